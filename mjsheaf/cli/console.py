"""The console that commands print tables to."""

from typing import Any

from rich.console import Console

_NARROWEST = 20  # columns; in fewer, a table has no room for its text


def make_console(**options: Any) -> Console:
    """A console that has some width, whatever the terminal or COLUMNS says."""
    console = Console(**options)
    if console.width < _NARROWEST:
        console.width = _NARROWEST
    return console
