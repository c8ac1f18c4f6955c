"""Random missions of shipped vehicles as a user would write them, and an oracle that judges runs of them.

About half of the missions are within the capabilities of their vehicles; the others ask for more in one or two of the
ways in `CAUSES`. The oracle judges a run by its dataset, without code of `check` or of the notes of `run`; whether a
velocity limit, the safety filter or a body decides, by one more run without it.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.signal import detrend

import mjsheaf
from tests.builders import make_scenario

Raw = dict[str, Any]
Rng = np.random.Generator
Array = NDArray[np.float64]

# -- missions ----------------------------------------------------------------------------------------------------------

SPEEDS = {
    "hull": 6.0,
    "otter": 3.0,
    "otter_rudder": 3.0,
    "wamv": 5.9,
    "wamv_azimuth": 3.8,
    "aerial": 8.0,
    "hexarotor": 5.1,
    "quadrotor": 9.4,
    "x500": 16.0,
    "submersible": 2.0,
}
"""Rounded steady speed of each vehicle in its slowest direction, m/s; a common demand of those without limits."""
BOATS = ("wamv", "otter", "wamv_azimuth", "otter_rudder", "hull")
DRONES = ("hexarotor", "quadrotor", "x500", "aerial")
CAUSES = ("speed", "current", "limit", "gusts", "gain", "turns", "room", "links", "crowding")
"""Ways in which a mission asks too much: of speed over ground or through the medium, within a velocity limit or with
gusts, a gain too high for bodies, tight turns of targets, safety distances without enough room, poor links, formations
smaller than their vehicles."""


@dataclass
class _Group:
    """Vehicles with one role in a mission: agents that keep a formation about a target.

    Attributes:
        name: Name of the group, a prefix of the ids of its agents.
        vehicles: Vehicle of each agent.
        dimension, target_dimension: Of its agents, and of its target.
        height: Height of the target, m.
        spacing: Distance of neighbours in its formation, m.
        raw: Fields that the group adds to the mission.
    """

    name: str
    vehicles: list[str]
    dimension: int
    target_dimension: int
    height: float
    raw: Raw = field(default_factory=dict)
    spacing: float = 0.0

    @property
    def slowest(self) -> float:
        """Speed of the slowest vehicle, m/s."""
        return min(SPEEDS[vehicle] for vehicle in self.vehicles)

    @property
    def strongest(self) -> str:
        """Vehicle without limits that moves where its target does."""
        if self.target_dimension == 2:
            return "hull"
        return "aerial" if self.height > 0.0 else "submersible"

    @property
    def ids(self) -> list[str]:
        """Ids of its agents."""
        return [f"{self.name}{i + 1}" for i in range(len(self.vehicles))]

    @property
    def target(self) -> str:
        """Id of its target."""
        return f"{self.name}_target"


def random_mission(seed: int) -> Raw:
    """Draw a mission: the mapping of a scenario, the same for the same seed."""
    rng = np.random.default_rng([20, seed])
    causes: set[str] = set()
    if rng.random() < 0.5:
        causes = {str(cause) for cause in rng.choice(CAUSES, int(rng.integers(1, 3)), replace=False)}
    kind = str(rng.choice(["boats", "drones", "mixed", "over", "under"], p=[0.36, 0.32, 0.18, 0.09, 0.05]))
    groups = _draw_groups(rng, kind)
    count = sum(len(group.vehicles) for group in groups)
    end = float(np.round(rng.uniform(30.0, 120.0) * min(1.0, 4.0 / count) + 5.0))
    end = max(end, 30.0)

    slowest = min(group.slowest for group in groups)
    share = rng.uniform(0.0, 1.0)
    ratio = rng.uniform(0.0, 0.6)
    if causes & {"speed", "current"}:
        ratio = rng.uniform(0.85, 1.8)
        share = rng.uniform(0.0, 0.4) if "speed" in causes else rng.uniform(0.7, 1.0)
    flow_speed = ratio * share * slowest * (rng.random() < 0.75 or "current" in causes)
    target_speed = ratio * (1.0 - share) * slowest * (rng.random() < 0.8 or "speed" in causes)

    period = float(rng.choice([0.02, 0.04, 0.05, 0.1], p=[0.4, 0.2, 0.25, 0.15]))
    raw: Raw = {"name": f"mission{seed}", "summary": f"{kind}: {', '.join(sorted(causes)) or 'within'}", "seed": seed}
    raw |= {"time": {"end": end}, "controller": {"control_period": period}}
    raw |= {name: [] for name in ("agents", "targets", "communication", "sensing", "formations", "anchors")}
    for group in groups:
        _place(rng, raw, group, "crowding" in causes)
        own = target_speed if group.slowest < 1.5 * slowest else target_speed * float(rng.uniform(0.5, 1.0))
        _move(rng, raw, group, own, flow_speed, end, "turns" in causes)
    _link_groups(rng, raw, groups)
    _choose_law(rng, raw, period, causes, flow_speed + target_speed, slowest)
    _choose_medium(rng, raw, flow_speed, slowest, "gusts" in causes)
    if "room" in causes or rng.random() < 0.15:
        _keep_apart(rng, raw, groups, "room" in causes, flow_speed + target_speed)
    if "links" in causes or rng.random() < 0.25:
        _choose_links(rng, raw, period, "links" in causes)
    if rng.random() < 0.15:
        _add_event(rng, raw, groups, end)
    raw["physics"] = {"timestep": 0.005 if kind == "boats" and period != 0.04 else 0.002}
    return {name: value for name, value in raw.items() if value not in ([], {})}


def _round(values: Any) -> Any:
    """Round to the two decimals that a user would write."""
    return np.round(np.asarray(values, dtype=float), 2).tolist()


def _draw_groups(rng: Rng, kind: str) -> list[_Group]:
    """Draw one group of agents, or two of a mixed team or of two targets."""
    names = {"boats": ["B"], "drones": ["D"], "mixed": ["D", "B"], "over": ["D"], "under": ["U"]}[kind]
    if kind in ("boats", "drones") and rng.random() < 0.3:
        names = [names[0], "C" if kind == "boats" else "E"]
    groups = []
    for name in names:
        boats = name in "BC"
        pool = BOATS if boats else ("submersible",) if kind == "under" else DRONES
        chance = np.array([3.0, 3.0, 2.0, 2.0, 1.0] if boats else [1.0] if kind == "under" else [3.0, 3.0, 3.0, 1.0])
        size = int(rng.integers(1, 4 if len(names) > 1 else 6))
        different = size if rng.random() < 0.4 else 1
        drawn = [str(each) for each in rng.choice(pool, different, p=chance / chance.sum())]
        vehicles = drawn if different == size else drawn * size
        height = 0.0 if boats else float(_round(rng.uniform(-25, -8) if kind == "under" else rng.uniform(8, 25)))
        dimension = 2 if boats else 3
        groups.append(_Group(name, vehicles, dimension, 2 if kind == "over" else dimension, height))
    return groups


def _place(rng: Rng, raw: Raw, group: _Group, crowded: bool) -> None:
    """Add agents that begin scattered about their target, their formation, and their edges."""
    n, size = group.dimension, len(group.vehicles)
    centre = np.array([0.0, 0.0] if not raw["targets"] else rng.uniform(15, 40, 2) * rng.choice([-1, 1], 2))
    boats = n == 2 or group.vehicles[0] == "submersible"
    radius = rng.uniform(8, 20) if boats else rng.uniform(3, 9)
    if crowded:
        radius = rng.uniform(0.3, 1.5)
    scatter = rng.uniform(5, 25)
    for name, vehicle in zip(group.ids, group.vehicles, strict=True):
        position = np.append(centre + rng.uniform(-scatter, scatter, 2), [group.height + rng.uniform(-3, 5)] * (n == 3))
        agent = {"id": name, "position": _round(position), "vehicle": vehicle}
        if rng.random() < 0.6:
            agent["heading"] = float(np.round(rng.uniform(-180, 180)))
        raw["agents"].append(agent)
    target = np.append(centre, [group.height] * (group.target_dimension == 3))
    raw["targets"].append({"id": group.target, "position": _round(target)})

    rise = float(_round(rng.uniform(0, 5) if n == 3 and not boats else 0.0))
    shape: Raw = {"name": group.name, "members": group.ids, "about": group.target}
    if n == 3 and group.target_dimension == 3 and rise:
        shape["height"] = rise
    angle = float(np.round(rng.uniform(-180, 180)))
    if size >= 3 and rng.random() < 0.7:
        shape |= {"shape": "polygon", "radius": float(_round(radius)), "angle": angle}
        group.spacing = 2.0 * radius * np.sin(np.pi / size)
    elif size >= 2:
        shape |= {"shape": "line", "spacing": float(_round(radius)), "angle": angle}
        group.spacing = radius
    else:
        offset = radius * np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle)), 0.0])[:n]
        shape |= {"shape": "explicit", "displacements": [_round(offset)]}
        group.spacing = radius
    raw["formations"].append(shape)

    for i in range(1, size):
        raw["communication"].append([group.ids[i - 1], group.ids[i]])
    if size > 2 and rng.random() < 0.7:
        raw["communication"].append([group.ids[-1], group.ids[0]])
    weight = float(rng.choice([1, 1, 2, 4]))
    seeing = group.ids if rng.random() < 0.4 else group.ids[: max(1, size // 2)]
    for name in seeing:
        raw["sensing"].append({"between": [name, group.target], "weight": weight})
    if group.target_dimension < n:
        height = group.height + rise
        raw["anchors"] += [{"agent": name, "axes": ["z"], "value": [_round(height)]} for name in group.ids]


def _move(rng: Rng, raw: Raw, group: _Group, speed: float, flow: float, end: float, tight: bool) -> None:
    """Choose vehicle and motion of the group's target, which is the last one, with a speed over ground in m/s."""
    target = raw["targets"][-1]
    n = group.target_dimension
    start = np.array(target["position"])
    pull = float(rng.choice([0.2, 0.5, 1.0]))
    if tight:
        speed = max(speed, 0.5 * group.slowest)
    if speed < 0.1:
        adrift = rng.random() < 0.3
        target["motion"] = {"kind": "static", "pull": 0.0 if adrift else pull}
        target["vehicle"] = ("buoy" if adrift else "hull") if n == 2 else "aerial"
        return
    able = [name for name in (BOATS if n == 2 else DRONES) if SPEEDS[name] > 1.3 * (speed + flow)]
    target["vehicle"] = group.strongest
    if able and group.height >= 0 and rng.random() < 0.5:
        target["vehicle"] = str(rng.choice(able))
    kind = "circle" if tight else str(rng.choice(["circle", "lissajous", "path", "tour", "line", "random"]))
    radius = rng.uniform(1.0, 4.0) if tight else rng.uniform(8.0, 30.0)
    flat = np.array([1.0, 1.0, 0.0])[:n]
    if kind in ("circle", "lissajous"):
        rates = speed / radius * (np.ones(n) if kind == "circle" else rng.uniform(0.4, 1.0, n))
        amplitude = radius * flat
        if n == 3:
            amplitude[2] = rng.uniform(0.0, 0.1) * radius
        phase = np.array([np.pi / 2 * rng.choice([-1, 1]), 0.0, rng.uniform(0, 6)])[:n]
        motion = {"amplitude": _round(amplitude), "rate": np.round(rates, 4).tolist(), "phase": _round(phase)}
        target["motion"] = {"kind": "lissajous", **motion, "pull": pull}
        return
    if kind in ("path", "tour"):
        points = start + rng.uniform(-1, 1, (int(rng.integers(2, 5)), n)) * ([30.0, 30.0, 3.0][:n])
        target["motion"] = {"kind": "waypoints", "points": _round(points), "speed": float(np.round(speed, 3))}
        target["motion"] |= {"closed": kind == "tour", "pull": pull}
        return
    if kind == "line":
        bearing = rng.uniform(-np.pi, np.pi)
        point = start + speed * (end + 10.0) * np.array([np.cos(bearing), np.sin(bearing), 0.0])[:n]
        target["motion"] = {"kind": "waypoints", "points": [_round(point)], "speed": float(np.round(speed, 3))}
        return
    times = np.arange(0.0, 3.0 * end + 12.0, 6.0)  # for a run three times as long, which may decide
    turns = rng.normal(0.0, 0.7, len(np.arange(0.0, end + 12.0, 6.0)))
    headings = np.cumsum(np.pad(turns, (0, len(times) - len(turns))))
    steps = 6.0 * speed * np.column_stack([np.cos(headings), np.sin(headings), np.zeros(len(times))])[:, :n]
    places = start + np.vstack([np.zeros(n), np.cumsum(steps[:-1], axis=0)])
    target["motion"] = {"kind": "recorded", "samples": _round(np.column_stack([times, places])), "pull": pull}


