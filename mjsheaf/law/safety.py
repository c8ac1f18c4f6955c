"""Safety filter: a stage of the law that keeps vehicles apart, with a control barrier for each pair within range.

Let z = x_i - x_j, D the distance that the pair must keep, and h = |z|^2 - D^2. Agent i commands the velocity nearest to
the law's that satisfies, for everything within range,

    2 z . u_i >= -w_i gamma h + 2 w_i |z| d        another agent, w_i + w_j = 1, and the same with -z for it
    2 z . u_i >= -gamma h + 2 |z| (s + d)          a target, a lost agent, or an obstacle that moves no faster than s

where d bounds the relative velocity of the media around the two: |w_i - w_j| <= d. For an obstacle, z points from its
nearest point to the agent, and |z| is the distance to its surface.

Theorem. On ideal kinematics with commands held for h_c, gamma h_c <= 1, a pair that satisfies its constraints has
h_(k+1) >= (1 - gamma h_c) h_k. Proof: z(t) = z_k + t (u_i - u_j) + a(t), |a(t)| <= t d. Then |z(t)|^2 >= |z_k|^2
+ 2 z_k . (z(t) - z_k) >= |z_k|^2 + t (2 z_k . (u_i - u_j) - 2 |z_k| d) >= |z_k|^2 - t gamma h_k, because the two
constraints add up to 2 z . (u_i - u_j) >= -gamma h + 2 |z| d. The first step drops a square, so sampling needs no extra
margin. An obstacle is convex: its distance is at least that to the plane through its nearest point, for which the same
holds. Hence h >= 0 from the first sample at which it holds, if no problem is infeasible and no pair crosses from beyond
the range to within D in one period. A pair closer than D / 2 gets a weaker constraint than this one, which grows with
1 / |z|: if the two part at q, |z| grows by h_c q, and (|z| + h_c q)^2 = |z|^2 - gamma h_c h gives q. The speed limit
scales commands, which keeps constraints whose bound is not positive. For the others it is part of the problem: see
`nearest_within`.

Distant vehicles and obstacles impose no constraint. Let q = s + d + |u_law| / w_i, with the largest s, d and 1 / w_i of
any vehicle, and D the largest distance. Beyond r = q / gamma + sqrt((q / gamma)^2 + D^2), gamma (r^2 - D^2) / (2 r) is
above q, and the bound on n . u_i with n = z / |z| is below -|u_law|. The law's command satisfies it, and so does zero.
If all vehicles within range are farther, the command is kept, and no constraint is written.

If the law's command satisfies all constraints, it is kept bit for bit. Which vehicles are within range depends on
positions alone, not on the edges and links of the team: every agent has a separate sensor of this range.

Neighbours are found with a grid. Space is divided into cells at least as wide as the range, so the neighbours of a
vehicle lie in its own cell and those around it. Cells are numbered along x first, and vehicles are sorted by cell, so
the vehicles of three cells in a row are contiguous. There are at most two cells for each vehicle, so the work is
proportional to the number of vehicles.

The nearest velocity u to a desired velocity w in R^3 solves

    minimise |u - w|^2  subject to  a_k . u >= c_k for every k, and |u| <= limit

Constraints are added one at a time. If the nearest velocity under the previous constraints satisfies the next one, it
is kept. If not, the next constraint is active at the new minimum, because the objective is strictly convex. The problem
then reduces to the plane of that constraint, with a second one to a line, and with a third one to a point (Seidel,
Discrete Comput. Geom. 6, 1991). So active sets are found exactly, with at most three constraints.

With a limit, let m >= 0 be the multiplier of |u|^2 <= limit^2. The minimum is the velocity nearest to s w without a
limit, with s = 1 / (1 + m) in (0, 1]. |u| does not decrease with s, so bisection finds it. If c_k <= 0 for all k, zero
is allowed, and the caller may scale u down instead, because the set of allowed velocities is convex.

If no velocity satisfies all constraints, c_k is replaced by c_k - t with the smallest t that makes the problem
feasible: t is the minimum of the largest violation. At this t the set of allowed velocities has no interior: it is a
point where a plane touches the ball, or part of a plane between two that face each other. Rounding decides whether such
a set is found at all, and a ball and a plane that overlap by delta meet in a disc of radius sqrt(2 limit delta), which
has an unbounded derivative at 0. Hence a set that is thinner than `_THICKNESS` is made that thick: t is the smallest
one plus `_THICKNESS`, or 0 if that is negative. The minimum is then a Lipschitz function of the constraints.
"""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from mjsheaf.arrays import Array, BoolArray, Take
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.errors import InputError
from mjsheaf.law.obstacles import AnyObstacle, ObstacleArrays, distance_from, pack_obstacles
from mjsheaf.section import Positive, Section
from mjsheaf.vectors import square_of, subtract, triple

