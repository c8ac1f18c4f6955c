"""The page that a person reads: ladder, budget, ringing, speeds, convergence, and first of all what to change."""

from collections.abc import Sequence
from io import StringIO

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from mjsheaf.comparing.ladder import words
from mjsheaf.comparing.measures import TEAM
from mjsheaf.comparing.record import CompareRecord, RungRecord

WIDTH = 120  # of report.txt, and the least on a terminal, as numbers must not be cut

_SECTION = {"ideal": 0, "part": 0, "base": 1, "alone": 1, "all": 2, "without": 2}


def report(record: CompareRecord) -> Group:
    """The comparison as a page."""
    tables = [_ladder(record), _budget(record), _ringing(record), _speeds(record)]
    lines = [Padding(Text(f"- {sentence}"), (0, 0, 0, 2)) for sentence in record.verdict]
    title = f"{record.scenario}: ideal kinematics against bodies, gain {record.gain:g} 1/s, {record.time_s:.6g} s"
    return Group(Text(title, style="bold"), *lines, *tables, Text(_convergence(record)))


def report_text(record: CompareRecord) -> str:
    """The page as plain text."""
    console = Console(width=WIDTH, color_system=None, force_terminal=False, file=StringIO(), record=True)
    console.print(report(record))
    return console.export_text()


def _table(columns: Sequence[str]) -> Table:
    table = Table(header_style="", box=SIMPLE_HEAD, padding=(0, 1))
    for k, name in enumerate(columns):
        table.add_column(name, justify="right" if k else "left", no_wrap=True)
    return table


def _under(title: str, table: Table, note: str = "") -> Group:
    """A table under its title, with a note below; a table's own title would be as narrow as the table."""
    return Group(Text(f"\n{title}", style="bold"), table, *([Text(f"  {note}", style="dim")] if note else []))


def _number(value: float | None, form: str = ".3g") -> str:
    return "-" if value is None else f"{value:{form}}"


def _ladder(record: CompareRecord) -> Group:
    table = _table(
        ["rung", "tracking", "formation", "settles", "distance", "last half", "who, when", "at limits"],
    )
    sections = [_SECTION[rung.kind] for rung in record.ladder]
    for rung, own, following in zip(record.ladder, sections, [*sections[1:], 0], strict=True):
        if rung.status != "finished":
            mark = Text("BLOWS UP", style="bold red")
            table.add_row(rung.label, mark, *[""] * 6, end_section=own != following)
            continue
        far, near = rung.distance, rung.distance_late
        ideal = rung.key == "ideal"
        table.add_row(
            rung.label,
            *(_late_and_final(rung, name) for name in ("tracking_error", "formation_error")),
            _number(rung.settling_time_s),
            "" if ideal else _number(far.distance_m if far else None),
            "" if ideal else _number(near.distance_m if near else None),
            "" if ideal or near is None else f"{near.agent}, {near.time_s:.4g}",
            "" if not rung.saturation else f"{100 * rung.saturation[0].share:.1f}%",
            style="bold" if rung.kind in ("ideal", "all") else None,
            end_section=own != following,
        )
    usual = record.rung("all").timestep_s
    finer = ", ".join(r.label for r in record.ladder if r.timestep_s not in (None, usual))
    notes = [f"with a tenth of the timestep, else it blows up: {finer}"] if finer else []
    notes += [f"{r.label}: {r.message}" for r in record.ladder if r.status != "finished"]
    title = "ladder: errors in m, RMS over the last half / at the end; largest distance to the ideal run in m"
    return _under(title, table, "; ".join(notes))


def _late_and_final(rung: RungRecord, measure: str) -> str:
    errors = rung.errors[TEAM]
    late, final = getattr(errors.late, measure), getattr(errors.final, measure)
    return "-" if late is None else f"{late:.3f} / {_number(final, '.3f')}"


