"""The linear model of the law, read off the compiled stages, against its dynamics derived by hand.

Oracles: its recursions (`DerivedLaw`); terms added behind the compiled law. Its loops with vehicles, and with delays,
are held against runs in `test_oracle`.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter, ss2tf

import mjsheaf
from mjsheaf.arrays import Array
from mjsheaf.checking.loop import held_law, linear_law
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
from mjsheaf.law.terms import TermArrays
from mjsheaf.loop.system import System
from mjsheaf.scenario import scenario_from_mapping
from tests.builders import known, random_scenario

TERMS: dict[str, dict[str, Any]] = {
    "feedforward": {"rounds": 2, "filter": 0.02, "extrapolate": True},
    "newton": {"rounds": 2},
    "drift": {"filter": 0.1},
    "integral": {"gain": 0.2},
}
LAWS = [chosen for size in range(5) for chosen in itertools.combinations(TERMS, size)]


@dataclass(frozen=True)
class DerivedLaw:
    """The law by its formulas, for eigenvalues of H (L,), a gain, 1/s, a period, s, and a delay in periods.

    With e = q* - q in an eigenvector of H of eigenvalue lambda, and measurements d periods old,

        s_k = alpha (e_{k-d} - n_k / lambda) + c s_{k-1}
        z_{k+1} = z_k - h lambda e_{k-d} + h n_k
        e_{k+1} = e_k - h (k1 s_k - k_I z_k + v_k + lead (v_k - v_{k-1}) - phi_k),

    where n is the noise of eta, and v and phi are the responses of feedforward and observer to noise alone. With newton
    c = T_r(..), as its rounds contract, and alpha = 1 - c; without it alpha = lambda and c = 0.
    """

    terms: TermArrays
    values: Array
    gain: float
    period: float
    delay: int = 0

    @cached_property
    def c(self) -> Array:
        """Fraction of an error that remains after newton's rounds, shape (L,)."""
        rounds = self.terms.newton
        if not rounds:
            return np.zeros_like(self.values)
        return residual_polynomial(self.values, rounds, *self.terms.eigenvalues)

    @cached_property
    def alpha(self) -> Array:
        """Coefficient of an error in s, shape (L,)."""
        return 1.0 - self.c if self.terms.newton else self.values

    @property
    def names(self) -> list[str]:
        """The states, those of the loop itself first."""
        d, terms = self.delay, self.terms
        names = [f"e{j}" for j in range(d + 1)] + ["s"] * (terms.newton > 0) + ["z"] * (terms.integral > 0.0)
        if terms.feedforward:
            names += ["rate", "v", "sensed", *(f"odometry{j}" for j in range(1, d + 1))]
        return names + ["drift"] * (terms.drift > 0.0)

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array]:
        """M and G of x+ = M x + G u, and rows that give the command of x and u: (L, n, n), (L, n, 4), (L, n + 4)."""
        terms, d, values, names, h = self.terms, self.delay, self.values, self.names, self.period
        n, L = len(names), len(values)

        def unit(name: str) -> Array:
            row = np.zeros((L, n + 4))
            if name in names:
                row[:, names.index(name)] = 1.0
            return row

        def given(i: int) -> Array:
            row = np.zeros((L, n + 4))
            row[:, n + i] = 1.0
            return row

        eta = -values[:, None] * unit(f"e{d}") + given(0)
        s = (-self.alpha / values)[:, None] * eta + self.c[:, None] * unit("s")
        command = self.gain * s - terms.integral * unit("z")
        new = {"s": s, "z": unit("z") + h * eta}
        if terms.feedforward:
            c, lead = residual_polynomial(values, terms.feedforward, *terms.eigenvalues), float(terms.lead[0])
            moved = unit(f"odometry{d}") if d else given(2)
            rate = unit("rate") + terms.measured * ((given(1) - unit("sensed") + moved) / h - unit("rate"))
            v = c[:, None] * unit("v") + ((1.0 - c) / values)[:, None] * rate
            command = command + v + lead * (v - unit("v"))
            new |= {"rate": rate, "v": v, "sensed": given(1), "odometry1": given(2)}
            new |= {f"odometry{j}": unit(f"odometry{j - 1}") for j in range(2, d + 1)}
        if terms.drift > 0.0:
            new["drift"] = unit("drift") + terms.drift * (given(3) / h - unit("drift"))
            command = command - new["drift"]
        new |= {"e0": unit("e0") - h * command} | {f"e{j}": unit(f"e{j - 1}") for j in range(1, d + 1)}
        rows = np.stack([new[name] for name in names], axis=1)
        return rows[..., :n], rows[..., n:], command

    @property
    def own(self) -> Array:
        """Matrices of the loop itself, shape (L, n, n)."""
        n = self.delay + 1 + (self.terms.newton > 0) + (self.terms.integral > 0.0)
        return self.matrices[0][:, :n, :n]

    def answered(self, one: int, added: Array) -> Array:
        """The command of one eigenvalue where `added` (n,) is added to it, and feedback answers."""
        push = np.zeros((len(self.own[one]), 1))
        push[0] = -self.period
        ask = self.matrices[2][one, : len(push)]
        above, below = ss2tf(self.own[one], push, ask[None], [[1.0]])
        return np.asarray(lfilter(above[0], below, added))