def _link_groups(rng: Rng, raw: Raw, groups: list[_Group]) -> None:
    """Connect two groups weakly, or let one agent of a group sense a third target too."""
    if len(groups) == 2:
        edge: Raw = {"between": [groups[0].ids[0], groups[1].ids[-1]], "weight": 0.1}
        raw["communication"].append(edge)
    if rng.random() < 0.12:
        group = groups[0]
        place = np.array(raw["targets"][0]["position"])
        place[:2] += rng.uniform(-20, 20, 2)
        mark = {"id": "mark", "position": _round(place), "vehicle": group.strongest}
        raw["targets"].append(mark | {"motion": {"kind": "static", "pull": 0.5}})
        raw["sensing"].append({"between": [group.ids[-1], "mark"], "weight": 0.5})


def _choose_law(rng: Rng, raw: Raw, period: float, causes: set[str], demand: float, slowest: float) -> None:
    """Choose gain, velocity limit and terms."""
    controller = raw["controller"]
    controller["gain"] = float(rng.choice([0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.2]))
    if "gain" in causes:
        controller["gain"] = float(_round(rng.uniform(1.5, 10.0)))
    if "limit" in causes:
        controller["velocity_limit"] = float(_round(max(0.1, rng.uniform(0.4, 1.1) * max(demand, 0.2 * slowest))))
    elif rng.random() < 0.5:
        controller["velocity_limit"] = float(_round(max(rng.uniform(0.7, 1.0) * slowest, 1.3 * demand)))
    if rng.random() < 0.2:
        controller["feedforward"] = {"rounds": int(rng.integers(1, 6)), "filter": float(rng.choice([0.0, 0.2, 1.0]))}
    if rng.random() < 0.12:
        controller["newton"] = {"rounds": int(rng.integers(1, 6))}
    if rng.random() < 0.12:
        controller["drift"] = {"filter": float(rng.choice([0.1, 0.5, 2.0]))}
    if rng.random() < 0.04:
        controller["integral"] = {"gain": float(rng.choice([0.005, 0.02])), "limit": float(_round(0.3 * slowest))}


