"""The page of a run: its data in addition to the samples, and the file."""

import base64
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr
from pydantic_core import to_json

from mjsheaf._version import __version__
from mjsheaf.arrays import Array
from mjsheaf.checking.theorem.of_run import HeldBound, RunBound
from mjsheaf.page.replay import Ghost, pack
from mjsheaf.results.metrics import MEASURES, engine_of, phases_in
from mjsheaf.scenario import Scenario
from mjsheaf.section import LARGEST
from mjsheaf.show.played import Played, has_bodies, played
from mjsheaf.show.solids import kinds_of
from mjsheaf.show.style import list_scales
from mjsheaf.system import Phase, System
from mjsheaf.vehicles.effects import capability_of, of_each

Bounds = Sequence[tuple[RunBound, HeldBound]]

_BODIES = {None: "ideal kinematics", "mujoco": "MuJoCo bodies", "fused": "bodies moved by the fused engine"}


@dataclass(frozen=True)
class Live:
    """Connection of a page to a run in progress.

    Attributes:
        controls: What the page lets its user change, with the `address` of the websocket; see `mjsheaf.live`.
        ahead: Points that vehicles are expected to reach, shape (K, 3), m.
    """

    controls: dict[str, Any]
    ahead: Array


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
    live: Live | None = None,
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
        live: Connection to a run in progress; None for a finished one.
    """
    content = played(scenario, dataset, phases)
    curves = bound_curves(phases, dataset, bounds)
    replay, data = pack(content, dataset, phases, curves, ghosts, None if live is None else live.ahead)
    said = {
        **replay,
        **_scene(scenario, content, phases, dataset, replay),
        "facts": _facts(scenario, phases, dataset, summary, again) | {"theory": _theory(phases, bounds)},
        "notes": [note if isinstance(note, dict) else {"text": str(note)} for note in notes],
    }
    connect = ""
    if live is not None:
        said["live"] = live.controls | {"ahead": (live.ahead - replay["origin"]).round(2).tolist()}
        connect = f"; connect-src {live.controls['address']}"
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
    kinds, kind = kinds_of(system.vehicles)
    agents = system.vehicles[:N] if bodies else []
    able = of_each(agents, lambda vehicle: capability_of(vehicle).least_speed)
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


def _theory(phases: Sequence[Phase], bounds: Bounds) -> list[dict[str, Any]]:
    """Return start, events and theoretical results of each phase that a run reached."""
    return [
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


def _hash(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