_FARTHEST = 1e10  # m; positions beyond it are a blow-up, which is reported elsewhere
_USUAL = 4.0  # mean distances from the middle, within which cells end
_ROUNDING = 1e-12  # fraction by which cells are wider, because a product may round up
_GROWTH = 1.25  # of the cells' width until there are few enough
_FEW = 32  # vehicles that lie in one cell, which is quicker than several


class Cells(NamedTuple):
    """A grid of cells. All of its arrays are scratch space; results do not depend on their previous contents.

    Whole numbers are stored as float64, because these arrays are parts of the one array of a run.

    Attributes:
        places: Positions of all vehicles in one space, shape (V, 3), m.
        corner: Smallest coordinates of the grid, shape (3,), m.
        shape: Number of cells along each axis, and number of cells per metre, 1/m, shape (4,).
        cell: Number of each vehicle's cell, shape (V,).
        start: Index in `order` at which the vehicles of each cell begin, shape (2 V + 1,).
        order: Vehicles sorted by cell, and in a cell by number, shape (V,).
        sorted: Positions in this order, shape (V, 3), m.
        found: Vehicles near one vehicle, not in order, shape (V,).
    """

    places: Array
    corner: Array
    shape: Array
    cell: Array
    start: Array
    order: Array
    sorted: Array
    found: Array


def new_cells(V: int, take: Take = np.zeros) -> Cells:
    """Return a grid with room for V vehicles; all arrays are empty if V is 0."""
    some = V > 0
    return Cells(
        places=take((V, 3)),
        corner=take(3 * some),
        shape=take(4 * some),
        cell=take(V),
        start=take((2 * V + 1) * some),
        order=take(V),
        sorted=take((V, 3)),
        found=take(V),
    )


@inline_jit
def _lay_out(cells, reach):
    """Choose the width of the cells and their number along each axis; return False for positions that blew up.

    Vehicles far from all others are assigned to the outermost cells, because otherwise they would make all cells wide.
    """
    V, shape = cells.places.shape[0], cells.shape
    for axis in range(3):
        lowest, highest, total, away = np.inf, -np.inf, 0.0, 0.0
        for v in range(V):
            x = cells.places[v, axis]
            if not abs(x) <= _FARTHEST:
                return False
            lowest = min(lowest, x)
            highest = max(highest, x)
            total += x
        middle = total / V
        for v in range(V):
            away += abs(cells.places[v, axis] - middle)
        usual = _USUAL * away / V
        cells.corner[axis] = max(lowest, middle - usual)
        shape[axis] = max(min(highest, middle + usual) - cells.corner[axis], 0.0)
    width = np.inf if V <= _FEW else max(reach, 1e-3)
    while _cells_along(shape, 0, width) * _cells_along(shape, 1, width) * _cells_along(shape, 2, width) > 2.0 * V:
        width *= _GROWTH
    for axis in range(3):
        shape[axis] = _cells_along(shape, axis, width)
    shape[3] = (1.0 - _ROUNDING) / width
    return True


@inline_jit
def _cells_along(extent, axis, width):
    return np.floor(extent[axis] / width) + 1.0


@inline_jit
def _place_along(cells, axis, value):
    """Return the number of the cell along an axis that holds a coordinate, or the nearest one."""
    place = (value - cells.corner[axis]) * cells.shape[3]
    return int(min(max(place, 0.0), cells.shape[axis] - 1.0))


