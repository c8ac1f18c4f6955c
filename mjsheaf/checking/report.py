"""The report of `mjsheaf check`: a record as a page for a terminal."""

from collections.abc import Mapping
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from mjsheaf.checking.check import CheckRecord, ExplainedCohomology, PhaseRecord, TheoremSummary
from mjsheaf.checking.fragility import Fragility
from mjsheaf.checking.loop.disturbance import DisturbanceRecord
from mjsheaf.checking.loop.held_law import LawLoop
from mjsheaf.checking.loop.link_noise import NoiseAnswer
from mjsheaf.checking.loop.links import LinkRecord
from mjsheaf.checking.loop.loss import LossAnswer
from mjsheaf.checking.loop.margins import BodyMargins, OneSided, SpeedDemand
from mjsheaf.checking.loop.targets_loop import TargetsLoop
from mjsheaf.checking.problems import describe_tried, headline
from mjsheaf.checking.proposals import Proposal
from mjsheaf.checking.separation import SafetyRecord
from mjsheaf.checking.trial import TrialRecord

Row = tuple[str, str, str]
"""Name, value, remark."""

_APPLIES = {True: "applies", False: "does not apply"}
_RATES = {True: "the best", False: "none satisfies the gain condition"}
_INSIDE = {True: "inside S", False: "OUTSIDE S", None: "no set S"}
_WORDS = {True: "stable", False: "UNSTABLE", None: "undecided"}
_MARKS = {
    "holds": ("holds", "green"),
    "fails": ("FAILS", "bold red"),
    "undecided": ("undecided", "yellow"),
    "does not apply": ("n/a", "yellow"),
}
_MOST = 12  # null directions, and losses, that are listed


def report(record: CheckRecord) -> Group:
    """The record as a readable report."""
    return Group(
        Text(f"{record.scenario}: {headline(record)}", style="bold"),
        *(Text(f"note: {note}", style="yellow") for note in record.notes),
        *_problems(record),
        _assumptions(record),
        *_cohomology(record.relative_cohomology),
        _theorem(record),
        _law(record),
        *_disturbance(record.disturbance),
        *_links(record.links),
        *_separation(record.safety),
        *_proposals(record),
        _margins(record),
        *_fragility(record.fragility),
        *_phases(record),
        *_trial(record.trial),
    )


def _problems(record: CheckRecord) -> list[Table]:
    """Return why the analysis is not ok, and what came of the fixes that were tried."""
    fixes = [f"fix: {problem.fix}. {describe_tried(problem)}" if problem.fix else "" for problem in record.problems]
    rows = [(problem.what, problem.why, fix) for problem, fix in zip(record.problems, fixes, strict=True)]
    return [_pairs("problems", rows)] if rows else []


def _trial(trial: TrialRecord | None) -> list[Table]:
    """Return what came of the trial of the mission."""
    if trial is None:
        return []
    rows = [
        ("verdict", "ok" if trial.ok else "failed", f"{trial.seconds:g} s{'' if trial.complete else ', a part of it'}"),
        ("tracking error", _number(trial.tracking_error, "m"), "RMS over agents, second half"),
        ("ending", trial.ending or "-", ""),
        *((problem.kind, _number(problem.number, "m"), problem.text) for problem in trial.problems),
    ]
    return [_pairs("trial of the mission on bodies", rows)]


def _number(value: float | None, unit: str = "") -> str:
    return "-" if value is None else f"{value:.4g}{' ' + unit if unit else ''}"


def _rms_of(norm: float | None, remark: str = "") -> str:
    """Return a remark on an RMS over agents, with the norm of the whole team that it is of."""
    said = "RMS over agents" if norm is None else f"RMS over agents; norm of the whole team {norm:.4g} m"
    return f"{said}; {remark}" if remark else said


def _assumptions(record: CheckRecord) -> Table:
    headings = ("", "assumption", "verdict", "number", "why")
    table = Table(*headings, title="\nassumptions of the paper", title_justify="left", header_style="")
    for a in record.assumptions:
        mark, style = _MARKS[a.verdict]
        table.add_row(str(a.number), a.name, Text(mark, style=style), _number(a.value, a.unit), a.witness)
    return table