def _choose_medium(rng: Rng, raw: Raw, speed: float, slowest: float, gusty: bool) -> None:
    """Choose wind and current of a mean speed in m/s, with vortices, channels, gusts and waves."""
    bearing = rng.uniform(-np.pi, np.pi)
    drift = speed * np.array([np.cos(bearing), np.sin(bearing)])
    spatial = any(len(agent["position"]) == 3 and agent["position"][2] > 0 for agent in raw["agents"])
    planar = any(len(agent["position"]) == 2 for agent in raw["agents"])
    flow: Raw = {}
    if planar:
        flow["water"] = {"dimension": 2, "drift": _round(drift)}
    if spatial or not planar:
        flow["air"] = {"dimension": 3, "drift": _round([*drift, 0.0])}
    strength = 0.25 * max(speed, 0.1 * slowest)
    for name, part in flow.items():
        n = part["dimension"]
        if rng.random() < 0.2:
            centre = rng.uniform(-25, 25, n)
            vortex = {"centre": _round(centre), "gamma": float(_round(strength * 8.0))}
            part |= {"core": 4, "vortices": [vortex | ({"axis": [0, 0, 1]} if n == 3 else {})]}
        if rng.random() < 0.15:
            channel = {
                "centre": _round(rng.uniform(-20, 20, n)),
                "direction": _round([1.0, rng.uniform(-1, 1), 0.0][:n]),
            }
            part["channels"] = [channel | {"beta": float(_round(strength)), "width": 8, "length": 40}]
        if name == "air" and spatial and (gusty or rng.random() < 0.2):
            wind = rng.uniform(12, 30) if gusty else rng.uniform(2, 9)
            part["gusts"] = {"kind": "dryden", "wind_speed": float(_round(wind))}
        if name == "water" and (gusty or rng.random() < 0.2):
            height = float(_round(rng.uniform(1.5, 4.0) if gusty else rng.uniform(0.1, 0.8)))
            waves = {
                "significant_height": height,
                "peak_period": float(_round(rng.uniform(4, 6) * np.sqrt(height) + 1)),
            }
            part["waves"] = {"kind": str(rng.choice(["jonswap", "pierson_moskowitz"])), **waves, "direction": 30}
    raw["flow"] = flow
    if rng.random() < 0.4:
        bound = rng.uniform(0.5, 1.5) * slowest if gusty else rng.uniform(0.05, 0.4)
        raw["disturbance"] = {"agents": {"bound": float(_round(bound))}}


