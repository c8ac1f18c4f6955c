"""The error budget: how much of a team's error each effect adds.

With E the error of a rung, base and all as in `ladder`:

    all = ideal + (targets - ideal) + (agents - ideal) + together + sum over effects of (+EFFECT - base) + interaction

where `together` is what both as bodies have beyond the sum of the parts, and `interaction` what all effects have beyond
the sum of each alone. What removing an effect would give back is all - (-EFFECT); with interaction it is not what the
effect adds alone, and it is what tells a person what to change.

What a comparison says, in sentences: how much bodies cost, what to change, and what no change of vehicle mends.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite

from mjsheaf.comparing.ladder import Rung, words
from mjsheaf.comparing.measures import TEAM
from mjsheaf.comparing.record import CompareRecord, RingingRecord


@dataclass(frozen=True)
class Item:
    """One effect's part in an error, in m; None where a rung that it needs blew up.

    Attributes:
        effect: its name.
        alone: what it adds to bodies with ideal thrusters.
        give_back: what the whole would lose without it.
    """

    effect: str
    alone: float | None
    give_back: float | None


@dataclass(frozen=True)
class Budget:
    """Where one error comes from, in m; None where a rung that it needs blew up.

    Attributes:
        ideal: of ideal kinematics.
        targets, agents: what they add as bodies with ideal thrusters, each apart.
        together: what both have beyond that.
        items: the effects.
        interaction: what all effects have beyond the sum of each alone.
        whole: of the scenario as it stands: the sum of all of these (but for give_back).
    """

    ideal: float | None
    targets: float | None
    agents: float | None
    together: float | None
    items: list[Item]
    interaction: float | None
    whole: float | None


def budget_of(ladder: list[Rung], error: Callable[[str], float]) -> Budget:
    """The budget of one error.

    Args:
        ladder: the rungs.
        error: of the rung with a key, m; not finite where it has none.
    """

    def value(key: str) -> float | None:
        found = error(key)
        return float(found) if isfinite(found) else None

    ideal, base, whole = value("ideal"), value("base"), value("all")
    targets, agents = _less(value("targets"), ideal), _less(value("agents"), ideal)
    effects = [rung.effect for rung in ladder if rung.kind == "alone" and rung.effect is not None]
    items = [Item(e, _less(value(f"+{e}"), base), _less(whole, value(f"-{e}"))) for e in effects]
    return Budget(
        ideal=ideal,
        targets=targets,
        agents=agents,
        together=_less(_less(base, ideal), _sum([targets, agents])),
        items=items,
        interaction=_less(_less(whole, base), _sum([item.alone for item in items])),
        whole=whole,
    )


def _less(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else one - other


def _sum(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) if len(known) == len(values) else None


_CHANGE = {
    "inertia": "a faster autopilot (autopilot.rate), or a lower controller.gain",
    "drag_law": "hulls with less quadratic drag, or slower motion",
    "limits": "stronger thrusters, or slower targets, or a lower controller.velocity_limit",
    "lag": "faster thrusters, or a lower controller.gain",
    "underactuation": "vehicles that push along every axis, or slower turns of what they follow",
    "contacts": "more room between vehicles",
}
_CALM = {"lag": "faster thrusters", "underactuation": "a quicker attitude (attitude.frequency)"}
_SMALL = 0.05  # of the error, below which bodies are not what matters
_TELLING = 0.25  # of what bodies add, below which no single effect is to blame
_RINGS = 0.2  # damping ratio
_FLOOR = 0.5  # of the error, from which on q* itself is to blame
_FAR = 0.1  # tracking error, of the formation's size
_ROOM = 1.05  # of the gain, above which it is worth raising
_SELDOM = 0.01  # of the time at the velocity limit, below which it is no matter
_MOST_GROUPS = 6  # that are told apart


@dataclass(frozen=True)
class _Lever:
    """What would lower an error most.

    Attributes:
        kind: what it is, before the first colon.
        why: how much there is in it.
        cure: what to do; may be empty.
    """

    kind: str
    why: str
    cure: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.why}" + (f"; {self.cure}" if self.cure else "")


def verdict_of(record: CompareRecord) -> list[str]:
    """The sentences, the most telling first."""
    whole = _of_the_whole(record)
    return (
        _unsettled(record)
        + whole
        + _groups(record)
        + _tracking(record)
        + _velocity_limit(record)
        + _speeds(record)
        + _saturation(record)
        + _ringing(record.ringing)
    )


def _unsettled(record: CompareRecord) -> list[str]:
    """That the team as it stands does not settle, or its loop is unstable."""
    ending, loop = record.rung("all").ending, record.loop
    own = ending in ("growing", "circling")
    if not own and (loop is None or loop.stable is not False):
        return []
    what = {"growing": "its error GROWS to the end", "circling": "it swings by itself without end"}.get(
        ending or "", "its vehicles' loop is unstable"
    )
    if loop is None or loop.stable is not False:
        return [f"the team never settles: {what}"]
    limit = (
        "" if loop.largest_gain is None else f" from a gain of {loop.largest_gain:.3g} 1/s on: lower controller.gain"
    )
    return [f"the team never settles: {what}; the loop of its vehicles is unstable{limit}"]


def _of_the_whole(record: CompareRecord) -> list[str]:
    """How much bodies cost, and the largest lever."""
    whole = record.rung("all")
    if whole.status != "finished":
        saviours = [words(r.effect or "") for r in record.ladder if r.kind == "without" and r.status == "finished"]
        lever = (
            f"largest lever: it holds without {' or without '.join(saviours)}"
            if saviours
            else "no effect alone is to blame"
        )
        return [f"the scenario as it stands blows up ({whole.message})", lever]
    budget = record.budget(TEAM, record.measure, "late")
    if budget.ideal_m is None or budget.all_m is None:
        return ["the ideal run blows up: nothing can be compared with it"]
    cost = budget.all_m - budget.ideal_m
    name = record.measure.replace("_", " ")
    return [
        f"largest lever: {_lever(record, TEAM)}",
        f"{name}, RMS over the last half: ideal {budget.ideal_m:.3g} m, as it stands {budget.all_m:.3g} m; "
        f"bodies {'add' if cost >= 0 else 'take away'} {abs(cost):.2g} m "
        f"({100 * cost / max(budget.ideal_m, 1e-12):+.1f}%)",
    ]


def _lever(record: CompareRecord, scope: str) -> _Lever | None:
    """What would lower the error of the team or a group most; None where it is not known."""
    budget = record.budget(scope, record.measure, "late")
    if budget.ideal_m is None or budget.all_m is None:
        return None
    cost, now = budget.all_m - budget.ideal_m, f"{budget.all_m:.3g} m now, {budget.ideal_m:.3g} m ideal"
    floor = budget.at_q_star_m
    if floor is not None and budget.all_m > 0.0 and floor >= _FLOOR * budget.all_m:
        return _Lever(
            "the sheaf, not law or vehicles",
            f"q* itself is {floor:.3g} m out of formation (now {budget.all_m:.3g} m)",
            "give the edges between groups an `offset`, or weigh sensing and formation edges more against them",
        )
    known = sorted(((item.give_back_m or 0.0, item.effect) for item in budget.effects), reverse=True)
    limit = record.limit_costs(scope, record.measure, "all") or 0.0
    if limit >= _TELLING * budget.all_m and (not known or limit >= known[0][0]):
        less = f"without it the error would be {limit:.2g} m less ({now})"
        return _Lever("the velocity limit", less, _raise_limit(record))
    if cost <= _SMALL * budget.all_m:
        return _Lever("the law, not the vehicles", now, _law(record, "more agents that sense", "slower targets"))
    if known and known[0][0] >= _TELLING * cost:
        (most, effect), others = known[0], known[1:2]
        then = "".join(f"; then {words(e)} with {x:.2g} m: {_CHANGE[e]}" for x, e in others if x >= 0.5 * most)
        less = f"without it the error would be {most:.2g} m less ({now})"
        return _Lever(words(effect), less, f"{_CHANGE[effect]}{then}")
    parts = {"targets": budget.targets_m or 0.0, "agents": budget.agents_m or 0.0}
    who = max(parts, key=lambda name: parts[name])
    if parts[who] >= _TELLING * cost:
        why = f"as bodies with ideal thrusters they cost {parts[who]:.2g} m already ({now})"
        return _Lever(f"time constant tau of the {who}", why, "")
    why = f"bodies add {cost:.2g} m together ({now})"
    return _Lever("no single effect", why, "see the interaction in the budget")


def _law(record: CompareRecord, *others: str) -> str:
    """What lowers the ideal run's own error: a higher gain, as far as there is room for it, or something else."""
    room = record.usable_gain
    if room is not None and room <= _ROOM * record.gain:
        return f"{_either(*others)} (no higher gain: by hold and ringing {room:.2g} 1/s is the most)"
    upto = "" if room is None else f" (up to {room:.2g} 1/s by hold and ringing)"
    return _either(f"a higher controller.gain{upto}", *others)


