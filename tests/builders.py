"""Scenarios, vehicles, teams, sheaves, studies and videos that tests share, and plain forms to compare results with."""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import fields, replace
from functools import cache, partial, reduce
from pathlib import Path
from typing import Any, TypeVar
from xml.etree import ElementTree

import jsonschema
import mujoco
import numpy as np
import pytest
import xarray as xr
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel
from scipy.spatial.transform import Rotation
from scipy.stats import ortho_group

from mjsheaf import Sheaf
from mjsheaf.files import dump_yaml
from mjsheaf.media.flow import Channel, FlowField, Source, Vortex
from mjsheaf.scenario import Scenario, list_scenarios, load_scenario, scenario_from_mapping
from mjsheaf.show.played import Poses, Stage
from mjsheaf.studies.plan import Plan, load_plan
from mjsheaf.studies.workers import Workers, local_workers
from mjsheaf.team import Edge, Member, Team, anchor, restriction_maps
from mjsheaf.vehicles.loading import list_vehicles
from mjsheaf.video.film import Film
from tests.oracles.flow import flow_jacobian as flow_jacobian

Array = NDArray[np.float64]
Pair = tuple[str, str]
Simulated = Callable[..., xr.Dataset]
Edit = Callable[[ElementTree.Element], None]
T = TypeVar("T")
Part = tuple[str, str]
"""Path of an element of an MJCF, '' for its root, and the text of an element that is added to it."""

REPOSITORY = Path(__file__).resolve().parents[1]
DATA = REPOSITORY / "tests" / "data"
FACTS = json.loads((DATA / "paper_facts.json").read_text())
"""Numbers that were published, or measured before mjsheaf was written, with their sources."""

RAFT = DATA / "raft.yaml"
"""A user's vehicle."""

POWERED = [name for name in list_vehicles() if name != "buoy"]
"""Vehicles with thrusters that come with mjsheaf."""

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
"""A mesh, as the text of an .obj file."""

# -- scenarios ---------------------------------------------------------------------------------------------------------


FLOW = {
    "dimension": 3,
    "core": 0.5,
    "drift": [0.2, 0.05, -0.1],
    "sources": [{"centre": [1, 0, 0], "alpha": 1.0}],
    "vortices": [{"centre": [0, 1, 0], "axis": [0, 0, 1], "gamma": 0.8}],
}

OBSTACLES: list[dict[str, Any]] = [
    {"id": "pole", "kind": "capsule", "ends": [[0.0, -1.0, 3.0], [1.0, 1.0, 7.0]], "radius": 0.5},
    {"id": "crate", "kind": "box", "centre": [4.0, 4.0, 5.0], "sides": [1.0, 3.0, 2.0], "heading": 30.0},
    {"id": "ball", "kind": "sphere", "centre": [-5.0, 2.0, 5.0], "radius": 1.0, "motion": {"kind": "waypoints",
     "points": [[5.0, 2.0, 5.0]], "speed": 0.4}},
]  # fmt: skip
"""Bodies about the aircraft of `swap`, of which the last one moves."""


@cache
def validator_of(kind: type[BaseModel]) -> Any:
    """Return the jsonschema validator of a model, whose schema is checked once."""
    schema = kind.model_json_schema()
    validator = jsonschema.validators.validator_for(schema)
    validator.check_schema(schema)
    return validator(schema)


@cache
def shipped() -> dict[str, Scenario]:
    """Return the scenarios that ship, as their files have them; to read them takes a second."""
    return {name: load_scenario(name) for name in list_scenarios()}


def make_scenario(fields: dict[str, Any]) -> Scenario:
    """A scenario from a mapping, checked as a file would be."""
    return scenario_from_mapping({"name": "test", **fields})


def list_members(places: Mapping[str, Any], **fields: Any) -> list[dict[str, Any]]:
    """Return agents or targets of a file from positions, or fields, by id; `fields` are those of every one."""
    given = {id: at if isinstance(at, dict) else {"position": at} for id, at in places.items()}
    return [{"id": id, **fields, **own} for id, own in given.items()]


