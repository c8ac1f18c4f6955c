"""Non-cooperative target motions: the reference velocity v(t) that a target commands itself.

A target moves by p' = w(p) + v(t) + pull (r(t) - p) - gain (L_T p - c_T)_k + omega(t), with r' = v. With pull = 0 this
is the paper's: the flow carries the target away from its reference. The consensus term is the law's and is not here.

The curve through recorded positions is a cubic spline (not-a-knot), unless that leaves the track.

A spline through uneven samples can deviate far from them: two messages 50 us apart whose positions differ by 1 cm give
it a slope of 200 m/s. So each piece is compared with its chord. Let c_j be the length of chord j, h_j its duration, and
m the median duration. Piece k stays on the track if it is never farther from its chord than

    2.1 max_j(c_j / 2^|j - k|) min(1, 2 m / h_k)   or 1 mm.

Evenly spaced samples always keep their spline. For them, a factor of 1.944 in place of 2.1 suffices, ends included: the
deviation is linear in the chords, sum_j w_kj c_j, and sup_k sum_j |w_kj| 2^|j - k| = 1.944. The last factor is for
gaps, where a spline extrapolates the noise of both slopes.

If a piece leaves the track, samples that follow another one within a tenth of m are left out. If that does not suffice,
both ends of the piece get the slopes of PCHIP, which make it monotone between its samples; the other ends keep their
slopes. Position and velocity stay continuous.
"""

from collections.abc import Sequence
from math import factorial
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used
from pydantic import Field, model_validator

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.compile.jit import inline_jit
from mjsheaf.errors import InputError, in_field
from mjsheaf.recordings import Selection, read_positions
from mjsheaf.section import NonNegative, Number, Point, Positive, Tagged

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

    path: "scipy.interpolate.PPoly"
    note: str


def fit_curve(t: Array, places: Array) -> Curve:
    """Fit the curve through positions (T, n), m, at rising times (T,), s."""
    path = scipy.interpolate.CubicSpline(t, places)
    off = _deviation(path, t, places)
    leaves = off > 0.0
    h = np.diff(t)
    gaps = int((h > MAX_INTERVAL * np.median(h)).sum())
    longest = f"from t = {t[h.argmax()]:.6g} to {t[h.argmax() + 1]:.6g} s"
    about_gaps = {0: [], 1: [f"a gap {longest}"]}.get(gaps, [f"{gaps} gaps, the longest {longest}"])
    if not leaves.any():
        return Curve(path, "".join(about_gaps))
    farthest = int(off.argmax())
    notes = [f"its spline is up to {off.max():.3g} m off the track (t = {t[farthest]:.6g} to {t[farthest + 1]:.6g} s)"]
    kept = _thin(t)
    if not kept.all():
        least = MIN_INTERVAL * float(np.median(np.diff(t)))
        notes.append(f"{(~kept).sum()} of {len(t)} samples within {least:.3g} s of another left out")
        t, places = t[kept], places[kept]
        path = scipy.interpolate.CubicSpline(t, places)
        leaves = _deviation(path, t, places) > 0.0
    if leaves.any():
        smooth, monotone = path(t, 1), scipy.interpolate.PchipInterpolator(t, places)(t, 1)
        ends = np.zeros(len(t), dtype=bool)
        while leaves.any():  # at the latest when all slopes are PCHIP's
            ends[:-1] |= leaves
            ends[1:] |= leaves
            path = scipy.interpolate.CubicHermiteSpline(t, places, np.where(ends[:, None], monotone, smooth))
            leaves = (_deviation(path, t, places) > 0.0) & ~(ends[:-1] & ends[1:])
        count = int((ends[:-1] & ends[1:]).sum())
        notes.append(f"{count} of {len(t) - 1} pieces monotone instead (PCHIP)")
    return Curve(path, "; ".join([*notes, *about_gaps]))


def _deviation(path: "scipy.interpolate.PPoly", t: Array, places: Array) -> Array:
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


PARTS = 16
"""Number of parts into which pieces of paths are cut for tight bounds on speeds."""

_CLOCK = 1e-9  # resolution of the times of logs, s
_ORDER = 6  # coefficients of the quintic pieces of a waypoint path


class MotionArrays(NamedTuple):
    """References of all vehicles.

    Attributes:
        pull: Rate of return to the reference, shape (V,), 1/s.
        origin: Centre of the Lissajous part, shape (V, 3), m; not used with a path.
        amplitude, rate, phase: Amplitude, m, rate, rad/s, and phase, rad, of the Lissajous part, shape (V, 3) each.
        path: First knot of each path and number of its pieces, shape (V, 2).
        period: Period of a closed path, shape (V,), s; else 0.
        knots: Times of the knots of all paths, shape (P,), s.
        coefficients: Coefficients of the pieces, highest power first, shape (P, 6, 3).
    """

    pull: Array
    origin: Array
    amplitude: Array
    rate: Array
    phase: Array
    path: IntArray
    period: Array
    knots: Array
    coefficients: Array


