"""The ideal backend: q' = f(q, t) + g(q, t) u + omega(t), integrated to a stated tolerance.

With a control period the velocity commands -k1 eta are sampled and held (zero-order hold); between samples vehicles do
not act on one another, and each is integrated by itself, flow and disturbance included. The allocation
u = g^+ (-k1 eta) follows g(q, t) within a period, as an actuator does. With period 0 the law itself is inside the
integrator, and the team is integrated as one.

The method is Dormand and Prince's pair of order 5(4) (J. Comput. Appl. Math. 6, 1980) with local extrapolation, the
step control and starting step of Hairer, Norsett and Wanner (Solving Ordinary Differential Equations I, II.4). Errors
are measured as the root mean square over the padded state (3 components a vehicle) relative to atol + rtol |x|: the
way in which the paper's published run was integrated, so that it comes out alike to rounding.

All within a period is inlined into one function for one vehicle (see `part`): handing tuples of arrays on costs more
than a slope does.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.dynamics.disturbance import evaluate_sines
from mjsheaf.dynamics.effectiveness import EffectivenessArrays, allocate
from mjsheaf.jit import kernel, part
from mjsheaf.simulation.trajectory import Trajectory, blow_up_message
from mjsheaf.system import MediumArrays, System, medium_velocity, velocity_commands

Array = NDArray[np.float64]

_A = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_C = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
_ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])

_HUGE = 1e9  # m; a position beyond this is a blow-up
_SMALLEST_STEP = 1e-13  # of a period
_SMALLEST_TRIAL = 1e-9  # of a period
_MOST_STEPS = 50_000  # of the integrator in a period: more means that the solution runs into a singularity
_CHUNK = 500  # periods between progress reports


class _Scratch(NamedTuple):
    """Work arrays of one run: residual, command, a stage's state (V, 3); slopes (7, V, 3); input (s,); sines (V K,)."""

    residual: Array
    command: Array
    state: Array
    slope: Array
    input: Array
    sines: Array


def scratch(medium: MediumArrays, effectiveness: EffectivenessArrays) -> _Scratch:
    """Work arrays for the vehicles in a medium."""
    V = len(medium.planar)
    return _Scratch(
        residual=np.zeros((V, 3)),
        command=np.zeros((V, 3)),
        state=np.zeros((V, 3)),
        slope=np.zeros((7, V, 3)),
        input=np.zeros(effectiveness.pinv.shape[1]),
        sines=np.zeros(len(medium.harmonics.rate)),
    )


@part
def drift_and_disturbance(follow, medium, effectiveness, t, x, first, last, work, out):
    """Write x' of the vehicles from first to last into out (V, 3); commands are those held unless there is a law."""
    if follow is not None:
        velocity_commands(follow, t, x, work.residual, work.command)
    evaluate_sines(medium.harmonics, t, first, last, work.sines)
    for v in range(first, last):
        for i in range(3):
            out[v, i] = work.command[v, i]
        if v < medium.agents and effectiveness.given[v]:
            allocate(effectiveness, v, x[v], t, out[v], work.input)
        wx, wy, wz = medium_velocity(medium, work.sines, v, x[v, 0], x[v, 1], x[v, 2])
        out[v, 0] += wx
        out[v, 1] += wy
        out[v, 2] += wz


@part
def _norm(values, x, y, first, last, tolerance):
    """Root mean square of values relative to atol + rtol max(|x|, |y|), over the vehicles from first to last."""
    total = 0.0
    for v in range(first, last):
        for i in range(3):
            scale = tolerance[1] + tolerance[0] * max(abs(x[v, i]), abs(y[v, i]))
            total += (values[v, i] / scale) ** 2
    return np.sqrt(total / (3 * (last - first)))