def make_fields(
    agents: Mapping[str, Any], targets: Mapping[str, Any], sensing: Sequence[Any], /, **fields: Any
) -> dict[str, Any]:
    """Return a scenario as a file gives it, of members as for `list_members`; fields replace fields."""
    members = {"agents": list_members(agents), "targets": list_members(targets)}
    return {"name": "test", **members, "sensing": [*sensing], **fields}


def build_scenario(*members: Any, **fields: Any) -> Scenario:
    """Return the scenario of `make_fields`."""
    return make_scenario(make_fields(*members, **fields))


def team_of(agents: dict[str, Any], targets: dict[str, Any], pairs: str = "", **fields: Any) -> dict[str, Any]:
    """Fields of a scenario: places by id, and pairs "A1 A2, A1 T1" of agents that talk and of what an agent senses."""
    edges = [pair.split() for pair in pairs.split(",") if pair]
    return {
        "agents": list_members(agents),
        "targets": list_members(targets),
        "communication": [edge for edge in edges if edge[1] in agents],
        "sensing": [edge for edge in edges if edge[1] in targets],
        **fields,
    }


def pursuit(position: Sequence[float], goal: Sequence[float], /, agent: Any = (), **fields: Any) -> Scenario:
    """An agent A at a position that senses a target T at another; `agent` has more fields of it."""
    return build_scenario({"A": {"position": list(position), **dict(agent)}}, {"T": list(goal)}, [["A", "T"]], **fields)


def mixed_scenario(**fields: Any) -> Scenario:
    """A boat and two aircraft that track a diver and a boat, in a flow, with a formation; fields replace fields."""
    agents = {
        "boat": {"position": [-2, 1], "heading": 30},
        "front": {"position": [3, 1, 2], "heading": -60},
        "back": {"position": [0, -3, 5], "heading": 120},
    }
    pair = {"name": "pair", "shape": "line", "members": ["front", "back"], "about": "diver", "spacing": 3.0}
    usual: dict[str, Any] = {
        "time": {"end": 1.0},
        "controller": {"gain": 3.0, "control_period": 0.01},
        "communication": [["boat", "front"], ["front", "back"]],
        "target_edges": [["diver", "ship"]],
        "target_motion": None,
        "target_formation": {"gain": 0.3},
        "formations": [pair],
        "flow": {"agents": FLOW, "targets": FLOW},
    }
    return build_scenario(
        agents,
        {"diver": {"position": [1, 1, -2], "heading": 10}, "ship": {"position": [-3, 2], "heading": 45}},
        [["boat", "ship"], ["front", "diver"], {"between": ["back", "diver"], "map": "local_frame"}],
        **usual | fields,
    )


def two_boats(agents: str, targets: str, /, **fields: Any) -> Scenario:
    """Two boats in a line behind a third that moves; fields replace fields."""
    team = {"A1": {"position": [-4, 1], "heading": 20}, "A2": [-3, -2]}
    return _two_behind(team, [0, 0], {"agents": agents, "targets": targets}, 0.005, fields)


def two_aircraft(vehicle: str, /, **fields: Any) -> Scenario:
    """Two aircraft about a third that moves; fields replace fields."""
    team = {"A1": [-4, 1, 5], "A2": [-3, -2, 6]}
    return _two_behind(team, [0, 0, 5], {"agents": vehicle, "targets": "aerial"}, 0.002, fields)


