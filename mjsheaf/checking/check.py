"""`check`: analyse a scenario, its phases one by one, without running it; then try it."""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from html import escape
from typing import Any

import numpy as np

from mjsheaf.arguments import require_number, require_scenario
from mjsheaf.arrays import Array
from mjsheaf.checking.loop.body_loop import loop_on_path, medium_on_path, with_bodies
from mjsheaf.checking.loop.held_law import envelope, law_loop, loop_of
from mjsheaf.checking.loop.links import link_answers
from mjsheaf.checking.loop.margins import margins
from mjsheaf.checking.loop.prediction import WIND_ON_TARGETS, predict_rms, steady_error
from mjsheaf.checking.record import (
    CheckRecord,
    ExplainedCohomology,
    PartRecord,
    PhaseRecord,
    Problem,
    Proposal,
    RegionSummary,
    TheoremSummary,
    TriedFix,
    WeakerBound,
    describe_changes,
    problems_of,
    untried_of,
)
from mjsheaf.checking.repairs import describe_edges, plan_augmentation, rigidity_of, suggest_edges
from mjsheaf.checking.report import screen
from mjsheaf.checking.separation import safety_record
from mjsheaf.checking.spectrum import fragility, held_eigenvalues
from mjsheaf.checking.theorem.certificate import (
    Certificate,
    Search,
    certificate_of,
    gain_for_wanted_radius,
    obstacle_of_team,
)
from mjsheaf.checking.theorem.targets import Carrier, targets_loop
from mjsheaf.checking.theorem.theorem import Rho, RhoLike, as_rho
from mjsheaf.checking.trial import MAX_VEHICLE_STEPS, TrialRecord, try_mission
from mjsheaf.errors import InputError, UndecidedError
from mjsheaf.law.terms import Drift, Feedforward, Newton, Odometry, Terms, pack_terms
from mjsheaf.loop.system import Phase, System, during, phases_of
from mjsheaf.progress import shown
from mjsheaf.scenario import Scenario, scenario_from_mapping
from mjsheaf.scenario.slips import drifts_of, slips_of
from mjsheaf.section import per_agent
from mjsheaf.threads import one_thread


@dataclass(frozen=True)
class Examination:
    """A check with its certificate and its system."""

    record: CheckRecord
    certificate: Certificate
    system: System

    @cached_property
    def end(self) -> float:
        """Smallest bound on |e| at the end of the system's time, m; infinite if there is none."""
        certificate, system = self.certificate, self.system
        found = [certificate.at_end(system.grid.period * system.grid.steps)]
        if not system.law.extended:
            with suppress(UndecidedError):
                bound = envelope(system, certificate)
                found += [] if bound.clipped else [float(bound.samples[-1])]
        return min(found) + _carried_error(system, certificate.constants.path.error)


def examine_scenario(
    scenario: Scenario, *, rate: float | None = None, radius: float = 1.0, rho: Rho | None = None
) -> Examination:
    """Examine a scenario; the record's notes name likely mistakes in its files."""
    examination = examine(scenario.phases, rate=rate, radius=radius, rho=rho)
    return replace(
        examination,
        record=examination.record.model_copy(update={"notes": slips_of(scenario), "drifts": drifts_of(scenario)}),
    )


