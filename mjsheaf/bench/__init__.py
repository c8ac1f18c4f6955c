"""`mjsheaf bench`: how fast mjsheaf is on this machine, each figure beside what it is held against.

Whoever else runs can only make a wall clock slower: the best of many is what the machine can do. Where one thread
works, its own processor time is taken instead, which does not count the time of others; a ratio of two things is
taken from turns, one right after the other, so that both meet the same clock frequency and the same neighbours.
"""

import os
import platform
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, thread_time
from typing import Any, TypeVar

from mjsheaf.errors import InputError
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.scenario import Scenario, load_scenario

T = TypeVar("T")

TOPICS = {
    "startup": "benchmarks.processes",
    "ideal": "mjsheaf.bench.simulations",
    "loop": "mjsheaf.bench.simulations",
    "fused": "mjsheaf.bench.simulations",
    "threads": "mjsheaf.bench.simulations",
    "peers": "benchmarks.peers",
    "hardware": "benchmarks.hardware",
    "assembly": "mjsheaf.bench.simulations",
    "sheaf": "mjsheaf.bench.sheaf",
    "video": "benchmarks.processes",
    "memory": "benchmarks.processes",
}
"""Module of each topic, a function `topic(short) -> list[Row]`; `short` takes fewer repetitions.

`benchmarks` is part of the source tree and is not installed with the package.
"""

_SOURCE_TREE = Path(__file__).resolve().parents[2]

WANTED = {
    "startup": 0.3,
    "ideal": 0.3,
    "loop": 1.25,
    "swarm growth": 1.2,
    "fused": 200.0,
    "fused run": 0.2,
    "fused threads": 0.9,
    "mujoco threads": 0.8,
    "speed-up": 0.9,
    "assembly": 6.0,
    "sheaf": 2.0,
    "grid growth": 1.1,
    "video": 1.15,
    "memory": 1.15,
}
"""What is wanted, at most unless a line says otherwise.

- startup: time of the command line's help, s; ideal: of the published run; assembly: of putting a thousand vehicles
  into one model;
- loop: time of a step with the loop closed, over that of a bare step; swarm growth: of a step per vehicle of the
  largest swarm, over that of the next smaller one;
- fused: time of a step of the fused engine per vehicle of a thousand, ns, on one core; fused run: of the published run
  on bodies by it, s; fused threads, mujoco threads: speed-up by threads that share one team, over their number, at
  least;
- speed-up: by threads, over their number, at least; 1.8 on two cores;
- sheaf: published time of an operation on a sheaf of 500 vertices over ours, at least; grid growth: exponent with which
  time grows with the number of vertices of a grid;
- video: time of a run with its video, over that of bare drawing; memory: peak of a run ten times as long, over that of
  the shorter, as results stream to disk.
"""


@dataclass(frozen=True)
class Row:
    """One line of the table of `mjsheaf bench`.

    Attributes:
        topic: which measurement it comes from.
        what: what was measured, with its unit.
        ours: the figure; None where it could not be measured.
        reference: what it is compared with, in the same unit; None where there is only a bound.
        ratio: the number that is wanted to be small or large; None where it could not be formed.
        wanted: the bound on `ratio` in words, 'at most 1.25' or 'at least 4'; empty where the row only informs.
        met: whether it holds; None where `wanted` is empty.
        note: where the reference comes from, or why there is none.
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
    """A row whose ratio should be at most a bound."""
    return Row(topic, what, ours, reference, ratio, f"at most {bound:g}", ratio <= bound, note)


def at_least(
    topic: str, what: str, ours: float, reference: float | None, ratio: float, bound: float, note: str = ""
) -> Row:
    """A row whose ratio should be at least a bound."""
    return Row(topic, what, ours, reference, ratio, f"at least {bound:g}", ratio >= bound, note)


def informs(topic: str, what: str, ours: float | None, reference: float | None = None, note: str = "") -> Row:
    """A row without a bound."""
    ratio = None if ours is None or not reference else ours / reference
    return Row(topic, what, ours, reference, ratio, note=note)


def best(work: Callable[[], Any], repetitions: int, clock: Callable[[], float] = perf_counter) -> float:
    """Shortest time of some work, s: by the wall, or of the calling thread's processor by `thread_time`."""
    return min(elapsed(work, clock) for _ in range(repetitions))


