"""Contents of compare.json, and the verdict in sentences: the cause of each error, its size, and what to change.

Errors, distances and their parts are in m, times in s, speeds in m/s. A value is null if it is undefined, infinite, or
from a run that blew up. Each part is defined by the module that computes it.
"""

from math import floor, log10

from pydantic import Field

from mjsheaf.comparing.margins import (
    MIN_DAMPING,
    DemandRecord,
    FastestRecord,
    GainTrialRecord,
    LoopRecord,
    RingingRecord,
    VelocityLimitRecord,
)
from mjsheaf.comparing.variants import (
    FORMATION,
    TEAM,
    TRACKING,
    BudgetRecord,
    ConvergenceRecord,
    Measure,
    RungRecord,
    ScopeRecord,
    display_name,
)
from mjsheaf.errors import joined, listed
from mjsheaf.results.ending import ROUNDING
from mjsheaf.section import Finite, FiniteRecord

_LOWER_GAIN = ", or a lower controller.gain"  # advice for laws that have one
_CHANGE = {
    "inertia": f"a faster autopilot (autopilot.rate){_LOWER_GAIN}",
    "drag_law": "hulls with less quadratic drag, or slower motion",
    "limits": "stronger thrusters, or slower motion, or a lower controller.velocity_limit",
    "lag": f"faster thrusters{_LOWER_GAIN}",
    "underactuation": "vehicles with thrust along every axis, or slower turns of what they follow",
    "contacts": "more room between vehicles",
}
"""Fix for each effect."""

LIMITED_BY = {
    "inertia": "inertia",
    "lag": "the lag of thrusters",
    "underactuation": "vehicles that turn before they push",
    "hold": "the hold of the law over controller.control_period",
    "links": "the age of measurements (links.delay)",
}
"""What limits the gain, in words."""

_RINGING_CURES = {"lag": "faster thrusters", "underactuation": "a quicker attitude (attitude.frequency)"}
_MIN_BODY_FRACTION = 0.05  # of the error; bodies that add less are not reported as its cause


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
        description="largest k1 at which the vehicles' loop neither rings nor is unstable, 1/s; null if every gain is "
        "usable, or if the loop is undecided, or if the law is in Python"
    )
    gains: list[GainTrialRecord] = Field(
        default_factory=list, description="runs at the present gain, then at higher ones; none where none is worth it"
    )
    loop: LoopRecord | None = Field(None, description="loop over all phases; null under a law in Python")
    time_s: float = Field(description="length of the run")
    formation_size_m: Finite = Field(description="RMS over edges inside groups of their desired length")
    ladder: list[RungRecord]
    budgets: list[BudgetRecord]
    ringing: RingingRecord | None = Field(
        description="loop in the phase in which it is least damped, without losses of links; null under a law in Python"
    )
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

    def error(self, key: str, scope: str, measure: str) -> float | None:
        """Return an error of a variant over the second half, m; None if it is unknown, or if there is no such variant.

        Args:
            key: Key of the variant.
            scope: 'team' or the name of a group.
            measure: Field of `ErrorsRecord`.
        """
        rung = next((rung for rung in self.ladder if rung.key == key), None)
        return None if rung is None else rung.errors[scope].error(measure)

    def saved_by(self, key: str, scope: str, measure: str) -> float:
        """Return how much smaller an error of the scenario as given is in another variant, m; 0 if unknown."""
        now, then = self.error("all", scope, measure), self.error(key, scope, measure)
        return 0.0 if now is None or then is None else now - then


def levers_of(record: CompareRecord, phase: PhaseRecord) -> list[str]:
    """Return the sentences about the errors of a phase, the most important first."""
    ladder = [rung.model_copy(update={"errors": phase.errors[rung.key], "ending": None}) for rung in record.ladder]
    if phase.errors["all"][TEAM].final.tracking_error is not None:  # the run reached the phase's end
        ladder = [rung.model_copy(update={"status": "finished"}) for rung in ladder]
    return _errors(
        record.model_copy(update={"ladder": ladder, "budgets": phase.budgets, "velocity_limit": phase.velocity_limit})
    )


def verdict_of(record: CompareRecord) -> list[str]:
    """Compose the sentences of the verdict, the most important first."""
    sentences = _harmful_terms(record)  # they come first, as they explain why a team does not converge
    also = ", on ideal kinematics too" if record.rung("ideal").ending == "diverging" else ""
    causes = [f"its error DIVERGES{also}"] if record.rung("all").ending == "diverging" else []
    loop = next((one for one in (record.loop, record.ringing) if one is not None and one.stable is False), None)
    if loop is not None:
        limit = (
            "" if loop.largest_gain is None else f" at gains above {loop.largest_gain:.3g} 1/s: lower controller.gain"
        )
        causes.append(f"the loop of its vehicles is unstable{limit}")
    if causes:
        sentences = [*sentences, f"the team does not converge: {'; '.join(causes)}"]
    return [*sentences, *_errors(record), *_gain(record), *_speeds(record)]


