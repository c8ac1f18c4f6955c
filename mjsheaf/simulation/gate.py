"""Team of threads that run one compiled function, and the barrier that synchronises them.

A gate is the barrier: an array of integers, initially zero, with the number of arrivals, the next unit of work, and
flags for failed and abandoned work. Threads synchronise there without the interpreter, thousands of times per second.
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

_ARRIVED, _NEXT, _FAILED, _ABANDONED, _SIZE = 0, 16, 32, 48, 64  # places, each in a cache line of its own
_PATIENCE = 1000  # looks at a gate before another process may have the processor

Work = Callable[[int, IntArray], None]
"""Called with (number of the thread, gate)."""


class Crew:
    """Threads for one run; thread 0 is the caller's.

    Args:
        count: how many.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = ThreadPoolExecutor(count - 1) if count > 1 else None

    def run(self, work: Work) -> None:
        """Run `work` on every thread, until all of them have ended; one that raises makes the others leave the gate."""
        gate = self.gate()
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
    def gate() -> IntArray:
        """A new gate."""
        return np.zeros(_SIZE, dtype=np.int64)

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
        gate: the gate.
        meetings: how many there were, with this one.
        threads: how many meet.
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
def take(gate, amount, threads):
    """Take the next `amount` units of work; returns the first of them."""
    if threads > 1:
        return _fetch_add(gate, _NEXT, amount)
    first = gate[_NEXT]
    gate[_NEXT] = first + amount
    return first


@inline_jit
def refill(gate):
    """Begin with unit 0 again; for one thread, while the others wait."""
    gate[_NEXT] = 0


@inline_jit
def fail(gate):
    """Report that the work failed. All threads see it alike once they have met again."""
    gate[_FAILED] = 1


@inline_jit
def failed(gate):
    """Return True if a thread reported a failure before the last barrier."""
    return gate[_FAILED] != 0
