"""Directions in which a vehicle can push, from the set of wrenches that its actuators can make.

Along each controlled row of the wrench and each way, a linear program finds the largest force or moment that the
actuators add to what carries the weight, with all other controlled rows zero. A vehicle lacks a direction in which it
makes less than WEAK_SIDE of what it makes the other way. Two propellers that cannot reverse lack astern, and turning to
both sides, because every yaw moment of theirs comes with thrust ahead. They lack no turning once surge is free.
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
_TURNING_SHARE = 0.12  # of the speed ahead, above which a boat that cannot back turns round under way
_HALF = 0.5  # of the largest yaw moment: its price in surge is taken there


class Authority(NamedTuple):
    """Directions in which a vehicle can push, about the thrust that carries its weight.

    Attributes:
        rows: Controlled rows of the wrench, length r.
        reach: Largest force or moment along each row, and against it, with the others zero, shape (r, 2), N and N m.
        under_way: Same with the force rows of a boat free where it turns, shape (r, 2).
        lacking: Names of the directions in which it cannot push, or hardly.
    """

    rows: list[int]
    reach: Array
    under_way: Array
    lacking: tuple[str, ...]

    @property
    def forward_only(self) -> bool:
        """Return True if the vehicle pushes ahead and not astern."""
        return "astern" in self.lacking and "ahead" not in self.lacking

    @property
    def turns_under_way(self) -> bool:
        """Return True if it turns both ways, but only while it also pushes."""
        row = self.rows.index(_YAW) if _YAW in self.rows else None
        return row is not None and bool(set(_WAYS[_YAW]) & set(self.lacking)) and bool((self.under_way[row] > 0).all())

    def describe(self) -> str:
        """Say in a few words which ways the vehicle pushes."""
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
    reach, under_way = np.zeros((len(rows), 2)), np.zeros((len(rows), 2))
    for k, row in enumerate(rows):
        free = [other for other in rows if other < 3 and vehicle.dimension == 2 and row == _YAW]
        for way, sign in enumerate((1.0, -1.0)):
            reach[k, way] = _largest(vehicle, row, sign, [])
            under_way[k, way] = _largest(vehicle, row, sign, free) if free else reach[k, way]
    lacking = [
        _WAYS[row][way]
        for k, row in enumerate(rows)
        for way in (0, 1)
        if reach[k, way] < WEAK_SIDE * under_way[k].max() or reach[k, way] <= 0.0
    ]
    return Authority(rows, reach, under_way, tuple(lacking))


def may_lack(vehicle: Vehicle) -> bool:
    """Return False for a vehicle whose efforts all leave room both ways; it pushes in all directions."""
    trim, (low, high) = vehicle.steering.trim_effort(vehicle), vehicle.effort_bounds.T
    below, above = trim - low, high - trim
    return not vehicle.actuators or bool((np.minimum(below, above) < WEAK_SIDE * np.maximum(below, above)).any())


def describe_consequences(vehicle: Vehicle, authority: Authority) -> str:
    """Say what follows for control where a vehicle lacks directions."""
    if not vehicle.steering.attitude:
        if authority.forward_only:
            return (
                "it cannot go astern: it turns round for a target behind it, and near its target no linear model holds"
            )
        return "it moves ahead while it turns, and near its target no linear model holds"
    return "it holds its heading, so it cannot move in these directions"


def is_one_sided(vehicle: Vehicle) -> bool:
    """Return True for a boat with an actuator that pushes one way only, or hardly the other."""
    return vehicle.dimension == 2 and any(actuator.one_sided for actuator in vehicle.actuators)


class Turning(NamedTuple):
    """Numbers with which a boat that cannot back turns; see `steering.steer`.

    Attributes:
        price: Surge force that each unit of yaw moment brings with it, 1/m; 0 where it turns on the spot.
        speed: Commanded speed above which it turns round rather than drift, m/s.
    """

    price: float
    speed: float


def turning_of(vehicle: Vehicle) -> Turning | None:
    """Return how a boat steered at its hand point turns, or None for a vehicle that can back."""
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
    """Largest wrench along a row, one way, with the other controlled rows zero but those that are free, N or N m."""
    rows = [other for other in vehicle.controlled_rows if other not in free]
    along = np.zeros(6)
    along[row] = sign
    return vehicle.largest_along(rows, along, vehicle.W @ vehicle.steering.trim_effort(vehicle))


def _least_surge(vehicle: Vehicle, moment: float) -> float:
    """Smallest surge force, from 0 on, with which a boat makes a yaw moment, N."""
    W = vehicle.W
    A = np.column_stack([W[[_SURGE, _YAW]], [-1.0, 0.0]])
    return vehicle.solve_for_efforts(A, np.array([0.0, moment]), np.append(np.zeros(W.shape[1]), 1.0))
