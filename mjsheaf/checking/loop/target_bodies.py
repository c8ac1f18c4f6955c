"""The targets' own law, consensus and pull, closed through the vehicles that carry the targets, for small motions.

Each vehicle is linearised about the equilibrium in which it holds station in the mean flow along its path, and all are
closed through u = -S p: see `targets_loop` for S, and `body_loop` for the same of agents.
"""

import numpy as np

from mjsheaf.checking.loop.body_loop import LARGEST_WHOLE, TeamLoop, joined, key_of, sampling_of, station_in
from mjsheaf.checking.loop.linear_law import without_memory
from mjsheaf.checking.loop.targets_loop import TargetsLoop, TargetsOnBodies, stiffness, targets_loop
from mjsheaf.checking.theorem.targets import TargetPath
from mjsheaf.errors import InputError, UndecidedError
from mjsheaf.loop.linear import LinearVehicle, linearise
from mjsheaf.system import System
from mjsheaf.threads import one_thread


def with_bodies(loop: TargetsLoop, system: System, path: TargetPath) -> TargetsLoop:
    """Return the loop with what the targets' vehicles make of it, along a path."""
    moves = loop.rate > 0.0 and system.team.targets
    return loop.model_copy(update={"bodies": _on_bodies(system, path)}) if moves else loop


@one_thread
def _on_bodies(system: System, path: TargetPath) -> TargetsOnBodies:
    """Close the targets' law through their vehicles, in the mean flow along their path."""
    S = stiffness(system).toarray()
    owner = np.repeat(np.arange(len(system.team.targets)), [target.dimension for target in system.team.targets])
    try:
        period, timestep, steps = sampling_of(system)
        models = _models(system, path, timestep, steps)
        block = joined(models, lambda gain: without_memory(-gain * S), np.eye(len(S)), owner)
        loop = TeamLoop([block], period)
        modes = loop.modes(1.0)
    except (UndecidedError, InputError, np.linalg.LinAlgError) as error:
        return TargetsOnBodies(stable=None, spectral_radius=None, reason=str(error))
    return TargetsOnBodies(stable=loop.is_stable(1.0, modes), spectral_radius=modes.radius, reason="")


def _models(system: System, path: TargetPath, timestep: float, steps: int) -> list[LinearVehicle]:
    """Return the linear vehicle of each target, in the mean velocity of the medium relative to its path.

    If the path is unknown or diverges, the vehicle is linearised in the medium where the target begins.

    Raises:
        UndecidedError: one has none.
    """
    N = len(system.team.agents)
    span = float(path.time[-1] - path.time[0])
    bounded = path.cells is not None and targets_loop(system).stable
    positions = path.positions[:, N:] if bounded else system.initial[None, N:]
    medium = -(positions[-1] - positions[0]) / span
    for k in range(len(medium)):
        medium[k] += np.mean(system.flows[int(system.field[N + k])].velocity(positions[:, k]), axis=0)
    stations = [station_in(system, N + k, medium[k]) for k in range(len(medium))]
    keys = list(map(key_of, stations))
    unlike = dict(zip(keys, stations, strict=True))
    if len(unlike) > LARGEST_WHOLE:
        raise UndecidedError("too many unlike targets")
    found = dict(zip(unlike, linearise(list(unlike.values()), system.control, timestep, steps), strict=True))
    models = []
    for id_, key in zip(system.team.target_ids, keys, strict=True):
        model = found[key]
        if isinstance(model, str):
            raise UndecidedError(f"the vehicle of {id_} cannot hold station on its path: {model}")
        models.append(model)
    return models
