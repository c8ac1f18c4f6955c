"""The schema of a scenario file. Lengths in m, time in s, angles in degrees unless a field says otherwise.

These classes only say what is legal field by field; how fields fit together is checked where the system is built. The
team and the medium are in modules of their own.
"""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from mjsheaf.reading import Section
from mjsheaf.scenario.fields import Duration, Id, NonNegative, Number, Positive
from mjsheaf.scenario.schema_medium import Disturbances, Flow, Motion
from mjsheaf.scenario.schema_team import Agent, AnchorModel, Edge, Group, Target, TargetFormation
from mjsheaf.scenario.swarm import Swarm, expand_swarm

if TYPE_CHECKING:
    from mjsheaf.backends.system import System


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
