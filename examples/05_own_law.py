"""
A law of your own
=================

A law is a callable ``law(t, sample)`` that returns velocities, shape (N, 3), in m/s. This one adds an
integral to the paper's law, to remove the error that a steady current causes.
"""

import matplotlib.pyplot as plt
import numpy as np

import mjsheaf

scenario = mjsheaf.load_scenario(
    {
        "name": "current",
        "time": {"end": 20},
        "controller": {"gain": 1, "control_period": 0.02},
        "agents": [{"id": "A1", "position": [0, 0]}, {"id": "A2", "position": [4, 0]}],
        "targets": [{"id": "T1", "position": [10, 5]}],
        "communication": [["A1", "A2"]],
        "sensing": [["A1", "T1"]],
        "flow": {"agents": {"dimension": 2, "drift": [0.5, 0.2]}},
    }
)


class WithIntegral:
    def __init__(self, gain=1.0, integral=0.2, period=0.02):
        self.gain, self.integral, self.period = gain, integral, period

    def reset(self, team, rng):
        self.sum = np.zeros((len(team.agents), 3))

    def __call__(self, t, sample):
        self.sum += self.period * sample.disagreement
        return -self.gain * sample.disagreement - self.integral * self.sum


figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
for name, law in (("the paper's law", None), ("with an integral", WithIntegral())):
    result = mjsheaf.simulate(scenario, backend="ideal", controller=law)
    print(f"{name}: {float(result.tracking_error[-1].mean()):.3f} m")
    axes.semilogy(result.time, result.tracking_error.mean("agent"), label=name)
axes.set(xlabel="time (s)", ylabel="mean tracking error (m)")
axes.legend()