def _keep_apart(rng: Rng, raw: Raw, groups: list[_Group], tight: bool, demand: float) -> None:
    """Add a safety distance that the formations leave room for, or not, and at times an obstacle near the target.

    The filter on bodies adds stopping distances: most teams with room are slow ones.
    """
    spacing = min(group.spacing for group in groups)
    slow = not tight and rng.random() < 0.6
    ratio = rng.uniform(0.8, 1.6) if tight else rng.uniform(0.2, 0.6)
    safety: Raw = {"distance": float(_round(max(0.3, ratio * spacing)))}
    if not tight and rng.random() < 0.3:
        safety["distance"] = "size"
    if rng.random() < 0.3:
        safety["tie_break"] = "right_hand"
    if rng.random() < 0.35:
        group = groups[0]
        target = next(t for t in raw["targets"] if t["id"] == group.target)["position"]
        way = 0.5 * (np.array(raw["agents"][0]["position"][:2]) + np.array(target[:2]))
        safety["obstacles"] = [{"kind": "sphere", "centre": _round([*way, group.height]), "radius": 1.0}]
    raw["safety"] = safety
    # The range within which an agent sees others follows from its velocity limit.
    controller = raw["controller"]
    controller.setdefault("velocity_limit", float(_round(0.8 * min(group.slowest for group in groups))))
    if slow:
        safety["distance"] = float(_round(max(0.3, rng.uniform(0.1, 0.3) * spacing)))
        controller["velocity_limit"] = min(controller["velocity_limit"], float(_round(1.4 * demand + 0.5)))


