"""`check`: analyse a scenario, and try it."""

import math
from collections.abc import Callable
from functools import partial
from html import escape
from typing import Any

from mjsheaf.arguments import require_scenario
from mjsheaf.checking.examination import examine_scenario
from mjsheaf.checking.loop.prediction import WIND_ON_TARGETS
from mjsheaf.checking.problems import describe_changes, untried_of
from mjsheaf.checking.record import CheckRecord, Problem, TriedFix
from mjsheaf.checking.report import screen
from mjsheaf.checking.theorem.theorem import RhoLike, as_rho
from mjsheaf.checking.trial import MAX_VEHICLE_STEPS, TrialRecord, try_mission
from mjsheaf.errors import InputError
from mjsheaf.progress import shown
from mjsheaf.scenario import Scenario, scenario_from_mapping


class Answer(dict[str, Any]):
    """The record of a check as a mapping, as `mjsheaf check --json` prints it; it prints as the screen does."""

    def __init__(self, record: CheckRecord) -> None:

        super().__init__(record.model_dump(mode="json"))
        self._lines = screen(record)

    def __repr__(self) -> str:
        return "\n".join(self._lines)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"


def check(
    scenario: Scenario,
    *,
    rate: float | None = None,
    radius: float = 1.0,
    rho: RhoLike | None = None,
    trial: bool = True,
    progress: bool | None = True,
) -> Answer:
    """Check a scenario: the paper's assumptions, Theorem 1, margins, fragility, and a trial of the mission.

    Args:
        scenario: Scenario returned by `load_scenario`.
        rate: Rate lambda_V, 1/s; None selects the best.
        radius: Desired ultimate radius of |e|, m; the smallest gain and other laws that reach it are reported.
        rho: |f_q(q*) - f_q(q)| <= rho(|e|) |e|, as the caller claims: a number, coefficients c_0, c_1, ... of a
            polynomial, pairs (radius, value) or a function; None takes the flow's largest slope over the region.
        trial: True to run the mission once on bodies at the end, False to analyse it only.
        progress: True shows a bar on a terminal or in a notebook, False and None nothing.

    Returns:
        The record that `mjsheaf check --json` prints, a mapping whose schema is that of `CheckRecord`. It prints, also
        in a notebook, as what `mjsheaf check` prints.

    Raises:
        InputError: rate or radius is not positive, rho is no bound, or a vehicle does not fit its agent.
    """
    require_scenario(scenario)
    own = None if rho is None else as_rho(rho)
    with shown(progress, "checking") as bar:
        record = examine_scenario(scenario, rate=rate, radius=radius, rho=own).record
        if not trial:
            return Answer(untried(record))
        return Answer(try_out(record, scenario, partial(bar, "trying the mission") if bar else None))


def untried(record: CheckRecord) -> CheckRecord:
    """Return the record of an analysis that no trial follows: what only a trial could decide is a problem."""
    problems = [*record.problems, *untried_of(record)]
    return record.model_copy(update={"problems": problems, "ok": not problems})


