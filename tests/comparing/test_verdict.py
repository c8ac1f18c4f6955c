"""Dominant cause of the error (sheaf, law or vehicles), and the range of the gain.

Oracles: teams whose harmonic extension is in formation or not by their edges; closed forms.
"""

import re
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf.comparing import CompareRecord, compare
from mjsheaf.comparing.causes import verdict_of
from mjsheaf.comparing.figures import choose_rungs
from mjsheaf.comparing.page import report_text
from mjsheaf.comparing.variants import ItemRecord, formation_size, positions_at_q_star, root_mean_square
from mjsheaf.law.law import disagreement
from mjsheaf.results.metrics import error_series, evaluate_errors
from mjsheaf.scenario import Scenario
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import approx, known, make_fields, two_boats
from tests.running import run_ideal


def two_groups(link: Any) -> Scenario:
    """Two lines about targets 20 m apart, and a third alone, the first two tied by a link."""
    places = {"T1": (0, 0), "T2": (20, 0), "T3": (0, 30)}
    slow = {"kind": "lissajous", "amplitude": [1, 1], "rate": [0.1, 0.1], "phase": [1.57, 0]}
    line = {"shape": "line", "spacing": 3}
    fields = make_fields(
        {f"{t}{k}": [x + 3, y + 2 * k] for t, (x, y) in places.items() for k in (1, 2)},
        {t: {"position": list(p), "motion": slow} for t, p in places.items()},
        [[f"{t}{k}", t] for t in places for k in (1, 2)],
        communication=[*([f"{t}1", f"{t}2"] for t in places), link],
        formations=[{"name": f"line_{t}", "members": [f"{t}1", f"{t}2"], "about": t, **line} for t in places],
    )
    return two_boats("hull", "hull", **fields)


def with_terms(**odometry: float) -> CompareRecord:
    """Two boats in a current, with feedforward and drift observers."""
    law = {"gain": 1.0, "control_period": 0.02, "feedforward": {}, "drift": {}, "odometry": odometry}
    flow = {"agents": {"dimension": 2, "drift": [0.3, 0.1]}}
    vehicles = {"agents": "hull", "targets": "hull", "tau": 0.1}
    return compare(two_boats("hull", "hull", controller=law, flow=flow, vehicles=vehicles, time={"end": 12.0})).record


@pytest.mark.slow
def test_what_terms_bring_is_in_the_ladder() -> None:
    record = with_terms()
    paper, now = (known(record.rung(key).errors["team"].error("tracking_error")) for key in ("all-terms", "all"))
    assert now < 0.2 * paper
    assert record.terms == ["feedforward", "drift"]
    assert record.harm == []
    assert "WARNING" not in " ".join(record.verdict)
    assert "without feedforward and drift" in report_text(record)
    assert [rung.key for rung in choose_rungs(record)][-3:] == ["all", "all-terms", "ideal"]


@pytest.mark.slow
def test_terms_that_harm_come_first_with_what_to_change() -> None:
    record = with_terms(noise=3.0)
    assert record.harm
    assert "WARNING" in record.verdict[0]
    assert record.verdict[1] == record.harm[0]
    assert "raise their filters" in record.harm[0]
    (tracking,) = [s for s in record.verdict if s.startswith("tracking error:")]
    assert "dominant cause: feedforward and drift (" in tracking
    assert report_text(record).index("WARNING") < report_text(record).index("tracking error: ")


@pytest.fixture(scope="module")
def torn() -> CompareRecord:
    return compare(two_groups(["T11", "T21"])).record


def test_agents_at_q_star_do_not_err_in_tracking() -> None:
    system = two_groups(["T11", "T21"]).system
    run = run_ideal(system)
    placed = positions_at_q_star(system, run.positions)
    N = len(system.team.agents)
    np.testing.assert_array_equal(placed[:, N:], run.positions[:, N:])
    found = evaluate_errors(system.team, placed)
    np.testing.assert_allclose(found.tracking, 0.0, atol=1e-9)
    np.testing.assert_allclose(disagreement(system.law, placed)[:, : len(system.team.agents), :2], 0.0, atol=1e-9)
    assert formation_size(system) == pytest.approx(3.0)


