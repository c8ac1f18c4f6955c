"""Contents of compare.json, and the verdict in sentences: how much bodies cost, and what to change.

Errors, distances and their parts are in m, times in s, speeds in m/s. A value is null if it is undefined, infinite, or
from a run that blew up. Each part is defined by the module that computes it.
"""

from itertools import chain, product
from math import floor, inf, log10
from typing import NamedTuple

from pydantic import Field

from mjsheaf.checking.finished import ROUNDING
from mjsheaf.comparing.convergence import ConvergenceRecord
from mjsheaf.comparing.demands import DemandRecord, FastestRecord, VelocityLimitRecord
from mjsheaf.comparing.gains import GainLimitRecord, GainRecord, GainTrialRecord
from mjsheaf.comparing.ladder import RungRecord, display_name
from mjsheaf.comparing.measures import FORMATION, RMS_OVER, TEAM, TRACKING, BudgetRecord, Measure, ScopeRecord
from mjsheaf.comparing.ringing import RingingRecord
from mjsheaf.errors import joined
from mjsheaf.section import Finite, FiniteRecord

_LOWER_GAIN = ", or a lower controller.gain"  # advice for laws that have one
_CHANGE = {
    "inertia": f"a faster autopilot (autopilot.rate){_LOWER_GAIN}",
    "drag_law": "hulls with less quadratic drag, or slower motion",
    "limits": "stronger thrusters, or slower targets, or a lower controller.velocity_limit",
    "lag": f"faster thrusters{_LOWER_GAIN}",
    "underactuation": "vehicles with thrust along every axis, or slower turns of what they follow",
    "contacts": "more room between vehicles",
}
_RINGING_CURES = {"lag": "faster thrusters", "underactuation": "a quicker attitude (attitude.frequency)"}
_UNSETTLED = {
    "growing": "its error DIVERGES",
    "circling": "it ends in a limit cycle",
    "stuck": "an agent does not move although it is commanded to (see the notes of mjsheaf run)",
}
_LEAST_BODY_SHARE = 0.05  # fraction of the error; bodies that add less are not reported as its cause
_LEAST_CAUSE_SHARE = 0.25  # fraction of the error that bodies add; a single effect below it is not a cause
_LEAST_NAMED_SHARE = 0.01  # fraction of the error; smaller parts are named together
_LEAST_Q_STAR_SHARE = 0.5  # fraction of the error; if q* itself has more, the sheaf is the cause
_LEAST_SATURATION = 0.01  # fraction of the time at a limit of velocity or thrust; less is not reported
_LARGEST_PERCENTAGE = 10.0  # ratio to the ideal error; larger ones are given as a multiple, not a percentage
_LARGEST_MULTIPLE = 1000.0  # ratio to the ideal error; above it the ideal error is negligible
_RINGING_DAMPING = 0.2  # damping ratio below which the team rings
_LARGE_TRACKING = 0.1  # tracking error as a fraction of the formation's size
_GAIN_ROOM = 1.05  # ratio of the usable to the present gain above which raising the gain is advised
LIMITED_BY = {
    "inertia": "inertia",
    "lag": "the lag of thrusters",
    "underactuation": "vehicles that turn before they push",
    "hold": "the hold of the law over controller.control_period",
    "links": "the age of measurements (links.delay)",
    "loop": "the loop of the vehicles",
}
_MOST_GROUPS = 6  # maximum number of groups that get a sentence each


class LoopRecord(FiniteRecord):
    """Stability of the vehicles' loop for small motions, as `check` reports it."""

    stable: bool | None = Field(description="null where undecided")
    largest_gain: float | None = Field(description="gain above which the loop is unstable, 1/s")
    reason: str = Field(description="why it is undecided, or empty")


class PhaseRecord(FiniteRecord):
    """A phase of a run with events: its errors, their causes, and what to change."""

    start: float = Field(description="time of its first sample, s")
    end: float = Field(description="time of its last sample, s")
    events: list[str] = Field(description="events at its start, in words")
    errors: dict[str, dict[str, ScopeRecord]] = Field(
        description="by variant, then by scope: at its end, and RMS over its second half; null where a run did not "
        "reach its end"
    )
    budgets: list[BudgetRecord] = Field(description="as those of the whole run, over this phase")
    velocity_limit: VelocityLimitRecord | None = Field(
        description="as that of the whole run, over this phase; null where no agent has one"
    )
    levers: list[str] = Field(description="what to change in this phase, the most important first")


