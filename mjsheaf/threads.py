"""Number of threads. Imports no numpy, since the environment's variables must be set before that.

Threads of linear algebra that wait for one another on busy cores take up to a hundred times as long on matrices of some
hundred states, and more of them gain little there.
"""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self, TypeVar

from threadpoolctl import threadpool_limits

F = TypeVar("F", bound=Callable[..., Any])

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables of the environment that keep BLAS to one thread where they are 1 before numpy is imported."""

one_thread: Callable[[F], F] = threadpool_limits.wrap(limits=1, user_api="blas")
"""Runs a function with one BLAS thread; the process has its own number again afterwards."""


_QUOTA = Path("/sys/fs/cgroup/cpu.max")
"""Processor time that a container may take, and in which period, us; 'max' where there is no limit."""


def usable_processors() -> int:
    """Return the number of processors that this process may use, limited by its affinity and its container's quota."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = map(float, _QUOTA.read_text().split())
    except (OSError, ValueError):
        return allowed
    return max(1, min(allowed, math.ceil(quota / period)))


class WithThreads:
    """Base of runs that may have threads; leaving a `with` block ends them."""

    def close(self) -> None:
        """End the threads, if there are any."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
