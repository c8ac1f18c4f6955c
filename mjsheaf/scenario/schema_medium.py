"""The part of the schema that moves vehicles: target motions, flow, disturbances."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from mjsheaf.reading import Section
from mjsheaf.scenario.fields import NonNegative, Number, Point, Positive


class LissajousMotion(Section):
    """v_i(t) = amplitude_i rate_i cos(rate_i t + phase_i)."""

    kind: Literal["lissajous"]
    amplitude: Point = Field(description="m")
    rate: Point = Field(description="rad/s")
    phase: Point = Field(description="rad")
    pull: NonNegative = Field(0.0, description="return to the path when flow moves the target off it, 1/s")


class WaypointMotion(Section):
    """A smooth path through points, starting at the target's initial position."""

    kind: Literal["waypoints"]
    points: Annotated[list[Point], Field(min_length=1)]
    speed: Positive = Field(description="mean speed along the straight legs, m/s")
    closed: bool = False
    pull: NonNegative = Field(1.0, description="return to the path when flow moves the target off it, 1/s")


class StaticMotion(Section):
    """No motion of its own; flow and disturbance still move it, unless it is pulled back."""

    kind: Literal["static"]
    pull: NonNegative = Field(0.0, description="return to the initial position, 1/s")


Motion = Annotated[LissajousMotion | WaypointMotion | StaticMotion, Field(discriminator="kind")]


class SourceModel(Section):
    """alpha r / (|r|^2 + core^2)^p, p = 1 in the plane and 1.5 in space."""

    centre: Point
    alpha: Number


class VortexModel(Section):
    """gamma (axis x r) / (|r|^2 + core^2)."""

    centre: Point
    gamma: Number
    axis: Annotated[list[Number], Field(min_length=3, max_length=3)] | None = Field(None, description="in space only")


class ChannelModel(Section):
    """beta exp(-|n|^2 / 2 width^2) exp(-l^2 / 2 length^2) along a direction."""

    centre: Point
    direction: Point
    beta: Number = Field(description="m/s")
    width: Positive
    length: Positive


class FlowModel(Section):
    """A flow field in the plane (dimension 2) or in space (3)."""

    dimension: Literal[2, 3]
    core: NonNegative | None = Field(None, description="needed with sources or vortices; 0 leaves them singular, m")
    drift: Point | None = None
    sources: list[SourceModel] = Field(default_factory=list)
    vortices: list[VortexModel] = Field(default_factory=list)
    channels: list[ChannelModel] = Field(default_factory=list)


class Flow(Section):
    """The medium, as agents and as targets meet it, or as vehicles in space and in the plane do."""

    agents: FlowModel | None = None
    targets: FlowModel | None = None
    air: FlowModel | None = Field(None, description="what spatial vehicles meet, agents and targets")
    water: FlowModel | None = Field(None, description="what planar vehicles meet")

    @model_validator(mode="after")
    def _one_way(self) -> "Flow":
        if (self.agents or self.targets) and (self.air or self.water):
            raise ValueError("give either agents and targets, or air and water")
        return self


class DisturbanceModel(Section):
    """A bounded, smooth, seeded disturbance velocity."""

    bound: NonNegative = Field(description="m/s")
    frequencies: Annotated[list[Positive], Field(min_length=2, max_length=2)] = Field([0.05, 0.5], description="Hz")
    components: Annotated[int, Field(ge=1, le=64)] = 6


class Disturbances(Section):
    """Disturbances of agents and targets."""

    agents: DisturbanceModel | None = None
    targets: DisturbanceModel | None = None
