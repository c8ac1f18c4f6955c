"""A swarm: agents, their graph and their formation, generated from a number and a seed instead of written out.

Places are those of a sunflower (Vogel, Math. Biosci. 44, 1979): any number of them fills a disc evenly. The scenario
that comes out has every agent and edge in it; nothing else knows that they were generated. networkx and scipy are
imported by the graphs that need them, so that commands which make none come at once.
"""

from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import InputError
from mjsheaf.section import Id, NonNegative, Number, Point, Positive, Section
from mjsheaf.sheaf.nonlinear import Measure

Edges = set[tuple[int, int]]

_POINT: TypeAdapter[list[float]] = TypeAdapter(Point, config=ConfigDict(strict=True, allow_inf_nan=False))
_MOST_AGENTS = 100_000
_MOST_DRAWS = 100  # of a graph that must be connected: with three links or more, nearly every one is
_AT_A_TIME = 4096  # agents whose neighbours are sought together
_SCATTER = 0x5A  # stream of random numbers
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


class Swarm(Section):
    """Agents S1, S2, ... in a disc about a target, with a graph drawn from the scenario's seed."""

    size: Annotated[int, Field(ge=1, le=_MOST_AGENTS)] = Field(description="number of agents, S1, S2, ... [-]")
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
    _require_alone(raw)
    centre = _centre_of(swarm.about, raw.get("targets"))
    seed = raw.get("seed", 0)
    if type(seed) is not int or not 0 <= seed < 2**63:
        raise InputError(f"seed: expected a whole number from 0 to 2^63 - 1, not {str(seed)[:60]!r}")
    if swarm.graph in ("nearest", "small_world") and swarm.degree % 2:
        raise InputError(
            f"swarm.degree: {swarm.degree} is odd; expected an even number with graph {swarm.graph}, as half "
            "of an agent's links lead each way"
        )
    return {name: value for name, value in raw.items() if name != "swarm"} | _written_out(swarm, centre, seed)


def _require_alone(raw: dict[str, Any]) -> None:
    """Refuse fields that a swarm makes."""
    made = [name for name in ("agents", "communication", "sensing", "formations") if raw.get(name)]
    if made:
        raise InputError(f"swarm: makes {', '.join(made)} itself; give either")


def _centre_of(about: str, targets: Any) -> list[float]:
    """Return the position of the target that a swarm is about; targets are as a file has them.

    Raises:
        InputError: There is no such target, or it has no position.
    """
    known = [target for target in targets if isinstance(target, dict)] if isinstance(targets, list) else []
    position = next((target.get("position") for target in known if target.get("id") == about), None)
    try:
        return _POINT.validate_python(position)
    except ValidationError:
        raise InputError(f"swarm.about: {about!r} is no target with a position of two or three numbers") from None


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
        "communication": [_edge(swarm, ids[i], ids[j], swarm.directed) for i, j in sorted(edges)],
        "sensing": [_edge(swarm, ids[k], swarm.about) for k in sensors],
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


def _edge(swarm: Swarm, tail: str, head: str, directed: bool = False) -> Any:
    """Return an edge as a file has it."""
    fields: dict[str, Any] = {}
    if swarm.measures != "position":
        fields["measures"] = swarm.measures
    if directed:
        fields["directed"] = True
    return {"between": [tail, head], **fields} if fields else [tail, head]


