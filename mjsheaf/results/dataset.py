"""A run as an xarray Dataset with CF attributes: what result.nc holds."""

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf._version import __version__
from mjsheaf.arrays import Array, IntArray
from mjsheaf.control.law import disagreement
from mjsheaf.control.links import NEW, SILENT
from mjsheaf.control.terms import traffic_of
from mjsheaf.results.metrics import evaluate_errors, separations
from mjsheaf.simulation.trajectory import Log, Trajectory
from mjsheaf.system import Phase, System
from mjsheaf.team import Edge
from mjsheaf.team.null_modes import describe_null_modes

Variable = tuple[str | tuple[str, ...], NDArray[Any], dict[str, Any]]
"""Dimensions, values and attributes, as xarray takes them."""


def make_dataset(trajectory: Trajectory, backend: str, seed: int) -> xr.Dataset:
    """Gather a trajectory, as it was recorded, and its errors.

    Args:
        trajectory: what came out, or a piece of it.
        backend: 'ideal' or 'physics'.
        seed: seed of the scenario.

    Returns:
        Variables over the dimensions time, agent, target and axis; docs/reference/results.md lists them. Attributes
        name the scenario, backend, status and groups.
    """
    return next(make_datasets([trajectory], backend, seed))


def make_datasets(
    pieces: Iterable[Trajectory], backend: str, seed: int, phases: Sequence[Phase] = ()
) -> Iterator[xr.Dataset]:
    """Gather a trajectory that comes in pieces, each as `make_dataset` does.

    The last piece has the run's status, and says what agents have sent one another (see `terms.traffic_of`) and what
    share of their measurements has arrived. `phases` number the samples and name all edges that have a link at some
    time; a run of one phase does not need it.
    """
    attributes: dict[str, Any] = {}
    delivery = Delivery([phase.system for phase in phases])
    traffic = np.zeros(3, dtype=np.int64)
    done = 0
    for piece in pieces:
        attributes = attributes or _attributes(piece.system, backend, seed) | _about_phases(phases)
        delivery.add(piece)
        samples = np.arange(done, done + len(piece.time))
        done += len(piece.time)
        dataset = _gather(piece, delivery, _number_phases(phases or [Phase(0, piece.system)], samples))
        traffic += len(piece.time) * np.array(traffic_of(piece.system.law.terms, piece.system.team))
        dataset.attrs = attributes | {"status": piece.status, "message": piece.message}
        dataset.attrs |= dict(zip(("exchange_rounds", "messages", "numbers_sent"), traffic.tolist(), strict=True))
        yield dataset


def join(pieces: Iterable[xr.Dataset]) -> xr.Dataset:
    """The dataset of a whole run from those of its pieces."""
    parts = list(pieces)
    if len(parts) == 1:
        return parts[0]
    alike: dict[str, Any] = dict.fromkeys(("data_vars", "coords"), "minimal")
    alike |= dict.fromkeys(("compat", "join", "combine_attrs"), "override")
    whole = xr.concat(parts, "time", **alike).assign_attrs(parts[-1].attrs)
    return whole.assign(delivery=parts[-1]["delivery"]) if "delivery" in whole else whole


def in_pieces(pieces: Iterable[xr.Dataset], samples: int) -> Iterator[xr.Dataset]:
    """The same run in pieces of so many samples, but for the last, whatever pieces it comes in."""
    held: list[xr.Dataset] = []
    for piece in pieces:
        held.append(piece)
        while sum(part.sizes["time"] for part in held) > samples:
            whole = join(held)
            yield whole.isel(time=slice(0, samples))
            held = [whole.isel(time=slice(samples, None))]
    if held:
        yield join(held)


def _number_phases(phases: Sequence[Phase], samples: IntArray) -> Variable:
    """Return the coordinate `phase` of some samples: the number of each one's phase, and when each phase begins.

    `flag_values` and `flag_meanings` are those of CF: numbers, and words without blanks. `events` has the words as they
    are: a JSON list of lists.
    """
    starts = [phase.start for phase in phases]
    number = np.searchsorted(starts, samples, side="right") - 1
    meanings = [re.sub(r"[^\w.+@-]+", "_", phase.name).strip("_") for phase in phases]
    several = len(phases) > 1  # an array of one number comes back from a file as a number
    numbers = np.arange(len(phases), dtype=np.int32)
    times = np.array([phase.time for phase in phases])
    attributes = {
        "units": "1",
        "long_name": "number of the phase of the run, from 0 on",
        "flag_values": numbers if several else numbers[0],
        "flag_meanings": " ".join(meanings),
        "start_times": times if several else times[0],
        "start_times_units": "s",
        "events": json.dumps([list(phase.events) for phase in phases]),
    }
    return "time", number.astype(np.int32), attributes