@part
def _first_step(follow, medium, effectiveness, t, period, x, first, last, tolerance, work):
    """A step for which the method's leading error term is likely to pass; work.slope[0] holds x' at t."""
    size = _norm(x, x, x, first, last, tolerance)
    speed = _norm(work.slope[0], x, x, first, last, tolerance)
    trial = min(1e-6 if size < 1e-5 or speed < 1e-5 else 0.01 * size / speed, period)
    if trial < _SMALLEST_TRIAL * period:  # |x| says nothing about the time scale of a vehicle next to the origin
        trial = _SMALLEST_TRIAL * period
    for v in range(first, last):
        for i in range(3):
            work.state[v, i] = x[v, i] + trial * work.slope[0, v, i]
    drift_and_disturbance(follow, medium, effectiveness, t + trial, work.state, first, last, work, work.slope[1])
    for v in range(first, last):
        for i in range(3):
            work.slope[1, v, i] -= work.slope[0, v, i]
    bend = _norm(work.slope[1], x, x, first, last, tolerance) / trial
    if speed <= 1e-15 and bend <= 1e-15:
        step = max(1e-6, trial * 1e-3)
    else:
        step = (0.01 / max(speed, bend)) ** 0.2
    return min(100.0 * trial, step, period)


@part
def take_step(follow, medium, effectiveness, t, h, x, first, last, tolerance, work):
    """Try a step of the vehicles from first to last from t to t + h; return its error, of which 1 is tolerated.

    work.slope[0] holds x' at t; afterwards work.state holds the positions at t + h and work.slope[6] x' there.
    """
    for stage in range(1, 7):
        for v in range(first, last):
            for i in range(3):
                total = 0.0
                for k in range(stage):
                    total += _A[stage, k] * work.slope[k, v, i]
                work.state[v, i] = x[v, i] + h * total
        drift_and_disturbance(
            follow, medium, effectiveness, t + _C[stage] * h, work.state, first, last, work, work.slope[stage]
        )
    for v in range(first, last):
        for i in range(3):
            total = 0.0
            for k in range(7):
                total += _ERROR[k] * work.slope[k, v, i]
            work.slope[1, v, i] = h * total  # no later stage reads this slope
    return _norm(work.slope[1], x, work.state, first, last, tolerance)


@part
def _advance(follow, medium, effectiveness, t, period, x, first, last, tolerance, work):
    """Integrate the vehicles from first to last over one period, in place; False where the solution blows up."""
    drift_and_disturbance(follow, medium, effectiveness, t, x, first, last, work, work.slope[0])
    step = _first_step(follow, medium, effectiveness, t, period, x, first, last, tolerance, work)
    done, rejected, steps = 0.0, False, 0
    while done < period:
        steps += 1
        if steps > _MOST_STEPS or not step > _SMALLEST_STEP * period:  # also where it is NaN
            return False
        h = min(step, period - done)
        error = take_step(follow, medium, effectiveness, t + done, h, x, first, last, tolerance, work)
        if not np.isfinite(error):
            return False
        if error < 1.0:
            factor = 10.0 if error == 0.0 else min(10.0, 0.9 * error**-0.2)
            step = h * (min(1.0, factor) if rejected else factor)
            done = period if h >= period - done else done + h
            rejected = False
            for v in range(first, last):
                for i in range(3):
                    x[v, i] = work.state[v, i]
                    work.slope[0, v, i] = work.slope[6, v, i]
                    if abs(x[v, i]) > _HUGE:
                        return False
        else:
            step = h * max(0.2, 0.9 * error**-0.2)
            rejected = True
    return True


@kernel
def _run(control, follow, medium, effectiveness, times, begin, end, period, x, tolerance, work, positions, placed):
    """Advance from sample `begin` to `end`, recording; return the last sample reached and the vehicle that blew up.

    `follow` is `control` where the law is inside the integrator and None where it is held: another type, so that the
    two are compiled apart, and only the one that is used.
    """
    V = x.shape[0]
    for k in range(begin, end):
        if follow is None:
            velocity_commands(control, times[k], x, work.residual, work.command)
            for v in range(V):
                if not _advance(None, medium, effectiveness, times[k], period, x, v, v + 1, tolerance, work):
                    return k, v
        elif not _advance(follow, medium, effectiveness, times[k], period, x, 0, V, tolerance, work):
            return k, V
        for v in range(V):
            for i in range(3):
                if placed.shape[0] and v >= medium.agents:
                    x[v, i] = placed[k + 1, v - medium.agents, i]
                positions[k + 1, v, i] = x[v, i]
    return end, -1


