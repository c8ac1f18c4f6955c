"""MuJoCo engine for bodies, with contacts; `World` is its public class.

Before each step our own function writes to MuJoCo's arrays. It does not use MuJoCo's global callbacks, because these
belong to the whole process and slow down or break other simulations in it. mj_step is called through its C symbol,
without the interpreter.
"""

from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arguments import phases_given
from mjsheaf.arrays import Array, IntArray
from mjsheaf.control.controller import Controller, Law, controller_of
from mjsheaf.engine import mujoco, quiet
from mjsheaf.errors import InputError, expected
from mjsheaf.jit import external, inline_jit, jit, on_stack
from mjsheaf.media.medium import advance
from mjsheaf.simulation.arena import Arena, compose
from mjsheaf.simulation.block import ALONE, command_alone
from mjsheaf.simulation.bodies import apply_wrench, turn_gears
from mjsheaf.simulation.engine import Commanded, Recorder
from mjsheaf.simulation.gate import ThreadTeam, fail
from mjsheaf.simulation.loop import (
    HUGE,
    ClosedLoop,
    EngineArrays,
    Loop,
    finish_law,
    record,
)
from mjsheaf.simulation.motion import at, attitude
from mjsheaf.simulation.threaded import NEVER, ThreadedLoop, begin_span, end_span, first_bad, next_row
from mjsheaf.simulation.walls import movers_of, place_obstacles
from mjsheaf.system import System, phases_of
from mjsheaf.tiers import Tiered

# Of the very library that the Python bindings use.
_mj_step = external(next(Path(mujoco.__file__).parent.glob("libmujoco*")), "mj_step", "void", "voidptr", "voidptr")

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class MujocoArrays(NamedTuple):
    """Arrays of MuJoCo, in addition to the state, for compiled code.

    Attributes:
        qacc: Accelerations, read to detect divergence.
        applied: Applied forces qfrc_applied.
        gear: Gears actuator_gear.
        model, data: Addresses of the model and its data.
        mocap: Positions mocap_pos of obstacles that move, shape (M, 3), m.
        movers: Motion of those; see `mjsheaf.simulation.walls.movers_of`.
    """

    qacc: Array
    applied: Array
    gear: Array
    model: int
    data: int
    mocap: Array
    movers: Any = ()


def mujoco_arrays(model: mujoco.MjModel, data: mujoco.MjData, movers: tuple[Any, ...] = ()) -> MujocoArrays:
    """Views of MuJoCo's arrays."""
    gear, addresses = model.actuator_gear, (model._address, data._address)
    return MujocoArrays(data.qacc, data.qfrc_applied, gear, *addresses, data.mocap_pos, movers)


def engine_arrays(model: mujoco.MjModel, data: mujoco.MjData) -> EngineArrays:
    """Return views of the arrays that a Loop sees."""
    return EngineArrays(data.qpos, data.qvel, data.ctrl, data.act, model.actuator_gainprm)


@inline_jit
def apply_forces(loop, arrays, t, first, last):
    """Let vehicles from first up to last measure and command at time t, s, and write what the medium does to them.

    They are MuJoCo's only ones.
    """
    params, state = loop
    fleet = params.fleet
    advance(params.medium, t, first, last, state.medium)
    place_obstacles(arrays.movers, t, arrays.mocap)
    b = on_stack(ALONE)
    for v in range(first, last):
        body = fleet.bodies[v]
        kind = fleet.kinds[body.kind]
        command_alone(loop, v, b)
        R = attitude(b, 0)
        place, channel = 6 * (v - first), body.actuator - fleet.bodies[first].actuator
        applied, gear = arrays.applied[place : place + 6], arrays.gear[channel : channel + kind.count]
        apply_wrench(kind, state.qvel[body.dof : body.dof + 6], R, at(b.force, 0), at(b.moment, 0), applied)
        turn_gears(kind, fleet.thrusters[kind.thruster :], R, state.act[body.state :], gear)


evaluate_forces = Tiered(apply_forces, records=True)
"""`apply_forces`, for calls by Python."""


@jit
def _is_bad(values):
    """Return True if MuJoCo would treat one of the numbers as bad: it is not finite, or huge."""
    bad = 0
    for i in range(values.shape[0]):  # no early exit: compiled to vector instructions
        bad += not abs(values[i]) < HUGE
    return bad > 0


@inline_jit
def _is_any_bad(qpos, qvel, qacc):
    return _is_bad(qpos) or _is_bad(qvel) or _is_bad(qacc)


@inline_jit
def _copy(source, target):
    for i in range(target.shape[0]):
        target[i] = source[i]


@inline_jit
def _mark_bad_commands(loop, first, last, k, bad):
    for v in range(first, last):
        body = loop.params.fleet.bodies[v]
        count = loop.params.fleet.kinds[body.kind].count
        if _is_bad(loop.state.ctrl[body.actuator : body.actuator + count]):
            bad[v] = 2 * k + 1


