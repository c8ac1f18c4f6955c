"""Output of `mjsheaf check`: one screen with the verdict, each problem with its fix, and the most important numbers.

`--full` prints a page: the screen, then every number of the record under its name in `--json`.

Rows have the names, values and descriptions of the record's fields, so a new field appears by itself. Fields that are
null or empty are left out, as are sentences about null. A list of records has a row for each of them.
"""

from collections.abc import Iterator, Mapping
from itertools import groupby, pairwise
from textwrap import wrap
from typing import Any, NamedTuple

from pydantic import BaseModel
from rich.console import Group
from rich.text import Text

from mjsheaf.checking.loop.prediction import WIND_ON_TARGETS, DisturbanceRecord, SteadyError
from mjsheaf.checking.record import CheckRecord, Proposal, TheoremSummary, describe_tried, headline
from mjsheaf.checking.separation import SafetyRecord
from mjsheaf.checking.spectrum import Fragility
from mjsheaf.checking.trial import TrialRecord
from mjsheaf.errors import and_more, joined, listed

PAGE_WIDTH = 120
"""Smallest width of the page."""

_FIRST = ("assumptions", "trial", "steady", "theorem", "region", "law", "links", "margins", "proposals")
_IN_HEADINGS = (
    "scenario",
    "ok",
    "problems",
    "notes",
    "drifts",
    "topology_fix",
    "topology_edges",
    "start",
    "events",
    "phases",
)
_SAID_ELSEWHERE = ("norm", "holds", "applies")  # by descriptions, `verdict`, `reason` and the screen
_RMS = "_per_agent"  # ends the names of fields that have an error as RMS over agents, not as norm of the whole team
_WIDEST_VALUE = 26  # characters; what is longer takes the place of its description


class _Row(NamedTuple):
    """A field of a record.

    Attributes:
        path: Its name, after those of the records that contain it.
        lines: Its value; for a list of records, one line for each.
        meaning: Its description.
    """

    path: str
    lines: list[str]
    meaning: str


def report(record: CheckRecord) -> Group:
    """Return the record as a page for a terminal; of later phases, only the differences from the previous phase."""
    page = [Text("\n".join(screen(record, whole=True))), *_page(record, {row.path: row for row in _rows(record)}, {})]
    phases = [(phase, {row.path: row for row in _rows(phase)}) for phase in record.phases]
    for (_, before), (phase, rows) in pairwise(phases):
        page.append(Text(f"\nFrom {phase.start:g} s on: {', '.join(phase.events)}", style="bold"))
        gone = {path: row._replace(lines=["null"]) for path, row in before.items() if path not in rows}
        page += _page(phase, {**rows, **gone}, before)
    return Group(*page)


def _rows(
    record: BaseModel,
    path: str = "",
    *,
    most: int = 8,  # of the records in a list
) -> Iterator[_Row]:
    """Yield the fields of a record, and of the records in it, that have a value."""
    names = list(type(record).model_fields)
    for name in names:
        value = getattr(record, name)
        hidden = name in _SAID_ELSEWHERE or name.removesuffix(_RMS) in {*names} - {name}
        if hidden or value is None or (not path and name in _IN_HEADINGS):
            continue
        if isinstance(value, BaseModel):
            yield from _rows(value, f"{path}{name}.")
            continue
        lines = [_text(value)] if _text(value) else []
        if isinstance(value, list) and value and isinstance(value[0], BaseModel):
            lines = [
                ", ".join(f"{row.path.strip()}: {'; '.join(row.lines)}" for row in _rows(one, " "))
                for one in value[:most]
            ]
            lines += [f"and {len(value) - most} more"] if len(value) > most else []
        elif getattr(record, name + _RMS, None) is not None:
            lines = [f"{_text(value)} (RMS {_text(getattr(record, name + _RMS))})"]
        if lines:
            clauses = (type(record).model_fields[name].description or "").split("; ")
            yield _Row(path + name, lines, next((clause for clause in clauses if not clause.startswith("null")), ""))


