"""The ideal backend: q' = f(q, t) + g(q, t) u + omega(t), integrated to a stated tolerance.

With a control period the velocity commands -k1 eta are sampled and held (zero-order hold). Between samples vehicles do
not interact, and each is integrated separately, flow and disturbance included. The allocation
u = g^+ (-k1 eta) follows g(q, t) within a period, as an actuator does. With period 0 the law itself is inside the
integrator, and the team is integrated as one.

The method is Dormand and Prince's pair of order 5(4) (J. Comput. Appl. Math. 6, 1980) with local extrapolation, the
step control and starting step of Hairer, Norsett and Wanner (Solving Ordinary Differential Equations I, II.4). Errors
are measured as the root mean square over the padded state (3 components a vehicle) relative to atol + rtol |x|. The
paper's published run was integrated in the same way, so it is reproduced up to rounding.

The code of a period is inlined into one function for one vehicle (see `inline_jit`), because passing tuples of arrays
to a function costs more than evaluating a slope.
"""

from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array, Room, lay_out, quaternions_of
from mjsheaf.compile.jit import held, inline_jit, jit, pinned
from mjsheaf.law.law import ControlArrays, Memory, Station, evaluate_law, keep_station, new_memory, no_station
from mjsheaf.loop.engine import (
    Engine,
    Log,
    Recorder,
    blow_up_message,
    new_log,
    record_links,
    record_vehicle,
)
from mjsheaf.loop.system import System
from mjsheaf.media.medium import (
    MediumArrays,
    MediumState,
    advance,
    hold,
    medium_velocity,
    new_state,
    unknown_flow,
)
from mjsheaf.vehicles.allocation import EffectivenessArrays, allocate

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
_MOST_STEPS = 50_000  # of the integrator beyond the usual ones: the solution runs into a singularity, or is stiff
_USUAL_STEPS = 2_000  # of the integrator in a period: those above it are counted from period to period


class Integrator(NamedTuple):
    """Model of V vehicles between samples, and the integrator's work arrays.

    Attributes:
        medium, effectiveness: Flow and disturbances around the vehicles, and the map from inputs to velocities.
        tolerance: Relative and absolute error of each step.
        period: Time over which commands are held, s.
        station: Positions that vehicles keep, at every instant.
        memory: Memory of the law.
        state: Positions at a stage, shape (V, 3), m.
        slope: x' at each stage, shape (7, V, 3), m/s.
        input: Input u of an agent, shape (s,).
        medium_state: State of the medium at the present time.
        surplus: Accumulated steps in excess of the usual number per period, reduced by periods that need fewer, by the
            first of the vehicles that are integrated together, shape (V,).
    """

    medium: MediumArrays
    effectiveness: EffectivenessArrays
    tolerance: tuple[float, float]
    period: float
    station: Station
    memory: Memory
    state: Array
    slope: Array
    input: Array
    medium_state: MediumState
    surplus: Array


def new_integrator(
    medium: MediumArrays,
    effectiveness: EffectivenessArrays,
    tolerance: tuple[float, float],
    period: float,
    memory: Memory,
    surplus: Array | None = None,
    station: Station | None = None,
) -> Integrator:
    """Make an integrator for the vehicles in a medium, with the memory of their law.

    `surplus` is that of an earlier integrator; no vehicle keeps a station by default.
    """
    V = len(medium.planar)
    return Integrator(
        medium=medium,
        effectiveness=effectiveness,
        tolerance=tolerance,
        period=period,
        station=no_station(V) if station is None else station,
        memory=memory,
        state=np.zeros((V, 3)),
        slope=np.zeros((7, V, 3)),
        input=np.zeros(effectiveness.pinv.shape[1]),
        medium_state=new_state(medium),
        surplus=np.zeros(V) if surplus is None else surplus,
    )


@inline_jit
def slope_of(follow, run, t, x, first, last, out):
    """Write x' of the vehicles from first to last into out (V, 3), m/s; `follow` is the law, None to hold commands."""
    medium, effectiveness = run.medium, run.effectiveness
    if follow is not None:
        evaluate_law(follow, t, x, None, run.memory)
    advance(medium, t, first, last, run.medium_state)
    for v in range(first, last):
        for i in range(3):
            out[v, i] = run.memory.command[v, i]
        wx, wy, wz = medium_velocity(medium, run.medium_state, v, x[v, 0], x[v, 1], x[v, 2])
        if run.station.holds[v]:
            keep_station(run.station, v, x[v], (wx, wy, wz), out[v])
        if v < medium.agents and effectiveness.given[v]:
            allocate(effectiveness, v, x[v], t, out[v], run.input)
        out[v, 0] += wx
        out[v, 1] += wy
        out[v, 2] += wz


@inline_jit
def _norm(values, x, y, first, last, tolerance):
    """Return the RMS of values relative to atol + rtol max(|x|, |y|), over the vehicles from first to last."""
    total = 0.0
    for v in range(first, last):
        for i in range(3):
            scale = tolerance[1] + tolerance[0] * max(abs(x[v, i]), abs(y[v, i]))
            relative = values[v, i] / scale
            total += relative * relative
    return np.sqrt(total / (3 * (last - first)))