def _cohomology(found: ExplainedCohomology) -> list[Text]:
    lines = []
    if found.dimension:
        lines.append(Text(f"\nfree to drift: H^0(G, G_p; F) has dimension {found.dimension}", style="bold"))
        lines += [Text(f"  {d.description}") for d in found.basis[:_MOST]]
    if (plan := found.mending) is not None:
        kind = "the smallest set" if plan.exact else "a small set (greedy)"
        lines += [
            Text(f"fix: {kind} of {plan.needed} out of {plan.candidates} that sensors could support"),
            *(
                Text(
                    f"  {x.description}: holds {x.nullity_reduction} of {found.dimension} directions by itself, "
                    f"lambda_min {x.lambda_min_alone:.3g}"
                )
                for x in plan.repairs
            ),
            *(Text(f"  or: {'; '.join(other)}") for other in plan.alternatives[:3]),
            Text(f"then lambda_min(H) is {plan.lambda_min:.3g}"),
        ]
    if found.near_null:
        lines.append(Text("\nbarely held (small eigenvalues of H)", style="bold"))
        lines += [Text(f"  {d.description}: {d.eigenvalue:.3g}, {d.ratio:.2g} of the largest") for d in found.near_null]
    return lines


def _pairs(title: str, rows: list[Row]) -> Table:
    table = Table(title=f"\n{title}", title_justify="left", show_header=False)
    for row in rows:
        table.add_row(*row)
    return table


def _theorem(record: CheckRecord) -> Table:
    """Return the constants of Theorem 1, and what it says."""
    t = record.theorem
    region = record.region
    low, high = (", ".join(f"{x:.3g}" for x in corner) for corner in (region.agents_low, region.agents_high))
    proven = "" if region.verified else ", not proven"
    approximately = " (approximately)" if t.applies and t.approximate else ""
    rows = [
        ("verdict", _APPLIES[t.applies] + approximately, t.reason),
        ("gain condition", "holds" if t.gain_condition else "fails", "k_min > rho + lambda_V"),
        ("region", "", f"agents in ({low}) to ({high}) m; {region.source}{proven}"),
        ("lambda_min, lambda_max", f"{t.lambda_min:.4g}, {t.lambda_max:.4g}", "of H"),
        ("sigma_max(B)", _number(t.sigma_max_B), ""),
        ("f_bar", _number(t.f_bar, "m/s"), "upper bound on |H^-1 B f_p - f_q(q*)| along the targets' path"),
        ("omega_bar", _number(t.omega_bar, "m/s"), ""),
        ("rho", _number(t.rho, "1/s"), t.rho_source),
        ("k_min", _number(t.k_min, "1/s"), "k1 lambda_min / 2"),
        ("lambda_V", _number(t.lambda_V, "1/s"), "given" if t.lambda_V_given else _RATES[t.gain_condition]),
        ("mu", _number(t.mu, "m^2/s"), ""),
        *_sets(t),
        (
            f"gain for {t.wanted_radius:g} m",
            _number(t.gain_for_wanted_radius, "1/s"),
            t.gain_for_wanted_radius_reason
            or "smallest k1 with this ultimate radius, norm of the whole team, in its own region",
        ),
        (
            "weaker bound",
            _number(t.weaker.radius_per_agent, "m"),
            _rms_of(t.weaker.radius, "ultimate radius with rho = 0, for any slopes"),
        ),
    ]
    return _pairs(f"Theorem 1{_restriction(record)}", rows)


def _restriction(record: CheckRecord) -> str:
    """Return which part of the law Theorem 1 is about, if that is not the whole law."""
    if record.imperfect_links:
        return ", of the paper's law over exact links"
    return ", of the paper's law alone" if record.law.terms or record.law.unmodelled else ""


