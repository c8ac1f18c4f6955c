"""`check`: analyse a scenario, and try it."""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from html import escape
from numbers import Real
from typing import Any

import numpy as np
from pydantic import Field

from mjsheaf.arguments import require_number, require_scenario
from mjsheaf.arrays import Array
from mjsheaf.checking.fragility import Fragility, fragility
from mjsheaf.checking.loop.body_loop import medium_on_path, with_bodies
from mjsheaf.checking.loop.disturbance import DisturbanceRecord, predict_rms
from mjsheaf.checking.loop.held_law import LawLoop, envelope, law_loop
from mjsheaf.checking.loop.links import LinkRecord, link_answers
from mjsheaf.checking.loop.margins import Margins, margins
from mjsheaf.checking.loop.steady import SteadyError, steady_error
from mjsheaf.checking.loop.targets_loop import TargetsLoop, targets_loop
from mjsheaf.checking.problems import Problem, TriedFix, problems_of, untried_of
from mjsheaf.checking.proposals import Proposal, propose
from mjsheaf.checking.repairs import (
    Augmentation,
    Rigidity,
    describe_edges,
    plan_augmentation,
    rigidity_of,
    suggest_edges,
)
from mjsheaf.checking.separation import SafetyRecord, safety_record
from mjsheaf.checking.slips import drifts_of, slips_of
from mjsheaf.checking.spectrum import RelativeCohomology, held_eigenvalues, spectrum_of, zero_of
from mjsheaf.checking.theorem.certificate import (
    Assumption,
    Certificate,
    Search,
    certificate_of,
    obstacle_of_team,
)
from mjsheaf.checking.theorem.targets import Carrier
from mjsheaf.checking.theorem.wanted_gain import gain_for_wanted_radius
from mjsheaf.checking.trial import MAX_VEHICLE_STEPS, TrialRecord, try_mission
from mjsheaf.errors import InputError, UndecidedError
from mjsheaf.io.norms import OF_TEAM, TEAM_NORM, Norm, per_agent
from mjsheaf.io.section import Finite, Record
from mjsheaf.law.theorem import Rho, RhoLike, as_rho
from mjsheaf.progress import shown
from mjsheaf.scenario import Scenario, scenario_from_mapping
from mjsheaf.system import Phase, System, during, phases_of
from mjsheaf.team import Team
from mjsheaf.threads import one_thread

_MAX_FIXES = 3  # that are tried
_SPARE = 1.5  # times the speed of q*, that is proposed as a velocity limit
_RESERVE = 0.5  # m/s, in addition to that


class RegionSummary(Record):
    """Region over which the constants were taken."""

    source: str
    verified: bool = Field(description="whether agents of an unlimited law are proven to stay there; else a guess")
    agents_low: list[float] = Field(description="corner of the box about the agents' region, m")
    agents_high: list[float] = Field(description="opposite corner, m")
    start: float = Field(description="s")
    end: float = Field(description="s")
    samples: int = Field(description="cells that cover the targets' path, or instants where it is not known")
    path_error: Finite = Field(description="error of the targets' path that the bounds include, m; null: not known")


class ExplainedCohomology(RelativeCohomology):
    """H^0(G, G_p; F), explained, and what would make it trivial."""

    mending: Augmentation | None = Field(description="null where nothing is free")


