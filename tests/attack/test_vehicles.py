"""Malicious vehicles: MuJoCo files that reach outside, contradict themselves, or change while they are read.

Oracle: the contract. Each is accepted, or refused in one line with exit code 2 (1 where `check` then finds an
assumption open), within bounded memory and time.
"""

import os
import shutil
import threading
from pathlib import Path

import pytest

from mjsheaf.errors import InputError
from mjsheaf.vehicles.loading import load_vehicle
from tests.attack.test_surroundings import limited, run
from tests.builders import DATA

BODY = (DATA / "raft.xml").read_text()
LOL = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 10))

HARMFUL = {
    "billion laughs": '<!DOCTYPE m [<!ENTITY l0 "ha">' + LOL + "]>" + BODY.replace('model="raft"', 'model="&l9;"'),
    "external entity": '<!DOCTYPE m [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + BODY.replace("raft", "&x;", 1),
    "include of itself": BODY.replace("<asset>", '<include file="raft.xml"/><asset>'),
    "include outside": BODY.replace("<asset>", '<include file="../outside.xml"/><asset>'),
    "plugin": BODY.replace("<asset>", '<extension><plugin plugin="mujoco.pid"/></extension><asset>'),
    "huge arena": BODY.replace("<default>", '<size memory="900G"/><default>', 1),
    "deep": BODY.replace('<geom type="box"', '<body pos="0 0 0">' * 20_000 + "</body>" * 20_000 + '<geom type="box"'),
    "not a number": BODY.replace('mass="60"', 'mass="nan"'),
    "no mass": BODY.replace('mass="60"', 'mass="0"'),
    "truncated": BODY[: len(BODY) // 2],
    "empty": "",
}


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("name", HARMFUL)
def test_a_harmful_file_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    shutil.copy(DATA / "raft.yaml", tmp_path)
    (tmp_path / "raft.xml").write_text(HARMFUL[name])
    (tmp_path / "mine.yaml").write_text(
        "time: {end: 0.1}\ncontroller: {gain: 1}\nsensing: [[A1, T1]]\ntargets: [{id: T1, position: [1, 1]}]\n"
        "agents: [{id: A1, position: [0, 0], vehicle: raft.yaml}]\nname: mine\n"
    )
    done = run("check", "mine.yaml", cwd=tmp_path, timeout=120, preexec_fn=limited(12 << 10))
    assert done.returncode in (0, 1, 2), (done.returncode, done.stderr[-2000:])
    assert "Traceback" not in done.stderr
    told = [line for line in done.stderr.splitlines() if not line.endswith("since the start")]  # that is progress
    assert len(told) == (0 if done.returncode == 0 else 1), done.stderr[-2000:]
    assert "root:" not in done.stdout + done.stderr  # of /etc/passwd
    if name not in ("huge arena", "external entity"):
        assert done.returncode == 2, done.stderr


@pytest.mark.slow
def test_a_vehicle_that_changes_while_it_is_read_is_read_as_it_was_or_refused(tmp_path: Path) -> None:
    """Another process writes the files in place, in parts: what is loaded is one of the two, or an error names it."""
    whole = {name: (DATA / name).read_text() for name in ("raft.xml", "raft.yaml")}
    other = {"raft.xml": whole["raft.xml"].replace('mass="60"', 'mass="90"'), "raft.yaml": whole["raft.yaml"]}
    for name, text in whole.items():
        (tmp_path / name).write_text(text)
    stop, masses, refused = threading.Event(), set(), []

    def write() -> None:
        while not stop.is_set():
            for texts in (other, whole):
                for name, text in texts.items():
                    with (tmp_path / name).open("w") as file:
                        for start in range(0, len(text), 200):
                            file.write(text[start : start + 200])
                            file.flush()
                        os.fsync(file.fileno())

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for _ in range(150):
            try:
                masses.add(round(load_vehicle("raft.yaml", tmp_path).mass, 6))
            except InputError as error:
                refused.append(str(error))
    finally:
        stop.set()
        writer.join()
    assert masses <= {60.0, 90.0}
    assert all("raft" in message for message in refused)
    assert len(masses) + len(refused) > 0
