"""Simulating many scenarios at once, on threads of this process."""

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from threading import Event
from typing import TYPE_CHECKING

from mjsheaf.errors import InputError, MjsheafError
from mjsheaf.runs.simulate import (
    datasets_of,
    moved_by,
    require_backend,
    require_engine,
    require_simulable,
    simulate,
    with_scenario,
)
from mjsheaf.scenario import Scenario
from mjsheaf.threads import usable_processors

if TYPE_CHECKING:
    from collections.abc import Callable

    import xarray as xr

    from mjsheaf.simulation.fused import Fused


def simulate_many(
    scenarios: Iterable[Scenario],
    backend: str = "physics",
    *,
    engine: str = "mujoco",
    workers: int | None = None,
    allow_drift: bool = False,
    progress: "Callable[[int, int], None] | None" = None,
) -> "list[xr.Dataset | MjsheafError]":
    """Run independent scenarios side by side on threads of this process.

    The compiled loops run without the interpreter's lock, so that threads do what processes would, without starting
    any or copying results. What comes out is bit for bit what `simulate` gives one by one. On the fused engine runs
    of one team lie side by side in memory, and share what does not differ: see `mjsheaf.simulation.rows`.

    Args:
        scenarios: for example one scenario with many seeds or gains.
        backend: 'physics' or 'ideal'.
        engine: as for `simulate`.
        workers: how many run at a time; None takes one for each processor that this process may use.
        allow_drift: as for `simulate`.
        progress: called from the calling thread with (runs done, runs in all).

    Returns:
        What `simulate` returns for each scenario, in their order. A scenario that it would refuse does not lose the
        others: its place holds the error, a MjsheafError. A run that blew up is a dataset with status 'unstable'.

    Raises:
        InputError: unknown backend or engine, or workers below 1.
    """
    require_backend(backend)
    require_engine(engine, backend)
    if workers is not None and workers < 1:
        raise InputError(f"workers is {workers}; expected 1 or more, or None")
    todo = list(scenarios)
    prepared = _side_by_side(todo, allow_drift) if engine == "fused" else {}
    stop = Event()

    def check(done: int, of: int) -> None:
        if stop.is_set():
            raise _Abandoned

    def one(k: int) -> "xr.Dataset | MjsheafError":
        try:
            check(0, 0)
            if run := prepared.pop(k, None):
                return _record(run, todo[k], check)
            return simulate(todo[k], backend, engine=engine, threads=1, allow_drift=allow_drift, progress=check)
        except MjsheafError as error:
            return error

    with ThreadPoolExecutor(workers or usable_processors()) as pool:
        futures = [pool.submit(one, k) for k in range(len(todo))]
        try:
            for done, future in enumerate(as_completed(futures), 1):
                future.result()  # raises what is not a refusal: the others are abandoned
                if progress:
                    progress(done, len(todo))
        finally:
            stop.set()
    return [future.result() for future in futures]


class _Abandoned(Exception):  # noqa: N818
    """Ends a run whose siblings were interrupted."""


def _side_by_side(scenarios: Sequence[Scenario], allow_drift: bool) -> "dict[int, Fused]":
    """Runs at their start by number, those of one team side by side; without scenarios that `simulate` refuses."""
    from mjsheaf.simulation.fused import Fused
    from mjsheaf.simulation.rows import Rows, groups_of_one_team

    runs = dict[int, Fused]()
    for k, scenario in enumerate(scenarios):
        try:
            phases = moved_by(scenario.phases, "physics", "fused", 1)
            require_simulable(phases, "physics", allow_drift=allow_drift)
            runs[k] = Fused(phases)
        except MjsheafError:
            continue
    numbers = list(runs)
    for group in groups_of_one_team(list(runs.values())):
        if len(group) > 1:
            members = [runs[numbers[k]] for k in group]
            rows = Rows(members)
            for w, run in enumerate(members):
                run.adopt(rows.loop_of(w))
    return runs


def _record(run: "Fused", scenario: Scenario, progress: "Callable[[int, int], None]") -> "xr.Dataset":
    """What `simulate` returns, of a run at its start."""
    samples = run.system.grid.steps + 1
    pieces = run.record(samples, None, progress)
    return with_scenario(next(datasets_of(pieces, run.phases, "physics", scenario.seed, samples)), scenario)
