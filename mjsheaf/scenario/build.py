"""From a scenario to the closed-loop system that it describes."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mjsheaf.control import pack_law
from mjsheaf.dynamics import ControlEffectiveness, Disturbance, FlowField, Lissajous, Waypoints
from mjsheaf.dynamics import disturbance as disturbances
from mjsheaf.dynamics import effectiveness as effectivenesses
from mjsheaf.dynamics import motion as motions
from mjsheaf.errors import InputError, expected
from mjsheaf.scenario import scenario as medium_schema
from mjsheaf.scenario import scenario as team_schema
from mjsheaf.scenario.scenario import Scenario
from mjsheaf.system import BodyPlan, Effects, System, TimeGrid
from mjsheaf.team import GROUND, Edge, Formation, Member, Team, anchor, formation, restriction_maps

Array = NDArray[np.float64]
T = TypeVar("T")

DEFAULT_VEHICLE = {2: "hull", 3: "aerial"}
"""What an agent or target of each dimension is unless the scenario names something else; takes any effects and tau."""
_EDGES = {"communication": ("agent", "agent"), "sensing": ("agent", "target"), "target_edges": ("target", "target")}
"""The fields that hold edges, and what their tails and heads are."""
_MOST_SAMPLES = 50_000_000


def build_system(scenario: Scenario) -> System:
    """Build the system of a scenario.

    Raises:
        InputError: fields do not fit together; the message begins with the field.
    """
    team = build_team(scenario)
    grid = _at("time", lambda: _time_grid(scenario))
    dimensions = [m.dimension for m in team.members]
    N = len(team.agents)
    rng = np.random.default_rng(scenario.seed)
    initial, heading = _initial_conditions(scenario, dimensions, rng)
    disturbed = scenario.disturbance
    kinds = _per_vehicle(
        scenario,
        _at("disturbance.agents", lambda: _disturbance(disturbed.agents, scenario.time)),
        _at("disturbance.targets", lambda: _disturbance(disturbed.targets, scenario.time)),
    )
    agents, targets = scenario.agents, scenario.targets
    vehicles: list[team_schema.Agent | team_schema.Target] = [*agents, *targets]
    limit = scenario.controller.velocity_limit
    limits = np.array([a.velocity_limit or limit or np.inf for a in agents] + [np.inf] * len(targets))
    target_gain = scenario.target_formation.gain if scenario.target_formation else 0.0
    return System(
        name=scenario.name,
        team=team,
        initial=initial,
        grid=grid,
        gain=scenario.controller.gain,
        law=pack_law(team, scenario.controller.gain, target_gain, limits),
        motion=_at("targets", lambda: _motions(scenario, initial, dimensions)),
        harmonics=_at("disturbance", lambda: disturbances.draw(kinds, dimensions, rng)),
        effectiveness=_at("agents", lambda: _effectiveness(scenario, dimensions[:N])),
        flows=[_at(f"flow.{name}", partial(_flow, model)) for name, model in _fields(scenario).items()],
        field=_field_of_each(scenario, dimensions),
        tolerance=(scenario.ideal.rtol, scenario.ideal.atol),
        bodies=BodyPlan(
            vehicle=[
                v.vehicle or default or DEFAULT_VEHICLE[n]
                for v, default, n in zip(
                    vehicles,
                    _per_vehicle(scenario, scenario.vehicles.agents, scenario.vehicles.targets),
                    dimensions,
                    strict=True,
                )
            ],
            time_constant=scenario.vehicles.tau,
            effects=Effects(**scenario.physics.effects.model_dump()),
            heading=heading,
            timestep=scenario.physics.timestep,
            contacts=scenario.physics.contacts,
            surface=scenario.scene.surface,
            surface_height=scenario.scene.height,
        ),
    )


def build_team(scenario: Scenario) -> Team:
    """Build the team of a scenario: its sheaf and its formations."""
    agents = [Member(a.id, len(a.position)) for a in scenario.agents]
    targets = [Member(t.id, len(t.position)) for t in scenario.targets]
    dimension: dict[str, int] = {}
    for member in agents + targets:  # before edges are looked up by id
        if member.id in dimension:
            raise InputError(f"agents, targets: id {member.id!r} is used twice; each needs its own")
        dimension[member.id] = member.dimension
    attitude = {a.id: _attitude(a) for a in scenario.agents}
    agent_ids, target_ids = [m.id for m in agents], [m.id for m in targets]
    role = dict.fromkeys(agent_ids, "agent") | dict.fromkeys(target_ids, "target")
    edges = {
        field: _each(field, getattr(scenario, field), partial(_edge, dimension=dimension, attitude=attitude,
                                                              role=role, wanted=wanted))
        for field, wanted in _EDGES.items()
    }  # fmt: skip
    for field, made in edges.items():
        _require_different(field, made, [model.parallel for model in getattr(scenario, field)])
    anchors = _each("anchors", scenario.anchors, lambda a: _anchor(a, dimension, agent_ids))
    _require_different("anchors", anchors, [model.parallel for model in scenario.anchors])
    groups = _each("formations", scenario.formations, lambda g: _formation(g, dimension, agent_ids, target_ids))
    names = [g.name for g in groups]
    if len(set(names)) != len(names):
        raise InputError(f"formations: each needs its own name, but they are {names}")
    own = scenario.target_formation.group if scenario.target_formation else None
    if own is not None and own.about is not None:
        raise InputError("target_formation.group.about: targets hold their formation about no other; leave it out")
    target_formation = _at("target_formation", lambda: _formation(own, dimension, target_ids, [])) if own else None
    return _at(
        "team",
        lambda: Team(
            agents,
            targets,
            edges["communication"],
            edges["sensing"],
            edges["target_edges"],
            groups,
            target_formation,
            anchors,
        ),
    )


def uses_seed(scenario: Scenario) -> dict[str, bool]:
    """For each backend, whether another seed would change anything."""
    drawn = [d for d in (scenario.disturbance.agents, scenario.disturbance.targets) if d is not None and d.bound > 0.0]
    ideal = bool(drawn) or scenario.spread.position > 0.0
    return {"ideal": ideal, "physics": ideal or scenario.spread.heading > 0.0}


def _at(field: str, make: Callable[[], T]) -> T:
    try:
        return make()
    except InputError as error:
        raise InputError(f"{field}: {error}") from None


def _each(field: str, models: Sequence[Any], make: Callable[[Any], T]) -> list[T]:
    made = []
    for k, model in enumerate(models):
        try:
            made.append(make(model))
        except InputError as error:
            raise InputError(f"{field}.{k}: {error}") from None
    return made


def _per_vehicle(scenario: Scenario, for_agent: T, for_target: T) -> list[T]:
    return [for_agent] * len(scenario.agents) + [for_target] * len(scenario.targets)


def _time_grid(scenario: Scenario) -> TimeGrid:
    control = scenario.controller.control_period
    period = control or scenario.controller.record_period
    # A span that is a whole number of periods up to rounding keeps its last sample.
    steps = (scenario.time.end - scenario.time.start) / period + 1e-6
    if not 1.0 <= steps <= _MOST_SAMPLES:
        raise InputError(f"end: gives {steps:.3g} control periods; expected 1 to {_MOST_SAMPLES}")
    return TimeGrid(scenario.time.start, period, int(steps), continuous=control == 0.0)


def _initial_conditions(scenario: Scenario, dimensions: list[int], rng: np.random.Generator) -> tuple[Array, Array]:
    """Initial positions (V, 3) in m and headings (V,) in rad, spread over the seed's draw."""
    vehicles: Sequence[team_schema.Agent | team_schema.Target] = [*scenario.agents, *scenario.targets]
    position = np.zeros((len(vehicles), 3))
    for v, vehicle in enumerate(vehicles):
        position[v, : dimensions[v]] = vehicle.position
    # Both are drawn whatever their width, so that switching one on leaves the other as it was.
    shift, turn = rng.uniform(-1.0, 1.0, position.shape), rng.uniform(-1.0, 1.0, len(vehicles))
    for v in range(len(scenario.agents)):
        position[v, : dimensions[v]] += scenario.spread.position * shift[v, : dimensions[v]]
    heading = np.deg2rad([vehicle.heading or 0.0 for vehicle in vehicles])
    return position, heading + np.deg2rad(scenario.spread.heading) * turn


