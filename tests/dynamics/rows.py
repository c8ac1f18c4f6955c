"""Flow fields from rows of numbers, as data files and random draws give them."""

from typing import Any

from mjsheaf.dynamics.flow import Channel, FlowField, Source, Vortex


def field_of(
    n: Any, core: float | None = None, drift: Any = None, sources: Any = (), vortices: Any = (), channels: Any = ()
) -> FlowField:
    """A field in n dimensions from rows: (centre, alpha); (centre, axis in space, gamma); (centre, direction, ...)."""
    return FlowField(
        dimension=n,
        core=core,
        drift=drift,
        sources=[Source(centre=row[:n], alpha=row[n]) for row in sources],
        vortices=[Vortex(centre=row[:n], axis=list(row[n:-1]) or None, gamma=row[-1]) for row in vortices],
        channels=[
            Channel(centre=row[:n], direction=row[n:-3], beta=row[-3], width=row[-2], length=row[-1])
            for row in channels
        ],
    )


def of_facts(facts: dict[str, Any]) -> FlowField:
    """A field of the published run."""
    channels = [[*centre, *direction, *rest] for centre, direction, *rest in facts["gaussian_channels"]]
    return field_of(facts["dimension"], facts["core"], facts["drift"], facts["sources"], facts["vortices"], channels)
