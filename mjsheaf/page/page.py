"""The page of a run: its samples, thinned evenly, rounded and packed, its other data, and the file.

Between two kept samples the page interpolates linearly. The error of this and of rounding is measured over every sample
of the run, and stated in the page.

Places are relative to an origin near the run, a whole number of kilometres each way, so that those of a team far from
zero keep their digits; `record["origin"]` has it.

An array is packed as integers: positions in steps of 1/20000 of the scene, attitudes in 2^-13, everything else as
32-bit floats with the mantissa rounded to 12 bits (a relative error below 2^-12). Differences along time, with
their sign in the lowest bit, byte plane by byte plane, then compress well; the browser undoes it (web/src/data.js).
"""

import base64
import hashlib
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.resources import files
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic_core import to_json

from mjsheaf._version import __version__
from mjsheaf.arrays import Array
from mjsheaf.checking.theorem.of_run import HeldBound, RunBound
from mjsheaf.law.obstacles import HALF_SPACE
from mjsheaf.loop.system import Phase, System
from mjsheaf.results.metrics import MEASURES, engine_of, phases_in
from mjsheaf.results.store import at_rows, thin
from mjsheaf.scenario import Scenario
from mjsheaf.section import LARGEST
from mjsheaf.show.played import (
    Played,
    Poses,
    RecordedRun,
    Region,
    edges_of,
    goals_in,
    has_bodies,
    joined,
    kept_from,
    played,
    positions_in,
    residuals_in,
)
from mjsheaf.show.solids import obstacle_places, obstacle_solids, quaternion_of, shapes_of
from mjsheaf.show.style import OBSTACLE, list_scales

Bounds = Sequence[tuple[RunBound, HeldBound]]

_BODIES = {None: "ideal kinematics", "mujoco": "MuJoCo bodies", "fused": "bodies moved by the fused engine"}

_FEWEST, _MOST = 400, 3000  # minimum and maximum number of samples
_ORIGINS = 1000.0  # spacing of possible origins, m
_SHOWN = (
    *("disagreement", "tracking_error", "velocity_command", "agent_flow", "harmonic_extension"),
    *("formation_error", "centering_error", "group_formation_error", "group_centering_error"),
    *("agent_saturation", "heard", "safety_correction", "safety_cause"),
    *(f"{kind}_{quantity}" for quantity in ("position", "height", "orientation") for kind in ("agent", "target")),
)
_QUATERNION_STEP = 2.0**-13
_DROPPED_BITS = 11  # number of dropped bits of a float's mantissa


# -- samples -----------------------------------------------------------------------------------------------------------


@dataclass
class Packer:
    """Arrays over time, packed one after the other.

    Attributes:
        index: Shape (samples, columns) of each array, offset of its unpacked bytes, and step of its integers. A step
            of 0 means that they are the bits of floats.
    """

    index: dict[str, dict[str, Any]] = field(default_factory=dict)
    _planes: list[bytes] = field(default_factory=list)

    def add_fixed(self, name: str, values: Array, step: float) -> Array:
        """Add values rounded to multiples of a step, shape (K, ...); returns them as the page has them."""
        known = np.isfinite(values)
        with np.errstate(invalid="ignore"):
            whole = np.rint(np.clip(np.where(known, values, 0.0) / step, -(2.0**30), 2.0**30)).astype(np.int32)
        self._add(name, np.where(known, whole, np.iinfo(np.int32).min).astype(np.int32), step)
        return np.where(known, whole * step, np.nan)

    def add_float(self, name: str, values: Array) -> None:
        """Add values with a relative error of at most 2^-12, shape (K, ...)."""
        with np.errstate(over="ignore"):
            bits = np.ascontiguousarray(values, np.float32).view(np.int32)
        half = 1 << (_DROPPED_BITS - 1)
        finite = np.isfinite(values)
        self._add(name, np.where(finite, (bits + half) & -(1 << _DROPPED_BITS), bits).astype(np.int32), 0.0)

    def _add(self, name: str, whole: NDArray[np.int32], step: float) -> None:
        columns = whole.reshape(len(whole), -1)
        self.index[name] = {"shape": columns.shape, "at": sum(map(len, self._planes)), "step": step}
        change = np.diff(columns, axis=0, prepend=np.int32(0))  # modulo 2^32, as the browser adds them
        signed = np.ascontiguousarray(((change << 1) ^ (change >> 31)).T, "<i4")
        self._planes.append(signed.view(np.uint8).reshape(-1, 4).T.tobytes())

    def packed(self) -> str:
        """Everything, compressed, in base64."""
        return base64.b64encode(zlib.compress(b"".join(self._planes), 4)).decode("ascii")


