"""The linear model of the law, read off the compiled stages, against its dynamics derived by hand.

Oracles: the recursions of e = q* - q in `held_law` and `delay`; terms added behind the compiled law.
"""

from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.arrays import Array
from mjsheaf.checking.loop.delay import DelayedLoop
from mjsheaf.checking.loop.held_law import loop_of
from mjsheaf.checking.loop.modelled import UndecidedError
from mjsheaf.control.law import new_memory
from mjsheaf.scenario import scenario_from_mapping
from mjsheaf.system import System
from tests.builders import random_scenario
from tests.checking import linear_law
from tests.checking.linear_law import linearise_law

TERMS: dict[str, dict[str, Any]] = {
    "feedforward": {"rounds": 2, "filter": 0.02, "extrapolate": True},
    "newton": {"rounds": 2},
    "drift": {"filter": 0.1},
    "integral": {"gain": 0.2},
}
LAWS = [chosen for size in (0, 1, 2, 4) for chosen in combinations(TERMS, size)]


def with_terms(names: tuple[str, ...]) -> System:
    fields: dict[str, Any] = {f"controller.{name}": None for name in TERMS}
    fields |= {f"controller.{name}": TERMS[name] for name in names}
    return mjsheaf.load_scenario("midpoint", fields).system


@pytest.mark.parametrize("delay", range(6))
@pytest.mark.parametrize("names", LAWS, ids="+".join)
def test_running_the_law_gives_the_loop_derived_by_hand(names: tuple[str, ...], delay: int) -> None:
    system = with_terms(names)
    loop = loop_of(system)
    by_hand = DelayedLoop(loop, system.law.terms, delay)
    law = linearise_law(system.law, system.gain, loop.values, loop.period, delay)
    power = np.zeros((len(loop.values), by_hand.own.shape[1], 1))
    power[:, 0] = 1.0  # e_0; nothing is measured before the start
    expected = np.zeros((len(loop.values), 80))
    for k in range(80):
        expected[:, k] = power[:, 0, 0]
        power = by_hand.own @ power
    np.testing.assert_allclose(law.responses(80), expected, rtol=0.0, atol=1e-10)
    radii = np.abs(np.linalg.eigvals(by_hand.own)).max(axis=1)
    np.testing.assert_allclose(law.radii, radii, rtol=0.0, atol=1e-10)


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
    law = linearise_law(system.law, system.gain, loop.values, period)
    radii = np.abs(np.linalg.eigvals(loop.matrices())).max(axis=1)
    np.testing.assert_allclose(law.radii, radii, rtol=1e-10)


def with_term(monkeypatch: pytest.MonkeyPatch, term: Callable[[Array], Array]) -> None:
    """Let the compiled law end with one more term, a function of eta."""
    compiled = linear_law._answer

    def answer(control: Any, t: float, starts: Array, positions: Array, *rest: Any) -> None:
        compiled(control, t, starts, positions, *rest)
        ends, commands = rest[-2:]
        memory = new_memory(control.law, 2)
        for k in range(len(ends)):
            memory.flat[:] = ends[k]
            commands[k] += term(memory.residual[0, :1])[0]
            memory.command[0, 0] = commands[k]
            ends[k] = memory.flat

    monkeypatch.setattr(linear_law, "_answer", answer)


@pytest.mark.parametrize("names", [(), ("newton", "integral")], ids="+".join)
def test_a_new_linear_term_is_in_the_model(names: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """The paper's law with 0.7 eta more is the paper's law at a gain larger by 0.7."""
    system = with_terms(names)
    values = loop_of(system).values
    period = system.grid.period
    before = linearise_law(system.law, system.gain, values, period)
    with_term(monkeypatch, lambda eta: -0.7 * eta)
    after = linearise_law(system.law, system.gain, values, period)
    np.testing.assert_allclose(after.d - before.d, -0.7 * values, rtol=1e-12)
    assert not np.allclose(after.radii, before.radii, rtol=1e-6)
    if not names:
        np.testing.assert_allclose(after.radii, np.abs(1.0 - period * (system.gain + 0.7) * values), rtol=1e-12)


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
    system = with_terms(())
    with_term(monkeypatch, term)
    with pytest.raises(UndecidedError, match="not linear"):
        linearise_law(system.law, system.gain, np.array([0.4, 1.7]), 0.01)
