"""What moves vehicles apart from the law: flow, disturbances, target motions, control effectiveness.

Each module holds one concept: a class for users, flat arrays that it packs into, and the compiled function
that evaluates them. How they are integrated is not known here.
"""

from mjsheaf.dynamics.disturbance import Disturbance
from mjsheaf.dynamics.effectiveness import ControlEffectiveness
from mjsheaf.dynamics.flow import FlowField
from mjsheaf.dynamics.motion import Lissajous, Motion, Static, Waypoints

__all__ = ["ControlEffectiveness", "Disturbance", "FlowField", "Lissajous", "Motion", "Static", "Waypoints"]
