"""Options and errors of several commands, and the terminal: streams, tables, progress, signals.

Modules of this package import typer, and nothing else that takes long. The rest is loaded by `mjsheaf.lazy` when a
command runs, so that help appears at once.

Ctrl-C, SIGTERM and SIGHUP end a command in order: incomplete files are removed. A signal raises an exception where it
arrives. Inside a callback of a library, or a hook of fork, Python prints the exception and continues. Therefore the
signal is also stored, and code that reports progress calls `raise_if_stopped`. A second signal has no effect, because
it would interrupt the removal of files.
"""

import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from mjsheaf import lazy
from mjsheaf.errors import InputError, MjsheafError, printable
from mjsheaf.live import PORT

if TYPE_CHECKING:
    from rich.console import Console
    from rich.segment import Segment
    from rich.table import Table

_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}
_received: int | None = None


class Stopped(SystemExit):
    """Raised by a signal that ends this process; `code` is 128 plus the signal's number, as shells expect."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.message = f"{_WORDS[signal.Signals(number)]}; nothing was written"


@contextmanager
def saying_what_is_kept(describe: Callable[[], str]) -> Iterator[None]:
    """Report the files written before a signal ended the block, as text returned by `describe`."""
    try:
        yield
    except Stopped as stopped:
        stopped.message = stopped.message.replace("nothing was written", describe())
        raise


def raise_if_stopped() -> None:
    """Raise `Stopped` if a signal has arrived; its own exception may have been lost."""
    if _received is not None:
        raise Stopped(_received)


def was_stopped() -> bool:
    """Return True if a signal has arrived that ends this process."""
    return _received is not None


@contextmanager
def stoppable() -> Iterator[None]:
    """Let signals raise `Stopped` inside the block. A signal that the process ignores stays ignored.

    After the first signal all are ignored, because the process is ending and libraries clean up.
    """
    global _received
    _received = None
    if threading.current_thread() is not threading.main_thread():  # only there may handlers be set
        yield
        return
    before = {number: signal.getsignal(number) for number in _WORDS}
    hook = sys.unraisablehook

    def show_lost(lost: Any) -> None:
        if not isinstance(lost.exc_value, Stopped):
            hook(lost)

    sys.unraisablehook = show_lost
    try:
        for number, handler in before.items():
            if handler is not signal.SIG_IGN:
                signal.signal(number, _stop)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler if _received is None else signal.SIG_IGN)
        sys.unraisablehook = hook


def _stop(number: int, _frame: FrameType | None) -> None:
    global _received
    error = sys.exception()  # of this thread, on its way out in an `except`, `finally` or `with`
    while error is not None and not isinstance(error, Stopped):
        error = error.__context__
    if error is None:  # else an earlier signal is being obeyed
        _received = number
        raise Stopped(number)


def open_streams() -> None:
    """Make the standard streams usable.

    A closed one is opened on the null device: the next file that is opened would take its number, and what a library
    prints would go into that file. What an encoding lacks is written as an escape.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free, which is this one
    sys.stdin = sys.stdin or open(os.devnull)  # noqa: SIM115
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def make_console(min_width: int = 20, **options: Any) -> "Console":
    """Make a console of at least `min_width` columns, even if the terminal or COLUMNS is narrower.

    With fewer columns than the default, a table has no room for its text.
    """
    from rich.console import Console

    class Cleaned(Console):
        """Console that escapes control sequences in the text it prints."""

        def render(self, *arguments: Any, **named: Any) -> "Iterator[Segment]":
            for segment in super().render(*arguments, **named):
                yield segment if segment.control else segment._replace(text=printable(segment.text))

    console = Cleaned(highlight=False, emoji=False, **options)
    console.width = max(console.width, min_width)
    return console


def make_table(*headings: str, numbers: Sequence[str] = (), fixed: Sequence[str] = (), **options: Any) -> "Table":
    """Make a table without rows.

    Args:
        headings: Headings of the columns.
        numbers: Headings of columns of numbers, which are right-aligned.
        fixed: Headings of columns that are never wrapped.
        options: Options of rich's Table.
    """
    from rich.table import Column, Table

    columns = [Column(h, justify="right" if h in numbers else "left", no_wrap=h in fixed) for h in headings]
    return Table(*columns, title_justify="left", header_style="", **options)


def print_lines(*lines: object) -> None:
    """Print lines as they are, however wide the terminal."""
    for line in lines:
        make_console(soft_wrap=True).print(line, markup=False)


def print_note(text: str) -> None:
    """Print a note on stderr."""
    make_console(stderr=True, soft_wrap=True).print(f"note: {text}", markup=False)


@contextmanager
def progress_bars(
    what: str = "loading", *, lines: Literal["stdout", "stderr"] | None = "stdout", above: Sequence[str] = ()
) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function of (activity, done, total) that shows progress.

    It draws a bar on stderr if that is a terminal, and writes lines otherwise. Progress appears within a second, also
    while loops are being compiled. A call raises `Stopped` if a signal has arrived.

    Args:
        what: Activity until the first call.
        lines: Stream for lines; None writes none.
        above: Lines that a terminal shows above the bar, as long as it is there.
    """
    view: lazy.progress.View | None = partial(lazy.progress.in_lines, getattr(sys, lines)) if lines else None
    if sys.stderr.isatty():
        view = partial(lazy.progress.on_terminal, above)
    with lazy.progress.displaying(view, what) as show:

        def report(what: str, done: int, total: int) -> None:
            raise_if_stopped()
            if show is not None:
                show(what, done, total)

        yield report


Backend = StrEnum("Backend", ["PHYSICS", "IDEAL"])
"""Model of the vehicles' motion; values are the names in lower case."""