def _choose_links(rng: Rng, raw: Raw, period: float, poor: bool) -> None:
    """Choose delay, noise and loss of all links."""
    link: Raw = {}
    if rng.random() < 0.5:
        delay = rng.uniform(0.4, 2.0) if poor else rng.uniform(0.0, 0.3)
        link["delay"] = float(np.round(max(1, round(delay / period)) * period, 6))
    if rng.random() < 0.5:
        link["noise"] = float(np.round(rng.uniform(0.5, 2.0) if poor else rng.uniform(0.005, 0.1), 3))
    if rng.random() < 0.5 or not link:
        link["loss"] = float(_round(rng.uniform(0.5, 0.95) if poor else rng.uniform(0.02, 0.3)))
    raw["links"] = {"all": link}


def _add_event(rng: Rng, raw: Raw, groups: list[_Group], end: float) -> None:
    """Lose the last agent of the largest group, or change the gain, near the middle of the run."""
    time = float(np.round(rng.uniform(0.35, 0.55) * end))
    group = max(groups, key=lambda each: len(each.vehicles))
    if len(group.vehicles) > 1 and rng.random() < 0.7:
        raw["events"] = [{"time": time, "lose": group.ids[-1]}]
    else:
        raw["events"] = [{"time": time, "set": {"controller.gain": 2.0 * raw["controller"]["gain"]}}]


# -- the oracle --------------------------------------------------------------------------------------------------------

MIN_ERROR = 3.0
"""Tracking error of an agent that matters, as a mean over a quarter of a run, m."""
MIN_STUCK_ERROR = 1.5
"""Tracking error that matters of an agent that does not move or that swings, m."""
APPROACHING = 0.85
"""An error whose mean over the last quarter is a smaller fraction of the mean over the one before still decays."""
MAX_SHORTFALL = 0.35
"""Fraction of its commanded velocity that an agent may miss, where it still does what it is commanded."""
MAX_LIMITED = 0.5
"""Fraction of the time at the velocity limit, or of thrusters at their limits, above which limits decide."""
UNFORESEEN = 3.0
"""Ratio of the error of a run to the foreseen one above which the prediction is wrong, with MIN_UNFORESEEN."""
MIN_UNFORESEEN = 2.0
"""Difference of these errors that matters, m."""

_BLOCK = 6.0  # s, over which commands and velocities are compared
_CALM = 0.3  # of the speed of a swing, that of the medium which does not drive it; and the same for growth


@dataclass(frozen=True)
class _Motion:
    """Motion of an agent over a quarter of a run, or over a half.

    Attributes:
        error: Mean tracking error, m.
        commanded: Mean speed of the commands over blocks, m/s.
        steady: That over the mean speed of the commands over seconds: small if they turn within a block.
        made: Mean velocity through the medium along the commands, m/s.
        shortfall: Missing part of the commanded velocity, as a fraction of it.
        limited: Fraction of the time at the velocity limit.
        saturated: Fraction of thrusters at a limit.
        corrected: Mean speed that the safety filter changed, m/s.
        of_place: Mean speed of its place in q*, m/s.
    """

    error: float
    commanded: float
    steady: float
    made: float
    shortfall: float
    limited: float
    saturated: float
    corrected: float
    of_place: float

    @property
    def incapable(self) -> str:
        """Why the agent does not do what the law wants, or empty."""
        if self.limited > MAX_LIMITED:
            return f"at its velocity limit for {100 * self.limited:.0f} % of the time"
        if self.saturated > MAX_LIMITED:
            return f"{100 * self.saturated:.0f} % of its thrusters at a limit"
        if self.shortfall > MAX_SHORTFALL and self.commanded > 0.05:
            return f"{100 * self.shortfall:.0f} % short of its commanded velocity"
        return ""


