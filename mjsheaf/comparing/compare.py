"""The whole comparison: ladder, budgets, ringing, convergence, demands and a verdict, as one record."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Literal

import numpy as np

from mjsheaf._version import __version__
from mjsheaf.checking.cohomology import spectrum_of
from mjsheaf.checking.finished import Ending, ending_of, settling_time
from mjsheaf.checking.margins import body_loop, mean_medium
from mjsheaf.comparing import record as records
from mjsheaf.comparing.convergence import Convergence, converge
from mjsheaf.comparing.demands import VelocityLimit, demands_of, examine_limit, fastest_vehicles
from mjsheaf.comparing.ladder import Run, Rung, climb, ladder_of
from mjsheaf.comparing.measures import (
    CENTERING,
    FORMATION,
    TEAM,
    TRACKING,
    Distance,
    Series,
    distance_between,
    formation_size,
    late,
    positions_at_q_star,
    root_mean_square,
    saturation_shares,
    series_of,
)
from mjsheaf.comparing.ringing import Ringing, ringing_of, usable_gain
from mjsheaf.comparing.verdict import budget_of, verdict_of
from mjsheaf.results.metrics import evaluate_errors
from mjsheaf.scenario import Scenario
from mjsheaf.simulation.run import require_simulable
from mjsheaf.system import System

Progress = Callable[[str, int, int], None]
Statistic = Literal["late", "final"]

_DOMAIN: dict[int, Literal["the plane", "space"]] = {2: "the plane", 3: "space"}


@dataclass(frozen=True)
class Comparison:
    """A comparison and the runs that it stands on.

    Attributes:
        record: what compare.json holds.
        runs: of the rungs, by key.
    """

    record: records.CompareRecord
    runs: dict[str, Run]


def compare(scenario: Scenario, progress: Progress | None = None) -> Comparison:
    """Compare a scenario's ideal kinematics with its bodies.

    Args:
        scenario: from `load_scenario`.
        progress: called with (what is being done, done, in all).

    Raises:
        InputError: a vehicle that does not fit its agent, or a g that is not of full row rank.
        NotUniqueError: the harmonic extension is not unique.
    """
    begun = time.perf_counter()
    system = scenario.system
    require_simulable(system, "physics")
    ladder = ladder_of(system)
    runs = climb(system, ladder, progress)
    grid = system.grid
    middle = grid.start + 0.5 * grid.period * grid.steps
    limit = examine_limit(system, runs)
    convergence = converge(system, progress)
    if progress:
        progress("letting go", 0, 1)
    ringing = ringing_of(system)
    if progress:
        progress("letting go", 1, 1)
    loop = _loop(system, runs["ideal"])
    rungs = [_rung(rung, runs[rung.key], runs["ideal"], middle) for rung in ladder]
    parts = {
        "mjsheaf_version": __version__,
        "scenario": scenario.name,
        "seed": scenario.seed,
        "gain": system.gain,
        "usable_gain": _least(usable_gain(system, ringing), loop.largest_gain if loop else None),
        "loop": loop,
        "time_s": grid.period * grid.steps,
        "formation_size_m": _plain(formation_size(system)),
        "ladder": rungs,
        "budgets": _budgets(ladder, rungs, _errors_at_q_star(runs["ideal"])),
        "ringing": None if ringing is None else _ringing(ringing),
        "convergence": _convergence(convergence),
        "velocity_limit": None if limit is None else _velocity_limit(limit),
        "demands": [d for key in ("ideal", "all") for d in _demands(system, runs[key], middle)],
        "fastest": [
            records.FastestRecord(moves_in=_DOMAIN[f.dimension], vehicle=f.vehicle, speed_m_s=f.speed)
            for f in fastest_vehicles(system)
        ],
    }
    draft = records.CompareRecord(**parts, verdict=[], wall_time_s=time.perf_counter() - begun, video=None)
    return Comparison(draft.model_copy(update={"verdict": verdict_of(draft)}), runs)


def _rung(rung: Rung, run: Run, ideal: Run, middle: float) -> records.RungRecord:
    start, team = run.system.grid.start, run.series[TEAM]
    telling = team.tracking_error if np.isnan(team.formation_error).all() else team.formation_error
    bodies = rung.setup.agents or rung.setup.targets
    ending = _ending(run) if run.finished else None
    return records.RungRecord(
        key=rung.key,
        label=rung.label,
        kind=rung.kind,
        effect=rung.effect,
        status=run.trajectory.status,
        message=run.trajectory.message,
        timestep_s=run.system.bodies.timestep if bodies else None,
        errors=_errors(run, run.series),
        ending=ending,
        settling_time_s=settling_time(run.trajectory.time, telling) if ending == "settled" else None,
        distance=_distance(distance_between(run.system, run.trajectory, ideal.trajectory, start)),
        distance_late=_distance(distance_between(run.system, run.trajectory, ideal.trajectory, middle)),
        saturation=_saturation(run),
    )


def _ending(run: Run) -> Ending | None:
    q_star = positions_at_q_star(run.system, run.trajectory.positions)
    N = len(run.system.team.agents)
    time, positions = run.trajectory.time, run.trajectory.positions[:, :N]
    return ending_of(run.system, time, q_star[:, :N], positions, on_bodies=run.rung.setup.agents)


def _loop(system: System, ideal: Run) -> records.LoopRecord | None:
    """The loop of the scenario's bodies in the mean flow along the ideal run."""
    if not ideal.finished:
        return None
    path, _ = system.team.split(positions_at_q_star(system, ideal.trajectory.positions))
    found = body_loop(system, spectrum_of(system.team), mean_medium(system, ideal.trajectory.time, path))
    return records.LoopRecord(stable=found.stable, largest_gain=found.largest_gain, reason=found.reason)


