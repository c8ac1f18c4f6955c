"""Independent runs in one process: `simulate_many` on several threads against one at a time, bit for bit the same."""

from statistics import median
from time import perf_counter
from typing import Any

import mjsheaf
from mjsheaf.bench.rows import Row, at_least, informs
from mjsheaf.simulation.run import usable_processors

WANTED = 0.9
"""Wanted: the speed-up over the number of threads; 1.8 on two cores."""

GAINS = (5.0, 8.0, 10.0, 12.0)


def measure(short: bool = False, ends: tuple[float, float] = (49.99, 20.0)) -> dict[str, Any]:
    """Runs of `paper` with different gains on both backends, one by one and side by side.

    Args:
        short: fewer repetitions.
        ends: end of the runs on ideal kinematics and on bodies, s.

    Returns:
        `processors` that this process may use; `threads` used, one for each, at most one for each run; `backends`: for
        each the best wall times in s of `one_by_one_s` and `together_s`, the median `speedup` of a turn, and whether
        the results are `identical`.
    """
    processors = usable_processors()
    threads = min(processors, len(GAINS))
    backends = [
        _measure_backend(backend, end, threads, 3 if short else 8)
        for backend, end in zip(("ideal", "physics"), ends, strict=True)
    ]
    return {"processors": processors, "threads": threads, "backends": backends}


def _measure_backend(backend: str, end: float, threads: int, repetitions: int) -> dict[str, Any]:
    scenarios = [mjsheaf.load_scenario("paper", {"controller.gain": gain, "time.end": end}) for gain in GAINS]
    mjsheaf.simulate(scenarios[0], backend=backend)  # compiles
    turns = []
    for _ in range(repetitions):
        begun = perf_counter()
        alone = mjsheaf.simulate_many(scenarios, backend, workers=1)
        middle = perf_counter()
        together = mjsheaf.simulate_many(scenarios, backend, workers=threads)
        turns.append((middle - begun, perf_counter() - middle))
    same = all(a.identical(b) for a, b in zip(alone, together, strict=True))  # type: ignore[union-attr, arg-type]
    return {
        "backend": backend,
        "runs": len(scenarios),
        "one_by_one_s": min(a for a, _ in turns),
        "together_s": min(b for _, b in turns),
        "speedup": median(a / b for a, b in turns),
        "identical": same,
    }


def rows(figures: dict[str, Any]) -> list[Row]:
    """The figures of `measure` against what is wanted."""
    threads = figures["threads"]
    table = []
    for b in figures["backends"]:
        what = f"{b['runs']} runs on {b['backend']}, {threads} threads, s"
        note = "one thread" if b["identical"] else "one thread; the results DIFFER"
        if threads == 1:
            table.append(informs("threads", what, b["together_s"], b["one_by_one_s"], "one processor only"))
        else:
            bound = WANTED * threads
            table.append(at_least("threads", what, b["together_s"], b["one_by_one_s"], b["speedup"], bound, note))
    return table
