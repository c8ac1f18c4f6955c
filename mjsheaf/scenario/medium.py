"""Sections of a scenario file about the medium: the flow, and the disturbances of vehicles in addition to it."""

from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from mjsheaf.arrays import Array
from mjsheaf.errors import in_field
from mjsheaf.io.section import Section
from mjsheaf.media import Disturbance, FlowField
from mjsheaf.media import varying as disturbance
from mjsheaf.media.gridded import GriddedFlow
from mjsheaf.team import Team


def _kind_of(flow: Any) -> str:
    """Return the name of the class of a flow, as a file has it."""
    if isinstance(flow, FlowField):
        return type(flow).__name__
    return "GriddedFlow" if isinstance(flow, dict) and "kind" in flow else "FlowField"


AnyFlow = Annotated[
    Annotated[FlowField, Tag("FlowField")] | Annotated[GriddedFlow, Tag("GriddedFlow")], Discriminator(_kind_of)
]
"""A flow by kernels, or out of a file."""


class Flow(Section):
    """Flow of the medium, given either by medium (air, water) or, as in the paper, by role (agents, targets)."""

    agents: AnyFlow | None = Field(
        None, description="flow that all agents meet, planar and spatial ones; not together with air or water"
    )
    targets: AnyFlow | None = Field(
        None, description="flow that all targets meet, planar and spatial ones; not together with air or water"
    )
    air: AnyFlow | None = Field(
        None, description="flow that spatial vehicles meet, agents and targets; not together with agents or targets"
    )
    water: AnyFlow | None = Field(
        None, description="flow that planar vehicles meet, agents and targets; not together with agents or targets"
    )

    @model_validator(mode="after")
    def _one_way(self) -> "Flow":
        if (self.agents or self.targets) and (self.air or self.water):
            raise ValueError("give either agents and targets, or air and water")
        for name in ("agents", "targets", "air"):
            if getattr(self, name) is not None and getattr(self, name).waves is not None:
                raise ValueError(f"{name}.waves: only water has waves; expected them in flow.water")
        return self

    def parts(self, team: Team) -> dict[str, Any]:
        """Return the fields of a System that describe its flow: by medium if one is given, else by role."""
        if self.air is not None or self.water is not None:
            names = ("wind", "current")
            fields = (self.air, self.water)
            met = [0 if member.dimension == 3 else 1 for member in team.members]
        else:
            names = ("flow about agents", "flow about targets")
            fields = (self.agents, self.targets)
            met = [0] * len(team.agents) + [1] * len(team.targets)
        flows = [field or FlowField(dimension=2) for field in fields]
        return {"flows": flows, "flow_names": names, "field": np.array(met, dtype=np.int64)}


class Disturbances(Section):
    """Disturbances of agents and targets."""

    agents: Disturbance | None = Field(None, description="of every agent, drawn independently")
    targets: Disturbance | None = Field(None, description="of every target, drawn independently")

    def require_resolved(self, last: float) -> None:
        """Refuse frequencies that the loops do not resolve up to |t| = `last`, s."""
        for role, kind in (("agents", self.agents), ("targets", self.targets)):
            if kind is not None:
                with in_field(f"disturbance.{role}"):
                    kind.require_resolved(last)

    def draw(self, team: Team, seed: int) -> Array:
        """Draw the harmonics of each vehicle, shape (V, K, 5)."""
        kinds = [self.agents] * len(team.agents) + [self.targets] * len(team.targets)
        return disturbance.draw(kinds, [m.dimension for m in team.members], [m.id for m in team.members], seed)
