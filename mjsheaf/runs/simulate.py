"""Simulating a scenario: from a scenario to data."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from mjsheaf.arguments import require_choice, require_scenario, require_whole
from mjsheaf.errors import InputError, NotUniqueError, RankError
from mjsheaf.scenario import Scenario
from mjsheaf.threads import free_processors

if TYPE_CHECKING:
    import xarray as xr

    from mjsheaf.control.controller import Controller, Law
    from mjsheaf.simulation.trajectory import Trajectory
    from mjsheaf.system import Phase, System

BACKENDS = ("physics", "ideal")
ENGINES = ("mujoco", "fused")
_WORTH_THREADS = 1e6  # vehicles times physics steps: less ends before another thread is of use

Progress = Callable[[str, int, int], None]
"""Called with (what is being done, done, in all)."""


def no_progress(what: str, done: int, total: int) -> None:
    """A `Progress` that reports nothing."""


def simulate(
    scenario: Scenario,
    backend: str = "physics",
    *,
    engine: str = "mujoco",
    threads: int | None = None,
    controller: "Law | Controller | None" = None,
    allow_drift: bool = False,
    progress: Callable[[int, int], None] | bool | None = True,
) -> "xr.Dataset":
    """Run a scenario and return its data, as result.nc holds them.

    Args:
        scenario: from `load_scenario`.
        backend: 'physics' or 'ideal'.
        engine: what moves bodies: 'mujoco', or 'fused', which has no contacts, ends within rounding of it and takes a
            fraction of the time.
        threads: how many move the bodies; MuJoCo gives each a model of its own. More than one is refused with contacts,
            and a law in Python runs on one. None takes the idle processors. The result is the same to the bit.
        controller: a law in Python in place of the agents' own, `law(t, sample)` -> velocities (N, 3), m/s, called once
            a control period; see `mjsheaf.control.controller`.
        allow_drift: simulate a team whose harmonic extension is not unique too, against the q* of minimum norm; the
            result's attrs['free_directions'] then say what is free.
        progress: True shows a bar on a terminal or in a notebook, False nothing; a function is called now and then with
            (samples done, samples in all).

    Returns:
        The whole dataset, in memory; `mjsheaf run` writes it piece by piece. Where the run blew up, attrs['status'] is
        'unstable', attrs['message'] says why, and the data end with the last good sample.

    Raises:
        InputError: unknown backend or engine, an engine or threads that lack what the scenario asks for, a vehicle that
            does not fit its agent, or a g that is not of full row rank; or a law in Python raised an exception or
            returned no velocities: the message names agent and time.
        NotUniqueError: the harmonic extension is not unique, and drift is not allowed.
    """
    from mjsheaf.progress import shown

    require_scenario(scenario)
    with shown(progress, "simulating") as bar:
        report = partial(bar, "simulating") if bar else progress if callable(progress) else None
        phases = moved_by(scenario.phases, backend, engine, threads)
        require_simulable(phases, backend, allow_drift=allow_drift)
        result = next(stream(phases, backend, scenario.seed, report, phases[0].system.grid.steps + 1, controller))
    return with_scenario(result, scenario)


def with_scenario(dataset: "xr.Dataset", scenario: Scenario) -> "xr.Dataset":
    """Note on a run what it is of, for `mjsheaf.save`; no file gets it."""
    dataset.encoding["scenario"] = scenario
    return dataset


def moved_by(
    phases: "Sequence[Phase]", backend: str, engine: str = "mujoco", threads: int | None = None
) -> "Sequence[Phase]":
    """A run on an engine and threads; see `simulate`.

    Raises:
        InputError: unknown engine, threads below 1, or either for ideal kinematics.
    """
    from mjsheaf.system import on_engine

    require_engine(engine, backend)
    if threads is not None:
        require_whole("threads", threads, 1)
    if backend == "ideal":
        if threads is not None and threads > 1:
            raise InputError(f"threads is {threads}: ideal kinematics run on one; expected 1, or backend 'physics'")
        return phases
    plan, grid = phases[0].system.bodies, phases[0].system.grid
    if threads is None:
        vehicle_steps = len(plan.vehicle) * grid.steps * grid.period / plan.timestep
        threads = free_processors() if vehicle_steps >= _WORTH_THREADS and not plan.contacts else 1
    return phases if (plan.engine, plan.threads) == (engine, threads) else on_engine(phases, engine, threads)


def stream(
    run: "System | Sequence[Phase]",
    backend: str,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    samples: int | None = None,
    controller: "Law | Controller | None" = None,
) -> "Iterator[xr.Dataset]":
    """Yield a run as consecutive Datasets; arguments that are not listed are those of `simulate`.

    Args:
        run: a system that has passed `require_simulable`, or phases whose systems have.
        seed: seed of the scenario.
        samples: at most in each piece; a few megabytes of them unless given.
    """
    from mjsheaf.control.controller import controller_of
    from mjsheaf.simulation.trajectory import samples_in_piece
    from mjsheaf.system import phases_of

    if backend == "ideal":
        from mjsheaf.simulation.ideal import stream_ideal as simulated
    else:
        from mjsheaf.simulation.physics import stream_physics as simulated
    phases = phases_of(run)
    first = phases[0].system
    called, length = controller_of(controller, first, seed), samples or samples_in_piece(first)
    pieces = simulated(run, length, progress, controller=called)
    yield from datasets_of(pieces, phases, backend, seed, length, called)


def datasets_of(
    pieces: "Iterable[Trajectory]",
    phases: "Sequence[Phase]",
    backend: str,
    seed: int,
    samples: int,
    controller: "Controller | None" = None,
) -> "Iterator[xr.Dataset]":
    """The Datasets of a run that comes in pieces, so many samples each; arguments as of `stream`."""
    from mjsheaf.results.dataset import in_pieces, make_datasets

    datasets = make_datasets(pieces, backend, seed, phases)
    if any(phase.events for phase in phases):
        datasets = in_pieces(datasets, samples)
    for dataset in datasets:
        if controller:
            dataset.attrs.pop("gain", None)  # which this law ignores
            dataset.attrs |= {
                "controller": controller.name,
                "law": controller.name,
                "exchange_rounds": controller.rounds,
                "messages": controller.messages,
                "numbers_sent": controller.numbers,
            }
        yield dataset


def dataset_of(
    pieces: "Sequence[Trajectory]",
    phases: "Sequence[Phase]",
    backend: str,
    seed: int,
    controller: "Controller | None" = None,
) -> "xr.Dataset":
    """Gather a run that lies in memory, one piece for each phase that it reached; arguments as of `stream`."""
    samples = phases[0].system.grid.steps + 1
    return next(datasets_of(pieces, phases, backend, seed, samples, controller))


def require_backend(backend: str) -> None:
    """Refuse an unknown backend.

    Raises:
        InputError: it is.
    """
    require_choice("backend", backend, BACKENDS)


def require_engine(engine: str, backend: str) -> None:
    """Refuse an engine.

    Raises:
        InputError: it is unknown, or not for this backend.
    """
    require_choice("engine", engine, ENGINES)
    if engine != "mujoco" and backend == "ideal":
        raise InputError(f"engine {engine!r}: moves bodies, and ideal kinematics have none; expected backend 'physics'")


def require_simulable(run: "System | Sequence[Phase]", backend: str, *, allow_drift: bool = False) -> None:
    """Refuse what cannot be simulated; the same on both backends, before anything is simulated or written.

    Raises:
        InputError: unknown backend; contacts, where the engine or its threads have none; a vehicle that is unknown or
            does not fit its agent or target, which matters to the ideal backend too, as a scenario that only one
            backend takes is not one to compare; or a g that is not of full row rank.
        NotUniqueError: the harmonic extension is not unique, in some phase of the run, and drift is not allowed.
    """
    from mjsheaf.dynamics.effectiveness import without_full_row_rank
    from mjsheaf.system import DEFAULT_VEHICLE, phases_of

    require_backend(backend)
    phases = phases_of(run)
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
        if phase.system.team.dirichlet.unique:
            continue
        from mjsheaf.team.null_modes import describe_null_modes

        free = describe_null_modes(phase.system.team.remaining)
        when = f" in phase {k}, from t = {phase.time:g} s on ({phase.name})" if len(phases) > 1 else ""
        raise NotUniqueError(
            f"the harmonic extension is not unique{when}: H^0(G, G_p; F) has dimension {len(free)}: "
            f"{'; '.join(free[:4])}{'; ...' if len(free) > 4 else ''}; sense or share the free coordinates"
        )
