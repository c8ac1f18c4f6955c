"""Allocation for boats with one-sided thrusters.

The efforts of such a boat form a convex set U. Scaling the desired wrench w down fails if its direction leaves U
immediately: two propellers that cannot reverse produce no yaw moment without thrust ahead. Instead, with W the wrenches
of efforts on the rows surge, sway and yaw, the efforts are those in U that

    1. produce the yaw moment nearest to the desired one,
    2. given that, produce the force nearest to the desired one,
    3. given both, are the smallest,

If w is feasible, the efforts produce it up to 1e-8 of what the thrusters make at most. If not, they produce up to 1e-8,
or 1e-4 with thrusters that turn, the wrench that is nearest where each row is divided by its norm, and the square of
yaw counts 1e5 times. So yaw differs from that of 1 by at most 1/300 of what the force lacks, in these units. This holds
for wrenches of up to 10,000 times what the thrusters make; where lever arms are almost the same, up to 1e-4.

The dual problem yields them: u = P(W' y), the point of U nearest to W' y, where y minimises a convex function with the
gradient W P(W' y) - w. y has three components whatever the number of thrusters. Each round minimises that function plus
(y - y0)' E (y - y0) / 2 by semismooth Newton steps, where y0 is the y of the previous round and E holds small weights,
the smallest for yaw (method of multipliers, Rockafellar, Math. Oper. Res. 1976). If most thrusters are at a limit, the
minimum is far away and the function almost flat. Therefore the weights fall from round to round, as far as rounding
allows, and the rounds gain ever more: most w need two or three, and many only where lever arms are almost the same. No
memory is allocated.

Control effectiveness g_i(q, t) of an ideal agent: full row rank, and possibly more inputs than states.

g(q, t) = R(psi(q, t)) W: a thruster layout W fixed in a frame whose heading psi = psi_0 + psi_q . q + psi_t t depends
on position and time. R turns about z. As R is a rotation, g^+ = W^+ R^T, and g has full row rank where W has.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.errors import InputError
from mjsheaf.section import Matrix, Number, Point, Section
from mjsheaf.vectors import subtract, triple
from mjsheaf.vehicles.actuators import ANGLE, FIXED, WEAK_SIDE

_FORCE_WEIGHT, _YAW_SHARE = 1e-3, 1e-5  # first weight in E for force; that for yaw, which has priority, as a part of it
_ROUNDS = 200  # maximum rounds of the method of multipliers
_NEWTON_STEPS, _LINE_STEPS = 30, 60  # maximum numbers of steps
_ACCURACY = 1e-9  # relative accuracy of the wrench
_FAR = 1e9  # an effort that exceeds every limit


@inline_jit
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline_jit
def _size(a):
    return abs(a[0]) + abs(a[1]) + abs(a[2])


@inline_jit
def _plus(a, share, b):
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@jit
def nearest_effort(channels, k, a, b):
    """Find the effort of actuator k that is nearest to (a, b); b is used if it has an angle.

    The efforts of an azimuth thruster that is one-sided and turns by less than 180 degrees form a sector of a disc. For
    any other, the whole disc is used.

    Args:
        channels: CHANNELs of one vehicle, shape (s,).
        k: First channel of the actuator.
        a: First component of the effort, N.
        b: Second component of the effort, N.

    Returns:
        Both components of the effort, and three derivatives: the first component by a and by b, the second by b.
    """
    low, high = channels[k].low, channels[k].high
    if channels[k].code == FIXED:
        return min(max(a, low), high), b, 1.0 if low <= a <= high else 0.0, 0.0, 0.0
    strong, weak = max(high, -low), min(high, -low)
    first, last = channels[k + 1].low, channels[k + 1].high
    size = np.sqrt(a * a + b * b)
    middle, half = 0.5 * (first + last), 0.5 * (last - first)
    sector = weak < WEAK_SIDE * strong and 2.0 * half < np.pi
    if sector:
        sign = 1.0 if high >= -low else -1.0
        x, y = sign * np.cos(middle), sign * np.sin(middle)
        along, across = x * a + y * b, x * b - y * a
        cosine, sine = np.cos(half), np.sin(half)
        if along * sine < abs(across) * cosine or along < 0.0:  # beyond an edge
            sine = np.copysign(sine, across)
            t = along * cosine + across * sine
            within = 1.0 if 0.0 < t < strong else 0.0
            t = min(max(t, 0.0), strong)
            x, y = x * cosine - y * sine, y * cosine + x * sine
            return t * x, t * y, within * x * x, within * x * y, within * y * y
    if size <= strong:
        return a, b, 1.0, 0.0, 1.0
    share = strong / size
    x, y = a / size, b / size
    return share * a, share * b, share * y * y, -share * x * y, share * x * x


@jit
def _make_wrench(channels, y, effort):
    """Write the efforts P(W' y) for a dual variable y, and compute W P(W' y), their planar wrench."""
    made, last = (0.0, 0.0, 0.0), channels.shape[0] - 1
    for k in range(last + 1):
        if channels[k].code != ANGLE:
            one, other = triple(channels[k].planar), triple(channels[min(k + 1, last)].planar)
            effort[k], b, _, _, _ = nearest_effort(channels, k, _dot(one, y), _dot(other, y))
            made = _plus(made, effort[k], one)
            if channels[k].code != FIXED:
                effort[k + 1] = b
                made = _plus(made, b, other)
    return made


@jit
def _newton_step(channels, y, residual, weight):
    """Solve (W P' W' + E) d = -residual for d, by L D L'."""
    xx, yy, nn = weight, weight, _YAW_SHARE * weight
    xy = xn = yn = 0.0
    last = channels.shape[0] - 1
    for k in range(last + 1):
        if channels[k].code != ANGLE:
            p, q = triple(channels[k].planar), triple(channels[min(k + 1, last)].planar)
            _, _, aa, ab, bb = nearest_effort(channels, k, _dot(p, y), _dot(q, y))
            f = aa * p[0] + ab * q[0], aa * p[1] + ab * q[1], aa * p[2] + ab * q[2]
            g = ab * p[0] + bb * q[0], ab * p[1] + bb * q[1], ab * p[2] + bb * q[2]
            xx += p[0] * f[0] + q[0] * g[0]
            xy += p[0] * f[1] + q[0] * g[1]
            xn += p[0] * f[2] + q[0] * g[2]
            yy += p[1] * f[1] + q[1] * g[1]
            yn += p[1] * f[2] + q[1] * g[2]
            nn += p[2] * f[2] + q[2] * g[2]
    a, b = xy / xx, xn / xx
    second = max(yy - a * xy, weight)  # it is at least that, but for rounding
    mixed = yn - a * xn
    c = mixed / second
    third = max(nn - b * xn - c * mixed, _YAW_SHARE * weight)
    x = -residual[0]
    v = -residual[1] - a * x
    n = (-residual[2] - b * x - c * v) / third
    v = v / second - c * n
    return x / xx - a * v - b * n, v, n


