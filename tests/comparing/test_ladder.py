"""The ladder and its runs: the fields of each variant, and that its result is that of a plain run.

Oracles: plain runs of scenarios with the fields of a variant; the vehicles' own descriptions.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.comparing.variants import EFFECTS, effects_of, ladder_of, run_ablation
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


def test_a_team_over_links_has_rungs_over_perfect_ones() -> None:
    """They are the runs of the same scenario without links; the others are runs with them."""
    links = {"all": {"noise": 0.3, "loss": 0.2, "delay": 0.02}}
    fields: dict[str, Any] = {"vehicles": {"agents": "hull", "targets": "hull", "tau": 0.01}, "time": {"end": 0.5}}
    noisy, perfect = two_boats("hull", "hull", links=links, **fields), two_boats("hull", "hull", **fields)
    ladder = ladder_of(noisy.system)
    assert [rung.key for rung in ladder][-2:] == ["ideal-links", "all-links"]
    runs = run_ablation(noisy.system, ladder)
    for key, backend in (("ideal", "ideal"), ("all", "physics")):
        of_links, plain = (positions(simulate(scenario, backend)) for scenario in (noisy, perfect))
        np.testing.assert_array_equal(positions(runs[key].dataset), of_links)
        np.testing.assert_array_equal(positions(runs[f"{key}-links"].dataset), plain)
        assert np.abs(of_links - plain).max() > 0.01


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
    for key, effects in {
        "base": OFF,
        "+limits": {**OFF, "limits": True},
        "-lag": {"lag": False},
        "all": {},
    }.items():
        expected = run_physics(with_effects(scenario, **effects).system)
        np.testing.assert_array_equal(positions(runs[key].dataset), expected.positions, err_msg=key)


def test_a_velocity_limit_has_rungs_without_it() -> None:
    """They are the runs of the same scenario without a limit, bit for bit."""
    law = {"gain": 1.0, "control_period": 0.02}
    limited = two_boats("otter", "hull", time={"end": 1.0}, controller={**law, "velocity_limit": 0.5})
    free = two_boats("otter", "hull", time={"end": 1.0}, controller=law)
    ladder = ladder_of(limited.system)
    assert [rung.key for rung in ladder[-2:]] == ["ideal-limit", "all-limit"]
    runs = run_ablation(limited.system, ladder)
    for key, backend in (("ideal", "ideal"), ("all", "physics")):
        without = positions(runs[f"{key}-limit"].dataset)
        np.testing.assert_array_equal(without, positions(simulate(free, backend)))
        assert np.abs(positions(runs[key].dataset) - without).max() > 0.01


def test_terms_have_rungs_under_the_paper_s_law() -> None:
    """The last two, against plain runs of the scenario without its terms, bit for bit."""
    law = {"gain": 1.0, "control_period": 0.02}
    terms = {"feedforward": {"rounds": 2}, "newton": {"rounds": 2}, "drift": {}}
    scenario = two_boats("otter", "hull", time={"end": 1.0}, controller={**law, **terms})
    plain = two_boats("otter", "hull", time={"end": 1.0}, controller=law)
    ladder = ladder_of(scenario.system)
    assert [rung.key for rung in ladder[-2:]] == ["ideal-terms", "all-terms"]
    assert [rung.key for rung in ladder[:-2]] == [rung.key for rung in ladder_of(plain.system)]
    runs = run_ablation(scenario.system, ladder)
    for whole, backend in (("ideal", "ideal"), ("all", "physics")):
        without = positions(runs[f"{whole}-terms"].dataset)
        np.testing.assert_array_equal(without, positions(simulate(plain, backend)))
        assert np.abs(positions(runs[whole].dataset) - without).max() > 0.01


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
