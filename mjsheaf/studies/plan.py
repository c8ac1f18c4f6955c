"""From a study file or a scenario to a plan: its scenario, its points, and the record that identifies it."""

import math
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, JsonValue, ValidationError, model_validator

from mjsheaf._version import __version__
from mjsheaf.arguments import require_mapping, require_type
from mjsheaf.compile.remember import remember_last
from mjsheaf.errors import InputError, ScenarioError, in_field, joined
from mjsheaf.files import SUFFIXES, confined, digest, digest_of, list_studies, parse_yaml, read_yaml
from mjsheaf.loop.session import BACKENDS, ENGINES, require_engine
from mjsheaf.scenario import Scenario, scenario_from_mapping
from mjsheaf.scenario.load import LawFile, find_law, find_scenario, list_scenarios, map_vehicles, read_scenario
from mjsheaf.section import Number, Positive, Section, split_path, validation_problems

Measure = Literal["mean_disagreement", "tracking_error", "formation_error", "centering_error"]


def _fits_a_table(value: JsonValue) -> JsonValue:
    """Refuse integers that do not fit a column of the table; no field of a scenario accepts them."""
    for item in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _fits_a_table(item)
    if isinstance(value, int) and abs(value) >= 2**63:
        raise ValueError(f"a number of {len(str(value))} digits; expected whole numbers below 2^63 in size")
    return value


Value = Annotated[JsonValue, AfterValidator(_fits_a_table)]
Values = Annotated[list[Value], Field(min_length=1)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]

MOST_RUNS = 1_000_000
"""Maximum number of runs of a study. Each is a file, and directories with more files are slow."""


class _Range(Section):
    """Both ends of an interval."""

    low: Number = Field(description="lower end [that of the field]")
    high: Number = Field(description="upper end [that of the field]")

    @model_validator(mode="after")
    def _ordered(self) -> "_Range":
        whole = isinstance(self, Integers)  # both ends are included
        if self.high < self.low or (self.high == self.low and not whole):
            raise ValueError(f"high ({self.high}) must {'not be below' if whole else 'be above'} low ({self.low})")
        return self


class Uniform(_Range):
    """Uniform on an interval."""

    kind: Literal["uniform"] = Field(description="always uniform")

    def sample(self, rng: np.random.Generator, count: int) -> list[Any]:
        """Draw `count` values."""
        return rng.uniform(self.low, self.high, count).tolist()


class LogUniform(_Range):
    """Uniform in the logarithm, on an interval of positive numbers."""

    kind: Literal["loguniform"] = Field(description="always loguniform")
    low: Positive = Field(description="lower end, positive [that of the field]")
    high: Positive = Field(description="upper end, positive [that of the field]")

    def sample(self, rng: np.random.Generator, count: int) -> list[Any]:
        """Draw `count` values."""
        logs = rng.uniform(np.log(self.low), np.log(self.high), count)
        return np.clip(np.exp(logs), self.low, self.high).tolist()


class Normal(Section):
    """A normal distribution."""

    kind: Literal["normal"] = Field(description="always normal")
    mean: Number = Field(description="mean [that of the field]")
    deviation: Positive = Field(description="standard deviation [that of the field]")

    def sample(self, rng: np.random.Generator, count: int) -> list[Any]:
        """Draw `count` values."""
        return rng.normal(self.mean, self.deviation, count).tolist()


class Integers(_Range):
    """Uniform on the integers from low to high, both included."""

    kind: Literal["integers"] = Field(description="always integers")
    low: Annotated[int, Field(gt=-(2**62), lt=2**62)] = Field(description="lowest number, included [that of the field]")
    high: Annotated[int, Field(gt=-(2**62), lt=2**62)] = Field(
        description="highest number, included [that of the field]"
    )

    def sample(self, rng: np.random.Generator, count: int) -> list[Any]:
        """Draw `count` values."""
        return rng.integers(self.low, self.high, size=count, endpoint=True).tolist()


class Choice(Section):
    """One of the values, with equal probability."""

    kind: Literal["choice"] = Field(description="always choice")
    values: Values = Field(description="values, with equal probability")

    def sample(self, rng: np.random.Generator, count: int) -> list[Any]:
        """Draw `count` values."""
        return [self.values[k] for k in rng.integers(len(self.values), size=count)]


Distribution = Annotated[Uniform | LogUniform | Normal | Integers | Choice, Field(discriminator="kind")]


