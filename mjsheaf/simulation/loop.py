"""The callback before every physics step: the law if it is due, then flow, drag, buoyancy and thrust.

An object of ours that writes into MuJoCo's arrays, not one of MuJoCo's global callbacks: those belong to the whole
process, and slow down or break whatever else it simulates.

What a run on bodies records of each sample, written inside the compiled loop into arrays allocated once.

The loop: the law at its period, forces before each step, MuJoCo's step, and a look at what came out.

The whole loop is compiled; mj_step is called through its C symbol, which frees it from the interpreter.

A whole run on bodies: in one piece, or in pieces as they come.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding
import numpy as np
from numba import types
from numpy.typing import NDArray

from mjsheaf.dynamics.disturbance import evaluate_sines
from mjsheaf.engine import mujoco
from mjsheaf.errors import InputError, UnstableError, expected
from mjsheaf.jit import kernel, part
from mjsheaf.simulation.arena import Arena, compose
from mjsheaf.simulation.autopilot import drive, pack_fleet
from mjsheaf.simulation.forces import measure, push, rotation, to_world, triple
from mjsheaf.simulation.trajectory import Trajectory, blow_up_message
from mjsheaf.system import ControlArrays, MediumArrays, System, velocity_commands

Array = NDArray[np.float64]


class LoopState(NamedTuple):
    """Views of MuJoCo's arrays; x, residual, command (V, 3): where the law sees vehicles, eta, what it wants.

    sines (V K,): of the disturbances, now.
    """

    qpos: Array
    qvel: Array
    qacc: Array
    ctrl: Array
    gear: Array
    applied: Array
    x: Array
    residual: Array
    command: Array
    sines: Array


@kernel
def controlled_position(kind, body, qpos, x):
    """Write the position of a vehicle that the law controls into x (3,): its hand point, or its origin."""
    a = body.qpos
    x[0], x[1] = qpos[a], qpos[a + 1]
    x[2] = 0.0 if kind.planar else qpos[a + 2]
    if kind.hand > 0.0:
        w, i, j, k = qpos[a + 3], qpos[a + 4], qpos[a + 5], qpos[a + 6]
        x[0] += kind.hand * (1.0 - 2.0 * (j * j + k * k))
        x[1] += kind.hand * 2.0 * (i * j + w * k)


@kernel
def close_loop(control, medium, fleet, t, sample, state):
    """All before a physics step: the law if it is due; then each vehicle measures, is pushed, and drives."""
    kinds, bodies = fleet.kinds, fleet.bodies
    if sample:
        for v in range(bodies.shape[0]):
            controlled_position(kinds[bodies[v].kind], bodies[v], state.qpos, state.x[v])
        velocity_commands(control, t, state.x, state.residual, state.command)
    evaluate_sines(medium.harmonics, t, 0, bodies.shape[0], state.sines)
    q = state.qpos
    for v in range(bodies.shape[0]):
        body = bodies[v]
        kind, a, first = kinds[body.kind], body.qpos, body.actuator
        thrusters = fleet.thrusters[kind.thruster : kind.thruster + kind.count]
        ctrl = state.ctrl[first : first + kind.count]
        quaternion = (q[a + 3], q[a + 4], q[a + 5], q[a + 6])
        R = rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])
        s, omega = measure(kind, body, medium, state.sines, v, q, state.qvel, R)
        push(kind, body, q, state.qvel, R, s, omega, state.applied)
        drive(kind, thrusters, body.heading, triple(state.command[v]), R, quaternion, s, omega, ctrl)
        for k in range(kind.count):
            gear, row = to_world(R, triple(thrusters[k].direction)), state.gear[first + k]
            row[0], row[1], row[2] = gear


class BeforeStep:
    """What happens before a physics step, as one callable.

    Attributes:
        control, medium: what onboard computers know, and what surrounds the vehicles.
        fleet: what the vehicles are.
        state: views of MuJoCo's arrays, and scratch; `state.command` holds the commanded velocities (V, 3) in m/s and
            `state.residual` the disagreements (V, 3) in m of the last evaluation of the law.
    """

    def __init__(
        self,
        control: ControlArrays,
        medium: MediumArrays,
        arena: Arena,
        data: mujoco.MjData,
        heading: Array,
        level: float,
    ) -> None:
        """Pack the vehicles of an arena, and take views of the arrays that are read and written.

        Args:
            control, medium: the same as the attributes.
            arena, data: the vehicles and their state.
            heading: that each vehicle holds, shape (V,), rad.
            level: height of the water, m.
        """
        V = len(arena.vehicles)
        self.control = control
        self.medium = medium
        self.fleet = pack_fleet(arena, heading, level)
        self.state = LoopState(
            qpos=data.qpos,
            qvel=data.qvel,
            qacc=data.qacc,
            ctrl=data.ctrl,
            gear=arena.model.actuator_gear,
            applied=data.qfrc_applied,
            x=np.zeros((V, 3)),
            residual=np.zeros((V, 3)),
            command=np.zeros((V, 3)),
            sines=np.zeros(len(medium.harmonics.rate)),
        )

    def __call__(self, time: float, sample: bool) -> None:
        """Write commands and applied forces for the present state; `sample` says whether the law is evaluated."""
        close_loop(self.control, self.medium, self.fleet, time, sample, self.state)


class Log(NamedTuple):
    """Samples of a run, T of them, of which the first `written` are there.

    positions (T, V, 3) m: where the law sees the vehicles; quaternions (T, V, 4); heights (T, V) m, of the bodies;
    thrust (T, A): thruster commands; saturation (T, V): share of thrusters at a limit; placed (T, V - N, 3) m: where
    targets are put at each sample, or (0, V - N, 3) to leave them to their bodies; written (1,).
    """

    positions: Array
    quaternions: Array
    heights: Array
    thrust: Array
    saturation: Array
    placed: Array
    written: NDArray[np.int64]


def new_log(samples: int, vehicles: int, thrusters: int, placed: Array | None = None) -> Log:
    """A log for so many samples; 0 samples record nothing."""
    return Log(
        positions=np.empty((samples, vehicles, 3)),
        quaternions=np.empty((samples, vehicles, 4)),
        heights=np.empty((samples, vehicles)),
        thrust=np.empty((samples, thrusters)),
        saturation=np.empty((samples, vehicles)),
        placed=np.empty((0, 0, 3)) if placed is None else np.ascontiguousarray(placed),
        written=np.zeros(1, dtype=np.int64),
    )


@part
def place_targets(fleet, log, state):
    """Put every target where the log wants its controlled position at this sample, with its attitude and speed."""
    k, bodies = log.written[0], fleet.bodies
    agents = bodies.shape[0] - log.placed.shape[1]
    if k >= log.placed.shape[0]:
        return
    for v in range(agents, bodies.shape[0]):
        x, body, kind = state.x[v], bodies[v], fleet.kinds[bodies[v].kind]
        controlled_position(kind, body, state.qpos, x)
        for i in range(2 if kind.planar else 3):
            state.qpos[body.qpos + i] += log.placed[k, v - agents, i] - x[i]


@part
def record(fleet, state, log):
    """Write the present state, and the commands just made for it, as the next sample."""
    k = log.written[0]
    log.written[0] = k + 1
    for v in range(fleet.bodies.shape[0]):
        body = fleet.bodies[v]
        kind, a = fleet.kinds[body.kind], body.qpos
        controlled_position(kind, body, state.qpos, log.positions[k, v])
        log.heights[k, v] = state.qpos[a + 2]
        for i in range(4):
            log.quaternions[k, v, i] = state.qpos[a + 3 + i]
        at_limit = 0
        for j in range(kind.count):
            command, thruster = state.ctrl[body.actuator + j], fleet.thrusters[kind.thruster + j]
            log.thrust[k, body.actuator + j] = command
            at_limit += command <= thruster.low or command >= thruster.high
        log.saturation[k, v] = at_limit / kind.count


# The very library that the Python bindings use; numba binds the name when it links compiled code.
for _library in Path(mujoco.__file__).parent.glob("libmujoco*"):
    llvmlite.binding.load_library_permanently(str(_library))
_mj_step = types.ExternalFunction("mj_step", types.void(types.voidptr, types.voidptr))

_HUGE = 1e10  # beyond this MuJoCo calls a state bad (mjMAXVAL)
_CHUNK = 200_000  # physics steps times vehicles in one compiled call, after which Ctrl-C is heard


@part
def _is_bad(value):
    """Whether MuJoCo would call a number bad: it is not finite, or huge."""
    return not abs(value) < _HUGE


@kernel
def _first_bad(values):
    """Index of the first bad entry, or -1."""
    bad = 0
    for i in range(values.shape[0]):  # no early exit: compiled to vector instructions
        bad += _is_bad(values[i])
    if bad > 0:
        for i in range(values.shape[0]):
            if _is_bad(values[i]):
                return i
    return -1


@kernel
def _bad_vehicle(bodies, state):
    """The first vehicle whose position, velocity or acceleration is bad, or -1."""
    if _first_bad(state.qpos) < 0 and _first_bad(state.qvel) < 0 and _first_bad(state.qacc) < 0:
        return -1
    for v in range(bodies.shape[0]):
        a, d = bodies[v].qpos, bodies[v].dof
        if (
            _first_bad(state.qpos[a : a + 7]) >= 0
            or _first_bad(state.qvel[d : d + 6]) >= 0
            or _first_bad(state.qacc[d : d + 6]) >= 0
        ):
            return v
    return -1


@kernel
def _owner(bodies, actuator):
    """The vehicle that has an actuator."""
    v = bodies.shape[0] - 1
    while bodies[v].actuator > actuator:
        v -= 1
    return v


@kernel
def _advance(control, medium, fleet, start, timestep, step, count, per_law, per_sample, state, model, data, log):
    """Take `count` steps from step number `step`; return how many were taken, and the vehicle that went bad or -1.

    The law is evaluated every `per_law` steps. While the log has room, a sample is recorded every `per_sample` steps.
    """
    for k in range(step, step + count):
        sample = k % per_sample == 0 and log.written[0] < log.heights.shape[0]
        if sample:
            place_targets(fleet, log, state)
        close_loop(control, medium, fleet, start + k * timestep, k % per_law == 0, state)
        if sample:
            record(fleet, state, log)
        # MuJoCo sets all commands to zero where one is bad, and goes on: that would be another simulation.
        bad = _first_bad(state.ctrl)
        if bad >= 0:
            return k - step, _owner(fleet.bodies, bad)
        _mj_step(model, data)
        bad = _bad_vehicle(fleet.bodies, state)
        if bad >= 0:
            return k + 1 - step, bad
    return count, -1


class World:
    """A scenario on MuJoCo bodies, with the loop closed.

    Attributes:
        system: the closed-loop system.
        arena: where each vehicle is in the model. By name: vehicle A1 has the free joint `A1/`, and everything that is
            its own (bodies, geoms, sites, actuators) has that prefix: `A1/thruster_left`. `actuators` gives the
            actuators of a vehicle by its id. Vehicles of one kind share the materials of the first.
        model, data: MuJoCo's own. The state may be read and set between steps; each step overwrites `data.ctrl`,
            `data.qfrc_applied` of the vehicles and `model.actuator_gear`. Forces of your own go to
            `data.xfrc_applied`; of a vehicle with added mass only the rigid body feels them: multiply by
            `vehicle.share`.
    """

    def __init__(self, scenario: Any, *, visible: bool = True) -> None:
        """Compose the arena and put every vehicle at its initial position and heading.

        Args:
            scenario: a Scenario, or the System that one describes.
            visible: False for a model without the geoms that are only to be seen: the same motion to the bit, sooner.

        Raises:
            InputError: a vehicle is unknown, or does not fit the dimension of its agent or target.
        """
        self.system: System = scenario if isinstance(scenario, System) else scenario.system
        self.arena = arena_of(self.system, visible=visible)
        self.model: mujoco.MjModel = self.arena.model
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        plan, grid = self.system.bodies, self.system.grid
        self._steps_per_sample = whole_ratio(grid.period, plan.timestep)
        self._steps_per_law = 1 if grid.continuous else self._steps_per_sample
        # The timestep that divides a period exactly: sample times then agree with the ideal backend's.
        self._timestep = grid.period / self._steps_per_sample
        self.model.opt.timestep = self._timestep
        self._before_step = BeforeStep(
            self.system.control, self.system.medium, self.arena, self.data, plan.heading, plan.surface_height
        )
        self._chunk = max(1, min(4000, _CHUNK // len(self.arena.vehicles)))
        self._no_log = new_log(0, len(self.arena.vehicles), self.model.nu)
        self.reset()

    @property
    def time(self) -> float:
        """Simulated time in s."""
        return self.system.grid.start + self._step * self._timestep

    @property
    def _step(self) -> int:
        """Physics steps since the start, by MuJoCo's clock: those count that were taken without `step`."""
        return round((self.data.time - self.system.grid.start) / self._timestep)

    @property
    def steps_per_sample(self) -> int:
        """Physics steps between samples."""
        return self._steps_per_sample

    def reset(self) -> None:
        """Go back to the initial condition.

        Where a command is bad there already, `data` has positions but no forces, and `step` raises UnstableError.
        """
        mujoco.mj_resetData(self.model, self.data)
        plan, initial = self.system.bodies, self.system.initial
        self.data.time = self.system.grid.start
        for v, vehicle in enumerate(self.arena.vehicles):
            at, heading = self.arena.qpos[v], plan.heading[v]
            self.data.qpos[at : at + 3] = initial[v] - vehicle.hand * np.array([np.cos(heading), np.sin(heading), 0.0])
            if vehicle.dimension == 2:
                self.data.qpos[at + 2] = plan.surface_height
            self.data.qpos[at + 3 : at + 7] = [np.cos(heading / 2), 0, 0, np.sin(heading / 2)]
        trim = np.concatenate([vehicle.trim for vehicle in self.arena.vehicles])
        lags = np.flatnonzero(self.model.actuator_actadr >= 0)  # rotors turn before a multirotor is let go
        self.data.act[self.model.actuator_actadr[lags]] = trim[lags]
        self.close_loop(sample=True)
        if _first_bad(self.data.ctrl) < 0:
            mujoco.mj_forward(self.model, self.data)
        else:  # MuJoCo would warn and take others; `step` raises
            mujoco.mj_fwdPosition(self.model, self.data)

    def close_loop(self, sample: bool | None = None) -> None:
        """Write commands and forces for the present state, without stepping.

        This is what happens before every physics step. Call it yourself to step with `mujoco.mj_step`; `step` calls
        it for you.

        Args:
            sample: whether the law is evaluated; None evaluates it when its period is due.
        """
        if sample is None:
            sample = self._step % self._steps_per_law == 0
        self._before_step(self.time, sample)

    def step(self, n: int = 1) -> None:
        """Take n physics steps with the loop closed.

        Raises:
            UnstableError: the state became bad; the message names vehicle, time and likely cause. `data` holds the
                bad state.
        """
        while n > 0:
            n -= self._advance(min(n, self._chunk), self._no_log)

    def _advance(self, count: int, log: Log) -> int:
        """Take `count` steps, recording samples where the log has room; return `count`."""
        callback = self._before_step
        _, bad = _advance(
            callback.control,
            callback.medium,
            callback.fleet,
            self.system.grid.start,
            self._timestep,
            self._step,
            count,
            self._steps_per_law,
            self._steps_per_sample,
            callback.state,
            self.model._address,
            self.data._address,
            log,
        )
        if bad >= 0:
            raise UnstableError(self._blow_up(bad))
        return count

    def record(
        self, samples: int, targets: Array | None, progress: Callable[[int, int], None] | None
    ) -> Iterator[tuple[Log, str]]:
        """Take a sample now and after each period, up to the end of the system's time or of `targets`.

        Args:
            samples: how many to hand out at a time; the last piece has what is left.
            targets: where the targets are put, as for `run_physics`.
            progress: called with (samples done, samples in all).

        Yields:
            A log, and what went wrong; empty where nothing did.
        """
        of = self.system.grid.steps + 1 if targets is None else min(self.system.grid.steps + 1, len(targets))
        for begin in range(0, of, samples):
            end = min(begin + samples, of)
            placed = None if targets is None else targets[begin:end]
            log = new_log(end - begin, len(self.arena.vehicles), self.model.nu, placed)
            left = (end - begin - (end == of)) * self._steps_per_sample
            try:
                while left > 0:
                    left -= self._advance(min(left, self._chunk), log)
                    if progress:
                        progress(begin + int(log.written[0]) - 1, of - 1)
            except UnstableError as error:
                yield log, str(error)
                return
            if end == of:
                before = self._before_step
                place_targets(before.fleet, log, before.state)
                self.close_loop(sample=True)
                record(before.fleet, before.state, log)
                if progress:
                    progress(of - 1, of - 1)
            yield log, ""

    def _blow_up(self, vehicle: int) -> str:
        at = self.arena.dof[vehicle]
        speed = float(np.linalg.norm(self.data.qvel[at : at + 3]))
        detail = f" (body '{self.arena.vehicles[vehicle].name}', speed {speed:.3g} m/s)"
        period = self._timestep * self._steps_per_law
        return blow_up_message(self.system, vehicle, self.time, period, detail)

    def actuators(self, id: str) -> NDArray[np.int64]:
        """Indices of a vehicle's actuators in `model` and in `data.ctrl`, in the order of `result.nc`'s thrusters.

        For example `world.model.actuator_gainprm[world.actuators("A1"), 0] = 0` stops all thrusters of A1.

        Args:
            id: of an agent or a target.

        Raises:
            InputError: there is no such vehicle.
        """
        ids = [m.id for m in self.system.team.members]
        if id not in ids:
            raise InputError(f"unknown vehicle {id!r}; {expected(id, ids)}")
        first, end = self.arena.thruster[ids.index(id) :][:2]
        return np.arange(first, end)

    def positions(self) -> Array:
        """Controlled positions, padded: agents then targets, z = 0 for planar ones; shape (V, 3), m."""
        x, fleet = np.empty((len(self.arena.vehicles), 3)), self._before_step.fleet
        for v in range(len(x)):
            body = fleet.bodies[v]
            controlled_position(fleet.kinds[body["kind"]], body, self.data.qpos, x[v])
        return x

    def heights(self) -> Array:
        """z of every body, floating ones included, shape (V,), m."""
        return self.data.qpos[self.arena.qpos + 2].copy()

    def quaternions(self) -> Array:
        """Attitudes (w, x, y, z), body to world, shape (V, 4)."""
        return self.data.qpos[self.arena.qpos[:, None] + np.arange(3, 7)]

    def saturation(self) -> Array:
        """Share of each vehicle's thrusters whose command is at its limit, shape (V,)."""
        low, high = np.concatenate([vehicle.limits for vehicle in self.arena.vehicles]).T
        first = self.arena.thruster
        at_limit = (self.data.ctrl <= low) | (self.data.ctrl >= high)
        return np.add.reduceat(at_limit.astype(float), first[:-1]) / np.diff(first)


def whole_ratio(period: float, timestep: float) -> int:
    """How many physics steps make a period.

    Raises:
        InputError: not a whole number.
    """
    ratio = period / timestep
    if not (0.5 < ratio < 1e9 and abs(ratio - round(ratio)) <= 1e-6 * ratio):
        raise InputError(
            f"physics.timestep: {timestep} s does not divide controller.control_period (or record_period), {period} s; "
            "the period must be a whole multiple of it"
        )
    return round(ratio)


def arena_of(system: System, colours: Array | None = None, visible: bool = True) -> Arena:
    """Compose the arena of a system; colours (V, 3) paint the vehicles, and they need not be visible."""
    plan = system.bodies
    return compose(
        system.vehicles,
        [m.id for m in system.team.members],
        timestep=plan.timestep,
        contacts=plan.contacts,
        surface=plan.surface,
        surface_height=plan.surface_height,
        colours=colours,
        visible=visible,
    )


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
