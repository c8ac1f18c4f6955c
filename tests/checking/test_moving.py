"""Checks of a medium that moves: waves are bounded, gusts are Gaussian, and bounds hold in runs."""

from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.checking import examine_scenario
from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.checking.theorem.constants import bound_moving
from mjsheaf.checking.theorem.targets import Carrier, follow_targets
from mjsheaf.media.medium import moving_along
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, list_members, mixed_scenario, require
from tests.media.test_flow_events import pieces_of
from tests.running import analyse

WAVES = {"kind": "jonswap", "significant_height": 0.4, "peak_period": 4.0, "spreading": "cos2", "components": 6}
GUSTS = {"kind": "dryden", "wind_speed": 5.0, "altitude": 10.0}


def waving(**fields: Any) -> Scenario:
    """Return the mixed team on a sea, without what its vehicles meet in addition."""
    flow = {"water": {"dimension": 2, "drift": [0.1, 0.0], "waves": WAVES}}
    return mixed_scenario(**{"flow": flow, "time": {"end": 4.0}, **fields})


@pytest.mark.slow
def test_waves_are_bounded_and_enter_omega_bar() -> None:
    record = examine_scenario(waving()).record
    third = record.assumptions[2]
    assert (third.verdict, third.holds, third.applies) == ("holds", True, True)
    assert third.value == pytest.approx(waving().system.largest_disturbance.max())
    assert (record.theorem.omega_bar or 0.0) > (third.value or 0.0) > 0.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_bounds_of_waves_are_not_exceeded_anywhere(seed: int) -> None:
    system, rng = waving(seed=seed).system, np.random.default_rng(seed)
    V, h = len(system.team.members), 1e-4
    times = np.sort(rng.uniform(0.0, 1000.0, 3000))
    places = rng.uniform([-20, -20, -3], [20, 20, -1e-3], (3000, V, 3))
    at = moving_along(system.medium, times, places)
    bounds = system.moving_bounds
    assert (np.linalg.norm(at, axis=2) <= bounds.speed + 1e-12).all()
    assert np.linalg.norm(at, axis=2).max() > 0.5 * bounds.speed.max()
    later = moving_along(system.medium, times + h, places)
    assert (np.linalg.norm(later - at, axis=2) / h <= bounds.change + 1e-3).all()
    step = rng.standard_normal((3000, V, 3))
    step *= h / np.linalg.norm(step, axis=2, keepdims=True)
    beside = moving_along(system.medium, times, places + step * [1.0, 1.0, 0.0])
    assert (np.linalg.norm(beside - at, axis=2) / h <= bounds.slope + 1e-3).all()


VORTEX = {"centre": [-6.0, 1.0], "gamma": 8.0, "velocity": [0.5, 0.1]}
SWELL = {"kind": "jonswap", "significant_height": 0.3, "peak_period": 12.0, "components": 4, "spreading": "cos2"}
TIDE = {"amplitude": 0.4, "minor": 0.1, "period": 20.0, "direction": 30.0}


def boats(**water: Any) -> Scenario:
    """Return three boats about a fourth that sails a circle, all on water."""
    circle = {"kind": "lissajous", "amplitude": [2, 2], "rate": [0.1, 0.1], "phase": [1.57, 0]}
    places = {"B0": [4, 0], "B1": [-3, 2], "B2": [0, -4]}
    return build_scenario(
        places,
        {"T": {"position": [0, 0], "motion": circle}},
        [["B0", "T"], ["B2", "T"]],
        time={"end": 20.0},
        controller={"gain": 3.0, "control_period": 0.02},
        communication=[["B0", "B1"], ["B1", "B2"]],
        formations=[{"name": "about", "shape": "polygon", "members": [*places], "about": "T", "radius": 3}],
        flow={"water": {"dimension": 2, "core": 20.0, "drift": [0.1, 0.0], **water}},
    )


SHARED = {
    "tide": lambda: boats(tide=TIDE),
    "ramp": lambda: boats(ramp={"velocity": [0.5, -0.3], "start": 2.0, "end": 6.0}),
    "vortex": lambda: boats(vortices=[VORTEX]),
    "swell": lambda: boats(waves=SWELL),
    "all": lambda: boats(tide=TIDE, vortices=[VORTEX, {**VORTEX, "centre": [5, -4], "velocity": [-0.2, 0.3]}]),
    "file": lambda: mjsheaf.load_scenario("double_gyre", {"controller.velocity_limit": None, "time.end": 100.0}),
    "boats among aircraft": lambda: mixed_scenario(flow={"water": {"dimension": 2, "tide": TIDE}}, time={"end": 9.0}),
}