@inline_jit
def add_reference(motion, v, t, x, command):
    """Add v(t) + pull (r(t) - x) of vehicle v to command (3,)."""
    pull, pieces = motion.pull[v], motion.path[v, 1]
    for i in range(3):
        amplitude, rate = motion.amplitude[v, i], motion.rate[v, i]
        if amplitude != 0.0:  # agents have none
            command[i] += amplitude * rate * np.cos(rate * t + motion.phase[v, i])
        if pull != 0.0 and pieces == 0:
            position = motion.origin[v, i] + amplitude * np.sin(rate * t + motion.phase[v, i])
            command[i] += pull * (position - x[i])
    if pieces > 0:
        k, h = piece_at(motion, v, t)
        for i in range(3):
            position, velocity = 0.0, 0.0
            for j in range(_ORDER):  # Horner's scheme for the value and its derivative
                velocity = velocity * h + position
                position = position * h + motion.coefficients[k, j, i]
            command[i] += velocity + pull * (position - x[i])


@inline_jit
def piece_at(motion, v, t):
    """Return the piece of the path of v at time t, s, and how long it has lasted then, s."""
    first, pieces = motion.path[v, 0], motion.path[v, 1]
    s = t
    if motion.period[v] > 0.0:
        s = motion.knots[first] + (t - motion.knots[first]) % motion.period[v]
    last = motion.knots[first + pieces]
    s = min(max(s, motion.knots[first]), last)
    k, beyond = first, first + pieces
    while beyond - k > 1:  # knots[k] <= s, and s < knots[beyond] unless that is the last
        middle = (k + beyond) // 2
        if s >= motion.knots[middle]:
            k = middle
        else:
            beyond = middle
    return k, s - motion.knots[k]


@inline_jit
def position_at(motion, v, t):
    """Return the position of the reference of v at time t, s, as three numbers, m."""
    if motion.path[v, 1] > 0:
        k, h = piece_at(motion, v, t)
        x, y, z = 0.0, 0.0, 0.0
        for j in range(_ORDER):
            x = x * h + motion.coefficients[k, j, 0]
            y = y * h + motion.coefficients[k, j, 1]
            z = z * h + motion.coefficients[k, j, 2]
        return x, y, z
    return _swing(motion, v, 0, t), _swing(motion, v, 1, t), _swing(motion, v, 2, t)


@inline_jit
def _swing(motion, v, i, t):
    """Return coordinate i of the Lissajous part of v at time t, s, m."""
    position = motion.origin[v, i]
    if motion.amplitude[v, i] != 0.0:
        position += motion.amplitude[v, i] * np.sin(motion.rate[v, i] * t + motion.phase[v, i])
    return position


class Lissajous(Tagged):
    """v_i(t) = amplitude_i rate_i cos(rate_i t + phase_i)."""

    kind: Literal["lissajous"] = Field("lissajous", description="always lissajous")
    amplitude: Point = Field(description="of each coordinate [m]")
    rate: Point = Field(description="of each coordinate [rad/s]")
    phase: Point | None = Field(
        None, description="of each coordinate, 0 unless given; the one angle that is not in degrees [rad]"
    )
    pull: NonNegative = Field(0.0, description="return to the path when flow moves the target off it [1/s]")

    def write(self, arrays: MotionArrays, v: int, n: int, start: float) -> None:
        """Write the motion of vehicle v, which has dimension n; its path begins at the origin in the arrays."""
        for name in ("amplitude", "rate", "phase"):
            value = getattr(self, name)
            if value is None:  # the arrays begin as zeros
                continue
            if len(value) != n:
                raise InputError(f"lissajous {name} has {len(value)} entries; the target has dimension {n}")
            getattr(arrays, name)[v, :n] = value
        arrays.origin[v] -= arrays.amplitude[v] * np.sin(arrays.rate[v] * start + arrays.phase[v])