@one_thread
def examine(
    run: System | Sequence[Phase], *, rate: float | None = None, radius: float = 1.0, rho: Rho | None = None
) -> Examination:
    """Analyse a system, or the phases of a run; return a typed record with the certificate of the first."""
    if rate is not None:
        require_number("rate", rate, positive=True)
    require_number("radius", radius, positive=True)
    phases = phases_of(run)
    first = before = _examine_one(during(phases, 0), rate, radius, rho)
    if len(phases) == 1 and not phases[0].events:
        return first
    records = [_phase_record(phases[0], first.record, None)]
    beyond = False  # True once a phase has terms, which Theorem 1 does not cover
    for k, phase in enumerate(phases[1:], 1):
        old = phases[k - 1].system
        new = phase.system
        path = before.certificate.constants.path
        targets = _targets_at(before.certificate, phase.start - phases[k - 1].start, phase.time)
        began = new.initial[: len(new.team.agents)]
        settled = old.team.harmonic_extension(np.concatenate([old.initial[: len(began)], targets]), phase.time)
        q_star = new.team.harmonic_extension(np.concatenate([began, targets]))
        jump = np.linalg.norm(q_star - settled, axis=1)
        jumps = {id: float(x) for id, x in zip(old.team.agent_ids, jump, strict=True) if np.isfinite(x)}
        # |q* - q| of each agent that joins; infinite if q is not known.
        away = np.linalg.norm(q_star - began, axis=1)
        joining = np.flatnonzero(new.team.present & ~old.team.present)
        stayed = [all(_stays(earlier.system, int(i)) for earlier in phases[:k]) for i in joining]
        beyond = beyond or bool(old.law.extended or before.record.law.unmodelled)
        known = new.law.extended or not beyond
        start = before.end + math.hypot(*jumps.values(), *away[joining]) if known and all(stayed) else math.inf
        # The previous team is assumed to have come to rest; joining vehicles are at their initial positions.
        system = during(phases, k, np.concatenate([np.where(np.isnan(settled), began, settled), targets]))
        before = _examine_one(system, rate, radius, rho, start + _carried_error(system, path.error))
        records.append(_phase_record(phase, before.record, jumps))
    problems = list(first.record.problems)
    for record in records[1:]:
        since = f"from {record.start:g} s on ({', '.join(record.events)})"
        for problem in record.problems:
            # Fields of the scenario are those of the first phase; in later ones, events have changed them.
            fix = f"from then on, {problem.fix}" if problem.fix else ""
            problems.append(
                problem.model_copy(
                    update={"what": f"{problem.what} {since}", "fix": fix, "changes": {}, "additions": {}}
                )
            )
    steady = first.record.steady
    if steady.ideal is not None:
        steady = steady.model_copy(
            update={"leaves_out": [*steady.leaves_out, f"the events from {records[1].start:g} s on"]}
        )
    return replace(
        first,
        record=first.record.model_copy(
            update={"ok": not problems, "problems": problems, "phases": records, "steady": steady}
        ),
    )


def _phase_record(phase: Phase, record: CheckRecord, jumps: dict[str, float] | None) -> PhaseRecord:
    """Return the record of a phase, at whose start q* of some agents jumps; None for the first phase."""
    return PhaseRecord(
        start=phase.time,
        events=list(phase.events),
        absent=sorted(phase.system.team.absent, key=phase.system.team.index.__getitem__),
        jump=None if jumps is None else math.hypot(*jumps.values()),
        jumps=jumps or {},
        **{name: getattr(record, name) for name in PartRecord.model_fields},
    )


def _targets_at(certificate: Certificate, sample: int, time: float) -> Array:
    """Return the targets' positions at a sample of the certificate's path, at a time in s: padded, shape (M, 3), m."""
    path = certificate.constants.path
    row, rest = divmod(sample, path.stride)
    if rest == 0 and row < len(path.samples):
        return path.samples[row]
    M = path.samples.shape[1]
    known = path.positions[:, path.positions.shape[1] - M :].reshape(len(path.time), 3 * M)
    return np.array([np.interp(time, path.time, values) for values in known.T]).reshape(M, 3)


def _stays(system: System, agent: int) -> bool:
    """Return True if an agent holds its position, on ideal kinematics, in a medium that cannot carry it off."""
    if system.waiting is None or not system.waiting.holds[agent] or system.effectiveness.given[agent]:
        return False
    place = system.initial[agent, : system.team.agents[agent].dimension]
    flow = float(np.linalg.norm(system.flows[system.field[agent]].velocity(place)))
    return flow + float(system.largest_disturbance[agent]) <= float(system.waiting.limit[agent])


def _carried_error(system: System, error: float) -> float:
    """Bound the error of q* of the present agents if the targets' positions are off by `error`, m."""
    system = system.local
    if not (error > 0.0 and system.team.dirichlet.unique):
        return 0.0
    return float(np.linalg.norm(Carrier(system).reach(np.full(len(system.team.targets), error))))


def _examine_one(
    system: System, rate: float | None, radius: float, rho: Rho | None, start: float | None = None
) -> Examination:
    """Analyse one phase, whose |e(t0)| is at most `start`, m; None uses that of the initial positions."""
    original = system.team.remaining
    system = system.local
    search = Search(system, rate, rho, start)
    certificate = certificate_of(search)
    path = certificate.constants.path
    region = certificate.region
    low, high = region.tube.corners()
    law = law_loop(system, certificate, carried=start is not None)
    mending = None if system.team.free or system.team.stressed else plan_augmentation(system.team, system.initial)
    edges = suggest_edges(system.team, system.initial)
    record = CheckRecord(
        scenario=system.name,
        ok=True,
        region=RegionSummary(
            source=region.source,
            verified=region.verified and not certificate.obstacle,
            agents_low=low.tolist(),
            agents_high=high.tolist(),
            start=float(path.time[0]),
            end=float(path.time[-1] if path.cells is None else path.cells.end[-1]),
            samples=len(path.time if path.cells is None else path.cells.begin),
            path_error=path.error,
        ),
        assumptions=certificate.assumptions,
        relative_cohomology=ExplainedCohomology(**dict(certificate.cohomology), mending=mending),
        rigidity=rigidity_of(system, original),
        safety=safety_record(system, certificate),
        theorem=_theorem(search, certificate, radius),
        law=law,
        links=link_answers(system, path),
        topology_fix=describe_edges(edges),
        topology_edges=edges,
        steady=steady_error(system, certificate, law.rate),
        proposals=propose(system, certificate, radius),
        targets=with_bodies(targets_loop(system), system, path),
        margins=margins(system, certificate),
        disturbance=predict_rms(system, search.spectrum, medium_on_path(system, path)),
        fragility=fragility(system.team),
    )
    stable = law.stable is True
    if system.grid.continuous and not (law.unmodelled or len(system.law.links.table)):
        with suppress(UndecidedError):
            stable = bool((held_eigenvalues(system.team).real > 0.0).all())
    problems = problems_of(record, stable=stable)
    record = record.model_copy(update={"ok": not problems, "problems": problems})
    return Examination(record, certificate, system)


