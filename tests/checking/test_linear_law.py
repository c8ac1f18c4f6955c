"""The linear model of the law, read off the compiled stages, against its dynamics derived by hand.

Oracles: the recursions in `derived_law`; terms added behind the compiled law. Its loops with vehicles, and with delays,
are held against runs in `test_oracle`.
"""

from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebroots
from scipy.signal import lfilter

import mjsheaf
from mjsheaf.arrays import Array
from mjsheaf.checking.loop import linear_law
from mjsheaf.checking.loop.held_law import (
    Loop,
    _carried_odometry,
    _noise,
    closed,
    ideal_vehicle,
    law_loop,
    loop_of,
    residual_polynomial,
)
from mjsheaf.checking.loop.linear_law import model_of
from mjsheaf.checking.loop.links import largest_delay
from mjsheaf.checking.theorem.certificate import certify
from mjsheaf.errors import UndecidedError
from mjsheaf.law.law import new_memory
from mjsheaf.loop.system import System
from mjsheaf.scenario import scenario_from_mapping
from tests.builders import known, random_scenario
from tests.checking.derived_law import DerivedLaw

TERMS: dict[str, dict[str, Any]] = {
    "feedforward": {"rounds": 2, "filter": 0.02, "extrapolate": True},
    "newton": {"rounds": 2},
    "drift": {"filter": 0.1},
    "integral": {"gain": 0.2},
}
LAWS = [chosen for size in range(5) for chosen in combinations(TERMS, size)]


def with_terms(names: tuple[str, ...]) -> System:
    """A team with different eigenvalues, so rounds leave different fractions of an error."""
    raw = random_scenario(3)
    raw["controller"] = {"gain": 0.8, "control_period": 0.02} | {name: TERMS[name] for name in names}
    raw["time"] = {"end": 2.0}
    return scenario_from_mapping(raw).system


def derived(system: System, loop: Loop, delay: int = 0) -> DerivedLaw:
    return DerivedLaw(system.law.terms, loop.values, loop.gain, loop.period, delay)


