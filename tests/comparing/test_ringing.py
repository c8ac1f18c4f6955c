"""The least damped mode of the vehicles' loop, the usable gain and its cause; convergence in the time constant.

Oracles: the closed form 1 / (2 sqrt(k1 lambda tau)); decays simulated on bodies; first order in tau.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from mjsheaf import simulate
from mjsheaf.comparing import CompareRecord
from mjsheaf.comparing.causes import LIMITED_BY
from mjsheaf.comparing.margins import RingingRecord, find_ringing, try_gains
from mjsheaf.comparing.page import report_text
from mjsheaf.comparing.variants import converge, ladder_of, positions_at_q_star, run_ablation
from mjsheaf.loop.session import engine_of
from mjsheaf.loop.system import System, phases_of
from mjsheaf.scenario import Scenario
from tests.builders import approx, known, two_aircraft, two_boats
from tests.checking.test_norms import errors_of, records
from tests.running import analyse, rms_error
from tests.strategies import tried

HULLS = {"agents": "hull", "targets": "hull"}
FINE: dict[str, Any] = {"physics": {"timestep": 0.002}}
STILL = [{"id": "T1", "position": [0, 0], "motion": {"kind": "static"}}]


def with_tau(tau: float, gain: float, terms: dict[str, Any] | None = None, **fields: Any) -> Scenario:
    """Two hulls with a time constant about a target at rest, under a law that is held for 2 ms."""
    law = {"gain": gain, "control_period": 0.002, **(terms or {})}
    return two_boats("hull", "hull", vehicles={**HULLS, "tau": tau}, controller=law, targets=STILL, **FINE, **fields)


def ringing_at_rest(system: System) -> RingingRecord:
    """Return the ringing of a team that stays at its harmonic extension."""
    rest = positions_at_q_star(system, system.initial[None])[:, : len(system.team.agents)]
    data = xr.Dataset(
        {"harmonic_extension": (("time", "agent", "axis"), np.repeat(rest, 2, axis=0)), "phase": ("time", [0, 0])},
        coords={"time": [0.0, 1.0]},
    )
    found = known(find_ringing(phases_of(system), data)[1])
    assert found.least_damped is not None
    return found


def decay(system: System, ringing: RingingRecord) -> tuple[float, float]:
    """Simulate the bodies' decay to q* from a displacement along x, the stiffest, and fit damping ratio and frequency.

    The fit is Prony's, with four poles; those with the largest amplitude count.
    """
    team, frequency = system.team, known(ringing.least_damped).frequency
    H, axes = team.dirichlet.H.toarray(), team.agents[0].dimension
    along = np.zeros(len(H))
    along[::axes] = np.linalg.eigh(H[::axes, ::axes])[1][:, -1]
    q_star = positions_at_q_star(system, system.initial[None])[0]
    initial = q_star.copy()
    initial[: len(team.agents)] += 0.01 * team.unpack(along)
    grid = replace(system.grid, start=0.0, steps=int(np.ceil(6.0 * 2.0 * np.pi / frequency / system.grid.period)))
    held = np.broadcast_to(q_star[len(team.agents) :], (grid.steps + 1, len(team.targets), 3)).copy()
    run = engine_of(replace(system, grid=grid, initial=initial)).run(held)
    assert run.status == "finished"
    assert not run.log.saturation[:, : len(team.agents)].any()
    e = (team.pack(run.positions) - team.pack(q_star))[:, : len(along)] @ along
    step = max(1, round(2.0 * np.pi / frequency / 12.0 / system.grid.period))
    count = len(e) // step
    rows = e[: count * step].reshape(count, step).T[:, 1:]  # each offset obeys the same recurrence
    past = np.concatenate([np.lib.stride_tricks.sliding_window_view(row[:-1], 4) for row in rows])
    weights = np.linalg.lstsq(past, rows[:, 4:].ravel(), rcond=None)[0]
    z = np.roots(np.r_[1.0, -weights[::-1]]).astype(complex)
    amplitude = np.linalg.lstsq(z[None, :] ** np.arange(count - 1)[:, None], rows[0].astype(complex), rcond=None)[0]
    s = np.log(z[np.argmax(np.where(z.imag > 0.0, np.abs(amplitude), -1.0))]) / (step * system.grid.period)
    return float(-s.real / abs(s)), float(abs(s))


@pytest.mark.parametrize(("tau", "gain"), [(0.1, 3.0), (0.3, 5.0), (0.2, 2.0)])
def test_alike_bodies_have_the_damping_of_the_closed_form(tau: float, gain: float) -> None:
    """Also the usable gain, 1 / (4 zeta^2 lambda tau), which inertia limits; a hold of 2 ms is nearly none."""
    system = with_tau(tau, gain).system
    stiffest = system.largest_eigenvalue
    ringing = ringing_at_rest(system)
    assert known(ringing.least_damped).damping == pytest.approx(
        min(1.0 / (2.0 * np.sqrt(gain * stiffest * tau)), 1.0), rel=0.03
    )
    assert approx(ringing.usable_gain, rel=0.05) == 1.0 / (4.0 * 0.3**2 * stiffest * tau)
    assert ringing.effect == "inertia"


DECAYING: dict[str, tuple[Scenario, float]] = {
    "a slow body": (with_tau(0.3, 5.0), 0.03),
    "a quicker body": (with_tau(0.2, 2.0), 0.03),
    "newton": (with_tau(0.3, 5.0, {"newton": {"rounds": 10}}), 0.03),
    "a delay": (with_tau(0.3, 5.0, links={"all": {"delay": 0.02}}), 0.03),
    "a longer delay": (with_tau(0.1, 3.0, links={"all": {"delay": 0.05}}), 0.03),
    **{name: (two_boats(name, "hull", targets=STILL), 0.1) for name in ("wamv", "otter")},
    **{name: (two_aircraft(name), 0.1) for name in ("hexarotor", "quadrotor")},
}
"""Scenarios, and the relative tolerance: boats head in different directions, so that their decay has several modes."""


@pytest.mark.parametrize(("scenario", "rel"), DECAYING.values(), ids=DECAYING)
def test_bodies_decay_as_the_mode_says(scenario: Scenario, rel: float) -> None:
    """Over links that delay too: what is under way there rings at once, and is not in the positions."""
    ringing = ringing_at_rest(scenario.system)
    damping, frequency = decay(scenario.system, ringing)
    assert known(ringing.least_damped).damping == pytest.approx(damping, rel=rel)
    assert known(ringing.least_damped).frequency == pytest.approx(frequency, rel=rel)


def test_noise_and_losses_do_not_ring_and_delay_leaves_less_gain() -> None:
    perfect = ringing_at_rest(with_tau(0.3, 5.0).system)
    noisy = ringing_at_rest(with_tau(0.3, 5.0, links={"all": {"noise": 1.0, "bias": 1.0, "loss": 0.5}}).system)
    assert noisy.least_damped == perfect.least_damped
    assert noisy.usable_gain == perfect.usable_gain
    late = ringing_at_rest(with_tau(0.3, 5.0, links={"all": {"delay": 0.02}}).system)
    assert known(late.least_damped).damping < 0.95 * known(perfect.least_damped).damping
    assert (late.usable_gain or np.inf) < 0.9 * (perfect.usable_gain or 0.0)
    assert approx(late.without["links"], rel=1e-6) == perfect.usable_gain


@pytest.mark.slow(each=True)
@settings(max_examples=tried(10, 3))
@given(st.integers(10, 100))
def test_a_longer_hold_leaves_less_gain(steps: int) -> None:
    """Ideal agents overshoot at 1/(h lambda); a displacement that changes its sign falls to 37 % at 1.37/(h lambda)."""
    system = with_tau(1e-4, 1.0).system
    period = steps * system.bodies.timestep
    held, longer = (
        replace(system, grid=replace(system.grid, period=x, continuous=False)) for x in (period, 2 * period)
    )
    usable, less = (ringing_at_rest(one).usable_gain for one in (held, longer))
    assert approx(usable, rel=0.05) == (1.0 + np.exp(-np.pi * 0.3 / np.sqrt(1.0 - 0.3**2))) / (
        period * system.largest_eigenvalue
    )
    assert (less or np.inf) < (usable or 0.0)


@pytest.mark.parametrize("gain", [0.5, 6.0])
def test_the_usable_gain_does_not_depend_on_the_present_one(gain: float) -> None:
    usable = ringing_at_rest(with_tau(0.2, gain).system).usable_gain
    assert approx(usable, rel=3e-3) == ringing_at_rest(with_tau(0.2, 2.0).system).usable_gain


@pytest.mark.slow(each=True)
@pytest.mark.parametrize(
    ("vehicle", "fields", "effect"),
    [
        ("hull", {"vehicles": {**HULLS, "tau": 0.4}}, "inertia"),
        ("otter", {}, "lag"),
        ("hull", {"vehicles": {**HULLS, "tau": 0.1}, "controller": {"gain": 1.0, "control_period": 0.5}}, "hold"),
        ("hull", {"vehicles": {**HULLS, "tau": 0.1}, "links": {"all": {"delay": 0.4}}}, "links"),
    ],
)
def test_the_effect_that_limits_is_named(vehicle: str, fields: dict[str, Any], effect: str) -> None:
    ringing = ringing_at_rest(two_boats(vehicle, "hull", **fields).system)
    assert ringing.effect == effect
    usable = [gain for gain in ringing.without.values() if gain is not None]
    assert effect == "inertia" or ringing.without[effect] == max(usable)


def test_distance_to_the_ideal_run_is_of_first_order_in_tau() -> None:
    for scenario in (two_boats("wamv", "hull"), two_boats("otter", "hull")):
        system = scenario.system
        found = converge(system)
        assert approx(found.slope, abs=0.1) == 1.0
        assert all(
            a.tau_s == pytest.approx(2.0 * b.tau_s) for a, b in zip(found.points, found.points[1:], strict=False)
        )
        for point in found.points:
            assert point.timestep_s <= 0.1 * point.tau_s * (1.0 + 1e-9)
            steps = system.grid.period / point.timestep_s
            assert steps == pytest.approx(round(steps))


# -- a higher gain, measured: plain runs, and `check` ------------------------------------------------------------------


@pytest.mark.slow
def test_trials_are_plain_runs_at_their_gains(record: CompareRecord) -> None:
    assert len(record.gains) >= 2
    for trial in record.gains:
        data = simulate(two_boats("otter", "hull", controller={"gain": trial.gain, "control_period": 0.02}))
        late = rms_error(data)[data["time"].values >= 1.5 - 1e-9]
        assert approx(trial.late.tracking_error, rel=1e-9) == np.sqrt((late**2).mean())
        assert approx(trial.saturated) == data["agent_saturation"].values.mean()
    assert record.gains[0].gain == record.gain
    assert record.gains[0].late == record.rung("all").errors["team"].late


@pytest.mark.slow
def test_the_verdict_says_what_limits_and_the_page_what_was_measured(record: CompareRecord) -> None:
    (limit,) = [s for s in record.verdict if s.startswith("gain 1 1/s")]
    assert f"{record.usable_gain:.2g} 1/s" in limit
    assert LIMITED_BY[known(record.ringing).effect] in limit
    page = report_text(record)
    for trial in record.gains:
        error = f"{trial.late.tracking_error:.3g}"
        assert any(row.split()[:2] == [f"{trial.gain:.4g}", error] for row in page.splitlines())
    assert "thrusters at a limit" in page


def test_the_loop_is_that_of_the_bodies_with_their_effects(record: CompareRecord) -> None:
    """And the usable gain below the stable one. Oracle: `check`, whose flow is that along the path in theory."""
    ringing, loop, bodies = (
        known(record.ringing),
        known(record.loop),
        analyse(two_boats("otter", "hull"))["margins"]["bodies"],
    )
    assert known(record.usable_gain) == known(ringing.usable_gain) < known(ringing.largest_gain)
    assert (loop.largest_gain, loop.stable, loop.reason) == (ringing.largest_gain, bodies["stable"], "")
    assert ringing.stable is bodies["stable"]
    assert ringing.largest_gain == pytest.approx(bodies["largest_gain"], rel=0.05)
    assert known(ringing.least_damped).damping == pytest.approx(bodies["least_damped"]["damping"], rel=0.05)


def test_every_error_of_a_comparison_states_its_norm(record: CompareRecord) -> None:
    held = [part for _, part in records(record.model_dump(mode="json")) if errors_of(part) or "at_q_star_m" in part]
    assert len(held) >= 2 * len(record.ladder) + len(record.budgets)
    assert {part["norm"] for part in held} == {"per_agent_rms"}


@pytest.mark.parametrize(
    ("largest", "expected"), [(None, [1.0, 2.0, 4.0]), (3.0, [1.0, 2.0, 2.7]), (2.0, [1.0, 1.8]), (1.1, [])]
)
def test_gains_are_tried_below_that_at_which_the_loop_is_unstable(largest: float | None, expected: list[float]) -> None:
    phases = two_boats("otter", "hull", time={"end": 0.2}).phases
    given = run_ablation(phases, [rung for rung in ladder_of(phases) if rung.key == "all"])["all"]
    assert [trial.gain for trial in try_gains(phases, given, largest)] == expected