@jit
def _line_search(channels, wrench, y, start, weight, step, slope, effort):
    """Follow a step to its end, or until the slope of the dual function, at first `slope`, has fallen to 1e-4 of it.

    With a larger fraction, steps would zigzag between limits of efforts if the wrench is far away.

    Returns:
        The y there, and W P(W' y) + E (y - start) - wrench, which is zero at the solution of a round.
    """
    low, high, at_low, at_high, share = 0.0, np.inf, slope, 0.0, 1.0
    point, residual = y, (0.0, 0.0, 0.0)
    for j in range(_LINE_STEPS):
        point = _plus(y, share, step)
        missed, moved = subtract(_make_wrench(channels, point, effort), wrench), subtract(point, start)
        residual = _plus(missed, weight, (moved[0], moved[1], _YAW_SHARE * moved[2]))
        now = _dot(residual, step)
        if abs(now) <= 1e-4 * abs(slope) or (now < 0.0 and high == np.inf):
            break
        if now > 0.0:
            high, at_high = share, now
        else:
            low, at_low = share, now
        share = 0.5 * (low + high) if j % 2 == 1 else low - (high - low) * at_low / (at_high - at_low)
    return point, residual


@jit
def allocate_nearest(channels, scale, force, yaw, effort):
    """Compute the efforts of a boat, within their limits, that come nearest to a force and a yaw moment.

    Args:
        channels: CHANNELs of one vehicle, shape (s,).
        scale: Norms of the rows surge, sway and yaw of W, 0 for a row that is not commanded, (3,).
        force: Desired force, body axes, (3,), N.
        yaw: Desired yaw moment, N m.
        effort: Output array of efforts, shape (s,).
    """
    x = force[0] / scale[0] if scale[0] > 0.0 else 0.0
    y = force[1] / scale[1] if scale[1] > 0.0 else 0.0
    n = yaw / scale[2] if scale[2] > 0.0 else 0.0
    far = np.copysign(_FAR, n)
    most = _make_wrench(channels, (0.0, 0.0, far), effort)[2]  # what the actuators produce together, that way
    wrench = x, y, min(n, most) if far > 0.0 else max(n, most)
    accuracy = _ACCURACY * (1e-3 + _size(wrench))  # nothing depends on less than 1e-12 N
    zero = 0.0 if accuracy < np.inf else accuracy  # what is not finite stays, to be seen
    dual, weight = (zero, zero, zero), _FORCE_WEIGHT
    residual = subtract(_make_wrench(channels, dual, effort), wrench)
    for _ in range(_ROUNDS):
        start, before = dual, residual
        for _ in range(_NEWTON_STEPS):
            if not _size(residual) > accuracy:
                break
            step = _newton_step(channels, dual, residual, weight)
            dual, residual = _line_search(channels, wrench, dual, start, weight, step, _dot(residual, step), effort)
        residual = subtract(_make_wrench(channels, dual, effort), wrench)
        if not _size(residual) > accuracy:
            return
        # What is missing, r = w - W u, is E d with d = y - y0. The slope of the dual function along d rises to the one
        # far away, where W u goes as far along d as efforts allow. So if it stays negative there, all efforts leave at
        # least last/slope of r, in the norm of E^-1. If it stays the same, and so did r, all u on the ray are the same,
        # and the rounds would go along it for ever. The slope alone does not tell: it may change only by the square of
        # what W u changes by.
        d = subtract(dual, start)
        point, slope = _plus(dual, _FAR * max(1.0, 1.0 / _size(d)), d), _dot(residual, d)
        last = _dot(subtract(_make_wrench(channels, point, effort), wrench), d)
        if last <= (1.0 - 1e-12) * slope and not _size(subtract(residual, before)) > accuracy:
            break
        # The weights fall if at least half of r may be made. If not, y grows for ever, and its rounding with it: they
        # fall while the next d is below 1e5 times the wrench, where both engines still make the same of it.
        if last > 0.5 * slope or _size(d) < 1e4 * _size(_plus(residual, 1.0, wrench)):
            weight *= 0.1
    _make_wrench(channels, dual, effort)