@jit
def sort_into_cells(cells, reach):
    """Sort the vehicles at `cells.places` into cells.

    Args:
        cells: The grid, with the present places.
        reach: Distance within which neighbours are to be found, m.

    Returns:
        False if a position is not a number or huge.
    """
    if not _lay_out(cells, reach):
        return False
    V, start = cells.places.shape[0], cells.start
    count = int(cells.shape[0] * cells.shape[1] * cells.shape[2])
    for c in range(count + 1):
        start[c] = 0.0
    for v in range(V):
        x, y, z = triple(cells.places[v])
        row = _place_along(cells, 2, z) * int(cells.shape[1]) + _place_along(cells, 1, y)
        cell = row * int(cells.shape[0]) + _place_along(cells, 0, x)
        cells.cell[v] = cell
        start[cell] += 1.0
    for c in range(count):
        start[c + 1] += start[c]
    for v in range(V - 1, -1, -1):  # so that each cell's vehicles keep their order, and `start` ends where they begin
        cell = int(cells.cell[v])
        start[cell] -= 1.0
        k = int(start[cell])
        cells.order[k] = v
        for i in range(3):
            cells.sorted[k, i] = cells.places[v, i]
    return True


@inline_jit
def find_near(cells, v, reach, near):
    """Write the numbers of the vehicles within `reach` of vehicle v to `near`, in order, and return how many there are.

    The vehicles are sorted by `sort_into_cells` for this reach.
    """
    own, count, farthest = triple(cells.places[v]), 0, reach * reach
    column, line, layer = _place_along(cells, 0, own[0]), _place_along(cells, 1, own[1]), _place_along(cells, 2, own[2])
    wide, high, deep = int(cells.shape[0]), int(cells.shape[1]), int(cells.shape[2])
    for k in range(max(layer - 1, 0), min(layer + 2, deep)):
        for j in range(max(line - 1, 0), min(line + 2, high)):
            row = (k * high + j) * wide
            first, end = cells.start[row + max(column - 1, 0)], cells.start[row + min(column + 2, wide)]
            for n in range(int(first), int(end)):  # without a branch, which would be mispredicted
                cells.found[count] = cells.order[n]
                within = square_of(subtract(own, triple(cells.sorted[n]))) <= farthest
                count += within & (cells.order[n] != v)
    for n in range(count):
        m = n
        while m > 0 and near[m - 1] > cells.found[n]:
            near[m] = near[m - 1]
            m -= 1
        near[m] = cells.found[n]
    return count


CORRECTION, WANTED, CAUSE, VIOLATION = 0, 1, 2, 3
"""Columns of `SafetyMemory.found`."""
_SMALLEST = 1e-6  # fraction of a direction in an agent's own space, below which the agent cannot act along it
_CLEARLY = 1e-9  # fraction by which one squared distance exceeds another, despite rounding
_INSIDE = 0.5  # fraction of the required distance, below which the constraint is weakened


class SafetyArrays(NamedTuple):
    """Parameters of the safety filter for V vehicles and K obstacles.

    Attributes:
        agents: Number of agents, which are the first of the vehicles.
        radius: Contribution of each vehicle to the distance that a pair keeps, shape (V,), m: D = radius_i + radius_j.
        clearance: Distance that each vehicle keeps to obstacles, shape (V,), m.
        reach: Range of the agents' sensors, m.
        rate: gamma, 1/s.
        period: Time for which commands are held, s; 1 / gamma if the law is continuous.
        pairing: Data of each vehicle for the constraint of a pair, shape (V, 3): its radius, m; its weight in
            w_i = share_i / (share_i + share_j), 0 if it does not yield; and a bound on its speed, m/s, which is that
            of the remaining medium, plus that relative to the medium if it does not yield.
        yields: True for vehicles that run the filter, shape (V,): present agents.
        carried: Uniform part of the medium's velocity around each vehicle, shape (V, 3), m/s.
        unsteady: Bound on the remaining velocity of the medium, shape (V,), m/s.
        lift: Offset from a position to the position in space, shape (V, 3), m: the height of planar vehicles.
        planar: True for vehicles that live in the plane, shape (V,).
        closing: Bound on the speed at which vehicles that do not yield, and the media, close in on each agent, shape
            (V,), m/s.
        burden: 1 / w_i of each agent for the smallest w_i, shape (V,).
        widest: Largest radius, m.
        uniform: True if the uniform part of the medium's velocity is the same around all vehicles.
        right: True if agents that give way turn to their right.
        obstacles: Obstacles.
    """

    agents: int
    radius: Array
    clearance: Array
    reach: float
    rate: float
    period: float
    pairing: Array
    yields: BoolArray
    carried: Array
    unsteady: Array
    lift: Array
    planar: BoolArray
    closing: Array
    burden: Array
    widest: float
    uniform: bool
    right: bool
    obstacles: ObstacleArrays


