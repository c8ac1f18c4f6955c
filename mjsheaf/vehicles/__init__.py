"""Vehicles: description files, MJCF files and reduced models.

Modules: actuators and steering (a class for each kind), body (mass, drag and actuators), vehicle (the description file
and the reduced model), loading (MJCF), effects (which can be switched off), authority (directions of thrust).
"""
