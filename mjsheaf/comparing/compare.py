"""The whole comparison: ladder, budgets, ringing, convergence, demands and a verdict, as one record."""

from dataclasses import dataclass

from mjsheaf._version import __version__
from mjsheaf.checking.body_loop import loop_along
from mjsheaf.comparing.convergence import converge
from mjsheaf.comparing.demands import JUDGED, demands_of, examine_limit, fastest_vehicles
from mjsheaf.comparing.ladder import Run, ladder_of, run_ablation
from mjsheaf.comparing.measures import budgets_of, error_series, errors_by_scope, formation_size, positions_at_q_star
from mjsheaf.comparing.ringing import ringing_of, usable_gain
from mjsheaf.comparing.verdict import CompareRecord, LoopRecord, verdict_of
from mjsheaf.errors import InputError
from mjsheaf.jit import working_time
from mjsheaf.results import make_dataset
from mjsheaf.runs.harm import examine_terms
from mjsheaf.runs.simulate import Progress, moved_by, no_progress, require_simulable
from mjsheaf.scenario import Scenario
from mjsheaf.system import System


@dataclass(frozen=True)
class Comparison:
    """A comparison, as compare.json holds it, and the runs of its ladder by key."""

    record: CompareRecord
    runs: dict[str, Run]


def compare(
    scenario: Scenario, progress: Progress = no_progress, *, engine: str = "mujoco", threads: int | None = None
) -> Comparison:
    """Compare a scenario's ideal kinematics with its bodies.

    Args:
        scenario: from `load_scenario`.
        progress: called with (what is being done, done, in all).
        engine, threads: that move bodies; see `simulate`. Beside another engine's runs is MuJoCo's of the scenario as
            it stands.

    Raises:
        InputError: an engine that lacks what the scenario asks for, a vehicle that does not fit its agent, a g that is
            not of full row rank, or events.
        NotUniqueError: the harmonic extension is not unique.
    """
    if scenario.events:
        raise InputError(
            "events: a comparison is of one team; expected none, as with --set events=[]; of a run with events, "
            "`mjsheaf expect` shows the errors of both backends at the end of each phase"
        )
    begun = working_time()
    (phase,) = moved_by(scenario.phases, "physics", engine, threads)
    system = phase.system
    require_simulable(system, "physics")
    runs = run_ablation(system, ladder_of(system), progress)
    ideal = runs["ideal"]
    at_q_star = error_series(ideal.system, positions_at_q_star(ideal.system, ideal.trajectory.positions))
    limit = examine_limit(system, runs)
    convergence = converge(system, progress)
    progress("free-decay test", 0, 1)
    ringing = ringing_of(system)
    progress("free-decay test", 1, 1)
    loop = _loop(system, ideal)
    gains = [usable_gain(system, ringing), loop.largest_gain if loop else None]
    draft = CompareRecord(
        mjsheaf_version=__version__,
        scenario=scenario.name,
        seed=scenario.seed,
        gain=system.gain,
        terms=list(system.law.terms.names),
        harm=_harm(system, runs["all"], scenario.seed),
        usable_gain=min((gain for gain in gains if gain is not None), default=None),
        loop=loop,
        time_s=system.grid.period * system.grid.steps,
        formation_size_m=formation_size(system),
        ladder=[run.record(ideal) for run in runs.values()],
        budgets=budgets_of(
            {key: run.errors for key, run in runs.items()}, errors_by_scope(ideal.trajectory, at_q_star)
        ),
        ringing=ringing,
        convergence=convergence,
        velocity_limit=limit,
        demands=[demand for key in JUDGED for demand in demands_of(system, key, runs[key])],
        fastest=fastest_vehicles(system),
        verdict=[],
        wall_time_s=working_time() - begun,
        video=None,
    )
    return Comparison(draft.model_copy(update={"verdict": verdict_of(draft)}), runs)


def _loop(system: System, ideal: Run) -> LoopRecord | None:
    """The loop of the scenario's bodies in the mean flow along the ideal run."""
    if not ideal.finished:
        return None
    found = loop_along(system, ideal.trajectory.time, system.team.harmonic_extension(ideal.trajectory.positions))
    return LoopRecord(stable=found.stable, largest_gain=found.largest_gain, reason=found.reason)


def _harm(system: System, run: Run, seed: int) -> list[str]:
    """What the terms of the law do wrong in the run of the scenario as it stands."""
    if not system.law.terms.agents:
        return []
    found = examine_terms(system, make_dataset(run.trajectory, "physics", seed))
    return list(found.harm) if found else []