class Safety(Section):
    """Fields of the safety filter; see `mjsheaf.law.safety`."""

    distance: Positive | Literal["size"] = Field(
        description="between the positions of any two vehicles of which one is an agent, and from an agent to the "
        "surface of an obstacle; `size`: spheres about the vehicles do not touch each other or an obstacle [m]"
    )
    range: Positive | None = Field(
        None,
        description="within which agents see other vehicles and obstacles, by a sensor of its own; as far as the "
        "filter can act unless given [m]",
    )
    rate: Positive = Field(1.0, description="largest rate gamma at which h = |z|^2 - distance^2 may fall [1/s]")
    authority: Literal["equal", "by_speed"] = Field(
        "equal", description="by_speed: of two agents, the faster one gives way more, in proportion to velocity_limit"
    )
    tie_break: Literal["none", "right_hand"] = Field(
        "none", description="right_hand: an agent turns what the filter takes off its speed to the right"
    )
    obstacles: list[AnyObstacle] = Field(default_factory=list, description="what agents keep away from too")

    @property
    def obstacle_ids(self) -> list[str]:
        """Name of each obstacle."""
        return [one.id or f"{one.kind}_{k}" for k, one in enumerate(self.obstacles, 1)]

    @model_validator(mode="after")
    def _named_once(self) -> "Safety":
        ids = self.obstacle_ids
        for k, id in enumerate(ids):
            if id in ids[:k]:
                raise ValueError(f"obstacles.{k}.id: there is another obstacle {id!r}; expected a unique name")
        return self


def pack_safety(
    safety: Safety,
    *,
    ids: Sequence[str],
    planar: BoolArray,
    height: float,
    limit: Array,
    yields: BoolArray,
    radius: Array,
    margin: Array,
    speed: Array,
    carried: Array,
    unsteady: Array,
    period: float,
    start: float,
    end: float,
) -> SafetyArrays:
    """Pack the section `safety` for V vehicles, for compiled code.

    Args:
        safety: The section.
        ids: Ids of the agents.
        planar: True for vehicles that live in the plane, shape (V,).
        height: Height of planar vehicles, m.
        limit: Largest commanded speed of each vehicle, shape (V,), m/s.
        yields: True for present agents, shape (V,).
        radius: Radius of each vehicle, shape (V,), m; used if `distance` is 'size'.
        margin: Addition to the distance for each vehicle, shape (V,), m.
        speed: Bound on the speed relative to the medium of a vehicle that does not yield, shape (V,), m/s.
        carried, unsteady: Velocity of the medium around each vehicle; see `SafetyArrays`.
        period: Time for which commands are held, s.
        start, end: Start and end time of the run, s.

    Raises:
        InputError: The range is missing, and an agent has no velocity limit from which it follows; or the motion of an
            obstacle does not fit. The message begins with the field.
    """
    V = len(planar)
    own = radius if safety.distance == "size" else np.full(V, 0.5 * float(safety.distance))
    padded = own + margin
    obstacles = pack_obstacles(safety.obstacles, height, start, end)
    lift = np.zeros((V, 3))
    lift[planar, 2] = height
    shares = np.ones(V)
    for v, id in enumerate(ids if safety.authority == "by_speed" else []):
        if not np.isfinite(limit[v]):
            raise InputError(f"safety.authority: {id} has no velocity_limit; expected one, or authority equal")
        shares[v] = limit[v] if yields[v] else 1.0
    stirred = np.linalg.norm(carried - carried[0], axis=1) + unsteady
    moving = np.where(yields, 0.0, speed)
    clearance = (own if safety.distance == "size" else 2.0 * own) + margin
    if safety.range is None:
        limits = {id: limit[v] for v, id in enumerate(ids) if yields[v]}
        others = max(speed.max(initial=0.0), obstacles.speed.max(initial=0.0))
        flows = np.linalg.norm(carried, axis=1).max(initial=0.0) + unsteady.max(initial=0.0)
        D = max(2.0 * float(padded.max()), float(clearance.max()))
        reach = _farthest(limits, others, flows, D, safety.rate, period)
    else:
        reach = safety.range + 2.0 * float(margin.max())
    return SafetyArrays(
        agents=len(ids),
        radius=padded,
        clearance=clearance,
        reach=reach,
        rate=safety.rate,
        period=period or 1.0 / safety.rate,
        pairing=np.column_stack([padded, shares * yields, unsteady + moving]),
        yields=yields,
        carried=carried,
        unsteady=unsteady,
        lift=lift,
        planar=planar,
        closing=stirred + stirred.max() + moving.max(),
        burden=1.0 + shares.max() / shares,
        widest=float(padded.max()),
        uniform=bool((carried == carried[0]).all()),
        right=safety.tie_break == "right_hand",
        obstacles=obstacles,
    )