class WeakerBound(Record):
    """The bound with rho = 0 and f_bar enlarged by 2 sqrt(sum_i sup |f_i|^2)."""

    f_bar: Finite
    radius: Finite = Field(description="ultimate radius, m")
    radius_per_agent: Finite = Field(description="the same as RMS over agents, radius / sqrt(N), m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)


class TheoremSummary(Record):
    """Theorem 1, computed."""

    holds: bool | None = Field(
        description="the same as `applies`; null where the theorem is about other teams: with ranges, bearings or "
        "directed edges, or without targets"
    )
    applies: bool = Field(
        description="the gain condition and every numbered assumption hold, and no hold or speed limit is in the way"
    )
    gain_condition: bool = Field(description="k_min > rho(2 sqrt(mu / lambda_V)) + lambda_V, the targets' path known")
    approximate: bool = Field(description="the law is held over a period; the theorem's is continuous")
    reason: str = Field(description="why it does not apply, or empty")
    gain: float = Field(description="k1, 1/s")
    lambda_min: float
    lambda_max: float
    sigma_max_B: float
    omega_bar: Finite = Field(description="m/s")
    f_bar: Finite = Field(description="m/s")
    rho: Finite = Field(description="constant Lipschitz bound, 1/s; of a user's rho its value at the initial error")
    rho_seen: Finite = Field(description="largest slope found, 1/s")
    rho_source: str
    lambda_V: Finite = Field(description="rate, 1/s; the best one unless given")
    lambda_V_given: bool
    k_min: float = Field(description="1/s")
    mu: Finite = Field(description="m^2/s")
    chi: Finite = Field(description="m; null where it is infinite: rho is constant over the region")
    chi_infinite: bool | None = Field(description="null where the gain condition fails")
    radius_D: Finite = Field(description="m; null: the whole space, or the condition fails")
    radius_S: Finite = Field(description="m; null: the whole space, or the condition fails")
    radius_U: Finite = Field(description="m; null where the condition fails")
    initial_error: Finite = Field(
        description="|e(t0)|, m; of a later phase a bound: that of the phase before at its end, and the jump "
        "of q*; null where there is none"
    )
    radius_U_per_agent: Finite = Field(description="ultimate radius as RMS over agents, radius_U / sqrt(N), m")
    initial_error_per_agent: Finite = Field(description="initial error as RMS over agents, m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    initial_error_inside_S: bool | None = Field(description="null where the gain condition fails: there is no S")
    wanted_radius: float = Field(description="of |e|, the norm of the whole team, m")
    gain_for_wanted_radius: Finite = Field(
        description="smallest k1 that was found at which the theorem applies with that radius, in its own region and "
        "from the initial error as here, 1/s; null: see its reason"
    )
    gain_for_wanted_radius_reason: str = Field(description="why there is no such gain, or empty")
    weaker: WeakerBound


class PartRecord(Record):
    """Analysis of a team and its law while neither changes."""

    ok: bool = Field(
        description="every numbered assumption that applies holds (none fails, none is undecided), check has a model "
        "of the whole law; neither the held law, alone and over its links, nor the targets' own, nor the vehicles' "
        "loop is unstable; and the vehicles can do what the mission demands: `problems` is empty"
    )
    problems: list[Problem] = Field([], description="why the analysis is not ok, each with a fix")
    assumptions: list[Assumption]
    relative_cohomology: ExplainedCohomology
    theorem: TheoremSummary = Field(description="of the paper's law, whatever terms the scenario's has")
    law: LawLoop
    links: LinkRecord | None = Field(description="what links do to the law; null without a held law")
    targets: TargetsLoop = Field(description="the targets' own law, on ideal kinematics and on their vehicles")
    margins: Margins
    rigidity: Rigidity = Field(description="of the communication edges, linearised at q*")
    safety: SafetyRecord | None = Field(
        description="what keeps vehicles apart, null without it; with it, what is said of the law and of loops is "
        "about the team while the filter does not act"
    )
    disturbance: DisturbanceRecord
    fragility: Fragility = Field(description="which single event more breaks an assumption")
    topology_fix: str = Field(
        description="edges that would make assumption 5 hold, the shortest ones; empty if it holds"
    )
    topology_edges: dict[str, list[list[str]]] = Field(description="the same edges, as the scenario's lists have them")


class PhaseRecord(PartRecord):
    """A check of one phase of a run with events, of the present agents alone and the time until the next event.

    Its |e(t0)| is at most the smallest bound of the phase before at its end, and the jump of q* more. An agent that
    joins adds its distance from q*, if it is proven to have stayed where it began: it has held its position from the
    start of the run, and the medium there is never faster than its velocity limit. No bound is claimed where an agent
    joins that was lost, drifts or may have been carried off, where the phase before leaves none, nor where the
    paper's law follows one with terms. What is asked at the start (`margins.speed`) is as if the phase before had come
    to rest.
    """

    start: float = Field(description="s")
    events: list[str] = Field(description="what happens there")
    absent: list[str] = Field(description="agents that are lost or have yet to join")
    jump: Finite = Field(description="|q*_new - q*_old| at its start, of the agents present before and after, m")
    norm: Norm = Field(TEAM_NORM, description="which norm `jump` is")
    jumps: dict[str, Finite] = Field(description="the same of each of these agents, m")


class CheckRecord(PartRecord):
    """A check of a scenario; of a run with events it is about the first phase, and `phases` about each of them.

    `ok` and `problems` are about all phases, and `ok` about the trial too.
    """

    scenario: str
    region: RegionSummary
    steady: SteadyError
    proposals: list[Proposal] = Field(
        description="laws whose bound is at most the desired radius, the cheapest of each kind"
    )
    phases: list[PhaseRecord] = Field(default_factory=list, description="of a run with events, the first included")
    trial: TrialRecord | None = Field(None, description="the mission, tried on bodies; null where it was not tried")
    drifts: dict[str, float] = Field(
        {}, description="how far the flow carries each target that nothing holds by the end of the run, m"
    )
    notes: list[str] = Field(
        default_factory=list, description="values in the files that look like mistakes, in sentences"
    )

    @property
    def imperfect_links(self) -> bool:
        """True if links delay, lose or disturb measurements, or have a range."""
        return self.links is not None and not self.links.exact


class Answer(dict[str, Any]):
    """The record of a check as a mapping, as `mjsheaf check --json` prints it; it prints as the screen does."""

    def __init__(self, record: CheckRecord) -> None:
        from mjsheaf.checking.screen import screen  # which reads this module's records

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
    require_number("radius", radius, positive=True)
    if rate is not None:
        require_number("rate", rate, positive=True)
    own = None if rho is None else as_rho(rho)
    with shown(progress, "checking") as bar:
        record = examine_scenario(scenario, rate=rate, radius=radius, rho=own).record
        if trial:
            record = try_out(record, scenario, partial(bar, "trying the mission") if bar else None)
        else:
            record = untried(record)
        return Answer(record)


def untried(record: CheckRecord) -> CheckRecord:
    """Return the record of an analysis that no trial follows: what only a trial could decide is a problem."""
    problems = [*record.problems, *untried_of(record)]
    return record.model_copy(update={"problems": problems, "ok": not problems})


def try_out(record: CheckRecord, scenario: Scenario, progress: Callable[[int, int], None] | None = None) -> CheckRecord:
    """Return the record of a scenario's analysis with a trial of the mission, and of the fixes that it proposes.

    Args:
        record: Record of the analysis.
        scenario: The scenario.
        progress: Called with the samples done and the number of samples.
    """
    trial = try_mission(scenario, foreseen_error(record), progress)
    problems = list(record.problems)
    notes = list(record.notes)
    if scenario.expect.controller is not None:
        notes.append(f"expectations are for the law {scenario.expect.controller}, and the trial ran the scenario's own")
    grid = scenario.whole.grid
    steps = len(scenario.team.members) * grid.steps * round(grid.period / scenario.whole.bodies.timestep)
    fixes: list[int] = []
    for k, problem in enumerate(problems):
        if problem.kind == "room" and not problem.changes:
            problem = problem.model_copy(update=_limit_for_room(record, scenario))
        problems[k] = _with_own_limits(problem, scenario)
        if (problem.changes or problem.additions) and (len(fixes) + 1) * steps <= MAX_VEHICLE_STEPS:
            fixes.append(k)
    for k in fixes[:_MAX_FIXES]:
        problems[k] = problems[k].model_copy(update={"tried": _try_fix(scenario, problems[k], trial, progress)})
    update = {"trial": trial, "problems": problems, "notes": notes, "ok": record.ok and trial.ok}
    return record.model_copy(update=update)


def _with_own_limits(problem: Problem, scenario: Scenario) -> Problem:
    """Return a problem whose fix also sets the velocity limits that agents have of their own."""
    limit = problem.changes.get("controller.velocity_limit")
    owners = [agent.id for agent in scenario.agents if agent.velocity_limit is not None]
    if limit is None or not owners:
        return problem
    changes = problem.changes | {f"agents.{id}.velocity_limit": limit for id in owners}
    if len(owners) == len(scenario.agents):
        del changes["controller.velocity_limit"]
    fix = " and ".join(f"set {name} to {value:g}" for name, value in changes.items())
    return problem.model_copy(update={"fix": fix, "changes": changes})


def _limit_for_room(record: CheckRecord, scenario: Scenario) -> dict[str, Any]:
    """Find a velocity limit, and a rate if necessary, with which the safety filter leaves room for the formation.

    The stopping distance of vehicles grows with their speed. The limit is a little above the speed of q*.

    Returns:
        `fix` and `changes` of the problem; nothing if the formation does not fit even then.
    """
    demanded = [demand.steady for demand in record.margins.speed if demand.steady is not None]
    if not demanded:
        return {}
    limit = float(f"{_SPARE * max(demanded) + _RESERVE:.2g}")
    changes: dict[str, Any] = {"controller.velocity_limit": limit}
    changes |= {f"agents.{a.id}.velocity_limit": limit for a in scenario.agents if a.velocity_limit is not None}
    fields = scenario.model_dump(mode="json", exclude_none=True)
    try:
        left = examine_scenario(scenario_from_mapping(fields, changes)).record.problems
    except InputError:
        return {}
    changes |= next((problem.changes for problem in left if problem.kind == "room"), {})
    if any(problem.kind == "unsafe" or (problem.kind == "room" and not problem.changes) for problem in left):
        return {}
    return {"fix": " and ".join(f"set {name} to {value:g}" for name, value in changes.items()), "changes": changes}


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
    if len(record.phases) > 1:
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


@dataclass(frozen=True)
class Examination:
    """A check with what it was made from."""

    record: CheckRecord
    certificate: Certificate
    system: System

    @cached_property
    def end(self) -> float:
        """The smallest bound on |e| at the end of the system's time, m; infinite where there is none."""
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
    about_files = {"notes": slips_of(scenario), "drifts": drifts_of(scenario)}
    return replace(examination, record=examination.record.model_copy(update=about_files))


@one_thread
def examine(
    run: System | Sequence[Phase], *, rate: float | None = None, radius: float = 1.0, rho: Rho | None = None
) -> Examination:
    """`check` of a system, or of the phases of a run, as a typed record with the certificate of the first."""
    if rate is not None:
        _require_positive("rate", rate)
    _require_positive("radius", radius)
    phases = phases_of(run)
    first = before = _examine_one(during(phases, 0), rate, radius, rho)
    if len(phases) == 1 and not phases[0].events:
        return first
    records = [_phase_record(phases[0], first.record, None)]
    beyond = False  # True once a phase has terms, which Theorem 1 does not cover
    for k, phase in enumerate(phases[1:], 1):
        old = phases[k - 1].system
        path = before.certificate.constants.path
        targets = _targets_at(before.certificate, phase.start - phases[k - 1].start, phase.time)
        jumps = _jumps(old, phase.system, targets)
        beyond = beyond or bool(old.law.extended or before.record.law.unmodelled)
        joining = _distances_of_joining(phases[: k + 1], targets)
        known = phase.system.law.extended or not beyond
        start = before.end + math.hypot(*jumps.values(), *joining) if known else math.inf
        system = during(phases, k, _settled(old, phase.system, targets))
        before = _examine_one(system, rate, radius, rho, start + _carried_error(system, path.error))
        records.append(_phase_record(phase, before.record, jumps))
    problems = list(first.record.problems)
    for record in records[1:]:
        since = f"from {record.start:g} s on ({', '.join(record.events)})"
        for problem in record.problems:
            # A field of the scenario is that of the first phase; later ones have what events made of it.
            fix = f"from then on, {problem.fix}" if problem.fix else ""
            later = {"what": f"{problem.what} {since}", "fix": fix, "changes": {}, "additions": {}}
            problems.append(problem.model_copy(update=later))
    steady = first.record.steady
    if steady.ideal is not None:
        left_out = [*steady.leaves_out, f"the events from {records[1].start:g} s on"]
        steady = steady.model_copy(update={"leaves_out": left_out})
    update = {"ok": not problems, "problems": problems, "phases": records, "steady": steady}
    return replace(first, record=first.record.model_copy(update=update))


def _require_positive(name: str, value: float) -> None:
    if not (isinstance(value, Real) and 0.0 < value < math.inf):
        raise InputError(f"{name} is {value!r}; expected a positive, finite number")


def _phase_record(phase: Phase, record: CheckRecord, jumps: dict[str, float] | None) -> PhaseRecord:
    """Return the record of a phase, at whose start q* of some agents jumps; None for the first phase."""
    return PhaseRecord(
        start=phase.time,
        events=list(phase.events),
        absent=sorted(phase.system.team.absent, key=phase.system.team.index.__getitem__),
        jump=None if jumps is None else math.hypot(*jumps.values()),
        jumps=dict(jumps or {}),
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


def _q_star(system: System, targets: Array) -> Array:
    """q* of targets (M, 3), padded, shape (N, 3), m; NaN for absent agents."""
    return system.team.harmonic_extension(np.concatenate([system.initial[: len(system.team.agents)], targets]))


def _jumps(old: System, new: System, targets: Array) -> dict[str, float]:
    """|q*_new - q*_old| of each agent that is present before and after, m."""
    away = np.linalg.norm(_q_star(new, targets) - _q_star(old, targets), axis=1)
    return {id: float(x) for id, x in zip(new.team.agent_ids, away, strict=True) if np.isfinite(x)}


def _distances_of_joining(phases: Sequence[Phase], targets: Array) -> list[float]:
    """|q* - q| of each agent that joins at the start of the last of some phases, m; infinite where q is not known."""
    *earlier, last = phases
    system = last.system
    joining = np.flatnonzero(system.team.present & ~earlier[-1].system.team.present)
    away = np.linalg.norm(_q_star(system, targets) - system.initial[: len(system.team.agents)], axis=1)
    return [float(away[i]) if all(_stays(phase.system, i) for phase in earlier) else math.inf for i in joining.tolist()]


def _stays(system: System, agent: int) -> bool:
    """Return True if an agent holds its position, on ideal kinematics, in a medium that cannot carry it off."""
    if system.waiting is None or not system.waiting.holds[agent] or system.effectiveness.given[agent]:
        return False
    place = system.initial[agent, : system.team.agents[agent].dimension]
    flow = float(np.linalg.norm(system.flows[system.field[agent]].velocity(place)))
    return flow + float(system.largest_disturbance[agent]) <= float(system.waiting.limit[agent])


def _settled(old: System, new: System, targets: Array) -> Array:
    """Return positions after the old system came to rest, shape (V, 3), m; joining vehicles are where they began."""
    settled = _q_star(old, targets)
    return np.concatenate([np.where(np.isnan(settled), new.initial[: len(settled)], settled), targets])


def _carried_error(system: System, error: float) -> float:
    """Bound the error of q* of the present agents if the targets' positions are off by `error`, m."""
    system = system.local
    if not (error > 0.0 and system.team.dirichlet.unique):
        return 0.0
    reach = Carrier(system, spectrum_of(system.team)).reach(np.full(len(system.team.targets), error))
    return float(np.linalg.norm(reach))


def _examine_one(
    system: System, rate: float | None, radius: float, rho: Rho | None, start: float | None = None
) -> Examination:
    """`check` of one phase, whose |e(t0)| in m is at most `start`; None takes that of the initial positions."""
    original = system.team.remaining
    system = system.local
    search = Search(system, rate, rho, start)
    certificate = certificate_of(search)
    path = certificate.constants.path
    practice = margins(system, certificate)
    law = law_loop(system, certificate, carried=start is not None)
    links = link_answers(system, path)
    targets = with_bodies(targets_loop(system), system, path)
    rigidity = _rigidity(system, original)
    mending = None if system.team.free or system.team.stressed else plan_augmentation(system.team, system.initial)
    edges = suggest_edges(system.team, system.initial)
    record = CheckRecord(
        scenario=system.name,
        ok=True,
        region=_region(certificate),
        assumptions=certificate.assumptions,
        relative_cohomology=ExplainedCohomology(**dict(certificate.cohomology), mending=mending),
        rigidity=rigidity,
        safety=safety_record(system, certificate),
        theorem=_theorem(search, certificate, radius),
        law=law,
        links=links,
        topology_fix=describe_edges(edges),
        topology_edges=edges,
        steady=steady_error(system, certificate, law.rate),
        proposals=propose(system, certificate, radius),
        targets=targets,
        margins=practice,
        disturbance=predict_rms(system, search.spectrum, medium_on_path(system, certificate.constants.path)),
        fragility=fragility(system.team),
    )
    problems = problems_of(record, stable=_is_stable(system, law))
    record = record.model_copy(update={"ok": not problems, "problems": problems})
    return Examination(record, certificate, system)


def _is_stable(system: System, law: LawLoop) -> bool:
    """Return True if the law of a team of linear edges is known to be stable, also where it is continuous."""
    if not system.grid.continuous or law.unmodelled or len(system.law.links.table):
        return law.stable is True
    try:
        return bool((held_eigenvalues(system.team).real > 0.0).all())
    except UndecidedError:
        return False


def _rigidity(system: System, original: Team) -> Rigidity:
    """The rigidity of a system's present team, all of whose edges are linear, linearised from the original one."""
    team = system.team
    x = team.pack(system.initial) if team.linearised_at is None else team.linearised_at
    n_q = int(team.first_state[-1])
    try:
        values = held_eigenvalues(team)
    except UndecidedError:
        values = spectrum_of(team).smallest.astype(np.complex128)
    zero = np.abs(values) <= zero_of(team) * np.abs(values).max(initial=0.0)
    return rigidity_of(team, original, x[:n_q], system.gain, values[~zero])


def _region(certificate: Certificate) -> RegionSummary:
    region, path = certificate.region, certificate.constants.path
    low, high = region.tube.corners()
    time, cells = path.time, path.cells
    return RegionSummary(
        source=region.source,
        verified=region.verified and not certificate.obstacle,
        agents_low=low.tolist(),
        agents_high=high.tolist(),
        start=float(time[0]),
        end=float(time[-1] if cells is None else cells.end[-1]),
        samples=len(time if cells is None else cells.begin),
        path_error=path.error,
    )


def _theorem(search: Search, certificate: Certificate, radius: float) -> TheoremSummary:
    rate = search.rate
    theorem = certificate.theorem
    spectrum = certificate.spectrum
    constants = certificate.constants
    agents = len(search.system.team.agents)
    holds = theorem.applies and certificate.region.verified
    wanted = gain_for_wanted_radius(search, certificate, radius)
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
        **_slope(search, certificate),
        lambda_V=theorem.rate or None if holds or rate is not None else None,
        lambda_V_given=rate is not None,
        k_min=theorem.k_min,
        mu=theorem.mu,
        **(sets if holds else dict.fromkeys(sets)),
        initial_error=constants.initial_error,
        initial_error_per_agent=per_agent(constants.initial_error, agents),
        wanted_radius=radius,
        gain_for_wanted_radius=wanted.gain,
        gain_for_wanted_radius_reason=wanted.reason,
        weaker=_weaker(certificate, agents),
    )


def _slope(search: Search, certificate: Certificate) -> dict[str, Any]:
    """Return the slope rho of the summary, and where it comes from."""
    slope = certificate.region.rho
    if search.rho is not None:
        value = search.rho(certificate.constants.initial_error)
        source = "given by the user, here at the initial error"
        return {"rho": value, "rho_seen": slope.seen, "rho_source": source}
    moving = certificate.constants.moving.slope
    source = "largest norm of the Jacobian of the agents' field over their region, by branch and bound"
    part = f"; {moving:.3g} 1/s of it is the slope of what moves in the medium" if moving else ""
    loose = "" if slope.exact else " (an upper bound, not tight)"
    return {"rho": slope.upper + moving, "rho_seen": slope.seen, "rho_source": source + part + loose}


def _weaker(certificate: Certificate, agents: int) -> WeakerBound:
    proven = certificate.region.verified
    radius = certificate.weaker.radius if proven and not certificate.obstacle else None
    return WeakerBound(
        f_bar=certificate.weaker.f_bar if proven else None,
        radius=radius,
        radius_per_agent=per_agent(radius, agents),
    )
