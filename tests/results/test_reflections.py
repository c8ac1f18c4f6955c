"""Notes of runs that end in another equilibrium than the formation's shape."""

from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.runs.diagnostics import describe_reflections
from tests.builders import build_scenario

PLACES = [[0.0, 0.0], [4.0, 0.0], [1.0, 2.0]]


def ends(measures: str, start: Any) -> list[str]:
    """Return the notes on a triangle that begins at `start`."""
    ids = ["A", "B", "C"]
    scenario = build_scenario(
        dict(zip(ids, start, strict=True)),
        {},
        [],
        time={"end": 20.0},
        controller={"gain": 1.0, "control_period": 0.02},
        communication=[{"between": pair, "measures": measures} for pair in (["A", "B"], ["B", "C"], ["C", "A"])],
        formations=[{"name": "f", "shape": "explicit", "members": ids, "displacements": PLACES}],
    )
    return list(describe_reflections(scenario.team, mjsheaf.simulate(scenario, backend="ideal")))


@pytest.mark.slow(first=True)
@pytest.mark.parametrize(
    ("measures", "start", "words"),
    [
        ("range", [[0.1, 0.0], [4.0, 0.1], [1.0, 1.8]], ""),
        ("range", [[5.0, 5.0], [5.1, 9.0], [3.1, 6.0]], ""),  # turned
        ("range", [[0.1, 0.0], [4.0, 0.1], [1.0, -1.8]], "mirror image"),
        ("range", [[0.0, 0.0], [4.5, 0.0], [1.0, 0.0]], "on a line"),
        ("bearing", [[0.1, 0.0], [4.0, 0.1], [1.0, 1.8]], ""),
        ("bearing", (-np.array(PLACES)).tolist(), "reflected in a point"),
    ],
)
def test_ends_in_other_equilibria_are_named(measures: str, start: Any, words: str) -> None:
    """A turned shape is no fault; a mirror image, a line and a point reflection are."""
    notes = ends(measures, start)
    assert len(notes) == bool(words)
    assert all(words in note for note in notes)