def _farthest(limits: dict[str, float], others: float, flows: float, D: float, rate: float, period: float) -> float:
    """Return the distance beyond which the filter changes no command that is within the velocity limits, m.

    The bound of a constraint at distance r is at most q - gamma (r^2 - D^2) / (2 r), taken as a whole for a pair, with
    q the fastest at which two vehicles can close in.

    Args:
        limits: Velocity limit of each present agent, m/s.
        others: Largest speed of what does not yield, m/s.
        flows: Largest speed of the medium, m/s.
        D: Largest distance that is kept, m.
        rate: gamma, 1/s.
        period: Time for which commands are held, s.

    Raises:
        InputError: An agent has no velocity limit.
    """
    for id, limit in limits.items():
        if not np.isfinite(limit):
            raise InputError(f"safety.range: {id} has no velocity_limit from which a range follows; expected either")
    closing = 2.0 * max(limits.values(), default=0.0) + others + 2.0 * flows
    settled = closing / rate
    return float(max(settled + np.hypot(settled, D), D + closing * period))


class SafetyMemory(NamedTuple):
    """Results of the stage at the last sample, and scratch space; the run does not depend on it.

    Attributes:
        found: Results of each vehicle, shape (V, 4): difference between its limited command and the law's, m/s; the
            law's limited speed, m/s; number, from 1, of the vehicle or obstacle (after the vehicles) whose constraint
            the law violated most, 0 if none; and the violation that had to be accepted, m/s.
        rows: Constraints of one agent: a, c in m/s, and the number of the cause from 0, shape (V + K, 5).
        close: Vehicles within range of one agent, shape (V,).
        cells: Grid of cells.
    """

    found: Array
    rows: Array
    close: Array
    cells: Cells


def new_safety_memory(safety: Any, V: int, take: Take) -> SafetyMemory:
    """Return the memory of V vehicles; empty without a safety filter."""
    if not safety:
        return SafetyMemory(take((V, 0)), take((0, 5)), take(0), new_cells(0, take))
    rows = V + len(safety.obstacles.kind)
    return SafetyMemory(take((V, 4)), take((rows, 5)), take(V), new_cells(V, take))


@jit
def keep_apart(safety, limit, t, x, memory):
    """Replace commands that bring agents too close to something, unless `safety` is ().

    Args:
        safety: Parameters of the filter; () without one.
        limit: Largest commanded speed of each vehicle, shape (V,), m/s.
        t: Time, s.
        x: Positions, shape (V, 3), m.
        memory: Memory of the law, with the commands before they are limited.
    """
    if len(safety) == 0:
        return
    work = memory.safety
    for v in range(x.shape[0]):
        for i in range(3):
            work.cells.places[v, i] = x[v, i] + safety.lift[v, i]
        for i in range(4):
            work.found[v, i] = 0.0
    if not sort_into_cells(work.cells, safety.reach):
        return
    for v in range(safety.agents):
        if safety.yields[v]:
            _filter(safety, t, v, limit[v], memory.command[v], work)


@inline_jit
def is_restrained(safety, work, v):
    """Return True if the command of vehicle v was replaced; False if `safety` is ()."""
    if len(safety) == 0:
        return False
    return work.found[v, CORRECTION] > 0.0


