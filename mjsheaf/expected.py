"""What errors say about a name that is not known: the names that are expected, and the closest of them."""

from collections.abc import Collection
from difflib import get_close_matches

_MOST = 20


def listed(names: Collection[str]) -> str:
    """The first names, separated by commas, and how many there are."""
    shown = ", ".join(list(names)[:_MOST])
    return shown + (f", ... ({len(names)} in all)" if len(names) > _MOST else "")


def suggestion(name: str, names: Collection[str]) -> str:
    """'; did you mean X?' where one of the names is close to what was written, else nothing."""
    close = get_close_matches(name, names, 1, 0.6) or [n for n in names if n.lower() == name.lower()][:1]
    return f"; did you mean {close[0]}?" if close else ""


def expected(name: str, names: Collection[str]) -> str:
    """'expected one of A, B, C', and the closest to what was written."""
    return f"expected {'one of ' * (len(names) > 1)}{listed(names)}{suggestion(name, names)}"
