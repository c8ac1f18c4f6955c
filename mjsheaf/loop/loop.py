"""Loop on bodies: the law at its period, the measurements and commands of each vehicle, and the samples.

An engine moves the bodies: MuJoCo (see `mujoco_engine`), or our own function (see `fused`). The whole step is compiled
code. Samples are recorded inside the loop, into arrays allocated once.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.arrays import Array, IntArray, Room, lay_out, mapped, quaternions_of
from mjsheaf.compile.jit import held, inline_jit, pinned
from mjsheaf.compile.tiers import Tiered
from mjsheaf.law.in_python import Controller
from mjsheaf.law.law import ControlArrays, Memory, Station, evaluate_law, keep_station, new_memory
from mjsheaf.loop.bodies import Fleet, pack_fleet
from mjsheaf.loop.engine import (
    Engine,
    Log,
    Recorder,
    blow_up_message,
    new_log,
    record_links,
    record_vehicle,
)
from mjsheaf.loop.system import Phase, System
from mjsheaf.media.medium import (
    MediumArrays,
    MediumState,
    advance,
    hold,
    medium_velocity,
    new_state,
    unknown_flow,
)
from mjsheaf.vehicles.actuators import ANGLE

HUGE = 1e10
"""Magnitude above which a number of the state is bad, as in MuJoCo (mjMAXVAL)."""

NEVER = int(np.iinfo(np.int64).max)
"""Value in `Fused._bad` for a vehicle that did not become bad."""

_MOVING = ("steps", "qpos", "qvel", "ctrl", "act")  # fields of a State that another law leaves as they are

AUTOPILOT, STOPPED, OUTSIDE = 0, 1, 2
"""Source of a vehicle's actuator commands: its autopilot, none, or the caller, who writes `State.ctrl`."""


class Params(NamedTuple):
    """Constants of a run. Runs of one team under different seeds share all but what `map_seeded` maps.

    Attributes:
        control: Law and references of the onboard computers.
        medium: Flow and disturbances around the vehicles.
        fleet: The vehicles.
        station: Positions that vehicles hold.
        helm: AUTOPILOT, STOPPED or OUTSIDE for each vehicle, shape (V,).
        gain: Gains of all actuators, as MuJoCo has them, shape (A, k) or (A, 1).
        start: Time of step 0, s.
        timestep: Physics step, s.
        per_law: Physics steps between evaluations of the law.
        per_sample: Physics steps between samples.
    """

    control: ControlArrays
    medium: MediumArrays
    fleet: Fleet
    station: Station
    helm: NDArray[np.int8]
    gain: Array
    timestep: float
    start: float = 0.0
    per_law: int = 1
    per_sample: int = 1


def map_seeded(function: Callable[[Any], Any], params: Params) -> Params:
    """Return the constants with `function` applied to each array of numbers that depends on the seed of a run.

    These are the seed of random numbers, the initial positions of targets, disturbances, and the moving parts of the
    medium. Arrays of numbers have entries of eight bytes; others, such as flags, are shared by runs.
    """

    def own(leaf: Any) -> Any:
        return function(leaf) if isinstance(leaf, np.ndarray) and leaf.dtype.itemsize == 8 else leaf

    law, motion = params.control
    control = ControlArrays(law._replace(seed=own(law.seed)), motion._replace(origin=own(motion.origin)))
    harmonics, parts = mapped(own, params.medium.harmonics), mapped(own, params.medium.parts)
    return params._replace(control=control, medium=params.medium._replace(harmonics=harmonics, parts=parts))


class State(NamedTuple):
    """State of a run, which changes from step to step: parts of one array, except for MuJoCo's own arrays.

    `memory.flat` is the part of that array that determines the rest of the run.

    Attributes:
        steps: Number of steps taken, shape (1,); MuJoCo's clock counts its own.
        qpos: Positions of the free joints, shape (7 V,).
        qvel: Velocities of the free joints, shape (6 V,).
        ctrl: Commands of all actuators, shape (A,).
        act: Activations of the actuators with a lag.
        x: Positions that the law sees, padded, shape (V, 3), m.
        carried: Velocity of the medium at each vehicle when its commands were made, shape (V, 3), m/s; z of a planar
            one is that of the surface.
        medium: State of the medium.
        memory: Memory of the law.
    """

    steps: Array
    qpos: Array
    qvel: Array
    ctrl: Array
    act: Array
    x: Array
    carried: Array
    medium: MediumState
    memory: Memory


