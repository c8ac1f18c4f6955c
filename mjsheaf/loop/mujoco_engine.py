"""MuJoCo engine for bodies, with contacts; `World` is its public class.

Before each step our own function writes to MuJoCo's arrays. It does not use MuJoCo's global callbacks, because these
belong to the whole process and slow down or break other simulations in it. mj_step is called through its C symbol,
without the interpreter.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array, IntArray, Room
from mjsheaf.compile.jit import external, held, inline_jit, jit, on_stack, pinned
from mjsheaf.compile.tiers import Tiered
from mjsheaf.errors import InputError, expected
from mjsheaf.law.in_python import Controller, Law
from mjsheaf.loop.block import ALONE, at, attitude, command_alone
from mjsheaf.loop.bodies import apply_wrench, turn_gears
from mjsheaf.loop.engine import Commanded, Recorder
from mjsheaf.loop.loop import HUGE, Bodies, ClosedLoop, begin_span, record
from mjsheaf.loop.system import System
from mjsheaf.media.medium import advance
from mjsheaf.mujoco_import import mujoco, quiet
from mjsheaf.vehicles.arena import Arena, compose, movers_of, place_obstacles

# From the same library that the Python bindings use.
_mj_step = external(next(Path(mujoco.__file__).parent.glob("libmujoco*")), "mj_step")

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class MujocoArrays(NamedTuple):
    """Arrays of MuJoCo, in addition to the state, for compiled code.

    Attributes:
        qacc: Accelerations, read to detect divergence.
        applied: Applied forces qfrc_applied.
        gear: Gears actuator_gear.
        model, data: Addresses of the model and its data.
        mocap: Positions mocap_pos of obstacles that move, shape (M, 3), m.
        movers: Motion of those; see `mjsheaf.vehicles.arena.movers_of`.
    """

    qacc: Array
    applied: Array
    gear: Array
    model: int
    data: int
    mocap: Array
    movers: Any = ()


def mujoco_arrays(model: mujoco.MjModel, data: mujoco.MjData, movers: tuple[Any, ...] = ()) -> MujocoArrays:
    """Return views of MuJoCo's arrays."""
    gear, addresses = model.actuator_gear, (model._address, data._address)
    return MujocoArrays(data.qacc, data.qfrc_applied, gear, *addresses, data.mocap_pos, movers)


@inline_jit
def apply_forces(loop, arrays, t):
    """Compute measurements and commands of all vehicles at time t, s, and write the forces of the medium on them."""
    loop = pinned(loop)
    params, state = loop.params, loop.state
    fleet = params.fleet
    V = fleet.bodies.shape[0]
    advance(params.medium, t, 0, V, state.medium)
    place_obstacles(arrays.movers, t, arrays.mocap)
    b = on_stack(ALONE)
    for v in range(V):
        body = fleet.bodies[v]
        kind = fleet.kinds[body.kind]
        command_alone(loop, v, b)
        R = attitude(b, 0)
        applied, gear = arrays.applied[body.dof : body.dof + 6], arrays.gear[body.actuator : body.actuator + kind.count]
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


@jit
def _advance(loop, arrays, step, count, recorder):
    """Take `count` steps from step number `step`, fewer where commands or the state become bad.

    Returns:
        Number of the step at which they did; -1 if they did not.
    """
    loop, arrays, recorder = pinned(loop), pinned(arrays), pinned(recorder)
    params, state = loop.params, loop.state
    for k in range(step, step + count):
        row = begin_span(loop, k, recorder)
        apply_forces(loop, arrays, params.start + k * params.timestep)
        if row >= 0:
            record(loop, recorder.log, row, 0, params.fleet.bodies.shape[0])
        # If a command is bad, MuJoCo sets all commands to zero and continues, which would be another simulation.
        if _is_bad(state.ctrl):
            return k
        _mj_step(arrays.model, arrays.data)
        if _is_bad(state.qpos) or _is_bad(state.qvel) or _is_bad(arrays.qacc):
            return k + 1
    return -1