class Draws(Section):
    """Random points."""

    count: Annotated[int, Field(ge=1, le=MOST_RUNS)] = Field(description="number of points [-]")
    seed: Seed = Field(0, description="seed of the draws [-]")
    values: Annotated[dict[str, Distribution], Field(min_length=1)] = Field(description="field path to distribution")


class SeedRange(Section):
    """Seeds from `start` to `stop` - 1."""

    start: Seed = Field(0, description="first seed [-]")
    stop: Seed = Field(description="last seed plus 1 [-]")

    @model_validator(mode="after")
    def _ordered(self) -> "SeedRange":
        if self.stop <= self.start:
            raise ValueError(f"stop ({self.stop}) must be above start ({self.start})")
        return self


class StudyFile(Section):
    """Contents of a study file: every listed point with every pair, grid point and draw, each with every seed."""

    name: str = Field("", description="title of the page and the plots; the summary unless given")
    summary: str = Field("", description="question that the study answers, in one line")
    scenario: str = Field(description="name in scenarios/, or path of a YAML file relative to this file's directory")
    backend: Literal[BACKENDS] = Field("physics", description="backend of all runs")  # type: ignore[valid-type]
    engine: Literal[ENGINES] = Field("mujoco", description="physics engine")  # type: ignore[valid-type]
    controller: str | None = Field(
        None,
        description="law in Python of all runs, FILE.py:NAME with a path relative to this file's directory; the "
        "scenario's law unless given",
    )
    batch: bool = Field(
        False, description="records of errors alone, without the ending, in three fifths of the time; engine fused"
    )
    set: dict[str, Value] = Field(default_factory=dict, description="overrides of all runs: field path to value")
    points: list[dict[str, Value]] = Field(default_factory=list, description="listed points: field path to value")
    names: list[Annotated[str, Field(min_length=1)]] = Field(
        default_factory=list, description="names of the listed points in plots; the points then count as one axis"
    )
    paired: dict[str, Values] = Field(default_factory=dict, description="lists of equal length, swept in step")
    grid: dict[str, Values] = Field(default_factory=dict, description="values in all combinations")
    draws: Draws | None = Field(None, description="random points")
    seeds: SeedRange | None = Field(None, description="seeds of every point; the scenario's seed unless given")
    measure: Measure | None = Field(None, description="error that plots show; every error that is defined unless given")
    late: bool = Field(False, description="plot RMS over the second half instead of the final error")
    labels: dict[str, str] = Field(default_factory=dict, description="names of swept fields in plots, with units")
    trajectories: bool = Field(False, description="keep result.nc of every run, and draw errors over time")

    @model_validator(mode="before")
    @classmethod
    def _engine_of_batch(cls, given: Any) -> Any:
        """Choose the fused engine for a batch that names none."""
        return {"engine": "fused", **given} if isinstance(given, dict) and given.get("batch") is True else given

    @model_validator(mode="after")
    def _fits(self) -> "StudyFile":
        require_engine(self.engine, self.backend)
        if self.batch and self.engine != "fused":
            raise ValueError("batch: requires the fused engine; expected engine fused")
        if self.batch and self.trajectories:
            raise ValueError("trajectories: a batch keeps errors alone; expected one of the two")
        lengths = ", ".join(f"{path} has {len(values)}" for path, values in self.paired.items())
        expected = f"expected {len(self.points)} different names, one per point"
        unfit = len(self.names) != len(self.points) or len(set(self.names)) < len(self.names)
        if len(set(map(len, self.paired.values()))) > 1:
            raise ValueError(f"paired: lists must have one length, but {lengths}")
        if self.names and unfit:
            raise ValueError(f"names: {len(self.names)}; {expected}")
        for path, values in self.grid.items():
            # true is not 1, but 1.0 is
            keys = [repr(v) if isinstance(v, list | dict) else (isinstance(v, bool), v) for v in values]
            if len(set(keys)) < len(keys):
                twice = next(v for v, key in zip(values, keys, strict=True) if keys.count(key) > 1)
                raise ValueError(f"grid: {path}: {twice!r} is given twice; give each value once")
        swept = self.paths
        given = [*self.set, *swept]
        for path, other in ((later, earlier) for k, later in enumerate(given) for earlier in given[:k]):
            if path == other:
                twice = "both set and swept" if path in self.set else "swept twice"
                raise ValueError(f"{path}: is {twice}; give it once")
            if other.startswith(f"{path}."):
                before = "set" if other in self.set else "swept before it"
                raise ValueError(f"{path}: would overwrite {other}, which is {before}; give it once, or first")
        _check_items(self.set, swept)
        if self.seeds is not None and "seed" in (*swept, *self.set):
            raise ValueError("seeds: the field seed is given too; give either")
        for path in self.labels.keys() - set(self.paths):
            raise ValueError(f"labels: {path} is not swept; expected {', '.join(self.paths) or 'none'}")
        if self.size > MOST_RUNS:
            raise ValueError(f"the study has {self.size} runs; expected at most {MOST_RUNS}")
        return self

    @property
    def paths(self) -> list[str]:
        """Paths of the swept fields, in the order in which they are set."""
        listed = dict.fromkeys(path for point in self.points for path in point)
        return [*listed, *self.paired, *self.grid, *(self.draws.values if self.draws else [])]

    @property
    def size(self) -> int:
        """Number of runs."""
        count = max(1, len(self.points)) * len(next(iter(self.paired.values()), [None]))
        count *= math.prod(map(len, self.grid.values())) * (self.draws.count if self.draws else 1)
        return count * self.seed_count

    @property
    def seed_count(self) -> int:
        """Number of seeds of every point."""
        return self.seeds.stop - self.seeds.start if self.seeds else 1

    def values(self) -> Iterator[tuple[str, JsonValue]]:
        """Yield every value that the file gives to a field of the scenario, with the field's path."""
        for point in [self.set, *self.points]:
            yield from point.items()
        draws = self.draws.values if self.draws else {}
        choices = {path: how.values for path, how in draws.items() if isinstance(how, Choice)}
        for columns in (self.paired, self.grid, choices):
            for path, values in columns.items():
                yield from ((path, value) for value in values)

    def asked(self) -> dict[str, Any]:
        """Return what results depend on apart from the scenario, in canonical form, without fields for display."""
        shown = {"name", "summary", "scenario", "measure", "late", "labels", "names", "controller"}
        defaults = {"engine": "mujoco", "batch": False}  # older studies lack these fields
        usual = {name for name, value in defaults.items() if getattr(self, name) == value}
        return self.model_dump(mode="json", exclude=shown | usual, exclude_none=True)