def _about_phases(phases: Sequence[Phase]) -> dict[str, Any]:
    """Return the attributes that a dataset has of a run with events: the phases, and all directions free in some."""
    if not any(phase.events for phase in phases):
        return {}
    told = json.dumps([{"time": phase.time, "events": list(phase.events)} for phase in phases])
    free = dict.fromkeys(words for phase in phases for words in describe_null_modes(phase.system.team.remaining))
    return {"phases": told, "free_directions": "; ".join(free)}


def of_phase(run: System | Sequence[Phase], dataset: xr.Dataset, which: int) -> tuple[System, xr.Dataset]:
    """The system of one phase of a run and its samples, both of the present agents alone; all there is without events.

    Args:
        run: what was run.
        dataset: its data.
        which: number of the phase; -1 is the last that the run came to.
    """
    phases = (Phase(0, run),) if isinstance(run, System) else run
    if len(phases) == 1 and not phases[0].system.team.absent:
        return phases[0].system, dataset
    time = dataset["time"].values
    half = 0.5 * phases[0].system.grid.period
    begin = np.searchsorted(time, [phase.time - half for phase in phases])
    reached = [k for k in range(len(phases)) if begin[k] < len(time)]
    k = reached[which]
    end = begin[k + 1] if k + 1 in reached else len(time)
    present = np.flatnonzero(phases[k].system.team.present)
    return phases[k].system.remaining, dataset.isel(time=slice(begin[k], end), agent=present)


class Delivery:
    """What arrives over the links of a run, counted piece by piece.

    Attributes:
        edges: that have a link in some phase: kind and name, in order.
        sizes: how many numbers each edge of communication and sensing measures, with a link or without.
        share: of the measurements that could have arrived, new ones that did, in phases without the link all of them;
            NaN where none could, shape (L,).
    """

    def __init__(self, systems: Sequence[System]) -> None:
        """Begin to count, in a run under these systems; those of pieces are added."""
        self._number: dict[tuple[str, str], int] = {}
        self.sizes: dict[tuple[str, str], int] = {}
        self._new, self._due, self._waiting = (np.zeros(0, dtype=np.int64) for _ in range(3))
        for system in systems:
            self._enter(system)

    @property
    def edges(self) -> list[tuple[str, str]]:
        """Kind and name of each link's edge."""
        return list(self._number)

    @property
    def share(self) -> Array:
        """See the class."""
        return np.where(self._due > 0, self._new / np.maximum(self._due, 1), np.nan)

    def _enter(self, system: System) -> IntArray:
        """The numbers of a system's links, in order."""
        labelled = labelled_edges(system)
        self.sizes |= {key: len(edge.b) for key, edge in labelled}
        names = [key for key, _ in labelled]
        keys = [names[e] for e in system.law.links.table["edge"]]
        for key in keys:
            self._number.setdefault(key, len(self._number))
        more = (0, len(self._number) - len(self._new))
        self._new, self._due, self._waiting = (np.pad(x, more) for x in (self._new, self._due, self._waiting))
        return np.array([self._number[key] for key in keys], dtype=np.int64)

    def add(self, piece: Trajectory) -> None:
        """Count a piece's."""
        own, table, T = self._enter(piece.system), piece.system.law.links.table, len(piece.time)
        under_way = self._waiting.copy()  # samples that each link has been there, up to its delay
        self._waiting[:] = 0
        self._waiting[own] = np.minimum(under_way[own] + T, table["delay"])
        self._due[own] += T - (self._waiting[own] - under_way[own])
        self._new[own] += (piece.log.heard == NEW).sum(axis=0)
        there = {self._number[key] for key, _ in labelled_edges(piece.system) if key in self._number}
        plain = sorted(there.difference(own.tolist()))
        self._due[plain] += T
        self._new[plain] += T