@inline_jit
def _mark_bad_motion(loop, qacc, first, last, k, bad):
    state = loop.state
    for v in range(first, last):
        a, d, own = 7 * v, 6 * v, 6 * (v - first)
        if _is_any_bad(state.qpos[a : a + 7], state.qvel[d : d + 6], qacc[own : own + 6]):
            bad[v] = 2 * k


@inline_jit
def _step_part(loop, arrays, own, first, last, step, count, log, row, bad):
    """Take `count` steps from step number `step` with a model's vehicles, fewer where one of them becomes bad.

    Their samples before the first step are recorded as `row` of the log, unless that is negative.

    Args:
        loop: Loop of all vehicles.
        arrays: Arrays of the model.
        own: State of the model; None where it is the loop's, which is another type and compiles without the copies.
        first, last: Vehicles of the model, up to but without the last.
        step, count: Number of the first step, and of steps.
        log, row: Destination of samples.
        bad: Time at which each vehicle was bad, see `ThreadedLoop._work`.

    Returns:
        True if none did.
    """
    params, state = loop
    body, final = params.fleet.bodies[first], params.fleet.bodies[last - 1]
    qpos, qvel, act = state.qpos[7 * first : 7 * last], state.qvel[6 * first : 6 * last], state.act[body.state :]
    ctrl = state.ctrl[body.actuator : final.actuator + params.fleet.kinds[final.kind].count]
    if own is not None:
        _copy(qpos, own.qpos)
        _copy(qvel, own.qvel)
        _copy(act, own.act)
    for k in range(step, step + count):
        apply_forces(loop, arrays, params.start + k * params.timestep, first, last)
        if k == step and row >= 0:
            record(loop, log, row, first, last)
        # If a command is bad, MuJoCo sets all commands to zero and continues, which would be another simulation.
        if _is_bad(ctrl):
            _mark_bad_commands(loop, first, last, k, bad)
            return False
        if own is not None:
            _copy(ctrl, own.ctrl)
        _mj_step(arrays.model, arrays.data)
        if own is not None:
            _copy(own.qpos, qpos)
            _copy(own.qvel, qvel)
            _copy(own.act, act[: own.act.shape[0]])
        if _is_any_bad(qpos, qvel, arrays.qacc):
            _mark_bad_motion(loop, arrays.qacc, first, last, k + 1, bad)
            return False
    return True


@jit
def _advance_part(loop, arrays, own, first, last, steps, count, recorder, row, bad, thread, threads, gate):
    """Do a thread's part, see `ThreadedLoop._work`, with vehicles from first up to last; return False if one is bad.

    The number of the first step is in `steps`, shape (1,).
    """
    k, end, meetings = steps[0], steps[0] + count, 0
    while k < end:
        span = min(loop.params.per_law - k % loop.params.per_law, end - k)
        sample = next_row(loop.params.per_sample, k, recorder.log.positions, row)
        if not begin_span(loop, k, recorder, sample, thread, threads, meetings, gate):
            return False
        finish_law(loop.params.control.stages.joint, loop, k, first, last)
        if not _step_part(loop, arrays, own, first, last, k, span, recorder.log, sample, bad):
            fail(gate)
        if not end_span(steps, k + span, thread, threads, meetings, gate):
            return False
        k, row, meetings = k + span, row + (sample >= 0), meetings + 3
    return True