def _attitude(agent: team_schema.Agent) -> tuple[float, float, float]:
    if agent.frame is None:
        return 0.0, 0.0, float(np.deg2rad(agent.heading or 0.0))
    return tuple(float(np.deg2rad(x)) for x in (agent.frame.roll, agent.frame.pitch, agent.frame.yaw))  # type: ignore[return-value]


def _require_different(field: str, edges: Sequence[Edge], parallel: Sequence[bool]) -> None:
    """Refuse an edge that another one repeats, in either direction, unless one of them says that it is parallel.

    Each is legal, as two sensors may see the same; but together they count double, and most are written by mistake.

    Raises:
        InputError: naming both.
    """
    first: dict[tuple[Any, ...], int] = {}
    for k, edge in enumerate(edges):
        key = _equation(edge)
        if key not in first:
            first[key] = k
        elif not (parallel[k] or parallel[first[key]]):
            one, other = (_ends(edges[j]) for j in (first[key], k))
            raise InputError(
                f"{field}.{k}: {other} says the same as {field}.{first[key]}, {one}, and would count double; leave one "
                f"out, give it another weight, map or offset, or write parallel: true if there are two sensors"
            )


def _ends(edge: Edge) -> str:
    return f"the anchor of {edge.tail}" if edge.head == GROUND else f"[{edge.tail}, {edge.head}]"


