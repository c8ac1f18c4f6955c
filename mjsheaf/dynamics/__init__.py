"""Motions of the targets, and the control effectiveness of the agents.

Each module holds one concept: a class for users, flat arrays that it packs into, and the compiled function
that evaluates them. How they are integrated is not known here.
"""

from mjsheaf.dynamics.effectiveness import ControlEffectiveness
from mjsheaf.dynamics.motion import Adrift, Fixed, Lissajous, Motion, Static, Waypoints

__all__ = ["Adrift", "ControlEffectiveness", "Fixed", "Lissajous", "Motion", "Static", "Waypoints"]
