"""From a system to trajectories: ideal kinematics, or MuJoCo bodies.

Where to look: ideal integrates first-order kinematics; loop holds `World`, the compiled loop about MuJoCo's step, and
what it records; bodies turns velocity commands into thrust, and the medium into forces; arena composes the model;
linear linearises a vehicle's own loop; trajectory is what both backends return. Nothing is imported here: MuJoCo is
heavy.
"""