def elapsed(work: Callable[[], Any], clock: Callable[[], float] = thread_time) -> float:
    """Time of some work, s: of the calling thread's processor, or by the wall by `perf_counter`."""
    return timed(work, clock)[1]


def timed(work: Callable[[], T], clock: Callable[[], float] = perf_counter) -> tuple[T, float]:
    """What some work returns, and its time, s, as of `best`."""
    begun = clock()
    found = work()
    return found, clock() - begun


def swarm(size: int, vehicle: str = "hexarotor", **overrides: Any) -> Scenario:
    """The scenario `swarm` in any size: vehicles that follow another in wind, and shake.

    Args:
        size: number of agents; the target is one vehicle more.
        vehicle: name in models/.
        overrides: field to value, with __ for the dots of `--set`.
    """
    changes = {field.replace("__", "."): value for field, value in overrides.items()}
    return load_scenario("swarm", {"swarm.size": size, "swarm.vehicle": vehicle, **changes})


def run_bench(
    topics: Sequence[str] | None = None,
    *,
    short: bool = True,
    peers: str | None = None,
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Measure on this machine.

    Args:
        topics: some of TOPICS; None takes all that are installed.
        short: the short version of each, about two minutes in all.
        peers: a Python that has peers installed, for the topic of that name; None takes this one.
        progress: called with (what is measured, topics done, topics in all).

    Returns:
        `machine`; `short`; `figures`: for each topic what was measured, to the figure; `rows`: the `Row`s.

    Raises:
        InputError: an unknown topic, or one that is not installed, or peers without theirs, or a Python that measures
            none.
    """
    chosen = _choose(topics)
    if peers is not None and "peers" not in chosen:
        raise InputError(f"--peers {peers}: has no meaning without the topic peers; expected it among the topics")
    options = {"peers": {"python": peers}}
    rows: list[Row] = []
    for done, topic in enumerate(chosen):
        progress("measuring", done, len(chosen))
        rows += _load(topic)(short, **options.get(topic, {}))
    progress("measuring", len(chosen), len(chosen))
    figures = {topic: {row.what: row.ours for row in rows if row.topic == topic} for topic in chosen}
    return {"machine": machine(), "short": short, "figures": figures, "rows": [asdict(row) for row in rows]}


def _choose(topics: Sequence[str] | None) -> list[str]:
    """Return the topics to measure, in the order of TOPICS: these, or all that are installed.

    Raises:
        InputError: One is unknown, or not installed.
    """
    available = [topic for topic, module in TOPICS.items() if _is_available(module)]
    unknown = next((topic for topic in topics or () if topic not in available), None)
    if unknown is not None:
        fault = f"topic {unknown!r} needs mjsheaf's source tree" if unknown in TOPICS else f"unknown topic {unknown!r}"
        raise InputError(f"{fault}; expected {', '.join(available)}")
    return [topic for topic in available if topic in (topics or available)]


def _is_available(module: str) -> bool:
    """Return True if a module of TOPICS is installed or in the source tree."""
    return module.startswith("mjsheaf.") or (_SOURCE_TREE / f"{module.replace('.', '/')}.py").exists()


def _load(topic: str) -> Callable[..., list[Row]]:
    """Return the function that measures a topic."""
    if str(_SOURCE_TREE) not in sys.path and not TOPICS[topic].startswith("mjsheaf."):
        sys.path.append(str(_SOURCE_TREE))
    measure: Callable[..., list[Row]] = getattr(import_module(TOPICS[topic]), topic)
    return measure


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    return {
        "processors": os.cpu_count(),
        "architecture": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("mjsheaf", "mujoco", "numba")},
    }
