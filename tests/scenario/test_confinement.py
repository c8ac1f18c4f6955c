"""Files named in a scenario stay inside its directory, nothing is executed, and a run's directory is complete.

Oracle: the contract; files of a secret kind outside the scenario's directory, which nothing may open.
"""

import os
import shutil
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
import yaml

from mjsheaf import load_scenario, load_vehicle, simulate
from mjsheaf.errors import InputError, ScenarioError
from mjsheaf.files import confined
from mjsheaf.runs.publish import write_scenario
from tests.builders import DATA, ONE_BOAT, TETRAHEDRON
from tests.commands import answer_of, is_refusal
from tests.scenario.mutations import in_time


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A directory with the raft in boats/, and a copy of it outside."""
    for folder in (tmp_path / "inside" / "boats", tmp_path / "outside"):
        folder.mkdir(parents=True)
        for suffix in (".yaml", ".xml"):
            shutil.copy(DATA / f"raft{suffix}", folder)
        (folder / "hull.obj").write_text(TETRAHEDRON)
    return tmp_path / "inside"


def write(place: Path, **fields: Any) -> Path:
    path = place / "mine.yaml"
    path.write_text(yaml.safe_dump({**ONE_BOAT, **fields}))
    return path


def agent(vehicle: str) -> list[dict[str, Any]]:
    return [{"id": "A1", "position": [0, 0], "vehicle": vehicle}]


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


FIELDS = {
    "agents.0.vehicle": "agents: [{id: A1, position: [0, 0], vehicle: %s}]",
    "vehicles.agents": "vehicles: {agents: %s}",
    "vehicles.targets": "vehicles: {targets: %s}",
    "swarm.vehicle": "{agents: [], sensing: [], swarm: {size: 2, about: T1, vehicle: %s}}",
}
LINKED = ("link.yaml", "linked/raft.yaml")
WRITTEN = ("../outside/raft.yaml", "boats/../../outside/raft.yaml", "{tmp}/outside/raft.yaml")


@pytest.mark.parametrize("vehicle", [*LINKED, *WRITTEN, "/etc/passwd.yaml", "../inside2/x.yml"])
@pytest.mark.parametrize("field", FIELDS)
def test_a_vehicle_outside_is_refused(vehicle: str, field: str, place: Path) -> None:
    (place / "link.yaml").symlink_to(place.parent / "outside" / "raft.yaml")
    (place / "linked").symlink_to(place.parent / "outside")
    path = write(place, **yaml.safe_load(FIELDS[field] % vehicle.replace("{tmp}", str(place.parent))))
    for backend in ("ideal", "physics"):
        answer = answer_of("run", path, "--backend", backend, "--no-video", "--out", place / "out")
        assert is_refusal(answer, f"{path}: {field}:"), answer
        assert f"lies outside {place}; expected a file in that directory or below it" in answer.err
    assert not (place / "out").exists()


@pytest.mark.parametrize(
    "vehicle", ["boats/raft.yaml", "./boats/../boats/raft.yaml", "{tmp}/inside/boats/raft.yaml", "hull"]
)
def test_a_vehicle_inside_is_not(vehicle: str, place: Path) -> None:
    path = write(place, agents=agent(vehicle.replace("{tmp}", str(place.parent))))
    assert simulate(load_scenario(path)).attrs["status"] == "finished"


def test_a_person_may_name_any_file(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, outside = write(place), place.parent / "outside"
    monkeypatch.chdir(outside)
    for vehicle in (str(outside / "raft.yaml"), "raft.yaml"):
        scenario = load_scenario(path, {"vehicles.agents": vehicle})
        assert simulate(scenario).sizes["time"] == 5


@pytest.mark.parametrize("name", ["\0", "a\0b", "x" * 5000, "/" * 5000 + "x" * 5000])
def test_what_is_no_path_is_refused_in_few_words(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        confined(name, tmp_path)
    assert len(str(refused.value)) < 500


@pytest.mark.parametrize("name", ["raft.yaml", "raft.xml", "pipe.obj", "terms.py"])
def test_a_pipe_is_not_waited_on(name: str, place: Path) -> None:
    pipe = place / "boats" / name
    edit(place / "boats" / "raft.xml", "</mujoco>", '<asset><mesh name="m" file="pipe.obj"/></asset></mujoco>')
    pipe.unlink(missing_ok=True)
    os.mkfifo(pipe)
    field = r"controller\.custom\.steeper: file: " if name == "terms.py" else ""
    terms = {"controller.custom.steeper": {"file": str(pipe)}}
    with in_time(), pytest.raises(InputError, match=rf"{field}.*is no regular file") as caught:
        load_scenario("midpoint", terms) if field else load_vehicle(str(place / "boats" / "raft.yaml"))
    assert "\n" not in str(caught.value)


def test_links_in_a_circle_are_refused(place: Path) -> None:
    (place / "a.yaml").symlink_to(place / "b.yaml")
    (place / "b.yaml").symlink_to(place / "a.yaml")
    with pytest.raises(ScenarioError, match=r"agents\.0\.vehicle|no path"):
        simulate(load_scenario(write(place, agents=agent("a.yaml"))))


ASSET = '<material name="livery"'
OUTSIDE = {
    "the file": ("yaml", "mjcf: raft.xml", "mjcf: ../../outside/raft.xml", "mjcf: "),
    "the file by its full path": ("yaml", "mjcf: raft.xml", "mjcf: {tmp}/outside/raft.xml", "mjcf: "),
    "the file by a link": ("yaml", "mjcf: raft.xml", "mjcf: link.xml", "mjcf: "),
    "an include": ("xml", "<default>", '<include file="../../outside/raft.xml"/><default>', "<include>"),
    "a mesh": ("xml", ASSET, f'<mesh name="m" file="../../outside/hull.obj"/>{ASSET}', "<mesh>"),
    "a mesh by a link": ("xml", ASSET, f'<mesh name="m" file="link.obj"/>{ASSET}', "<mesh>"),
    "a mesh by characters": ("xml", ASSET, f'<mesh name="m" file="&#46;./&#46;./outside/x.obj"/>{ASSET}', "<mesh>"),
    "a texture": ("xml", ASSET, f'<texture name="t" type="2d" file="/etc/passwd"/>{ASSET}', "<texture>"),
    "a side of a texture": ("xml", ASSET, f'<texture name="t" type="cube" fileup="../../x.png"/>{ASSET}', "<texture>"),
    "a height field": ("xml", ASSET, f'<hfield name="h" size="1 1 1 1" file="../../x.png"/>{ASSET}', "<hfield>"),
    "a skin": ("xml", ASSET, f'<skin name="s" file="/dev/zero"/>{ASSET}', "<skin>"),
    "a model": ("xml", ASSET, f'<model name="m" file="../../outside/raft.xml"/>{ASSET}', "<model>"),
    "meshdir": ("xml", "<compiler ", '<compiler meshdir="../../outside" ', "<mesh>"),
    "assetdir": ("xml", "<compiler ", '<compiler assetdir="{tmp}/outside" ', "<mesh>"),
    "meshdir without the mesh's folder": (
        "xml", "<compiler ", '<compiler strippath="true" meshdir="../../outside" ', "<mesh>"
    ),
    "an extension": ("xml", "<default>", "<extension/><default>", "plugins are code"),
    "a plugin": ("xml", ASSET, f'<mesh name="m"><plugin plugin="mujoco.sdf.nut"/></mesh>{ASSET}', "plugins are code"),
    "an entity": ("xml", "<mujoco", '<!DOCTYPE mujoco [<!ENTITY x SYSTEM "file:///etc/passwd">]><mujoco', "DOCTYPE"),
    "a bomb": ("xml", "<mujoco", '<!DOCTYPE m [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><mujoco', "DOCTYPE"),
    "another language": ("xml", "<mujoco model", "<robot name", "not XML"),
    "a folder": ("yaml", "mjcf: raft.xml", "mjcf: .", "is no regular file"),
    "nothing": ("yaml", "mjcf: raft.xml", "mjcf: none.xml", "cannot be read: No such file"),
}  # fmt: skip


@pytest.mark.parametrize("what", OUTSIDE)
def test_what_a_vehicle_names_outside_its_directory_is_refused(what: str, place: Path) -> None:
    suffix, old, new, message = OUTSIDE[what]
    boats, outside = place / "boats", place.parent / "outside"
    (boats / "link.xml").symlink_to(outside / "raft.xml")
    (boats / "link.obj").symlink_to(outside / "hull.obj")
    if "<mesh>" in message:
        edit(boats / "raft.xml", ASSET, f'<mesh name="own" file="hull.obj"/>{ASSET}')
    edit(boats / f"raft.{suffix}", old, new.replace("{tmp}", str(place.parent)))
    with pytest.raises(InputError) as refused:
        load_vehicle(str(boats / "raft.yaml"))
    assert message in str(refused.value)
    if "outside" in new:
        assert "lies outside" in str(refused.value)
    with pytest.raises(InputError, match=r"agents\.A1\.vehicle: "):
        simulate(load_scenario(write(place, agents=agent("boats/raft.yaml"))))


def whole(place: Path) -> None:
    """Give the raft an include, in a folder, and a mesh in a folder that the compiler's settings name."""
    boats = place / "boats"
    for folder in ("parts", "meshes"):
        (boats / folder).mkdir()
    (boats / "hull.obj").rename(boats / "meshes" / "hull.obj")
    (boats / "parts" / "assets.xml").write_text('<mujoco><asset><material name="own"/></asset></mujoco>')
    edit(boats / "raft.xml", "<compiler ", '<compiler meshdir="meshes" ')
    edit(boats / "raft.xml", "<default>", '<include file="parts/assets.xml"/><default>')
    edit(boats / "raft.xml", ASSET, f'<mesh name="m" file="hull.obj"/>{ASSET}')
    edit(boats / "raft.xml", "<geom ", '<geom type="mesh" mesh="m" mass="0" contype="0" conaffinity="0"/><geom ')


