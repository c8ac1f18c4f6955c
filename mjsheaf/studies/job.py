"""One run of a study, as a worker does it: from a point to a record of plain values."""

import time
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

import numpy as np

from mjsheaf._version import __version__
from mjsheaf.errors import InputError, NotUniqueError
from mjsheaf.studies.points import Point

if TYPE_CHECKING:
    import xarray as xr

    from mjsheaf.scenario import Scenario

STATUSES = ("finished", "unstable", "refused", "invalid", "failed", "lost")
"""How a run may end: well; blown up; with a team that is free to drift; before it began, its point being no legal
scenario; with an error that mjsheaf did not expect; with its worker, which died of it."""

_LONGEST_MESSAGE = 600
_MOST_WRITES = 5


@cache
def library_versions() -> dict[str, str]:
    """Versions of the libraries on which the bits of a run depend."""
    return {name: version(name) for name in ("mujoco", "numpy", "numba")}


class ForeignWorkerError(InputError):
    """A worker of an existing scheduler cannot do this study's runs."""


@dataclass(frozen=True)
class Job:
    """What a worker is told.

    Attributes:
        point: which run.
        source: the scenario's name, for messages.
        scenario: the scenario as read, without overrides.
        overrides: field path to value, for all runs of the study.
        directory: to which paths of vehicles in overrides are relative.
        backend: 'physics' or 'ideal'.
        trajectories: whether result.nc is wanted.
        versions: of the mjsheaf that asks and of its libraries.
    """

    point: Point
    source: str
    scenario: dict[str, Any]
    overrides: dict[str, Any]
    directory: str
    backend: str
    trajectories: bool = False
    versions: dict[str, str] = field(default_factory=lambda: {"mjsheaf": __version__, **library_versions()})


@dataclass(frozen=True)
class Done:
    """What a worker answers.

    Attributes:
        record: see `new_record`; a function of the job alone.
        seconds: that it took.
        dataset: bytes of result.nc, where wanted and the run began.
    """

    record: dict[str, Any]
    seconds: float
    dataset: bytes | None = None


def new_record(point: Point, seed: int | None, status: str, message: str = "", **found: Any) -> dict[str, Any]:
    """A run's record.

    Its run, parameters, seed, status, message; final (as summary.json), late (the same measures, RMS over the last
    half), ending, settled (whether that is it), and bound_ratio.
    """
    record = {
        "run": point.number,
        "parameters": point.parameters,
        "seed": seed,
        "status": status,
        "message": shorten(message, _LONGEST_MESSAGE, placeholder=" ..."),
    }
    return {**record, "final": None, "late": None, "settled": None, "ending": None, "bound_ratio": None, **found}


def run_job(job: Job) -> Done:
    """Simulate a point. Whatever goes wrong with it is its record's status and message.

    Raises:
        ForeignWorkerError: this worker has another version of mjsheaf or of a library.
    """
    for name, here in {"mjsheaf": __version__, **library_versions()}.items():
        if job.versions[name] != here:
            raise ForeignWorkerError(f"a worker has {name} {here}; expected {job.versions[name]}, as who asks has")
    begun = time.perf_counter()
    dataset = None
    try:
        record, dataset = _run(job)
    except NotUniqueError as error:
        record = new_record(job.point, seed_of(job), "refused", str(error))
    except InputError as error:
        record = new_record(job.point, seed_of(job), "invalid", str(error))
    except MemoryError as error:
        record = new_record(job.point, seed_of(job), "failed", f"not enough memory: {error}")
    except Exception as error:  # one bad point must not end the study: it is told of in the table
        record = new_record(job.point, seed_of(job), "failed", f"{type(error).__name__}: {error}")
    return Done(record, time.perf_counter() - begun, dataset)


def _run(job: Job) -> tuple[dict[str, Any], bytes | None]:
    from mjsheaf.checking.finished import bound_of_run, ending_of_run
    from mjsheaf.results import summarize
    from mjsheaf.results.metrics import late_errors
    from mjsheaf.simulation.run import simulate

    scenario = scenario_of(job)
    dataset = simulate(scenario, job.backend)
    system = scenario.system()
    finished = dataset.attrs["status"] == "finished"
    ending = ending_of_run(system, dataset) if finished else None
    record = new_record(
        job.point,
        scenario.seed,
        dataset.attrs["status"],
        dataset.attrs["message"],
        final=summarize(system.team, dataset),
        late=late_errors(system.team, dataset) if finished else None,
        settled=None if finished and ending is None else ending == "settled",
        ending=ending,
        bound_ratio=_finite(bound_of_run(system, dataset).ratio) if finished else None,
    )
    return record, _bytes_of(dataset) if job.trajectories else None


def scenario_of(job: Job) -> "Scenario":
    """The scenario of a job's point.

    Raises:
        ScenarioError: the point is not legal.
    """
    from mjsheaf.scenario.load import scenario_from_mapping

    return scenario_from_mapping(job.scenario, overrides_of(job), job.source)


def overrides_of(job: Job) -> dict[str, Any]:
    """What makes the scenario of a job's point from the one that was read; paths of vehicles in it are absolute."""
    from mjsheaf.scenario.load import map_vehicles

    directory = Path(job.directory)
    return {
        path: map_vehicles(value, lambda name: str(directory / name), tuple(path.split(".")))
        for path, value in (job.overrides | job.point.overrides).items()
    }


def seed_of(job: Job) -> int | None:
    """The seed of a run that has no scenario to ask; None where it is given one that no scenario takes."""
    overrides = job.overrides | job.point.overrides
    given = overrides.get("seed", job.scenario.get("seed", 0))
    return given if type(given) is int and abs(given) < 2**63 else None


def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None


def _bytes_of(dataset: "xr.Dataset") -> bytes:
    """The bytes of result.nc.

    HDF5 has once been seen to lay out a file differently for the same data. Thousands of writes since (other hash
    seeds, threads side by side, memory filled with other values before, files of other kinds between) gave the same
    bytes, and a memory checker found nothing that is written without having been set. Two writes that agree keep such
    an accident out of a study, whose bytes must not depend on what ran it.
    """
    from mjsheaf.results import dataset_bytes

    before = b""
    for _ in range(_MOST_WRITES):
        written = dataset_bytes(dataset)
        if written == before:
            break
        before = written
    return written
