"""Effects of links on the held law on ideal kinematics: delay, noise and loss, exact where an exact answer is known.

All of it is linear about q*: within limits of speed, while bodies are within range of one another, without the slope of
the flow. See `linked_law` for what each edge measures and for delay, and `moments` for noise and loss.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from pydantic import Field

from mjsheaf.arrays import IntArray
from mjsheaf.checking.loop.held_law import common_delay, loop_of
from mjsheaf.checking.loop.linear_law import require_model
from mjsheaf.checking.loop.linked_law import (
    DelayAnswer,
    LinkedLaw,
    LinkParameters,
    MeasuredEdge,
    answer_of_large_team,
    continuous_delay_margin,
    delay_answer,
    linked_law,
    links_of,
    measured_edges,
    perfect_links,
    spectral_radius,
)
from mjsheaf.checking.loop.moments import LossAnswer, NoiseAnswer, loss_answer, noise_answer
from mjsheaf.checking.loop.sampled_loop import largest_gain
from mjsheaf.checking.spectrum import DENSE_STATES, held_eigenvalues
from mjsheaf.checking.theorem.targets import TargetPath
from mjsheaf.errors import UndecidedError
from mjsheaf.law.terms import TermArrays
from mjsheaf.section import OF_TEAM, TEAM_NORM, Finite, Norm, Record
from mjsheaf.system import System
from mjsheaf.team import Team
from mjsheaf.team.links import KINDS

UNSTABLE_LINKS = "over its links the law is unstable"


class LinkRecord(Record):
    """Effects of links on the law, on ideal kinematics and linear about q*; null wherever no exact answer is known."""

    exact: bool = Field(description="whether every link is: then only the margin of delay is new")
    stable: bool | None = Field(
        description="with the delays of the links, and where measurements are lost in mean square; null: undecided"
    )
    delay_margin: Finite = Field(description="that of `delay`, s")
    noise_rms: Finite = Field(description="RMS in time of |e| of the whole team that noise makes in the long run, m")
    noise_rms_per_agent: Finite = Field(description="the same as RMS over agents, noise_rms / sqrt(N), m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    mean_square_rate: Finite = Field(
        description="by which E|e|^2 falls in a period, in the long run: the spectral radius of X -> E[A X A^T]"
    )
    delivery: dict[str, Finite] = Field(
        description="share of measurements that arrive in the long run, mean over a kind's edges, within range"
    )
    assumed: str = Field(description="what the answers rest on")
    delay: DelayAnswer
    noise: NoiseAnswer | None = Field(description="null where nothing has noise or bias")
    loss: LossAnswer | None = Field(description="null where nothing is lost")


def link_answers(system: System, path: TargetPath) -> LinkRecord | None:
    """Compute the effects of links on a law, and its delay margin; None if links are exact and the margin is unknown.

    Args:
        system: the system.
        path: Path of its targets.
    """
    found = _answers(system, path)
    if found is None or found.delay.delay is None:
        return found
    delay = found.delay.model_copy(update={"largest_gain": _largest_gain(system)})
    return found.model_copy(update={"delay": delay})


def _largest_gain(system: System) -> float | None:
    """Return the controller.gain from which on the held law is unstable over its links, 1/s.

    It is None if it is not known: where a term changes it, and where measurements are not equally old.
    """
    law, team, delay = system.law, system.local.team, common_delay(system)
    changed = law.terms.newton or law.terms.integral or law.custom or (law.extended and not team.symmetric)
    if system.grid.continuous or changed or delay is None:
        return None
    values = np.array([system.largest_eigenvalue]) if team.symmetric else held_eigenvalues(team)
    return largest_gain(values, system.grid.period, delay)


def _answers(system: System, path: TargetPath) -> LinkRecord | None:
    team = system.team
    try:
        require_model(system)
        edges, links = measured_edges(team), links_of(system, path)
        if not team.symmetric:
            why = "H is not symmetric: only a delay of all measurements alike is decided"
            return _record(_delay_of_directed_team(system, links, why), edges, links, system.law.terms, why=why)
        size = team.dirichlet.H.shape[0]
        if size > DENSE_STATES and not (system.grid.continuous or system.law.terms.newton):
            why = f"H has {size} rows; all its eigenvalues are found up to {DENSE_STATES}"
            return _record(_delay_of_large_team(system, edges, links, why), edges, links, system.law.terms, why=why)
        return answers_for(linked_law(system, path), team)
    except UndecidedError as error:
        if not len(system.law.links.table):
            return None
        why = str(error)
        return _record(DelayAnswer(reason=why), [], perfect_links([]), system.law.terms, why=why, unknown=True)


def answers_for(law: LinkedLaw, team: Team) -> LinkRecord:
    """Compute the effects of a law's links, for a team."""
    delay = delay_answer(law.loop, law.links.delay, law.linked, partial(spectral_radius, law))
    return _record(delay, law.edges, law.links, law.terms, law=law, team=team)


