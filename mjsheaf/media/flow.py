"""Flow fields: the velocity w(x) of the medium, as a sum of kernels.

With r = x - centre and s = |r|^2 + core^2, in m and m/s:

| kernel  | velocity                                                     | strength              |
|---------|--------------------------------------------------------------|-----------------------|
| drift   | a constant                                                   | m/s                   |
| source  | alpha r / s in the plane, alpha r / s^1.5 in space           | m^2/s, m^3/s          |
| vortex  | gamma (axis x r) / s; in the plane the axis is z             | m^2/s                 |
| channel | beta exp(-|n|^2 / 2 width^2) exp(-l^2 / 2 length^2) d,       | m/s                   |
|         | l = r . d along the unit direction d, n = r - l d across     |                       |

Source: the paper's Section VI, and the kernels of its published run.
"""

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from mjsheaf.arrays import Array, IntArray
from mjsheaf.compile.jit import inline_jit, jit, overload, two_to_by_bits
from mjsheaf.errors import InputError
from mjsheaf.media.gusts import Gusts
from mjsheaf.media.varying import Exposure, Moving, MovingVortices, Ramp, Tide, pack_varying
from mjsheaf.media.waves import Waves
from mjsheaf.section import NonNegative, Number, Point, Positive, Section
from mjsheaf.vectors import add, cross, triple

# A field is a table with one row for each kernel: its kind, 1 if it lies in space (0: its z is ignored), centre (3),
# axis or direction (3), strength, and two parameters: core^2, or the falloffs of a channel across and along. Its first
# row is the drift, in the place of a centre. One array is what compiled code passes on most cheaply.
KIND, SPACE, CENTRE, AXIS, STRENGTH = 0, 1, 2, 5, 8
CORE2 = 9
ACROSS, ALONG = 9, 10
SOURCE, VORTEX, CHANNEL = 0.0, 1.0, 2.0
_NARROWEST = 1e-100  # m, of a channel: the square of its inverse must be finite
NOTHING_LEFT = 600.0  # exp(-600) = 3e-261, which stands for all that is less
_LOG2_E = 1.4426950408889634
# ln 2 in two parts: the first has so few digits that multiples of it are exact.
_LN2_1, _LN2_2 = 0.6931471803691238, 1.9082149292705877e-10
# e^r = 1 + r + r^2 Q(r), |r| <= ln 2 / 2: Q interpolates at Chebyshev's points, and is wrong by 2e-17 at most.
_Q0, _Q1, _Q2, _Q3 = 0.5000000000000001, 0.1666666666666667, 0.04166666666662412, 0.008333333333326134
_Q4, _Q5, _Q6 = 0.0013888888917215586, 0.00019841269874822307, 2.4801521293463862e-05
_Q7, _Q8, _Q9 = 2.755725539833871e-06, 2.762008948195459e-07, 2.5105217695684516e-08


def two_to(exponent):
    """Return 2 to the power of a whole number, given as a float; NaN if it is none."""
    return math.ldexp(1.0, int(exponent)) if math.isfinite(exponent) else math.nan


@overload(two_to)
def _two_to(exponent):
    """Compute it without a call."""
    return lambda exponent: two_to_by_bits(exponent)


@inline_jit
def decay(x):
    """Return exp(-x) for x from 0 to 700, to a unit in its last place.

    It is arithmetic alone, as `varying.sine`: a library's function is called for one lane after the other.
    """
    n = np.rint(x * -_LOG2_E)
    r = (-x - n * _LN2_1) - n * _LN2_2
    q = r * r
    low = (_Q0 + r * _Q1) + q * (_Q2 + r * _Q3)
    high = (_Q4 + r * _Q5) + q * (_Q6 + r * _Q7) + q * q * (_Q8 + r * _Q9)
    return two_to(n) * (1.0 + (r + q * (low + q * q * high)))


