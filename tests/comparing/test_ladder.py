"""The ladder and its runs: the fields of each variant, and that its result is that of a plain run.

Oracles: plain runs of scenarios with the fields of a variant; the vehicles' own descriptions; the identity of budgets.
"""

from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf import simulate
from mjsheaf.comparing.variants import (
    EFFECTS,
    budget_of,
    effects_of,
    ladder_of,
    run_ablation,
)
from mjsheaf.loop.system import phases_of
from mjsheaf.scenario import Scenario
from tests.builders import positions_of, two_aircraft, two_boats

OFF = {name: False for name in EFFECTS if name != "contacts"}


def with_effects(scenario: Scenario, **effects: bool) -> Scenario:
    own = scenario.physics.effects
    return scenario.model_copy(
        update={"physics": scenario.physics.model_copy(update={"effects": own.model_copy(update=effects)})}
    )


def hulls(tau: float) -> Scenario:
    return two_boats("hull", "hull", vehicles={"agents": "hull", "targets": "hull", "tau": tau})


def test_bodies_with_ideal_thrusters_run_as_without_their_effects() -> None:
    system = hulls(0.01).system
    runs = run_ablation(phases_of(system), ladder_of(phases_of(system)))
    np.testing.assert_array_equal(positions_of(runs["all"].dataset), positions_of(runs["base"].dataset))


LAW: dict[str, Any] = {"gain": 1.0, "control_period": 0.02}


@pytest.mark.parametrize(
    ("part", "fields"),
    [
        ("links", {"links": {"all": {"noise": 0.3, "loss": 0.2, "delay": 0.02}}}),
        ("limit", {"controller": {**LAW, "velocity_limit": 0.5}}),
        ("terms", {"controller": {**LAW, "feedforward": {"rounds": 2}, "newton": {"rounds": 2}, "drift": {}}}),
    ],
)
def test_a_part_has_rungs_without_it(part: str, fields: dict[str, Any]) -> None:
    """They are runs of the scenario over perfect links, without a limit or terms, bit for bit; others are with it."""
    whole, without = (two_boats("otter", "hull", time={"end": 1.0}, **each) for each in (fields, {}))
    ladder = ladder_of(whole.phases)
    assert [rung.key for rung in ladder[-2:]] == [f"ideal-{part}", f"all-{part}"]
    assert [rung.key for rung in ladder[:-2]] == [rung.key for rung in ladder_of(without.phases)]
    runs = run_ablation(whole.phases, ladder)
    for key, backend in (("ideal", "ideal"), ("all", "physics")):
        own, other = positions_of(runs[key].dataset), positions_of(runs[f"{key}-{part}"].dataset)
        np.testing.assert_array_equal(own, positions_of(simulate(whole, backend)))
        np.testing.assert_array_equal(other, positions_of(simulate(without, backend)))
        assert np.abs(own - other).max() > 0.01


EFFECTS_OF = {
    "ideal thrusters": (hulls(0.01), []),
    "no autopilot, but slow": (hulls(0.2), ["inertia"]),
    "boat": (two_boats("wamv", "hull"), ["inertia", "drag_law", "limits", "lag"]),
    "boat without force abeam": (
        two_boats("otter", "hull"),
        ["inertia", "drag_law", "limits", "lag", "underactuation"],
    ),
    "aircraft": (two_aircraft("x500"), ["inertia", "limits", "lag", "underactuation"]),
    "switched off": (with_effects(two_boats("wamv", "hull"), lag=False), ["inertia", "drag_law", "limits"]),
    "contacts": (
        two_boats("wamv", "hull", physics={"timestep": 0.005, "contacts": True}),
        ["inertia", "drag_law", "limits", "lag", "contacts"],
    ),
}


@pytest.mark.parametrize(("scenario", "expected"), EFFECTS_OF.values(), ids=EFFECTS_OF)
def test_rungs_are_the_effects_that_vehicles_have(scenario: Scenario, expected: list[str]) -> None:
    system = scenario.system
    assert effects_of(system) == expected
    keys = [rung.key for rung in ladder_of(phases_of(system))]
    assert keys == ["ideal", "targets", "agents", "base", *(f"+{e}" for e in expected), "all"] + [
        f"-{e}" for e in expected
    ]


def test_every_rung_is_the_run_that_it_says() -> None:
    """Ideal, base, one effect alone, all, and all without one, against plain runs, bit for bit and in every phase."""
    scenario = two_boats("otter", "hull", time={"end": 1.0}, events=[{"time": 0.5, "lose": "A2"}])
    runs = run_ablation(scenario.phases, ladder_of(scenario.phases))
    for key, backend in (("ideal", "ideal"), ("all", "physics")):
        xr.testing.assert_identical(runs[key].dataset, simulate(scenario, backend))
    for key, effects in {"base": OFF, "+limits": {**OFF, "limits": True}, "-lag": {"lag": False}}.items():
        expected = positions_of(simulate(with_effects(scenario, **effects)))
        np.testing.assert_array_equal(positions_of(runs[key].dataset), expected, err_msg=key)


def test_part_rungs_place_targets_where_the_other_run_had_them() -> None:
    system = two_boats("wamv", "otter", time={"end": 1.0}).system
    runs = run_ablation(phases_of(system), ladder_of(phases_of(system)))
    targets = {key: np.nan_to_num(run.dataset["target_position"].values) for key, run in runs.items()}
    np.testing.assert_allclose(targets["targets"], targets["base"], atol=1e-12)
    np.testing.assert_allclose(targets["agents"], targets["ideal"], atol=1e-12)
    assert np.abs(targets["base"] - targets["ideal"]).max() > 1e-4


@given(st.integers(0, 2**32 - 1))
def test_a_budget_sums_to_the_whole(seed: int) -> None:
    """Ideal + targets + agents + together + every effect alone + interaction = all, whatever the errors."""
    ladder = ladder_of(two_boats("otter", "hull").phases)
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
    ladder = ladder_of(two_boats("otter", "hull").phases)
    error = {variant.key: None if variant.key == "+lag" else 1.0 for variant in ladder}
    budget = budget_of(("team", "tracking_error", "late"), error, None)
    assert next(item for item in budget.effects if item.effect == "lag").alone_m is None
    assert (budget.interaction_m, budget.all_m) == (None, 1.0)
