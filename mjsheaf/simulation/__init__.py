"""From a system to trajectories: ideal kinematics, or bodies.

Where to look: session holds `Session`, which chooses an engine. engine has what all engines share: phases, samples,
states. ideal integrates first-order kinematics; loop closes the loop about what moves bodies: world holds `World`,
about MuJoCo's step, and fused a compiled one of our own, on the threads of threaded, which meet at a gate. bodies turns
velocity commands into thrust, and the medium into forces; arena composes MuJoCo's model. batch runs many runs of one
team, which lie side by side in rows and leave scores, on threads or on a card. linear linearises a vehicle's own loop;
trajectory is what all return. Nothing is imported here: MuJoCo is heavy.
"""