@inline_jit
def channel_place(c, rx, ry, rz):
    """Return the place of an offset (rx, ry, rz) from a channel's centre: l along the channel, |n|^2 across."""
    d = triple(c[AXIS:])
    along = rx * d[0] + ry * d[1] + rz * d[2]
    nx, ny, nz = rx - along * d[0], ry - along * d[1], rz - along * d[2]
    return along, nx * nx + ny * ny + nz * nz


@inline_jit
def source_velocity(c, r):
    """Return the velocity of a source at an offset r from its centre, as three numbers."""
    s = r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + c[CORE2]
    a = c[STRENGTH] / (s * np.sqrt(s)) if c[SPACE] else c[STRENGTH] / s
    return a * r[0], a * r[1], a * r[2]


@inline_jit
def vortex_velocity(c, r):
    """Return that of a vortex."""
    a = c[STRENGTH] / (r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + c[CORE2])
    x, y, z = cross(triple(c[AXIS:]), r)
    return a * x, a * y, a * z


@inline_jit
def channel_velocity(c, r):
    """Return that of a channel."""
    along, across2 = channel_place(c, r[0], r[1], r[2])
    falloff = across2 * c[ACROSS] + along * along * c[ALONG]
    a = c[STRENGTH] * decay(min(falloff, NOTHING_LEFT))
    return a * c[AXIS], a * c[AXIS + 1], a * c[AXIS + 2]


@inline_jit
def offset_from(c, x):
    """Return the offset of a point x from the centre of a kernel."""
    return x[0] - c[CENTRE], x[1] - c[CENTRE + 1], (x[2] - c[CENTRE + 2]) * c[SPACE]


@jit
def flow_velocity(table, x, y, z):
    """Velocity of the medium at a point, as three numbers; the first row of the table is the drift."""
    w = triple(table[0, CENTRE:])
    for k in range(1, table.shape[0]):
        c = table[k]
        r = offset_from(c, (x, y, z))
        if c[KIND] == SOURCE:
            w = add(w, source_velocity(c, r))
        elif c[KIND] == VORTEX:
            w = add(w, vortex_velocity(c, r))
        else:
            w = add(w, channel_velocity(c, r))
    return w


