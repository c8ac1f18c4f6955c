"""What compare.json holds, and what it says in sentences: how much bodies cost, what to change, what nothing mends.

Errors, distances and their parts are in m, times in s, speeds in m/s. What has no meaning, is infinite, or comes from a
run that blew up is null. Each part is defined by the module that computes it.
"""

from itertools import pairwise
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
from mjsheaf.io.section import Finite, FiniteRecord

_LOWER_GAIN = ", or a lower controller.gain"  # advice for laws that have one
_CHANGE = {
    "inertia": f"a faster autopilot (autopilot.rate){_LOWER_GAIN}",
    "drag_law": "hulls with less quadratic drag, or slower motion",
    "limits": "stronger thrusters, or slower targets, or a lower controller.velocity_limit",
    "lag": f"faster thrusters{_LOWER_GAIN}",
    "underactuation": "vehicles that push along every axis, or slower turns of what they follow",
    "contacts": "more room between vehicles",
}
_RINGING_CURES = {"lag": "faster thrusters", "underactuation": "a quicker attitude (attitude.frequency)"}
_UNSETTLED = {
    "growing": "its error GROWS to the end",
    "circling": "it swings by itself without end",
    "stuck": "an agent is commanded to move and does not (see the notes of mjsheaf run)",
}
_LEAST_BODY_SHARE = 0.05  # of the error, below which bodies are not what matters
_LEAST_CAUSE_SHARE = 0.25  # of what bodies add, below which no single effect is to blame
_LEAST_Q_STAR_SHARE = 0.5  # of the error, from which on q* itself is to blame
_LEAST_SATURATION = 0.01  # of the time at a limit of velocity or thrust, below which it is not reported
_LARGEST_PERCENTAGE = 10.0  # as a ratio; what is larger is given as a multiple of the ideal error
_LARGEST_MULTIPLE = 1000.0  # what is larger has next to no ideal error
_RINGING_DAMPING = 0.2  # damping ratio, below which the team rings
_LARGE_TRACKING = 0.1  # tracking error, of the formation's size
_GAIN_ROOM = 1.05  # of the gain, above which it is worth raising
LIMITED_BY = {
    "inertia": "inertia",
    "lag": "the lag of thrusters",
    "underactuation": "vehicles that turn before they push",
    "hold": "the hold of the law over controller.control_period",
    "links": "the age of measurements (links.delay)",
    "loop": "the loop of the vehicles",
}
_MOST_GROUPS = 6  # with sentences of their own


class LoopRecord(FiniteRecord):
    """The loop of the scenario's vehicles, for small motions, as `check` has it."""

    stable: bool | None = Field(description="null where undecided")
    largest_gain: float | None = Field(description="from which on it is unstable, 1/s")
    reason: str = Field(description="why it is undecided, or empty")


class PhaseRecord(FiniteRecord):
    """A phase of a run with events: errors over it, where they come from and what to change."""

    start: float = Field(description="time of its first sample, s")
    end: float = Field(description="time of its last sample, s")
    events: list[str] = Field(description="what happens at its start, in words")
    errors: dict[str, dict[str, ScopeRecord]] = Field(
        description="by key of the ladder, then by scope: at its end, and RMS over its last half; null where a run did "
        "not reach its end"
    )
    budgets: list[BudgetRecord] = Field(description="as those of the whole run, over this phase")
    velocity_limit: VelocityLimitRecord | None = Field(
        description="as that of the whole run, over this phase; null where no agent has one"
    )
    levers: list[str] = Field(description="what to change in this phase, the most telling sentence first")