def _errors(record: CompareRecord) -> list[str]:
    """Report each error of the team as the sum of its parts, with its dominant cause and a fix."""
    if record.rung("all").status != "finished":
        stable = [r for r in record.ladder if r.kind == "without" and r.status == "finished"]
        names = " or without ".join(display_name(r.effect or "") for r in stable)
        cause = f"dominant cause: it is stable without {names}" if stable else "no single effect is the cause"
        return [f"the scenario as given blows up ({record.rung('all').message})", cause]
    if record.budget(TEAM, record.measure, "late").ideal_m is None:
        return ["the ideal run blows up, so nothing can be compared with it"]
    sentences = []
    for measure in dict.fromkeys((TRACKING, record.measure)):
        budget = record.budget(TEAM, measure, "late")
        cause = _cause(record, measure)
        parts = f"{display_name(measure)}: {_sum_of_parts(budget)}"
        sentences.append(f"{parts}; dominant cause: {cause}" if cause else f"{parts}: nothing to gain")
    return sentences


def _sum_of_parts(
    budget: BudgetRecord,
    *,
    least: float = 0.01,  # of the error; smaller parts are named together
) -> str:
    """Write an error as the sum of its parts: what each effect adds alone, and what they add in combination."""
    if budget.ideal_m is None or budget.all_m is None:
        return "unknown"
    if budget.all_m <= ROUNDING:
        return "zero to rounding on bodies"
    decimals = 2 - floor(log10(budget.all_m))
    whole = round(budget.all_m, decimals)
    parts = {"targets as bodies": budget.targets_m, "agents as bodies": budget.agents_m}
    parts |= {display_name(item.effect): item.alone_m for item in budget.effects}
    large = {name: added for name, added in parts.items() if added is not None and abs(added) >= least * whole}
    named = {name: round(x, decimals) for name, x in {"on ideal kinematics": budget.ideal_m, **large}.items()}
    rest = round(whole - sum(named.values()), decimals)
    if rest:
        named["in combination"] = rest
    terms = [f"{'-' if x < 0.0 else '+'} {abs(x):.{max(decimals, 0)}f} m {name}" for name, x in named.items()]
    return f"{' '.join(terms).removeprefix('+ ')} = {whole:.{max(decimals, 0)}f} m on bodies"


def _cause(
    record: CompareRecord,
    measure: Measure,
    *,
    cause_fraction: float = 0.25,  # of the error, or of the part that bodies add; a smaller part is not a cause
    q_star_fraction: float = 0.5,  # of the error; if q* itself has more, the sheaf is the cause
) -> str:
    """Return the dominant cause of an error of the team, and a fix; empty if the error is unknown or zero.

    It is the sheaf if q* itself has half of the error; else what removes the most of it: perfect links, the paper's law
    alone or no velocity limit, if that is a quarter of the error, or an effect of bodies, if that is a quarter of what
    bodies add; else the law, or the bodies as a whole.
    """
    budget = record.budget(TEAM, measure, "late")
    if budget.ideal_m is None or budget.all_m is None or budget.all_m <= ROUNDING:
        return ""
    if (budget.at_q_star_m or 0.0) >= q_star_fraction * budget.all_m:
        groups = []
        for scope in record.scopes[1:]:
            own = record.budget(scope, measure, "late")
            if (own.at_q_star_m or 0.0) >= q_star_fraction * max(own.all_m or 0.0, ROUNDING):
                groups.append(scope)
        where = f" in {listed(groups)}" if 0 < len(groups) < len(record.scopes) - 1 else ""
        return (
            f"the sheaf, not the law or the vehicles, as q* itself is {budget.at_q_star_m:.3g} m out of formation"
            f"{where}: give the edges between groups an `offset`, or increase the weights of sensing and formation "
            "edges"
        )
    added = budget.all_m - budget.ideal_m
    least = cause_fraction * budget.all_m
    ignored = _LOWER_GAIN if record.gain is None else ""
    causes = [
        (
            record.saved_by("all-links", TEAM, measure),
            least,
            "imperfect links",
            "better links (links.noise, loss, delay)",
        )
    ]
    if record.terms:
        saved = record.saved_by("all-terms", TEAM, measure)
        causes.append((saved, least, joined(record.terms), "the paper's law alone, or better odometry"))
    if record.velocity_limit is not None:
        limit = record.velocity_limit
        saved = record.saved_by("all-limit", TEAM, measure)
        # What suffices is the largest speed commanded in the second half of the ideal run without a limit, unless it is
        # only on their way there that agents lack speed.
        fix = f"raise velocity_limit to {limit.asked_m_s:.3g} m/s, the maximum speed in the ideal run ({limit.who})"
        if not limit.exceeded:
            fix = "raise velocity_limit, which is too low on the way to q* alone"
        causes.append((saved, least, "the velocity limit", fix))
    if added > _MIN_BODY_FRACTION * budget.all_m:
        for item in budget.effects:
            least_of_bodies = cause_fraction * added
            causes.append(
                (
                    item.give_back_m or 0.0,
                    least_of_bodies,
                    display_name(item.effect),
                    _CHANGE[item.effect].removesuffix(ignored),
                )
            )
    ranked = sorted((cause for cause in causes if cause[0] >= max(cause[1], ROUNDING)), reverse=True)
    if ranked:
        saved, _, name, fix = ranked[0]
        others = [cause for cause in ranked[1:2] if cause[0] >= 0.5 * saved]
        then = "".join(f"; or {_without(budget, x, other)}: {remedy}" for x, _, other, remedy in others)
        return f"{_without(budget, saved, name)}: {fix}{then}"
    if added <= _MIN_BODY_FRACTION * budget.all_m:
        return f"the law, not the vehicles: {_change_of_law(record)}"
    part, who = max((budget.agents_m or 0.0, "agents"), (budget.targets_m or 0.0, "targets"))
    if part >= cause_fraction * added:
        return f"the time constant tau of the {who}, which add {part:.2g} m with ideal thrusters"
    return f"no single effect, as bodies add {added:.2g} m together: see the interaction in the budget"


