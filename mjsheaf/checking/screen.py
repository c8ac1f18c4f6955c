"""The answer of `mjsheaf check` on one screen: the verdict, what fails and how to fix it, and five numbers."""

from collections.abc import Iterator
from textwrap import wrap

from mjsheaf.checking.check import CheckRecord, PhaseRecord
from mjsheaf.checking.loop.disturbance import DisturbanceRecord
from mjsheaf.checking.loop.steady import SteadyError
from mjsheaf.checking.proposals import Proposal
from mjsheaf.checking.separation import SafetyRecord
from mjsheaf.checking.topology.cohomology import Fragility
from mjsheaf.errors import select_true

MAX_LINES = 45
"""Largest number of lines of the answer."""

WIDTH = 100
"""Largest width of a line."""

_FIXES = {
    1: "give singular parts of the flow a `core` radius",
    2: "give this vehicle thrusters, or `steering`, that push along every axis",
    4: "as for assumption 2",
}
_MAX_FAILURES = 6
_MAX_LINES_OF_A_FAILURE = 5
_MAX_NOTES = 4
_LABEL = 22


def screen(record: CheckRecord, name: str) -> list[str]:
    """Return the answer as lines of text.

    Args:
        record: Record of the check.
        name: Scenario as the user named it, for the last line.
    """
    lines = _wrapped(f"{record.scenario}: {_headline(record)}", "")
    failures = list(_failures(record))
    for failure in failures[:_MAX_FAILURES]:
        lines += ["", *failure[:_MAX_LINES_OF_A_FAILURE]]
    if len(failures) > _MAX_FAILURES:
        lines += ["", f"... and {len(failures) - _MAX_FAILURES} more"]
    lines += ["", *_numbers(record)]
    if later := [p for p in record.phases[1:] if not p.ok]:
        lines += ["", *_phases(later, len(record.phases))]
    notes = [line for note in record.notes[:_MAX_NOTES] for line in _wrapped(f"note: {note}", "  ")[:2]]
    lines += ["", *notes] if notes else []
    ending = ["", f"mjsheaf check {name} --full prints the whole report."]
    return lines[: MAX_LINES - len(ending)] + ending


def _headline(record: CheckRecord) -> str:
    problems = [*_unsettled(record), *(text for text, _ in _unstable(record))]
    if problems:
        return "NOT OK: " + "; ".join(problems)
    if not record.ok:
        return "NOT OK in a later phase" if record.phases else "NOT OK"
    all_apply = all(a.applies for a in record.assumptions)
    every = "all 7 assumptions hold" if all_apply else "all assumptions that apply hold"
    on_vehicles = " and on the vehicles" if record.margins.bodies.stable else ""
    loop = f", and the loop is stable on ideal kinematics{on_vehicles}" if record.law.stable else ""
    return f"OK: {every}{loop}"


def _unsettled(record: CheckRecord) -> Iterator[str]:
    """Yield which assumptions fail, and which are undecided."""
    for verdict, singular, plural in (("fails", "fails", "fail"), ("undecided", "undecided", "undecided")):
        numbers = [str(a.number) for a in record.assumptions if a.applies and a.verdict == verdict]
        if len(numbers) == 1:
            yield f"assumption {numbers[0]} {singular}"
        elif numbers:
            yield f"assumptions {', '.join(numbers)} {plural}"


def _unstable(record: CheckRecord) -> Iterator[tuple[str, str]]:
    """Yield what is not rigid or not stable, each with a fix."""
    shape = record.rigidity
    if shape.localizable is None and shape.rigid is False:
        fix = f"edges have rank {shape.rank}, and {shape.needed} is needed"
        yield "the formation is not rigid", fix if shape.bracing is None else shape.bracing.describe()
    if record.law.unmodelled:
        yield "the law is undecided", f"check has no model of {', '.join(record.law.unmodelled)}"
    yield from _unstable_loops(record)


def _unstable_loops(record: CheckRecord) -> Iterator[tuple[str, str]]:
    """Yield the loops that are unstable, each with a fix."""
    if record.law.stable is False:
        gains = record.law.stable_gains
        fix = f"set controller.gain between {gains[0]:.3g} and {gains[1]:.3g} 1/s" if gains else "no gain is stable"
        yield "the sampled loop is unstable", fix
    if record.links is not None and record.links.stable is False:
        margin = record.links.delay_margin
        fix = "lower controller.gain, or use links with less delay and loss"
        yield "the loop over the links is unstable", fix if margin is None else f"{fix} (margin {margin:.3g} s)"
    if record.margins.bodies.stable is False:
        largest = record.margins.bodies.largest_gain
        fix = "lower controller.gain" if largest is None else f"set controller.gain below {largest:.3g} 1/s"
        yield "the loop of the vehicles is unstable", fix
    if record.targets.unstable:
        yield "the targets' own law is unstable", record.targets.verdict()


def _failures(record: CheckRecord) -> Iterator[list[str]]:
    """Yield what fails or is undecided, each with the reason and the smallest fix."""
    for a in record.assumptions:
        if a.verdict not in ("fails", "undecided"):
            continue
        fix = _fix(record, a.number)
        yield [
            *_wrapped(f"Assumption {a.number} {a.verdict}: {a.name}.", "  "),
            *_wrapped(f"Why: {a.witness}.", "    ", "  "),
            *(_wrapped(f"Fix: {fix}.", "    ", "  ") if fix else ()),
        ]
    for problem, fix in _unstable(record):
        yield [*_wrapped(problem[0].upper() + problem[1:] + ".", "  "), *_wrapped(f"Fix: {fix}.", "    ", "  ")]


