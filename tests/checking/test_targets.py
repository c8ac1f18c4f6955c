"""The targets' path, the cells that cover it, and the bounds that are taken over them.

Oracle: an independent integrator (tests/checking/oracle.py), whose every step is looked at; dense samples of flows and
references.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf.checking import examine
from mjsheaf.checking.theorem import targets
from mjsheaf.checking.theorem.constants import coarser, difference_along
from mjsheaf.checking.theorem.flow_bounds import bound_slopes
from mjsheaf.checking.theorem.targets import Carrier, follow_targets
from mjsheaf.law.paths import Lissajous, Motion, Waypoints, add_reference, pack_motions, reference_bounds
from mjsheaf.loop.system import System
from mjsheaf.media.varying import evaluate
from mjsheaf.scenario import scenario_from_mapping
from tests.builders import build_scenario, field_of, flow_jacobian, known, mixed_scenario, require
from tests.checking.adversarial import adversarial_scenario
from tests.checking.oracle import solve
from tests.checking.test_flow_bounds import random_field

SEEDS = [0, 2, 4, 5, 6, 7, 29]  # jets, vortices, small cores, a saddle, corners


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_cells_hold_the_path_and_the_drift_and_the_bound_on_the_difference_is_tight(seed: int) -> None:
    raw = adversarial_scenario(seed)
    system, truth = scenario_from_mapping(raw).system, solve(raw)
    drift = truth.target_velocities - evaluate(system.harmonics[len(raw["agents"]) :], truth.time)
    path, carrier = follow_targets(system), Carrier(system)
    cells = known(path.cells)
    k = np.clip(np.searchsorted(cells.begin, truth.time, side="right") - 1, 0, len(cells.begin) - 1)
    along = (truth.time - cells.begin[k]) / (cells.end[k] - cells.begin[k])
    chord = cells.centre[k] + (2.0 * along - 1.0)[:, None, None] * cells.half[k]
    assert (np.linalg.norm(truth.targets - chord, axis=2) <= cells.bend[k]).all()
    assert (np.linalg.norm(drift - cells.drift[k], axis=2) <= cells.spread[k] + 1e-9 * np.abs(drift).max()).all()
    for most in (1, 20):
        begin, end, centre, radius = coarser(cells, most)
        assert len(begin) <= most
        assert (begin[0], end[-1]) == (cells.begin[0], cells.end[-1])
        k = np.clip(np.searchsorted(begin, truth.time, side="right") - 1, 0, len(begin) - 1)
        assert np.all(np.linalg.norm(truth.targets - centre[k], axis=2) <= radius[k])
    assert cells.begin[0] == system.grid.start
    np.testing.assert_allclose(cells.begin[1:], cells.end[:-1], rtol=1e-14, atol=1e-14)
    assert cells.end[-1] == pytest.approx(system.grid.samples[-1])
    difference = difference_along(system, path, carrier)
    q_star = system.team.unpack(carrier.extend(truth.targets))
    own = np.stack([system.flows[system.field[i]].velocity(q_star[:, i]) for i in range(q_star.shape[1])], axis=1)
    n_q = system.team.dirichlet.H.shape[0]
    f_B = carrier.carry(drift) - own.reshape(len(own), -1)[:, system.team.slots[:n_q]]
    largest = float(np.linalg.norm(f_B, axis=1).max())
    assert largest <= difference.bound <= 1.25 * largest + 1e-4


def test_the_bound_on_the_difference_is_tight_where_agents_meet_what_targets_do_not() -> None:
    """A target is carried 2.5 m a sample across a jet 0.05 m wide, which its agent alone meets."""
    jet = {"centre": [11.3, 0.0], "direction": [0.0, 1.0], "beta": 2.0, "width": 0.05, "length": 1e9}
    flow = {"targets": {"dimension": 2, "drift": [5.0, 0.0]}, "agents": {"dimension": 2, "channels": [jet]}}
    system = _moving(controller={"gain": 1.0, "control_period": 0.5}, flow=flow)
    bound = difference_along(system, follow_targets(system), Carrier(system)).bound
    largest = np.hypot(5.0, 2.0)  # at the jet's centre, across the drift
    assert largest <= bound <= 1.002 * largest


def test_a_narrow_jet_is_not_stepped_over() -> None:
    """The target crosses it at 5 m/s within a sample, and is moved along it by the integral of 2 exp(-x^2 / 2 w^2)."""
    jet = {"centre": [11.3, 0.0], "direction": [0.0, 1.0], "beta": 2.0, "width": 0.05, "length": 1e9}
    flow = {"targets": {"dimension": 2, "drift": [5.0, 0.0], "channels": [jet]}}
    path = follow_targets(_moving(controller={"gain": 1.0, "control_period": 0.5}, flow=flow))
    assert path.positions[-1, -1, 1] == pytest.approx(2.0 * 0.05 * np.sqrt(2.0 * np.pi) / 5.0, rel=1e-6)


def test_of_a_map_that_is_too_large_to_store_norms_bound_the_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    system, rng = mixed_scenario().system, np.random.default_rng(0)
    N, M = len(system.team.agents), len(system.team.targets)
    stored = Carrier(system)
    monkeypatch.setattr(targets, "_DENSE", 0)
    large = Carrier(system)
    motions = rng.standard_normal((5, M, 3)) + 1j * rng.standard_normal((5, M, 3))
    np.testing.assert_allclose(large.extend(motions.real), stored.extend(motions.real), atol=1e-9)
    np.testing.assert_allclose(large.carry(motions), stored.carry(motions), atol=1e-9)
    radii, slopes, moves = rng.random((5, M)), rng.random((5, N)), rng.random((5, N))
    assert large.reach(radii).shape == (5, N)
    assert (stored.reach(radii) <= large.reach(radii)).all()
    moved, away = np.linalg.norm(stored.carry(motions.real), axis=1), np.linalg.norm(motions.real, axis=2)
    assert (moved <= large.spread(away, slopes, moves)).all()
    assert np.isfinite(large.spread(radii, slopes, moves)).all()


def test_what_a_range_leaves_free_stays_where_the_team_is() -> None:
    seen = [{"between": ["A", "T"], "measures": "range", "offset": [5.0]}]
    system = build_scenario({"A": [4.0, 4.0]}, {"T": [1.0, 0.0]}, seen).system.local
    np.testing.assert_allclose(Carrier(system).extend(system.initial[1:]), [4.0, 4.0], rtol=1e-9)


def _moving(target: dict[str, Any] | None = None, **changes: Any) -> System:
    """An agent and a target that begin at the origin, with a continuous law; fields replace fields."""
    law = {"gain": 1.0, "control_period": 0, "record_period": 0.1}
    place = {"position": [0.0, 0.0], **(target or {})}
    usual = {"time": {"end": 20.0}, "controller": law}
    return build_scenario({"A": [0.0, 0.0]}, {"T": place}, [["A", "T"]], **{**usual, **changes}).system


def test_a_path_that_takes_too_many_steps_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    fast = {"kind": "lissajous", "amplitude": [1.0, 0.0], "rate": [50.0, 0.0], "phase": [0.0, 0.0]}
    path = follow_targets(_moving({"motion": fast}))
    assert path.warning == ""
    assert (known(path.cells).end - known(path.cells).begin).max() <= 0.1251 / 50.0  # an eighth of a radian
    monkeypatch.setattr(targets, "MOST_STEPS", 1000)
    path = follow_targets(_moving({"motion": fast}))
    assert path.cells is None
    assert "too long or too stiff" in path.warning
    record = examine(_moving({"motion": fast})).record
    assert not record.ok
    assert [a.number for a in record.assumptions if a.verdict == "undecided"] == [7]
    unknown = dict.fromkeys(("chi_infinite", "initial_error_inside_S", "radius_U"))
    require(record.theorem.model_dump(), {"applies": False, "gain_condition": False, **unknown})
    assert [problem.what for problem in record.problems] == ["assumption 7 is undecided"]


def test_a_target_that_falls_into_a_pole_is_named_with_the_time() -> None:
    """x' = -a / x from x = r ends in the pole at r^2 / 2 a."""
    sink = {"dimension": 2, "core": 0, "sources": [{"centre": [0.3, 0.0], "alpha": -0.1}]}
    path = follow_targets(_moving(flow={"targets": sink}))
    assert path.cells is None
    assert "T cannot be followed beyond t = 0.45 s: it runs into a singularity" in path.warning


