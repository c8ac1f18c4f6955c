"""The ladder and its runs: the fields of each variant, and that its result is that of a plain run.

Oracles: plain runs of scenarios with the fields of a variant; the vehicles' own descriptions; the identity of budgets.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf import simulate
from mjsheaf.comparing.variants import (
    EFFECTS,
    budget_of,
    effects_of,
    ladder_of,
    root_mean_square,
    run_ablation,
    span_of,
)
from mjsheaf.scenario import Scenario
from tests.builders import two_aircraft, two_boats
from tests.running import run_physics

OFF = {name: False for name in EFFECTS if name != "contacts"}


def positions(dataset: Any) -> Any:
    both = [dataset[f"{kind}_position"].values for kind in ("agent", "target")]
    return np.nan_to_num(np.concatenate(both, axis=1))


def with_effects(scenario: Scenario, **effects: bool) -> Scenario:
    own = scenario.physics.effects
    return scenario.model_copy(
        update={"physics": scenario.physics.model_copy(update={"effects": own.model_copy(update=effects)})}
    )


def test_bodies_with_ideal_thrusters_have_no_effect_rungs() -> None:
    system = two_boats("hull", "hull", vehicles={"agents": "hull", "targets": "hull", "tau": 0.01}).system
    ladder = ladder_of(system)
    assert effects_of(system) == []
    assert [rung.key for rung in ladder] == ["ideal", "targets", "agents", "base", "all"]
    runs = run_ablation(system, ladder)
    np.testing.assert_array_equal(positions(runs["all"].dataset), positions(runs["base"].dataset))


LAW: dict[str, Any] = {"gain": 1.0, "control_period": 0.02}
TERMS = {"feedforward": {"rounds": 2}, "newton": {"rounds": 2}, "drift": {}}


@pytest.mark.parametrize(
    ("part", "fields", "plain"),
    [
        ("links", {"links": {"all": {"noise": 0.3, "loss": 0.2, "delay": 0.02}}}, {}),
        ("limit", {"controller": {**LAW, "velocity_limit": 0.5}}, {"controller": LAW}),
        ("terms", {"controller": {**LAW, **TERMS}}, {"controller": LAW}),
    ],
)
def test_a_part_has_rungs_without_it(part: str, fields: dict[str, Any], plain: dict[str, Any]) -> None:
    """They are runs of the scenario over perfect links, without a limit or terms, bit for bit; others are with it."""
    whole, without = (two_boats("otter", "hull", time={"end": 1.0}, **each) for each in (fields, plain))
    ladder = ladder_of(whole.system)
    assert [rung.key for rung in ladder[-2:]] == [f"ideal-{part}", f"all-{part}"]
    assert [rung.key for rung in ladder[:-2]] == [rung.key for rung in ladder_of(without.system)]
    runs = run_ablation(whole.system, ladder)
    for key, backend in (("ideal", "ideal"), ("all", "physics")):
        own, other = positions(runs[key].dataset), positions(runs[f"{key}-{part}"].dataset)
        np.testing.assert_array_equal(own, positions(simulate(whole, backend)))
        np.testing.assert_array_equal(other, positions(simulate(without, backend)))
        assert np.abs(own - other).max() > 0.01


def test_a_slow_body_without_an_autopilot_has_inertia() -> None:
    slow = {"agents": "hull", "targets": "hull", "tau": 0.2}
    assert effects_of(two_boats("hull", "hull", vehicles=slow).system) == ["inertia"]


@pytest.mark.parametrize(
    ("vehicle", "expected"),
    [
        ("wamv", ["inertia", "drag_law", "limits", "lag"]),
        ("otter", ["inertia", "drag_law", "limits", "lag", "underactuation"]),
    ],
)
def test_rungs_are_the_effects_that_vehicles_have(vehicle: str, expected: list[str]) -> None:
    system = two_boats(vehicle, "hull").system
    assert effects_of(system) == expected
    keys = [rung.key for rung in ladder_of(system)]
    assert keys == ["ideal", "targets", "agents", "base", *(f"+{e}" for e in expected), "all"] + [
        f"-{e}" for e in expected
    ]


def test_what_the_scenario_switches_off_is_no_rung() -> None:
    system = with_effects(two_boats("wamv", "hull"), lag=False).system
    assert "lag" not in effects_of(system)
    contacts = two_boats("wamv", "hull", physics={"timestep": 0.005, "contacts": True}).system
    assert effects_of(contacts)[-1] == "contacts"


def test_an_effect_of_an_x500_is_not_its_drag_law() -> None:
    assert "drag_law" not in effects_of(two_aircraft("x500").system)


def test_every_rung_is_the_run_that_it_says() -> None:
    """Ideal, base, one effect alone, all, and all without one, against plain runs, bit for bit."""
    scenario = two_boats("otter", "hull", time={"end": 1.0})
    system = scenario.system
    runs = run_ablation(system, ladder_of(system))
    np.testing.assert_array_equal(positions(runs["ideal"].dataset), positions(simulate(scenario, "ideal")))
    for key, effects in {"base": OFF, "+limits": {**OFF, "limits": True}, "-lag": {"lag": False}, "all": {}}.items():
        expected = run_physics(with_effects(scenario, **effects).system)
        np.testing.assert_array_equal(positions(runs[key].dataset), expected.positions, err_msg=key)


def test_part_rungs_place_targets_where_the_other_run_had_them() -> None:
    system = two_boats("wamv", "otter", time={"end": 1.0}).system
    runs = run_ablation(system, ladder_of(system))
    targets = {key: np.nan_to_num(run.dataset["target_position"].values) for key, run in runs.items()}
    np.testing.assert_allclose(targets["targets"], targets["base"], atol=1e-12)
    np.testing.assert_allclose(targets["agents"], targets["ideal"], atol=1e-12)
    assert np.abs(targets["base"] - targets["ideal"]).max() > 1e-4


def test_a_rung_that_blows_up_is_marked_and_the_others_go_on() -> None:
    """Without mass, a hull's step of .02 s under a gain of 200 1/s diverges; the ladder reports it for each variant."""
    system = two_boats("hull", "hull", controller={"gain": 200.0, "control_period": 0.02}).system
    runs = run_ablation(system, ladder_of(system))
    assert {run.dataset.attrs["status"] for run in runs.values()} == {"unstable"}
    for run in runs.values():
        assert "unstable" in run.dataset.attrs["message"]


