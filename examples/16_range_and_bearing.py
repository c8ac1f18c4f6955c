"""
Keep a shape by distances or directions
=======================================

Three boats without targets keep a triangle. ``check`` says whether the edges determine its shape,
and at which rate errors decay near it. With distances, the rate is 1.5 k1. Directions leave the
size of the triangle free, and the rate is 1.5 k1 divided by the side that results.
"""

import matplotlib.pyplot as plt
import numpy as np

import mjsheaf

places = [[0.0, 0.0], [1.0, 0.0], [0.5, 0.75**0.5]]
start = {"A": [0.1, 0.0], "B": [1.0, 0.2], "C": [0.3, 1.0]}
figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
for measures in ("range", "bearing"):
    scenario = mjsheaf.Scenario.model_validate(
        {
            "name": "triangle",
            "time": {"end": 6},
            "controller": {"gain": 1.0, "control_period": 0.02},
            "agents": [{"id": name, "position": place} for name, place in start.items()],
            "communication": [{"between": list(pair), "measures": measures} for pair in ("AB", "BC", "CA")],
            "formations": [{"name": "shape", "shape": "explicit", "members": list("ABC"), "displacements": places}],
        }
    )
    rigidity = mjsheaf.check(scenario, trial=False)["rigidity"]
    run = mjsheaf.simulate(scenario, backend="ideal")
    error = run.formation_error.values
    assert rigidity["rigid"]
    print(f"{measures:8} rank {rigidity['rank']} of {rigidity['needed']}, rate {rigidity['rate']:.3f} 1/s")
    axes.semilogy(run.time, np.maximum(error, 1e-12), label=measures)
axes.set(xlabel="time (s)", ylabel="formation error (m)")
axes.legend()

# %%
# Only the tail of a directed edge measures and moves. A cycle of three is as fast, but its
# eigenvalues are complex.
for edge in (fields := scenario.model_dump(mode="json", exclude_unset=True))["communication"]:
    edge |= {"measures": "position", "directed": True}
report = mjsheaf.check(mjsheaf.Scenario.model_validate(fields), trial=False)
print(f"directed rate {report['rigidity']['rate']:.3f} 1/s")