@pytest.mark.parametrize("place", [0.0, 1e-9, 0.005, 3.0])
def test_a_target_at_rest_is_known_however_near_the_origin(place: float) -> None:
    path = follow_targets(_moving({"position": [place, 0.0]}))
    assert path.warning == ""
    assert path.cells is not None


def test_a_motion_that_is_too_fast_for_so_late_a_time_is_not_known() -> None:
    """At 1e6 s the phase of 1000 rad/s is good to 1e-7 rad; there is no singularity anywhere."""
    motion = {"kind": "lissajous", "amplitude": [1.0, 0.5], "rate": [1e3, 1.3e3], "phase": [0.3, 1.0]}
    path = follow_targets(_moving({"motion": motion}, time={"start": 1e6, "end": 1e6 + 1.0}))
    assert path.cells is None
    assert "moves too fast for the resolution of floating-point time" in path.warning


@pytest.mark.slow
def test_a_sensitive_path_is_not_known() -> None:
    """A target between two hyperbolic points of a strong flow: the last digit decides where it goes."""
    vortices = [{"centre": [x, y], "gamma": 100.0 * (-1) ** (x + y)} for x in range(-1, 3) for y in range(-1, 3)]
    flow = {"dimension": 2, "core": 0.2, "drift": [0.05, 0.03], "vortices": vortices}
    path = follow_targets(_moving(flow={"targets": flow}, disturbance={"targets": {"bound": 5.0}}, seed=1))
    assert path.cells is None
    assert "too sensitive" in path.warning