def _check_items(fixed: Mapping[str, Any], swept: Iterable[str]) -> None:
    """Require that swept fields refer to the items of a list either by number or by id, so that no item has two names.

    Raises:
        ValueError: The fields mix both.
    """
    tree: dict[bool, Any] = {}
    for path in (*fixed, *swept):
        at = tree
        for key in split_path(path):
            number = key.isdecimal()
            other = next(iter(at.get(not number, ())), None)
            if other is not None and path not in fixed:
                raise ValueError(f"{path}: another field names an item of the same list as {other}; name all one way")
            at = at.setdefault(number, {}).setdefault(key, {})


@dataclass(frozen=True)
class Point:
    """One run of a study.

    Attributes:
        number: Number of the run, from 0.
        parameters: Values by field path, in the order in which they are set.
        seed: Seed of the scenario; None keeps the scenario's own.
    """

    number: int
    parameters: dict[str, Any] = field(hash=False)
    seed: int | None = None

    @property
    def overrides(self) -> dict[str, Any]:
        """Overrides that turn the study's scenario into this run's."""
        return self.parameters if self.seed is None else {**self.parameters, "seed": self.seed}


def points_of(study: StudyFile) -> Iterator[Point]:
    """Yield the points of a study.

    Listed points change slowest, then pairs, then the grid with its first path slowest, then draws. Seeds change
    fastest.
    """
    listed = study.points or [{}]
    pairs = _rows(study.paired, zip(*study.paired.values(), strict=True)) or [{}]
    grid = _rows(study.grid, product(*study.grid.values()))
    drawn = draw(study.draws) if study.draws else [{}]
    seeds = range(study.seeds.start, study.seeds.stop) if study.seeds else [None]
    for number, (point, pair, cell, sample, seed) in enumerate(product(listed, pairs, grid, drawn, seeds)):
        yield Point(number, {**point, **pair, **cell, **sample}, seed)


def draw(draws: Draws) -> list[dict[str, Any]]:
    """Draw the random points.

    Each path has its own random stream, so a longer study begins with the points of a shorter one, and adding a path
    does not change the values of the others.
    """
    columns = {
        path: how.sample(np.random.default_rng([draws.seed, zlib.crc32(path.encode())]), draws.count)
        for path, how in draws.values.items()
    }
    return _rows(columns, zip(*columns.values(), strict=True))


