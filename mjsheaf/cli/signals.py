"""Ctrl-C, SIGTERM and SIGHUP end a command in order: what is half done is taken away.

Each is raised where it arrives, as an exception. Inside a callback of a library, or a hook of fork, Python prints what
is raised and goes on. So the signal is also remembered, and whoever reports progress calls `raise_if_stopped`. One that
arrives while an earlier one is being obeyed changes nothing: what is taken away then would be taken away by half.
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}
_received: int | None = None


class Stopped(SystemExit):
    """A signal has asked this process to stop; `code` is what shells expect, 128 and the signal's number."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.message = f"{_WORDS[signal.Signals(number)]}; nothing was written"


def raise_if_stopped() -> None:
    """Raise what a signal raised before, where that was lost.

    Raises:
        Stopped: a signal came.
    """
    if _received is not None:
        raise Stopped(_received)


def was_stopped() -> bool:
    """Whether a signal has asked this process to stop."""
    return _received is not None


@contextmanager
def stoppable() -> Iterator[None]:
    """Let the signals raise `Stopped` inside the block. A signal that the process was told to ignore stays ignored.

    After one that was obeyed they are ignored: the process is about to end, and libraries tidy up as it does.
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
    if _obeying():
        return
    _received = number
    raise Stopped(number)


def _obeying() -> bool:
    """Whether this thread is on its way out because of a signal: in an `except`, `finally` or `with` on that way."""
    error = sys.exception()
    while error is not None and not isinstance(error, Stopped):
        error = error.__context__
    return error is not None