class CompareRecord(FiniteRecord):
    """Ideal kinematics against bodies."""

    mjsheaf_version: str
    scenario: str
    origin: str | None = Field(None, description="scenario: its name, or its file relative to this directory")
    seed: int
    law: str = Field("paper's law", description="name of the law: the paper's with its terms, or that of `controller`")
    controller: str | None = Field(None, description="law in Python, FILE.py:NAME, or null")
    gain: float | None = Field(description="k1, 1/s; null under a law in Python, which ignores it")
    terms: list[str] = Field(default_factory=list, description="terms of the law beyond the paper's")
    harm: list[str] = Field(
        default_factory=list, description="warnings about the terms in the scenario as given, as `run` notes them"
    )
    usable_gain: float | None = Field(
        description="largest k1 at which neither the hold nor the bodies ring, 1/s, from the least damped mode; null "
        "if every gain is usable, or the law is in Python"
    )
    gains: GainRecord | None = Field(None, description="what limits the gain; null under a law in Python")
    loop: LoopRecord | None = Field(
        None, description="loop in the worst phase; null if the ideal run blew up, or under a law in Python"
    )
    time_s: float = Field(description="length of the run")
    formation_size_m: Finite = Field(description="RMS over edges inside groups of their desired length")
    ladder: list[RungRecord]
    budgets: list[BudgetRecord]
    ringing: RingingRecord | None = Field(description="null for teams of too many states, or under a law in Python")
    ringing_phase: int | None = Field(None, description="number of the phase of `ringing`; null without events")
    convergence: ConvergenceRecord
    velocity_limit: VelocityLimitRecord | None = Field(None, description="null where no agent has one")
    demands: list[DemandRecord]
    fastest: list[FastestRecord]
    phases: list[PhaseRecord] = Field(default_factory=list, description="phases of a run with events; else none")
    verdict: list[str] = Field(description="what to change, the most important first")
    wall_time_s: float
    video: str | None = Field(description="name of the file, or null")

    def rung(self, key: str) -> RungRecord:
        """Return the variant with a key."""
        return next(rung for rung in self.ladder if rung.key == key)

    def budget(self, scope: str, measure: str, statistic: str) -> BudgetRecord:
        """Return the budget of one error."""
        wanted = (scope, measure, statistic)
        return next(b for b in self.budgets if (b.scope, b.measure, b.statistic) == wanted)

    @property
    def law_in_words(self) -> str:
        """The law for titles: its gain and terms, or its name."""
        return f"law {self.law}" if self.gain is None else ", ".join([f"gain {self.gain:g} 1/s", *self.terms])

    @property
    def scopes(self) -> list[str]:
        """'team', then the names of the groups."""
        return list(self.ladder[0].errors)

    @property
    def measure(self) -> Measure:
        """The error that matters: the formation error, or that of tracking in a team without formations."""
        return TRACKING if self.rung("ideal").errors[TEAM].late.formation_error is None else FORMATION

    @property
    def large_tracking_error(self) -> float:
        """Tracking error that is large compared with the formation, m; infinite without formations."""
        return inf if self.formation_size_m is None else _LARGE_TRACKING * self.formation_size_m

    def limit_costs(self, scope: str, measure: str, run: str) -> float | None:
        """Return how much the velocity limit adds to an error of run 'ideal' or 'all' over the second half, m.

        None if that is unknown.
        """
        if self.velocity_limit is None:
            return None
        now = self.rung(run).errors[scope].error(measure)
        without = self.velocity_limit.run(run).errors_without[scope].error(measure)
        return None if now is None or without is None else now - without


def levers_of(record: CompareRecord, phase: PhaseRecord) -> list[str]:
    """Return the sentences about a phase, the most important first."""
    alone = phase_alone(record, phase)
    parts = (_of_the_whole, _groups, _tracking, _velocity_limit)
    return [sentence for part in parts for sentence in part(alone)]


