"""How fast a small disturbance of a simulated team grows: measured on `World`, without any linearisation."""

from collections.abc import Mapping
from typing import Any

import numpy as np

import mjsheaf
from mjsheaf.scenario import scenario_from_mapping

_KICK = 1e-6  # m
_LINEAR = 1e-2  # m: beyond it thrusters may meet limits, and the measurement ends
_FAINT = 1e-13  # m: below it all is rounding, and the measurement ends


def growth_rate(scenario: Mapping[str, Any], gain: float, *, settle: float, span: float, seed: int = 0) -> float:
    """Rate at which a disturbance of 1e-6 m grows (positive) or decays (negative) at a gain, 1/s.

    The team first settles at the scenario's own gain, which must be stable. Then the gain changes and the wanted
    disagreement with it, so that commands stay what they were, and every agent is moved by 1e-6 m in a random
    direction. The rate is the slope, by least squares, of the logarithm of how far positions swing about their mean in
    each of eight windows after the first third.

    Args:
        scenario: as in a file, with static targets.
        gain: 1/s.
        settle: how long the team settles, s.
        span: how long it is watched, s; some periods of the slowest swing must fit into each window.
        seed: of the directions.
    """
    world = mjsheaf.World(scenario_from_mapping(dict(scenario)), visible=False)
    law, data, agents = world.system.law, world.data, len(world.system.team.agents)
    per = world.steps_per_sample
    world.step(round(settle / world.system.grid.period) * per)
    x = world.positions().reshape(-1)
    residual = np.array([law.value[a:b] @ x[law.column[a:b]] for a, b in zip(law.start, law.start[1:], strict=False)])
    residual -= law.c
    share = np.repeat(np.where(np.arange(len(law.gain)) < agents, law.gain / gain, 1.0), 3)
    law.c[:] += residual * (1.0 - share)
    law.gain[:agents] = gain
    rng = np.random.default_rng(seed)
    rest = world.positions()[:agents]
    for v in range(agents):
        n = world.arena.vehicles[v].dimension
        at = world.arena.qpos[v]
        data.qpos[at : at + n] += _KICK * rng.choice([-1.0, 1.0], n)
    samples = round(span / world.system.grid.period)
    moved = np.empty((samples, agents, 3))
    for k in range(samples):
        world.step(per)
        moved[k] = world.positions()[:agents] - rest
        if not _FAINT < np.abs(moved[k]).max() < _LINEAR:
            moved = moved[: k + 1]
            break
    time = world.system.grid.period * np.arange(len(moved))
    windows = np.array_split(np.arange(len(moved) // 3, len(moved)), 8)
    size = [np.log(np.sqrt(moved[w].var(axis=0).sum())) for w in windows]
    return float(np.polyfit([time[w].mean() for w in windows], size, 1)[0])
