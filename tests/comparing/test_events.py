"""Comparisons of scenarios with events: every variant runs the same phases, and each phase has its own budget.

Oracles: plain runs with the same events; the identity that a budget satisfies.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.checking.loop.body_loop import BodyLoop, Swing
from mjsheaf.comparing import CompareRecord, compare
from mjsheaf.comparing.compare import Comparison
from mjsheaf.comparing.margins import worst_loop
from mjsheaf.comparing.page import WIDTH, report_text
from mjsheaf.comparing.variants import present_in
from mjsheaf.results.metrics import summarize_phases
from mjsheaf.scenario import Scenario
from tests.builders import approx, known, list_members, two_boats
from tests.running import rms_error


def three_boats(**fields: Any) -> Scenario:
    """Two boats in a line, and a third that is lost and joins again."""
    agents = {"A1": {"position": [-4, 1], "heading": 20}, "A2": [-3, -2], "A3": [5, 5]}
    usual = {
        "agents": list_members(agents),
        "communication": [["A1", "A2"], ["A2", "A3"]],
        "sensing": [[id, "T1"] for id in agents],
        "events": [
            {"time": 1.0, "lose": "A3"},
            {"time": 2.0, "join": "A3"},
            {"time": 2.0, "set": {"controller.gain": 2.0}},
        ],
    }
    return two_boats("otter", "hull", **{**usual, **fields})


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return compare(three_boats())


@pytest.fixture(scope="module")
def record(comparison: Comparison) -> CompareRecord:
    return comparison.record


@pytest.mark.long
def test_phases_are_those_of_plain_runs(record: CompareRecord) -> None:
    scenario = three_boats()
    assert [(phase.start, approx(phase.end)) for phase in record.phases] == [(0.0, 0.98), (1.0, 1.98), (2.0, 3.0)]
    assert [phase.events for phase in record.phases] == [[], ["lose A3"], ["join A3", "gain = 2.0"]]
    for key, backend in (("ideal", "ideal"), ("all", "physics")):
        plain = summarize_phases(scenario.team, simulate(scenario, backend))
        for phase, expected in zip(record.phases, plain, strict=True):
            for scope, values in (("team", expected["final"]), ("line", expected["final"]["groups"]["line"])):
                found = phase.errors[key][scope].final
                for name in ("tracking_error", "formation_error", "centering_error"):
                    assert approx(getattr(found, name), rel=1e-9) == values[name]


@pytest.mark.long
def test_the_late_error_of_a_phase_is_that_of_its_last_half(record: CompareRecord, comparison: Comparison) -> None:
    dataset = comparison.runs["ideal"].dataset
    late = rms_error(dataset.sel(time=slice(1.49 - 1e-9, 2.0 - 1e-9)))
    expected = np.sqrt((late**2).mean())
    assert approx(record.phases[1].errors["ideal"]["team"].late.tracking_error, rel=1e-9) == expected


@pytest.mark.slow
def test_each_phase_has_budgets_of_its_own_errors(record: CompareRecord) -> None:
    """So has the whole run, which ends as its last phase and begins with the gain that is shown."""
    whole = record.rung("all").errors
    for budgets, errors in (
        (record.budgets, whole),
        *((phase.budgets, phase.errors["all"]) for phase in record.phases),
    ):
        assert len(budgets) == len(record.budgets)
        for budget in budgets:
            assert budget.all_m == getattr(getattr(errors[budget.scope], budget.statistic), budget.measure)
    assert all(phase.levers for phase in record.phases)
    assert whole["team"].final == record.phases[-1].errors["all"]["team"].final
    assert record.gain == 1.0


@pytest.mark.parametrize(
    ("stable", "worst"), [([True, None, False], False), ([True, None, True], None), ([True, True, True], True)]
)
def test_the_loop_is_that_of_the_worst_of_all_phases(
    stable: list[bool | None], worst: bool | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last phase is the least damped, and the second has the smallest gain."""
    scenario = three_boats()
    common = {"spectral_radius": 0.9, "period": 0.02}
    swings = [Swing(damping=damping, frequency=1.0, agent="A1") for damping in (0.5, 0.4, 0.3)]
    reasons = ["not known" if one is None else "" for one in stable]
    rows = zip(stable, (5.0, 2.0, None), swings, reasons, strict=True)
    names = ("stable", "largest_gain", "least_damped", "reason")
    found = [BodyLoop(**common, **dict(zip(names, row, strict=True))) for row in rows]
    loops = iter(found)
    monkeypatch.setattr("mjsheaf.comparing.margins.loop_in_run", lambda system, data: next(loops))
    loop = worst_loop(scenario.phases, simulate(scenario, "ideal"))
    assert (loop.stable, loop.largest_gain, loop.reason) == (worst, 2.0, "not known" if None in stable else "")


def test_an_absent_agent_counts_neither_in_distances_nor_in_saturation(comparison: Comparison) -> None:
    """While A3 is lost it drifts: only samples with it count. Oracle: the positions of both runs."""
    ideal, bodies = (comparison.runs[key].dataset for key in ("ideal", "all"))
    present = present_in(bodies)
    assert not present[50:100, 2].any()
    assert present[100:, 2].all()
    apart = np.linalg.norm(np.nan_to_num((bodies["agent_position"] - ideal["agent_position"]).values), axis=2)
    found = comparison.record.rung("all")
    for distance, first in ((found.distance, 0), (found.distance_late, 75)):
        assert known(distance).distance_m == approx(np.where(present, apart, 0.0)[first:].max())
    saturation = bodies["agent_saturation"].values
    assert found.saturation[0].share == approx(saturation[present].mean())


def test_the_report_has_everything_and_a_row_for_each_phase_and_fits(record: CompareRecord) -> None:
    page = report_text(record)
    assert max(map(len, page.splitlines())) <= WIDTH
    causes = ("dominant cause", "ladder", "error budget", "ringing", "speeds", "convergence", "underactuation")
    for words in (*causes, "1: lose A3", "phase 2: formation error: "):
        assert words in page
    assert "…" not in page


@pytest.mark.slow
def test_a_run_that_blows_up_in_a_later_phase_keeps_the_earlier_ones() -> None:
    fast = [{"time": 1.0, "set": {"controller.gain": 500.0}}]
    record = compare(three_boats(events=fast, vehicles={"agents": "hull", "targets": "hull"})).record
    assert record.rung("all").status == "unstable"
    first, second = record.phases
    assert first.errors["all"]["team"].final.tracking_error is not None
    assert second.errors["all"]["team"].final.tracking_error is None
