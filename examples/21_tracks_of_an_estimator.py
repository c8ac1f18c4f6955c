"""
Tracks of an estimator
======================

A radar sees a ship among false echoes, now and then not at all, and for ten seconds it is lost behind a headland.
`Stone Soup <https://stonesoup.readthedocs.io>`_ estimates its track: a Kalman filter that weighs all echoes near where
it expects the ship. Three boats escort the estimate, a target with ``motion: recorded``. How far are they from where
they would have been, had they known the ship itself? The recording is a curve through the estimates, so the boats
know each up to one scan early.

It needs ``pip install stonesoup``, and does nothing without it.
"""

import sys
from datetime import datetime, timedelta

import matplotlib.pyplot as plt
import numpy as np

import mjsheaf

try:
    from stonesoup.dataassociator.probability import PDA
    from stonesoup.functions import gm_reduce_single
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.array import CovarianceMatrix, StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.types.update import GaussianStateUpdate
    from stonesoup.updater.kalman import KalmanUpdater
except ImportError:
    print("Stone Soup is not installed; nothing is shown")
    sys.exit(0)

END, PERIOD, NOISE = 80.0, 1.0, 1.5  # s, s between scans, m
DETECTED, CLUTTER, SIDE = 0.9, 6, 160.0  # probability, false echoes in a scan, m of the square that is scanned
LOST = (40.0, 50.0)  # s
rng = np.random.default_rng(0)

# The ship turns slowly.
times = np.arange(0.0, END + PERIOD, PERIOD)
ship = np.column_stack([1.2 * times - 45.0, 25.0 * np.sin(0.05 * times)])

measures = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=CovarianceMatrix(NOISE**2 * np.eye(2)))
moves = CombinedLinearGaussianTransitionModel([ConstantVelocity(0.05), ConstantVelocity(0.05)])
predictor, updater = KalmanPredictor(moves), KalmanUpdater(measures)
nearby = PDAHypothesiser(predictor, updater, clutter_spatial_density=CLUTTER / SIDE**2, prob_detect=DETECTED)
associator = PDA(hypothesiser=nearby)

begin = datetime(2026, 1, 1)
start = GaussianState([ship[0, 0], 1.0, ship[0, 1], 1.0], np.diag([NOISE**2, 1.0, NOISE**2, 1.0]), timestamp=begin)
track, echoes = Track([start]), []
for t, place in zip(times[1:], ship[1:], strict=True):
    found = list(rng.uniform(-0.5 * SIDE, 0.5 * SIDE, (rng.poisson(CLUTTER), 2)))
    if rng.random() < DETECTED and not LOST[0] <= t <= LOST[1]:
        found.append(place + NOISE * rng.standard_normal(2))
    echoes += [(t, *echo) for echo in found]
    now = begin + timedelta(seconds=float(t))
    scan = {Detection(echo.reshape(2, 1), timestamp=now, measurement_model=measures) for echo in found}
    hypotheses = associator.associate({track}, scan, now)[track]
    # The mean of what the track would be with each echo, or with none, weighed by how likely that is.
    weights = np.array([float(hypothesis.probability) for hypothesis in hypotheses])
    states = [updater.update(hypothesis) if hypothesis else hypothesis.prediction for hypothesis in hypotheses]
    vectors = StateVectors([state.state_vector for state in states])
    mean, covariance = gm_reduce_single(vectors, np.stack([state.covar for state in states], axis=2), weights)
    track.append(GaussianStateUpdate(mean, covariance, hypotheses, now))
estimate = np.array([[state.state_vector[0], state.state_vector[2]] for state in track], dtype=float)
stamps = np.array([(state.timestamp - begin).total_seconds() for state in track])


def escort(times, path):
    """Return the run of three boats about a target that is at each time, s from 0 on, where a path is, (T, 2) m."""
    scenario = mjsheaf.load_scenario(
        {
            "name": "escort",
            "time": {"end": END},
            "controller": {"gain": 1.5, "control_period": 0.05},
            "agents": [
                {"id": f"A{k + 1}", "position": (path[0] + 10.0 * np.array([np.cos(b), np.sin(b)])).tolist()}
                for k, b in enumerate(2.0 * np.pi * np.arange(3) / 3.0)
            ],
            "targets": [
                {
                    "id": "ship",
                    "position": path[0].tolist(),
                    "motion": {"kind": "recorded", "samples": np.column_stack([times, path]).tolist()},
                }
            ],
            "communication": [["A1", "A2"], ["A2", "A3"]],
            "sensing": [["A1", "ship"], ["A3", "ship"]],
            "formations": [
                {"name": "ring", "shape": "polygon", "members": ["A1", "A2", "A3"], "about": "ship", "radius": 8}
            ],
        }
    )
    return mjsheaf.simulate(scenario)


knowing, tracking = escort(times, ship), escort(stamps, estimate)
apart = np.linalg.norm((tracking.agent_position - knowing.agent_position).values[..., :2], axis=-1).mean(axis=1)
error = np.linalg.norm(estimate - ship, axis=1)
when = tracking.time.values
lost = (when >= LOST[0]) & (when <= LOST[1] + 5.0)
print(f"error of the track: {error.mean():.2f} m, of one echo {NOISE * np.sqrt(np.pi / 2):.2f} m")
print(f"boats from where they would have been: {apart[~lost].mean():.2f} m, up to {apart[lost].max():.2f} m while lost")
assert error[times > LOST[1] + 10.0].mean() < 2.0 * NOISE  # it is found again

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
shown = np.array(echoes)
left.plot(shown[:, 1], shown[:, 2], ".", color="0.7", markersize=4.0, label="echoes")
left.plot(*ship.T, color="black", label="ship")
left.plot(*estimate.T, color="tab:red", label="track")
behind = (times >= LOST[0]) & (times <= LOST[1])
left.plot(*estimate[behind].T, color="tab:red", linewidth=4.0, alpha=0.4, label="lost")
for k in range(3):
    left.plot(
        *tracking.agent_position.values[:, k, :2].T, color="tab:blue", linewidth=1.0, label="boats" if not k else None
    )
left.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
left.legend(loc="lower left", fontsize="small")
right.plot(times, error, color="tab:red", label="track from the ship")
right.plot(when, apart, color="tab:blue", label="boats from where they would be")
right.axvspan(*LOST, color="0.9", label="lost")
right.set(xlabel="time (s)", ylabel="distance (m)")
right.legend()
