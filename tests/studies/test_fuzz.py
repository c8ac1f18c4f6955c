"""Study files as nobody should write them: each is a plan, or refused in one line, and leaves no partial directory.

Oracle: the contract on errors. Mutations are those of scenario files; nothing is run.
"""

import json
import warnings
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjsheaf.errors import InputError
from mjsheaf.reading import dump_yaml
from mjsheaf.studies import load_plan
from mjsheaf.studies.directory import open_directory
from tests.scenario.mutations import FUZZ, in_time, mutated_text, mutated_tree

FILES = 400
"""Mutated files for each of the studies below, as trees and as texts."""

STUDIES: dict[str, dict[str, Any]] = {
    "grid": {
        "summary": "a question",
        "scenario": "midpoint",
        "backend": "ideal",
        "set": {"time.end": 0.5, "agents.A1.heading": 3},
        "grid": {"controller.gain": [0.5, 1, 2.0], "spread.position": [1, 0]},
        "seeds": {"start": 1, "stop": 4},
        "measure": "tracking_error",
        "labels": {"controller.gain": "gain (1/s)"},
        "trajectories": True,
    },
    "draws": {
        "scenario": "midpoint",
        "draws": {
            "count": 3,
            "seed": 7,
            "values": {
                "controller.gain": {"kind": "loguniform", "low": 0.1, "high": 10},
                "spread.position": {"kind": "uniform", "low": 0, "high": 2},
                "agents.A1.heading": {"kind": "normal", "mean": 0, "deviation": 30},
                "seed": {"kind": "integers", "low": 0, "high": 9},
                "vehicles.agents": {"kind": "choice", "values": ["hull", "wamv"]},
            },
        },
    },
    "lists": {
        "scenario": "swarm",
        "backend": "ideal",
        "points": [{"swarm.size": 3}, {"swarm.size": 5, "swarm.graph": "ring"}],
        "paired": {"controller.gain": [1, 2], "time.end": [1, 2]},
        "grid": {"summary": ["one", "two"]},
    },
}


@pytest.mark.parametrize("name", STUDIES)
def test_what_is_mutated_is_valid(name: str, tmp_path: Path) -> None:
    """Else every mutation would be refused for the same reason."""
    (tmp_path / "study.yaml").write_text(dump_yaml(STUDIES[name]))
    assert load_plan(str(tmp_path / "study.yaml")).points


@pytest.mark.parametrize("name", STUDIES)
def test_a_mutated_study_is_planned_or_refused_in_one_line(name: str, tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    numbers = iter(range(10 * FILES))

    @settings(FUZZ, max_examples=FILES)
    @given(st.one_of(mutated_tree(STUDIES[name]), mutated_text(dump_yaml(STUDIES[name]).encode())))
    def each(data: bytes) -> None:
        path.write_bytes(data)
        out = tmp_path / str(next(numbers))
        with in_time(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                with open_directory(out, load_plan(str(path))):
                    assert json.loads((out / "study.json").read_bytes())["runs"] >= 1
            except InputError as error:
                told = str(error)
                assert 0 < len(told) < 2_500
                assert all(c.isprintable() or c == "\t" for c in told), told
                assert not out.exists()

    each()
