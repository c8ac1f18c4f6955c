"""The constants of Theorem 1 over a run: f_bar along the targets' path, and rho over a tube that holds the agents.

f_B = H^-1 B f_p(p, t) - f_q(q*) along the targets' path is the theorem's bounded difference. Its largest norm is
bounded over each of the cells that cover the path (see `targets`), which are cut into parts if that helps. Let |K_ik|
be the norms of the blocks of K = H^-1 B. Over a cell with p_k within r_k of a centre and f_p,k within s_k of its value
there,

    |q*_i - centre| <= R_i = sum_k |K_ik| r_k,
    |f_B,i - f_B,i at the centre| <= sum_k |K_ik| s_k + R_i sup |df_i/dq| over that ball.

While formations change, offsets are linear in time, and so are c and q* beyond H^-1 B p: q* = H^-1 (B p + c(t)) has the
velocity H^-1 (B p' + c'), with c' constant. The proof of the theorem uses e' = q*' - q' alone, so it holds with

    f_B = H^-1 B f_p(p, t) + H^-1 c' - f_q(q*).

Over a cell of duration h, q*_i is within h |(H^-1 c')_i| / 2 of its position at mid-time, which R_i includes.

As long as |e(t)| <= R(t), each agent is within R(t) of its q*_i(t). So bounds on the flow's slope and speed over the
tube of that radius about q* hold along the run.

Moving parts of the medium are bounded in one of two ways. As a disturbance, a part adds its largest speed S to
omega_bar_i. But usually it is one flow w(x, t) for a set of vehicles, and only its differences move e. With E_q and E_p
the maps that give each agent and target of the set the same velocity, c any point, and L the largest norm of the
Jacobian of w,

    K w(p, t) - w(q, t) = (K E_p - E_q) w(c, t) + K d_p - d_q + (w(q*, t) - w(q, t)),
    |d_k| <= L |x_k - c| at p_k and q*_k,    |w(q*, t) - w(q, t)| <= L |e|,

so it adds sigma S + L D to f_bar and L to rho, with sigma the norm of K E_p - E_q and D a bound on
|K (x_p - c) - (x_q* - c)| by the norms of K's blocks, along the path. sigma is 0 if all vehicles meet the flow: a tide
moves the whole team and changes no error. A grid is continued outside its box by the value at the nearest point, which
keeps S and L. No other property of w is used, so the proof of the theorem is unchanged. Each flow is bounded in the way
that makes the ultimate radius smaller.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.checking.spectrum import Spectrum
from mjsheaf.checking.theorem.flow_bounds import Supremum, bound_slopes, supremum
from mjsheaf.checking.theorem.targets import Carrier, Cells, TargetPath
from mjsheaf.checking.theorem.theorem import disturbance_bound
from mjsheaf.loop.system import System
from mjsheaf.media import varying
from mjsheaf.media.gridded import GridArrays
from mjsheaf.media.gusts import FrozenArrays, GustArrays
from mjsheaf.media.medium import Parts, bounds_of, moving_along, undisturbed
from mjsheaf.media.varying import VaryingArrays, evaluate
from mjsheaf.media.waves import WaveArrays

_PARTS = 4  # number of parts into which a cell is cut
_MOST_NUMBERS = 8_000_000  # of f_B over cells that were cut
_ROUNDING = 1e-9
_MOST_SPANS = 32  # of time
FARTHEST = 1e12
"""Size of a box that stands for the whole space, m."""


@dataclass(frozen=True)
class Difference:
    """f_B along the targets' path.

    Attributes:
        bound: Bound on |f_B| along the path, m/s; infinite if the path is not known or meets a singularity.
        time: Time near which |f_B| is largest, s.
        carried, own, values: H^-1 (B f_p + c'), f_q(q*) and f_B at the path's own instants, stacked, shape (T, n_q),
            m/s.
        shaken: H^-1 B omega_p there, the velocity of q* due to the targets' disturbances, minus the velocity of the
            moving parts of the medium at q*, m/s.
    """

    bound: float
    time: float
    carried: Array
    own: Array
    values: Array
    shaken: Array


def difference_along(system: System, path: TargetPath, carrier: Carrier) -> Difference:
    """Bound |f_B| along a path, and evaluate f_B at its instants."""
    carried, own, shaken = velocities_along(system, path, carrier)
    values = carried - own
    if path.cells is None or system.team.changing is not None:
        return Difference(np.inf, float(path.time[0]), carried, own, np.full_like(values, np.nan), shaken)
    bound, time = _largest(system, path.cells, carrier)
    return Difference(bound * (1.0 + _ROUNDING), time, carried, own, values, shaken)


def velocities_along(system: System, path: TargetPath, carrier: Carrier) -> tuple[Array, Array, Array]:
    """Return H^-1 (B f_p + c'), f_q(q*), and the contribution of disturbances to their difference; see `Difference`.

    The first is NaN if the change of linearised edges is not known.
    """
    carried = carrier.carry(np.nan_to_num(path.drift)) + (carrier.rate if system.team.changing is None else np.nan)
    N = len(system.team.agents)
    shaking = (
        moving_along(system.medium, path.time, path.positions)[:, N:]
        if system.moving
        else evaluate(system.harmonics[N:], path.time)
    )
    shaken = carrier.carry(shaking) - agent_motion(system, path.time, path.q_star, (GustArrays, FrozenArrays))
    return carried, agent_flow(system, path.q_star), shaken


def _largest(
    system: System,
    cells: Cells,
    carrier: Carrier,
    *,
    rounds: int = 10,  # of cuts
    gap: float = 1e-3,  # relative gap of the bound to an attained value, and smallest relative gain of a round
    size: int = 1024,  # cells that are bounded at once
) -> tuple[float, float]:
    """Return a bound on |f_B| over cells, m/s, and a time near which it is attained, s.

    Every round bounds |f_B| over each cell from above, and its largest value by that at the cell's centre from below.
    Cells whose bound is at most slightly above the largest such value are not cut again. The others are cut into equal
    parts of their segments. The parts cover the cell, so the largest bound of any round, including those of the cells
    set aside earlier, holds over the whole path. Rounds end when they no longer lower it; the remaining gap is due to
    the spread of the cells.
    """
    bound, closed, attained, time = np.inf, 0.0, 0.0, float(cells.begin[0])
    most = max(_MOST_NUMBERS // system.team.dirichlet.H.shape[0], len(cells.begin))
    for _ in range(rounds):
        batches = [_some(cells, slice(k, k + size)) for k in range(0, len(cells.begin), size)]
        upper, lower = np.concatenate([_bound(system, carrier, batch) for batch in batches], axis=1)
        if lower.max() > attained:
            attained = float(lower.max())
            time = float(cells.begin[lower.argmax()])
        last = bound
        bound = min(bound, max(closed, float(upper.max())))
        over = upper > (1.0 + gap) * attained
        if bound > (1.0 - gap) * last or not over.any() or _PARTS * over.sum() > most:
            break
        closed = max(closed, float(upper[~over].max(initial=0.0)))
        cells = _cut(_some(cells, over))
    return bound, time


def _some(cells: Cells, which: BoolArray | slice) -> Cells:
    return Cells(*(x[which] for x in cells))


def _bound(system: System, carrier: Carrier, cells: Cells) -> Array:
    """Bound |f_B| over cells from above, and its largest value in each from below, shape (2, n), m/s."""
    moves = carrier.reach(np.linalg.norm(cells.half, axis=2) + cells.bend) + carrier.slide(cells.end - cells.begin)
    q_star = carrier.extend(cells.centre, 0.5 * (cells.begin + cells.end))
    centre = np.linalg.norm(carrier.carry(cells.drift) + carrier.rate - agent_flow(system, q_star), axis=1)
    spread = carrier.spread(cells.spread, agent_slopes(system, q_star, moves), moves)
    upper = centre + spread
    return np.stack([np.where(np.isnan(upper), np.inf, upper), np.nan_to_num(np.maximum(centre - spread, 0.0))])


def _cut(cells: Cells) -> Cells:
    """Cut the segment of each cell into equal parts; bounds of its drift hold in each of them."""
    place = np.tile((np.arange(_PARTS) + 0.5) / _PARTS, len(cells.begin))
    parts = Cells(*(np.repeat(x, _PARTS, axis=0) for x in cells))
    middle = parts.begin + place * (parts.end - parts.begin)
    span = 0.5 / _PARTS * (parts.end - parts.begin)
    return parts._replace(
        begin=middle - span,
        end=middle + span,
        centre=parts.centre + (2.0 * place - 1.0)[:, None, None] * parts.half,
        half=parts.half / _PARTS,
    )


def coarser(cells: Cells, most: int) -> tuple[Array, Array, Array, Array]:
    """Enclose consecutive cells in balls, at most `most` for each target.

    Returns:
        Times from and to which each ball holds its target, shape (S,), s, centres, shape (S, M, 3), m, and radii, shape
        (S, M), m.
    """
    first = np.unique(np.linspace(0, len(cells.begin), min(most, len(cells.begin)), endpoint=False).astype(np.int64))
    wide = np.abs(cells.half) + cells.bend[..., None]
    low = np.minimum.reduceat(cells.centre - wide, first)
    high = np.maximum.reduceat(cells.centre + wide, first)
    centre = 0.5 * (low + high)
    last = np.append(first[1:], len(cells.begin))
    away = np.linalg.norm(cells.centre - np.repeat(centre, last - first, axis=0), axis=2)
    return (
        cells.begin[first],
        cells.end[last - 1],
        centre,
        np.maximum.reduceat(away + np.linalg.norm(cells.half, axis=2) + cells.bend, first) * (1.0 + _ROUNDING),
    )


def agent_flow(system: System, q: Array) -> Array:
    """Return f_q, the flow that agents meet, at stacked agent states (T, n_q), m; stacked, shape (T, n_q), m/s."""
    spread = system.team.unpack(q)
    w = np.zeros_like(spread)
    for field, own in _agents_by_field(system):
        w[:, own] = system.flows[field].velocity(spread[:, own])
    return w.reshape(len(q), -1)[:, system.team.slots[: q.shape[1]]]


def flow_over_periods(system: System, middle: Array, first: int) -> Array:
    """Return the mean of the steady flow and of sines of the disturbance over periods of a run, shape (K, n_q), m/s.

    Args:
        system: The system.
        middle: Stacked states of the agents in the middle of each period, shape (K, n_q), m.
        first: Number of the sample with which the first of the periods begins.
    """
    h = system.grid.period
    harmonics = system.harmonics[: len(system.team.agents)].copy()
    harmonics[..., :3] *= np.sinc(harmonics[..., 3:4] * h / (2.0 * np.pi))  # the mean of a sine over a period
    shaken = evaluate(harmonics, system.grid.span(first, first + len(middle)) + 0.5 * h).reshape(len(middle), -1)
    return agent_flow(system, middle) + shaken[:, system.team.slots[: middle.shape[1]]]


def agent_motion(system: System, time: Array, q: Array, without: tuple[type, ...] = ()) -> Array:
    """Evaluate the moving parts of the medium at the agents, without disturbances.

    Args:
        system: The system.
        time: Times, shape (T,), s.
        q: Stacked states of the agents, shape (T, n_q), m.
        without: Kinds of parts that are left out.

    Returns:
        Velocities, stacked, shape (T, n_q), m/s.
    """
    if not system.moving:
        return np.zeros_like(q)
    N = len(system.team.agents)
    places = np.repeat(system.initial[None], len(q), axis=0)
    places[:, :N] = system.team.unpack(q)
    w = moving_along(undisturbed(system.medium, without), time, places)[:, :N]
    return w.reshape(len(q), -1)[:, system.team.slots[: q.shape[1]]]


def agent_slopes(system: System, q: Array, radii: Array) -> Array:
    """Bound |df_i/dq| over balls of radii (T, N), m, about stacked agent states (T, n_q), m; shape (T, N), 1/s."""
    spread, slopes = system.team.unpack(q), np.empty(radii.shape)
    for field, own in _agents_by_field(system):
        slopes[:, own] = bound_slopes(system.flows[field], spread[:, own], radii[:, own])
    return slopes


def _agents_by_field(system: System) -> list[tuple[int, IntArray]]:
    """Return each flow field that agents meet, and the agents that meet it."""
    fields = system.field[: len(system.team.agents)]
    return [(int(field), np.flatnonzero(fields == field)) for field in np.unique(fields)]


@dataclass(frozen=True, eq=False)
class Tube:
    """Boxes that contain the N agents of a system over S spans of time, by their corners, shape (S, N, 3), m."""

    system: System
    low: Array
    high: Array

    def corners(self) -> tuple[Array, Array]:
        """Return the corners of one box that contains all, shape (3,) each, m."""
        return self.low.min(axis=(0, 1)), self.high.max(axis=(0, 1))

    def joined(self) -> "Tube":
        """Return a tube with one box that contains all, for every agent."""
        low, high = (np.tile(corner, (1, self.low.shape[1], 1)) for corner in self.corners())
        return Tube(self.system, low, high)

    @cached_property
    def slope(self) -> Supremum:
        """rho: the largest Lipschitz constant of the flow that agents meet in their boxes, 1/s."""
        return self._largest(slope=True)

    @cached_property
    def speed(self) -> Supremum:
        """The largest speed of the flow that agents meet in their boxes, without uniform drift, m/s."""
        return self._largest(slope=False)

    def _largest(self, *, slope: bool) -> Supremum:
        system, members, found = self.system, self.system.team.members, []
        kinds = [(int(system.field[i]), members[i].dimension == 2) for i in range(self.low.shape[1])]
        for field, planar in dict.fromkeys(kinds):
            own = [i for i, kind in enumerate(kinds) if kind == (field, planar)]
            boxes = np.unique(np.stack([x[:, own].reshape(-1, 3) for x in (self.low, self.high)], axis=1), axis=0)
            found.append(supremum(system.flows[field], *boxes.swapaxes(0, 1), planar=planar, slope=slope, drift=False))
        return max(found, key=lambda s: s.upper)


class Moving(NamedTuple):
    """Bounds of the moving parts of the medium: see the module.

    Attributes:
        f_bar: Contribution to f_bar, m/s.
        omega_bar: Bound on |Delta| by all parts that are treated as disturbances, m/s.
        slope: Contribution to rho, 1/s.
    """

    f_bar: float
    omega_bar: float
    slope: float


def bound_moving(system: System, path: TargetPath, carrier: Carrier, spectrum: Spectrum, f_bar: float) -> list[Moving]:
    """Bound the moving parts of the medium, each flow in the better way, with and without contributions to rho.

    Args:
        system: The system.
        path: Path of its targets.
        carrier: Its carrier.
        spectrum: Spectrum of H and sigma_max(B).
        f_bar: f_bar by the steady flow, m/s.

    Returns:
        The bounds with contributions to rho, and those without.
    """
    N, V = len(system.team.agents), len(system.field)
    rate = system.gain * spectrum.lambda_min
    pieces, others = _pieces_of(system.moving)
    if path.cells is None or not rate > 0.0:
        pieces, others = (), system.moving
    bounds = np.array([_bound_shared(system, path, carrier, piece) for piece in pieces]).reshape(-1, 2)

    def sharing(shared: list[int]) -> Moving:
        """Bound all parts, with the pieces of these numbers as flows that vehicles share."""
        rest = (*others, *(piece for k, piece in enumerate(pieces) if k not in shared))
        speeds = varying.bounds(system.harmonics) + bounds_of(rest, V).speed
        largest = float((speeds if shared else system.largest_disturbance).max(initial=0.0))
        return Moving(
            float(bounds[shared, 0].sum()),
            disturbance_bound(spectrum.sigma_max_B, spectrum.lambda_min, N, V - N, largest),
            float(bounds[shared, 1].sum()),
        )

    def radius(moving: Moving) -> float:
        """Return the ultimate radius at the best rate, up to a factor, m."""
        left = 0.5 * rate - moving.slope
        return (f_bar + moving.f_bar + moving.omega_bar) / np.sqrt(left) if left > 0.0 else np.inf

    found = []
    for steepest in (np.inf, 0.0):
        shared = list[int]()
        for k in np.flatnonzero(bounds[:, 1] <= steepest).tolist():
            if radius(sharing([*shared, k])) < radius(sharing(shared)):
                shared.append(k)
        found.append(sharing(shared))
    return found


def _pieces_of(parts: Parts) -> tuple[Parts, Parts]:
    """Split parts into pieces that add up to them.

    Returns:
        Pieces that are one continuous flow of time and place for all vehicles that meet them, and all others: gusts,
        files with land, and waves for vehicles in space, which meet them only below the surface.
    """
    shared: list[Any] = []
    others: list[Any] = []
    for part in parts:
        if isinstance(part, VaryingArrays):
            shared.append(part._replace(vortices=part.vortices.select(slice(0))))
            still = part._replace(tide=0.0 * part.tide, ramp=0.0 * part.ramp)
            shared += [
                still._replace(vortices=part.vortices.select(slice(k, k + 1))) for k in range(len(part.vortices.core2))
            ]
        elif isinstance(part, WaveArrays):
            shared.append(part._replace(met=np.where(part.met == 1, 1, 0)))
            others.append(part._replace(met=np.where(part.met == 1, 0, part.met)))
        elif isinstance(part, GridArrays) and np.isfinite(part.grid.velocity).all():
            shared.append(part)
        else:
            others.append(part)
    return tuple(shared), tuple(others)


def _bound_shared(system: System, path: TargetPath, carrier: Carrier, piece: Any) -> tuple[float, float]:
    """Bound a flow that vehicles share: see the module.

    Args:
        system: The system.
        path: Path of its targets, which is known.
        carrier: Its carrier.
        piece: Parameters of the flow.

    Returns:
        sigma S + L D, m/s, and L, 1/s.
    """
    N, n_q, bounds = len(system.team.agents), path.q_star.shape[1], bounds_of((piece,), len(system.field))
    met = (piece.met > 0).astype(np.float64)
    speed, slope = float(bounds.speed.max(initial=0.0)), float(bounds.slope.max(initial=0.0))
    same = np.eye(3)[:, None] * met[:, None]
    own = same[:, :N].reshape(3, -1)[:, system.team.slots[:n_q]]
    sigma = float(np.linalg.norm(carrier.carry(same[:, N:]) - own, ord=2))
    if slope == 0.0:
        return sigma * speed + _ROUNDING * speed, 0.0
    assert path.cells is not None
    begin, end, centre, reach = coarser(path.cells, _MOST_SPANS)
    places = np.concatenate([system.team.unpack(carrier.extend(centre, 0.5 * (begin + end))), centre], axis=1)
    middle = (places * met[:, None]).sum(axis=1) / max(met.sum(), 1.0)
    moved = carrier.reach(reach) + carrier.slide(end - begin)
    away = np.linalg.norm(places - middle[:, None], axis=2) + np.concatenate([moved, reach], axis=1)
    away *= met
    apart = float(carrier.spread(away[:, N:], np.ones_like(away[:, :N]), away[:, :N]).max())
    return (sigma * speed + slope * apart) * (1.0 + _ROUNDING) + _ROUNDING * speed, slope


@dataclass(frozen=True)
class Constants:
    """The constants of a system, except for those of a region.

    Attributes:
        path: Path of the targets, with the harmonic extension along it.
        difference: f_B along the targets' path; its bound is f_bar.
        moving: Bounds of the moving parts of the medium.
        level: The same without contributions to rho, for the bound with rho = 0.
        initial_error: |e(t0)|, m.
    """

    path: TargetPath
    difference: Difference
    moving: Moving
    level: Moving
    initial_error: float

    @property
    def f_bar(self) -> float:
        """Bound on |f_B| along the path, with the flows in time that vehicles share, m/s."""
        return self.difference.bound + self.moving.f_bar


@dataclass(frozen=True)
class Region:
    """Region in which a run stays according to the theory.

    Attributes:
        tube: Boxes that contain the agents.
        source: Argument that confines the agents, or origin of the boxes.
        verified: True if the path is known and the unlimited law provably keeps the agents in the boxes.
        rho: Upper bound on the flow's slope over the tube, 1/s, and its location.
    """

    tube: Tube
    source: str
    verified: bool
    rho: Supremum


def tube_about(
    system: System,
    path: TargetPath,
    carrier: Carrier,
    radius: Callable[[Array], Array],
    *,
    boxes: int = 256,
) -> Tube:
    """Return the tube of a radius, monotone in time, about the harmonic extension along a known path.

    It has about `boxes` boxes at most: one for each agent and span of time, or one for all agents in each span if there
    are more than `boxes` agents.
    """
    assert path.cells is not None
    N = len(system.team.agents)
    begin, end, targets, reach = coarser(path.cells, max(1, min(_MOST_SPANS, boxes // N)))
    centre = system.team.unpack(carrier.extend(targets, 0.5 * (begin + end)))
    wide = np.maximum(radius(begin), radius(end))[:, None] + carrier.reach(reach) + carrier.slide(end - begin)
    low, high = centre - wide[..., None], centre + wide[..., None]
    planar = np.array([agent.dimension == 2 for agent in system.team.agents])
    low[:, planar, 2] = high[:, planar, 2] = 0.0
    tube = Tube(system, low, high)
    return tube.joined() if boxes < N else tube


def tube_guessed(system: System, path: TargetPath, margin: float = 0.5) -> Tube:
    """Return a box around initial positions and q*, widened by a fraction of its size. It proves nothing."""
    N = len(system.team.agents)
    both = np.concatenate([system.initial[None, :N], system.team.unpack(path.q_star)])
    low, high = both.min(axis=(0, 1)), both.max(axis=(0, 1))
    widen = margin * np.maximum(high - low, 1.0)
    widen[2] *= any(agent.dimension == 3 for agent in system.team.agents)
    return Tube(system, *(np.tile(x, (1, N, 1)) for x in (low - widen, high + widen)))


def speed_everywhere(system: System) -> float:
    """Bound the speed of the flow that agents meet anywhere, without uniform drift, m/s."""
    whole = np.full((1, len(system.team.agents), 3), FARTHEST)
    return Tube(system, -whole, whole).speed.upper