def try_out(
    record: CheckRecord,
    scenario: Scenario,
    progress: Callable[[int, int], None] | None = None,
    *,
    fixes: int = 3,
) -> CheckRecord:
    """Return the record of a scenario's analysis with a trial of the mission, and of the fixes that it proposes.

    Args:
        record: Record of the analysis.
        scenario: The scenario.
        progress: Called with the samples done and the number of samples.
        fixes: Largest number of fixes that are tried.
    """
    trial = try_mission(scenario, foreseen_error(record), progress)
    notes = list(record.notes)
    if scenario.expect.controller is not None:
        notes.append(f"expectations are for the law {scenario.expect.controller}, and the trial ran the scenario's own")
    grid = scenario.whole.grid
    steps = len(scenario.team.members) * grid.steps * round(grid.period / scenario.whole.bodies.timestep)
    left = min(fixes, MAX_VEHICLE_STEPS // max(steps, 1))
    problems = []
    for problem in record.problems:
        if problem.kind == "room" and not problem.changes:
            changes = _limit_for_room(record, scenario)
        else:
            changes = _with_own_limits(problem.changes, scenario)
        if changes != problem.changes:
            problem = problem.model_copy(update={"fix": describe_changes(changes), "changes": changes})
        if left > 0 and (problem.changes or problem.additions):
            left -= 1
            problem = problem.model_copy(update={"tried": _try_fix(scenario, problem, trial, progress)})
        problems.append(problem)
    update = {"trial": trial, "problems": problems, "notes": notes, "ok": record.ok and trial.ok}
    return record.model_copy(update=update)


def _with_own_limits(changes: dict[str, Any], scenario: Scenario) -> dict[str, Any]:
    """Return changes of fields that also set the velocity limits that agents have of their own."""
    limit = changes.get("controller.velocity_limit")
    owners = [agent.id for agent in scenario.agents if agent.velocity_limit is not None]
    if limit is None or not owners:
        return changes
    changes = changes | {f"agents.{id}.velocity_limit": limit for id in owners}
    if len(owners) == len(scenario.agents):
        del changes["controller.velocity_limit"]
    return changes


def _limit_for_room(
    record: CheckRecord, scenario: Scenario, *, spare: float = 1.5, reserve: float = 0.5
) -> dict[str, Any]:
    """Find a velocity limit, and a rate if necessary, with which the safety filter leaves room for the formation.

    The stopping distance of vehicles grows with their speed. The limit is `spare` times the speed of q* and `reserve`,
    m/s, more.

    Returns:
        Changes of fields; none if the formation does not fit even then.
    """
    demanded = [demand.steady for demand in record.margins.speed if demand.steady is not None]
    if not demanded:
        return {}
    limit = float(f"{spare * max(demanded) + reserve:.2g}")
    changes = _with_own_limits({"controller.velocity_limit": limit}, scenario)
    fields = scenario.model_dump(mode="json", exclude_none=True)
    try:
        left = examine_scenario(scenario_from_mapping(fields, changes)).record.problems
    except InputError:
        return {}
    room = [problem for problem in left if problem.kind == "room"]
    if any(problem.kind == "unsafe" for problem in left) or not all(problem.changes for problem in room):
        return {}
    return changes | (room[0].changes if room else {})


def _try_fix(
    scenario: Scenario, problem: Problem, trial: TrialRecord, progress: Callable[[int, int], None] | None
) -> TriedFix:
    """Try the mission with a fix; an anchor holds its agent at the coordinate with which it begins."""
    fields = scenario.model_dump(mode="json", exclude_none=True, exclude={"expect"})  # that is about the unchanged one
    places = dict(zip(scenario.team.index, scenario.system.initial.tolist(), strict=True))
    for kind, entries in problem.additions.items():
        own = fields.setdefault(kind, [])
        for entry in entries:
            anchored = {"value": [places[entry["agent"]]["xyz".index(entry["axes"][0])]]} if kind == "anchors" else {}
            own.append({**entry, **anchored} if isinstance(entry, dict) else entry)
    try:
        mended = try_mission(scenario_from_mapping(fields, problem.changes), None, progress)
    except InputError as error:
        return TriedFix(ok=False, tracking_error=None, without=trial.tracking_error, problem=str(error))
    return TriedFix(
        ok=mended.ok,
        tracking_error=mended.tracking_error,
        without=trial.tracking_error,
        problem=mended.problems[0].text if mended.problems else "",
    )


def foreseen_error(record: CheckRecord) -> float | None:
    """Return the error that the analysis foresees, RMS over agents, m; None if it is not known, as with events.

    It is that on ideal kinematics if it is not known on the vehicles.
    """
    unknown = WIND_ON_TARGETS in record.steady.leaves_out or (record.margins.wind and record.steady.bodies is None)
    if len(record.phases) > 1 or unknown:
        return None
    steady, moved = record.steady, record.disturbance
    parts = [
        steady.ideal if steady.bodies is None else steady.bodies,
        moved.rms if moved.rms_on_bodies is None else moved.rms_on_bodies,
    ]
    if record.links is not None and record.links.noise is not None:
        parts.append(record.links.noise.error_per_agent)
    known = [part for part in parts if part is not None]
    return math.hypot(*known) if len(known) == len(parts) else None
