"""Directions in which a vehicle can push, from the set of wrenches that its actuators can produce.

Along each controlled row of the wrench, in both directions, a linear program finds the largest force or moment that the
actuators can add to the trim, with all other controlled rows zero. A vehicle lacks a direction if it reaches less than
WEAK_SIDE of what it reaches in the opposite one. Two propellers that cannot reverse lack thrust astern. They also lack
turning to both sides, because every yaw moment comes with thrust ahead. If surge is free, they do not lack turning.
"""

from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.vehicles.actuators import WEAK_SIDE
from mjsheaf.vehicles.effects import capability_of
from mjsheaf.vehicles.vehicle import Vehicle

_WAYS = (
    ("ahead", "astern"),
    ("to port", "to starboard"),
    ("up", "down"),
    ("roll to starboard", "roll to port"),
    ("pitch down", "pitch up"),
    ("turn to port", "turn to starboard"),
)
_SURGE, _YAW = 0, 5
_TURNING_SHARE = 0.12  # fraction of the speed ahead above which a boat that cannot back turns round under way
_HALF = 0.5  # fraction of the largest yaw moment at which its price in surge is taken


class Authority(NamedTuple):
    """Directions in which a vehicle can push in addition to its trim.

    Attributes:
        rows: Controlled rows of the wrench, length r.
        reach: Largest force or moment along each row, and against it, with the others zero, shape (r, 2), N and N m.
        under_way: The same while a boat's force rows are free for moment rows, shape (r, 2), N and N m.
        lacking: Names of the directions in which it pushes very little or not at all.
    """

    rows: list[int]
    reach: Array
    under_way: Array
    lacking: tuple[str, ...]

    @property
    def forward_only(self) -> bool:
        """Return True if the vehicle pushes ahead but not astern."""
        return "astern" in self.lacking and "ahead" not in self.lacking

    @property
    def turns_under_way(self) -> bool:
        """Return True if it turns both ways, but only with thrust."""
        row = self.rows.index(_YAW) if _YAW in self.rows else None
        return row is not None and bool(set(_WAYS[_YAW]) & set(self.lacking)) and bool((self.under_way[row] > 0).all())

    def describe(self) -> str:
        """Describe the directions of thrust in a few words."""
        if not self.reach.any():
            return "not at all"
        if not self.lacking:
            return "both ways"
        turning = _WAYS[_YAW]
        others = [way for way in self.lacking if way not in turning or not self.turns_under_way]
        words = "ahead only" if others == ["astern"] else f"not {', '.join(others)}" if others else ""
        if self.turns_under_way:
            words += ", turns under way" if words else "turns under way"
        return words


def authority_of(vehicle: Vehicle) -> Authority:
    """Find the directions in which a vehicle can push."""
    rows = vehicle.controlled_rows
    reach = np.array([_largest_both_ways(vehicle, row, []) for row in rows]).reshape(-1, 2)
    under_way = reach.copy()
    if vehicle.dimension == 2 and _YAW in rows:
        under_way[rows.index(_YAW)] = _largest_both_ways(vehicle, _YAW, [row for row in rows if row < 3])
    weak = (reach < WEAK_SIDE * under_way.max(axis=1, keepdims=True, initial=0.0)) | (reach <= 0.0)
    lacking = [_WAYS[rows[k]][way] for k, way in np.argwhere(weak).tolist()]
    return Authority(rows, reach, under_way, tuple(lacking))


def _largest_both_ways(vehicle: Vehicle, row: int, free: list[int]) -> list[float]:
    """Find the largest force or moment along a row, and against it; see `_largest`."""
    return [_largest(vehicle, row, sign, free) for sign in (1.0, -1.0)]


def may_lack(vehicle: Vehicle) -> bool:
    """Return False if all efforts have room in both directions, so that the vehicle pushes in all directions."""
    trim, (low, high) = vehicle.steering.trim_effort(vehicle), vehicle.effort_bounds.T
    below, above = trim - low, high - trim
    return not vehicle.actuators or bool((np.minimum(below, above) < WEAK_SIDE * np.maximum(below, above)).any())


def describe_consequences(vehicle: Vehicle, authority: Authority) -> str:
    """Describe the consequences for control if a vehicle lacks directions."""
    if not vehicle.steering.attitude:
        if authority.forward_only:
            return "it cannot go astern: it turns round for a target behind it, and no linear model is valid near it"
        return "it moves ahead while it turns, and no linear model is valid near its target"
    return "it keeps its heading, so it cannot move in these directions"


def is_one_sided(vehicle: Vehicle) -> bool:
    """Return True for a boat with an actuator that pushes in one direction only, or very little in the other."""
    return vehicle.dimension == 2 and any(actuator.one_sided for actuator in vehicle.actuators)


class Turning(NamedTuple):
    """Turning parameters of a boat that cannot back; see `steering.steer`.

    Attributes:
        price: Surge force that comes with each unit of yaw moment, 1/m; 0 if it turns on the spot.
        speed: Commanded speed above which it turns round instead of drifting, m/s.
    """

    price: float
    speed: float


def turning_of(vehicle: Vehicle) -> Turning | None:
    """Return the turning parameters of a boat steered at its hand point; None for a vehicle that can back."""
    if _YAW not in vehicle.controlled_rows or vehicle.steering.attitude or not is_one_sided(vehicle):
        return None
    if not authority_of(vehicle).forward_only:
        return None
    prices = []
    for sign in (1.0, -1.0):
        moment = _HALF * _largest(vehicle, _YAW, sign, [_SURGE])
        if np.isfinite(moment) and moment > 0.0:
            prices.append(_least_surge(vehicle, sign * moment) / moment)
    speed = _TURNING_SHARE * capability_of(vehicle).forward_speed
    return Turning(max(prices, default=0.0), speed if np.isfinite(speed) else 0.0)


def _largest(vehicle: Vehicle, row: int, sign: float, free: list[int]) -> float:
    """Compute the largest wrench along a row in one direction, N or N m; other controlled rows are zero or `free`."""
    rows = [other for other in vehicle.controlled_rows if other not in free]
    along = np.zeros(6)
    along[row] = sign
    return vehicle.largest_along(rows, along, vehicle.W @ vehicle.steering.trim_effort(vehicle))


def _least_surge(vehicle: Vehicle, moment: float) -> float:
    """Compute the smallest surge force >= 0 with which a boat produces a yaw moment, N."""
    W = vehicle.W
    A = np.column_stack([W[[_SURGE, _YAW]], [-1.0, 0.0]])
    return vehicle.solve_for_efforts(A, np.array([0.0, moment]), np.append(np.zeros(W.shape[1]), 1.0))
