"""Vehicles: description files, MJCF files and reduced models.

Modules: actuators and steering (a class for each kind), body (mass, drag and actuators), vehicle (the description file
and the reduced model), loading (MJCF), effects (capabilities, and what can be switched off).
"""
