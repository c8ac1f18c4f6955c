"""Simulation of many scenarios in parallel, on threads of this process."""

from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from functools import partial
from threading import Event
from typing import TYPE_CHECKING, TypeVar

from mjsheaf.arguments import require_whole
from mjsheaf.errors import InputError, MjsheafError
from mjsheaf.loop.session import require_engine
from mjsheaf.runs.simulate import simulate
from mjsheaf.scenario import Scenario
from mjsheaf.threads import usable_processors

if TYPE_CHECKING:
    from collections.abc import Callable

    import xarray as xr

T = TypeVar("T")


def simulate_many(
    scenarios: Iterable[Scenario],
    backend: str = "physics",
    *,
    engine: str = "mujoco",
    workers: int | None = None,
    allow_drift: bool = False,
    progress: "Callable[[int, int], None] | bool | None" = True,
) -> "list[xr.Dataset | MjsheafError]":
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
    from mjsheaf.progress import shown

    require_engine(engine, backend)
    require_whole("workers", 1 if workers is None else workers, 1)
    todo = _listed(scenarios)
    stop = Event()

    def check(done: int, of: int) -> None:
        if stop.is_set():
            raise _Abandoned

    def one(k: int) -> "xr.Dataset | MjsheafError":
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
            return _results([pool.submit(one, k) for k in range(len(todo))], report)
        finally:
            stop.set()


def _results(futures: "list[Future[T]]", report: "Callable[[int, int], None] | None") -> list[T]:
    """Return all results in order; an exception is raised as soon as it occurs."""
    for done, future in enumerate(as_completed(futures), 1):
        future.result()
        if report:
            report(done, len(futures))
    return [future.result() for future in futures]


def _listed(scenarios: Iterable[Scenario]) -> list[Scenario]:
    """Return scenarios as a list.

    Raises:
        InputError: An item is not a Scenario.
    """
    if isinstance(scenarios, Scenario) or not isinstance(scenarios, Iterable):
        raise InputError(f"scenarios is a {type(scenarios).__name__}; expected a list of Scenarios")
    todo = list(scenarios)
    for k, scenario in enumerate(todo):
        if not isinstance(scenario, Scenario):
            raise InputError(f"scenarios: number {k} is a {type(scenario).__name__}; expected a Scenario")
    return todo


class _Abandoned(Exception):  # noqa: N818
    """Signal to end a run because the others were interrupted."""
