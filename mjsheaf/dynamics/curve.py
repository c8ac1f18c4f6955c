"""The curve through recorded positions: a cubic spline (not-a-knot), unless that leaves the track.

A spline through uneven samples can swing far off them: two messages 50 us apart whose positions differ by 1 cm give it
a slope of 200 m/s. So each piece is compared with its chord. Let c_j be the length of chord j, h_j its duration, and
m the median duration. Piece k stays on the track if it is never farther from its chord than

    2.1 max_j(c_j / 2^|j - k|) min(1, 2 m / h_k)   or 1 mm.

Through even samples no spline of this kind exceeds 1.944 of that, whatever they are, ends included: its deviation is
linear in the chords, sum_j w_kj c_j, and sup_k sum_j |w_kj| 2^|j - k| = 1.944. Even samples therefore keep their
spline. The last factor is for gaps, where a spline extrapolates the noise of both slopes.

Where a piece leaves the track, two things happen. Samples that follow another one within a tenth of m are left out.
If that does not suffice, both ends of the piece get the slopes of PCHIP, with which it is monotone between its samples;
the other ends keep theirs. Position and velocity stay continuous.
"""

from math import factorial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

MAX_DEVIATION = 2.1
"""Maximum deviation from a chord, in the weighted length of the chords around it."""
MIN_DEVIATION = 1e-3
"""Deviation from a chord that is always allowed, m."""
MIN_INTERVAL = 0.1
"""Minimum time between samples of a path that its spline leaves, in median intervals."""
MAX_INTERVAL = 10.0
"""Maximum time between samples that is no gap, in median intervals."""

_SHARES = np.arange(1, 8) / 8.0


class Curve(NamedTuple):
    """A curve through positions.

    Attributes:
        path: Piecewise cubic, shape (n,) in m, over time in s.
        note: Sentence on gaps, and on what differs from the spline through all samples; empty if there is nothing.
    """

    path: "PPoly"
    note: str


def fit_curve(t: Array, places: Array) -> Curve:
    """Fit the curve through positions (T, n), m, at rising times (T,), s."""
    from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

    path = _spline(t, places)
    off = _deviation(path, t, places)
    leaves = off > 0.0
    gaps = _gaps(t)
    if not leaves.any():
        return Curve(path, "".join(gaps))
    farthest = int(off.argmax())
    notes = [f"its spline is up to {off.max():.3g} m off the track (t = {t[farthest]:.6g} to {t[farthest + 1]:.6g} s)"]
    kept = _thin(t)
    if not kept.all():
        least = MIN_INTERVAL * float(np.median(np.diff(t)))
        notes.append(f"{(~kept).sum()} of {len(t)} samples within {least:.3g} s of another left out")
        t, places = t[kept], places[kept]
        path = _spline(t, places)
        leaves = _deviation(path, t, places) > 0.0
    if leaves.any():
        smooth, monotone = path(t, 1), PchipInterpolator(t, places)(t, 1)
        ends = np.zeros(len(t), dtype=bool)
        while leaves.any():  # at the latest when all slopes are PCHIP's
            ends[:-1] |= leaves
            ends[1:] |= leaves
            path = CubicHermiteSpline(t, places, np.where(ends[:, None], monotone, smooth))
            leaves = (_deviation(path, t, places) > 0.0) & ~(ends[:-1] & ends[1:])
        count = int((ends[:-1] & ends[1:]).sum())
        notes.append(f"{count} of {len(t) - 1} pieces monotone instead (PCHIP)")
    return Curve(path, "; ".join([*notes, *gaps]))


def _gaps(t: Array) -> list[str]:
    """Return a sentence on long times without samples, if there are any."""
    h = np.diff(t)
    gaps = int((h > MAX_INTERVAL * np.median(h)).sum())
    k = int(h.argmax())
    longest = f"from t = {t[k]:.6g} to {t[k + 1]:.6g} s"
    return [f"a gap {longest}" if gaps == 1 else f"{gaps} gaps, the longest {longest}"] if gaps else []


def _spline(t: Array, places: Array) -> "PPoly":
    """Return the cubic spline, or the polynomial through fewer than four positions."""
    from scipy.interpolate import PPoly, make_interp_spline

    cubic = make_interp_spline(t, places, k=min(3, len(t) - 1))
    knots = cubic.t[cubic.k : len(cubic.t) - cubic.k]
    taylor = [cubic(knots[:-1], order) / factorial(order) for order in range(cubic.k, -1, -1)]
    return PPoly(np.array(taylor), knots)


def _deviation(path: "PPoly", t: Array, places: Array) -> Array:
    """Return how far each piece between samples is off its chord, m; 0 where that is allowed. Shape (T - 1,)."""
    h, step = np.diff(t), np.diff(places, axis=0)
    off = np.zeros(len(h))
    for share in _SHARES:
        chord = places[:-1] + share * step
        off = np.maximum(off, np.linalg.norm(path(t[:-1] + share * h) - chord, axis=1))
    k = np.arange(len(h))
    with np.errstate(divide="ignore"):
        length = np.log2(np.linalg.norm(step, axis=1))
    before = np.maximum.accumulate(length + k) - k
    after = np.maximum.accumulate((length - k)[::-1])[::-1] + k
    allowed = MAX_DEVIATION * np.exp2(np.maximum(before, after)) * np.minimum(1.0, 2.0 * np.median(h) / h)
    return np.where(off > np.maximum(allowed, MIN_DEVIATION), off, 0.0)


def _thin(t: Array) -> BoolArray:
    """Return which samples remain if none follows another too soon; the first and last do. Shape (T,)."""
    least = MIN_INTERVAL * float(np.median(np.diff(t)))
    kept = np.zeros(len(t), dtype=bool)
    last = -np.inf
    for k, time in enumerate(t):
        if time - last >= least:
            kept[k], last = True, time
    if not kept[-1]:
        kept[np.flatnonzero(kept)[-1]] = False
        kept[[0, -1]] = True
    return kept
