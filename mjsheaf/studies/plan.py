"""What a study is to do: its scenario, its points, and the record by which it is known again."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mjsheaf._version import __version__
from mjsheaf.errors import InputError, ScenarioError
from mjsheaf.io.yaml import parse_yaml
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import map_vehicles
from mjsheaf.simulation.run import BACKENDS
from mjsheaf.studies.job import Job, library_versions, scenario_of
from mjsheaf.studies.points import Point, points_of
from mjsheaf.studies.schema import StudyFile, asked_of, problem_of
from mjsheaf.studies.sources import read_source, vehicle_files

_TRIED_POINTS = 20
"""Points of which one must be legal before anything begins: a field that does not exist fails them all."""

_GOLDEN = 0.6180339887498949


@dataclass(frozen=True)
class Plan:
    """A study that can begin.

    Attributes:
        name: of the study.
        source: what the user called it, for messages.
        study: what is asked.
        scenario: the scenario as read, without overrides.
        directory: to which paths of vehicles in the study are relative.
        files: SHA-256 of the vehicles' own files.
        points: the runs, in order.
        seed_matters: whether another seed would change anything.
    """

    name: str
    source: str
    study: StudyFile
    scenario: dict[str, Any]
    directory: Path
    files: dict[str, str]
    points: list[Point]
    seed_matters: bool = True

    def record(self) -> dict[str, Any]:
        """What study.json holds: all on which results depend. Two studies with one record give the same bytes."""
        return {
            "mjsheaf_version": __version__,
            "versions": library_versions(),
            "study": self.name,
            "runs": len(self.points),
            "asked": asked_of(self.study),
            "scenario": self.scenario,
            "vehicle_files": self.files,
        }

    def job(self, point: Point) -> Job:
        """What a worker is told of a point."""
        study = self.study
        # Messages become part of results: they name the scenario as itself, not by the path that was typed.
        source = str(self.scenario.get("name"))
        directory = str(self.directory)
        return Job(point, source, self.scenario, study.set, directory, study.backend, study.trajectories)


def load_plan(
    source: str,
    *,
    grid: Mapping[str, Sequence[Any]] | None = None,
    seeds: tuple[int, int] | None = None,
    overrides: Mapping[str, Any] | None = None,
    backend: str | None = None,
    measure: str | None = None,
    trajectories: bool = False,
) -> Plan:
    """Read a study, add what is asked beside it, and lay out its runs.

    Args:
        source: a name in studies/ or scenarios/, or a path; see `read_source`.
        grid: field path to values, beside the study's own.
        seeds: the first seed and the one after the last, instead of the study's own.
        overrides: field path to value for all runs; they go before the study's own. Paths of vehicles here and in
            `grid` are relative to the working directory and may lie anywhere.
        backend: 'physics' or 'ideal', instead of the study's own.
        measure: the error that plots show, instead of the study's own.
        trajectories: whether to keep result.nc of every run, also where the study does not ask for it.

    Raises:
        ScenarioError: a file is not valid, fields clash, or no point is legal.
    """
    if backend is not None and backend not in BACKENDS:
        raise InputError(f"--backend {backend}: expected {', '.join(BACKENDS)}")
    read = read_source(source)
    study, here = read.study, Path.cwd()
    overrides = {path: _anchored(value, path, here) for path, value in (overrides or {}).items()}
    grid = {path: [_anchored(value, path, here) for value in values] for path, values in (grid or {}).items()}
    twice = sorted(set(grid) & set(study.grid))
    if twice:
        raise ScenarioError(f"{source}: grid: {twice[0]} is swept by the study itself; set or sweep another field")
    changes: dict[str, Any] = {
        "grid": {**study.grid, **grid},
        "set": {**study.set, **overrides},
        "trajectories": study.trajectories or trajectories,
    }
    if backend is not None:
        changes["backend"] = backend
    if measure is not None:
        changes["measure"] = measure
    if seeds is not None:
        changes["seeds"] = {"start": seeds[0], "stop": seeds[1]}
    try:
        study = StudyFile.model_validate({**study.model_dump(exclude_none=True), **changes})
    except ValidationError as error:
        raise ScenarioError(f"{source}: {problem_of(error)}") from None
    files = vehicle_files(read.scenario, study, read.directory)
    plan = Plan(read.name, source, study, read.scenario, read.directory, files, list(points_of(study)))
    legal = _a_legal_point(plan)
    return replace(plan, seed_matters=legal.uses_seed(study.backend) or "swarm" in read.scenario)


def _anchored(value: Any, path: str, directory: Path) -> Any:
    """A value that a person typed, with paths of vehicles in it absolute: workers may run anywhere."""
    return map_vehicles(value, lambda name: str(directory / name), tuple(path.split(".")))


def parse_grid(text: str) -> tuple[str, list[Any]]:
    """Split PATH=V1,V2,... and read the values as YAML.

    Raises:
        ScenarioError: it is not that.
    """
    path, equals, values = text.partition("=")
    if not equals or not path or not values.strip():
        raise ScenarioError(f"--grid {text!r}: expected PATH=V1,V2,..., for example controller.gain=0.1,1,10")
    found = parse_yaml(f"[{values}]", f"--grid {path}")  # a flow sequence: commas inside brackets or quotes are kept
    if not isinstance(found, list) or not found:
        raise ScenarioError(f"--grid {text!r}: expected PATH=V1,V2,..., for example controller.gain=0.1,1,10")
    return path, found


def parse_seeds(text: str) -> tuple[int, int]:
    """Read A:B as the seeds from A up to, but without, B.

    Raises:
        ScenarioError: it is not that.
    """
    match = re.fullmatch(r"([0-9]{1,19}):([0-9]{1,19})", text)
    if not match or not int(match[1]) < int(match[2]) < 2**63:
        raise ScenarioError(
            f"--seeds {text!r}: expected A:B with 0 <= A < B < 2^63, the seeds from A up to but without B"
        )
    return int(match[1]), int(match[2])


def _a_legal_point(plan: Plan) -> Scenario:
    """The first of the points tried that is legal.

    Raises:
        ScenarioError: none of them is; the message is about the very first.
    """
    first: InputError | None = None
    tried = _tried(plan)
    for point in tried:
        try:
            return scenario_of(replace(plan.job(point), source=plan.source))
        except InputError as error:
            first = first or error
    which = f"{len(tried)} points" + (" from all over the study" if len(tried) < len(plan.points) else "")
    raise ScenarioError(str(first) if len(plan.points) == 1 else f"{first} (and none of {which} is legal)")


def _tried(plan: Plan) -> list[Point]:
    """The first point and others from all over the study: with as many different parameters, then seeds, as may be."""
    seeds = plan.study.seeds.stop - plan.study.seeds.start if plan.study.seeds else 1
    places = len(plan.points) // seeds
    # Steps of the golden ratio come near every place and fall in with no period of the grid.
    steps = (int(places * (k * _GOLDEN % 1.0)) for k in range(_TRIED_POINTS))
    spread = dict.fromkeys(steps if places > _TRIED_POINTS else range(places))
    return [plan.points[place * seeds + k] for k in range(min(seeds, _TRIED_POINTS)) for place in spread][
        :_TRIED_POINTS
    ]