def _errors_at_q_star(ideal: Run) -> dict[str, records.ScopeRecord]:
    """Errors by scope with the agents at q* along the ideal run."""
    system, placed = ideal.system, ideal.trajectory.positions
    if ideal.finished:  # elsewhere errors are null, and positions may not be finite
        placed = positions_at_q_star(system, placed)
    return _errors(ideal, series_of(system, evaluate_errors(system.team, placed)))


def _errors(run: Run, series_by_scope: dict[str, Series]) -> dict[str, records.ScopeRecord]:
    """Errors by scope; those of a run that blew up are null, as its last sample tells nothing."""
    chosen, found = late(run.system, run.trajectory.time), {}
    for scope, series in series_by_scope.items():
        values = {name: getattr(series, name) for name in (TRACKING, FORMATION, CENTERING)}
        found[scope] = records.ScopeRecord(
            final=records.ErrorsRecord(**{n: _plain(x[-1], run.finished) for n, x in values.items()}),
            late=records.ErrorsRecord(
                **{n: _plain(root_mean_square(x, chosen), run.finished) for n, x in values.items()}
            ),
        )
    return found


def _least(*gains: float | None) -> float | None:
    return min((gain for gain in gains if gain is not None), default=None)


def _distance(found: Distance | None) -> records.DistanceRecord | None:
    if found is None or not isfinite(found.largest):
        return None
    return records.DistanceRecord(distance_m=found.largest, agent=found.agent, time_s=found.time)


def _saturation(run: Run) -> list[records.SaturationRecord]:
    if not run.trajectory.log.saturation.size:
        return []
    setup = run.rung.setup
    present = {"agents": setup.agents, "targets": setup.targets}
    return [
        records.SaturationRecord(role=role, vehicle=vehicle, share=share)
        for (role, vehicle), share in saturation_shares(run.system, run.trajectory, run.thrusters).items()
        if present[role]
    ]


def _budgets(
    ladder: list[Rung], rungs: list[records.RungRecord], at_q_star: dict[str, records.ScopeRecord]
) -> list[records.BudgetRecord]:
    by_key, found = {rung.key: rung for rung in rungs}, []
    statistics: tuple[Statistic, ...] = ("late", "final")
    for scope in rungs[0].errors:
        for measure in (FORMATION, TRACKING):
            for statistic in statistics:

                def error(key: str, at: tuple[str, str, str] = (scope, statistic, measure)) -> float:
                    value = getattr(getattr(by_key[key].errors[at[0]], at[1]), at[2])
                    return float("nan") if value is None else value

                b = budget_of(ladder, error)
                found.append(
                    records.BudgetRecord(
                        scope=scope,
                        measure=measure,
                        statistic=statistic,
                        at_q_star_m=getattr(getattr(at_q_star[scope], statistic), measure),
                        ideal_m=b.ideal,
                        targets_m=b.targets,
                        agents_m=b.agents,
                        together_m=b.together,
                        effects=[
                            records.ItemRecord(effect=i.effect, alone_m=i.alone, give_back_m=i.give_back)
                            for i in b.items
                        ],
                        interaction_m=b.interaction,
                        all_m=b.whole,
                    )
                )
    return found


def _ringing(ringing: Ringing) -> records.RingingRecord:
    mode = ringing.mode
    return records.RingingRecord(
        agent=mode.who,
        predicted_damping_ratio=mode.damping,
        predicted_damping_ratio_held=ringing.held,
        predicted_frequency_rad_s=mode.frequency,
        predicted_overshoot=ringing.overshoot,
        overdamped=not mode.swings,
        measured=[
            records.ReleaseRecord(
                bodies=r.label,
                damping_ratio=r.damping,
                frequency_rad_s=r.frequency,
                overshoot=r.overshoot if isfinite(r.overshoot) else 0.0,
                amplitude_m=r.amplitude,
                saturation=r.saturated,
                status=r.status,
            )
            for r in ringing.releases
        ],
    )


def _velocity_limit(found: VelocityLimit) -> records.VelocityLimitRecord:
    keys: tuple[Literal["ideal", "all"], ...] = ("ideal", "all")
    return records.VelocityLimitRecord(
        lowest_m_s=found.lowest,
        highest_m_s=found.highest,
        asked_m_s=found.asked,
        who=found.who,
        runs=[
            records.UnlimitedRecord(
                run=key,
                share_at_limit=found.shares[key],
                status_without=found.without[key].trajectory.status,
                errors_without=_errors(found.without[key], found.without[key].series),
            )
            for key in keys
        ],
    )


def _convergence(found: Convergence) -> records.ConvergenceRecord:
    return records.ConvergenceRecord(
        points=[records.PointRecord(tau_s=p.tau, timestep_s=p.timestep, distance_m=p.distance) for p in found.points],
        start_s=found.start,
        end_s=found.end,
        slope=found.slope,
        constant=found.constant,
        reason=found.reason,
    )


def _demands(system: System, run: Run, start: float) -> list[records.DemandRecord]:
    """Demands of a run that has come to its end."""
    if not run.finished:
        return []
    found = []
    for d in demands_of(system, run.trajectory.time, run.trajectory.log.command, start):
        rest = {k: v for k, v in asdict(d).items() if k in ("role", "vehicle", "who", "share_beyond")}
        found.append(
            records.DemandRecord(
                run=run.rung.key,
                moves_in=_DOMAIN[d.dimension],
                asked_m_s=d.asked,
                time_s=d.time,
                least_speed_m_s=_plain(d.least_speed),
                forward_speed_m_s=_plain(d.forward_speed),
                **rest,
            )
        )
    return found


def _plain(value: float | np.floating, meant: bool = True) -> float | None:
    return float(value) if meant and isfinite(value) else None
