"""Progress of long work in Python: a bar on a terminal or in a notebook, and nothing elsewhere.

A bar appears after half a second, so that short work shows nothing, and disappears when the work ends. While numba
compiles, the bar shows that: otherwise the first run on a machine would be silent for about a minute.
"""

import contextvars
import html
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread
from typing import Any, Protocol

from numba.core import event

from mjsheaf.arguments import require_type

Report = Callable[[str, int, int], None]
"""Called with (what is being done, done, in all)."""

DELAY = 0.5
"""Time before a bar appears, s."""
_INTERVAL = 0.2  # s between updates of a bar
_displaying = Lock()  # held while a bar is shown: there is one at most


class _Compilations(event.Listener):
    """Counts the functions that numba compiles while this module is loaded."""

    def __init__(self) -> None:
        self.under_way = 0
        self.count = 0

    def on_start(self, event: Any) -> None:
        self.under_way += 1

    def on_end(self, event: Any) -> None:
        self.under_way = max(self.under_way - 1, 0)  # one may have started before this module was loaded
        self.count += 1


_compilations = _Compilations()
event.register("numba:compile", _compilations)


def describe_compiling() -> str:
    """Return that loops are being compiled and how many functions were, or nothing."""
    if not _compilations.under_way:
        return ""
    return f"compiling loops for this machine, once, about a minute (function {_compilations.count + 1})"


class State:
    """Contents of a bar: a title, the amount done and the whole amount; 0 of 0 where that is not known yet."""

    def __init__(self, what: str) -> None:
        self.what = what
        self.done = 0
        self.total = 0

    def report(self, what: str, done: int, total: int) -> None:
        """Take note of progress."""
        self.what = what
        self.done = done
        self.total = total

    @property
    def title(self) -> str:
        """Title of the bar: the compilation if there is one."""
        return describe_compiling() or self.what


class _View(Protocol):
    def update(self, state: State) -> None: ...

    def close(self) -> None: ...


class _Terminal:
    """A bar on stderr."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        self._bars = Progress(*columns, console=Console(stderr=True), transient=True, auto_refresh=False)
        self._task = self._bars.add_task("", total=None)
        self._bars.start()

    def update(self, state: State) -> None:
        total = state.total or None
        self._bars.update(self._task, description=state.title, completed=state.done, total=total, refresh=True)

    def close(self) -> None:
        self._bars.stop()


class _Notebook:
    """A bar below a notebook's cell."""

    def __init__(self) -> None:
        from IPython.display import display  # type: ignore[import-not-found]

        self._handle = display({"text/plain": ""}, raw=True, display_id=True)

    def update(self, state: State) -> None:
        share = f'max="{state.total}" value="{state.done}"' if state.total else ""
        number = f"{state.done} of {state.total}" if state.total else ""
        bar = f"<progress {share}></progress>"
        text = f"{html.escape(state.title)} {bar} {number}"
        self._handle.update({"text/html": text, "text/plain": f"{state.title} {number}"}, raw=True)

    def close(self) -> None:
        self._handle.update({"text/plain": "", "text/html": ""}, raw=True)


def _new_view() -> Callable[[], _View] | None:
    """Return what shows a bar here: a notebook, a terminal, or nothing."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    if shell is not None and "IPKernelApp" in getattr(shell, "config", {}):
        return _Notebook
    if sys.stderr is not None and sys.stderr.isatty():
        return _Terminal
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
    require_type("progress", progress, (bool, type(None), Callable), "True, False or a function")
    make = _new_view() if progress is True else None
    if make is None or not _displaying.acquire(blocking=False):
        yield None
        return
    state = State(what)
    ended = Event()
    context = contextvars.copy_context()  # by which a notebook knows the cell
    thread = Thread(target=context.run, args=(_show, state, make, ended), daemon=True)
    thread.start()
    try:
        yield state.report
    finally:
        ended.set()
        thread.join()
        _displaying.release()


def _show(state: State, make: Callable[[], _View], ended: Event) -> None:
    """Show a bar from half a second on until the work has ended."""
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
