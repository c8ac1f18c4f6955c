"""The error budget: how much of a team's error each effect adds.

With E the error of a rung, base and all as in `ladder`:

    all = ideal + (targets - ideal) + (agents - ideal) + together + sum over effects of (+EFFECT - base) + interaction

where `together` is what both as bodies have beyond the sum of the parts, and `interaction` what all effects have beyond
the sum of each alone. What removing an effect would give back is all - (-EFFECT); with interaction it is not what the
effect adds alone, and it is what tells a person what to change.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

from mjsheaf.comparing.ladder import Rung


@dataclass(frozen=True)
class Item:
    """One effect's part in an error, in m; None where a rung that it needs blew up.

    Attributes:
        effect: its name.
        alone: what it adds to bodies with ideal thrusters.
        give_back: what the whole would lose without it.
    """

    effect: str
    alone: float | None
    give_back: float | None


@dataclass(frozen=True)
class Budget:
    """Where one error comes from, in m; None where a rung that it needs blew up.

    Attributes:
        ideal: of ideal kinematics.
        targets, agents: what they add as bodies with ideal thrusters, each apart.
        together: what both have beyond that.
        items: the effects.
        interaction: what all effects have beyond the sum of each alone.
        whole: of the scenario as it stands: the sum of all of these (but for give_back).
    """

    ideal: float | None
    targets: float | None
    agents: float | None
    together: float | None
    items: list[Item]
    interaction: float | None
    whole: float | None


def budget_of(ladder: list[Rung], error: Callable[[str], float]) -> Budget:
    """The budget of one error.

    Args:
        ladder: the rungs.
        error: of the rung with a key, m; not finite where it has none.
    """

    def value(key: str) -> float | None:
        found = error(key)
        return float(found) if isfinite(found) else None

    ideal, base, whole = value("ideal"), value("base"), value("all")
    targets, agents = _less(value("targets"), ideal), _less(value("agents"), ideal)
    effects = [rung.effect for rung in ladder if rung.kind == "alone" and rung.effect is not None]
    items = [Item(e, _less(value(f"+{e}"), base), _less(whole, value(f"-{e}"))) for e in effects]
    return Budget(
        ideal=ideal,
        targets=targets,
        agents=agents,
        together=_less(_less(base, ideal), _sum([targets, agents])),
        items=items,
        interaction=_less(_less(whole, base), _sum([item.alone for item in items])),
        whole=whole,
    )


def _less(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else one - other


def _sum(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) if len(known) == len(values) else None