@pytest.mark.long
@pytest.mark.parametrize("name", SHARED)
def test_nothing_that_moves_in_the_medium_exceeds_what_it_adds_to_the_constants(name: str) -> None:
    """|K w(p) - w(q)| <= f_bar + omega_bar + rho |e|, along the path and at any error e."""
    system, rng, n = SHARED[name]().system, np.random.default_rng(0), 20_000
    team, spectrum, path = system.team, spectrum_of(system.team), follow_targets(system)
    carrier, N = Carrier(system), len(team.agents)
    assert path.cells is not None
    cells = np.sort(rng.integers(0, len(path.cells.begin), n))
    share = rng.uniform(0.0, 1.0, n)
    times = path.cells.begin[cells] + share * (path.cells.end - path.cells.begin)[cells]
    order = np.argsort(times, kind="stable")
    cells, share, times = cells[order], share[order], times[order]
    targets = path.cells.centre[cells] + (2.0 * share - 1.0)[:, None, None] * path.cells.half[cells]
    away = rng.standard_normal((n, N, 3)) * (10.0 ** rng.uniform(-3.0, 0.5, n))[:, None, None]
    away *= [[[1.0, 1.0, agent.dimension - 2.0] for agent in team.agents]]
    places = np.concatenate([team.unpack(carrier.extend(targets)) + away, targets], axis=1)
    met = moving_along(system.medium, times, places)
    own = met[:, :N].reshape(n, -1)[:, team.slots[: path.q_star.shape[1]]]
    pushed = np.linalg.norm(carrier.carry(met[:, N:]) - own, axis=1)
    error = np.linalg.norm(away.reshape(n, -1), axis=1)
    steep, level = bound_moving(system, path, carrier, spectrum, 0.1)
    for bound in (steep, level):
        limits = bound.f_bar + bound.omega_bar + bound.slope * error
        assert (pushed <= limits * (1.0 + 1e-9) + 1e-9).all()
    apart = (pushed / (steep.f_bar + steep.omega_bar + steep.slope * error + 1e-9)).max()
    assert apart > (0.0 if name in ("tide", "ramp") else 0.05)
    assert steep.f_bar + steep.omega_bar < 0.5 * (level.f_bar + level.omega_bar) or level.slope == steep.slope
    assert level.slope == 0.0


@pytest.mark.long
def test_a_tide_that_all_meet_moves_no_error_and_enters_no_constant() -> None:
    still, tidal = (analyse(boats(**water))["theorem"] for water in (dict[str, Any](), {"tide": TIDE}))
    require(tidal, {"omega_bar": 0.0, "f_bar": pytest.approx(still["f_bar"], abs=1e-06)})
    assert tidal["radius_U"] == pytest.approx(still["radius_U"], abs=1e-6)
    apart = analyse(SHARED["boats among aircraft"]())["theorem"]
    assert apart["f_bar"] + apart["omega_bar"] > 0.3


@pytest.mark.slow
def test_a_target_that_passes_through_the_surface_of_waves_has_no_known_path() -> None:
    dives = {"kind": "lissajous", "amplitude": [0.1, 0.1, 3.0], "rate": [1.0, 1.0, 1.0], "phase": [0.0, 0.0, 0.0]}
    targets = list_members(
        {"diver": {"position": [1, 1, -2], "motion": dives}, "ship": {"position": [-3, 2], "heading": 45}}
    )
    fields = {"targets": targets, "target_edges": [], "target_formation": None}
    warnings = [follow_targets(waving(**fields, time={"end": end}).system).warning for end in (0.1, 4.0)]
    assert warnings == ["", "diver passes through the surface of the waves"]


@pytest.mark.slow
def test_the_path_of_targets_in_waves_lies_within_its_cells() -> None:
    system = waving(controller={"gain": 3.0, "control_period": 0.05}).system
    path = follow_targets(system)
    assert path.cells is not None
    positions = pieces_of(system, "ideal", "mujoco")["positions"][:, len(system.team.agents) :]
    for time, where in zip(system.grid.samples[:-1], positions[:-1], strict=True):
        k = int(np.searchsorted(path.cells.end, time + 1e-12))
        share = (time - path.cells.begin[k]) / (path.cells.end[k] - path.cells.begin[k])
        on_segment = path.cells.centre[k] + (2.0 * share - 1.0) * path.cells.half[k]
        assert (np.linalg.norm(where - on_segment, axis=1) <= path.cells.bend[k] + 1e-5).all()


@pytest.mark.long
def test_the_third_assumption_does_not_apply_under_gusts_and_does_not_count() -> None:
    flow = {"air": {"dimension": 3, "gusts": GUSTS}}
    gusty = mixed_scenario(flow=flow)
    still = mixed_scenario(flow={"air": {"dimension": 3}})
    record, without = examine_scenario(gusty).record, examine_scenario(still).record
    third = record.assumptions[2]
    assert (third.verdict, third.holds, third.applies) == ("does not apply", None, False)
    assert "front, back, diver" in third.witness
    assert record.ok == without.ok
    assert not record.theorem.applies
    assert record.theorem.omega_bar is None
    assert record.law.radius is None
    assert "gusts" in record.law.reason


def test_gusts_do_not_excuse_a_broken_topology() -> None:
    flow = {"air": {"dimension": 3, "gusts": GUSTS}}
    blind = mixed_scenario(flow=flow, sensing=[["boat", "ship"]], communication=[["front", "back"]], formations=[])
    assert not examine_scenario(blind).record.ok