# -- errors and budgets of curves with a known answer ------------------------------------------------------------------


def test_late_is_the_last_half_of_the_run_that_was_asked_for() -> None:
    system = two_boats("hull", "hull").system
    time = system.grid.samples
    chosen = span_of(system).last_half(len(time))
    assert time[chosen][0] == pytest.approx(1.5)
    assert root_mean_square(np.full(len(time), 3.0), chosen) == 3.0
    assert np.isnan(root_mean_square(time[:10], chosen[:10]))  # it blew up before


@given(st.integers(0, 2**32 - 1))
def test_a_budget_sums_to_the_whole(seed: int) -> None:
    """Ideal + targets + agents + together + every effect alone + interaction = all, whatever the errors."""
    ladder = ladder_of(two_boats("otter", "hull").system)
    values = np.random.default_rng(seed).uniform(0.0, 10.0, len(ladder))
    error = {rung.key: float(x) for rung, x in zip(ladder, values, strict=True)}
    budget = budget_of(("team", "tracking_error", "late"), error, None)
    parts = [budget.ideal_m, budget.targets_m, budget.agents_m, budget.together_m, budget.interaction_m]
    total = sum(x for x in [*parts, *(item.alone_m for item in budget.effects)] if x is not None)
    assert total == pytest.approx(error["all"])
    assert budget.all_m == error["all"]
    assert [item.effect for item in budget.effects] == [v.effect for v in ladder if v.kind == "alone"]
    for item in budget.effects:
        assert item.give_back_m == pytest.approx(error["all"] - error[f"-{item.effect}"])


def test_a_rung_that_blew_up_leaves_a_hole_in_the_budget() -> None:
    ladder = ladder_of(two_boats("otter", "hull").system)
    error = {variant.key: None if variant.key == "+lag" else 1.0 for variant in ladder}
    budget = budget_of(("team", "tracking_error", "late"), error, None)
    assert next(item for item in budget.effects if item.effect == "lag").alone_m is None
    assert (budget.interaction_m, budget.all_m) == (None, 1.0)