def _sunflower(size: int, spacing: float) -> Array:
    """Places in the plane about the origin, shape (size, 2), m; neighbours are about `spacing` apart."""
    k = np.arange(size) + 0.5
    radius, angle = spacing * np.sqrt(k / np.pi), _GOLDEN_ANGLE * np.arange(size)
    return np.asarray(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def _nearest(places: Array, swarm: Swarm, rng: np.random.Generator) -> Edges:
    """Each agent and its nearest ones, half the degree of them among those further in, so that all are connected."""
    starts = range(1, len(places), _AT_A_TIME)
    chunks = (np.arange(begin, min(begin + _AT_A_TIME, len(places))) for begin in starts)
    return set().union(*(_nearest_before(places, chunk, max(1, swarm.degree // 2)) for chunk in chunks))


def _nearest_before(places: Array, agents: IntArray, wanted: int) -> Edges:
    """Links from some agents to those nearest of the agents before them in number; of two as near, the first."""
    from scipy.spatial import cKDTree

    tree = cKDTree(places[: agents[-1] + 1])
    edges: Edges = set()
    asked = 4 * wanted + 4  # along the spiral, about half of those that are near come before
    while agents.size:
        asked = min(asked, tree.n)
        reach, near = tree.query(places[agents], k=asked)
        distance = ((places[near] - places[agents][:, None]) ** 2).sum(axis=2)
        distance[near >= agents[:, None]] = np.inf
        order = np.lexsort((near, distance), axis=1)[:, :wanted]
        near, distance = np.take_along_axis(near, order, axis=1), np.take_along_axis(distance, order, axis=1)
        # A neighbour that was not returned is no nearer than `reach`, up to rounding.
        certain = (asked == tree.n) | (distance < ((1.0 - 1e-9) * reach[:, -1:]) ** 2).all(axis=1)
        found = np.isfinite(distance) & certain[:, None]
        edges |= _ordered(zip(near[found], np.broadcast_to(agents[:, None], near.shape)[found], strict=True))
        agents, asked = agents[~certain], 2 * asked
    return edges


def _ring(places: Array, swarm: Swarm, rng: np.random.Generator) -> Edges:
    """One after the other, in the order of their bearing."""
    return _cycle(np.argsort(np.arctan2(places[:, 1], places[:, 0]), kind="stable"))


def _random_geometric(places: Array, swarm: Swarm, rng: np.random.Generator) -> Edges:
    """Agents within a distance of one another, after each has been moved at random by up to its spacing."""
    from scipy.spatial import cKDTree

    moved = places + rng.uniform(-swarm.spacing, swarm.spacing, places.shape)
    reach = swarm.spacing * np.sqrt((swarm.degree + 1) / np.pi)  # radius of a disc that holds degree + 1 places
    return _connected(_ordered(cKDTree(moved).query_pairs(reach)), places)


def _small_world(places: Array, swarm: Swarm, rng: np.random.Generator) -> Edges:
    """A ring with links to the nearest, one in ten of them rewired (Watts and Strogatz, Nature 393, 1998)."""
    size, degree = len(places), min(swarm.degree, len(places) - 1)
    if degree < 2:
        return _nearest(places, swarm, rng)
    import networkx

    graph = networkx.watts_strogatz_graph(size, degree, 0.1, seed=int(rng.integers(2**31)))
    return _connected(_ordered(graph.edges), places)


def _k_regular(places: Array, swarm: Swarm, rng: np.random.Generator) -> Edges:
    """Every agent has the same number of neighbours, drawn at random: anew until all are connected."""
    size, degree = len(places), min(swarm.degree, len(places) - 1)
    if degree < 1:
        return set()
    if size * degree % 2:
        raise InputError(f"swarm.degree: no graph of {size} agents has {degree} links each; take an even number")
    if degree == 2:  # of these, only one cycle is connected, which would hardly ever be drawn
        return _cycle(rng.permutation(size))
    import networkx

    for _ in range(_MOST_DRAWS):
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
    from scipy.spatial import cKDTree

    graph = networkx.Graph()
    graph.add_nodes_from(range(len(places)))
    graph.add_edges_from(edges)
    parts = sorted((sorted(part) for part in networkx.connected_components(graph)), key=len, reverse=True)
    joined = parts[0]
    for part in parts[1:]:
        distance, nearest = cKDTree(places[joined]).query(places[part])
        k = int(np.argmin(distance))
        edges = edges | _ordered([(joined[int(nearest[k])], part[k])])
        joined = joined + part
    return edges