@inline_jit
def _first_step(follow, run, t, x, first, last):
    """Return a step, s, whose error is likely to be within the tolerance; run.slope[0] holds x' at t."""
    period = run.period
    size = _norm(x, x, x, first, last, run.tolerance)
    speed = _norm(run.slope[0], x, x, first, last, run.tolerance)
    trial = min(1e-6 if size < 1e-5 or speed < 1e-5 else 0.01 * size / speed, period)
    if trial < _SMALLEST_TRIAL * period:  # |x| says nothing about the time scale of a vehicle next to the origin
        trial = _SMALLEST_TRIAL * period
    for v in range(first, last):
        for i in range(3):
            run.state[v, i] = x[v, i] + trial * run.slope[0, v, i]
    slope_of(follow, run, t + trial, run.state, first, last, run.slope[1])
    for v in range(first, last):
        for i in range(3):
            run.slope[1, v, i] -= run.slope[0, v, i]
    bend = _norm(run.slope[1], x, x, first, last, run.tolerance) / trial
    if speed <= 1e-15 and bend <= 1e-15:
        step = max(1e-6, trial * 1e-3)
    else:
        step = (0.01 / max(speed, bend)) ** 0.2
    return min(100.0 * trial, step, period)


@inline_jit
def take_step(follow, run, t, h, x, first, last):
    """Try a step of the vehicles from first to last from t to t + h; return its error relative to the tolerance.

    run.slope[0] contains x' at t. On return, run.state contains the positions at t + h, and run.slope[6] x' there.
    """
    for stage in range(1, 7):
        for v in range(first, last):
            for i in range(3):
                total = 0.0
                for k in range(stage):
                    total += _A[stage, k] * run.slope[k, v, i]
                run.state[v, i] = x[v, i] + h * total
        slope_of(follow, run, t + _C[stage] * h, run.state, first, last, run.slope[stage])
    for v in range(first, last):
        for i in range(3):
            total = 0.0
            for k in range(7):
                total += _ERROR[k] * run.slope[k, v, i]
            run.slope[1, v, i] = h * total  # no later stage reads this slope
    return _norm(run.slope[1], x, run.state, first, last, run.tolerance)


@inline_jit
def _advance(follow, run, t, x, first, last):
    """Integrate the vehicles from first to last over one period, in place; return False if the solution blows up.

    run.slope[0] holds x' at t.
    """
    period = run.period
    step = _first_step(follow, run, t, x, first, last)
    done, rejected, steps = 0.0, False, 0
    while done < period:
        steps += 1
        if steps > _USUAL_STEPS:
            run.surplus[first] += 1
        if run.surplus[first] > _MOST_STEPS:
            return False
        if not step > _SMALLEST_STEP * period:  # also true for NaN
            return False
        h = min(step, period - done)
        error = take_step(follow, run, t + done, h, x, first, last)
        if not np.isfinite(error):
            return False
        factor = 10.0 if error == 0.0 else min(10.0, 0.9 * error**-0.2)
        if not error < 1.0:
            step, rejected = h * max(0.2, factor), True
            continue
        step, rejected = h * (min(1.0, factor) if rejected else factor), False  # not larger after a rejected one
        done = period if h >= period - done else done + h
        for v in range(first, last):
            for i in range(3):
                x[v, i] = run.state[v, i]
                run.slope[0, v, i] = run.slope[6, v, i]
                if abs(x[v, i]) > _HUGE:
                    return False
    if steps < _USUAL_STEPS:
        run.surplus[first] = max(run.surplus[first] - (_USUAL_STEPS - steps), 0.0)
    return True


@inline_jit
def _record(run, t, x, k, log):
    """Write sample k at time t: positions x (V, 3), commands just made, and x', kept in run.slope[0]."""
    medium, memory, slope = run.medium, run.memory, run.slope[0]
    record_links(memory.links.heard, memory.y, log, k)
    hold(medium, t, 0, x.shape[0], run.medium_state)
    advance(medium, t, 0, x.shape[0], run.medium_state)
    for v in range(x.shape[0]):
        w = medium_velocity(medium, run.medium_state, v, x[v, 0], x[v, 1], x[v, 2])
        if run.station.holds[v]:
            keep_station(run.station, v, x[v], w, memory.command[v])
        for i in range(3):
            slope[v, i] = memory.command[v, i]
        if v < medium.agents:
            if run.effectiveness.given[v]:
                allocate(run.effectiveness, v, x[v], t, slope[v], log.inputs[k, v])
            else:
                for i in range(3):
                    log.inputs[k, v, i] = memory.command[v, i]
        for i in range(3):
            slope[v, i] += w[i]
        record_vehicle(run, memory, log, k, v, x[v], slope[v], w)


