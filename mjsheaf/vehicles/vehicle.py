"""What stands in models/NAME.yaml: all of a vehicle that its MJCF file cannot say.

In which medium it moves, what the medium does to it (drag, added mass, hydrostatics), and what its onboard computer
does with the velocity that the law wants. Axes are those of the body: x forward, y port, z up.

A vehicle, ready to be controlled: numbers from its MJCF file and its description, and its reduced model.

Wrenches are [force; moment] about the origin of the body frame, in body axes (x forward, y port, z up).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag, model_validator

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.io.section import Section
from mjsheaf.vehicles.actuators import Azimuth, Channel, Thruster
from mjsheaf.vehicles.steering import HandPoint, Steering, ThrustVector

Triple = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=3, max_length=3)]
Six = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=6, max_length=6)]


class Drag(Section):
    """Drag relative to the medium along and about the body's axes: D v + Q |v| v; give time_constant or linear."""

    time_constant: Annotated[float, Field(gt=0)] | None = Field(None, description="m / D, s: isotropic")
    linear: Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=3, max_length=3)] | None = Field(
        None, description="surge, sway, heave, N s/m"
    )
    quadratic: Triple = Field([0.0, 0.0, 0.0], description="surge, sway, heave, N s^2/m^2")
    angular: Triple = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw, N m s/rad")
    angular_quadratic: Triple = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw, N m s^2/rad^2")

    @model_validator(mode="after")
    def _one(self) -> "Drag":
        if (self.time_constant is None) == (self.linear is None):
            raise ValueError("give either time_constant or linear")
        return self


class Hydrostatics(Section):
    """Restoring of a floating vehicle about its waterline, which is z = 0 of its frame."""

    heave: Annotated[float, Field(gt=0)] = Field(description="N/m")
    roll: Annotated[float, Field(gt=0)] = Field(description="N m/rad")
    pitch: Annotated[float, Field(gt=0)] = Field(description="N m/rad")
    centre: Annotated[list[float], Field(min_length=2, max_length=2)] | None = Field(
        None, description="x, y of the centre of buoyancy when level, m; below the centre of mass unless given"
    )


class AttitudeHold(Section):
    """The attitude that is wanted, held by the thrusters as a second-order system.

    A boat at its hand point holds none; its numbers serve where underactuation is switched off.
    """

    frequency: Annotated[float, Field(gt=0)] = Field(description="natural frequency, rad/s")
    damping: Annotated[float, Field(gt=0)] = Field(1.0, description="damping ratio")


class Autopilot(Section):
    """The loop on the velocity through the medium, which is measured: tau = M / (M rate + D); more with lag."""

    rate: Annotated[float, Field(gt=0)] = Field(description="k_v, 1/s")


def _kind_of_steering(value: Any) -> str | None:
    """The field that is given, if it is one alone, or the kind."""
    given = {"hand_point", "largest_tilt"} & set(value if isinstance(value, dict) else type(value).model_fields)
    return given.pop() if len(given) == 1 else None


class VehicleDescription(Section):
    """What stands in models/NAME.yaml."""

    summary: str
    source: str = Field("", description="where the numbers come from")
    mjcf: str = Field(description="MJCF file, beside this one")
    domain: Literal["surface", "volume"] = Field(description="surface: controlled in the plane; volume: in space")
    drag: Drag
    attitude: AttitudeHold
    autopilot: Autopilot | None = Field(None, description="feedforward of the drag law only unless given")
    actuators: dict[str, Azimuth] = Field({}, description="thrusters of the MJCF file that turn, by name")
    steering: (
        Annotated[
            Annotated[HandPoint, Tag("hand_point")] | Annotated[ThrustVector, Tag("largest_tilt")],
            Discriminator(
                _kind_of_steering,
                custom_error_type="steering",
                custom_error_message="give either hand_point or largest_tilt",
            ),
        ]
        | None
    ) = Field(None, description="how a vehicle that cannot push along every axis makes the velocity that is wanted")
    added_mass: Six | None = Field(None, description="surge, sway, heave, kg; roll, pitch, yaw, kg m^2")
    hydrostatics: Hydrostatics | None = Field(None, description="of a vehicle that floats")

    @model_validator(mode="after")
    def _fits_together(self) -> "VehicleDescription":
        if (self.domain == "surface") != (self.hydrostatics is not None):
            raise ValueError("a surface vehicle needs hydrostatics, and no other has them")
        if isinstance(self.steering, ThrustVector if self.domain == "surface" else HandPoint):
            raise ValueError("steering has a hand_point on the surface, and a largest_tilt in a volume")
        return self


