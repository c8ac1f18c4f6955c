"""Local information at a sample: the record that laws in Python, environments and viewers read."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.law.law import LawArrays, Memory, link_of, rows_of_measuring_edges
from mjsheaf.law.terms import Traffic
from mjsheaf.sheaf.nonlinear import measure
from mjsheaf.team import Edge, Team


class ReadOnlyTeam(Team):
    """Read-only view of the run's team, passed to a law."""

    def __init__(self, team: Team) -> None:
        """Take over all that a team has; `remaining` is computed anew, because it may be the run's own team."""
        vars(self).update({name: _read_only(value) for name, value in vars(team).items() if name != "remaining"})

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"cannot set {name}: the team that a law is handed is read-only")


def _read_only(value: Any) -> Any:
    """Return views of arrays and mappings that cannot be written, also those of edges, and copies of lists."""
    if isinstance(value, np.ndarray):
        view = value.view()
        view.flags.writeable = False
        return view
    if isinstance(value, dict):
        return MappingProxyType({key: _read_only(one) for key, one in value.items()})
    if isinstance(value, Edge):
        return replace(value, **{field.name: _read_only(getattr(value, field.name)) for field in fields(value)})
    if type(value) in (list, tuple):
        return type(value)(map(_read_only, value))
    return value


class Perceived(NamedTuple):
    """Measurement of an edge; see `Sample`."""

    measurement: Array
    jacobian: Array
    residual: Array


def perceived(edge: Edge, y: Array) -> Perceived:
    """Return what an edge measures where its relative position, less b, is y, shape (m,), m."""
    z = y + edge.b
    if edge.measures == "position" or edge.offset is None:
        return Perceived(y.copy(), np.eye(len(y)), z)
    measured = measure(edge.measures, z)
    residual = measured.h - edge.offset if measured.h.any() else np.zeros_like(measured.h)
    return Perceived(measured.h, measured.J, residual)


class View:
    """Places of the agents' measurements in the memory of a law; each phase of a run has its own.

    Attributes:
        team: The run's team.
        shown: The same, read-only.
        edges: Edges at which agents measure: communication, sensing, anchors; E of them.
        places: Slice of `memory.y` with the numbers of each edge.
        linked: True for each edge that has a link, shape (E,).
        links: Index of each edge with a link in the links' memory.
        neighbours: Indices of the agents that each agent communicates with.
    """

    def __init__(self, team: Team, law: LawArrays) -> None:
        self.team = team
        self.shown = ReadOnlyTeam(team)
        self.edges = self.shown.measuring_edges
        rows = rows_of_measuring_edges(team, law)
        slices = [slice(begin, end) for begin, end in pairwise(law.edges.first)]
        self.places = [slices[row] for row in rows]
        links = np.array([link_of(law, row) for row in rows], dtype=np.int64)
        self.linked = links >= 0
        self.links = links[self.linked]
        near: list[dict[int, None]] = [{} for _ in team.agents]
        for e in team.communication:
            i, j = team.index[e.tail], team.index[e.head]
            near[i][j] = near[j][i] = None
        self.neighbours = [list(js) for js in near]


@dataclass(frozen=True)
class Truth:
    """Quantities that no agent can measure; for debugging, for rewards and for drawing.

    Attributes:
        positions: Positions of agents, then targets, padded, shape (V, 3), m.
        attitude: Quaternions (w, x, y, z) of agents, then targets, body to world, shape (V, 4).
    """

    positions: Array
    attitude: Array
    _team: Team  # the run's own

    @cached_property
    def harmonic_extension(self) -> Array:
        """q*, padded, shape (N, 3), m."""
        return self._team.harmonic_extension(self.positions)