def _rows(paths: Iterable[str], rows: Iterable[tuple[Any, ...]]) -> list[dict[str, Any]]:
    return [dict(zip(paths, row, strict=True)) for row in rows]


@cache
def versions() -> dict[str, str]:
    """Return the versions of mjsheaf and of the libraries that the bits of a run depend on."""
    return {"mjsheaf": __version__, **{name: version(name) for name in ("mujoco", "numpy", "numba")}}


class ForeignWorkerError(InputError):
    """A worker has another version of mjsheaf or of a library, or other files, than those that the study began with."""


@dataclass(frozen=True)
class Job:
    """Input of a worker for one run.

    Attributes:
        point: Point of the run.
        plan: Plan of the study, without its points.
        versions: Versions of mjsheaf and its libraries in the process that submits the job.
    """

    point: Point
    plan: "Plan"
    versions: dict[str, str] = field(default_factory=versions)

    def require_unchanged(self) -> None:
        """Refuse a job once a file is no longer the one that its study began with.

        Raises:
            ForeignWorkerError: The message names the file.
        """
        changed = [path for path, known in self.plan.files.items() if digest(Path(path)) != known]
        if self.plan.law is not None and self.plan.law.changed:
            changed.append(self.plan.law.label)
        if changed:
            raise ForeignWorkerError(f"{changed[0]}: the file has changed since the study began; choose another --out")

    @property
    def changes(self) -> dict[str, Any]:
        """Overrides that turn the scenario as read into the point's; paths of vehicles are absolute."""
        return {
            path: map_vehicles(value, lambda name: str(self.plan.directory / name), tuple(path.split(".")))
            for path, value in (self.plan.study.set | self.point.overrides).items()
        }

    @property
    def seed(self) -> int | None:
        """Seed of the run, read without building the scenario; None if it is not a valid seed."""
        given = (self.plan.study.set | self.point.overrides).get("seed", self.plan.scenario.get("seed", 0))
        return given if type(given) is int and abs(given) < 2**63 else None

    def load(self, source: str | None = None) -> Scenario:
        """Return the scenario of the point; messages name the source, or else the scenario.

        Raises:
            ScenarioError: The point is not valid.
        """
        scenario = self.plan.scenario
        changes = self.changes
        seed = self.point.seed
        # Messages are part of the results, so they use the scenario's name instead of the path that the user gave.
        source = source or str(scenario.get("name"))
        swarm = "swarm" in scenario or any(path.startswith("swarm") for path in changes)
        if seed is not None and 0 <= seed < 2**63 and not swarm:
            with suppress(InputError):  # the call below raises it again, with the point's own seed in the message
                return _of_any_seed(scenario, {**changes, "seed": 0}, source, self.plan.files).with_seed(seed)
        return scenario_from_mapping(scenario, changes, source)


@remember_last(lambda *arguments: arguments)
def _of_any_seed(scenario: dict[str, Any], changes: dict[str, Any], source: str, files: dict[str, str]) -> Scenario:
    """Return the scenario of a study's point that all of its seeds share; files are by their content, see `Job`."""
    return scenario_from_mapping(scenario, changes, source)


_TRIED_POINTS = 20
"""Number of points that are tried before a study starts. At least one must be valid, which exposes misspelt fields."""


@dataclass(frozen=True)
class Plan:
    """A study that is ready to run.

    Attributes:
        name: Name of the study.
        source: Name or path that the user gave, for messages.
        study: Contents of the study file.
        scenario: Scenario as read, without overrides.
        directory: Base of the paths of vehicles in the study.
        files: SHA-256 digests of the vehicles' own files.
        points: Points of the runs, in order.
        seed_matters: True if another seed would change results.
        law: Law in Python of all runs, or None.
    """

    name: str
    source: str
    study: StudyFile
    scenario: dict[str, Any]
    directory: Path
    files: dict[str, str]
    points: list[Point]
    seed_matters: bool = True
    law: LawFile | None = None

    @property
    def title(self) -> str:
        """Title of the page and the plots: the study's name or summary, or else the scenario and the swept fields."""
        if self.study.name or self.study.summary:
            return self.study.name or self.study.summary
        swept = [self.study.labels.get(path, path) for path in self.study.paths]
        swept += ["seeds"] if self.study.seeds else []
        over = f" over {joined(swept)}" if swept else ""
        return f"{self.scenario.get('name', self.name)}{over}"

    def record(self) -> dict[str, Any]:
        """Return the contents of study.json: everything that results depend on.

        Two studies with equal records give the same bytes.
        """
        libraries = dict(versions())
        return {
            "mjsheaf_version": libraries.pop("mjsheaf"),
            "versions": libraries,
            "study": self.name,
            "runs": len(self.points),
            "asked": self.study.asked(),
            "scenario": self.scenario,
            "vehicle_files": self.files,
            **({} if self.law is None else {"law": self.law.key()}),
        }

    def job(self, point: Point) -> Job:
        """Return the job of a worker for a point."""
        return Job(point, replace(self, points=[]))


