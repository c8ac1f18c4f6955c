"""Tests of the comparison of ideal kinematics with bodies."""
