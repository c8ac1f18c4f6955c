"""Closed-loop runs and their results: the code that all engines have in common.

An engine takes steps: control periods on ideal kinematics, physics steps on bodies. Between two samples it runs
compiled code. `mjsheaf.loop.session` chooses one and offers it as a `Session`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np

from mjsheaf.arguments import require_whole
from mjsheaf.arrays import Array, IntArray
from mjsheaf.compile.jit import for_each, inline_jit
from mjsheaf.errors import InputError, UnstableError
from mjsheaf.law.custom import naming_terms
from mjsheaf.law.in_python import Controller, Law, Sample, View, controller_of
from mjsheaf.law.law import ControlArrays, LawArrays, Memory, carry, with_ramp
from mjsheaf.law.terms import Traffic
from mjsheaf.loop.system import Phase, System, on_engine, phases_of
from mjsheaf.threads import WithThreads

if TYPE_CHECKING:
    from mjsheaf.scenario import Scenario


def samples_in_piece(system: System, *, numbers: int = 2**16) -> int:
    """Return the number of samples in a chunk, chosen so that memory does not grow with the length of a run.

    Args:
        system: The system.
        numbers: Product of vehicles and samples: a few megabytes of results.
    """
    return max(16, min(2048, numbers // len(system.team.members)))


READERS: dict[str, tuple[Any, int]] = {}
"""Compiled functions that read quantities available only in the loop, by name, with how many numbers each writes.

