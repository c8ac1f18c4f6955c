"""Bounds of a flow field's speed and slope, rigorous up to rounding: over boxes, and quickly over balls along a path.

Branch and bound. A box is cut into cells. A bound over each cell limits the supremum from above, and the field's value
at points inside limits it from below. Cells whose bound exceeds (1 + tolerance) times the best value found are cut
again, those with the largest bounds first.

A kernel is written in the n = 2 or 3 coordinates of the vehicle: r is the offset from its centre and u = |r|^2. For a
vehicle in the plane, the other coordinates are constants of the kernel. There are two kinds of kernel:

- a pole, g (M r + v) / s^p with s = u + C, k = u / s, m = |M|. A source has M = 1, v = 0, p = 1 (in space 1.5); a
  vortex has M = [axis]_x, p = 1. A vehicle in a plane at offset h from the centre of a kernel in space sees
  C = core^2 + h^2, and of a vortex M = a_z [z]_x and v = h (a_y, -a_x).

      |f|   <= |g| (m u^(1/2) + |v|) / s^p
      |J|   <= |g| (m max(1 / s^p, ((2p - 1) u - C) / s^(p+1)) + 2p |v| u^(1/2) / s^(p+1))
      |D2f| <= |g| (m min(2p max((2 / (p+1))^(1/2), k^(1/2) (2(p+1) k - 3)) / s^(p+1/2), 6p u^(1/2) / s^(p+1))
                    + 2p |v| max(1, 2(p+1) k - 1) / s^(p+1))

  J of r / s^p has the eigenvalues 1 / s^p across r and (C - (2p - 1) u) / s^(p+1) along it. Its derivative is a
  symmetric trilinear form, so its norm is the largest |D2(e, e, e)| = 2p u^(1/2) |t| |2(p+1) k t^2 - 3| / s^(p+1)
  over unit vectors e, with t the cosine between e and r. It is attained at t = 1 or at t^2 = 1 / (2(p+1) k).
- a channel, b E d with E = exp(-A |n|^2 - B l^2), l = r . d, n = r - l d, and q = 2A n + 2B l d: |f| <= |b d| E,
  |J| <= |b d| E |q|, |D2f| <= |b d| E max(|q|^2, 2A, 2B), as E has the Hessian E (q q^T - 2A N - 2B d d^T) with
  N = 1 - d d^T.

There are three bounds over a cell, and the smallest is used. First, every term is monotone in u, |n| or |l| or has one
peak there, so the ranges of these over a cell bound it, and the sum of the kernels' bounds bounds the field. Second,
with the tangent at the cell's centre and the half diagonal a, |f| <= max over corners |f + J delta| + |D2f| a^2 / 2 and
|J| <= |J(centre)| + |D2f| a. Third, the strongest kernel is bounded in the first way and all others in the second.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arrays import Array
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.media.flow import (
    ACROSS,
    ALONG,
    AXIS,
    CENTRE,
    CHANNEL,
    CORE2,
    KIND,
    NOTHING_LEFT,
    SOURCE,
    SPACE,
    STRENGTH,
    VORTEX,
    FlowField,
    channel_place,
    in_space,
)
from mjsheaf.vectors import triple

_ROUNDING = 1e-12  # of the sum of all kernels' bounds
_TWO_OVER_E = 2.0 / math.e


@dataclass(frozen=True, eq=False)
class Supremum:
    """Bounds of the supremum of a field's speed (m/s) or slope (1/s) over a box.

    Attributes:
        upper: Upper bound over the box. `upper` and `seen` are infinite if the box contains the centre of a kernel
            without a core.
        seen: Value attained at `where`, so the supremum lies in [seen, upper].
        where: Point, shape (2,) for a planar vehicle, else that of the box's corners, m; read-only.
        exact: True if upper <= (1 + tolerance) seen; if not, the largest number of cells was reached, and upper is
            still a bound.
    """

    upper: float
    seen: float
    where: Array
    exact: bool


def singular_points(flow: FlowField, *, planar: bool) -> Array:
    """Find the points where a vehicle's field is not C^1, the centres of kernels without core, (k, 2) or (k, 3), m."""
    return _Kernels(flow.table, flow.dimension, 2 if planar or flow.dimension == 2 else 3, drift=False).singular