def failure_of_run(mission: Raw, run: xr.Dataset | Exception) -> str | None:
    """Say why a run, or what `simulate` raised, contradicts a check that said OK; None if it does not.

    After the last event, for agents that are present to the end, in this order: the run blew up; an agent turned over,
    or an aircraft went below the surface; a safety distance was not kept; an agent is stuck, is held up by the safety
    filter, diverges, stays far off at its limits, or swings where q*, the medium and noise do not. An error that the
    law itself leaves, as it lags behind a moving target, is no failure unless it grows in a run three times as long.
    Nor is one that hardly depends on the limit, filter or body at work, or that falls at the end as others come in.
    """
    if isinstance(run, Exception):
        return f"refused: {run}"
    if run.attrs["status"] != "finished":
        return f"blew up: {run.attrs['message']}"
    lost = {event["lose"] for event in mission.get("events", []) if "lose" in event}
    ids = [str(agent) for agent in run["agent"].values]
    present = [i for i, name in enumerate(ids) if name not in lost]
    for failure in (_tumbled(mission, run, present), _too_close(mission, run)):
        if failure:
            return failure
    begin = max([event["time"] for event in mission.get("events", [])], default=0.0)
    for i in present:
        failure = _failure_of_agent(mission, run, i, begin)
        if failure:
            return f"{ids[i]} ({mission['agents'][i]['vehicle']}) {failure}"
    return None


def _tumbled(mission: Raw, run: xr.Dataset, present: list[int]) -> str | None:
    """Find an agent that turned over, or an aircraft below the surface."""
    for i in present:
        _, x, y, _ = run["agent_orientation"].values[:, i].T
        over = 1.0 - 2.0 * (x**2 + y**2) < 0.0
        if over.any():
            return f"{mission['agents'][i]['id']} turned over at {run['time'].values[over.argmax()]:.1f} s"
        start = mission["agents"][i]["position"]
        below = run["agent_height"].values[:, i] < 0.0
        if len(start) == 3 and start[2] > 0.0 and below.any():
            return f"{mission['agents'][i]['id']} below the surface at {run['time'].values[below.argmax()]:.1f} s"
    return None


def _too_close(mission: Raw, run: xr.Dataset) -> str | None:
    """Find a safety distance that was lost once it was kept, or never kept."""
    if "safety" not in mission:
        return None
    distance = mission["safety"]["distance"]
    allowed = 0.1 * max(1.0, distance if distance != "size" else 1.0)
    gap = run["separation"].values
    kept = gap >= 0.0
    first = int(kept.argmax()) if kept.any() else len(gap)
    if first > len(gap) // 2:
        return f"safety distance never kept: {-gap.max():.2f} m too close"
    worst = float(gap[first:].min())
    return f"safety distance not kept: {-worst:.2f} m too close" if worst < -allowed else None


