"""The part of the schema that moves vehicles: target motions, flow, disturbances.

The part of the schema that is the team: agents, targets, edges, anchors, formations.

The schema of a scenario file. Lengths in m, time in s, angles in degrees unless a field says otherwise.

These classes only say what is legal field by field; how fields fit together is checked where the system is built. The
team and the medium are in modules of their own.
"""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from mjsheaf.io.yaml import Duration, Id, Matrix, NonNegative, Number, Point, Positive, Section
from mjsheaf.scenario.swarm import Swarm, expand_swarm

if TYPE_CHECKING:
    from mjsheaf.system import System


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


class Time(Section):
    """The span of the run."""

    start: NonNegative = 0.0
    end: NonNegative = Field(30.0, description="the last sample is the last whole period up to here")

    @model_validator(mode="after")
    def _ordered(self) -> "Time":
        if self.end <= self.start:
            raise ValueError(f"end ({self.end}) must be after start ({self.start})")
        return self


class Controller(Section):
    """The law u_i = -k1 g_i^+ eta_i."""

    gain: Positive = Field(1.0, description="k1, 1/s")
    control_period: NonNegative = Field(0.01, description="zero-order hold, s; 0 evaluates the law continuously")
    record_period: Duration = Field(0.01, description="time between samples where control_period is 0, s")
    velocity_limit: Positive | None = Field(None, description="largest commanded speed of every agent, m/s")


class Spread(Section):
    """Random initial conditions, drawn from the seed."""

    position: NonNegative = Field(0.0, description="half width of a uniform box about each agent's position, m")
    heading: Annotated[float, Field(ge=0, le=180)] = Field(0.0, description="half width about every heading")


class Vehicles(Section):
    """The bodies of the physics backend."""

    agents: str | None = Field(None, description="hull for planar and aerial for spatial agents unless given")
    targets: str | None = None
    tau: Duration | None = Field(
        None, description="time constant along surge of every body, s, by autopilot or else drag; its own unless given"
    )


class EffectsModel(Section):
    """What makes bodies real; each can be switched off alone."""

    inertia: bool = Field(True, description="off: bodies are so light that m / D is massless_tau; no autopilot")
    drag_law: bool = Field(True, description="off: drag is linear")
    limits: bool = Field(True, description="off: thrusters push as hard as asked")
    lag: bool = Field(True, description="off: thrusters follow their commands at once")
    underactuation: bool = Field(True, description="off: thrusters along every controlled axis")
    massless_tau: Duration = Field(0.02, description="s")


class Physics(Section):
    """How the physics backend steps."""

    timestep: Duration = Field(0.001, description="s; the control period must be a multiple of it")
    contacts: bool = Field(False, description="whether vehicles collide")
    effects: EffectsModel = EffectsModel()


class Ideal(Section):
    """How the ideal backend integrates."""

    rtol: Annotated[float, Field(ge=1e-13, le=1e-2)] = 1e-9
    atol: Annotated[float, Field(gt=0, le=1)] = 1e-12


class Scene(Section):
    """What the video shows beside the vehicles."""

    surface: Literal["water", "ground", "none"] = "water"
    height: Number = 0.0
    vehicle_scale: Annotated[float, Field(ge=1e-3, le=1e4)] = Field(
        1.0, description="vehicles are drawn this many times larger"
    )


class Video(Section):
    """How a run is filmed."""

    width: Annotated[int, Field(ge=64, le=7680, multiple_of=2)] = 1280
    height: Annotated[int, Field(ge=64, le=7680, multiple_of=2)] = 720
    fps: Annotated[int, Field(ge=1, le=240)] = 30
    speed: Annotated[float, Field(ge=1e-3, le=1e3)] = Field(1.0, description="simulated seconds per second of video")
    azimuth: Annotated[float, Field(ge=-360, le=360)] = -60.0
    elevation: Annotated[float, Field(ge=-90, le=90)] = Field(-35.0, description="negative looks down")
    distance: Annotated[float, Field(ge=1e-3, le=1e6)] | None = Field(
        None, description="of the camera, m; follows the team unless given"
    )
    trail: Annotated[float, Field(ge=0, le=1e6)] = Field(6.0, description="length of the trails, s")
    quality: Literal["good", "draft"] = Field(
        "good", description="draft: quickly drawn, coarse and with hard edges, at most 15 frames a second"
    )


class Bounds(Section):
    """Largest final errors that are expected; a missing one is not checked."""

    mean_disagreement: NonNegative | None = None
    tracking_error: NonNegative | None = None
    formation_error: NonNegative | None = None
    centering_error: NonNegative | None = None


class Expect(Section):
    """What a regression run must show, for each backend."""

    ideal: Bounds | None = None
    physics: Bounds | None = None
    refused: str | None = Field(None, description="`run` must refuse, and its reason must contain this")


def _optional(schema: dict[str, Any]) -> None:
    """What need not stand in a file: the name, which is then the file's, and agents where a swarm makes them."""
    schema["required"] = [name for name in schema["required"] if name not in ("name", "agents")]


class Scenario(Section):
    """A team, a sheaf, a formation, a flow, a law, and what is expected of them."""

    model_config = ConfigDict(json_schema_extra=_optional)

    name: Id = Field(description="that of the file unless given")
    summary: str = Field("", description="one line for the gallery")
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    time: Time = Time()
    controller: Controller = Controller()
    swarm: Swarm | None = Field(None, description="makes agents, communication, sensing and formations")
    agents: Annotated[list[Agent], Field(min_length=1)]
    targets: Annotated[list[Target], Field(min_length=1)]
    communication: list[Edge] = Field(default_factory=list, description="agent to agent")
    sensing: list[Edge] = Field(default_factory=list, description="agent to target")
    target_edges: list[Edge] = Field(default_factory=list, description="target to target")
    anchors: list[AnchorModel] = Field(default_factory=list, description="agent to a fixed value")
    formations: list[Group] = Field(default_factory=list)
    target_motion: Motion | None = None
    target_formation: TargetFormation | None = None
    flow: Flow = Flow()
    disturbance: Disturbances = Disturbances()
    spread: Spread = Spread()
    vehicles: Vehicles = Vehicles()
    physics: Physics = Physics()
    ideal: Ideal = Ideal()
    scene: Scene = Scene()
    video: Video = Video()
    expect: Expect = Expect()

    @model_validator(mode="before")
    @classmethod
    def _write_out_swarm(cls, raw: Any) -> Any:
        return expand_swarm(raw) if isinstance(raw, dict) else raw

    def system(self) -> "System":
        """The closed-loop system that this scenario describes, ready for a backend.

        Raises:
            ScenarioError: fields that are legal one by one do not fit together.
        """
        from mjsheaf.scenario.build import build_system

        return build_system(self)
