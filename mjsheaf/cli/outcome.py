"""Print a run on the terminal: how well it went first, then the numbers, then what needs attention."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjsheaf.cli.terminal import make_console, make_table, print_lines
from mjsheaf.errors import printable, shortened

if TYPE_CHECKING:
    from mjsheaf.runs.publish import Outcome
    from mjsheaf.runs.simulate import Progress
    from mjsheaf.scenario import Scenario

_MOVED_BY = {"physics": "MuJoCo bodies", "ideal": "ideal kinematics"}
_NORMS = {
    "mean_disagreement": "mean over agents",
    "tracking_error": "RMS over agents",
    "formation_error": "RMS over edges",
    "centering_error": "largest group",
}
_FILES = {"report.html": "replay, for any browser", "video.mp4": "video"}
_MAX_NOTES = 4  # lines
_MAX_ROWS = 5  # of the table
_MAX_EVENTS = 36  # characters


def announcing(scenario: "Scenario", backend: str, progress: "Progress") -> "Progress":
    """Return `progress` that prints what runs before its first report: a run that is refused prints nothing."""
    announced = False

    def report(what: str, done: int, total: int) -> None:
        nonlocal announced
        if not announced:
            announced = True
            print_start(scenario, backend)
        progress(what, done, total)

    return report


def print_start(scenario: "Scenario", backend: str) -> None:
    """Print the size, engine and duration of a run that starts."""
    agents = _count(len(scenario.agents), "agent")
    targets = _count(len(scenario.targets), "target")
    seconds = scenario.time.end - scenario.time.start
    line = f"{scenario.name}: {agents} and {targets} on {_MOVED_BY[backend]}, {seconds:.6g} s"
    with suppress(BrokenPipeError):  # the run continues, for its files; the next line printed ends the command
        print(printable(line), flush=True)


def print_outcome(outcome: "Outcome", *, overridden: bool = False) -> None:
    """Print the result of a published run, then its errors, its notes and its files.

    Args:
        outcome: The published run.
        overridden: True if fields of the scenario were overridden, which its expectation does not account for.
    """
    summary = outcome.summary
    replaced = [outcome.replaced] if outcome.replaced else []
    print_lines(_headline(summary), *_verdict(summary["expect"], overridden))
    make_console().print(_table(summary))
    print_lines(
        *_safety(summary.get("safety")),
        *_notes(summary),
        *(f"DRIFTS: {direction}; errors refer to the q* of least norm" for direction in summary["free_directions"]),
        *_effort(summary),
        *replaced,
        *describe_files(outcome.directory, _FILES),
    )


def describe_files(directory: Path, about: Mapping[str, str]) -> list[str]:
    """Return where the files of a run or a comparison are.

    Args:
        directory: Their directory.
        about: What is in the most important ones, by name; they get lines of their own, if they exist.
    """
    names = sorted(path.name for path in directory.iterdir())
    lines = [f"  {directory / name}: {text}" for name, text in about.items() if name in names]
    others = [name for name in names if name not in about]
    return [*lines, f"  {directory}: {', '.join(others)}"] if others else lines


def _notes(summary: dict[str, Any]) -> list[str]:
    """Return the most important notes, and how many more there are.

    That bodies exceed the bound of ideal kinematics is no news: the page and summary.json have it.
    """
    told = [note for note in summary["notes"] if note["kind"] != "bound" or summary["backend"] == "ideal"]
    lines = [f"note: {note['text']}" for note in told]
    if len(lines) <= _MAX_NOTES:
        return lines
    shown = _MAX_NOTES - 1
    return [*lines[:shown], f"and {len(lines) - shown} more notes in summary.json"]


def _headline(summary: dict[str, Any]) -> str:
    """Return a sentence about how a run ended and how far agents are from their places."""
    final = summary["final"]
    if summary["status"] != "finished":
        return f"{summary['status']}: {summary['message']}"
    size = final["tracking_error"]
    if size is None:
        return "finished"
    return (
        f"finished: at {final['time']:.6g} s the agents are {size:.3g} m from where they should be "
        "(tracking error, RMS over agents)"
    )


def _verdict(expect: dict[str, Any], overridden: bool) -> list[str]:
    """Return the verdict on the scenario's expectation: what is missed, or else every measure with its bound."""
    from mjsheaf.runs.expecting import miss

    if expect["met"] is None:
        reason = expect.get("reason") or "the scenario has no `expect:` block for this backend"
        return [f"no expectation: {reason}"]
    missed = [miss(check) for check in expect["checks"] if not check["met"]]
    if missed:
        scope = " (the expectation is for the scenario without --set)" if overridden else ""
        return [f"NOT as expected: {'; '.join(missed)}{scope}"]
    held = [
        f"{_words(check['measure'])} {check['found']:.3g} m "
        f"(at {'least' if check['measure'] == 'smallest_separation' else 'most'} {check['bound']:g} m)"
        for check in expect["checks"]
    ]
    return [f"as expected: {'; '.join(held)}"]