@pytest.mark.slow
def test_budgets_know_the_errors_at_q_star(torn: CompareRecord) -> None:
    system = two_groups(["T11", "T21"]).system
    run = run_ideal(system)
    team, groups = error_series(system.team, positions_at_q_star(system, run.positions))
    series = {"team": team, **groups}
    chosen = run.time >= system.grid.start + 0.5 * system.grid.period * system.grid.steps
    for budget in torn.budgets:
        values = series[budget.scope][budget.measure]
        expected = {"late": root_mean_square(values, chosen), "final": values[-1]}[budget.statistic]
        assert approx(budget.at_q_star_m, abs=1e-9) == expected


@pytest.mark.slow
def test_a_link_without_offset_is_the_sheafs_fault_and_spares_who_has_none(torn: CompareRecord) -> None:
    tracking, formation = torn.verdict[:2]
    assert formation.startswith("formation error: ")
    assert "dominant cause: the sheaf, not the law or the vehicles, as q* itself is" in formation
    assert "m out of formation in line_T1, line_T2: give the edges between groups an `offset`" in formation
    assert tracking.startswith("tracking error: ")
    assert "the sheaf" not in tracking  # agents at q* have none
    assert torn.budget("line_T3", "formation_error", "late").at_q_star_m == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_a_link_with_the_targets_offset_blames_nobody_for_the_sheaf() -> None:
    system_free = two_groups({"between": ["T11", "T21"], "offset": [-20.0, 0.0]})
    record = compare(system_free).record
    assert approx(record.budget("team", "formation_error", "late").at_q_star_m, abs=1e-9) == 0.0
    assert not any("the sheaf" in s for s in record.verdict)


@pytest.mark.slow
def test_where_the_law_lags_the_tracking_error_is_told() -> None:
    """A target in uniform motion is followed at a distance of v / (k1 w), which the ideal run has too."""
    motion = {"kind": "lissajous", "amplitude": [3, 3], "rate": [0.5, 0.5], "phase": [1.57, 0]}
    record = compare(two_boats("hull", "hull", targets=[{"id": "T1", "position": [0, 0], "motion": motion}])).record
    (told,) = [s for s in record.verdict if s.startswith("tracking error:")]
    assert "dominant cause: the law, not the vehicles: a higher controller.gain (up to" in told
    assert known(record.usable_gain) > known(record.gain)
    poor = record.model_copy(update={"usable_gain": 0.5 * known(record.gain)})
    (told,) = [s for s in verdict_of(poor) if s.startswith("tracking error:")]
    assert "(a higher gain rings, above" in told
    assert "a higher controller.gain" not in " ".join(verdict_of(poor))


def test_inertia_is_the_reduced_model_without_lag() -> None:
    for name in ("wamv", "otter", "hexarotor", "hull"):
        vehicle = load_vehicle(name)
        free = [actuator.without_lag() for actuator in vehicle.actuators]
        expected = replace(vehicle, actuators=free).reduced_model().tau
        np.testing.assert_allclose(vehicle.reduced_model().tau_with(0.0), expected)
        assert (vehicle.reduced_model().tau >= vehicle.reduced_model().tau_with(0.0) - 1e-12).all()


@pytest.mark.parametrize("ideal", [0.0, 3e-16, 0.5])
def test_nothing_is_blamed_for_an_error_of_zero(ideal: float, torn: CompareRecord) -> None:
    changed = [b.model_copy(update={"ideal_m": ideal, "all_m": 4e-16}) for b in torn.budgets]
    told = verdict_of(torn.model_copy(update={"budgets": changed}))
    assert told[1] == "formation error: zero to rounding on bodies: nothing to gain"
    assert "dominant cause" not in " ".join(told)


@pytest.mark.parametrize(("share", "named"), [(0.1, False), (0.4, True)])
def test_links_are_the_cause_if_perfect_ones_save_enough(share: float, named: bool, torn: CompareRecord) -> None:
    """A quarter of the error. Oracle: the error of the variant over perfect links."""
    budgets = [b.model_copy(update={"ideal_m": 1.0, "all_m": 1.0, "at_q_star_m": 0.0}) for b in torn.budgets]
    ladder = list(torn.ladder)
    for key, error in (("all", 1.0), ("all-links", 1.0 - share)):
        rung = torn.rung("all").model_copy(update={"key": key, "kind": "links" if key != "all" else "all"})
        late = rung.errors["team"].late.model_copy(update={"tracking_error": error, "formation_error": error})
        errors = {**rung.errors, "team": rung.errors["team"].model_copy(update={"late": late})}
        ladder = [r for r in ladder if r.key != key] + [rung.model_copy(update={"errors": errors})]
    told = verdict_of(torn.model_copy(update={"budgets": budgets, "ladder": ladder}))
    causes = [sentence for sentence in told if "dominant cause" in sentence]
    assert len(causes) == 2
    assert all((f"links ({1.0 - share:.3g} m without): better links" in cause) == named for cause in causes)
    assert all(("the law, not the vehicles" in cause) != named for cause in causes)