GRAVITY = 9.81  # m/s^2

_STIFF = 0.01  # share of a velocity that drag takes in a step: as an applied force it is wrong by about this much

ROW_NAMES = ("surge force", "sway force", "heave force", "roll moment", "pitch moment", "yaw moment")


class Inertial(NamedTuple):
    """Inertia of one body of an MJCF file, as compiled.

    Attributes:
        position: of the centre of mass in the body's frame, shape (3,), m.
        quaternion: of the principal axes, shape (4,).
        mass: kg.
        diagonal: principal moments of inertia, shape (3,), kg m^2.
    """

    position: Array
    quaternion: Array
    mass: float
    diagonal: Array


@dataclass(frozen=True)
class Vehicle:
    """A vehicle, ready to be controlled.

    Attributes:
        name: of its description.
        description: the description.
        path: its MJCF file.
        steering: how a wanted velocity becomes wrenches.
        mass: kg.
        weight: what thrusters or water must carry, N: m g less what the MJCF compensates (gravcomp).
        ballast: weight that the body does not have in the model, N; see effects.
        centre_of_mass: in the body frame, shape (3,), m.
        inertia: about the origin of the body frame, body axes, shape (3, 3), kg m^2.
        inertials: of each body in the file, depth first.
        actuators: what pushes it.
        drag: linear drag D along the body axes, shape (3,), N s/m.
        angular_drag: the same about them, shape (3,), N m s/rad.
        quadratic_drag: of |v| v along and of |omega| omega about the body axes, shape (6,).
        added_mass: mass of the medium that moves with the body along and about its axes, shape (6,), kg and kg m^2.
        rate: k_v of the autopilot, 1/s; 0 without one.
    """

    name: str
    description: VehicleDescription
    path: Path
    steering: Steering
    mass: float
    weight: float
    ballast: float
    centre_of_mass: Array
    inertia: Array
    inertials: list[Inertial]
    actuators: list[Thruster]
    drag: Array
    angular_drag: Array
    quadratic_drag: Array
    added_mass: Array
    rate: float

    @property
    def dimension(self) -> int:
        """Dimension of the controlled position: 2 on the surface, 3 in a volume."""
        return 2 if self.description.domain == "surface" else 3

    @property
    def controlled_rows(self) -> list[int]:
        """Rows of the wrench that actuators must produce: those that its steering commands."""
        return self.steering.rows[self.dimension]

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
        """A (r, s) and b (r,) of A u <= b, which efforts u obey beside their bounds."""
        from scipy.linalg import block_diag

        A, b = zip(*(actuator.half_planes for actuator in self.actuators), strict=True)
        return block_diag(*A), np.concatenate(b)

    @cached_property
    def allocation(self) -> Array:
        """W^+ on the controlled rows, zero on the others, shape (s, 6): efforts that make a wanted wrench.

        The moment rows belong to it: the pseudo-inverse of the force rows alone would spin a free body.
        """
        P = np.zeros((self.W.shape[1], 6))
        P[:, self.controlled_rows] = np.linalg.pinv(self.W[self.controlled_rows])
        return P

    @property
    def trim_effort(self) -> Array:
        """Efforts that carry the weight of the level vehicle, shape (s,); zero where water carries it."""
        if self.dimension == 2:
            return np.zeros(self.W.shape[1])
        force = np.array([0.0, 0.0, self.weight])
        return np.asarray(self.allocation @ np.concatenate([force, np.cross(self.centre_of_mass, force)]))

    @property
    def trim(self) -> Array:
        """Commands that carry the weight of the level vehicle, shape (s,)."""
        efforts = self.by_actuator(self.trim_effort)
        return np.concatenate([a.command(effort) for a, effort in zip(self.actuators, efforts, strict=True)])

    def by_actuator(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Efforts or commands (s,) of each actuator."""
        return np.split(values, np.cumsum([len(actuator.channels) for actuator in self.actuators])[:-1])

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

    def joint_damps(self, timestep: float) -> bool:
        """Whether the free joint takes linear drag, in a step of so many s.

        MuJoCo integrates what the joint takes implicitly: stiff drag then costs no small steps. But it factorizes the
        mass matrix once more for it, so that drag which is not stiff had better be an applied force. What is shared
        with the medium must be: see `simulation.bodies`.
        """
        fastest = max(*(self.drag / self.mass), *(self.angular_drag / np.diag(self.turning_inertia)))
        return not self.added_mass.any() and bool(fastest * timestep > _STIFF)

    @property
    def gears(self) -> Array:
        """Wrench on the free joint for each effort of 1 / gain, shape (s, 6): zero where the gain is."""
        gain = np.array([a.gain for a in self.actuators for _ in a.channels])  # W holds gain times gear
        wrenches = self.W.T @ self.rigid_wrench_map.T
        return np.divide(wrenches, gain[:, None], out=np.zeros((len(gain), 6)), where=gain[:, None] != 0)

    @property
    def turning_inertia(self) -> Array:
        """What a couple must overcome, shape (3, 3), kg m^2: inertia about the centre of mass, and added inertia."""
        c = self.centre_of_mass
        return self.inertia - self.mass * (c @ c * np.eye(3) - np.outer(c, c)) + np.diag(self.added_mass[3:])

    def reduced_model(self) -> "ReducedModel":
        """The paper's first-order model of this vehicle: q' = f + g u once its time constants are small."""
        return ReducedModel(self)

    def with_time_constant(self, tau: float | None) -> "Vehicle":
        """The same vehicle with time constant tau, s; None leaves it as it is.

        Where it has an autopilot, that is made faster or slower, until M / (M k_v + D) along surge is tau, whatever the
        lag of its thrusters; where it has none, its drag becomes isotropic, m / tau.

        Raises:
            InputError: its drag alone makes it faster than tau.
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


@dataclass(frozen=True)
class ReducedModel:
    """q' = f + g u + omega: what is left of a vehicle once its time constants are small against those of the law.

    The medium carries it, so that f is the medium's velocity w, and thrust moves it relative to that through linear
    drag: g = C (R D R^T)^-1 R W_f. What u is depends on its steering: efforts of a fully actuated vehicle (commands of
    thrusters, force components of azimuth thrusters) and of a boat at its hand point, where
    g = R(psi) diag(1 / D_surge, l / D_yaw) W on the rows surge and yaw is square and of full rank; the thrust vector in
    world axes (N) of a multirotor with parallel rotors, whose attitude is faster still.

    Attributes:
        vehicle: the vehicle.
    """

    vehicle: Vehicle

    @property
    def tau(self) -> Array:
        """Time constants of the controlled velocity along body axes at low speed, shape (n,), s.

        (M + l D) / (M k_v + D): the mean delay of a step, the area above its response. The force comes late by l, the
        lag of the thrusters, or 2 zeta / omega of the attitude that must turn first: inside the autopilot's loop that
        costs l D only.
        """
        v, rows = self.vehicle, self.vehicle.steering.velocity_rows[: self.vehicle.dimension]
        mass, drag = v.moving_mass[rows], np.concatenate([v.drag, v.angular_drag])[rows]
        return np.asarray((mass + v.steering.delays(v) * drag) / (mass * v.rate + drag))

    def f(self, w: Array) -> Array:
        """The drift of a vehicle in a medium that moves at w (3,), shape (n,), m/s."""
        return np.asarray(w, dtype=np.float64)[: self.vehicle.dimension]

    def g(self, R: Array) -> Array:
        """Control effectiveness, shape (n, s), m/s for each unit of input.

        Args:
            R: attitude, body to world, shape (3, 3).
        """
        return self.vehicle.steering.g(self.vehicle, R)

    def g_inverse(self, R: Array) -> Array:
        """g^+, the right inverse of g that makes no other motion of the body, shape (s, n)."""
        return self.vehicle.steering.g_inverse(self.vehicle, R)