@jit
def _run(control, follow, run, times, advances, x, count, log, placed):
    """Record the samples at `times`, and advance after each of the first `advances`.

    The number of periods taken is added to `count`, shape (1,), here: after Ctrl-C, Python could not count them.

    `follow` is `control` if the law is inside the integrator and None if commands are held. The two have different
    types, so that only the case that is used is compiled.

    Returns:
        The number of samples recorded, and the vehicle that blew up, or -1.
    """
    control, run, log, V, M = pinned(control), pinned(run), pinned(log), x.shape[0], placed.shape[1]
    for k in range(times.shape[0]):
        for v in range(M):
            for i in range(3):
                x[V - M + v, i] = placed[k, v, i]
        evaluate_law(control, times[k], x, None, run.memory)
        _record(run, times[k], x, k, log)
        if k == advances:
            break
        if follow is None:
            for v in range(V):
                if not _advance(None, run, times[k], x, v, v + 1):
                    return k + 1, v
        elif not _advance(control, run, times[k], x, 0, V):
            return k + 1, V
        count[0] += 1
    return times.shape[0], -1


class Ideal(Engine):
    """A run on ideal kinematics; a step is one period between samples."""

    steps_per_sample = 1
    _chunk = 500
    _stride = 1

    def _begin(self) -> None:
        self._timestep = self.system.grid.period
        self._attitude = quaternions_of(self.system.bodies.heading)
        self._count, self._x, self._surplus = np.zeros(1), self.system.initial, np.zeros(len(self.system.initial))
        self._enter()

    def _new_state(self, room: Room) -> tuple[tuple[Array, Array, Array], Memory]:
        """Return room for the steps taken, positions and surplus steps, and a memory before the first sample."""
        V = len(self.system.initial)
        moving = room.take(1), room.take((V, 3)), room.take(V)
        return moving, new_memory(self._control.law, V, room)

    def _enter(self) -> None:
        system = self.system
        before = self._count, self._x, self._surplus
        _, (moving, self.memory) = lay_out(self._new_state)
        for own, value in zip(moving, before, strict=True):
            own[:] = value
        self._count, self._x, self._surplus = moving
        self._integrator = new_integrator(
            system.medium,
            system.effectiveness,
            system.tolerance,
            system.grid.period,
            self.memory,
            self._surplus,
            system.station,
        )
        self._held = held(self._control), held(self._integrator)
        self._unrecorded = self._recorder(1)  # which each sample overwrites

    def _new_log(self, samples: int) -> Log:
        inputs = len(self.system.team.agents), self.system.effectiveness.pinv.shape[1]
        return new_log(samples, self._control.law, inputs=inputs)

    def _control_of(self, system: System) -> ControlArrays:
        return system.control

    def _place_targets(self, recorder: Recorder) -> None:
        k = int(recorder.written[0])
        if k < len(recorder.placed):
            placed = recorder.placed[k]
            self._x[len(self._x) - len(placed) :] = placed

    def _evaluate_law(self) -> None:
        self._record_now(self._unrecorded)  # by the loop: nothing else has to be compiled

    def _record_now(self, recorder: Recorder) -> None:
        self._integrate(self.steps_taken, 1, recorder, advance=False)

    def _move(self, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        done, broken = self._integrate(step, count, recorder, advance=True)
        self._count[0] = step + done
        if broken < 0:
            return None
        if broken == len(self._x):  # the team was integrated as one: the largest state names the vehicle
            broken = int(np.argmax(np.abs(np.nan_to_num(self._x, nan=np.inf)).max(axis=1)))
        return broken, step + done - 1

    def _integrate(self, step: int, count: int, recorder: Recorder, *, advance: bool) -> tuple[int, int]:
        """Record `count` samples from step number `step` on, and advance after each or not.

        Returns:
            The number of samples recorded, and the vehicle that blew up or -1; V if the team was integrated as one.
        """
        row = min(int(recorder.written[0]), len(recorder.log.positions) - count)
        control, integrator = self._held
        done, broken = _run(
            control,
            control if self.system.grid.continuous else None,
            integrator,
            self.system.grid.span(step, step + count),
            count if advance else 0,
            self._x,
            self._count,
            recorder.log.span(row, row + count),
            recorder.placed[row : row + count],
        )
        recorder.written[0] = row + done
        return done, broken

    def _describe_blow_up(self, vehicle: int, step: int) -> str:
        grid = self.system.grid
        detail = ""
        if self._surplus.max(initial=0) > _MOST_STEPS:
            field = "controller.record_period" if grid.continuous else "controller.control_period"
            detail = f" takes more than {_USUAL_STEPS} steps of the integrator for each {field} of {grid.period:g} s"
        speed = f"commanded {float(np.linalg.norm(self.memory.command[vehicle])):.3g} m/s"
        time = grid.start + step * grid.period
        unknown = unknown_flow(self.system.moving, self._integrator.medium_state.parts, vehicle)
        return blow_up_message(self.system, vehicle, detail, time, speed, self.memory, unknown, self.controller)

    def _velocity(self, displacement: Array) -> Array:
        return np.hstack([displacement / self._timestep, np.zeros_like(displacement)])

    def positions(self) -> Array:
        """Positions, padded: agents then targets, shape (V, 3), m."""
        return self._x.copy()

    def quaternions(self) -> Array:
        """Attitudes at the start (w, x, y, z), body to world, shape (V, 4): ideal kinematics have none of their own."""
        return self._attitude.copy()