@pytest.mark.slow
@pytest.mark.usefixtures("without_plots")
def test_a_run_takes_its_vehicles_along(place: Path, tmp_path: Path) -> None:
    whole(place)
    (place / "raft.yaml").write_text((place / "boats" / "raft.yaml").read_text().replace("raft.xml", "boats/raft.xml"))
    fields: dict[str, Any] = {
        "agents": [*agent("boats/raft.yaml"), {"id": "A2", "position": [1, 1], "vehicle": "hull"}]
    }
    fields |= {"vehicles": {"targets": "raft.yaml"}, "communication": [["A1", "A2"]]}
    path = write(place, **fields)
    assert answer_of("run", path, "--no-video", "--out", place / "out").code == 0
    first = simulate(load_scenario(path))
    moved = tmp_path / "moved"
    (place / "out").rename(moved)
    shutil.rmtree(place)
    copies = {p.relative_to(moved / "vehicles").as_posix() for p in (moved / "vehicles").rglob("*") if p.is_file()}
    own = {"raft.yaml", "raft.xml", "parts/assets.xml", "meshes/hull.obj"}
    assert {f"raft/{name}" for name in own} <= copies
    assert {f"raft_2/{name}" for name in ("raft.yaml", "boats/raft.xml")} <= copies
    assert str(place) not in (moved / "scenario.yaml").read_text()
    xr.testing.assert_identical(first, simulate(load_scenario(moved / "scenario.yaml")))
    again = ("run", moved / "scenario.yaml", "--no-video", "--out", tmp_path / "again")
    assert answer_of(*again).code == 0
    assert (tmp_path / "again" / "vehicles" / "raft_2" / "raft.yaml").is_file()