class World(ClosedLoop):
    """A scenario on MuJoCo bodies, with the loop closed.

    Attributes:
        system, steps_per_sample: See `Engine`.
        arena: Indices of each vehicle in the model. By name, vehicle A1 has the free joint `A1/`, and all its bodies,
            geoms, sites and actuators have that prefix, such as `A1/thruster_left`. `actuators` gives the actuators of
            a vehicle by its id. Vehicles of one kind share the materials of the first.
        model, data: MuJoCo's model and data. The state may be read and set between steps; each step overwrites
            `data.ctrl`, `data.qfrc_applied` of the vehicles and `model.actuator_gear`. Write your own forces to
            `data.xfrc_applied`. They act on the rigid body alone, so for a vehicle with added mass multiply them by
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
            scenario: A Scenario, the System that one describes, or the phases of a run.
            controller: A law in Python in place of the agents' own; see `mjsheaf.law.in_python`.
            commanded: True if `add_to_command` gives the agents' whole command, in place of their own law; 'thrust' if
                it gives the commands of their actuators, in place of law and autopilot.
            visible: False for a model without purely visual geoms, which is faster; the motion is the same to the bit.

        Raises:
            InputError: A vehicle is unknown, or does not fit the dimension of its agent or target; or there is a law in
                Python, and the control period is 0.
        """
        self._visible = visible
        super().__init__(scenario, controller=controller, commanded=commanded)

    def _prepare(self) -> None:
        self.arena = arena_of(self.system, visible=self._visible)
        self.model: mujoco.MjModel = self.arena.model
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        touched = self.system.obstacles if self.system.bodies.contacts else None
        self._arrays = held(mujoco_arrays(self.model, self.data, movers_of(touched)))
        self._gain = self.model.actuator_gainprm

    def _bodies(self, room: Room) -> Bodies:
        self._kept = room.take(mujoco.mj_stateSize(self.model, _STATE))
        data = self.data
        return data.qpos, data.qvel, data.ctrl, data.act

    @property
    def steps_taken(self) -> int:
        """Number of physics steps since the start by MuJoCo's clock, including those taken without `step`."""
        return round((self.data.time - self.system.grid.start) / self._timestep)

    def _command(self) -> None:
        evaluate_forces(self._held, self._arrays, self.time)

    def _begin(self) -> None:
        mujoco.mj_resetData(self.model, self.data)
        self.data.time = self.system.grid.start
        super()._begin()
        # For a bad command MuJoCo would warn and use others; `step` raises instead.
        (mujoco.mj_fwdPosition if _is_bad(self.data.ctrl) else mujoco.mj_forward)(self.model, self.data)

    def get_state(self) -> Array:
        """Return the complete state of the run, as `Engine.get_state`."""
        self._enter_phase()
        mujoco.mj_getState(self.model, self.data, self._kept, _STATE)
        return super().get_state()

    def restore(self, state: Array) -> bool:
        """Restore a state, as `Engine.restore`, and update the quantities that MuJoCo computes from positions."""
        fits = super().restore(state)
        mujoco.mj_fwdPosition(self.model, self.data)
        return fits

    def _go_to(self, state: Array) -> None:
        own = state[1 : 1 + len(self._kept)]  # behind the steps taken
        if len(own) == len(self._kept):
            mujoco.mj_setState(self.model, self.data, own, _STATE)

    @quiet()
    def _move(self, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        bad = _advance(self._held, self._arrays, step, count, recorder)
        if bad < 0:
            return None
        data = self.data
        motion = np.hstack([data.qpos.reshape(-1, 7), data.qvel.reshape(-1, 6), data.qacc.reshape(-1, 6)])
        counts = self._fleet.kinds["count"][self._fleet.bodies["kind"]]
        owners = np.repeat(np.arange(len(counts)), counts)
        moved = np.flatnonzero(~(np.abs(motion) < HUGE).all(axis=1))
        commanded = owners[~(np.abs(data.ctrl) < HUGE)]
        return int(min([*moved, *commanded])), bad

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


def arena_of(system: System, colours: Array | None = None, visible: bool = True) -> Arena:
    """Compose the arena of a system; `colours` (V, 3) are those of the vehicles, `visible` includes visual geoms."""
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
