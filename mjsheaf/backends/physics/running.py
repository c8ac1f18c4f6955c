"""A whole run on bodies: in one piece, or in pieces as they come."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics.world import World
from mjsheaf.backends.system import System
from mjsheaf.backends.trajectory import Trajectory

Array = NDArray[np.float64]


def run_physics(
    system: System, progress: Callable[[int, int], None] | None = None, targets: Array | None = None
) -> Trajectory:
    """Simulate a system on bodies.

    Args:
        system: the system.
        progress: called with (samples done, samples in all).
        targets: where the targets are at each sample, shape (T, V - N, 3), m, whatever their bodies would do; the run
            ends with the last. None leaves them to their bodies.

    Returns:
        The trajectory; its status is 'unstable' and it ends early where the simulation blows up.
    """
    return next(stream_physics(system, system.grid.steps + 1, progress, targets))


def stream_physics(
    system: System,
    samples: int,
    progress: Callable[[int, int], None] | None = None,
    targets: Array | None = None,
) -> Iterator[Trajectory]:
    """Simulate as `run_physics` does, and hand out so many samples at a time; the last piece has what is left.

    A piece before the last has the status 'finished'.
    """
    begin = 0
    for log, message in World(system, visible=False).record(samples, targets, progress):
        done = int(log.written[0])
        yield Trajectory(
            system.grid.span(begin, begin + done),
            log.positions[:done],
            "unstable" if message else "finished",
            message,
            log.quaternions[:done],
            log.heights[:done],
            log.thrust[:done],
            log.saturation[:done],
        )
        begin += done
