"""Directions in which a vehicle can push, what it takes to hold station, and vehicles with effects switched off.

An effect that is off shows what it costs. The less obvious effects are:

- inertia: If off, mass, inertia and added mass shrink until m / D is `massless_tau`. Weight and drag stay the same. The
  autopilot is off, because it is no longer needed.
- limits: If off, thrusters have no limits, and multirotors tilt up to 80 degrees.
- underactuation: If off, a vehicle has thrusters along every controlled axis, with the strength and lag of its own. A
  boat then holds its heading and is controlled at its origin, and its sway drag limits its speed abeam. A multirotor
  has as much force sideways as up.

Authority: along each controlled row of the wrench, in both directions, a linear program finds the largest force or
moment that the actuators can add to the trim, with all other controlled rows zero. A vehicle lacks a direction if it
reaches less than WEAK_SIDE of what it reaches in the opposite one. Two propellers that cannot reverse lack thrust
astern. They also lack turning to both sides, because every yaw moment comes with thrust ahead. If surge is free, they
do not lack turning.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.section import Duration, Section
from mjsheaf.vehicles.actuators import WEAK_SIDE, Thruster
from mjsheaf.vehicles.steering import Full, ThrustVector
from mjsheaf.vehicles.vehicle import ROW_NAMES, Vehicle, solve_drag

SURGE, YAW = 0, 5
_AROUND = np.radians(np.arange(-181.0, 182.0))  # headings, rad, a little more than once around


def is_one_sided(vehicle: Vehicle) -> bool:
    """Return True for a boat with an actuator that pushes in one direction only, or very little in the other."""
    return vehicle.dimension == 2 and any(actuator.one_sided for actuator in vehicle.actuators)


class Turning(NamedTuple):
    """Turning parameters of a boat that cannot back; see `steering.steer_hand_point`.

    Attributes:
        price: Surge force that comes with each unit of yaw moment, 1/m; 0 if it turns on the spot.
        speed: Commanded speed above which it turns round instead of drifting, m/s.
    """

    price: float
    speed: float


def turning_of(vehicle: Vehicle, *, turned: float = 0.5, fast: float = 0.12) -> Turning | None:
    """Return the turning parameters of a boat steered at its hand point; None for a vehicle that can back.

    Args:
        vehicle: The vehicle.
        turned: Fraction of its largest yaw moment at which the price in surge is taken.
        fast: Fraction of its speed ahead above which it turns round under way.
    """
    if YAW not in vehicle.controlled_rows or vehicle.steering.attitude or not is_one_sided(vehicle):
        return None
    ahead, astern = (largest_wrench(vehicle, SURGE, sign, []) for sign in (1.0, -1.0))
    if not ahead > 0.0 or astern >= WEAK_SIDE * ahead:
        return None
    prices = []
    for sign in (1.0, -1.0):
        moment = turned * largest_wrench(vehicle, YAW, sign, [SURGE])
        if np.isfinite(moment) and moment > 0.0:
            A = np.column_stack([vehicle.W[[SURGE, YAW]], [-1.0, 0.0]])  # of the smallest surge that comes with it
            cost = np.append(np.zeros(vehicle.W.shape[1]), 1.0)
            prices.append(vehicle.solve_for_efforts(A, np.array([0.0, sign * moment]), cost) / moment)
    speed = fast * vehicle.capability.forward_speed
    return Turning(max(prices, default=0.0), speed if np.isfinite(speed) else 0.0)


def largest_wrench(vehicle: Vehicle, row: int, sign: float, free: list[int]) -> float:
    """Compute the largest wrench along a row in one direction, N or N m; other controlled rows are zero or `free`."""
    rows = [other for other in vehicle.controlled_rows if other not in free]
    along = np.zeros(6)
    along[row] = sign
    return vehicle.largest_along(rows, along, vehicle.W @ vehicle.steering.trim_effort(vehicle))


def hold_station(vehicle: Vehicle, heading: float, current: Array, wind: Array) -> tuple[float, Array, Array]:
    """Find how a vehicle on the surface holds station in current and wind.

    One with an attitude hold turns until that balances the moments of wind and water. A boat at its hand point turns
    until no force acts abeam. The force of the autopilot for a velocity v_c through the water is
    D v_c + Q |v_c| v_c + M k_v (v_c - v_r).

    Args:
        vehicle: The vehicle.
        heading: Heading that it holds, or from which it turns, rad.
        current: Velocity of the water, world axes, shape (2,) or more, m/s.
        wind: Velocity of the air, likewise.

    Returns:
        Its heading, to a degree, rad; the commanded velocity v_c, world axes, shape (2,), m/s; and its efforts.
    """
    pushed, _ = _push_at_station(vehicle, heading + _AROUND, current, wind)
    hold = 2.0 * vehicle.turning_inertia[2, 2] * vehicle.hold.frequency**2 * np.sin(0.5 * _AROUND)
    swing = pushed[2] - hold if vehicle.steering.attitude else -pushed[1]
    stable = _AROUND[1:][(swing[:-1] > 0.0) & (swing[1:] <= 0.0)]
    heading += float(stable[np.abs(stable).argmin()]) if len(stable) else 0.0
    pushed, (u, v) = _push_at_station(vehicle, np.array(heading), current, wind)
    X, Y, N = -pushed
    G = vehicle.moving_mass * vehicle.rate
    D, Q = np.append(vehicle.drag[:2], vehicle.angular_drag[2]), vehicle.quadratic_drag[[0, 1, 5]]
    ahead, port = solve_drag(D[:2] + G[:2], Q[:2], np.array([X - G[0] * u, Y - G[1] * v]))
    if not vehicle.steering.attitude:
        port = vehicle.steering.hand * solve_drag(D[2] + G[5], Q[2], N) - v
    c, s = math.cos(heading), math.sin(heading)
    command = np.array([c * ahead - s * port, s * ahead + c * port])
    return heading, command, vehicle.allocation @ [X, Y, 0.0, 0.0, 0.0, N]


def largest_wind(
    vehicle: Vehicle, heading: float, current: Array, wind: Array, limit: float, *, strongest: float = 200.0
) -> float:
    """Find the largest wind of a direction in which a vehicle on the surface holds station.

    It does if the velocity that it is commanded is within the limit, and its efforts within those of its actuators. A
    boat at its hand point must also turn into the wind while it drifts at any heading. So its actuators must balance
    the moments of wind and water there.

    Args:
        vehicle, heading, current: See `hold_station`.
        wind: Wind, which gives its direction.
        limit: Velocity limit, m/s.
        strongest: Strongest wind that is sought, m/s.

    Returns:
        The largest wind, m/s; infinite if it is beyond the strongest, or not known, as of boats with one-sided
        thrusters.
    """

    def room(speed: float) -> float:
        air = speed * wind / max(float(np.linalg.norm(wind)), 1e-9)
        _, command, effort = hold_station(vehicle, heading, current, air)
        efforts = [effort]
        if not vehicle.steering.attitude:
            (X, Y, N), _ = _push_at_station(vehicle, _AROUND, 0.0 * current, air)
            D, Q, A = vehicle.drag, vehicle.quadratic_drag, vehicle.added_mass
            moment = N - (A[1] - A[0]) * solve_drag(D[0], Q[0], X) * solve_drag(D[1], Q[1], Y)
            efforts += [sign * np.abs(moment).max() * vehicle.allocation[:, 5] for sign in (1.0, -1.0)]
        shares = [_share_within(vehicle, 0.0 * effort, effort) for effort in efforts]
        return min(*shares, limit / max(float(np.linalg.norm(command)), 1e-9), 2.0) - 1.0

    if is_one_sided(vehicle) or room(strongest) > 0.0:
        return float("inf")
    return float(scipy.optimize.bisect(room, 0.0, strongest, xtol=0.01)) if room(0.0) > 0.0 else 0.0


def leeway_of(vehicle: Vehicle, wind: Array) -> Array:
    """Return the velocity through the water of a hull without thrust that lies across a wind (3,), m/s.

    The wind is relative to the water. Y (W - v)^2 = D v + Q v^2 has this root.
    """
    W, Y = float(np.linalg.norm(wind)), vehicle.windage[1]
    speed = solve_drag(vehicle.drag[1] + 2.0 * Y * W, vehicle.quadratic_drag[1] - Y, Y * W * W)
    return np.asarray(wind * speed / max(W, 1e-9))


def _push_at_station(vehicle: Vehicle, heading: Array, current: Array, wind: Array) -> tuple[Array, Array]:
    """Return force ahead and to port, N, and yaw moment, N m, on a hull at rest at headings (...), shape (3, ...).

    Also return the velocity of the water in its axes, shape (2, ...), m/s.
    """
    c, s = np.cos(heading), np.sin(heading)
    (u, v), (a, b) = ((c * w[0] + s * w[1], c * w[1] - s * w[0]) for w in (current, wind))
    D, Q, A, (X, Y, N, _) = vehicle.drag, vehicle.quadratic_drag, vehicle.added_mass, vehicle.windage
    ahead = (D[0] + Q[0] * np.abs(u)) * u + X * np.hypot(a, b) * a
    port = (D[1] + Q[1] * np.abs(v)) * v + Y * np.hypot(a, b) * b
    return np.array([ahead, port, N * a * b - (A[1] - A[0]) * u * v]), np.array([u, v])  # with the Munk moment


class Effects(Section):
    """Physical effects of bodies; each can be switched off separately."""

    inertia: bool = Field(True, description="off: bodies are so light that m / D is massless_tau; no autopilot")
    drag_law: bool = Field(True, description="off: drag is linear, and no wind acts on hulls")
    limits: bool = Field(True, description="off: thrusters have no limits")
    lag: bool = Field(True, description="off: thrusters follow their commands without lag")
    underactuation: bool = Field(True, description="off: thrusters along every controlled axis")
    massless_tau: Duration = Field(0.02, description="m / D without inertia [s]")


def embody(vehicle: Vehicle, effects: Effects) -> Vehicle:
    """Return the vehicle with the given effects; see `Effects` and the module."""
    if not effects.underactuation and vehicle.steering.underactuated:
        vehicle = _fully_actuated(vehicle)
    if not effects.limits:
        free = [actuator.without_limits() for actuator in vehicle.actuators]
        vehicle = replace(vehicle, actuators=free, steering=vehicle.steering.without_limits())
    if not effects.lag:
        vehicle = replace(vehicle, actuators=[actuator.without_lag() for actuator in vehicle.actuators])
    if not effects.drag_law:
        vehicle = replace(vehicle, quadratic_drag=np.zeros(6), windage=np.zeros(4))
    if not effects.inertia:
        vehicle = _massless(vehicle, effects.massless_tau)
    return vehicle


def has_effects(vehicle: Vehicle) -> Effects:
    """Return the effects that a vehicle has; switching off another one changes nothing."""
    return Effects(
        inertia=vehicle.rate > 0.0 or bool(vehicle.added_mass.any()),
        drag_law=bool(vehicle.quadratic_drag.any() or vehicle.windage.any()),
        limits=bool(np.isfinite(vehicle.limits).any()),
        lag=vehicle.lag > 0.0,
        underactuation=vehicle.steering.underactuated,
    )


def _massless(vehicle: Vehicle, tau: float) -> Vehicle:
    """Shrink the mass; ballast compensates for the model's lower weight."""
    own = vehicle.mass / vehicle.drag[: vehicle.dimension]  # added mass is removed
    scale = min(1.0, tau / float(own.max()))
    inertials = [x._replace(mass=x.mass * scale, diagonal=x.diagonal * scale) for x in vehicle.inertials]
    # Angular drag shrinks with the inertia, so that the attitude hold stays the same. Exceptions keep their drag: roll
    # and pitch of a boat, which follow from its restoring moments, and yaw at a hand point, a controlled velocity.
    turning, axes = np.ones(3), [row - 3 for row in vehicle.controlled_rows if row > 2 and vehicle.steering.attitude]
    turning[axes] = (scale * np.diag(vehicle.inertia) / vehicle.moving_mass[3:])[axes]
    return replace(
        vehicle,
        angular_drag=vehicle.angular_drag * turning,
        quadratic_drag=vehicle.quadratic_drag * np.concatenate([np.ones(3), turning]),
        mass=vehicle.mass * scale,
        ballast=vehicle.ballast + (1.0 - scale) * vehicle.weight,
        weight_moment=vehicle.weight_moment * scale,
        inertia=vehicle.inertia * scale,
        inertials=inertials,
        added_mass=np.zeros(6),
        rate=0.0,
    )