@inline_jit
def _filter(safety, t, v, limit, command, work):
    """Replace the command of agent v by the nearest that satisfies its constraints, if it violates one."""
    wanted = np.sqrt(square_of(triple(command)))
    count, square = _find_close(safety, v, work)
    D = safety.radius[v] + safety.widest
    settled = safety.rate * (square * (1.0 - _CLEARLY) - D * D)
    obstacles = safety.obstacles.kind.shape[0]
    if obstacles == 0 and settled > 2.0 * np.sqrt(square) * (safety.closing[v] + wanted * safety.burden[v]):
        if count > 0:
            work.found[v, WANTED] = limit / wanted * wanted if wanted > limit else wanted
        return
    inside = square <= _INSIDE * _INSIDE * D * D * (1.0 + _CLEARLY)
    own, planar = triple(safety.pairing[v]), safety.planar[v]
    for k in range(count):
        _face_vehicle(safety, v, own, planar, inside, work.rows[k], work)
    for k in range(obstacles):
        count = _add_obstacle(safety, t, v, k, work, count)
    if count > 0:
        _give_way(safety, v, count, limit, wanted, command, work)


@inline_jit
def _find_close(safety, v, work):
    """Write the vehicles within range of agent v to work.rows, in their order: relative position, its square, number.

    Returns:
        The number of vehicles, and the squared distance of the nearest, m^2; infinite if there is none.
    """
    count, least, own = find_near(work.cells, v, safety.reach, work.close), np.inf, triple(work.cells.places[v])
    for k in range(count):
        other = work.close[k]
        rx, ry, rz = subtract(own, triple(work.cells.places[np.uint64(int(other))]))
        square = rx * rx + ry * ry + rz * rz
        row = work.rows[np.uint64(k)]
        row[0] = rx
        row[1] = ry
        row[2] = rz
        row[3] = square
        row[4] = other
        least = min(least, square)
    return count, least


@inline_jit
def _face_vehicle(safety, v, own, planar, inside, row, work):
    """Turn the row of a vehicle within range into the constraint of agent v against it.

    Args:
        own: Row of agent v in safety.pairing.
        planar: True if agent v lives in the plane.
        inside: True if a vehicle may be closer than half the distance to keep.
    """
    square, j = row[3], int(row[4])
    if inside and square == 0.0:  # at the same position: the first vehicle is pushed along x, the other along -x
        row[0] = 1e-12 if v < j else -1e-12
        square = row[0] * row[0]
    away = np.sqrt(square)
    inverse = 1.0 / away
    radius, share, speed = triple(safety.pairing[np.uint64(j)])
    D = own[0] + radius
    parting = own[2] + speed
    if not safety.uniform:
        parting += np.sqrt(square_of(subtract(triple(safety.carried[v]), triple(safety.carried[j]))))
    fall = 0.5 * safety.rate * (square - D * D) * inverse
    if inside and away < _INSIDE * D:
        grown = square + safety.period * safety.rate * (D * D - square)
        fall = (away - np.sqrt(grown)) / safety.period
    weight = 0.5 if share == own[1] else own[1] / (own[1] + share)  # exactly a half for equal shares
    nx, ny, nz = row[0] * inverse, row[1] * inverse, row[2] * inverse
    _write(planar, v, nx, ny, nz, weight * (parting - fall), row, work)


@inline_jit
def _add_obstacle(safety, t, v, k, work, count):
    """Add the constraint of agent v against obstacle k, if that is within range, and return how many there are."""
    x, y, z = triple(work.cells.places[v])
    away, nx, ny, nz = distance_from(safety.obstacles, k, t, x, y, z)
    if away > safety.reach:
        return count
    D = safety.clearance[v]
    near = max(away, _INSIDE * D)
    fall = safety.rate * (away - D) * (near + D) / (2.0 * near)
    bound = np.sqrt(square_of(triple(safety.carried[v]))) + safety.unsteady[v] + safety.obstacles.speed[k] - fall
    work.rows[count, 4] = work.cells.places.shape[0] + k
    _write(safety.planar[v], v, nx, ny, nz, bound, work.rows[count], work)
    return count + 1


@inline_jit
def _write(planar, v, nx, ny, nz, bound, row, work):
    """Write the constraint n . u >= bound of agent v."""
    if planar:
        nz = 0.0
        if nx * nx + ny * ny < _SMALLEST * _SMALLEST:  # above or below a planar agent, which cannot act along n
            work.found[v, VIOLATION] = max(work.found[v, VIOLATION], bound)
            nx, ny, bound = 0.0, 0.0, -np.inf
    row[0] = nx
    row[1] = ny
    row[2] = nz
    row[3] = bound