class Waypoints(Tagged):
    """A smooth path through points, starting at the target's initial position."""

    kind: Literal["waypoints"] = Field("waypoints", description="always waypoints")
    points: Annotated[list[Point], Field(min_length=1)] = Field(
        description="visited after the initial position, each x, y or x, y, z [m]"
    )
    speed: Positive = Field(description="mean speed along the straight legs [m/s]")
    closed: bool = Field(False, description="whether the path returns to the initial position and repeats")
    pull: NonNegative = Field(1.0, description="return to the path when flow moves the target off it [1/s]")

    def spline(self, initial: Array, start: float, end: float) -> "scipy.interpolate.PPoly":
        """Return the path from `initial` (n,) in m at time `start` in s, as a piecewise polynomial.

        `end` is not used: the path has its own duration.

        It is the quintic spline through the points at times in proportion to the distances between them: position,
        velocity and acceleration are continuous. An open path starts and ends at rest, and holds its last point.
        """
        for k, point in enumerate(self.points):
            if len(point) != len(initial):
                raise InputError(f"waypoint {k} has {len(point)} entries; the target has dimension {len(initial)}")
        path = np.array([initial, *self.points, *[initial] * self.closed])
        legs = np.linalg.norm(np.diff(path, axis=0), axis=1)
        if not legs.all():
            raise InputError(f"waypoint {int(legs.argmin())} is where the target already is; leave it out")
        times = start + np.concatenate([[0.0], np.cumsum(legs)]) / self.speed
        rest = [(1, np.zeros(len(initial))), (2, np.zeros(len(initial)))]
        spline = scipy.interpolate.make_interp_spline(
            times, path, k=5, bc_type="periodic" if self.closed else (rest, rest)
        )
        knots = spline.t[spline.k : -spline.k]  # without the copies at both ends
        taylor = [spline(knots[:-1], order) / factorial(order) for order in range(spline.k, -1, -1)]
        return scipy.interpolate.PPoly(np.array(taylor), knots)


class _Source(Tagged):
    kind: Literal["recorded", "file"] = Field("recorded", description="recorded; older files say file")
    samples: Annotated[list[Annotated[list[Number], Field(min_length=3, max_length=4)]], Field(min_length=2)] | None = (
        Field(
            None,
            description="rows t, x, y and in space z, t rising, from the start of the run to its end or beyond; `path` "
            "reads the same from a file [s, m]",
        )
    )
    path: str | None = Field(
        None,
        description="file with the positions: CSV, netCDF, MCAP, or a bag of ROS; relative to the scenario. Times "
        "of tables and netCDF without a date are those of the run; dates and clocks count from the first position",
    )


class Recorded(Selection, _Source):
    """A path through recorded positions: a cubic spline (not-a-knot) through the samples, unless that leaves the track.

    Its velocity is the reference. `pull` removes the difference between the initial positions of target and path. A
    loaded scenario has the samples of a file in place of the file's path. See `mjsheaf.law.paths` for uneven samples.
    """

    pull: NonNegative = Field(1.0, description="return to the path when the target is off it [1/s]")

    @model_validator(mode="after")
    def _one_source(self) -> "Recorded":
        if (self.samples is None) == (self.path is None):
            raise ValueError("expected either samples or path")
        if self.path is None and self.selects:
            raise ValueError(
                "topic and frame select from the file of `path`, as time, axes and origin do; expected only with it"
            )
        return self

    def read(self) -> "Recorded":
        """Return the same motion with its samples, from its file if it has one.

        Raises:
            InputError: The file cannot be read, or holds no positions; the message names it.
        """
        if self.path is None:
            return self
        return Recorded(samples=read_positions(self.path, self), pull=self.pull)

    def spline(self, initial: Array, start: float, end: float) -> "scipy.interpolate.PPoly":
        """Return the path, m, over time, s, in the dimension n of the target's initial position (n,).

        Raises:
            InputError: Samples have another dimension, do not rise in time, or do not cover the run from `start` to
                `end`.
        """
        path = self.curve(len(initial)).path
        if path.x[0] > start + _CLOCK or path.x[-1] < end - _CLOCK:  # the path stands still for that long
            covered = f"{path.x[0]:g} to {path.x[-1]:g} s"
            raise InputError(f"samples cover {covered}; expected all of the run, {start:g} to {end:g} s")
        return path

    def curve(self, n: int) -> Curve:
        """Return the curve through the first n coordinates of the samples, m, with its note.

        Raises:
            InputError: Samples have another dimension, or do not rise in time.
        """
        samples = self.read().samples or []
        for k, row in enumerate(samples):
            if len(row) < n + 1:
                raise InputError(f"sample {k} has {len(row)} entries; expected t and {n} coordinates")
        t = np.array([row[0] for row in samples])
        if not (np.diff(t) > 0.0).all():
            k = int((np.diff(t) > 0.0).argmin())
            raise InputError(f"sample {k + 1} is of t = {t[k + 1]:g} s, after one of {t[k]:g} s; expected a later time")
        return fit_curve(t, np.array([row[1 : n + 1] for row in samples]))


class Fixed(Tagged):
    """No motion at all: it stays at its initial position in any flow.

    On ideal kinematics it does not move. A body holds the position by itself: it compensates for the medium that it
    measures, as far as its thrusters can. Neither disturbance nor `target_formation` moves it.
    """

    pull: ClassVar[float] = 0.0

    kind: Literal["fixed"] = Field("fixed", description="always fixed")


