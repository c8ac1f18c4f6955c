"""Runs in memory, with events or without: their samples as one, phase by phase, and as the dataset of a plain run."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.comparing.measures import Series, error_series, positions_at_q_star
from mjsheaf.control.controller import Controller
from mjsheaf.runs.simulate import dataset_of
from mjsheaf.simulation.session import engine_of
from mjsheaf.simulation.trajectory import Log, Trajectory
from mjsheaf.system import Phase

if TYPE_CHECKING:
    import xarray as xr

_OF_LINKS = ("heard", "measurements")  # fields of a log whose width changes from phase to phase
_LEFT_OUT = (*_OF_LINKS, "extra")


@dataclass(frozen=True)
class Recording:
    """A run in memory.

    Attributes:
        phases: Phases that were simulated.
        pieces: Samples of each phase that the run reached.
        controller: Law in Python that was in control, or None.
    """

    phases: tuple[Phase, ...]
    pieces: tuple[Trajectory, ...]
    controller: Controller | None = None

    @cached_property
    def trajectory(self) -> Trajectory:
        """All samples under the first phase's system; without those of links where there are several phases."""
        if len(self.pieces) == 1:
            return self.pieces[0]
        samples = sum(len(piece.time) for piece in self.pieces)
        fields = {
            name: np.concatenate([getattr(piece.log, name) for piece in self.pieces])
            for name in Log._fields
            if name not in _LEFT_OUT
        }
        log = Log(**fields, **{name: np.empty((samples, 0)) for name in _OF_LINKS})
        time = np.concatenate([piece.time for piece in self.pieces])
        return Trajectory(self.pieces[0].system, time, log, self.pieces[-1].message)

    @cached_property
    def present(self) -> BoolArray:
        """Agents that are part of the team at each sample, shape (T, N)."""
        rows = [np.tile(piece.system.team.present, (len(piece.time), 1)) for piece in self.pieces]
        return np.concatenate(rows)

    @cached_property
    def limits(self) -> Array:
        """Velocity limit of each agent at each sample, 0 where it is absent, shape (T, N), m/s."""
        agents = self.present.shape[1]
        rows = [np.tile(piece.system.law.limit[:agents], (len(piece.time), 1)) for piece in self.pieces]
        return np.concatenate(rows)

    @property
    def finished(self) -> bool:
        """True if it reached its end."""
        return self.trajectory.status == "finished"

    def series(self) -> Series:
        """Compute the errors of the team and of its groups over time."""
        return _joined(error_series(piece.system, piece.positions) for piece in self.pieces)

    def series_at_q_star(self) -> Series:
        """Compute the errors over time with every agent at its harmonic extension."""
        placed = ((piece.system, positions_at_q_star(piece.system, piece.positions)) for piece in self.pieces)
        return _joined(error_series(system, positions) for system, positions in placed)

    def dataset(self, backend: str, seed: int) -> "xr.Dataset":
        """Gather the run as `simulate` returns it."""
        return dataset_of(self.pieces, self.phases, backend, seed, self.controller)

    def with_message(self, message: str) -> "Recording":
        """Return the same run, whose end has another message."""
        *before, last = self.pieces
        return replace(self, pieces=(*before, replace(last, message=message)))


def record_run(
    phases: Sequence[Phase], *, bodies: bool, targets: Array | None = None, controller: Controller | None = None
) -> Recording:
    """Simulate phases on bodies or ideal kinematics; `targets` are those of `Engine.record`."""
    with engine_of(phases, "physics" if bodies else "ideal", controller=controller) as engine:
        pieces = tuple(engine.record(phases[0].system.grid.steps + 1, targets))
    return Recording(tuple(phases), pieces, controller)


def _joined(parts: Iterable[Series]) -> Series:
    """Join errors over time that follow one another."""
    first, *others = parts
    return {
        scope: {name: np.concatenate([x, *(part[scope][name] for part in others)]) for name, x in own.items()}
        for scope, own in first.items()
    }
