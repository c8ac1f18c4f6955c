"""The physics backend: a system on bodies, by whichever engine its run names."""

from collections.abc import Callable, Iterator, Sequence

from mjsheaf.arrays import Array
from mjsheaf.control.controller import Controller
from mjsheaf.simulation.threaded import ThreadedLoop, crew_size
from mjsheaf.simulation.trajectory import Trajectory
from mjsheaf.system import Phase, System, phases_of


def run_physics(
    run: System | Sequence[Phase],
    progress: Callable[[int, int], None] | None = None,
    targets: Array | None = None,
    controller: Controller | None = None,
) -> Trajectory:
    """Simulate a system on bodies, in one piece; see `stream_physics`.

    Returns:
        The trajectory; its status is 'unstable' and it ends early where the simulation blows up.
    """
    return next(stream_physics(run, phases_of(run)[0].system.grid.steps + 1, progress, targets, controller))


def stream_physics(
    run: System | Sequence[Phase],
    samples: int,
    progress: Callable[[int, int], None] | None = None,
    targets: Array | None = None,
    controller: Controller | None = None,
) -> Iterator[Trajectory]:
    """Simulate on bodies, by the engine of the run, and hand out pieces; arguments and pieces as of `stream_ideal`."""
    plan = phases_of(run)[0].system.bodies
    if plan.engine == "fused":
        from mjsheaf.simulation.fused import Fused

        bodies: ThreadedLoop = Fused(run, controller=controller)
    elif crew_size(plan, controller is not None) > 1:
        from mjsheaf.simulation.world import SplitWorld

        bodies = SplitWorld(run)
    else:
        from mjsheaf.simulation.world import World

        yield from World(run, controller=controller, visible=False).record(samples, targets, progress)
        return
    with bodies:
        yield from bodies.record(samples, targets, progress)
