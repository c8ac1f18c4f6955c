"""Damping predicted and measured, and convergence in the time constant.

Oracles: the closed form 1 / (2 sqrt(k1 lambda tau)); signals with known roots; first order in tau.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf.comparing.convergence import converge
from mjsheaf.comparing.ringing import fit_roots, least_damped, ringing_of, second_order, usable_gain
from mjsheaf.scenario import Scenario
from tests.builders import approx, two_aircraft, two_boats


def with_tau(tau: float, gain: float) -> Scenario:
    vehicles = {"agents": "hull", "targets": "hull", "tau": tau}
    return two_boats("hull", "hull", vehicles=vehicles, controller={"gain": gain, "control_period": 0.002},
                physics={"timestep": 0.002})  # fmt: skip


def test_fit_finds_the_roots_of_a_signal() -> None:
    s, t = complex(-0.4, 2.0), 0.1 * np.arange(60)
    signals = np.stack([np.exp(s.real * t) * np.cos(s.imag * t + phase) for phase in (0.3, 1.0)])
    roots = fit_roots(signals, 0.1)
    assert sorted(roots, key=lambda z: z.imag) == pytest.approx([s.conjugate(), s], abs=1e-9)


@pytest.mark.parametrize(("tau", "gain"), [(0.1, 3.0), (0.3, 5.0), (0.05, 2.0)])
def test_alike_bodies_have_the_damping_of_the_closed_form(tau: float, gain: float) -> None:
    """Above 1 nothing oscillates."""
    system = with_tau(tau, gain).system
    expected = 1.0 / (2.0 * np.sqrt(gain * system.largest_eigenvalue * tau))
    mode = least_damped(system, second_order(system))
    assert mode.damping == pytest.approx(expected, rel=1e-9)
    assert mode.oscillates == (expected < 1.0)


@pytest.mark.parametrize(("tau", "gain"), [(0.3, 5.0), (0.2, 2.0)])
def test_ideal_thrusters_ring_as_predicted(tau: float, gain: float) -> None:
    """Damping ratio and overshoot within 3%, as a hold of 2 ms is nearly none."""
    ringing = ringing_of(with_tau(tau, gain).system)
    assert ringing is not None
    (release,) = ringing.measured
    assert approx(release.damping_ratio, rel=0.03) == ringing.predicted_damping_ratio
    assert approx(release.frequency_rad_s, rel=0.03) == ringing.predicted_frequency_rad_s
    assert release.overshoot == pytest.approx(ringing.predicted_overshoot, rel=0.05)
    ratio = ringing.predicted_damping_ratio
    assert ringing.predicted_overshoot == pytest.approx(np.exp(-np.pi * ratio / np.sqrt(1.0 - ratio**2)), rel=1e-3)


def test_noise_and_losses_do_not_ring_and_delay_leaves_less_gain() -> None:
    """A decay is fitted to bodies alone. The law itself never oscillates up to k1 h lambda = d^d / (d + 1)^(d + 1)."""
    system = with_tau(0.3, 5.0).system
    perfect = ringing_of(system)
    boats: dict[str, Any] = {"vehicles": {"agents": "hull", "targets": "hull", "tau": 0.3}}
    boats |= {"physics": {"timestep": 0.002}, "controller": {"gain": 5.0, "control_period": 0.002}}
    noisy = ringing_of(
        two_boats("hull", "hull", links={"all": {"noise": 1.0, "bias": 1.0, "loss": 0.5}}, **boats).system
    )
    assert noisy == perfect
    late = two_boats("hull", "hull", links={"all": {"delay": 0.02}}, **boats).system
    ringing = ringing_of(late)
    assert perfect is not None
    assert ringing is not None
    assert ringing.delay_s == pytest.approx(0.02)
    damping = [found.measured[0].damping_ratio or np.nan for found in (ringing, perfect)]
    gains = [usable_gain(*pair) or np.nan for pair in ((late, ringing), (system, perfect))]
    assert damping[0] < 0.9 * damping[1]
    assert gains[0] < 0.9 * gains[1]
    quick = two_boats("hull", "hull", vehicles={"agents": "hull", "targets": "hull", "tau": 1e-4},
                      links={"all": {"delay": 0.02}}, controller=boats["controller"]).system  # fmt: skip
    lost = 10**10 / 11**11
    assert (usable_gain(quick, None) or np.nan) <= lost / (0.002 * quick.largest_eigenvalue) * (1 + 1e-12)
    # x+ = x - a x_10 oscillates only above this.
    for gain, swings in ((lost * 0.999, False), (lost * 1.3, True)):
        x = [1.0] * 11
        for _ in range(3000):
            x.append(x[-1] - gain * x[-11])
        assert (min(x) < 0.0) is swings


def test_the_newton_direction_rings_as_if_all_eigenvalues_were_one() -> None:
    """1 / (2 sqrt(k1 tau)); noise of odometry is left out, as all else is still."""
    fields = {"vehicles": {"agents": "hull", "targets": "hull", "tau": 0.3}, "physics": {"timestep": 0.002}}
    law = {"gain": 5.0, "control_period": 0.002, "newton": {"rounds": 10}, "drift": {}, "odometry": {"noise": 1.0}}
    system = two_boats("hull", "hull", controller=law, **fields).system
    ringing = ringing_of(system)
    assert ringing is not None
    assert ringing.predicted_damping_ratio == pytest.approx(1.0 / (2.0 * np.sqrt(5.0 * 0.3)), rel=1e-9)
    assert approx(ringing.measured[0].damping_ratio, rel=0.03) == ringing.predicted_damping_ratio
    usual = ringing_of(with_tau(0.3, 5.0).system)
    assert usual is not None
    assert usual.predicted_damping_ratio < 0.9 * ringing.predicted_damping_ratio


def test_overdamped_bodies_do_not_overshoot() -> None:
    ringing = ringing_of(with_tau(0.02, 1.0).system)
    assert ringing is not None
    assert ringing.overdamped
    assert ringing.predicted_damping_ratio > 1.0
    assert ringing.predicted_overshoot == 0.0
    assert ringing.measured[0].overshoot < 1e-3


@pytest.mark.parametrize("name", ["wamv", "otter", "hexarotor", "quadrotor"])
def test_real_vehicles_without_lag_ring_as_predicted(name: str) -> None:
    """Within 15% without lag and underactuation, and less damped with them, which the prediction does not know."""
    controller = {"gain": 1.0, "control_period": 0.02}
    afloat = name in ("wamv", "otter")
    scenario = two_boats(name, "hull", controller=controller) if afloat else two_aircraft(name, controller=controller)
    ringing = ringing_of(scenario.system)
    assert ringing is not None
    as_it_stands, ideal = ringing.measured[0], ringing.measured[-1]
    assert not ringing.overdamped
    assert as_it_stands.saturation == 0.0
    assert approx(ideal.damping_ratio, rel=0.15) == ringing.predicted_damping_ratio_held
    assert as_it_stands.damping_ratio is not None
    assert as_it_stands.damping_ratio < ringing.predicted_damping_ratio_held


def test_the_integral_is_off_while_ringing_is_measured() -> None:
    """The prediction does not know it."""
    controller = {"gain": 1.0, "control_period": 0.02}
    plain = ringing_of(two_boats("wamv", "hull", controller=controller).system)
    with_integral = {**controller, "integral": {"gain": 0.2}}
    assert ringing_of(two_boats("wamv", "hull", controller=with_integral).system) == plain


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
