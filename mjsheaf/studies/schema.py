"""A study file (a scenario and the fields to sweep) and its points, always in the same order."""

import math
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, JsonValue, model_validator

from mjsheaf.io.section import Number, Positive, Section, split_path
from mjsheaf.loop.session import BACKENDS, ENGINES, require_engine

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
    def _engine_fits(self) -> "StudyFile":
        require_engine(self.engine, self.backend)
        if self.batch and self.engine != "fused":
            raise ValueError("batch: requires the fused engine; expected engine fused")
        if self.batch and self.trajectories:
            raise ValueError("trajectories: a batch keeps errors alone; expected one of the two")
        return self

    @model_validator(mode="after")
    def _lengths_fit(self) -> "StudyFile":
        lengths = ", ".join(f"{path} has {len(values)}" for path, values in self.paired.items())
        expected = f"expected {len(self.points)} different names, one per point"
        unfit = len(self.names) != len(self.points) or len(set(self.names)) < len(self.names)
        if len(set(map(len, self.paired.values()))) > 1:
            raise ValueError(f"paired: lists must have one length, but {lengths}")
        if self.names and unfit:
            raise ValueError(f"names: {len(self.names)}; {expected}")
        return self

    @model_validator(mode="after")
    def _no_field_is_given_twice(self) -> "StudyFile":
        swept = self.paths
        for k, path in enumerate(swept):
            if path in self.set:
                raise ValueError(f"{path}: is both set and swept; give it once")
            if path in swept[:k]:
                raise ValueError(f"{path}: is swept twice; give it once")
            before = dict.fromkeys(swept[:k], "swept before it; give it first")
            for other, instead in (before | dict.fromkeys(self.set, f"set; give that in the values of {path}")).items():
                if other.startswith(f"{path}."):
                    raise ValueError(f"{path}: would overwrite {other}, which is {instead}")
        _check_items(self.set, swept)
        if self.seeds is not None and "seed" in (*swept, *self.set):
            raise ValueError("seeds: the field seed is given too; give either")
        return self

    @model_validator(mode="after")
    def _labels_and_size_fit(self) -> "StudyFile":
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
