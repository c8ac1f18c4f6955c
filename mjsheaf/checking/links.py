"""What links do to the held law on ideal kinematics: delay, noise and loss, answered exactly where an answer is known.

All of it is linear about q*: within limits of speed, while bodies are within range of one another, without the slope of
the flow. See `linked_law` for what each edge measures, and `delay`, `link_noise` and `loss` for the answers.
"""

from typing import Any

from pydantic import Field

from mjsheaf.checking.delay import DelayAnswer, delay_answer
from mjsheaf.checking.held_law import UndecidedError
from mjsheaf.checking.link_noise import NoiseAnswer, noise_answer
from mjsheaf.checking.linked_law import LinkedLaw, linked_law
from mjsheaf.checking.loss import LossAnswer, loss_answer
from mjsheaf.checking.targets import TargetPath
from mjsheaf.io.section import Finite, Record
from mjsheaf.system import System
from mjsheaf.team import Team
from mjsheaf.team.links import KINDS

UNSTABLE_LINKS = "over its links the law is unstable"


class LinkRecord(Record):
    """What links do to the law, on ideal kinematics and linear about q*; null wherever no exact answer is known."""

    exact: bool = Field(description="whether every link is: then only the margin of delay is new")
    stable: bool | None = Field(
        description="with the delays of the links, and where measurements are lost in mean square; null: undecided"
    )
    delay_margin: Finite = Field(description="that of `delay`, s")
    noise_rms: Finite = Field(description="RMS of |e| of the team that noise makes, m; null without noise")
    mean_square_rate: Finite = Field(description="that of `loss`, 1/s; null without loss")
    delivery: dict[str, Finite] = Field(
        description="share of measurements that arrive in the long run, mean over a kind's edges, within range"
    )
    assumed: str = Field(description="what the answers rest on")
    delay: DelayAnswer
    noise: NoiseAnswer | None = Field(description="null where nothing has noise or bias")
    loss: LossAnswer | None = Field(description="null where nothing is lost")


def link_answers(system: System, path: TargetPath) -> LinkRecord | None:
    """What links do to the law of a system, and how much delay it bears; None where links are exact and that unknown.

    Args:
        system: the system.
        path: of its targets.
    """
    exact = not len(system.law.links.table)
    try:
        return answers_for(linked_law(system, path), system.team)
    except UndecidedError as error:
        unknown: dict[str, Any] = dict.fromkeys(
            ("stable", "delay_margin", "noise_rms", "mean_square_rate", "noise", "loss")
        )
        nothing: dict[str, Any] = dict.fromkeys(("delay", "stable", "spectral_radius", "margin"))
        delay = DelayAnswer(reason=str(error), **nothing)
        return None if exact else LinkRecord(exact=False, delivery={}, assumed="", delay=delay, **unknown)


def answers_for(law: LinkedLaw, team: Team) -> LinkRecord:
    """What the links of a law do to it, for a team."""
    links, terms = law.links, law.terms
    lossy, late = bool(links.lossy.any()), bool(links.delay.any())
    noisy = any(x.any() for x in (*links.noise, *links.bias))
    strayed = (terms.noise > 0.0 or terms.bias != 0.0) and (terms.feedforward > 0 or terms.drift > 0.0)
    delay, loss = delay_answer(law), loss_answer(law) if lossy else None
    noise = noise_answer(law, team) if noisy or strayed else None
    arrive = {
        kind: [x for x, edge in zip(links.delivered.tolist(), law.edges, strict=True) if edge.kind == kind]
        for kind in KINDS
    }
    return LinkRecord(
        exact=not (lossy or late or noisy or links.ranged),
        stable=delay.stable if loss is None else loss.stable,
        delay_margin=delay.margin,
        noise_rms=None if noise is None else noise.error,
        mean_square_rate=None if loss is None else loss.rate,
        delivery={kind: sum(own) / len(own) if own else None for kind, own in arrive.items()},
        assumed="no command at a limit of speed; the slope of the flow is left out"
        + "; bodies within range of one another, as at the start and at q*" * links.ranged,
        delay=delay,
        noise=noise,
        loss=loss,
    )
