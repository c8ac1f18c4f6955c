"""Simulation of a scenario, from its description to data."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from mjsheaf.arguments import require_scenario
from mjsheaf.loop.session import Session, engine_of
from mjsheaf.scenario import Scenario

if TYPE_CHECKING:
    import xarray as xr

    from mjsheaf.law.in_python import Controller, Law
    from mjsheaf.loop.engine import Engine
    from mjsheaf.loop.log import Trajectory
    from mjsheaf.system import Phase, System

Progress = Callable[[str, int, int], None]
"""Callback, called with the name of the activity, the steps done and the number of steps."""


def no_progress(what: str, done: int, total: int) -> None:
    """Ignore progress."""


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
    """Run a scenario and return its data, the contents of result.nc.

    Args:
        scenario: Scenario from `load_scenario`.
        backend: 'physics' or 'ideal'.
        engine: Physics engine: 'mujoco', or 'fused', which has no contacts, agrees with MuJoCo to within rounding, and
            takes a fraction of the time.
        threads: Maximum number of threads of the fused engine, which divides the vehicles of a large team between two
            evaluations of the law; None takes all processors. MuJoCo, small teams and laws in Python run on one. The
            result is the same bit for bit.
        controller: Law in Python that replaces the agents' own, `law(t, sample)` -> velocities (N, 3), m/s, called once
            per control period; see `mjsheaf.law.in_python`.
        allow_drift: True to also simulate a team whose harmonic extension is not unique, with the q* of minimum norm;
            attrs['free_directions'] of the result then names the free directions.
        progress: True shows a bar on a terminal or in a notebook, and False shows nothing. A function is called
            periodically with the samples done and the number of samples.

    Returns:
        The whole dataset in memory; `mjsheaf run` writes it in pieces. If the run blew up, attrs['status'] is
        'unstable', attrs['message'] explains why, and the data end with the last valid sample.

    Raises:
        InputError: The backend or engine is unknown, the engine does not support the scenario, a vehicle does
            not fit its agent, or a g does not have full row rank; or a law in Python raised an exception or returned no
            velocities, in which case the message names agent and time.
        NotUniqueError: The harmonic extension is not unique, and drift is not allowed.
    """
    from mjsheaf.progress import shown

    require_scenario(scenario)  # before a bar is shown
    with shown(progress, "simulating") as bar:
        report = partial(bar, "simulating") if bar else progress if callable(progress) else None
        options: Any = {"engine": engine, "threads": threads, "controller": controller, "allow_drift": allow_drift}
        with Session(scenario, backend, **options) as session:
            samples = session.engine.system.grid.steps + 1
            datasets = datasets_by(session.engine, backend, scenario.seed, samples, report)
            return with_scenario(next(datasets), scenario)


def with_scenario(dataset: "xr.Dataset", scenario: Scenario) -> "xr.Dataset":
    """Attach the scenario to a run in memory, for `mjsheaf.save`; files do not contain it."""
    dataset.encoding["scenario"] = scenario
    return dataset


def stream(
    run: "System | Sequence[Phase]",
    backend: str,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    samples: int | None = None,
    controller: "Law | Controller | None" = None,
    only: "Collection[str] | None" = None,
) -> "Iterator[xr.Dataset]":
    """Yield a run as consecutive Datasets; see `simulate` for arguments that are not listed.

    Args:
        run: System that has passed `prepare_run`, or phases whose systems have.
        seed: Seed of the scenario.
        samples: Maximum number of samples in a piece; a few megabytes of them unless given.
        only: Names of the variables to collect; all unless given.
    """
    from mjsheaf.law.in_python import controller_of
    from mjsheaf.loop.log import samples_in_piece
    from mjsheaf.system import phases_of

    called = controller_of(controller, phases_of(run)[0].system, seed)
    with engine_of(run, backend, controller=called) as engine:
        yield from datasets_by(engine, backend, seed, samples or samples_in_piece(engine.system), progress, only)


def datasets_by(
    engine: "Engine",
    backend: str,
    seed: int,
    samples: int,
    progress: Callable[[int, int], None] | None,
    only: "Collection[str] | None" = None,
) -> "Iterator[xr.Dataset]":
    """Yield the Datasets of an engine's run; see `stream` for the arguments."""
    pieces = engine.record(samples, progress=progress)
    return datasets_of(pieces, engine.phases, backend, seed, samples, engine.controller, only)


def datasets_of(
    pieces: "Iterable[Trajectory]",
    phases: "Sequence[Phase]",
    backend: str,
    seed: int,
    samples: int,
    controller: "Controller | None" = None,
    only: "Collection[str] | None" = None,
) -> "Iterator[xr.Dataset]":
    """Yield the Datasets of a run in pieces of the given number of samples; see `stream` for the arguments."""
    from mjsheaf.results.dataset import in_pieces, make_datasets

    datasets = make_datasets(pieces, backend, seed, phases, only=only)
    if any(phase.events for phase in phases):
        datasets = in_pieces(datasets, samples)
    for dataset in datasets:
        if controller:
            dataset.attrs.pop("gain", None)  # a law in Python ignores it
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
    """Collect a run in memory, with one piece for each phase that it reached; see `stream` for the arguments."""
    return next(datasets_of(pieces, phases, backend, seed, phases[0].system.grid.steps + 1, controller))
