"""The schema of a scenario file, and the system that it describes.

Lengths in m, time in s, angles in degrees unless a field says otherwise. A section says field by field what is
expected, and builds its part of the system.

A swarm is a team generated from a number and a seed. Places are those of a sunflower (Vogel, Math. Biosci. 44, 1979):
any number of them fills a disc evenly. The scenario that comes out has every agent and edge in it; nothing else knows
that they were generated. networkx is imported by the graphs that need it, so that commands which make none come at
once.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Any, Literal, cast

import numpy as np
import scipy  # loads its parts when they are first used
from pydantic import ConfigDict, Discriminator, Field, Tag, TypeAdapter, ValidationError, model_validator

from mjsheaf.arguments import require_seed
from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.errors import InputError, in_field, shortened, visible
from mjsheaf.law.custom import CustomTerm, pack_custom
from mjsheaf.law.edges import bound_slopes, pack_links
from mjsheaf.law.law import ControlArrays, LawArrays, Station, pack_law, with_seed
from mjsheaf.law.paths import Fixed, Motion, pack_motions
from mjsheaf.law.safety import Safety
from mjsheaf.law.terms import Terms, pack_rounds, pack_terms
from mjsheaf.loop.system import DEFAULT_VEHICLE, Phase, PhysicsOptions, System, TimeGrid
from mjsheaf.media import varying
from mjsheaf.media.flow import NO_FLOW, FlowField
from mjsheaf.media.gridded import GriddedFlow
from mjsheaf.noise import generator_of
from mjsheaf.scenario.events import AnyEvent, Change, phases_of_events
from mjsheaf.section import Duration, Id, NonNegative, Number, Point, Positive, Section
from mjsheaf.sheaf.nonlinear import Measure
from mjsheaf.team import Anchor, Formation, Member, Team
from mjsheaf.team.edges import Group, PairOrEdge
from mjsheaf.team.links import Links
from mjsheaf.vehicles import allocation as effectivenesses
from mjsheaf.vehicles.effects import Effects
from mjsheaf.vehicles.vehicle import Vehicle

Edges = set[tuple[int, int]]

_POINT: TypeAdapter[list[float]] = TypeAdapter(Point, config=ConfigDict(strict=True, allow_inf_nan=False))
_SCATTER = 0x5A  # stream of random numbers


class Swarm(Section):
    """Agents S1, S2, ... in a disc about a target, with a graph drawn from the scenario's seed."""

    size: Annotated[int, Field(ge=1, le=100_000)] = Field(description="number of agents, S1, S2, ... [-]")
    about: Id = Field(description="id of the target that the swarm's centre should follow, and that some of it sense")
    vehicle: str | None = Field(None, description="name in models/ or a description file; vehicles.agents unless given")
    altitude: Number | None = Field(
        None, description="height of the agents, which then move in space; in the plane unless given [m]"
    )
    spacing: Positive = Field(6.0, description="distance of neighbouring places [m]")
    scatter: NonNegative = Field(1.0, description="half width of a box about each place in which an agent begins [m]")
    graph: Literal["nearest", "ring", "random_geometric", "small_world", "k_regular"] = Field(
        "nearest", description="how agents are linked"
    )
    degree: Annotated[int, Field(ge=2, le=64)] = Field(
        4, description="links of an agent; on average but for k_regular; even for nearest and small_world [-]"
    )
    sensing: Annotated[float, Field(gt=0, le=1)] = Field(
        0.1, description="share of the agents that sense the target [-]"
    )
    measures: Measure = Field("position", description="what edges compare: position, range or bearing")
    directed: bool = Field(False, description="only the tail of a communication edge measures and moves")


def expand_swarm(raw: dict[str, Any]) -> dict[str, Any]:
    """A scenario with its `swarm` written out: agents, communication, sensing and a formation.

    Args:
        raw: a scenario as a mapping; without a swarm it is returned as it is.

    Raises:
        InputError: Fields that a swarm makes are given as well, its target is missing, or its degree fits no graph.
    """
    if raw.get("swarm") is None:
        return raw
    try:
        swarm = Swarm.model_validate(raw["swarm"])
    except ValidationError:
        return raw  # the whole scenario's validation names the field
    made = [name for name in ("agents", "communication", "sensing", "formations") if raw.get(name)]
    if made:
        raise InputError(f"swarm: makes {', '.join(made)} itself; give either")
    targets = raw.get("targets")
    known = [target for target in targets if isinstance(target, dict)] if isinstance(targets, list) else []
    position = next((target.get("position") for target in known if target.get("id") == swarm.about), None)
    try:
        centre = _POINT.validate_python(position)
    except ValidationError:
        raise InputError(f"swarm.about: {swarm.about!r} is no target with a position of two or three numbers") from None
    seed = raw.get("seed", 0)
    if type(seed) is not int or not 0 <= seed < 2**63:
        raise InputError(f"seed: expected a whole number from 0 to 2^63 - 1, not {str(seed)[:60]!r}")
    if swarm.graph in ("nearest", "small_world") and swarm.degree % 2:
        raise InputError(
            f"swarm.degree: {swarm.degree} is odd; expected an even number with graph {swarm.graph}, as half "
            "of an agent's links lead each way"
        )
    return {name: value for name, value in raw.items() if name != "swarm"} | _written_out(swarm, centre, seed)