class Sample:
    """Local information of N agents at a sample, with E edges at which they measure.

    Attributes:
        time: Time of the sample, s.
        team: The team, read-only; `team.agent_ids` names the rows of arrays.
        edges: The edges at which agents measure: communication, sensing, anchors.
        measurements: y_e = F_head x_head - F_tail x_tail of each edge, in its stalk, m, as its link delivers it; -b_e
            where nothing is received. Of a range edge the distance, shape (1,), m; of a bearing edge the unit vector
            from tail to head; both zero where nothing is received.
        jacobians: dh/dz of each edge, h what it measures and z = F_head x_head - F_tail x_tail: the identity, of a
            range shape (1, m), of a bearing shape (m, m), 1/m.
        residuals: What measurements lack of the desired ones: y_e + b_e, h - h* of ranges and bearings. By these and
            K the tail's part of its disagreement is -F_tail^T J^T K residual, where K of a bearing has the factor |z|.
        received: True for each edge with a measurement, new or held, shape (E,).
        disagreement: eta by these, padded, shape (N, 3), m.
        command: Velocities relative to the medium that the compiled law commands, padded, shape (N, 3), m/s; under a
            law in Python those that it returned last. What is added from outside is not in them.
        velocity: Velocities over ground, shape (N, 3), m/s: of bodies now, on ideal kinematics the mean since the
            sample before.
        angular_velocity: Angular velocities in body axes, shape (N, 3), rad/s; zero on ideal kinematics.
        displacement: Displacements of the controlled positions since the sample before, zero at the first, shape
            (N, 3), m.
        attitude: Quaternions (w, x, y, z), body to world, shape (N, 4).
        truth: What no agent knows.
    """

    def __init__(
        self,
        view: View,
        time: float,
        positions: Array,
        attitude: Array,
        displacement: Array,
        velocity: Array,
        memory: Memory,
        traffic: Traffic,
    ) -> None:
        N = len(view.team.agents)
        self.time = time
        self.team: Team = view.shown
        self.edges = view.edges
        seen = [perceived(edge, memory.y[place]) for edge, place in zip(view.edges, view.places, strict=True)]
        self.measurements = [one.measurement for one in seen]
        self.jacobians = [one.jacobian for one in seen]
        self.residuals = [one.residual for one in seen]
        self.received = np.ones(len(view.edges), dtype=np.bool_)
        self.received[view.linked] = memory.links.heard[view.links] > 0.0
        self.disagreement = memory.residual[:N].copy()
        self.command = memory.command[:N].copy()
        self.velocity = velocity[:, :3].copy()
        self.angular_velocity = velocity[:, 3:].copy()
        self.displacement = displacement
        self.attitude = attitude[:N].copy()
        self.truth = Truth(positions, attitude, view.team)
        self._view = view
        self._traffic = traffic

    @property
    def heard(self) -> list[bool]:
        """The same as `received`, as a list."""
        return cast(list[bool], self.received.tolist())

    def exchange(self, values: ArrayLike) -> list[dict[str, Array]]:
        """Let every agent send numbers to its neighbours: one round of communication, which is counted.

        Args:
            values: Numbers that each agent sends, shape (N, ...).

        Returns:
            For each agent what it receives, by the neighbour's id.
        """
        sent = real_numbers(values)
        ids = self._view.team.agent_ids
        neighbours = self._view.neighbours
        if sent.shape[:1] != (len(ids),):
            raise InputError(f"exchange: values have shape {sent.shape}; expected ({len(ids)}, ...)")
        messages = sum(map(len, neighbours))
        self._traffic.rounds += 1
        self._traffic.messages += messages
        self._traffic.numbers += messages * (sent.size // len(sent))
        return [{ids[j]: sent[j].copy() for j in near} for near in neighbours]


def real_numbers(values: ArrayLike) -> Array:
    """Return numbers as float64.

    Raises:
        TypeError: They are complex, no numbers, or a masked array that lacks some.
    """
    if isinstance(values, (list, tuple)) and any(isinstance(row, np.ma.MaskedArray) for row in values):
        values = cast(ArrayLike, np.ma.array(values))
    if np.ma.is_masked(values):
        raise TypeError("expected real numbers, not a masked array with masked entries")
    found = np.asarray(values)
    if found.dtype.kind not in "buif":
        raise TypeError(f"expected real numbers, not {str(values)[:40]} of type {found.dtype}")
    return found.astype(np.float64)
