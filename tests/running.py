"""Whole runs and runs in pieces of a System or of phases, as tests take them."""

from collections.abc import Callable, Iterator, Sequence

from mjsheaf.arrays import Array
from mjsheaf.law.in_python import Controller, Law
from mjsheaf.loop.engine import Trajectory
from mjsheaf.loop.session import engine_of
from mjsheaf.loop.system import Phase, System

Run = System | Sequence[Phase]
Progress = Callable[[int, int], None]


def run_ideal(
    run: Run,
    progress: Progress | None = None,
    targets: Array | None = None,
    controller: Law | Controller | None = None,
) -> Trajectory:
    return engine_of(run, "ideal", controller=controller).run(targets, progress)


def run_physics(
    run: Run,
    progress: Progress | None = None,
    targets: Array | None = None,
    controller: Law | Controller | None = None,
) -> Trajectory:
    return engine_of(run, controller=controller).run(targets, progress)


def stream_ideal(run: Run, samples: int, *, targets: Array | None = None) -> Iterator[Trajectory]:
    return engine_of(run, "ideal").record(samples, targets)


def stream_physics(run: Run, samples: int, *, targets: Array | None = None) -> Iterator[Trajectory]:
    with engine_of(run) as engine:
        yield from engine.record(samples, targets)