def _written_out(swarm: Swarm, centre: list[float], seed: int) -> dict[str, Any]:
    """Return the fields of a scenario that a swarm makes, about a centre in m."""
    # Where an agent begins depends on its number alone: not on how many there are, nor on what the graph draws.
    rng = np.random.default_rng([seed, _SCATTER])
    places = _sunflower(swarm.size, swarm.spacing)
    edges = _GRAPHS[swarm.graph](places, swarm, np.random.default_rng([seed, _SCATTER, 1]))
    axes = 2 if swarm.altitude is None else 3
    altitude = swarm.altitude or 0.0
    offset = np.column_stack([places, np.zeros(swarm.size)])[:, :axes]
    start = offset + rng.uniform(-swarm.scatter, swarm.scatter, offset.shape)
    start += [*centre[:2], altitude][:axes]
    ids = [f"S{k + 1}" for k in range(swarm.size)]
    vehicle = {} if swarm.vehicle is None else {"vehicle": swarm.vehicle}
    heading = np.rad2deg(np.arctan2(places[:, 1], places[:, 0]))
    sensors = np.unique(np.linspace(0, swarm.size - 1, max(1, round(swarm.sensing * swarm.size))).astype(int))
    height = altitude - centre[2] if len(centre) == 3 else 0.0
    displacements = offset + [0.0, 0.0, height][:axes]
    return {
        "agents": [
            {"id": name, "position": p, "heading": h, **vehicle}
            for name, p, h in zip(ids, start.round(6).tolist(), heading.round(3).tolist(), strict=True)
        ],
        "communication": [
            {"between": [ids[i], ids[j]], "measures": swarm.measures, "directed": swarm.directed}
            for i, j in sorted(edges)
        ],
        "sensing": [{"between": [ids[k], swarm.about], "measures": swarm.measures} for k in sensors],
        "formations": [
            {
                "name": "swarm",
                "shape": "explicit",
                "members": ids,
                "about": swarm.about,
                "displacements": displacements.round(6).tolist(),
            }
        ],
    }


