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
from pydantic import Field, model_validator

from mjsheaf.errors import InputError
from mjsheaf.io.yaml import Section

Triple = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=3, max_length=3)]
Six = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=6, max_length=6)]


class Drag(Section):
    """Drag relative to the medium along and about the body's axes: D v + Q |v| v; give time_constant or linear."""

    time_constant: Annotated[float, Field(gt=0)] | None = Field(None, description="m / D, s: isotropic")
    linear: Triple | None = Field(None, description="surge, sway, heave, N s/m")
    quadratic: Triple = Field([0.0, 0.0, 0.0], description="surge, sway, heave, N s^2/m^2")
    angular: Triple = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw, N m s/rad")
    angular_quadratic: Triple = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw, N m s^2/rad^2")

    @model_validator(mode="after")
    def _one(self) -> "Drag":
        if (self.time_constant is None) == (self.linear is None):
            raise ValueError("give either time_constant or linear")
        if self.linear is not None and min(self.linear) <= 0.0:
            raise ValueError("linear drag must be positive along each axis")
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


class Steering(Section):
    """How a vehicle that cannot push along every axis makes the velocity that the law wants; give one of them."""

    hand_point: Annotated[float, Field(gt=0)] | None = Field(
        None, description="a boat with surge and yaw only is controlled at a point this far ahead of its origin, m"
    )
    largest_tilt: Annotated[float, Field(gt=0, le=80)] | None = Field(
        None, description="a multirotor with parallel rotors points its thrust, tilting by at most this, degrees"
    )

    @model_validator(mode="after")
    def _one(self) -> "Steering":
        if (self.hand_point is None) == (self.largest_tilt is None):
            raise ValueError("give either hand_point or largest_tilt")
        return self


class VehicleDescription(Section):
    """What stands in models/NAME.yaml."""

    summary: str
    source: str = Field("", description="where the numbers come from")
    mjcf: str = Field(description="MJCF file, beside this one")
    domain: Literal["surface", "volume"] = Field(description="surface: controlled in the plane; volume: in space")
    drag: Drag
    attitude: AttitudeHold
    autopilot: Autopilot | None = Field(None, description="feedforward of the drag law only unless given")
    steering: Steering | None = Field(None, description="of an underactuated vehicle")
    added_mass: Six | None = Field(None, description="surge, sway, heave, kg; roll, pitch, yaw, kg m^2")
    hydrostatics: Hydrostatics | None = Field(None, description="of a vehicle that floats")

    @model_validator(mode="after")
    def _fits_together(self) -> "VehicleDescription":
        if (self.domain == "surface") != (self.hydrostatics is not None):
            raise ValueError("a surface vehicle needs hydrostatics, and no other has them")
        if self.steering is not None:
            own = self.steering.hand_point if self.domain == "surface" else self.steering.largest_tilt
            if own is None:
                raise ValueError("steering has a hand_point on the surface, and a largest_tilt in a volume")
        return self


Array = NDArray[np.float64]
Control = Literal["full", "thrust_vector", "hand_point"]

GRAVITY = 9.81  # m/s^2

_USABLE = (
    0.9  # of its thrust is what a multirotor that points its thrust may use for its weight and for going somewhere
)
_STIFF = 0.01  # share of a velocity that drag takes in a step: as an applied force it is wrong by about this much
_NO_LIMIT = 1e9  # a range from here on is none: it is there so that a command which diverges is seen