@inline_jit
def _shortfall(rows, k, x, y, z):
    """Compute the amount by which a velocity violates constraint k, m/s; negative if it satisfies it."""
    return rows[k, 3] - (rows[k, 0] * x + rows[k, 1] * y + rows[k, 2] * z)


@inline_jit
def _give_way(safety, v, count, limit, desired, command, work):
    """Replace the command of agent v, of size `desired`, m/s, by the nearest that satisfies `count` constraints."""
    wx, wy, wz = command[0], command[1], command[2]
    worst, largest, cause, first = 0.0, -np.inf, 0.0, 0
    for k in range(count):
        short = _shortfall(work.rows, k, wx, wy, wz)
        largest = max(largest, work.rows[k, 3])
        if short > worst:
            worst = short
            cause = work.rows[k, 4] + 1.0
            first = k
    for i in range(4):  # the most violated constraint is usually active, and few others are violated at its minimum
        work.rows[first, i], work.rows[0, i] = work.rows[0, i], work.rows[first, i]
    scale = limit / desired if desired > limit else 1.0
    work.found[v, CAUSE] = cause
    work.found[v, WANTED] = scale * desired
    if worst == 0.0 and (largest <= 0.0 or desired <= limit):
        return
    if largest > 0.0 and desired > limit and (worst == 0.0 or not safety.right):
        most = -np.inf
        for k in range(count):
            most = max(most, _shortfall(work.rows, k, scale * wx, scale * wy, scale * wz))
        if most <= 0.0:  # then this is the nearest velocity: the law's command, scaled to the speed limit
            return
    aside_x, aside_y = 0.0, 0.0
    for k in range(count if safety.right else 0):
        short = _shortfall(work.rows, k, wx, wy, wz)
        level = np.sqrt(work.rows[k, 0] * work.rows[k, 0] + work.rows[k, 1] * work.rows[k, 1])
        if short > 0.0 and level > _SMALLEST:
            aside_x -= short * work.rows[k, 1] / level
            aside_y += short * work.rows[k, 0] / level
    ux, uy, uz, violation = nearest_within(work.rows, count, limit, wx + aside_x, wy + aside_y, wz)
    speed = np.sqrt(ux * ux + uy * uy + uz * uz)
    own = limit / speed if speed > limit else 1.0
    dx, dy, dz = own * ux - scale * wx, own * uy - scale * wy, own * uz - scale * wz
    work.found[v, CORRECTION] = np.sqrt(dx * dx + dy * dy + dz * dz)
    work.found[v, VIOLATION] = max(work.found[v, VIOLATION], violation)
    command[0], command[1], command[2] = ux, uy, uz


_SLACK = 1e-13  # m/s, for velocities and bounds of about 1: a constraint is violated beyond it
_PARALLEL = 1e-20  # square of the sine of the angle between two planes, below which they do not meet
_THICKNESS = 1e-10  # m/s, for bounds of about 1; far above _SLACK
_BISECTIONS = 60


@inline_jit
def _lacks(rows, k, shift, x, y, z):
    """Return the shortfall of constraint k at a velocity, m/s, minus rounding; positive if it is violated."""
    short = rows[k, 3] - shift - (rows[k, 0] * x + rows[k, 1] * y + rows[k, 2] * z)
    if short <= 0.0:
        return short
    return short - _SLACK * (1.0 + abs(rows[k, 3]) + abs(x) + abs(y) + abs(z))


@jit
def _on_line(rows, k, j, shift, wx, wy, wz):
    """Return the velocity nearest to w with constraints k and j active under those before j; False if there is none."""
    ax, ay, az = rows[k, 0], rows[k, 1], rows[k, 2]
    bx, by, bz = rows[j, 0], rows[j, 1], rows[j, 2]
    lx, ly, lz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    aa, bb = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
    across = lx * lx + ly * ly + lz * lz
    if across <= _PARALLEL * aa * bb:
        return False, wx, wy, wz
    step = (rows[k, 3] - shift - (ax * wx + ay * wy + az * wz)) / aa
    x, y, z = wx + step * ax, wy + step * ay, wz + step * az
    # On from there within plane k, along l x a: without the cancellation of the normal equations.
    step = (rows[j, 3] - shift - (bx * x + by * y + bz * z)) / across
    x, y, z = x + step * (ly * az - lz * ay), y + step * (lz * ax - lx * az), z + step * (lx * ay - ly * ax)
    for i in range(j):
        if _lacks(rows, i, shift, x, y, z) <= 0.0:
            continue
        ix, iy, iz = rows[i, 0], rows[i, 1], rows[i, 2]
        along = ix * lx + iy * ly + iz * lz
        if along * along <= _PARALLEL * across * (ix * ix + iy * iy + iz * iz):
            return False, x, y, z
        step = (rows[i, 3] - shift - (ix * x + iy * y + iz * z)) / along
        x, y, z = x + step * lx, y + step * ly, z + step * lz
        for earlier in range(i):
            if _lacks(rows, earlier, shift, x, y, z) > 0.0:
                return False, x, y, z
    return True, x, y, z