def labelled_edges(system: System) -> list[tuple[tuple[str, str], Edge]]:
    """The edges of communication and sensing in the order of the law: kind and name, such as 'A1-A2', and the edge.

    The second of several edges between the same ends is 'A1-A2-2'.
    """
    met: dict[tuple[str, str], int] = {}
    found = []
    for kind, edges in (("communication", system.team.communication), ("sensing", system.team.sensing)):
        for edge in edges:
            key = kind, f"{edge.tail}-{edge.head}"
            met[key] = met.get(key, 0) + 1
            found.append(((kind, key[1] + (f"-{met[key]}" if met[key] > 1 else "")), edge))
    return found


def _gather(trajectory: Trajectory, delivery: Delivery, phase: Variable) -> xr.Dataset:
    system, log = trajectory.system, trajectory.log
    team, N = system.team, len(system.team.agents)
    errors = evaluate_errors(team, log.positions)
    has = np.array([[axis < member.dimension for axis in range(3)] for member in team.members])

    # Gathered first: a dataset that grows variable by variable aligns all of them each time.
    variables: dict[str, Variable] = {}
    coordinates: dict[str, Variable] = {
        "time": ("time", trajectory.time, {"long_name": "time", "units": "s"}),
        "agent": _labels("agent", team.agent_ids, "agent"),
        "target": _labels("target", team.target_ids, "target"),
        "axis": _labels("axis", ["x", "y", "z"], "axis of the world frame"),
        "phase": phase,
        **_describe_members(system),
    }

    def add(name: str, dims: tuple[str, ...], values: Array, units: str, long_name: str) -> None:
        variables[name] = (dims, values, {"units": units, "long_name": long_name})

    def of_each(name: str, dims: tuple[str, ...], values: Array, units: str, long_name: str) -> None:
        """Add a variable of agents and one of targets; long_name names whose with {}."""
        for kind, own in (("agent", values[:, :N]), ("target", values[:, N:])):
            add(f"{kind}_{name}", ("time", kind, *dims), own, units, long_name.format(f"each {kind}"))

    def padded(values: Array) -> Array:
        """NaN in what a vehicle has no coordinate for."""
        return np.where(has, values, np.nan)

    body = ("time", "agent", "axis")
    add("agent_position", body, padded(log.positions)[:, :N], "m", "controlled position of each agent")
    add("target_position", ("time", "target", "axis"), padded(log.positions)[:, N:], "m", "position of each target")
    add("harmonic_extension", body, errors.harmonic_extension, "m", "q*, the harmonic extension of the targets")
    linked = bool(delivery.edges)
    eta = disagreement(system.law, log.positions) if linked else log.residual

    def of_present(values: Array) -> Array:
        """Of agents, padded; NaN in those that are absent."""
        return np.where(team.present[:, None], padded(values)[:, :N], np.nan)

    size = np.linalg.norm(eta[:, :N], axis=2)
    add("disagreement", ("time", "agent"), np.where(team.present, size, np.nan), "m",
        "|eta_i|, norm of the disagreement")  # fmt: skip
    add("disagreement_vector", body, of_present(eta), "m",
        "eta_i, the disagreement" + (", the true one" if linked else ", as the law had it"))  # fmt: skip
    if linked:
        add("measured_disagreement_vector", body, of_present(log.residual), "m",
            "eta_i by what was heard, as the law had it")  # fmt: skip
        kinds, names = zip(*delivery.edges, strict=True)
        coordinates["edge"] = _labels("edge", list(names), "edge that has a link")
        coordinates["edge_kind"] = _labels("edge", list(kinds), "communication or sensing")
        edges = len(team.communication) + len(team.sensing)
        arrived = edges - log.heard.shape[1] + (log.heard == NEW).sum(axis=1)
        add("arrival", ("time",), arrived / max(edges, 1), "1", "share of all edges by which a new measurement arrives")
        add("delivery", ("edge",), delivery.share, "1", "share of an edge's measurements that arrived, so far")
    if linked or system.law.links.record:
        _add_heard(variables, coordinates, trajectory, delivery)
    add("tracking_error", ("time", "agent"), errors.tracking, "m", "|q*_i - q_i|")
    add("velocity_command", body, padded(log.command)[:, :N], "m s-1",
        "commanded velocity relative to the medium, limited: -k1 eta_i and terms, or of a law in Python")  # fmt: skip
    add("formation_error", ("time",), errors.formation_rms(), "m", "RMS residual over the edges inside formations")
    add("centering_error", ("time",), errors.largest_centering(), "m",
        "largest distance of a group's centroid from where its formation wants it")  # fmt: skip
    groups = [f.name for f in team.formations]
    if groups:
        coordinates["formation"] = _labels("formation", groups, "formation group")
        by_group = ("time", "formation")
        add("group_formation_error", by_group, np.column_stack([errors.formation_rms(g) for g in groups]), "m",
            "RMS residual over the edges of a group")  # fmt: skip
        add("group_centering_error", by_group, np.column_stack([errors.centering[g] for g in groups]), "m",
            "distance of each centroid from its place: target's projection plus mean displacement")  # fmt: skip
    bodies = bool(len(log.origin))
    of_each("velocity", ("axis",), log.velocity if bodies else padded(log.velocity), "m s-1",
            "velocity over ground of {}" + ("'s body" if bodies else ""))  # fmt: skip
    of_each("flow", ("axis",), padded(log.medium), "m s-1", "velocity of flow and disturbance about {}")
    of_each("separation", (), separations(log.origin if bodies else log.positions), "m",
            "distance from {} to the nearest other vehicle")  # fmt: skip
    if bodies:
        _add_body_data(variables, coordinates, system, log)
        of_each("body_position", ("axis",), log.origin, "m", "position of {}'s body, its origin")
        of_each("height", (), log.origin[..., 2], "m", "z of {}'s body")
        of_each("orientation", ("quaternion",), log.quaternions, "1", "attitude of {}, body to world")
        of_each("saturation", (), log.saturation, "1", "share of {}'s thrusters at a limit")
    else:
        used = np.arange(log.inputs.shape[2]) < system.effectiveness.inputs[:, None]
        add("command", ("time", "agent", "channel"), np.where(used, log.inputs, np.nan), "1",
            "u_i = g_i^+ times the velocity command, control input of each agent")  # fmt: skip
    return xr.Dataset(variables, coordinates)