def phase_alone(record: CompareRecord, phase: PhaseRecord) -> CompareRecord:
    """Return the comparison restricted to the errors of one phase."""
    ladder = [rung.model_copy(update={"errors": phase.errors[rung.key], "ending": None}) for rung in record.ladder]
    if phase.errors["all"][TEAM].final.tracking_error is not None:  # the run reached the phase's end
        ladder = [rung.model_copy(update={"status": "finished"}) for rung in ladder]
    own = {"ladder": ladder, "budgets": phase.budgets, "velocity_limit": phase.velocity_limit}
    return record.model_copy(update=own)


class _Lever(NamedTuple):
    """Dominant cause of an error: its name, its contribution, and a fix, which may be empty."""

    kind: str
    why: str
    cure: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.why}" + (f"; {self.cure}" if self.cure else "")


def verdict_of(record: CompareRecord) -> list[str]:
    """Compose the sentences of the verdict, the most important first."""
    harmful = (_harmful_terms,) if _harmful_terms(record) else ()
    law = (
        () if harmful else (_terms, _links, _groups, _tracking, _gain, _velocity_limit)
    )  # advice that applies only if the terms do not make the error larger
    # Harmful terms come first: they explain why a team does not converge.
    parts = (*harmful, _unsettled, _of_the_whole, *law, _speeds, _saturation, _ringing)
    return [sentence for part in parts for sentence in part(record)]


def _unsettled(record: CompareRecord) -> list[str]:
    """Report a team that does not converge in the scenario as given, or whose loop is unstable."""
    what, loop = _UNSETTLED.get(record.rung("all").ending or ""), record.loop
    if loop is not None and loop.stable is False:
        most = loop.largest_gain
        limit = "" if most is None else f" at gains above {most:.3g} 1/s: lower controller.gain"
        what = (f"{what}; " if what else "") + f"the loop of its vehicles is unstable{limit}"
    return [f"the team does not converge: {what}"] if what else []


def _of_the_whole(record: CompareRecord) -> list[str]:
    """Report how much bodies cost, and the dominant cause of the error."""
    if record.rung("all").status != "finished":
        return _blown_up(record)
    budget = record.budget(TEAM, record.measure, "late")
    if budget.ideal_m is None or budget.all_m is None:
        return ["the ideal run blows up, so nothing can be compared with it"]
    error = f"{display_name(record.measure)}, {RMS_OVER[record.measure]} and the second half"
    if budget.all_m <= ROUNDING:
        ideal = f"{budget.ideal_m:.3g} m" if budget.ideal_m > ROUNDING else "zero to rounding"
        return [f"{error}: ideal {ideal}, as given zero to rounding: nothing to gain"]
    cost = budget.all_m - budget.ideal_m
    tracking = record.budget(TEAM, TRACKING, "late")
    headline = [] if record.measure == TRACKING else [f"parts of the tracking error: {_sum_of_parts(tracking)}"]
    return [
        *headline,
        f"dominant cause of the {display_name(record.measure)}: {_lever(record, TEAM)}",
        f"{error}: {_sum_of_parts(budget)}; "
        f"bodies {'add' if cost >= 0 else 'remove'} {abs(cost):.2g} m ({_relative(budget.ideal_m, budget.all_m)})",
    ]


def _sum_of_parts(budget: BudgetRecord) -> str:
    """Write an error as the sum of its parts: what each effect adds alone, and what they add in combination."""
    if budget.ideal_m is None or budget.all_m is None:
        return "unknown"
    if budget.all_m <= ROUNDING:
        return "zero to rounding"
    decimals = 2 - floor(log10(budget.all_m))
    whole = round(budget.all_m, decimals)
    parts = {"targets as bodies": budget.targets_m, "agents as bodies": budget.agents_m}
    parts |= {display_name(item.effect): item.alone_m for item in budget.effects}
    named = {"on ideal kinematics": round(budget.ideal_m, decimals)}
    for name, added in parts.items():
        if added is not None and abs(added) >= _LEAST_NAMED_SHARE * whole:
            named[name] = round(added, decimals)
    rest = round(whole - sum(named.values()), decimals)
    if rest:
        named["in combination"] = rest
    terms = [f"{'-' if x < 0.0 else '+'} {abs(x):.{max(decimals, 0)}f} m {name}" for name, x in named.items()]
    return f"{' '.join(terms).removeprefix('+ ')} = {whole:.{max(decimals, 0)}f} m on bodies"


