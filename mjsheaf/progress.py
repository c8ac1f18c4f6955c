"""Progress of long work: a bar on a terminal or in a notebook, and lines where output goes to a file.

It appears after half a second, so that short work shows nothing, and a bar disappears when the work ends. While numba
compiles, it shows that: otherwise the first run on a machine would print nothing.
"""

import contextvars
import html
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from threading import Event, Lock, Thread
from typing import Any, TextIO

Report = Callable[[str, int, int], None]
"""Called with (what is being done, done, in all)."""


def no_progress(what: str, done: int, total: int) -> None:
    """Ignore progress."""


DELAY = 0.5
"""Time before progress appears, s."""
BETWEEN_LINES = 2.0
"""Time between lines of progress, s."""
_INTERVAL = 0.2  # s between updates of a bar
_displaying = Lock()  # held while progress is shown: one at most


Update = Callable[[str, int, int, float], None]
"""Called with (what is being done, done, in all, seconds since the start)."""

View = Callable[[], AbstractContextManager[Update]]
"""Yields what shows progress, and removes what is shown at the end."""


def under_way(reported: tuple[str, int, int]) -> tuple[str, int, int]:
    """Return what is being done, the amount done and the whole amount: those of compilation while there is one."""
    # It is not loaded for this, which takes long; while it is being loaded it lacks the functions, and bool() is False.
    jit = sys.modules.get("mjsheaf.compile.jit")
    for asked, what in (
        ("is_waiting", "waiting for another process that compiles the same loops"),
        ("is_compiling", "compiling the loops for this machine, once"),
    ):
        if getattr(jit, asked, bool)():
            return what, 0, 0
    return reported


@contextmanager
def on_terminal(above: Sequence[str] = ()) -> Iterator[Update]:
    """Show a bar on stderr, below lines that disappear with it."""
    from rich.console import Console, Group
    from rich.live import Live
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.text import Text

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    bars = Progress(*columns, console=console)
    task = bars.add_task("", total=None)
    lines = map(Text, above[: max(0, console.height - 4)])  # with room for the bar, and for what is typed
    with Live(Group(*lines, bars), console=console, transient=True, auto_refresh=False) as live:

        def update(what: str, done: int, total: int, seconds: float) -> None:
            bars.update(task, description=what, completed=done, total=total if total > 1 else None)
            live.refresh()

        yield update


@contextmanager
def in_notebook() -> Iterator[Update]:
    """Show a bar below a notebook's cell."""
    from IPython.display import display  # type: ignore[import-not-found]

    handle = display({"text/plain": ""}, raw=True, display_id=True)

    def update(what: str, done: int, total: int, seconds: float) -> None:
        share = f'max="{total}" value="{done}"' if total > 1 else ""
        after = (f"{done} of {total}, " if total > 1 else "") + f"{seconds:.0f} s"
        bar = f"{html.escape(what)} <progress {share}></progress> {after}"
        handle.update({"text/html": bar, "text/plain": f"{what} {after}"}, raw=True)

    try:
        yield update
    finally:
        handle.update({"text/plain": "", "text/html": ""}, raw=True)


@contextmanager
def in_lines(stream: TextIO) -> Iterator[Update]:
    """Print lines on a stream: one at once, then one every two seconds."""
    due = 0.0

    def update(what: str, done: int, total: int, seconds: float) -> None:
        nonlocal due
        if seconds < due:
            return
        due = seconds + BETWEEN_LINES
        share = f" {done} of {total} ({100 * done // total} %)" if total > 1 else ""
        with suppress(OSError, ValueError):  # the reader went away, or the stream is closed
            print(f"{what}{share}, {seconds:.0f} s since the start", file=stream, flush=True)

    yield update


def _find_view() -> View | None:
    """Return what shows a bar here: a notebook, a terminal, or nothing."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    if shell is not None and "IPKernelApp" in getattr(shell, "config", {}):
        return in_notebook
    if sys.stderr is not None and sys.stderr.isatty():
        return on_terminal
    return None


@contextmanager
def shown(progress: "Callable[..., None] | bool | None", what: str) -> Iterator[Report | None]:
    """Yield what to call with progress: a bar on a terminal or in a notebook, or None where nothing is shown.

    Args:
        progress: True shows a bar where there is a terminal or a notebook; False and None show nothing. A function is
            for the caller to use: None is yielded.
        what: What is being done, until the first report.

    Raises:
        InputError: `progress` is something else.
    """
    from mjsheaf.arguments import require_type

    require_type("progress", progress, (bool, type(None), Callable), "True, False or a function")
    with displaying(_find_view() if progress is True else None, what) as report:
        yield report


@contextmanager
def displaying(view: View | None, what: str) -> Iterator[Report | None]:
    """Show progress in a view, and yield what to call with it; None if nothing can be shown."""
    if view is None or not _displaying.acquire(blocking=False):
        yield None
        return
    begun = time.monotonic()
    reported = what, 0, 0
    ended = Event()

    def report(*progress: Any) -> None:
        nonlocal reported
        reported = progress

    def show() -> None:
        """Show progress from half a second on until the work has ended."""
        if ended.wait(DELAY):
            return
        with view() as update:
            update(*under_way(reported), time.monotonic() - begun)
            while not ended.wait(_INTERVAL):
                update(*under_way(reported), time.monotonic() - begun)

    # The notebook cell is part of the context.
    thread = Thread(target=contextvars.copy_context().run, args=(show,), daemon=True)
    thread.start()
    try:
        yield report
    finally:
        ended.set()
        thread.join()
        _displaying.release()