def _labels(dimension: str, names: list[str], long_name: str) -> Variable:
    return dimension, np.array(names, dtype=object), {"long_name": long_name}


def _describe_members(system: System) -> dict[str, Variable]:
    """Return the group, vehicle and kind of every agent and target, as coordinates to group by.

    A coordinate's name is unique in a dataset, so that those of targets begin with `target_`.
    """
    team = system.team
    agents = len(team.agents)
    groups = {member: formation.name for formation in team.formations for member in formation.members}
    tracked: dict[str, str] = {}
    for formation in team.formations:
        if formation.about is not None:
            tracked.setdefault(formation.about, formation.name)
    vehicles = [PurePath(name).stem for name in system.bodies.vehicle]
    kinds = _kinds_of(system)
    found: dict[str, Variable] = {}
    for prefix, kind, rows, of in (("", "agent", slice(0, agents), groups),
                                   ("target_", "target", slice(agents, None), tracked)):  # fmt: skip
        members = team.members[rows]
        belonging = "group of each agent" if kind == "agent" else "first group about each target"
        named = {
            "group": ([of.get(member.id, "") for member in members], f"{belonging}, empty without one"),
            "vehicle": (vehicles[rows], f"vehicle of each {kind}; on ideal kinematics the one that it stands for"),
            "kind": (kinds[rows], f"surface, aerial or underwater: where each {kind} moves"),
        }
        for name, (labels, long_name) in named.items():
            found[f"{prefix}{name}"] = _labels(kind, labels, long_name)
    return found


def _kinds_of(system: System) -> list[str]:
    """Return `surface` for a vehicle in the plane, `underwater` for one that starts below the water, else `aerial`."""
    bodies = system.bodies
    under = (system.initial[:, 2] < bodies.surface_height) & (bodies.surface == "water")
    spatial = np.where(under, "underwater", "aerial")
    planar = np.array([member.dimension == 2 for member in system.team.members])
    return [str(kind) for kind in np.where(planar, "surface", spatial)]


def law_of(system: System) -> str:
    """Name the compiled law of a system: the paper's, and the terms that it has in addition."""
    terms = system.law.terms.names
    return f"paper's law with {' and '.join(terms)}" if terms else "paper's law"


