"""The targets' own law, consensus and pull, closed through the vehicles that carry the targets, for small motions.

Each vehicle is linearised about the equilibrium in which it holds station in the mean flow along its path, and all are
closed through u = -S p: see `targets_loop` for S, and `body_loop` for the same of agents.
"""

import numpy as np
from scipy import linalg

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.body_loop import LARGEST_WHOLE, MODE_AT_REST, NEUTRAL_RATE, key_of, sampling_of, station_in
from mjsheaf.checking.loop.targets_loop import TargetsLoop, TargetsOnBodies, stiffness, targets_loop
from mjsheaf.checking.theorem.targets import TargetPath
from mjsheaf.errors import InputError, UndecidedError
from mjsheaf.simulation.linear import LinearVehicle, linearise
from mjsheaf.system import System
from mjsheaf.threads import one_thread


def with_bodies(loop: TargetsLoop, system: System, path: TargetPath) -> TargetsLoop:
    """Return the loop with what the targets' vehicles make of it, along a path."""
    moves = loop.rate > 0.0 and system.team.targets
    return loop.model_copy(update={"bodies": _on_bodies(system, path)}) if moves else loop


@one_thread
def _on_bodies(system: System, path: TargetPath) -> TargetsOnBodies:
    """Close the targets' law through their vehicles, in the mean flow along their path."""
    try:
        period, timestep, steps = sampling_of(system)
        matrix, n = _matrix(system, _models(system, path, timestep, steps))
    except (UndecidedError, InputError, np.linalg.LinAlgError) as error:
        return TargetsOnBodies(stable=None, spectral_radius=None, reason=str(error))
    factors, vectors = linalg.eig(matrix)
    moves = np.linalg.norm(vectors[:n], axis=0) > MODE_AT_REST * np.linalg.norm(vectors, axis=0)
    growth = np.exp(NEUTRAL_RATE * period)
    size = np.abs(factors)
    radius = float(size[moves | (size > growth)].max())
    return TargetsOnBodies(stable=radius < growth, spectral_radius=radius, reason="")


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


def _matrix(system: System, models: list[LinearVehicle]) -> tuple[Array, int]:
    """The closed loop on (p, x_1, x_2, ...) over a period, under u = -S p, and the number of coordinates of p.

    Raises:
        UndecidedError: it is too large.
    """
    S = stiffness(system)
    n, states = S.shape[0], sum(len(model.A) for model in models)
    if n + states > LARGEST_WHOLE:
        raise UndecidedError(f"the targets have {n + states} states; up to {LARGEST_WHOLE} are looked at")
    A, B, C, D = (linalg.block_diag(*(model[k] for model in models)) for k in range(4))
    dense = S.toarray()
    return np.block([[np.eye(n) - D @ dense, C], [-B @ dense, A]]), n