class Adrift(Tagged):
    """No motion of its own: flow and disturbance carry it."""

    pull: ClassVar[float] = 0.0

    kind: Literal["adrift"] = Field("adrift", description="always adrift")


class Static(Tagged):
    """No motion of its own; flow and disturbance still move it, unless it is pulled back.

    Without a pull it is the same as `adrift`, which says so; `fixed` is a target that stays.
    """

    kind: Literal["static"] = Field("static", description="always static")
    pull: NonNegative = Field(0.0, description="return to the initial position [1/s]")


Motion = Annotated[Lissajous | Waypoints | Recorded | Fixed | Adrift | Static, Field(discriminator="kind")]


def pack_motions(
    motions: list[Motion | None],
    positions: Array,
    start: float,
    dimensions: list[int],
    end: float | None = None,
    names: Sequence[str] = (),
) -> MotionArrays:
    """Pack the reference of each vehicle (None: none) into arrays.

    Args:
        motions: Motion of each vehicle, or None.
        positions: Initial positions, shape (V, 3), m.
        start: Initial time, s.
        dimensions: Dimension of each vehicle.
        end: Time up to which recorded positions must reach, s; `start` unless given.
        names: Name of each vehicle's motion in messages; its number unless given.

    Raises:
        InputError: A motion has the wrong dimension, a path visits the same point twice in a row, or recorded positions
            do not cover the run.
    """
    V = len(motions)
    arrays = MotionArrays(
        pull=np.zeros(V),
        origin=np.array(positions, dtype=np.float64),
        amplitude=np.zeros((V, 3)),
        rate=np.zeros((V, 3)),
        phase=np.zeros((V, 3)),
        path=np.zeros((V, 2), dtype=np.int64),
        period=np.zeros(V),
        knots=np.zeros(0),
        coefficients=np.zeros((0, _ORDER, 3)),
    )
    for v, (motion, n) in enumerate(zip(motions, dimensions, strict=True)):
        arrays.pull[v] = motion.pull if motion else 0.0
        with in_field(names[v] if names else f"motion of vehicle {v}"):
            if isinstance(motion, Lissajous):
                motion.write(arrays, v, n, start)
            if not isinstance(motion, Waypoints | Recorded):
                continue
            spline = motion.spline(positions[v, :n], start, start if end is None else end)
        pieces = len(spline.x) - 1
        arrays.path[v] = len(arrays.knots), pieces
        closed = isinstance(motion, Waypoints) and motion.closed
        arrays.period[v] = spline.x[-1] - spline.x[0] if closed else 0.0
        padded = np.zeros((pieces + 1, _ORDER, 3))  # a row for the last knot keeps both arrays aligned
        padded[:-1, _ORDER - len(spline.c) :, :n] = spline.c.transpose(1, 0, 2)
        arrays = arrays._replace(
            knots=np.concatenate([arrays.knots, spline.x]),
            coefficients=np.concatenate([arrays.coefficients, padded]),
        )
    return arrays


def reference_bounds(motion: MotionArrays, parts: int = 1) -> tuple[Array, Array]:
    """Bound the speed |v(t)|, m/s, and the acceleration |v'(t)|, m/s^2, of every reference for all t, shape (V,) each.

    A piece of a path is a polynomial, which lies in the convex hull of its Bernstein coefficients. If it is cut into
    `parts`, the hulls are tighter.
    """
    swing = np.abs(motion.amplitude * motion.rate)
    speed, acceleration = np.linalg.norm(swing, axis=1), np.linalg.norm(swing * motion.rate, axis=1)
    for v, (first, pieces) in enumerate(motion.path):
        if pieces:
            knots = motion.knots[first : first + pieces + 1]
            path = scipy.interpolate.PPoly(motion.coefficients[first : first + pieces].transpose(1, 0, 2), knots)
            for order, bound in enumerate((speed, acceleration), 1):
                hull = scipy.interpolate.BPoly.from_power_basis(_cut(path.derivative(order), parts)).c
                bound[v] = max(bound[v], float(np.linalg.norm(hull, axis=-1).max()))
    return speed, acceleration


def _cut(path: "scipy.interpolate.PPoly", parts: int) -> "scipy.interpolate.PPoly":
    """Return the same path with every piece cut into parts of one length."""
    if parts == 1:
        return path
    shares = np.arange(parts) / parts
    knots = np.append((path.x[:-1, None] + np.diff(path.x)[:, None] * shares).ravel(), path.x[-1])
    taylor = [path(knots[:-1], order) / factorial(order) for order in range(len(path.c) - 1, -1, -1)]
    return type(path)(np.array(taylor), knots)
