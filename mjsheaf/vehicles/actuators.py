"""Actuators by kind: the forces that each can produce, its actuators in MuJoCo, and its branch in the compiled loop.

Allocation is linear in efforts: W maps them to the wrench on the body. The single effort of a fixed thruster is its
command. An azimuth thruster has two efforts, the components of its thrust along its site's direction and to port of it.
Its branch converts them to a thrust and an angle. Every effort has a channel: a MuJoCo actuator with its command in
ctrl.

A propeller with a rudder has two efforts too: the force ahead and, in proportion, the force to port. With u and v the
velocity of the rudder ahead and to port through the water, T the thrust and delta the deflection:

    inflow         a |a| = u |u| + 2 eta T / (rho A_p), b = v: momentum theory of the propeller's disc A_p far behind
                   it, with eta the fraction of the rudder in its race (Molland and Turnock, Marine Rudders and Control
                   Surfaces, 2007, ch. 3); a propeller with astern thrust has its race ahead of it
    normal force   F = -1/2 rho A_R U f n, limited where |n| > U sin(stall), with U^2 = a^2 + b^2, the normal velocity
                   n = b cos(delta) - a sin(delta), and f = 6.13 Lambda / (Lambda + 2.25) for a plate of aspect ratio
                   Lambda (Fujii; Yasukawa and Yoshimura, J. Mar. Sci. Technol. 20, 2015): lift F cos(alpha) and
                   drag F sin(alpha) at an incidence alpha; F n <= 0, so it takes energy out of the flow

The force acts behind the propeller. The model omits the influence of the hull (flow straightening, wake). W is the
wrench of full deflection at rest at a given thrust. Speed ahead increases it, so efforts that are feasible at rest are
feasible at any speed. `aim` inverts the model at the measured velocity. Without thrust and speed there is no force,
whatever the deflection.

A new kind subclasses `Thruster` and has a section with `fit`, named in `AnyActuator`. If its force depends on velocity,
it has a code `flow` with a branch in `flow_wrench`. If its efforts are not its commands, it has a code with a branch in
`aim`, `unit_wrench` and `bodies.allocate_within_limits`. `actuator_force` repeats MuJoCo's dynamics of any actuator,
for the engine that runs without MuJoCo.
"""

from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from mjsheaf.arrays import Array, freeze
from mjsheaf.compile.jit import apart_jit, inline_jit, jit
from mjsheaf.errors import InputError
from mjsheaf.section import Section
from mjsheaf.vectors import add, cross, triple

Range = tuple[float, float] | None  # a range of MuJoCo's: lower and upper limit, or None

LAGS = ("none", "filter", "filterexact")
"""Supported dynamics of a thruster: values of dyntype in MJCF."""

FIXED, AZIMUTH, ANGLE, RUDDER = 0, 1, 2, 3  # codes of channels
BLADE = 1  # code of a velocity-dependent force: that of a rudder
CHANNEL = np.dtype(
    [
        ("direction", "f8", 3),  # force on the body for a force of 1, body axes; for an angle, at 90 degrees
        ("row", "f8", 6),  # of the allocation W^+
        ("low", "f8"),  # limits of the command
        ("high", "f8"),
        ("code", "i8"),  # FIXED, AZIMUTH or RUDDER; the channel after an AZIMUTH or RUDDER is its ANGLE
        ("moment", "f8", 3),  # moment on the body for a force of 1, like direction
        ("reach", "f8"),  # maximum distance of an angle's command from the angle, rad
        ("dead_band", "f8"),  # effort below which an angle follows in proportion to the effort, N
        ("state", "i8"),  # index of its activation among its vehicle's
        # MuJoCo's response to the command: see `actuator_force`
        ("gain", "f8"),
        ("late", "i8"),  # 1 if it has an activation
        ("early", "i8"),  # 1 if its force uses the activation after the step
        ("followed", "f8"),  # fraction of the distance to its command that the activation covers in a step
        ("ctrl", "f8", 2),  # ranges
        ("act", "f8", 2),
        ("force", "f8", 2),
        ("planar", "f8", 3),  # wrench of an effort of 1 on the rows surge, sway and yaw: see `allocation`
        ("flow", "i8"),  # code of its branch in `flow_wrench`, 0 if its force does not depend on velocity
        # fields of the ANGLE of a RUDDER
        ("position", "f8", 3),  # m
        ("race", "f8"),  # 2 eta / (rho A_p), m^2/s^2 for 1 N of thrust
        ("normal", "f8"),  # 1/2 rho A_R f, kg/m
        ("stall", "f8"),  # sine of the incidence above which the normal force is constant
        ("side", "f8"),  # force to port for an effort of 1
    ],
    align=True,
)

