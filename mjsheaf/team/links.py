"""Links: how measurements are made and how they get from one end of an edge to the other, as a file says it.

A measurement of an edge is made by the tail at every sample and sent to the head; what is lost is lost for both. Fields
are set for all edges, for those of a kind, or on an edge itself: the finest that names a field counts, field by field.
"""

from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from mjsheaf.arrays import Array
from mjsheaf.compile.jit import inline_jit
from mjsheaf.errors import InputError
from mjsheaf.noise import normal_of, uniforms
from mjsheaf.section import NonNegative, Number, Positive, Section, Tagged

KINDS = ("communication", "sensing")
"""The kinds of edges that have links."""
WHOLE = ("bearing", "delay", "hold")
"""Fields of a LinkModel that are whole numbers for compiled code."""

Probability = Annotated[float, Field(ge=0, le=1)]


class Exact(Tagged):
    """The relative state itself, with white noise and bias where the link has them."""

    kind: Literal["exact"] = Field("exact", description="always exact")


class RangeBearing(Tagged):
    """Range and bearing in the body frame of the tail, which knows its own attitude.

    On an edge with two rows the bearing is an angle in their plane, on one with three azimuth and elevation in the body
    frame as it turns: along the motion on ideal kinematics, the true attitude on bodies.
    """

    kind: Literal["range_bearing"] = Field("range_bearing", description="always range_bearing")
    range_noise: NonNegative = Field(0.0, description="standard deviation of the range [m]")
    bearing_noise: Annotated[float, Field(ge=0, le=180)] = Field(
        0.0, description="standard deviation of every angle [degrees]"
    )


class GilbertElliott(Tagged):
    """Losses in bursts: a Markov chain of a good and a bad state, which changes before each sample."""

    kind: Literal["gilbert_elliott"] = Field("gilbert_elliott", description="always gilbert_elliott")
    to_bad: Probability = Field(description="probability of a change from good to bad, at each sample [-]")
    to_good: Probability = Field(description="probability of a change from bad to good, at each sample [-]")
    loss_good: Probability = Field(0.0, description="probability of a loss in the good state, at each sample [-]")
    loss_bad: Probability = Field(1.0, description="probability of a loss in the bad state, at each sample [-]")

    @property
    def bad(self) -> float:
        """Stationary probability of the bad state, also at the start; 0 if no state ever changes."""
        total = self.to_bad + self.to_good
        return self.to_bad / total if total > 0.0 else 0.0


class Link(Section):
    """Effects of a link on the measurements of an edge; None leaves a field to a more general section."""

    noise: NonNegative | None = Field(
        None,
        description="standard deviation of white noise on each measured number; of a bearing in degrees [m]",
    )
    bias: Number | None = Field(None, description="constant added to each measured number [m]")
    delay: NonNegative | None = Field(
        None, description="age of a measurement, a whole number of periods of controller.control_period [s]"
    )
    loss: Probability | GilbertElliott | None = Field(
        None, description="probability that a sample is lost, or a chain of a good and a bad state [-]"
    )
    range: Positive | None = Field(
        None, description="distance of the bodies beyond which the link receives nothing [m]"
    )
    hold: NonNegative | None = Field(
        None, description="how long the last measurement stands in for lost ones; after that the edge adds nothing [s]"
    )
    sensor: Annotated[Exact | RangeBearing, Field(discriminator="kind")] | None = Field(
        None, description="what measures; exact but for noise and bias unless given"
    )

    @model_validator(mode="after")
    def _one_noise(self) -> "Link":
        if self.noise and isinstance(self.sensor, RangeBearing):
            raise ValueError("noise with sensor range_bearing; expected its range_noise and bearing_noise, or exact")
        return self

    @property
    def own(self) -> dict[str, Any]:
        """The fields that are named."""
        return {name: value for name in Link.model_fields if (value := getattr(self, name)) is not None}


class RoundLink(Section):
    """Effects of links on the messages of agents in rounds of feedforward and newton."""

    delay: NonNegative = Field(
        0.0, description="age of a message, a whole number of control periods; if positive, one round a period [s]"
    )
    loss: Probability | GilbertElliott = Field(
        0.0, description="probability that a message is lost, or a chain of a good and a bad state, round by round [-]"
    )


