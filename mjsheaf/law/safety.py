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
`mjsheaf.law.halfspaces`.

What is far is not in the way. Let q = s + d + |u_law| / w_i, with the largest s, d and 1 / w_i of any vehicle, and D
the largest distance. Beyond r = q / gamma + sqrt((q / gamma)^2 + D^2), gamma (r^2 - D^2) / (2 r) > q, and the bound
on n . u_i with n = z / |z| is below -|u_law|. The law's command satisfies it, and so does zero. If all vehicles
within range are farther, the command stays, and no constraint is written.

If the law's command satisfies all constraints, it does not change by a bit. Which vehicles are within range follows
from positions, for any edges and links of the team: every agent has a separate sensor of this range.
"""

from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray, Take
from mjsheaf.jit import inline_jit, jit
from mjsheaf.law.halfspaces import nearest_within
from mjsheaf.law.neighbours import Cells, find_near, new_cells, sort_into_cells
from mjsheaf.law.obstacles import ObstacleArrays, distance_from
from mjsheaf.vehicles.vectors import square_of, subtract, triple

CORRECTION, WANTED, CAUSE, VIOLATION = 0, 1, 2, 3
"""Columns of `SafetyMemory.found`."""
_SMALLEST = 1e-6  # share of a direction in an agent's own space, below which the agent cannot act along it
_CLEARLY = 1e-9  # fraction by which a squared distance exceeds another one, whatever was rounded
_INSIDE = 0.5  # of the distance to keep: closer than that, bounds stay finite


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
    """Return the memory of V vehicles; empty where there is nothing to keep."""
    if not safety:
        return SafetyMemory(take((V, 0)), take((0, 5)), take(0), new_cells(0, take))
    rows = V + len(safety.obstacles.kind)
    return SafetyMemory(take((V, 4)), take((rows, 5)), take(V), new_cells(V, take))


@jit
def keep_apart(safety, limit, t, x, memory):
    """Replace commands that bring agents too close to something, unless `safety` is ().

    Args:
        safety: Parameters of the filter; () without anything to keep.
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
    """Write the vehicles within range of agent v to work.rows, in their order; see `_write_near`.

    Returns:
        Their number, and the squared distance of the nearest, m^2; infinite if there is none.
    """
    count, least, own = find_near(work.cells, v, safety.reach, work.close), np.inf, triple(work.cells.places[v])
    for k in range(count):
        least = min(least, _write_near(work, own, work.close[k], k))
    return count, least


@inline_jit
def _write_near(work, own, other, k):
    """Write an agent's place relative to a vehicle to row k, with the squared distance, and return that, m^2."""
    rx, ry, rz = subtract(own, triple(work.cells.places[np.uint64(int(other))]))
    square = rx * rx + ry * ry + rz * rz
    row = work.rows[np.uint64(k)]
    row[0] = rx
    row[1] = ry
    row[2] = rz
    row[3] = square
    row[4] = other
    return square


@inline_jit
def _face_vehicle(safety, v, own, planar, inside, row, work):
    """Turn the row of a vehicle within range into the constraint of agent v against it.

    Args:
        own: Row of agent v in safety.pairing.
        planar: True if agent v lives in the plane.
        inside: True if a vehicle may be closer than half the distance to keep.
    """
    square, j = row[3], int(row[4])
    if inside and square == 0.0:  # on top of one another: the first goes along x, the other the other way
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
    weight = 0.5 if share == own[1] else own[1] / (own[1] + share)  # the same to a bit, most often
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
        if nx * nx + ny * ny < _SMALLEST * _SMALLEST:  # above or below the agent, which can do nothing
            work.found[v, VIOLATION] = max(work.found[v, VIOLATION], bound)
            nx, ny, bound = 0.0, 0.0, -np.inf
    row[0] = nx
    row[1] = ny
    row[2] = nz
    row[3] = bound


@inline_jit
def _shortfall(rows, k, x, y, z):
    """Compute by how much a velocity violates constraint k, m/s; negative if it satisfies it."""
    return rows[k, 3] - (rows[k, 0] * x + rows[k, 1] * y + rows[k, 2] * z)


@inline_jit
def _give_way(safety, v, count, limit, wanted, command, work):
    """Replace the command of agent v, whose size is `wanted`, by the nearest that satisfies `count` constraints."""
    wx, wy, wz = command[0], command[1], command[2]
    worst, largest, cause, first = 0.0, -np.inf, 0.0, 0
    for k in range(count):
        short = _shortfall(work.rows, k, wx, wy, wz)
        largest = max(largest, work.rows[k, 3])
        if short > worst:
            worst = short
            cause = work.rows[k, 4] + 1.0
            first = k
    for i in range(4):  # it is active most often, and few others are violated where it is
        work.rows[first, i], work.rows[0, i] = work.rows[0, i], work.rows[first, i]
    scale = limit / wanted if wanted > limit else 1.0
    work.found[v, CAUSE] = cause
    work.found[v, WANTED] = scale * wanted
    if worst == 0.0 and (largest <= 0.0 or wanted <= limit):
        return
    if largest > 0.0 and wanted > limit and (worst == 0.0 or not safety.right):
        most = -np.inf
        for k in range(count):
            most = max(most, _shortfall(work.rows, k, scale * wx, scale * wy, scale * wz))
        if most <= 0.0:  # then this is the nearest one, and the speed limit applies to the law's command as it is
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