def _table(summary: dict[str, Any]) -> Any:
    """Return the table of errors: the team, each group, and the end of each phase."""
    final = summary["final"]
    headings = {measure: f"{_words(measure)}\n{norm}" for measure, norm in _NORMS.items()}
    title = f"{summary['scenario']} on {summary['backend']}, errors in m at t = {final['time']:.6g} s"
    rows = list({"team": final, **final["groups"]}.items())
    for number, phase in enumerate(summary["phases"]):
        if phase["final"] is None:
            continue
        events = shortened(", ".join(phase["events"]) or "start", _MAX_EVENTS)
        rows.append((f"phase {number}, {events}, at {phase['final']['time']:.6g} s", phase["final"]))
    columns = list(headings.values())
    table = make_table("", *columns, numbers=columns, title=title, box=None, padding=(0, 2, 0, 0))
    shown = len(rows) if len(rows) <= _MAX_ROWS else _MAX_ROWS - 1
    for name, values in rows[:shown]:
        table.add_row(name, *_numbers(values))
    if len(rows) > shown:
        table.add_row(f"and {len(rows) - shown} more in summary.json")
    return table


def _numbers(values: dict[str, Any]) -> list[str]:
    return ["-" if values[measure] is None else f"{values[measure]:.4g}" for measure in _NORMS]


def _safety(safety: dict[str, Any] | None) -> list[str]:
    """Return how close vehicles came, and what the filter that keeps them apart did; nothing without one."""
    if safety is None:
        return []
    shares, left, closest = safety["filtered"], safety["smallest_separation"], safety.get("closest")
    busiest = max(shares, key=shares.__getitem__)
    lines = [
        f"separation: all distances exceed the required ones by at least {left:.3g} m; the filter acted on "
        f"{sum(share > 0.0 for share in shares.values())} of {len(shares)} agents, on {busiest} most, "
        f"{100.0 * shares[busiest]:.3g} % of the time"
        if left is not None and left >= 0.0
        else f"TOO CLOSE: {' and '.join(closest['pair'])} are {-closest['gap']:.3g} m closer than required at t = "
        f"{closest['time']:.6g} s"
        if closest
        else f"TOO CLOSE: a distance is {0.0 if left is None else -left:.3g} m below the required one"
    ]
    circling = safety["circling"]
    stopped = [name for name in safety["deadlocked"] if name not in circling]
    if stopped:
        names = shortened(", ".join(stopped))
        advice = "safety.tie_break: right_hand makes agents that stop turn right"
        lines.append(f"DEADLOCKED: the filter has stopped {names} short of their places; {advice}")
    if circling:
        names = shortened(", ".join(circling))
        advice = "a larger safety.rate lets such agents pass"
        lines.append(f"DEADLOCKED: the filter keeps {names} circling without arriving; {advice}")
    if safety["infeasible"]:
        names = shortened(", ".join(safety["infeasible"]))
        lines.append(f"INFEASIBLE: at some time no command kept all distances of {names}; no guarantee from then on")
    return lines


def _effort(summary: dict[str, Any]) -> list[str]:
    """Return the duration of the simulation and, if agents send messages, their number."""
    speed = f"{summary['realtime_factor']:.3g} x real time"
    lines = [f"{summary['steps']} steps in {summary['wall_time_s']:.2f} s ({speed})"]
    sent = summary["communication"]
    if sent["exchanges_per_second"]:
        lines.append(
            f"{sent['exchanges_per_second']:.4g} exchanges between neighbours per second; each agent sends "
            f"{sent['numbers_per_agent_second']:.4g} numbers per second"
        )
    return lines


def _words(measure: str) -> str:
    """Return the name of a measure, or of one at the end of a phase, in words."""
    return measure.removeprefix("mean_").replace("_error", "").replace("_", " ")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
