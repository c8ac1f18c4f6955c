"""The answer of `mjsheaf compare` on one screen, and the whole report: verdict, variants, budget, gain, speeds."""

from io import StringIO
from itertools import accumulate
from textwrap import wrap

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group
from rich.padding import Padding
from rich.table import Column, Table
from rich.text import Text

from mjsheaf.comparing.causes import LIMITED_BY, CompareRecord
from mjsheaf.comparing.margins import MIN_DAMPING
from mjsheaf.comparing.variants import (
    FORMATION,
    RMS_OVER,
    TEAM,
    TRACKING,
    ItemRecord,
    RungRecord,
    display_name,
)
from mjsheaf.errors import and_more, joined, select_true, shortened

MAX_LINES = 14
"""Maximum number of lines of the answer on a screen. With six lines on the files, `compare` prints at most twenty."""

SCREEN_WIDTH = 100
"""Maximum width of a line of that answer, characters."""

_LABEL_WIDTH = 17
WIDTH = 120  # of report.txt; also the minimum on a terminal, so that numbers are not cut

_WORSE = {
    "underactuation": "the stand-in holds its heading, is controlled at its origin, and its speed abeam is limited by "
    "its sway drag",
    "drag_law": "quadratic drag also damps; without it, bodies with lagging thrusters oscillate longer and reach their "
    "limits",
}
_BEFORE_EFFECTS = {
    "at_q_star_m": "at q* already",
    "ideal_m": "ideal kinematics",
    "targets_m": "targets become bodies",
    "agents_m": "agents become bodies",
    "together_m": "both beyond that",
}
_AFTER_EFFECTS = {"interaction_m": "interaction", "all_m": "as given"}
"""Fields of a budget in the order of its table, with their labels."""

_SECTIONS = [("ideal", "part"), ("base", "alone"), ("all", "without"), ("law",), ("links",), ("limit",), ("engine",)]
"""Kinds of variants in each section of the ladder."""


def summary(
    record: CompareRecord,
    *,
    phases: int = 4,  # with a line on their tracking error
    characters: int = 36,  # of the events of a phase
) -> list[str]:
    """Return the answer as lines of text, with the sentences of the verdict that fit, the most important first."""
    lines = wrap(_title(record), SCREEN_WIDTH)[:2]
    for name in dict.fromkeys((TRACKING, record.measure)):
        ideal, bodies = (record.rung(key).error_in_words(name) for key in ("ideal", "all"))
        where = f"{ideal} on ideal kinematics, {bodies} on bodies ({RMS_OVER[name]}, second half)"
        lines.append(f"{display_name(name):<{_LABEL_WIDTH}}{where}")
    for k, phase in enumerate(record.phases[:phases]):
        both = [phase.errors[key][TEAM].error(TRACKING) for key in ("ideal", "all")]
        errors = ", ".join("-" if error is None else f"{error:.3g} m" for error in both)
        events = shortened(", ".join(phase.events) or "start", characters)
        lines.append(f"{f'  phase {k}':<{_LABEL_WIDTH}}{errors}: {events}, from {phase.start:.6g} s")
    if len(record.phases) > phases:
        lines.append(f"  {and_more(len(record.phases) - phases, 'phase')} in report.txt")
    shown = 0
    for sentence in record.verdict:
        wrapped = wrap(sentence, SCREEN_WIDTH, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)
        if len(lines) + len(wrapped) >= MAX_LINES and shown:
            break
        lines += wrapped[: MAX_LINES - 1 - len(lines)]
        shown += 1
    left = len(record.verdict) - shown
    if left:
        lines.append(f"  {and_more(left, 'sentence')} in report.txt")
    return lines


def _title(record: CompareRecord) -> str:
    return f"{record.scenario}: ideal kinematics against bodies, {record.law_in_words}, {record.time_s:.6g} s"


def report(record: CompareRecord) -> Group:
    """Render the comparison as a page."""
    tables = [_ladder(record), _budget(record), *_gains(record), _ringing(record), _speeds(record)]
    return Group(
        Text(_title(record), style="bold"),
        *[Padding(Text(f"- {sentence}"), (0, 0, 0, 2)) for sentence in record.verdict],
        *_phases(record),
        *tables,
        Text(_convergence(record)),
    )


def report_text(record: CompareRecord) -> str:
    """Render the page as plain text."""
    console = Console(width=WIDTH, color_system=None, force_terminal=False, file=StringIO(), record=True)
    console.print(report(record))
    return console.export_text()


def _table(*columns: str) -> Table:
    return Table(
        *(Column(name, justify="right" if k else "left", no_wrap=True) for k, name in enumerate(columns)),
        header_style="",
        box=SIMPLE_HEAD,
        padding=(0, 1),
    )


def _under(title: str, table: Table, *notes: str) -> Group:
    """Put a table under its title, with notes below it; rich would wrap a table's own title to the table's width."""
    return Group(
        Text(f"\n{title}", style="bold"), table, *[Padding(Text(note, style="dim"), (0, 0, 0, 2)) for note in notes]
    )