def _equation(edge: Edge) -> tuple[Any, ...]:
    """What an edge says, the same in either direction: F_tail x_tail - F_head x_head = b, weighted by K."""
    ends, sign = [(edge.tail, edge.F_tail), (edge.head, edge.F_head)], 1.0
    if edge.head < edge.tail:
        ends, sign = ends[::-1], -1.0
    b = None if edge.offset is None else (sign * edge.offset + 0.0).tobytes()  # + 0.0: no negative zeros
    return (*((name, F.shape, (F + 0.0).tobytes()) for name, F in ends), (edge.weight + 0.0).tobytes(), b)


def _edge(
    edge: team_schema.EdgeModel,
    dimension: dict[str, int],
    attitude: dict[str, tuple[float, float, float]],
    role: dict[str, str],
    wanted: tuple[str, str],
) -> Edge:
    """Build an edge.

    Args:
        edge: as written.
        dimension: of every member, by id.
        attitude: roll, pitch, yaw of every agent's local frame, by id.
        role: 'agent' or 'target', by id.
        wanted: roles of tail and head.
    """
    tail, head = edge.between
    for end in edge.between:
        if end not in dimension:
            raise InputError(f"unknown id {end!r}; {expected(end, [i for i in role if role[i] in wanted])}")
    found = role[tail], role[head]
    if found != wanted:
        article = {"agent": "an agent", "target": "a target"}
        words = [f"{end} is {article[kind]}" for end, kind in zip(edge.between, found, strict=True)]
        swapped = f"; write [{head}, {tail}]" if found[::-1] == wanted else ""
        raise InputError(f"[{tail}, {head}]: expected [{', '.join(wanted)}], but {' and '.join(words)}{swapped}")
    if tail == head:
        raise InputError(f"({tail}, {head}) is a loop; the ends of an edge must differ")
    if isinstance(edge.map, team_schema.ExplicitMaps):
        F_tail, F_head = _matrix(edge.map.tail, "map.tail"), _matrix(edge.map.head, "map.head")
        for name, F, n in (("tail", F_tail, dimension[tail]), ("head", F_head, dimension[head])):
            if F.shape[1] != n:
                raise InputError(f"map.{name} has shape {F.shape}; expected (m, {n})")
        if len(F_tail) != len(F_head):
            raise InputError(f"map.tail has {len(F_tail)} rows and map.head {len(F_head)}; they must be equal")
    else:
        F_tail, F_head = restriction_maps(
            edge.map, dimension[tail], dimension[head], attitude.get(tail, (0.0, 0.0, 0.0))
        )
    m = len(F_tail)
    K = _weight(edge.weight, m)
    offset = None if edge.offset is None else np.array(edge.offset, dtype=np.float64)
    if offset is not None and offset.shape != (m,):
        raise InputError(f"offset has {offset.size} entries; the edge stalk has dimension {m}")
    return Edge(tail, head, F_tail, F_head, K, offset)


def _anchor(model: team_schema.AnchorModel, dimension: dict[str, int], agents: list[str]) -> Edge:
    if model.agent not in agents:
        raise InputError(f"agent: unknown id {model.agent!r}; {expected(model.agent, agents)}")
    n = dimension[model.agent]
    if model.map is not None:
        F = _matrix(model.map, "map")
        if F.shape[1] != n:
            raise InputError(f"map has shape {F.shape}; expected (m, {n})")
    else:
        rows = ["xyz".index(axis) for axis in model.axes or []]
        if max(rows) >= n or len(set(rows)) != len(rows):
            raise InputError(f"axes: {model.agent} has the coordinates {', '.join('xyz'[:n])}, each at most once")
        F = np.eye(n)[rows]
    if len(model.value) != len(F):
        raise InputError(f"value has {len(model.value)} entries; {len(F)} numbers are measured")
    return anchor(model.agent, F, np.array(model.value, dtype=np.float64), _weight(model.weight, len(F)))


def _weight(weight: float | Sequence[Sequence[float]] | None, m: int) -> Array:
    if weight is None or isinstance(weight, float | int):
        return (1.0 if weight is None else weight) * np.eye(m)
    K = _matrix(weight, "weight")
    if K.shape != (m, m):
        raise InputError(f"weight has shape {K.shape}; expected ({m}, {m}) or a positive number")
    return K


def _matrix(rows: Sequence[Sequence[float]], name: str) -> Array:
    if len({len(row) for row in rows}) != 1:
        raise InputError(f"{name}: rows have different lengths")
    return np.array(rows, dtype=np.float64)


