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
`mjsheaf.control.halfspaces`.

If the law's command satisfies all constraints, it does not change by a bit. Which vehicles are within range follows
from positions, for any edges and links of the team: every agent has a separate sensor of this range.
"""

from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.control.halfspaces import nearest_within
from mjsheaf.control.neighbours import Cells, cell_of, new_cells, row_around, sort_into_cells
from mjsheaf.control.obstacles import ObstacleArrays, distance_from
from mjsheaf.jit import inline_jit, jit

CORRECTION, WANTED, CAUSE, VIOLATION = 0, 1, 2, 3
"""Columns of `SafetyMemory.found`."""
_SMALLEST = 1e-6  # share of a direction in an agent's own space, below which the agent cannot act along it
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
        share: Weight of each agent in w_i = share_i / (share_i + share_j), shape (V,).
        yields: True for vehicles that run the filter, shape (V,): present agents.
        speed: Bound on the speed relative to the medium of a vehicle that does not yield, shape (V,), m/s.
        carried: Uniform part of the medium's velocity around each vehicle, shape (V, 3), m/s.
        unsteady: Bound on the remaining velocity of the medium, shape (V,), m/s.
        lift: Offset from a position to the position in space, shape (V, 3), m: the height of planar vehicles.
        planar: True for vehicles that live in the plane, shape (V,).
        right: True if agents that give way turn to their right.
        obstacles: Obstacles.
    """

    agents: int
    radius: Array
    clearance: Array
    reach: float
    rate: float
    period: float
    share: Array
    yields: BoolArray
    speed: Array
    carried: Array
    unsteady: Array
    lift: Array
    planar: BoolArray
    right: bool
    obstacles: ObstacleArrays


class SafetyMemory(NamedTuple):
    """Results of the stage at the last sample, and scratch space; the run does not depend on it.

    Attributes:
        found: Results of each vehicle, shape (V, 4): difference between its limited command and the law's, m/s; the
            law's limited speed, m/s; number, from 1, of the vehicle or obstacle (after the vehicles) whose constraint
            the law violated most, 0 if none; and the violation that had to be accepted, m/s.
        rows: Constraints of one agent: a, c in m/s and the cause, shape (V + K, 5).
        cells: List of cells.
    """

    found: Array
    rows: Array
    cells: Cells


def new_safety_memory(safety: Any, V: int) -> SafetyMemory:
    """Return the memory of V vehicles; empty where there is nothing to keep."""
    if not safety:
        return SafetyMemory(np.zeros((V, 0)), np.zeros((0, 5)), new_cells(0))
    return SafetyMemory(np.zeros((V, 4)), np.zeros((V + len(safety.obstacles.kind), 5)), new_cells(V))


@jit
def keep_apart(stage, law, t, x, memory):
    """Replace commands that bring agents too close to something, unless `stage` is ().

    Args:
        stage: (1,), or () without anything to keep.
        law: Law of the vehicles.
        t: Time, s.
        x: Positions, shape (V, 3), m.
        memory: Memory of the law, with the commands before they are limited.
    """
    if len(stage) == 0:
        return
    safety, work = law.safety, memory.safety
    for v in range(x.shape[0]):
        for i in range(3):
            work.cells.places[v, i] = x[v, i] + safety.lift[v, i]
        for i in range(4):
            work.found[v, i] = 0.0
    if not sort_into_cells(work.cells, safety.reach):
        return
    for v in range(safety.agents):
        if safety.yields[v]:
            count = _constrain(safety, t, v, work)
            if count > 0:
                _give_way(safety, v, count, law.limit[v], memory.command[v], work)


@inline_jit
def is_restrained(stage, work, v):
    """Return True if the command of vehicle v was replaced; False if `stage` is ()."""
    if len(stage) == 0:
        return False
    return work.found[v, CORRECTION] > 0.0


@inline_jit
def _constrain(safety, t, v, work):
    """Write the constraints of agent v, in the order of what causes them, and return how many there are."""
    cells, count = work.cells, 0
    x, y, z = cells.places[v, 0], cells.places[v, 1], cells.places[v, 2]
    cell, listed = cell_of(cells, v), int(cells.listed[v])
    for row in range(9 if listed < 0 else 1):
        first, end = row_around(cells, cell, row) if listed < 0 else (0, listed)
        for k in range(first, end):
            j = int(cells.order[k] if listed < 0 else cells.near[v, k])
            if j != v:
                count = _add_vehicle(safety, v, j, x, y, z, work, count)
    for k in range(safety.obstacles.kind.shape[0]):
        count = _add_obstacle(safety, t, v, k, x, y, z, work, count)
    return count