def supremum(
    flow: FlowField,
    low: ArrayLike,
    high: ArrayLike,
    *,
    planar: bool,
    slope: bool = False,
    drift: bool = True,
    tolerance: float = 0.02,
    most_cells: int = 50_000,
) -> Supremum:
    """Bound the supremum of the speed |w(x)|, m/s, or the slope |dw/dx|, 1/s, over a box or the union of several.

    The slope is the Jacobian's spectral norm; its supremum is the field's Lipschitz constant.

    Args:
        flow: The field.
        low: Lowest corner of the box, shape (2,) or (3,), m, or those of k boxes, shape (k, 2) or (k, 3). A planar
            vehicle needs two numbers, and a third is not used; in space three are needed unless the field is planar.
        high: Highest corner, same shape, finite and not below `low`; a box may be a point.
        planar: True if the vehicle lives in the plane: points are (x, y, 0), and only the x and y of w count.
        slope: True for the slope, False for the speed.
        drift: True to include the uniform drift, which has no slope.
        tolerance: Desired gap between upper and seen, relative to seen.
        most_cells: Largest number of cells; if it is reached, the tolerance is not met.

    Returns:
        Bounds of the supremum. If all kernels have zero strength, both are |drift| for the speed and 0 for the slope.
    """
    boxes = tuple(tuple(map(tuple, np.atleast_2d(corner).tolist())) for corner in (low, high))
    return _supremum(
        tuple(map(tuple, flow.table.tolist())), flow.dimension, boxes, planar, slope, drift, tolerance, most_cells
    )


Rows = tuple[tuple[float, ...], ...]
"""A matrix that can be hashed."""


@lru_cache(16)  # runs of a study mostly need the same bounds
def _supremum(
    table: Rows,
    dimension: int,
    boxes: tuple[Rows, ...],
    planar: bool,
    slope: bool,
    drift: bool,
    tolerance: float,
    most_cells: int,
) -> Supremum:
    """Bound the supremum for the table of a flow; see `supremum`."""
    low, high = map(np.array, boxes)
    n = 2 if planar or dimension == 2 else 3
    a, b = low[:, :n], high[:, :n]
    kernels = _Kernels(np.array(table), dimension, n, drift and not slope)

    def result(upper: float, seen: float, at: Array) -> Supremum:
        where = np.concatenate([at, 0.5 * (low + high)[0, n:]])[: 2 if planar else None]
        where.flags.writeable = False
        return Supremum(upper, seen, where, upper <= (1.0 + tolerance) * seen)

    if not kernels.count:
        value = float(np.linalg.norm(kernels.drift))
        return result(value, value, 0.5 * (a + b)[0])
    for centre in _inside(kernels.singular, a, b):
        return result(np.inf, np.inf, centre)
    return result(*_search(kernels, a, b, slope, tolerance, most_cells))


def _search(
    kernels: "_Kernels",
    low: Array,
    high: Array,
    slope: bool,
    tolerance: float,
    most_cells: int,
    *,
    size: int = 1024,  # cells that are cut at once: enough to hide numpy's overhead, few enough to stay best-first
    pairs: int = 500_000,  # pairs of a cell and a kernel computed at once: some 150 MB
) -> tuple[float, float, Array]:
    """Cut boxes into cells until the bound is tight; return a bound, the largest value found, and its point (n,)."""
    n = low.shape[1]
    points = kernels.candidates()
    centres = 0.5 * (low + high)
    halves = 0.5 * (high - low)
    # With one box, points outside are moved to the nearest point of it; with several, they are left out.
    points = np.clip(points, low, high) if len(low) == 1 else np.concatenate([_inside(points, low, high), centres])
    values = kernels.values(points, slope)
    seen, at = float(values.max()), points[np.argmax(values)]
    closed, bounded, batch = 0.0, 0, int(np.clip(pairs / (kernels.count * 2**n), 1, size))

    def bound(c: Array, h: Array) -> Array:
        nonlocal seen, at, bounded
        values, found = kernels.bounds(c, h, slope)
        if values.max() > seen:
            seen, at = float(values.max()), c[np.argmax(values)]
        bounded += len(c)
        return found

    uppers = np.concatenate([bound(centres[k : k + batch], halves[k : k + batch]) for k in range(0, len(low), batch)])
    while True:
        # Cells that need no cut, or are as small as rounding lets them be.
        done = (uppers <= (1.0 + tolerance) * seen) | (halves.max(axis=1) <= 1e-14 * np.abs(centres).max(axis=1))
        closed = max(closed, float(uppers[done].max(initial=0.0)))
        centres, halves, uppers = centres[~done], halves[~done], uppers[~done]
        if not len(uppers) or bounded >= most_cells:
            break
        order = np.argsort(-uppers, kind="stable")
        now, later = order[:batch], order[batch:]
        c, h, parents = centres[now], halves[now], uppers[now]
        for _ in range(n):
            c, h, parents = _cut(c, h, parents)
        centres, halves = np.concatenate([centres[later], c]), np.concatenate([halves[later], h])
        uppers = np.concatenate([uppers[later], np.minimum(bound(c, h), parents)])
    return max(closed, seen, float(uppers.max(initial=0.0))), seen, at


