"""Threads of linear algebra; imports no numpy, before which the environment's variables are to be set.

Threads that wait for one another on busy cores take up to a hundred times as long on matrices of some hundred states,
and more of them gain little there.
"""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
T = TypeVar("T")

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables of the environment that keep BLAS to one thread where they are 1 before numpy is imported."""


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Run a function with one BLAS thread; the process has its own number again afterwards."""

    @wraps(function)
    def limited(*arguments: P.args, **options: P.kwargs) -> T:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*arguments, **options)

    return limited