class CompareRecord(FiniteRecord):
    """Ideal kinematics against bodies."""

    mjsheaf_version: str
    scenario: str
    origin: str | None = Field(None, description="scenario: its name, or its file relative to this directory")
    seed: int
    law: str = Field("paper's law", description="name of the law: the paper's with its terms, or that of `controller`")
    controller: str | None = Field(None, description="law in Python, FILE.py:NAME, or null")
    gain: float | None = Field(description="k1, 1/s; null under a law in Python, which ignores it")
    terms: list[str] = Field(default_factory=list, description="of the law beyond the paper's")
    harm: list[str] = Field(default_factory=list, description="what the terms do wrong as it stands, as `run` notes")
    usable_gain: float | None = Field(
        description="k1 up to which neither hold nor bodies ring, 1/s, from the least damped mode; null: any will do, "
        "or the law is in Python"
    )
    gains: GainRecord | None = Field(None, description="what limits the gain; null under a law in Python")
    loop: LoopRecord | None = Field(
        None, description="of the worst phase; null where the ideal run blew up, or under a law in Python"
    )
    time_s: float = Field(description="length of the run")
    formation_size_m: Finite = Field(description="RMS over edges inside groups of the distance they ask for")
    ladder: list[RungRecord]
    budgets: list[BudgetRecord]
    ringing: RingingRecord | None = Field(description="null for teams of too many states, and a law in Python")
    ringing_phase: int | None = Field(None, description="number of the phase it was measured for; null without events")
    convergence: ConvergenceRecord
    velocity_limit: VelocityLimitRecord | None = Field(None, description="null where no agent has one")
    demands: list[DemandRecord]
    fastest: list[FastestRecord]
    phases: list[PhaseRecord] = Field(default_factory=list, description="those of a run with events; else none")
    verdict: list[str] = Field(description="what to change, the most telling sentence first")
    wall_time_s: float
    video: str | None = Field(description="name of the file, or null")

    def rung(self, key: str) -> RungRecord:
        """The rung with a key."""
        return next(rung for rung in self.ladder if rung.key == key)

    def budget(self, scope: str, measure: str, statistic: str) -> BudgetRecord:
        """The budget of one error."""
        wanted = (scope, measure, statistic)
        return next(b for b in self.budgets if (b.scope, b.measure, b.statistic) == wanted)

    @property
    def law_in_words(self) -> str:
        """The law for titles: its gain and terms, or its name."""
        if self.gain is None:
            return f"law {self.law}"
        return ", ".join([f"gain {self.gain:g} 1/s", *self.terms])

    @property
    def scopes(self) -> list[str]:
        """'team', then the names of the groups."""
        return list(self.ladder[0].errors)

    @property
    def measure(self) -> Measure:
        """The error that matters: the formation error, or that of tracking in a team without formations."""
        return TRACKING if self.rung("ideal").errors[TEAM].late.formation_error is None else FORMATION

    def limit_costs(self, scope: str, measure: str, run: str) -> float | None:
        """What a late error of run 'ideal' or 'all' would lose without the velocity limit, m; None where unknown."""
        if self.velocity_limit is None:
            return None
        now = self.rung(run).errors[scope].error(measure)
        without = self.velocity_limit.run(run).errors_without[scope].error(measure)
        return None if now is None or without is None else now - without


def levers_of(record: CompareRecord, phase: PhaseRecord) -> list[str]:
    """Return the sentences about a phase, the most telling first."""
    alone = phase_alone(record, phase)
    parts = (_of_the_whole, _groups, _tracking, _velocity_limit)
    return [sentence for part in parts for sentence in part(alone)]


def phase_alone(record: CompareRecord, phase: PhaseRecord) -> CompareRecord:
    """Return a comparison that knows the errors of one phase alone."""
    ladder = [rung.model_copy(update={"errors": phase.errors[rung.key], "ending": None}) for rung in record.ladder]
    if phase.errors["all"][TEAM].final.tracking_error is not None:  # a run that blows up later has come so far
        ladder = [rung.model_copy(update={"status": "finished"}) for rung in ladder]
    own = {"ladder": ladder, "budgets": phase.budgets, "velocity_limit": phase.velocity_limit}
    return record.model_copy(update=own)


class _Lever(NamedTuple):
    """What would lower an error most: what it is, how much there is in it, and what to do, which may be empty."""

    kind: str
    why: str
    cure: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.why}" + (f"; {self.cure}" if self.cure else "")


def verdict_of(record: CompareRecord) -> list[str]:
    """The sentences, the most telling first."""
    harmful = (_harmful_terms,) if _harmful_terms(record) else ()
    law = (
        () if harmful else (_terms, _links, _groups, _tracking, _gain, _velocity_limit)
    )  # advice for a law that does what it can
    # Harm comes first: it names the cause of a team that never settles.
    parts = (*harmful, _unsettled, _of_the_whole, *law, _speeds, _saturation, _ringing)
    return [sentence for part in parts for sentence in part(record)]


