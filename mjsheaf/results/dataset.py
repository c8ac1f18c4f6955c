"""A run as an xarray Dataset with CF attributes, the contents of result.nc.

Every variable and every coordinate is one entry of a list. An entry has a name, dimensions, a unit, a meaning, the runs
that have it, and a function that reads it from samples. The lists define result.nc, the data of every other sink, and
the reference page (docs/_ext/fields.py).
"""

import json
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, field
from functools import cached_property
from numbers import Integral
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf._version import __version__
from mjsheaf.arrays import Array, IntArray
from mjsheaf.law.edges import NEW, SILENT
from mjsheaf.law.law import disagreement, with_ramp
from mjsheaf.law.safety import CAUSE, CORRECTION, VIOLATION
from mjsheaf.law.terms import traffic_of
from mjsheaf.loop.engine import READERS, Log, Trajectory
from mjsheaf.loop.system import Phase, System
from mjsheaf.results.metrics import Errors, clearances, evaluate_errors, lengths, separations
from mjsheaf.team import Edge
from mjsheaf.team.team import Path

Key = tuple[str, str]
"""Kind and name of an edge, such as ('sensing', 'A1-T1')."""


@dataclass
class Samples:
    """Samples of a run under one system, the source of all variables.

    Attributes:
        trajectory: Recorded samples.
        delivery: Edges of the run, and the fraction of their measurements that have arrived up to these samples.
        path: q* up to these samples.
    """

    trajectory: "Trajectory"
    delivery: "Delivery"
    path: Path = field(default_factory=Path)
    _known: dict[Any, NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.system: System = self.trajectory.system
        self.log: Log = self.trajectory.log
        self.team = self.system.team
        self.agents = len(self.team.agents)
        self.linked: list[Key] = self.delivery.edges
        self.positions: Array = self.log.positions

    @property
    def on_bodies(self) -> bool:
        """True on bodies, False on ideal kinematics."""
        return bool(len(self.log.origin))

    def of_present(self, values: Array) -> Array:
        """Return values of agents (T, N, 3), NaN where one is absent or lacks the coordinate."""
        return np.where(self.team.present[:, None], self.padded(values)[:, : self.agents], np.nan)

    def padded(self, values: Array) -> Array:
        """Return values (T, V, 3), NaN if a vehicle lacks the coordinate."""
        dimensions = np.array([[member.dimension] for member in self.team.members])
        return np.where(np.arange(3) < dimensions, values, np.nan)

    @cached_property
    def errors(self) -> Errors:
        """Errors of the team."""
        return evaluate_errors(self.team, self.positions, self.path, self.trajectory.time)

    @cached_property
    def eta(self) -> Array:
        """True disagreement of the agents, padded, shape (T, V, 3), m."""
        if not self.linked:
            return self.log.residual
        return disagreement(with_ramp(self.system.law, self.team), self.positions, self.trajectory.time)

    @cached_property
    def own_edges(self) -> list[Key]:
        """Edges of the present phase in the order of the law."""
        return [key for key, _ in labelled_edges(self.system)]

    @cached_property
    def columns(self) -> dict[Key, int]:
        """Number of each edge of the run."""
        return {key: e for e, key in enumerate(self.delivery.sizes)}

    @cached_property
    def heard(self) -> NDArray[np.int8]:
        """Measurement that each edge of the run received: 0 none, 1 the last one held, 2 a new one, (T, edges)."""
        heard = np.full((len(self.positions), len(self.columns)), SILENT, dtype=np.int8)
        heard[:, [self.columns[key] for key in self.own_edges]] = NEW
        linked = [self.columns[self.own_edges[e]] for e in self.system.law.links.table["edge"]]
        heard[:, linked] = self.log.heard
        return heard

    @cached_property
    def measurements(self) -> Array:
        """Measurements of all edges as delivered, shape (T, m), m; NaN if none was received."""
        first = self.system.law.edges.first
        begin = np.cumsum([0, *self.delivery.sizes.values()])
        found = np.full((len(self.positions), begin[-1]), np.nan)
        for e, key in enumerate(self.own_edges):
            k = self.columns[key]
            y = self.log.measurements[:, first[e] : first[e + 1]]
            found[:, begin[k] : begin[k + 1]] = np.where(self.heard[:, [k]] == SILENT, np.nan, y)
        return found

    @cached_property
    def arrival(self) -> Array:
        """Fraction of all edges that receive a new measurement, shape (T,)."""
        edges = len(self.own_edges)
        arrived = edges - self.log.heard.shape[1] + (self.log.heard == NEW).sum(axis=1)
        return np.asarray(arrived / max(edges, 1))

    @cached_property
    def clearances(self) -> Array:
        """Smallest distance minus the required one over all pairs, shape (T,), m."""
        system = self.system
        safety = system.separation(np.zeros(len(system.planar)))
        places = self.log.origin if self.on_bodies else self.positions + safety.lift
        return clearances(safety, self.trajectory.time, places)

    @cached_property
    def channels(self) -> list[list[Any]]:
        """Channels of each vehicle's thrusters."""
        return [list(vehicle.channels) for vehicle in self.system.vehicles]

    def by_channel(self, values: Array) -> Array:
        """Return values of all actuators (T, A) by vehicle, NaN where one has fewer, shape (T, V, channels)."""
        counts = np.array([len(own) for own in self.channels])
        has = np.arange(counts.max()) < counts[:, None]
        found = np.full((len(self.positions), *has.shape), np.nan)
        found[:, has] = values
        return found

    def channel_labels(self, field: str) -> NDArray[Any]:
        """Return a field of each vehicle's channels, empty if it has fewer, shape (V, channels)."""
        width = max(len(own) for own in self.channels)
        rows = [[getattr(channel, field) for channel in own] + [""] * (width - len(own)) for own in self.channels]
        return np.array(rows, dtype=object)

    def read(self, entry: "Variable") -> NDArray[Any]:
        """Return the values of an entry at all samples."""
        if entry.values not in self._known:
            found = entry.values(self)
            self._known[entry.values] = found if isinstance(found, np.ndarray) else np.array(found, dtype=object)
        values = self._known[entry.values]
        if entry.rows is None:
            return values
        rows = slice(0, self.agents) if entry.rows == "agent" else slice(self.agents, None)
        return values[:, rows] if entry.dimensions[0] == "time" else values[rows]

    def recorded(self, name: str) -> Array:
        """Return what one of the READERS wrote, shape (T, V, width)."""
        return self.log.extra[list(READERS).index(name)].values


def labelled_edges(system: "System") -> list[tuple[Key, Edge]]:
    """Return the edges of communication and sensing in the order of the law: kind and name, such as 'A1-A2', and edge.

    The second of several edges between the same ends is 'A1-A2-2'.
    """
    met: dict[Key, int] = {}
    found = []
    for kind, edges in (("communication", system.team.communication), ("sensing", system.team.sensing)):
        for edge in edges:
            key = kind, f"{edge.tail}-{edge.head}"
            met[key] = met.get(key, 0) + 1
            found.append(((kind, key[1] + (f"-{met[key]}" if met[key] > 1 else "")), edge))
    return found


class Variable(NamedTuple):
    """A recorded variable, or a coordinate.

    Attributes:
        name: Its name in result.nc.
        dimensions: Names of its dimensions.
        unit: Unit in CF notation, or a function of samples; empty for labels.
        long_name: Meaning of the variable.
        values: Function that reads it from samples.
        where: Function that returns True if a run has it, with the same result for all pieces of a run.
        present: Description of `where` for the reference page.
        rows: 'agent' or 'target' if `values` returns both, agents first; None if it returns the recorded values.
    """

    name: str
    dimensions: tuple[str, ...]
    unit: str | Callable[[Samples], str]
    long_name: str
    values: Callable[[Samples], Any]
    where: Callable[[Samples], bool] = lambda _: True
    present: str = ""
    rows: str | None = None

    def attributes(self, samples: Samples) -> dict[str, str]:
        """Return its attributes in result.nc."""
        unit = self.unit if isinstance(self.unit, str) else self.unit(samples)
        return {**({"units": unit} if unit else {}), "long_name": self.long_name}


def of_each(
    name: str,
    dimensions: tuple[str, ...],
    unit: str | Callable[[Samples], str],
    long_name: str,
    values: Callable[[Samples], Any],
    **options: Any,
) -> list[Variable]:
    """Return an entry for agents and one for targets; {} in name and long_name stands for 'agent' or 'target'."""
    found = []
    for kind in ("agent", "target"):
        own = tuple(dimension.format(kind) for dimension in dimensions)
        found.append(Variable(name.format(kind), own, unit, long_name.format(kind), values, rows=kind, **options))
    return found


def _renamed(pair: list[Variable], agents: str) -> list[Variable]:
    """Return a pair of entries with another name for the agents' one."""
    return [pair[0]._replace(name=agents), pair[1]]


_BODY = ("time", "agent", "axis")
_EACH = ("time", "{}")
_BODIES: dict[str, Any] = {"where": lambda s: s.on_bodies, "present": "on bodies"}
_IDEAL: dict[str, Any] = {"where": lambda s: not s.on_bodies, "present": "on ideal kinematics"}
_LINKED: dict[str, Any] = {"where": lambda s: bool(s.linked), "present": "over links"}
_PLAIN: dict[str, Any] = {"where": lambda s: not s.linked, "present": "without links"}
_BACKEND_WORDS = {"physics": _BODIES["present"], "ideal": _IDEAL["present"]}
_GROUPED: dict[str, Any] = {"where": lambda s: bool(s.team.formations), "present": "with formations"}
_HEARD: dict[str, Any] = {
    "where": lambda s: bool(s.linked) or s.system.law.links.record,
    "present": "over links, or with `links.record`",
}
_SAFE: dict[str, Any] = {"where": lambda s: s.system.safety is not None, "present": "with `safety`"}
_RECORD: dict[str, Any] = {"where": lambda s: s.system.law.links.record, "present": "with `links.record`"}


def _thruster_unit(samples: Samples) -> str:
    """Return N, or 1 if some channels are angles; see the coordinate thruster_unit."""
    return "N" if all(channel.unit == "N" for own in samples.channels for channel in own) else "1"


def _positions(samples: Samples) -> Array:
    """Return the controlled positions; NaN if a vehicle lacks the coordinate."""
    return samples.padded(samples.positions)


VARIABLES: list[Variable] = [
    Variable("agent_position", _BODY, "m", "controlled position of each agent", _positions, rows="agent"),
    Variable("target_position", ("time", "target", "axis"), "m", "position of each target", _positions, rows="target"),
    Variable("harmonic_extension", _BODY, "m", "q*, the harmonic extension of the targets",
             lambda s: s.errors.harmonic_extension),
    Variable("disagreement", ("time", "agent"), "m", "|eta_i|, norm of the disagreement",
             lambda s: np.where(s.team.present, lengths(s.eta[:, : s.agents]), np.nan)),
    Variable("disagreement_vector", _BODY, "m", "eta_i, the disagreement, the true one",
             lambda s: s.of_present(s.eta), **_LINKED),
    Variable("disagreement_vector", _BODY, "m", "eta_i, the disagreement, as the law had it",
             lambda s: s.of_present(s.eta), **_PLAIN),
    Variable("measured_disagreement_vector", _BODY, "m", "eta_i from the measurements that the law received",
             lambda s: s.of_present(s.log.residual), **_LINKED),
    Variable("arrival", ("time",), "1", "fraction of all edges that receive a new measurement",
             lambda s: s.arrival, **_LINKED),
    Variable("delivery", ("edge",), "1", "fraction of an edge's measurements that arrived until now",
             lambda s: s.delivery.share, **_LINKED),
    Variable("heard", ("time", "measuring_edge"), "1",
             "measurement of an edge: 0 none, 1 the last one held, 2 a new one", lambda s: s.heard, **_HEARD),
    Variable("measurement", ("time", "measured_number"), "m",
             "y_e = F_head x_head - F_tail x_tail as delivered; NaN without a measurement",
             lambda s: s.measurements, **_RECORD),
    Variable("tracking_error", ("time", "agent"), "m", "|q*_i - q_i|", lambda s: s.errors.tracking),
    Variable("velocity_command", _BODY, "m s-1",
             "commanded velocity relative to the medium, limited: -k1 eta_i and terms, or of a law in Python",
             lambda s: s.padded(s.log.command)[:, : s.agents]),
    Variable("formation_error", ("time",), "m", "RMS residual over the edges inside formations",
             lambda s: s.errors.formation_rms()),
    Variable("centering_error", ("time",), "m",
             "largest distance of a group's centroid from its desired position",
             lambda s: s.errors.largest_centering()),
    Variable("group_formation_error", ("time", "formation"), "m", "RMS residual over the edges of a group",
             lambda s: np.column_stack([s.errors.formation_rms(f.name) for f in s.team.formations]), **_GROUPED),
    Variable("group_centering_error", ("time", "formation"), "m",
             "distance of each centroid from its place: target's projection plus mean displacement",
             lambda s: np.column_stack([s.errors.centering[f.name] for f in s.team.formations]), **_GROUPED),
    *of_each("{}_velocity", ("time", "{}", "axis"), "m s-1", "velocity over ground of each {}'s body",
             lambda s: s.log.velocity, **_BODIES),
    *of_each("{}_velocity", ("time", "{}", "axis"), "m s-1", "velocity over ground of each {}",
             lambda s: s.padded(s.log.velocity), **_IDEAL),
    *of_each("{}_flow", ("time", "{}", "axis"), "m s-1", "velocity of flow and disturbance about each {}",
             lambda s: s.padded(s.log.medium)),
    *of_each("{}_separation", _EACH, "m", "distance from each {} to the nearest other vehicle",
             lambda s: separations(s.log.origin if s.on_bodies else s.positions)),
    Variable("separation", ("time",), "m",
             "smallest distance minus the required one, over all pairs with an agent, and obstacles",
             lambda s: s.clearances, **_SAFE),
    Variable("safety_correction", ("time", "agent"), "m s-1",
             "by how much the filter that keeps vehicles apart changed each agent's limited command",
             lambda s: s.log.safety[:, : s.agents, CORRECTION], **_SAFE),
    Variable("safety_cause", ("time", "agent"), "1",
             "vehicle or obstacle whose constraint the law's command violated most: 0 none, 1 the first agent, then "
             "agents, targets and obstacles in order",
             lambda s: s.log.safety[:, : s.agents, CAUSE].astype(np.int64), **_SAFE),
    Variable("safety_violation", ("time", "agent"), "m s-1",
             "violation that had to be accepted, as the constraints of an agent contradict one another",
             lambda s: s.log.safety[:, : s.agents, VIOLATION], **_SAFE),
    *_renamed(of_each("{}_command", ("time", "{}", "channel"), _thruster_unit,
                      "u_i = W_i^+ [force; moment] + trim, thruster commands of each {}",
                      lambda s: s.by_channel(s.log.thruster_command), **_BODIES), "command"),
    *of_each("{}_thrust", ("time", "{}", "channel"), _thruster_unit,
             "what each {}'s thrusters do at the sample: their commands after lag",
             lambda s: s.by_channel(s.log.thruster_output), **_BODIES),
    *of_each("{}_body_position", ("time", "{}", "axis"), "m", "position of each {}'s body, its origin",
             lambda s: s.log.origin, **_BODIES),
    *of_each("{}_height", _EACH, "m", "z of each {}'s body", lambda s: s.log.origin[..., 2], **_BODIES),
    *of_each("{}_orientation", ("time", "{}", "quaternion"), "1", "attitude of each {}, body to world",
             lambda s: s.log.quaternions, **_BODIES),
    *of_each("{}_saturation", _EACH, "1", "fraction of each {}'s thrusters at a limit",
             lambda s: s.log.saturation, **_BODIES),
    Variable("command", ("time", "agent", "channel"), "1",
             "u_i = g_i^+ times the velocity command, control input of each agent",
             lambda s: np.where(np.arange(s.log.inputs.shape[2]) < s.system.effectiveness.inputs[:, None],
                                s.log.inputs, np.nan), **_IDEAL),
]  # fmt: skip
"""All recorded variables, in the order of result.nc. To record one more, add an entry."""


def _groups(samples: Samples) -> list[str]:
    """Return the group of each agent and the first group about each target, empty without one."""
    groups = {member: formation.name for formation in samples.team.formations for member in formation.members}
    for formation in samples.team.formations:
        groups.setdefault(formation.about or "", formation.name)
    return [groups.get(member.id, "") for member in samples.team.members]


def _kinds(samples: Samples) -> list[str]:
    """Return `surface` for a vehicle in the plane, `underwater` for one that starts below the water, else `aerial`."""
    bodies = samples.system.bodies
    under = (samples.system.initial[:, 2] < bodies.surface_height) & (bodies.surface == "water")
    spatial = np.where(under, "underwater", "aerial")
    planar = np.array([member.dimension == 2 for member in samples.team.members])
    return [str(kind) for kind in np.where(planar, "surface", spatial)]


def _of_members(kind: str, prefix: str, belonging: str) -> list[Variable]:
    """Return the group, vehicle and kind of every agent or target; names are unique in a dataset."""
    options: dict[str, Any] = {"rows": kind}
    return [
        Variable(f"{prefix}group", (kind,), "", f"{belonging}, empty without one", _groups, **options),
        Variable(f"{prefix}vehicle", (kind,), "",
                 f"vehicle of each {kind}; on ideal kinematics the one that it stands for",
                 lambda s: [PurePath(name).stem for name in s.system.bodies.vehicle], **options),
        Variable(f"{prefix}kind", (kind,), "",
                 f"surface, aerial or underwater: where each {kind} moves", _kinds, **options),
    ]  # fmt: skip


def _of_channels(name: str, what: str, of: str) -> list[Variable]:
    """Return entries for a field of each channel of the thrusters."""
    pair = of_each("{}_" + name, ("{}", "channel"), "", f"{what} each channel of each {{}}, empty where it has fewer",
                   lambda s: s.channel_labels(of), **_BODIES)  # fmt: skip
    return _renamed(pair, name)


COORDINATES: list[Variable] = [
    Variable("agent", ("agent",), "", "agent", lambda s: s.team.agent_ids),
    Variable("target", ("target",), "", "target", lambda s: s.team.target_ids),
    Variable("axis", ("axis",), "", "axis of the world frame", lambda _: ["x", "y", "z"]),
    *_of_members("agent", "", "group of each agent"),
    *_of_members("target", "target_", "first group about each target"),
    Variable("edge", ("edge",), "", "edge that has a link", lambda s: [name for _, name in s.linked], **_LINKED),
    Variable("edge_kind", ("edge",), "", "communication or sensing", lambda s: [kind for kind, _ in s.linked],
             **_LINKED),
    Variable("measuring_edge", ("measuring_edge",), "", "edge", lambda s: [" ".join(key) for key in s.delivery.sizes],
             **_HEARD),
    Variable("measured_number", ("measured_number",), "", "edge, and number in its stalk",
             lambda s: [f"{' '.join(key)} {r}" for key, m in s.delivery.sizes.items() for r in range(m)], **_RECORD),
    Variable("formation", ("formation",), "", "formation group", lambda s: [f.name for f in s.team.formations],
             **_GROUPED),
    Variable("quaternion", ("quaternion",), "", "component of the unit quaternion",
             lambda _: ["w", "x", "y", "z"], **_BODIES),
    *_of_channels("thruster", "thruster behind", "name"),
    *_of_channels("thruster_unit", "unit of", "unit"),
]  # fmt: skip
"""All coordinates but `time` and `phase`, which number the samples."""


_ATTRIBUTES = {"backend": str, "status": str, "message": str, "exchange_rounds": Integral, "numbers_sent": Integral}


def fault_of(dataset: xr.Dataset) -> str:
    """Describe why a dataset is not that of a run, such as 'has no agent_flow'; empty if it is one."""
    for name, kind in _ATTRIBUTES.items():
        if not isinstance(dataset.attrs.get(name), kind):
            return f"has no attribute {name}" if name not in dataset.attrs else f"has a wrong attribute {name}"
    if dataset.attrs["backend"] not in _BACKEND_WORDS:
        return f"has the backend {dataset.attrs['backend']!r}"
    time = Variable("time", ("time",), "s", "time", lambda s: s.trajectory.time)
    phase = Variable("phase", ("time",), "1", "phase", lambda s: s.trajectory.time)
    entries = [time, phase, *COORDINATES, *VARIABLES]
    names = [entry.name for entry in entries]
    expected = {"", _BACKEND_WORDS[dataset.attrs["backend"]]}
    # What is present under one condition is present together.
    expected |= {entry.present for entry in entries if entry.name in dataset.variables and names.count(entry.name) == 1}
    for entry in entries:
        if entry.name in dataset.variables:
            found = dataset.variables[entry.name]
            if found.dims != entry.dimensions:
                over = ", ".join(entry.dimensions)
                return f"has {entry.name} over ({', '.join(map(str, found.dims))}) and not ({over})"
            if entry.unit and found.dtype.kind not in "fiu":
                return f"has {entry.name} of the type {found.dtype} and not of numbers"
        elif entry.present in expected:
            return f"has no {entry.name}"
    if not dataset.sizes["time"]:
        return "has no samples"
    return "has not three axes" if dataset.sizes["axis"] != 3 else ""


Coordinate = tuple[str | tuple[str, ...], NDArray[Any], dict[str, Any]]
"""Dimensions, values and attributes, in the form that xarray expects."""


def make_datasets(
    pieces: Iterable[Trajectory],
    backend: str,
    seed: int,
    phases: Sequence[Phase] = (),
    first: int = 0,
    path: Path | None = None,
    only: Collection[str] | None = None,
) -> Iterator[xr.Dataset]:
    """Collect a trajectory in pieces.

    Each is a Dataset over the dimensions time, agent, target and axis; docs/reference/results.md lists the variables.
    Attributes give the scenario, backend, status and groups.

    The last piece has the run's status, the communication between agents (see `terms.traffic_of`) and the fraction of
    measurements that arrived. `phases` determine the phase of each sample and the edges that have a link at some time;
    a run of one phase does not need them. `first` is the number of the first sample in the run, and `path` has q* up to
    there. In each phase q* begins anew. `only` names the variables to collect, without labels; all unless given.
    """
    attributes: dict[str, Any] = {}
    delivery: Delivery | None = None
    traffic = np.zeros(3, dtype=np.int64)
    done = first
    path = path or Path()
    starts = {phase.start for phase in phases}
    for piece in pieces:
        if done in starts:
            path.last = path.held = path.solver = None
            path.moving = True
        attributes = attributes or _attributes(piece.system, backend, seed, phases)
        delivery = delivery or Delivery([phase.system for phase in phases] or [piece.system])
        delivery.add(piece)
        samples = np.arange(done, done + len(piece.time))
        done += len(piece.time)
        read_from = Samples(piece, delivery, path)
        dataset = gather(read_from, _number_phases(phases or [Phase(0, piece.system)], samples), only)
        traffic += len(piece.time) * np.array(astuple(traffic_of(piece.system.law.terms, piece.system.team)))
        dataset.attrs = attributes | {"status": piece.status, "message": piece.message}
        dataset.attrs |= dict(zip(("exchange_rounds", "messages", "numbers_sent"), traffic.tolist(), strict=True))
        yield dataset


def join(pieces: Iterable[xr.Dataset]) -> xr.Dataset:
    """Join the datasets of a run's pieces."""
    parts = list(pieces)
    if len(parts) == 1:
        return parts[0]
    first, last = parts[0], parts[-1]
    variables: dict[Any, Any] = {}
    for name, variable in first.variables.items():  # equal except for `time`; xarray would check this slowly
        if "time" in variable.dims:
            values = np.concatenate([part.variables[name].values for part in parts], variable.dims.index("time"))
            variables[name] = variable.dims, values, variable.attrs, variable.encoding
        else:
            variables[name] = (last if name == "delivery" else first).variables[name]
    coordinates = {name: variables.pop(name) for name in first.coords}
    return xr.Dataset(variables, coordinates, last.attrs)


def in_pieces(pieces: Iterable[xr.Dataset], samples: int) -> Iterator[xr.Dataset]:
    """Split a run into pieces of `samples` samples, except for the last, for any lengths of the given pieces."""
    held: list[xr.Dataset] = []
    for piece in pieces:
        held.append(piece)
        while sum(part.sizes["time"] for part in held) > samples:
            whole = join(held)
            yield whole.isel(time=slice(0, samples))
            held = [whole.isel(time=slice(samples, None))]
    yield join(held)


def _number_phases(phases: Sequence[Phase], samples: IntArray) -> Coordinate:
    """Return the coordinate `phase` of samples: the number of each one's phase, and the start of each phase.

    `flag_values` and `flag_meanings` follow CF: numbers, and words without blanks. `events` has the original words as a
    JSON list of lists.
    """
    number = np.searchsorted([phase.start for phase in phases], samples, side="right") - 1
    meanings = [re.sub(r"[^\w.+@-]+", "_", phase.name).strip("_") for phase in phases]
    several = len(phases) > 1  # files return an array of one number as a number
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


def of_phase(run: System | Sequence[Phase], dataset: xr.Dataset, which: int) -> tuple[System, xr.Dataset]:
    """Return the system of one phase of a run and its samples, both restricted to the present agents.

    Without events, this is the whole run.

    Args:
        run: System of the run, or its phases.
        dataset: Data of the run.
        which: Number of the phase; -1 is the last phase that the run reached.
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
    """Fraction of measurements that arrive over the links of a run, counted piece by piece.

    Attributes:
        edges: Kind and name of the edges that have a link in some phase, in order.
        sizes: Number of components that each communication or sensing edge measures, with or without a link.
        share: Fraction of possible new measurements that arrived, shape (L,). Phases without the link count as 1; NaN
            if none was possible.
    """

    def __init__(self, systems: Sequence[System]) -> None:
        """Start counting in a run under these systems."""
        self.sizes: dict[Key, int] = {}
        self._new: dict[Key, int] = {}
        for system in systems:
            labelled = labelled_edges(system)
            self.sizes |= {key: len(edge.b) for key, edge in labelled}
            self._new |= dict.fromkeys((labelled[e][0] for e in system.law.links.table["edge"]), 0)
        self.edges = list(self._new)
        self._due = self._new.copy()
        self._under_way: dict[Key, int] = {}  # number of samples since each link appeared, up to its delay

    @property
    def share(self) -> Array:
        """Fraction of measurements that arrived, shape (L,); see the class."""
        return np.array([self._new[key] / due if due else np.nan for key, due in self._due.items()])

    def add(self, piece: Trajectory) -> None:
        """Count the measurements of a piece."""
        T = len(piece.time)
        keys = [key for key, _ in labelled_edges(piece.system)]
        arrived = dict.fromkeys(keys, T)
        under_way: dict[Key, int] = {}
        news = (piece.log.heard == NEW).sum(axis=0).tolist()
        for link, new in zip(piece.system.law.links.table, news, strict=True):
            key = keys[link["edge"]]
            arrived[key] = new
            under_way[key] = min(self._under_way.get(key, 0) + T, int(link["delay"]))
        for key in self._new.keys() & arrived.keys():
            self._new[key] += arrived[key]
            self._due[key] += T - max(under_way.get(key, 0) - self._under_way.get(key, 0), 0)
        self._under_way = under_way


def gather(samples: Samples, phase: Coordinate, only: Collection[str] | None = None) -> xr.Dataset:
    """Read a run's variables and coordinates from its samples, or `only` some variables, without labels."""
    time = "time", samples.trajectory.time, {"long_name": "time", "units": "s"}
    # Collected first, because adding variables one by one aligns all of them each time.
    coordinates: dict[str, Coordinate] = {"time": time}
    variables: dict[str, Coordinate] = {}
    chosen = [entry for entry in VARIABLES if only is None or entry.name in only]
    for found, entries in ((coordinates, COORDINATES if only is None else []), (variables, chosen)):
        for entry in entries:
            if entry.where(samples):
                found[entry.name] = entry.dimensions, samples.read(entry), entry.attributes(samples)
    coordinates["phase"] = phase
    return xr.Dataset(variables, coordinates)


def law_of(system: System) -> str:
    """Name the compiled law of a system: the paper's, and the terms that it has in addition."""
    terms = system.law.term_names
    return f"paper's law with {' and '.join(terms)}" if terms else "paper's law"


def _attributes(system: System, backend: str, seed: int, phases: Sequence[Phase]) -> dict[str, Any]:
    """Return the attributes of result.nc except for the status; directions are those that are free in any phase."""
    team = system.team
    free = [words for one in [system, *(phase.system for phase in phases)] for words in one.free_directions]
    events = [{"time": phase.time, "events": list(phase.events)} for phase in phases]
    return {
        "Conventions": "CF-1.11",
        "title": f"mjsheaf run of scenario {system.name}",
        "source": f"mjsheaf {__version__}",
        "scenario": system.name,
        "backend": backend,
        **({"engine": system.bodies.engine} if backend == "physics" and system.bodies.engine != "mujoco" else {}),
        "status": "",
        "message": "",
        "free_directions": "; ".join(dict.fromkeys(free)),
        "seed": seed,
        "law": law_of(system),
        "gain": system.gain,
        "control_period": 0.0 if system.grid.continuous else system.grid.period,
        "groups": json.dumps(
            {f.name: {"members": list(f.members), "about": f.about or ""} for f in team.formations}, sort_keys=True
        ),
        **({"phases": json.dumps(events)} if any(phase.events for phase in phases) else {}),
    }
