"""The loop on bodies: the law at its period, forces before each step, MuJoCo's step, and a look at what came out.

What happens before a step is a function of ours that writes into MuJoCo's arrays, not one of MuJoCo's global callbacks:
those belong to the whole process, and slow down or break whatever else it simulates. The whole loop is compiled;
mj_step is called through its C symbol, which frees it from the interpreter. Samples are recorded inside the loop, into
arrays allocated once.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding
import numpy as np
from numba import types
from numpy.typing import NDArray

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.control.controller import Controller, Law, controller_of
from mjsheaf.control.law import ControlArrays, LawArrays, Memory, carry, evaluate_law, new_memory
from mjsheaf.dynamics.disturbance import evaluate_sines
from mjsheaf.engine import mujoco
from mjsheaf.errors import InputError, UnstableError, expected
from mjsheaf.jit import inline_jit, jit
from mjsheaf.simulation.arena import Arena, compose
from mjsheaf.simulation.bodies import (
    Fleet,
    Sensed,
    apply_wrench,
    medium_wrench,
    pack_fleet,
    thruster_commands,
    turn_gears,
    velocity_through_medium,
)
from mjsheaf.simulation.trajectory import (
    Log,
    Trajectory,
    blow_up_message,
    new_log,
    pieces_of,
    quaternions_of,
    record_links,
)
from mjsheaf.system import MediumArrays, Phase, System, medium_velocity, phases_of
from mjsheaf.vehicles.actuators import ANGLE
from mjsheaf.vehicles.vectors import rotation, triple


class Loop(NamedTuple):
    """The closed loop, for compiled code: views of MuJoCo's arrays, and what is kept beside them.

    Attributes:
        control, medium, fleet: what onboard computers know, what surrounds the vehicles, what the vehicles are.
        qpos, qvel, qacc, ctrl, act, applied: MuJoCo's own; `applied` is qfrc_applied.
        gear, gain, lag: of the actuators: actuator_gear, actuator_gainprm, actuator_actadr.
        x: where the law sees the vehicles, padded, shape (V, 3), m.
        drift: of the medium that carries each vehicle, as it measures it, shape (V, 3), m/s.
        memory: of the law.
        sines: of the disturbances, now, shape (V K,).
        model, data: addresses of MuJoCo's own.
        start: time of step 0, s.
        timestep: s.
        per_law, per_sample: physics steps between evaluations of the law, and between samples.
        stopped: whether each vehicle's thrusters stand still, shape (V,).
    """

    control: ControlArrays
    medium: MediumArrays
    fleet: Fleet
    qpos: Array
    qvel: Array
    qacc: Array
    ctrl: Array
    act: Array
    applied: Array
    gear: Array
    gain: Array
    lag: NDArray[np.int32]
    x: Array
    drift: Array
    memory: Memory
    sines: Array
    model: int
    data: int
    stopped: BoolArray
    start: float = 0.0
    timestep: float = 0.0
    per_law: int = 1
    per_sample: int = 1


class Recorder(NamedTuple):
    """Where samples go.

    Attributes:
        log: T samples.
        placed: where targets are put at each sample, shape (T, V - N, 3), m; (0, 0, 3) leaves them to their bodies.
        written: how many samples are there, shape (1,).
    """

    log: Log
    placed: Array
    written: IntArray


@jit
def controlled_positions(fleet, qpos, x):
    """Write the positions that the law controls into x (V, 3), z = 0 for planar ones: hand points, or origins."""
    for v in range(fleet.bodies.shape[0]):
        kind, a = fleet.kinds[fleet.bodies[v].kind], fleet.bodies[v].qpos
        x[v, 0], x[v, 1] = qpos[a], qpos[a + 1]
        x[v, 2] = 0.0 if kind.planar else qpos[a + 2]
        if kind.hand > 0.0:
            w, i, j, k = qpos[a + 3], qpos[a + 4], qpos[a + 5], qpos[a + 6]
            x[v, 0] += kind.hand * (1.0 - 2.0 * (j * j + k * k))
            x[v, 1] += kind.hand * 2.0 * (i * j + w * k)


@jit
def close_loop(loop, t, due, count):
    """All before a physics step: the law if it is due; then each of `count` vehicles measures, is pushed, drives."""
    medium, kinds, bodies, q = loop.medium, loop.fleet.kinds, loop.fleet.bodies, loop.qpos
    evaluate_sines(medium.harmonics, t, 0, bodies.shape[0], loop.sines)
    if due:
        controlled_positions(loop.fleet, loop.qpos, loop.x)
        if loop.control.law.terms.drift > 0.0:
            for v in range(bodies.shape[0]):
                a, planar = bodies[v].qpos, kinds[bodies[v].kind].planar
                w = medium_velocity(medium, loop.sines, v, q[a], q[a + 1], 0.0 if planar else q[a + 2])
                loop.drift[v, 0], loop.drift[v, 1], loop.drift[v, 2] = w[0], w[1], w[2]
        attitude = loop.memory.links.attitude
        for v in range(attitude.shape[0]):
            for i in range(4):
                attitude[v, i] = q[bodies[v].qpos + 3 + i]
        evaluate_law(loop.control, t, loop.x, loop.drift, loop.memory)
    for v in range(count):
        body = bodies[v]
        kind = kinds[body.kind]
        R, _, force, moment = sense_and_command(loop, v)
        apply_wrench(kind, body, loop.qvel, R, force, moment, loop.applied)
        gear = loop.gear[body.actuator : body.actuator + kind.count]
        turn_gears(kind, loop.fleet.thrusters[kind.thruster :], R, loop.act[body.state :], gear)


@inline_jit
def sense_and_command(loop, v):
    """Let vehicle v measure and write its commands.

    Returns:
        Its attitude (9,) and rates, and force and moment of the medium (see `medium_wrench`); body axes, (3,) each.
    """
    q, body = loop.qpos, loop.fleet.bodies[v]
    kind, a, first = loop.fleet.kinds[body.kind], body.qpos, body.actuator
    thrusters = loop.fleet.thrusters[kind.thruster : kind.thruster + kind.count]
    ctrl = loop.ctrl[first : first + kind.count]
    quaternion = (q[a + 3], q[a + 4], q[a + 5], q[a + 6])
    R = rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])
    s = velocity_through_medium(kind, body, loop.medium, loop.sines, v, q, loop.qvel, R)
    omega = triple(loop.qvel[body.dof + 3 :])
    force, moment = medium_wrench(kind, q[a + 2], R, s, omega)
    sensed, act = Sensed(R, quaternion, s, omega), loop.act[body.state :]
    thruster_commands(kind, thrusters, body.heading, triple(loop.memory.command[v]), sensed, act, ctrl)
    if loop.stopped[v]:
        for j in range(kind.count):
            if thrusters[j].code != ANGLE:
                ctrl[j] = 0.0
    return R, omega, force, moment


@jit
def place_targets(fleet, qpos, x, recorder):
    """Put every target where its controlled position is wanted at this sample, with its attitude and speed.

    x (V, 3) is overwritten.
    """
    k, bodies = recorder.written[0], fleet.bodies
    agents = bodies.shape[0] - recorder.placed.shape[1]
    if k >= recorder.placed.shape[0]:
        return
    controlled_positions(fleet, qpos, x)
    for v in range(agents, bodies.shape[0]):
        for i in range(2 if fleet.kinds[bodies[v].kind].planar else 3):
            qpos[bodies[v].qpos + i] += recorder.placed[k, v - agents, i] - x[v, i]


@inline_jit
def record(loop, log, k, first, last):
    """Write the state and the commands just made for it of vehicles from first up to last as sample k.

    Links go with vehicle 0.
    """
    if first == 0:
        record_links(loop.memory, log, k)
    fleet = loop.fleet
    for v in range(first, last):
        body = fleet.bodies[v]
        kind, a, d = fleet.kinds[body.kind], body.qpos, body.dof
        x, y, z = loop.qpos[a], loop.qpos[a + 1], loop.qpos[a + 2]
        w = medium_velocity(loop.medium, loop.sines, v, x, y, 0.0 if kind.planar else z)
        for i in range(3):
            log.positions[k, v, i] = loop.x[v, i]
            log.residual[k, v, i] = loop.memory.residual[v, i]
            log.command[k, v, i] = loop.memory.command[v, i]
            log.velocity[k, v, i] = loop.qvel[d + i]
            log.medium[k, v, i] = w[i]
            log.origin[k, v, i] = loop.qpos[a + i]
        for i in range(4):
            log.quaternions[k, v, i] = loop.qpos[a + 3 + i]
        at_limit = 0
        for j in range(kind.count):
            n, thruster = body.actuator + j, fleet.thrusters[kind.thruster + j]
            command = loop.ctrl[n]
            log.thruster_command[k, n] = command
            late = loop.act[loop.lag[n]] if loop.lag[n] >= 0 else command
            log.thruster_output[k, n] = late if thruster.code == ANGLE else loop.gain[n, 0] * late
            at_limit += command <= thruster.low or command >= thruster.high
        log.saturation[k, v] = at_limit / kind.count


# The very library that the Python bindings use; numba binds the name when it links compiled code.
for _library in Path(mujoco.__file__).parent.glob("libmujoco*"):
    llvmlite.binding.load_library_permanently(str(_library))
_mj_step = types.ExternalFunction("mj_step", types.void(types.voidptr, types.voidptr))

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
HUGE = 1e10  # beyond this MuJoCo calls a state bad (mjMAXVAL)
_CHUNK = 200_000  # physics steps times vehicles in one compiled call, after which Ctrl-C is heard


@jit
def _is_bad(values):
    """Whether MuJoCo would call one of the numbers bad: it is not finite, or huge."""
    bad = 0
    for i in range(values.shape[0]):  # no early exit: compiled to vector instructions
        bad += not abs(values[i]) < HUGE
    return bad > 0


@jit
def _advance(loop, step, count, recorder):
    """Take `count` steps from step number `step`, or fewer where the state becomes bad; return whether it did.

    While the recorder has room, a sample is recorded every `loop.per_sample` steps.
    """
    for k in range(step, step + count):
        recorded = k % loop.per_sample == 0 and recorder.written[0] < recorder.log.positions.shape[0]
        if recorded:
            place_targets(loop.fleet, loop.qpos, loop.x, recorder)
        close_loop(loop, loop.start + k * loop.timestep, k % loop.per_law == 0, loop.fleet.bodies.shape[0])
        if recorded:
            record(loop, recorder.log, recorder.written[0], 0, loop.fleet.bodies.shape[0])
            recorder.written[0] += 1
        # MuJoCo sets all commands to zero where one is bad, and goes on: that would be another simulation.
        if _is_bad(loop.ctrl):
            return True
        _mj_step(loop.model, loop.data)
        if _is_bad(loop.qpos) or _is_bad(loop.qvel) or _is_bad(loop.qacc):
            return True
    return False


def new_loop(
    arena: Arena, data: mujoco.MjData, control: ControlArrays, medium: MediumArrays, heading: Array, level: float
) -> Loop:
    """The loop about an arena, its times still open.

    Args:
        arena, data: the vehicles and their state.
        control, medium: what onboard computers know, and what surrounds the vehicles.
        heading: that each vehicle holds, shape (V,), rad.
        level: height of the water, m.
    """
    V, model = len(arena.vehicles), arena.model
    return Loop(
        control=control,
        medium=medium,
        fleet=pack_fleet(arena.vehicles, model.dof_damping.reshape(-1, 6), heading, level, model.opt.timestep),
        qpos=data.qpos,
        qvel=data.qvel,
        qacc=data.qacc,
        ctrl=data.ctrl,
        act=data.act,
        applied=data.qfrc_applied,
        gear=model.actuator_gear,
        gain=model.actuator_gainprm,
        lag=model.actuator_actadr,
        x=np.zeros((V, 3)),
        drift=np.zeros((V, 3)),
        memory=new_memory(control.law, V),
        sines=np.zeros(len(medium.harmonics.rate)),
        model=model._address,
        data=data._address,
        stopped=np.zeros(V, dtype=np.bool_),
    )


class ClosedLoop(ABC):
    """A run on bodies with the loop closed: its phases, its law and its samples, whatever moves the bodies.

    Subclasses make `_loop` before they call `_begin`, count steps and move the bodies.

    Attributes:
        system: the closed-loop system; of a run with phases, that of the present one.
        steps_per_sample: physics steps between samples.
    """

    _loop: Loop

    def __init__(self, run: System | Sequence[Phase], controller: Law | Controller | None, seed: int) -> None:
        """Take over a run; arguments as of `World`."""
        self._phases = phases_of(run)
        self.system: System = self._phases[0].system
        grid, self._vehicles = self.system.grid, self.system.vehicles
        self._controller = controller_of(controller, self.system, seed)
        self.steps_per_sample = whole_ratio(grid.period, self.system.bodies.timestep)
        # The timestep that divides a period exactly: sample times then agree with the ideal backend's.
        self._timestep = grid.period / self.steps_per_sample
        self._chunk = max(1, min(4000, _CHUNK // len(self._vehicles)))
        self._first_thruster = np.cumsum([0, *(len(vehicle.channels) for vehicle in self._vehicles)])

    def _begin(self, loop: Loop) -> None:
        """Complete the loop."""
        self._loop = loop._replace(
            stopped=self._stopped(),
            start=self.system.grid.start,
            timestep=self._timestep,
            per_law=1 if self.system.grid.continuous else self.steps_per_sample,
            per_sample=self.steps_per_sample,
        )
        self._unrecorded = self._recorder(0, self.system.law)

    @property
    @abstractmethod
    def _step(self) -> int:
        """Physics steps since the start."""

    @abstractmethod
    def _move(self, loop: Loop, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        """Take `count` steps; where the state becomes bad, say of which vehicle, and at which step."""

    @property
    def time(self) -> float:
        """Simulated time in s."""
        return self.system.grid.start + self._step * self._timestep

    @property
    def command(self) -> Array:
        """Velocities that the law asks for, of its last evaluation, shape (V, 3), m/s."""
        return self._loop.memory.command

    @property
    def disagreement(self) -> Array:
        """eta of the agents, L_T p - c_T of the targets, at the law's last evaluation, shape (V, 3), m."""
        return self._loop.memory.residual

    def _place(self) -> None:
        """Put the vehicles where they begin, with an empty memory; rotors turn before a multirotor is let go."""
        plan, initial = self.system.bodies, self.system.initial
        x, hand = self._loop.qpos.reshape(-1, 7), np.array([[vehicle.steering.hand] for vehicle in self._vehicles])
        x[:, :3] = initial
        x[:, :2] -= hand * np.column_stack([np.cos(plan.heading), np.sin(plan.heading)])
        x[[vehicle.dimension == 2 for vehicle in self._vehicles], 2] = plan.surface_height
        x[:, 3:] = quaternions_of(plan.heading)
        trim = np.concatenate([vehicle.trim for vehicle in self._vehicles])
        self._loop.act[:] = trim[self._loop.lag >= 0]
        self._enter_phase().memory.flat[:] = 0.0
        if self._controller:  # it is called at the first step, and asks for nothing until then
            self._controller.reset()
        close_loop(self._loop, self.time, True, len(self._vehicles))

    def close_loop(self, sample: bool | None = None) -> None:
        """Write commands and forces for the present state, without stepping.

        This is what happens before every physics step. Call it yourself to step with `mujoco.mj_step`; `step` calls
        it for you.

        Args:
            sample: whether the law is evaluated; None evaluates it when its period is due.
        """
        self._enter_phase()
        if sample is None:
            sample = self._step % self._loop.per_law == 0
        if sample:
            self._consult()
        close_loop(self._loop, self.time, sample, len(self._vehicles))

    def step(self, n: int = 1) -> None:
        """Take n physics steps with the loop closed.

        Raises:
            UnstableError: the state became bad; the message names vehicle, time and likely cause.
            InputError: a law in Python raised an exception, or asked for no velocity.
        """
        while n > 0:
            n -= self._advance(min(n, self._chunk), self._unrecorded)

    def _advance(self, count: int, recorder: Recorder) -> int:
        """Take up to `count` steps within one phase and, of a law in Python, one period; return how many."""
        step, loop = self._step, self._enter_phase()
        ahead = (phase.start * loop.per_sample - step for phase in self._phases)
        count = min([count, *(steps for steps in ahead if steps > 0)])
        if self._controller:
            if step % loop.per_law == 0:
                place_targets(loop.fleet, loop.qpos, loop.x, recorder)
                self._consult()
            count = min(count, loop.per_law - step % loop.per_law)
        bad = self._move(loop, step, count, recorder)
        if bad:
            raise UnstableError(self._blow_up(*bad))
        return count

    def _enter_phase(self) -> Loop:
        """The loop of the phase that the present step belongs to."""
        sample = max(self._step // self.steps_per_sample, 0)
        system = [phase.system for phase in self._phases if phase.start <= sample][-1]
        if system is not self.system:
            self.system = system
            control = self._control()
            memory = carry(self._loop.memory, control.law)
            self._loop = self._loop._replace(control=control, memory=memory, stopped=self._stopped())
        return self._loop

    def _stopped(self) -> BoolArray:
        """Whether each vehicle's thrusters stand still now, shape (V,)."""
        stopped = self.system.stopped
        return np.zeros(len(self._vehicles), dtype=np.bool_) if stopped is None else stopped

    def _control(self) -> ControlArrays:
        """What onboard computers know now; a law in Python takes the agents over."""
        control = self.system.control_of_bodies
        return self._controller.enter(self.system.team, control) if self._controller else control

    def _consult(self) -> None:
        """Let a law in Python, where there is one, say what it wants now."""
        if self._controller:
            N, memory = len(self.system.team.agents), self._loop.memory
            velocity, attitude = self._loop.qvel.reshape(-1, 6)[:N, :3].copy(), self.quaternions()[:N]
            if len(memory.links.attitude):
                memory.links.attitude[:] = self.quaternions()
            law, x = self._loop.control.law, self.positions()
            self._controller.supply(law, self.time, x, memory, velocity, attitude, bodies=True)

    def record(
        self, samples: int, targets: Array | None, progress: Callable[[int, int], None] | None
    ) -> Iterator[Trajectory]:
        """Take a sample now and after each period, up to the end of the run's time or of `targets`; in pieces.

        Args:
            samples: at most in each piece.
            targets: where the targets are put, as for `stream_physics`.
            progress: called with (samples done, samples in all).
        """
        grid = self.system.grid
        of = grid.steps + 1 if targets is None else min(grid.steps + 1, len(targets))
        for system, begin, end in pieces_of(self._phases, samples, of):
            recorder = self._recorder(end - begin, system.law, None if targets is None else targets[begin:end])
            left, message = (end - begin - (end == of)) * self.steps_per_sample, ""
            try:
                while left > 0:
                    left -= self._advance(min(left, self._chunk), recorder)
                    if progress:
                        progress(begin + int(recorder.written[0]) - 1, of - 1)
                if end == of:
                    loop = self._enter_phase()
                    place_targets(loop.fleet, loop.qpos, loop.x, recorder)
                    self.close_loop(sample=True)
                    record(self._loop, recorder.log, int(recorder.written[0]), 0, len(self._vehicles))
                    recorder.written[0] += 1
                    if progress:
                        progress(of - 1, of - 1)
            except UnstableError as error:
                message = str(error)
            done = int(recorder.written[0])
            yield Trajectory(system, grid.span(begin, begin + done), recorder.log.span(0, done), message)
            if message:
                return

    def _recorder(self, T: int, law: LawArrays, placed: Array | None = None) -> Recorder:
        """A place for T samples; 0 records nothing."""
        log = new_log(T, law, actuators=len(self._loop.ctrl))
        placed = np.empty((0, 0, 3)) if placed is None else np.ascontiguousarray(placed)
        return Recorder(log, placed, np.zeros(1, dtype=np.int64))

    def _blow_up(self, vehicle: int, step: int) -> str:
        """Name the vehicle that was bad at a step."""
        speed = float(np.linalg.norm(self._loop.qvel[6 * vehicle :][:3]))
        detail = f" (body '{self._vehicles[vehicle].name}', speed {speed:.3g} m/s)"
        time = self.system.grid.start + step * self._timestep
        return blow_up_message(self.system, vehicle, time, self._timestep * self._loop.per_law, detail)

    def positions(self) -> Array:
        """Controlled positions, padded: agents then targets, z = 0 for planar ones; shape (V, 3), m."""
        x = np.empty((len(self._vehicles), 3))
        controlled_positions(self._loop.fleet, self._loop.qpos, x)
        return x

    def heights(self) -> Array:
        """z of every body, floating ones included, shape (V,), m."""
        return self._loop.qpos.reshape(-1, 7)[:, 2].copy()

    def quaternions(self) -> Array:
        """Attitudes (w, x, y, z), body to world, shape (V, 4)."""
        return self._loop.qpos.reshape(-1, 7)[:, 3:].copy()

    def saturation(self) -> Array:
        """Share of each vehicle's thrusters whose command is at its limit, shape (V,)."""
        low, high = np.concatenate([vehicle.limits for vehicle in self._vehicles]).T
        first, ctrl = self._first_thruster, self._loop.ctrl
        at_limit = (ctrl <= low) | (ctrl >= high)
        return np.add.reduceat(at_limit.astype(float), first[:-1]) / np.diff(first)


class World(ClosedLoop):
    """A scenario on MuJoCo bodies, with the loop closed.

    Attributes:
        system, steps_per_sample: see `ClosedLoop`.
        arena: where each vehicle is in the model. By name: vehicle A1 has the free joint `A1/`, and everything that is
            its own (bodies, geoms, sites, actuators) has that prefix: `A1/thruster_left`. `actuators` gives the
            actuators of a vehicle by its id. Vehicles of one kind share the materials of the first.
        model, data: MuJoCo's own. The state may be read and set between steps; each step overwrites `data.ctrl`,
            `data.qfrc_applied` of the vehicles and `model.actuator_gear`. Forces of your own go to
            `data.xfrc_applied`; of a vehicle with added mass only the rigid body feels them: multiply by
            `vehicle.rigid_wrench_map`.
    """

    def __init__(self, scenario: Any, *, controller: Law | Controller | None = None, visible: bool = True) -> None:
        """Compose the arena and put every vehicle at its initial position and heading.

        Args:
            scenario: a Scenario, the System that one describes, or the phases of a run.
            controller: a law in Python in place of the agents' own; see `mjsheaf.control.controller`.
            visible: False for a model without the geoms that are only to be seen: the same motion to the bit, sooner.

        Raises:
            InputError: a vehicle is unknown, or does not fit the dimension of its agent or target; or a law in Python
                where the control period is 0.
        """
        run = scenario.phases if hasattr(scenario, "controller") else scenario
        super().__init__(run, controller, getattr(scenario, "seed", 0))
        self.arena = arena_of(self.system, visible=visible)
        self.model: mujoco.MjModel = self.arena.model
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        self.model.opt.timestep = self._timestep
        plan = self.system.bodies
        control, medium = self._control(), self.system.medium
        self._begin(new_loop(self.arena, self.data, control, medium, plan.heading, plan.surface_height))
        self.reset()

    @property
    def _step(self) -> int:
        """Physics steps since the start, by MuJoCo's clock: those count that were taken without `step`."""
        return round((self.data.time - self.system.grid.start) / self._timestep)

    def reset(self) -> None:
        """Go back to the initial condition.

        Where a command is bad there already, `data` has positions but no forces, and `step` raises UnstableError.
        """
        mujoco.mj_resetData(self.model, self.data)
        self.data.time = self.system.grid.start
        self._place()
        # Where a command is bad MuJoCo would warn and take others; `step` raises.
        (mujoco.mj_fwdPosition if _is_bad(self.data.ctrl) else mujoco.mj_forward)(self.model, self.data)

    def get_state(self) -> Array:
        """All that decides how the run goes on: MuJoCo's state and the law's memory, as one array.

        A law in Python keeps its own state, which is not in it.
        """
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return np.concatenate([state, self._loop.memory.flat])

    def set_state(self, state: Array) -> None:
        """Go on from a state of `get_state`, to the bit as the world did from which it was taken.

        Raises:
            InputError: the state is of another size, so not one of this scenario, or not finite.
        """
        values, before = np.ascontiguousarray(state, dtype=np.float64), self.get_state()
        if values.ndim != 1 or not np.isfinite(values).all() or not self._restore(values):
            self._restore(before)
            raise InputError(
                f"state has shape {values.shape}; expected {before.shape} finite numbers, as get_state gives them"
            )
        mujoco.mj_fwdPosition(self.model, self.data)

    def _restore(self, state: Array) -> bool:
        """Take over a state; False where it is not of the size that the law of its phase needs."""
        size = mujoco.mj_stateSize(self.model, _STATE)
        if len(state) <= size:
            return False
        mujoco.mj_setState(self.model, self.data, state[:size], _STATE)
        memory = self._enter_phase().memory.flat
        if len(state) != size + len(memory):
            return False
        memory[:] = state[size:]
        return True

    def _move(self, loop: Loop, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        """The first vehicle with a bad command or, if none has, a bad position, velocity or acceleration, if any."""
        if not _advance(loop, step, count, recorder):
            return None
        data, owner = self.data, np.repeat(np.arange(len(self._vehicles)), np.diff(self.arena.thruster))
        motion = np.hstack([x.reshape(len(self._vehicles), -1) for x in (data.qpos, data.qvel, data.qacc)])
        bad = owner[~(np.abs(data.ctrl) < HUGE)], np.flatnonzero(~(np.abs(motion) < HUGE).all(axis=1))
        return int(np.concatenate(bad)[0]), self._step

    def actuators(self, id: str) -> IntArray:
        """Indices of a vehicle's actuators in `model` and in `data.ctrl`, in the order of `result.nc`'s thrusters.

        For example `world.model.actuator_gainprm[world.actuators("A1"), 0] = 0` stops all thrusters of A1.

        Args:
            id: of an agent or a target.

        Raises:
            InputError: there is no such vehicle.
        """
        index = self.system.team.index
        if id not in index:
            raise InputError(f"unknown vehicle {id!r}; {expected(id, index)}")
        return np.arange(*self.arena.thruster[index[id] :][:2])


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
    if phases_of(run)[0].system.bodies.engine == "mujoco":
        yield from World(run, controller=controller, visible=False).record(samples, targets, progress)
        return
    from mjsheaf.simulation.fused import Fused

    with Fused(run, controller=controller) as bodies:
        yield from bodies.record(samples, targets, progress)
