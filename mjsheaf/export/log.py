"""Runs as logs: what a log has of each sample, whatever its format, and the formats with their files.

Poses are exact, and times are to the nanosecond. Desired positions are rounded to a ten-thousandth of the team's
initial size, so that files stay small.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from importlib import import_module
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
import xarray as xr

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import InputError
from mjsheaf.files import naming, whole_directory, whole_file
from mjsheaf.loop.system import Phase
from mjsheaf.results.store import BAG, Sink, length_of_piece, reopen_run, send, split, strange_in_bag
from mjsheaf.scenario import Scenario
from mjsheaf.show.played import edges_of, goals_in, has_bodies, joined, positions_in, residuals_in
from mjsheaf.show.solids import parts_of
from mjsheaf.show.style import groups_of

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

_LEVELS = 16  # number of colours of edges
PALETTE: Array = matplotlib.colormaps["turbo"](np.linspace(0.05, 0.95, _LEVELS)).round(3)
"""Colours of edges from small to large residuals, RGBA, shape (levels, 4)."""

HALF_OPEN = 0.6
"""Opacity of desired positions."""
ARROW = (0.25, 0.8, 0.95, 0.9)
"""Colour of the arrows of flow, RGBA."""


class Moment(NamedTuple):
    """One sample of a run.

    Attributes:
        time: Time, ns.
        phase: Number of its phase.
        poses: Position and quaternion x, y, z, w of each vehicle, shape (V, 7), m; not finite if it blew up.
        edges: Vehicles at the ends of the drawn edges, shape (E, 2).
        levels: Number of each drawn edge's colour in `PALETTE`, shape (E,).
        owners: Agents with a drawn desired position, shape (G,).
        goals: Desired positions q* of these, rounded, shape (G, 3), m.
        drifting: Vehicles with a drawn flow, shape (A,).
        flow: Velocity of the medium about these, shape (A, 3), m/s.
        values: Values of the exported variables; the first dimension of an array is that of its labels.
    """

    time: int
    phase: int
    poses: Array
    edges: IntArray
    levels: IntArray
    owners: IntArray
    goals: Array
    drifting: IntArray
    flow: Array
    values: dict[str, Array]


class LogSink(Sink, ABC):
    """Sink that writes a run sample by sample; subclasses implement how a format has each of them.

    Attributes:
        frames: Name of each vehicle's frame, its id.
        solids: Shape of each vehicle in its frame.
        labels: Labels of each exported variable's values: ids of agents or targets, names of groups; empty for one.
        vectors: Names of the variables that have several numbers for each label.
        colours: Colour of each vehicle's group, RGB, shape (V, 3).
        radii: Radius of the ball at each agent's desired position, shape (N,), m.
        last: Time of the last sample, ns.
        failed: False after a sample was written; True before the first, and if writing failed.
        status: Status and message of the run.
        file: The MCAP file.
    """

    def __init__(self, path: Path, scenario: Scenario, phases: Sequence[Phase], attachment: Path) -> None:
        """Write an MCAP file at `path`; `attachment` is the scenario's file, read at the end."""
        self.scenario, self.phases, self.attachment = scenario, phases, attachment
        self.file = path.open("wb")
        self.last, self.status, self.failed = 0, ("", ""), True

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Prepare the content; nothing is written before the first sample."""
        system = self.phases[0].system
        team = system.team
        self._phase = -1  # number of that of the last sample
        ends = [[team.index[edge.tail], team.index[edge.head]] for edge in edges_of(self.phases).values()]
        self._ends = np.array(ends, dtype=np.int64).reshape(-1, 2)
        size = max(float(np.ptp(system.initial, axis=0).max()), 1.0)
        self._step = float(2.0 ** np.floor(np.log2(size / 10_000)))  # of desired positions, m
        group, _, colours = groups_of(team)
        self.colours = colours[group]
        self.frames = [member.id for member in team.members]
        self.solids, radii = parts_of(system.vehicles, self.colours, at_hand=attrs["backend"] != "physics")
        self.radii = 0.5 * radii[: len(team.agents)]
        self.labels: dict[str, list[str]] = {}
        self.vectors: set[str] = set()
        for name in chain(*TOPICS.values()):
            if name in variables and variables[name].size:
                dimensions = variables[name].dims
                if len(dimensions) > 2:
                    self.vectors.add(name)
                self.labels[name] = [str(x) for x in variables[dimensions[1]].values] if len(dimensions) > 1 else []

    def write(self, chunk: xr.Dataset) -> None:
        """Write the samples of a chunk."""
        self.failed = True
        times = np.rint(1e9 * chunk["time"].values).astype(np.int64).tolist()
        values = {name: chunk[name].values for name in self.labels}
        poses = self._poses(chunk)
        goals = goals_in(chunk, poses[..., :3])
        flow = np.nan_to_num(joined(chunk, "flow"))
        residual = residuals_in(chunk, self.phases, np.nan_to_num(joined(chunk, "position")))
        low, high = np.log((0.01, 10.0))  # residuals at the ends of the colour scale, m
        with np.errstate(all="ignore"):
            goals = np.rint(goals / self._step) * self._step
            part = (np.log(residual) - low) / (high - low)
        levels = np.clip(np.nan_to_num(np.floor(part * _LEVELS), nan=_LEVELS), 0, _LEVELS - 1).astype(np.int64)
        for row, (time, k) in enumerate(zip(times, chunk["phase"].values.tolist(), strict=True)):
            team = self.phases[k].system.team
            present = np.append(team.present, np.ones(len(team.targets), dtype=bool))
            visible = np.isfinite(poses[row]).all(axis=1) & present
            shown = visible[self._ends].all(axis=1) & ~np.isnan(residual[row])
            owners = np.flatnonzero(np.isfinite(goals[row]).all(axis=1) & team.present)
            # Slowest flow with an arrow, m/s.
            drifting = np.flatnonzero(visible & (np.linalg.norm(flow[row], axis=1) >= 2.0**-6))
            self.last = time
            if self._phase < 0:
                self.write_vehicles()
            self.write_moment(
                Moment(
                    time=time,
                    phase=k,
                    poses=poses[row],
                    edges=self._ends[shown],
                    levels=levels[row, shown],
                    owners=owners,
                    goals=goals[row, owners],
                    drifting=drifting,
                    flow=flow[row, drifting],
                    values={name: array[row] for name, array in values.items()},
                )
            )
            for words in chain(*(phase.events for phase in self.phases[self._phase + 1 : k + 1])):
                self.write_log("INFO", words)
            self._phase = k
        self.status = chunk.attrs["status"], chunk.attrs["message"]
        self.failed = False

    @abstractmethod
    def write_vehicles(self) -> None:
        """Write the shapes of all vehicles, which move with their frames."""

    @abstractmethod
    def write_moment(self, moment: Moment) -> None:
        """Write poses, scene and values of a sample."""

    @abstractmethod
    def write_log(self, level: str, words: str) -> None:
        """Write a message, of level INFO or ERROR, at the time of the last sample."""

    def placed(self, moment: Moment) -> list[tuple[str, list[float]]]:
        """Return the frame and the pose of each vehicle, except those that are not finite."""
        rows = zip(self.frames, moment.poses.tolist(), strict=True)
        return [(frame, pose) for frame, pose in rows if all(map(isfinite, pose))]

    @abstractmethod
    def finish(self) -> None:
        """Write the scenario and the index."""

    def close(self) -> None:
        """Write the end of the log if every sample could be written, and why a run is unstable."""
        with self.file:
            if not self.failed:
                if self.status[0] == "unstable":
                    self.write_log("ERROR", self.status[1])
                self.finish()

    def _poses(self, chunk: xr.Dataset) -> Array:
        """Return position and quaternion x, y, z, w of all vehicles, shape (T, V, 7).

        On ideal kinematics vehicles have no attitude, and the frame's origin is the controlled point.
        """
        if has_bodies(chunk):
            return np.concatenate(
                [joined(chunk, "body_position"), joined(chunk, "orientation")[..., [1, 2, 3, 0]]], axis=2
            )
        positions = positions_in(chunk, self.scenario.scene.height)
        level = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (*positions.shape[:2], 4))
        return np.concatenate([positions, level], axis=2)


FORMATS = {"mcap": "run.mcap", "ros2": BAG}
"""Name in a run's directory of what each format writes: a file, and the directory of a bag."""