def _unsettled(record: CompareRecord) -> list[str]:
    """That the team as it stands does not settle, or its loop is unstable."""
    what, loop = _UNSETTLED.get(record.rung("all").ending or ""), record.loop
    if loop is not None and loop.stable is False:
        most = loop.largest_gain
        limit = "" if most is None else f" from a gain of {most:.3g} 1/s on: lower controller.gain"
        what = (f"{what}; " if what else "") + f"the loop of its vehicles is unstable{limit}"
    return [f"the team never settles: {what}"] if what else []


def _of_the_whole(record: CompareRecord) -> list[str]:
    """How much bodies cost, and the largest lever."""
    whole = record.rung("all")
    if whole.status != "finished":
        stable = [r for r in record.ladder if r.kind == "without" and r.status == "finished"]
        names = " or without ".join(display_name(r.effect or "") for r in stable)
        lever = f"largest lever: it holds without {names}" if stable else "no effect alone is to blame"
        return [f"the scenario as it stands blows up ({whole.message})", lever]
    budget = record.budget(TEAM, record.measure, "late")
    if budget.ideal_m is None or budget.all_m is None:
        return ["the ideal run blows up: nothing can be compared with it"]
    cost, name = budget.all_m - budget.ideal_m, display_name(record.measure)
    over = f"{RMS_OVER[record.measure]} and the last half"
    if budget.all_m <= ROUNDING:
        ideal = f"{budget.ideal_m:.3g} m" if budget.ideal_m > ROUNDING else "zero to rounding"
        return [f"{name}, {over}: ideal {ideal}, as it stands zero to rounding: nothing to gain"]
    return [
        f"largest lever: {_lever(record, TEAM)}",
        f"{name}, {over}: ideal {budget.ideal_m:.3g} m, as it stands {budget.all_m:.3g} m; "
        f"bodies {'add' if cost >= 0 else 'take away'} {abs(cost):.2g} m ({_relative(budget.ideal_m, budget.all_m)})",
    ]


def _harmful_terms(record: CompareRecord) -> list[str]:
    """That the team would track better by the paper's law alone, and what the terms do wrong."""
    cost = None if record.controller else _costs_of_terms(record)
    if cost is None or cost[1] - cost[0] <= max(_LEAST_BODY_SHARE * cost[0], ROUNDING):
        return record.harm
    gist = f"tracking error {cost[1]:.3g} m as it stands, {cost[0]:.3g} m by the paper's law alone"
    return [f"{joined(record.terms)} HARM: {gist}", *record.harm]


def _terms(record: CompareRecord) -> list[str]:
    """What the terms of the law bring, where they do no harm."""
    cost = _costs_of_terms(record)
    if cost is None:
        return []
    ideal = [record.rung(key).errors[TEAM].error(TRACKING) for key in ("ideal-terms", "ideal")]
    known = "" if None in ideal else f", ideal {ideal[0]:.3g} -> {ideal[1]:.3g} m"
    if record.controller:
        what = f"{record.controller} instead of the paper's law at the scenario's gain"
    else:
        what = joined(record.terms)
    return [f"{what}: tracking error {cost[0]:.3g} -> {cost[1]:.3g} m as it stands{known}"]


def _links(record: CompareRecord) -> list[str]:
    """What links cost, where they are not perfect."""
    if not any(rung.kind == "links" for rung in record.ladder):
        return []
    found = [
        (record.rung(f"{key}-links").errors[TEAM].error(TRACKING), record.rung(key).errors[TEAM].error(TRACKING))
        for key in ("all", "ideal")
    ]
    costs = [
        f"{perfect:.3g} -> {now:.3g} m {name}"
        for (perfect, now), name in zip(found, ("as it stands", "ideal"), strict=True)
        if perfect is not None and now is not None
    ]
    return [f"links as they are, against perfect ones: tracking error {', '.join(costs)}"] if costs else []


def _costs_of_terms(record: CompareRecord) -> tuple[float, float] | None:
    """Tracking error as it stands by the paper's law alone, and with the terms, RMS over the last half, m."""
    if not record.terms and record.controller is None:
        return None
    without, now = (record.rung(key).errors[TEAM].error(TRACKING) for key in ("all-terms", "all"))
    return None if without is None or now is None else (without, now)


