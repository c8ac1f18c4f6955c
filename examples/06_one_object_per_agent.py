"""
One object per agent
====================

``PerAgent`` makes one object per agent and gives it its own edges only, so the law is decentralized by
construction. A law that yields numbers exchanges them with its neighbours; here each agent averages its
command with those of its neighbours.
"""

import matplotlib.pyplot as plt
import numpy as np

import mjsheaf


class Smoothed:
    def __init__(self, agent):
        self.agent = agent

    def __call__(self, t, local):
        own = -3.0 * local.disagreement
        received = yield own  # one exchange with the neighbours
        near = list(received.values())
        return 0.8 * own + 0.2 * np.mean(near, axis=0) if near else own


scenario = mjsheaf.load_scenario("paper", {"time.end": 5, "controller.gain": 3})
result = mjsheaf.simulate(scenario, backend="ideal", controller=mjsheaf.PerAgent(Smoothed))
print(f"tracking error at the end: {float(result.tracking_error[-1].mean()):.2f} m")
print("exchanges in the run:", int(result.attrs["exchange_rounds"]))

figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.plot(result.time, result.tracking_error)
axes.set(xlabel="time (s)", ylabel="tracking error of each agent (m)", yscale="log")