def load_plan(
    source: str,
    *,
    grid: Mapping[str, Sequence[Any]] | None = None,
    seeds: tuple[int, int] | None = None,
    overrides: Mapping[str, Any] | None = None,
    backend: str | None = None,
    engine: str | None = None,
    batch: bool = False,
    measure: str | None = None,
    trajectories: bool = False,
    controller: str | None = None,
) -> Plan:
    """Read a study, apply the arguments to it, and list its runs.

    Args:
        source: Name in studies/ or scenarios/, or path of a YAML file. A file with a field `scenario` is a study. Any
            other file is a scenario, which becomes a study of one run.
        grid: Field paths and their values, in addition to the study's.
        seeds: First seed, and last seed plus 1, in place of the study's.
        overrides: Field paths and their values for all runs; they take precedence over the study's. Paths of vehicles
            here and in `grid` are relative to the working directory and may lie anywhere.
        backend: 'physics' or 'ideal', in place of the study's.
        engine: Physics engine, in place of the study's.
        batch: True for records of errors alone, on the fused engine, even if the study has `batch: false`.
        measure: Error that plots show, in place of the study's.
        trajectories: True to keep result.nc of every run, even if the study does not.
        controller: Law in Python, FILE.py:NAME relative to the working directory, in place of the study's.

    Raises:
        ScenarioError: A file does not exist, is not valid or refers to a file outside its directory, fields conflict,
            or no point is valid.
    """
    require_type("source", source, str, "the name of a study or scenario, or the path of its file")
    _require_paths("overrides", "--set", overrides, "a mapping of field paths to values")
    _require_paths("grid", "--grid", grid, "a mapping of field paths to lists of values")
    read = _read(source)
    law = _law(read, controller, source)
    twice = sorted(set(grid or ()) & set(read.study.grid))
    if twice:
        raise ScenarioError(f"{source}: grid: {twice[0]} is swept by the study itself; set or sweep another field")
    chosen = {"backend": backend, "engine": engine or ("fused" if batch else None), "measure": measure}
    swept = {path: [_absolute(value, path) for value in values] for path, values in (grid or {}).items()}
    fixed = {path: _absolute(value, path) for path, value in (overrides or {}).items()}
    changes = {
        "grid": {**read.study.grid, **swept},
        "set": {**read.study.set, **fixed},
        **{field: value for field, value in chosen.items() if value},
        "trajectories": read.study.trajectories or trajectories,
        "batch": batch or read.study.batch,
        "controller": law.label if law else None,
    }
    if seeds is not None:
        changes["seeds"] = {"start": seeds[0], "stop": seeds[1]}
    study = _validated({**read.study.model_dump(exclude_none=True), **changes}, source)
    files = _vehicle_files(read.scenario, study, read.directory)
    plan = replace(read, study=study, files=files, points=list(points_of(study)), law=law)
    scenario = _a_valid_point(plan)
    return replace(plan, seed_matters=scenario.uses_seed(study.backend) or "swarm" in read.scenario)


def _require_paths(name: str, option: str, fields: Any, expected: str) -> None:
    """Require an argument that is None or a mapping whose keys are field paths.

    Raises:
        InputError: The argument is something else.
    """
    require_mapping(name, fields, expected)
    with in_field(option):
        for path in fields or ():
            split_path(path)


def _read(source: str) -> Plan:
    """Return the plan of a study file, or of a scenario as a study of one run, without files and points."""
    scenarios = list_scenarios()
    path = find_scenario(source, list_studies())
    directory = path.parent.resolve()
    raw = {} if source in scenarios else read_yaml(path)
    if "scenario" not in raw:
        return Plan(path.stem, source, StudyFile(scenario=source), read_scenario(source), directory, {}, [])
    study = _validated(raw, source)
    scenario: str | Path = study.scenario
    with in_field(source, ScenarioError):
        for field, value in study.values():
            map_vehicles(value, lambda name: str(confined(name, directory)), tuple(field.split(".")))
        if scenario not in scenarios:
            with in_field("scenario"):
                scenario = confined(study.scenario, directory)
    if isinstance(scenario, Path) and not scenario.is_file():
        raise ScenarioError(
            f"{source}: scenario: {study.scenario!r} is neither a file nor one of {', '.join(scenarios)}"
        )
    return Plan(path.stem, source, study, read_scenario(scenario), directory, {}, [])


