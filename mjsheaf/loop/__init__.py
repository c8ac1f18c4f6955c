"""Simulate a system on ideal kinematics or on bodies.

`session` contains `Session`, which selects an engine, and `engine` the code common to all engines: phases, samples,
states and results. `ideal` integrates first-order kinematics. `loop` closes the loop around an engine for bodies:
`mujoco_engine` contains `World`, which uses MuJoCo, and `fused` our own compiled engine. `bodies` has what the medium
does to vehicles and what their autopilots compute, `block` a vehicle's whole step. `linear` linearises a vehicle's own
loop. This module imports nothing, because MuJoCo is slow to import.
"""
