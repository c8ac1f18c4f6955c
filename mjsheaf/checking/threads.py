"""One thread for linear algebra on matrices of some hundred states.

Threads that wait for one another on busy cores take up to a hundred times as long, and more of them gain little here.
"""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
T = TypeVar("T")


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Run a function with one BLAS thread; the process has its own number again afterwards."""

    @wraps(function)
    def limited(*arguments: P.args, **options: P.kwargs) -> T:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*arguments, **options)

    return limited