WEAK_SIDE = 0.1
"""Ratio of the smaller to the larger limit of an actuator below which it counts as one-sided."""

_SHORTEST = 1e-15  # MuJoCo's lower limit on time constants, s
_NO_LIMIT = 1e9  # a range of this size counts as no limit; MJCF files use one to detect commands that diverge
_NORMALS = 2.0 * np.pi * np.arange(72) / 72  # rad; normals of the half-planes around an azimuth thruster's efforts
DEAD_BAND = 1e-6
"""Dead band of an azimuth thruster, as a fraction of its largest thrust, or of its vehicle's weight if it has no limit.

Rounding leaves efforts of about 1e-16 of the thrust, or 1e-13 of it 10 km from the origin. That is at most 1e-7 of the
band, so an angle turns at most at 1e-7 of its rate: 0.1 rad of turning becomes 1e-8 rad. A force within the band is
negligible: 2.4 mN move a WAM-V of 211 kg at 0.02 mm/s against its drag.
"""
_OVERLAP = 0.2  # fraction of a force that an azimuth thruster omits before it reverses by turning 180 degrees
_PORT = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # turns rows by 90 degrees to port
_AIM_ROUNDS = 4  # iterations for a rudder: thrust compensates for its drag, and deflection depends on thrust


class Channel(NamedTuple):
    """A MuJoCo actuator, as recorded.

    Attributes:
        name: Name, unique in its vehicle.
        unit: Unit of its command.
        low: Lower limit of its command.
        high: Upper limit of its command.
    """

    name: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class Thruster:
    """An actuator on a site of the MJCF file, fixed in the body: its effort is its command.

    Attributes:
        name: Name of the actuator.
        wrench: Wrench for a command of 1, body axes about the origin, shape (6,), N and N m.
        gain: MuJoCo's force for a command of 1.
        ctrl: Range of MuJoCo's commands.
        force: Range of MuJoCo's forces.
        act: Range of MuJoCo's activations.
        law: Dynamics from command to force, one of LAGS.
        time_constant: Time constant of the dynamics, s.
        early: True if its force uses the activation after the step.
    """

    name: str
    wrench: Array
    gain: float = 1.0
    ctrl: Range = None
    force: Range = None
    act: Range = None
    law: str = "none"
    time_constant: float = 1.0
    early: bool = False

    def __post_init__(self) -> None:
        freeze(vars(self).values())

    @property
    def wrenches(self) -> Array:
        """Wrench for each effort of 1, body axes about the origin, shape (e, 6), N and N m."""
        return self.wrench[None]

    @property
    def thrust(self) -> tuple[float, float]:
        """Lowest and highest command that has an effect within all ranges."""
        low, high = -np.inf, np.inf
        late, scale = self.act if self.law != "none" else None, self.gain or 1.0
        force = self.force and (self.force[0] / scale, self.force[1] / scale)
        for limits in (self.ctrl, late, force):
            if limits:
                low, high = max(low, min(limits)), min(high, max(limits))
        return low if low > -_NO_LIMIT else -np.inf, high if high < _NO_LIMIT else np.inf

    @property
    def one_sided(self) -> bool:
        """Return True if it pushes in one direction only, or very little in the other."""
        low, high = self.thrust
        return min(high, -low) < WEAK_SIDE * max(high, -low)

    @property
    def bounds(self) -> Array:
        """Lowest and highest of each effort, shape (e, 2)."""
        return np.array([self.thrust])

    @property
    def half_planes(self) -> tuple[Array, Array]:
        """A (r, e) and b (r,) of further limits A u <= b on efforts u."""
        return np.zeros((0, len(self.channels))), np.zeros(0)

    @property
    def channels(self) -> list[Channel]:
        """Channels of the efforts, in the same order."""
        return [Channel(self.name, "N", *self.thrust)]

    @property
    def lag(self) -> float:
        """Time constant with which efforts follow commands, s."""
        return self.time_constant if self.law != "none" else 0.0

    def command(self, effort: Array) -> Array:
        """Return the commands that produce an effort, shape (e,), at rest; shape (e,)."""
        return effort

    def why_rough(self, command: Array, least: float) -> str:
        """Explain why it does not follow small changes of effort linearly about commands, shape (e,); empty if it does.

        Thrusts up to `least` count as none.
        """
        within = all(c.low < value < c.high for c, value in zip(self.channels, command, strict=True))
        return "" if within else "its thrusters are at their limits"

    def without_limits(self) -> "Thruster":
        """Return the same thruster without limits."""
        return replace(self, ctrl=None, force=None, act=None)

    def without_lag(self) -> "Thruster":
        """Return the same thruster without lag."""
        return replace(self, law="none", act=None)

    def to_mujoco(self, gears: Array) -> list[dict[str, Any]]:
        """Return the arguments of `MjSpec.add_actuator` for each channel; gears are for efforts of 1 / gain, (e, 6)."""
        own = _actuator(self.name, gears[0], self.gain, self.law, self.time_constant)
        own["actearly"] = self.early
        for name, limits in (("ctrl", self.ctrl), ("force", self.force), ("act", self.act)):
            own[f"{name}limited"] = int(limits is not None)
            if limits is not None:
                own[f"{name}range"] = limits
        return [own]

    def pack(self, channels: NDArray[np.void], timestep: float, weight: float = 0.0) -> None:
        """Write the fields that are specific to the kind into its CHANNEL records.

        Args:
            channels: Records of the thruster, shape (e,).
            timestep: Timestep of the physics, s.
            weight: Weight of the vehicle, N, used as the scale of a thrust without limits.
        """
        channels["code"] = FIXED
        one = channels[0]
        one["gain"], one["late"], one["early"] = self.gain, self.law != "none", self.early
        if one["late"]:
            steps = timestep / max(self.time_constant, _SHORTEST)
            one["followed"] = steps if self.law == "filter" else -np.expm1(-steps)
        for name, limits in (("ctrl", self.ctrl), ("force", self.force), ("act", self.act)):
            one[name] = limits or (-np.inf, np.inf)


class Mount(NamedTuple):
    """Place of a thruster in the body, body axes.

    Attributes:
        arm: Position of its site, shape (3,), m.
        force: Force for a command of 1, shape (3,), N.
        torque: Moment for a command of 1 about the site, shape (3,), N m.
    """

    arm: Array
    force: Array
    torque: Array


class Azimuth(Section):
    """Rotation of a thruster of the MJCF file about the vertical axis through its site."""

    kind: Literal["azimuth"] = Field(description="always azimuth")
    angle: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(
        description="lowest and highest angle; 0 is the site's own direction, positive to port [degrees]"
    )
    rate: Annotated[float, Field(gt=0)] = Field(description="maximum rate of turn [degrees/s]")
    lag: Annotated[float, Field(ge=0)] = Field(
        0.0, description="time constant with which the angle follows its command [s]"
    )

    @model_validator(mode="after")
    def _ordered(self) -> "Azimuth":
        if not -360.0 <= self.angle[0] < self.angle[1] <= 360.0:
            raise ValueError("angle: expected the lowest, then the highest, from -360 to 360 degrees")
        return self

    def fit(self, thruster: Thruster, mount: Mount) -> "AzimuthThruster":
        """Return a thruster of the MJCF file as an azimuth thruster.

        Raises:
            InputError: Its thrust is not horizontal.
        """
        if not max(abs(mount.force[2]), abs(mount.torque[2])) < 1e-9 * np.hypot(*mount.force[:2]):
            raise InputError("expected a horizontal thrust and no torque about the vertical")
        force = mount.force @ _PORT
        low, high, rate = map(float, np.deg2rad([*self.angle, self.rate]))
        return AzimuthThruster(
            **vars(thruster),
            sideways=np.concatenate([force, np.cross(mount.arm, force) + mount.torque @ _PORT]),
            low=low,
            high=high,
            rate=rate,
            angle_lag=self.lag,
        )


