"""What stands in models/NAME.yaml: all of a vehicle that its MJCF file cannot say.

In which medium it moves, what the medium does to it (drag, added mass, hydrostatics), and what its onboard computer
does with the velocity that the law wants. Axes are those of the body: x forward, y port, z up.

A vehicle, ready to be controlled: numbers from its MJCF file and its description, and its reduced model.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.io.section import Section
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
    """The loop on the velocity through the medium, which is measured: tau = M / (M rate + D); more with lag."""

    rate: Annotated[float, Field(gt=0)] = Field(description="k_v of the loop on the velocity through the medium [1/s]")


def _kind_of_steering(value: Any) -> str | None:
    """The class of the field that is given, if it is one alone."""
    kinds = {"hand_point": "HandPoint", "largest_tilt": "ThrustVector"}
    given = set(kinds) & set(value if isinstance(value, dict) else type(value).model_fields)
    return kinds[given.pop()] if len(given) == 1 else None


class VehicleDescription(Section):
    """What stands in models/NAME.yaml."""

    summary: str = Field(description="one line that `mjsheaf list --vehicles` shows")
    source: str = Field("", description="where the numbers come from")
    mjcf: str = Field(description="MJCF file, in the same directory")
    domain: Literal["surface", "volume"] = Field(description="surface: controlled in the plane; volume: in space")
    drag: Drag = Field(description="what the medium takes")
    attitude: AttitudeHold = Field(description="hold of the attitude")
    autopilot: Autopilot | None = Field(
        None, description="hold of the commanded velocity; feedforward of the drag law only unless given"
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
    hydrostatics: Hydrostatics | None = Field(None, description="of a vehicle that floats")
    drifts: bool = Field(False, description="true for a buoy without thrusters, which can only be a target")

    @model_validator(mode="after")
    def _rudders_float(self) -> "VehicleDescription":
        if self.domain != "surface" and any(actuator.surface_only for actuator in self.actuators.values()):
            raise ValueError("a rudder steers a vehicle on the surface")
        return self

    @model_validator(mode="after")
    def _fits_together(self) -> "VehicleDescription":
        if (self.domain == "surface") != (self.hydrostatics is not None):
            raise ValueError("a surface vehicle needs hydrostatics, and no other has them")
        if isinstance(self.steering, ThrustVector if self.domain == "surface" else HandPoint):
            raise ValueError("steering has a hand_point on the surface, and a largest_tilt in a volume")
        if self.drifts and (self.domain != "surface" or self.steering or self.autopilot or self.actuators):
            raise ValueError("what drifts floats on the surface, without steering, autopilot and actuators")
        return self


@dataclass(frozen=True)
class Vehicle(Body):
    """A vehicle, ready to be controlled.

    Attributes:
        name: of its description.
        description: the description.
        path: its MJCF file.
        steering: how a wanted velocity becomes wrenches.
        rate: k_v of the autopilot, 1/s; 0 without one.
    """

    name: str
    description: VehicleDescription
    path: Path
    steering: Steering
    rate: float

    @property
    def controlled_rows(self) -> list[int]:
        """Rows of the wrench that actuators must produce: those that its steering commands."""
        return self.steering.rows[self.dimension]

    @cached_property
    def allocation(self) -> Array:
        """Efforts that make a wanted wrench, shape (s, 6); see `Steering.allocation`."""
        return self.steering.allocation(self)

    @cached_property
    def trim(self) -> Array:
        """Commands that carry the weight of the level vehicle, shape (s,)."""
        efforts = self.by_actuator(self.steering.trim_effort(self))
        commands = [a.command(effort) for a, effort in zip(self.actuators, efforts, strict=True)]
        return np.concatenate([np.zeros(0), *commands])

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

        The model leaves out that an azimuth thruster turns at a limited rate before it pushes: a step in sway of
        wamv_azimuth at rest was measured to take 1.20 times as long, steps of an Otter differ by 3 to 7 %. `compare`
        measures the delay.
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
