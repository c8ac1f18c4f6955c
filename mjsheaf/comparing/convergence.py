"""Bodies whose time constant shrinks: their distance to the ideal run is of first order in it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mjsheaf.comparing.ladder import inertial_tau
from mjsheaf.comparing.measures import distance_between, positions_at_q_star
from mjsheaf.simulation.ideal import run_ideal
from mjsheaf.simulation.loop import run_physics
from mjsheaf.system import System
from mjsheaf.vehicles.effects import Effects

_COUNT, _RATIO = 4, 2.0
_SHARE_OF_OWN, _SHARE_OF_LAW = 0.5, 0.25
_STEPS_PER_TAU = 10
_SPAN = 6.0  # s; runs at short steps cost
_JUMP = 10.0  # time constants over which bodies catch up with the flow
_SHORTEST_STEP = 1e-5  # s


@dataclass(frozen=True)
class Point:
    """One time constant.

    Attributes:
        tau: of every vehicle, s.
        timestep: of the physics, s.
        distance: sup over agents and over the span of the distance to the ideal run, m; None where it blew up.
    """

    tau: float
    timestep: float
    distance: float | None


@dataclass(frozen=True)
class Convergence:
    """Distance to the ideal run against the time constant; theory says that it is of first order.

    Attributes:
        points: the largest tau first.
        start, end: span over which the distance is taken, s.
        slope: of log distance against log tau, by least squares; None with fewer than two points.
        constant: distance / tau on the fitted line at tau = 1 s, m/s^slope; None likewise.
        reason: why there is none, or empty.
    """

    points: list[Point]
    start: float
    end: float
    slope: float | None
    constant: float | None
    reason: str


def converge(system: System, progress: Callable[[str, int, int], None] | None = None) -> Convergence:
    """Run bodies with inertia as their only effect, at time constants halved from one to the next.

    Agents start at q*, in the scenario's flow and behind its targets: from anywhere else the law's first command is a
    jump, whose kick lets boats pitch and roll however small tau is.

    The largest is half of the quickest vehicle's own, and at most a quarter of the time 1 / (k1 lambda_max) in which
    the law's fastest mode moves: beyond that, first order has not begun. Underactuated vehicles have thrusters along
    every axis. The timestep is at most a tenth of tau, and a whole number of them makes a period.

    Args:
        system: the scenario's system.
        progress: called with ('converging', runs done, runs in all).
    """
    system = _at_rest_in_place(_with_inertia(system, None))
    grid, own = system.grid, min(float(inertial_tau(v).min()) for v in system.vehicles)
    fastest = system.gain * system.largest_eigenvalue
    largest = min(_SHARE_OF_OWN * own, _SHARE_OF_LAW / fastest if fastest > 0.0 else np.inf)
    start = grid.start + _JUMP * largest
    steps = min(grid.steps, int(np.ceil((_JUMP * largest + _SPAN) / grid.period)))
    end = grid.start + steps * grid.period
    smallest = largest / _RATIO ** (_COUNT - 1) / _STEPS_PER_TAU
    if smallest < _SHORTEST_STEP:
        reason = f"it would take timesteps of {smallest:.2g} s, as bodies or law are so fast"
        return Convergence([], start, end, None, None, reason)
    system = replace(system, grid=replace(grid, steps=steps))
    ideal = run_ideal(system)
    if ideal.status != "finished" or end <= start:
        return Convergence([], start, end, None, None, ideal.message or "the run is too short")
    points = []
    for k in range(_COUNT):
        if progress:
            progress("converging", k, _COUNT)
        tau = largest / _RATIO**k
        timestep = grid.period / np.ceil(grid.period / min(tau / _STEPS_PER_TAU, system.bodies.timestep) - 1e-9)
        here = _with_inertia(system, tau)
        run = run_physics(replace(here, bodies=replace(here.bodies, timestep=float(timestep))))
        apart = distance_between(here, run, ideal, start) if run.status == "finished" else None
        points.append(Point(tau, float(timestep), apart.largest if apart else None))
    if progress:
        progress("converging", _COUNT, _COUNT)
    return Convergence(points, start, end, *_fit(points), reason="")


def _at_rest_in_place(system: System) -> System:
    """The system with its agents at q*."""
    return replace(system, initial=positions_at_q_star(system, system.initial))


def _with_inertia(system: System, tau: float | None) -> System:
    """The system on bodies whose only effect is inertia, with a time constant of their own unless given, s."""
    plan = system.bodies
    only = Effects(inertia=True, drag_law=False, limits=False, lag=False, underactuation=False)
    constant = plan.time_constant if tau is None else tau
    return replace(system, bodies=replace(plan, effects=only, time_constant=constant, contacts=False))


def _fit(points: list[Point]) -> tuple[float | None, float | None]:
    """Slope and constant of the line through the logarithms."""
    known = [(p.tau, p.distance) for p in points if p.distance]
    if len(known) < 2:
        return None, None
    tau, distance = np.log(np.array(known)).T
    slope, constant = np.polyfit(tau, distance, 1)
    return float(slope), float(np.exp(constant))