def _page(record: BaseModel, rows: Mapping[str, _Row], before: Mapping[str, _Row]) -> Iterator[Text]:
    """Yield the rows of a record that differ from those before, the important parts first, each under its title."""
    order = {name: k for k, name in enumerate(_FIRST)}
    changed = [row for path, row in rows.items() if path not in before or before[path].lines != row.lines]
    changed.sort(key=lambda row: order.get(row.path.split(".")[0], len(order)))
    for part, group in groupby(changed, lambda row: row.path.split(".")[0]):
        value = getattr(record, part)
        one = value[0] if isinstance(value, list) and value else value
        about = type(one).__doc__ if isinstance(one, BaseModel) else type(record).model_fields[part].description
        title = " ".join((about or "").split("\n\n")[0].split()).removesuffix(".")
        yield Text()
        yield Text.assemble((part, "bold"), "  ", (title, "dim"), no_wrap=True, overflow="ellipsis")
        named = [(f"  {row.path.removeprefix(part).removeprefix('.')}", row) for row in group]
        width = max(len(name) for name, _ in named)
        for name, row in named:
            old = "; ".join(before[row.path].lines) if row.path in before else ""
            meaning = f"before: {old}" if old else "" if row.meaning == title else row.meaning
            for k, line in enumerate(row.lines):
                start = f"{'' if k else name:<{width}}  "
                if len(line) > _WIDEST_VALUE:
                    yield Text(
                        "\n".join(wrap(line, PAGE_WIDTH, initial_indent=start, subsequent_indent=" " * len(start)))
                    )
                else:
                    shown = f"{start}{line:<{_WIDEST_VALUE}}  "
                    yield Text.assemble(shown, (meaning, "dim"), no_wrap=True, overflow="ellipsis")


def _text(
    value: Any,
    *,
    most: int = 12,  # in a row
) -> str:
    """Return a value in words."""
    if isinstance(value, BaseModel):
        value = value.model_dump(exclude_none=True)
    if isinstance(value, dict):
        value = [f"{key}: {in_yaml(inner)}" for key, inner in value.items()]
    if isinstance(value, list | tuple):
        more = f", and {len(value) - most} more" if len(value) > most else ""
        return ", ".join(map(_text, value[:most])) + more
    return in_yaml(value)


# -- one screen --------------------------------------------------------------------------------------------------------

MAX_LINES = 45
"""Largest number of lines of the answer."""

WIDTH = 100
"""Largest width of a line."""

_LABEL = 22


def screen(
    record: CheckRecord,
    name: str | None = None,
    *,
    pending: bool = False,
    whole: bool = False,
    most_of_headline: int = 6,
    most_notes: int = 4,
) -> list[str]:
    """Return the answer as lines of text.

    Args:
        record: Record of the check.
        name: Scenario as the user named it, for a last line on the whole report; None without such a line.
        pending: True while the mission is being tried, so a verdict of OK is not final.
        whole: True to print all texts in full, False to fit on a screen.
        most_of_headline: Largest number of lines of the verdict.
        most_notes: Largest number of notes.
    """
    verdict = "no problem found by analysis" if pending and record.ok else headline(record)
    rest = [""]
    for label, text in _numbers(record):
        rest += _cut(_wrapped(text, " " * _LABEL, f"{label:<{_LABEL}}"), 3, whole)
    notes = record.notes if whole else record.notes[:most_notes]
    rest += [""] if notes else []
    for note in notes:
        rest += _cut(_wrapped(f"note: {note}", "  "), 2, whole)
    rest += [] if name is None else ["", f"mjsheaf check {name} --full prints the whole report."]
    lines = _cut(_wrapped(f"{record.scenario}: {verdict}", ""), most_of_headline, whole)
    for k, problem in enumerate(record.problems):
        tried = "" if pending else describe_tried(problem)
        block = ["", *_wrapped(problem.what[0].upper() + problem.what[1:] + ".", "  ", "  ")]
        block += _cut(_wrapped(f"Why: {problem.why}.", "      ", "    "), 3, whole) if problem.why else []
        block += _cut(_wrapped(f"Fix: {problem.fix}. {tried}", "      ", "    "), 4, whole) if problem.fix else []
        more = ["", f"... {and_more(len(record.problems) - k, 'problem')}"]
        if not whole and len(lines) + len(block) + len(more) + len(rest) > MAX_LINES:
            lines += more
            break
        lines += block
    return lines + rest


