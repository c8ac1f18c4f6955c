"""The answer of `mjsheaf compare` in a few lines: the errors on ideal kinematics and on bodies, and what to change."""

from textwrap import wrap

from mjsheaf.comparing.ladder import RungRecord, display_name
from mjsheaf.comparing.measures import FORMATION, RMS_OVER, TEAM, TRACKING
from mjsheaf.comparing.verdict import CompareRecord, PhaseRecord
from mjsheaf.errors import shortened

MAX_LINES = 14
"""Maximum number of lines of the answer. With six lines on the files, `compare` prints at most twenty."""

WIDTH = 100
"""Maximum width of a line, characters."""

_LABEL = 17
_MAX_PHASES = 4
_MAX_EVENTS = 36  # characters


def summary(record: CompareRecord) -> list[str]:
    """Return the answer as lines of text, with the sentences of the verdict that fit, the most important first."""
    title = f"{record.scenario}: ideal kinematics against bodies, {record.law_in_words}, {record.time_s:.6g} s"
    lines = [*wrap(title, WIDTH)[:2], *_errors(record), *_phases(record.phases)]
    shown = 0
    for sentence in record.verdict:
        wrapped = wrap(sentence, WIDTH, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)
        if len(lines) + len(wrapped) >= MAX_LINES and shown:
            break
        lines += wrapped[: MAX_LINES - 1 - len(lines)]
        shown += 1
    left = len(record.verdict) - shown
    if left:
        noun = "sentence" if left == 1 else "sentences"
        lines.append(f"  and {left} more {noun} in report.txt")
    return lines


def _errors(record: CompareRecord) -> list[str]:
    """Return a line on the tracking error, and one on the formation error where there are formations."""
    ideal = record.rung("ideal")
    bodies = record.rung("all")
    names = [TRACKING] if record.measure == TRACKING else [TRACKING, FORMATION]
    return [
        f"{display_name(name):<{_LABEL}}{_error(ideal, name)} on ideal kinematics, {_error(bodies, name)} on bodies "
        f"({RMS_OVER[name]}, second half)"
        for name in names
    ]


def _error(rung: RungRecord, name: str) -> str:
    if rung.status != "finished":
        return "blows up"
    value = rung.errors[TEAM].error(name)
    return "-" if value is None else f"{value:.3g} m"


def _phases(phases: list[PhaseRecord]) -> list[str]:
    """Return a line on the tracking error of each phase of a run with events."""
    lines = list[str]()
    for k, phase in enumerate(phases[:_MAX_PHASES]):
        ideal, bodies = (phase.errors[key][TEAM].error(TRACKING) for key in ("ideal", "all"))
        events = shortened(", ".join(phase.events) or "start", _MAX_EVENTS)
        errors = ", ".join("-" if error is None else f"{error:.3g} m" for error in (ideal, bodies))
        lines.append(f"{f'  phase {k}':<{_LABEL}}{errors}: {events}, from {phase.start:.6g} s")
    if len(phases) > _MAX_PHASES:
        lines.append(f"  and {len(phases) - _MAX_PHASES} more phases in report.txt")
    return lines
