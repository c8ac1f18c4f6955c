"""Errors, one class for each exit code of the command line.

An error about an unknown name lists the expected names and suggests the closest.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches

_LINE_BREAKS = re.compile(r"[^\S ]+")


class MjsheafError(Exception):
    """Base of every error that mjsheaf raises on purpose.

    Lines may quote what users wrote: characters that a terminal would obey are escaped, and lines are cut after 4000.

    Attributes:
        args: the lines of the message, mostly one; a scenario with several mistakes has a line for each.
        exit_code: what the command line exits with; 1 unless a class says otherwise.
    """

    exit_code = 1

    def __init__(self, *lines: object) -> None:
        super().__init__(*(shortened(printable(_LINE_BREAKS.sub(" ", str(line))), 4000) for line in lines))

    def __str__(self) -> str:
        return "\n".join(self.args)

    def within(self, place: object, kind: "type[MjsheafError] | None" = None) -> "MjsheafError":
        """Return the same error with a place before each line, as of the same class unless another is given."""
        return (kind or type(self))(*(f"{place}: {line}" for line in self.args))


class InputError(MjsheafError, ValueError):
    """The input is wrong; the message names the place and what is expected."""

    exit_code = 2


class SheafError(InputError):
    """A sheaf was given a vertex, map, offset or weight that does not fit it."""


class ScenarioError(InputError):
    """A scenario file, or an override of it, is not valid."""


class RankError(InputError):
    """A control effectiveness is not of full row rank: no input makes every velocity (Assumption 2 fails)."""


class NotUniqueError(MjsheafError):
    """The harmonic extension is not unique: some agents are free to drift (Assumption 6 fails)."""


class UnstableError(MjsheafError):
    """A simulation blew up; the message names the vehicle, the time, the speed and the likely cause."""

    exit_code = 3


class PlaceError(InputError):
    """The place where results should go cannot be used."""


@contextmanager
def in_field(field: object, kind: "type[MjsheafError] | None" = None) -> Iterator[None]:
    """Put the name of a field before the message of an error, unless that is about the place of results.

    The error stays of the same class unless another is given.
    """
    try:
        yield
    except PlaceError:
        raise
    except MjsheafError as error:
        raise error.within(field, kind) from None


_MOST = 20


def printable(text: str) -> str:
    """Escape the characters of a text that are neither printed nor line breaks, such as those that a terminal obeys."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)


def shortened(text: str, most: int = 60) -> str:
    """Return a text of at most `most` characters: a longer one ends in '...'."""
    return text if len(text) <= most else text[: most - 3] + "..."


def visible(part: object, most: int = 60) -> str:
    """Return a text, key or name as one line of at most `most` characters, free of control sequences."""
    return shortened(printable(" ".join(str(part).split())), most) or "''"


def listed(names: Collection[str]) -> str:
    """The first names, separated by commas, and how many there are."""
    shown = ", ".join(list(names)[:_MOST])
    return shown + (f", ... ({len(names)} in all)" if len(names) > _MOST else "")


def joined(names: Sequence[str], last: str = " and ") -> str:
    """Join names in a sentence: a, b and c."""
    return last.join(filter(None, [", ".join(names[:-1]), names[-1]]))


def and_others(name: str, others: int) -> str:
    """Return a name with the number of others, if there are any: A and 2 others."""
    return name + (f" and {others} other{'s' if others > 1 else ''}" if others else "")


def and_more(count: int, noun: str) -> str:
    """Return how many more there are: and 1 more pair, and 2 more pairs."""
    return f"and {count} more {noun}{'s' if count > 1 else ''}"


def with_verb(name: str, others: int, one: str = "is", several: str = "are") -> str:
    """Return a name with the number of others and the verb, as a sentence about them begins."""
    return f"{and_others(name, others)} {several if others else one}"


def select_true(reasons: Mapping[str, object]) -> list[str]:
    """Return the texts whose conditions are true."""
    return [text for text, true in reasons.items() if true]


def suggestion(name: str, names: Collection[str]) -> str:
    """'; did you mean X?' where one of the names is close to what was written, else nothing."""
    close = get_close_matches(name, names, 1, 0.6) or [n for n in names if n.lower() == name.lower()][:1]
    return f"; did you mean {close[0]}?" if close else ""


def expected(name: str, names: Collection[str]) -> str:
    """'expected one of A, B, C', and the closest to what was written."""
    return f"expected {'one of ' * (len(names) > 1)}{listed(names)}{suggestion(name, names)}"


class UndecidedError(Exception):
    """Nothing can be claimed; the message says why."""


class OverpoweredError(UndecidedError):
    """A vehicle cannot hold its place in the medium; the message names it, with the speeds."""


class NoModelError(UndecidedError):
    """A vehicle has no linear model; the message names it, and says why."""
