"""The part of the schema that is the team: agents, targets, edges, anchors, formations."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from mjsheaf.reading import Section
from mjsheaf.scenario.fields import Id, Matrix, Number, Point, Positive
from mjsheaf.scenario.schema_medium import Motion


class Effectiveness(Section):
    """g(q, t) = R(psi) layout with psi = heading + gradient . q + rate t; ideal backend."""

    layout: Matrix = Field(description="W, one row for each state, one column for each input")
    heading: Number = 0.0
    heading_gradient: Point | None = Field(None, description="degrees per m")
    heading_rate: Number = Field(0.0, description="degrees per s")


class Attitude(Section):
    """Attitude of an agent's local frame."""

    roll: Number = 0.0
    pitch: Number = 0.0
    yaw: Number = 0.0


class Agent(Section):
    """A controlled vehicle; its dimension is the length of its position."""

    id: Id
    position: Point
    heading: Number | None = Field(None, description="initial heading of its body; 0 unless given")
    vehicle: str | None = Field(None, description="name in models/ or a description file; vehicles.agents unless given")
    frame: Attitude | None = Field(None, description="local frame of its local_frame edges; yaw = heading unless given")
    velocity_limit: Positive | None = Field(None, description="m/s; controller.velocity_limit unless given")
    effectiveness: Effectiveness | None = None


class Target(Section):
    """An uncontrolled vehicle; its dimension is the length of its position."""

    id: Id
    position: Point
    heading: Number | None = None
    vehicle: str | None = Field(None, description="vehicles.targets unless given")
    motion: Motion | None = Field(None, description="target_motion unless given")


class ExplicitMaps(Section):
    """Restriction maps as matrices."""

    tail: Matrix
    head: Matrix


EDGE_FIELDS = ("communication", "sensing", "target_edges")
"""The fields of a scenario that hold edges."""

_Ends = Annotated[list[Id], Field(min_length=2, max_length=2)]


def edge_from_pair(value: Any) -> Any:
    """Let a bare pair stand for an edge with all defaults."""
    return {"between": value} if isinstance(value, list) else value


class EdgeModel(Section):
    """An edge; a bare pair [tail, head] is short for {between: [tail, head]}."""

    between: _Ends
    map: Literal["shared", "identity", "local_frame"] | ExplicitMaps = "shared"
    weight: Positive | Matrix | None = Field(None, description="inner product of the edge stalk; a number times I")
    offset: list[Number] | None = Field(None, description="desired F_tail x_tail - F_head x_head; from formations")
    parallel: bool = Field(False, description="a second sensor: it may repeat another edge, and counts beside it")


Edge = Annotated[EdgeModel, BeforeValidator(edge_from_pair, json_schema_input_type=EdgeModel | _Ends)]


class AnchorModel(Section):
    """A measurement of an agent's own position that should have a fixed value, such as an altimeter's."""

    agent: Id
    axes: Annotated[list[Literal["x", "y", "z"]], Field(min_length=1, max_length=3)] | None = Field(
        None, description="coordinates that are anchored; give these or a map"
    )
    map: Matrix | None = Field(None, description="F, one row for each measured number")
    value: Annotated[list[Number], Field(min_length=1)] = Field(description="desired F q, m")
    weight: Positive | Matrix | None = Field(None, description="inner product of the edge stalk; a number times I")
    parallel: bool = Field(False, description="a second sensor: it may repeat another anchor, and counts beside it")

    @model_validator(mode="after")
    def _one(self) -> "AnchorModel":
        if (self.axes is None) == (self.map is None):
            raise ValueError("give either axes or map")
        return self


class _Group(Section):
    name: Id
    members: Annotated[list[Id], Field(min_length=1)]
    about: Id | None = Field(None, description="the target that the group's centre should follow; free if absent")
    height: Number = Field(0.0, description="added to z of spatial members, m")


class PolygonGroup(_Group):
    """A regular polygon."""

    shape: Literal["polygon", "square"]
    side: Positive | None = None
    radius: Positive | None = None
    angle: Number = Field(90.0, description="bearing of the first member from the x axis")
    clockwise: bool = False

    @model_validator(mode="after")
    def _check(self) -> "PolygonGroup":
        if (self.side is None) == (self.radius is None):
            raise ValueError("give either side or radius")
        legal = len(self.members) == 4 if self.shape == "square" else len(self.members) >= 2
        if not legal:
            raise ValueError(f"a {self.shape} does not have {len(self.members)} members")
        return self


class LineGroup(_Group):
    """Equally spaced points on a horizontal line."""

    shape: Literal["line"]
    spacing: Positive
    angle: Number = 0.0


class TetrahedronGroup(_Group):
    """A regular tetrahedron, apex last."""

    shape: Literal["tetrahedron"]
    side: Positive


class ExplicitGroup(_Group):
    """Displacements as given, one for each member."""

    shape: Literal["explicit"]
    displacements: Annotated[list[Point], Field(min_length=1)]


Group = Annotated[PolygonGroup | LineGroup | TetrahedronGroup | ExplicitGroup, Field(discriminator="shape")]


class TargetFormation(Section):
    """The targets' own consensus: v = -gain (L_T p - c_T)."""

    gain: Positive = Field(description="1/s")
    group: Group | None = Field(None, description="where targets belong; consensus on one point if absent")
