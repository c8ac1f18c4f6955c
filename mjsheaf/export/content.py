"""Content of an exported run, sample by sample, whatever the format.

Poses are exact, and times are to the nanosecond. Desired positions are rounded to a ten-thousandth of the team's
initial size, so that files stay small.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib
import numpy as np
import xarray as xr

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.export.solids import solids_of
from mjsheaf.results.metrics import edge_residuals
from mjsheaf.show.panels import groups_of
from mjsheaf.team import Edge

if TYPE_CHECKING:
    from mjsheaf.scenario import Scenario
    from mjsheaf.system import Phase, System

WORLD = "world"
"""Frame of all positions: x, y horizontal, z up, m."""

TOPICS = {
    "errors": (
        *("disagreement", "tracking_error", "formation_error", "centering_error"),
        *("group_formation_error", "group_centering_error", "separation"),
    ),
    "commands": (
        *("velocity_command", "command", "target_command", "agent_saturation", "target_saturation"),
        *("safety_correction", "safety_violation", "arrival"),
    ),
}
"""Names of the recorded variables that are exported as numbers, where a run has them, by topic."""

_RESIDUALS = (0.01, 10.0)  # residuals at the ends of the colour scale, m
_LEVELS = 16  # number of colours of edges
PALETTE: Array = matplotlib.colormaps["turbo"](np.linspace(0.05, 0.95, _LEVELS)).round(3)
"""Colours of edges from small to large residuals, RGBA, shape (levels, 4)."""

_STEPS = 10_000  # minimum number of steps of desired positions along the team's initial size
_SLOWEST = 2.0**-6  # slowest flow with an arrow, m/s


class Moment(NamedTuple):
    """One sample of a run.

    Attributes:
        time: Time, ns.
        poses: Position and quaternion x, y, z, w of each vehicle, shape (V, 7), m; not finite if it blew up.
        edges: Vehicles at the ends of the drawn edges, shape (E, 2).
        levels: Number of each drawn edge's colour in `PALETTE`, shape (E,).
        owners: Agents with a drawn desired position, shape (G,).
        goals: Desired positions q* of these, rounded, shape (G, 3), m.
        drifting: Vehicles with a drawn flow, shape (A,).
        flow: Velocity of the medium about these, shape (A, 3), m/s.
        values: Values of the exported variables; the first dimension of an array is that of its labels.
        log: Events at this sample.
    """

    time: int
    poses: Array
    edges: IntArray
    levels: IntArray
    owners: IntArray
    goals: Array
    drifting: IntArray
    flow: Array
    values: dict[str, Array]
    log: tuple[str, ...]


class Edges(NamedTuple):
    """Edges of one phase.

    Attributes:
        edges: Edges of communication and sensing.
        ends: Vehicles at their ends, shape (E, 2).
        present: True for the vehicles that take part, shape (V,).
    """

    edges: list[Edge]
    ends: IntArray
    present: BoolArray


class Content:
    """Content of a run, from its chunks.

    Attributes:
        frames: Name of each vehicle's frame, its id.
        solids: Shape of each vehicle in its frame.
        labels: Labels of each exported variable's values: ids of agents or targets, names of groups; empty for one.
        vectors: Names of the variables that have several numbers for each label.
        colours: Colour of each vehicle's group, RGB, shape (V, 3).
        radii: Radius of the ball at each agent's desired position, shape (N,), m.
    """

    def __init__(
        self, scenario: "Scenario", phases: "Sequence[Phase]", variables: Mapping[Any, xr.Variable], bodies: bool
    ) -> None:
        """Prepare the content of a run with these variables, on bodies or on ideal kinematics."""
        system = phases[0].system
        self._team, self._phases, self._bodies = system.team, phases, bodies
        self._height = scenario.scene.height
        self._done = 0
        self._edges = [_edges_of(phase.system) for phase in phases]
        self._step = _step_of(system.initial)
        group, _, colours = groups_of(self._team)
        self.colours = np.asarray(colours)[group]
        self.frames = [member.id for member in self._team.members]
        self.solids, radii = solids_of(system.vehicles, self.colours, at_hand=not bodies)
        self.radii = 0.5 * radii[: len(self._team.agents)]
        self.labels: dict[str, list[str]] = {}
        self.vectors: set[str] = set()
        for name in chain(*TOPICS.values()):
            if name in variables:
                dimensions = variables[name].dims
                if len(dimensions) > 2:
                    self.vectors.add(name)
                self.labels[name] = [str(x) for x in variables[dimensions[1]].values] if len(dimensions) > 1 else []

    def moments(self, chunk: xr.Dataset) -> Iterator[Moment]:
        """Return the samples of the next chunk of the run."""
        arrays = {str(name): chunk[name].values for name in chunk.variables}
        times = np.rint(1e9 * arrays["time"]).astype(np.int64)
        poses = self._poses(arrays)
        goals = self._goals(arrays["harmonic_extension"], poses)
        flow = np.nan_to_num(np.concatenate([arrays["agent_flow"], arrays["target_flow"]], axis=1))
        positions = np.nan_to_num(np.concatenate([arrays["agent_position"], arrays["target_position"]], axis=1))
        begin, self._done = self._done, self._done + len(times)
        starts = [phase.start for phase in self._phases[1:]]
        for k, (phase, first, end) in enumerate(zip(self._phases, [0, *starts], [*starts, self._done], strict=True)):
            rows = np.arange(max(first - begin, 0), min(end - begin, len(times)))
            drawn = self._edges[k]
            levels = _levels(edge_residuals(self._team, drawn.edges, positions[rows]))
            for row, level in zip(rows.tolist(), levels, strict=True):
                visible = np.isfinite(poses[row]).all(axis=1) & drawn.present
                shown = visible[drawn.ends].all(axis=1)
                owners = np.flatnonzero(np.isfinite(goals[row]).all(axis=1) & drawn.present[: goals.shape[1]])
                drifting = np.flatnonzero(visible & (np.linalg.norm(flow[row], axis=1) >= _SLOWEST))
                yield Moment(
                    time=int(times[row]),
                    poses=poses[row],
                    edges=drawn.ends[shown],
                    levels=level[shown],
                    owners=owners,
                    goals=goals[row, owners],
                    drifting=drifting,
                    flow=flow[row, drifting],
                    values={name: arrays[name][row] for name in self.labels},
                    log=phase.events if begin + row == phase.start else (),
                )

    def _goals(self, q_star: Array, poses: Array) -> Array:
        """Return q* rounded, shape (T, N, 3), at the agent's height where it has none; NaN for absent agents."""
        goals = np.where(
            np.isnan(q_star[..., :1]), np.nan, np.where(np.isnan(q_star), poses[:, : q_star.shape[1], :3], q_star)
        )
        with np.errstate(invalid="ignore", over="ignore"):
            return np.asarray(np.rint(goals / self._step) * self._step)

    def _poses(self, arrays: Mapping[str, Array]) -> Array:
        """Return position and quaternion x, y, z, w of all vehicles, shape (T, V, 7).

        On ideal kinematics vehicles have no attitude, and the frame's origin is the controlled point.
        """
        what = "body_position" if self._bodies else "position"
        positions = np.concatenate([arrays[f"{kind}_{what}"] for kind in ("agent", "target")], axis=1)
        poses = np.zeros((*positions.shape[:2], 7))
        poses[..., :3] = positions
        if self._bodies:
            turns = np.concatenate([arrays[f"{kind}_orientation"] for kind in ("agent", "target")], axis=1)
            poses[..., 3:] = turns[..., [1, 2, 3, 0]]
        else:
            planar = [member.dimension == 2 for member in self._team.members]
            poses[:, planar, 2] = self._height
            poses[..., 6] = 1.0
        return poses


def _edges_of(system: "System") -> Edges:
    """Return the edges of a system and who is present."""
    team = system.team
    edges = [*team.communication, *team.sensing]
    ends = [[team.index[edge.tail], team.index[edge.head]] for edge in edges]
    return Edges(
        edges,
        np.array(ends, dtype=np.int64).reshape(-1, 2),
        np.append(team.present, np.ones(len(team.targets), dtype=bool)),
    )


def _levels(residuals: Array) -> IntArray:
    """Return the number of the colour of each residual, on a logarithmic scale."""
    low, high = np.log(_RESIDUALS)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = (np.log(residuals) - low) / (high - low)
    return np.clip(np.nan_to_num(np.floor(part * _LEVELS), nan=_LEVELS), 0, _LEVELS - 1).astype(np.int64)


def _step_of(initial: Array) -> float:
    """Return the step of desired positions, a power of 2, m."""
    size = max(float(np.ptp(initial, axis=0).max()), 1.0)
    return float(2.0 ** np.floor(np.log2(size / _STEPS)))