`read(run, memory, v, out)` is called for vehicle v at every sample: `run` is the Loop on bodies and the Integrator on
ideal kinematics, `memory` is the law's. See `results.dataset.Samples.recorded`.
"""


class Extra(NamedTuple):
    """Recorded values of one of the READERS.

    Attributes:
        values: The values, shape (T, V, width).
        read: The function that writes those of one vehicle.
    """

    values: Array
    read: Any


class Log(NamedTuple):
    """T samples of V vehicles, recorded in the loop; arrays that a backend does not fill have no samples.

    Attributes:
        positions: Positions seen by the law, padded, shape (T, V, 3), m.
        residual: eta of the agents from received measurements, L_T p - c_T of the targets, padded, shape (T, V, 3), m.
        command: Commanded velocities relative to the medium, limited, shape (T, V, 3), m/s.
        velocity: Velocity of the controlled state on ideal kinematics, of the body's origin on bodies, shape (T, V, 3),
            m/s.
        medium: Velocity of flow and disturbance around each vehicle, shape (T, V, 3), m/s.
        inputs: Inputs u_i = g_i^+ command on ideal kinematics, shape (T, N, s).
        origin: Origins of bodies, shape (T, V, 3), m.
        quaternions: Attitudes of bodies (w, x, y, z), body to world, shape (T, V, 4).
        thruster_command: Commands of all actuators, shape (T, A).
        thruster_output: Lagged commands: forces of the actuators, N, or angles, rad, shape (T, A).
        saturation: Fraction of each vehicle's thrusters at a limit, shape (T, V).
        heard: Reception on each link (see `mjsheaf.law.edges`), shape (T, L).
        measurements: Delivered measurements, -b if nothing was received, shape (T, m), m; recorded on request.
        safety: Results of the safety filter (see `mjsheaf.law.safety`), shape (T, V, 4); without one (T, V, 0).
        extra: An Extra for each of the READERS.
    """

    positions: Array
    residual: Array
    command: Array
    velocity: Array
    medium: Array
    inputs: Array
    origin: Array
    quaternions: Array
    thruster_command: Array
    thruster_output: Array
    saturation: Array
    heard: Array
    measurements: Array
    safety: Array
    extra: Any = ()

    def span(self, begin: int, end: int) -> "Log":
        """Return views of the samples from `begin` up to but without `end`."""
        arrays = [values[begin:end] for values in self[:-1]]
        return Log._make([*arrays, tuple(Extra(one.values[begin:end], one.read) for one in self.extra)])


def new_log(T: int, law: LawArrays, *, inputs: tuple[int, int] | None = None, actuators: int | None = None) -> Log:
    """Return a log for T samples of a law's vehicles.

    Args:
        T: Number of samples.
        law: Law of the vehicles.
        inputs: Shape (N, s) of the inputs, on ideal kinematics.
        actuators: Number of actuators, on bodies.
    """
    V, links = len(law.gain), law.links
    ideal, bodies = T * (inputs is not None), T * (actuators is not None)
    return Log(
        positions=np.empty((T, V, 3)),
        residual=np.empty((T, V, 3)),
        command=np.empty((T, V, 3)),
        velocity=np.empty((T, V, 3)),
        medium=np.empty((T, V, 3)),
        inputs=np.full((ideal, *(inputs or (0, 0))), np.nan),
        origin=np.empty((bodies, V, 3)),
        quaternions=np.empty((bodies, V, 4)),
        thruster_command=np.empty((bodies, actuators or 0)),
        thruster_output=np.empty((bodies, actuators or 0)),
        saturation=np.empty((bodies, V)),
        heard=np.empty((T, len(links.table))),
        measurements=np.empty((T, len(law.edges.b) if links.record else 0)),
        safety=np.zeros((T, V, 4 if law.safety else 0)),
        extra=tuple(Extra(np.full((T, V, width), np.nan), read) for read, width in READERS.values()),
    )


@dataclass(frozen=True)
class Trajectory:
    """Samples of a run under one system.

    Attributes:
        system: The system, that of the phase if a run has several.
        time: Sample times, shape (T,), s.
        log: The samples.
        message: Vehicle, time and place of a blow-up; empty without one.
    """

    system: System
    time: Array
    log: Log
    message: str = ""

    @property
    def status(self) -> str:
        """'finished' or 'unstable'."""
        return "unstable" if self.message else "finished"

    @property
    def positions(self) -> Array:
        """Controlled positions, agents then targets, shape (T, V, 3), m."""
        return self.log.positions


@inline_jit
def _read_extra(extra, _, run, memory, k, v):
    extra.read(run, memory, v, extra.values[k, v])


_read_extras = for_each(lambda _: _read_extra)


@inline_jit
def record_vehicle(run, memory, log, k, v, position, velocity, medium):
    """Write the values that every backend records of vehicle v as sample k.

    Args:
        run: A Loop on bodies, an Integrator on ideal kinematics; see `READERS`.
        memory: Memory of the law.
        log: Log to write to.
        k, v: Numbers of the sample and the vehicle.
        position: Position seen by the law, at least 3 numbers, m.
        velocity: Velocity of the vehicle, at least 3 numbers, m/s.
        medium: Velocity of the medium around it, (x, y, z), m/s.
    """
    for i in range(3):
        log.positions[k, v, i] = position[i]
        log.residual[k, v, i] = memory.residual[v, i]
        log.command[k, v, i] = memory.command[v, i]
        log.velocity[k, v, i] = velocity[i]
        log.medium[k, v, i] = medium[i]
    for i in range(log.safety.shape[2]):
        log.safety[k, v, i] = memory.safety.found[v, i]
    _read_extras(log.extra, log.extra, None, run, memory, k, v)


@inline_jit
def record_links(heard, y, log, k):
    """Write the reception on each link as sample k, and measurements y (m,) if the log has room for them."""
    for i in range(log.heard.shape[1]):
        log.heard[k, i] = heard[i]
    for i in range(log.measurements.shape[1]):
        log.measurements[k, i] = y[i]


def pieces_of(phases: Sequence[Phase], samples: int, end: int, first: int = 0) -> Iterator[tuple[System, int, int]]:
    """Cut a run, from sample `first` on, into pieces of at most `samples` samples and one phase each.

    Yields:
        System, first sample and end of each piece.
    """
    for phase, stop in zip(phases, [*(later.start for later in phases[1:]), end], strict=True):
        for begin in range(max(phase.start, first), min(stop, end), samples):
            yield phase.system, begin, min(begin + samples, stop, end)


def blow_up_message(
    system: System,
    vehicle: int,
    detail: str,
    time: float,
    speed: str,
    memory: Memory,
    unknown: str,
    controller: Controller | None = None,
) -> str:
    """Name the vehicle, the time and the speed of a blow-up, and the cause, or where to find it.

    Args:
        system: The system.
        vehicle: Number of the vehicle that blew up.
        detail: Text that follows its name.
        time: Time, s.
        speed: Its speed, in words.
        memory: Memory of the law.
        unknown: Reason why the flow at the vehicle is unknown, or empty.
        controller: Law in Python that is in control, which may be the cause.
    """
    gain = "the law, with a controller.gain"
    if vehicle >= len(system.team.agents):
        gain = "the targets' consensus or pull, with a target_formation.gain or motion.pull"
    cause = controller.cause_of_blow_up(system.team, vehicle, memory.command) if controller else ""
    cause = unknown or cause
    cause = cause or (
        f"likely cause: {gain} that is too high for the control period, the links or the bodies, or a flow or motion "
        "too strong to integrate; mjsheaf check names the margin"
    )
    return f"unstable: {system.team.members[vehicle].id}{detail} at t = {time:.6g} s, {speed}; {cause}"


Commanded = bool | Literal["thrust"]
"""True if velocities from outside replace the agents' law, 'thrust' if actuator commands replace law and autopilot."""