def _number(value: float | None, form: str = ".3g") -> str:
    return "-" if value is None else f"{value:{form}}"


def _phases(
    record: CompareRecord,
    *,
    sentences: int = 2,  # maximum number of sentences on the page for each phase
) -> list[Group]:
    """Tabulate the errors of each phase on ideal kinematics and as given, with what to change."""
    if not record.phases:
        return []
    names = {TRACKING: "tracking"} if record.measure == TRACKING else {TRACKING: "tracking", FORMATION: "formation"}
    columns = [heading for name in names.values() for heading in (f"{name}: ideal", "bodies")]
    table = _table("phase", "from (s)", "to (s)", *columns)
    notes = []
    for k, phase in enumerate(record.phases):
        what = ", ".join(phase.events) or "start"
        cells = [_number(phase.errors[key][TEAM].error(name)) for name in names for key in ("ideal", "all")]
        table.add_row(f"{k}: {shortened(what, 36)}", f"{phase.start:.6g}", f"{phase.end:.6g}", *cells)
        notes += [f"phase {k}: {sentence}" for sentence in phase.levers[:sentences]]
    title = "phases: errors of the team in m (RMS over agents or edges, and over the second half of the phase)"
    notes.append("compare.json has the budget of each phase and all of its sentences")
    return [_under(title, table, *notes)]


def _gains(record: CompareRecord) -> list[Group]:
    """Tabulate the runs at higher gains."""
    if not record.gains:
        return []
    table = _table("gain (1/s)", "tracking", "formation", "thrusters at a limit", "ends")
    for trial in record.gains:
        errors = [_number(trial.late.tracking_error), _number(trial.late.formation_error)]
        saturated = "" if trial.saturated is None else f"{100 * trial.saturated:.1f}%"
        ends = (trial.ending or "") if trial.status == "finished" else "BLOWS UP"
        table.add_row(f"{trial.gain:.4g}", *errors, saturated, ends)
    return [
        _under(
            "gain: runs of the bodies as given at the gain and above it; errors in m, RMS over the second half", table
        )
    ]


def _ladder(record: CompareRecord) -> Group:
    table = _table("variant", "tracking", "formation", "settles (s)", "distance", "second half", "who, when", "limited")
    for kinds in _SECTIONS:
        for rung in [rung for rung in record.ladder if rung.kind in kinds]:
            bold = rung.kind in ("ideal", "all") and rung.status == "finished"
            table.add_row(rung.label, *_cells(rung), style="bold" if bold else None)
        table.add_section()
    title = "ladder: errors in m, over the second half / at the end; largest distance to the ideal run in m"
    usual = record.rung("all").timestep_s
    finer = ", ".join(r.label for r in record.ladder if r.timestep_s not in (None, usual))
    telling = record.measure.removesuffix("_error")
    special = {
        f"paper's law: without {joined(record.terms or [''])}": record.terms,
        f"paper's law: at the scenario's gain, instead of {record.controller}": record.controller,
        f"with a tenth of the timestep, as it blows up otherwise: {finer}": finer,
    }
    notes = [
        "tracking: RMS over agents; formation: RMS over edges; over the second half: RMS over time too",
        f"settles: time from which the team's {telling} error stays below 1.25 times its maximum over the second half;",
        "not settled: the error still changes, the team is in a limit cycle, or an agent does not move",
        "limited: fraction of the time that agents' thrusters are at a limit",
        *select_true(special),
        *(f"{r.label}: {r.message}" for r in record.ladder if r.status != "finished"),
    ]
    return _under(title, table, *notes)


def _cells(rung: RungRecord) -> list[Text | str | None]:
    """Return the cells of a variant in the table of the ladder."""
    if rung.status != "finished":
        return [Text("BLOWS UP", style="bold red"), *[""] * 6]
    team = rung.errors[TEAM]
    errors = [
        " / ".join(_number(team.error(name, of), ".3f") for of in ("late", "final")).replace("- / -", "-")
        for name in (TRACKING, FORMATION)
    ]
    near = rung.distance_late
    distances: list[str | None] = [""] * 3
    if rung.kind != "ideal":
        who = f"{near.agent}, {near.time_s:.4g}" if near else ""
        distances = [*(_number(d.distance_m if d else None) for d in (rung.distance, near)), who]
    return [
        *errors,
        _number(rung.settling_time_s) if rung.ending in ("settled", None) else rung.ending,
        *distances,
        f"{100 * rung.saturation[0].share:.1f}%" if rung.saturation else "",
    ]