def _sets(t: TheoremSummary) -> list[Row]:
    """Return the radii of the sets of Theorem 1, and where the error begins."""
    finite = (f"{_number(t.chi, 'm')}, {_number(t.radius_D, 'm')}, {_number(t.radius_S, 'm')}", "")
    sizes = ("infinite", "within the region, as rho is constant there") if t.chi_infinite else finite
    inside = _rms_of(t.initial_error, _INSIDE[t.initial_error_inside_S])
    return [
        ("chi, radii of D and S", *sizes),
        ("ultimate radius", _number(t.radius_U_per_agent, "m"), _rms_of(t.radius_U)),
        ("initial error", _number(t.initial_error_per_agent, "m"), inside),
    ]


def _law(record: CheckRecord) -> Table:
    """The law as it is held, with its terms, on ideal kinematics."""
    law = record.law
    as_if = ", as if its links were exact" if record.imperfect_links else ""
    name = "the held law on ideal kinematics: " + (", ".join(law.terms) or "the paper's") + as_if
    if law.stable is None:
        return _pairs(name, [("loop", "undecided", law.reason)])
    hold = record.margins.hold
    radius = f"spectral radius {_number(law.spectral_radius)} over {hold.period:g} s" if hold else ""
    gains = "none" if law.stable_gains is None else " to ".join(f"{gain:.4g}" for gain in law.stable_gains) + " 1/s"
    rows = [
        ("loop", _WORDS[law.stable], radius),
        ("rate", _number(law.rate, "1/s"), "decay rate of the slowest mode"),
        ("stable gains", gains, "under this hold" + (", with these terms" if law.terms else "")),
    ]
    if law.stable:
        remark = "|e|, the norm of the whole team, is ultimately at most this times the largest |d|"
        rows.append(("error per disturbance", _number(law.error_per_disturbance, "s"), remark))
    return _pairs(name, rows + _bound_rows(law) + _cost_rows(law))


def _bound_rows(law: LawLoop) -> list[Row]:
    """Return the bound of a run under a law, and what it is made of."""
    never = _rms_of(law.radius, "upper bound at samples of the run's second half")
    rows: list[Row] = [("bound on the error", _number(law.radius_per_agent, "m"), law.reason or never)]
    if law.radius is not None:
        whole = f"RMS over agents; {_number(law.largest_per_agent, 'm')} over the whole run"
        rows += [
            ("between samples", _number(law.between_per_agent, "m"), whole),
            ("command", _number(law.command, "m/s"), "upper bound for every agent over the second half"),
        ]
    elif law.unlimited is not None:
        same = _rms_of(law.unlimited, "the same bound for the law without speed limits")
        rows.append(("without limits", _number(law.unlimited_per_agent, "m"), same))
    left: list[Row] = [("", _number(share.size, "m/s"), share.part) for share in law.left if share.size > 0.0]
    heading: Row = ("residual of d", "", "drives e away from 0; upper bounds over the second half:")
    return rows + ([heading, *left] if left else [])


def _disturbance(found: DisturbanceRecord) -> list[Table]:
    """Return what gusts and waves do to the agents; nothing where there are none."""
    if found.rms == 0.0:
        return []
    rows: list[Row] = [("error", _number(found.rms, "m"), found.reason or "RMS over agents on ideal kinematics")]
    rows += [
        *_rms_on_bodies(found),
        *(
            ("altitude", id, f"begins where the model does not hold; its gusts are those at {altitude:g} m")
            for id, altitude in found.clipped.items()
        ),
        *(
            ("cannot hold station", id, f"the medium is {speed:.4g} m/s faster at times than its vehicle can be")
            for id, speed in found.carried_off.items()
        ),
    ]
    return [_pairs("gusts and waves, once the loop has settled", rows)]


def _rms_on_bodies(found: DisturbanceRecord) -> list[Row]:
    """Return the RMS error on bodies, or why it is not known.

    Args:
        found: Errors that gusts and waves leave.

    Returns:
        A row, or none where the error is not known on ideal kinematics either.
    """
    total = found.rms_on_bodies
    if total is not None:
        who = max(found.bodies, key=lambda id: found.bodies[id] or 0.0)
        return [("on bodies", _number(total, "m"), f"largest {_number(found.bodies[who], 'm')}, of {who}")]
    return [("on bodies", "undecided", found.bodies_reason)] if found.bodies_reason else []