def _inside(points: Array, low: Array, high: Array) -> Array:
    """Return those of the points (k, n) that lie in one of the boxes."""
    return points[[bool(np.any(np.all((low <= p) & (p <= high), axis=1))) for p in points]]


def _cut(centres: Array, halves: Array, uppers: Array) -> tuple[Array, Array, Array]:
    """Halve each cell along its longest side."""
    longest = np.arange(len(halves)), np.argmax(halves, axis=1)
    halves = halves.copy()
    halves[longest] *= 0.5
    step = np.zeros_like(halves)
    step[longest] = halves[longest]
    return np.concatenate([centres - step, centres + step]), np.tile(halves, (2, 1)), np.tile(uppers, 2)


class _Kernels:
    """The field's kernels in n coordinates, evaluated and bounded over many cells at once.

    Attributes:
        drift: Uniform velocity in the vehicle's n coordinates, shape (n,), m/s; zero if it is not included.
        count: Number of kernels, poles before channels; those of zero strength are left out.
        centre: Centres of the kernels, shape (count, n), m.
        singular: Centres of poles without a core, where they are infinite, shape (k, n), m.
    """

    def __init__(self, table: Array, dimension: int, n: int, drift: bool) -> None:
        self.n, space = n, dimension == 3
        self.drift = table[0, CENTRE : CENTRE + n] if drift else np.zeros(n)
        kernels = table[1:]
        sources, vortices, channels = (kernels[kernels[:, KIND] == kind] for kind in (SOURCE, VORTEX, CHANNEL))
        vortices = vortices[np.any(vortices[:, AXIS:STRENGTH] != 0.0, axis=1)]
        poles, axis = np.concatenate([sources, vortices]), vortices[:, AXIS:STRENGTH]
        is_vortex = np.arange(len(poles)) >= len(sources)
        self.centre = np.concatenate([poles, channels])[:, CENTRE : CENTRE + n]
        self.count, self._poles = len(self.centre), len(poles)

        # Poles: strength (M r + v) / (|r|^2 + C)^p.
        # Height of the plane over the kernel's centre.
        height = -poles[:, CENTRE + 2] if space and n == 2 else np.zeros(len(poles))
        self._strength, self._C = poles[:, STRENGTH], poles[:, CORE2] + height**2
        self._p = np.where(is_vortex | (not space), 1.0, 1.5)
        self._M, self._v = np.tile(np.eye(n), (len(poles), 1, 1)), np.zeros((len(poles), n))
        self._M[is_vortex] = np.cross(np.eye(3), axis[:, None])[:, :n, :n]  # M r = axis x r
        if n == 2:
            self._v[is_vortex] = height[is_vortex, None] * axis[:, [1, 0]] * [1.0, -1.0]
        self._m, self._shift = np.ones(len(poles)), np.linalg.norm(self._v, axis=1)
        self._m[is_vortex] = np.linalg.norm(axis, axis=1) if n == 3 else np.abs(axis[:, 2])
        self.singular = self.centre[: len(poles)][self._C <= 1e-60]  # a core below 1e-30 m is none

        # Channels: strength exp(-A |n|^2 - B l^2) d, projected onto the plane of a planar vehicle.
        self._push = channels[:, STRENGTH, None] * channels[:, AXIS : AXIS + n]
        self._d, self._A, self._B = channels[:, AXIS:STRENGTH], channels[:, ACROSS], channels[:, ALONG]
        self._channel_centre = channels[:, CENTRE:AXIS]

    def candidates(self) -> Array:
        """Return points where the supremum may be, shape (k, n), m: kernels' centres, and their peaks around them."""
        # A pole is fastest on a sphere; the velocity of the others at its centre gives the point where they add.
        across = np.sqrt(self._C / (2.0 * self._p - 1.0))
        with np.errstate(divide="ignore", invalid="ignore"):  # at poles without a core
            w = self.evaluate(self.centre[: self._poles])[0].sum(axis=1) + self.drift
        w[~np.isfinite(w)] = 0.0
        wanted = np.sign(self._strength)[:, None] * np.einsum("kji,kj->ki", self._M, w)
        length = np.linalg.norm(wanted, axis=1, keepdims=True)
        aligned = across[:, None] * np.divide(wanted, length, out=np.zeros_like(wanted), where=length > 0.0)
        reach = np.concatenate([across, np.sqrt(0.5 / self._A)])
        stencil = np.concatenate([np.zeros((1, self.n)), np.eye(self.n), -np.eye(self.n)])
        around = self.centre[:, None] + reach[:, None, None] * stencil
        return np.concatenate([around.reshape(-1, self.n), self.centre[: self._poles] + aligned])

    def values(self, points: Array, slope: bool) -> Array:
        """Return the speed, m/s, or the Jacobian's norm, 1/s, at points (k, n), shape (k,)."""
        w, J = self.evaluate(points)
        return _norm(J.sum(axis=1)) if slope else np.linalg.norm(w.sum(axis=1) + self.drift, axis=1)

    def evaluate(self, points: Array) -> tuple[Array, Array]:
        """Return each kernel's velocity (k, count, n), m/s, and Jacobian (k, count, n, n), 1/s, at points (k, n), m."""
        r = points[:, None] - self.centre[: self._poles]
        s = np.einsum("kpi,kpi->kp", r, r) + self._C
        a = self._strength * s**-self._p
        f = np.einsum("pij,kpj->kpi", self._M, r) + self._v
        J = a[..., None, None] * (self._M - ((2.0 * self._p / s)[..., None] * f)[..., None] * r[..., None, :])
        _, _, exponent, q = self._channel_parts(points)
        g = np.exp(-exponent)[..., None] * self._push
        return np.concatenate([a[..., None] * f, g], 1), np.concatenate([J, -g[..., None] * q[..., None, :]], 1)

    def bounds(self, centres: Array, halves: Array, slope: bool) -> tuple[Array, Array]:
        """Return values at the centres (k, n) of cells with half sides (k, n), and bounds over the cells, each (k,)."""
        a = np.linalg.norm(halves, axis=1)
        w, J = self.evaluate(centres)
        poles, channels = self._pole_bounds(centres, halves, slope), self._channel_bounds(centres, halves, a, slope)
        largest, curvature = (np.concatenate(both, axis=1) for both in zip(poles, channels, strict=True))
        w_all, J_all, curvature_all = w.sum(axis=1) + self.drift, J.sum(axis=1), curvature.sum(axis=1)
        rows, strongest = np.arange(len(centres)), np.argmax(largest, axis=1)
        w_rest, J_rest = w_all - w[rows, strongest], J_all - J[rows, strongest]
        curvature_rest = curvature_all - curvature[rows, strongest]
        apart = largest.sum(axis=1) + np.linalg.norm(self.drift)
        top = largest[rows, strongest]
        if slope:
            values = _norm(J_all)
            together = values + curvature_all * a
            mixed = top + _norm(J_rest) + curvature_rest * a
        else:
            values = np.linalg.norm(w_all, axis=1)
            together = _tangent(w_all, J_all, halves) + 0.5 * curvature_all * a**2
            mixed = top + _tangent(w_rest, J_rest, halves) + 0.5 * curvature_rest * a**2
        bounds = np.fmin(np.fmin(apart, together), mixed) + _ROUNDING * apart
        return values, np.where(np.isnan(bounds), np.inf, bounds)

    def _pole_bounds(self, centres: Array, halves: Array, slope: bool) -> tuple[Array, Array]:
        """Bound speed or slope, and the second derivative, of each pole over each cell, shapes (k, P)."""
        p, C, m, v = self._p, self._C, self._m, self._shift
        r = np.abs(centres[:, None] - self.centre[: self._poles])
        near = np.square(np.maximum(r - halves[:, None], 0.0)).sum(axis=-1)
        far = np.square(r + halves[:, None]).sum(axis=-1)
        s = near + C
        k = far / (far + C)

        def peak(at: Array, power: Array) -> Array:
            """Return the supremum of u^(1/2) / s^power, which has one peak, at `at`."""
            u = np.clip(at, near, far)
            return np.sqrt(u) * (u + C) ** -power

        bend = peak(C / (2.0 * p + 1.0), p + 1.0)
        steep = s ** -(p + 0.5) * np.maximum(np.sqrt(2.0 / (p + 1.0)), np.sqrt(k) * (2.0 * (p + 1.0) * k - 3.0))
        curvature = m * 2.0 * p * np.minimum(steep, 3.0 * bend)
        curvature += v * 2.0 * p * s ** -(p + 1.0) * np.maximum(1.0, 2.0 * (p + 1.0) * k - 1.0)
        if slope:
            u = np.clip(3.0 * C / (2.0 * p - 1.0), near, far)
            largest = m * np.maximum(s**-p, ((2.0 * p - 1.0) * u - C) * (u + C) ** -(p + 1.0)) + 2.0 * p * v * bend
        else:
            largest = m * peak(C / (2.0 * p - 1.0), p) + v * s**-p
        return np.abs(self._strength) * largest, np.abs(self._strength) * curvature

    def _channel_parts(self, points: Array) -> tuple[Array, Array, Array, Array]:
        """Return |l|, |n| and the exponent A |n|^2 + B l^2 of each channel, (k, c) each, and its gradient (k, c, n)."""
        r = np.repeat(-self._channel_centre[None], len(points), axis=0)
        r[..., : self.n] += points[:, None]
        along = np.einsum("kci,ci->kc", r, self._d)
        across = r - along[..., None] * self._d
        far = np.linalg.norm(across, axis=-1)
        q = 2.0 * (self._A[:, None] * across + (self._B * along)[..., None] * self._d)[..., : self.n]
        return np.abs(along), far, self._A * far**2 + self._B * along**2, q

    def _channel_bounds(self, centres: Array, halves: Array, a: Array, slope: bool) -> tuple[Array, Array]:
        """Bound speed or slope, and the second derivative, of each channel over each cell, shapes (k, c)."""
        along, across, exponent, q = self._channel_parts(centres)
        dl, dn, sharpest = halves @ np.abs(self._d[:, : self.n]).T, a[:, None], 2.0 * np.maximum(self._A, self._B)
        l0, l1, l2 = _gaussian(self._B, np.maximum(along - dl, 0.0), along + dl)
        n0, n1, n2 = _gaussian(self._A, np.maximum(across - dn, 0.0), across + dn)
        # The exponent is convex, so above its tangent, and its gradient q changes by `sharpest` a at most.
        least = np.maximum(exponent - np.einsum("kci,ki->kc", np.abs(q), halves), 0.0)
        e = np.minimum(np.exp(-least), n0 * l0)
        steepest = np.linalg.norm(q, axis=-1) + sharpest * dn
        largest = np.minimum(np.hypot(n1 * l0, n0 * l1), e * steepest) if slope else e
        curvature = np.maximum(np.minimum(n2 * l0 + n0 * l2, e * steepest**2), e * sharpest)
        push = np.linalg.norm(self._push, axis=1)
        return push * largest, push * curvature