def _budget(
    record: CompareRecord,
    *,
    width: int = 62,  # of the first three columns, characters, at most
    least: float = 0.05,  # fraction of the error; it is explained why removing an effect adds more than this
    resolution: float = 0.0005,  # m; smaller values are shown as 0
) -> Group:
    team, *groups = (record.budget(scope, record.measure, "late") for scope in record.scopes)
    widths = [
        max(map(len, [b.scope, *map(_alone_and_back, b.effects), _millimetres(b.ideal_m), _millimetres(b.all_m)])) + 2
        for b in groups
    ]
    fitting = [b for b, total in zip(groups, accumulate(widths), strict=True) if total <= WIDTH - width]
    budgets = [team, record.budget(TEAM, record.measure, "final"), *fitting]
    table = _table("", "team", "team, at the end", *(b.scope for b in budgets[2:]))

    def rows(labels: dict[str, str]) -> None:
        for field, label in labels.items():
            table.add_row(
                label,
                *(_millimetres(getattr(b, field)) for b in budgets),
                style="bold" if field in ("ideal_m", "all_m") else None,
            )

    rows(_BEFORE_EFFECTS)
    table.add_section()
    for items in sorted(zip(*(b.effects for b in budgets), strict=True), key=lambda c: -abs(c[0].give_back_m or 0.0)):
        table.add_row(display_name(items[0].effect), *map(_alone_and_back, items))
    table.add_section()
    rows(_AFTER_EFFECTS if team.effects else {"all_m": _AFTER_EFFECTS["all_m"]})
    title = (
        f"error budget in mm: {display_name(record.measure)}, {RMS_OVER[record.measure]} and the second half: "
        "what an effect adds alone / what removing it gives back"
    )
    notes = [
        "at q* already: error with the agents of the ideal run at q*; not part of the sum",
        "compare.json has the tracking and formation error of every group, over the second half and at the end",
    ]
    worse = {
        item.effect
        for b in (team, *groups)
        for item in b.effects
        if (item.give_back_m or 0.0) < -max(least * (b.all_m or 0.0), resolution)
    }
    reasons = [f"{display_name(effect)}: {why}" for effect, why in _WORSE.items() if effect in worse]
    if worse:
        notes.append("; ".join(["below 0: worse without it", *reasons]))
    return _under(title, table, *notes)


def _alone_and_back(item: ItemRecord) -> str:
    return f"{_millimetres(item.alone_m)} / {_millimetres(item.give_back_m)}"


def _millimetres(value: float | None) -> str:
    return "-" if value is None else f"{round(1000 * value):d}"


def _ringing(record: CompareRecord) -> Group | Text:
    ringing = record.ringing
    if ringing is None or ringing.least_damped is None:
        reason = "the run is too short" if ringing is None else ringing.reason
        return Text(f"\nringing: not examined; {f'the law is {record.law}' if record.controller else reason}")
    mode = ringing.least_damped
    table = _table("vehicles' loop", "usable gain (1/s)")
    gains = {"as given": ringing.usable_gain} | {f"without {name}": gain for name, gain in ringing.without.items()}
    for name, gain in gains.items():
        table.add_row(name, "no limit" if gain is None else f"{gain:.3g}")
    when = "" if record.ringing_phase is None else f", phase {record.ringing_phase}"
    about = f"about {mode.agent or 'all agents'}{when}"
    title = f"ringing: the least damped mode ({about}) has the damping ratio {mode.damping:.3f} at {mode.frequency:.3g}"
    note = f"the gain is usable while every mode has a damping ratio of {MIN_DAMPING}: it overshoots by 37% at most"
    known = [one.largest_gain for one in (ringing, record.loop) if one is not None and one.largest_gain is not None]
    return _under(
        f"{title} rad/s",
        table,
        note,
        f"limited by {LIMITED_BY[ringing.effect]}; unstable above {_number(min(known, default=None))} 1/s",
    )


def _speeds(record: CompareRecord) -> Group:
    table = _table("", "ideal run", "as given", "who, when (s)", "sustained: slowest way", "sustained: ahead")
    as_given = {(d.role, d.vehicle): d.asked_m_s for d in record.demands if d.run == "all"}
    for d in record.demands:
        if d.run == "ideal":
            beyond = d.least_speed_m_s is not None and d.asked_m_s > d.least_speed_m_s
            table.add_row(
                f"{d.role}: {d.vehicle}",
                Text(f"{d.asked_m_s:.3g}", style="bold red" if beyond else ""),
                _number(as_given.get((d.role, d.vehicle))),
                f"{d.who}, {d.time_s:.4g}",
                *("no limit" if v is None else f"{v:.3g}" for v in (d.least_speed_m_s, d.forward_speed_m_s)),
            )
    best = ", ".join(f"in {f.moves_in} {f.vehicle} {f.speed_m_s:.3g}" for f in record.fastest)
    title = "maximum speeds commanded in the second half, relative to the medium, m/s"
    return _under(
        title,
        table,
        "sustained: steady speed through the medium at full thrust, in the slowest horizontal direction and ahead",
        f"fastest real vehicles (slowest way): {best}",
    )


def _convergence(record: CompareRecord) -> str:
    c = record.convergence
    if c.slope is None:
        return f"\nconvergence: none measured; {c.reason or 'too few runs finished'}"
    law = ", under the paper's law alone" if record.terms else ""
    points = ", ".join(f"{_number(p.distance_m)} m at {p.tau_s:.2g} s" for p in c.points)
    return (
        f"\nconvergence to the ideal run with the bodies' time constant tau{law}: slope {c.slope:.3f} (theory: 1); "
        f"largest distance from {c.start_s:.3g} s to {c.end_s:.3g} s: {points}"
    )