def _either(*choices: str) -> str:
    *first, last = choices
    return f"{', '.join(first)}, or {last}" if first else last


def _groups(record: CompareRecord) -> list[str]:
    """The groups' own levers where they differ: in full, but for what is said of the team already."""
    of_team = _lever(record, TEAM)
    found = {scope: _lever(record, scope) for scope in list(record.rung("ideal").errors)[1:]}
    known = {scope: lever for scope, lever in found.items() if lever is not None}
    if of_team is None or record.rung("all").status != "finished":
        return []
    if all(lever.kind == of_team.kind for lever in known.values()):
        return []

    def error(scope: str) -> float:
        return record.budget(scope, record.measure, "late").all_m or 0.0

    chosen = sorted(known, key=error, reverse=True)[:_MOST_GROUPS]
    return [
        f"{scope}: {lever}" if lever.cure != of_team.cure else f"{scope}: {lever.kind}: {lever.why}"
        for scope, lever in known.items()
        if scope in chosen
    ]


def _tracking(record: CompareRecord) -> list[str]:
    """Whose the tracking error is, where it is large beside the formation, or mostly the law's and beyond its error."""
    if record.measure == "tracking_error" or record.rung("all").status != "finished":
        return []
    budget, other = record.budget(TEAM, "tracking_error", "late"), record.budget(TEAM, record.measure, "late")
    now, ideal, size = budget.all_m, budget.ideal_m, record.formation_size_m
    if now is None or ideal is None or other.all_m is None:
        return []
    own = ideal >= 0.5 * now
    if not (size is not None and now >= _FAR * size) and not (own and now >= other.all_m):
        return []
    told = f"tracking error {now:.3g} m, {min(ideal, now):.3g} m of it in the ideal run"
    if own:
        limit = record.limit_costs(TEAM, "tracking_error", "ideal") or 0.0
        if limit >= _TELLING * ideal:
            return [
                f"{told}: {limit:.2g} m of that by the velocity limit, the rest by the law's own lag; "
                f"{_law(record, 'slower targets')}"
            ]
        return [f"{told}: the law's own lag; {_law(record, 'slower targets')}"]
    known = sorted(((item.give_back_m or 0.0, item.effect) for item in budget.effects), reverse=True)
    if known and known[0][0] > 0.0:
        most, effect = known[0]
        return [f"{told}: the bodies'; {words(effect)} first, without which it would be {most:.2g} m less"]
    return [f"{told}: the bodies'"]