@given(
    ideal=st.floats(0.0, 50.0), whole=st.floats(1e-6, 50.0),
    added=st.tuples(*[st.floats(-5.0, 5.0) | st.none()] * 3),
)  # fmt: skip
def test_parts_of_an_error_add_up_as_they_are_printed(
    ideal: float, whole: float, added: tuple[float | None, ...], torn: CompareRecord
) -> None:
    """Oracle: the numbers of the sentence, whatever the effects add alone."""
    items = [ItemRecord(effect="lag", alone_m=added[2], give_back_m=None)]
    own = {"ideal_m": ideal, "all_m": whole, "targets_m": added[0], "agents_m": added[1], "effects": items}
    changed = [b.model_copy(update=own) for b in torn.budgets]
    told = verdict_of(torn.model_copy(update={"budgets": changed}))
    for start in ("tracking error: ", "formation error: "):
        (sentence,) = [words for words in told if words.startswith(start)]
        left, right = sentence.removeprefix(start).split(" = ")
        numbers = [Decimal(sign.strip() + x) for sign, x in re.findall(r"(^|- |\+ )([\d.]+) m", left)]
        assert sum(numbers) == Decimal(right.split(" m")[0])
        assert float(right.split(" m")[0]) == pytest.approx(whole, rel=6e-3)


@pytest.mark.parametrize(("share", "named"), [(1e-16, False), (0.2, False), (0.4, True)])
def test_only_effects_that_matter_are_named(share: float, named: bool, torn: CompareRecord) -> None:
    """It recovers a fraction of an error of 1 m, all of it due to the bodies."""
    item = ItemRecord(effect="lag", alone_m=0.0, give_back_m=share)
    changed = [b.model_copy(update={"ideal_m": 0.0, "all_m": 1.0, "effects": [item]}) for b in torn.budgets]
    told = verdict_of(torn.model_copy(update={"budgets": changed}))
    (tracking,) = [sentence for sentence in told if sentence.startswith("tracking error:")]
    assert ("dominant cause: lag (0.6 m without): faster thrusters" in tracking) == named
    assert ("lag (" in " ".join(told)) == named


@pytest.mark.long
def test_a_team_at_rest_has_no_lever() -> None:
    """Its errors, with terms and without, are rounding: -1e-16 m, 4e-16 m."""
    static = {"id": "T1", "position": [0, 0], "motion": {"kind": "static"}}
    law = {"gain": 1.0, "control_period": 0.02, "feedforward": {}}
    scenario = two_boats("hull", "hull", targets=[static], controller=law, time={"end": 120.0})
    record = compare(scenario).record
    now = known(record.budget("team", "formation_error", "late").all_m)
    assert now < 1e-9
    told = " ".join(record.verdict)
    assert "nothing to gain" in told
    assert "dominant cause" not in told
    assert "WARNING" not in told


def test_the_page_says_why_something_is_worse_without_an_effect(torn: CompareRecord) -> None:

    def with_item(share: float) -> CompareRecord:
        budgets = []
        for b in torn.budgets:
            item = ItemRecord(effect="underactuation", alone_m=0.0, give_back_m=share * (b.all_m or 0.0))
            budgets.append(b.model_copy(update={"effects": [item]}))
        return torn.model_copy(update={"budgets": budgets})

    assert "worse without it; underactuation: the stand-in" in " ".join(report_text(with_item(-0.2)).split())
    assert "worse without it" not in report_text(with_item(-0.01))
    for words in ("team, at the end", "at q* already", "settles (s)", "settles:", "compare.json has the tracking"):
        assert words in report_text(torn)


def test_every_variant_with_one_effect_is_drawn(record: CompareRecord) -> None:
    keys = [rung.key for rung in choose_rungs(record)]
    assert {"ideal", "targets", "agents", "base", "all"} <= set(keys)
    assert {rung.key for rung in record.ladder if rung.kind == "alone"} <= set(keys)
    assert len(set(keys)) == len(keys)