@pytest.mark.parametrize("dimension", [2, 3])
def test_slopes_over_balls_are_bounds(dimension: int) -> None:
    rng = np.random.default_rng(dimension)
    for _ in range(40):
        field = random_field(rng, dimension)
        centre, radius = rng.uniform(-2, 2, dimension), float(rng.uniform(0, 2.0))
        step = rng.standard_normal((500, dimension))
        step *= (radius * rng.uniform(0, 1, 500) ** (1 / dimension) / np.linalg.norm(step, axis=1))[:, None]
        seen = np.linalg.norm(flow_jacobian(field, centre + step), ord=2, axis=(1, 2)).max()
        assert seen <= bound_slopes(field, centre, radius) * (1.0 + 1e-12)


def test_a_single_kernel_attains_its_slope_bound() -> None:
    source = field_of(3, core=0.5, sources=[[0, 0, 0, 2.0]])
    assert bound_slopes(source, [0.0, 0.0, 0.0], 0.0) == pytest.approx(2 * 2.0 / 0.5**3)  # twice that at the centre
    vortex = field_of(2, core=0.5, vortices=[[0, 0, 2.0]])
    assert bound_slopes(vortex, [0.0, 0.0], 0.0) == pytest.approx(2.0 / 0.25)
    jet = field_of(2, channels=[[0, 0, 1, 0, 3.0, 0.5, 1e9]])
    steepest = 3.0 / 0.5 * np.exp(-0.5)  # at one width
    assert bound_slopes(jet, [0.0, 0.5], 0.0) == pytest.approx(steepest)
    assert bound_slopes(jet, [0.0, 4.0], 100.0) == pytest.approx(steepest)
    pole = field_of(2, core=0.0, vortices=[[0, 0, 2.0]])
    assert bound_slopes(pole, [0.5, 0.0], 0.5) == np.inf
    assert bound_slopes(pole, [0.5, 0.0], 0.4) == pytest.approx(200.0)


def test_bounds_of_references_are_never_exceeded_and_nearly_attained() -> None:
    rng = np.random.default_rng(4)
    start = rng.uniform(-3, 3, (4, 3))
    A, rate, phase = rng.uniform([[0.0], [0.1], [0.0]], [[3.0], [9.0], [6.0]], (3, 3)).tolist()
    motions: list[Motion | None] = [
        Lissajous(amplitude=A, rate=rate, phase=phase),
        Waypoints(points=rng.uniform(-5, 5, (5, 3)).tolist(), speed=3.0, pull=0.0),
        Waypoints(points=rng.uniform(-5, 5, (4, 3)).tolist(), speed=0.5, closed=True, pull=0.0),
        None,
    ]
    packed = pack_motions(motions, start, 2.0, [3, 3, 3, 3])
    t, velocity = np.linspace(2.0, 82.0, 16_001), np.zeros((16_001, 3, 3))
    for k, v in np.ndindex(velocity.shape[:2]):
        add_reference(packed, v, t[k], start[v], velocity[k, v])
    acceleration = np.diff(velocity, axis=0) / (t[1] - t[0])
    for sampled, bounds in zip((velocity, acceleration), reference_bounds(packed), strict=True):
        seen = np.linalg.norm(sampled, axis=2).max(axis=0)
        assert (seen <= bounds[:3] * (1.0 + 1e-9)).all()
        assert (bounds[:3] <= 3.0 * seen).all()
        assert bounds[3] == 0.0


def test_a_target_without_a_bound_leaves_no_bound() -> None:
    """Also where an agent's q* does not depend on it: 0 times infinity is no number."""
    apart = build_scenario(
        {"A1": [1.0, 0.0], "A2": [9.0, 0.0]}, {"T1": [0.0, 0.0], "T2": [8.0, 0.0]}, [["A1", "T1"], ["A2", "T2"]]
    )
    np.testing.assert_array_equal(Carrier(apart.system).reach(np.array([np.inf, 1.0])), [np.inf, np.inf])
    np.testing.assert_array_equal(Carrier(apart.system).reach(np.array([2.0, 1.0])), [2.0, 1.0])
