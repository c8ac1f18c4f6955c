"""Vehicles, their descriptions in models/NAME.yaml, and their reduced models.

A description contains the properties of a vehicle that MJCF has no place for: its medium, the effects of the medium
(drag, added mass, hydrostatics), and the control of the commanded velocity by its onboard computer. Axes are those of
the body: x forward, y port, z up.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, raise_first
from mjsheaf.section import Section
from mjsheaf.vehicles.actuators import AnyActuator
from mjsheaf.vehicles.body import AttitudeHold, Body
from mjsheaf.vehicles.steering import HandPoint, Steering, ThrustVector

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


class Autopilot(Section):
    """Loop on the measured velocity through the medium, with time constant M / (M rate + D), or more with lag."""

    rate: Annotated[float, Field(gt=0)] = Field(description="k_v of the loop on the velocity through the medium [1/s]")


def _kind_of_steering(value: Any) -> str | None:
    """Return the class of the given field; None unless exactly one is given."""
    kinds = {"hand_point": "HandPoint", "largest_tilt": "ThrustVector"}
    given = set(kinds) & set(value if isinstance(value, dict) else type(value).model_fields)
    return kinds[given.pop()] if len(given) == 1 else None


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
    steering: (
        Annotated[
            Annotated[HandPoint, Tag("HandPoint")] | Annotated[ThrustVector, Tag("ThrustVector")],
            Discriminator(
                _kind_of_steering,
                custom_error_type="steering",
                custom_error_message="give either hand_point or largest_tilt",
            ),
        ]
        | None
    ) = Field(None, description="steering of a vehicle that cannot push along every axis")
    added_mass: Six | None = Field(None, description="surge, sway, heave; roll, pitch, yaw [kg, kg m^2]")
    hydrostatics: Hydrostatics | None = Field(None, description="restoring moments of a floating vehicle")
    drifts: bool = Field(False, description="true for a buoy without thrusters, which can only be a target")

    @model_validator(mode="after")
    def _rudders_float(self) -> "VehicleDescription":
        if self.domain != "surface" and any(actuator.surface_only for actuator in self.actuators.values()):
            raise ValueError("a rudder steers a vehicle on the surface")
        return self

    @model_validator(mode="after")
    def _fits_together(self) -> "VehicleDescription":
        raise_first(
            ValueError,
            {
                "a surface vehicle needs hydrostatics, and other vehicles must not have them": (
                    (self.domain == "surface") != (self.hydrostatics is not None)
                ),
                "steering needs a hand_point on the surface, and a largest_tilt in a volume": (
                    isinstance(self.steering, ThrustVector if self.domain == "surface" else HandPoint)
                ),
                "a drifting vehicle must be on the surface, without steering, autopilot and actuators": (
                    self.drifts and (self.domain != "surface" or self.steering or self.autopilot or self.actuators)
                ),
            },
        )
        return self


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
        v, rows = self.vehicle, self.vehicle.steering.velocity_rows[: self.vehicle.dimension]
        mass, drag = v.moving_mass[rows], np.concatenate([v.drag, v.angular_drag])[rows]
        return np.asarray((mass + v.steering.delays(v) * drag) / (mass * v.rate + drag))

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
