"""Invalid input from Python: laws that exit the process, foreign states and results."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import mjsheaf
from mjsheaf.errors import InputError
from tests.builders import REPOSITORY
from tests.commands import call

SHORT = {"time.end": 0.05}


def leave(_: float, sample: Any) -> Any:
    raise SystemExit(7)


def turn(_: float, sample: Any) -> Any:
    return 1j * sample.disagreement


@pytest.mark.parametrize(("law", "named"), [(leave, "SystemExit: 7"), (turn, "complex")])
def test_a_law_that_gives_no_velocity_is_one_error(law: Any, named: str) -> None:
    with pytest.raises(InputError, match=named):
        mjsheaf.simulate(mjsheaf.load_scenario("midpoint", SHORT), "ideal", controller=law)


def test_a_file_that_leaves_the_process_is_exit_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "law.py").write_text("raise SystemExit(5)\n")
    assert call("run", "midpoint", "--controller", f"{tmp_path / 'law.py'}:f", "--out", tmp_path / "out") == 2
    assert "SystemExit: 5" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_state_that_is_not_finite_is_refused_and_the_world_stays(wrong: float) -> None:
    world = mjsheaf.World(mjsheaf.load_scenario("midpoint", SHORT))
    world.step(10)
    before = world.get_state()
    with pytest.raises(InputError, match="finite"):
        world.set_state(np.full_like(before, wrong))
    np.testing.assert_array_equal(world.get_state(), before)
    world.step()


def test_part_of_a_result_is_not_saved(tmp_path: Path) -> None:
    result = mjsheaf.simulate(mjsheaf.load_scenario("paper", SHORT), "ideal")
    parts = [result.isel(time=slice(0, 0)), result.drop_vars("tracking_error"), result.isel(agent=[0])]
    for part in parts:
        part.encoding = result.encoding
        with pytest.raises(InputError, match="save: "):
            mjsheaf.save(part, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_unknown_field_of_steering_is_named_with_its_place(tmp_path: Path) -> None:
    description = yaml.safe_load((REPOSITORY / "models" / "otter.yaml").read_text())
    description["steering"]["foo"] = 1
    (tmp_path / "o.yaml").write_text(yaml.safe_dump(description))
    (tmp_path / description["mjcf"]).write_bytes((REPOSITORY / "models" / description["mjcf"]).read_bytes())
    with pytest.raises(InputError, match=r"steering\.foo: .*hand_point"):
        mjsheaf.load_vehicle(str(tmp_path / "o.yaml"))