def _gaussian(rate: Array, low: Array, high: Array) -> list[Array]:
    """Return suprema of (2 rate x)^i exp(-rate x^2), i = 0, 1, 2, over low <= x <= high; peak at x^2 = i / 2 rate."""
    points = [np.clip(np.sqrt(0.5 * i / rate), low, high) for i in range(3)]
    return [(2.0 * rate * x) ** i * np.exp(-rate * x**2) for i, x in enumerate(points)]


def _norm(J: Array) -> Array:
    """Return the spectral norms of small matrices (k, n, n), shape (k,)."""
    return np.linalg.norm(J, ord=2, axis=(1, 2))


def _tangent(w: Array, J: Array, halves: Array) -> Array:
    """Return the largest |w + J delta| over cells of half sides (k, n), attained at a corner, shape (k,)."""
    n = halves.shape[1]
    signs = np.array(np.meshgrid(*[[1.0], *[[-1.0, 1.0]] * (n - 1)])).reshape(n, -1).T  # each corner or its opposite
    moved = np.einsum("kij,kj,cj->kci", J, halves, signs)
    inner = np.abs(np.einsum("kci,ki->kc", moved, w))
    return np.sqrt((np.einsum("kci,kci->kc", moved, moved) + 2.0 * inner).max(axis=1) + np.einsum("ki,ki->k", w, w))


