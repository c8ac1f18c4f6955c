"""Record of a check: what `mjsheaf check --json` prints, with the meaning of each field; and the problems in it.

Each problem has its reason and the smallest change that removes it. There is one list. The screen, the title of plots,
the message of exit code 1 and the JSON are made from it. A check is ok if it is empty and the trial found nothing.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import Field

from mjsheaf.checking.loop.held_law import LawLoop
from mjsheaf.checking.loop.linear_law import because_of
from mjsheaf.checking.loop.links import UNSTABLE_LINKS, LinkRecord
from mjsheaf.checking.loop.margins import Margins
from mjsheaf.checking.loop.prediction import DisturbanceRecord, SteadyError
from mjsheaf.checking.repairs import Augmentation, Rigidity
from mjsheaf.checking.separation import MOSTLY, SafetyRecord
from mjsheaf.checking.spectrum import Fragility, RelativeCohomology
from mjsheaf.checking.theorem.certificate import Assumption
from mjsheaf.checking.theorem.targets import TargetsLoop
from mjsheaf.checking.trial import TrialRecord
from mjsheaf.errors import and_more, and_others, listed
from mjsheaf.section import OF_TEAM, TEAM_NORM, Finite, Norm, Record


class RegionSummary(Record):
    """Region over which the constants were computed."""

    source: str
    verified: bool = Field(description="whether agents of an unlimited law are proven to stay there; else a guess")
    agents_low: list[float] = Field(description="corner of the box about the agents' region, m")
    agents_high: list[float] = Field(description="opposite corner, m")
    start: float = Field(description="start of the time, s")
    end: float = Field(description="end of the time, s")
    samples: int = Field(description="number of cells that cover the targets' path, or of instants if it is not known")
    path_error: Finite = Field(description="error of the targets' path that the bounds include, m; null: not known")


class ExplainedCohomology(RelativeCohomology):
    """H^0(G, G_p; F), explained, and the edges and anchors that would make it trivial."""

    mending: Augmentation | None = Field(description="null if nothing is free")


class WeakerBound(Record):
    """The bound with rho = 0 and f_bar enlarged by 2 sqrt(sum_i sup |f_i|^2)."""

    f_bar: Finite = Field(description="f_bar enlarged in this way, m/s")
    radius: Finite = Field(description="ultimate radius of |e|, m")
    radius_per_agent: Finite = Field(description="the same as RMS over agents, radius / sqrt(N), m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)


class TheoremSummary(Record):
    """Theorem 1, computed."""

    holds: bool | None = Field(
        description="the same as `applies`; null if the theorem is about other teams: with ranges, bearings or "
        "directed edges, or without targets"
    )
    applies: bool = Field(
        description="the gain condition and every numbered assumption hold, and no hold or speed limit prevents it"
    )
    gain_condition: bool = Field(
        description="k_min > rho(2 sqrt(mu / lambda_V)) + lambda_V; the targets' path is known"
    )
    approximate: bool = Field(description="the law is held over a period; the theorem's is continuous")
    reason: str = Field(description="why it does not apply, or empty")
    gain: float = Field(description="k1, 1/s")
    lambda_min: float = Field(description="smallest eigenvalue of H")
    lambda_max: float = Field(description="largest eigenvalue of H")
    sigma_max_B: float = Field(description="largest singular value of B")
    omega_bar: Finite = Field(description="bound on the effect of disturbances, m/s")
    f_bar: Finite = Field(description="bound on |H^-1 B f_p - f_q(q*)| along the targets' path, m/s")
    rho: Finite = Field(description="constant Lipschitz bound, 1/s; for a user's rho, its value at the initial error")
    rho_seen: Finite = Field(description="largest slope found, 1/s")
    rho_source: str
    lambda_V: Finite = Field(description="rate, 1/s; the best one unless given")
    lambda_V_given: bool = Field(description="lambda_V is the caller's, not the best one")
    k_min: float = Field(description="k1 lambda_min / 2, 1/s")
    mu: Finite = Field(description="(f_bar + omega_bar)^2 / (2 k1 lambda_min), m^2/s")
    chi: Finite = Field(description="radius of D, m; null if it is infinite: rho is constant over the region")
    chi_infinite: bool | None = Field(description="D is the whole space; null if the gain condition fails")
    radius_D: Finite = Field(description="radius of the set that is never left, m; null: the whole space, or none")
    radius_S: Finite = Field(
        description="radius of the set in which an error may begin, m; null: the whole space, or none"
    )
    radius_U: Finite = Field(description="ultimate radius of |e|, m; null if the condition fails")
    initial_error: Finite = Field(
        description="|e(t0)|, m; for a later phase a bound: that at the end of the previous phase plus the jump "
        "of q*; null if there is none"
    )
    radius_U_per_agent: Finite = Field(description="the same as RMS over agents, radius_U / sqrt(N), m")
    initial_error_per_agent: Finite = Field(description="initial error as RMS over agents, m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    initial_error_inside_S: bool | None = Field(description="the error begins in S; null: there is no S")
    wanted_radius: float = Field(description="desired bound on |e|, the norm of the whole team, m")
    gain_for_wanted_radius: Finite = Field(
        description="smallest k1 found at which the theorem applies with that radius, over the region of that gain and "
        "from the same initial error, 1/s; null: see its reason"
    )
    gain_for_wanted_radius_reason: str = Field(description="why there is no such gain, or empty")
    weaker: WeakerBound


class Proposal(Record):
    """A law whose bound on ideal kinematics is at most the desired radius, and its cost."""

    controller: dict[str, object] = Field(
        description="fields of the scenario's controller to set; null removes a term, other fields are unchanged"
    )
    bound: float = Field(description="bound on |e| at samples of the second half, without speed limits, m")
    bound_per_agent: float = Field(description="`bound` as RMS over agents, bound / sqrt(N), m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    certified: bool = Field(description="no speed limit can be reached, so the bound holds for the run")
    command: Finite = Field(description="bound on each agent's command over the second half, m/s")
    stable_on_bodies: bool | None = Field(description="the loop of the real vehicles is stable too; null: undecided")
    exchanges: float = Field(description="rounds of exchange a second")
    numbers: float = Field(description="numbers that an agent sends a second, on average")
    noise: Finite = Field(description="bound on the RMS noise of commands per noise of odometry, 1/s")


class TriedFix(Record):
    """A fix that was tried on bodies."""

    ok: bool = Field(description="nothing failed")
    tracking_error: Finite = Field(description="error with the fix, RMS over agents and the second half, m; null: none")
    without: Finite = Field(description="error without the fix, m; null: none")
    problem: str = Field(description="what still failed, or empty")


class Problem(Record):
    """A reason why a check is not ok."""

    kind: str = Field(
        description="assumption_1 to assumption_7, rigid, place, undecided, held_law, links, bodies, targets, turning, "
        "flow, wind, gusts, slow, limited, unsafe, room, or untried"
    )
    what: str = Field(description="what is wrong, in a few words")
    why: str = Field("", description="the reason, with numbers, or empty")
    fix: str = Field("", description="the smallest change that removes it, or empty")
    changes: dict[str, Any] = Field({}, description="fields of the scenario that the fix sets, as for --set")
    additions: dict[str, list[Any]] = Field({}, description="entries that the fix adds to lists of the scenario")
    tried: TriedFix | None = Field(None, description="the fix, tried on bodies; null if it was not")

    def __str__(self) -> str:
        return f"{self.what}: {self.why}" if self.why else self.what


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
    theorem: TheoremSummary = Field(description="Theorem 1 for the paper's law, without the terms of the scenario's")
    law: LawLoop
    links: LinkRecord | None = Field(description="effects of links on the law; null without a held law")
    targets: TargetsLoop = Field(description="the targets' own law, on ideal kinematics and on their vehicles")
    margins: Margins
    rigidity: Rigidity = Field(description="rigidity of the communication edges, linearised at q*")
    safety: SafetyRecord | None = Field(
        description="safety filter, null without one; with one, results about the law and about loops are for the team "
        "while the filter does not act"
    )
    disturbance: DisturbanceRecord
    fragility: Fragility = Field(description="single losses that break an assumption")
    topology_fix: str = Field(
        description="edges that would make assumption 5 hold, the shortest ones; empty if it holds"
    )
    topology_edges: dict[str, list[list[str]]] = Field(description="the same edges, as the scenario's lists have them")


class PhaseRecord(PartRecord):
    """A check of one phase of a run with events, of the present agents alone and the time until the next event.

    Its |e(t0)| is at most the smallest bound at the end of the previous phase plus the jump of q*. An agent that joins
    adds its distance from q*, if it is proven to have stayed at its initial position: it has held its position from the
    start of the run, and the medium there is never faster than its velocity limit. There is no bound if an agent joins
    that was lost, drifts or may have been carried off, if the previous phase has none, or if the paper's law follows
    one with terms. Required speeds at the start (`margins.speed`) assume that the team had come to rest in the previous
    phase.
    """

    start: float = Field(description="start of the phase, s")
    events: list[str] = Field(description="events at its start")
    absent: list[str] = Field(description="agents that are lost or have not joined yet")
    jump: Finite = Field(description="|q*_new - q*_old| at its start, of the agents present before and after, m")
    norm: Norm = Field(TEAM_NORM, description="which norm `jump` is")
    jumps: dict[str, Finite] = Field(description="the same for each of these agents, m")


class CheckRecord(PartRecord):
    """A check of a scenario; for a run with events it is that of the first phase, and `phases` has each of them.

    `ok` and `problems` cover all phases, and `ok` also the trial.
    """

    scenario: str
    region: RegionSummary
    steady: SteadyError
    proposals: list[Proposal] = Field(
        description="laws whose bound is at most the desired radius, the cheapest of each kind"
    )
    phases: list[PhaseRecord] = Field(
        default_factory=list, description="phases of a run with events, including the first"
    )
    trial: TrialRecord | None = Field(None, description="trial of the mission on bodies; null if it was not tried")
    drifts: dict[str, float] = Field(
        {}, description="distance by which the flow carries each target that nothing holds until the end of the run, m"
    )
    notes: list[str] = Field(
        default_factory=list, description="values in the files that look like mistakes, in sentences"
    )


# -- problems ----------------------------------------------------------------------------------------------------------


_FIXES = {
    1: "give singular parts of the flow a `core` radius",
    2: "give this vehicle thrusters, or `steering`, that push along every axis",
    4: "as for assumption 2",
}
_UNITS = {"gain": " 1/s", "rate": " 1/s", "velocity_limit": " m/s"}  # of fields that a fix sets
_SPARE = 1.2  # factor between the required speed or rate and the proposed one


def problems_of(part: PartRecord, *, stable: bool) -> list[Problem]:
    """Return why the analysis of a team and its law is not ok.

    Args:
        part: Record of the analysis.
        stable: True if the law is known to be stable; used for teams that Theorem 1 is not about.
    """
    return [
        *_of_assumptions(part),
        *(_of_shape(part, stable=stable) if part.theorem.holds is None else ()),
        *_of_loops(part),
        *_of_speeds(part),
        *(_of_room(part.safety, part.margins.bodies.period) if part.safety is not None else ()),
    ]


def untried_of(record: CheckRecord) -> list[Problem]:
    """Return what the analysis leaves undecided and a trial decides, as problems."""
    return [
        Problem(kind="untried", what=f"{what}, and the mission was not tried", why=why)
        for what, why in dict.fromkeys(_doubts(record))
    ]


def _doubts(
    record: CheckRecord, *, max_lag: float = 7.0 / 16.0 * math.pi, min_delivery: float = 0.5, slower: float = 1.1
) -> Iterator[tuple[str, str]]:
    """Yield what a linear analysis cannot decide, and why.

    Args:
        record: The record of the analysis.
        max_lag: Phase lag of inertia, delays and losses together at the crossover, above which a loop over inexact
            links is in doubt, rad.
        min_delivery: Fraction of the measurements that arrive, below which means over time say little about a run.
        slower: Predicted error on the vehicles over that on ideal kinematics, above which they may not follow.
    """
    parts: list[PartRecord] = [record]
    for part in record.phases or parts:
        bodies = part.margins.bodies
        undecided = bodies.obstacle == "no model" or _late_phase(part, max(bodies.tau)) > max_lag
        if bodies.stable is None and undecided:
            yield "the vehicles' loop is undecided", bodies.reason
        shares = {} if part.links is None else part.links.delivery
        arriving = min((share for share in shares.values() if share is not None), default=1.0)
        lost = f"links lose {100.0 * (1.0 - arriving):.0f} % of the measurements"
        if arriving < min_delivery:
            yield "most measurements are lost", lost
        if arriving < 1.0 and part.margins.turning:
            who = and_others(part.margins.turning[0], len(part.margins.turning) - 1)
            yield f"{who} may not turn as fast as commands change", lost
        speed = {one.agent: one.largest for one in part.margins.speed}
        slowest = min(speed.values(), default=math.inf)  # for agents that are not listed
        noise = [] if part.links is None or part.links.noise is None else part.links.noise.agents
        jumpy = [one for one in noise if (one.command or 0.0) > speed.get(one.agent, slowest)]
        if jumpy:
            who = and_others(jumpy[0].agent, len(jumpy) - 1)
            why = f"noise makes commands of {jumpy[0].command:.3g} m/s RMS for {jumpy[0].agent}"
            yield f"{who} may not follow commands that noise makes", why
        if part.safety is not None and part.safety.crossing:
            first = " and ".join(part.safety.crossing[0])
            yield "the safety filter may block agents", f"{first} get too close on straight ways to their places"
        moved = part.disturbance
        blown = [id for id, often in moved.too_fast.items() if often <= MOSTLY]
        if blown:
            why = f"its mean and twice its RMS are {moved.carried_off[blown[0]]:.3g} m/s too fast for {blown[0]}"
            yield f"gusts and waves may carry {and_others(blown[0], len(blown) - 1)} off", why
    ideal, real = record.steady.ideal, record.steady.bodies
    if ideal is not None and real is not None and real > max(slower * ideal, 1.0):
        why = f"{real:.3g} m of error are predicted, and {ideal:.3g} m on ideal kinematics"
        yield "the vehicles may be too slow", why


def reasons_of(record: CheckRecord) -> list[str]:
    """Return why a check is not ok, in sentences; the refusal of a run adds nothing to the problems of the analysis."""
    found = [str(problem) for problem in record.problems]
    tried = [] if record.trial is None else record.trial.problems
    return found + [problem.text for problem in tried if not (found and problem.kind == "refused")]


def describe_tried(problem: Problem) -> str:
    """Return the result of trying a fix, in a sentence; empty without a fix."""
    tried = problem.tried
    if tried is None:
        return "(Not tried.)" if problem.fix else ""
    before = "" if tried.without is None else f" instead of {tried.without:.3g} m"
    if tried.tracking_error is None:
        return f"Tried: {tried.problem}."
    error = f"Tried: the tracking error is {tried.tracking_error:.3g} m{before}"
    if tried.ok and tried.without is not None and tried.tracking_error > tried.without:
        return f"{error}, which is no better."
    return f"{error}." if tried.ok else f"{error}, but {tried.problem}."


def headline(record: CheckRecord) -> str:
    """Return a check in one sentence: OK or NOT OK, and why."""
    if not record.ok:
        first = {problem.kind: problem.what for problem in reversed(record.problems)}
        kinds = dict.fromkeys(problem.kind for problem in record.problems)
        tried = reasons_of(record)[len(record.problems) :]
        return "NOT OK: " + "; ".join([*(first[kind] for kind in kinds), *tried])
    every = (
        "all 7 assumptions hold"
        if all(a.verdict == "holds" for a in record.assumptions)
        else "all assumptions that apply hold"
    )
    every += ", the formation is rigid" if record.theorem.holds is None and record.rigidity.rigid else ""
    on_vehicles = " and on the vehicles" if record.margins.bodies.stable else ""
    stable = f", the loop is stable on ideal kinematics{on_vehicles}" if record.law.stable else ""
    if record.trial is None:
        outcome = "; not tried"
    elif record.trial.complete:
        outcome = ", and the mission worked when tried"
    else:
        outcome = f", and the first {record.trial.seconds:g} s of the mission worked when tried"
    return f"OK: {every}{stable}{outcome}"


def _of_assumptions(part: PartRecord) -> Iterator[Problem]:
    """Yield the assumptions that do not hold; only those on topology for teams that Theorem 1 is not about."""
    for a in part.assumptions:
        if a.applies and not a.holds and (part.theorem.holds is not None or a.number in (5, 6)):
            word = "fails" if a.verdict == "fails" else "is undecided"
            fix = _FIXES.get(a.number, "")
            additions: dict[str, list[Any]] = {}
            plan = part.relative_cohomology.mending
            if a.number == 5:
                fix = part.topology_fix
                additions = {**part.topology_edges}
            elif a.number == 6 and plan is not None:
                fix = "; ".join(repair.description for repair in plan.repairs)
                for repair in plan.repairs:
                    additions.setdefault("anchors" if repair.kind == "anchor" else repair.kind, []).append(repair.entry)
            yield Problem(
                kind=f"assumption_{a.number}",
                what=f"assumption {a.number} {word}",
                why=f"{a.witness} (assumed: {a.name})",
                fix=fix,
                additions=additions,
            )


def _of_shape(part: PartRecord, *, stable: bool) -> Iterator[Problem]:
    """Yield why a team that Theorem 1 is not about does not, or may not, keep its shape."""
    shape = part.rigidity
    if shape.localizable is None and shape.rigid is not True:
        why = (
            "the rank of its edges is not known"
            if shape.rank is None
            else f"its edges have rank {shape.rank} of {shape.needed}"
        )
        edges = shape.bracing.edges if shape.bracing else []
        fix = shape.bracing.describe() if shape.bracing else ""
        additions = {"communication": [edge.model_dump(mode="json") for edge in edges]} if edges else {}
        yield Problem(kind="rigid", what="the formation is not rigid", why=why, fix=fix, additions=additions)
    if shape.localizable is False and part.law.stable is not None:
        yield Problem(kind="place", what="targets and anchors do not hold every agent's place")
    if not stable and part.law.stable is None and not part.law.unmodelled:
        yield Problem(kind="undecided", what="the law is undecided", why=part.law.reason)


def _of_loops(
    part: PartRecord,
    *,
    reserve: float = 0.5,  # fraction of the largest gain that is proposed
) -> Iterator[Problem]:
    """Yield the loops that are undecided or unstable."""
    law = part.law
    links = part.links
    bodies = part.margins.bodies
    late = math.inf if links is None else links.delay.largest_gain or math.inf
    late = min(late, bodies.largest_gain or math.inf)
    if law.unmodelled:
        yield Problem(kind="undecided", what=f"the law is undecided, {because_of(law.unmodelled)}")
    at_any_gain = law.stable is False and law.stable_gains is None
    if at_any_gain:
        yield Problem(kind="held_law", what="the held law is unstable at any controller.gain")
    elif law.stable is False and law.stable_gains is not None:
        low, high = law.stable_gains
        why = f"controller.gain is stable between {low:.3g} and {high:.3g} 1/s"
        yield _of_gain("held_law", "the held law is unstable", why, low + reserve * (min(high, late) - low))
    if links is not None and links.stable is False and not (links.exact and law.stable is False):
        known = links.delay_margin is not None and not links.delay.stable
        why = f"it tolerates {links.delay_margin:.6g} s of delay" if known else ""
        mends = links.loss is None and links.delay.largest_gain is not None  # a lower gain alone
        yield _of_gain(
            "links", UNSTABLE_LINKS, why, reserve * late if mends else None, ", or use links with less delay and loss"
        )
    if bodies.stable is False and at_any_gain and bodies.largest_gain is None:
        yield Problem(kind="bodies", what=bodies.verdict())
    elif bodies.stable is False:
        yield _of_gain("bodies", bodies.verdict(), gain=reserve * late if bodies.largest_gain is not None else None)
    elif bodies.stable is None and bodies.stable_over_exact_links is False:
        yield _of_gain("bodies", "the vehicles' loop is unstable, even if links were exact")
    elif bodies.stable is None and not law.terms and _late_phase(part, min(bodies.tau)) > 0.5 * math.pi:
        why = "measurements are too old for vehicles that are as slow"
        yield _of_gain(
            "bodies", "the vehicles' loop is unstable over its links", why, another=", or use links with less delay"
        )
    for name, (taken, top) in part.margins.slow_targets.items():
        yield Problem(
            kind="targets",
            what=f"{name} is slower than its path ({top:.3g} of {taken:.3g} m/s)",
            why=f"through the medium, the path of {name} takes {taken:.3g} m/s, and the top speed of its vehicle is "
            f"{top:.3g} m/s",
            fix="a slower motion, or a faster vehicle",
        )
    if diverging := part.targets.verdict():
        yield Problem(kind="targets", what=diverging)


def _of_gain(kind: str, what: str, why: str = "", gain: float | None = None, another: str = "") -> Problem:
    """Return a problem that a gain, 1/s, None if it is not known, or another change removes."""
    changes = {} if gain is None else {"controller.gain": _round(gain)}
    fix = describe_changes(changes) if changes else "lower controller.gain"
    return Problem(kind=kind, what=what, why=why, fix=fix + another, changes=changes)


def describe_changes(changes: Mapping[str, float]) -> str:
    """Describe the fields that a fix sets."""
    return " and ".join(
        f"set {name} to {value:g}{_UNITS.get(name.split('.')[-1], '')}" for name, value in changes.items()
    )


def _late_phase(part: PartRecord, tau: float) -> float:
    """Return the phase lag of delay and inertia at the crossover of the fastest mode, rad; 0 if it is not known.

    Of vehicles that follow a command with the time constant tau, s, the loop k1 lambda e^(-s d) / (s (1 + tau s)) has
    the gain 1 at omega^2 = (sqrt(1 + 4 tau^2 k1^2 lambda^2) - 1) / (2 tau^2). It is stable if atan(omega tau) + omega d
    is below pi / 2; terms of the law are left out. The delay d is that of the links, half a period, and the mean age of
    measurements that are held because later ones were lost.
    """
    links, hold = part.links, part.margins.hold
    if links is None or hold is None or links.delay.delay is None or links.exact or tau <= 0.0:
        return 0.0
    lost = 1.0 - min((share for share in links.delivery.values() if share is not None), default=1.0)
    delay = links.delay.delay + hold.period * (0.5 + lost / max(1.0 - lost, 1e-3))
    rate = part.theorem.gain * part.theorem.lambda_max
    crossover = math.sqrt((math.sqrt(1.0 + (2.0 * tau * rate) ** 2) - 1.0) / 2.0) / tau
    return math.atan(crossover * tau) + crossover * delay


def _round(gain: float) -> float:
    """Return a positive number with two significant digits."""
    return float(f"{gain:.2g}")


def _of_speeds(part: PartRecord) -> Iterator[Problem]:
    """Yield the problems of agents that fall behind their places because they are too slow."""
    falling = part.margins.falling
    if falling:
        names = listed(falling)
        yield Problem(
            kind="turning", what=f"{names} cannot turn as fast as leaning takes", why=next(iter(falling.values()))
        )
    slow = list(_of_slow(part))
    yield from slow
    carried = {id: often for id, often in part.disturbance.too_fast.items() if often > MOSTLY}
    blown = {id: (wind, most) for id, (wind, most) in part.margins.wind.items() if most is not None and wind > most}
    if blown:
        worst_id, (wind, most) = min(blown.items(), key=lambda item: item[1][1] / item[1][0])
        yield Problem(
            kind="wind",
            what=f"{listed(blown)} cannot hold station in the wind",
            why=f"above {worst_id} it is {wind:.3g} m/s, and {worst_id} holds station in at most {most:.3g} m/s",
            fix="less wind, stronger vehicles, or a higher velocity_limit if the vehicle allows it",
        )
    if part.margins.bodies.obstacle == "overpowered" and not slow and not blown:
        yield Problem(kind="flow", what="a vehicle cannot hold its place in the flow", why=part.margins.bodies.reason)
    if carried:
        worst_id = max(carried, key=carried.__getitem__)
        yield Problem(
            kind="gusts",
            what=f"{and_others(worst_id, len(carried) - 1)} cannot hold against gusts and waves",
            why=f"the medium about {worst_id} is faster than its vehicle can be for "
            f"{100.0 * carried[worst_id]:.0f} % of the time",
            fix="a calmer medium, faster vehicles, or a higher velocity_limit if the vehicle allows it",
        )


def _of_slow(part: PartRecord, *, deficit: float = 0.5) -> Iterator[Problem]:
    """Yield the problem of agents that stay behind their places, because of their vehicles or their velocity limits.

    An agent that is at most `deficit`, m, behind counts as keeping up.
    """
    for limited in (False, True):
        alike = [demand for demand in part.margins.speed if demand.limited == limited]
        slow = [demand for demand in alike if (demand.deficit or 0.0) > deficit]
        if not slow:
            continue
        worst = max(slow, key=lambda demand: demand.deficit or 0.0)
        limit = _round(_SPARE * max(demand.steady or 0.0 for demand in slow))
        raised = limited and limit <= min(demand.top_speed for demand in slow)
        changes = {"controller.velocity_limit": limit} if raised else {}
        at_times = sum((demand.steady or 0.0) > demand.largest for demand in alike)
        limiting = "its velocity limit is" if limited else "the top speed of its vehicle is"
        yield Problem(
            kind="limited" if limited else "slow",
            what=f"{at_times} of {len(part.disturbance.agents)} agents are slower than their places "
            f"({worst.largest:.3g} of {worst.steady:.3g} m/s)",
            why=f"{worst.agent} stays {worst.deficit:.3g} m or more behind: relative to the medium, q* moves at up to "
            f"{worst.steady:.3g} m/s, and {limiting} {worst.largest:.3g} m/s",
            fix=describe_changes(changes) or "slow targets, or faster vehicles",
            changes=changes,
        )


def _of_room(safety: SafetyRecord, period: float) -> Iterator[Problem]:
    """Yield the problem of a formation whose places are closer than the safety filter keeps, at most samples.

    While the formation changes, places that are too close at any sample count, because vehicles would meet there.

    A rate is proposed up to the inverse of the control period in s, beyond which nothing is guaranteed.
    """
    close = [one for one in safety.unsafe if safety.changing or one.fraction > MOSTLY]
    if close:
        nearest = close[0]
        others = "" if len(close) == 1 else f", {and_more(len(close) - 1, 'pair')}"
        yield Problem(
            kind="unsafe",
            what=f"{' and '.join(nearest.pair)} are too close in q*",
            why=f"their places are {-nearest.gap:.3g} m nearer than the required distance at "
            f"{nearest.time:.6g} s{others}",
            fix=f"{'a change in several steps' if safety.changing else 'a larger formation'}, or a smaller "
            "safety.distance",
        )
    known = {tuple(one.pair) for one in close}
    kept = [one for one in safety.standoff_on_bodies if one.lasts and tuple(one.pair) not in known]
    if not kept:
        return
    worst = max(kept, key=lambda one: one.kept - one.desired)
    agent, other = worst.pair
    rates = [one.rate for one in kept if one.rate is not None]
    changes = {"safety.rate": min(_round(_SPARE * max(rates)), 1.0 / period)} if len(rates) == len(kept) else {}
    others = "" if len(kept) == 1 else f", {and_more(len(kept) - 1, 'pair')}"
    yield Problem(
        kind="room",
        what=f"the safety filter keeps {agent} {worst.kept:.3g} m from {other}, and its place is at "
        f"{worst.desired:.3g} m",
        why=f"that is the standoff at safety.rate {safety.rate:g} 1/s with the stopping distances of bodies, at "
        f"{worst.time:.6g} s{others}",
        fix=describe_changes(changes) or "a larger formation, or a smaller safety.distance",
        changes=changes,
    )
