"""Dryden gusts: covariances against Van Loan's integral and the standards' formulas, samples against covariances."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm, solve_continuous_lyapunov

import mjsheaf
from mjsheaf.errors import InputError
from mjsheaf.media.gusts import FOOT, OUTPUT, Gusts, discretise
from mjsheaf.media.medium import moving_along
from mjsheaf.scenario import Scenario
from tests.builders import make_scenario, mixed_scenario, team_of

STEPS = [0.002, 0.02, 0.5]
DRIFT = [3.0, 4.0, 0.0]
FRAME = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
"""Along that wind, to its left, and up."""

FIXED = {"kind": "dryden", "wind_speed": 15.0, "altitude": 10.0}


def gusty(gusts: dict[str, Any], **fields: Any) -> Scenario:
    flow = {"air": {"dimension": 3, "drift": DRIFT, "gusts": {**FIXED, **gusts}}}
    return mixed_scenario(**{"time": {"end": 0.4}, "flow": flow, **fields})


def aloft(scenario: Scenario) -> list[str]:
    return [member.id for member in scenario.team.members if member.dimension == 3]


def covariance(rate: float, period: float, lags: int) -> np.ndarray:
    """Return the autocorrelation at multiples of a period that the discrete states have, shape (lags + 1,)."""
    transition, _ = discretise(rate, period)
    P = np.array([[1.0, 0.5], [0.5, 0.5]])
    return np.array([OUTPUT @ np.linalg.matrix_power(transition, k) @ P @ OUTPUT for k in range(lags + 1)])


@pytest.mark.parametrize("period", STEPS)
@pytest.mark.parametrize("rate", [0.02, 0.2, 5.0])
def test_the_discrete_states_are_those_of_van_loan_and_lyapunov(rate: float, period: float) -> None:
    A = rate * np.array([[-1.0, 0.0], [1.0, -1.0]])
    noise = np.diag([2.0 * rate, 0.0])
    transition, factor = discretise(rate, period)
    exponential = expm(period * np.block([[-A, noise], [np.zeros((2, 2)), A.T]]))
    exact = exponential[2:, 2:].T
    added = exact @ exponential[:2, 2:]
    P = solve_continuous_lyapunov(A, -noise)
    assert np.allclose(transition, exact, rtol=1e-11, atol=1e-14)
    assert np.allclose(factor @ factor.T, added, rtol=1e-10, atol=1e-14)
    assert np.allclose(transition @ P @ transition.T + factor @ factor.T, P, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("period", [0.01, 0.05, 1.0])
def test_the_vertical_gust_has_its_published_correlations_at_any_step(period: float) -> None:
    times = np.array([0.01, 1.0, 5.0])
    k = np.round(times / period).astype(int)
    found = covariance(0.2, period, int(k.max()))
    published = np.array([0.9970039967, 0.7368576778, 0.1839397206])
    assert found[0] == pytest.approx(1.0, abs=1e-14)
    on_grid = np.isclose(k * period, times)
    assert on_grid.any()
    assert np.allclose(found[k[on_grid]], published[on_grid], rtol=0.0, atol=1e-10)


def test_intensities_and_lengths_are_those_of_the_standards() -> None:
    for knots, sigma in ((15.0, 0.771667), (30.0, 1.543333), (45.0, 2.315)):
        gusts = Gusts(kind="dryden", wind_speed=knots * 1852.0 / 3600.0)
        for altitude, length, ratio in ((10.0, 67.366, 1.88863), (50.0, 202.2896, 1.593436)):
            sizes, lengths = gusts.intensities(altitude), gusts.decay_lengths(altitude)
            assert sizes[2] == pytest.approx(sigma, abs=1e-6)
            assert sizes[:2] / sizes[2] == pytest.approx(ratio, abs=1e-5)
            assert lengths == pytest.approx([length, length, altitude], abs=1e-3)


def printed_spectrum(standard: str, component: int, slip: float, rate: float) -> float:
    """Return the spectrum over positive frequencies in rad/s as a standard prints it, with L / V, at sigma = 1, s."""
    s2 = (slip * rate) ** 2
    if component == 0:
        return 2.0 * slip / np.pi / (1.0 + s2)
    if standard == "MIL-F-8785C":
        return slip / np.pi * (1.0 + 3.0 * s2) / (1.0 + s2) ** 2
    return 2.0 * slip / np.pi * (1.0 + 12.0 * s2) / (1.0 + 4.0 * s2) ** 2


@pytest.mark.parametrize("standard", ["MIL-F-8785C", "MIL-HDBK-1797"])
def test_autocorrelations_are_the_transforms_of_the_printed_spectra(standard: str) -> None:
    """Lengths and spectra are typed in from the standards, h in ft, and integrated numerically."""
    altitude, period, speed = 30.0, 0.25, 5.0
    feet = altitude / 0.3048
    length = 0.3048 * feet / (0.177 + 0.000823 * feet) ** 1.2
    lengths = [length, length, altitude] if standard == "MIL-F-8785C" else [length, 0.5 * length, 0.5 * altitude]
    model = Gusts.model_validate({**FIXED, "standard": standard})
    rates = speed / model.decay_lengths(altitude)
    for k in range(3):
        lags = np.exp(-rates[0] * period * np.arange(21)) if k == 0 else covariance(rates[k], period, 20)
        for lag in (0, 1, 4, 20):
            options = {"weight": "cos", "wvar": lag * period} if lag else {}
            shape = partial(printed_spectrum, standard, k, lengths[k] / speed)
            assert lags[lag] == pytest.approx(quad(shape, 0.0, np.inf, **options)[0], abs=1e-7)


@pytest.mark.parametrize("altitude", [10.0 * FOOT, 1000.0 * FOOT])
def test_altitudes_of_the_model_are_accepted_and_others_refused(altitude: float) -> None:
    assert Gusts(kind="dryden", wind_speed=10.0, altitude=altitude).altitude_of(99.0) == altitude
    with pytest.raises(InputError, match=r"flow\.air\.gusts\.altitude.*3\.048 to 304\.8"):
        gusty({"altitude": altitude + (-0.01 if altitude < 100.0 else 0.01)})


@pytest.mark.parametrize("period", STEPS)
@pytest.mark.parametrize("standard", ["MIL-F-8785C", "MIL-HDBK-1797"])
def test_long_runs_have_the_variance_and_the_correlations_of_theory(period: float, standard: str) -> None:
    gusts = {"standard": standard, "altitude": 3.048}
    time = {"end": 2.0}
    scenario = gusty(gusts, time=time, controller={"gain": 1.0, "control_period": period}, physics={"timestep": period})
    name = aloft(scenario)[0]
    count = min(400_000, int(20_000.0 / period))
    times = period * np.arange(count)
    velocity = mjsheaf.medium(scenario).velocity(name, times, [0.0, 0.0, 5.0]) - DRIFT
    parts = velocity @ FRAME.T
    model = Gusts.model_validate({**FIXED, **gusts})
    sigma, lengths = model.intensities(3.048), model.decay_lengths(3.048)
    for k, length in enumerate(lengths):
        for lag in (0.0, 0.5 * length / 5.0, 2.0 * length / 5.0):
            steps = round(lag / period)
            slip = steps * period * 5.0 / length
            theory = np.exp(-slip) * (1.0 - 0.5 * slip * (k > 0))
            found = np.mean(parts[: count - steps, k] * parts[steps:, k]) / sigma[k] ** 2
            # The variance of an estimate of R over a time T is 2 / T of the integral of R^2, L / V for u at most.
            error = np.sqrt(2.0 * length / 5.0 / (count * period))
            assert abs(found - theory) < 5.0 * error


def test_gusts_are_stationary_from_the_first_sample() -> None:
    """Over 300 vehicles, whose gusts are independent."""
    agents = {f"A{k}": [0.0, 0.0, 10.0] for k in range(300)}
    air = {"dimension": 3, "drift": DRIFT, "gusts": FIXED}
    system = make_scenario(team_of(agents, {"T": [0, 0, 9]}, "A0 T", flow={"air": air})).system
    first = moving_along(system.medium, np.zeros(1), system.initial[None])[0, :300] - DRIFT
    sigma = Gusts.model_validate(FIXED).intensities(10.0)
    assert np.std(first @ FRAME.T, axis=0) == pytest.approx(sigma, rel=5.0 / np.sqrt(600.0))


def test_vehicles_meet_independent_gusts_that_no_other_vehicle_changes() -> None:
    scenario = gusty({})
    one, other = aloft(scenario)[:2]
    times = 0.1 * np.arange(40_000)
    of = {id: mjsheaf.medium(scenario).velocity(id, times, [0.0, 0.0, 10.0]) for id in (one, other)}
    assert abs(np.corrcoef(of[one][:, 2], of[other][:, 2])[0, 1]) < 0.1
    raw = scenario.model_dump(mode="json", exclude_none=True)
    raw["agents"] = raw["agents"][::-1]
    turned = mjsheaf.medium(Scenario.model_validate(raw))
    for id in (one, other):
        assert np.array_equal(turned.velocity(id, times, [0.0, 0.0, 10.0]), of[id])
    again = mjsheaf.medium(gusty({}, seed=7)).velocity(one, times, [0.0, 0.0, 10.0])
    assert abs(np.corrcoef(again[:, 0], of[one][:, 0])[0, 1]) < 0.3
    assert np.array_equal(mjsheaf.medium(scenario).velocity(one, times[5:50], [0.0, 0.0, 10.0]), of[one][5:50])


@pytest.mark.long
@pytest.mark.parametrize("standard", ["MIL-F-8785C", "MIL-HDBK-1797"])
def test_a_frozen_field_has_the_correlations_of_theory_along_the_wind(standard: str) -> None:
    model = Gusts.model_validate({**FIXED, "standard": standard, "altitude": 3.048})
    sigma, lengths = model.intensities(3.048), model.decay_lengths(3.048)
    period, count = 0.5, 12_000
    gusts = {"standard": standard, "altitude": 3.048, "frozen": True}
    scenario = gusty(gusts, time={"end": 0.5}, controller={"gain": 1.0, "control_period": period})
    probe, name, other = mjsheaf.medium(scenario), *aloft(scenario)[:2]
    times = period * np.arange(count)
    here = (probe.velocity(name, times, [0.0, 0.0, 10.0]) - DRIFT) @ FRAME.T
    assert here.std(axis=0) == pytest.approx(sigma, rel=0.08)
    assert np.array_equal(probe.velocity(other, times[:9], [-8.0, 6.0, 10.0])[0], FRAME.T @ here[0] + DRIFT)
    for distance in (0.2, 1.0, 4.0):
        there = (probe.velocity(other, times, distance * FRAME[0]) - DRIFT) @ FRAME.T
        slip = distance / lengths
        theory = np.exp(-slip) * (1.0 - np.array([0.0, 0.5, 0.5]) * slip)
        # The mean square of the difference, whose error is small where the correlation is close to 1.
        expected = 2.0 * sigma**2 * (1.0 - theory)
        assert np.mean((there - here) ** 2, axis=0) == pytest.approx(expected, rel=0.15)


def test_a_frozen_field_that_is_too_long_is_refused() -> None:
    with pytest.raises(InputError, match=r"flow: wind: gusts: frozen: .*nodes.*expected at most"):
        gusty({"frozen": True}, time={"end": 4e5})