def _fix(record: CheckRecord, number: int) -> str:
    """Return the smallest change that makes an assumption hold, or nothing."""
    plan = record.relative_cohomology.mending
    if number == 5:
        return record.topology_fix
    if number == 6 and plan is not None:
        repairs = "; ".join(repair.description for repair in plan.repairs)
        others = [f"; or {'; '.join(other)}" for other in plan.alternatives[:1]]
        return repairs + "".join(others)
    return _FIXES.get(number, "")


def _numbers(record: CheckRecord) -> Iterator[str]:
    """Yield the five numbers and the fragility."""
    as_if = "" if record.steady.exact_links else ", as if links were exact"
    yield from _row("tracking error", _error(record.steady, as_if))
    if record.disturbance.rms != 0.0:
        yield from _row("gusts and waves", _moved(record.disturbance))
    largest = {"ideal kinematics": record.law.largest_gain, "the vehicles": record.margins.bodies.largest_gain}
    known = ", ".join(f"{gain:.4g} 1/s on {where}" for where, gain in largest.items() if gain is not None)
    yield from _row("largest gain", f"{known or 'not known'}; the gain is {record.theorem.gain:.4g} 1/s")
    margin = None if record.links is None else record.links.delay_margin
    yield from _row("delay margin", "not known" if margin is None else f"{margin:.3g} s, equal on all links")
    yield from _row("better law", _better(record.proposals, record.theorem.wanted_radius, as_if))
    if record.safety is not None:
        yield from _row("separation", _separation(record.safety))
    yield from _row("fragility", _fragile(record.fragility))


def _error(steady: SteadyError, as_if: str) -> str:
    """Return the predicted tracking error, and what it leaves out."""
    if steady.ideal is None:
        return f"not known: {steady.reason}"
    on_bodies = "not known" if steady.bodies is None else f"{steady.bodies:.3g} m"
    remarks = {
        f"vehicles: {steady.reason_on_bodies}": steady.bodies is None,
        f"{_listed(steady.limited)} would exceed the speed limit, so expect more": steady.limited,
    }
    error = f"{steady.ideal:.3g} m on ideal kinematics, {on_bodies} on the vehicles"
    return "; ".join([f"{error} (RMS over agents, second half{as_if})", *select_true(remarks)])


def _moved(found: DisturbanceRecord) -> str:
    """Return the error that gusts and waves leave, and which agents cannot hold station."""
    bodies = "not known" if found.rms_on_bodies is None else f"{found.rms_on_bodies:.3g} m"
    if found.rms is None:
        text = f"not known: {found.reason}"
    else:
        text = f"{found.rms:.3g} m on ideal kinematics, {bodies} on the vehicles (RMS over agents and time)"
    if found.carried_off:
        excess = max(found.carried_off.values())
        who = _listed(list(found.carried_off))
        text += f"; {who} cannot hold station at times: the medium is up to {excess:.3g} m/s too fast"
    return text


def _fragile(fragility: Fragility) -> str:
    """Return which single losses break an assumption."""
    if not fragility.critical_count:
        return "no single loss breaks an assumption"
    losses = [f"{loss.name} ({loss.kind})" for loss in fragility.critical[:3]]
    more = fragility.critical_count - len(losses)
    if more:
        losses.append("1 other" if more == 1 else f"any of {more} others")
    *others, last = losses
    either = f"{', '.join(others)} or {last}" if others else last
    return f"losing {either} breaks an assumption"


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
        return f"none found with a certified error of at most {radius:g} m"
    best = min(usable, key=lambda p: p.bound_per_agent)
    fields = ", ".join(f"{key}: {_value(value)}" for key, value in best.controller.items() if value is not None)
    cost = f", {best.exchanges:.4g} exchanges per second" if best.exchanges else ""
    return f"{fields} (error at most {best.bound_per_agent:.3g} m, RMS over agents{as_if}{cost})"


def _value(value: object) -> str:
    """Return a value as in a scenario file, without fields that have their default 0 or false."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_value(inner)}" for key, inner in value.items() if inner) + "}"
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else f"{value}"


def _phases(later: list[PhaseRecord], count: int) -> Iterator[str]:
    """Yield the phases in which the check does not hold."""
    yield f"Not ok in {len(later)} of {count} phases:"
    for phase in later[:3]:
        failed = [str(a.number) for a in phase.assumptions if a.verdict in ("fails", "undecided")]
        what = f"assumption {', '.join(failed)}" if failed else "a loop is unstable or undecided"
        yield from _wrapped(f"from {phase.start:g} s ({', '.join(phase.events)}): {what}", "    ", "  ")[:2]


def _listed(ids: list[str]) -> str:
    shown = ", ".join(ids[:3])
    more = "1 other" if len(ids) == 4 else f"{len(ids) - 3} others"
    return shown if len(ids) <= 3 else f"{shown} and {more}"


def _row(label: str, text: str) -> list[str]:
    return _wrapped(text, " " * _LABEL, f"{label:<{_LABEL}}")[:3]


def _wrapped(text: str, indent: str, first: str = "") -> list[str]:
    """Break a text into lines of at most WIDTH characters."""
    return wrap(text, WIDTH, initial_indent=first, subsequent_indent=indent, break_on_hyphens=False)
