"""Agents, targets, who senses and talks to whom, what they compare, and the formation they should hold.

This layer turns a team into a sheaf. It knows nothing of dynamics.
"""

from mjsheaf.team.edges import (
    GROUND,
    Anchor,
    Edge,
    Formation,
    LinearEdge,
    Member,
    anchor,
    restriction_maps,
    rotation_to_local,
)
from mjsheaf.team.team import Team

__all__ = [
    "GROUND",
    "Anchor",
    "Edge",
    "Formation",
    "LinearEdge",
    "Member",
    "Team",
    "anchor",
    "restriction_maps",
    "rotation_to_local",
]
