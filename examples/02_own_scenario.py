"""
A scenario from a dict
======================

``load_scenario`` takes a mapping with the fields of a scenario file. Two boats keep a formation below a drone.
"""

import matplotlib.pyplot as plt

import mjsheaf

fields = {
    "name": "two_boats",
    "time": {"end": 20},
    "controller": {"gain": 2},
    "agents": [{"id": "B1", "position": [-5, 0]}, {"id": "B2", "position": [-5, -8]}],
    "targets": [
        {
            "id": "D",
            "position": [10, 5, 8],
            "motion": {"kind": "waypoints", "points": [[0, 20, 8], [-10, 0, 6]], "speed": 1, "closed": True},
        }
    ],
    "communication": [["B1", "B2"]],  # a formation needs links between its members
    "sensing": [["B1", "D"], ["B2", "D"]],
    "formations": [{"name": "pair", "shape": "line", "members": ["B1", "B2"], "spacing": 4, "angle": 90, "about": "D"}],
}
scenario = mjsheaf.load_scenario(fields)
result = mjsheaf.simulate(scenario, backend="ideal")

# %%
# The result is an xarray Dataset with units and long names.
for name in ("tracking_error", "formation_error"):
    series = result[name]
    last = series.isel(time=-1)
    print(f"{series.attrs['long_name']}: {float(last.mean()):.3f} {series.attrs['units']}")

figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
for agent in result.agent.values:
    axes.plot(*result.agent_position.sel(agent=agent, axis=["x", "y"]).values.T, label=str(agent))
axes.plot(*result.target_position.isel(target=0).sel(axis=["x", "y"]).values.T, "k--", label="D, from above")
axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
axes.legend()