def _relative(ideal: float, now: float) -> str:
    """An error against that of the ideal run: a percentage, a multiple, or neither where the ideal one is next to 0."""
    if now > _LARGEST_MULTIPLE * ideal:
        return "nearly all of it"
    if now > _LARGEST_PERCENTAGE * ideal:
        return f"{now / ideal:.2g} times the ideal"
    return f"{100.0 * (now - ideal) / max(ideal, 1e-12):+.1f}%"


def _ranked(budget: BudgetRecord) -> list[tuple[float, str]]:
    """What removing each effect gives back, m, and its name; the most first."""
    return sorted(((item.give_back_m or 0.0, item.effect) for item in budget.effects), reverse=True)


def _lever(record: CompareRecord, scope: str) -> _Lever | None:
    """What would lower the error of the team or a group most; None where it is not known, or nothing would."""
    budget = record.budget(scope, record.measure, "late")
    if budget.ideal_m is None or budget.all_m is None or budget.all_m <= ROUNDING:
        return None
    floor = budget.at_q_star_m
    if floor is not None and floor >= _LEAST_Q_STAR_SHARE * budget.all_m:
        return _Lever(
            "the sheaf, not law or vehicles",
            f"q* itself is {floor:.3g} m out of formation (now {budget.all_m:.3g} m)",
            "give the edges between groups an `offset`, or weigh sensing and formation edges more against them",
        )
    now = f"{budget.all_m:.3g} m now, {budget.ideal_m:.3g} m ideal"
    effects = _ranked(budget)
    limit = record.limit_costs(scope, record.measure, "all") or 0.0
    if 0.0 < limit >= _LEAST_CAUSE_SHARE * budget.all_m and limit >= max(effects, default=(limit, ""))[0]:
        less = f"without it the error would be {limit:.2g} m less ({now})"
        return _Lever("the velocity limit", less, _raise_limit(record))
    cost = budget.all_m - budget.ideal_m
    if cost <= _LEAST_BODY_SHARE * budget.all_m:
        return _Lever("the law, not the vehicles", now, _law(record, "more agents that sense", "slower targets"))
    return _lever_of_bodies(budget, _changes(record), cost, now)


def _lever_of_bodies(budget: BudgetRecord, changes: dict[str, str], cost: float, now: str) -> _Lever:
    """Return what would lower most the part of an error that bodies add.

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
        then = "".join(f"; then {display_name(e)} with {x:.2g} m: {changes[e]}" for x, e in others)
        less = f"without it the error would be {most:.2g} m less ({now})"
        return _Lever(display_name(effect), less, f"{changes[effect]}{then}")
    share, who = max((budget.agents_m or 0.0, "agents"), (budget.targets_m or 0.0, "targets"))
    if share >= _LEAST_CAUSE_SHARE * cost:
        why = f"as bodies with ideal thrusters they cost {share:.2g} m already ({now})"
        return _Lever(f"time constant tau of the {who}", why, "")
    return _Lever("no single effect", f"bodies add {cost:.2g} m together ({now})", "see the interaction in the budget")


def _changes(record: CompareRecord) -> dict[str, str]:
    """Advise what lowers the cost of each effect, without a gain that the law ignores."""
    if record.gain is not None:
        return _CHANGE
    return {effect: change.removesuffix(_LOWER_GAIN) for effect, change in _CHANGE.items()}


def _law(record: CompareRecord, *others: str) -> str:
    """What lowers the ideal run's own error: a higher gain, as far as there is room for it, or something else."""
    if record.gain is None:
        return _either(f"another law than {record.law}", *others)
    room = record.usable_gain
    if room is not None and room <= _GAIN_ROOM * record.gain:
        why = f" by {LIMITED_BY[limit.effect]}" if (limit := _lowest_limit(record)) else ""
        return f"{_either(*others)} (a higher gain rings: from {room:.2g} 1/s on{why})"
    upto = "" if room is None else f" (up to {room:.2g} 1/s without ringing)"
    return _either(f"a higher controller.gain{upto}", *others)


def _lowest_limit(record: CompareRecord) -> GainLimitRecord | None:
    return record.gains.limits[0] if record.gains and record.gains.limits else None


