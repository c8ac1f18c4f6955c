"""
A vehicle of your own
=====================

A vehicle is an MJCF file and a short description. This one is a raft with a thruster under each
corner.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import mjsheaf

MJCF = """
<mujoco model="raft">
  <worldbody>
    <body name="raft">
      <geom type="box" size="1 1 .2" mass="300"/>
      <site name="fl" pos="1 1 -.2" zaxis="1 -1 0"/>
      <site name="fr" pos="1 -1 -.2" zaxis="1 1 0"/>
      <site name="bl" pos="-1 1 -.2" zaxis="1 1 0"/>
      <site name="br" pos="-1 -1 -.2" zaxis="1 -1 0"/>
    </body>
  </worldbody>
  <actuator>
    <general name="fl" site="fl" gear="0 0 1 0 0 0" ctrllimited="true" ctrlrange="-80 80"/>
    <general name="fr" site="fr" gear="0 0 1 0 0 0" ctrllimited="true" ctrlrange="-80 80"/>
    <general name="bl" site="bl" gear="0 0 1 0 0 0" ctrllimited="true" ctrlrange="-80 80"/>
    <general name="br" site="br" gear="0 0 1 0 0 0" ctrllimited="true" ctrlrange="-80 80"/>
  </actuator>
</mujoco>
"""
DESCRIPTION = """
summary: raft with a thruster under each corner
mjcf: raft.xml
domain: surface
drag: {linear: [60, 60, 400], angular: [100, 100, 50]}
hydrostatics: {heave: 14100, roll: 1700, pitch: 1700}
attitude: {frequency: 2}
autopilot: {rate: 1}
"""

with tempfile.TemporaryDirectory() as directory:
    (Path(directory) / "raft.xml").write_text(MJCF)
    path = Path(directory) / "raft.yaml"
    path.write_text(DESCRIPTION)
    vehicle = mjsheaf.load_vehicle(str(path))
    print(f"mass {vehicle.mass:g} kg, time constants along x and y {vehicle.reduced_model().tau.round(2)} s")

    scenario = mjsheaf.load_scenario(
        {
            "name": "rafts",
            "time": {"end": 20},
            "controller": {"gain": 0.3, "control_period": 0.05},
            "agents": [{"id": "A1", "position": [0, 0], "vehicle": str(path)}],
            "targets": [{"id": "T1", "position": [6, 3]}],
            "sensing": [["A1", "T1"]],
        }
    )
    result = mjsheaf.simulate(scenario)
print(f"distance from the target after 20 s: {float(result.tracking_error[-1, 0]):.3f} m")

figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.plot(result.time, result.tracking_error)
axes.set(xlabel="time (s)", ylabel="distance from the target (m)")
