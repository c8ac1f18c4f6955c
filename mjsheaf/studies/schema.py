"""The schema of a study file: a scenario, what is swept, and how."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, JsonValue, ValidationError, model_validator

from mjsheaf.io.yaml import Number, Positive, Section, describe_validation_error
from mjsheaf.simulation.run import BACKENDS

Measure = Literal["mean_disagreement", "tracking_error", "formation_error", "centering_error"]


def _fits_a_table(value: JsonValue) -> JsonValue:
    """Refuse whole numbers that no column holds; no field of a scenario takes them."""
    waiting = [value]
    while waiting:
        item = waiting.pop()
        if isinstance(item, dict | list):
            waiting += item.values() if isinstance(item, dict) else item
        elif isinstance(item, int) and abs(item) >= 2**63:
            raise ValueError(f"a number of {len(str(item))} digits; expected whole numbers below 2^63 in size")
    return value


Value = Annotated[JsonValue, AfterValidator(_fits_a_table)]
Values = Annotated[list[Value], Field(min_length=1)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]

MOST_RUNS = 1_000_000
"""In one study: a run is a file, and more of them in one directory help nobody."""


class _Range(Section):
    """Two ends of an interval."""

    low: Number
    high: Number

    @model_validator(mode="after")
    def _ordered(self) -> "_Range":
        if self.high <= self.low:
            raise ValueError(f"high ({self.high}) must be above low ({self.low})")
        return self


class Uniform(_Range):
    """Any number of an interval, all alike."""

    kind: Literal["uniform"]


class LogUniform(_Range):
    """Any number of an interval of positive numbers, every ratio alike."""

    kind: Literal["loguniform"]
    low: Positive
    high: Positive


class Normal(Section):
    """A normal distribution."""

    kind: Literal["normal"]
    mean: Number
    deviation: Positive


class Integers(Section):
    """Whole numbers from low to high, both among them."""

    kind: Literal["integers"]
    low: int
    high: int

    @model_validator(mode="after")
    def _ordered(self) -> "Integers":
        if self.high < self.low:
            raise ValueError(f"high ({self.high}) must not be below low ({self.low})")
        if max(abs(self.low), abs(self.high)) >= 2**62:
            raise ValueError("low and high must be below 2**62 in size")
        return self


class Choice(Section):
    """One of the values, all alike."""

    kind: Literal["choice"]
    values: Values


Distribution = Annotated[Uniform | LogUniform | Normal | Integers | Choice, Field(discriminator="kind")]


class Draws(Section):
    """Random points."""

    count: Annotated[int, Field(ge=1, le=MOST_RUNS)]
    seed: Seed = 0
    values: Annotated[dict[str, Distribution], Field(min_length=1)]


class SeedRange(Section):
    """Seeds from `start` up to, but without, `stop`."""

    start: Seed = 0
    stop: Seed

    @model_validator(mode="after")
    def _ordered(self) -> "SeedRange":
        if self.stop <= self.start:
            raise ValueError(f"stop ({self.stop}) must be above start ({self.start})")
        return self


class StudyFile(Section):
    """What is asked: every listed point with every pair, grid point and draw, and all of these with every seed."""

    summary: str = Field("", description="one line: the question")
    scenario: str = Field(description="a name in scenarios/, or the path of a YAML file from this one's directory")
    backend: Literal[BACKENDS] = "physics"  # type: ignore[valid-type]
    set: dict[str, Value] = Field(default_factory=dict, description="overrides of all runs: field path to value")
    points: list[dict[str, Value]] = Field(default_factory=list, description="listed points: field path to value")
    paired: dict[str, Values] = Field(default_factory=dict, description="lists of one length that go together")
    grid: dict[str, Values] = Field(default_factory=dict, description="every value with every other")
    draws: Draws | None = None
    seeds: SeedRange | None = Field(None, description="the scenario's own seed unless given")
    measure: Measure | None = Field(None, description="the error that plots show; all that are defined unless given")
    labels: dict[str, str] = Field(default_factory=dict, description="what plots call a swept field, with its unit")
    trajectories: bool = Field(False, description="whether to keep result.nc of every run")

    @model_validator(mode="after")
    def _fits(self) -> "StudyFile":
        lengths = {path: len(values) for path, values in self.paired.items()}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{path} has {length}" for path, length in lengths.items())
            raise ValueError(f"paired: lists must have one length, but {told}")
        seen: list[str] = []
        listed = dict.fromkeys(path for point in self.points for path in point)
        drawn = self.draws.values if self.draws else {}
        for path in (*listed, *self.paired, *self.grid, *drawn):
            if path in self.set:
                raise ValueError(f"{path}: is both set and swept; give it once")
            if path in seen:
                raise ValueError(f"{path}: is swept twice; give it once")
            inside = next((other for other in seen if other.startswith(f"{path}.")), None)
            if inside is not None:
                raise ValueError(f"{path}: would overwrite {inside}, which is swept before it; give it first")
            inside = next((other for other in self.set if other.startswith(f"{path}.")), None)
            if inside is not None:
                raise ValueError(f"{path}: would overwrite {inside}, which is set; give that in the values of {path}")
            seen.append(path)
        _check_items(self.set, seen)
        unknown = next((path for path in self.labels if path not in seen), None)
        if unknown is not None:
            raise ValueError(f"labels: {unknown} is not swept; expected {', '.join(seen) or 'none'}")
        if self.seeds is not None and ("seed" in seen or "seed" in self.set):
            raise ValueError("seeds: the field seed is given too; give either")
        if self.size > MOST_RUNS:
            raise ValueError(f"{self.size} runs are asked for; expected at most {MOST_RUNS}")
        return self

    @property
    def paths(self) -> list[str]:
        """The fields that are swept, in the order in which they are set."""
        listed = dict.fromkeys(path for point in self.points for path in point)
        return [*listed, *self.paired, *self.grid, *(self.draws.values if self.draws else [])]

    @property
    def size(self) -> int:
        """The number of runs."""
        count = max(1, len(self.points)) * len(next(iter(self.paired.values()), [None]))
        for values in self.grid.values():
            count *= len(values)
        count *= self.draws.count if self.draws else 1
        return count * (self.seeds.stop - self.seeds.start if self.seeds else 1)


def _check_items(fixed: Mapping[str, Any], swept: Iterable[str]) -> None:
    """See that swept fields name the items of a list either by number or by id, so that no item has two names.

    Raises:
        ValueError: one does not.
    """
    tree: dict[bool, Any] = {}
    for path in (*fixed, *swept):
        at = tree
        for key in path.split("."):
            number = key.isdecimal()
            other = next(iter(at.get(not number, ())), None)
            if other is not None and path not in fixed:
                raise ValueError(f"{path}: another field names an item of the same list as {other}; name all one way")
            at = at.setdefault(number, {}).setdefault(key, {})


def problem_of(error: ValidationError) -> str:
    """What is wrong with a study, in one line; what concerns several fields begins with the one that is wrong."""
    return describe_validation_error(error, StudyFile).removeprefix("file: ")


def values_of(study: StudyFile) -> Iterator[tuple[str, JsonValue]]:
    """Every value that a study file gives to a field of the scenario, with the field's path."""
    for point in [study.set, *study.points]:
        yield from point.items()
    draws = study.draws.values if study.draws else {}
    choices = {path: how.values for path, how in draws.items() if isinstance(how, Choice)}
    for columns in (study.paired, study.grid, choices):
        for path, values in columns.items():
            yield from ((path, value) for value in values)


def asked_of(study: StudyFile) -> dict[str, Any]:
    """What a study file asks for, in canonical form, but for the scenario and what only says how results are shown."""
    return study.model_dump(mode="json", exclude={"summary", "scenario", "measure", "labels"}, exclude_none=True)
