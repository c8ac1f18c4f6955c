"""Simulating a scenario: from a scenario to data."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from mjsheaf.arguments import require_scenario
from mjsheaf.scenario import Scenario
from mjsheaf.simulation.session import Session, engine_of

if TYPE_CHECKING:
    import xarray as xr

    from mjsheaf.control.controller import Controller, Law
    from mjsheaf.simulation.engine import Engine
    from mjsheaf.simulation.trajectory import Trajectory
    from mjsheaf.system import Phase, System

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
        scenario: Scenario from `load_scenario`.
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

    require_scenario(scenario)  # before a bar is shown
    with shown(progress, "simulating") as bar:
        report = partial(bar, "simulating") if bar else progress if callable(progress) else None
        options: Any = {"engine": engine, "threads": threads, "controller": controller, "allow_drift": allow_drift}
        with Session(scenario, backend, **options) as session:
            return dataset_of_session(session, report)


def dataset_of_session(session: Session, progress: Callable[[int, int], None] | None = None) -> "xr.Dataset":
    """Run a session of a Scenario to its end and return its data; see `simulate`."""
    engine = session.engine
    datasets = datasets_by(engine, session.backend, session.scenario.seed, engine.system.grid.steps + 1, progress)
    return with_scenario(next(datasets), session.scenario)


def with_scenario(dataset: "xr.Dataset", scenario: Scenario) -> "xr.Dataset":
    """Note on a run what it is of, for `mjsheaf.save`; no file gets it."""
    dataset.encoding["scenario"] = scenario
    return dataset


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
        samples: Largest number of samples in a piece; a few megabytes of them unless given.
    """
    from mjsheaf.simulation.trajectory import samples_in_piece

    with engine_of(run, backend, controller=controller, seed=seed) as engine:
        yield from datasets_by(engine, backend, seed, samples or samples_in_piece(engine.system), progress)


def datasets_by(
    engine: "Engine", backend: str, seed: int, samples: int, progress: Callable[[int, int], None] | None
) -> "Iterator[xr.Dataset]":
    """Yield the Datasets of an engine's run; arguments as of `stream`."""
    pieces = engine.record(samples, progress=progress)
    return datasets_of(pieces, engine.phases, backend, seed, samples, engine.controller)


def datasets_of(
    pieces: "Iterable[Trajectory]",
    phases: "Sequence[Phase]",
    backend: str,
    seed: int,
    samples: int,
    controller: "Controller | None" = None,
) -> "Iterator[xr.Dataset]":
    """Yield the Datasets of a run in pieces of the given number of samples; arguments as of `stream`."""
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
                "exchange_rounds": controller.traffic.rounds,
                "messages": controller.traffic.messages,
                "numbers_sent": controller.traffic.numbers,
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
