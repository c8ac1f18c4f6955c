"""What a measurement says in one line: a figure, what it is held against, and whether that is enough."""

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Row:
    """One line of the table of `mjsheaf bench`.

    Attributes:
        topic: which measurement it comes from.
        what: what was measured, with its unit.
        ours: the figure.
        reference: what it is compared with, in the same unit; None where there is only a bound.
        ratio: the number that is wanted to be small or large; None where it could not be formed.
        wanted: the bound on `ratio` in words, 'at most 1.25' or 'at least 4'; empty where the row only informs.
        met: whether it holds; None where `wanted` is empty or nothing was measured.
        note: where the reference comes from, or why there is none.
    """

    topic: str
    what: str
    ours: float | None
    reference: float | None
    ratio: float | None
    wanted: str
    met: bool | None
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def at_most(
    topic: str, what: str, ours: float, reference: float | None, ratio: float, bound: float, note: str = ""
) -> Row:
    """A row whose ratio should be at most a bound."""
    return Row(topic, what, ours, reference, ratio, f"at most {bound:g}", ratio <= bound, note)


def at_least(
    topic: str, what: str, ours: float, reference: float | None, ratio: float, bound: float, note: str = ""
) -> Row:
    """A row whose ratio should be at least a bound."""
    return Row(topic, what, ours, reference, ratio, f"at least {bound:g}", ratio >= bound, note)


def informs(topic: str, what: str, ours: float | None, reference: float | None = None, note: str = "") -> Row:
    """A row that nothing is asked of."""
    ratio = None if ours is None or not reference else ours / reference
    return Row(topic, what, ours, reference, ratio, "", None, note)
