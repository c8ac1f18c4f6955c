"""Parts of a law that `check` has no model of.

The response of the law's stages to their measurements is computed from them (see `linear_law`), so a new term needs
nothing here. The rest of the analysis knows what edges measure, what links do to it, and who has which gain. A test
names the fields of these structures, one by one: whoever adds a field decides whether `check` models it, and adds to
`unmodelled_parts` where it does not.
"""

import numpy as np

from mjsheaf.checking.loop.linear_law import model_of
from mjsheaf.errors import UndecidedError, listed, select_true
from mjsheaf.law.custom import names_of
from mjsheaf.law.law import LawArrays
from mjsheaf.system import System

_SENSORS = (0, 1)  # values of `bearing`: the exact sensor, and range and bearing


def unmodelled_parts(system: System) -> list[str]:
    """Return the parts of a system's law that `check` has no model of, such as "law in Python"; empty if it has all."""
    law = system.law
    others = {
        "sensor of a link": not np.isin(law.links.table["bearing"], _SENSORS).all(),
        "range and bearing edges, unless linearised": law.edges.kinds,
        "law in Python": law.supplied,
        "gains that differ between agents": (law.gain[: len(system.team.agents)] != system.gain).any(),
    }
    return select_true(others) + _terms_without_model(system)


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
    return [f"term {name}" for name in names_of(law.custom)]


def because_of(parts: list[str]) -> str:
    """Return why a law is undecided, from `unmodelled_parts`."""
    return f"because of {listed(parts)}, which check has no model of"


def require_model(system: System) -> None:
    """Raise an UndecidedError that names the parts of a system's law that `check` has no model of, if there are any."""
    if parts := unmodelled_parts(system):
        raise UndecidedError(because_of(parts))