Engine = StrEnum("Engine", ["MUJOCO", "FUSED"])
"""Engine that simulates bodies."""

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A name from `mjsheaf list`, or the path of a YAML file.")
]
BackendOption = Annotated[Backend, typer.Option(help="MuJoCo bodies, or the paper's first-order kinematics.")]
EngineOption = Annotated[
    Engine,
    typer.Option(
        help="Engine for bodies: MuJoCo, or the same equations compiled, which is faster but has no contacts."
    ),
]
ThreadsOption = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Maximum number of threads of the fused engine; MuJoCo uses one. Results do not depend on it.",
        show_default="all cores",
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Override a field of the scenario; may be repeated. Select items of lists by id, name or index: "
        "controller.gain=30, agents.A1.heading=90, sensing.0.weight=2.",
    ),
]
SeedOption = Annotated[int | None, typer.Option(help="Seed of disturbances and of random initial conditions.")]
OutOption = Annotated[Path | None, typer.Option(metavar="DIR", help="Directory for the results.")]
VideoOption = Annotated[bool, typer.Option("--video/--no-video", help="Draw a video.")]
QualityOption = Annotated[
    Literal["good", "draft"] | None,
    typer.Option(
        help="Quality of the video. A draft takes a fraction of the time: the scene is coarse, with hard edges, at "
        "most 15 frames per second. Text stays sharp.",
        show_default="as the scenario says: good",
    ),
]


ControllerOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE.py:NAME",
        help="Your own law in Python: a function or class, called once per control period. law(t, sample) "
        "returns the agents' velocities, shape (N, 3), in m/s.",
    ),
]
FormatOption = Annotated[
    str, typer.Option("--format", metavar="F1[,F2,...]", help="Formats of the plots: png, svg, pdf, or several.")
]
McapOption = Annotated[
    bool, typer.Option("--mcap", help="Write run.mcap, a log for Foxglove or PlotJuggler. Needs the extra mcap.")
]
Ros2Option = Annotated[
    bool, typer.Option("--ros2", help="Write run_ros2/, a bag for ROS 2 tools such as RViz. Needs the extra mcap.")
]
LiveOption = Annotated[
    bool,
    typer.Option(
        "--live",
        help=f"Show the run in Foxglove while it is simulated, at ws://127.0.0.1:{PORT}. Needs the extras mcap, live.",
    ),
]
FOXGLOVE = f"live in Foxglove: open a connection to ws://127.0.0.1:{PORT}"
TitleOption = Annotated[bool, typer.Option("--title/--no-title", help="Give the plots a title.")]


def formats_of(**chosen: bool) -> list[str]:
    """Return the keys of `mjsheaf.export.FORMATS` that options like --mcap select."""
    return [name for name, wanted in chosen.items() if wanted]


class NotHeldError(MjsheafError):
    """An assumption, an expectation or a bound does not hold."""

    exit_code = 1


def prepare(
    source: str, overrides: Iterable[str] | None, seed: int | None, out: Path | None, backend: str, kind: str
) -> "tuple[lazy.scenario.Scenario, Path, str]":
    """Return the scenario of `run` or `compare`, the directory for its results, and its origin.

    Raises:
        ScenarioError: The scenario or an override is not valid.
        PlaceError: The default directory contains results of another scenario with the same name.
    """
    changes = changes_of(overrides, seed)
    scenario = lazy.scenario.load_scenario(source, changes)
    if "seed" in changes and not scenario.uses_seed(backend):
        note_idle_seed(scenario.name, backend)
    directory = Path("runs") / f"{scenario.name}-{kind}" if out is None else out
    where = lazy.load.origin(source, directory)
    if out is None:
        lazy.store.require_same_origin(directory, where)
    return scenario, directory, where


def require_file_name(option: str, path: Path, *suffixes: str) -> None:
    """Refuse the name of a file that cannot be written.

    Raises:
        InputError: The name has another suffix or is a directory, or its directory does not exist.
    """
    expected = f"{option} {path}: expected a file whose name ends in {' or '.join(suffixes)}"
    if path.suffix not in suffixes or path.is_dir():
        raise InputError(expected)
    if not path.parent.is_dir():
        raise InputError(f"{option} {path}: there is no directory {path.parent}")


def note_idle_seed(scenario: str, backend: str) -> None:
    """Print a note that the seed has no effect."""
    print_note(f"the seed changes nothing: {scenario} has no spread and no disturbance on backend {backend}")


def changes_of(overrides: Iterable[str] | None, seed: int | None = None) -> dict[str, Any]:
    """Return the changes made by --set and --seed: field path to value.

    Raises:
        ScenarioError: An override is not PATH=VALUE.
    """
    changes = dict(lazy.load.parse_override(text) for text in overrides or ())
    return changes if seed is None else {**changes, "seed": seed}
