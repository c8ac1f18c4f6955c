"""
Gusts and waves against theory
==============================

Gusts and waves are processes with a known spectrum. Here the gusts of a drone and the sea under a boat are sampled
with `mjsheaf.medium`, and plotted over the formulas of the standards.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import welch

import mjsheaf

scenario = mjsheaf.load_scenario("open_sea")
medium = mjsheaf.medium(scenario)
period = scenario.controller.control_period

# %%
# Gusts: 24 hours of the drone's air, less the mean wind, along the wind (u), to its left (v) and upwards (w).
gusts, wind = scenario.flow.air.gusts, np.array(scenario.flow.air.drift)
times = period * np.arange(round(86_400 / period))
velocity = medium.velocity("H1", times, [14.0, 4.0, 9.0]) - wind
direction, speed = gusts.wind(wind)
along, left = direction, np.array([-direction[1], direction[0]])
parts = np.column_stack([velocity[:, :2] @ along, velocity[:, :2] @ left, velocity[:, 2]])
sigma, lengths = gusts.scales(9.0)
print("standard deviations, m/s:", parts.std(axis=0).round(2), " theory:", sigma.round(2))

figure, (correlation, spectrum) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
lags = np.arange(0, round(15 / period), 8)
for k, name in enumerate("uvw"):
    found = [np.mean(parts[: len(parts) - lag, k] * parts[lag:, k]) / sigma[k] ** 2 for lag in lags]
    slip = period * lags * speed / lengths[k]
    theory = np.exp(-slip) * (1 if name == "u" else 1 - slip / 2)
    (line,) = correlation.plot(period * lags, theory, label=f"{name}, theory")
    correlation.plot(period * lags, found, "o", ms=3, color=line.get_color(), label=f"{name}, 24 hours")
correlation.set(xlabel="lag (s)", ylabel="autocorrelation", title="Dryden gusts about the drone")
correlation.legend(fontsize="small")

# %%
# Waves: an hour of the elevation at one place. A sea of 50 waves has lines at their frequencies, so it is averaged over
# wide bands; the last waves, beyond 3 rad/s, stand alone. The variance is that of the spectrum to rounding.
waves = scenario.flow.water.waves
height = medium.surface(0.25 * np.arange(14_400), [0.0, 0.0, 0.0])
frequency, density = welch(height, fs=4.0, nperseg=256)
rate = np.linspace(0.5, 6, 400)
spectrum.plot(rate, waves.spectrum(rate), label="JONSWAP, theory")
spectrum.plot(2 * np.pi * frequency, density / (2 * np.pi), "o", ms=3, label="an hour")
spectrum.set(xlim=(0, 6), xlabel="frequency (rad/s)", ylabel="spectrum (m$^2$ s)", title="The sea under the boats")
spectrum.legend(fontsize="small")
print("significant height, m:", round(4 * float(height.std()), 2), " desired:", waves.significant_height)
plt.show()

# %%
# What the medium does to the team is predicted before any run.
found = mjsheaf.check(scenario)["disturbance"]
print({name: round(rms, 3) for name, rms in found["bodies"].items()})
