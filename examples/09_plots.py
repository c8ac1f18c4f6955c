"""
Plots from result.nc
====================

``mjsheaf run`` leaves ``result.nc``, netCDF-4 that xarray opens.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import xarray as xr

import mjsheaf

result = mjsheaf.simulate(mjsheaf.load_scenario("certified", {"time.end": 15}), backend="ideal")
with tempfile.TemporaryDirectory() as directory:
    path = Path(directory) / "result.nc"
    result.to_netcdf(path, engine="h5netcdf")  # stands for the run
    run = xr.load_dataset(path, engine="h5netcdf")

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
for agent in run.agent.values:
    left.plot(*run.agent_position.sel(agent=agent, axis=["x", "y"]).values.T, label=str(agent))
left.plot(*run.target_position.isel(target=0).sel(axis=["x", "y"]).values.T, "k--", label="T1")
left.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
left.legend()
right.semilogy(run.time, run.tracking_error)
right.set(xlabel="time (s)", ylabel="tracking error (m)")