# The first is the one that continuous integration tries: all terms, the longest delay.
@pytest.mark.slow
@pytest.mark.parametrize("delay", range(5, -1, -1))
@pytest.mark.parametrize("names", LAWS[::-1], ids="+".join)
def test_running_the_law_gives_the_loop_derived_by_hand(names: tuple[str, ...], delay: int) -> None:
    """Responses of error and command to a start and to noise in every input, and the radius of the loop."""
    system = with_terms(names)
    loop = loop_of(system)
    by_hand = derived(system, loop, delay)
    matrices = loop.with_noise(delay)
    radius = np.abs(np.linalg.eigvals(by_hand.own)).max()
    assert loop.radius_at(delay) == pytest.approx(radius, abs=1e-10)
    L = len(loop.values)
    found = {}
    for which, (M, G, command), sign in (("by hand", by_hand.matrices, -1.0), ("read", matrices, 1.0)):  # of e = -q
        n = M.shape[1]
        x = np.concatenate([sign * G, np.zeros((L, n, 1))], axis=2)
        x[:, 0, 4] = sign
        responses = np.zeros((60, 2, L, 5))
        for k in range(60):
            responses[k] = x[:, 0], np.einsum("li,lij->lj", command[:, :n], x)
            x = M @ x
        found[which] = np.abs(responses)
    np.testing.assert_allclose(found["read"], found["by hand"], rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("gain", [0.1, 0.5, 2.5])
@pytest.mark.parametrize("rounds", [5, 8, 13, 21])
def test_many_rounds_leave_rounding_and_no_other_loop(rounds: int, gain: float) -> None:
    """The residual of rounds is small compared to the terms that cancel: the loop has the unreduced law's factors."""
    both = {"controller.newton": {"rounds": rounds}, "controller.feedforward": {"rounds": rounds}}
    system = mjsheaf.load_scenario("swarm", {"swarm.size": 9, "controller.gain": gain, **both}).system
    loop = loop_of(system)
    whole = closed(ideal_vehicle(loop.period), loop.law.feedback(np.eye(loop.law.A.shape[1])).alike(1))
    assert loop.radius == pytest.approx(float(np.abs(np.linalg.eigvals(whole)).max()), abs=1e-11)
    by_hand = derived(system, loop).own
    assert loop.radius == pytest.approx(float(np.abs(np.linalg.eigvals(by_hand)).max()), abs=1e-10)


@pytest.mark.parametrize("seed", range(12))
def test_random_teams_gains_and_periods(seed: int) -> None:
    rng = np.random.default_rng([seed, 29])
    raw = random_scenario(seed)
    names = [name for name in TERMS if rng.random() < 0.5]
    period = float(rng.choice([0.002, 0.01, 0.05, 0.2]))
    raw["controller"] = {"gain": float(rng.uniform(0.1, 5.0)), "control_period": period}
    raw["controller"] |= {name: TERMS[name] for name in names}
    raw["time"] = {"end": 2.0}
    system = scenario_from_mapping(raw).system
    loop = loop_of(system)
    by_hand = derived(system, loop)
    radii = np.abs(np.linalg.eigvals(by_hand.own)).max(axis=1)
    np.testing.assert_allclose(np.abs(np.linalg.eigvals(loop.matrices())).max(axis=1), radii, rtol=1e-10)
    start = np.zeros((len(loop.values), 1 + len(by_hand.own[0]) - 1))
    start[:, 0] = 1.0
    decay = loop.responses(50)[0]
    for k in range(50):
        assert decay[k] == pytest.approx(np.abs(start[:, 0]).max(), rel=2e-9, abs=1e-12)
        start = np.einsum("lij,lj->li", by_hand.own, start)


@pytest.mark.parametrize("names", LAWS, ids="+".join)
def test_gains_between_which_the_loop_is_stable(names: tuple[str, ...]) -> None:
    """At the ends of the interval the spectral radius of the matrices derived by hand is 1."""
    system = with_terms(names)
    loop = loop_of(system)
    low, high = known(loop.stable_gains)
    for gain in (low, high):
        if gain > 0.0:
            at_end = DerivedLaw(system.law.terms, loop.values, gain, loop.period)
            assert np.abs(np.linalg.eigvals(at_end.own)).max() == pytest.approx(1.0, abs=1e-6)
    for gain in (1.01 * low + 1e-6, 0.99 * high):
        inside = DerivedLaw(system.law.terms, loop.values, gain, loop.period)
        assert np.abs(np.linalg.eigvals(inside.own)).max() < 1.0


@pytest.mark.parametrize("names", LAWS, ids="+".join)
def test_noise_of_the_command(names: tuple[str, ...]) -> None:
    """By impulse responses of the filters, rounds and feedback derived by hand."""
    system = with_terms(names)
    loop = loop_of(system)
    terms = system.law.terms
    by_hand = derived(system, loop)
    impulse = np.zeros(20_000)
    impulse[0] = 1.0
    expected = 0.0
    if terms.feedforward:
        rate = lfilter([terms.measured], [1.0, terms.measured - 1.0], impulse)
        lead = float(terms.lead[0])
        c = residual_polynomial(loop.values, terms.feedforward, *terms.eigenvalues)
        v = [lfilter([(1.0 - kept) * (1.0 + lead), -(1.0 - kept) * lead], [1.0, -kept], rate) for kept in c]
        largest = max(float(np.linalg.norm(by_hand.answered(one, v[one]))) for one in range(len(v)))
        expected += largest * _carried_odometry(system) / terms.period
    if terms.drift > 0.0:
        phi = lfilter([terms.drift], [1.0, terms.drift - 1.0], impulse)
        each = range(len(loop.values))
        expected += max(float(np.linalg.norm(by_hand.answered(one, phi))) for one in each) / terms.period
    assert _noise(system, loop) == pytest.approx(expected, rel=1e-8, abs=1e-14)


def with_term(monkeypatch: pytest.MonkeyPatch, term: Callable[[Array], Array]) -> None:
    """Let the compiled law end with one more term, a function of eta."""
    compiled = linear_law._answer

    def answer(control: Any, t: float, start: Array, cells: Array, size: float, points: Array, *rest: Any) -> None:
        compiled(control, t, start, cells, size, points, *rest)
        ends, commands = rest[-2:]
        memory = new_memory(control.law, 3)
        for one in np.ndindex(*commands.shape[:2]):
            memory.flat[:] = ends[one]
            commands[one] += term(memory.residual[0])
            memory.command[0] = commands[one]
            ends[one] = memory.flat

    monkeypatch.setattr(linear_law, "_answer", answer)
    monkeypatch.setattr(linear_law, "_models", {})


@pytest.mark.parametrize("names", [("drift",), ("newton", "integral")], ids="+".join)
def test_a_new_linear_term_is_in_all_that_check_says(names: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """The paper's law with 0.7 eta more is the paper's law at a gain larger by 0.7."""
    system = with_terms(names)
    before = loop_of(system)
    plain = before.matrices()
    share = before.law.D[:, 0]
    record = law_loop(system, certify(system))
    with_term(monkeypatch, lambda eta: -0.7 * eta)
    after = loop_of(system)
    np.testing.assert_allclose(after.law.D[:, 0] - share, -0.7 * before.values, rtol=1e-12)
    assert not np.allclose(after.matrices(), plain, rtol=1e-6)
    changed = law_loop(system, certify(system))
    assert changed.spectral_radius != record.spectral_radius
    if names == ("drift",):
        assert changed.largest_gain == pytest.approx(known(record.largest_gain) - 0.7, rel=1e-9)
        radius = np.abs(1.0 - before.period * (before.gain + 0.7) * before.values).max()
        assert changed.spectral_radius == pytest.approx(radius, rel=1e-12)


@pytest.mark.parametrize(
    "term",
    [
        lambda eta: -30.0 * eta / (np.abs(eta) + 1e-3),
        np.abs,
        lambda eta: np.sign(eta) * eta**2,
        np.sign,
        lambda eta: np.where(np.abs(eta) > 1e-8, -eta, 0.0),
    ],
    ids=["bounded", "abs", "square", "sign", "dead zone"],
)
def test_a_law_that_is_not_linear_is_undecided(term: Callable[[Array], Array], monkeypatch: pytest.MonkeyPatch) -> None:
    """A push -k eta / (abs(eta) + w) of slope 30,000 1/s was once certified as if it were not there."""
    system = with_terms(("drift",))
    with_term(monkeypatch, term)
    with pytest.raises(UndecidedError, match="not linear"):
        model_of(system.law, 0.01)
    record = law_loop(system, certify(system))
    assert record.unmodelled == ["term drift"]
    assert record.stable is None
    assert "because of term drift" in record.reason


def test_one_eigenvalue_that_rounds_meet_exactly() -> None:
    """The law then remembers nothing, and its delay is decided all the same."""
    system = mjsheaf.load_scenario("midpoint", {"controller.newton": {"rounds": 5}, "controller.drift": {}}).system
    loop = loop_of(system)
    assert loop.feedback.A.shape[1:] == (0, 0)
    assert nyquist_limit(loop) == scanned_limit(loop)


@pytest.mark.parametrize("names", [(), ("newton",), ("integral",), ("newton", "integral")])
def test_the_largest_delay_is_that_of_nyquists_count(names: tuple[str, ...]) -> None:
    terms = {"newton": {"rounds": 2}, "integral": {"gain": 0.2}}
    changes = {f"controller.{name}": terms[name] for name in names}
    for gain in (1.5, 4.0):
        loop = loop_of(mjsheaf.load_scenario("midpoint", {**changes, "controller.gain": gain}).system)
        assert nyquist_limit(loop) == scanned_limit(loop)
        assert nyquist_limit(loop) > 0


def scanned_limit(loop: Loop) -> int | None:
    """Return the largest delay of all measurements, in periods."""
    return largest_delay(loop, np.ones(1, dtype=np.bool_), lambda delay: loop.radius_at(int(delay[0])))


def nyquist_limit(loop: Loop) -> int:
    """Oracle: the largest delay of loops 1 + L(z) z^-d, each with a single frequency at which |L| = 1.

    L is the loop without delay; its poles lie on z = 1 or inside the unit circle. If |L| = 1 at theta alone, the loop
    is stable up to d theta = pi + arg L there, and unstable beyond.
    """
    limits = []
    feedback = loop.feedback
    for A, b, c, d in zip(feedback.A, feedback.B[:, :, 0], feedback.C, feedback.D[:, 0], strict=True):
        below = np.atleast_1d(np.poly(np.linalg.eigvals(A)))  # of L, powers of z descending
        # c adj(z - A) b = det(z - A + b c) - det(z - A)
        closed = np.atleast_1d(np.poly(np.linalg.eigvals(A - np.outer(b, c))))
        above = np.append(0.0, -loop.period * (closed + (d - 1.0) * below))
        below = np.convolve(below, [1.0, -1.0])
        square = [np.correlate(p, p, "full")[len(p) - 1 :] for p in (below, above)]
        series = (square[0] - square[1]) * np.append(1.0, np.full(len(below) - 1, 2.0))
        roots = chebroots(np.trim_zeros(series, "b"))
        (cosine,) = roots[(np.abs(roots.imag) < 1e-9) & (np.abs(roots.real) < 1.0)].real
        theta = np.arccos(cosine)
        z = np.exp(1j * theta)
        L = np.polyval(above, z) / np.polyval(below, z)
        limits.append(((np.angle(L) + np.pi) % (2.0 * np.pi)) / theta)
    return int(np.ceil(min(limits) - 1e-9)) - 1