class Loop(NamedTuple):
    """The closed loop of a world, for compiled code.

    Attributes:
        params: Constants of the run.
        state: State of the run.
    """

    params: Params
    state: State


Bodies = tuple[Array, Array, Array, Array]
"""Arrays of an engine: qpos, qvel, ctrl and act of a `State`."""


@inline_jit
def controlled_positions(fleet, qpos, x):
    """Write the positions that the law controls into x (V, 3): hand points, or origins; z = 0 for planar ones."""
    for v in range(x.shape[0]):
        kind, a = fleet.kinds[fleet.bodies[v].kind], fleet.bodies[v].qpos
        x[v, 0], x[v, 1] = qpos[a], qpos[a + 1]
        x[v, 2] = 0.0 if kind.planar else qpos[a + 2]
        if kind.hand > 0.0:
            w, i, j, k = qpos[a + 3], qpos[a + 4], qpos[a + 5], qpos[a + 6]
            x[v, 0] += kind.hand * (1.0 - 2.0 * (j * j + k * k))
            x[v, 1] += kind.hand * 2.0 * (i * j + w * k)


@inline_jit
def run_law(loop, t):
    """Evaluate the law at time t, s, for the present state."""
    loop = pinned(loop)
    params, state = loop.params, loop.state
    memory = state.memory
    bodies = params.fleet.bodies
    controlled_positions(params.fleet, state.qpos, state.x)
    hold(params.medium, t, 0, bodies.shape[0], state.medium)
    if params.control.law.terms.drift > 0.0:
        advance(params.medium, t, 0, bodies.shape[0], state.medium)
        for v in range(bodies.shape[0]):
            w = medium_at(params.medium, state.medium, params.fleet, state.qpos, v)
            for i in range(3):
                state.carried[v, i] = w[i]
    attitude = memory.links.attitude
    for v in range(attitude.shape[0]):
        for i in range(4):
            attitude[v, i] = state.qpos[bodies[v].qpos + 3 + i]
    evaluate_law(params.control, t, state.x, state.carried, memory)
    for v in range(bodies.shape[0]):
        if params.station.holds[v]:
            advance(params.medium, t, v, v + 1, state.medium)
            w = medium_at(params.medium, state.medium, params.fleet, state.qpos, v)
            keep_station(params.station, v, state.x[v], w, memory.command[v])


@inline_jit
def medium_at(medium, present, fleet, qpos, v):
    """Return the velocity of the medium, whose state is `present`, at the origin of vehicle v, three numbers, m/s."""
    body = fleet.bodies[v]
    a = body.qpos
    z = 0.0 if fleet.kinds[body.kind].planar else qpos[a + 2]
    return medium_velocity(medium, present, v, qpos[a], qpos[a + 1], z)


@inline_jit
def place_targets(fleet, qpos, x, recorder):
    """Put the targets at their references of this sample."""
    k, agents = recorder.written[0], x.shape[0] - recorder.placed.shape[1]
    if k >= recorder.placed.shape[0]:
        return
    controlled_positions(fleet, qpos, x)
    for v in range(agents, x.shape[0]):
        body = fleet.bodies[v]
        for i in range(2 if fleet.kinds[body.kind].planar else 3):
            qpos[body.qpos + i] += recorder.placed[k, v - agents, i] - x[v, i]