# -- along a path -----------------------------------------------------------------------------------------------------


@inline_jit
def flow_slope(table, x, y, z, radius):
    """Bound the Jacobian's spectral norm over the ball about a point, 1/s: a Lipschitz constant in the ball.

    It is the sum of the bounds of the kernels over the ball. For a pole g M r / s^p with s = |r|^2 + core^2 the norm is
    at most (2 p - 1) |g M| / s^p, p = 1 (a source in space 1.5), which falls with |r|. For a channel |b| E |q| with
    E = exp(-A |n|^2 - B l^2) and q its exponent's gradient, E is largest at the nearest point, |q| at the farthest, and
    with a = A |n|^2 + B l^2 their product is at most 2 (max(A, B) a)^(1/2) exp(-a) <= (2 max(A, B) / e)^(1/2).
    `supremum` gives tighter bounds, at a hundred times the cost.
    """
    total = 0.0
    for k in range(1, table.shape[0]):
        c = table[k]
        rx, ry, rz = x - c[CENTRE], y - c[CENTRE + 1], (z - c[CENTRE + 2]) * c[SPACE]
        if c[KIND] == CHANNEL:
            along, across2 = channel_place(c, rx, ry, rz)
            across = np.sqrt(across2)
            near, low = max(across - radius, 0.0), max(abs(along) - radius, 0.0)
            strongest = np.exp(-min(near * near * c[ACROSS] + low * low * c[ALONG], NOTHING_LEFT))
            slope_across = c[ACROSS] * (across + radius)
            slope_along = c[ALONG] * (abs(along) + radius)
            steepest = 2.0 * np.sqrt(slope_across * slope_across + slope_along * slope_along)
            total += abs(c[STRENGTH]) * min(strongest * steepest, np.sqrt(max(c[ACROSS], c[ALONG]) * _TWO_OVER_E))
        else:
            r = max(np.sqrt(rx * rx + ry * ry + rz * rz) - radius, 0.0)
            s = r * r + c[CORE2]
            if c[KIND] == SOURCE:
                total += 2.0 * abs(c[STRENGTH]) / (s * np.sqrt(s)) if c[SPACE] else abs(c[STRENGTH]) / s
            else:
                ax, ay, az = triple(c[AXIS:])
                total += abs(c[STRENGTH]) * np.sqrt(ax * ax + ay * ay + az * az) / s
    return total


