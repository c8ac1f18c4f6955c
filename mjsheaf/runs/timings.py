"""Durations of the parts of a command, the contents of `timings` in summary.json."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

from mjsheaf.compile.jit import compilation_time, working_time


def join_timings(before: dict[str, float], after: dict[str, float]) -> dict[str, float]:
    """Add the durations of two records, s."""
    return {name: before.get(name, 0.0) + after.get(name, 0.0) for name in {**before, **after}}


class Timings:
    """Durations of the parts of a run's publication; compilation is a separate part."""

    def __init__(self) -> None:
        """Begin to measure."""
        self._begun = perf_counter()
        self._compiled = compilation_time()
        self._parts: dict[str, float] = {}

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Add the duration of the block to a part."""
        begun = working_time()
        try:
            yield
        finally:
            self.add(name, working_time() - begun)

    def add(self, name: str, seconds: float) -> None:
        """Add a duration in s to a part."""
        self._parts[name] = self._parts.get(name, 0.0) + seconds

    def record(self) -> dict[str, float]:
        """Return the duration of each part until now, of compilation, and of everything since the beginning, s."""
        compilation = compilation_time() - self._compiled
        return {**self._parts, "compilation": compilation, "total": perf_counter() - self._begun}
