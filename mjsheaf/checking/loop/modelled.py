"""Parts of a law that `check` has no model of.

The response of the law's stages to their measurements is computed from them (see `linear_law`), so a new
term needs nothing here. Everything else is named here, field by field: what edges measure, what links do to it,
who has which gain. A law with a field that is not named, or with terms that are not linear, is undecided.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from mjsheaf.checking.loop.linear_law import model_of
from mjsheaf.control.custom import names_of
from mjsheaf.control.law import LawArrays
from mjsheaf.control.links import LinkArrays
from mjsheaf.control.rounds import RoundArrays
from mjsheaf.control.terms import TermArrays
from mjsheaf.errors import UndecidedError, listed, select_true
from mjsheaf.system import System

_LAW = frozenset(("edges", "gain", "limit", "supplied", "terms", "links", "custom", "safety"))
_EDGES = frozenset(("tail", "head", "listens", "first", "F_tail", "F_head", "P_tail", "P_head", "b", "kinds"))
_TERMS = frozenset((
    "agents", "dimension", "period", "sensing", "eigenvalues", "steepest", "fresh", "feedforward", "newton", "measured",
    "drift", "lead", "settled", "integral", "largest", "noise", "bias", "seed", "streams", "rounds",
))  # fmt: skip
_ROUNDS = frozenset(("imperfect", "delay", "loss", "streams", "range", "lift", "own", "inverse", "stiffest"))
_LINKS = frozenset(("table", "of", "lift", "facing", "size", "odometry", "start", "period", "seed", "record"))
_LINK = frozenset((
    "edge", "place", "width", "moves", "delay", "hold", "random", "lossy", "bursts", "bearing",
    "noise", "bias", "range_noise", "bearing_noise", "range", "to_bad", "to_good", "bad", "loss_good",
    "loss_bad", "stream",
))  # fmt: skip
_SENSORS = (0, 1)  # values of `bearing`: the exact sensor, and range and bearing


def unmodelled_parts(system: System) -> list[str]:
    """Return the parts of a system's law that `check` has no model of, such as "law in Python"; empty if it has all.

    A field that is not known counts unless it is switched off: zero, or as in the paper's law over exact links.
    """
    law = system.law
    structures: list[tuple[str, Any, frozenset[str], Any]] = [
        ("field of the rounds", law.terms.rounds, _ROUNDS, RoundArrays()),
        ("field of the links", law.links, _LINKS, LinkArrays()),
        ("field of the edges", law.edges, _EDGES, None),
        ("field of the law", law, _LAW, None),
    ]
    parts = [f"{what} {name}" for what, values, known, off in structures for name in _unknown(values, known, off)]
    table = law.links.table
    columns = [name for name in table.dtype.names or () if name not in _LINK and _is_on(table[name], None)]
    parts += [f"field of a link {name}" for name in columns]
    others = {
        "sensor of a link": not np.isin(table["bearing"], _SENSORS).all(),
        "range and bearing edges, unless linearised": law.edges.kinds,
        "law in Python": law.supplied,
        "gains that differ between agents": (law.gain[: len(system.team.agents)] != system.gain).any(),
    }
    return parts + select_true(others) + _terms_without_model(system)


def _terms_without_model(system: System) -> list[str]:
    """Return the terms of a law that is not linear, or that is continuous with a term that `check` does not know."""
    law = system.law
    new = terms_without_bound(law)
    if system.grid.continuous or not law.extended:
        return new
    try:
        model_of(law, system.grid.period)
    except UndecidedError:
        return new or [f"term {name}" for name in law.term_names]
    return []


def terms_without_bound(law: LawArrays) -> list[str]:
    """Return the terms of a law of which no bound along the targets' path is derived."""
    return [f"term {name}" for name in (*_unknown(law.terms, _TERMS, TermArrays()), *names_of(law.custom))]


def because_of(parts: list[str]) -> str:
    """Return why a law is undecided, from `unmodelled_parts`."""
    return f"because of {listed(parts)}, which check has no model of"


def require_model(system: System) -> None:
    """Raise an UndecidedError that names the parts of a system's law that `check` has no model of, if there are any."""
    if parts := unmodelled_parts(system):
        raise UndecidedError(because_of(parts))


def _unknown(values: Any, known: frozenset[str], off: Any) -> Iterator[str]:
    """Yield the fields of a named tuple that are switched on and not known."""
    for name in values._fields:
        if name not in known and _is_on(getattr(values, name), getattr(off, name, None)):
            yield name


def _is_on(value: Any, off: Any) -> bool:
    """Return True unless a value is zero, empty or equal to `off`."""
    if isinstance(value, tuple):  # a structure of its own
        return value != off
    return bool(np.any(value)) and not np.array_equal(value, off)