@inline_jit
def record(loop, log, k, first, last):
    """Write the state and the commands just made for it of vehicles from first up to last as sample k.

    Links go with vehicle 0.
    """
    loop = pinned(loop)
    params, state = loop.params, loop.state
    fleet, memory = params.fleet, state.memory
    if first == 0:
        record_links(memory.links.heard, memory.y, log, k)
    for v in range(first, last):
        body = fleet.bodies[v]
        kind, a, d = fleet.kinds[body.kind], body.qpos, body.dof
        record_vehicle(loop, memory, log, k, v, state.x[v], state.qvel[d : d + 3], state.carried[v])
        if log.origin.shape[0] == 0:
            continue
        for i in range(3):
            log.origin[k, v, i] = state.qpos[a + i]
        for i in range(4):
            log.quaternions[k, v, i] = state.qpos[a + 3 + i]
        at_limit = 0
        for j in range(kind.count):
            n, thruster = body.actuator + j, fleet.thrusters[kind.thruster + j]
            command = state.ctrl[n]
            log.thruster_command[k, n] = command
            late = state.act[body.state + thruster.state] if thruster.late else command
            log.thruster_output[k, n] = late if thruster.code == ANGLE else params.gain[n, 0] * late
            if command != 0.0 or not kind.one_sided:  # one that cannot reverse is at rest at 0
                at_limit += command <= thruster.low or command >= thruster.high
        log.saturation[k, v] = at_limit / max(kind.count, 1)


@inline_jit
def begin_span(loop, k, recorder):
    """Prepare step k: place targets for the recorder, and evaluate the law if it is due.

    Returns:
        Row of the log for the sample at step k, which is counted as written; -1 if it is no sample or there is no room.
    """
    params, state = loop.params, loop.state
    row = -1
    if k % params.per_sample == 0 and recorder.written[0] < recorder.log.positions.shape[0]:
        row = recorder.written[0]
        place_targets(params.fleet, state.qpos, state.x, recorder)
        recorder.written[0] = row + 1
    if k % params.per_law == 0:
        run_law(loop, params.start + k * params.timestep)
    return row


def new_loop(params: Params, bodies: Callable[[Room], Bodies], room: Room) -> Loop:
    """Return a loop before the first sample, with a state that is laid out in a room.

    Args:
        params: Constants of the run.
        bodies: Function that returns the engine's arrays, which it may take from the room.
        room: The room.
    """
    V, law = len(params.fleet.bodies), params.control.law
    steps, moved = room.take(1), bodies(room)
    memory = new_memory(law, V, room)
    x, carried = room.take((V, 3)), room.take((V, 3))
    return Loop(params, State(steps, *moved, x, carried, new_state(params.medium, room.take), memory))


def blow_up_of(system: System, loop: Loop, vehicle: int, step: int, controller: Controller | None = None) -> str:
    """Name the vehicle of a loop that was bad at a step, and the likely cause, which may be a law in Python."""
    speed = np.linalg.norm(loop.state.qvel[6 * vehicle :][:3])
    commanded = np.linalg.norm(loop.state.memory.command[vehicle])
    detail = f" (body '{system.vehicles[vehicle].name}')"
    time = system.grid.start + step * system.timestep
    seen = f"speed {speed:.3g} m/s, commanded {commanded:.3g} m/s"
    unknown = unknown_flow(loop.params.medium.parts, loop.state.medium.parts, vehicle)
    return blow_up_message(system, vehicle, detail, time, seen, loop.state.memory, unknown, controller)


@inline_jit
def hold_medium(loop, t):
    """Bring what the medium holds between samples to the sample at time t, s."""
    loop = pinned(loop)
    hold(loop.params.medium, t, 0, loop.params.fleet.bodies.shape[0], loop.state.medium)


# Python calls them once for a run or a sample; compiled loops call the functions themselves.
_run_law = Tiered(run_law, records=True)
_hold_medium = Tiered(hold_medium, records=True)
_place_targets = Tiered(place_targets, records=True, numbers=np.inf)
_record = Tiered(record, records=True, numbers=np.inf)


