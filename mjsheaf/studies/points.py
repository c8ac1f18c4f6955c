"""The points of a study, in order: the same study always has the same points with the same numbers."""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from mjsheaf.studies.schema import Choice, Distribution, Draws, Integers, LogUniform, Normal, StudyFile, Uniform


@dataclass(frozen=True)
class Point:
    """One run of a study.

    Attributes:
        number: its place, from 0.
        parameters: field path to value, in the order in which they are set.
        seed: the scenario's seed; None leaves it as it is.
    """

    number: int
    parameters: dict[str, Any] = field(hash=False)
    seed: int | None = None

    @property
    def overrides(self) -> dict[str, Any]:
        """What makes this run of the study's scenario."""
        return self.parameters if self.seed is None else {**self.parameters, "seed": self.seed}


def points_of(study: StudyFile) -> Iterator[Point]:
    """The points: listed ones change slowest, then pairs, then the grid with its first path slowest, then draws; seeds
    change fastest.
    """
    listed = study.points or [{}]
    pairs = _rows(study.paired)
    grid = [dict(zip(study.grid, values, strict=True)) for values in product(*study.grid.values())]
    drawn = draw(study.draws) if study.draws else [{}]
    seeds = range(study.seeds.start, study.seeds.stop) if study.seeds else [None]
    for number, (point, pair, cell, sample, seed) in enumerate(product(listed, pairs, grid, drawn, seeds)):
        yield Point(number, {**point, **pair, **cell, **sample}, seed)


def _rows(columns: dict[str, list[Any]]) -> list[dict[str, Any]]:
    if not columns:
        return [{}]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def draw(draws: Draws) -> list[dict[str, Any]]:
    """The random points. Each path has a stream of its own: a longer study begins with the points of a shorter one, and
    another path leaves the values of the others as they were.
    """
    return _rows({path: _sample(how, draws.count, draws.seed, path) for path, how in draws.values.items()})


def _sample(how: Distribution, count: int, seed: int, path: str) -> list[Any]:
    rng = np.random.default_rng([seed, zlib.crc32(path.encode())])
    if isinstance(how, Choice):
        return [how.values[k] for k in rng.integers(len(how.values), size=count)]
    if isinstance(how, Integers):
        return [int(k) for k in rng.integers(how.low, how.high, size=count, endpoint=True)]
    if isinstance(how, Normal):
        return [float(x) for x in rng.normal(how.mean, how.deviation, count)]
    if isinstance(how, LogUniform):
        logs = rng.uniform(np.log(how.low), np.log(how.high), count)
        return [float(x) for x in np.clip(np.exp(logs), how.low, how.high)]
    assert isinstance(how, Uniform)
    return [float(x) for x in rng.uniform(how.low, how.high, count)]