def _delay_of_directed_team(system: System, links: LinkParameters, why: str) -> DelayAnswer:
    """Answer for the delay that all measurements share; `why` is the reason where they do not."""
    if system.grid.continuous:
        margin = continuous_delay_margin(held_eigenvalues(system.team), system.gain)
        return DelayAnswer(delay=0.0, stable=margin is not None, margin=margin, reason="")
    loop = loop_of(system)

    def radius_of(delay: IntArray) -> float:
        if np.ptp(delay) > 0:
            raise UndecidedError(why)
        return loop.radius_at(int(delay.max()))

    return delay_answer(loop, links.delay, np.ones(len(links.delay), dtype=np.bool_), radius_of)


def _delay_of_large_team(system: System, edges: Sequence[MeasuredEdge], links: LinkParameters, why: str) -> DelayAnswer:
    """Answer from lambda_max, for a team whose other eigenvalues are not known.

    Raises:
        UndecidedError: The harmonic extension is not unique, or the law has an integral.
    """
    if not system.team.dirichlet.unique:
        raise UndecidedError("the harmonic extension is not unique")
    if system.law.terms.integral or system.law.custom:
        raise UndecidedError(why)
    linked = np.array([edge.linked for edge in edges])
    return answer_of_large_team(system.gain, system.grid.period, system.largest_eigenvalue, links.delay, linked)


def _record(
    delay: DelayAnswer,
    edges: Sequence[MeasuredEdge],
    links: LinkParameters,
    terms: TermArrays,
    *,
    law: LinkedLaw | None = None,
    team: Team | None = None,
    why: str = "",
    unknown: bool = False,
) -> LinkRecord:
    """Return the record of links; without a law, `why` is the reason for what is not known of noise and loss."""
    noise = loss = None
    strays = (terms.noise > 0.0 or terms.bias != 0.0) and (terms.feedforward > 0 or terms.drift > 0.0)  # odometry
    if unknown or links.noisy or strays:
        noise = (
            NoiseAnswer(agents=[], linearised=links.linearised, reason=why)
            if law is None or team is None
            else noise_answer(law, team)
        )
    if unknown or links.lossy.any():
        loss = LossAnswer(reason=why) if law is None else loss_answer(law)
    rate = None if delay.spectral_radius is None else delay.spectral_radius**2
    delivered = {
        kind: [x for x, e in zip(links.delivered.tolist(), edges, strict=True) if e.kind == kind] for kind in KINDS
    }
    ranged = "; bodies within range of one another, as at the start and at q*" if links.ranged else ""
    return LinkRecord(
        exact=links.exact and not unknown,
        stable=delay.stable if loss is None else loss.stable,
        delay_margin=delay.margin,
        noise_rms=0.0 if noise is None else noise.error,
        noise_rms_per_agent=0.0 if noise is None else noise.error_per_agent,
        mean_square_rate=rate if loss is None else loss.factor,
        delivery={} if unknown else {kind: sum(own) / len(own) if own else None for kind, own in delivered.items()},
        assumed="" if unknown else f"no command at a limit of speed; the slope of the flow is left out{ranged}",
        delay=delay,
        noise=noise,
        loss=loss,
    )