def _failure_of_agent(mission: Raw, run: xr.Dataset, i: int, begin: float) -> str | None:
    """Say how an agent ends in trouble over the time from `begin`, s, to the end; None if it does not."""
    time = run["time"].values
    begin = max(begin, float(time[0]))
    cuts = np.linspace(begin, time[-1], 5)
    third, last = (_motion(mission, run, i, cuts[k], cuts[k + 1]) for k in (2, 3))
    # One that was driven away, and comes back, is not on its first way to its place.
    error = np.array([run["tracking_error"].sel(time=slice(*cuts[k : k + 2])).mean("time") for k in range(4)])
    on_way = (np.diff(error[:3], axis=0) < 0.0).all(axis=0) & (error[3] < APPROACHING * error[2])
    if on_way[i]:
        return None
    tail = f"{third.error:.1f} then {last.error:.1f} m off in the last quarters"
    goes = last.commanded > 0.1 and last.steady > 0.5
    if last.error > MIN_STUCK_ERROR and goes and last.made < 0.15 * last.commanded:
        return f"is stuck: commanded {last.commanded:.2f} m/s, makes {last.made:.2f} m/s, {tail}"
    corrected = last.corrected > 0.1 and last.corrected > 0.3 * last.commanded
    free = {key: value for key, value in mission.items() if key != "safety"}
    less = max(0.5 * last.error, min(last.error - 1.0, APPROACHING * last.error))  # m, without what holds it up
    if last.error > MIN_STUCK_ERROR and corrected and _is_nearer(free, i, less, cuts[3]):
        return f"is held up by the safety filter, which changes {last.corrected:.2f} m/s, {tail}"
    if last.error > MIN_ERROR and last.shortfall > MAX_SHORTFALL and not _is_nearer(mission, i, less, cuts[3], "ideal"):
        last = replace(last, shortfall=0.0)  # the law itself leaves the error
    limited = last.limited > MAX_LIMITED and "safety" not in mission  # which needs a limit
    far = last.error > max(MIN_ERROR, third.error)
    free = mission | {"controller": {k: v for k, v in mission["controller"].items() if k != "velocity_limit"}}
    if far and limited and not _is_nearer(free, i, APPROACHING * last.error, cuts[3]):
        last = replace(last, limited=0.0)
    centre = 0.5 * (cuts[3] + cuts[4])
    if far and last.incapable:  # others that are on their way draw an agent off its place, and it comes back with them
        early, late = (_motion(mission, run, i, *ends).error for ends in ((cuts[3], centre), (centre, cuts[4])))
        if late >= APPROACHING * early or not on_way.any():
            return f"{'diverges' if grows(run, i, cuts[2]) else 'stays far off'}: {last.incapable}, {tail}"
    if last.error > MIN_ERROR and last.of_place < 1.1 * third.of_place and grows(run, i, cuts[2]):
        longer = mission | {"time": mission["time"] | {"end": 3.0 * mission["time"]["end"]}}  # a lag may still build up
        run_on = mjsheaf.simulate(make_scenario(longer), progress=False)
        if run_on.attrs["status"] != "finished" or grows(run_on, i, run_on["time"].values[-1] / 2.0):
            return f"diverges, and its place moves no faster: {tail}"
    before, after = (_swing(run, i, cuts[k], cuts[k + 1]) for k in (2, 3))
    decays = after < APPROACHING * before
    if not before:  # something drove it, and what is left may decay now
        decays = _swing(run, i, centre, cuts[4]) < APPROACHING * _swing(run, i, cuts[3], centre)
    links = {key: value for key, value in mission.get("links", {}).get("all", {}).items() if key != "noise"}
    if after > MIN_STUCK_ERROR and not decays and "links" in mission:  # noise may drive it
        quiet = mjsheaf.simulate(make_scenario(mission | {"links": {"all": links}}), progress=False)
        decays = quiet.attrs["status"] == "finished" and _swing(quiet, i, cuts[3], cuts[4]) < 0.5 * after
    if after > MIN_STUCK_ERROR and not decays:
        return f"swings by {after:.1f} m RMS about a mean that neither q*, the medium nor noise drives"
    return None


def _is_nearer(mission: Raw, i: int, error: float, begin: float, backend: str = "physics") -> bool:
    """Return True if an agent's mean error in a mission, from `begin`, s, on, is below `error`, m, and the run ends."""
    run = mjsheaf.simulate(make_scenario(mission), backend, progress=False)
    left = run["tracking_error"].isel(agent=i).sel(time=slice(begin, None)).mean()
    return run.attrs["status"] == "finished" and bool(left < error)


def _motion(mission: Raw, run: xr.Dataset, i: int, begin: float, end: float) -> _Motion:
    """Measure the motion of an agent over a part of its run, between two times in s."""
    part = run.isel(agent=i).sel(time=slice(begin, end))
    time = part["time"].values
    command = np.nan_to_num(part["velocity_command"].values)
    ground = np.gradient(np.nan_to_num(part["agent_position"].values), time, axis=0)
    through = ground - np.nan_to_num(part["agent_flow"].values)
    places = np.gradient(np.nan_to_num(part["harmonic_extension"].values), time, axis=0)
    blocks = np.array_split(np.arange(len(time)), max(1, round((time[-1] - time[0]) / _BLOCK)))
    wanted = np.array([command[block].mean(axis=0) for block in blocks])
    made = np.array([through[block].mean(axis=0) for block in blocks])
    size = float(np.linalg.norm(wanted, axis=1).mean())
    seconds = np.array_split(np.arange(len(time)), max(1, round(time[-1] - time[0])))  # noise is gone from their means
    each_second = np.array([command[second].mean(axis=0) for second in seconds])
    limit = mission["controller"].get("velocity_limit", np.inf)
    corrected = part["safety_correction"].values.mean() if "safety_correction" in part else 0.0
    return _Motion(
        error=float(np.nanmean(part["tracking_error"].values)),
        commanded=size,
        steady=size / max(float(np.linalg.norm(each_second, axis=1).mean()), 1e-9),
        made=float((made * wanted).sum(axis=1).mean() / max(size, 1e-9)),
        shortfall=float(1.0 - (made * wanted).sum() / max((wanted**2).sum(), 1e-9)),
        limited=float((np.linalg.norm(command, axis=1) > 0.999 * limit).mean()),
        saturated=float(part["agent_saturation"].values.mean()),
        corrected=float(corrected),
        of_place=float(np.linalg.norm(places, axis=1).mean()),
    )