def _attributes(system: System, backend: str, seed: int) -> dict[str, Any]:
    """What result.nc says about a run, its status left open."""
    team = system.team
    return {
        "Conventions": "CF-1.11",
        "title": f"mjsheaf run of scenario {system.name}",
        "source": f"mjsheaf {__version__}",
        "scenario": system.name,
        "backend": backend,
        **({"engine": system.bodies.engine} if backend == "physics" and system.bodies.engine != "mujoco" else {}),
        "status": "",
        "message": "",
        "free_directions": "; ".join(describe_null_modes(team.remaining)),
        "seed": seed,
        "law": law_of(system),
        "gain": system.gain,
        "control_period": 0.0 if system.grid.continuous else system.grid.period,
        "groups": json.dumps(
            {f.name: {"members": list(f.members), "about": f.about or ""} for f in team.formations}, sort_keys=True
        ),
    }


def _add_heard(
    variables: dict[str, Variable], coordinates: dict[str, Variable], trajectory: Trajectory, delivery: Delivery
) -> None:
    """What each edge heard, and where they are recorded its measurements as delivered.

    They are NaN where nothing was heard, or an edge is not there.
    """
    system, log = trajectory.system, trajectory.log
    first, T = system.law.edges.first, len(log.positions)
    own = [key for key, _ in labelled_edges(system)]
    number = {key: e for e, key in enumerate(delivery.sizes)}
    heard = np.full((T, len(number)), SILENT, dtype=np.int8)
    heard[:, [number[key] for key in own]] = NEW
    heard[:, [number[own[e]] for e in system.law.links.table["edge"]]] = log.heard
    coordinates["measuring_edge"] = _labels("measuring_edge", [" ".join(key) for key in number], "edge")
    variables["heard"] = (
        ("time", "measuring_edge"),
        heard,
        {"units": "1", "long_name": "what an edge heard: 0 nothing, 1 the last measurement held, 2 a new one"},
    )
    if not system.law.links.record:
        return
    begin = np.cumsum([0, *delivery.sizes.values()])
    measured = np.full((T, begin[-1]), np.nan)
    for e, key in enumerate(own):
        k = number[key]
        y = log.measurements[:, first[e] : first[e + 1]]
        measured[:, begin[k] : begin[k + 1]] = np.where(heard[:, [k]] == SILENT, np.nan, y)
    rows = [f"{kind} {name} {r}" for (kind, name), m in delivery.sizes.items() for r in range(m)]
    coordinates["measured_number"] = _labels("measured_number", rows, "edge, and number in its stalk")
    variables["measurement"] = (
        ("time", "measured_number"),
        measured,
        {"units": "m", "long_name": "y_e = F_head x_head - F_tail x_tail as delivered; NaN where nothing was heard"},
    )


def _add_body_data(variables: dict[str, Variable], coordinates: dict[str, Variable], system: System, log: Log) -> None:
    """Thruster commands and what lags leave of them."""
    N, T = len(system.team.agents), len(log.positions)
    thrusters = [[channel.name for channel in vehicle.channels] for vehicle in system.vehicles]
    units = [[channel.unit for channel in vehicle.channels] for vehicle in system.vehicles]
    width = max(len(names) for names in thrusters)
    has = np.arange(width) < np.array([len(names) for names in thrusters])[:, None]
    # Of turning thrusters some channels are angles: see thruster_unit.
    unit = "N" if all(name == "N" for names in units for name in names) else "1"
    for agents, targets, values, long_name in (
        ("command", "target_command", log.thruster_command,
         "u_i = W_i^+ [force; moment] + trim, thruster commands of {}"),
        ("agent_thrust", "target_thrust", log.thruster_output,
         "what {}'s thrusters do at the sample: their commands after lag"),
    ):  # fmt: skip
        u = np.full((T, *has.shape), np.nan)
        u[:, has] = values
        for key, kind, own in ((agents, "agent", u[:, :N]), (targets, "target", u[:, N:])):
            attributes = {"units": unit, "long_name": long_name.format(f"each {kind}")}
            variables[key] = (("time", kind, "channel"), own, attributes)
    coordinates["quaternion"] = _labels("quaternion", ["w", "x", "y", "z"], "component of the unit quaternion")
    for name, values_of, what in (("thruster", thrusters, "thruster behind"), ("thruster_unit", units, "unit of")):
        labels = np.array([values + [""] * (width - len(values)) for values in values_of], dtype=object)
        for key, kind, own in ((name, "agent", labels[:N]), (f"target_{name}", "target", labels[N:])):
            long_name = f"{what} each channel of each {kind}, empty where it has fewer"
            coordinates[key] = ((kind, "channel"), own, {"long_name": long_name})
