"""Effects of links on the held law on ideal kinematics: delay, noise and loss, exact where an exact answer is known.

All of it is linear about q*: within limits of speed, while bodies are within range of one another, without the slope of
the flow. See `linked_law` for what each edge measures and for delay, and `moments` for noise and loss.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from pydantic import Field

from mjsheaf.arrays import IntArray
from mjsheaf.checking.loop.held_law import common_delay, eigen_of, loop_of
from mjsheaf.checking.loop.linear_law import model_of, require_model
from mjsheaf.checking.loop.linked_law import (
    DelayAnswer,
    LinkedLaw,
    LinkParameters,
    MeasuredEdge,
    continuous_delay_margin,
    delay_answer,
    links_of,
    measured_edges,
    perfect_links,
    spectral_radius,
)
from mjsheaf.checking.loop.moments import LossAnswer, NoiseAnswer, loss_answer, noise_answer
from mjsheaf.checking.loop.sampled_loop import Loop, largest_gain
from mjsheaf.checking.spectrum import DENSE_STATES, held_eigenvalues, spectrum_of
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
    team, terms = system.team, system.law.terms
    try:
        require_model(system)
        edges, links = measured_edges(team), links_of(system, path)
        size = team.dirichlet.H.shape[0]
        if not team.symmetric:
            why = "H is not symmetric: only a delay of all measurements alike is decided"
        elif size > DENSE_STATES and not (system.grid.continuous or terms.newton):
            why = f"H has {size} rows; all its eigenvalues are found up to {DENSE_STATES}"
        else:
            law = LinkedLaw(loop_of(system), eigen_of(system)[1], edges, links, terms)
            return _with_gain(answers_for(law, team), system)
        found = _record(_delay_alone(system, edges, links, why), edges, links, terms, why=why)
        return _with_gain(found, system)
    except UndecidedError as error:
        if not len(system.law.links.table):
            return None
        why = str(error)
        return _record(DelayAnswer(reason=why), [], perfect_links([]), terms, why=why, unknown=True)


def _with_gain(record: LinkRecord, system: System) -> LinkRecord:
    """Add the controller.gain from which on the held law is unstable over its links, where it is known."""
    law, team, delay = system.law, system.local.team, common_delay(system)
    changed = law.terms.newton or law.terms.integral or law.custom or (law.extended and not team.symmetric)
    if system.grid.continuous or changed or delay is None:
        return record
    values = np.array([system.largest_eigenvalue]) if team.symmetric else held_eigenvalues(team)
    gain = largest_gain(values, system.grid.period, delay)
    return record.model_copy(update={"delay": record.delay.model_copy(update={"largest_gain": gain})})


def answers_for(law: LinkedLaw, team: Team) -> LinkRecord:
    """Compute the effects of a law's links, for a team."""
    delay = delay_answer(law.loop, law.links.delay, law.linked, partial(spectral_radius, law))
    return _record(delay, law.edges, law.links, law.terms, law=law, team=team)


def _delay_alone(system: System, edges: Sequence[MeasuredEdge], links: LinkParameters, why: str) -> DelayAnswer:
    """Answer for the delay that all measurements share, of a team whose eigenvectors are not known.

    Of a large team the largest and smallest eigenvalues decide: the spectral radius falls and then rises in between.

    Args:
        system: The system.
        edges: Its edges.
        links: Theirs.
        why: Reason why nothing is known of unlike delays.

    Raises:
        UndecidedError: The harmonic extension is not unique, or the law has an integral.
    """
    team, gain, period = system.team, system.gain, system.grid.period
    linked = np.array([edge.linked for edge in edges])
    if not team.symmetric and system.grid.continuous:
        margin = continuous_delay_margin(held_eigenvalues(team), gain)
        return DelayAnswer(delay=0.0, stable=margin is not None, margin=margin, reason="")
    if not team.symmetric:
        loop = loop_of(system)
        linked[:] = True
    elif not team.dirichlet.unique:
        raise UndecidedError("the harmonic extension is not unique")
    elif system.law.terms.integral or system.law.custom:
        raise UndecidedError(why)
    else:
        values = np.array([spectrum_of(team).smallest[0], system.largest_eigenvalue])
        loop = Loop(model_of(system.law, period), values, gain, period)

    def radius_of(delay: IntArray) -> float:
        if np.ptp(delay) > 0:
            raise UndecidedError(why)
        return loop.radius_at(int(delay.max()))

    return delay_answer(loop, links.delay, linked, radius_of)


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
