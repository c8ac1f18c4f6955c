"""
Agents that fail
================

Events begin a phase with a team of its own. An agent is lost at 5 s and returns at 10 s; the others continue
without it.
"""

import matplotlib.pyplot as plt

import mjsheaf

scenario = mjsheaf.load_scenario(
    {
        "name": "failing",
        "time": {"end": 15},
        "controller": {"gain": 2},
        "agents": [
            {"id": "A1", "position": [0, 0]},
            {"id": "A2", "position": [4, 0]},
            {"id": "A3", "position": [8, 0]},
        ],
        "targets": [{"id": "T1", "position": [2, 6]}, {"id": "T2", "position": [6, 6]}],
        "communication": [["A1", "A2"], ["A2", "A3"], ["A1", "A3"]],
        "sensing": [["A1", "T1"], ["A3", "T2"]],
        "events": [{"time": 5, "lose": "A2"}, {"time": 10, "join": "A2"}],
    }
)
result = mjsheaf.simulate(scenario, backend="ideal")
for number, phase in enumerate(scenario.phases):
    inside = result.isel(time=(result.phase == number).values)
    errors = inside.tracking_error.isel(time=-1).to_series()  # NaN of an agent that is lost
    print(f"{phase.name:10} ends with", ", ".join(f"{agent}: {e:.4f} m" for agent, e in errors.items()))

figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.semilogy(result.time, result.tracking_error, label=result.agent.values.tolist())
for phase in scenario.phases[1:]:
    axes.axvline(phase.time, color="grey", linestyle=":")
axes.set(xlabel="time (s)", ylabel="tracking error (m)")
axes.legend()