def _fully_actuated(vehicle: Vehicle) -> Vehicle:
    """Give a vehicle thrusters along every controlled axis, as strong as its own together and as slow as their mean."""
    low, high = np.minimum(vehicle.effort_bounds[:, 0], 0.0), vehicle.effort_bounds[:, 1]
    used = vehicle.W != 0.0  # a thruster without limits has no effect along an axis where it has no wrench
    reach = np.where(vehicle.W > 0.0, high, low) * np.where(used, vehicle.W, 1.0)
    strongest = np.where(used, reach, 0.0).sum(axis=1)
    force, steering = strongest[:3].max(), Full()
    actuators: list[Thruster] = []
    for row in steering.rows[vehicle.dimension]:
        bound = force if row < 3 else strongest[row]
        limits = (-bound, bound) if np.isfinite(bound) and bound > 0.0 else None
        law, name = "filterexact" if vehicle.lag > 0.0 else "none", f"virtual_{ROW_NAMES[row].replace(' ', '_')}"
        actuators.append(Thruster(name, np.eye(6)[row], ctrl=limits, law=law, time_constant=vehicle.lag))
    return replace(vehicle, steering=steering, actuators=actuators)


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
    """Find the demands of a multirotor's description that exceed its actuators, the most serious first.

    Turning: at a lean of theta_max the attitude loop commands an angular acceleration of omega^2 theta_max, which few
    vehicles have. They need far less. With saturated moments, the actuators switch between angular accelerations of +a
    and -a, and the loop through the lean has a limit cycle, by the describing function of a relay:

        amplitude  A = 4 a / (pi y),  y = Omega^2 the positive root of  T y^2 + (T d^2 - k_v) y - k_1 (k_v + d) d = 0

    with T = 2 zeta / omega - lag the lead of the attitude loop, k_v the rate of the autopilot, d = D / m, and k_1 =
    (k_v + d) / 4 for the law around it. (Without d, Omega^2 = k_v / T.) It is unstable: smaller oscillations decay,
    larger ones grow until the vehicle turns over. So a vehicle needs a = pi y theta_max / 4; then no commanded lean is
    beyond A. In 84 simulated missions of drones of 25 kinds (omega 5 to 40 rad/s, lean 10 to 60 degrees,
    k_v 0 to 6 1/s, zeta 0.5 to 1.5, lag 0 to 0.07 s, D / m 0.04 to 2 1/s) that follow a moving target, the largest a
    with which the drone falls is 0.13 to 0.93 times that with an autopilot and 0.24 to 1.5 times without one; in 75
    it is 0.25 to 1 times. So a vehicle with less than a quarter falls. With more, it depends on the leans of the
    mission. The available acceleration is the fraction of a turn for which the allocation stays within the limits of
    the actuators while they carry the weight. Attitude loops that are unstable because of lag alone (T <= 0) are not
    covered; the analysis of the linear loop reports them.

    Thrust: a lean of theta_max at constant height requires weight / cos(theta_max). A vehicle with less leans less and
    is slower, but does not fall, because its force is scaled to its thrust.

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
            f"degrees command up to {asked:.3g} and need {needed:.3g} rad/s^2: {outcome}"
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
    return min(_share_within(vehicle, trim, sign * step) for sign in (1.0, -1.0))


def _share_within(vehicle: Vehicle, efforts: Array, step: Array) -> float:
    """Return the largest s >= 0 for which efforts + s step, shape (s,) each, are within limits; may be infinite."""
    planes, heights = vehicle.half_planes
    low, high = vehicle.effort_bounds.T
    room = np.concatenate([high - efforts, efforts - low, heights - planes @ efforts])
    rate = np.concatenate([step, -step, planes @ step])
    return max(float(np.divide(room, rate, out=np.full(len(room), np.inf), where=rate > 0.0).min(initial=np.inf)), 0.0)
