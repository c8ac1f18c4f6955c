"""One run of a study, as a worker does it: from a point to a record of plain values."""

import time
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
import xarray as xr

from mjsheaf._version import __version__
from mjsheaf.checking.finished import Ending, bound_of_run, ending_of_run, judge
from mjsheaf.control.source import LawFile
from mjsheaf.errors import InputError, NotUniqueError
from mjsheaf.io.norms import PER_AGENT_RMS
from mjsheaf.io.section import finite
from mjsheaf.remember import remember_last
from mjsheaf.results import dataset_bytes, summarize
from mjsheaf.results.dataset import of_phase
from mjsheaf.results.metrics import communication, error_series_of, late_errors, mean_known
from mjsheaf.results.netcdf import thin
from mjsheaf.runs.simulate import simulate
from mjsheaf.scenario import Scenario, scenario_from_mapping
from mjsheaf.scenario.load import map_vehicles
from mjsheaf.studies.schema import Point

STATUSES = ("finished", "unstable", "refused", "invalid", "failed", "lost")
"""How a run may end: well; blown up; refused, as its team is free to drift; invalid, as its point is no scenario; with
an error that mjsheaf did not expect; with its worker, which died of it."""

_MOST_SAMPLES = 500  # of errors over time
TRAFFIC = "numbers_per_agent_second"
"""A measure of every record."""


@cache
def versions() -> dict[str, str]:
    """Versions on which the bits of a run depend: of mjsheaf and of its libraries."""
    return {"mjsheaf": __version__, **{name: version(name) for name in ("mujoco", "numpy", "numba")}}


class ForeignWorkerError(InputError):
    """A worker of an existing scheduler has another version of mjsheaf or of a library."""


@dataclass(frozen=True)
class Job:
    """Input of a worker.

    Attributes:
        point: Point of the study.
        source: Name of the scenario, for messages.
        scenario: Scenario as read, without overrides.
        overrides: Field path to value, for all runs of the study.
        directory: Directory to which paths of vehicles in overrides are relative.
        backend: 'physics' or 'ideal'.
        engine: Engine that moves bodies.
        trajectories: True to return result.nc.
        versions: Versions of the submitting mjsheaf and of its libraries.
        law: Law in Python that is in control, or None.
    """

    point: Point
    source: str
    scenario: dict[str, Any]
    overrides: dict[str, Any]
    directory: str
    backend: str
    engine: str = "mujoco"
    trajectories: bool = False
    versions: dict[str, str] = field(default_factory=versions)
    law: LawFile | None = None

    @property
    def changes(self) -> dict[str, Any]:
        """What makes the point's scenario from the one that was read; paths of vehicles in it are absolute."""
        directory = Path(self.directory)
        return {
            path: map_vehicles(value, lambda name: str(directory / name), tuple(path.split(".")))
            for path, value in (self.overrides | self.point.overrides).items()
        }

    @property
    def seed(self) -> int | None:
        """The seed, read without building the scenario; None where it is given one that no scenario takes."""
        given = (self.overrides | self.point.overrides).get("seed", self.scenario.get("seed", 0))
        return given if type(given) is int and abs(given) < 2**63 else None

    def load(self) -> Scenario:
        """The scenario of the point.

        Raises:
            ScenarioError: the point is not valid.
        """
        changes, seed = self.changes, self.point.seed
        swarm = "swarm" in self.scenario or any(path.startswith("swarm") for path in changes)
        if seed is not None and 0 <= seed < 2**63 and not swarm:
            try:
                return _of_any_seed(self.scenario, {**changes, "seed": 0}, self.source).with_seed(seed)
            except InputError:  # the message is that of the point itself
                pass
        return scenario_from_mapping(self.scenario, changes, self.source)


@remember_last(lambda scenario, changes, source: (scenario, changes, source))
def _of_any_seed(scenario: dict[str, Any], changes: dict[str, Any], source: str) -> Scenario:
    """The scenario of a study's point, which its seeds share."""
    return scenario_from_mapping(scenario, changes, source)


@dataclass(frozen=True)
class JobResult:
    """Output of a worker.

    Attributes:
        record: Record of the run (see `new_record`), a function of the job alone.
        seconds: Duration of the job, s.
        dataset: Bytes of result.nc, if requested and if the run started.
        page: Page that shows the same data (see `mjsheaf.page`).
    """

    record: dict[str, Any]
    seconds: float = 0.0
    dataset: bytes | None = None
    page: bytes | None = None


