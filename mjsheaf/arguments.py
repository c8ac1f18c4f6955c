"""Checks of the arguments of public functions: one line that names the argument and the values it accepts."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, expected, shortened


def _given(value: Any) -> str:
    """A value as a message shows it, with its type."""
    return f"{shortened(repr(value))} ({type(value).__name__})"


def require_type(name: str, value: Any, kinds: Any, accepted: str) -> None:
    """Refuse an argument of another type.

    Raises:
        InputError: naming the argument and what it accepts.
    """
    if not isinstance(value, kinds):
        raise InputError(f"{name} is {_given(value)}; expected {accepted}")


def require_scenario(value: Any) -> None:
    """Refuse an argument that is no Scenario, which is what has phases and runs under any seed.

    Raises:
        InputError: it is none.
    """
    if not (hasattr(value, "phases") and hasattr(value, "with_seed")):
        raise InputError(f"scenario is {_given(value)}; expected a Scenario, as mjsheaf.load_scenario returns it")


def require_whole(name: str, value: Any, least: int) -> None:
    """Refuse an argument that is no whole number of at least `least`; booleans are none.

    Raises:
        InputError: naming the argument.
    """
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"{name} is {_given(value)}; expected a whole number of at least {least}")


def require_seed(name: str, value: Any) -> None:
    """Refuse an argument that is no seed.

    Raises:
        InputError: naming the argument.
    """
    require_whole(name, value, 0)
    if value >= 2**63:
        raise InputError(f"{name} is {_given(value)}; expected a whole number below 2^63")


def real_numbers(name: str, value: Any, shape: tuple[int, ...], accepted: str, rows: Any = ...) -> Array:
    """Return an argument as an array.

    Args:
        name: Name of the argument.
        value: The argument.
        shape: Shape that it must have.
        accepted: What is expected, in words.
        rows: Index of the rows that must be finite.

    Raises:
        InputError: It is not made of real numbers, has another shape, or is not finite.
    """
    try:
        numbers = np.asarray(value)
    except ValueError:  # rows of different lengths
        numbers = np.array(None)
    if numbers.dtype.kind not in "fiu" or numbers.shape != shape or not np.isfinite(numbers[rows]).all():
        what = f"is {_given(value)}"
        if numbers.dtype.kind in "fiu":
            what = f"has shape {numbers.shape}{' and is not finite' if numbers.shape == shape else ''}"
        raise InputError(f"{name} {what}; expected {accepted}")
    return numbers.astype(np.float64)


def require_choice(name: str, value: Any, choices: tuple[str, ...]) -> None:
    """Refuse an argument that is none of some names.

    Raises:
        InputError: naming the argument.
    """
    if value not in choices or not isinstance(value, str):
        close = expected(value, choices) if isinstance(value, str) else f"expected one of {', '.join(choices)}"
        raise InputError(f"unknown {name} {shortened(repr(value))}; {close}")


def require_mapping(name: str, value: Any, accepted: str) -> None:
    """Refuse an argument that is neither None nor a mapping with keys of text.

    Raises:
        InputError: naming the argument.
    """
    if value is None:
        return
    require_type(name, value, Mapping, f"{accepted}, or None")
    for key in value:
        require_type(f"a key of {name}", key, str, "text")


def require_number(name: str, value: Any, *, positive: bool = False) -> None:
    """Refuse an argument that is no finite number, or not above 0 where it must be.

    Raises:
        InputError: naming the argument.
    """
    number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not number or not np.isfinite(value) or (positive and value <= 0):
        raise InputError(f"{name} is {_given(value)}; expected a {'positive' if positive else 'finite'} number")
