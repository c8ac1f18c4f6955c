"""
The physics loop by hand
========================

``World`` is the closed loop on MuJoCo's own model and data. Step it yourself and apply forces
through ``xfrc_applied``: here a tug pulls a boat away for two seconds.
"""

import matplotlib.pyplot as plt
import numpy as np

import mjsheaf

world = mjsheaf.World(mjsheaf.load_scenario("midpoint"))
boat = world.model.jnt_bodyid[world.model.joint("A1/").id]
weight = 9.81 * world.model.body_subtreemass[boat]
steps_per_second = round(1 / world.model.opt.timestep)
eta = []
for second in range(8):
    world.data.xfrc_applied[boat, :3] = [0.0, 5.0 * weight, 0.0] if 3 <= second < 5 else 0.0  # N
    for _ in range(10):
        world.step(steps_per_second // 10)
        eta.append(np.linalg.norm(world.disagreement[0]))
    pulled = "  pulled" if 3 <= second < 5 else ""
    print(f"{world.time:4.1f} s  |eta| {eta[-1]:.3f} m{pulled}")

figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.semilogy(0.1 * np.arange(1, 81), eta)
axes.axvspan(3, 5, alpha=0.2, label="pulled")
axes.set(xlabel="time (s)", ylabel="|eta| (m)")
axes.legend()

# %%
# A saved state continues with the same bits.
state = world.get_state()
world.step(100)
after = world.data.qpos.copy()
world.set_state(state)
world.step(100)
assert np.array_equal(after, world.data.qpos)
