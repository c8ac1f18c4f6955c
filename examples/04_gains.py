"""
Error over gain
===============

``simulate_many`` runs scenarios on threads. The published run at five gains, its first ten seconds, on ideal
kinematics: the error falls as 1 / k1, until the hold of 10 ms makes the loop unstable.
"""

import matplotlib.pyplot as plt

import mjsheaf

gains = [1, 3, 10, 20, 30]
scenarios = [mjsheaf.load_scenario("paper", {"controller.gain": gain, "time.end": 10}) for gain in gains]
results = list(mjsheaf.simulate_many(scenarios, backend="ideal"))
late = [float((r.tracking_error.sel(time=slice(5, None)) ** 2).mean() ** 0.5) for r in results]
for gain, error in zip(gains, late, strict=True):
    print(f"gain {gain:2d} 1/s: {error:6.3f} m")

# %%
# ``check`` knows the limit without a run.
largest = mjsheaf.check(scenarios[0], trial=False)["law"]["largest_gain"]
print(f"stable up to a gain of {largest:.1f} 1/s")

figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.loglog(gains, late, "o-")
axes.set(xlabel="gain k1 (1/s)", ylabel="RMS tracking error (m)")