def grows(run: xr.Dataset, i: int, begin: float) -> bool:
    """Return True if an agent's error grows from eighth to eighth of the run from `begin`, s, by a half and more.

    A rise to the error that the law leaves slows: its second half is less than 0.9 times the first. Nor is it growth
    where the agent's place or the medium drives it: where the velocity of the place through the medium changes, from
    the first half of that time to the second, by more than three times the rate of the error.
    """
    part = run.isel(agent=i).sel(time=slice(begin, None))
    time = part["time"].values
    means = np.array([np.nanmean(eighth) for eighth in np.array_split(part["tracking_error"].values, 8)])
    slows = means[-1] - means[4] < 0.9 * (means[3] - means[0])
    if (np.diff(means) > 0.0).sum() < 6 or means[-1] <= 1.5 * means[0] or slows:
        return False
    place, flow = (np.nan_to_num(part[name].values) for name in ("harmonic_extension", "agent_flow"))
    before, after = (half.mean(axis=0) for half in np.array_split(np.gradient(place, time, axis=0) - flow, 2))
    rate = (means[4:].mean() - means[:4].mean()) / (0.5 * (time[-1] - time[0]))
    return bool(rate > _CALM * np.linalg.norm(after - before))


def _swing(run: xr.Dataset, i: int, begin: float, end: float) -> float:
    """Measure the RMS swing of an agent's error between two times in s, m; 0 if q* or the medium drives it."""
    part = run.isel(agent=i).sel(time=slice(begin, end))
    time = part["time"].values
    place, q_star = (np.nan_to_num(part[name].values) for name in ("agent_position", "harmonic_extension"))
    flow = np.nan_to_num(part["agent_flow"].values)
    error, wanted, medium = (detrend(each, axis=0) for each in (place - q_star, q_star, flow))
    speed = np.gradient(error, time, axis=0)
    swing, of_q_star, of_medium, of_speed = (
        float(np.sqrt((each**2).sum(axis=1).mean())) for each in (error, wanted, medium, speed)
    )
    main = error[:, error.var(axis=0).argmax()]
    swings = (np.diff(np.sign(main)) != 0.0).sum() >= 3  # a way back has two
    return swing if swings and swing > 3.0 * of_q_star and of_medium < _CALM * of_speed else 0.0


def unforeseen_error(mission: Raw, record: Raw, run: xr.Dataset) -> str | None:
    """Say that the error of a run is far from the one that `check` foresaw; None if it is near, or not foreseen.

    Both are RMS over agents and over the second half of the run, up to the first event. An error that still decays is
    not compared.
    """
    steady, disturbance, links = record["steady"], record["disturbance"], record["links"]
    foreseen = steady["ideal"] if steady["bodies"] is None else steady["bodies"]
    if foreseen is None:
        return None
    shaken = [rms for rms in disturbance["bodies"].values() if rms is not None]
    rms = float(np.sqrt(np.mean(np.square(shaken)))) if shaken else disturbance["rms"] or 0.0
    foreseen = float(np.sqrt(foreseen**2 + rms**2 + ((links or {}).get("noise_rms_per_agent") or 0.0) ** 2))
    time = run["time"].values
    end = min([event["time"] for event in mission.get("events", [])], default=float(time[-1]))
    error = run["tracking_error"].values[time <= end]
    quarters = [np.sqrt(np.nanmean(part**2)) for part in np.array_split(error, 4)]
    measured = float(np.sqrt(np.nanmean(error[len(error) // 2 :] ** 2)))
    if quarters[3] < APPROACHING * quarters[2] or measured < max(UNFORESEEN * foreseen, foreseen + MIN_UNFORESEEN):
        return None
    return f"error {measured:.1f} m, {foreseen:.2f} m foreseen"
