"""What stands in models/NAME.yaml: all of a vehicle that its MJCF file cannot say.

In which medium it moves, what the medium does to it (drag, added mass, hydrostatics), and what its onboard computer
does with the velocity that the law wants. Axes are those of the body: x forward, y port, z up.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from mjsheaf.reading import Section

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