def _two_behind(
    team: dict[str, Any], target: list[float], vehicles: dict[str, str], timestep: float, fields: dict[str, Any]
) -> Scenario:
    n = len(target)
    motion = {"amplitude": [2, 2, 0.5][:n], "rate": [0.3] * n, "phase": [1.57, 0, 0][:n]}
    usual: dict[str, Any] = {
        "time": {"end": 3.0},
        "controller": {"gain": 1.0, "control_period": 0.02},
        "communication": [["A1", "A2"]],
        "formations": [{"name": "line", "shape": "line", "members": ["A1", "A2"], "about": "T1", "spacing": 3}],
        "vehicles": vehicles,
        "physics": {"timestep": timestep},
    }
    led = {"T1": {"position": target, "motion": {"kind": "lissajous", **motion}}}
    return build_scenario(team, led, [["A1", "T1"], ["A2", "T1"]], **usual | fields)


def boat_and_drone(end: float = 3.0, /, **fields: Any) -> Scenario:
    """A boat and a drone after a drone; fields replace fields."""
    usual: dict[str, Any] = {"name": "boat_and_drone", "time": {"end": end}, "communication": [["A", "B"]]}
    return build_scenario({"A": [0, 0], "B": [3, 0, 2]}, {"T": [5, 1, 2]}, [["A", "T"], ["B", "T"]], **usual | fields)


def continued(scenario: Scenario, run: xr.Dataset, sample: int, **fields: Any) -> Scenario:
    """The scenario without events that begins where a run of it is at a sample; fields replace fields."""
    raw = scenario.model_dump(mode="json", exclude_none=True) | {"events": []} | fields
    raw["time"] = {**raw["time"], "start": round(float(run["time"][sample]), 9)}
    for kind in ("agent", "target"):
        places = run[f"{kind}_position"].isel(time=sample)
        raw[f"{kind}s"] = [
            {**one, "position": places.sel({kind: one["id"]}).values[: len(one["position"])].tolist()}
            for one in raw[f"{kind}s"]
        ]
    return scenario_from_mapping(raw)


ONE_BOAT = team_of({"A1": [0, 0]}, {"T1": [5, 5]}, "A1 T1", time={"end": 0.2}, controller={"control_period": 0.05})
ONE_BOAT |= {"physics": {"timestep": 0.005}}


QUADROTOR_PAIR = make_fields(
    {id: {"position": [0, y, 10], "vehicle": "quadrotor"} for id, y in (("Q1", 0), ("Q2", 5))},
    {"T": {"position": [3, 0, 12], "motion": {"kind": "static"}}},
    [["Q1", "T"], ["Q2", "T"]],
    name="ring",
    time={"end": 60},
    controller={"gain": 4.0},
    communication=[["Q1", "Q2"]],
)