@jit
def _velocities(table, points, out):
    for i in range(points.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = flow_velocity(table, points[i, 0], points[i, 1], points[i, 2])


class Source(Section):
    """alpha r / (|r|^2 + core^2)^p, p = 1 in the plane and 1.5 in space."""

    centre: Point = Field(description="position [m]")
    alpha: Number = Field(
        description="strength, positive for a source and negative for a sink [m^2/s in the plane, m^3/s in space]"
    )

    def row(self, core2: float) -> list[float]:
        """Return the kernel's row in the table after its kind and its plane or space."""
        return [*_padded(self.centre), 0.0, 0.0, 0.0, self.alpha, core2, 0.0]


class Vortex(Section):
    """gamma (axis x r) / (|r|^2 + core^2)."""

    centre: Point = Field(description="position [m]")
    gamma: Number = Field(description="strength, positive to port about the axis [m^2/s]")
    axis: Annotated[list[Number], Field(min_length=3, max_length=3)] | None = Field(
        None, description="axis; its length counts; in space only [-]"
    )

    velocity: Point | None = Field(None, description="velocity of the centre; at rest unless given [m/s]")

    def row(self, core2: float) -> list[float]:
        """As that of a source."""
        return [*_padded(self.centre), *(self.axis or (0.0, 0.0, 1.0)), self.gamma, core2, 0.0]


class Channel(Section):
    """beta exp(-|n|^2 / 2 width^2) exp(-l^2 / 2 length^2) along a direction."""

    centre: Point = Field(description="position at which it is strongest [m]")
    direction: Point = Field(description="direction of the flow, of any length [-]")
    beta: Number = Field(description="speed at the centre [m/s]")
    width: Positive = Field(description="standard deviation across the direction [m]")
    length: Positive = Field(description="standard deviation along the direction [m]")

    @model_validator(mode="after")
    def _is_no_line(self) -> "Channel":
        if not np.linalg.norm(self.direction) or min(self.width, self.length) < _NARROWEST:
            raise ValueError(
                f"a channel needs a non-zero direction and a positive width and length, of {_NARROWEST:g} m at least"
            )
        return self

    def row(self, _: float) -> list[float]:
        """As that of a source."""
        along = np.asarray(self.direction) / np.linalg.norm(self.direction, axis=0)  # 0: without BLAS
        falloff = 0.5 / np.array([self.width, self.length]) ** 2
        return [*_padded(self.centre), *_padded(along), self.beta, *falloff]


class FlowField(Section):
    """A flow field in the plane (dimension 2) or in space (3)."""

    dimension: Literal[2, 3] = Field(description="2: in the plane, the same at every height; 3: in space [-]")
    core: NonNegative | None = Field(
        None,
        description="radius that smooths sources and vortices; needed with them, 0 leaves them singular [m]",
    )
    drift: Point | None = Field(None, description="uniform velocity [m/s]")
    sources: list[Source] = Field(default_factory=list, description="point sources and sinks")
    vortices: list[Vortex] = Field(default_factory=list, description="vortices")
    channels: list[Channel] = Field(default_factory=list, description="Gaussian streams")
    tide: Tide | None = Field(None, description="uniform flow that turns; none unless given")
    ramp: Ramp | None = Field(None, description="uniform flow that rises once; none unless given")
    gusts: Gusts | None = Field(None, description="turbulence in addition to the steady flow; none unless given")
    waves: Waves | None = Field(None, description="waves, in `flow.water` alone; none unless given")

    @model_validator(mode="after")
    def _poles_are_complete(self) -> "FlowField":
        if any((vortex.axis is not None) != (self.dimension == 3) for vortex in self.vortices):
            raise ValueError("vortices: in space each needs an axis; in the plane the axis is z, leave it out")
        if self.core is None and (self.sources or self.vortices):
            raise ValueError("sources and vortices are singular at their centre: give a 'core' radius (0 leaves it so)")
        if not self.core and any(vortex.velocity is not None for vortex in self.vortices):
            raise ValueError("vortices: one that moves needs a 'core' radius above 0")
        return self

    @model_validator(mode="after")
    def _points_have_its_dimension(self) -> "FlowField":
        for name, point in self._points():
            if point is not None and len(point) != self.dimension:
                raise ValueError(f"{name} has {len(point)} numbers; expected {self.dimension}")
        return self

    def _points(self) -> Iterator[tuple[str, Point | None]]:
        """Yield the names of all points and directions, and their values."""
        yield "drift", self.drift
        yield "ramp.velocity", self.ramp.velocity if self.ramp else None
        for kind in ("sources", "vortices", "channels"):
            for k, kernel in enumerate(getattr(self, kind)):
                for name in ("centre", "velocity", "direction"):
                    yield f"{kind}.{k}.{name}", getattr(kernel, name, None)

    @cached_property
    def table(self) -> Array:
        """The field as a table for the compiled loops, one row for each kernel after the drift's."""
        core2, space = float(self.core or 0.0) ** 2, float(self.dimension == 3)
        drift = [0.0, space, *_padded(self.drift or [0.0, 0.0]), *[0.0] * 6]
        resting = [vortex for vortex in self.vortices if vortex.velocity is None]
        kinds = ((SOURCE, self.sources), (VORTEX, resting), (CHANNEL, self.channels))
        rows = [[kind, space, *kernel.row(core2)] for kind, kernels in kinds for kernel in kernels]
        # A kernel without strength is no kernel: left in, it would be 0 / 0 at a centre without a core.
        return np.array([drift, *(row for row in rows if row[STRENGTH] != 0.0)])

    @cached_property
    def kernel_speed(self) -> float:
        """Upper bound of the speed of the kernels without the drift, m/s; infinite for a pole without a core.

        A pole g r / s^p with s = r^2 + c^2 has its maximum g / (2 c) at r = c (p = 1), or 2 g / (3^(3/2) c^2) at
        r = c / 2^(1/2) (p = 3/2, a source in space). A channel is at most |beta|.
        """
        total = 0.0
        for row in self.table[1:]:
            core = math.sqrt(row[CORE2])
            if row[KIND] == CHANNEL:
                total += abs(row[STRENGTH])
            elif core == 0.0:
                return math.inf
            elif row[KIND] == SOURCE and row[SPACE]:
                total += abs(row[STRENGTH]) * 2.0 / (3.0**1.5 * core * core)
            else:
                x, y, z = row[AXIS:STRENGTH]
                axis = 1.0 if row[KIND] == SOURCE else math.sqrt(x**2 + y**2 + z**2)
                total += abs(row[STRENGTH]) * axis / (2.0 * core)
        return total

    @property
    def is_steady(self) -> bool:
        """True if nothing of it changes with time."""
        return not (self.varies or any(isinstance(section, Moving) for _, section in self))

    @property
    def varies(self) -> bool:
        """True if it has a tide, a ramp, or a vortex that moves."""
        return self.tide is not None or self.ramp is not None or len(self.moving_vortices.core2) > 0

    @cached_property
    def moving_vortices(self) -> MovingVortices:
        """Vortices that move."""
        moving = [k for k in self.vortices if k.velocity is not None and k.gamma != 0.0]
        along = [k.gamma * np.array(k.axis or (0.0, 0.0, 1.0)) for k in moving]
        vectors = ([_padded(k.centre) for k in moving], [_padded(k.velocity or ()) for k in moving], along)
        core2, space = float(self.core or 0.0) ** 2, float(self.dimension == 3)
        numbers = (np.full(len(moving), number) for number in (core2, space))
        return MovingVortices(*(np.array(rows).reshape(-1, 3) for rows in vectors), *numbers)

    def recorded(self, name: str, met: Exposure) -> tuple[list[Any], Array]:
        """Return parts out of a file, and the velocity where each vehicle begins, shape (V, 3), m/s; no parts here."""
        return [], met.wind

    def parts(self, name: str, met: Exposure, reached: IntArray) -> Iterator[Any]:
        """Yield what moves of it, for compiled code; see `Moving.parts`."""
        if self.varies:
            yield pack_varying(self.tide, self.ramp, self.moving_vortices, met.met.astype(np.int64))
        recorded, wind = self.recorded(name, met)
        yield from recorded
        for _, section in self:
            if isinstance(section, Moving):
                yield from section.parts(name, met._replace(wind=wind), reached)

    def velocity(self, points: ArrayLike) -> Array:
        """Velocity of the medium.

        Args:
            points: positions, shape (..., d), m. A planar field ignores z; a field in space takes z = 0 at planar
                points.

        Returns:
            Velocities of the same shape, m/s; the components that points do not have are left out.
        """
        x, shape = in_space(points)
        w = np.empty_like(x)
        _velocities(self.table, x, w)
        return w.reshape(*shape[:-1], 3)[..., : shape[-1]]


NO_FLOW = FlowField.model_construct(set(), dimension=2)
"""The flow in place of one that is not given: at rest, and no field of it is set."""


def _padded(point: Sequence[float]) -> list[float]:
    return [*point, 0.0][:3]


def in_space(points: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """Return points (..., 2 or 3) as rows in space, with z = 0 where there is none, and their shape."""
    x = np.asarray(points, dtype=np.float64)
    if x.ndim == 0 or x.shape[-1] not in (2, 3):
        raise InputError(f"points have shape {x.shape}; expected (..., 2) or (..., 3)")
    flat = np.zeros((x.size // x.shape[-1], 3))
    flat[:, : x.shape[-1]] = x.reshape(-1, x.shape[-1])
    return flat, x.shape
