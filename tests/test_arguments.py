"""Arguments of wrong types: one InputError that names the argument and what is accepted, before anything runs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import mjsheaf
from mjsheaf.errors import InputError
from mjsheaf.studies.plan import load_plan
from mjsheaf.studies.workers import local_workers
from tests.builders import mixed_scenario, names


def scenario() -> Any:
    return mixed_scenario(time={"end": 0.05})


WRONG: dict[str, tuple[Callable[[], Any], tuple[object, ...]]] = {
    "scenario None": (lambda: mjsheaf.simulate(None), ("scenario is None", "mjsheaf.load_scenario")),  # type: ignore[arg-type]
    "scenario by name": (lambda: mjsheaf.simulate("paper"), ("scenario is 'paper' (str)",)),  # type: ignore[arg-type]
    "backend": (lambda: mjsheaf.simulate(scenario(), 3), ("backend", 3, "physics, ideal")),  # type: ignore[arg-type]
    "engine": (lambda: mjsheaf.simulate(scenario(), engine=None), ("engine", None, "mujoco, fused")),  # type: ignore[arg-type]
    "threads": (lambda: mjsheaf.simulate(scenario(), threads="2"), ("threads is '2' (str)", 1)),  # type: ignore[arg-type]
    "threads true": (lambda: mjsheaf.simulate(scenario(), threads=True), ("threads is True",)),
    "controller": (lambda: mjsheaf.simulate(scenario(), controller=3), ("controller", "law(t, sample)", "int")),  # type: ignore[arg-type]
    "progress": (lambda: mjsheaf.simulate(scenario(), progress=3), ("progress is 3",)),  # type: ignore[arg-type]
    "many None": (lambda: mjsheaf.simulate_many(None), ("scenarios", "NoneType", "list of Scenarios")),  # type: ignore[arg-type]
    "many of one": (lambda: mjsheaf.simulate_many(scenario()), ("scenarios", "list of Scenarios")),
    "workers": (lambda: mjsheaf.simulate_many([scenario()], workers="2"), ("workers is '2' (str)", 1)),  # type: ignore[arg-type]
    "workers of a study": (lambda: local_workers("2").__enter__(), ("workers is '2' (str)", 1)),  # type: ignore[arg-type]
    "many progress": (lambda: mjsheaf.simulate_many([scenario()], progress="no"), ("progress is 'no' (str)",)),  # type: ignore[arg-type]
    "many backend": (lambda: mjsheaf.simulate_many([], None), ("backend", None)),  # type: ignore[arg-type]
    "check None": (lambda: mjsheaf.check(None, trial=False), ("scenario is None",)),  # type: ignore[arg-type]
    "check radius": (
        lambda: mjsheaf.check(scenario(), radius="1", trial=False),  # type: ignore[arg-type]
        ("radius is '1' (str)", "positive number"),
    ),
    "check rate": (lambda: mjsheaf.check(scenario(), rate=[1], trial=False), ("rate is [1] (list)", "positive number")),  # type: ignore[arg-type]
    "check rho": (lambda: mjsheaf.check(scenario(), rho="x", trial=False), ("rho",)),  # type: ignore[arg-type]
    "overrides": (lambda: mjsheaf.load_scenario("paper", 3), ("overrides is 3 (int)", "field paths")),  # type: ignore[arg-type]
    "overrides key": (lambda: mjsheaf.load_scenario("paper", {3: 3}), ("a key of overrides is 3 (int)",)),  # type: ignore[dict-item]
    "seed": (lambda: scenario().with_seed("x"), ("seed is 'x' (str)",)),
    "World None": (lambda: mjsheaf.World(None), ("scenario is None",)),
    "steps": (lambda: mjsheaf.World(scenario()).step("2"), ("n is '2' (str)", 0)),  # type: ignore[arg-type]
    "save": (lambda: mjsheaf.save(None, "x"), ("result is None", "mjsheaf.simulate")),  # type: ignore[arg-type]
    "vehicle": (lambda: mjsheaf.load_vehicle(3), ("source is 3 (int)",)),  # type: ignore[arg-type]
    "study": (lambda: load_plan(None), ("source is None",)),  # type: ignore[arg-type]
    "grid": (lambda: load_plan("midpoint", grid=[1]), ("grid is [1] (list)",)),  # type: ignore[arg-type]
    "study overrides": (lambda: load_plan("midpoint", overrides="a=3"), ("overrides", "field paths")),  # type: ignore[arg-type]
    "study dots": (lambda: load_plan("midpoint", overrides={"a" + ".a" * 5000: 3}), ("--set", "10001 characters")),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_argument_is_named(name: str) -> None:
    call, expected = WRONG[name]
    with pytest.raises(InputError) as caught:
        call()
    assert names(str(caught.value), *expected), str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_place_of_no_kind_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = mjsheaf.simulate(scenario(), "ideal")
    for place, formats, told in ((3, ["png"], "directory is 3"), ("x", "png", "formats is 'png'")):
        with pytest.raises(InputError, match=told):
            mjsheaf.save(run, place, formats=formats)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []
