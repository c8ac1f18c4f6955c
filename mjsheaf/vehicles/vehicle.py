"""Vehicles, their descriptions in models/NAME.yaml, and their reduced models.

A description contains the properties of a vehicle that MJCF has no place for: its medium, the effects of the medium
(drag, added mass, hydrostatics), and the control of the commanded velocity by its onboard computer. Axes are those of
the body: x forward, y port, z up. Wrenches are [force; moment] about the origin of the body frame, in body axes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used
from numpy.typing import NDArray
from pydantic import Field, model_validator

from mjsheaf.arrays import Array, IntArray, freeze
from mjsheaf.errors import InputError
from mjsheaf.section import Positive, Section
from mjsheaf.vehicles.actuators import AnyActuator, Channel, Rudder, Thruster
from mjsheaf.vehicles.steering import AnySteering, HandPoint, Steering, ThrustVector

GRAVITY = 9.81  # m/s^2
AIR_DENSITY = 1.225  # kg/m^3, at sea level and 15 degrees C

_STIFF = 10.0  # 1/s: rate D / M above which drag is stiff

ROW_NAMES = ("surge force", "sway force", "heave force", "roll moment", "pitch moment", "yaw moment")


class Inertial(NamedTuple):
    """Inertia of one body of an MJCF file, as compiled.

    Attributes:
        position: Position of the centre of mass in the body's frame, shape (3,), m.
        quaternion: Quaternion of the principal axes, shape (4,).
        mass: Mass, kg.
        diagonal: Principal moments of inertia, shape (3,), kg m^2.
    """

    position: Array
    quaternion: Array
    mass: float
    diagonal: Array


class AttitudeHold(Section):
    """Desired attitude, held by the thrusters as a second-order system.

    A boat steered at its hand point holds no attitude; the values apply if underactuation is switched off.
    """

    frequency: Annotated[float, Field(gt=0)] = Field(description="natural frequency [rad/s]")
    damping: Annotated[float, Field(gt=0)] = Field(1.0, description="damping ratio [-]")


@dataclass(frozen=True)
class Body:
    """A rigid body in a medium, and its actuators.

    Attributes:
        dimension: Dimension of the controlled position: 2 on the surface, 3 in a volume.
        mass: Mass, kg.
        weight: Weight that thrusters or water must carry, N: m g minus MuJoCo's compensation (gravcomp).
        ballast: Part of the weight that the body does not have in the model, N; see effects.
        centre_of_mass: Centre of mass in the body frame, shape (3,), m.
        weight_moment: Sum over bodies of weight, minus MuJoCo's compensation, times its position in the body frame,
            shape (3,), N m.
        inertia: Inertia about the origin of the body frame, body axes, shape (3, 3), kg m^2.
        inertials: Inertias of the bodies in the file, depth first.
        radius: Radius about the origin of the body frame that holds what is seen of it, m.
        size: Longest side of the box about all of its geoms along the body axes, m; 0 without geoms.
        actuators: Actuators of the vehicle.
        hold: Parameters of the attitude hold.
        drag: Linear drag D along the body axes, shape (3,), N s/m.
        angular_drag: Linear drag about the body axes, shape (3,), N m s/rad.
        quadratic_drag: Coefficients of |v| v along and |omega| omega about the body axes, shape (6,), N s^2/m^2 and
            N m s^2/rad^2.
        added_mass: Mass of the medium that moves with the body along and about its axes, shape (6,), kg and kg m^2.
        windage: Force of the wind on a hull, shape (4,); see `Windage.pack`.
    """

    dimension: int
    mass: float
    weight: float
    ballast: float
    centre_of_mass: Array
    weight_moment: Array
    inertia: Array
    inertials: list[Inertial]
    radius: float
    size: float
    actuators: list[Thruster]
    hold: AttitudeHold
    drag: Array
    angular_drag: Array
    quadratic_drag: Array
    added_mass: Array
    windage: Array

    def __post_init__(self) -> None:
        freeze([*vars(self).values(), *(value for inertial in self.inertials for value in inertial)])

    @cached_property
    def channels(self) -> list[Channel]:
        """Its actuators in MuJoCo, length s: names, units and limits of commands."""
        return [channel for actuator in self.actuators for channel in actuator.channels]

    @property
    def thrusters(self) -> list[str]:
        """Names of the channels."""
        return [channel.name for channel in self.channels]

    @property
    def limits(self) -> Array:
        """Lowest and highest useful command of each channel, shape (s, 2)."""
        return np.array([(channel.low, channel.high) for channel in self.channels]).reshape(-1, 2)

    @cached_property
    def W(self) -> Array:  # noqa: N802
        """Wrench for each effort of 1, shape (6, s), N and N m; see `actuators`."""
        return np.array([wrench for actuator in self.actuators for wrench in actuator.wrenches]).reshape(-1, 6).T

    @property
    def effort_bounds(self) -> Array:
        """Lowest and highest of each effort, shape (s, 2)."""
        return np.concatenate([np.zeros((0, 2)), *(actuator.bounds for actuator in self.actuators)])

    @property
    def half_planes(self) -> tuple[Array, Array]:
        """A (r, s) and b (r,) of A u <= b, which efforts u satisfy in addition to their bounds."""
        if not self.actuators:
            return np.zeros((0, 0)), np.zeros(0)
        A, b = zip(*(actuator.half_planes for actuator in self.actuators), strict=True)
        return scipy.linalg.block_diag(*A), np.concatenate(b)

    def solve_for_efforts(self, A: Array, b: Array, cost: Array) -> float:
        """Return the s >= 0 of the minimum-cost solution of A [u; s] = b with efforts u within limits.

        It is infinite if s is unbounded, and 0 if there is no solution.
        """
        planes, heights = self.half_planes
        answer = scipy.optimize.linprog(
            cost,
            A_ub=np.column_stack([planes, np.zeros(len(heights))]) if len(heights) else None,
            b_ub=heights if len(heights) else None,
            A_eq=A,
            b_eq=b,
            bounds=[*self.effort_bounds, (0.0, np.inf)],
        )
        if answer.status == 3:
            return float("inf")
        return float(answer.x[-1]) if answer.status == 0 else 0.0

    def largest_along(self, rows: list[int], along: Array, carried: Array) -> float:
        """Return the largest s for which efforts within limits satisfy W u = carried + s along on `rows`."""
        cost = np.append(np.zeros(self.W.shape[1]), -1.0)
        return self.solve_for_efforts(np.column_stack([self.W[rows], -along[rows]]), carried[rows], cost)

    def by_actuator(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Split efforts or commands, shape (s,), by actuator."""
        ends = np.cumsum([len(actuator.channels) for actuator in self.actuators], dtype=np.int64)
        return np.split(values, ends)[:-1]

    @property
    def moving_mass(self) -> Array:
        """Mass along, and inertia about, each body axis that a thruster must accelerate, shape (6,), kg and kg m^2."""
        return np.concatenate([np.full(3, self.mass), np.diag(self.inertia)]) + self.added_mass

    @property
    def lag(self) -> float:
        """Mean time constant of the actuators, s."""
        return float(np.mean([actuator.lag for actuator in self.actuators])) if self.actuators else 0.0

    @property
    def rigid_mass(self) -> Array:
        """Rigid-body mass matrix M_RB about the origin, shape (6, 6): kg, kg m, kg m^2."""
        x, y, z = self.mass * self.centre_of_mass
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.block([[self.mass * np.eye(3), -cross], [cross, self.inertia]])

    @property
    def rigid_wrench_map(self) -> Array:
        """M_RB (M_RB + M_A)^-1, shape (6, 6).

        Maps an applied wrench to the one that gives the rigid body alone the same acceleration.
        """
        if not self.added_mass.any():
            return np.eye(6)
        rigid = self.rigid_mass
        return np.asarray(np.linalg.solve(rigid + np.diag(self.added_mass), rigid).T)

    @property
    def joint_damping(self) -> Array:
        """Linear damping applied by the free joint, shape (6,), N s/m and N m s/rad.

        MuJoCo integrates damping of joints implicitly, so stiff drag needs no small steps. This costs another
        factorization of the mass matrix, so drag that is not stiff is an applied force, which is stable up to steps of
        0.2 s. Bodies with added mass require an applied force: see `mjsheaf.loop.bodies`. The choice does not depend on
        the timestep. The errors of both are of first order in it, but that of the force is several times larger, so a
        run that switched would be less accurate with a smaller step.
        """
        fastest = max(*(self.drag / self.mass), *(self.angular_drag / np.diag(self.turning_inertia)))
        if self.added_mass.any() or fastest <= _STIFF * (1.0 + 1e-9):  # allows for the rounding of m / tau
            return np.zeros(6)
        return np.array([*np.full(3, self.drag.max()), *self.angular_drag])

    @property
    def gears(self) -> Array:
        """Wrench on the free joint for each effort of 1 / gain, shape (s, 6); zero if the gain is zero."""
        gain = np.array([a.gain for a in self.actuators for _ in a.channels])  # W holds gain times gear
        wrenches = self.W.T @ self.rigid_wrench_map.T
        return np.divide(wrenches, gain[:, None], out=np.zeros((len(gain), 6)), where=gain[:, None] != 0)

    @property
    def turning_inertia(self) -> Array:
        """Effective inertia for a couple: inertia about the centre of mass plus added inertia, shape (3, 3), kg m^2."""
        c = self.centre_of_mass
        return self.inertia - self.mass * (c @ c * np.eye(3) - np.outer(c, c)) + np.diag(self.added_mass[3:])


Triple = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=3, max_length=3)]
Six = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=6, max_length=6)]


class Drag(Section):
    """Drag relative to the medium along and about the body's axes: D v + Q |v| v; give time_constant or linear."""

    time_constant: Annotated[float, Field(gt=0)] | None = Field(
        None, description="m / D of isotropic linear drag; give this or linear [s]"
    )
    linear: Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=3, max_length=3)] | None = Field(
        None, description="surge, sway, heave; give this or time_constant [N s/m]"
    )
    quadratic: Triple = Field([0.0, 0.0, 0.0], description="surge, sway, heave [N s^2/m^2]")
    angular: Triple = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw [N m s/rad]")
    angular_quadratic: Triple = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw [N m s^2/rad^2]")

    @model_validator(mode="after")
    def _one(self) -> "Drag":
        if (self.time_constant is None) == (self.linear is None):
            raise ValueError("give either time_constant or linear")
        return self


class Hydrostatics(Section):
    """Restoring of a floating vehicle about its waterline, which is z = 0 of its frame."""

    heave: Annotated[float, Field(gt=0)] = Field(description="stiffness [N/m]")
    roll: Annotated[float, Field(gt=0)] = Field(description="stiffness [N m/rad]")
    pitch: Annotated[float, Field(gt=0)] = Field(description="stiffness [N m/rad]")
    centre: Annotated[list[float], Field(min_length=2, max_length=2)] | None = Field(
        None, description="x, y of the centre of buoyancy when level; below the centre of mass unless given [m]"
    )


class Windage(Section):
    """Force of the wind on a floating vehicle that is symmetric fore and aft, and to port and starboard.

    With a the velocity of the air relative to the hull, in body axes, and |a| its horizontal size, the force and the
    moment about the vertical are

        X = 1/2 rho c_x A_F |a| a_x,   Y = 1/2 rho c_y A_L |a| a_y,   N = -rho c_n A_L L a_x a_y

    (Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2011, section 8.1). The force acts at `height`,
    so it also heels and trims the hull.
    """

    area: Annotated[list[Positive], Field(min_length=2, max_length=2)] = Field(
        description="frontal and lateral area above the water, A_F and A_L [m^2]"
    )
    coefficients: Triple = Field(description="c_x, c_y and c_n; of ships 0.5 to 0.9, 0.7 to 0.95, 0.05 to 0.2 [-]")
    height: Positive = Field(description="height of the centre of these areas above the waterline [m]")
    length: Positive | None = Field(
        None, description="length overall L; the longest side of the vehicle's geoms, its `size`, unless given [m]"
    )

    def pack(self, size: float) -> Array:
        """Return X / (|a| a_x) and Y / (|a| a_y), N s^2/m^2, N / (a_x a_y), N s^2/m, and the height, m, shape (4,)."""
        (frontal, lateral), (x, y, n) = self.area, 0.5 * AIR_DENSITY * np.array(self.coefficients)
        return np.array([x * frontal, y * lateral, -2.0 * n * lateral * (self.length or size), self.height])


class Autopilot(Section):
    """Loop on the measured velocity through the medium, with time constant M / (M rate + D), or more with lag."""

    rate: Annotated[float, Field(gt=0)] = Field(description="k_v of the loop on the velocity through the medium [1/s]")


