"""How the same team, law and flow become trajectories: ideal kinematics, or MuJoCo bodies."""
