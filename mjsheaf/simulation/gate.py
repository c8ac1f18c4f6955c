"""Team of threads that run one compiled function, and the barrier that synchronises them.

A gate is the barrier: an array of integers, initially zero, with the number of arrivals, flags for failed and
abandoned work, and how many units of each thread's share of the work are taken. Threads synchronise there without the
interpreter, thousands of times per second.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from mjsheaf.arrays import IntArray
from mjsheaf.jit import inline_jit

_ARRIVED, _FAILED, _ABANDONED, _TAKEN = 0, 16, 32, 48  # places, each in a cache line of its own
_APART = 16  # between places
_PATIENCE = 1000  # looks at a gate before another process may have the processor

Work = Callable[[int, IntArray], None]
"""Called with (number of the thread, gate)."""


class ThreadTeam:
    """Threads for one run; thread 0 is the caller's.

    Args:
        count: Number of threads.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = ThreadPoolExecutor(count - 1) if count > 1 else None

    def run(self, work: Work) -> None:
        """Run `work` on every thread, until all of them have ended; one that raises makes the others leave the gate."""
        gate = self.gate(self.count)
        others: list[Future[None]] = []

        def guarded(thread: int) -> None:
            try:
                work(thread, gate)
            except BaseException:
                gate[_ABANDONED] = 1
                raise

        try:
            if self._pool:
                for thread in range(1, self.count):
                    others.append(self._pool.submit(guarded, thread))
            guarded(0)
        except BaseException:  # a thread that could not be started, or Ctrl-C in between, strands those that were
            gate[_ABANDONED] = 1
            raise
        finally:
            errors = [other.exception() for other in others]
        for error in errors:
            if error:
                raise error

    @staticmethod
    def gate(count: int = 1) -> IntArray:
        """A new gate for `count` threads."""
        return np.zeros(_TAKEN + _APART * count, dtype=np.int64)

    def close(self) -> None:
        """End the threads."""
        if self._pool:
            self._pool.shutdown()


def _place_in(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return cgutils.get_item_pointer(context, builder, signature.args[0], array, [arguments[1]], wraparound=False)


def _atomic_addition(typing: Any, array: Any, index: Any, amount: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _place_in(context, builder, signature, arguments)
        return builder.atomic_rmw("add", place, arguments[2], "seq_cst")

    return types.int64(array, types.int64, types.int64), generate


def _atomic_load(typing: Any, array: Any, index: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load_atomic(_place_in(context, builder, signature, arguments), "seq_cst", 8)

    return types.int64(array, types.int64), generate


_fetch_add: Any = intrinsic(_atomic_addition)
"""_fetch_add(array, index, amount) adds to an entry of integers and returns what was there before."""

_load: Any = intrinsic(_atomic_load)
"""_load(array, index) returns an entry of integers that other threads may be changing."""

_sched_yield = types.ExternalFunction("sched_yield", types.int32())


@inline_jit
def wait(gate, meetings, threads):
    """Arrive at a gate and wait for the others; return False where one of them will never come.

    Args:
        gate: Barrier of the threads.
        meetings: Number of times that they have met, including this one.
        threads: Number of threads.
    """
    if threads > 1:
        _fetch_add(gate, _ARRIVED, 1)
        looks = 0
        while _load(gate, _ARRIVED) < meetings * threads:
            if _load(gate, _ABANDONED):
                return False
            looks += 1
            if looks > _PATIENCE:
                _sched_yield()
    return True


@inline_jit
def take(gate, thread, threads, count):
    """Take the next of `count` units of work; return its number, -1 where none is left.

    A thread takes the units of its own share, the same ones each time, so that what belongs to them stays in its cache;
    then it helps the others.
    """
    for turn in range(threads):
        owner = (thread + turn) % threads
        unit = owner * count // threads + _taken(gate, owner, threads)
        if unit < (owner + 1) * count // threads:
            return unit
    return -1


@inline_jit
def _taken(gate, owner, threads):
    """Count one more unit of a thread's share as taken; return how many were."""
    place = _TAKEN + _APART * owner
    if threads > 1:
        return _fetch_add(gate, place, 1)
    gate[place] += 1
    return gate[place] - 1


@inline_jit
def refill(gate, threads):
    """Begin anew with every share; for one thread, while the others wait."""
    for owner in range(threads):
        gate[_TAKEN + _APART * owner] = 0


@inline_jit
def fail(gate):
    """Report that the work failed. All threads see it alike once they have met again."""
    gate[_FAILED] = 1


@inline_jit
def failed(gate):
    """Return True if a thread reported a failure before the last barrier."""
    return gate[_FAILED] != 0