@dataclass(frozen=True, kw_only=True)
class AzimuthThruster(Thruster):
    """A thruster that turns about the vertical axis through its site.

    One channel is its thrust in N, with the limits and lag of the MJCF file. The other is its angle in rad, stored as
    an activation, so that MuJoCo saves and restores it with its state.

    Attributes:
        sideways: Wrench for a command of 1 at 90 degrees, shape (6,), N and N m.
        low: Lower limit of the angle, rad.
        high: Upper limit of the angle, rad.
        rate: Maximum rate of the angle, rad/s.
        angle_lag: Time constant with which the angle follows its command, s.
        angle_name: Word for the angle in the name of its channel.
    """

    angle_name: ClassVar[str] = "angle"

    sideways: Array
    low: float
    high: float
    rate: float
    angle_lag: float

    @property
    def wrenches(self) -> Array:
        """Wrenches for thrust along the site's direction, and to port of it."""
        return np.array([self.wrench, self.sideways])

    @property
    def channels(self) -> list[Channel]:
        """Channels of thrust and angle."""
        return [*super().channels, Channel(f"{self.name}_{self.angle_name}", "rad", self.low, self.high)]

    def _reach(self, normals: Array) -> Array:
        """Compute the largest effort along directions, shape (k,), rad."""
        angles = normals + 2.0 * np.pi * np.arange(-2, 3)[:, None]
        ahead, astern = (((self.low <= a) & (a <= self.high)).any(axis=0) for a in (angles, angles + np.pi))
        ends = np.cos([self.low - normals, self.high - normals])
        cosines = np.where(astern, -1.0, ends.min(axis=0)), np.where(ahead, 1.0, ends.max(axis=0))
        return np.asarray(np.max([thrust * c for thrust in self.thrust for c in cosines], axis=0))

    @property
    def one_sided(self) -> bool:
        """Return True if it pushes in one direction only and turns by less than 180 degrees."""
        return super().one_sided and self.high - self.low < np.pi

    @property
    def bounds(self) -> Array:
        """Bounding box of its efforts."""
        if not np.isfinite([*self.thrust, self.low, self.high]).all():
            return np.array([[-np.inf, np.inf]] * 2)
        ahead, port, astern, starboard = self._reach(np.pi * np.array([0.0, 0.5, 1.0, 1.5]))
        return np.array([[-astern, ahead], [-starboard, port]])

    @property
    def half_planes(self) -> tuple[Array, Array]:
        """Tangents to the convex hull of its efforts, within 0.1 %."""
        if not np.isfinite(self.bounds).all():
            return super().half_planes
        return np.column_stack([np.cos(_NORMALS), np.sin(_NORMALS)]), self._reach(_NORMALS)

    @property
    def lag(self) -> float:
        """Time constant of the slower one of thrust and angle, s."""
        return max(super().lag, self.angle_lag)

    def command(self, effort: Array) -> Array:
        """Thrust ahead at the effort's angle, or none at the angle nearest to 0."""
        angle = np.arctan2(effort[1], effort[0]) if effort.any() else min(max(0.0, self.low), self.high)
        return np.array([np.hypot(*effort), angle])

    def why_rough(self, command: Array, least: float) -> str:
        """Without thrust it has no direction: what is small turns it far."""
        aimless = "" if abs(command[0]) > least else "an azimuth thruster has no direction without thrust"
        return super().why_rough(command, least) or aimless

    def without_limits(self) -> "AzimuthThruster":
        """Return the same thruster without limits on thrust, angle and rate."""
        return replace(self, ctrl=None, force=None, act=None, low=-np.inf, high=np.inf, rate=np.inf)

    def without_lag(self) -> "AzimuthThruster":
        """Return the same thruster without lag; the rate of its angle remains limited."""
        return replace(self, law="none", act=None, angle_lag=0.0)

    def to_mujoco(self, gears: Array) -> list[dict[str, Any]]:
        """Return the arguments for thrust and angle; the angle's force equals the angle and has no gear."""
        angle = _actuator(f"{self.name}_{self.angle_name}", np.zeros(6), 1.0, "filterexact", self.angle_lag)
        if np.isfinite([self.low, self.high]).all():
            angle |= {"ctrllimited": 1, "ctrlrange": (self.low, self.high)}
        return [*super().to_mujoco(gears), angle]

    def pack(self, channels: NDArray[np.void], timestep: float, weight: float = 0.0) -> None:
        """Write the fields of thrust and angle; rate and lag limit how far a command may be ahead of the angle."""
        super().pack(channels, timestep)
        limits = np.abs(self.thrust)
        largest = limits[np.isfinite(limits)].max(initial=0.0)
        channels["dead_band"] = DEAD_BAND * (largest if largest > 0.0 else weight)
        channels["code"] = AZIMUTH, ANGLE
        followed = -np.expm1(-timestep / self.angle_lag) if self.angle_lag > 0.0 else 1.0  # in a step
        channels["reach"] = self.rate * timestep / followed
        angle, free = channels[1], (-np.inf, np.inf)
        angle["gain"], angle["late"], angle["followed"] = 1.0, True, followed
        angle["act"] = angle["force"] = free
        angle["ctrl"] = (self.low, self.high) if np.isfinite([self.low, self.high]).all() else free


