"""
Delay margin
============

``check`` computes the largest delay that the law tolerates. With one period more, a run diverges.
"""

import matplotlib.pyplot as plt

import mjsheaf

team = {
    "name": "late",
    "time": {"end": 10},
    "controller": {"gain": 4, "control_period": 0.02},
    "agents": [{"id": "A1", "position": [0, 0]}, {"id": "A2", "position": [4, 0]}],
    "targets": [{"id": "T1", "position": [2, 6]}],
    "communication": [["A1", "A2"]],
    "sensing": [["A1", "T1"], ["A2", "T1"]],
    "links": {"all": {"delay": 0.02}},
}
margin = mjsheaf.check(mjsheaf.load_scenario(team), trial=False)["links"]["delay_margin"]
print(f"stable up to a delay of {margin:.2f} s")
figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
for delay in (margin, margin + 0.02):
    late = mjsheaf.load_scenario(team, {"links.all.delay": round(delay, 6)})
    error = mjsheaf.simulate(late, backend="ideal").tracking_error.mean("agent")
    print(f"delay {delay:.2f} s: {float(error[0]):.2f} m at the start, {float(error[-1]):.2g} m at the end")
    axes.semilogy(error.time, error, label=f"delay {delay:.2f} s")
axes.set(xlabel="time (s)", ylabel="mean tracking error (m)")
axes.legend()
