"""The physics backend: the same team, law and flow on MuJoCo bodies.

description: what a person writes of a vehicle beside its MJCF file. vehicle: what one vehicle is, and its reduced
model.
loading: from the one to the other. effects: a vehicle with something switched off. capability: what it can do.
attachment: its file made fit for the arena. arena: all of them in one model, which bodies holds as arrays. forces: the
medium's at one instant. autopilot: thruster commands. callback: what happens before every step. world: the loop.
running: a whole run.
"""

from mjsheaf.backends.physics.arena import Arena, compose
from mjsheaf.backends.physics.loading import list_vehicles, load_vehicle
from mjsheaf.backends.physics.running import run_physics, stream_physics
from mjsheaf.backends.physics.vehicle import Vehicle
from mjsheaf.backends.physics.world import World, vehicles_of

__all__ = [
    "Arena",
    "Vehicle",
    "World",
    "compose",
    "list_vehicles",
    "load_vehicle",
    "run_physics",
    "stream_physics",
    "vehicles_of",
]
