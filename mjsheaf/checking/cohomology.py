"""The relative cohomology H^0(G, G_p; F) in the words of the team: who is free to drift, and who is barely held."""

from dataclasses import dataclass

import numpy as np

from mjsheaf.checking.spectrum import Spectrum, spectrum_of
from mjsheaf.sheaf import RANK_TOLERANCE
from mjsheaf.sheaf.kernel import DENSE_COLUMNS
from mjsheaf.team import Team
from mjsheaf.team.freedom import Motion, describe, describe_nearly, free_motions, motion_of

NEARLY = 1e-3
"""A direction is barely held when its eigenvalue is at most this much of the largest."""

MOST_NEARLY = 3
"""How many barely held directions are told."""


@dataclass(frozen=True)
class FreeDirection:
    """A direction in which agents can drift without any edge or anchor noticing.

    Attributes:
        description: such as "A3 is free along z".
        motion: how each agent moves, in its own coordinates; agents that do not move are left out. The largest entry
            is 1.
    """

    description: str
    motion: dict[str, list[float]]


@dataclass(frozen=True)
class NearNull:
    """A direction that is held, but barely: it converges slowly and a small disturbance moves it far.

    Attributes:
        description: such as "A3 is nearly free along z"; only agents that move at least half as far as the one that
            moves most are named.
        eigenvalue: of H.
        ratio: to the largest eigenvalue of H.
    """

    description: str
    eigenvalue: float
    ratio: float


@dataclass(frozen=True)
class RelativeCohomology:
    """H^0(G, G_p; F), explained.

    Attributes:
        dimension: 0 where the harmonic extension is unique.
        tolerance: a singular value of the coboundary on the agents counts as zero when it is at most this much of the
            largest.
        basis: one direction for each dimension; in each as few agents move as was found.
        near_null: directions whose eigenvalue is above zero and at most NEARLY of the largest, at most MOST_NEARLY.
        method: how it was decided, in words.
    """

    dimension: int
    tolerance: float
    basis: list[FreeDirection]
    near_null: list[NearNull]
    method: str


def explain(team: Team, spectrum: Spectrum | None = None) -> RelativeCohomology:
    """Explain the relative cohomology of a team.

    Args:
        team: the team.
        spectrum: its spectrum where that is known already.
    """
    spectrum = spectrum or spectrum_of(team)
    basis = [FreeDirection(describe(team, motion), _by_agent(team, motion)) for motion in free_motions(team)]
    n = team.dirichlet.H.shape[0]
    return RelativeCohomology(
        dimension=len(basis),
        tolerance=RANK_TOLERANCE,
        basis=basis,
        near_null=_near_null(team, spectrum),
        method="singular values, dense"
        if n <= DENSE_COLUMNS
        else f"singular values of each connected component, dense up to {DENSE_COLUMNS} states and by shift-invert "
        "Lanczos beyond",
    )


def _near_null(team: Team, spectrum: Spectrum) -> list[NearNull]:
    near = spectrum.smallest[:MOST_NEARLY] <= NEARLY * spectrum.lambda_max
    return [
        NearNull(
            describe_nearly(team, motion_of(team, spectrum.vectors[:, k])),
            float(spectrum.smallest[k]),
            float(spectrum.smallest[k] / spectrum.lambda_max),
        )
        for k in np.flatnonzero(near)
    ]


def _by_agent(team: Team, motion: Motion) -> dict[str, list[float]]:
    moving = [team.agents[a] for a in motion.agents]
    return {
        agent.id: step[: agent.dimension].round(9).tolist() for agent, step in zip(moving, motion.steps, strict=True)
    }