def _blown_up(record: CompareRecord) -> list[str]:
    """Report a scenario that blows up, and the effects without which it does not."""
    stable = [r for r in record.ladder if r.kind == "without" and r.status == "finished"]
    names = " or without ".join(display_name(r.effect or "") for r in stable)
    lever = f"dominant cause: it is stable without {names}" if stable else "no single effect is the cause"
    return [f"the scenario as given blows up ({record.rung('all').message})", lever]


def _harmful_terms(record: CompareRecord) -> list[str]:
    """Warn if the team would track better under the paper's law alone, and say why."""
    cost = None if record.controller else _costs_of_terms(record)
    if cost is None or cost[1] - cost[0] <= max(_LEAST_BODY_SHARE * cost[0], ROUNDING):
        return record.harm
    gist = f"tracking error {cost[1]:.3g} m as given, {cost[0]:.3g} m under the paper's law alone"
    return [f"WARNING: the error is larger with {joined(record.terms)}: {gist}", *record.harm]


def _terms(record: CompareRecord) -> list[str]:
    """Report how much the terms of the law reduce the error."""
    cost = _costs_of_terms(record)
    if cost is None:
        return []
    ideal = [record.rung(key).errors[TEAM].error(TRACKING) for key in ("ideal-terms", "ideal")]
    known = "" if None in ideal else f", ideal {ideal[0]:.3g} -> {ideal[1]:.3g} m"
    instead = f"{record.controller} instead of the paper's law at the scenario's gain"
    what = instead if record.controller else joined(record.terms)
    return [f"{what}: tracking error {cost[0]:.3g} -> {cost[1]:.3g} m as given{known}"]


def _links(record: CompareRecord) -> list[str]:
    """Report how much links add to the error if they are not perfect."""
    if not any(rung.kind == "links" for rung in record.ladder):
        return []
    found = [
        (record.rung(f"{key}-links").errors[TEAM].error(TRACKING), record.rung(key).errors[TEAM].error(TRACKING))
        for key in ("all", "ideal")
    ]
    costs = [
        f"{perfect:.3g} -> {now:.3g} m {name}"
        for (perfect, now), name in zip(found, ("as given", "ideal"), strict=True)
        if perfect is not None and now is not None
    ]
    return [f"links as given instead of perfect ones: tracking error {', '.join(costs)}"] if costs else []


def _costs_of_terms(record: CompareRecord) -> tuple[float, float] | None:
    """Return the tracking errors under the paper's law alone and with the terms, RMS over the second half, m.

    None if the law has no terms, or if one of the runs blew up.
    """
    if not record.terms and record.controller is None:
        return None
    without, now = (record.rung(key).errors[TEAM].error(TRACKING) for key in ("all-terms", "all"))
    return None if without is None or now is None else (without, now)


def _relative(ideal: float, now: float) -> str:
    """Describe an error relative to the ideal run's: as a percentage or a multiple, or in words if that is near 0."""
    if now > _LARGEST_MULTIPLE * ideal:
        return "nearly all of it"
    if now > _LARGEST_PERCENTAGE * ideal:
        return f"{now / ideal:.2g} times the ideal"
    return f"{100.0 * (now - ideal) / max(ideal, 1e-12):+.1f}%"


def _ranked(budget: BudgetRecord) -> list[tuple[float, str]]:
    """Return the reduction in error from removing each effect, m, and its name; the largest first."""
    return sorted(((item.give_back_m or 0.0, item.effect) for item in budget.effects), reverse=True)