def _numbers(
    record: CheckRecord,
    *,
    most_drifts: int = 8,
) -> Iterator[tuple[str, str]]:
    """Yield label and text of the rows with the most important numbers."""
    as_if = "" if record.steady.exact_links else ", as if links were exact"
    yield "tracking error", _error(record.steady, as_if)
    if record.disturbance.rms != 0.0:
        yield "gusts and waves", _moved(record.disturbance)
    largest = {"ideal kinematics": record.law.largest_gain, "the vehicles": record.margins.bodies.largest_gain}
    if record.links is not None and record.links.delay.delay and record.links.loss is None:
        largest["ideal kinematics over its links"] = record.links.delay.largest_gain
    known = ", ".join(f"{gain:.4g} 1/s on {where}" for where, gain in largest.items() if gain is not None)
    yield "largest gain", f"{known or 'not known'}; the gain is {record.theorem.gain:.4g} 1/s"
    margin = None if record.links is None else record.links.delay_margin
    yield "delay margin", "not known" if margin is None else f"{margin:.3g} s, equal on all links"
    yield "better law", _better(record.proposals, record.theorem.wanted_radius, as_if)
    yield "Theorem 1", _theorem(record.theorem)
    if record.safety is not None:
        yield "separation", _separation(record.safety)
    if record.margins.wind:
        held = ", ".join(
            f"{id} {'not known' if most is None else f'{most:.3g}'}" for id, (_, most) in record.margins.wind.items()
        )
        yield "wind on hulls", f"holds station against wind of at most (m/s): {held}"
    if record.drifts:
        far = ", ".join(f"{name} {distance:.3g} m" for name, distance in list(record.drifts.items())[:most_drifts])
        yield "targets adrift", f"the flow carries them: {far}"
    yield "fragility", _fragile(record.fragility)
    if record.trial is not None:
        yield "trial on bodies", _trial(record.trial)


def _theorem(theorem: TheoremSummary) -> str:
    """Return whether Theorem 1 applies, with which bound, or why not."""
    if theorem.holds is None:
        return f"is not about this team: {theorem.reason.removeprefix('does not apply: ')}"
    if not theorem.applies:
        return f"does not apply: {theorem.reason}"
    held = " approximately (the law is held)" if theorem.approximate else ""
    return (
        f"applies{held}: k_min = {theorem.k_min:.3g} 1/s exceeds rho = {theorem.rho or 0.0:.3g} 1/s, and the error "
        f"ends below {theorem.radius_U_per_agent:.3g} m (RMS over agents)"
    )


def _trial(trial: TrialRecord) -> str:
    """Return the result of the trial of the mission."""
    if not trial.seconds:
        return trial.problems[0].text if trial.problems else "not run"
    error = "" if trial.tracking_error is None else f": tracking error {trial.tracking_error:.3g} m"
    part = "" if trial.complete else ", the part that fits into 1e8 vehicle-steps"
    failed = "; ".join(problem.text for problem in trial.problems)
    ending = failed or trial.ending or "too short to judge"
    return f"{trial.seconds:g} s{part}{error} (RMS over agents, second half); {ending}"


def _error(steady: SteadyError, as_if: str) -> str:
    """Return the predicted tracking error, and what it leaves out."""
    if steady.ideal is None:
        return f"not known: {steady.reason}"
    unknown = steady.bodies is None or WIND_ON_TARGETS in steady.leaves_out  # as in `check.foreseen_error`
    on_bodies = "not known" if unknown else f"{steady.bodies:.3g} m"
    parts = [
        f"{steady.ideal:.3g} m on ideal kinematics, {on_bodies} on the vehicles (RMS over agents, second half{as_if})"
    ]
    if steady.bodies is None:
        parts.append(f"vehicles: {steady.reason_on_bodies}")
    if steady.limited:
        parts.append(f"{listed(steady.limited)} {'is' if len(steady.limited) == 1 else 'are'} at the speed limit")
    if steady.leaves_out:
        parts.append(f"leaves out {joined(steady.leaves_out)}")
    return "; ".join(parts)


