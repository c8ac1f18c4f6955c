"""Bounds rho of the agents' drift: |f_q(q*, t) - f_q(q, t)| <= rho(|e|) |e| with e = q* - q (before Theorem 1).

The theorem needs two things of rho: its value, and how far it stays below a level. Subclasses of `Rho` implement
`__call__`, non-decreasing and rounded up if at all, and may override `reach`, which never rounds up.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mjsheaf.errors import InputError

_REFINEMENTS = 64


class Rho:
    """A non-decreasing bound of the slope of the drift; infinite where nothing is known."""

    def __call__(self, radius: float) -> float:
        """rho at a radius >= 0 in m, 1/s."""
        raise NotImplementedError

    def reach(self, level: float) -> float | None:
        """A radius s with rho(s) <= level, the largest to about 1e-15 of itself; None where rho(0) exceeds it.

        This is the inverse of rho where rho has one. Where rho only does not decrease it is the supremum of
        {s: rho(s) <= level} from below.
        """
        if not self(0.0) <= level:
            return None
        if self(math.inf) <= level:
            return math.inf
        low, high = (1.0, 2.0) if self(1.0) <= level else (0.5, 1.0)
        while high < math.inf and self(high) <= level:
            low, high = high, 2.0 * high
        while low > 0.0 and not self(low) <= level:
            low, high = 0.5 * low, low
        for _ in range(_REFINEMENTS if high < math.inf else 0):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            low, high = (middle, high) if self(middle) <= level else (low, middle)
        return low


class ConstantRho(Rho):
    """rho = L: a Lipschitz constant over the whole region.

    Attributes:
        value: L, 1/s; infinite where there is none.
    """

    def __init__(self, value: float) -> None:
        if not value >= 0.0:
            raise InputError(f"rho is {value}; expected a number >= 0")
        self.value = float(value)

    def __call__(self, radius: float) -> float:
        """L, at every radius."""
        return self.value

    def reach(self, level: float) -> float | None:
        """Infinite where L does not exceed the level."""
        return math.inf if self.value <= level else None


class PolynomialRho(Rho):
    """rho(s) = c_0 + c_1 s + c_2 s^2 + ... with c_k >= 0.

    Attributes:
        coefficients: c_0, c_1, ... in 1/s, 1/(m s), ...
    """

    def __init__(self, coefficients: Sequence[float]) -> None:
        """Take the coefficients.

        Raises:
            InputError: none is given, or one is negative or not finite.
        """
        self.coefficients = tuple(float(c) for c in coefficients)
        if not self.coefficients or not all(0.0 <= c < math.inf for c in self.coefficients):
            raise InputError(f"the coefficients of rho are {list(coefficients)}; expected finite numbers >= 0")
        # Horner's scheme without cancellation: each of its 2 n roundings costs at most 2^-53 of the value.
        self._up = 1.0 + 4.0 * len(self.coefficients) * 2.0**-53

    def __call__(self, radius: float) -> float:
        """The polynomial, rounded up."""
        *lower, value = self.coefficients
        for c in reversed(lower):
            value = c + (value * radius if value > 0.0 else 0.0)
        return value * self._up if any(self.coefficients[1:]) else value


class StepRho(Rho):
    """A table: rho(s) = L_k on (radius_{k-1}, radius_k], infinite beyond the last radius.

    L_k may be a Lipschitz constant of the drift over the tube of radius_k about the path of q*: q lies in the tube of
    radius |e|, with the whole segment from q* to q.

    Attributes:
        radii: strictly increasing, m.
        values: L_k, non-decreasing, 1/s.
    """

    def __init__(self, steps: Sequence[tuple[float, float]]) -> None:
        """Take pairs (radius_k, L_k).

        Raises:
            InputError: there is none, radii do not increase from above 0, or values decrease or are negative.
        """
        self.radii = tuple(float(r) for r, _ in steps)
        self.values = tuple(float(value) for _, value in steps)
        rising = all(a < b for a, b in zip((0.0, *self.radii), self.radii, strict=False))
        sorted_ = all(a <= b for a, b in zip((0.0, *self.values), self.values, strict=False))
        if not (self.radii and rising and sorted_):
            raise InputError(
                f"the table of rho is {list(steps)}; expected pairs (radius, L), radii increasing from above 0, "
                "L >= 0 and never smaller than before"
            )

    def __call__(self, radius: float) -> float:
        """The L_k of the smallest tube that holds the radius."""
        k = bisect_left(self.radii, radius)
        return self.values[k] if k < len(self.values) else math.inf

    def reach(self, level: float) -> float | None:
        """The largest radius_k whose L_k does not exceed the level: exact."""
        below = [radius for radius, value in zip(self.radii, self.values, strict=True) if value <= level]
        return below[-1] if below else None


class BoundRho(Rho):
    """A function of the user's, non-decreasing and non-negative.

    That it bounds the drift is the user's claim, and that it does not decrease is checked on a grid alone: 0 and 1e-9
    to 1e9 m, eight radii a decade. NaN counts as infinite. Where the function rounds down, so does the theorem.
    """

    def __init__(self, function: Callable[[float], float]) -> None:
        """Take the function, of a radius in m, in 1/s.

        Raises:
            InputError: on the grid it is negative, or decreases.
        """
        self._function = function
        before, at = 0.0, 0.0
        for radius in (0.0, *np.logspace(-9, 9, 145).tolist()):
            value = self(radius)
            if value < before:
                raise InputError(
                    f"rho({radius:.6g}) = {value:.6g} but rho({at:.6g}) = {before:.6g}; expected a bound >= 0 that "
                    "does not decrease"
                    if radius
                    else f"rho(0) = {value:.6g}; expected a bound >= 0"
                )
            before, at = value, radius

    def __call__(self, radius: float) -> float:
        """What the function says."""
        try:
            value = float(self._function(radius))
        except (OverflowError, ZeroDivisionError):  # of plain floats at large or infinite radii
            return math.inf
        return math.inf if math.isnan(value) else value


RhoLike = float | Sequence[float] | Sequence[tuple[float, float]] | Callable[[float], float] | Rho
"""What `as_rho` takes."""


def as_rho(rho: RhoLike) -> Rho:
    """A bound from what a user gives.

    Args:
        rho: a number L, coefficients (c_0, c_1, ...) of a polynomial, a table of pairs (radius_k, L_k), a function of
            the radius, or a `Rho`, which stays as it is.

    Raises:
        InputError: it is none of these, or no bound.
    """
    if isinstance(rho, Rho):
        return rho
    if callable(rho):
        return BoundRho(rho)
    shape = _shape(rho)
    if shape == ():
        return ConstantRho(float(rho))  # type: ignore[arg-type]
    if len(shape) == 1:
        return PolynomialRho(rho)  # type: ignore[arg-type]
    if len(shape) == 2 and shape[1] == 2:
        return StepRho(rho)  # type: ignore[arg-type]
    raise InputError(
        f"rho is {rho!r}; expected a number, coefficients c_0, c_1, ..., pairs (radius, L), or a function of the radius"
    )


def _shape(rho: Any) -> tuple[int, ...]:
    """The shape of numbers, or one that nothing has."""
    try:
        return np.asarray(rho, dtype=np.float64).shape
    except (TypeError, ValueError):
        return (0, 0)
