"""
A policy on top of the law
==========================

``mjsheaf.envs.dm_env`` makes a scenario an environment of dm_control. An action is a velocity that is added to the
law's command; an observation contains the agent's own measurements only. The policy moves along the sum of
these measurements, and a search over its one parameter finds the largest return.
"""

import matplotlib.pyplot as plt
import numpy as np

import mjsheaf
import mjsheaf.envs

env = mjsheaf.envs.dm_env(mjsheaf.load_scenario("midpoint"), horizon=6.0)
limit = env.action_spec()["A1"].maximum  # m/s


def episode(share):
    """Return the rewards of an episode, shape (steps,), m^2."""
    step = env.reset()
    rewards = []
    while not step.last():
        to_targets = step.observation["A1"]["measurements"].reshape(-1, 2)  # m, one row for each target
        step = env.step({"A1": np.clip(share * to_targets.sum(axis=0), -limit, limit)})
        rewards.append(step.reward.sum())
    return np.array(rewards)


figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
for share in (0.0, 0.2, 1.0):  # 1/s
    rewards = episode(share)
    print(f"share {share:.1f} 1/s: return {rewards.sum():9.1f} m^2, error at the end {np.sqrt(-rewards[-1]):.3f} m")
    axes.plot(env.control_timestep() * np.arange(1, len(rewards) + 1), -rewards, label=f"{share:g} 1/s")
axes.set(xlabel="time (s)", ylabel="$|q^* - q|^2$ (m$^2$)", yscale="log")
axes.legend(title="policy")