def _separation(found: SafetyRecord | None) -> list[Table]:
    """Return what is certain of the distances that vehicles keep; nothing without the filter."""
    if found is None:
        return []
    rows: list[Row] = [
        ("guaranteed", "yes" if found.guaranteed else "no", "on ideal kinematics, while feasible"),
        *(("", "", f"because {reason}") for reason in found.reasons),
        ("sensor range", _number(found.range, "m"), f"with gamma = {found.rate:.4g} 1/s"),
    ]
    if found.parting:
        rows.append(
            ("flow", _number(found.parting, "m/s"), "largest relative speed of the media around two vehicles; included")
        )
    largest = max(found.margins, key=found.margins.__getitem__)
    rows.append(("on bodies", _number(found.margins[largest], "m"), f"added for {largest}, its stopping distance"))
    for pairs, where in ((found.unsafe, "q* too close"), (found.initial, "start too close")):
        rows += [
            (where, _number(-one.gap, "m"), f"{' - '.join(one.pair)} at {one.time:.4g} s") for one in pairs[:_MOST]
        ]
    rows.append(("all other results", "", "assume that the filter does not act; links do not affect the filter"))
    return [_pairs("safety filter", rows)]


def _cost_rows(law: LawLoop) -> list[Row]:
    """Return what a law sends, and what noise it hands on."""
    sent = f"rounds of exchange; an agent sends {law.numbers:.4g} numbers per second on average"
    remark = "upper bound on command noise, m/s RMS per m of odometry noise"
    rows: dict[Row, object] = {
        ("messages", _number(law.exchanges, "1/s"), sent): law.exchanges,
        ("noise", _number(law.noise, "1/s"), remark): law.noise,
    }
    return [row for row, told in rows.items() if told]


def _links(links: LinkRecord | None) -> list[Table]:
    """Return the tables about the law over its links."""
    if links is None:
        return []
    rows = _delay_rows(links)
    if links.noise is not None:
        rows += _noise_rows(links.noise, lossy=links.loss is not None)
    if links.loss is not None:
        rows += _loss_rows(links.loss, links.delivery)
    if links.assumed and not links.exact:
        rows.append(("holds for", "", links.assumed))
    return [_pairs("the law over its links, on ideal kinematics", rows)]


def _delay_rows(links: LinkRecord) -> list[Row]:
    """Return what delay does to the law."""
    delay = links.delay
    rows = list[Row]()
    if not links.exact:
        late = "" if delay.delay is None else f"measurements up to {_number(delay.delay, 's')} old"
        late = "measurements arrive instantly" if delay.delay == 0.0 else late
        late += ", as if none were lost" if late and links.loss is not None else ""
        radius = "" if delay.spectral_radius is None else f", spectral radius {delay.spectral_radius:.6g} over a period"
        rows.append(("delay", _WORDS[delay.stable], (late + radius) or delay.reason))
    if delay.delay is not None:
        alike = "equal on all links, in whole periods; one more period is unstable"
        rows.append(("delay margin", _number(delay.margin, "s"), delay.reason or alike))
    return rows


def _noise_rows(noise: NoiseAnswer, *, lossy: bool) -> list[Row]:
    """Return what noise does to the team, on links of which some may lose measurements."""
    lost = ", in addition to that due to losses" if lossy else ""
    linear = ", linearised" if noise.linearised else ""
    what = f"steady-state error due to noise, at samples{lost}{linear}"
    total: Row = ("error due to noise", _number(noise.error_per_agent, "m"), noise.reason or _rms_of(noise.error, what))
    if noise.error is None:
        return [total]
    worst = max(noise.agents, key=lambda agent: agent.error)
    return [
        total,
        ("  largest", _number(worst.error, "m"), f"RMS of |e_i|, that of {worst.agent}"),
        ("  commands", _number(noise.command, "m/s"), "RMS of the commands, norm of the whole team"),
        ("  due to bias", _number(noise.mean_per_agent, "m"), _rms_of(noise.mean, "mean of e")),
    ]