class Links(Section):
    """Links of all edges and of each kind; an edge may have the same fields."""

    all: Link | None = Field(None, description="of communication and sensing")
    communication: Link | None = Field(None, description="of communication edges, before `all`")
    sensing: Link | None = Field(None, description="of sensing edges, before `all`")
    rounds: RoundLink | None = Field(
        None, description="of the messages of feedforward and newton; at once and never lost unless given"
    )
    record: bool | None = Field(None, description="whether result.nc has every measurement, as agents had it")

    def resolve(self, kind: str, own: Link | None = None) -> "LinkModel":
        """The link of an edge of a kind, with its own fields.

        Raises:
            InputError: A sensor range_bearing has noise from a more specific section.
        """
        return model_of(self.all, getattr(self, kind), own)


class LinkModel(NamedTuple):
    """A link with every field, in SI units; compiled code has the same fields (`mjsheaf.law.edges.LINK`).

    Attributes:
        noise: Standard deviation of white noise on each measured number, m.
        bias: Constant added to each measured number, m.
        bearing: True for the sensor range_bearing.
        range_noise: Standard deviation of its range, m.
        bearing_noise: Standard deviation of its angles, rad.
        delay: Age of a measurement, s.
        hold: Time for which the last measurement stands in for lost ones, s.
        range: Distance beyond which the link receives nothing, infinite without one, m.
        to_bad, to_good: Probabilities that the chain of losses changes its state, at each sample.
        bad: Probability that the chain begins in the bad state.
        loss_good, loss_bad: Probabilities of a loss in each state; equal where losses are independent.
    """

    noise: float = 0.0
    bias: float = 0.0
    bearing: bool = False
    range_noise: float = 0.0
    bearing_noise: float = 0.0
    delay: float = 0.0
    hold: float = 0.0
    range: float = np.inf
    to_bad: float = 0.0
    to_good: float = 1.0
    bad: float = 0.0
    loss_good: float = 0.0
    loss_bad: float = 0.0

    @property
    def lossy(self) -> bool:
        """True if a measurement can be lost at random."""
        return self.loss_good > 0.0 or self.loss_bad * self.bad > 0.0

    @property
    def random(self) -> bool:
        """True if random numbers enter."""
        return self.noise > 0.0 or self.range_noise > 0.0 or self.bearing_noise > 0.0 or self.lossy

    @property
    def exact(self) -> bool:
        """True if measurements arrive at once, all of them, without error."""
        return not (self.random or self.bias != 0.0 or self.delay > 0.0 or np.isfinite(self.range))


def model_of(*sections: Link | None) -> LinkModel:
    """The link of sections from the coarsest to the finest."""
    fields: dict[str, Any] = {}
    for section in sections:
        own = section.own if section else {}
        if isinstance(own.get("sensor"), RangeBearing):
            fields.pop("noise", None)  # that of the exact sensor which it replaces
        fields |= own
    sensor, loss = fields.pop("sensor", None), fields.pop("loss", None)
    if isinstance(sensor, RangeBearing):
        if fields.get("noise"):
            raise InputError(
                "noise with the sensor range_bearing of a more general section; expected sensor: {kind: exact} with it"
            )
        angle = float(np.deg2rad(sensor.bearing_noise))
        fields |= {"bearing": True, "range_noise": sensor.range_noise, "bearing_noise": angle}
    chain = loss
    if not isinstance(loss, GilbertElliott):  # independent losses are those of two states with equal ones
        chain = GilbertElliott(to_bad=0.0, to_good=1.0, loss_good=loss or 0.0, loss_bad=loss or 0.0)
    return LinkModel(**fields, **chain.model_dump(exclude={"kind"}), bad=chain.bad)


def require_bearing(F_tail: Array, F_head: Array) -> None:
    """Check that maps are F_tail = R P and F_head = R P, P two or three common axes and R a rotation.

    Raises:
        InputError: they are not.
    """
    used = [np.flatnonzero(np.abs(F).max(axis=0, initial=0.0) > 0.0) for F in (F_tail, F_head)]
    m = len(F_tail)
    fits = m in (2, 3) and np.array_equal(used[0], used[1]) and len(used[0]) == m
    R = F_tail[:, used[0]] if fits else np.eye(2)
    if not (fits and np.array_equal(R, F_head[:, used[1]]) and np.allclose(R.T @ R, np.eye(m), rtol=0.0, atol=1e-9)
            and np.linalg.det(R) > 0.0):  # fmt: skip
        raise InputError(
            "sensor range_bearing: expected maps F_tail = R P and F_head = R P, P two or three common axes and R a "
            "rotation: shared, identity or local_frame"
        )