@pytest.mark.slow
@pytest.mark.usefixtures("without_plots")
@pytest.mark.parametrize("what", ["added", "edited", "linked", "instead"])
def test_what_a_person_puts_among_a_run_s_vehicles_is_not_lost(place: Path, what: str) -> None:
    out = place / "out"
    path = write(place, agents=agent("boats/raft.yaml"))
    command = ("run", path, "--backend", "ideal", "--no-video", "--out", out)
    for _ in range(2):  # as mjsheaf left it, it is replaced
        assert answer_of(*command).code == 0
    mine = out / "vehicles" / "raft" / {"edited": "raft.xml"}.get(what, "mine.txt")
    if what == "linked":
        mine.symlink_to(place / "boats")
    elif what == "instead":
        mine = out / "vehicles"
        shutil.rmtree(mine)
        mine.write_text("mine")
    else:
        mine.write_text("mine")
    told = f"holds '{mine.relative_to(out)}', which mjsheaf did not write; move it"
    assert is_refusal(answer_of(*command), told)
    assert mine.is_symlink() or mine.read_text() == "mine"


def test_a_resolved_scenario_without_own_vehicles_has_no_folder(tmp_path: Path) -> None:
    write_scenario(load_scenario("midpoint"), tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["scenario.yaml"]


@pytest.mark.parametrize(
    "value",
    [
        "!!python/object/apply:os.system ['touch {mark}']",
        "!!python/object/apply:subprocess.check_call [[touch, '{mark}']]",
        "!!python/object/new:os.system ['touch {mark}']",
        "!!python/name:os.system",
        "!<tag:yaml.org,2002:python/object/apply:os.system> ['touch {mark}']",
        "%TAG !p! tag:yaml.org,2002:python/\n---\nx: !p!object/apply:os.system ['touch {mark}']",
    ],
)
@pytest.mark.parametrize("file", ["scenario", "vehicle", "override"])
def test_nothing_in_a_file_is_executed(value: str, file: str, place: Path) -> None:
    mark = place / "mark"
    text = value.replace("{mark}", str(mark))
    path = write(place, agents=agent("boats/raft.yaml"))
    arguments = []
    if file == "override":
        arguments = ["--set", f"summary={text}"]
    else:
        victim = path if file == "scenario" else place / "boats" / "raft.yaml"
        victim.write_text(text if text.startswith("%") else f"{victim.read_text()}\nsource: {text}\n")
    assert answer_of("run", path, "--no-video", "--out", place / "out", *arguments).code == 2
    assert not mark.exists()
    assert not (place / "out").exists()