def _loss_rows(loss: LossAnswer, delivery: Mapping[str, float | None]) -> list[Row]:
    """Return how errors fall in mean square, where so large a share of each kind's measurements arrives."""
    arrive = ", ".join(f"{100.0 * x:.4g} % of {kind}" for kind, x in delivery.items() if x is not None)
    rows: list[Row] = [("arrives", "", f"{arrive}, in the long run")] if arrive else []
    falls = "in mean square, with these delays" if loss.factor is None else "E|e|^2, with these delays"
    rows.append(("loss", _WORDS[loss.stable], loss.reason or falls))
    if loss.factor is not None:
        most = "" if loss.bound is None else f"; at most {loss.bound:.6g} over any one period"
        rows += [
            ("  factor", f"{loss.factor:.6g}", f"of E|e|^2 over a period in the long run{most}"),
            ("  rate", _number(loss.rate, "1/s"), "at which the RMS of e decays"),
        ]
    return [*rows, ("  not included", "", "the error due to losses if edges disagree at q*, or if e is not zero")]


def _proposals(record: CheckRecord) -> list[Text | Table]:
    """Laws that would do."""
    if record.imperfect_links:
        return [Text("\nno laws are proposed: no bound is known with noise, delay, loss or range", style="bold")]
    if not record.proposals:
        return []
    rows = [(f"{p.bound_per_agent:.4g} m", _in_yaml(p.controller), _cost_of(p)) for p in record.proposals]
    radius = record.theorem.wanted_radius
    title = f"laws with a bound of at most {radius:g} m on |e|, norm of the whole team, on ideal kinematics"
    return [_pairs(f"{title}: bound as RMS over agents, the cheapest law of each kind", rows)]


def _cost_of(p: Proposal) -> str:
    """Return what a proposed law sends and commands, and what is not certain of it."""
    exchanged = f"{p.exchanges:.4g} exchanges per second, {p.numbers:.4g} numbers per agent and second"
    remarks = (
        exchanged if p.exchanges else "no messages",
        "" if p.command is None else f"commands up to {p.command:.4g} m/s",
        f"command noise {_number(p.noise, '1/s')}" if p.noise else "",
        "" if p.certified else "bound without speed limits",
        {True: "", False: "UNSTABLE on the vehicles", None: "undecided on the vehicles"}[p.stable_on_bodies],
    )
    return "; ".join(remark for remark in remarks if remark)


def _in_yaml(fields: dict[str, Any]) -> str:
    """Return the fields of a controller, one a line, as a scenario has them, without those that are as by default."""
    return "\n".join(f"{name}: {_value_in_yaml(name, value)}" for name, value in fields.items())


def _value_in_yaml(name: str, value: Any) -> str:
    if isinstance(value, dict):
        told = {k: v for k, v in value.items() if name == "drift" or {"filter": 0.0, "extrapolate": False}.get(k) != v}
        return f"{{{', '.join(f'{k}: {str(v).lower()}' for k, v in told.items())}}}"
    return "null" if value is None else f"{value:g}"


def _margins(record: CheckRecord) -> Table:
    """Return what the hold, the vehicles and the targets ask of the law."""
    m = record.margins
    tau = " to ".join(f"{x:.3g}" for x in dict.fromkeys(m.bodies.tau))
    damping = f"{_number(m.bodies.damping_slowest)}, {_number(m.bodies.damping_fastest)}"
    rows = [
        *_hold(record),
        ("damping by inertia", damping, f"slowest and fastest mode, tau = {tau} s, without attitude, lag and hold"),
        *_bodies(m.bodies),
        _initial_command(m.speed),
        _speed_of_bodies(m.speed),
        *_speed_of_limits(m.speed),
        ("steady lag", _number(m.lag[0].lag, "m"), f"largest, of {m.lag[0].agent}"),
        *_targets(record.targets),
        *map(_one_sided, m.one_sided),
    ]
    return _pairs("margins in practice", rows)


