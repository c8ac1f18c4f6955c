"""The linear model of the law, read off the compiled stages.

Oracle: terms added behind the compiled law. Its loops are held against runs in `test_oracle`, its responses to noise
against the law in plain numpy in `test_links`.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.arrays import Array
from mjsheaf.checking.loop import held_law, linear_law
from mjsheaf.checking.loop.held_law import closed, ideal_vehicle, law_loop, loop_of
from mjsheaf.checking.loop.linear_law import model_of
from mjsheaf.checking.loop.links import largest_delay
from mjsheaf.checking.theorem.certificate import certify
from mjsheaf.errors import UndecidedError
from mjsheaf.law.law import new_memory
from mjsheaf.loop.system import System
from mjsheaf.scenario import scenario_from_mapping
from tests.builders import known, random_scenario

TERMS: dict[str, Any] = {"newton": {"rounds": 2}, "drift": {"filter": 0.1}, "integral": {"gain": 0.2}}


def with_terms(names: tuple[str, ...]) -> System:
    """A team with different eigenvalues, so rounds leave different fractions of an error."""
    raw = random_scenario(3)
    raw["controller"] = {"gain": 0.8, "control_period": 0.02} | {name: TERMS[name] for name in names}
    raw["time"] = {"end": 2.0}
    return scenario_from_mapping(raw).system


@pytest.mark.parametrize("gain", [0.1, 0.5, 2.5])
@pytest.mark.parametrize("rounds", [5, 8, 13, 21])
def test_many_rounds_leave_rounding_and_no_other_loop(rounds: int, gain: float) -> None:
    """The residual of rounds is small compared to the terms that cancel: the loop has the unreduced law's factors."""
    both = {"controller.newton": {"rounds": rounds}, "controller.feedforward": {"rounds": rounds}}
    system = mjsheaf.load_scenario("swarm", {"swarm.size": 9, "controller.gain": gain, **both}).system
    loop = loop_of(system)
    whole = closed(ideal_vehicle(loop.period), loop.law.feedback(np.eye(loop.law.A.shape[1])).alike(1))
    assert loop.radius == pytest.approx(float(np.abs(np.linalg.eigvals(whole)).max()), abs=1e-11)


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
    """The law then remembers nothing, e+ = e - h k1 e(d periods ago), and its delay is decided all the same."""
    terms = {"controller.newton": {"rounds": 5}, "controller.drift": {}}
    loop = loop_of(mjsheaf.load_scenario("midpoint", terms).system)
    assert loop.feedback.A.shape[1:] == (0, 0)
    d = largest_delay(loop, np.ones(1, dtype=np.bool_), lambda delay: loop.radius_at(int(delay[0])))
    ends = [2.0 * np.sin(np.pi / (2.0 * (2.0 * periods + 1.0))) for periods in (known(d), known(d) + 1)]
    assert ends[0] > loop.gain * loop.period > ends[1]
