"""From a system to trajectories: ideal kinematics, or MuJoCo bodies. Nothing is imported here: MuJoCo is heavy."""