RANK_TOLERANCE = 1e-9
"""A singular value of g at most this much of the largest counts as zero."""


class EffectivenessArrays(NamedTuple):
    """Layouts of all agents, padded: W (N, 3, s), pinv (N, s, 3), heading (N, 5): psi_0, psi_q (3), psi_t.

    `given` (N,) marks the agents that have one; the others have g = I. `inputs` (N,) is each one's number s of inputs.
    """

    given: BoolArray
    inputs: IntArray
    W: Array
    pinv: Array
    heading: Array


class ControlEffectiveness(Section):
    """g(q, t) = R(psi) layout with psi = heading + gradient . q + rate t; ideal backend."""

    layout: Matrix = Field(
        description="W, one row for each coordinate, one column for each input [m/s per unit of input]"
    )
    heading: Number = Field(0.0, description="psi_0 [degrees]")
    heading_gradient: Point | None = Field(None, description="psi_q [degrees/m]")
    heading_rate: Number = Field(0.0, description="psi_t [degrees/s]")


@jit
def allocate(effectiveness, i, q, t, velocity, u):
    """Write u = g^+(q, t) velocity of agent i into u (s,), then g(q, t) u back into velocity (3,)."""
    h = effectiveness.heading[i]
    psi = h[0] + h[1] * q[0] + h[2] * q[1] + h[3] * q[2] + h[4] * t
    c, s = np.cos(psi), np.sin(psi)
    bx, by, bz = c * velocity[0] + s * velocity[1], c * velocity[1] - s * velocity[0], velocity[2]
    P, W = effectiveness.pinv[i], effectiveness.W[i]
    bx2, by2, bz2 = 0.0, 0.0, 0.0
    for k in range(P.shape[0]):
        u[k] = P[k, 0] * bx + P[k, 1] * by + P[k, 2] * bz
        bx2 += W[0, k] * u[k]
        by2 += W[1, k] * u[k]
        bz2 += W[2, k] * u[k]
    velocity[0], velocity[1], velocity[2] = c * bx2 - s * by2, s * bx2 + c * by2, bz2


