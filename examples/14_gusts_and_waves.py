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
sigma, lengths = gusts.intensities(9.0), gusts.decay_lengths(9.0)
print("standard deviations, m/s:", parts.std(axis=0).round(2), " theory:", sigma.round(2))

figure, ((correlation, frozen), (gust_spectrum, spectrum)) = plt.subplots(2, 2, figsize=(9, 7), layout="constrained")
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
# The same as spectra: power over frequency, which falls by two decades for each decade of frequency.
for k, name in enumerate("uvw"):
    frequency, density = welch(parts[:, k], fs=1 / period, nperseg=16_384)
    rate, rest = 2 * np.pi * frequency[1:600], lengths[k] / speed  # rad/s, s
    low_pass = 1 / (1 + (rate * rest) ** 2)
    shape = 4 * low_pass if name == "u" else 2 * (1 + 3 * (rate * rest) ** 2) * low_pass**2
    (line,) = gust_spectrum.loglog(rate, sigma[k] ** 2 * rest * shape / (2 * np.pi), label=f"{name}, theory")
    gust_spectrum.loglog(rate[::6], density[1:600:6] / (2 * np.pi), "o", ms=2, color=line.get_color())
gust_spectrum.set(xlabel="frequency (rad/s)", ylabel="spectrum (m$^2$/s)", title="Their spectra (dots: 24 hours)")
gust_spectrum.legend(fontsize="small")

# %%
# A frozen field is carried by the wind, so that vehicles in line with the wind meet the same gusts one after the other.
carried = mjsheaf.medium(mjsheaf.load_scenario("open_sea", {"flow.air.gusts.frozen": True}))
times = 2.0 * np.arange(43_200)
distances = np.linspace(0, 120, 13)
place = np.array([14.0, 4.0, 9.0])
met = [carried.velocity("H1", times, place + d * np.array([*along, 0.0])) - wind for d in distances]
fine = np.linspace(0, 120, 200)
for name, k, axis in (("u", 0, np.array([*along, 0.0])), ("w", 2, np.array([0.0, 0.0, 1.0]))):
    series = [one @ axis for one in met]
    theory = np.exp(-fine / lengths[k]) * (1 if name == "u" else 1 - fine / lengths[k] / 2)
    (line,) = frozen.plot(fine, theory, label=f"{name}, theory")
    found = [np.mean(series[0] * other) / sigma[k] ** 2 for other in series]
    frozen.plot(distances, found, "o", ms=3, color=line.get_color(), label=f"{name}, 24 hours")
frozen.set(xlabel="distance along the wind (m)", ylabel="correlation of two vehicles", title="A frozen field of gusts")
frozen.legend(fontsize="small")

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
found = mjsheaf.check(scenario, trial=False)["disturbance"]
print({name: round(rms, 3) for name, rms in found["bodies"].items()})
