"""
Train a policy
==============

A slow current, another one around each boat and in each episode, carries four boats away from their square, and the
paper's law alone keeps an error of about the current over its gain. A policy with three numbers, the same for every
boat, is added to the law; it sees what the boat itself measures. An evolution strategy trains it in
``mjsheaf.envs.vector_env``: in each generation 12 candidates meet the same four new episodes. Then it meets episodes
that training has not seen. The optimum q* is known, so the curve shows the regret of each generation.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import block_diag

import mjsheaf
import mjsheaf.envs

CANDIDATES, EPISODES, ELITE, GENERATIONS = 12, 4, 4, 12
HORIZON = 8.0  # s
UNSEEN = 100_000  # seeds from here on are not trained on

scenario = mjsheaf.load_scenario(
    "steady_current",
    {
        "controller.integral": None,
        "flow.agents.drift": [0, 0],
        "disturbance.agents": {"bound": 0.6, "frequencies": [0.005, 0.03]},
        "spread.position": 2.0,
    },
)
worlds = mjsheaf.envs.vector_env(scenario, CANDIDATES * EPISODES, horizon=HORIZON, autoreset_mode="Disabled")


def disagreement_matrix(episode):
    """Return M with eta = M o for an observation o of the team, from edges that compare positions."""
    blocks = []
    for agent, n in zip(episode.agents, episode.dimensions, strict=True):
        own = episode.observe()[agent]
        block = {part: np.zeros((n, own[part].size)) for part in episode.parts}
        first = 0
        for k, edge in enumerate(episode.edges[agent]):
            pull = -edge.F_tail.T @ edge.weight if agent == edge.tail else edge.F_head.T @ edge.weight
            block["measurements"][:, first : first + len(edge.b)] = pull
            block["received"][:, k] = pull @ edge.b
            first += len(edge.b)
        blocks.append(np.hstack(list(block.values())))
    return block_diag(*blocks)


def regrets(policies, seeds):
    """Return the mean of |q* - q|^2 over agents and time in each run, shape (n,), m^2; run k has policy k and seed k.

    A policy (a, b, c) adds a eta + b d(eta)/dt + c (integral of eta) to the velocity of a boat, eta its disagreement.
    """
    episode = worlds.envs[0].episode
    M = disagreement_matrix(episode)
    limits = np.repeat(episode.action_limits, episode.dimensions)  # velocity that an action of 1 stands for, m/s
    grid = episode.scenario.whole.grid
    observation, _ = worlds.reset(seed=seeds)
    before = observation @ M.T
    total = np.zeros_like(before)
    regret = np.zeros(len(policies))
    steps = round(HORIZON / grid.period)
    for _ in range(steps):
        eta = observation @ M.T
        total += grid.period * eta
        features = np.stack([eta, (eta - before) / grid.period, total], axis=-1)
        before = eta
        velocity = np.einsum("wnk,wk->wn", features, policies)  # m/s
        observation, rewards, *_ = worlds.step(np.clip(velocity / limits, -1.0, 1.0))
        regret -= rewards
    return regret / (steps * len(episode.agents))


rng = np.random.default_rng(0)
paper = np.zeros(3)  # the law alone
mean = np.zeros(3)
spread = np.array([0.2, 0.02, 0.2])
best, centres, alone = [], [], []
for generation in range(GENERATIONS):
    candidates = mean + spread * rng.standard_normal((CANDIDATES, 3))
    candidates[:2] = mean, paper  # the centre of the search, and what it is compared with
    new = EPISODES * generation + np.arange(EPISODES)
    found = regrets(np.repeat(candidates, EPISODES, axis=0), np.tile(new, CANDIDATES).tolist())
    found = found.reshape(CANDIDATES, EPISODES).mean(axis=1)
    elite = candidates[np.argsort(found)[:ELITE]]
    mean = elite.mean(axis=0)
    spread = 0.5 * elite.std(axis=0) + 0.5 * spread
    best.append(found.min())
    centres.append(found[0])
    alone.append(found[1])

unseen = [UNSEEN + k for k in range(len(worlds.envs))]
trained, untrained = (regrets(np.tile(policy, (len(unseen), 1)), unseen) for policy in (mean, paper))
print("policy:", mean.round(3))
print(f"regret in {len(unseen)} episodes that it has not seen:")
print(f"  {untrained.mean():.3f} m^2 by the law alone, {trained.mean():.3f} m^2 with the policy")
print(f"  the policy is better in {np.mean(trained < untrained):.0%} of them")
assert trained.mean() < untrained.mean()

figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
generations = np.arange(1, GENERATIONS + 1)
axes.plot(generations, alone, color="black", linestyle="--", label="the paper's law alone")
axes.plot(generations, centres, marker=".", label="centre of the search")
axes.plot(generations, best, marker="o", label=f"best of {CANDIDATES} policies")
axes.set(xlabel="generation, each with new episodes", ylabel="regret: mean of $|q^* - q|^2$ (m$^2$)", ylim=(0, None))
axes.legend()