def _budget(record: CompareRecord) -> Group:
    scopes = list(record.rung("ideal").errors)
    budgets = [record.budget(scope, record.measure, "late") for scope in scopes]
    name = record.measure.replace("_", " ")
    table = _table(["", *scopes])

    def row(label: str, values: list[float | None], style: str | None = None, end: bool = False) -> None:
        table.add_row(label, *(_millimetres(v) for v in values), style=style, end_section=end)

    row("ideal kinematics", [b.ideal_m for b in budgets], "bold")
    row("targets become bodies", [b.targets_m for b in budgets])
    row("agents become bodies", [b.agents_m for b in budgets])
    row("both beyond that", [b.together_m for b in budgets], end=True)
    items = {item.effect: k for k, item in enumerate(budgets[0].effects)}
    order = sorted(items, key=lambda e: -abs(budgets[0].effects[items[e]].give_back_m or 0.0))
    for k, effect in enumerate(order):
        cells = [b.effects[items[effect]] for b in budgets]
        table.add_row(
            words(effect),
            *(f"{_millimetres(c.alone_m)} / {_millimetres(c.give_back_m)}" for c in cells),
            end_section=k + 1 == len(order),
        )
    if order:
        row("interaction", [b.interaction_m for b in budgets])
    row("as it stands", [b.all_m for b in budgets], "bold")
    title = f"error budget in mm: {name}, RMS over the last half: what it adds alone / what removing it gives back"
    return _under(title, table)


def _millimetres(value: float | None) -> str:
    return "-" if value is None else f"{round(1000 * value):d}"


def _ringing(record: CompareRecord) -> Group | Text:
    r = record.ringing
    if r is None:
        return Text("\nringing: not looked at, the team has too many states")
    table = _table(["", "damping ratio", "frequency (rad/s)", "overshoot"])
    ratio, held = f"{r.predicted_damping_ratio:.3f}", f"{r.predicted_damping_ratio_held:.3f}"
    table.add_row("predicted from inertia", ratio, _number(r.predicted_frequency_rad_s), f"{r.predicted_overshoot:.1%}")
    if held != ratio:
        table.add_row("predicted with the law's hold", held, "", "")
    for m in r.measured:
        found = "does not swing" if m.damping_ratio is None else f"{m.damping_ratio:.3f}"
        found = found if m.status == "finished" else "BLOWS UP"
        table.add_row(f"bodies {m.bodies}", found, _number(m.frequency_rad_s), f"{m.overshoot:.1%}")
    note = "the prediction knows no lag of thrusters and no turning" + "; no mode is predicted to swing" * r.overdamped
    return _under(
        f"ringing: the least damped mode (about {r.agent}), let go from rest with all else still", table, note
    )


def _speeds(record: CompareRecord) -> Group:
    table = _table(["", "ideal run", "as it stands", "who, when (s)", "vehicle holds", "forward"])
    bodies = {(d.role, d.vehicle): d for d in record.demands if d.run == "all"}
    for d in (d for d in record.demands if d.run == "ideal"):
        there = bodies.get((d.role, d.vehicle))
        beyond = d.least_speed_m_s is not None and d.asked_m_s > d.least_speed_m_s
        table.add_row(
            f"{d.role}: {d.vehicle}",
            Text(f"{d.asked_m_s:.3g}", style="bold red" if beyond else ""),
            _number(there.asked_m_s if there else None),
            f"{d.who}, {d.time_s:.4g}",
            "no limit" if d.least_speed_m_s is None else f"{d.least_speed_m_s:.3g}",
            "no limit" if d.forward_speed_m_s is None else f"{d.forward_speed_m_s:.3g}",
        )
    best = ", ".join(f"in {f.moves_in} {f.vehicle} {f.speed_m_s:.3g}" for f in record.fastest)
    return _under(
        "largest speeds asked in the last half, relative to the medium, m/s", table, f"fastest real vehicles: {best}"
    )


def _convergence(record: CompareRecord) -> str:
    c = record.convergence
    if c.slope is None:
        return f"\nconvergence: none measured; {c.reason or 'too few runs came to their end'}"
    points = ", ".join(f"{_number(p.distance_m)} m at {p.tau_s:.2g} s" for p in c.points)
    return (
        f"\nconvergence to the ideal run with the bodies' time constant: slope {c.slope:.3f} (theory: 1); largest "
        f"distance from {c.start_s:.3g} s to {c.end_s:.3g} s: {points}"
    )
