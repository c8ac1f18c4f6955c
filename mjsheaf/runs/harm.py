"""Where the law's terms do harm in a run: commands that jump, agents at their velocity limit, saturated thrusters.

A smooth command has hardly a second difference from sample to sample. White noise of deviation s has one of sqrt(6) s,
by which the jump of a run is measured, as RMS over agents and the last half of the run. Measurements are commands as
they were executed, limited: jumps that a limit cuts off are larger than they look.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mjsheaf.control.terms import TermArrays
from mjsheaf.results.dataset import of_phase
from mjsheaf.results.netcdf import pieces_of
from mjsheaf.simulation.trajectory import largest_integral
from mjsheaf.system import Phase, System

if TYPE_CHECKING:
    import xarray as xr

_LARGEST_JUMP = 0.1  # of the RMS commanded speed of the whole run
_SMALLEST_JUMP = 1e-6  # m/s: below it is rounding
_LARGEST_SHARE = 0.2  # of time and agents at the velocity limit, or of time and thrusters at a limit
_TOLD_SHARE = 0.01  # of the same, below which a sentence about jumps leaves it out
_ACCOMPLICE = 0.3  # of the largest noise, from which on another term is to blame too
_FEWEST_SAMPLES = 8
_AT_LIMIT = 1.0 - 1e-9  # of the limit


@dataclass(frozen=True)
class TermsInRun:
    """The terms of a law, as their run shows them over its last half.

    Attributes:
        on: names of the terms.
        jump: of the command from sample to sample, as of white noise, RMS, m/s.
        commanded: speed, RMS over the whole run, m/s.
        at_limit: share of samples and agents at the velocity limit.
        saturated: share of time and thrusters of agents at a limit; None on ideal kinematics.
        harm: sentences: what is wrong, by which term, and what to change; empty in a healthy run.
    """

    on: tuple[str, ...]
    jump: float
    commanded: float
    at_limit: float
    saturated: float | None
    harm: tuple[str, ...] = ()

    def record(self) -> dict[str, Any]:
        """What summary.json says of it."""
        return {
            "on": list(self.on),
            "jump_m_s": self.jump,
            "commanded_m_s": self.commanded,
            "share_at_limit": self.at_limit,
            "share_saturated": self.saturated,
            "harm": list(self.harm),
        }


def examine_terms(run: System | Sequence[Phase], dataset: "xr.Dataset") -> TermsInRun | None:
    """Look for harm of the terms in a run, of one with events in the last phase; it is read in pieces.

    Args:
        run: what was run.
        dataset: as `simulate` gives it.

    Returns:
        None for the paper's law, a law in Python, and fewer than 8 samples.
    """
    system, dataset = of_phase(run, dataset, -1)
    bodies, count = dataset.attrs["backend"] == "physics", dataset.sizes["time"]
    terms = (system.control_of_bodies if bodies else system.control).law.terms
    if not terms.agents or dataset.attrs.get("controller") or count < _FEWEST_SAMPLES:
        return None
    limit, begin, done = system.law.limit[: terms.agents], count // 2, 0
    thrusters = np.array([len(vehicle.thrusters) for vehicle in system.vehicles[: terms.agents]]) if bodies else None
    speed = jumps = at_limit = saturated = 0.0
    before = np.zeros((0, terms.agents, 3))
    for piece in pieces_of(dataset, ["velocity_command", *["agent_saturation"] * bodies]):
        command = np.nan_to_num(piece["velocity_command"].values)
        square = (command**2).sum(axis=2)
        late = max(begin - done, 0)
        speed += float(square.sum())
        at_limit += float((np.sqrt(square[late:]) >= _AT_LIMIT * limit).sum())
        if thrusters is not None:
            saturated += float((piece["agent_saturation"].values[late:] @ (thrusters / thrusters.sum())).sum())
        before = np.concatenate([before[-2:], command[late:]])
        jumps += float((np.diff(before, 2, axis=0) ** 2).sum())
        done += len(command)
    rest = count - begin
    found = TermsInRun(
        on=terms.names,
        jump=float(np.sqrt(jumps / (6.0 * (rest - 2) * terms.agents))),
        commanded=float(np.sqrt(speed / (count * terms.agents))),
        at_limit=at_limit / (rest * terms.agents),
        saturated=saturated / rest if bodies else None,
    )
    return replace(found, harm=tuple(_harm(system, terms, found)))


def _harm(system: System, terms: TermArrays, found: TermsInRun) -> list[str]:
    """Sentences about what is wrong."""
    limited = f"agents are at their velocity limit for {100 * found.at_limit:.0f}% of the last half"
    saturated = f"agents' thrusters are at a limit for {100 * (found.saturated or 0.0):.0f}% of the last half"
    if found.jump > max(_LARGEST_JUMP * found.commanded, _SMALLEST_JUMP):
        told = (
            f"commands jump by {found.jump:.3g} m/s RMS from sample to sample "
            f"({100 * found.jump / found.commanded:.0f}% of the commanded speed)"
        )
        told += f"; {limited}" * (found.at_limit >= _TOLD_SHARE)
        told += f"; {saturated}" * ((found.saturated or 0.0) >= _TOLD_SHARE)
        return [f"{told}: {_cause(system, terms, found.on)}"]
    on, sentences = listed(found.on), []
    if found.at_limit > _LARGEST_SHARE:
        sentences.append(f"{limited}, which leaves {on} no room: raise velocity_limit, or slow the targets")
    if (found.saturated or 0.0) > _LARGEST_SHARE:
        sentences.append(f"{saturated}, with {on}: lower controller.gain or velocity_limit, or slow the targets")
    return sentences


def _cause(system: System, terms: TermArrays, on: tuple[str, ...]) -> str:
    """Which terms make commands jump, and what to change."""
    noise = _noise(terms)
    largest = max(noise.values(), default=0.0)
    if largest > 0.0:
        blamed = [term for term, own in noise.items() if own >= _ACCOMPLICE * largest]
        filters = " and ".join(f"controller.{term}.filter" for term in blamed)
        leads = "feedforward" in blamed and terms.lead.any()
        calm = ", or set controller.feedforward.extrapolate to false, which multiplies it" * bool(leads)
        return f"{listed(blamed)} pass{'es' * (len(blamed) == 1)} the noise of odometry on; raise {filters}{calm}"
    if terms.integral >= largest_integral(system):  # less gain would make it worse
        mend = f"controller.integral.gain ({terms.integral:g} 1/s^2)"
    else:
        mend = f"controller.gain ({system.gain:g} 1/s)"
        mend += ", or raise controller.newton.rounds" * bool(terms.newton)
    feedback = [term for term in on if term in ("newton", "integral")]  # the others do not depend on the error
    return f"with {listed(feedback or ['this gain'])} the loop rings; lower {mend}; see mjsheaf check"


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: a, b and c."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _noise(terms: TermArrays) -> dict[str, float]:
    """Noise of odometry in what each term adds for unit maps, m/s RMS; no terms without noise.

    A filter that takes a share a of white noise leaves sqrt(a / (2 - a)) of it, and neighbouring samples correlated by
    1 - a; lead L makes of v the sum (1 + L) v - L v_before.
    """
    white = terms.noise / terms.period

    def left(a: float) -> float:
        return float(np.sqrt(a / (2.0 - a)))

    found = {}
    if terms.feedforward and white > 0.0:
        L, a = float(terms.lead.max()), terms.measured
        found["feedforward"] = white * left(a) * float(np.sqrt((1.0 + L) ** 2 + L**2 - 2.0 * L * (1.0 + L) * (1.0 - a)))
    if terms.drift > 0.0 and white > 0.0:
        found["drift"] = white * left(terms.drift)
    return found
