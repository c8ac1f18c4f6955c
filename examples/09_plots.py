"""
Plots of a run
==============

``mjsheaf.plot`` draws the figures that ``mjsheaf run`` writes, from a result in memory or from the directory of a run.
The data are an xarray Dataset, so that a plot of your own takes a few lines. ``result.nc`` holds the same Dataset.
"""

import matplotlib.pyplot as plt

import mjsheaf

scenario = mjsheaf.load_scenario("harbour", {"time.end": 30})
result = mjsheaf.simulate(scenario, backend="ideal")

mjsheaf.plot(result)  # a dict of matplotlib figures: errors, trajectories, configurations

# %%
# Coordinates name the group, the vehicle and the kind of every agent, and the phase of every sample.
# The errors of the groups are then one line:

errors = (result.tracking_error**2).groupby("group").mean() ** 0.5

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
for name in errors.group.values:
    right.semilogy(result.time, errors.sel(group=name), label=name)
right.set(xlabel="time (s)", ylabel="tracking error, RMS over agents (m)")
right.legend()
for agent in result.agent.values:
    left.plot(*result.agent_position.sel(agent=agent, axis=["x", "y"]).values.T)
for target in result.target.values:
    left.plot(*result.target_position.sel(target=target, axis=["x", "y"]).values.T, "k--")
left.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")

# %%
# ``mjsheaf.replay`` makes the page that replays the run in three dimensions. A notebook shows it; ``save`` writes one
# HTML file that any browser opens, without a network.

mjsheaf.replay(result)