def _hold(record: CheckRecord) -> list[Row]:
    """Return what holding the law over a period allows."""
    hold = record.margins.hold
    if hold is None:
        held = record.theorem.approximate
        return [("sampling", "none", "H is not symmetric" if held else "the law is continuous")]
    over = "; over exact links" if record.imperfect_links else ""
    alone = "; of the paper's law alone" if record.law.unmodelled else ""
    word = "diverges" if hold.product >= 2 else "rings" if hold.product > 1 else "does not ring"
    rings = f"{word}; the law rings above 1, and diverges from 2 on{over}{alone}"
    return [
        ("k1 h lambda_max", _number(hold.product), rings),
        ("largest gain", _number(hold.largest_gain, "1/s"), f"under a hold of {hold.period:g} s{over}{alone}"),
        ("gain without ringing", _number(hold.ringing_gain, "1/s"), ""),
    ]


def _initial_command(speeds: list[SpeedDemand]) -> Row:
    """Return the row on the speed that the law commands first, of the agent for which that is the most."""
    first = max(speeds, key=lambda s: s.asked / (s.limit or 1e300))
    limit = "no limit" if first.limit is None else f"limit {first.limit:.4g} m/s"
    beyond = sum(s.limit is not None and s.asked > s.limit for s in speeds)
    exceeded = f", exceeded by {beyond} agents" if beyond else ""
    return "initial speed command", _number(first.asked, "m/s"), f"of {first.agent}; {limit}{exceeded}"


def _one_sided(one: OneSided) -> Row:
    others = "" if len(one.agents) == 1 else f" and {len(one.agents) - 1} more"
    cannot = f"cannot push in these directions without another: {', '.join(one.lacking)}"
    return "one-sided", one.vehicle, f"{one.agents[0]}{others} {cannot}; {one.meaning}"


def _targets(loop: TargetsLoop) -> list[Row]:
    """Return rows on the targets' own law, if they have one."""
    if not loop.parts:
        return []
    held = "" if loop.product is None else f"; times the control period {loop.product:.4g}, stable below 2"
    rows = [(f"targets' {' and '.join(loop.parts)}", _WORDS[loop.stable], f"rates up to {loop.rate:.4g} 1/s{held}")]
    bodies = loop.bodies
    if bodies is not None:
        radius = "" if bodies.spectral_radius is None else f"spectral radius {bodies.spectral_radius:.6g}"
        rows.append(("  on their vehicles", _WORDS[bodies.stable], radius or bodies.reason))
    return rows


def _bodies(bodies: BodyMargins) -> list[Row]:
    """The loop of the vehicles."""
    if bodies.stable is None or bodies.spectral_radius is None:
        return [("loop on bodies", "undecided", bodies.reason)]
    beyond = "at no gain that was tried" if bodies.largest_gain is None else "beyond it"
    radius = f"spectral radius {bodies.spectral_radius:.6g} over {bodies.period:g} s"
    rows = [
        ("loop on bodies", _WORDS[bodies.stable], radius),
        ("largest gain on bodies", _number(bodies.largest_gain, "1/s"), f"{beyond} the vehicles oscillate or diverge"),
    ]
    mode = bodies.least_damped
    if mode is not None:
        about = "" if mode.agent is None else f", about {mode.agent}"
        rows.append(("least damped mode", f"{mode.damping:.3g}", f"damping ratio at {mode.frequency:.3g} rad/s{about}"))
    return rows


def _speed_of_bodies(speeds: list[SpeedDemand]) -> Row:
    """Return the row that compares the speeds required to follow q* with those of the vehicles."""
    known = [(s, s.steady) for s in speeds if s.steady is not None]
    if not known:
        return "speed along q*", "-", "a field is singular"
    first, steady = max(known, key=lambda demand: demand[1] / (demand[0].able or 1e300))
    able = "its thrusters have no limits"
    if first.able is not None:
        able = f"its all-way speed is {first.able:.4g} m/s, forward {_number(first.able_forward, 'm/s')}"
    return "speed along q*", _number(steady, "m/s"), f"of {first.agent}; {able}"


