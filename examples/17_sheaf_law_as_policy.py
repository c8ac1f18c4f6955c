"""
The sheaf law as a policy
=========================

Learners need a baseline. The paper's law is one: it is linear in what agents observe, so that a matrix M with one block
for each agent gives the disagreement eta = M o of a team from its observation o. Actions are whole velocities here, and
the policy -k1 eta moves the team as the law in the loop does.
"""

import numpy as np
from scipy.linalg import block_diag

import mjsheaf
import mjsheaf.envs


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


limited = {"controller.velocity_limit": 3}  # m/s; without one, actions are cut at the top speed
team = mjsheaf.envs.env(mjsheaf.load_scenario("midpoint", limited), horizon=2.0, action="velocity")
episode = team.episode
law = episode.scenario.whole.law
M = disagreement_matrix(episode)
limits = np.repeat(episode.action_limits, episode.dimensions)  # velocity that an action of 1 stands for, m/s

observation, _ = team.reset()
over = False
while not over:
    velocity = -law.gain[0] * (M @ observation)
    for own in np.split(velocity, np.cumsum(episode.dimensions)[:-1]):  # the speed limit of each agent
        own *= min(1.0, law.limit[0] / max(np.linalg.norm(own), 1e-300))
    observation, _, _, over, _ = team.step(np.clip(velocity / limits, -1.0, 1.0))

run = mjsheaf.simulate(mjsheaf.load_scenario("midpoint", limited | {"time.end": 2.0}))
difference = abs(episode.world.positions()[0, :2] - run.agent_position[-1, 0, :2].values).max()
print(f"the policy is {difference:.1e} m from the law after 2 s")
assert difference < 1e-6