def _sunflower(size: int, spacing: float) -> Array:
    """Return places in the plane about the origin, shape (size, 2), m; neighbours are about `spacing` apart."""
    number = np.arange(size)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * number  # the golden angle
    radius = spacing * np.sqrt((number + 0.5) / np.pi)
    return np.asarray(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def _nearest(places: Array, swarm: Swarm, rng: np.random.Generator) -> Edges:
    """Each agent and its nearest ones, half the degree of them among those further in, so that all are connected.

    Agents further in come before in number; of two as near, the first.
    """
    wanted = np.minimum(np.arange(len(places)), max(1, swarm.degree // 2))
    reach = swarm.spacing * np.sqrt(swarm.degree)
    tree = scipy.spatial.cKDTree(places)
    pairs = np.zeros((0, 2), dtype=np.int64)  # the one further in comes first
    while (np.bincount(pairs[:, 1], minlength=len(places)) < wanted).any():
        pairs = tree.query_pairs(reach, output_type="ndarray")
        reach *= 1.3
    distance = ((places[pairs[:, 0]] - places[pairs[:, 1]]) ** 2).sum(axis=1)
    pairs = pairs[np.lexsort((pairs[:, 0], distance, pairs[:, 1]))]
    rank = np.arange(len(pairs)) - np.searchsorted(pairs[:, 1], pairs[:, 1])
    return _ordered(pairs[rank < wanted[pairs[:, 1]]])


def _ring(places: Array, swarm: Swarm, rng: np.random.Generator) -> Edges:
    """One after the other, in the order of their bearing."""
    return _cycle(np.argsort(np.arctan2(places[:, 1], places[:, 0]), kind="stable"))


def _random_geometric(places: Array, swarm: Swarm, rng: np.random.Generator) -> Edges:
    """Agents within a distance of one another, after each has been moved at random by up to its spacing."""
    moved = places + rng.uniform(-swarm.spacing, swarm.spacing, places.shape)
    reach = swarm.spacing * np.sqrt((swarm.degree + 1) / np.pi)  # radius of a disc that holds degree + 1 places
    return _connected(_ordered(scipy.spatial.cKDTree(moved).query_pairs(reach)), places)


def _small_world(places: Array, swarm: Swarm, rng: np.random.Generator) -> Edges:
    """A ring with links to the nearest, one in ten of them rewired (Watts and Strogatz, Nature 393, 1998)."""
    import networkx

    size, degree = len(places), min(swarm.degree, len(places) - 1)
    graph = networkx.watts_strogatz_graph(size, degree, 0.1, seed=int(rng.integers(2**31)))
    return _connected(_ordered(graph.edges), places)


def _k_regular(places: Array, swarm: Swarm, rng: np.random.Generator) -> Edges:
    """Every agent has the same number of neighbours, drawn at random: anew until all are connected."""
    size, degree = len(places), min(swarm.degree, len(places) - 1)
    if size * degree % 2:
        raise InputError(f"swarm.degree: no graph of {size} agents has {degree} links each; take an even number")
    if degree == 2:  # of these, only one cycle is connected, which would hardly ever be drawn
        return _cycle(rng.permutation(size))
    import networkx

    for _ in range(100):  # with three links or more, nearly every graph is connected
        graph = networkx.random_regular_graph(degree, size, seed=int(rng.integers(2**31)))
        if networkx.is_connected(graph):
            return _ordered(graph.edges)
    raise InputError(f"swarm.graph: no graph of {size} agents with {degree} links each was drawn that is connected")


_GRAPHS: dict[str, Callable[[Array, Swarm, np.random.Generator], Edges]] = {
    "nearest": _nearest,
    "ring": _ring,
    "random_geometric": _random_geometric,
    "small_world": _small_world,
    "k_regular": _k_regular,
}


def _cycle(order: IntArray) -> Edges:
    """From each to the next, and from the last to the first."""
    return _ordered(zip(order, np.roll(order, -1), strict=True))


def _ordered(pairs: Any) -> Edges:
    return {(min(int(i), int(j)), max(int(i), int(j))) for i, j in pairs if i != j}


def _connected(edges: Edges, places: Array) -> Edges:
    """With links between the nearest agents of different parts, until there is one part (Assumption 5)."""
    import networkx

    graph = networkx.Graph()
    graph.add_nodes_from(range(len(places)))
    graph.add_edges_from(edges)
    parts = sorted((sorted(part) for part in networkx.connected_components(graph)), key=len, reverse=True)
    joined = parts[0]
    for part in parts[1:]:
        distance, nearest = scipy.spatial.cKDTree(places[joined]).query(places[part])
        k = int(np.argmin(distance))
        edges = edges | _ordered([(joined[int(nearest[k])], part[k])])
        joined = joined + part
    return edges


def _kind_of(flow: Any) -> str:
    """Return the name of the class of a flow, as a file has it."""
    if isinstance(flow, FlowField):
        return type(flow).__name__
    return "GriddedFlow" if isinstance(flow, dict) and "kind" in flow else "FlowField"


AnyFlow = Annotated[
    Annotated[FlowField, Tag("FlowField")] | Annotated[GriddedFlow, Tag("GriddedFlow")], Discriminator(_kind_of)
]
"""A flow by kernels, or out of a file."""


class Flow(Section):
    """Flow of the medium, given either by medium (air, water) or, as in the paper, by role (agents, targets)."""

    agents: AnyFlow | None = Field(
        None, description="flow that all agents meet, planar and spatial ones; not together with air or water"
    )
    targets: AnyFlow | None = Field(
        None, description="flow that all targets meet, planar and spatial ones; not together with air or water"
    )
    air: AnyFlow | None = Field(
        None, description="flow that spatial vehicles meet, agents and targets; not together with agents or targets"
    )
    water: AnyFlow | None = Field(
        None, description="flow that planar vehicles meet, agents and targets; not together with agents or targets"
    )

    @model_validator(mode="after")
    def _one_way(self) -> "Flow":
        if (self.agents or self.targets) and (self.air or self.water):
            raise ValueError("give either agents and targets, or air and water")
        for name in ("agents", "targets", "air"):
            if getattr(self, name) is not None and getattr(self, name).waves is not None:
                raise ValueError(f"{name}.waves: only water has waves; expected them in flow.water")
        return self

    def parts(self, team: Team) -> dict[str, Any]:
        """Return the fields of a System that describe its flow, by medium or else by role."""
        if self.air is not None or self.water is not None:
            names = ("wind", "current")
            fields = (self.air, self.water)
            met = [0 if member.dimension == 3 else 1 for member in team.members]
        else:
            names = ("flow about agents", "flow about targets")
            fields = (self.agents, self.targets)
            met = [0] * len(team.agents) + [1] * len(team.targets)
        flows = [field or NO_FLOW for field in fields]
        return {"flows": flows, "flow_names": names, "field": np.array(met, dtype=np.int64)}


class Disturbances(Section):
    """Disturbances of agents and targets."""

    agents: varying.Disturbance | None = Field(None, description="of every agent, drawn independently")
    targets: varying.Disturbance | None = Field(None, description="of every target, drawn independently")

    def require_resolved(self, last: float) -> None:
        """Refuse frequencies that the loops do not resolve up to |t| = `last`, s."""
        for role, kind in (("agents", self.agents), ("targets", self.targets)):
            if kind is not None:
                with in_field(f"disturbance.{role}"):
                    kind.require_resolved(last)

    def draw(self, team: Team, seed: int) -> Array:
        """Draw the harmonics of each vehicle, shape (V, K, 5)."""
        kinds = [self.agents] * len(team.agents) + [self.targets] * len(team.targets)
        return varying.draw(kinds, [m.dimension for m in team.members], [m.id for m in team.members], seed)


EDGE_FIELDS = ("communication", "sensing", "target_edges")
"""The fields of a scenario that hold edges."""
_MOST_SAMPLES = 50_000_000


class Attitude(Section):
    """Attitude of an agent's local frame."""

    roll: Number = Field(0.0, description="then rotation about its x [degrees]")
    pitch: Number = Field(0.0, description="then rotation about its y [degrees]")
    yaw: Number = Field(0.0, description="rotation about z, the first of the three [degrees]")


class Agent(Section):
    """A controlled vehicle; its dimension is the length of its position."""

    id: Id = Field(description="unique name: a letter, then letters, digits, _ and -")
    position: Point = Field(
        description="initial position x, y or x, y, z; two numbers make a planar agent, three a spatial one [m]"
    )
    heading: Number | None = Field(
        None, description="initial heading of the body, from the x axis to port; 0 unless given [degrees]"
    )
    vehicle: str | None = Field(
        None,
        description="name, of those that `mjsheaf list --vehicles` shows, or a description file; "
        "vehicles.agents unless given",
    )
    frame: Attitude | None = Field(None, description="frame of its local_frame edges; yaw = heading unless given")
    velocity_limit: Positive | None = Field(
        None, description="largest commanded speed; controller.velocity_limit unless given [m/s]"
    )
    effectiveness: effectivenesses.ControlEffectiveness | None = Field(
        None, description="g_i(q, t) on the ideal backend; the identity unless given"
    )
    drift: bool = Field(
        False,
        description="whether an agent that joins later drifts with the medium until then, instead of holding its "
        "position",
    )

    @property
    def member(self) -> Member:
        """The agent as its team knows it."""
        angles = (self.frame.roll, self.frame.pitch, self.frame.yaw) if self.frame else (0.0, 0.0, self.heading or 0.0)
        roll, pitch, yaw = np.deg2rad(angles).tolist()
        return Member(self.id, len(self.position), (roll, pitch, yaw))


class Target(Section):
    """An uncontrolled vehicle; its dimension is the length of its position."""

    id: Id = Field(description="unique name: a letter, then letters, digits, _ and -")
    position: Point = Field(description="initial position x, y or x, y, z; its length is the target's dimension [m]")
    heading: Number | None = Field(
        None, description="initial heading of the body, from the x axis to port; 0 unless given [degrees]"
    )
    vehicle: str | None = Field(
        None,
        description="name, of those that `mjsheaf list --vehicles` shows, or a description file; "
        "vehicles.targets unless given",
    )
    motion: Motion | None = Field(None, description="target_motion unless given")


class TargetFormation(Section):
    """The targets' own consensus: v = -gain (L_T p - c_T)."""

    gain: Positive = Field(description="rate of the targets' consensus [1/s]")
    group: Group | None = Field(None, description="where targets belong; consensus on one point unless given")


class Time(Section):
    """The span of the run."""

    start: NonNegative = Field(0.0, description="time of the first sample [s]")
    end: NonNegative = Field(30.0, description="the last sample is the last whole period up to here [s]")

    @model_validator(mode="after")
    def _ordered(self) -> "Time":
        if self.end <= self.start:
            raise ValueError(f"end ({self.end}) must be after start ({self.start})")
        return self

    def grid(self, control_period: float, record_period: float) -> TimeGrid:
        """The samples: one each control period, or each record period under a continuous law; periods in s.

        Raises:
            InputError: there are none, or too many.
        """
        period = control_period or record_period
        # A span that is a whole number of periods up to rounding keeps its last sample.
        steps = (self.end - self.start) / period + 1e-6
        if not 1.0 <= steps <= _MOST_SAMPLES:
            raise InputError(f"end: gives {steps:.3g} control periods; expected 1 to {_MOST_SAMPLES}")
        return TimeGrid(self.start, period, int(steps), continuous=control_period == 0.0)


class _Law(Section):
    gain: Positive = Field(1.0, description="k1 of u_i = -k1 g_i^+ eta_i [1/s]")
    control_period: NonNegative = Field(
        0.01,
        description="time between samples; a command is held between samples; 0 evaluates the law continuously [s]",
    )
    record_period: Duration = Field(0.01, description="time between recorded samples where control_period is 0 [s]")
    velocity_limit: Positive | None = Field(
        None, description="largest commanded speed of every agent; no limit unless given [m/s]"
    )


class Controller(Terms, _Law):
    """The law u_i = -k1 g_i^+ eta_i, and its terms beyond the paper's."""

    custom: dict[str, CustomTerm] = Field(
        {}, description="compiled terms of your own, by the name that `mjsheaf.register` gave them; none unless given"
    )

    @model_validator(mode="after")
    def _sampled(self) -> "Controller":
        if (self.has_terms or self.custom) and self.control_period == 0.0:
            raise ValueError(
                "control_period is 0; expected a positive one with feedforward, newton, drift, integral or custom terms"
            )
        return self


class Spread(Section):
    """Random initial conditions, drawn from the seed."""

    position: NonNegative = Field(0.0, description="half width of a uniform box about each agent's position [m]")
    heading: Annotated[float, Field(ge=0, le=180)] = Field(
        0.0, description="half width of a uniform interval about every heading [degrees]"
    )

    def place(self, agents: Sequence[Agent], targets: Sequence[Target], seed: int) -> tuple[Array, Array]:
        """Return initial positions of all vehicles, shape (V, 3), m, and headings, shape (V,), rad.

        Each vehicle draws from a stream that its id names: no other vehicle changes where it begins.
        """
        vehicles: list[Agent | Target] = [*agents, *targets]
        position = np.array([[*vehicle.position, 0.0][:3] for vehicle in vehicles])
        heading = np.deg2rad([vehicle.heading or 0.0 for vehicle in vehicles])
        turn = np.deg2rad(self.heading)
        for v, vehicle in enumerate(vehicles if turn > 0.0 else agents if self.position > 0.0 else ()):
            # Both are drawn whatever their width, so that switching one on leaves the other as it was.
            drawn = generator_of(seed, "spread", vehicle.id).uniform(-1.0, 1.0, 4)
            heading[v] += turn * drawn[3]
            n = len(vehicle.position) if v < len(agents) else 0
            position[v, :n] += self.position * drawn[:n]
        return position, heading


class Vehicles(Section):
    """The bodies of the physics backend."""

    agents: str | None = Field(
        None,
        description="vehicle of agents without one of their own; hull in the plane and aerial in space unless given",
    )
    targets: str | None = Field(
        None,
        description="vehicle of targets without one of their own; hull in the plane and aerial in space unless given",
    )
    tau: Duration | None = Field(
        None,
        description="time constant of every body along surge, by autopilot or drag; its own unless given [s]",
    )

    def names(self, agents: Sequence[Agent], targets: Sequence[Target]) -> list[str]:
        """The vehicle of each agent and target."""
        pairs = [(a, self.agents) for a in agents] + [(t, self.targets) for t in targets]
        return [v.vehicle or default or DEFAULT_VEHICLE[len(v.position)] for v, default in pairs]


class Physics(Section):
    """Steps of the physics backend."""

    timestep: Duration = Field(0.001, description="MuJoCo's step; the control period must be a multiple of it [s]")
    contacts: bool = Field(False, description="whether vehicles collide")
    effects: Effects = Field(Effects(), description="what makes bodies real, each to be switched off alone")


class Ideal(Section):
    """Integration of the ideal backend."""

    rtol: Annotated[float, Field(ge=1e-13, le=1e-2)] = Field(
        1e-9, description="relative tolerance of the integrator [-]"
    )
    atol: Annotated[float, Field(gt=0, le=1)] = Field(1e-12, description="absolute tolerance of the integrator [m]")


def _stopping_times(vehicles: Sequence[Vehicle], control: ControlArrays, timestep: float, steps: int) -> list[float]:
    """Compute the stopping time of each vehicle, s; see `mjsheaf.loop.linear`, which imports MuJoCo."""
    from mjsheaf.loop.linear import stopping_times

    return stopping_times(vehicles, control, timestep, steps)


Scale = Annotated[float, Field(ge=1e-3, le=1e4)]
"""How many times larger than life something is drawn."""


class Scene(Section):
    """Objects that the video shows in addition to the vehicles."""

    surface: Literal["water", "ground", "none"] = Field("water", description="what is drawn at `height`")
    height: Number = Field(0.0, description="height of the surface; planar vehicles move at it [m]")
    vehicle_scale: Scale | None = Field(
        None,
        description="vehicles are drawn this many times larger; without it each kind is enlarged just enough to be "
        "seen next to the team [-]",
    )
    vehicle_scales: dict[str, Scale] = Field(
        default_factory=dict,
        description="the same for agents and targets by id, or for kinds of vehicle by name, such as {wamv: 1}; an id "
        "overrides its kind [-]",
    )


class Video(Section):
    """Settings of a run's video."""

    width: Annotated[int, Field(ge=64, le=7680, multiple_of=2)] = Field(1280, description="of a frame [px]")
    height: Annotated[int, Field(ge=64, le=7680, multiple_of=2)] = Field(720, description="of a frame [px]")
    fps: Annotated[int, Field(ge=1, le=240)] = Field(30, description="frames per second of video [1/s]")
    speed: Annotated[float, Field(ge=1e-3, le=1e3)] = Field(
        1.0, description="simulated seconds per second of video [-]"
    )
    azimuth: Annotated[float, Field(ge=-360, le=360)] = Field(
        120.0, description="direction in which the camera looks, about z [degrees]"
    )
    elevation: Annotated[float, Field(ge=-90, le=90)] = Field(
        -35.0, description="of the direction in which the camera looks; negative looks down [degrees]"
    )
    distance: Annotated[float, Field(ge=1e-3, le=1e6)] | None = Field(
        None, description="of the camera; follows the team unless given [m]"
    )
    trail: Annotated[float, Field(ge=0, le=1e6)] = Field(6.0, description="time that trails reach back [s]")
    quality: Literal["good", "draft"] = Field(
        "good", description="draft: drawn quickly, coarse and with hard edges, at most 15 frames a second"
    )
    legend: Literal[True] = Field(
        True, description="a panel next to the scene always explains colours, lines and arrows"
    )

    @property
    def eye(self) -> tuple[float, float]:
        """Azimuth and elevation of the eye as seen from the team, in degrees, for matplotlib's `view_init`.

        Video, page and plots all look from here. The azimuth is counted from x about z; a positive elevation is above
        the horizon.
        """
        return (self.azimuth + 360.0) % 360.0 - 180.0, -self.elevation


class PhaseBounds(Section):
    """Largest errors that are expected; a missing one is not checked."""

    mean_disagreement: NonNegative | None = Field(None, description="mean over agents of |eta_i| [m]")
    tracking_error: NonNegative | None = Field(None, description="RMS over agents of |q*_i - q_i| [m]")
    formation_error: NonNegative | None = Field(
        None, description="RMS of the residual over edges inside formations [m]"
    )
    centering_error: NonNegative | None = Field(
        None, description="largest distance of a formation's centroid from where it should be [m]"
    )


class Bounds(PhaseBounds):
    """Largest final errors that are expected, those at the end of each phase, and the smallest separation."""

    smallest_separation: NonNegative | None = Field(
        None,
        description="with `safety`: what distances exceed the required ones by, at least, over the whole run; not "
        "negative, because vehicles that come too close are no regression to keep [m]",
    )
    phases: list[PhaseBounds] | None = Field(
        None, description="at the last sample of each phase of a run with events, but for the last phase"
    )


class Expect(Section):
    """Largest errors of a regression run, for each backend."""

    ideal: Bounds | None = Field(None, description="bounds for the ideal backend")
    physics: Bounds | None = Field(None, description="bounds for the physics backend")
    refused: str | None = Field(None, description="`run` must refuse, and its reason must contain this")
    controller: str | None = Field(
        None,
        description="law in Python for which the bounds hold, FILE.py:NAME with a path from this file's directory; "
        "that of the scenario unless given",
    )


def _optional(schema: dict[str, Any]) -> None:
    """Make fields optional that a file may omit: the name, which is then the file's, and agents of a swarm."""
    schema["required"] = [name for name in schema["required"] if name not in ("name", "agents")]


class Scenario(Section):
    """A team, a sheaf, a formation, a flow, a law, and what is expected of them."""

    model_config = ConfigDict(json_schema_extra=_optional)

    name: Id = Field(description="name of the scenario, and of its run directory; the file's name unless given")
    summary: str = Field("", description="one line that `mjsheaf list` and the gallery show")
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(
        0, description="seed of everything that is random: spread, disturbances, noise, losses, swarm [-]"
    )
    time: Time = Field(Time(), description="span of the run")
    controller: Controller = Field(Controller(), description="law of the agents")
    swarm: Swarm | None = Field(
        None, description="generates agents, communication, sensing and formations; give either it or those"
    )
    agents: Annotated[list[Agent], Field(min_length=1)] = Field(description="vehicles that the law controls")
    targets: list[Target] = Field(
        default_factory=list,
        description="vehicles that the agents track and that the law does not control; without any the agents keep "
        "their formation",
    )
    communication: list[PairOrEdge] = Field(
        default_factory=list, description="edges between agents: a pair [tail, head], or a mapping with more fields"
    )
    sensing: list[PairOrEdge] = Field(default_factory=list, description="edges from an agent (tail) to a target (head)")
    target_edges: list[PairOrEdge] = Field(
        default_factory=list, description="edges between targets, for `target_formation`"
    )
    anchors: list[Anchor] = Field(
        default_factory=list, description="an agent's measurements that should have a fixed value"
    )
    links: Links = Field(
        Links(), description="noise, delay and loss of what edges measure; exact and at once unless given"
    )
    formations: list[Group] = Field(
        default_factory=list, description="groups of agents with a place for each; needs edges between the members"
    )
    target_motion: Motion | None = Field(None, description="motion of every target that has none of its own")
    target_formation: TargetFormation | None = Field(
        None, description="the targets' own consensus; targets ignore one another unless given"
    )
    events: list[AnyEvent] = Field(
        default_factory=list,
        description="what happens during the run: losses, joins, cuts, changes of fields and formations",
    )
    flow: Flow = Field(Flow(), description="velocity of the medium; at rest unless given")
    safety: Safety | None = Field(
        None, description="keeps agents apart from one another, from targets and from obstacles; nothing unless given"
    )
    disturbance: Disturbances = Field(Disturbances(), description="bounded random velocities, in addition to the flow")
    spread: Spread = Field(Spread(), description="random initial conditions; none unless given")
    vehicles: Vehicles = Field(Vehicles(), description="bodies of the physics backend")
    physics: Physics = Field(Physics(), description="how the physics backend steps")
    ideal: Ideal = Field(Ideal(), description="how the ideal backend integrates")
    scene: Scene = Field(Scene(), description="objects that pictures and videos show in addition to the vehicles")
    video: Video = Field(Video(), description="settings of a run's video")
    expect: Expect = Field(Expect(), description="largest errors for `run --expect`, `mjsheaf expect` and pytest")

    @model_validator(mode="before")
    @classmethod
    def _write_out_swarm(cls, raw: Any) -> Any:
        return expand_swarm(raw) if isinstance(raw, dict) else raw

    @model_validator(mode="after")
    def _scaled(self) -> "Scenario":
        with in_field("scene"):
            _ = self.drawn_scales
        return self

    def __repr__(self) -> str:
        edges = len(self.communication) + len(self.sensing)
        parts = {"agent": len(self.agents), "target": len(self.targets), "edge": edges}
        counts = [f"{count} {what}{'s' * (count != 1)}" for what, count in parts.items()]
        return f"Scenario({self.name!r}: {', '.join(counts)}; {self.time.start:g} to {self.time.end:g} s)"

    __str__ = __repr__

    @property
    def drawn_scales(self) -> Array:
        """Scale at which the scenario has each vehicle drawn, shape (V,), agents first; NaN where it gives none.

        Raises:
            InputError: A name in `scene.vehicle_scales` is no vehicle's.
        """
        ids = [*(agent.id for agent in self.agents), *(target.id for target in self.targets)]
        kinds = self.vehicles.names(self.agents, self.targets)
        named = self.scene.vehicle_scales
        unknown = sorted(set(named) - {*ids, *kinds})
        if unknown:
            known = shortened(", ".join(visible(name) for name in dict.fromkeys([*kinds, *ids])))
            raise InputError(
                f"vehicle_scales.{visible(unknown[0])}: there is none of this name; expected one of {known}"
            )
        of_kinds = [named.get(kind, self.scene.vehicle_scale) for kind in kinds]
        scales = [named.get(name, scale) for name, scale in zip(ids, of_kinds, strict=True)]
        return np.array(scales, dtype=np.float64)  # None becomes NaN

    @cached_property
    def team(self) -> Team:
        """The agents and targets with their edges and formations, as a sheaf.

        Raises:
            InputError: fields do not fit together; the message begins with the field.
        """
        for k, edge in enumerate(self.target_edges):
            for name in edge.own:
                raise InputError(
                    f"target_edges.{k}.{name}: targets have no links; expected between, map, weight, offset"
                )
        return self._placed(self.formations)

    def _placed(self, formations: Sequence[Formation]) -> Team:
        """Return the team with other formations."""
        height = self.scene.height
        return Team(
            [replace(agent.member, height=height) for agent in self.agents],
            [Member(target.id, len(target.position), height=height) for target in self.targets],
            self.communication,
            self.sensing,
            self.target_edges,
            formations,
            self.target_formation.group if self.target_formation else None,
            self.anchors,
        )

    def with_seed(self, seed: int) -> "Scenario":
        """The same scenario under another seed; it shares the team and all else that no seed changes.

        Raises:
            InputError: See `phases`, which are built; or the seed is no whole number from 0 to 2^63 - 1.
        """
        require_seed("seed", seed)
        other = self.model_copy(update={"seed": int(seed)})
        other.__dict__ |= {"team": self.team, "_compiled": self._compiled, "_of_some_seed": self._of_some_seed}
        _ = other.phases
        return other

    @cached_property
    def _compiled(self) -> dict[tuple[Any, ...], Vehicle]:
        """Vehicles that were loaded; see `PhysicsOptions.compiled`."""
        return {}

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """The run as phases, one unless there are events; built once.

        Raises:
            InputError: an event cannot happen, or as for `whole`; the message begins with the field.
        """
        sections = {"controller": self.controller, "links": self.links, "flow": self.flow}
        sections |= {"safety": self.safety} if self.safety else {}
        drifting = [agent.id for agent in self.agents if agent.drift]
        return phases_of_events(self.events, self.whole, sections, self._adapted, self._placed, drifting)

    @property
    def system(self) -> System:
        """The closed-loop system with which the run begins; see `whole`."""
        return self.phases[0].system

    def _adapted(self, team: Team, sections: Mapping[str, Section]) -> System:
        """Return the system of a changed team, under another controller, over other links and in another flow."""
        whole = self.whole
        law = cast(Controller, sections["controller"])
        packed = self._pack_law(team, law, cast(Links, sections["links"]), whole.initial, whole.bodies.heading)
        flow = cast(Flow, sections["flow"])
        safety = cast(Safety | None, sections.get("safety"))
        system = replace(whole, team=team, gain=law.gain, law=packed, safety=safety, **flow.parts(self.team))
        system.require_fitting()
        return system

    @property
    def target_motions(self) -> list[Motion | None]:
        """Motion of each target; None if it has none."""
        return [target.motion or self.target_motion for target in self.targets]

    @property
    def _fixed(self) -> BoolArray:
        """True for each target that is fixed, shape (M,)."""
        return np.array([isinstance(motion, Fixed) for motion in self.target_motions], dtype=np.bool_)

    @cached_property
    def whole(self) -> System:
        """The closed-loop system that this scenario describes, whatever happens to it; built once.

        Raises:
            InputError: fields do not fit together; the message begins with the field.
        """
        system, law = self._of_some_seed, self._of_some_seed.law
        changes: dict[str, Any] = {}
        if self.spread.position > 0.0 or self.spread.heading > 0.0:
            initial, heading = self.spread.place(self.agents, self.targets, self.seed)
            if self.spread.heading > 0.0 or not self.team.linear:
                law = self._pack_law(self.team, self.controller, self.links, initial, heading)
            if self.spread.heading > 0.0:
                changes["bodies"] = replace(system.bodies, heading=heading)
            agents = np.arange(len(initial))[:, None] < len(self.agents)  # targets begin where they do under any seed
            motion = system.motion._replace(origin=np.where(agents, initial, system.motion.origin))
            changes |= {"initial": initial, "motion": motion}
        harmonics, law = self.disturbance.draw(self.team, self.seed), with_seed(law, self.seed)
        shared = {"steady_medium": system.steady_medium, "station": system.station}
        if not system.moving:
            shared["moving"] = ()
        system = replace(system, seed=self.seed, harmonics=harmonics, law=law, **changes)
        vars(system).update(shared)
        system.require_fitting()
        return system

    @cached_property
    def _of_some_seed(self) -> System:
        """System of the first seed, without its disturbances; scenarios of other seeds share it."""
        team, law, agents, targets = self.team, self.controller, self.agents, self.targets
        with in_field("time"):
            grid = self.time.grid(law.control_period, law.record_period)
        self.disturbance.require_resolved(max(abs(self.time.start), abs(self.time.end)))
        initial, heading = self.spread.place(agents, targets, self.seed)
        dimensions = [member.dimension for member in team.members]
        moves, names = [*[None] * len(agents), *self.target_motions], [f"targets.{id}.motion" for id in team.index]
        motion = pack_motions(moves, initial, self.time.start, dimensions, self.time.end, names)
        with in_field("agents"):
            g = effectivenesses.pack([agent.effectiveness for agent in agents], dimensions[: len(agents)])
        packed = self._pack_law(team, law, self.links, initial, heading)
        fixed = np.concatenate([np.zeros(len(agents), dtype=np.bool_), self._fixed])
        return System(
            name=self.name,
            team=team,
            initial=initial,
            grid=grid,
            gain=law.gain,
            law=packed,
            motion=motion,
            harmonics=np.zeros((len(initial), 0, 5)),
            effectiveness=g,
            **self.flow.parts(team),
            safety=self.safety,
            waiting=Station(fixed, initial, np.zeros(len(fixed)), packed.limit) if fixed.any() else None,
            tolerance=(self.ideal.rtol, self.ideal.atol),
            bodies=PhysicsOptions(
                vehicle=self.vehicles.names(agents, targets),
                time_constant=self.vehicles.tau,
                effects=self.physics.effects,
                heading=heading,
                timestep=self.physics.timestep,
                contacts=self.physics.contacts,
                surface=self.scene.surface,
                surface_height=self.scene.height,
                stopping_times=_stopping_times,
                compiled=self._compiled,
            ),
        )

    def _pack_law(self, team: Team, law: Controller, links: Links, initial: Array, heading: Array) -> LawArrays:
        """The law of a team under a controller and over links, from initial positions (V, 3) and headings (V,), rad."""
        period, height, events = law.control_period, self.scene.height, self.events
        slopes = bound_slopes(team, initial) if law.has_rounds and not team.linear else None
        rounds = pack_rounds(slopes.bound if slopes else team, links, period=period, height=height)
        packed_links = pack_links(
            team,
            links,
            period=period,
            start=self.time.start,
            height=height,
            heading=heading,
            feedforward=self.controller.feedforward is not None
            or any(e.touches("feedforward") for e in events if isinstance(e, Change)),
            run=self.team,
        )
        limits = [a.velocity_limit or law.velocity_limit or np.inf for a in self.agents] + [np.inf] * len(self.targets)
        return pack_law(
            team,
            law.gain,
            np.where(self._fixed, 0.0, self.target_formation.gain if self.target_formation else 0.0),
            np.array(limits),
            pack_terms(law, team, period, rounds, slopes),
            packed_links,
            pack_custom(law.custom, len(team.agents), period),
            self.seed,
        )

    def uses_seed(self, backend: str) -> bool:
        """Return True if another seed would change anything on a backend."""
        drawn = any(d is not None and d.bound > 0.0 for d in (self.disturbance.agents, self.disturbance.targets))
        drawn = drawn or any(phase.system.law.random or phase.system.moving for phase in self.phases)
        return drawn or self.spread.position > 0.0 or (backend == "physics" and self.spread.heading > 0.0)