def run_ideal(
    system: System, progress: Callable[[int, int], None] | None = None, targets: Array | None = None
) -> Trajectory:
    """Integrate a system on ideal kinematics.

    Args:
        system: the system.
        progress: called with (samples done, samples in all).
        targets: where the targets are at each sample, shape (T, V - N, 3), m, whatever their own motion would be; the
            run ends with the last. None integrates them too.

    Returns:
        The trajectory; its status is 'unstable' and it ends early where the solution blows up.
    """
    return next(stream_ideal(system, system.grid.steps + 1, progress, targets))


def stream_ideal(
    system: System,
    samples: int,
    progress: Callable[[int, int], None] | None = None,
    targets: Array | None = None,
) -> Iterator[Trajectory]:
    """Integrate as `run_ideal` does, and hand out so many samples at a time; the last piece has what is left.

    A piece before the last has the status 'finished'. The last is empty where the solution blows up right after the
    piece before it.
    """
    grid = system.grid
    x = np.array(system.initial)
    V, work = len(x), scratch(system.medium, system.effectiveness)
    steps = grid.steps if targets is None else min(grid.steps, len(targets) - 1)
    for begin in range(0, steps + 1, samples):
        end = min(begin + samples, steps + 1)
        first = max(begin - 1, 0)  # the piece is reached from the last sample of the one before
        times, positions = grid.span(first, end), np.empty((end - first, V, 3))
        positions[0] = x
        placed = np.empty((0, V, 3)) if targets is None else np.ascontiguousarray(targets[first:end])
        done, broken, new = 0, -1, begin - first
        while done < end - first - 1:
            done, broken = _run(
                system.control,
                system.control if grid.continuous else None,
                system.medium,
                system.effectiveness,
                times,
                done,
                min(done + _CHUNK, end - first - 1),
                grid.period,
                x,
                system.tolerance,
                work,
                positions,
                placed,
            )
            if progress:
                progress(first + done, steps)
            if broken >= 0:
                if broken == V:  # the team was integrated as one: the largest state names the vehicle
                    broken = int(np.argmax(np.abs(np.nan_to_num(x, nan=np.inf)).max(axis=1)))
                message = blow_up_message(system, broken, float(times[done]), 0.0 if grid.continuous else grid.period)
                yield Trajectory(times[new : done + 1], positions[new : done + 1], "unstable", message)
                return
        yield Trajectory(times[new:], positions[new:], "finished", "")


def inputs(system: System, time: Array, commands: Array, positions: Array) -> Array:
    """u_i = g_i^+(q_i, t) (-k1 eta_i) of every agent at every sample, shape (T, N, s); NaN where an agent has fewer."""
    effectiveness = system.effectiveness
    N = len(system.team.agents)
    u = np.full((len(time), N, effectiveness.pinv.shape[1]), np.nan)
    for i in range(N):
        h = effectiveness.heading[i]
        psi = h[0] + positions[:, i] @ h[1:4] + h[4] * time
        body = commands[:, i].copy()
        if effectiveness.given[i]:
            c, s = np.cos(psi), np.sin(psi)
            body[:, 0], body[:, 1] = (
                c * commands[:, i, 0] + s * commands[:, i, 1],
                c * commands[:, i, 1] - s * commands[:, i, 0],
            )
        used = np.arange(effectiveness.inputs[i])
        u[:, i, used] = body @ effectiveness.pinv[i, used].T
    return u