def with_terms(names: tuple[str, ...]) -> System:
    """A team with different eigenvalues, so rounds leave different fractions of an error."""
    raw = random_scenario(3)
    raw["controller"] = {"gain": 0.8, "control_period": 0.02} | {name: TERMS[name] for name in names}
    raw["time"] = {"end": 2.0}
    return scenario_from_mapping(raw).system


def derived(system: System, loop: Loop, delay: int = 0) -> DerivedLaw:
    return DerivedLaw(system.law.terms, loop.values, loop.gain, loop.period, delay)


# The first is the one that continuous integration tries: all terms, the longest delay.
@pytest.mark.slow(first=True)
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
    for module in (linear_law, held_law):  # models of the law without it are remembered
        monkeypatch.setattr(module, "model_of", vars(model_of)["__wrapped__"])


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
        linear_law.model_of(system.law, 0.01)
    record = law_loop(system, certify(system))
    assert record.unmodelled == ["term drift"]
    assert record.stable is None
    assert "because of term drift" in record.reason


def test_one_eigenvalue_that_rounds_meet_exactly() -> None:
    """The law then remembers nothing, and its delay is decided all the same."""
    system = mjsheaf.load_scenario("midpoint", {"controller.newton": {"rounds": 5}, "controller.drift": {}}).system
    loop = loop_of(system)
    assert loop.feedback.A.shape[1:] == (0, 0)
    assert found_limit(loop) == derived_limit(system, loop)


@pytest.mark.parametrize("names", [(), ("newton",), ("integral",), ("newton", "integral")])
def test_the_largest_delay_is_that_of_the_loop_derived_by_hand(names: tuple[str, ...]) -> None:
    terms = {"newton": {"rounds": 2}, "integral": {"gain": 0.2}}
    changes = {f"controller.{name}": terms[name] for name in names}
    for gain in (1.5, 4.0):
        system = mjsheaf.load_scenario("midpoint", {**changes, "controller.gain": gain}).system
        loop = loop_of(system)
        assert found_limit(loop) == derived_limit(system, loop) > 0


def found_limit(loop: Loop) -> int | None:
    """Return the largest delay of all measurements, in periods."""
    return largest_delay(loop, np.ones(1, dtype=np.bool_), lambda delay: loop.radius_at(int(delay[0])))


def derived_limit(system: System, loop: Loop) -> int:
    """Oracle: the largest delay up to which the spectral radius of the loop derived by hand is below 1."""
    return next(d for d in range(1, 200) if np.abs(np.linalg.eigvals(derived(system, loop, d).own)).max() >= 1.0) - 1
