"""From what a user asks to a plan: names, files, command-line values, and one line for what is wrong."""

from pathlib import Path
from typing import Any

import pytest

from mjsheaf.errors import InputError, ScenarioError
from mjsheaf.files import list_studies
from mjsheaf.studies.plan import load_plan, parse_grid, parse_seeds


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a=1", [1]),
        ("a=0.1,1,1e1", [0.1, 1, 10.0]),
        ("a=ring,small_world", ["ring", "small_world"]),
        ("a.b=[1, 2],[3, 4]", [[1, 2], [3, 4]]),
        ("a='x, y',true,null", ["x, y", True, None]),
        ("a={kind: lissajous, rate: [1, 2]},null", [{"kind": "lissajous", "rate": [1, 2]}, None]),
    ],
)
def test_values_of_a_grid_are_yaml(text: str, values: list[Any]) -> None:
    assert parse_grid(text) == (text.partition("=")[0], values)


@pytest.mark.parametrize("text", ["a", "a=", "=1", "a=[1", "a=1]", "a=1,,2", "a=],[", "a=!x 1", "a= "])
def test_a_grid_that_is_none(text: str) -> None:
    with pytest.raises(ScenarioError, match="--grid"):
        parse_grid(text)


@pytest.mark.parametrize("text", ["", "3", "3:", ":3", "3:3", "4:3", "-1:3", "0:1.5", "0:" + 30 * "9", f"0:{2**63}"])
def test_seeds_that_are_none(text: str) -> None:
    with pytest.raises(ScenarioError, match="--seeds"):
        parse_seeds(text)


def test_seeds_are_half_open() -> None:
    assert parse_seeds("3:5") == (3, 5)
    assert parse_seeds(f"{2**63 - 2}:{2**63 - 1}") == (2**63 - 2, 2**63 - 1)
    assert [p.seed for p in load_plan("midpoint", seeds=(3, 5), backend="ideal").points] == [3, 4]


def test_a_study_file_and_what_is_given_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(
        "summary: a question\nscenario: midpoint\nbackend: ideal\nset: {time.end: 0.5}\n"
        "grid: {controller.gain: [1, 2]}\nseeds: {stop: 3}\n"
    )
    plan = load_plan(str(path))
    assert (plan.name, len(plan.points), plan.study.set) == ("own", 6, {"time.end": 0.5})
    given: dict[str, Any] = {"grid": {"vehicles.tau": [0.1, 0.2]}, "seeds": (0, 1), "overrides": {"time.end": 1}}
    plan = load_plan(str(path), **given, backend="physics")
    assert [list(p.overrides) for p in plan.points] == 4 * [["controller.gain", "vehicles.tau", "seed"]]
    assert (plan.study.backend, plan.study.set) == ("physics", {"time.end": 1})
    with pytest.raises(ScenarioError, match="swept by the study itself"):
        load_plan(str(path), grid={"controller.gain": [5]})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scenario: nowhere\n", "neither a file nor one of"),
        ("scenario: midpoint\ngird: {a: [1]}\n", "gird: unknown field"),
        (
            "scenario: midpoint\ngrid: {controller.gian: [1, 2]}\n",
            "controller.gian: unknown field.*none of 2 points is valid",
        ),
        ("scenario: midpoint\ngrid: {controller.gain: [.nan]}\n", "nan"),
        ("scenario: midpoint\ndraws: {count: 2, values: {a: {kind: cauchy}}}\n", "cauchy"),
        (
            "scenario: midpoint\ndraws: {count: 2, values: {a: {kind: normal, mean: 0, deviation: 1, low: 2}}}\n",
            "draws.values.a.low: unknown field; expected deviation, kind, mean",
        ),
        ('scenario: midpoint\ngrid: {summary: ["\\ud800", b]}\n', "line 2, column 18: half of a surrogate pair"),
    ],
)
def test_a_bad_study_file_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        load_plan(str(path))
    assert "\n" not in str(caught.value)


def test_unknown_names_tell_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"no such study or scenario; expected bound, failures, gain, .*midpoint"):
        load_plan("nothing")
    with pytest.raises(ScenarioError, match="is a directory"):
        load_plan(str(tmp_path))


@pytest.mark.parametrize(
    ("grid", "seeds"),
    [
        ({"controller.gain": [-1, 1]}, (0, 21)),
        ({"controller.gain": [*range(-18, 0), 1]}, (0, 3)),
        ({"time.end": [1.0 + k for k in range(300)], "controller.gain": [-1, -2, -3, 1]}, None),
        ({"controller.gain": [-1, 1], "time.end": [1.0 + k for k in range(300)]}, (0, 50)),
    ],
)
def test_the_points_that_are_tried_come_from_all_over_the_study(
    grid: dict[str, list[Any]], seeds: tuple[int, int] | None
) -> None:
    assert load_plan("midpoint", grid=grid, seeds=seeds, backend="ideal").points
    with pytest.raises(ScenarioError, match=r"controller.gain.*none of 20 points from all over the study is valid"):
        load_plan("midpoint", grid={**grid, "controller.gain": [-1, -2]}, seeds=(0, 50), backend="ideal")


@pytest.mark.parametrize(
    ("grid", "overrides", "said"),
    [
        ({"agents.A1.heading": [1, 2], "agents.0.heading": [3]}, {}, "agents.0.heading: .* same list as A1; name all"),
        ({"agents.0": [{}], "agents.A1.heading": [3]}, {}, "agents.A1.heading: .* same list as 0; name all one way"),
        ({"agents.A1.heading": [1, 2]}, {"agents.0.heading": 3}, "agents.A1.heading: .* same list as 0"),
        (
            {"controller": [{"gain": 1}, {"gain": 2}]},
            {"controller.gain": 5},
            "controller: would overwrite controller.g",
        ),
        ({"controller": [{}], "controller.gain": [1]}, {"controller.gain": 5}, "would overwrite"),
    ],
)
def test_a_field_has_one_value(grid: dict[str, list[Any]], overrides: dict[str, Any], said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        load_plan("midpoint", grid=grid, overrides=overrides, backend="ideal")


def test_fields_within_what_is_set_may_be_swept() -> None:
    overrides = {"controller": {"gain": 5}, "agents.0.heading": 1, "agents.A1.position": [0, 0]}
    plan = load_plan("midpoint", grid={"controller.gain": [1, 2]}, overrides=overrides, backend="ideal")
    assert len(plan.points) == 2


def test_a_seed_matters_to_swarms() -> None:
    assert load_plan("swarm", grid={"swarm.size": [4, 6]}, backend="ideal").seed_matters
    assert not load_plan("midpoint", backend="ideal").seed_matters


@pytest.mark.parametrize("name", sorted(list_studies()))
def test_shipped_studies_are_legal(name: str) -> None:
    assert load_plan(name).points