def _lever(record: CompareRecord, scope: str) -> _Lever | None:
    """Return the dominant cause of the error of the team or a group; None if it is unknown or the error is zero."""
    budget = record.budget(scope, record.measure, "late")
    if budget.ideal_m is None or budget.all_m is None or budget.all_m <= ROUNDING:
        return None
    floor = budget.at_q_star_m
    if floor is not None and floor >= _LEAST_Q_STAR_SHARE * budget.all_m:
        return _Lever(
            "the sheaf, not the law or the vehicles",
            f"q* itself is {floor:.3g} m out of formation (now {budget.all_m:.3g} m)",
            "give the edges between groups an `offset`, or increase the weights of sensing and formation edges",
        )
    now = f"{budget.all_m:.3g} m now, {budget.ideal_m:.3g} m ideal"
    effects = _ranked(budget)
    limit = record.limit_costs(scope, record.measure, "all") or 0.0
    if 0.0 < limit >= _LEAST_CAUSE_SHARE * budget.all_m and limit >= max(effects, default=(limit, ""))[0]:
        without = f"without it the error would be {_left(budget, limit)} ({now})"
        return _Lever("the velocity limit", without, _raise_limit(record))
    cost = budget.all_m - budget.ideal_m
    if cost <= _LEAST_BODY_SHARE * budget.all_m:
        return _Lever("the law, not the vehicles", now, _law(record, "more sensing agents", "slower targets"))
    return _lever_of_bodies(budget, _changes(record), cost, now)


def _lever_of_bodies(budget: BudgetRecord, changes: dict[str, str], cost: float, now: str) -> _Lever:
    """Return the dominant cause of the error that bodies add.

    Args:
        budget: Budget of the error.
        changes: Advice for each effect.
        cost: Part that bodies add, m.
        now: The error in words.
    """
    effects = _ranked(budget)
    if effects and effects[0][0] >= _LEAST_CAUSE_SHARE * cost:
        most, effect = effects[0]
        others = [(x, other) for x, other in effects[1:2] if x >= 0.5 * most]
        then = "".join(f"; {_left(budget, x)} without {display_name(e)} instead: {changes[e]}" for x, e in others)
        without = f"without it the error would be {_left(budget, most)} ({now})"
        return _Lever(display_name(effect), without, f"{changes[effect]}{then}")
    share, who = max((budget.agents_m or 0.0, "agents"), (budget.targets_m or 0.0, "targets"))
    if share >= _LEAST_CAUSE_SHARE * cost:
        why = f"with ideal thrusters they already add {share:.2g} m ({now})"
        return _Lever(f"time constant tau of the {who}", why, "")
    return _Lever("no single effect", f"bodies add {cost:.2g} m together ({now})", "see the interaction in the budget")


def _left(budget: BudgetRecord, given_back: float) -> str:
    """Return the error that is left without a part of it: such parts overlap and do not add up."""
    return f"{max((budget.all_m or 0.0) - given_back, 0.0):.3g} m"


def _changes(record: CompareRecord) -> dict[str, str]:
    """Return a fix for each effect, without a gain that the law ignores."""
    ignored = _LOWER_GAIN if record.gain is None else ""
    return {effect: change.removesuffix(ignored) for effect, change in _CHANGE.items()}


def _law(record: CompareRecord, *others: str) -> str:
    """Advise how to lower the ideal run's error: a higher gain up to the usable one, or `others`."""
    if record.gain is None:
        return _either(f"another law than {record.law}", *others)
    room = record.usable_gain
    if room is not None and room <= _GAIN_ROOM * record.gain:
        why = f" by {LIMITED_BY[limit.effect]}" if (limit := _lowest_limit(record)) else ""
        return f"{_either(*others)} (a higher gain rings, above {room:.2g} 1/s{why})"
    upto = "" if room is None else f" (up to {room:.2g} 1/s without ringing)"
    return _either(f"a higher controller.gain{upto}", *others)


def _lowest_limit(record: CompareRecord) -> GainLimitRecord | None:
    return record.gains.limits[0] if record.gains and record.gains.limits else None


def _gain(record: CompareRecord) -> list[str]:
    """Report what limits the gain, and the errors of runs at higher gains."""
    limit = _lowest_limit(record)
    if record.gain is None or record.gains is None or limit is None:
        return []
    whose = f" of the mode about {limit.agent}" if limit.agent else ""
    what = f"the vehicles' loop is unstable above {limit.gain:.2g} 1/s"
    if limit.kind == "rings":
        cause = LIMITED_BY[limit.effect]
        what = f"above {limit.gain:.2g} 1/s the team rings: the damping{whose} is limited by {cause}"
    told = [f"gain {record.gain:g} 1/s: {what}"]
    if len(record.gains.trials) > 1:
        now, *higher = map(_measured, record.gains.trials)
        told.append(f"a higher gain, measured on the bodies: {', '.join(higher)}; now {now}")
    return told


