"""The points of a study.

Oracles: counting, and the laws that points keep: the same study has the same points, a longer one begins with those of
a shorter one.
"""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from mjsheaf.studies.plan import Draws, StudyFile, draw, points_of

PATHS = ["controller.gain", "vehicles.tau", "swarm.size", "agents.A1.heading", "physics.timestep"]
value = st.one_of(st.integers(-5, 5), st.floats(-1, 1), st.booleans(), st.text(max_size=3))
values = st.lists(value, min_size=1, max_size=4, unique_by=lambda one: (isinstance(one, bool), one))
DISTRIBUTIONS: dict[str, dict[str, Any]] = {
    "uniform": {"kind": "uniform", "low": -2, "high": 3},
    "loguniform": {"kind": "loguniform", "low": 0.01, "high": 30},
    "normal": {"kind": "normal", "mean": 1, "deviation": 2},
    "integers": {"kind": "integers", "low": 2, "high": 5},
    "choice": {"kind": "choice", "values": ["ring", 3, [1, 2]]},
}


@st.composite
def studies(make: st.DrawFn) -> StudyFile:
    paths = make(st.permutations(PATHS))
    cut = make(st.integers(0, 3))
    rows = make(st.integers(1, 3))
    return StudyFile.model_validate(
        {
            "scenario": "midpoint",
            "grid": {path: make(values) for path in paths[:cut]},
            "paired": {paths[3]: list(range(rows))} if make(st.booleans()) else {},
            "draws": {"count": 3, "values": {paths[4]: DISTRIBUTIONS["normal"]}} if make(st.booleans()) else None,
            "points": [{"time.end": k + 1} for k in range(make(st.integers(0, 3)))],
            "seeds": {"start": 3, "stop": 3 + make(st.integers(1, 4))} if make(st.booleans()) else None,
        }
    )


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # of a busy machine
@given(studies())
def test_points_are_the_product_in_order(study: StudyFile) -> None:
    points = list(points_of(study))
    assert len(points) == study.size
    assert [p.number for p in points] == list(range(len(points)))
    assert points == list(points_of(study))
    assert all(list(p.parameters) == study.paths for p in points)
    if study.seeds:
        n = study.seeds.stop - study.seeds.start
        assert [p.seed for p in points] == [*range(study.seeds.start, study.seeds.stop)] * (len(points) // n)
    else:
        assert all(p.seed is None and "seed" not in p.overrides for p in points)


def test_the_first_path_of_a_grid_changes_slowest() -> None:
    study = StudyFile(scenario="x", grid={"a": [1, 2], "b": ["p", "q", "r"]})
    found = [(p.parameters["a"], p.parameters["b"]) for p in points_of(study)]
    assert found == list(itertools.product([1, 2], ["p", "q", "r"]))


@pytest.mark.parametrize("kind", DISTRIBUTIONS)
@settings(deadline=None)
@given(count=st.integers(1, 20), more=st.integers(1, 20), seed=st.integers(0, 2**40))
def test_draws_are_kept_by_a_longer_study(kind: str, count: int, more: int, seed: int) -> None:
    def drawn(n: int, **others: Any) -> list[Any]:
        found = draw(Draws.model_validate({"count": n, "seed": seed, "values": {"x": DISTRIBUTIONS[kind], **others}}))
        return [row["x"] for row in found]

    assert drawn(count + more)[:count] == drawn(count)
    assert drawn(count, y=DISTRIBUTIONS["uniform"]) == drawn(count)


def test_draws_follow_their_distributions() -> None:
    rows = draw(Draws.model_validate({"count": 4000, "values": DISTRIBUTIONS}))

    def column(name: str) -> list[Any]:
        return [row[name] for row in rows]

    uniform, log, normal = (np.array(column(name)) for name in ("uniform", "loguniform", "normal"))
    assert -2 <= uniform.min() < -1.9
    assert 2.9 < uniform.max() <= 3
    assert log.min() >= 0.01
    assert log.max() <= 30
    np.testing.assert_allclose(np.median(log), np.sqrt(0.01 * 30), rtol=0.2)
    np.testing.assert_allclose([normal.mean(), normal.std()], [1, 2], atol=0.12)
    assert set(column("integers")) == {2, 3, 4, 5}
    assert {str(x) for x in column("choice")} == {"ring", "3", "[1, 2]"}


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"grid": {"a": []}}, "at least 1"),
        ({"paired": {"a": [1, 2], "b": [1]}}, "a has 2, b has 1"),
        ({"grid": {"a": [1]}, "paired": {"a": [1]}}, "a: is swept twice; give it once"),
        ({"grid": {"a": [True, 2, 1, 1.0]}}, "a: 1 is given twice; give each value once"),
        ({"grid": {"a": [1]}, "set": {"a": 2}}, "a: is both set and swept; give it once"),
        ({"grid": {"swarm.size": [1], "swarm": [{}]}}, "swarm: would overwrite swarm.size"),
        ({"grid": {"seed": [1]}, "seeds": {"stop": 3}}, "the field seed is given too"),
        ({"seeds": {"start": 3, "stop": 3}}, "must be above start"),
        ({"seeds": {"stop": 2_000_000}}, "at most 1000000"),
        ({"draws": {"count": 2, "values": {"a": {"kind": "uniform", "low": 1, "high": 1}}}}, "must be above low"),
        ({"draws": {"count": 2, "values": {"a": {"kind": "loguniform", "low": 0, "high": 1}}}}, "greater than 0"),
        ({"draws": {"count": 2, "values": {"a": {"kind": "integers", "low": 3, "high": 2}}}}, r"high \(2\)"),
        ({"grid": {"a": [1, [10**30]]}}, "number of 31 digits"),
        ({"grid": {"a": [1]}, "labels": {"b": "B (m)"}}, "b is not swept; expected a"),
        ({"points": [{"a": 1}, {"a": 2}], "names": ["one"]}, "names"),
        ({"points": [{"a": 1}, {"a": 2}], "names": ["one", "one"]}, "names"),
    ],
)
def test_what_does_not_fit_is_refused(fields: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        StudyFile.model_validate({"scenario": "midpoint", **fields})
