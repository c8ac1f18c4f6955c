"""Simulation of scenarios, from their description to data: one, or many on threads of this process."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from threading import Event

import xarray as xr

from mjsheaf.arguments import require_scenario, require_whole
from mjsheaf.errors import InputError, MjsheafError
from mjsheaf.law.in_python import Controller, Law, controller_of
from mjsheaf.loop.engine import Trajectory, samples_in_piece
from mjsheaf.loop.session import engine_of, prepare_run, require_engine
from mjsheaf.loop.system import Phase, System, phases_of
from mjsheaf.progress import shown
from mjsheaf.results.dataset import in_pieces, make_datasets
from mjsheaf.scenario import Scenario
from mjsheaf.threads import one_thread, usable_processors


def simulate(
    scenario: Scenario,
    backend: str = "physics",
    *,
    engine: str = "mujoco",
    threads: int | None = None,
    controller: Law | Controller | None = None,
    allow_drift: bool = False,
    progress: Callable[[int, int], None] | bool | None = True,
) -> xr.Dataset:
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
    require_scenario(scenario)  # before a bar is shown
    with shown(progress, "simulating") as bar:
        report = partial(bar, "simulating") if bar else progress if callable(progress) else None
        phases = prepare_run(scenario, backend, engine, threads, allow_drift=allow_drift)
        samples = phases[0].system.grid.steps + 1
        (dataset,) = stream(phases, backend, scenario.seed, report, samples, controller)
    dataset.encoding["scenario"] = scenario  # for `mjsheaf.save`; files do not contain it
    return dataset


@one_thread  # of linear algebra, whose number is the process's: a run that ends would restore it for the others
def simulate_many(
    scenarios: Iterable[Scenario],
    backend: str = "physics",
    *,
    engine: str = "mujoco",
    workers: int | None = None,
    allow_drift: bool = False,
    progress: Callable[[int, int], None] | bool | None = True,
) -> list[xr.Dataset | MjsheafError]:
    """Run independent scenarios in parallel on threads of this process.

    The compiled loops release the interpreter's lock. Results equal those of `simulate` bit for bit.

    Args:
        scenarios: Scenarios, for example one with many seeds or gains.
        backend: 'physics' or 'ideal'.
        engine: See `simulate`.
        workers: Number of threads; None takes one for each processor that this process may use.
        allow_drift: See `simulate`.
        progress: True shows a bar on a terminal or in a notebook, and False shows nothing. A function is called in the
            calling thread with the runs done and the number of runs.

    Returns:
        Result of `simulate` for each scenario, in their order. If `simulate` refuses a scenario, its place holds the
        error, a MjsheafError, and the others still run. A run that blew up is a dataset with status 'unstable'.

    Raises:
        InputError: The backend or engine is unknown, `workers` is below 1, or an item is not a Scenario.
    """
    require_engine(engine, backend)
    require_whole("workers", 1 if workers is None else workers, 1)
    if isinstance(scenarios, Scenario) or not isinstance(scenarios, Iterable):
        raise InputError(f"scenarios is a {type(scenarios).__name__}; expected a list of Scenarios")
    todo = list(scenarios)
    for k, scenario in enumerate(todo):
        if not isinstance(scenario, Scenario):
            raise InputError(f"scenarios: number {k} is a {type(scenario).__name__}; expected a Scenario")
    stop = Event()

    def check(done: int, of: int) -> None:
        if stop.is_set():
            raise _Abandoned

    def one(k: int) -> xr.Dataset | MjsheafError:
        try:
            check(0, 0)
            return simulate(todo[k], backend, engine=engine, threads=1, allow_drift=allow_drift, progress=check)
        except MjsheafError as error:
            return error

    with shown(progress, "running") as bar, ThreadPoolExecutor(workers or usable_processors()) as pool:
        report = partial(bar, "running") if bar else progress if callable(progress) else None
        if bar:
            bar("running", 0, len(todo))
        try:
            futures = [pool.submit(one, k) for k in range(len(todo))]
            for done, future in enumerate(as_completed(futures), 1):
                future.result()  # an exception is raised as soon as it occurs
                if report:
                    report(done, len(futures))
            return [future.result() for future in futures]
        finally:
            stop.set()


class _Abandoned(Exception):  # noqa: N818
    """Signal to end a run because the others were interrupted."""


def stream(
    run: System | Sequence[Phase],
    backend: str,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    samples: int | None = None,
    controller: Law | Controller | None = None,
    only: Collection[str] | None = None,
) -> Iterator[xr.Dataset]:
    """Yield a run as consecutive Datasets; see `simulate` for arguments that are not listed.

    Args:
        run: System that has passed `prepare_run`, or phases whose systems have.
        seed: Seed of the scenario.
        samples: Maximum number of samples in a piece; a few megabytes of them unless given.
        only: Names of the variables to collect, which need no attitudes and no actuators; all unless given.
    """
    with engine_of(run, backend, controller=controller_of(controller, phases_of(run)[0].system, seed)) as engine:
        engine.light = only is not None
        samples = samples or samples_in_piece(engine.system)
        pieces = engine.record(samples, progress=progress)
        yield from datasets_of(pieces, engine.phases, backend, seed, samples, engine.controller, only)


def datasets_of(
    pieces: Iterable[Trajectory],
    phases: Sequence[Phase],
    backend: str,
    seed: int,
    samples: int,
    controller: Controller | None = None,
    only: Collection[str] | None = None,
) -> Iterator[xr.Dataset]:
    """Yield the Datasets of a run in pieces of the given number of samples; see `stream` for the arguments."""
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