def _theorem(search: Search, certificate: Certificate, radius: float) -> TheoremSummary:
    theorem = certificate.theorem
    spectrum = certificate.spectrum
    constants = certificate.constants
    agents = len(search.system.team.agents)
    holds = theorem.applies and certificate.region.verified
    weaker = certificate.weaker.radius if certificate.region.verified and not certificate.obstacle else None
    wanted_gain, no_gain = gain_for_wanted_radius(search, certificate, radius)
    slope = certificate.region.rho
    moving = constants.moving.slope
    rho = slope.upper + moving
    part = f"; {moving:.3g} 1/s of it is the slope of what moves in the medium" if moving else ""
    loose = "" if slope.exact else " (an upper bound, not tight)"
    source = f"largest norm of the Jacobian of the agents' field over their region, by branch and bound{part}{loose}"
    if search.rho is not None:
        rho = search.rho(constants.initial_error)
        source = "given by the user, here at the initial error"
    sets: dict[str, Any] = {
        "chi": theorem.chi,
        "chi_infinite": math.isinf(theorem.chi),
        "radius_D": theorem.chi,
        "radius_S": theorem.radius_S,
        "radius_U": theorem.radius,
        "radius_U_per_agent": per_agent(theorem.radius, agents),
        "initial_error_inside_S": theorem.contains(constants.initial_error),
    }
    return TheoremSummary(
        holds=None if obstacle_of_team(search.system.team) else certificate.applies,
        applies=certificate.applies,
        gain_condition=holds,
        approximate=certificate.approximate,
        reason=certificate.reason,
        gain=search.system.gain,
        lambda_min=spectrum.lambda_min,
        lambda_max=spectrum.lambda_max,
        sigma_max_B=spectrum.sigma_max_B,
        omega_bar=constants.moving.omega_bar,
        f_bar=constants.f_bar,
        rho=rho,
        rho_seen=slope.seen,
        rho_source=source,
        lambda_V=theorem.rate or None if holds or search.rate is not None else None,
        lambda_V_given=search.rate is not None,
        k_min=theorem.k_min,
        mu=theorem.mu,
        **(sets if holds else dict.fromkeys(sets)),
        initial_error=constants.initial_error,
        initial_error_per_agent=per_agent(constants.initial_error, agents),
        wanted_radius=radius,
        gain_for_wanted_radius=wanted_gain,
        gain_for_wanted_radius_reason=no_gain,
        weaker=WeakerBound(
            f_bar=certificate.weaker.f_bar if certificate.region.verified else None,
            radius=weaker,
            radius_per_agent=per_agent(weaker, agents),
        ),
    )


# -- a better law ------------------------------------------------------------------------------------------------------