@jit
def _advance(loop, arrays, steps, count, recorder, bad, gate):
    """Take `count` steps from step number steps[0] with all vehicles in one model; return False if one becomes bad."""
    V, row = loop.params.fleet.bodies.shape[0], recorder.written[0]
    return _advance_part(loop, arrays, None, 0, V, steps, count, recorder, row, bad, 0, 1, gate)


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

    def __init__(
        self,
        scenario: Any,
        *,
        controller: Law | Controller | None = None,
        commanded: Commanded = False,
        visible: bool = True,
    ) -> None:
        """Compose the arena and put every vehicle at its initial position and heading.

        Args:
            scenario: a Scenario, the System that one describes, or the phases of a run.
            controller: a law in Python in place of the agents' own; see `mjsheaf.control.controller`.
            commanded: True if `add_to_command` gives the agents' whole command, in place of their own law; 'thrust' if
                it gives the commands of their actuators, in place of law and autopilot.
            visible: False for a model without the geoms that are only to be seen: the same motion to the bit, sooner.

        Raises:
            InputError: a vehicle is unknown, or does not fit the dimension of its agent or target; or a law in Python
                where the control period is 0.
        """
        self._visible = visible
        run = phases_given(scenario)
        if hasattr(scenario, "with_seed"):
            self.seed = scenario.seed
            self.run_under = lambda seed: scenario.with_seed(seed).phases
        called = controller_of(controller, phases_of(run)[0].system, getattr(scenario, "seed", 0))
        super().__init__(run, controller=called, commanded=commanded)

    def _prepare(self) -> None:
        self.arena = arena_of(self.system, visible=self._visible)
        self.model: mujoco.MjModel = self.arena.model
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        touched = self.system.obstacles if self.system.bodies.contacts else None
        self._arrays = mujoco_arrays(self.model, self.data, movers_of(touched))
        self._bad = np.full(len(self._vehicles), NEVER)
        self._gate = ThreadTeam.gate()

    def _state_arrays(self) -> EngineArrays:
        return engine_arrays(self.model, self.data)

    @property
    def steps_taken(self) -> int:
        """Physics steps since the start, by MuJoCo's clock: those count that were taken without `step`."""
        return round((self.data.time - self.system.grid.start) / self._timestep)

    def _command(self) -> None:
        evaluate_forces(self._loop, self._arrays, self.time, 0, len(self._vehicles))

    def reset(self, seed: int | None = None) -> None:
        """Return to the initial condition.

        If a command is already invalid there, `data` has positions but no forces, and `step` raises UnstableError.

        Args:
            seed: New seed of initial conditions, disturbances, links and a law in Python. None keeps the seed and
                repeats the same run, bit for bit.

        Raises:
            InputError: A seed is given but the world was not made from a Scenario, or the seed is not an integer >= 0.
        """
        if seed is not None:
            self.restart(seed)
            return
        mujoco.mj_resetData(self.model, self.data)
        self.data.time = self.system.grid.start
        super().reset()
        # Where a command is bad MuJoCo would warn and take others; `step` raises.
        (mujoco.mj_fwdPosition if _is_bad(self.data.ctrl) else mujoco.mj_forward)(self.model, self.data)

    def restore(self, state: Array) -> bool:
        """Take over a state, as `Engine.restore`, and what MuJoCo computes of positions."""
        fits = super().restore(state)
        mujoco.mj_fwdPosition(self.model, self.data)
        return fits

    def _get_motion(self) -> Array:
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return state

    def _set_motion(self, values: Array) -> None:
        mujoco.mj_setState(self.model, self.data, values, _STATE)

    @quiet()
    def _move(self, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        if _advance(self._loop, self._arrays, np.full(1, step), count, recorder, self._bad, self._gate):
            return None
        found = first_bad(self._bad)
        self._bad[:] = NEVER
        self._gate = ThreadTeam.gate()
        return found

    def actuators(self, id: str) -> IntArray:
        """Return indices of a vehicle's actuators in `model` and `data.ctrl`, in the order of thrusters in `result.nc`.

        For example, `world.model.actuator_gainprm[world.actuators("A1"), 0] = 0` stops all thrusters of A1.

        Args:
            id: Id of an agent or a target.

        Raises:
            InputError: There is no such vehicle.
        """
        index = self.system.team.index
        if id not in index:
            raise InputError(f"unknown vehicle {id!r}; {expected(id, index)}")
        return np.arange(*self.arena.thruster[index[id] :][:2])


class _Part(NamedTuple):
    """The vehicles of a thread, from first up to last, in a model of their own."""

    first: int
    last: int
    arrays: MujocoArrays
    own: EngineArrays
    model: mujoco.MjModel
    data: mujoco.MjData


class SplitWorld(ThreadedLoop):
    """A scenario on MuJoCo bodies without contacts, on several threads, each of which has a model of its vehicles.

    Vehicles that never touch are independent trees to MuJoCo: the motion is that of `World` to the bit. The state is
    the loop's; MuJoCo's is a copy.
    """

    def _prepare(self) -> None:
        super()._prepare()
        ends = np.arange(self._thread_team.count + 1) * len(self._vehicles) // self._thread_team.count
        self._parts = [self._part(int(first), int(last)) for first, last in pairwise(ends)]

    def _part(self, first: int, last: int) -> "_Part":
        """The model of vehicles from first up to last."""
        ids = [member.id for member in self.system.team.members[first:last]]
        model = compose(self._vehicles[first:last], ids, timestep=self._timestep, visible=False).model
        data = mujoco.MjData(model)
        return _Part(first, last, mujoco_arrays(model, data), engine_arrays(model, data), model, data)

    def _command(self) -> None:
        for part in self._parts:  # forces are written too, which the next step overwrites
            apply_forces(self._loop, part.arrays, self.time, part.first, part.last)

    @quiet()
    def _work(self, loop: Loop, count: int, recorder: Recorder, row: int, thread: int, gate: IntArray) -> None:
        first, last, arrays, own, _, _ = self._parts[thread]
        steps, threads = self._count, self._thread_team.count
        _advance_part(loop, arrays, own, first, last, steps, count, recorder, row, self._bad, thread, threads, gate)


def arena_of(system: System, colours: Array | None = None, visible: bool = True) -> Arena:
    """Compose the arena of a system; colours (V, 3) paint the vehicles, and they need not be visible."""
    plan, obstacles = system.bodies, None
    if plan.contacts and system.safety is not None:
        ids = system.safety.obstacle_ids
        obstacles = {"obstacles": system.obstacles, "ids": ids, "time": system.grid.start}
    return compose(
        system.vehicles,
        [m.id for m in system.team.members],
        timestep=system.timestep,
        contacts=plan.contacts,
        surface=plan.surface,
        surface_height=plan.surface_height,
        colours=colours,
        visible=visible,
        obstacles=obstacles,
    )