class ClosedLoop(Engine):
    """A run on bodies; a step is a physics step.

    Subclasses must implement `_bodies`, `_command` and `_move`.
    """

    _loop: Loop
    _held: Any  # the same, for compiled code
    _values: Array  # all numbers of the state
    _gain: Array  # of all actuators
    _heading: Array | None = None  # of the vehicles of `_fleet`
    _in_lanes: ClassVar = False  # True if compiled code moves vehicles itself, and may do so in lanes
    _at_once: ClassVar = 200_000  # physics steps times vehicles in a compiled call; Ctrl-C takes effect between calls

    def _take(self, phases: Sequence[Phase]) -> None:
        super()._take(phases)
        system = self.system
        plan = system.bodies
        if plan.heading is not self._heading:  # no seed changes more
            self._vehicles = system.vehicles
            self._heading = plan.heading
            self._hand = np.array([[vehicle.steering.hand] for vehicle in self._vehicles])
            self._fleet = pack_fleet(
                self._vehicles, plan.heading, system.timestep, plan.surface, in_lanes=self._in_lanes
            )
            trim = np.concatenate([vehicle.trim for vehicle in self._vehicles])
            self._act = trim[self._fleet.channels["late"] > 0]
            self._attitudes = quaternions_of(plan.heading)
            self._forward = np.column_stack([np.cos(plan.heading), np.sin(plan.heading)])
        self.steps_per_sample = system.steps_per_sample
        self._timestep = system.timestep
        self._chunk = self._stride = max(1, min(4000, self._at_once // len(self._vehicles)))

    @abstractmethod
    def _bodies(self, room: Room) -> Bodies:
        """Return the engine's arrays, taken from a room unless they are MuJoCo's own."""

    @abstractmethod
    def _command(self) -> None:
        """Compute the measurements and commands of every vehicle in the present state."""

    def _begin(self) -> None:
        self._lay_out()
        self._unrecorded = self._recorder(0)
        self.place()
        self._sample()
        self._command()

    def new_loop(self, room: Room) -> Loop:
        """Return the loop of the present phase at the start of a run, without the vehicles' positions, in a room."""
        return new_loop(self.params(), self._bodies, room)

    def _lay_out(self) -> None:
        self._values, loop = lay_out(self.new_loop)
        self._go_on(loop)

    def _go_on(self, loop: Loop) -> None:
        """Continue with a loop."""
        self._loop, self._held, self._count = loop, held(loop), loop.state.steps
        self.memory = loop.state.memory

    def _enter(self) -> None:
        before = self._loop.state
        self._lay_out()
        for name in _MOVING:
            getattr(self._loop.state, name)[:] = getattr(before, name)

    def restore(self, state: Array) -> bool:
        """Restore a state, as `Engine.restore`, and between samples what the medium holds since the last one."""
        fits = super().restore(state)
        if self.steps_taken % self.steps_per_sample > 0:
            _hold_medium(self._held, self.time)
        return fits

    def loop_in(self, room: Room) -> Loop:
        """Return a copy of the loop in a room: its state, followed by the constants that depend on the seed.

        Each world has its own copy of these; the other constants are shared.
        """
        params, state = self.new_loop(room)
        room.since(0)[:] = self._values

        def copied(leaf: Array | IntArray) -> Any:
            own = room.take(leaf.shape).view(leaf.dtype)
            own[...] = leaf
            return own

        return Loop(map_seeded(copied, params), state)

    def params(self) -> Params:
        """Return the constants of the present phase."""
        system = self.system
        helm = np.full(len(self._vehicles), AUTOPILOT, dtype=np.int8)
        if system.stopped is not None:
            helm[system.stopped] = STOPPED
        if self._commanded == "thrust":
            helm[: len(system.team.agents)][system.team.present] = OUTSIDE
        return Params(
            control=self._control,
            medium=system.medium._replace(parts=system.moving + system.wind),
            fleet=self._fleet,
            station=system.station_of_bodies,
            helm=helm,
            gain=self._gain,
            timestep=self._timestep,
            start=system.grid.start,
            per_law=1 if system.grid.continuous else self.steps_per_sample,
            per_sample=self.steps_per_sample,
        )

    def place(self) -> None:
        """Put the vehicles at their initial positions; rotors of multirotors are already turning."""
        x = self._loop.state.qpos.reshape(-1, 7)
        x[:, :3] = self.system.initial
        x[:, :2] -= self._hand * self._forward
        x[self.system.planar, 2] = self.system.bodies.surface_height
        x[:, 3:] = self._attitudes
        self._loop.state.act[:] = self._act

    def _control_of(self, system: System) -> ControlArrays:
        return system.control_of_bodies

    def _evaluate_law(self) -> None:
        _run_law(self._held, self.time)

    def _place_targets(self, recorder: Recorder) -> None:
        _place_targets(self._fleet, self._loop.state.qpos, self._loop.state.x, recorder)

    def _record_now(self, recorder: Recorder) -> None:
        self._evaluate_law()
        self._command()
        _record(self._held, recorder.log, int(recorder.written[0]), 0, len(self._vehicles))
        recorder.written[0] += 1

    def _describe_blow_up(self, vehicle: int, step: int) -> str:
        return blow_up_of(self.system, self._loop, vehicle, step, self.controller)

    def _new_log(self, samples: int) -> Log:
        return new_log(samples, self._control.law, actuators=None if self.light else len(self._loop.state.ctrl))

    def _velocity(self, displacement: Array) -> Array:
        return self._loop.state.qvel.reshape(-1, 6)[: len(displacement)]

    def close_loop(self, sample: bool | None = None) -> None:
        """Write commands and forces for the present state, without stepping.

        This is what happens before every physics step. Call it yourself to step with `mujoco.mj_step`; `step` calls
        it for you.

        Args:
            sample: True if the law is evaluated; None evaluates it when its period is due.
        """
        self._enter_phase()
        if sample is None:
            sample = self.steps_taken % self._loop.params.per_law == 0
        if sample:
            self._consult()
            self._sample()
        self._command()

    @property
    def command_shape(self) -> tuple[int, ...]:
        """Shape of the argument of `add_to_command`."""
        if self._commanded != "thrust":
            return super().command_shape
        return (sum(len(vehicle.channels) for vehicle in self._vehicles[: len(self.system.team.agents)]),)

    def add_to_command(self, command: Array) -> None:
        """Set velocities as `Engine.add_to_command`, or the commands of actuators if `commanded` is 'thrust'.

        Args:
            command: Velocities, or the command of each actuator of the agents, shape (A,), in the order of `result.nc`
                and within the limits of `Vehicle.channels`; actuators of agents that are absent ignore theirs.
        """
        if self._commanded == "thrust":
            self._enter_phase()
            self._loop.state.ctrl[: len(command)] = command
        else:
            super().add_to_command(command)

    @property
    def command(self) -> Array:
        """Commanded velocities of the law's last evaluation, shape (V, 3), m/s."""
        return self.memory.command

    @property
    def disagreement(self) -> Array:
        """eta of the agents, L_T p - c_T of the targets, at the law's last evaluation, shape (V, 3), m."""
        return self.memory.residual

    def positions(self) -> Array:
        """Controlled positions, padded: agents then targets, z = 0 for planar ones; shape (V, 3), m."""
        x = np.empty((len(self._vehicles), 3))
        controlled_positions(self._fleet, self._loop.state.qpos, x)
        return x

    def heights(self) -> Array:
        """z of every body, floating ones included, shape (V,), m."""
        return self._loop.state.qpos.reshape(-1, 7)[:, 2].copy()

    def quaternions(self) -> Array:
        """Attitudes (w, x, y, z), body to world, shape (V, 4)."""
        return self._loop.state.qpos.reshape(-1, 7)[:, 3:].copy()

    def saturation(self) -> Array:
        """Fraction of each vehicle's thrusters whose command is at its limit, shape (V,)."""
        log = new_log(1, self._control.law, actuators=len(self._loop.state.ctrl))
        _record(self._held, log, 0, 0, len(self._vehicles))
        return log.saturation[0]
