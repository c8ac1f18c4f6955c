"""Directions in which a vehicle can push, and what it cannot do of what its description asks of it.

Along each controlled row of the wrench, in both directions, a linear program finds the largest force or moment that the
actuators can add to the trim, with all other controlled rows zero. A vehicle lacks a direction if it reaches less than
WEAK_SIDE of what it reaches in the opposite one. Two propellers that cannot reverse lack thrust astern. They also lack
turning to both sides, because every yaw moment comes with thrust ahead. If surge is free, they do not lack turning.
"""

import math
from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.vehicles.actuators import WEAK_SIDE
from mjsheaf.vehicles.effects import YAW, largest_wrench
from mjsheaf.vehicles.steering import ThrustVector
from mjsheaf.vehicles.vehicle import Vehicle

_WAYS = (
    ("ahead", "astern"),
    ("to port", "to starboard"),
    ("up", "down"),
    ("roll to starboard", "roll to port"),
    ("pitch down", "pitch up"),
    ("turn to port", "turn to starboard"),
)


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
        row = self.rows.index(YAW) if YAW in self.rows else None
        return row is not None and bool(set(_WAYS[YAW]) & set(self.lacking)) and bool((self.under_way[row] > 0).all())

    def describe(self) -> str:
        """Describe the directions of thrust in a few words."""
        if not self.reach.any():
            return "not at all"
        if not self.lacking:
            return "both ways"
        turning = _WAYS[YAW]
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
    if vehicle.dimension == 2 and YAW in rows:
        under_way[rows.index(YAW)] = _largest_both_ways(vehicle, YAW, [row for row in rows if row < 3])
    weak = (reach < WEAK_SIDE * under_way.max(axis=1, keepdims=True, initial=0.0)) | (reach <= 0.0)
    lacking = [_WAYS[rows[k]][way] for k, way in np.argwhere(weak).tolist()]
    return Authority(rows, reach, under_way, tuple(lacking))


def _largest_both_ways(vehicle: Vehicle, row: int, free: list[int]) -> list[float]:
    """Find the largest force or moment along a row, and against it; see `largest_wrench`."""
    return [largest_wrench(vehicle, row, sign, free) for sign in (1.0, -1.0)]


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


class Shortfall(NamedTuple):
    """An ability that a vehicle needs for what its description asks of it, and does not have.

    Attributes:
        axis: "roll" or "pitch" for the angular acceleration about an axis, "thrust" for the thrust.
        needed: Angular acceleration, rad/s^2, or thrust, N, with which it does what is asked.
        available: What its actuators produce at the thrust that carries its weight, rad/s^2, or in all, N.
        falls: True if it turns over and falls once it leans to its limit; False if that depends on the mission.
        sentence: The same in words, with the numbers.
    """

    axis: str
    needed: float
    available: float
    falls: bool
    sentence: str