def _velocity_limit(record: CompareRecord) -> list[str]:
    """How much of the time agents are at the law's velocity limit, and what the errors are without it."""
    limit = record.velocity_limit
    if limit is None or max(run.share_at_limit for run in limit.runs) < _SELDOM:
        return []
    ideal, whole = limit.run("ideal"), limit.run("all")
    measures = dict.fromkeys((record.measure, "tracking_error"))
    errors = [text for measure in measures for text in _with_and_without(record, measure)]
    costs = [record.limit_costs(TEAM, measure, run.run) or 0.0 for measure in measures for run in limit.runs]
    told = (
        f"agents are at their velocity limit ({_limits(record)}) {100 * ideal.share_at_limit:.0f}% of the last half of "
        f"the ideal run, {100 * whole.share_at_limit:.0f}% as it stands"
    )
    if errors:
        told += f"; without it {', '.join(errors)}" + (f": {_raise_limit(record)}" if max(costs) > 0.0 else "")
    return [told]


def _with_and_without(record: CompareRecord, measure: str) -> list[str]:
    """One error with and without the velocity limit, where it differs notably."""
    told, notably = [], False
    for run, name in (("ideal", "ideal"), ("all", "as it stands")):
        now, less = getattr(record.rung(run).errors[TEAM].late, measure), record.limit_costs(TEAM, measure, run)
        if now is not None and less is not None:
            told.append(f"{now:.3g} -> {now - less:.3g} m {name}")
            notably = notably or abs(less) > _SMALL * now
    return [f"{measure.replace('_', ' ')} {' and '.join(told)}"] if notably else []