@jit
def _in_plane(rows, k, shift, wx, wy, wz):
    """Return the velocity nearest to w with constraint k active under those before it; False if there is none."""
    ax, ay, az = rows[k, 0], rows[k, 1], rows[k, 2]
    square = ax * ax + ay * ay + az * az
    if square == 0.0:
        return False, wx, wy, wz
    step = (rows[k, 3] - shift - (ax * wx + ay * wy + az * wz)) / square
    x, y, z = wx + step * ax, wy + step * ay, wz + step * az
    for j in range(k):
        if _lacks(rows, j, shift, x, y, z) > 0.0:
            found, x, y, z = _on_line(rows, k, j, shift, wx, wy, wz)
            if not found:
                return False, x, y, z
    return True, x, y, z


@jit
def nearest(rows, count, shift, wx, wy, wz):
    """Return the velocity nearest to w under constraints, without a limit.

    Args:
        rows: a_k and c_k of each constraint, shape (>= count, >= 4), c_k in m/s.
        count: Number of constraints.
        shift: Amount subtracted from every c_k, m/s.
        wx, wy, wz: The velocity w, m/s.

    Returns:
        True if there is such a velocity, and its components, m/s.
    """
    x, y, z = wx, wy, wz
    for k in range(count):
        if _lacks(rows, k, shift, x, y, z) > 0.0:
            found, x, y, z = _in_plane(rows, k, shift, wx, wy, wz)
            if not found:
                return False, x, y, z
    return True, x, y, z


@jit
def _is_feasible(rows, count, shift, limit):
    """Return True if a velocity within the limit satisfies the constraints, each less `shift`."""
    found, x, y, z = nearest(rows, count, shift, 0.0, 0.0, 0.0)
    return found and x * x + y * y + z * z <= limit * limit * (1.0 + _SLACK)


@jit
def nearest_within(rows, count, limit, wx, wy, wz):
    """Return the velocity nearest to w under the constraints, and the violation.

    The limit applies if some c_k > 0. If no c_k is positive, the velocity may exceed the limit, because it still
    satisfies the constraints when it is scaled down.

    Args:
        rows, count, wx, wy, wz: See `nearest`.
        limit: Largest speed, m/s; may be infinite.

    Returns:
        The components of the velocity, and the minimum of the largest violation, m/s: 0 unless the constraints are
        infeasible.
    """
    found, x, y, z = nearest(rows, count, 0.0, wx, wy, wz)
    largest = -np.inf
    for k in range(count):
        largest = max(largest, rows[k, 3])
    if found and (largest <= 0.0 or x * x + y * y + z * z <= limit * limit):
        return x, y, z, 0.0
    shift, violation, thickness = 0.0, 0.0, _THICKNESS * (1.0 + abs(largest))
    if not _is_feasible(rows, count, -thickness, limit):
        low, high = -thickness, max(largest, 0.0)  # at the upper end, zero satisfies all
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if _is_feasible(rows, count, middle, limit):
                high = middle
            else:
                low = middle
        violation = max(high, 0.0)
        shift = high + thickness
    found, x, y, z = nearest(rows, count, shift, wx, wy, wz)
    if found and x * x + y * y + z * z <= limit * limit:
        return x, y, z, violation
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        share = 0.5 * (low + high)
        found, x, y, z = nearest(rows, count, shift, share * wx, share * wy, share * wz)
        if found and x * x + y * y + z * z <= limit * limit:
            low = share
        else:
            high = share
    found, x, y, z = nearest(rows, count, shift, low * wx, low * wy, low * wz)
    return x, y, z, violation
