"""Where agents can be: a tube about the harmonic extension, which holds every run of the theory's law.

As long as |e(t)| <= R(t), each agent is within R(t) of its q*_i(t). So bounds on the flow's slope and speed over the tube
of that radius hold along the run, whatever the run records, and whether there is one or not.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.system import System
from mjsheaf.checking.drift import Carrier, coarser
from mjsheaf.checking.targets import TargetPath
from mjsheaf.dynamics.bounds import Supremum, largest_speed, lipschitz_constant

Array = NDArray[np.float64]
Radius = Callable[[Array], Array]
"""A bound on |e| in m at times in s: monotone in time."""

_MOST_BOXES = 4096
_MOST_SPANS = 64  # of time
_FARTHEST = 1e12  # m: a box that is the whole space


@dataclass(frozen=True)
class Tube:
    """Boxes that hold the agents over spans of time.

    Attributes:
        low, high: corners, shape (S, N, 3), m.
    """

    low: Array
    high: Array

    def corners(self) -> tuple[Array, Array]:
        """The corners of one box that holds all, shape (3,) each, m."""
        return self.low.min(axis=(0, 1)), self.high.max(axis=(0, 1))

    def slope(self, system: System) -> Supremum:
        """rho: the largest Lipschitz constant of the flow that agents meet in their boxes, 1/s."""
        return self._largest(system, lipschitz_constant)

    def speed(self, system: System) -> Supremum:
        """The largest speed of the flow that agents meet in their boxes, without uniform drift, m/s."""
        return self._largest(system, lambda *box, planar: largest_speed(*box, planar=planar, drift=False))

    def _largest(self, system: System, of: Callable[..., Supremum]) -> Supremum:
        members, found = system.team.members, []
        kinds = [(int(system.field[i]), members[i].dimension == 2) for i in range(self.low.shape[1])]
        for field, planar in dict.fromkeys(kinds):
            own = [i for i, kind in enumerate(kinds) if kind == (field, planar)]
            boxes = [x[:, own].reshape(-1, 3) for x in (self.low, self.high)]
            found.append(of(system.flows[field], *boxes, planar=planar))
        return max(found, key=lambda s: s.upper)


def tube_about(system: System, path: TargetPath, carrier: Carrier, radius: Radius) -> Tube:
    """The tube of a radius about the harmonic extension of a path that is known, in spans of time."""
    assert path.cells is not None
    N = len(system.team.agents)
    cells = coarser(path.cells, max(1, min(_MOST_SPANS, _MOST_BOXES // N)))
    centre = system.team.unpack(carrier.extend(cells.centre))
    wide = np.maximum(radius(cells.begin), radius(cells.end))[:, None]
    wide = wide + carrier.reach(np.linalg.norm(cells.half, axis=2) + cells.bend)
    low, high = centre - wide[..., None], centre + wide[..., None]
    if N > _MOST_BOXES:
        low, high = low.min(axis=1, keepdims=True), high.max(axis=1, keepdims=True)
        low, high = (np.repeat(x, N, axis=1) for x in (low, high))
    planar = np.array([agent.dimension == 2 for agent in system.team.agents])
    low[:, planar, 2] = high[:, planar, 2] = 0.0
    return Tube(low, high)


def tube_guessed(system: System, path: TargetPath) -> Tube:
    """A box about initial positions and the harmonic extension, by which nothing is proven."""
    N = len(system.team.agents)
    both = np.concatenate([system.initial[None, :N], system.team.unpack(path.q_star)])
    low, high = both.min(axis=(0, 1)), both.max(axis=(0, 1))
    widen = 0.5 * np.maximum(high - low, 1.0)
    widen[2] *= any(agent.dimension == 3 for agent in system.team.agents)
    return Tube(*(np.tile(x, (1, N, 1)) for x in (low - widen, high + widen)))


def speed_everywhere(system: System) -> float:
    """A bound on the speed of the flow that agents meet anywhere, without uniform drift, m/s."""
    whole = np.full((1, len(system.team.agents), 3), _FARTHEST)
    return Tube(-whole, whole).speed(system).upper