class Rudder(Section):
    """A rudder behind a propeller of the MJCF file that pushes ahead; see the module."""

    kind: Literal["rudder"] = Field(description="always rudder")
    angle: Annotated[float, Field(gt=0, lt=90)] = Field(description="largest deflection to either side [degrees]")
    rate: Annotated[float, Field(gt=0)] = Field(description="maximum rate of turn [degrees/s]")
    lag: Annotated[float, Field(ge=0)] = Field(
        0.0, description="time constant with which the deflection follows its command [s]"
    )
    behind: Annotated[float, Field(ge=0)] = Field(description="distance of the rudder behind the propeller's site [m]")
    area: Annotated[float, Field(gt=0)] = Field(description="area of the blade A_R [m^2]")
    span: Annotated[float, Field(gt=0)] = Field(description="height of the blade; aspect ratio is span^2 / area [m]")
    diameter: Annotated[float, Field(gt=0)] = Field(description="diameter of the propeller [m]")
    slipstream: Annotated[float, Field(gt=0, le=1)] = Field(
        description="fraction eta of the blade in the propeller's race [-]"
    )
    stall: Annotated[float, Field(gt=0, le=90)] = Field(
        35.0, description="incidence above which the normal force is constant [degrees]"
    )
    density: Annotated[float, Field(gt=0)] = Field(1025.0, description="density of the water [kg/m^3]")

    def fit(self, thruster: Thruster, mount: Mount) -> "RudderThruster":
        """Return a thruster of the MJCF file with this rudder behind it.

        Raises:
            InputError: It does not push straight ahead with 1 N for a command of 1, or the rudder's drag exceeds its
                thrust.
        """
        if thruster.gain != 1.0 or not np.allclose(mount.force, [1.0, 0.0, 0.0], atol=1e-9):
            raise InputError("a rudder needs a propeller with a thrust straight ahead of 1 N for a command of 1")
        aspect_ratio = self.span**2 / self.area
        normal = 0.5 * self.density * self.area * 6.13 * aspect_ratio / (aspect_ratio + 2.25)
        race = 2.0 * self.slipstream / (self.density * 0.25 * np.pi * self.diameter**2)
        angle, stall, rate = map(float, np.deg2rad([self.angle, self.stall, self.rate]))
        useful = min(angle, stall)
        pushed = normal * race * np.sin(useful) * np.cos(useful)  # force to port for a thrust of 1 N at rest
        ahead = 1.0 - pushed * np.tan(useful)
        if ahead <= 0.0:
            raise InputError("its drag at full deflection exceeds the thrust; expected less area, angle or slipstream")
        side = pushed / (ahead * np.tan(angle))
        position = mount.arm - [self.behind, 0.0, 0.0]
        force = np.array([0.0, side, 0.0])
        return RudderThruster(
            **vars(thruster),
            sideways=np.concatenate([force, np.cross(position, force)]),
            low=-angle,
            high=angle,
            rate=rate,
            angle_lag=self.lag,
            position=position,
            race=race,
            normal=normal,
            stall=float(np.sin(stall)),
            side=side,
        )


