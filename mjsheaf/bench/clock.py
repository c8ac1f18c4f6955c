"""Timing on machines that have other things to do.

Whoever else runs can only make a wall clock slower: the best of many is what the machine can do. Where one thread
works, its own processor time is taken instead, which does not count the time of others; a ratio of two things is
taken from turns, one right after the other, so that both meet the same clock frequency and the same neighbours.
"""

from collections.abc import Callable
from time import perf_counter, thread_time
from typing import Any


def best_wall(work: Callable[[], Any], repetitions: int) -> float:
    """Shortest wall time of some work, s."""
    return min(_timed(work, perf_counter) for _ in range(repetitions))


def best_cpu(work: Callable[[], Any], repetitions: int) -> float:
    """Shortest processor time of the calling thread in some work, s."""
    return min(_timed(work, thread_time) for _ in range(repetitions))


def cpu_time(work: Callable[[], Any]) -> float:
    """Processor time of the calling thread in some work, s."""
    return _timed(work, thread_time)


def _timed(work: Callable[[], Any], clock: Callable[[], float]) -> float:
    begun = clock()
    work()
    return clock() - begun
