"""Progress of long work: a bar on a terminal or in a notebook, and lines where output goes to a file.

It appears after half a second, so that short work shows nothing, and a bar disappears when the work ends. While numba
compiles, it shows that, function by function: otherwise the first run on a machine would print nothing.
"""

import contextvars
import html
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from threading import Event, Lock, Thread
from typing import Protocol, TextIO

Report = Callable[[str, int, int], None]
"""Called with (what is being done, done, in all)."""

DELAY = 0.5
"""Time before progress appears, s."""
BETWEEN_LINES = 2.0
"""Time between lines of progress, s."""
_INTERVAL = 0.2  # s between updates of a bar
_ROOM = 4  # lines of a terminal that a bar leaves free
_displaying = Lock()  # held while progress is shown: one at most


class State:
    """Progress of some work: what is being done, the amount done and the whole amount; at most 1 where unknown."""

    def __init__(self, what: str) -> None:
        self._begun = time.monotonic()
        self._what = what
        self._done = 0
        self._total = 0

    def report(self, what: str, done: int, total: int) -> None:
        """Take note of progress."""
        self._what = what
        self._done = done
        self._total = total

    @property
    def seconds(self) -> float:
        """Time since the start, s."""
        return time.monotonic() - self._begun

    def now(self) -> tuple[str, int, int]:
        """Return what is being done, the amount done and the whole amount: those of compilation while there is one."""
        # It is not loaded for this, which takes long; while it is being loaded it lacks the functions.
        jit = sys.modules.get("mjsheaf.compile.jit")
        waiting = getattr(jit, "is_waiting", None)
        if waiting and waiting():
            return "waiting for another process that compiles the same loops", 0, 0
        compiling = getattr(jit, "compiling", None)
        compiled = compiling() if compiling else None
        if compiled:
            what = "compiling the loops for this machine, once"
            return f"{what}: function" if compiled[1] > 1 else what, *compiled
        return self._what, self._done, self._total


class View(Protocol):
    """Shows progress."""

    def update(self, state: State) -> None:
        """Show the present state."""

    def close(self) -> None:
        """Remove what is shown."""


class Terminal:
    """A bar on stderr, below lines that disappear with it."""

    def __init__(self, above: Sequence[str] = ()) -> None:
        from rich.console import Console, RenderableType
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
        from rich.text import Text

        console = Console(stderr=True)

        class Below(Progress):
            def get_renderables(self) -> Iterator[RenderableType]:
                yield from map(Text, above[: max(0, console.height - _ROOM)])
                yield from super().get_renderables()

        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        self._bars = Below(*columns, console=console, transient=True, auto_refresh=False)
        self._task = self._bars.add_task("", total=None)
        self._bars.start()

    def update(self, state: State) -> None:
        """Draw the bar."""
        what, done, total = state.now()
        known = total if total > 1 else None
        self._bars.update(self._task, description=what, completed=done, total=known, refresh=True)

    def close(self) -> None:
        """Remove the bar."""
        self._bars.stop()


class Notebook:
    """A bar below a notebook's cell."""

    def __init__(self) -> None:
        from IPython.display import display  # type: ignore[import-not-found]

        self._handle = display({"text/plain": ""}, raw=True, display_id=True)

    def update(self, state: State) -> None:
        """Draw the bar."""
        what, done, total = state.now()
        share = f'max="{total}" value="{done}"' if total > 1 else ""
        number = f"{done} of {total}, " if total > 1 else ""
        after = f"{number}{state.seconds:.0f} s"
        bar = f"<progress {share}></progress>"
        data = {"text/html": f"{html.escape(what)} {bar} {after}", "text/plain": f"{what} {after}"}
        self._handle.update(data, raw=True)

    def close(self) -> None:
        """Remove the bar."""
        self._handle.update({"text/plain": "", "text/html": ""}, raw=True)


class Lines:
    """Lines on a stream: one at once, then one every two seconds."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._due = 0.0

    def update(self, state: State) -> None:
        """Print a line if one is due."""
        if state.seconds < self._due:
            return
        self._due = state.seconds + BETWEEN_LINES
        what, done, total = state.now()
        share = f" {done} of {total} ({100 * done // total} %)" if total > 1 else ""
        with suppress(OSError, ValueError):  # the reader went away, or the stream is closed
            print(f"{what}{share}, {state.seconds:.0f} s since the start", file=self._stream, flush=True)

    def close(self) -> None:
        """Leave the lines."""


def _find_view() -> Callable[[], View] | None:
    """Return what shows a bar here: a notebook, a terminal, or nothing."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    if shell is not None and "IPKernelApp" in getattr(shell, "config", {}):
        return Notebook
    if sys.stderr is not None and sys.stderr.isatty():
        return Terminal
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
def displaying(make: Callable[[], View] | None, what: str) -> Iterator[Report | None]:
    """Show progress in a view, which `make` makes, and yield what to call with it; None if nothing can be shown."""
    if make is None or not _displaying.acquire(blocking=False):
        yield None
        return
    state = State(what)
    ended = Event()
    context = contextvars.copy_context()  # the notebook cell is part of it
    thread = Thread(target=context.run, args=(_show, state, make, ended), daemon=True)
    thread.start()
    try:
        yield state.report
    finally:
        ended.set()
        thread.join()
        _displaying.release()


def _show(state: State, make: Callable[[], View], ended: Event) -> None:
    """Show progress from half a second on until the work has ended."""
    if ended.wait(DELAY):
        return
    view = make()
    try:
        while True:
            view.update(state)
            if ended.wait(_INTERVAL):
                return
    finally:
        view.close()