def _measured(trial: GainTrialRecord) -> str:
    if trial.late.tracking_error is None:
        return f"{trial.gain:.3g} 1/s blows up"
    endings = {"growing": ", diverging", "circling": ", in a limit cycle", "stuck": ", stuck"}
    unsettled = endings.get(trial.ending or "", "")
    limited = "" if trial.saturated is None else f" with thrusters at a limit {100 * trial.saturated:.0f}% of the time"
    return f"{trial.gain:.3g} 1/s: tracking error {trial.late.tracking_error:.3g} m RMS{limited}{unsettled}"


def _either(*choices: str) -> str:
    return ", or ".join(filter(None, [", ".join(choices[:-1]), choices[-1]]))


def _groups(record: CompareRecord) -> list[str]:
    """Report the dominant cause in each group where it differs from the team's; a fix that is the same is left out."""
    of_team = _lever(record, TEAM)
    known = {scope: lever for scope in record.scopes[1:] if (lever := _lever(record, scope)) is not None}
    if of_team is None or all(lever.kind == of_team.kind for lever in known.values()):
        return []
    largest = sorted(known, key=lambda scope: -(record.budget(scope, record.measure, "late").all_m or 0.0))
    return [
        f"{scope}: {lever}" if lever.cure != of_team.cure else f"{scope}: {lever.kind}: {lever.why}"
        for scope, lever in known.items()
        if scope in largest[:_MOST_GROUPS]
    ]


def _tracking(record: CompareRecord) -> list[str]:
    """Attribute the tracking error to the law or the bodies.

    It is reported if it is large compared with the formation, or if the ideal run has at least half of it and it
    exceeds the formation error.
    """
    if record.measure == TRACKING or record.rung("all").status != "finished":
        return []
    budget = record.budget(TEAM, TRACKING, "late")
    now = budget.all_m
    ideal = budget.ideal_m
    other = record.budget(TEAM, record.measure, "late").all_m
    if now is None or ideal is None or other is None:
        return []
    mostly_ideal = ideal >= 0.5 * now
    cause = _lag_of_law(record, ideal) if mostly_ideal else _cause_in_bodies(budget, now)
    told = f"tracking error {now:.3g} m, of that {min(ideal, now):.3g} m in the ideal run: {cause}"
    return [told] if now >= record.large_tracking_error or (mostly_ideal and now >= other) else []


def _lag_of_law(record: CompareRecord, ideal: float) -> str:
    """Attribute the tracking error of the ideal run, m, to the velocity limit and the law."""
    limit = record.limit_costs(TEAM, TRACKING, "ideal") or 0.0
    of_limit = f"{limit:.2g} m from the velocity limit, the rest from " if limit >= _LEAST_CAUSE_SHARE * ideal else ""
    return f"{of_limit}the law's lag; {_law(record, 'slower targets')}"


def _cause_in_bodies(budget: BudgetRecord, now: float) -> str:
    """Attribute the rest of the tracking error, m, to the effect whose removal reduces it most."""
    most, effect = next(iter(_ranked(budget)), (0.0, ""))
    notable = most >= _LEAST_BODY_SHARE * now
    first = f", mainly {display_name(effect)}: without it the error would be {_left(budget, most)}" if notable else ""
    return f"the rest is due to bodies{first}"


def _velocity_limit(record: CompareRecord) -> list[str]:
    """Report the fraction of time that agents spend at the law's velocity limit, and the errors without it."""
    limit = record.velocity_limit
    if limit is None or max(run.share_at_limit for run in limit.runs) < _LEAST_SATURATION:
        return []
    measures = dict.fromkeys((record.measure, TRACKING))
    errors = list(chain.from_iterable(_with_and_without(record, measure) for measure in measures))
    costs = [record.limit_costs(TEAM, measure, run.run) or 0.0 for measure, run in product(measures, limit.runs)]
    raised = f": {_raise_limit(record)}" if max(costs) > ROUNDING else ""
    without = f"; without it {', '.join(errors)}{raised}" if errors else ""
    limits = " to ".join(dict.fromkeys([f"{limit.lowest_m_s:.3g}", f"{limit.highest_m_s:.3g}"]))
    ideal = 100 * limit.run("ideal").share_at_limit
    whole = 100 * limit.run("all").share_at_limit
    return [
        f"agents are at their velocity limit ({limits} m/s) {ideal:.0f}% of the second half of the ideal run, "
        f"{whole:.0f}% as given{without}"
    ]


