"""Sections made in Python are as strict as files, with tuples and numpy's values for lists and numbers.

Oracle: the same section read from plain values, as YAML gives them.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf.errors import InputError
from mjsheaf.law.paths import Lissajous, Waypoints
from mjsheaf.media.flow import FlowField, Source
from mjsheaf.media.varying import Disturbance
from mjsheaf.scenario.scenario import Agent
from mjsheaf.section import Section
from mjsheaf.team import LinearEdge

PAIRS: list[tuple[type[Section], dict[str, Any], dict[str, Any]]] = [
    (Agent, {"id": "A1", "position": np.array([1, 2])}, {"id": "A1", "position": [1.0, 2.0]}),
    (
        Lissajous,
        {"amplitude": (1, 2), "rate": np.ones(2), "phase": [0, np.float64(0.5)], "pull": np.int64(1)},
        {"kind": "lissajous", "amplitude": [1.0, 2.0], "rate": [1.0, 1.0], "phase": [0.0, 0.5], "pull": 1.0},
    ),
    (
        FlowField,
        {"dimension": 2, "core": 0, "sources": (Source(centre=[1, 2], alpha=3),)},
        {"dimension": 2, "core": 0.0, "sources": [{"centre": [1.0, 2.0], "alpha": 3.0}]},
    ),
    (
        LinearEdge,
        {"between": ("A", "B"), "weight": 2 * np.eye(2), "offset": np.zeros(2)},
        {"between": ["A", "B"], "weight": [[2.0, 0.0], [0.0, 2.0]], "offset": [0.0, 0.0]},
    ),
]


@pytest.mark.parametrize(("kind", "given", "plain"), PAIRS, ids=lambda x: getattr(x, "__name__", ""))
def test_what_python_gives_is_what_a_file_gives(
    kind: type[Section], given: dict[str, Any], plain: dict[str, Any]
) -> None:
    section = kind(**given)
    assert section == kind.model_validate(plain)
    assert section.model_dump(mode="json", exclude_defaults=False) == kind.model_validate(plain).model_dump(mode="json")
    with pytest.raises(ValueError, match="frozen"):
        section.__setattr__(next(iter(given)), None)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Disturbance(bound=True), "Disturbance: bound"),
        (lambda: Disturbance(bund=1), "Disturbance: bund: unknown field"),  # type: ignore[call-arg]
        (lambda: LinearEdge(between=["A", "B"], map={"tail": [[1]]}), "LinearEdge: map.head"),  # type: ignore[arg-type]
        (lambda: Waypoints(points=[[1, 2], [3]], speed=1), "Waypoints: points.1"),
        (lambda: Waypoints(points=[], speed=1), "Waypoints: points"),
    ],
)
def test_what_a_file_may_not_hold_python_may_not_give(make: Any, field: str) -> None:
    with pytest.raises(InputError, match=field):
        make()