@dataclass(frozen=True, kw_only=True)
class RudderThruster(AzimuthThruster):
    """A propeller with a rudder behind it.

    Its efforts are those of a thruster that turns by the deflection, and pushes `side` times as hard to port as one.
    It is commanded ahead only: astern, no race passes the rudder.

    Attributes:
        position: Position of the rudder in the body, shape (3,), m.
        race: Square of the speed that 1 N of thrust adds to the inflow, m^2/s^2.
        normal: Normal force for a speed and a normal velocity of 1 m/s, kg/m.
        stall: Sine of the incidence above which the normal force is constant.
        side: Force to port for an effort of 1 N.
    """

    angle_name = "rudder"

    position: Array
    race: float
    normal: float
    stall: float
    side: float

    @property
    def thrust(self) -> tuple[float, float]:
        """Lowest and highest useful command, ahead only."""
        low, high = super().thrust
        return max(low, 0.0), high

    def why_rough(self, command: Array, least: float) -> str:
        """Explain why it is not linear, which includes a lack of thrust: the rudder may then have no inflow."""
        if command[0] <= least:
            return "a rudder produces no force without thrust or speed"
        return Thruster.why_rough(self, command, least)

    def without_limits(self) -> AzimuthThruster:
        """Return an azimuth thruster without limits, whose force to port does not depend on the flow."""
        own = {field.name: getattr(self, field.name) for field in fields(AzimuthThruster)}
        return AzimuthThruster(**own).without_limits()

    def pack(self, channels: NDArray[np.void], timestep: float, weight: float = 0.0) -> None:
        """Write the fields of thrust and angle, and those of blade and race."""
        super().pack(channels, timestep, weight)
        channels["code"] = RUDDER, ANGLE
        channels[0]["flow"] = BLADE
        for name in ("position", "race", "normal", "stall", "side"):
            channels[1][name] = getattr(self, name)


AnyActuator = Annotated[Azimuth | Rudder, Field(discriminator="kind")]
"""Section of a description about a thruster of the MJCF file."""


def _actuator(name: str, gear: Array, gain: float, law: str, time_constant: float) -> dict[str, Any]:
    from mjsheaf.mujoco_import import mujoco  # not at import, as ideal kinematics do not need it

    return {
        "name": name,
        "gear": gear,
        "gaintype": mujoco.mjtGain.mjGAIN_FIXED,
        "gainprm": [gain, *np.zeros(9)],
        "biastype": mujoco.mjtBias.mjBIAS_NONE,
        "dyntype": getattr(mujoco.mjtDyn, f"mjDYN_{law.upper()}"),
        "dynprm": [time_constant, *np.zeros(9)],
    }


@jit
def aim(channels, velocity, rates, act, ctrl):
    """Turn the efforts of actuators with an angle into commands, in place.

    Args:
        channels: Channels of one vehicle, shape (s,); see CHANNEL.
        velocity: Velocity through the medium, body axes, (3,), m/s.
        rates: Angular velocity, body axes, (3,), rad/s.
        act: Activations of the vehicle.
        ctrl: Efforts on entry, commands on return, shape (s,).
    """
    for k in range(ctrl.shape[0] - 1):
        if channels[k].code == AZIMUTH:
            _aim_azimuth(channels, k, act, ctrl)
        elif channels[k].code == RUDDER:
            _aim_rudder(channels, k, velocity, rates, act, ctrl)


