"""The loop: the law at its period, forces before each step, MuJoCo's step, and a look at what came out.

The whole loop is compiled; mj_step is called through its C symbol, which frees it from the interpreter.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import llvmlite.binding
import numpy as np
from numba import types
from numpy.typing import NDArray

from mjsheaf.backends.physics.arena import Arena, compose
from mjsheaf.backends.physics.callback import BeforeStep, close_loop, controlled_position
from mjsheaf.backends.physics.effects import embody
from mjsheaf.backends.physics.loading import load_vehicle
from mjsheaf.backends.physics.recording import Log, new_log, place_targets, record
from mjsheaf.backends.physics.vehicle import Vehicle
from mjsheaf.backends.system import System
from mjsheaf.backends.trajectory import blow_up_message
from mjsheaf.compiled import kernel, part
from mjsheaf.engine import mujoco
from mjsheaf.errors import InputError, UnstableError
from mjsheaf.expected import expected

Array = NDArray[np.float64]

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
        self.system: System = scenario if isinstance(scenario, System) else scenario.system()
        self.arena = arena_of(self.system, visible=visible)
        self.model: mujoco.MjModel = self.arena.model
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        plan, grid = self.system.bodies, self.system.grid
        self._steps_per_sample = _whole_ratio(grid.period, plan.timestep)
        self._steps_per_law = 1 if grid.continuous else self._steps_per_sample
        # The timestep that divides a period exactly: sample times then agree with the ideal backend's.
        self._timestep = grid.period / self._steps_per_sample
        self.model.opt.timestep = self._timestep
        self._before_step = BeforeStep(self.system, self.arena, self.data)
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


def _whole_ratio(period: float, timestep: float) -> int:
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


def vehicles_of(system: System) -> list[Vehicle]:
    """The vehicle of every agent and target, in order.

    Raises:
        InputError: a vehicle is unknown, its files are not valid, or it does not fit the dimension of its agent or
            target; the message begins with the field.
    """
    plan, loaded, vehicles = system.bodies, {}, []
    for v, (member, name) in enumerate(zip(system.team.members, plan.vehicle, strict=True)):
        field = f"{'agents' if v < len(system.team.agents) else 'targets'}.{member.id}.vehicle"
        try:
            if name not in loaded:
                loaded[name] = embody(load_vehicle(name).with_time_constant(plan.time_constant), plan.effects)
        except InputError as error:
            raise InputError(f"{field}: {error}") from None
        if loaded[name].dimension != member.dimension:
            raise InputError(
                f"{field}: {name!r} moves in {loaded[name].dimension} dimensions, but {member.id} has "
                f"{member.dimension}; see mjsheaf list --vehicles"
            )
        vehicles.append(loaded[name])
    return vehicles


def arena_of(system: System, colours: Array | None = None, visible: bool = True) -> Arena:
    """Compose the arena of a system; colours (V, 3) paint the vehicles, and they need not be visible."""
    plan = system.bodies
    return compose(
        vehicles_of(system),
        [m.id for m in system.team.members],
        timestep=plan.timestep,
        contacts=plan.contacts,
        surface=plan.surface,
        surface_height=plan.surface_height,
        colours=colours,
        visible=visible,
    )