def _gain(record: CompareRecord) -> list[str]:
    """Say what limits the gain, and what a higher one gives in runs."""
    limit = _lowest_limit(record)
    if record.gain is None or record.gains is None or limit is None:
        return []
    whose = f" of the mode about {limit.agent}" if limit.agent else ""
    what = f"the vehicles' loop is unstable from {limit.gain:.2g} 1/s on"
    if limit.kind == "rings":
        cause = LIMITED_BY[limit.effect]
        what = f"from {limit.gain:.2g} 1/s on the team rings: the damping{whose} is limited by {cause}"
    told = [f"gain {record.gain:g} 1/s: {what}"]
    if len(record.gains.trials) > 1:
        now, *higher = map(_measured, record.gains.trials)
        told.append(f"a higher gain, measured on the bodies: {', '.join(higher)}; now {now}")
    return told


def _measured(trial: GainTrialRecord) -> str:
    if trial.late.tracking_error is None:
        return f"{trial.gain:.3g} 1/s blows up"
    endings = {"growing": ", growing", "circling": ", swinging without end", "stuck": ", stuck"}
    unsettled = endings.get(trial.ending or "", "")
    limited = "" if trial.saturated is None else f" with thrusters at a limit {100 * trial.saturated:.0f}% of the time"
    return f"{trial.gain:.3g} 1/s: tracking error {trial.late.tracking_error:.3g} m RMS{limited}{unsettled}"


def _either(*choices: str) -> str:
    return ", or ".join(filter(None, [", ".join(choices[:-1]), choices[-1]]))


def _groups(record: CompareRecord) -> list[str]:
    """The groups' own levers where they differ: in full, but for what is said of the team already."""
    of_team = _lever(record, TEAM)
    known = {scope: lever for scope in record.scopes[1:] if (lever := _lever(record, scope)) is not None}
    if of_team is None or all(lever.kind == of_team.kind for lever in known.values()):
        return []
    errors = {scope: record.budget(scope, record.measure, "late").all_m or 0.0 for scope in known}
    chosen = sorted(known, key=lambda scope: errors[scope], reverse=True)[:_MOST_GROUPS]
    return [
        f"{scope}: {lever}" if lever.cure != of_team.cure else f"{scope}: {lever.kind}: {lever.why}"
        for scope, lever in known.items()
        if scope in chosen
    ]


def _tracking(record: CompareRecord) -> list[str]:
    """Whose the tracking error is, where it is large beside the formation, or mostly the law's and beyond its error."""
    if record.measure == TRACKING or record.rung("all").status != "finished":
        return []
    budget, other = record.budget(TEAM, TRACKING, "late"), record.budget(TEAM, record.measure, "late")
    now, ideal, size = budget.all_m, budget.ideal_m, record.formation_size_m
    if now is None or ideal is None or other.all_m is None:
        return []
    own = ideal >= 0.5 * now
    if not (size is not None and now >= _LARGE_TRACKING * size) and not (own and now >= other.all_m):
        return []
    told = f"tracking error {now:.3g} m, {min(ideal, now):.3g} m of it in the ideal run"
    if own:
        limit = record.limit_costs(TEAM, TRACKING, "ideal") or 0.0
        of_limit = f"{limit:.2g} m of that by the velocity limit, the rest by " * (limit >= _LEAST_CAUSE_SHARE * ideal)
        return [f"{told}: {of_limit}the law's own lag; {_law(record, 'slower targets')}"]
    most, effect = next(iter(_ranked(budget)), (0.0, ""))
    notably = most >= _LEAST_BODY_SHARE * now
    first = f"; {display_name(effect)} first, without which it would be {most:.2g} m less" if notably else ""
    return [f"{told}: the bodies'{first}"]


def _velocity_limit(record: CompareRecord) -> list[str]:
    """How much of the time agents are at the law's velocity limit, and what the errors are without it."""
    limit = record.velocity_limit
    if limit is None or max(run.share_at_limit for run in limit.runs) < _LEAST_SATURATION:
        return []
    ideal, whole = limit.run("ideal"), limit.run("all")
    measures = dict.fromkeys((record.measure, TRACKING))
    errors = [text for measure in measures for text in _with_and_without(record, measure)]
    costs = [record.limit_costs(TEAM, measure, run.run) or 0.0 for measure in measures for run in limit.runs]
    limits = " to ".join(dict.fromkeys([f"{limit.lowest_m_s:.3g}", f"{limit.highest_m_s:.3g}"]))
    told = (
        f"agents are at their velocity limit ({limits} m/s) {100 * ideal.share_at_limit:.0f}% of the last half of "
        f"the ideal run, {100 * whole.share_at_limit:.0f}% as it stands"
    )
    if errors:
        told += f"; without it {', '.join(errors)}" + (f": {_raise_limit(record)}" if max(costs) > ROUNDING else "")
    return [told]


