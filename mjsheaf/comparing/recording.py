"""Runs in memory, with or without events: all samples, samples by phase, and the dataset of a plain run."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.comparing.measures import Series, error_series, positions_at_q_star
from mjsheaf.law.in_python import Controller
from mjsheaf.loop.log import Log, Trajectory
from mjsheaf.loop.session import engine_of
from mjsheaf.runs.simulate import dataset_of
from mjsheaf.system import Phase

if TYPE_CHECKING:
    import xarray as xr

_OF_LINKS = ("heard", "measurements")  # log fields whose width differs between phases
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
        """Samples under the first phase's system; with several phases, without the log fields of links."""
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
        """True for agents that are part of the team at each sample, shape (T, N)."""
        return np.concatenate([np.tile(piece.system.team.present, (len(piece.time), 1)) for piece in self.pieces])

    @cached_property
    def limits(self) -> Array:
        """Velocity limit of each agent at each sample, 0 if it is absent, shape (T, N), m/s."""
        agents = self.present.shape[1]
        rows = [np.tile(piece.system.law.limit[:agents], (len(piece.time), 1)) for piece in self.pieces]
        return np.concatenate(rows)

    @property
    def finished(self) -> bool:
        """True if the run reached its end."""
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
        """Return the same run with another message at its end."""
        *before, last = self.pieces
        return replace(self, pieces=(*before, replace(last, message=message)))


def record_run(
    phases: Sequence[Phase], *, bodies: bool, targets: Array | None = None, controller: Controller | None = None
) -> Recording:
    """Simulate phases on bodies or ideal kinematics; see `Engine.record` for `targets`."""
    with engine_of(phases, "physics" if bodies else "ideal", controller=controller) as engine:
        pieces = tuple(engine.record(phases[0].system.grid.steps + 1, targets))
    return Recording(tuple(phases), pieces, controller)


def _joined(parts: Iterable[Series]) -> Series:
    """Concatenate errors over consecutive times."""
    first, *others = parts
    return {
        scope: {name: np.concatenate([x, *(part[scope][name] for part in others)]) for name, x in own.items()}
        for scope, own in first.items()
    }
