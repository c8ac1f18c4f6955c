"""What the law does not command: f_q of the agents, H^-1 B f_p that targets' drift asks of them, and their difference.

f_B = H^-1 B f_p(p, t) - f_q(q*) along the targets' path is what the theorem calls the bounded difference. Its largest
norm is found by branch and bound in time over the cells that cover the path (see `targets`). Over a cell in which p_k
moves by at most r_k about a centre and f_p,k by at most s_k, with |K_ik| the norms of the blocks of K = H^-1 B,

    |q*_i - centre| <= R_i = sum_k |K_ik| r_k,
    |f_B,i - f_B,i at the centre| <= sum_k |K_ik| s_k + R_i sup |df_i/dq| over that ball.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjsheaf.checking.targets import Carrier, Cells, TargetPath
from mjsheaf.dynamics.disturbance import evaluate
from mjsheaf.system import System

Array = NDArray[np.float64]

_MOST_CELLS = 50_000  # that are bounded
_MOST_NUMBERS = 8_000_000  # of f_B over them
_FEWEST_CELLS = 32  # to begin with
_GAP = 0.02  # wanted between the bound on |f_B| and a value of it, relative
_BATCH = 256
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Difference:
    """f_B along the targets' path.

    Attributes:
        bound: never exceeded by |f_B| along the path, m/s; infinite where the path is not known or meets a singularity.
        time: about when it is largest, s.
        carried, own, values: H^-1 B f_p, f_q(q*) and f_B at the path's own instants, stacked, shape (T, n_q), m/s.
        shaken: H^-1 B omega_p there, what the targets' disturbances ask of the agents, m/s.
    """

    bound: float
    time: float
    carried: Array
    own: Array
    values: Array
    shaken: Array


def difference_along(system: System, path: TargetPath, carrier: Carrier) -> Difference:
    """Bound |f_B| along a path, and evaluate f_B at its instants."""
    carried, own = carrier.carry(np.nan_to_num(path.drift)), agent_drift(system, path.q_star)
    values, shaken = carried - own, carrier.carry(evaluate(system.harmonics[len(system.team.agents) :], path.time))
    if path.cells is None:
        return Difference(np.inf, float(path.time[0]), carried, own, np.full_like(values, np.nan), shaken)
    bound, time = _largest(system, path.cells, carrier)
    return Difference(bound * (1.0 + _ROUNDING), time, carried, own, values, shaken)


def _largest(system: System, cells: Cells, carrier: Carrier) -> tuple[float, float]:
    """A bound on |f_B| over cells, and a time near which it is attained."""
    levels = [cells]
    while len(levels[-1].begin) > _FEWEST_CELLS:
        levels.append(_pairs(levels[-1]))
    level = np.full(len(levels[-1].begin), len(levels) - 1)
    index, now = np.arange(len(level)), levels[-1]
    upper, seen = _bound(system, carrier, now)
    most, time = float(seen.max()), float(now.begin[np.argmax(seen)])
    closed, left = 0.0, min(_MOST_CELLS, _MOST_NUMBERS // system.team.dirichlet.H.shape[0])
    while True:
        # A cell of one step whose segment is short beside how far the path may leave it gains nothing by being cut.
        whole = (level == 0) & np.all(np.linalg.norm(now.half, axis=2) <= now.bend, axis=1)
        over = (upper > (1.0 + _GAP) * most) & ~whole
        closed = max(closed, float(upper[~over].max(initial=0.0)))
        now, level, index, upper = _some(now, over), level[over], index[over], upper[over]
        if not len(upper) or left <= 0:
            return max(closed, float(upper.max(initial=0.0))), time
        order = np.argsort(-upper, kind="stable")
        first, rest = order[:_BATCH], order[_BATCH:]
        parent, levels_below, below, fresh = _children(levels, level[first], index[first], _some(now, first))
        bounds, values = _bound(system, carrier, fresh)
        left -= len(bounds)
        if values.max() > most:
            most, time = float(values.max()), float(fresh.begin[np.argmax(values)])
        now = Cells(*(np.concatenate([old[rest], new]) for old, new in zip(now, fresh, strict=True)))
        level, index = np.concatenate([level[rest], levels_below]), np.concatenate([index[rest], below])
        upper = np.concatenate([upper[rest], np.minimum(bounds, upper[first][parent])])


def _some(cells: Cells, which: NDArray[np.bool_] | NDArray[np.int64]) -> Cells:
    return Cells(*(x[which] for x in cells))


def _bound(system: System, carrier: Carrier, cells: Cells) -> tuple[Array, Array]:
    """Bounds on |f_B| over cells, and values that it reaches in each at least, shapes (n,), m/s."""
    moves = carrier.reach(np.linalg.norm(cells.half, axis=2) + cells.bend)
    q_star = carrier.extend(cells.centre)
    centre = np.linalg.norm(carrier.carry(cells.drift) - agent_drift(system, q_star), axis=1)
    spread = carrier.spread(cells.spread, agent_slopes(system, q_star, moves), moves)
    upper = centre + spread
    return np.where(np.isnan(upper), np.inf, upper), np.nan_to_num(np.maximum(centre - spread, 0.0))


def _children(
    levels: list[Cells], level: NDArray[np.int64], index: NDArray[np.int64], cells: Cells
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Cells]:
    """The cells of which cells are made, pairs below them or halves of their segments: parent, level, index, cell."""
    found = []
    for k in np.unique(level):
        own = np.flatnonzero(level == k)
        parent = np.repeat(own, 2)
        if k == 0:
            cut = _some(cells, parent)
            sign = np.tile([-1.0, 1.0], len(own))
            half, middle = 0.5 * cut.half, 0.5 * (cut.begin + cut.end)
            ends = np.where(sign < 0, cut.begin, middle), np.where(sign < 0, middle, cut.end)
            halves = cut._replace(begin=ends[0], end=ends[1], centre=cut.centre + sign[:, None, None] * half, half=half)
            found.append((parent, np.zeros_like(parent), index[parent], halves))
            continue
        below = 2 * index[parent] + np.tile([0, 1], len(own))
        there = below < len(levels[k - 1].begin)
        parent, below = parent[there], below[there]
        found.append((parent, np.full_like(parent, k - 1), below, _some(levels[k - 1], below)))
    parents, above, places, parts = zip(*found, strict=True)
    joined = Cells(*(np.concatenate(x) for x in zip(*parts, strict=True)))
    return np.concatenate(parents), np.concatenate(above), np.concatenate(places), joined


def _pairs(cells: Cells) -> Cells:
    """Each two neighbours as one cell, a ball; the last alone where their number is odd."""
    n = len(cells.begin) // 2 * 2
    centre, bend = _joined(cells.centre, np.linalg.norm(cells.half, axis=2) + cells.bend, n)
    drift, spread = _joined(cells.drift, cells.spread, n)
    ends = np.concatenate([cells.end[1:n:2], cells.end[n:]])
    slope = np.concatenate([np.maximum(cells.slope[0:n:2], cells.slope[1:n:2]), cells.slope[n:]])
    return Cells(cells.begin[::2], ends, centre, np.zeros_like(centre), bend, drift, spread, slope)


def _joined(centre: Array, radius: Array, n: int) -> tuple[Array, Array]:
    """The smallest balls about each two of the first n balls, shapes (n / 2, M, 3) and (n / 2, M), and what is left."""
    a, b, r, s = centre[0:n:2], centre[1:n:2], radius[0:n:2], radius[1:n:2]
    apart = np.linalg.norm(b - a, axis=2)
    around = np.maximum(0.5 * (apart + r + s), np.maximum(r, s))
    share = np.clip(np.divide(around - r, apart, out=np.zeros_like(r), where=apart > 0.0), 0.0, 1.0)
    middle = a + share[..., None] * (b - a)
    return np.concatenate([middle, centre[n:]]), np.concatenate([around * (1.0 + _ROUNDING), radius[n:]])


def coarser(cells: Cells, most: int) -> Cells:
    """At most so many cells that cover what the given ones do."""
    while len(cells.begin) > most:
        cells = _pairs(cells)
    return cells


def agent_drift(system: System, q: Array) -> Array:
    """f_q at stacked agent states (T, n_q): the flow that agents meet, stacked; shape (T, n_q), m/s."""
    spread = system.team.unpack(q)
    w = np.zeros_like(spread)
    for field in np.unique(system.field[: spread.shape[1]]):
        own = np.flatnonzero(system.field[: spread.shape[1]] == field)
        w[:, own] = system.flows[field].velocity(spread[:, own])
    n_q = system.team.dirichlet.H.shape[0]
    return w.reshape(len(q), -1)[:, system.team.slots[:n_q]]


def agent_slopes(system: System, q: Array, radii: Array) -> Array:
    """Bounds on |df_i/dq| over balls of radii (T, N) about stacked agent states (T, n_q), shape (T, N), 1/s."""
    spread = system.team.unpack(q)
    slopes = np.empty(radii.shape)
    for field in np.unique(system.field[: spread.shape[1]]):
        own = np.flatnonzero(system.field[: spread.shape[1]] == field)
        slopes[:, own] = system.flows[field].slope_bound(spread[:, own], radii[:, own])
    return slopes