def shortfalls_of(vehicle: Vehicle, *, falling: float = 0.25) -> list[Shortfall]:
    """Find what a multirotor that leans cannot do of what its description asks, the gravest first.

    Turning: a lean of theta_max asks its attitude loop for omega^2 theta_max, which few vehicles have. They need
    far less. With saturated moments, the actuators switch between +a and -a (an angular acceleration), and the loop
    through the lean has a limit cycle, by the describing function of a relay:

        amplitude  A = 4 a / (pi y),  y = Omega^2 the positive root of  T y^2 + (T d^2 - k_v) y - k_1 (k_v + d) d = 0

    with T = 2 zeta / omega - lag the lead of the attitude loop, k_v the rate of the autopilot, d = D / m, and k_1 =
    (k_v + d) / 4 for the law around it. (Without d, Omega^2 = k_v / T.) It is unstable: smaller swings decay, larger
    ones grow until the vehicle turns over. So a vehicle needs a = pi y theta_max / 4, with which no lean that is
    asked for is beyond A. In 84 simulated missions of drones of 25 kinds (omega 5 to 40 rad/s, lean 10 to 60 degrees,
    k_v 0 to 6 1/s, zeta 0.5 to 1.5, lag 0 to 0.07 s, D / m 0.04 to 2 1/s) that follow a moving target, the largest a
    with which the drone falls is 0.13 to 0.93 times that with an autopilot and 0.24 to 1.5 times without one; in 75
    it is 0.25 to 1 times. So less than a quarter falls, and in between it depends on how hard the mission leans. What
    is available is the share of a turn that the allocation leaves within the limits of the actuators while they carry
    the weight. Attitude loops that lag alone makes unstable (T <= 0) are not covered; their linear loop says so.

    Thrust: a lean of theta_max at constant height takes weight / cos(theta_max). A vehicle with less leans less,
    and is slower, but does not fall: its force is scaled to its thrust.

    Args:
        vehicle: The vehicle.
        falling: Fraction of the needed turning below which it falls once it leans to its limit.
    """
    steering = vehicle.steering
    if not isinstance(steering, ThrustVector):
        return []
    shortfalls, tilt = [], math.radians(steering.largest_tilt)
    asked = vehicle.hold.frequency**2 * tilt
    needed = min(_needed_turning(vehicle, tilt), asked)
    available = {axis: _available_turning(vehicle, row) for axis, row in (("roll", 3), ("pitch", 4))}
    axis = min(available, key=available.__getitem__)
    if available[axis] < needed:
        falls = available[axis] < falling * needed
        outcome = "it turns over and falls once it leans to its limit" if falls else "it may turn over and fall"
        sentence = (
            f"{vehicle.name} can turn by {available[axis]:.3g} rad/s^2 about its {axis} axis while it carries its "
            f"weight; attitude.frequency of {vehicle.hold.frequency:g} rad/s and a lean of {steering.largest_tilt:g} "
            f"degrees ask for {asked:.3g} and need {needed:.3g} rad/s^2: {outcome}"
        )
        shortfalls.append(Shortfall(axis, needed, available[axis], falls, sentence))
    thrust, lift = steering.largest_thrust(vehicle), vehicle.weight / math.cos(tilt)
    if vehicle.weight > 0.0 and thrust < lift:
        lean = math.degrees(math.acos(vehicle.weight / thrust))
        sentence = (
            f"a lean of {steering.largest_tilt:g} degrees takes {vehicle.name} {lift:.3g} N at constant height; it has "
            f"{thrust:.3g} N for that, so it leans by at most {lean:.2g} degrees"
        )
        shortfalls.append(Shortfall("thrust", lift, thrust, False, sentence))
    return shortfalls


def _needed_turning(vehicle: Vehicle, tilt: float) -> float:
    """Compute the angular acceleration that keeps leans up to `tilt`, rad, below the limit cycle, rad/s^2."""
    lead = 2.0 * vehicle.hold.damping / vehicle.hold.frequency - vehicle.lag
    if lead <= 0.0:
        return 0.0
    d = float(vehicle.drag[:2].max()) / vehicle.mass
    total = vehicle.rate + d
    half = 0.5 * (vehicle.rate - lead * d * d)
    # A law is critically damped with a gain of a quarter of the rate of the velocity loop.
    y = (half + math.sqrt(half * half + 0.25 * lead * total * total * d)) / lead
    return 0.25 * math.pi * y * tilt


def _available_turning(vehicle: Vehicle, row: int) -> float:
    """Compute the angular acceleration about an axis that the allocation adds to the trim both ways, rad/s^2."""
    turn = np.zeros(6)
    turn[3:] = vehicle.turning_inertia[:, row - 3]
    step, trim = vehicle.allocation @ turn, vehicle.steering.trim_effort(vehicle)
    planes, heights = vehicle.half_planes
    low, high = vehicle.effort_bounds.T
    room, rate = [high - trim, trim - low, heights - planes @ trim], [step, -step, planes @ step]
    shares = [
        float(np.divide(r, v, out=np.full(len(r), np.inf), where=v > 0.0).min(initial=np.inf))
        for sign in (1.0, -1.0)
        for r, v in zip(room, [sign * part for part in rate], strict=True)
    ]
    return max(min(shares), 0.0)