class VehicleDescription(Section):
    """Contents of models/NAME.yaml."""

    summary: str = Field(description="one line that `mjsheaf list --vehicles` shows")
    source: str = Field("", description="source of the numbers")
    mjcf: str = Field(description="MJCF file, in the same directory")
    domain: Literal["surface", "volume"] = Field(description="surface: controlled in the plane; volume: in space")
    drag: Drag = Field(description="drag in the medium")
    attitude: AttitudeHold = Field(description="attitude hold")
    autopilot: Autopilot | None = Field(
        None, description="velocity loop; only feedforward of the drag law unless given"
    )
    actuators: dict[str, AnyActuator] = Field(
        {}, description="thrusters of the MJCF file that turn, or have a rudder, by name"
    )
    steering: AnySteering | None = Field(None, description="steering of a vehicle that cannot push along every axis")
    added_mass: Six | None = Field(None, description="surge, sway, heave; roll, pitch, yaw [kg, kg m^2]")
    hydrostatics: Hydrostatics | None = Field(None, description="restoring moments of a floating vehicle")
    windage: Windage | None = Field(
        None, description="force of the wind, `flow.air`, on a floating vehicle; none unless given"
    )
    drifts: bool = Field(False, description="true for a buoy without thrusters, which can only be a target")

    @model_validator(mode="after")
    def _fits_together(self) -> "VehicleDescription":
        if self.domain != "surface" and any(isinstance(actuator, Rudder) for actuator in self.actuators.values()):
            raise ValueError("a rudder steers a vehicle on the surface")
        if (self.domain == "surface") != (self.hydrostatics is not None):
            raise ValueError("a surface vehicle needs hydrostatics, and other vehicles must not have them")
        if self.domain != "surface" and self.windage is not None:
            raise ValueError("windage is that of a vehicle on the surface; the drag of others is in `drag`")
        if isinstance(self.steering, ThrustVector if self.domain == "surface" else HandPoint):
            raise ValueError("steering needs a hand_point on the surface, and a largest_tilt in a volume")
        if isinstance(self.steering, HandPoint) and self.drag.angular[2] == 0.0:
            raise ValueError("a hand point needs a positive drag.angular in yaw, as g divides by it")
        if self.drifts and (self.domain != "surface" or self.steering or self.autopilot or self.actuators):
            raise ValueError("a drifting vehicle must be on the surface, without steering, autopilot and actuators")
        return self


@dataclass(frozen=True)
class Capability:
    """Capabilities of a level vehicle in steady motion; infinite if its thrusters have no limits.

    Attributes:
        forward_thrust: Maximum thrust along x in addition to the trim, N.
        forward_speed: Maximum speed along x through the medium, m/s.
        least_speed: Maximum speed through the medium in the slowest horizontal direction, m/s; the forward speed of a
            boat at its hand point, which turns first.
        top_speed: Maximum speed through the medium in the fastest horizontal direction, m/s.
    """

    forward_thrust: float
    forward_speed: float
    least_speed: float
    top_speed: float


@dataclass(frozen=True)
class Vehicle(Body):
    """A vehicle, ready to be controlled: numbers from its MJCF file and its description.

    Attributes:
        name: Name of its description.
        description: Its description.
        path: Path of its MJCF file.
        steering: Conversion of a desired velocity into wrenches.
        rate: Rate k_v of the autopilot, 1/s; 0 without one.
        left_out: Names of the elements of its MJCF file that belong to a scene, and are not part of it.
    """

    name: str
    description: VehicleDescription
    path: Path
    steering: Steering
    rate: float
    left_out: tuple[str, ...] = ()

    @property
    def controlled_rows(self) -> list[int]:
        """Rows of the wrench that its steering commands and actuators must produce."""
        return self.steering.rows[self.dimension]

    @cached_property
    def allocation(self) -> Array:
        """Map from desired wrenches to efforts, shape (s, 6); see `Steering.allocation`."""
        return self.steering.allocation(self)

    @cached_property
    def trim(self) -> Array:
        """Commands that carry the weight of the level vehicle, shape (s,)."""
        efforts = self.by_actuator(self.steering.trim_effort(self))
        commands = [a.command(effort) for a, effort in zip(self.actuators, efforts, strict=True)]
        return np.concatenate([np.zeros(0), *commands])

    @cached_property
    def capability(self) -> Capability:
        """Thrust and speed of the level vehicle: a linear program for each of its steering's directions."""
        directions = self.steering.directions
        thrust = np.array([self.steering.largest_force(self, d) for d in directions])
        speed = np.array([self._steady_speed(d, F) for d, F in zip(directions, thrust, strict=True)])
        return Capability(float(thrust[0]), float(speed[0]), float(speed.min()), float(speed.max()))

    def _steady_speed(self, direction: Array, thrust: float) -> float:
        """Solve D v + Q v^2 = F for the steady speed along a unit vector of the body's plane, m/s."""
        D = float(self.drag[:2] @ direction**2)
        Q = float(self.quadratic_drag[:2] @ np.abs(direction) ** 3)
        return float(solve_drag(D, Q, thrust)) if np.isfinite(thrust) else float("inf")

    def reduced_model(self) -> "ReducedModel":
        """The paper's first-order model of this vehicle, q' = f + g u, valid if its time constants are small."""
        return ReducedModel(self)

    def with_time_constant(self, tau: float | None) -> "Vehicle":
        """Return the same vehicle with time constant tau, s; None keeps its own.

        With an autopilot, k_v changes so that M / (M k_v + D) along surge is tau, ignoring the lag of its thrusters.
        Without one, its drag becomes isotropic, m / tau.

        Raises:
            InputError: Its drag alone makes it faster than tau.
        """
        if tau is None:
            return self
        if self.rate == 0.0:
            return replace(self, drag=np.full(3, self.mass / tau))
        own = float(self.moving_mass[0] / self.drag[0])
        rate = 1.0 / tau - 1.0 / own
        if rate <= 0.0:
            raise InputError(f"{self.name} has a time constant of {own:.3g} s without its autopilot; tau must be below")
        return replace(self, rate=float(rate))


