"""Growth rate of a small disturbance of a simulated team, measured on `World`, without linearisation."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mjsheaf
from mjsheaf.law import disagreement
from mjsheaf.law.in_python import Sample
from mjsheaf.scenario import scenario_from_mapping

_KICK = 1e-6  # m
_LINEAR = 1e-2  # m: beyond it thrusters may meet limits, and the measurement ends
_FAINT = 1e-13  # m: below it all is rounding, and the measurement ends


def growth_rate(scenario: Mapping[str, Any], gain: float, *, settle: float, span: float, seed: int = 0) -> float:
    """Return the rate at which a disturbance of 1e-6 m grows (positive) or decays (negative) at a gain, 1/s.

    The team first settles at the scenario's own gain, which must be stable. Then the gain changes and the desired
    disagreement with it, so that commands stay what they were, and every agent is moved by 1e-6 m in a random
    direction. The rate is the slope, by least squares, of the logarithm of the deviation of positions from the mean in
    each of eight windows after the first third.

    Args:
        scenario: Scenario as in a file, with static targets.
        gain: Gain of the law, 1/s.
        settle: Time for the team to settle, s.
        span: Time of the measurement, s; some periods of the slowest oscillation must fit into each window.
        seed: Seed of the directions.
    """
    wanted: dict[str, Any] = {"gain": 0.0, "own": 0.0, "rest": 0.0}  # command = -own rest - gain (eta - rest)

    def law(_: float, sample: Sample) -> NDArray[np.float64]:
        return -wanted["own"] * wanted["rest"] - wanted["gain"] * (sample.disagreement - wanted["rest"])

    parts = dict(scenario)
    if parts["controller"]["control_period"] == 0.0:  # on bodies: at each of their steps
        parts["controller"] = {**parts["controller"], "control_period": parts["physics"]["timestep"]}
    system = scenario_from_mapping(parts).system
    world = mjsheaf.World(system, controller=law, visible=False)
    agents, per = len(system.team.agents), world.steps_per_sample
    wanted["gain"] = system.gain
    world.reset()
    world.step(round(settle / system.grid.period) * per)
    wanted |= {"gain": gain, "own": system.gain, "rest": disagreement(system.law, world.positions())[:agents]}
    return _growth_from_rest(world, span, seed)


def growth_rate_with_terms(scenario: Mapping[str, Any], gain: float, *, settle: float, span: float) -> float:
    """The same of a team whose law has terms, in still water and air, where it comes to rest with commands of zero."""
    worlds = []
    for k in (scenario["controller"]["gain"], gain):
        parts = {**scenario, "controller": {**scenario["controller"], "gain": k}}
        worlds.append(mjsheaf.World(scenario_from_mapping(parts).system, visible=False))
    first, second = worlds
    first.step(round(settle / first.system.grid.period) * first.steps_per_sample)
    second.set_state(first.get_state())
    return _growth_from_rest(second, span, 0)


def _growth_from_rest(world: mjsheaf.World, span: float, seed: int) -> float:
    """Move every agent a little, and see how fast that grows."""
    data, agents, per = world.data, len(world.system.team.agents), world.steps_per_sample
    rest = world.positions()[:agents]
    rng = np.random.default_rng(seed)
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
