"""
Train a policy
==============

A current carries four boats away from their square, and the paper's law alone keeps an error of the current over its
gain. A policy with three numbers, the same for every boat, is added to the law; it sees what the boat itself measures.
An evolution strategy trains it: 12 candidates at a time, one in each run of ``mjsheaf.envs.vector_env``. The optimum q*
is known, so the curve shows the regret of each generation.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import block_diag

import mjsheaf
import mjsheaf.envs

CANDIDATES, ELITE, GENERATIONS = 12, 4, 12
HORIZON = 8.0  # s


def worlds_in(current):
    """Return runs under the paper's law in a current, (2,) m/s."""
    changes = {"controller.integral": None, "flow.agents.drift": current}
    scenario = mjsheaf.load_scenario("steady_current", changes)
    return mjsheaf.envs.vector_env(scenario, CANDIDATES, horizon=HORIZON, autoreset_mode="Disabled")


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


def regrets(worlds, policies):
    """Return the mean of |q* - q|^2 over agents and time under each policy, shape (n,), m^2.

    A policy (a, b, c) adds a eta + b d(eta)/dt + c (integral of eta) to the velocity of a boat, eta its disagreement.
    """
    episode = worlds.envs[0].episode
    M = disagreement_matrix(episode)
    limits = np.repeat(episode.action_limits, episode.dimensions)  # velocity that an action of 1 stands for, m/s
    grid = episode.scenario.whole.grid
    observation, _ = worlds.reset()
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
worlds = worlds_in([0.4, 0.3])
mean = np.zeros(3)
spread = np.array([0.2, 0.02, 0.2])
centres = []
best = []
for _ in range(GENERATIONS):
    candidates = mean + spread * rng.standard_normal((CANDIDATES, 3))
    candidates[0] = mean  # the centre of the search
    found = regrets(worlds, candidates)
    elite = candidates[np.argsort(found)[:ELITE]]
    mean = elite.mean(axis=0)
    spread = 0.5 * elite.std(axis=0) + 0.5 * spread
    centres.append(found[0])
    best.append(found.min())

paper = centres[0]  # the search begins with the policy of zeros

# A current that training has not seen.
policies = np.zeros((CANDIDATES, 3))
policies[0] = mean
trained, untrained = regrets(worlds_in([-0.3, 0.5]), policies)[:2]
print("policy:", mean.round(3))
print(f"regret in the current of the training: {paper:.2f} m^2 by the law, {best[-1]:.2f} m^2 with the policy")
print(f"regret in another current:             {untrained:.2f} m^2 by the law, {trained:.2f} m^2 with the policy")
assert best[-1] < paper
assert trained < untrained

figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.plot(np.arange(1, GENERATIONS + 1), best, marker="o", label="best of 12 policies")
axes.plot(np.arange(1, GENERATIONS + 1), centres, marker=".", label="centre of the search")
axes.axhline(paper, color="black", linestyle="--", label="the paper's law alone")
axes.set(xlabel="generation", ylabel="regret: mean of $|q^* - q|^2$ (m$^2$)", ylim=(0, None))
axes.legend(loc="lower left")
