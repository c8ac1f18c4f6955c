"""Simulate a system on ideal kinematics or on bodies.

`session` contains `Session`, which selects an engine, and `engine` the code common to all engines: phases, samples and
states. `ideal` integrates first-order kinematics. `loop` closes the loop around an engine for bodies: `world` contains
`World`, which uses MuJoCo, and `fused` our own compiled engine.
`bodies` computes thruster commands and the forces of the medium, and `arena` composes the MuJoCo model. `worlds`
steps runs of one team together, laid out by `rows`, for environments.
`linear` linearises a vehicle's own loop. `trajectory` defines the result of all engines. This module imports nothing,
because MuJoCo is slow to import.
"""