def _speed_of_limits(speeds: list[SpeedDemand]) -> list[Row]:
    """Return a row on the agent whose velocity limit leaves the least reserve along q*."""
    known = [(s.steady / s.limit, s.limit, s) for s in speeds if s.steady is not None and s.limit is not None]
    if not known:
        return []
    _, limit, worst = max(known, key=lambda demand: demand[0])
    remark = f"of {worst.agent}, whose q* takes up to {_number(worst.steady, 'm/s')}"
    return [("velocity limit", _number(limit, "m/s"), remark)]


def _phases(record: CheckRecord) -> list[Text | Table]:
    """Return each phase of a run with events, in a few lines; what stands above is of the first."""
    parts: list[Text | Table] = []
    for p in record.phases:
        beginning = f"from t = {p.start:g} s on: {', '.join(p.events) or 'start'}"
        if parts:
            parts += [_pairs(beginning, _phase_rows(p)), *_cohomology(p.relative_cohomology), *_fragility(p.fragility)]
        else:
            absent = f"; absent: {', '.join(p.absent[:_MOST])}" if p.absent else ""
            parts.append(Text(f"\n{beginning}: as above{absent}"))
    return parts


def _phase_rows(p: PhaseRecord) -> list[Row]:
    """Return what the check says of a phase."""
    t = p.theorem
    failed = "; ".join(a.failure for a in p.assumptions if a.failure)
    at_most = "" if t.initial_error is None or p.jump is None else ", at most"
    weaker = f"weaker bound {_number(t.weaker.radius_per_agent, 'm')}"
    return [
        ("assumptions", "FAIL" if failed else "all hold", failed),
        ("absent", ", ".join(p.absent[:_MOST]) or "none", ""),
        *_jump(p),
        ("lambda_min, lambda_max", f"{t.lambda_min:.4g}, {t.lambda_max:.4g}", "of H"),
        ("Theorem 1", _APPLIES[t.applies], t.reason),
        ("ultimate radius", _number(t.radius_U_per_agent, "m"), f"RMS over agents; {weaker}"),
        ("initial error", _number(t.initial_error_per_agent, "m"), f"RMS over agents{at_most}"),
        ("held law", _WORDS[p.law.stable], p.law.reason),
        *_targets(p.targets),
        *_margin_of_links(p.links),
        ("loop on bodies", _WORDS[p.margins.bodies.stable], p.margins.bodies.reason),
    ]


def _jump(p: PhaseRecord) -> list[Row]:
    """Return how far q* jumps at the start of a phase."""
    if p.jump is None:
        return []
    far = max(p.jumps, key=lambda id: p.jumps[id] or 0.0, default="")
    most = f"norm of the whole team; the largest, {_number(p.jumps[far], 'm')}, of {far}" if far else ""
    return [("jump of q*", _number(p.jump, "m"), most)]


def _margin_of_links(links: LinkRecord | None) -> list[Row]:
    if links is None:
        return []
    loop = ("over exact links", "") if links.exact else ("over its links", _WORDS[links.stable])
    return [(*loop, f"delay margin {_number(links.delay_margin, 's')}")]


def _fragility(f: Fragility) -> list[Text]:
    lines = [f"  losing {x.name} ({x.kind}) breaks: {', '.join(x.breaks)}" for x in f.critical[:_MOST]]
    if f.critical_count > _MOST:
        lines.append(f"  ... and {f.critical_count - _MOST} more")
    if f.worst is not None:
        lost, left = f"{f.worst.name} ({f.worst.kind})", f"lambda_min {f.worst.lambda_min:.4g}"
        lines.append(f"  worst of the others: losing {lost}, {left}")
    none = [] if f.critical_count else ["  no single loss breaks an assumption"]
    return [Text(f"\nfragility ({f.method})", style="bold"), *map(Text, none + lines)]