def require_installed(formats: Sequence[str]) -> list[Callable[..., Sink]]:
    """Return the sinks of formats, keys of `FORMATS` or 'live'.

    Raises:
        InputError: The packages of the extra `mcap` are not installed.
    """
    found = []
    for name in formats:
        try:
            found.append(import_module(f"mjsheaf.export.{name}").Log)
        except ImportError as error:
            extras = "mcap,live" if name == "live" else "mcap"
            raise InputError(
                f"--{name} needs packages that are not installed ({error.name}): pip install 'mjsheaf[{extras}]'"
            ) from None
    return found


def export_run(directory: Path, format_name: str, out: Path | None = None) -> Path:
    """Export a finished run, and return the path of the file or directory.

    Args:
        directory: Directory of the run.
        format_name: A key of `FORMATS`.
        out: Path to write; None for the format's name in the run's directory.

    Raises:
        InputError: The directory holds no run, a package is missing, or nothing can be written there.
    """
    path = directory / FORMATS[format_name] if out is None else out
    (kind,) = require_installed([format_name])
    with reopen_run(directory) as (scenario, dataset, _), ExitStack() as stack, naming(path):
        strange = strange_in_bag(path) if format_name == "ros2" else []
        if strange:
            raise InputError(f"{path}: holds {strange[0]!r}, which mjsheaf did not write; choose another with --out")
        part = stack.enter_context(whole_directory(path) if format_name == "ros2" else whole_file(path))
        sink = kind(part, scenario, scenario.phases, directory / "scenario.yaml")
        send((piece.load() for piece in split(dataset, length_of_piece(dataset))), sink)
    return path
