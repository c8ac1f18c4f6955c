"""Where agents can be: a tube about the harmonic extension, which holds every run of the theory's law.

As long as |e(t)| <= R(t), each agent is within R(t) of its q*_i(t). So bounds on the flow's slope and speed over the
tube of that radius hold along the run, whatever the run records, and whether there is one or not.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mjsheaf.checking.drift import Difference, coarser
from mjsheaf.checking.targets import Carrier, TargetPath
from mjsheaf.dynamics.bounds import Supremum, largest_speed, lipschitz_constant
from mjsheaf.system import System

Array = NDArray[np.float64]
Radius = Callable[[Array], Array]
"""A bound on |e| in m at times in s: monotone in time."""

_MOST_BOXES = 256
_MOST_SPANS = 32  # of time
FARTHEST = 1e12
"""m: a box of this size is the whole space."""


@dataclass(frozen=True, eq=False)
class Tube:
    """Boxes that hold the agents of a system over spans of time.

    Attributes:
        system: the system.
        low, high: corners, shape (S, N, 3), m.
    """

    system: System
    low: Array
    high: Array

    def corners(self) -> tuple[Array, Array]:
        """The corners of one box that holds all, shape (3,) each, m."""
        return self.low.min(axis=(0, 1)), self.high.max(axis=(0, 1))

    def joined(self) -> "Tube":
        """One box that holds all, for every agent."""
        low, high = (np.tile(corner, (1, self.low.shape[1], 1)) for corner in self.corners())
        return Tube(self.system, low, high)

    @cached_property
    def slope(self) -> Supremum:
        """rho: the largest Lipschitz constant of the flow that agents meet in their boxes, 1/s."""
        return self._largest(lipschitz_constant)

    @cached_property
    def speed(self) -> Supremum:
        """The largest speed of the flow that agents meet in their boxes, without uniform drift, m/s."""
        return self._largest(lambda *box, planar: largest_speed(*box, planar=planar, drift=False))

    def _largest(self, of: Callable[..., Supremum]) -> Supremum:
        system, members, found = self.system, self.system.team.members, []
        kinds = [(int(system.field[i]), members[i].dimension == 2) for i in range(self.low.shape[1])]
        for field, planar in dict.fromkeys(kinds):
            own = [i for i, kind in enumerate(kinds) if kind == (field, planar)]
            boxes = np.unique(np.stack([x[:, own].reshape(-1, 3) for x in (self.low, self.high)], axis=1), axis=0)
            found.append(of(system.flows[field], boxes[:, 0], boxes[:, 1], planar=planar))
        return max(found, key=lambda s: s.upper)


@dataclass(frozen=True)
class Constants:
    """The constants of a system, and where they hold.

    Attributes:
        difference: f_B along the targets' path; its bound is f_bar.
        rho: largest slope of the flow over the agents' tube, 1/s, and where.
        speed: largest speed of the flow over their tube, without uniform drift, which cancels in f~, m/s.
        largest_disturbance: largest omega_bar_i, m/s.
        omega_bar: bound on |Delta|, m/s.
        initial_error: |e(t0)|, m.
    """

    difference: Difference
    rho: Supremum
    speed: Supremum
    largest_disturbance: float
    omega_bar: float
    initial_error: float


@dataclass(frozen=True)
class Region:
    """Where the theory keeps a run.

    Attributes:
        path: the targets' path and the harmonic extension along it.
        tube: boxes that hold the agents.
        source: why they do, or what they are.
        verified: whether they are proven to, for the law without limits, and the path is known.
    """

    path: TargetPath
    tube: Tube
    source: str
    verified: bool


def tube_about(system: System, path: TargetPath, carrier: Carrier, radius: Radius) -> Tube:
    """The tube of a radius about the harmonic extension of a path that is known, in spans of time.

    It has one box for each agent and span, or one for all agents where there are many.
    """
    assert path.cells is not None
    N = len(system.team.agents)
    cells = coarser(path.cells, max(1, min(_MOST_SPANS, _MOST_BOXES // N)))
    centre = system.team.unpack(carrier.extend(cells.centre))
    wide = np.maximum(radius(cells.begin), radius(cells.end))[:, None]
    wide = wide + carrier.reach(np.linalg.norm(cells.half, axis=2) + cells.bend)
    low, high = centre - wide[..., None], centre + wide[..., None]
    planar = np.array([agent.dimension == 2 for agent in system.team.agents])
    low[:, planar, 2] = high[:, planar, 2] = 0.0
    tube = Tube(system, low, high)
    return tube if N <= _MOST_BOXES else tube.joined()


def tube_guessed(system: System, path: TargetPath, margin: float = 0.5) -> Tube:
    """A box about initial positions and q*, widened by a share of its size, by which nothing is proven."""
    N = len(system.team.agents)
    both = np.concatenate([system.initial[None, :N], system.team.unpack(path.q_star)])
    low, high = both.min(axis=(0, 1)), both.max(axis=(0, 1))
    widen = margin * np.maximum(high - low, 1.0)
    widen[2] *= any(agent.dimension == 3 for agent in system.team.agents)
    return Tube(system, *(np.tile(x, (1, N, 1)) for x in (low - widen, high + widen)))


def speed_everywhere(system: System) -> float:
    """A bound on the speed of the flow that agents meet anywhere, without uniform drift, m/s."""
    whole = np.full((1, len(system.team.agents), 3), FARTHEST)
    return Tube(system, -whole, whole).speed.upper