@jit
def _aim_azimuth(channels, k, act, ctrl):
    """Turn the efforts of an azimuth thruster, with its thrust in channel k, into commands.

    An azimuth thruster produces a force at either of two angles, with thrust ahead or astern. Within its limits, it
    takes the one that omits less of the force, or the nearer one. It turns at most at its rate. Meanwhile its thrust is
    the force's component along its present angle. Without a force, the angle stays as it is. Within the dead band, the
    turn of a step is proportional to the force, because rounding errors have a direction too. A threshold would not
    work: two engines whose rounded forces lie on either side of it would differ by the turn of a whole step.
    """
    x, y, thrust, angle = ctrl[k], ctrl[k + 1], channels[k], channels[k + 1]
    size, now = np.sqrt(x * x + y * y), act[angle.state]
    if size < np.inf:  # non-finite values stay, so that they are detected
        wanted, least = now, np.inf if size > 0.0 else 0.0
        for sign in (1.0, -1.0):
            a = nearest_angle(np.arctan2(sign * y, sign * x), now, angle.low, angle.high)
            c, s = np.cos(a), np.sin(a)
            made = min(max(x * c + y * s, thrust.low), thrust.high)
            dx = x - made * c
            dy = y - made * s
            cost = np.sqrt(dx * dx + dy * dy)
            cost += _OVERLAP * size * min(abs(a - now) / np.pi, 1.0)
            if cost < least:
                wanted, least = a, cost
        ctrl[k] = at_most(x * np.cos(now) + y * np.sin(now), thrust.low, thrust.high)
        ctrl[k + 1] = min(max(wanted, now - angle.reach, angle.low), now + angle.reach, angle.high)
        if size < angle.dead_band:
            ctrl[k + 1] = now + size / angle.dead_band * (ctrl[k + 1] - now)


@jit
def _aim_rudder(channels, k, velocity, rates, act, ctrl):
    """Turn the efforts of a propeller with a rudder into thrust, in channel k, and deflection.

    With b = U sin(beta), a force Y to port requires sin(2 delta - beta) = sin(beta) + 2 Y / (normal U^2); the thrust
    compensates for the drag. A small number is added to U^2, so that rounding sets no direction where there is no flow.
    """
    x, side, propeller, rudder = ctrl[k], channels[k + 1].side * ctrl[k + 1], channels[k], channels[k + 1]
    if abs(x) + abs(side) < np.inf:  # non-finite values stay, so that they are detected
        thrust, deflection, most = x, 0.0, np.arcsin(rudder.stall)
        calm = rudder.dead_band / rudder.normal
        for _ in range(_AIM_ROUNDS):
            thrust = at_most(thrust, propeller.low, propeller.high)
            a, b = _inflow(rudder, velocity, rates, thrust)
            square = a * a + b * b + calm
            facing = a / np.sqrt(a * a + calm)
            across = b / np.sqrt(square)
            sine = facing * (across + 2.0 * side / (rudder.normal * square))
            drift = np.arcsin(facing * across)
            deflection = 0.5 * (drift + np.arcsin(min(max(sine, -1.0), 1.0)))
            deflection = min(max(deflection, drift - most), drift + most)
            deflection = min(max(deflection, rudder.low), rudder.high)
            thrust = x - _blade_force(rudder, a, b, deflection)[0]
        now = act[rudder.state]
        ctrl[k] = at_most(thrust, propeller.low, propeller.high)
        ctrl[k + 1] = min(max(deflection, now - rudder.reach, rudder.low), now + rudder.reach, rudder.high)


@inline_jit
def _inflow(rudder, velocity, rates, thrust):
    """Compute the velocity of a rudder through the water around it, ahead and to port, m/s; see the module."""
    moved = add(velocity, cross(rates, triple(rudder.position)))
    square = moved[0] * abs(moved[0]) + rudder.race * max(thrust, 0.0)
    return np.copysign(np.sqrt(abs(square)), square), moved[1]


@inline_jit
def _blade_force(rudder, a, b, deflection):
    """Compute the force on a rudder ahead and to port, N; see the module."""
    c, s = np.cos(deflection), np.sin(deflection)
    speed = np.sqrt(a * a + b * b)
    stalled = rudder.stall * speed
    force = -rudder.normal * speed * min(max(b * c - a * s, -stalled), stalled)
    return -force * s, force * c


@jit
def flow_wrench(channels, velocity, rates, act, ctrl):
    """Compute the force and moment of the flow past a vehicle's actuators, in addition to those of the actuators.

    Args:
        channels: Channels of one vehicle, shape (s,); see CHANNEL.
        velocity: Velocity through the medium, body axes, (3,), m/s.
        rates: Angular velocity, body axes, (3,), rad/s.
        act: Activations of the vehicle.
        ctrl: Commands of the vehicle, shape (s,).

    Returns:
        Force and moment, body axes, (3,) each, as in `unit_wrench`.
    """
    force = moment = (0.0, 0.0, 0.0)
    for k in range(ctrl.shape[0]):
        if channels[k].flow == BLADE:
            propeller, rudder = channels[k], channels[k + 1]
            thrust, _ = actuator_force(
                propeller, propeller.late, ctrl[k], act[propeller.state] if propeller.late else 0.0
            )
            a, b = _inflow(rudder, velocity, rates, thrust)
            ahead, port = _blade_force(rudder, a, b, act[rudder.state])
            port /= rudder.side
            force = add(force, _turned(ahead, port, triple(propeller.direction), triple(rudder.direction)))
            moment = add(moment, _turned(ahead, port, triple(propeller.moment), triple(rudder.moment)))
    return force, moment


