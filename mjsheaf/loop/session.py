"""Runs that advance by control periods, on ideal kinematics or bodies, with any engine.

`simulate`, `simulate_many`, `compare` and the environments are callers of `Session`.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arguments import real_numbers, require_choice, require_scenario, require_whole
from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, NotUniqueError, RankError
from mjsheaf.threads import WithThreads, usable_processors

if TYPE_CHECKING:
    from mjsheaf.law.in_python import Controller, Law, Sample
    from mjsheaf.loop.engine import Commanded, Engine
    from mjsheaf.loop.system import Phase, System
    from mjsheaf.scenario import Scenario

BACKENDS = ("physics", "ideal")
ENGINES = ("mujoco", "fused")


class Session(WithThreads):
    """Closed-loop run that advances one control period at a time.

    It gives the results of `simulate` bit for bit: repeated calls of `step` give the samples of its dataset. If it has
    several threads, close it or use it in a `with` block.

    Attributes:
        backend: 'physics' or 'ideal'.
        engine: Engine that moves the vehicles: a `World` for MuJoCo, else another `Engine`.
    """

    def __init__(
        self,
        scenario: "Scenario",
        backend: str = "physics",
        *,
        engine: str = "mujoco",
        threads: int | None = 1,
        controller: "Law | Controller | None" = None,
        commanded: "Commanded" = False,
        allow_drift: bool = False,
        visible: bool = False,
    ) -> None:
        """Put every vehicle at its initial condition.

        Args:
            scenario: The scenario, as `mjsheaf.load_scenario` returns it.
            backend: 'physics' or 'ideal'.
            engine: Engine that moves bodies: 'mujoco' or 'fused'; see `simulate`.
            threads: Maximum number of threads of the fused engine; None takes all processors, see `simulate`.
            controller: A law in Python in place of the agents' own; see `simulate`.
            commanded: True if the argument of `step` replaces the agents' own law; by default it is added to it.
                'thrust' if it contains actuator commands, which replace law and autopilot (on bodies only).
            allow_drift: True to also simulate a team whose harmonic extension is not unique; see `simulate`.
            visible: True for a MuJoCo model that includes purely visual geoms.

        Raises:
            InputError: An argument or the scenario is invalid, as for `simulate`.
            NotUniqueError: The harmonic extension is not unique, and drift is not allowed.
        """
        require_scenario(scenario)
        self.backend = backend
        if commanded == "thrust" and backend == "ideal":
            raise InputError("commanded is 'thrust': ideal kinematics have no thrusters; expected backend 'physics'")
        phases = prepare_run(scenario, backend, engine, threads, allow_drift=allow_drift)
        self.engine = engine_of(
            phases, backend, controller=controller, scenario=scenario, commanded=commanded, visible=visible
        )

    @property
    def scenario(self) -> "Scenario":
        """The scenario, with the seed of the run."""
        return cast("Scenario", self.engine.scenario)

    def reset(self, seed: int | None = None) -> None:
        """Go back to the start.

        Args:
            seed: Seed of the run from here on: of initial conditions, disturbances, links and a law in Python. None
                keeps the seed, and gives the same run again, to the bit.

        Raises:
            InputError: The seed is not an integer >= 0.
        """
        self.engine.reset(seed)

    def observe(self) -> "Sample":
        """Return the local information of the agents now and, separately, the true state; the run is not affected.

        It is the record that a law in Python receives. Sample k corresponds to row k of the dataset.
        """
        return self.engine.observe()

    def step(self, command: ArrayLike | None = None) -> None:
        """Take one control period.

        Args:
            command: Velocity of each agent relative to the medium, in this period, padded, shape (N, 3), m/s. It is
                added to the command of the agents' law before the speed limit; if the session is `commanded`, it takes
                its place. None stands for zeros, which leave the law's command unchanged to the bit. If `commanded` is
                'thrust': the command of each actuator of the agents, in the order of `result.nc`, shape (A,).

        Raises:
            UnstableError: The state became bad; the message names vehicle, time and likely cause.
            InputError: The command has another shape or is not finite, or a law in Python raised an exception or
                returned no velocities.
        """
        engine = self.engine
        shape = engine.command_shape
        accepted = f"{shape} finite {'velocities in m/s' if len(shape) == 2 else 'commands of actuators'}"
        engine.add_to_command(real_numbers("command", np.zeros(shape) if command is None else command, shape, accepted))
        engine.step_period()

    def change_events(self, scenario: "Scenario") -> None:
        """Continue under a scenario with other events from the present sample on.

        The run is then that of the new scenario from its start, to the bit.

        Args:
            scenario: The session's scenario; its events before the present sample are the same.

        Raises:
            InputError: The scenario is invalid, see `simulate`; the session continues as before.
            NotUniqueError: The harmonic extension is not unique in some phase.
        """
        plan = self.engine.system.bodies
        phases = prepare_run(scenario, self.backend, plan.engine, plan.threads)
        self.engine.scenario = scenario
        self.engine.change_phases(phases)

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.engine.time

    @property
    def finished(self) -> bool:
        """True from the end of the run's time on."""
        return self.engine.finished

    @property
    def state(self) -> Array:
        """Complete state of the run, including the seed, as one array; set it to continue from there, bit for bit.

        It does not contain the state of a law in Python.
        """
        return self.engine.get_state()

    @state.setter
    def state(self, state: Array) -> None:
        self.engine.set_state(state)

    def close(self) -> None:
        """End the threads."""
        self.engine.close()