def _formation(group: Any, dimension: dict[str, int], members: list[str], targets: list[str]) -> Formation:
    known, named = set(members), set()
    for member in group.members:
        if member not in known:
            raise InputError(f"members: unknown id {member!r}; {expected(member, members)}")
        if member in named:
            raise InputError(f"members: {member!r} is named twice")
        named.add(member)
    if group.about is not None and group.about not in targets:
        raise InputError(f"about: {group.about!r} is not a target; {expected(group.about, targets)}")
    sizes = [dimension[m] for m in group.members]
    if isinstance(group, team_schema.ExplicitGroup):
        places = formation.explicit(group.displacements, sizes)
    else:
        count = len(sizes)
        if isinstance(group, team_schema.PolygonGroup):
            corners = formation.polygon(
                count, side=group.side, radius=group.radius, angle=group.angle, clockwise=group.clockwise
            )
        elif isinstance(group, team_schema.LineGroup):
            corners = formation.line(count, spacing=group.spacing, angle=group.angle)
        else:
            corners = formation.tetrahedron(group.side)
        places = formation.displacements(corners, sizes, group.height)
    return Formation(group.name, tuple(group.members), places, group.about)


def _fields(scenario: Scenario) -> dict[str, medium_schema.FlowModel | None]:
    """The flow fields by name: by medium where one is given, else by role."""
    flow = scenario.flow
    if flow.air is not None or flow.water is not None:
        return {"air": flow.air, "water": flow.water}
    return {"agents": flow.agents, "targets": flow.targets}


def _field_of_each(scenario: Scenario, dimensions: list[int]) -> NDArray[np.int64]:
    """Number of the field that each vehicle meets, shape (V,)."""
    if "air" in _fields(scenario):
        return np.array([0 if n == 3 else 1 for n in dimensions], dtype=np.int64)
    return np.array(_per_vehicle(scenario, 0, 1), dtype=np.int64)


def _flow(model: medium_schema.FlowModel | None) -> FlowField:
    if model is None:
        return FlowField(2)
    if model.dimension == 3 and any(v.axis is None for v in model.vortices):
        raise InputError("vortices: in space each needs an axis")
    if model.dimension == 2 and any(v.axis is not None for v in model.vortices):
        raise InputError("vortices: in the plane the axis is z; leave it out")
    return FlowField(
        model.dimension,
        model.core,
        model.drift,
        [[*k.centre, k.alpha] for k in model.sources],
        [[*k.centre, *(k.axis or []), k.gamma] for k in model.vortices],
        [[*k.centre, *k.direction, k.beta, k.width, k.length] for k in model.channels],
    )


def _disturbance(model: medium_schema.DisturbanceModel | None, time: Any) -> Disturbance | None:
    if model is None:
        return None
    low, high = model.frequencies
    kind = Disturbance(model.bound, (low, high), model.components)
    last = max(abs(time.start), abs(time.end))
    if kind.bound > 0.0 and last > kind.longest_time:
        raise InputError(
            f"frequencies: {high:g} Hz over {last:g} s is a phase of {2.0 * np.pi * high * last:.2g} rad, which a sine "
            f"in double precision does not resolve in the loop; expected at most {disturbances.LARGEST_PHASE:.0e} rad: "
            f"time.end up to {0.99 * kind.longest_time:.3g} s, or up to "
            f"{0.99 * high * kind.longest_time / last:.3g} Hz"
        )
    return kind


def _motions(scenario: Scenario, initial: Array, dimensions: list[int]) -> motions.MotionArrays:
    chosen: list[motions.Motion | None] = [None] * len(scenario.agents)
    for target in scenario.targets:
        model = target.motion or scenario.target_motion
        if isinstance(model, medium_schema.LissajousMotion):
            chosen.append(Lissajous(model.amplitude, model.rate, model.phase, model.pull))
        elif isinstance(model, medium_schema.WaypointMotion):
            chosen.append(Waypoints(model.points, model.speed, model.closed, model.pull))
        elif model is not None and model.pull > 0.0:
            still = [0.0] * len(target.position)
            chosen.append(Lissajous(still, still, still, model.pull))
        else:
            chosen.append(None)
    return motions.pack(chosen, initial, scenario.time.start, dimensions)


def _effectiveness(scenario: Scenario, dimensions: list[int]) -> effectivenesses.EffectivenessArrays:
    models: list[ControlEffectiveness | None] = []
    for agent in scenario.agents:
        g = agent.effectiveness
        if g is None:
            models.append(None)
            continue
        gradient = None if g.heading_gradient is None else [float(x) for x in np.deg2rad(g.heading_gradient)]
        models.append(ControlEffectiveness(g.layout, np.deg2rad(g.heading), gradient, np.deg2rad(g.heading_rate)))
    return effectivenesses.pack(models, dimensions)