def solve_drag(D: Any, Q: Any, force: Any) -> Any:
    """Solve D v + Q |v| v = F for v; written without a difference, because Q may be the rounding of a cosine."""
    return 2.0 * force / (D + np.sqrt(D**2 + 4.0 * Q * np.abs(force)))


def kinds_of(vehicles: Sequence[Vehicle]) -> tuple[list[Vehicle], IntArray]:
    """Return one vehicle of each kind, in the order in which they first come, and the kind of each, shape (V,)."""
    kinds = {id(vehicle): vehicle for vehicle in vehicles}
    number = {key: k for k, key in enumerate(kinds)}
    return list(kinds.values()), np.array([number[id(vehicle)] for vehicle in vehicles], dtype=np.int64)


@dataclass(frozen=True)
class ReducedModel:
    """First-order model q' = f + g u + omega of a vehicle with time constants much smaller than the law's.

    The medium carries it, so f is the medium's velocity w. Thrust moves it relative to the medium against linear drag:
    g = C (R D R^T)^-1 R W_f. The input u depends on its steering:

    - Fully actuated vehicle: efforts (commands of thrusters, force components of azimuth thrusters).
    - Boat at its hand point: efforts, with g = R(psi) diag(1 / D_surge, l / D_yaw) W on the rows surge and yaw, which
      is square and of full rank.
    - Multirotor with parallel rotors, whose attitude is faster still: thrust vector in world axes, N.

    Attributes:
        vehicle: Vehicle that is modelled.
    """

    vehicle: Vehicle

    @property
    def tau(self) -> Array:
        """Time constants of the controlled velocity along body axes at low speed, shape (n,), s.

        (M + l D) / (M k_v + D) is the mean delay of a step response, that is, the area above it. The force is delayed
        by l: the lag of the thrusters, or 2 zeta / omega of an attitude that must turn first. Inside the autopilot's
        loop, this adds only l D.

        The model omits that an azimuth thruster turns at a limited rate before it pushes. In a test, a step in sway of
        wamv_azimuth at rest took 1.20 times as long; steps of an Otter differ by 3 to 7 %. `compare` measures the
        delay.
        """
        return self.tau_with(self.vehicle.steering.delays(self.vehicle))

    def tau_with(self, delays: Array | float) -> Array:
        """Return tau for other delays l of the force, s; 0 leaves that of inertia, M / (M k_v + D)."""
        v, rows = self.vehicle, self.vehicle.steering.velocity_rows[: self.vehicle.dimension]
        mass, drag = v.moving_mass[rows], np.concatenate([v.drag, v.angular_drag])[rows]
        return np.asarray((mass + delays * drag) / (mass * v.rate + drag))

    def f(self, w: Array) -> Array:
        """Compute the drift of a vehicle in a medium that moves at w (3,), shape (n,), m/s."""
        return np.asarray(w, dtype=np.float64)[: self.vehicle.dimension]

    def g(self, R: Array) -> Array:
        """Compute the control effectiveness, shape (n, s), m/s per unit of input.

        Args:
            R: Attitude, body to world, shape (3, 3).
        """
        return self.vehicle.steering.g(self.vehicle, R)

    def g_inverse(self, R: Array) -> Array:
        """Compute g^+, the right inverse of g that causes no other motion of the body, shape (s, n)."""
        return self.vehicle.steering.g_inverse(self.vehicle, R)