@dataclass(frozen=True)
class Ghost:
    """Another run, whose agents are drawn translucent; the counterpart in the browser is web/src/ghosts.js.

    Attributes:
        name: Name of the run.
        colour: Colour of its agents and curves, #rrggbb; None for those of their groups.
        dataset: Its data, in memory or opened.
        surface_height: z of the surface on which planar vehicles lie where they have no height, m.
        twin: True if the page shows the distance of each agent from its counterpart.
    """

    name: str
    colour: str | None
    dataset: xr.Dataset
    surface_height: float
    twin: bool = False


def pack(
    content: Played,
    dataset: xr.Dataset,
    phases: Sequence[Phase],
    bounds: dict[str, Array],
    ghosts: Sequence[Ghost] = (),
    ahead: Array | None = None,
) -> tuple[dict[str, Any], str]:
    """Pack a run.

    Args:
        content: The run as it is drawn.
        dataset: Its data, in memory or opened.
        phases: Phases of the run.
        bounds: Bounds by name, on the team's RMS tracking error at every sample of the run, shape (T,), m.
        ghosts: Other runs, drawn translucent.
        ahead: Points that a run in progress is expected to reach, shape (K, 3), m; None for a finished run.

    Returns:
        Data for the page: times, names, arrays, scene and errors; and the packed arrays of its field `arrays`.
    """
    origin = origin_of(dataset)
    T = dataset.sizes["time"]
    run = RecordedRun(dataset, content.surface_height)
    # At most half a million positions, unless the fewest samples have more.
    most = int(np.clip(500_000 // content.vehicles, _FEWEST, _MOST))
    events = [row for phase in phases[1:] for row in (phase.start - 1, phase.start) if 0 <= row < T]
    rows = np.unique(np.array([*thin(T, most), *events]))
    own = at_rows(dataset[[name for name in _SHOWN if name in dataset]], rows)
    time = own["time"].values
    packer = Packer()
    positions = positions_in(own, content.surface_height) - origin
    seen = positions.copy()
    seen[:, : content.agents][np.isnan(own["tracking_error"].values)] = np.nan  # absent agents
    scene = Region.of(seen)
    if ahead is not None:
        scene = Region.of(np.concatenate([positions[0], ahead - origin]))
    elif dataset.attrs["status"] != "finished":  # vehicles that blew up leave the picture
        began = Region.of(positions[0])
        scene = Region(began.centre, min(scene.size, 4.0 * began.size))
    shown = scene.step * np.rint(scene.confined(positions) / scene.step)
    described = add_samples(packer, dataset, own, content.surface_height, phases, scene, origin)
    for k, values in enumerate(bounds.values()):
        packer.add_float(f"bound{k}", np.where(np.abs(values) < 1e30, values, np.nan)[rows])
    record: dict[str, Any] = {
        "time": [round(t, 9) for t in time.tolist()],
        "samples": int(T),
        "origin": origin.tolist(),
        "centre": scene.centre.tolist(),
        "size": scene.size,
        **described,
        "bounds": list(bounds),
        "largest_error": _largest_error(run, origin, scene, time, shown),
        "ghosts": add_ghosts(packer, ghosts, content.agent_ids, positions, time, scene, origin),
        "arrays": packer.index,
    }
    return record, packer.packed()


def add_samples(
    packer: Packer,
    dataset: xr.Dataset,
    own: xr.Dataset,
    surface_height: float,
    phases: Sequence[Phase],
    scene: Region,
    origin: Array,
) -> dict[str, Any]:
    """Add everything that the page shows of some samples of the run.

    Args:
        packer: Destination.
        dataset: The run, or a piece of it that contains the samples.
        own: The samples.
        surface_height: z of the surface, m.
        phases: Phases of the run.
        scene: Place of the run from the origin.
        origin: Origin of the page's places, shape (3,), m.

    Returns:
        Descriptions of the `edges` and `obstacles`.
    """
    positions = positions_in(own, surface_height)
    packer.add_fixed("position", scene.confined(positions - origin), scene.step)
    packer.add_fixed("q_star", scene.confined(goals_in(own, positions) - origin), scene.step)
    if has_bodies(dataset):
        attitudes = joined(own, "orientation")
    else:  # headings along the velocity
        attitudes = RecordedRun(dataset, surface_height).at(own["time"].values).quaternions
    packer.add_fixed("quaternion", _continuous(attitudes), _QUATERNION_STEP)
    packer.add_float("disagreement", own["disagreement"].values)
    packer.add_float("tracking_error", own["tracking_error"].values)
    packer.add_float("speed", np.linalg.norm(np.nan_to_num(own["velocity_command"].values), axis=2))
    packer.add_fixed("flow", np.nan_to_num(own["agent_flow"].values), 0.01)
    for name in ("formation_error", "centering_error", "group_formation_error", "group_centering_error"):
        if name in own:
            packer.add_float(name, own[name].values)
    if "agent_saturation" in own:
        packer.add_fixed("saturation", own["agent_saturation"].values, 2.0**-7)
    return {
        "edges": _add_edges(packer, phases, positions, own),
        "obstacles": _add_safety(packer, phases, positions, own, scene, origin),
    }


def origin_of(dataset: xr.Dataset) -> Array:
    """A place near where a run begins, shape (3,), m: see the module."""
    first = np.nan_to_num(joined(dataset.isel(time=[0]), "position")[0])
    first = first[np.abs(first).max(axis=1) < 1e12]  # where 64-bit floats resolve a tenth of a millimetre
    return _ORIGINS * np.round(np.median(first, axis=0) / _ORIGINS) if len(first) else np.zeros(3)


def _continuous(quaternions: Array) -> Array:
    """Choose the sign of each attitude (K, V, 4) that is nearer to the previous one."""
    known = np.where(np.isfinite(quaternions), quaternions, [1.0, 0.0, 0.0, 0.0])
    turns = np.sign((known[1:] * known[:-1]).sum(axis=-1))
    signs = np.cumprod(np.where(turns < 0.0, -1.0, 1.0), axis=0)
    return np.asarray(known * np.concatenate([np.ones((1, known.shape[1])), signs])[..., None])


def _largest_error(run: RecordedRun, origin: Array, scene: Region, time: Array, shown: Array) -> float:
    """Compute the largest distance of a vehicle from its position on the page, m, except for vehicles that blew up."""
    page = Poses(time, shown, shown[:, :0], shown[:, :0], time)  # without attitudes, q* and errors
    largest = 0.0
    for times, positions in run.positions():
        places = positions - origin
        with np.errstate(all="ignore"):
            away = np.linalg.norm(places - page.at(times).positions, axis=2)
            inside = np.abs(places - scene.centre).max(axis=2) < 10.0 * scene.size
        largest = max(largest, float(np.nan_to_num(away[inside]).max(initial=0.0)))
    return largest


def _add_edges(packer: Packer, phases: Sequence[Phase], positions: Array, own: xr.Dataset) -> list[dict[str, Any]]:
    """Add every edge's residual at every kept sample: NaN while it does not exist, negative while nothing is received.

    Returns:
        Description of each edge: ends, kind, name, dimension of its residual, and True if only its tail senses.
    """
    found, index = edges_of(phases), phases[0].system.team.index
    residual = residuals_in(own, phases, positions)
    heard = {name: k for k, name in enumerate(own["measuring_edge"].values.tolist())} if "heard" in own else {}
    for e, key in enumerate(found):
        if " ".join(key) in heard:
            silent = own["heard"].values[:, heard[" ".join(key)]] == 0
            residual[silent, e] = -np.abs(residual[silent, e])
    packer.add_float("residual", residual)
    return [
        {
            "tail": index[edge.tail],
            "head": index[edge.head],
            "kind": kind,
            "name": name,
            "numbers": len(edge.b),
            "directed": edge.directed,
        }
        for (kind, name), edge in found.items()
    ]


def _add_safety(
    packer: Packer, phases: Sequence[Phase], positions: Array, own: xr.Dataset, scene: Region, origin: Array
) -> list[dict[str, Any]]:
    """Add where obstacles are, and what the filter keeps each agent from; return the description of each obstacle."""
    system = phases[0].system
    if system.safety is None or "safety_cause" not in own:
        return []
    # Half the thickness at which the face of a half-space is drawn, in sizes of the scene.
    obstacles, face = system.control.law.safety.obstacles, 0.002 * scene.size
    places = [obstacle_places(obstacles, t, scene.centre + origin, face) - origin for t in own["time"].values]
    packer.add_fixed("obstacle", scene.confined(np.reshape(places, (len(places), -1, 3))), scene.step)
    cause, points = kept_from(own, obstacles, positions)
    packer.add_fixed("cause", cause.astype(np.float64), 1.0)
    packer.add_float("correction", own["safety_correction"].values)
    packer.add_fixed("kept_from", scene.confined(points - origin), scene.step)
    solids = obstacle_solids(obstacles, face, 2.0 * scene.size)  # half the width of that face, in sizes of the scene
    return [
        {
            "id": id,
            "shape": shape,
            "size": size.tolist(),
            "position": [0.0, 0.0, 0.0],
            "quaternion": quaternion_of(axes).tolist(),
            "colour": OBSTACLE,
            "opacity": 0.3 if kind == HALF_SPACE else 1.0,
            "livery": False,
        }
        for id, kind, (shape, size, axes) in zip(system.safety.obstacle_ids, obstacles.kind, solids, strict=True)
    ]


def add_ghosts(
    packer: Packer,
    ghosts: Sequence[Ghost],
    ids: Sequence[str],
    positions: Array,
    time: Array,
    scene: Region,
    origin: Array,
) -> list[dict[str, Any]]:
    """Pack where the agents of other runs are at the samples of a page, and their RMS tracking errors.

    Agents are matched by id. A run has no agents before its start and after its end, nor while they are absent.

    Args:
        packer: Gets the arrays ghost0, ghost_quaternion0 and ghost_error0, and so on; `apart` of a twin.
        ghosts: The other runs.
        ids: Agents of the page's run.
        positions: Positions of its vehicles at the page's samples from the origin, shape (K, V, 3), m.
        time: Samples that the page keeps, shape (K,), s.
        scene: Where the page's run takes place.
        origin: Origin of the page's places, shape (3,), m.

    Returns:
        Name and colour of each, for the page.
    """
    for k, ghost in enumerate(ghosts):
        number = {str(name): i for i, name in enumerate(ghost.dataset["agent"].values)}
        own = [(v, number[name]) for v, name in enumerate(ids) if name in number]
        mine, others = np.array(own, dtype=np.int64).reshape(-1, 2).T
        run = RecordedRun(ghost.dataset, ghost.surface_height)
        samples = run.at(np.clip(time, run.time[0], run.time[-1]))
        inside = (time >= run.time[0] - 1e-9) & (time <= run.time[-1] + 1e-9)
        there = inside[:, None] & np.isfinite(samples.harmonic_extension[:, others, 0])
        places = np.full(positions.shape, np.nan)
        places[:, mine] = np.where(there[..., None], samples.positions[:, others] - origin, np.nan)
        attitudes = np.tile([1.0, 0.0, 0.0, 0.0], (*positions.shape[:2], 1))
        attitudes[:, mine] = samples.quaternions[:, others]
        packer.add_fixed(f"ghost{k}", scene.confined(places), scene.step)
        packer.add_fixed(f"ghost_quaternion{k}", attitudes, _QUATERNION_STEP)
        packer.add_float(f"ghost_error{k}", np.where(inside, samples.error, np.nan)[:, None])
        if ghost.twin:
            packer.add_float("apart", np.linalg.norm((positions - places)[:, : len(ids)], axis=2))
    return [{"name": ghost.name, "colour": ghost.colour} for ghost in ghosts]


# -- the page ----------------------------------------------------------------------------------------------------------


def page_of(
    scenario: Scenario,
    phases: Sequence[Phase],
    dataset: xr.Dataset,
    summary: dict[str, Any],
    bounds: Bounds,
    *,
    notes: Sequence[Any] = (),
    ghosts: Sequence[Ghost] = (),
    again: tuple[str, str] | None = None,
    controls: dict[str, Any] | None = None,
    ahead: Array | None = None,
) -> bytes:
    """Make the page of a run, as HTML.

    Args:
        scenario: what was run.
        phases: Phases of the run.
        dataset: its data, in memory or opened.
        summary: Contents of summary.json, as far as they are known.
        bounds: what they say of each phase of the run: see `of_run.bounds_of_phases`.
        notes: what a reader should know: sentences, or mappings with `text`, and `agent` and `time` where they apply.
        ghosts: Other runs, drawn translucent.
        again: the command that makes the run again, and where; None for that in a run's directory.
        controls: What the page of a run in progress lets its user change, with the `address` of the websocket; see
            `mjsheaf.live`. None for a finished run.
        ahead: Points that vehicles of a run in progress are expected to reach, shape (K, 3), m.
    """
    content = played(scenario, dataset, phases)
    curves = bound_curves(phases, dataset, bounds)
    replay, data = pack(content, dataset, phases, curves, ghosts, ahead)
    theory = [  # of each phase that the run reached
        {
            "time": phase.time,
            "events": list(phase.events),
            "assumptions": [
                {"number": a.number, "name": a.name, "verdict": a.verdict, "why": a.witness}
                for a in theorem.certificate.assumptions
            ],
            "theorem": {"applies": theorem.applies, "approximate": theorem.approximate, "reason": theorem.reason},
            "held": {"applies": of_law.samples is not None, "reason": of_law.reason},
        }
        for phase, (theorem, of_law) in zip(phases, bounds, strict=False)
    ]
    said = {
        **replay,
        **_scene(scenario, content, phases, dataset, replay),
        "facts": _facts(scenario, phases, dataset, summary, again) | {"theory": theory},
        "notes": [note if isinstance(note, dict) else {"text": str(note)} for note in notes],
    }
    connect = ""
    if controls is not None and ahead is not None:
        said["live"] = controls | {"ahead": (ahead - replay["origin"]).round(2).tolist()}
        connect = f"; connect-src {controls['address']}"
    return _fill(said, data, connect)


def _fill(said: dict[str, Any], data: str, connect: str = "") -> bytes:
    """Fill the template of the page; `connect` extends its content security policy."""
    home = files("mjsheaf.page")
    script, style, template = (
        home.joinpath(name).read_text(encoding="utf-8") for name in ("bundle.js", "bundle.css", "page.html")
    )
    parts = {
        "script": script,
        "style": style,
        "script_hash": _hash(script),
        "style_hash": _hash(style),
        # Within a script element only `<` can end the data or hide what follows.
        "said": to_json(said, inf_nan_mode="null", ensure_ascii=True).decode("ascii").replace("<", "\\u003c"),
        "data": data,
        "connect": connect,
    }
    return re.sub(r"\{\{ (\w+) \}\}", lambda match: parts[match[1]], template).encode("utf-8")


def bound_curves(phases: Sequence[Phase], dataset: xr.Dataset, bounds: Bounds) -> dict[str, Array]:
    """Return the bounds on the RMS tracking error by name, shape (T,), m; NaN in phases without one."""
    time, number, grid = dataset["time"].values, dataset["phase"].values, phases[0].system.grid
    found: dict[str, Array] = {}
    for k, (phase, (theorem, of_law)) in enumerate(zip(phases, bounds, strict=False)):
        here = number == k
        own: dict[str, Array] = {}
        if theorem.applies and (bound := theorem.at(time[here])).max(initial=0.0) < LARGEST:
            own["Theorem 1" + " (approximate)" * theorem.approximate] = bound
        if of_law.samples is not None:
            known = grid.span(phase.start, phase.start + len(of_law.samples))
            own["held law"] = np.interp(time[here], known, of_law.samples, right=np.nan)
        for name, values in own.items():
            curve = found.setdefault(name, np.full(len(time), np.nan))
            curve[here] = values / np.sqrt(max(phase.system.team.present.sum(), 1))
    return found


def _scene(
    scenario: Scenario, content: Played, phases: Sequence[Phase], dataset: xr.Dataset, replay: dict[str, Any]
) -> dict[str, Any]:
    """Names, groups, shapes, flow and events; places are relative to the replay's origin."""
    system, bodies, N = phases[0].system, has_bodies(dataset), content.agents
    kinds, kind = shapes_of(system.vehicles)
    agents = system.vehicles[:N] if bodies else []
    able = np.array([vehicle.capability.least_speed for vehicle in agents])
    limits = [np.where(phase.system.team.present, phase.system.law.limit[:N], np.nan).tolist() for phase in phases]
    return {
        "agents": content.agent_ids,
        "targets": content.target_ids,
        "group": content.group.tolist(),
        "groups": [
            {"name": name, "colour": "#" + "".join(f"{round(255 * x):02x}" for x in colour)}
            for name, colour in zip(content.group_names, content.colours.tolist(), strict=True)
        ],
        "formations": [f.name for f in system.team.formations],
        "kinds": kinds,
        "kind": kind,
        "scales": content.scales.tolist(),
        "larger": list_scales(content.kinds, content.ids, content.scales),
        "view": scenario.video.eye,
        "bodies": bodies,
        "fastest": able.tolist() if bodies else [None] * N,
        "limits": [{"time": phase.time, "limit": own} for phase, own in zip(phases, limits, strict=True)],
        "surface": content.surface,
        "height": content.surface_height - replay["origin"][2],
        "seas": _seas(content, replay),
        "flow": _flow(content, replay),
        "phases": phases_in(dataset),
        "speed": scenario.video.speed,
        "trail": scenario.video.trail,
    }


def _seas(content: Played, replay: dict[str, Any]) -> list[dict[str, Any]]:
    """Describe the waves of each phase: amplitude, m, wave numbers along x and y, rad/m, rate, rad/s, and phase, rad.

    Phases are those at the replay's origin.
    """
    found = []
    for sea in content.seas:
        waves = sea.waves
        k = waves.number[:, None] * waves.unit
        phase = np.mod(waves.phase + k @ np.array(replay["origin"])[:2], 2.0 * np.pi)
        table = np.column_stack([waves.amplitude, k, waves.rate, phase])
        found.append({"time": sea.start, "level": sea.level - replay["origin"][2], "waves": table.tolist()})
    return found


def _flow(content: Played, replay: dict[str, Any]) -> list[dict[str, Any]]:
    """Describe each medium that moves: its velocity on a level grid where its vehicles are, and its scale of speeds."""
    origin, places = np.array(replay["origin"]), content.places()
    centre, reach = origin + replay["centre"], 1.25 * replay["size"]
    side = np.linspace(-reach, reach, 16)  # number of arrows of the flow along each side of the grid
    x, y = (part.ravel() for part in np.meshgrid(centre[0] + side, centre[1] + side))
    found = []
    for medium in content.media:
        level = content.surface_height if medium.level else float(np.nanmedian(places[:, medium.vehicles, 2]))
        grid = np.column_stack([x, y, np.full_like(x, level)])
        times = [time for time, _ in medium.shots]
        start, *arrows = [np.nan_to_num(medium.at(grid, t), posinf=0.0, neginf=0.0).round(3).tolist() for t in times]
        found.append(
            {
                "name": medium.name,
                "scale": medium.scale,
                "top": medium.top,
                "vehicles": medium.vehicles.tolist(),
                "spacing": float(side[1] - side[0]),
                "places": (grid - origin).round(2).tolist(),
                "velocity": start,
                "changes": [{"time": t, "velocity": own} for t, own in zip(times[1:], arrows, strict=True)],
            }
        )
    return found


def _facts(
    scenario: Scenario,
    phases: Sequence[Phase],
    dataset: xr.Dataset,
    summary: dict[str, Any],
    again: tuple[str, str] | None,
) -> dict[str, Any]:
    attrs, backend = dataset.attrs, dataset.attrs["backend"]
    controller = f" --controller {attrs['controller']}" if attrs.get("controller") else ""
    laws = [(phase.time, law_in_words(phase.system)) for phase in phases]
    changes = [f"from {time:g} s on {law}" for (_, before), (time, law) in pairwise(laws) if law != before]
    final = summary.get("final") or {}
    scopes = [("team", final), *(final.get("groups") or {}).items()]
    rows = [[name, *(errors.get(m) for m in MEASURES)] for name, errors in scopes]
    engine = f" --engine {attrs['engine']}" if "engine" in attrs else ""
    command = f"mjsheaf run scenario.yaml --backend {backend}{engine}{controller}"
    command, where = again or (command, " in this directory")
    return {
        "scenario": scenario.name,
        "summary": scenario.summary,
        "backend": _BODIES[engine_of(dataset)],
        "law": f"a law in Python, {attrs['controller']}" if controller else "; ".join([laws[0][1], *changes]),
        "status": attrs["status"],
        "message": attrs.get("message", ""),
        "ending": summary.get("ending"),
        "safety": summary.get("safety"),
        "seed": scenario.seed,
        "measures": list(MEASURES),
        "final": rows,
        "expect": (summary.get("expect") or {}).get("checks", []),
        "versions": {
            "run by": str(attrs.get("source", "")),
            "page by": f"mjsheaf {__version__}",
            "MuJoCo": version("mujoco"),
        },
        "command": command,
        "where": where,
    }


def law_in_words(system: System) -> str:
    """Return the law of a system with its gain and its terms."""
    return ", ".join(["sheaf law", f"gain {system.gain:g} 1/s", *system.law.term_names])


def _hash(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