def random_scenario(seed: int) -> dict[str, Any]:
    """A random team: mixed dimensions, random graph and maps, weights, offsets, smooth flow, disturbances."""
    rng = np.random.default_rng(seed)
    N, M = int(rng.integers(1, 7)), int(rng.integers(1, 4))
    agents = [f"A{i}" for i in range(N)]
    targets = [f"T{k}" for k in range(M)]
    dimension = {name: int(rng.integers(2, 4)) for name in agents + targets}

    def edge(tail: str, head: str) -> dict[str, Any]:
        e: dict[str, Any] = {"between": [tail, head], "weight": float(rng.uniform(0.5, 2.0))}
        kind = rng.choice(["shared", "local_frame", "random"])
        if kind == "random":  # near a rotation of the shared coordinates, so that no agent is nearly free
            m = min(dimension[tail], dimension[head])
            turn = np.linalg.qr(rng.standard_normal((m, m)))[0]
            F = [turn @ (np.eye(m, dimension[v]) + 0.2 * rng.standard_normal((m, dimension[v]))) for v in (tail, head)]
            e["map"] = {"tail": F[0].tolist(), "head": F[1].tolist()}
            e["offset"] = rng.uniform(-2, 2, m).tolist()
        else:
            e["map"] = str(kind)
        return e

    tree = [edge(agents[i], agents[int(rng.integers(i))]) for i in range(1, N)]
    more = [edge(a, b) for a in agents for b in agents if a < b and rng.random() < 0.3]
    sensing = [edge(agents[int(rng.integers(N))], t) for t in targets]
    sensing += [edge(a, t) for a in agents for t in targets if rng.random() < 0.5]

    def motion(n: int) -> dict[str, Any]:
        if rng.random() < 0.3:
            points = rng.uniform(-6, 6, (3, n)).tolist()
            return {"kind": "waypoints", "points": points, "speed": 4.0, "closed": bool(rng.random() < 0.5)}
        return {
            "kind": "lissajous",
            "amplitude": rng.uniform(0, 2, n).tolist(),
            "rate": rng.uniform(0.1, 6.0, n).tolist(),
            "phase": rng.uniform(0, 6, n).tolist(),
        }

    field = int(rng.integers(2, 4))

    def kernels(most: int) -> list[dict[str, Any]]:
        return [{"centre": rng.uniform(-6, 6, field).tolist()} for _ in range(int(rng.integers(0, most + 1)))]

    def axis() -> dict[str, Any]:
        return {"axis": rng.standard_normal(3).tolist()} if field == 3 else {}

    shape = {"beta": 0.5, "width": 4.0, "length": 8.0}
    flow = {
        "dimension": field,
        "core": float(rng.uniform(2, 5)),
        "drift": rng.uniform(-0.4, 0.4, field).tolist(),
        "sources": [{**k, "alpha": float(rng.uniform(-2, 2))} for k in kernels(2)],
        "vortices": [{**k, "gamma": float(rng.uniform(-2, 2)), **axis()} for k in kernels(2)],
        "channels": [{**k, "direction": rng.standard_normal(field).tolist(), **shape} for k in kernels(1)],
    }

    def place(name: str) -> dict[str, Any]:
        return {"id": name, "position": rng.uniform(-5, 5, dimension[name]).tolist()}

    def frame() -> dict[str, float]:
        return {"roll": 10.0, "pitch": -20.0, "yaw": float(rng.uniform(-180, 180))}

    return {
        "name": f"random{seed}",
        "seed": seed,
        "agents": [{**place(a), "frame": frame()} for a in agents],
        "targets": [{**place(t), "motion": motion(dimension[t])} for t in targets],
        "communication": tree + more,
        "sensing": sensing,
        # A planar target leaves spatial agents free along z: anchor every spatial agent.
        "anchors": [{"agent": a, "axes": ["z"], "value": [1.0]} for a in agents if dimension[a] == 3],
        "target_edges": [edge(a, b) for a in targets for b in targets if a < b],
        "target_formation": {"gain": float(rng.uniform(0.05, 1.0))},
        "flow": {"agents": flow, "targets": flow},
        "disturbance": {
            who: {"bound": float(rng.uniform(0, 0.4)), "frequencies": [0.05, 2.0]} for who in ("agents", "targets")
        },
        # Recorded finely or coarsely: the constants must not depend on it.
        "controller": {"gain": 1.0, "control_period": 0, "record_period": float(rng.choice([0.02, 0.1, 0.3]))},
        "time": {"end": 3.0},
    }


def positions_of(data: xr.Dataset) -> Array:
    """Positions of a run's agents, then its targets, padded with zeros, shape (T, V, 3), m."""
    return np.nan_to_num(np.concatenate([data["agent_position"].values, data["target_position"].values], axis=1))


# -- vehicles ----------------------------------------------------------------------------------------------------------


REAL = ("hexarotor", "quadrotor", "x500", "wamv", "otter")
MULTIROTORS, BOATS = REAL[:3], REAL[3:]
LAG = {"hexarotor": 0.05, "quadrotor": 0.025, "x500": 0.071, "wamv": 0.2, "otter": 0.1}  # s, from reference and MJCF


def find(root: ElementTree.Element, path: str) -> ElementTree.Element:
    """The one element at a path."""
    element = root.find(path)
    assert element is not None, path
    return element