def pack(models: list[ControlEffectiveness | None], dimensions: list[int]) -> EffectivenessArrays:
    """Pack the agents' models (None: g = I) into arrays.

    Raises:
        InputError: a layout has rows of unequal length or the wrong number of them.
    """
    N = len(models)
    width = max([3, *(len(g.layout[0]) for g in models if g is not None)])
    arrays = EffectivenessArrays(
        np.zeros(N, dtype=np.bool_),
        np.array(dimensions, dtype=np.int64),
        np.zeros((N, 3, width)),
        np.zeros((N, width, 3)),
        np.zeros((N, 5)),
    )
    for i, (g, n) in enumerate(zip(models, dimensions, strict=True)):
        if g is None:
            arrays.W[i, :n, :n] = arrays.pinv[i, :n, :n] = np.eye(n)
            continue
        if len({len(row) for row in g.layout}) != 1 or len(g.layout) != n:
            raise InputError(f"control effectiveness must have {n} rows of equal length")
        W = np.asarray(g.layout, dtype=np.float64)
        s = W.shape[1]
        arrays.given[i], arrays.inputs[i] = True, s
        arrays.W[i, :n, :s], arrays.pinv[i, :s, :n] = W, np.linalg.pinv(W)
        arrays.heading[i, 0], arrays.heading[i, 4] = np.deg2rad(g.heading), np.deg2rad(g.heading_rate)
        if g.heading_gradient is not None:
            if len(g.heading_gradient) != n:
                raise InputError(f"heading gradient has {len(g.heading_gradient)} entries; expected {n}")
            arrays.heading[i, 1 : 1 + n] = np.deg2rad(g.heading_gradient)
    return arrays


def without_full_row_rank(arrays: EffectivenessArrays, dimensions: list[int]) -> list[int]:
    """Numbers of the agents whose layout is not of full row rank (Assumption 2): g g^+ = I fails for them."""
    given = np.flatnonzero(arrays.given).tolist()  # others have g = I
    singular = [np.linalg.svd(arrays.W[i, : dimensions[i]], compute_uv=False) for i in given]
    return [i for i, sigma in zip(given, singular, strict=True) if is_rank_deficient(sigma)]


def is_rank_deficient(singular: NDArray[np.floating]) -> bool:
    """Return True if singular values, largest first, show that g lacks full row rank, relative to the largest."""
    return bool(singular[-1] <= RANK_TOLERANCE * singular[0])