def _with_and_without(record: CompareRecord, measure: str) -> list[str]:
    """One error with and without the velocity limit, where it differs notably."""
    found = [
        (record.rung(run).errors[TEAM].error(measure), record.limit_costs(TEAM, measure, run), name)
        for run, name in (("ideal", "ideal"), ("all", "as it stands"))
    ]
    known = [(now, less, name) for now, less, name in found if now is not None and less is not None]
    told = " and ".join(f"{now:.3g} -> {now - less:.3g} m {name}" for now, less, name in known)
    notably = any(abs(less) > max(_LEAST_BODY_SHARE * now, ROUNDING) for now, less, _ in known)
    return [f"{display_name(measure)} {told}"] if notably else []


def _raise_limit(record: CompareRecord) -> str:
    """The limit that does: the largest speed that the last half of the ideal run asks for without one."""
    limit = record.velocity_limit
    assert limit is not None  # some agent has one
    return f"raise velocity_limit to {limit.asked_m_s:.3g} m/s, the most that the ideal run asks for ({limit.who})"


def _speeds(record: CompareRecord) -> list[str]:
    """Who is asked for more than it can do, and, for bodies without limits, whether a real vehicle could."""
    fastest, sentences = {f.moves_in: f for f in record.fastest}, []
    for d in record.demands:
        if d.run != "ideal":
            continue
        asked = f"{d.role} of kind {d.vehicle} are asked for up to {d.asked_m_s:.3g} m/s ({d.who} at {d.time_s:.4g} s)"
        if d.least_speed_m_s is not None:
            if d.asked_m_s > d.least_speed_m_s:
                times = f"{d.asked_m_s / d.least_speed_m_s:.2g} times"
                sentences.append(
                    f"{asked}, beyond their {d.least_speed_m_s:.3g} m/s (at full thrust in the slowest direction) for "
                    f"{100 * d.share_beyond:.0f}% of the time: no tuning helps; slow the "
                    f"motion{_and_gain(record)} {times}"
                )
        elif (best := fastest.get(d.moves_in)) is not None and d.asked_m_s > best.speed_m_s:
            sentences.append(
                f"{asked}; the fastest real vehicle of mjsheaf in {d.moves_in}, {best.vehicle}, makes "
                f"{best.speed_m_s:.3g} m/s: none follows unless motion{_and_gain(record)} are slowed "
                f"{d.asked_m_s / best.speed_m_s:.2g} times, and the ladder ends at ideal thrusters"
            )
    return sentences


def _and_gain(record: CompareRecord) -> str:
    return " and gain" if record.gain is not None else " and commands"


def _saturation(record: CompareRecord) -> list[str]:
    total = next((s.share for s in record.rung("all").saturation if not s.vehicle), 0.0)
    return [f"agents' thrusters are at a limit {100 * total:.1f}% of the time"] if total >= 0.01 else []


def _ringing(record: CompareRecord) -> list[str]:
    """That bodies swing many times before they are still, and how to change that."""
    ringing = record.ringing
    measured = ringing.measured[0].damping_ratio if ringing and ringing.measured else None
    if ringing is None or measured is None or measured >= _RINGING_DAMPING:
        return []
    if measured < 0.0:
        return [f"the least damped mode (about {ringing.agent}) GROWS: lower controller.gain"]
    predicted = ringing.predicted_damping_ratio_held
    why = "" if measured > 0.7 * predicted else f", where inertia and the law's hold alone would leave {predicted:.2g}"
    late = f" and measurements were not {ringing.delay_s:.3g} s old" if why and ringing.delay_s else ""
    known = [(m.bodies, m.damping_ratio) for m in ringing.measured if m.damping_ratio is not None]
    blamed = max(((later[1] - now[1], later[0]) for now, later in pairwise(known)), default=(0.0, ""))[1]
    cures = [f", or {cure}" for effect, cure in _RINGING_CURES.items() if blamed.endswith(effect)]
    return [
        f"it rings: damping ratio {measured:.2g} of the mode about {ringing.agent}{why}{late}; "
        f"lower controller.gain{''.join(cures)}"
    ]