def _moved(found: DisturbanceRecord) -> str:
    """Return the error due to gusts and waves, and the agents that cannot hold station."""
    bodies = "not known" if found.rms_on_bodies is None else f"{found.rms_on_bodies:.3g} m"
    text = (
        f"not known: {found.reason}"
        if found.rms is None
        else f"{found.rms:.3g} m on ideal kinematics, {bodies} on the vehicles (RMS over agents and time)"
    )
    if found.carried_off:
        excess = max(found.carried_off.values())
        who = listed(list(found.carried_off))
        text += f"; {who} cannot hold station at times: the medium is up to {excess:.3g} m/s too fast"
    if found.leaves_out and found.rms is not None:
        text += f"; leaves out {joined(found.leaves_out)}"
    return text


def _fragile(fragility: Fragility) -> str:
    """Return which single losses break an assumption."""
    if not fragility.critical_count:
        return "no single loss breaks an assumption"
    losses = [f"{loss.name} ({loss.kind})" for loss in fragility.critical[:3]]
    more = fragility.critical_count - len(losses)
    if more:
        losses.append("1 other" if more == 1 else f"any of {more} others")
    return f"losing {joined(losses, ' or ')} breaks an assumption"


def _separation(safety: SafetyRecord) -> str:
    """Return the guarantees about distances between vehicles."""
    told = []
    for pairs, where in ((safety.unsafe, "q*"), (safety.initial, "the start")):
        if pairs:
            worst = pairs[0]
            others = f", and {len(pairs) - 1} more" if len(pairs) > 1 else ""
            told.append(
                f"too close at {where}: {' - '.join(worst.pair)} by {-worst.gap:.3g} m at {worst.time:.4g} s{others}"
            )
    kept = "kept on ideal kinematics as long as every agent's constraints are feasible"
    told.append(kept if safety.guaranteed else f"not guaranteed: {safety.reasons[0]}")
    return "; ".join([*told, "error bounds are undecided while the filter acts"])


def _better(proposals: list[Proposal], radius: float, as_if: str) -> str:
    """Return the law with the smallest bound among those that are stable on the vehicles."""
    usable = [p for p in proposals if p.stable_on_bodies is not False]
    if not usable:
        return f"none can be certified to keep the error below {radius:g} m; terms of the law may still reduce it"
    best = min(usable, key=lambda p: p.bound_per_agent)
    fields = ", ".join(f"{key}: {in_yaml(value)}" for key, value in best.controller.items() if value is not None)
    cost = f", {best.exchanges:.4g} exchanges per second" if best.exchanges else ""
    return f"{fields} (error at most {best.bound_per_agent:.3g} m, RMS over agents{as_if}{cost})"


def in_yaml(value: object) -> str:
    """Return a value as in a scenario file; for a mapping, without fields that have their default 0 or false."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {in_yaml(inner)}" for key, inner in value.items() if inner) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(in_yaml, value)) + "]"
    if isinstance(value, bool | None):
        return {True: "true", False: "false", None: "null"}[value]
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _cut(lines: list[str], most: int, whole: bool) -> list[str]:
    """Return the first lines, or the whole of them; the last one ends in '...' if some are left out."""
    return lines if whole or len(lines) <= most else [*lines[: most - 1], f"{lines[most - 1][: WIDTH - 4]} ..."]


def _wrapped(text: str, indent: str, first: str = "") -> list[str]:
    """Break a text into lines of at most WIDTH characters."""
    return wrap(text, WIDTH, initial_indent=first, subsequent_indent=indent, break_on_hyphens=False)
