"""Bodies with a shrinking time constant: their distance to the ideal run is of first order in it."""

from dataclasses import replace

import numpy as np
from pydantic import Field

from mjsheaf.comparing.measures import positions_at_q_star
from mjsheaf.comparing.variants import inertial_tau, without_links, without_terms
from mjsheaf.loop.engine import Trajectory
from mjsheaf.loop.session import engine_of
from mjsheaf.loop.system import System
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.section import FiniteRecord
from mjsheaf.vehicles.effects import Effects

_COUNT, _RATIO = 4, 2.0
_SHARE_OF_OWN, _SHARE_OF_LAW = 0.5, 0.25
_STEPS_PER_TAU = 10


class PointRecord(FiniteRecord):
    """Bodies with one time constant tau."""

    tau_s: float
    timestep_s: float
    distance_m: float | None


class ConvergenceRecord(FiniteRecord):
    """Largest distance to the ideal run, both from q*, against the time constant tau of all bodies.

    Both runs are under the paper's law alone and over perfect links, which are what the theory covers: terms and
    sensors respond differently to bodies and to ideal kinematics.
    """

    points: list[PointRecord]
    start_s: float
    end_s: float
    slope: float | None = Field(description="least-squares slope on log-log axes; theory: 1")
    constant: float | None = Field(description="distance = constant tau^slope, m and s")
    reason: str = Field(description="why there is no slope, or empty")


def converge(
    system: System,
    progress: Progress = no_progress,
    *,
    span: float = 6.0,  # s; runs at short steps cost
    catch_up: float = 10.0,  # time constants over which bodies catch up with the flow
    shortest: float = 1e-5,  # s
) -> ConvergenceRecord:
    """Run bodies with inertia as their only effect, at time constants halved from one to the next.

    Agents start at q*, in the scenario's flow and following its targets. From anywhere else the law's first command
    would be a jump, which makes boats pitch and roll however small tau is.

    The largest time constant is half of the quickest vehicle's, and at most a quarter of 1 / (k1 lambda_max), the time
    constant of the law's fastest mode; above that, the distance is not yet of first order. Underactuated vehicles get
    thrusters along every axis. The timestep is at most a tenth of tau, and divides the period.
    """
    system = _with_inertia(replace(system, initial=positions_at_q_star(system, system.initial[None])[0]), None)
    grid = system.grid
    largest = _SHARE_OF_OWN * min(float(inertial_tau(v).min()) for v in system.vehicles)
    fastest = system.gain * system.largest_eigenvalue
    if fastest > 0.0:
        largest = min(largest, _SHARE_OF_LAW / fastest)
    start = grid.start + catch_up * largest
    steps = min(grid.steps, int(np.ceil((catch_up * largest + span) / grid.period)))
    end = grid.start + steps * grid.period
    taus = [largest / _RATIO**k for k in range(_COUNT)]
    smallest = taus[-1] / _STEPS_PER_TAU
    if smallest < shortest:
        return _record(start, end, [], f"bodies or law are so fast that timesteps of {smallest:.2g} s would be needed")
    system = replace(system, grid=replace(grid, steps=steps))
    ideal = engine_of(system, "ideal").run()
    if ideal.status != "finished" or end <= start:
        return _record(start, end, [], ideal.message or "the run is too short")
    points = []
    for k, tau in enumerate(taus):
        progress("converging", k, _COUNT)
        points.append(_measure(system, ideal, tau, start))
    progress("converging", _COUNT, _COUNT)
    return _record(start, end, points)


def _measure(system: System, ideal: Trajectory, tau: float, start: float) -> PointRecord:
    """Measure the distance of bodies with one time constant, s, to the ideal run from a time on, s."""
    period = system.grid.period
    timestep = period / np.ceil(period / min(tau / _STEPS_PER_TAU, system.bodies.timestep) - 1e-9)
    here = _with_inertia(system, tau)
    run = engine_of(replace(here, bodies=replace(here.bodies, timestep=float(timestep)))).run()
    distance = None
    if run.status == "finished":
        apart = (run.positions - ideal.positions)[run.time >= start - 1e-9, : len(system.team.agents)]
        distance = float(np.linalg.norm(apart, axis=2).max())
    return PointRecord(tau_s=tau, timestep_s=timestep, distance_m=distance)


def _record(start: float, end: float, points: list[PointRecord], reason: str = "") -> ConvergenceRecord:
    """Fit the distances over time constants by a power law, if at least two of them are known."""
    slope = constant = None
    known = [(p.tau_s, p.distance_m) for p in points if p.distance_m]
    if len(known) >= 2:
        tau, distance = np.log(np.array(known)).T
        slope, intercept = np.polyfit(tau, distance, 1)
        constant = np.exp(intercept)
    return ConvergenceRecord(points=points, start_s=start, end_s=end, slope=slope, constant=constant, reason=reason)


def _with_inertia(system: System, tau: float | None) -> System:
    """Return the system under the paper's law over perfect links, on bodies with inertia alone.

    `tau` is their time constant, s; None keeps each vehicle's own.
    """
    plan = system.bodies
    only = Effects(inertia=True, drag_law=False, limits=False, lag=False, underactuation=False)
    constant = plan.time_constant if tau is None else tau
    return replace(
        without_links(without_terms(system)), bodies=replace(plan, effects=only, time_constant=constant, contacts=False)
    )