def _with_and_without(record: CompareRecord, measure: str) -> list[str]:
    """Describe one error with and without the velocity limit if the difference is notable."""
    found = [
        (record.rung(run).errors[TEAM].error(measure), record.limit_costs(TEAM, measure, run), name)
        for run, name in (("ideal", "ideal"), ("all", "as given"))
    ]
    known = [(now, less, name) for now, less, name in found if now is not None and less is not None]
    told = " and ".join(f"{now:.3g} -> {now - less:.3g} m {name}" for now, less, name in known)
    notably = any(abs(less) > max(_LEAST_BODY_SHARE * now, ROUNDING) for now, less, _ in known)
    return [f"{display_name(measure)} {told}"] if notably else []


def _raise_limit(record: CompareRecord) -> str:
    """Advise the limit that suffices: the largest speed commanded in the second half of the ideal run without one."""
    limit = record.velocity_limit
    assert limit is not None  # some agent has one
    return f"raise velocity_limit to {limit.asked_m_s:.3g} m/s, the maximum speed in the ideal run ({limit.who})"


def _speeds(record: CompareRecord) -> list[str]:
    """Report vehicles commanded beyond their speed; for bodies without limits, beyond that of any real vehicle."""
    fastest, sentences = {f.moves_in: f for f in record.fastest}, []
    for d in record.demands:
        if d.run != "ideal":
            continue
        asked = f"{d.role} of kind {d.vehicle} are commanded up to {d.asked_m_s:.3g} m/s ({d.who} at {d.time_s:.4g} s)"
        if d.least_speed_m_s is not None:
            if d.asked_m_s > d.least_speed_m_s:
                slower = "; none is slow enough"
                if d.least_speed_m_s > 0.0:
                    slower = f"; slow the motion{_and_gain(record)} {d.asked_m_s / d.least_speed_m_s:.2g} times"
                sentences.append(
                    f"{asked}, beyond their {d.least_speed_m_s:.3g} m/s (at full thrust in the slowest direction) for "
                    f"{100 * d.share_beyond:.0f}% of the time: tuning does not help{slower}"
                )
        elif (best := fastest.get(d.moves_in)) is not None and d.asked_m_s > best.speed_m_s:
            sentences.append(
                f"{asked}; the fastest real vehicle of mjsheaf in {d.moves_in}, {best.vehicle}, reaches "
                f"{best.speed_m_s:.3g} m/s: none can follow unless motion{_and_gain(record)} are slowed "
                f"{d.asked_m_s / best.speed_m_s:.2g} times, and the ladder ends at ideal thrusters"
            )
    return sentences


def _and_gain(record: CompareRecord) -> str:
    return " and gain" if record.gain is not None else " and commands"


def _saturation(record: CompareRecord) -> list[str]:
    total = next((s.share for s in record.rung("all").saturation if not s.vehicle), 0.0)
    return [f"agents' thrusters are at a limit {100 * total:.1f}% of the time"] if total >= 0.01 else []


def _ringing(record: CompareRecord) -> list[str]:
    """Report a team that rings before it comes to rest, and how to change that."""
    ringing = record.ringing
    if ringing is None or not ringing.measured:
        return []
    measured = ringing.measured[0].damping_ratio
    if measured is None or measured >= _RINGING_DAMPING:
        return []
    if measured < 0.0:
        return [f"the least damped mode (about {ringing.agent}) DIVERGES: lower controller.gain"]
    predicted = ringing.predicted_damping_ratio_held
    why = "" if measured > 0.7 * predicted else f", predicted {predicted:.2g} from inertia and the law's hold"
    late = f" without the measurements' delay of {ringing.delay_s:.3g} s" if why and ringing.delay_s else ""
    _, blamed = ringing.largest_rise
    cure = f", or {_RINGING_CURES[blamed]}" if blamed in _RINGING_CURES else ""
    return [
        f"it rings: damping ratio {measured:.2g} of the mode about {ringing.agent}{why}{late}; "
        f"lower controller.gain{cure}"
    ]