@inline_jit
def _add_vehicle(safety, v, j, x, y, z, work, count):
    """Add the constraint of agent v against vehicle j, if that is within range."""
    rx = x - work.cells.places[j, 0]
    ry = y - work.cells.places[j, 1]
    rz = z - work.cells.places[j, 2]
    square = rx * rx + ry * ry + rz * rz
    if square > safety.reach * safety.reach:
        return count
    away = np.sqrt(square)
    if away == 0.0:  # on top of one another: the first goes along x, the other the other way
        away = 1e-12
        rx = away if v < j else -away
    D = safety.radius[v] + safety.radius[j]
    square = 0.0
    for i in range(3):
        apart = safety.carried[v, i] - safety.carried[j, i]
        square += apart * apart
    parting = np.sqrt(square) + safety.unsteady[v] + safety.unsteady[j]
    fall = safety.rate * (away * away - D * D) / (2.0 * away)
    if away < _INSIDE * D:
        grown = away * away + safety.period * safety.rate * (D * D - away * away)
        fall = (away - np.sqrt(grown)) / safety.period
    if safety.yields[j]:
        w = safety.share[v] / (safety.share[v] + safety.share[j])
        bound = w * (parting - fall)
    else:
        bound = parting + safety.speed[j] - fall
    return _add(safety, v, j + 1.0, rx / away, ry / away, rz / away, bound, work, count)


@inline_jit
def _add_obstacle(safety, t, v, k, x, y, z, work, count):
    """Add the constraint of agent v against obstacle k, if that is within range."""
    away, nx, ny, nz = distance_from(safety.obstacles, k, t, x, y, z)
    if away > safety.reach:
        return count
    D = safety.clearance[v]
    near = max(away, _INSIDE * D)
    fall = safety.rate * (away - D) * (near + D) / (2.0 * near)
    square = 0.0
    for i in range(3):
        square += safety.carried[v, i] * safety.carried[v, i]
    bound = np.sqrt(square) + safety.unsteady[v] + safety.obstacles.speed[k] - fall
    cause = work.cells.places.shape[0] + k + 1.0
    return _add(safety, v, cause, nx, ny, nz, bound, work, count)


@inline_jit
def _add(safety, v, cause, nx, ny, nz, bound, work, count):
    """Insert the constraint n . u >= bound of agent v by the number of its cause, and return how many there are."""
    if safety.planar[v]:
        nz = 0.0
    if nx * nx + ny * ny + nz * nz < _SMALLEST * _SMALLEST:  # above or below a planar agent, which can do nothing
        work.found[v, VIOLATION] = max(work.found[v, VIOLATION], bound)
        return count
    k = count
    while k > 0 and work.rows[k - 1, 4] > cause:
        for i in range(5):
            work.rows[k, i] = work.rows[k - 1, i]
        k -= 1
    work.rows[k, 0] = nx
    work.rows[k, 1] = ny
    work.rows[k, 2] = nz
    work.rows[k, 3] = bound
    work.rows[k, 4] = cause
    return count + 1


@inline_jit
def _give_way(safety, v, count, limit, command, work):
    """Replace the command of agent v by the nearest that satisfies its constraints, if it violates one."""
    wx, wy, wz = command[0], command[1], command[2]
    worst, largest, aside_x, aside_y = 0.0, -np.inf, 0.0, 0.0
    for k in range(count):
        nx, ny, nz, bound = work.rows[k, 0], work.rows[k, 1], work.rows[k, 2], work.rows[k, 3]
        largest = max(largest, bound)
        short = bound - (nx * wx + ny * wy + nz * wz)
        if short <= 0.0:
            continue
        if short > worst:
            worst = short
            work.found[v, CAUSE] = work.rows[k, 4]
        level = np.sqrt(nx * nx + ny * ny)
        if safety.right and level > _SMALLEST:
            aside_x -= short * ny / level
            aside_y += short * nx / level
    wanted = np.sqrt(wx * wx + wy * wy + wz * wz)
    scale = limit / wanted if wanted > limit else 1.0
    work.found[v, WANTED] = scale * wanted
    if worst == 0.0 and (largest <= 0.0 or wanted <= limit):
        return
    ux, uy, uz, violation = nearest_within(work.rows, count, limit, wx + aside_x, wy + aside_y, wz)
    speed = np.sqrt(ux * ux + uy * uy + uz * uz)
    own = limit / speed if speed > limit else 1.0
    dx, dy, dz = own * ux - scale * wx, own * uy - scale * wy, own * uz - scale * wz
    work.found[v, CORRECTION] = np.sqrt(dx * dx + dy * dy + dz * dz)
    work.found[v, VIOLATION] = max(work.found[v, VIOLATION], violation)
    command[0], command[1], command[2] = ux, uy, uz
