"""Malformed study files: each is a plan, or refused in one line, and leaves no partial directory.

Oracle: the contract on errors. Mutations are those of scenario files; nothing is run, but what is planned is shown with
made-up records, as no study may fail once all of its runs have ended.
"""

import json
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mjsheaf.errors import InputError
from mjsheaf.files import dump_yaml
from mjsheaf.results.metrics import MEASURES
from mjsheaf.studies.figures import plot_study, swept_axes
from mjsheaf.studies.plan import Plan, Point, load_plan
from mjsheaf.studies.study import csv_of, make_table, open_directory, page_of
from mjsheaf.studies.workers import new_record
from tests.scenario.mutations import FUZZ, base, in_time, mutated_text, mutated_tree
from tests.strategies import tried

FILES = tried(400, 20)
"""Mutated files for each of the studies below, as trees and as texts."""

STUDIES: dict[str, dict[str, Any]] = yaml.safe_load("""
grid:
  {summary: a question, scenario: midpoint, backend: ideal, set: {time.end: 0.5, agents.A1.heading: 3},
   grid: {controller.gain: [0.5, 1, 2.0], spread.position: [1, 0]}, seeds: {start: 1, stop: 4},
   measure: tracking_error, labels: {controller.gain: gain (1/s)}, trajectories: true}
draws:
  scenario: midpoint
  draws:
    count: 3
    seed: 7
    values:
      controller.gain: {kind: loguniform, low: 0.1, high: 10}
      spread.position: {kind: uniform, low: 0, high: 2}
      agents.A1.heading: {kind: normal, mean: 0, deviation: 30}
      seed: {kind: integers, low: 0, high: 9}
      vehicles.agents: {kind: choice, values: [hull, wamv]}
lists:
  {scenario: swarm, backend: ideal, points: [{swarm.size: 3}, {swarm.size: 5, swarm.graph: ring}],
   paired: {controller.gain: [1, 2], time.end: [1, 2]}, grid: {summary: [one, two]}}
""")


MOST_SHOWN = 30
"""Runs of a study that is shown."""

_drawn: set[str] = set()


def show(plan: Plan) -> None:
    """Make the table and the page of a plan and, because plots take longest, one of several plots."""
    points = plan.points[:MOST_SHOWN]
    records = []
    for k, point in enumerate(points):
        if k % 3 == 1:
            records.append(new_record(point, plan.job(point).seed, "invalid", "no such thing"))
        else:
            final = dict.fromkeys(MEASURES, 1.0 + k)
            records.append(new_record(point, plan.job(point).seed, "finished", final=final, settled=k % 2 == 0))
    table = make_table(plan, records)
    csv_of(table)
    table.to_parquet()
    swept_axes(plan.study, records)
    kind = repr((sorted(plan.study.labels.values()), [str(table[p].dtype) for p in plan.study.paths if p in table]))
    plots = {}
    if kind not in _drawn:  # what decides how it is drawn
        _drawn.add(kind)
        plots = plot_study(plan.study, plan.name, records)
    page_of(plan, table, plots)


@pytest.mark.parametrize(
    "seeds", [[1, True], [True], [0, "a"], [[1], {"b": 2}], [None, 3], [1.5, 1e308], [2**62], [2**63 - 1, -(2**63) + 1]]
)
def test_odd_seeds_are_shown(seeds: list[Any]) -> None:
    _drawn.clear()
    show(load_plan("midpoint", grid={"seed": [10, *seeds]}, backend="ideal"))


@pytest.mark.parametrize("seed", [True, 2**63, "a", None, [1]])
def test_an_odd_seed_of_the_scenario_is_shown(seed: Any, tmp_path: Path) -> None:
    """Swept over, it is legal in some of the runs."""
    path = tmp_path / "own.yaml"
    path.write_text(dump_yaml({**base("midpoint"), "seed": seed}))
    plan = load_plan(str(path), backend="ideal", grid={"seed": [0]})
    show(replace(plan, study=plan.study.model_copy(update={"grid": {}}), points=[Point(0, {}), Point(1, {"seed": 3})]))


@pytest.mark.parametrize("name", STUDIES)
def test_what_is_mutated_is_valid(name: str, tmp_path: Path) -> None:
    """Else every mutation would be refused for the same reason."""
    (tmp_path / "study.yaml").write_text(dump_yaml(STUDIES[name]))
    assert load_plan(str(tmp_path / "study.yaml")).points


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("name", STUDIES)
def test_a_mutated_study_is_planned_or_refused_in_words(name: str, tmp_path: Path) -> None:
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
                plan = load_plan(str(path))
                with open_directory(out, plan):
                    assert json.loads((out / "study.json").read_bytes())["runs"] >= 1
                show(plan)
            except InputError as error:
                told = str(error)
                assert 0 < len(told) < 2_500
                assert all(c.isprintable() or c == "\n" for c in told), told
                assert not out.exists()

    each()