@inline_jit
def unit_wrench(channels, k, act):
    """Return the force and moment on the body for a force of 1 of channel k, body axes; `act` are the activations."""
    direction, moment = triple(channels[k].direction), triple(channels[k].moment)
    if channels[k].code == AZIMUTH:
        angle = channels[k + 1]
        c, s = np.cos(act[angle.state]), np.sin(act[angle.state])
        direction = _turned(c, s, direction, triple(angle.direction))
        moment = _turned(c, s, moment, triple(angle.moment))
    elif channels[k].code == ANGLE:
        direction = moment = (0.0, 0.0, 0.0)
    return direction, moment


@inline_jit
def _turned(c, s, ahead, port):
    return c * ahead[0] + s * port[0], c * ahead[1] + s * port[1], c * ahead[2] + s * port[2]


@inline_jit
def actuator_force(channel, late, ctrl, act):
    """Compute MuJoCo's force from a command and, if it is `late`, an activation, and the activation after a step."""
    u = min(max(ctrl, channel.ctrl[0]), channel.ctrl[1])
    after = act
    if late:
        after = min(max(act + channel.followed * (u - act), channel.act[0]), channel.act[1])
        u = after if channel.early else act  # a selection, no branch: this is also evaluated in lanes
    return min(max(channel.gain * u, channel.force[0]), channel.force[1]), after


@jit
def nearest_angle(angle, now, low, high):
    """Return the angle nearest to `now`, equal to `angle` up to whole turns, within limits; else the nearer limit."""
    turn = 2.0 * np.pi
    a = angle + turn * np.floor((now - angle) / turn + 0.5)
    if a > high or a < low:
        b = a - turn * np.ceil((a - high) / turn) if a > high else a + turn * np.ceil((low - a) / turn)
        a = b if low <= b <= high else (high if np.cos(high - a) > np.cos(low - a) else low)
    return a


@inline_jit
def room_within(u, du, low, high):
    """Return the largest fraction, 0 to 1, of an additional effort du that keeps an effort u within limits."""
    room = 1.0
    if u + du > high and du > 0.0:
        room = max(0.0, (high - u) / du)
    elif u + du < low and du < 0.0:
        room = max(0.0, (low - u) / du)
    return room


@apart_jit
def room_of_azimuth(thrust, angle, u, du, v, dv):
    """Return the largest fraction, 0 to 1, of additional efforts that an azimuth thruster can produce.

    Args:
        thrust, angle: Its two channels.
        u, v: Efforts of the two.
        du, dv: Additional efforts.
    """
    # Thrust ahead if it can turn towards the force, astern if it can turn away from it, or either.
    room, bearing = 1.0, np.arctan2(v + dv, u + du)
    ahead = np.cos(nearest_angle(bearing, bearing, angle.low, angle.high) - bearing)
    astern = np.cos(nearest_angle(bearing + np.pi, bearing, angle.low, angle.high) - bearing)
    most = max(thrust.high if ahead >= -astern - 1e-9 else 0.0, -thrust.low if -astern >= ahead - 1e-9 else 0.0)
    if not (u + du) * (u + du) + (v + dv) * (v + dv) <= most * most:
        a, b, c = du * du + dv * dv, u * du + v * dv, u * u + v * v - most * most
        room = max(0.0, (np.sqrt(b * b - a * c) - b) / a) if c < 0.0 else 0.0
    return room


@inline_jit
def at_most(u, low, high):
    """Clip a command to its limits, and round it to one that is within rounding; non-finite values stay."""
    slack = 1e-9 * (high - low)
    if u > high - slack:
        return high if u < np.inf else u
    if u < low + slack:
        return low if u > -np.inf else u
    return u
