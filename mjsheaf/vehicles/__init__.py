"""Vehicles: what a vehicle file says, its MJCF, and its reduced model.

Where to look: actuators and steering (a class for each kind), body (what physics knows of a vehicle), vehicle (the
description file and the reduced model), loading (MJCF), effects (what can be switched off).
"""