def engine_of(
    run: "System | Sequence[Phase]",
    backend: str = "physics",
    *,
    controller: "Law | Controller | None" = None,
    commanded: "Commanded" = False,
    visible: bool = False,
    scenario: "Scenario | None" = None,
) -> "Engine":
    """Return the engine of a run at its start.

    Runs that cannot be simulated are refused by `prepare_run`, not here.

    Args:
        run: A system, or the phases of a run on their engine.
        backend, controller, commanded, visible: See `Session`.
        scenario: Scenario that the run was made from, for other seeds.
    """
    from mjsheaf.loop.system import phases_of

    if backend == "ideal":
        from mjsheaf.loop.ideal import Ideal

        return Ideal(run, controller=controller, commanded=commanded, scenario=scenario)
    if phases_of(run)[0].system.bodies.engine == "fused":
        from mjsheaf.loop.fused import Fused

        return Fused(run, controller=controller, commanded=commanded, scenario=scenario)
    from mjsheaf.loop.mujoco_engine import World

    return World(scenario or run, controller=controller, commanded=commanded, visible=visible)


def require_engine(engine: str, backend: str) -> None:
    """Refuse an engine or a backend.

    Raises:
        InputError: One is unknown, or the engine is not for this backend.
    """
    require_choice("backend", backend, BACKENDS)
    require_choice("engine", engine, ENGINES)
    if engine != "mujoco" and backend == "ideal":
        raise InputError(f"engine {engine!r}: moves bodies, and ideal kinematics have none; expected backend 'physics'")


def prepare_run(
    run: "Scenario | System | Sequence[Phase]",
    backend: str,
    engine: str = "mujoco",
    threads: int | None = None,
    *,
    allow_drift: bool = False,
) -> "tuple[Phase, ...]":
    """Return the phases of a run on an engine and a number of threads (1 for MuJoCo); see `simulate`.

    Runs that cannot be simulated are refused before anything is simulated or written. Both backends refuse the same
    scenarios, also for faults of vehicles, because a scenario that only one of them accepts could not be compared.

    Raises:
        InputError: The backend or engine is unknown; threads is below 1; an engine or several threads are given for
            ideal kinematics; contacts are on, and the engine has none; a vehicle is unknown or does not fit its
            agent or target; or a g does not have full row rank.
        NotUniqueError: The harmonic extension is not unique in some phase of the run, and drift is not allowed.
    """
    from mjsheaf.loop.system import DEFAULT_VEHICLE, on_engine, phases_of
    from mjsheaf.vehicles.allocation import without_full_row_rank

    require_engine(engine, backend)
    if threads is not None:
        require_whole("threads", threads, 1)
    phases = phases_of(run)
    if backend == "physics":
        phases = on_engine(phases, engine, 1 if engine == "mujoco" else threads or usable_processors())
    elif threads is not None and threads > 1:
        raise InputError(f"threads is {threads}: ideal kinematics run on one; expected 1, or backend 'physics'")
    system = phases[0].system
    system.bodies.refuse_contacts()
    team = system.team
    named = zip(team.members, system.bodies.vehicle, strict=True)
    if any(name != DEFAULT_VEHICLE[member.dimension] for member, name in named):
        _ = system.vehicles
    for i in without_full_row_rank(system.effectiveness, [a.dimension for a in team.agents]):
        raise RankError(
            f"agents.{team.agents[i].id}.effectiveness: g is not of full row rank {team.agents[i].dimension} "
            "(Assumption 2): no input makes every velocity"
        )
    for k, phase in enumerate(() if allow_drift else phases):
        team = phase.system.team.remaining
        initial = phase.system.remaining.initial
        if team.is_settled(initial):
            continue
        free = phase.system.free_directions
        when = f" in phase {k}, from t = {phase.time:g} s on ({phase.name})" if len(phases) > 1 else ""
        why = "at q* agents can move without changing what is measured; give them more edges, or a target to sense"
        if free:
            shown = "; ".join(free[:4]) + ("; ..." if len(free) > 4 else "")
            why = f"H^0(G, G_p; F) has dimension {len(free)}: {shown}; sense or share the free coordinates"
        raise NotUniqueError(f"the harmonic extension is not unique{when}: {why}")
    return phases