def xml_of(name: str) -> ElementTree.Element:
    """The MJCF of a vehicle in models/."""
    return ElementTree.parse(list_vehicles()[name].with_suffix(".xml")).getroot()


def adding(*parts: Part, **compiler: str) -> Edit:
    """An edit that adds elements to others, and sets attributes of <compiler>."""

    def edit(root: ElementTree.Element) -> None:
        if compiler:
            find(root, "compiler").attrib.update(compiler)
        for path, text in parts:
            (find(root, path) if path else root).append(ElementTree.fromstring(text))

    return edit


def setting(path: str, **attributes: str) -> Edit:
    """An edit that sets attributes of the first element at a path."""
    return lambda root: find(root, path).attrib.update(attributes)


def altered(folder: Path, name: str, edit: Edit | None = None, **description: Any) -> str:
    """Write a copy of a vehicle with its MJCF edited and fields of its description replaced; give its path."""
    folder.mkdir(parents=True, exist_ok=True)
    root = xml_of(name)
    if edit is not None:
        edit(root)
    (folder / f"{name}.xml").write_text(ElementTree.tostring(root, encoding="unicode"))
    fields = yaml.safe_load(list_vehicles()[name].read_text())
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in {**fields, **description}.items() if v is not None}))
    return str(path)


def attitudes(count: int, seed: int = 0) -> Array:
    """Random attitudes, body to world, shape (count, 3, 3)."""
    return Rotation.random(count, random_state=seed).as_matrix()


def yaws(count: int, seed: int = 0) -> Array:
    """Random level attitudes, body to world, shape (count, 3, 3)."""
    angles = np.random.default_rng(seed).uniform(-4, 4, count)
    return Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])).as_matrix()


# -- teams: B floats in the plane, U flies in space; S is a target in the plane, V one in space ------------------------


def make_member(name: str) -> Member:
    return Member(name, 3 if name[0] in "UV" else 2)


def make_edge(tail: str, head: str, *, name: str = "shared", weight: float = 1.0, **attitude: Any) -> Edge:
    maps = restriction_maps(name, make_member(tail).dimension, make_member(head).dimension, **attitude)
    return Edge(tail, head, *maps, weight * np.eye(len(maps[0])))


def hold(agent: str, axes: str, weight: float = 1.0) -> Edge:
    """An anchor of some coordinates at zero."""
    F = np.eye(make_member(agent).dimension)[["xyz".index(a) for a in axes]]
    return anchor(agent, F, np.zeros(len(F)), weight * np.eye(len(F)))


def make_team(
    agents: str, targets: str, links: Sequence[Edge | Pair], seen: Sequence[Edge | Pair], anchors: Sequence[Edge] = ()
) -> Team:
    """A team of members named in a string; edges as pairs have 'shared' maps."""
    communication, sensing = ([e if isinstance(e, Edge) else make_edge(*e) for e in kind] for kind in (links, seen))
    return Team(
        [make_member(v) for v in agents.split()],
        [make_member(v) for v in targets.split()],
        communication,
        sensing,
        anchors=anchors,
    )


def turn(angle: float) -> Array:
    """Rotation in the plane by an angle in rad."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


# -- sheaves -----------------------------------------------------------------------------------------------------------


def bundle_on_a_grid(side: int, seed: int = 0, twist: int | None = None, k: int = 3) -> tuple[Sheaf, np.ndarray]:
    """A flat bundle on a square grid with its frames; `twist`: one edge is turned by another rotation."""
    rng = np.random.default_rng(seed)
    frames = ortho_group.rvs(k, size=side * side, random_state=rng).reshape(-1, k, k)
    number = np.arange(side * side).reshape(side, side)
    tails = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    heads = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    F_heads = frames[heads]
    if twist is not None:
        F_heads[twist] = ortho_group.rvs(k, random_state=rng) @ F_heads[twist]
    sheaf = Sheaf(dict.fromkeys(range(side * side), k))
    sheaf.add_edges(tails.tolist(), heads.tolist(), frames[tails], F_heads)
    return sheaf, frames


# -- studies -----------------------------------------------------------------------------------------------------------


IN_THREADS: Callable[[], AbstractContextManager[Workers]] = partial(local_workers, 1, processes=False)


def small_plan(gains: tuple[float, ...] = (1.0, 3.0), seeds: tuple[int, int] | None = (0, 2), **fields: Any) -> Plan:
    """Runs of half a second of one boat."""
    overrides = {"time.end": 0.5, **fields.pop("overrides", {})}
    return load_plan(
        "midpoint", grid={"controller.gain": gains}, seeds=seeds, overrides=overrides, backend="ideal", **fields
    )


# -- laws in Python ---------------------------------------------------------------------------------------------------


LAWS = '''
class Same:
    """-k1 eta, the paper's law at gain 1."""

    def __call__(self, t, sample):
        return -1.0 * sample.disagreement