def new_record(point: Point, seed: int | None, status: str, message: str = "", **found: Any) -> dict[str, Any]:
    """A run's record.

    Its run, parameters, seed, status, message; final (as summary.json), late (the same measures, RMS over the last
    half), ending, settled (whether that is it), bound_ratio and late_bound_ratio (see `RunBound`),
    numbers_per_agent_second and law as summary.json has them, and where trajectories are wanted the errors over time:
    series, with time, s, and each measure, m, at some samples.
    """
    return {
        "run": point.number,
        "parameters": point.parameters,
        "seed": seed,
        "status": status,
        "message": shorten(message, 600, placeholder=" ..."),
        **dict.fromkeys(("final", "late", "settled", "ending", "bound_ratio", "late_bound_ratio", "series", TRAFFIC)),
        "law": None,
        **found,
    }


def run_job(job: Job) -> JobResult:
    """Simulate a point. Whatever goes wrong with it is its record's status and message.

    Raises:
        ForeignWorkerError: this worker has another version of mjsheaf or of a library.
    """
    for name, here in versions().items():
        if job.versions[name] != here:
            raise ForeignWorkerError(f"a worker has {name} {here}; expected {job.versions[name]}")
    if job.law is not None and job.law.changed:
        raise ForeignWorkerError(f"{job.law.label}: the file has changed since the study began; choose another --out")
    begun = time.perf_counter()
    dataset = page = None
    try:
        record, dataset, page = _run(job)
    except Exception as error:  # one bad point must not end the study: the table reports it
        record = failed_record(job, error)
    return JobResult(record, time.perf_counter() - begun, dataset, page)


def failed_record(job: Job, error: Exception) -> dict[str, Any]:
    """The record of a run that raised an error."""
    told = str(error)
    if isinstance(error, NotUniqueError | InputError):
        status = "refused" if isinstance(error, NotUniqueError) else "invalid"
        if job.law is not None and job.law.label in told:  # an error of the law, not of the point
            status = "failed"
        return new_record(job.point, job.seed, status, told)
    what = "not enough memory" if isinstance(error, MemoryError) else type(error).__name__
    return new_record(job.point, job.seed, "failed", f"{what}: {told}")


def _run(job: Job) -> tuple[dict[str, Any], bytes | None, bytes | None]:
    scenario = job.load()
    controller = job.law.load(scenario.seed) if job.law else None
    dataset = simulate(scenario, job.backend, engine=job.engine, threads=1, controller=controller, progress=False)
    system = scenario.system
    found: dict[str, Any] = {"final": summarize(system.team, dataset), "settled": False, "law": dataset.attrs["law"]}
    if dataset.attrs["status"] == "finished":
        ending, bound = _ending_of(job, scenario, dataset), bound_of_run(scenario.phases, dataset)
        found["late"] = {**late_errors(system.team, dataset), "norm": PER_AGENT_RMS}
        found["ending"], found["settled"] = ending, None if ending is None else ending == "settled"
        for name, ratio in (("bound_ratio", bound.ratio), ("late_bound_ratio", bound.settled_ratio)):
            found[name] = finite(ratio)
    if job.trajectories:
        found["series"] = error_series_of(system.team, dataset.isel(time=thin(dataset.sizes["time"], _MOST_SAMPLES)))
    found[TRAFFIC] = communication(dataset, dataset.sizes["time"], system.grid.period)[TRAFFIC]
    record = new_record(job.point, scenario.seed, dataset.attrs["status"], dataset.attrs["message"], **found)
    if not job.trajectories:
        return record, None, None
    return record, _bytes_of(dataset), _page_of(scenario, dataset, found)


def _ending_of(job: Job, scenario: Scenario, dataset: xr.Dataset) -> Ending | None:
    """Judge how a run ended; under a law in Python, whose loop is not known, by its error alone."""
    if job.law is None:
        return ending_of_run(scenario.phases, dataset)
    _, own = of_phase(scenario.phases, dataset, -1)
    return judge(np.sqrt(mean_known(own["tracking_error"].values ** 2)))


def _page_of(scenario: Scenario, dataset: xr.Dataset, found: dict[str, Any]) -> bytes:
    from mjsheaf.checking.finished import bounds_of_phases
    from mjsheaf.page import page_of

    phases = scenario.phases
    again = "mjsheaf sweep", "; the study's index.html says of what"
    return page_of(scenario, phases, dataset, found, bounds_of_phases(phases, dataset), again=again)


def _bytes_of(dataset: xr.Dataset) -> bytes:
    """The bytes of result.nc, as two writes agree on them.

    HDF5 once laid out a file differently for the same data, for no cause that thousands of writes since have shown;
    the bytes of a study must not depend on such an accident.
    """
    for before, written in pairwise(dataset_bytes(dataset) for _ in range(5)):
        if written == before:
            break
    return written