@inline_jit
def flow_scale(table, x, y, z):
    """Return the length over which the field may change about a point, m, which an integrator must resolve.

    For a pole it is (|r|^2 + core^2)^(1/2), the distance to its singularity in complex space. For a channel it is the
    smaller width, or the distance to the region within nine widths, outside which less than 3e-18 of it remains.
    """
    smallest = np.inf
    for k in range(1, table.shape[0]):
        c = table[k]
        rx, ry, rz = x - c[CENTRE], y - c[CENTRE + 1], (z - c[CENTRE + 2]) * c[SPACE]
        if c[KIND] == CHANNEL:
            along, across2 = channel_place(c, rx, ry, rz)
            widths = np.sqrt(2.0 * (c[ACROSS] * across2 + c[ALONG] * along * along))
            smallest = min(smallest, max(1.0, widths - 9.0) / np.sqrt(2.0 * max(c[ACROSS], c[ALONG])))
        else:
            smallest = min(smallest, np.sqrt(rx * rx + ry * ry + rz * rz + c[CORE2]))
    return smallest


@jit
def _slopes(table, points, radii, out):
    for i in range(points.shape[0]):
        out[i] = flow_slope(table, points[i, 0], points[i, 1], points[i, 2], radii[i])


def bound_slopes(flow: FlowField, points: ArrayLike, radius: ArrayLike) -> Array:
    """Bound |dw/dx| over balls about points, shape (...), 1/s; infinite if a ball contains a kernel without a core.

    Args:
        flow: The field.
        points: Centres of the balls, shape (..., d), m.
        radius: Their radii, shape (...), m.
    """
    x, shape = in_space(points)
    out = np.empty(len(x))
    _slopes(flow.table, x, np.broadcast_to(radius, shape[:-1]).astype(np.float64).ravel(), out)
    return out.reshape(shape[:-1])
