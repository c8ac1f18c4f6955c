"""The speed of mjsheaf on this machine, each figure next to its reference or bound.

Other processes can only make wall times longer, so the minimum of many repetitions is reported. Work of a single thread
is measured in its processor time, which excludes other processes. A ratio of two times comes from alternating
repetitions, so that both have the same clock frequency and the same load from other processes.
"""

import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.metadata import version
from time import perf_counter, thread_time
from typing import Any, TypeVar

from mjsheaf.errors import InputError
from mjsheaf.progress import Report, no_progress
from mjsheaf.scenario import Scenario, load_scenario

T = TypeVar("T")

TOPICS = {
    "startup": "benchmarks.processes",
    "ideal": "benchmarks.simulations",
    "loop": "benchmarks.simulations",
    "fused": "benchmarks.simulations",
    "threads": "benchmarks.simulations",
    "peers": "benchmarks.peers",
    "hardware": "benchmarks.hardware",
    "assembly": "benchmarks.simulations",
    "sheaf": "benchmarks.sheaf",
    "video": "benchmarks.processes",
    "memory": "benchmarks.processes",
}
"""Modules of the topics, each with a function `topic(short) -> list[Row]`; `short` makes fewer repetitions."""

WANTED = {
    "startup": 0.3,
    "ideal": 0.3,
    "loop": 1.25,
    "swarm growth": 1.2,
    "fused": 200.0,
    "fused run": 0.2,
    "fused threads": 0.65,
    "speed-up": 0.9,
    "assembly": 6.0,
    "sheaf": 0.3,
    "grid growth": 1.1,
    "video": 1.15,
    "memory": 1.15,
}
"""Bounds of the measurements: maxima, except for those marked as minima.

- startup: Time of the command line's help, s.
- ideal: Time of the published run, s.
- assembly: Time of building one model of a thousand vehicles, s.
- loop: Time of a step with the loop closed, over that of a bare step.
- swarm growth: Time of a step per vehicle of the largest swarm, over that of the next smaller one.
- fused: Time of a step of the fused engine per vehicle, in a team of a thousand on one core, ns.
- fused run: Time of the published run on bodies with the fused engine, s.
- fused threads: Speed-up by threads that share one team, over their number (minimum).
- speed-up: Speed-up of independent runs by threads, over their number (minimum): 1.8 on two cores.
- sheaf: Published time of an operation on a sheaf of 500 vertices, over ours (minimum).
- grid growth: Exponent of the time as a function of the number of vertices of a grid.
- video: Time of a run with its video, over that of bare drawing.
- memory: Peak memory of a run ten times as long, over that of the shorter one, as results stream to disk.
"""


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes:
        topic: Topic of the measurement.
        what: Measured quantity with its unit.
        ours: Measured value; None if it could not be measured.
        reference: Value to compare it with, in the same unit; None if there is only a bound.
        ratio: Ratio that the bound applies to; None if it could not be computed.
        wanted: Bound on `ratio` in words, 'at most 1.25' or 'at least 4'; empty if there is none.
        met: True if the bound holds; None if there is none.
        note: Source of the reference, or the reason why there is none.
    """

    topic: str
    what: str
    ours: float | None
    reference: float | None = None
    ratio: float | None = None
    wanted: str = ""
    met: bool | None = None
    note: str = ""


def at_most(
    topic: str, what: str, ours: float, reference: float | None, ratio: float, bound: float, note: str = ""
) -> Row:
    """Return a row with an upper bound on its ratio."""
    return Row(topic, what, ours, reference, ratio, f"at most {bound:g}", ratio <= bound, note)


def at_least(
    topic: str, what: str, ours: float, reference: float | None, ratio: float, bound: float, note: str = ""
) -> Row:
    """Return a row with a lower bound on its ratio."""
    return Row(topic, what, ours, reference, ratio, f"at least {bound:g}", ratio >= bound, note)


def informs(topic: str, what: str, ours: float | None, reference: float | None = None, note: str = "") -> Row:
    """Return a row without a bound."""
    ratio = None if ours is None or not reference else ours / reference
    return Row(topic, what, ours, reference, ratio, note=note)


def best(work: Callable[[], Any], repetitions: int, clock: Callable[[], float] = perf_counter) -> float:
    """Return the shortest time of `work`, s, as wall time, or as processor time with the clock `thread_time`."""
    return min(elapsed(work, clock) for _ in range(repetitions))


def elapsed(work: Callable[[], Any], clock: Callable[[], float] = thread_time) -> float:
    """Return the time of `work`, s, as processor time, or as wall time with the clock `perf_counter`."""
    return timed(work, clock)[1]


def timed(work: Callable[[], T], clock: Callable[[], float] = perf_counter) -> tuple[T, float]:
    """Return the result of `work` and its time, s; see `best` for the clock."""
    begun = clock()
    found = work()
    return found, clock() - begun


def swarm(size: int, vehicle: str = "hexarotor", **overrides: Any) -> Scenario:
    """Return the scenario `swarm` in any size: vehicles with disturbances that follow a target in wind.

    Args:
        size: Number of agents; the target is an additional vehicle.
        vehicle: Name in models/.
        overrides: Values by field path, with __ instead of the dots of `--set`.
    """
    changes = {field.replace("__", "."): value for field, value in overrides.items()}
    return load_scenario("swarm", {"swarm.size": size, "swarm.vehicle": vehicle, **changes})


def run_bench(
    topics: Sequence[str] | None = None,
    *,
    short: bool = True,
    peers: str | None = None,
    progress: Report = no_progress,
) -> dict[str, Any]:
    """Measure the speed of this machine.

    Args:
        topics: Names out of TOPICS; None takes all.
        short: True for the short version of each topic, about two minutes in all.
        peers: Python with peer libraries installed, for the topic `peers`; None takes this one.
        progress: Callback, called with the name of the topic, the topics done and the number of topics.

    Returns:
        `machine`; `short`; `figures`: measured values of each topic by quantity; `rows`: the `Row`s.

    Raises:
        InputError: A topic is unknown, `peers` is given without its topic, or its Python measures nothing.
    """
    for topic in topics or ():
        if topic not in TOPICS:
            raise InputError(f"unknown topic {topic!r}; expected {', '.join(TOPICS)}")
    chosen = [topic for topic in TOPICS if topic in (topics or TOPICS)]
    if peers is not None and "peers" not in chosen:
        raise InputError(f"--peers {peers}: requires the topic peers; expected it among the topics")
    options = {"peers": {"python": peers}}
    rows: list[Row] = []
    for done, topic in enumerate(chosen):
        progress("measuring", done, len(chosen))
        measure: Callable[..., list[Row]] = getattr(import_module(TOPICS[topic]), topic)
        rows += measure(short, **options.get(topic, {}))
    progress("measuring", len(chosen), len(chosen))
    figures = {topic: {row.what: row.ours for row in rows if row.topic == topic} for topic in chosen}
    return {"machine": machine(), "short": short, "figures": figures, "rows": [asdict(row) for row in rows]}


def machine() -> dict[str, Any]:
    """Describe the machine and the versions."""
    return {
        "processors": os.cpu_count(),
        "architecture": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("mjsheaf", "mujoco", "numba")},
    }