def propose(
    system: System,
    certificate: Certificate,
    radius: float,
    *,
    gains: Sequence[float] = (1.0, 2.0, 5.0, 10.0),
    rounds: Sequence[int] = (1, 2, 3, 5, 8, 13),
    filtering: float = 0.1,
    most: int = 3_000_000,
) -> list[Proposal]:
    """Find the cheapest of each kind of law whose bound is at most the radius: the smallest gain, then fewest rounds.

    The kinds are the paper's law, then with feedforward, then also with Newton's direction, then also with drift and
    extrapolation. The list is empty if the law is undecided, if links are not exact, or if the run is long.

    Args:
        system: System under its law.
        certificate: Its certificate.
        radius: Desired bound on |e|, m.
        gains: Gains that are tried, as multiples of the scenario's.
        rounds: Numbers of rounds that are tried.
        filtering: Time constant of the observer's filter, s.
        most: Largest product of samples and states.
    """
    try:
        loop_of(system)  # if it is undecided, as with rounds that can be delayed or lost, so are its variants
    except UndecidedError:
        return []
    if (
        system.team.linearised_at is not None
        or len(system.law.links.table)
        or system.grid.steps * system.team.dirichlet.H.shape[0] > most
    ):
        return []
    odometry = Odometry(noise=system.law.terms.noise, bias=system.law.terms.bias)
    proposals = []
    for kind in range(4):
        terms = [
            Terms(
                feedforward=Feedforward(rounds=r, extrapolate=kind == 3) if kind else None,
                newton=Newton(rounds=r) if kind > 1 else None,
                drift=Drift(filter=filtering) if kind == 3 else None,
                odometry=odometry,
            )
            for r in (rounds if kind else [1])
        ]
        for gain in (factor * system.gain for factor in gains):
            own = system.law.gain.copy()
            own[: len(system.team.agents)] = gain
            packed = [pack_terms(each, system.team, system.grid.period) for each in terms]
            laws = [replace(system, gain=gain, law=system.law._replace(gain=own, terms=each)) for each in packed]
            # More rounds leave a smaller error, or nearly so: bisection finds the first number that suffices.
            first = bisect_left(laws, True, key=lambda law: _keeps(law, certificate, radius))
            if first == len(laws):
                continue
            fields = {name: getattr(terms[first], name) for name in ("feedforward", "newton", "drift", "integral")}
            sections = {
                name: term and term.model_dump()
                for name, term in fields.items()
                if term or name in system.law.term_names
            }
            found = law_loop(laws[first], certificate)
            assert found.unlimited is not None  # of a loop that is within a radius
            assert found.unlimited_per_agent is not None
            proposals.append(
                Proposal(
                    controller={"gain": gain, **sections},
                    bound=found.unlimited,
                    bound_per_agent=found.unlimited_per_agent,
                    certified=found.radius is not None,
                    stable_on_bodies=loop_on_path(laws[first], certificate).stable,
                    **{name: getattr(found, name) for name in ("command", "exchanges", "numbers", "noise")},
                )
            )
            break
    return proposals


def _keeps(system: System, certificate: Certificate, radius: float, *, reserve: float = 2.0) -> bool:
    """Return True if the law's bound is at most the radius, m, and `reserve` times its gain is stable."""
    try:
        loop = loop_of(system)
        stable = max(loop.radius, replace(loop, gain=reserve * loop.gain).radius) < 1.0
        return stable and envelope(system, certificate).late() <= radius
    except UndecidedError:
        return False


# -- the check, and its trial ------------------------------------------------------------------------------------------


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
        rho: User's bound |f_q(q*) - f_q(q)| <= rho(|e|) |e|: a number, coefficients c_0, c_1, ... of a polynomial,
            pairs (radius, value) or a function; None uses the flow's largest slope over the region.
        trial: True to run the mission on bodies at the end, False to analyse it only.
        progress: True shows a bar on a terminal or in a notebook, False and None nothing.

    Returns:
        The record that `mjsheaf check --json` prints, a mapping whose schema is that of `CheckRecord`. It prints, also
        in a notebook, as what `mjsheaf check` prints.

    Raises:
        InputError: rate or radius is not positive, rho is not a valid bound, or a vehicle does not fit its agent.
    """
    require_scenario(scenario)
    own = None if rho is None else as_rho(rho)
    with shown(progress, "checking") as bar:
        record = examine_scenario(scenario, rate=rate, radius=radius, rho=own).record
        if not trial:
            return Answer(untried(record))
        return Answer(try_out(record, scenario, partial(bar, "trying the mission") if bar else None))


def untried(record: CheckRecord) -> CheckRecord:
    """Return the record of an analysis without a trial: anything that only a trial could decide is a problem."""
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
        unfixed = problem.kind == "room" and not problem.changes
        changes = _limit_for_room(record, scenario) if unfixed else _with_own_limits(problem.changes, scenario)
        if changes != problem.changes:
            problem = problem.model_copy(update={"fix": describe_changes(changes), "changes": changes})
        if left > 0 and (problem.changes or problem.additions):
            left -= 1
            problem = problem.model_copy(update={"tried": _try_fix(scenario, problem, trial, progress)})
        problems.append(problem)
    return record.model_copy(
        update={"trial": trial, "problems": problems, "notes": notes, "ok": record.ok and trial.ok}
    )


def _with_own_limits(changes: dict[str, Any], scenario: Scenario) -> dict[str, Any]:
    """Return changes of fields that also set the velocity limits in the entries of agents."""
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
    fields = scenario.model_dump(mode="json", exclude_none=True, exclude={"expect"})  # which is for the unchanged one
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
    """Return the predicted error, RMS over agents, m; None if it is not known, as with events.

    If it is not known on the vehicles, it is that on ideal kinematics.
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