def whole_periods(seconds: float, period: float) -> int:
    """A delay in control periods.

    Raises:
        InputError: it is no whole number of them.
    """
    ratio = seconds / period
    n = round(ratio)
    if abs(ratio - n) > 1e-6 * max(1.0, ratio):
        below, above = (f"{k * period:.6g}" for k in (int(ratio), int(ratio) + 1))
        raise InputError(
            f"{seconds:.6g} s is no whole number of control periods of {period:.6g} s; expected {below} or {above}"
        )
    return n


@inline_jit
def perceive(seed, link, n, draw, F, attitude, tail, y):
    """Add the errors of a link's sensor to the measurement y of an edge, in place; each kind of sensor is a branch.

    Args:
        seed: Seed of the run.
        link: The link: the fields of its LinkModel, and its `stream` of random numbers.
        n: Number of the sample.
        draw: Random numbers of that sample, (4,); the sensor may use the last three.
        F: Map F_tail, shape (m, 3).
        attitude: Attitudes of the vehicles, shape (V, 4), if a sensor needs them.
        tail: Number of the vehicle that measures.
        y: True relative state, shape (m,), m.
    """
    if link.bearing:
        far, angle = link.range_noise * normal_of(draw[1]), link.bearing_noise * normal_of(draw[2])
        if y.shape[0] == 2:
            r, c, s = np.sqrt(y[0] * y[0] + y[1] * y[1]), np.cos(angle), np.sin(angle)
            longer = (r + far) / r if r > 0.0 else 0.0  # a range of 0 has no direction, and is measured as 0
            y[0], y[1] = longer * (c * y[0] - s * y[1]), longer * (s * y[0] + c * y[1])
        else:
            perceive_space(F, attitude[tail], far, angle, link.bearing_noise * normal_of(draw[3]), y)
    elif link.noise > 0.0:
        for r in range(y.shape[0]):  # three numbers of `draw`, then four of each further draw
            word = (r + 1) % 4
            if r > 0 and word == 0:
                draw = uniforms(seed, link.stream, n, 2 + (r - 3) // 4)
            y[r] += link.noise * normal_of(draw[word])
    if link.bias != 0.0:
        for r in range(y.shape[0]):
            y[r] += link.bias


@inline_jit
def perceive_space(F, attitude, far, azimuth, elevation, y):
    """Add errors to range, azimuth and elevation in the frame of a body, in place; y (3,) is F x of a relative x."""
    dx = F[0, 0] * y[0] + F[1, 0] * y[1] + F[2, 0] * y[2]
    dy = F[0, 1] * y[0] + F[1, 1] * y[1] + F[2, 1] * y[2]
    dz = F[0, 2] * y[0] + F[1, 2] * y[1] + F[2, 2] * y[2]
    w, i, j, k = attitude[0], attitude[1], attitude[2], attitude[3]
    bx, by, bz = turn(w, -i, -j, -k, dx, dy, dz)
    across = np.sqrt(bx * bx + by * by)
    r = np.sqrt(across * across + bz * bz)
    a, e = np.arctan2(by, bx) + azimuth, np.arctan2(bz, across) + elevation
    r = r + far if r > 0.0 else 0.0
    dx, dy, dz = turn(w, i, j, k, r * np.cos(e) * np.cos(a), r * np.cos(e) * np.sin(a), r * np.sin(e))
    for row in range(3):
        y[row] = F[row, 0] * dx + F[row, 1] * dy + F[row, 2] * dz


@inline_jit
def turn(w, i, j, k, x, y, z):
    """The vector (x, y, z) turned by the unit quaternion (w, i, j, k)."""
    a, b, c = 2.0 * (j * z - k * y), 2.0 * (k * x - i * z), 2.0 * (i * y - j * x)
    return x + w * a + (j * c - k * b), y + w * b + (k * a - i * c), z + w * c + (i * b - j * a)