ROW_NAMES = ("surge force", "sway force", "heave force", "roll moment", "pitch moment", "yaw moment")
_ROWS: dict[tuple[str, Control], list[int]] = {
    ("surface", "full"): [0, 1, 5],
    ("surface", "hand_point"): [0, 5],
    ("volume", "full"): [0, 1, 2, 3, 4, 5],
    ("volume", "thrust_vector"): [2, 3, 4, 5],
}


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
        control: how a wanted velocity becomes thrust: along every axis ('full'), by pointing the thrust of parallel
            rotors ('thrust_vector'), or by surge and yaw at the hand point ('hand_point').
        mass: kg.
        weight: what thrusters or water must carry, N: m g less what the MJCF compensates (gravcomp).
        ballast: weight that the body does not have in the model, N; see effects.
        centre_of_mass: in the body frame, shape (3,), m.
        inertia: about the origin of the body frame, body axes, shape (3, 3), kg m^2.
        inertials: of each body in the file, depth first.
        thrusters: names of the actuators; thruster_K where number K, from 0, has none.
        actuation: MJCF attributes of each thruster's actuator: gain, limits and lag, defaults included.
        W: wrench of each thruster for a command of 1, shape (6, s), N and N m.
        drag: linear drag D along the body axes, shape (3,), N s/m.
        angular_drag: the same about them, shape (3,), N m s/rad.
        quadratic_drag: of |v| v along and of |omega| omega about the body axes, shape (6,).
        added_mass: mass of the medium that moves with the body along and about its axes, shape (6,), kg and kg m^2.
        rate: k_v of the autopilot, 1/s; 0 without one.
        hand: distance of the controlled point ahead of the origin, m.
        tilt: largest tilt of a vehicle that points its thrust, degrees; 0 for others.
    """

    name: str
    description: VehicleDescription
    path: Path
    control: Control
    mass: float
    weight: float
    ballast: float
    centre_of_mass: Array
    inertia: Array
    inertials: list[Inertial]
    thrusters: list[str]
    actuation: list[dict[str, Any]]
    W: Array
    drag: Array
    angular_drag: Array
    quadratic_drag: Array
    added_mass: Array
    rate: float
    hand: float
    tilt: float

    @property
    def dimension(self) -> int:
        """Dimension of the controlled position: 2 on the surface, 3 in a volume."""
        return 2 if self.description.domain == "surface" else 3

    @property
    def controlled_rows(self) -> list[int]:
        """Rows of the wrench that thrusters must produce: those that its way of control commands."""
        return _ROWS[self.description.domain, self.control]

    @cached_property
    def allocation(self) -> Array:
        """W^+ on the controlled rows, zero on the others, shape (s, 6): commands that make a wanted wrench.

        The moment rows belong to it: the pseudo-inverse of the force rows alone would spin a free body.
        """
        P = np.zeros((self.W.shape[1], 6))
        P[:, self.controlled_rows] = np.linalg.pinv(self.W[self.controlled_rows])
        return P

    @property
    def trim(self) -> Array:
        """Commands that carry the weight of the level vehicle, shape (s,); zero where water carries it."""
        if self.dimension == 2:
            return np.zeros(self.W.shape[1])
        force = np.array([0.0, 0.0, self.weight])
        return np.asarray(self.allocation @ np.concatenate([force, np.cross(self.centre_of_mass, force)]))

    @property
    def limits(self) -> Array:
        """Lowest and highest useful command of each thruster, shape (s, 2): what ctrl, act and force ranges leave."""
        return np.array([_range_of(actuation) for actuation in self.actuation]).reshape(-1, 2)

    @property
    def moving_mass(self) -> Array:
        """Mass along, and inertia about, each body axis that a thruster must accelerate, shape (6,), kg and kg m^2."""
        return np.concatenate([np.full(3, self.mass), np.diag(self.inertia)]) + self.added_mass

    @property
    def lag(self) -> float:
        """Mean time constant of the thrusters, s."""
        lags = [float(np.ravel(a["dynprm"])[0]) if a["dyntype"] != "none" else 0.0 for a in self.actuation]
        return float(np.mean(lags)) if lags else 0.0

    @property
    def rigid_mass(self) -> Array:
        """Rigid-body mass matrix M_RB about the origin, shape (6, 6): kg, kg m, kg m^2."""
        x, y, z = self.mass * self.centre_of_mass
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.block([[self.mass * np.eye(3), -cross], [cross, self.inertia]])

    @property
    def share(self) -> Array:
        """M_RB (M_RB + M_A)^-1, shape (6, 6): of a wrench, what moves the body alone as all of it moves both."""
        if not self.added_mass.any():
            return np.eye(6)
        rigid = self.rigid_mass
        return np.asarray(np.linalg.solve(rigid + np.diag(self.added_mass), rigid).T)

    def joint_damps(self, timestep: float) -> bool:
        """Whether the free joint takes linear drag, in a step of so many s.

        MuJoCo integrates what the joint takes implicitly: stiff drag then costs no small steps. But it factorizes the
        mass matrix once more for it, so that drag which is not stiff had better be an applied force. What is shared
        with the medium must be: see forces.
        """
        fastest = max(*(self.drag / self.mass), *(self.angular_drag / np.diag(self.turning_inertia)))
        return not self.added_mass.any() and bool(fastest * timestep > _STIFF)

    @property
    def gears(self) -> Array:
        """Wrench of each actuator on the free joint for a force of 1, shape (s, 6): zero where the gain is."""
        gain = np.array([actuation["gainprm"][0] for actuation in self.actuation])  # W holds gain times gear
        return np.divide(self.W.T @ self.share.T, gain[:, None], out=np.zeros((len(gain), 6)), where=gain[:, None] != 0)

    @property
    def turning_inertia(self) -> Array:
        """What a couple must overcome, shape (3, 3), kg m^2: inertia about the centre of mass, and added inertia."""
        c = self.centre_of_mass
        return self.inertia - self.mass * (c @ c * np.eye(3) - np.outer(c, c)) + np.diag(self.added_mass[3:])

    @property
    def usable_lift(self) -> float:
        """Thrust along z that a vehicle which points its thrust may use, N: some is left for turning it."""
        lifting = self.W[2] > 0.0
        reach = self.W[2, lifting] @ self.limits[lifting, 1]
        return max(_USABLE * float(reach), 1.01 * self.weight)

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
    drag: g = C (R D R^T)^-1 R W_f. What u is depends on how it is controlled: thruster commands of a fully actuated
    vehicle and of a boat at its hand point, where g = R(psi) diag(1 / D_surge, l / D_yaw) W on the rows surge and yaw
    is square and of full rank; the thrust vector in world axes (N) of a multirotor with parallel rotors, whose attitude
    is faster still.

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
        v = self.vehicle
        mass, drag = v.moving_mass, np.concatenate([v.drag, v.angular_drag])
        rows = [0, 5] if v.control == "hand_point" else [0, 1, 2][: v.dimension]
        late = np.full(len(rows), v.lag)
        if v.control == "thrust_vector":
            late[:2] = 2.0 * v.description.attitude.damping / v.description.attitude.frequency
        return np.asarray((mass[rows] + late * drag[rows]) / (mass[rows] * v.rate + drag[rows]))

    def f(self, w: Array) -> Array:
        """The drift of a vehicle in a medium that moves at w (3,), shape (n,), m/s."""
        return np.asarray(w, dtype=np.float64)[: self.vehicle.dimension]

    def g(self, R: Array) -> Array:
        """Control effectiveness, shape (n, s), m/s for each unit of input.

        Args:
            R: attitude, body to world, shape (3, 3).
        """
        v, n = self.vehicle, self.vehicle.dimension
        if v.control == "thrust_vector":
            return np.asarray(R / v.drag @ R.T)
        if v.control == "hand_point":
            return np.asarray(R[:2, :2] @ (v.W[[0, 5]] * self._hand_gain[:, None]))
        return np.asarray((R @ (v.W[:3] / v.drag[:, None]))[:n])

    def g_inverse(self, R: Array) -> Array:
        """g^+, the right inverse of g that makes no other motion of the body, shape (s, n)."""
        v, n = self.vehicle, self.vehicle.dimension
        if v.control == "thrust_vector":
            return np.asarray(R * v.drag @ R.T)
        if v.control == "hand_point":
            return np.asarray(v.allocation[:, [0, 5]] / self._hand_gain @ R[:2, :2].T)
        return np.asarray((v.allocation[:, :3] @ (v.drag[:, None] * R.T))[:, :n])

    @property
    def _hand_gain(self) -> Array:
        """Velocity of the hand point forward and to port for a surge force and a yaw moment of 1."""
        return np.array([1.0 / self.vehicle.drag[0], self.vehicle.hand / self.vehicle.angular_drag[2]])


def _range_of(actuation: dict[str, Any]) -> tuple[float, float]:
    """What the ranges of an actuator leave of its command."""
    low, high = -np.inf, np.inf
    gain = float(actuation["gainprm"][0]) or 1.0
    for name, scale in (("ctrlrange", 1.0), ("actrange", 1.0), ("forcerange", gain)):
        if name in actuation and (name != "actrange" or actuation["dyntype"] != "none"):
            ends = sorted(float(end) / scale for end in actuation[name])
            low, high = max(low, ends[0]), min(high, ends[1])
    return (low if low > -_NO_LIMIT else -np.inf), (high if high < _NO_LIMIT else np.inf)