class Stateful:
    """A law whose gain grows by one with each call: a second run must begin anew."""

    def __init__(self):
        self.calls = 0

    def __call__(self, t, sample):
        self.calls += 1
        return -0.01 * self.calls * sample.disagreement


def wild(t, sample):
    return (-1.0) ** round(t / 0.02) * (5.0 + 0.0 * sample.disagreement)


def broken(t, sample):
    raise ValueError("no such luck")
'''
"""A file of laws: the paper's, one with a state, and two that fail in their way."""


# -- videos ------------------------------------------------------------------------------------------------------------


def make_model() -> mujoco.MjModel:
    """Five free bodies, each a box with a ball on a hinge, over a translucent plane."""
    bodies = "".join(
        f"""
        <body name="vehicle{number}"><freejoint/>
          <geom name="box{number}" type="box" size="1 .5 .3" rgba="{number % 2} .5 .2 1"/>
          <body pos="2 0 0"><joint type="hinge"/><geom name="ball{number}" size=".2" pos=".5 0 0"/></body>
        </body>"""
        for number in range(5)
    )
    return mujoco.MjModel.from_xml_string(
        f"""
        <mujoco>
          <asset><texture type="skybox" builtin="gradient" rgb1=".7 .8 .9" rgb2=".1 .1 .2" width="32" height="192"/></asset>
          <worldbody>
            <light directional="true" dir="0 0 -1"/>
            <geom name="water" type="plane" size="0 0 1" rgba=".1 .4 .6 .5"/>{bodies}
          </worldbody>
        </mujoco>"""  # noqa: E501
    )


def make_run(duration: float = 2.0, samples: int = 41) -> Poses:
    """Agents circle on the water, targets 10 m below them."""
    time = np.linspace(0.0, duration, samples)
    vehicles = 5
    phase = time[:, None] + 2 * np.pi * np.arange(vehicles) / vehicles
    positions = np.stack([20 * np.cos(phase), 20 * np.sin(phase), np.zeros_like(phase)], axis=-1)
    positions[:, 3:, 2] = -10
    quaternions = np.stack([np.cos(phase / 2), 0 * phase, 0 * phase, np.sin(phase / 2)], axis=-1)
    return Poses(time, positions, quaternions, positions[:, :3] + [3.0, 0.0, 0.0], 10.0 * np.exp(-time))


def make_film(model: mujoco.MjModel, duration: float = 2.0, samples: int = 41, **changes: Any) -> Film:
    """Make the video content of that run; `changes` replaces fields of it, and of its samples."""
    bodies = np.array([model.body(f"vehicle{number}").id for number in range(5)])
    film = Film(
        name="small",
        subtitle="made up",
        run=make_run(duration, samples),
        agent_ids=["A1", "A2", "A3"],
        target_ids=["T1", "T2"],
        qpos_address=model.jnt_qposadr[model.body_jntadr[bodies]],
        body_id=bodies,
        group=np.array([0, 0, 1, 2, 2]),
        group_names=["pair", "single", "targets"],
        colours=np.array([[0.2, 0.6, 1.0], [1.0, 0.6, 0.2], [1.0, 0.3, 0.3]]),
        radii=np.full(5, 2.7),
        scales=np.ones(5),
        stages=[Stage(0.0, [(0, 1, "communication"), (1, 2, "communication"), (0, 3, "sensing"), (2, 4, "sensing")])],
        surface="water",
    )
    return change_film(film, **changes)


def samples_of(film: Film) -> Poses:
    """Return the run of a video content, which is in memory."""
    assert isinstance(film.run, Poses)
    return film.run


def change_film(film: Film, **changes: Any) -> Film:
    """Return video content with some fields of it, or of its samples, replaced; `edges` hold all the time."""
    if "edges" in changes:
        changes["stages"] = [Stage(0.0, changes.pop("edges"))]
    of_samples = {field.name: changes.pop(field.name) for field in fields(Poses) if field.name in changes}
    return replace(film, run=replace(samples_of(film), **of_samples), **changes)


def bits(result: object) -> dict[str, bytes]:
    """The bytes of each variable of a dataset."""
    assert isinstance(result, xr.Dataset)
    return {str(name): np.ascontiguousarray(result[name]).tobytes() for name in result.data_vars}


def dump_scenario(scenario: Scenario) -> str:
    """Return the resolved scenario as YAML; custom vehicles keep their paths."""
    return dump_yaml(scenario.model_dump(mode="json", exclude_none=True))


# -- errors and numbers ----------------------------------------------------------------------------------------------


@contextmanager
def refused(error: type[Exception], *named: object) -> Iterator[pytest.ExceptionInfo[Exception]]:
    """Expect an error whose message names all of these: the field, what was given, what fits. The words are free."""
    with pytest.raises(error) as caught:
        yield caught
    assert names(str(caught.value), *named), f"{str(caught.value)!r} does not name all of {named}"


def names(text: str, *named: object) -> bool:
    """Return True if a text contains all of these as whole words or numbers."""
    return all(re.search(rf"(?<!\w){re.escape(str(each))}(?!\w)", text) for each in named)


def pick(record: Any, *paths: str) -> dict[str, Any]:
    """Return what is in the fields of a record, as 'law.radius', by path."""
    return {path: reduce(lambda part, name: part[name], path.split("."), record) for path in paths}


def require(record: Any, fields: Mapping[str, Any]) -> None:
    """Fail unless a record has these fields, as 'law.radius', by path."""
    found = pick(record, *fields)
    assert found == fields, f"{found} in place of {fields}"


def known(value: T | None) -> T:
    """Return what must be there."""
    assert value is not None
    return value


def approx(value: float | None, rel: float | None = None, abs: float | None = None) -> Any:
    """As pytest's, of what must be there."""
    return pytest.approx(known(value), rel=rel, abs=abs)


def field_of(
    n: Any, core: float | None = None, drift: Any = None, sources: Any = (), vortices: Any = (), channels: Any = ()
) -> FlowField:
    """A field in n dimensions from rows: (centre, alpha); (centre, axis in space, gamma); (centre, direction, ...)."""
    return FlowField(
        dimension=n,
        core=core,
        drift=drift,
        sources=[Source(centre=row[:n], alpha=row[n]) for row in sources],
        vortices=[Vortex(centre=row[:n], axis=list(row[n:-1]) or None, gamma=row[-1]) for row in vortices],
        channels=[
            Channel(centre=row[:n], direction=row[n:-3], beta=row[-3], width=row[-2], length=row[-1])
            for row in channels
        ],
    )


def of_facts(facts: dict[str, Any]) -> FlowField:
    """A field of the published run."""
    channels = [[*centre, *direction, *rest] for centre, direction, *rest in facts["gaussian_channels"]]
    return field_of(facts["dimension"], facts["core"], facts["drift"], facts["sources"], facts["vortices"], channels)