def _without(budget: BudgetRecord, saved: float, name: str) -> str:
    """Name a cause, and the error that is left without it: such parts overlap and do not add up."""
    return f"{name} ({max((budget.all_m or 0.0) - saved, 0.0):.3g} m without)"


def _change_of_law(
    record: CompareRecord,
    *,
    room_factor: float = 1.05,  # ratio of the usable to the present gain above which raising the gain is advised
) -> str:
    """Advise how to lower the ideal run's error: a higher gain up to the usable one, and what concerns targets."""
    targets = any(demand.role == "targets" for demand in record.demands)
    if record.gain is None:
        return f"another law than {record.law}{', or slower targets' if targets else ''}"
    room = record.usable_gain
    others = "more sensing agents, or slower targets" if targets else ""
    if room is None or room > room_factor * record.gain:
        upto = "" if room is None else f" (up to {room:.2g} 1/s)"
        return f"a higher controller.gain{upto}{others and ', '}{others}"
    return f"{others or 'another law'} (a higher gain rings, above {room:.2g} 1/s)"


def _harmful_terms(record: CompareRecord) -> list[str]:
    """Warn if the team would track better under the paper's law alone, and say why."""
    without, now = record.error("all-terms", TEAM, TRACKING), record.error("all", TEAM, TRACKING)
    harmful = without is not None and now is not None and now - without > max(_MIN_BODY_FRACTION * without, ROUNDING)
    if record.controller or not harmful:
        return record.harm
    gist = f"tracking error {now:.3g} m as given, {without:.3g} m under the paper's law alone"
    return [f"WARNING: the error is larger with {joined(record.terms)}: {gist}", *record.harm]


def _gain(
    record: CompareRecord,
    *,
    least_damping: float = 0.2,  # damping ratio below which the team rings
) -> list[str]:
    """Report what limits the gain; and how the team rings, if it does."""
    ringing = record.ringing
    if ringing is None or ringing.usable_gain is None or ringing.least_damped is None:
        return []
    mode = ringing.least_damped
    about = f" of the mode about {mode.agent}" if mode.agent else ""
    limit = (
        f"above {ringing.usable_gain:.2g} 1/s the damping ratio is below {MIN_DAMPING}, limited by "
        f"{LIMITED_BY[ringing.effect]}"
    )
    largest = None if record.loop is None else record.loop.largest_gain
    if largest is not None and largest < ringing.usable_gain:  # in another phase
        limit = f"above {largest:.2g} 1/s the vehicles' loop is unstable"
    cure = f"lower controller.gain, or {_RINGING_CURES[ringing.effect]}" if ringing.effect in _RINGING_CURES else ""
    now = f"gain {record.gain:g} 1/s: "
    if mode.damping < least_damping:
        cure = cure or "lower controller.gain"
        now += f"the team rings, with the damping ratio {mode.damping:.2g}{about}; "
    return ["; ".join(filter(None, [now + limit, cure]))]


def _speeds(record: CompareRecord) -> list[str]:
    """Report vehicles commanded beyond their speed; for bodies without limits, beyond that of any real vehicle."""
    fastest = {f.moves_in: f for f in record.fastest}
    what = "motion and gain" if record.gain is not None else "motion and commands"
    sentences = []
    for d in record.demands:
        if d.run != "ideal":
            continue
        asked = f"{d.role} of kind {d.vehicle} are commanded up to {d.asked_m_s:.3g} m/s ({d.who} at {d.time_s:.4g} s)"
        best = fastest.get(d.moves_in)
        if d.least_speed_m_s is not None and d.asked_m_s > d.least_speed_m_s:
            slower = f"slow {what} {d.asked_m_s / d.least_speed_m_s:.2g} times" if d.least_speed_m_s else "none is slow"
            sentences.append(
                f"{asked}, beyond their {d.least_speed_m_s:.3g} m/s (at full thrust in the slowest direction) for "
                f"{100 * d.share_beyond:.0f}% of the time: {slower}"
            )
        elif d.least_speed_m_s is None and best is not None and d.asked_m_s > best.speed_m_s:
            sentences.append(
                f"{asked}; the fastest real vehicle in {d.moves_in}, {best.vehicle}, reaches {best.speed_m_s:.3g} m/s: "
                f"slow {what} {d.asked_m_s / best.speed_m_s:.2g} times"
            )
    return sentences