def _raise_limit(record: CompareRecord) -> str:
    """The limit that does: the largest speed that the last half of the ideal run asks for without one."""
    limit = record.velocity_limit
    assert limit is not None  # somebody has one
    return f"raise velocity_limit to {limit.asked_m_s:.3g} m/s, the most that the ideal run asks for ({limit.who})"


def _limits(record: CompareRecord) -> str:
    limit = record.velocity_limit
    assert limit is not None  # somebody has one
    low, high = f"{limit.lowest_m_s:.3g}", f"{limit.highest_m_s:.3g}"
    return f"{low} m/s" if low == high else f"{low} to {high} m/s"


def _speeds(record: CompareRecord) -> list[str]:
    """Who is asked for more than it can do, and, for bodies without limits, whether a real vehicle could."""
    fastest, sentences = {f.moves_in: f for f in record.fastest}, []
    for d in record.demands:
        if d.run != "ideal":
            continue
        asked = f"{d.role} of kind {d.vehicle} are asked for up to {d.asked_m_s:.3g} m/s ({d.who} at {d.time_s:.4g} s)"
        if d.least_speed_m_s is not None:
            if d.asked_m_s > d.least_speed_m_s:
                sentences.append(
                    f"{asked}, beyond their {d.least_speed_m_s:.3g} m/s for {100 * d.share_beyond:.0f}% of the time: "
                    f"no tuning mends that; slow the motion and the gain {d.asked_m_s / d.least_speed_m_s:.2g} times"
                )
        elif (best := fastest.get(d.moves_in)) is not None and d.asked_m_s > best.speed_m_s:
            sentences.append(
                f"{asked}; the fastest real vehicle of mjsheaf in {d.moves_in}, {best.vehicle}, makes "
                f"{best.speed_m_s:.3g} m/s: none follows unless motion and gain are slowed "
                f"{d.asked_m_s / best.speed_m_s:.2g} times, and the ladder ends at ideal thrusters"
            )
    return sentences


def _saturation(record: CompareRecord) -> list[str]:
    total = next((s.share for s in record.rung("all").saturation if not s.vehicle), 0.0)
    return [f"agents' thrusters are at a limit {100 * total:.1f}% of the time"] if total >= 0.01 else []


def _rings(ringing: RingingRecord | None) -> bool:
    """Whether bodies swing many times before they are still."""
    measured = ringing.measured[0].damping_ratio if ringing and ringing.measured else None
    return measured is not None and measured < _RINGS


def _ringing(ringing: RingingRecord | None) -> list[str]:
    if ringing is None or not _rings(ringing):
        return []
    measured, predicted = ringing.measured[0].damping_ratio or 0.0, ringing.predicted_damping_ratio_held
    if measured < 0.0:
        return [f"the least damped mode (about {ringing.agent}) GROWS: lower controller.gain"]
    why = "" if measured > 0.7 * predicted else f", where inertia and the law's hold alone would leave {predicted:.2g}"
    known = [(m.bodies, m.damping_ratio) for m in ringing.measured if m.damping_ratio is not None]
    steps = [(later[1] - now[1], later[0]) for now, later in pairwise(known)]
    blamed = max(steps, default=(0.0, ""))[1]
    cure = "lower controller.gain" + next((f", or {c}" for name, c in _CALM.items() if blamed.endswith(name)), "")
    return [f"it rings: damping ratio {measured:.2g} of the mode about {ringing.agent}{why}; {cure}"]
