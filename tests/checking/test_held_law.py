"""The held law's loop, the gains that hold it stable, and the bound on a run, for each term and all together.

Oracles: runs of the ideal backend; between their samples, scipy's integrator; a scan of gains.
"""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import mjsheaf
from mjsheaf.checking.check import propose
from mjsheaf.checking.loop import held_law
from mjsheaf.checking.loop.body_loop import loop_on_path
from mjsheaf.checking.loop.held_law import Envelope, Loop, envelope, law_loop, loop_of
from mjsheaf.checking.loop.linear_law import LinearLaw
from mjsheaf.checking.loop.margins import hold_margin
from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.checking.theorem.certificate import certify
from mjsheaf.errors import UndecidedError
from mjsheaf.loop.system import System
from mjsheaf.scenario import scenario_from_mapping
from tests.builders import build_scenario, known, list_members, make_fields, random_scenario
from tests.checking import test_links
from tests.oracles.law import medium
from tests.running import ideal_errors, run_ideal
from tests.strategies import cases

Array = NDArray[np.float64]

STUDIED = 500
PIECES = 20  # of the study, so that it spreads over processes
TERMS = test_links.TERMS | {"all": test_links.TERMS["all"] | {"odometry": {"noise": 1e-4, "bias": 0.02}}}


def studied(seed: int, kind: str) -> System:
    """A random team under a random stable gain, period and number of rounds."""
    rng, raw = np.random.default_rng([seed, 13]), random_scenario(seed)
    fields = {name: dict(term) for name, term in TERMS[kind].items()}
    for name in ("feedforward", "newton"):
        if name in fields:
            fields[name]["rounds"] = int(rng.integers(1, 6))
    period = float(rng.choice([0.005, 0.01, 0.02, 0.05]))
    raw["controller"] = {"gain": 1.0, "control_period": period, **fields}
    raw["time"] = {"end": float(rng.uniform(2.0, 5.0))}
    low, high = loop_of(scenario_from_mapping(raw).system).stable_gains or (0.0, 0.0)
    assert high > low
    raw["controller"]["gain"] = low + float(rng.uniform(0.02, 0.95)) * (min(high, 1e3) - low)
    return scenario_from_mapping(raw).system


def accuracy(system: System) -> float:
    """Of a run: what its integrator may be wrong by, m."""
    return 1e-7 * (1.0 + float(np.abs(system.initial).max()))


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("piece", range(PIECES))
def test_the_bound_is_never_exceeded(piece: int) -> None:
    """Of 120 teams and laws, 20 with each term, of which CI tries six, and of 500 in `make test-all`."""
    seeds = cases(STUDIED, 120)[piece::PIECES]
    assert sum(map(held, seeds)) > 0.9 * len(seeds)


