"""The physics backend: the same team, law and flow on MuJoCo bodies.

vehicle: what one vehicle is, from its MJCF file and description. attachment: that file made fit for the arena. arena:
all of them in one model. forces: drag, flow, buoyancy and thrust at one instant. callback: what happens before every
step. world: the loop.
"""

from mjsheaf.backends.physics.arena import Arena, compose
from mjsheaf.backends.physics.vehicle import Vehicle, list_vehicles, load_vehicle
from mjsheaf.backends.physics.world import World, run_physics, vehicles_of

__all__ = ["Arena", "Vehicle", "World", "compose", "list_vehicles", "load_vehicle", "run_physics", "vehicles_of"]
