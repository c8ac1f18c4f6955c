"""MuJoCo's warnings go nowhere, and it reads numbers as they are written, in any locale."""

import locale
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import mujoco
import numpy as np
import pytest

from mjsheaf.errors import InputError, UnstableError
from mjsheaf.mujoco_import import quiet, refusing
from tests.commands import python
from tests.loop.one_vehicle import alone

BOX = """<mujoco><asset><mesh name="hull" file="hull.obj"/></asset><worldbody><body name="hull">
<geom type="mesh" mesh="hull" mass="1.5"/><site name="s"/></body></worldbody></mujoco>"""
CORNERS = [(2.5 * a, 1.5 * b, 1.2 * c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
FACES = ((1, 2, 4), (1, 4, 3), (5, 7, 8), (5, 8, 6), (1, 5, 6), (1, 6, 2), (3, 4, 8), (3, 8, 7), (1, 3, 7), (1, 7, 5),
         (2, 6, 8), (2, 8, 4))  # fmt: skip


def test_a_bad_step_leaves_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    world = alone("hull")
    world.data.qvel[:] = 1e12
    with pytest.raises(UnstableError):
        world.step(10)
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


def test_the_handler_from_before_returns_after_the_last_thread() -> None:
    seen: list[str] = []
    meet = Barrier(2, timeout=10)

    def one(first: bool) -> None:
        with quiet():
            meet.wait()
            if not first:
                meet.wait()  # the other has left
                _warn()
        if first:
            meet.wait()

    mujoco.set_mju_user_warning(seen.append)
    try:
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(one, (True, False)))
        assert not seen
        _warn()
        assert len(seen) == 1
    finally:
        mujoco.set_mju_user_warning(None)


def _warn() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qvel[:] = np.nan
    mujoco.mj_step(model, data)


def test_numbers_have_points_while_mujoco_reads() -> None:
    before = locale.setlocale(locale.LC_NUMERIC)
    locale.setlocale(locale.LC_NUMERIC, "C.UTF-8")
    try:
        with refusing("it"):
            assert locale.setlocale(locale.LC_NUMERIC) == "C"
        assert locale.setlocale(locale.LC_NUMERIC) == "C.UTF-8"
        with pytest.raises(InputError, match="it: "), refusing("it"):
            mujoco.MjSpec.from_string("<mujoco>")
        assert locale.setlocale(locale.LC_NUMERIC) == "C.UTF-8"
    finally:
        locale.setlocale(locale.LC_NUMERIC, before)


@pytest.mark.long
def test_a_mesh_has_its_inertia_under_a_locale_with_decimal_commas(tmp_path: Path) -> None:
    made = subprocess.run(
        ["localedef", "-i", "de_DE", "-f", "UTF-8", str(tmp_path / "de_DE.UTF-8")], capture_output=True, check=False
    )
    if made.returncode:
        pytest.skip("no locale can be made here")
    obj = "".join("v {} {} {}\n".format(*c) for c in CORNERS) + "".join("f {} {} {}\n".format(*f) for f in FACES)
    (tmp_path / "hull.obj").write_text(obj)
    (tmp_path / "hull.xml").write_text(BOX)
    (tmp_path / "hull.yaml").write_text(
        "summary: a hull\nmjcf: hull.xml\ndomain: surface\ndrag: {linear: [1, 1, 1], angular: [1, 1, 1]}\n"
        "attitude: {frequency: 1}\nhydrostatics: {heave: 1, roll: 1, pitch: 1}\ndrifts: true\n"
    )
    code = (
        "import locale, mjsheaf; locale.setlocale(locale.LC_ALL, 'de_DE.UTF-8'); "
        "print(*(repr(float(x)) for x in mjsheaf.load_vehicle('hull.yaml').inertia.diagonal()))"
    )
    found = np.array(python(code, tmp_path, LOCPATH=str(tmp_path)).stdout.split(), dtype=float)
    a, b, c = 2.5**2, 1.5**2, 1.2**2
    np.testing.assert_allclose(found, [0.5 * (b + c), 0.5 * (a + c), 0.5 * (a + b)], rtol=1e-6)