def held(seed: int) -> bool:
    """Return True if a studied team has a bound, after verifying that its run does not exceed it."""
    kind = list(TERMS)[seed // PIECES % len(TERMS)]
    system = studied(seed, kind)
    try:
        bound = envelope(system, certify(system))
    except UndecidedError:
        return False
    error = np.linalg.norm(ideal_errors(system), axis=1)
    worst = float((error / (bound.samples + accuracy(system))).max())
    assert worst <= 1.0, f"seed {seed}, {kind}: |e| reaches {worst:.6g} of its bound"
    assert (bound.within >= np.maximum(bound.samples[1:], bound.samples[:-1])).all()
    return True


@pytest.mark.slow
@pytest.mark.parametrize("kind", TERMS)
def test_between_samples_too(kind: str) -> None:
    """Held commands, integrated by scipy from the samples of a run."""
    system = studied(3, kind)
    bound, run, team = envelope(system, certify(system)), run_ideal(system), system.team
    h, V = system.grid.period, len(team.members)
    rng = np.random.default_rng(0)
    for k in rng.integers(0, system.grid.steps, 12):
        command = run.log.command[k]

        def velocity(t: float, flat: Array, command: Array = command) -> Array:
            x = flat.reshape(V, 3)
            return (command + np.array([medium(system, v, t, x[v]) for v in range(V)])).ravel()

        start, times = system.grid.start + k * h, np.linspace(0.0, h, 9)
        solved = solve_ivp(
            velocity, (start, start + h), run.positions[k].ravel(), t_eval=start + times, rtol=1e-10, atol=1e-12
        )
        x = solved.y.T.reshape(-1, V, 3)
        np.testing.assert_allclose(x[-1], run.positions[k + 1], atol=1e-7)
        q, p = team.split(x)
        error = np.linalg.norm(team.dirichlet.extend(p) - q, axis=1)
        assert error.max() <= bound.within[k] + accuracy(system)


@pytest.mark.parametrize("kind", TERMS)
def test_the_matrices_are_the_loop(kind: str) -> None:
    """Without flow, errors of a run are those of x+ = M x + h g d in each eigenvector, d along the targets' path."""
    raw = random_scenario(11)
    raw["flow"], raw["target_formation"]["gain"] = {}, 0.3
    controller = {"gain": 3.0, "control_period": 0.01, **TERMS[kind], "odometry": {}}
    system = scenario_from_mapping({**raw, "controller": controller}).system
    loop, (values, vectors) = loop_of(system), system.team.dirichlet.eigenvectors
    found = ideal_errors(system) @ vectors
    drive = held_law._drive(system, certify(system), values, vectors)
    d, M = (drive.left - drive.met) @ vectors, loop.matrices()
    x = np.zeros(M.shape[:2])
    x[:, 0] = found[0]
    for k in range(system.grid.steps):
        np.testing.assert_allclose(x[:, 0], found[k], atol=1e-6)
        x = np.einsum("lij,lj->li", M, x)
        x[:, 0] += loop.period * d[k]


@pytest.mark.parametrize("kind", ["paper", "newton", "integral", "all"])
@pytest.mark.parametrize("seed", range(4))
def test_stable_gains_are_those_of_a_scan(kind: str, seed: int) -> None:
    loop = loop_of(studied(seed, kind))
    low, high = known(loop.stable_gains)
    assert low < loop.gain < high
    gains = np.concatenate([np.geomspace(1e-6 * high, 3.0 * high, 200), [low * 1.001, low * 0.999, high * 0.999]])
    for gain in gains[gains > 0.0]:
        assert (replace(loop, gain=float(gain)).radius < 1.0) == (low < gain < high), gain


class TwoStretches:
    """A law with two numbers of memory, under which H = 1 is stable at two separate stretches of gains."""

    plain = False

    def feedback(self, gain: float, values: Array) -> LinearLaw:
        A, B = np.diag([0.2, 0.9]), np.ones((2, 1))
        C, D = gain * np.array([0.9, -0.8]), gain * np.array([-1.2])
        A, B, C, D = (np.array([part] * len(values)) for part in (A, B, C, D))
        return LinearLaw(A, B, C, D, np.zeros(2))


@pytest.mark.parametrize(
    ("gain", "first"), [(0.1, True), (0.45, True), (0.7, False), (1.0, False), (2.0, False)], ids=str
)
def test_of_two_stretches_of_stable_gains_it_is_the_nearest(gain: float, first: bool) -> None:
    loop = Loop(cast(Any, TwoStretches()), np.ones(1), gain, 1.0)
    low, high = known(loop.stable_gains)
    assert (low == 0.0) == first
    for end, inwards in ((low, 1.0), (high, -1.0)):
        for share in (1e-6, -1e-6):
            beside = end + share * inwards
            assert beside < 0.0 or (replace(loop, gain=beside).radius < 1.0) == (share > 0.0)


def attained(fields: dict[str, Any], N: int = 1, **more: Any) -> tuple[Array, Envelope]:
    """|e| and its bound for agents that begin at q*, each sensing one target in the plane."""
    raw = make_fields(
        {f"A{i}": [1.0, 2.0] for i in range(N)},
        {"T": {"position": [1.0, 2.0], **more.pop("target", {})}},
        [[f"A{i}", "T"] for i in range(N)],
        communication=[[f"A{i}", f"A{i + 1}"] for i in range(N - 1)],
        controller={"gain": 2.0, **fields},
        time={"end": 40.0},
    )
    system = scenario_from_mapping({**raw, **more}).system
    return np.linalg.norm(ideal_errors(system), axis=1), envelope(system, certify(system))


CURRENT: dict[str, Any] = {"flow": {"agents": {"dimension": 2, "drift": [0.3, -0.4]}}}
CIRCLE: dict[str, Any] = {
    "target": {"motion": {"kind": "lissajous", "amplitude": [20, 20], "rate": [0.3, 0.3], "phase": [0, -1.5708]}}
}
SWELL: dict[str, Any] = {"disturbance": {"agents": {"bound": 0.5, "frequencies": [0.02, 0.02], "components": 1}}}


@pytest.mark.parametrize(
    ("kind", "drive", "N"),
    [
        *(("paper", drive, N) for drive in (CURRENT, CIRCLE) for N in (1, 3)),
        *((kind, CIRCLE, N) for kind in ("feedforward", "all") for N in (1, 3)),
        *(("newton", CURRENT, N) for N in (1, 3)),
        ("drift", SWELL, 1),  # the change in a period remains; different swells of more agents would not add up
    ],
)
def test_the_bound_is_attained_where_it_can_be(kind: str, drive: dict[str, Any], N: int) -> None:
    """A d that hardly turns while the loop forgets, along the slowest eigenvector."""
    fields = {name: term for name, term in TERMS[kind].items() if name not in ("odometry", "integral")}
    error, bound = attained(fields, N, **drive)
    late = len(error) // 2
    share = error[late:] / bound.samples[late:]
    assert 0.9 <= share.max() <= 1.0 + 1e-9


def test_the_bound_is_attained_with_integral() -> None:
    """The response to a first current: its peak is all that the bound allows then."""
    error, bound = attained(TERMS["integral"], **CURRENT)
    peak = int(error.argmax())
    assert 0.9 <= error[peak] / bound.samples[peak] <= 1.0 + 1e-9
    assert error[-1] < 0.01 * error[peak]


def test_a_limit_that_may_be_met_leaves_it_undecided() -> None:
    raw = random_scenario(2)
    raw["controller"] = {"gain": 2.0, "control_period": 0.01, "velocity_limit": 0.5, "newton": {"rounds": 3}}
    system = scenario_from_mapping(raw).system
    found = law_loop(system, certify(system))
    assert found.stable
    assert found.radius is None
    assert found.unlimited is not None
    assert "0.5 m/s" in found.reason


def test_an_integral_that_fills_up_at_the_start_leaves_it_undecided() -> None:
    """Nothing drives the loop: the initial error alone brings the integral to its limit, beyond which it overshoots."""
    still: dict[str, Any] = {"target": {"motion": {"kind": "static"}}}
    still["agents"] = [{"id": "A0", "position": [50.0, 0.0]}]
    free, bound = attained({"integral": {"gain": 0.5}}, **still)
    assert not bound.clipped
    assert (free <= bound.samples + 1e-4).all()
    error, bound = attained({"integral": {"gain": 0.5, "limit": 0.5 * bound.integral}}, **still)
    assert "integral" in bound.clipped
    assert (error > bound.samples + 1e-4).any()


def test_errors_in_another_eigenvector_at_each_sample_are_allowed_for() -> None:
    """Rounds that keep nothing of one eigenvector and much of another: v is larger than either could make it alone."""
    c = np.array([0.0, 0.9])
    v = np.zeros(2)
    for r in [*[(0.0, 1.0)] * 200, (1.0, 0.0)]:
        v = c * v + (1.0 - c) * np.array(r)
    assert np.linalg.norm(v) > 1.3
    assert np.linalg.norm(v) <= held_law._amplified(c)
    assert held_law._amplified(np.array([0.9999])) == pytest.approx(1.0)  # a geometric series


def test_a_deadbeat_loop_has_a_rate() -> None:
    """k1 h lambda = 1: the error is gone after a period, and the rate is a number."""
    law = {"gain": 50.0, "control_period": 0.02}
    system = build_scenario({"A": [5.0, 0.0]}, {"T": [0.0, 0.0]}, [["A", "T"]], controller=law).system
    found = law_loop(system, certify(system))
    assert found.spectral_radius == 0.0
    assert known(found.rate) > 1e3
    assert found.error_per_disturbance == pytest.approx(0.02)
    assert found.largest_gain == pytest.approx(100.0)


@pytest.mark.parametrize("kind", TERMS)
def test_error_per_disturbance(kind: str) -> None:
    """Sum over a long horizon; the paper's law has a closed form if nothing overshoots."""
    loop = loop_of(studied(1, kind))
    summed = loop.responses(20_000)[3].sum()
    assert summed * (1.0 - 1e-6) <= loop.error_per_disturbance <= summed * 1.002
    if kind == "paper":
        slow = replace(loop, gain=0.1 / loop.values[-1])
        assert slow.error_per_disturbance == pytest.approx(10.0 * loop.values[-1] / loop.values[0], rel=1e-5)


@pytest.mark.parametrize("gain", [1.0, 30.0])
@pytest.mark.parametrize("fields", [{"drift": {"filter": 0.1}}, {"feedforward": {"rounds": 2, "extrapolate": True}}])
def test_noise_of_the_command_is_that_of_a_run(gain: float, fields: dict[str, Any]) -> None:
    """Odometry alone moves agents, each of an eigenvalue of its own; feedback answers, the more the higher the gain."""
    s = 1e-3
    law = {"gain": gain, "control_period": 0.05, **fields, "odometry": {"noise": s}}
    seen = [{"between": ["A", "T"], "weight": 0.3}, ["B", "T"]]
    at_rest = {"T": {"position": [0.0, 0.0], "motion": {"kind": "static"}}}
    agents = {"A": [0.0, 0.0], "B": [0.0, 0.0]}
    system = build_scenario(agents, at_rest, seen, controller=law, time={"end": 1000.0}).system
    command = run_ideal(system).log.command[200:, :2, :2]
    found = law_loop(system, certify(system)).noise
    assert found == pytest.approx(np.sqrt((command**2).mean(axis=(0, 2))).max() / s, rel=0.05)


def test_proposals_allow_for_odometry_that_the_law_does_not_use_yet() -> None:
    noisy = mjsheaf.load_scenario("paper", {"time.end": 3.0, "controller.odometry": {"noise": 1.0}}).system
    assert all("feedforward" not in proposal.controller for proposal in propose(noisy, certify(noisy), 3.0))


@pytest.mark.slow
def test_proposals_say_what_vehicles_do_not_stand() -> None:
    """Feedforward and drift see no error: without Newton direction the loop on bodies is the paper's."""
    system = mjsheaf.load_scenario("quads", {"time.end": 4.0}).system
    certificate = certify(system)
    largest = known(loop_on_path(system, certificate).largest_gain)
    found = {radius: propose(system, certificate, radius) for radius in (1.0, 10.0)}
    for proposal in [p for some in found.values() for p in some if "newton" not in p.controller]:
        assert proposal.stable_on_bodies == (float(str(proposal.controller["gain"])) < largest)
    assert {p.stable_on_bodies for some in found.values() for p in some} == {True, False}


def test_an_unbounded_field_is_confined_or_undecided() -> None:
    """A pole without a core: nothing is claimed near it; far from it the bound holds."""
    pole = {"dimension": 2, "sources": [{"centre": [0.0, 0.0], "alpha": 0.2}], "core": 0.0}
    far = {"motion": {"kind": "lissajous", "amplitude": [1, 1], "rate": [0.5, 0.4], "phase": [0, 1]}}
    start = list_members({"A0": [30.0, 2.0]})
    target = {**far, "position": [30.0, 2.0]}
    error, bound = attained({"gain": 8.0}, flow={"agents": pole}, target=target, agents=start)
    assert (error <= bound.samples + 1e-9).all()
    with pytest.raises(UndecidedError, match="no bound confines"):
        attained({"gain": 1.0}, flow={"agents": pole}, target={**far, "position": [0.5, 0.0]})


@pytest.mark.slow
def test_proposals_keep_what_they_promise() -> None:
    present = {"time.end": 10.0, "controller.integral": {"gain": 0.1}}
    scenario = mjsheaf.load_scenario("paper", present)
    proposals = propose(scenario.system, certify(scenario.system), 3.0)
    assert proposals
    for proposal in proposals:
        assert proposal.controller.get("integral", 0) is None  # which the scenario has
        fields = {f"controller.{name}": value for name, value in proposal.controller.items()}
        system = mjsheaf.load_scenario("paper", {**present, **fields}).system
        error = np.linalg.norm(ideal_errors(system), axis=1)
        assert error[len(error) // 2 :].max() <= proposal.bound <= 3.0
        run = run_ideal(system)
        asked = np.linalg.norm(run.log.command[:, : len(system.team.agents)], axis=2)
        assert asked[len(error) // 2 :].max() <= known(proposal.command)


def test_a_continuous_law_and_a_team_without_edges_have_no_limit() -> None:
    continuous = mjsheaf.load_scenario("certified").system
    assert hold_margin(continuous, spectrum_of(continuous.team)) is None
    apart = mjsheaf.load_scenario("midpoint", {"communication": [], "sensing": []}).system
    margin = known(hold_margin(apart, spectrum_of(apart.team)))
    assert (margin.product, margin.largest_gain, margin.ringing_gain) == (0.0, None, None)