Progress = Callable[[int, int], None]
"""Called with (samples done, samples in all)."""


class Recorder(NamedTuple):
    """Destination of samples.

    Attributes:
        log: T samples.
        placed: Positions that targets are put at, one for each sample, shape (T, V - N, 3), m; (0, 0, 3) leaves targets
            to their own motion.
        written: Number of samples in the log, shape (1,).
    """

    log: Log
    placed: Array
    written: IntArray


class Engine(WithThreads, ABC):
    """A run with the loop closed: its phases, its law and its samples.

    Subclasses must implement the abstract methods.

    Attributes:
        system: The closed-loop system; of a run with phases, that of the present one.
        steps_per_sample: Steps between samples.
        controller: Law in Python that is in control, or None.
        scenario: Scenario of the run, with its seed; None if the run was not made from one.
        phases: Phases of the run.
        memory: State of the onboard computers after the law's last evaluation; a phase with other edges has another.
        light: True to record what errors need alone: no attitudes, forces, commands and saturation.
    """

    light = False
    system: System
    memory: Memory
    steps_per_sample: int
    _control: ControlArrays  # of the present phase
    _timestep: float  # s
    _chunk: int  # steps in one compiled call; Ctrl-C takes effect between calls
    _stride: int  # the same if nothing is recorded
    _unrecorded: Recorder
    _count: Array  # steps taken, shape (1,)

    def __init__(
        self,
        run: "Scenario | System | Sequence[Phase]",
        *,
        controller: Law | Controller | None = None,
        commanded: Commanded = False,
        scenario: "Scenario | None" = None,
    ) -> None:
        """Put every vehicle at its initial position and heading.

        Args:
            run: A Scenario, the System that one describes, or the phases of a run.
            controller: Law in Python in place of the agents' own.
            commanded: True if velocities from outside take the place of the agents' own law, 'thrust' if commands of
                actuators take the place of their law and autopilot; see `add_to_command`.
            scenario: Scenario that phases are of, for other seeds.

        Raises:
            InputError: A vehicle is unknown or does not fit the dimension of its agent or target, or the control period
                is 0 with a law in Python.
        """
        self.scenario = cast("Scenario", run) if hasattr(run, "with_seed") else scenario
        self._take(phases_of(run))
        self._coordinates = np.arange(3) < [[agent.dimension] for agent in self.system.team.agents]
        self.controller = controller_of(controller, self.system, max(self.seed, 0))
        self._commanded: Commanded = commanded or self.controller is not None
        self._traffic = self.controller.traffic if self.controller else Traffic()
        self._prepare()
        self.reset()

    def _prepare(self) -> None:
        """Create the data that does not depend on the seed."""

    def _take(self, phases: Sequence[Phase]) -> None:
        """Store the phases of a run, and the data common to all of them."""
        self.phases = phases
        self.system = self.phases[0].system
        self._views: dict[int, View] = {}

    @property
    def seed(self) -> int:
        """Seed of the run; -1 if it is unknown."""
        return self.scenario.seed if self.scenario else -1

    def take_seed(self, seed: int) -> None:
        """Set the seed of the run that begins with the next `reset`; see there."""
        if self.scenario is None:
            raise InputError(f"seed is {seed}; expected None for a run that was not made from a Scenario")
        plan = self.system.bodies
        self.scenario = self.scenario.with_seed(seed)
        self._take(phases_of(on_engine(self.scenario.phases, plan.engine, plan.threads)))
        self._control = self._law_of_phase()
        if self.controller:
            self.controller.seed = self.seed

    def reset(self, seed: int | None = None) -> None:
        """Return to the initial condition.

        Args:
            seed: New seed of initial conditions, disturbances, links and a law in Python. None keeps the seed and
                repeats the same run, bit for bit.

        Raises:
            InputError: A seed is given but the run was not made from a Scenario, or the seed is not an integer >= 0.
        """
        if seed is not None:
            self.take_seed(seed)
        self.system = self.phases[0].system
        self._control = self._law_of_phase()
        self._begin()
        self._observed = -1
        self._now = self._before = self.positions()[: len(self.system.team.agents)]
        if self.controller:
            self.controller.reset(self._view.shown)

    # -- for subclasses ------------------------------------------------------------------------------------------------

    @abstractmethod
    def _control_of(self, system: System) -> ControlArrays:
        """Return law and references of a system's vehicles."""

    @abstractmethod
    def _begin(self) -> None:
        """Put the vehicles at their initial condition, with an empty memory."""

    @abstractmethod
    def _enter(self) -> None:
        """Continue under `system` and `_control`, those of another phase, with an empty memory."""

    @abstractmethod
    def _evaluate_law(self) -> None:
        """Evaluate the law now, into the memory."""

    @abstractmethod
    def _place_targets(self, recorder: Recorder) -> None:
        """Put targets at the recorder's positions for its next sample."""

    @abstractmethod
    def _move(self, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        """Take `count` steps, and samples as long as the recorder has room.

        Returns:
            The first vehicle whose state became bad and the step at which it did; None if all are good.
        """

    @abstractmethod
    def _record_now(self, recorder: Recorder) -> None:
        """Evaluate the law and record a sample, without a step."""

    @abstractmethod
    def _describe_blow_up(self, vehicle: int, step: int) -> str:
        """Name the vehicle whose state became bad at a step, and the likely cause."""

    @abstractmethod
    def _new_log(self, samples: int) -> Log:
        """Return a log for samples of the present phase."""

    @abstractmethod
    def _velocity(self, displacement: Array) -> Array:
        """Return velocities over ground and angular velocities of the agents, shape (N, 6), m/s and rad/s.

        Args:
            displacement: Displacements of the agents since the sample before, shape (N, 3), m.
        """

    @abstractmethod
    def positions(self) -> Array:
        """Controlled positions, padded: agents then targets, z = 0 for planar ones; shape (V, 3), m."""

    @abstractmethod
    def quaternions(self) -> Array:
        """Attitudes (w, x, y, z), body to world, shape (V, 4)."""

    # -- phases --------------------------------------------------------------------------------------------------------

    @property
    def steps_taken(self) -> int:
        """Number of steps since the start."""
        return int(self._count[0])

    @property
    def time(self) -> float:
        """Simulated time in s."""
        return self.system.grid.start + self.steps_taken * self._timestep

    @property
    def finished(self) -> bool:
        """True from the end of the run's time on."""
        return self.steps_taken >= self.system.grid.steps * self.steps_per_sample

    @property
    def _view(self) -> View:
        """Places of the agents' measurements in the memory of the present phase."""
        key = id(self.system)
        if key not in self._views:
            self._views[key] = View(self.system.team, self._control.law)
        return self._views[key]

    def _law_of_phase(self) -> ControlArrays:
        """Return law and references of the present system, without the agents' own law if they are commanded."""
        control = self._control_of(self.system)
        control = control._replace(law=with_ramp(control.law, self.system.team))
        if not self._commanded:
            return control
        supplied = len(self.system.team.agents)
        return ControlArrays(control.law.without_terms._replace(supplied=supplied), control.motion)

    def _enter_phase(self) -> int:
        """Enter the phase that the present step belongs to, and return the number of steps taken."""
        step = self.steps_taken
        sample = max(step // self.steps_per_sample, 0)
        system = [phase.system for phase in self.phases if phase.start <= sample][-1]
        if system is not self.system:
            self._unlook()
            law, memory = self._control.law, self.memory
            self.system = system
            self._control = self._law_of_phase()
            self._enter()
            carry(memory, law, self._control.law, sample, self.memory)
        return step

    def change_phases(self, phases: Sequence[Phase]) -> None:
        """Continue under other phases, equal to the previous ones up to the present sample.

        Args:
            phases: Phases of the run. Of those that begin after the start, the previous phases contain all that begin
                before the present sample.
        """
        self.phases = tuple(phases)
        self._views.clear()  # their keys are identities, which new systems may have again

    # -- stepping ------------------------------------------------------------------------------------------------------

    def step(self, n: int = 1) -> None:
        """Take n steps with the loop closed.

        Raises:
            UnstableError: The state diverged; the message names vehicle, time and likely cause.
            InputError: A law in Python raised an exception, or returned no velocity.
        """
        require_whole("n", n, 0)
        while n > 0:
            n -= self._advance(min(n, self._stride), self._unrecorded)

    def compile(self) -> None:
        """Compile what steps call, without taking one."""
        self._move(self.steps_taken, 0, self._unrecorded)

    def step_period(self) -> None:
        """Take the steps up to the next sample; see `step`."""
        self._displaced(self.positions()[: len(self.system.team.agents)])
        self.step(self.steps_per_sample - self.steps_taken % self.steps_per_sample)

    def _advance(self, count: int, recorder: Recorder) -> int:
        """Take up to `count` steps within one phase and, of a law in Python, one period; return how many."""
        step = self._enter_phase()
        ahead = (phase.start * self.steps_per_sample - step for phase in self.phases)
        count = min([count, *(steps for steps in ahead if steps > 0)])
        if self.controller:
            into = step % self.steps_per_sample
            if into == 0:
                self._place_targets(recorder)
                self._consult()
            count = min(count, self.steps_per_sample - into)
        self._unlook()
        with self._naming_terms():
            bad = self._move(step, count, recorder)
        if bad:
            raise UnstableError(self._describe_blow_up(*bad))
        return count

    def record(
        self, samples: int, targets: Array | None = None, progress: Progress | None = None
    ) -> Iterator[Trajectory]:
        """Take a sample now and after each period, up to the end of the run's time or of `targets`; in pieces.

        Args:
            samples: Largest number in each piece; the last one, and the last of a phase, may have fewer.
            targets: Positions that targets are put at, one for each sample, shape (T, V - N, 3), m, whatever their own
                motion would be; the run ends with the last. None lets them move by themselves.
            progress: Called with (samples done, samples in all).

        Yields:
            Pieces with the status 'finished'. If the run blows up, the last piece ends there and is 'unstable'.
        """
        of = self.system.grid.steps + 1 if targets is None else min(self.system.grid.steps + 1, len(targets))
        for system, begin, end in pieces_of(self.phases, samples, of, self.steps_taken // self.steps_per_sample):
            self._enter_phase()
            recorder = self._recorder(end - begin, None if targets is None else targets[begin:end])
            message = ""
            try:
                for _ in self._fill(recorder, to_the_end=end == of):
                    if progress:
                        progress(min(begin + int(recorder.written[0]), of - 1), of - 1)
            except UnstableError as error:
                message = str(error)
            done = int(recorder.written[0])
            yield Trajectory(system, system.grid.span(begin, begin + done), recorder.log.span(0, done), message)
            if message:
                return

    def _fill(self, recorder: Recorder, *, to_the_end: bool) -> Iterator[None]:
        """Record samples of one phase and advance after each, but for the last sample of a run; yield now and then."""
        positions = recorder.log.positions
        remaining = (len(positions) - to_the_end) * self.steps_per_sample
        while remaining > 0:
            remaining -= self._advance(min(remaining, self._chunk), recorder)
            yield
        before_now = positions[: len(positions) - to_the_end]
        if len(before_now) and not self.controller:
            self._observed = -1
            self._now = before_now[-1, : len(self._now)].copy()
        if to_the_end:
            self._enter_phase()
            self._place_targets(recorder)
            self._consult()
            self._look()
            with self._naming_terms():
                self._record_now(recorder)

    def _recorder(self, samples: int, targets: Array | None = None) -> Recorder:
        """Return a place for samples of the present phase."""
        placed = np.empty((0, 0, 3)) if targets is None else np.ascontiguousarray(targets)
        return Recorder(self._new_log(samples), placed, np.zeros(1, dtype=np.int64))

    def run(self, targets: Array | None = None, progress: Progress | None = None) -> Trajectory:
        """Record the whole run of one phase in one piece, and end the threads; see `record`.

        Returns:
            The trajectory; if the run blows up, its status is 'unstable' and it ends there.
        """
        with self:
            return next(self.record(self.system.grid.steps + 1, targets, progress))

    # -- what agents know ----------------------------------------------------------------------------------------------

    @property
    def command_shape(self) -> tuple[int, ...]:
        """Shape of the argument of `add_to_command`."""
        return len(self.system.team.agents), 3

    def add_to_command(self, velocity: Array) -> None:
        """Set velocities that are added to the commands of the compiled law, before the speed limit.

        They apply from the law's next evaluation until the next call. Zeros change no bit. Agents that are `commanded`
        have no other law.

        Args:
            velocity: Velocity of each agent relative to the medium, padded, shape (N, 3), m/s.
        """
        self._enter_phase()
        self.memory.supplied[: len(velocity)] = np.where(self._coordinates, velocity, 0.0)

    def observe(self) -> Sample:
        """Return the measurements available to agents now and, separately, the true state; the run is not affected."""
        self._enter_phase()
        memory = self.memory
        kept = memory.flat.copy()
        if not self._commanded:
            memory.supplied[:] = 0.0
        self._sample()
        x = self.positions()
        displacement = self._displaced(x[: len(self.system.team.agents)])
        moved = displacement, self._velocity(displacement)
        sample = Sample(self._view, self.time, x, self.quaternions(), *moved, memory, self._traffic)
        memory.flat[:] = kept
        return sample

    def _look(self) -> None:
        """Save the state of the onboard computers before the law is evaluated at a step that has not been taken yet.

        In compiled code, that is `mjsheaf.law.law.look`.
        """
        self._unlook()
        self.memory.kept[0] = self.steps_taken + 1
        self.memory.kept[1:] = self.memory.held

    def _unlook(self) -> None:
        """Restore the state of the onboard computers from before the law was evaluated at this step, if it was."""
        memory = self.memory
        if memory.kept[0] == self.steps_taken + 1:
            memory.held[:] = memory.kept[1:]

    def _sample(self) -> None:
        """Evaluate the law at the present step, which counts once."""
        self._look()
        with self._naming_terms():
            self._evaluate_law()

    def _naming_terms(self) -> AbstractContextManager[None]:
        """Return a context that names the registered term whose exception ends it."""
        return naming_terms(self._control.law.custom, self.system.team, self.memory.evaluated)

    def _displaced(self, q: Array) -> Array:
        """Return the displacement of agents at q (N, 3), m, since the sample before, shape (N, 3), m."""
        if self._observed != self.steps_taken:  # a sample may be taken again
            self._observed = self.steps_taken
            self._before = self._now
        self._now = q.copy()
        return np.asarray(q - self._before)

    def _consult(self) -> None:
        """Call the law in Python, if there is one, and supply the velocities that it returns."""
        if self.controller:
            self.add_to_command(self.controller.call(self.system.team, self.observe()))

    # -- the state -----------------------------------------------------------------------------------------------------

    def get_state(self) -> Array:
        """Return the complete state of the run, including the seed, as one array.

        It does not contain the state of a law in Python.
        """
        self._enter_phase()  # if a phase begins here, as `set_state` expects
        before = self._before if self._observed == self.steps_taken else self._now
        seed = float(self.seed)  # a double has 53 bits, and a seed 63
        rest = float(self.seed - int(seed))
        memory = self.memory
        seen = memory.held.copy()
        self._unlook()
        state = np.concatenate([[seed], memory.flat, [rest], before.ravel()])
        memory.held[:] = seen
        return state

    def set_state(self, state: Array) -> None:
        """Continue from a state of `get_state`, bit for bit as the run from which it was taken, with its seed.

        Raises:
            InputError: The state has another size, so it is not one of this scenario, or it is not finite.
        """
        values, before = np.asarray(state), self.get_state()
        good = values.dtype.kind in "fiu" and values.ndim == 1 and bool(np.isfinite(values).all())
        if not good or not self.restore(values.astype(np.float64)):
            self.restore(before)
            raise InputError(
                f"state has shape {values.shape}; expected {before.shape} finite numbers, as get_state gives them"
            )

    def seed_of(self, state: Array) -> int:
        """Return the seed of the run that a state belongs to; -1 if it is unknown."""
        rest = int(state[-1 - self._now.size]) if state[0] >= 2.0**53 else 0
        return int(state[0]) + rest

    def restore(self, state: Array) -> bool:
        """Take over a state, finite or not; return False if it is not of the size that its phase needs."""
        if len(state) < 3 + self._now.size:
            return False
        seed = self.seed_of(state)
        if self.scenario is not None and seed not in (-1, self.seed):
            self.reset(seed)
        self._go_to(state[1:])
        self._enter_phase()
        end = 1 + len(self.memory.flat)
        if len(state) != end + self._now.size + 1:
            return False
        self.memory.flat[:] = state[1:end]
        self.memory.kept[0] = 0.0
        self._observed = -1
        self._now = state[end + 1 :].reshape(-1, 3).copy()
        return True

    def _go_to(self, state: Array) -> None:
        """Set the number of steps taken to that of a state, its first number."""
        self._count[0] = state[0]