def _law(read: Plan, controller: str | None, source: str) -> LawFile | None:
    """Find the law in Python of a study, and load it once to check that it loads.

    Raises:
        InputError: There is no such law, or its file raises an exception.
    """
    named = read.study.controller
    if controller is None and named is None:
        return None
    if controller is not None:
        law = find_law(controller)
    else:
        with in_field(source):
            law = find_law(str(named), "controller", read.directory)
    law.load(0)
    # Results name the law by its file alone, so that they do not depend on how the user wrote the path.
    return replace(law, label=f"{Path(law.path).name}:{law.name}")


def _validated(raw: Mapping[str, Any], source: str) -> StudyFile:
    try:
        return StudyFile.model_validate(raw)
    except ValidationError as error:
        lines = [line.removeprefix("file: ") for line in validation_problems(error, StudyFile)]
        raise ScenarioError(*lines).within(source) from None


def _absolute(value: Any, path: str) -> Any:
    """Return a user's value with the paths of vehicles in it made absolute, because workers may run elsewhere."""
    return map_vehicles(value, lambda name: str(Path.cwd() / name), tuple(path.split(".")))


def _vehicle_files(scenario: dict[str, Any], study: StudyFile, directory: Path) -> dict[str, str]:
    """SHA-256 of the files of vehicles that do not come with mjsheaf, and of gridded flow, by path.

    The study's values may name vehicles too.

    Raises:
        InputError: A vehicle's files cannot be read, or lie outside its directory.
    """
    named: dict[Path, None] = {}

    def collect(name: str) -> str:
        named.setdefault(directory / name)
        return name

    map_vehicles(scenario, collect)
    for path, value in study.values():
        map_vehicles(value, collect, tuple(path.split(".")))
    digests: dict[str, str] = {}
    for description in named:
        from mjsheaf.vehicles.loading import files_of, read_description

        is_vehicle = description.suffix in SUFFIXES
        own = files_of(description, read_description(description).mjcf) if is_vehicle else []
        digests |= {str(path): digest_of(path) for path in [description, *own]}
    return digests


def parse_grid(text: str) -> tuple[str, list[Any]]:
    """Split PATH=V1,V2,... and read the values as YAML.

    Raises:
        ScenarioError: The text has another form.
    """
    path, equals, values = text.partition("=")
    found: Any = None
    if equals and path and values.strip():
        found = parse_yaml(f"[{values}]", f"--grid {path}")  # a flow sequence keeps commas in brackets
    if not isinstance(found, list) or not found:
        raise ScenarioError(f"--grid {text!r}: expected PATH=V1,V2,..., for example controller.gain=0.1,1,10")
    return path, found


def parse_seeds(text: str) -> tuple[int, int]:
    """Read A:B as the seeds from A to B - 1.

    Raises:
        ScenarioError: The text has another form.
    """
    match = re.fullmatch(r"([0-9]{1,19}):([0-9]{1,19})", text)
    if not match or not int(match[1]) < int(match[2]) < 2**63:
        raise ScenarioError(f"--seeds {text!r}: expected A:B with 0 <= A < B < 2^63, for the seeds A to B - 1")
    return int(match[1]), int(match[2])


def _a_valid_point(plan: Plan) -> Scenario:
    """Return the scenario of the first point among those tried that is valid.

    Raises:
        ScenarioError: None of them is valid. The message is about the first.
    """
    first: InputError | None = None
    drawn = np.random.default_rng(0).permutation(len(plan.points))[:_TRIED_POINTS]
    tried = list(dict.fromkeys([0, *drawn.tolist()]))[:_TRIED_POINTS]  # the first, and others from all over the study
    for number in tried:
        try:
            return plan.job(plan.points[number]).load(plan.source)
        except InputError as error:
            first = first or error
    which = f"{len(tried)} points" + (" from all over the study" if len(tried) < len(plan.points) else "")
    *lines, last = first.args if first else ("no point is valid",)
    raise ScenarioError(*lines, last if len(plan.points) == 1 else f"{last} (and none of {which} is valid)")
