"""
Noise, predicted and measured
=============================

A link has noise, bias, delay and loss. ``check`` predicts the error that noise causes; a run of the same team
at rest measures it.
"""

import matplotlib.pyplot as plt
import numpy as np

import mjsheaf

scenario = mjsheaf.load_scenario(
    {
        "name": "noisy",
        "seed": 3,
        "time": {"end": 200},
        "controller": {"gain": 2, "control_period": 0.05},
        "agents": [{"id": f"A{k}", "position": [k, 0]} for k in range(1, 5)],
        "targets": [{"id": "T1", "position": [2.5, 0]}],
        "communication": [["A1", "A2"], ["A2", "A3"], ["A3", "A4"]],
        "sensing": [["A1", "T1"], ["A4", "T1"]],
        "links": {"all": {"noise": 0.3}},
    }
)
predicted = mjsheaf.check(scenario, trial=False)["links"]["noise_rms"]
result = mjsheaf.simulate(scenario, backend="ideal")
e = result.tracking_error.sel(time=slice(20, None)).values
measured = np.sqrt((e**2).sum(axis=1).mean())  # of the whole team, as check gives it
print(f"RMS of |e|: predicted {predicted:.3f} m, measured {measured:.3f} m")
assert abs(measured / predicted - 1) < 0.1

figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.plot(result.time, np.sqrt((result.tracking_error**2).sum("agent")), linewidth=0.5)
axes.axhline(predicted, color="black", label="predicted RMS")
axes.set(xlabel="time (s)", ylabel="|e| of the team (m)")
axes.legend()
