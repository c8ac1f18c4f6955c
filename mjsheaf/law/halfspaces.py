"""Velocity nearest to a desired one under linear inequalities and a speed limit, in R^3, for compiled code.

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

import numpy as np

from mjsheaf.compile.jit import inline_jit, jit

_ROUNDING = 1e-13  # m/s, for velocities and bounds of about 1: a constraint is violated beyond it
_PARALLEL = 1e-20  # square of the sine of the angle between two planes, below which they do not meet
_THICKNESS = 1e-10  # m/s, for bounds of about 1; far above _ROUNDING
_BISECTIONS = 60


@inline_jit
def _lacks(rows, k, shift, x, y, z):
    """Return by how much constraint k falls short at a velocity, m/s, less rounding; positive where it is violated."""
    short = rows[k, 3] - shift - (rows[k, 0] * x + rows[k, 1] * y + rows[k, 2] * z)
    if short <= 0.0:
        return short
    return short - _ROUNDING * (1.0 + abs(rows[k, 3]) + abs(x) + abs(y) + abs(z))


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
        shift: What is taken off every c_k, m/s.
        wx, wy, wz: The velocity w, m/s.

    Returns:
        True if there is one, and its components, m/s.
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
    return found and x * x + y * y + z * z <= limit * limit * (1.0 + _ROUNDING)


@jit
def nearest_within(rows, count, limit, wx, wy, wz):
    """Return the velocity nearest to w under the constraints, and the violation.

    The limit applies if some c_k > 0. If no c_k is positive, the velocity may exceed the limit, because it still
    satisfies the constraints when it is scaled down.

    Args:
        rows, count, wx, wy, wz: As for `nearest`.
        limit: Largest speed, m/s; may be infinite.

    Returns:
        Its components, and the smallest possible largest violation, m/s: 0 unless the constraints are infeasible.
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
