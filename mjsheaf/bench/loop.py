"""What closing the loop costs: `World.step(n)` against bare `mj_step` of the same model from the same state."""

from statistics import median
from typing import Any

import mjsheaf
from mjsheaf.bench.clock import cpu_time
from mjsheaf.bench.rows import Row, at_most
from mjsheaf.bench.swarm import swarm
from mjsheaf.engine import mujoco
from mjsheaf.scenario import Scenario
from mjsheaf.simulation.loop import World

OVERHEAD = 1.25
"""Wanted: time of a step with the loop closed, over that of a bare step."""

GROWTH = 1.2
"""Wanted: time of a step per vehicle of the largest swarm, over that of the next smaller one."""

SIZES = (100, 1000)
_SETTLING = 200  # steps before the clock starts


def measure(short: bool = False, sizes: tuple[int, ...] = SIZES) -> dict[str, Any]:
    """The team of `paper`, and swarms of tilted hexarotors with lagged, limited rotors, in wind and disturbances.

    Args:
        short: fewer repetitions.
        sizes: of the swarms.

    Returns:
        `worlds`: for each the number of vehicles, steps a second and times in us of a step, see `measure_world`;
        `growth`: cost per vehicle of the last world over that of the last but one.
    """
    repetitions = 10 if short else 40
    worlds = [measure_world(mjsheaf.load_scenario("paper"), 100, 3 * repetitions)]
    for size in sizes:
        worlds.append(measure_world(swarm(size), 100, max(3, repetitions * 100 // max(size, 100))))
    per_vehicle = [world["step_us"] / world["vehicles"] for world in worlds]
    return {"worlds": worlds, "growth": per_vehicle[-1] / per_vehicle[-2]}


def measure_world(scenario: Scenario, steps: int, repetitions: int) -> dict[str, Any]:
    """Time steps of one world.

    The bare step starts from a copy of the state that the closed loop has just reached, with its commands and forces
    held. Lag and limits are the engine's own, and in both. The model is the one that `run` steps, without what is only
    to be seen; with that, as a World has it unless told otherwise, both steps are slower and their ratio is smaller.

    Args:
        scenario: the scenario.
        steps: steps at a time.
        repetitions: how many times.
    """
    world = World(scenario, visible=False)
    world.step(_SETTLING)
    model, data = world.model, world.data
    twin = mujoco.MjData(model)

    turns = []
    for _ in range(repetitions):
        mujoco.mj_copyData(twin, model, data)
        bare = cpu_time(lambda: mujoco.mj_step(model, twin, steps))
        turns.append((cpu_time(lambda: world.step(steps)), bare))
    return {
        "scenario": scenario.name,
        "vehicles": len(world.arena.vehicles),
        "thrusters": int(model.nu),
        "step_us": 1e6 * min(ours for ours, _ in turns) / steps,
        "bare_us": 1e6 * min(bare for _, bare in turns) / steps,
        "ratio": median(ours / bare for ours, bare in turns),
    }


def rows(figures: dict[str, Any]) -> list[Row]:
    """The figures of `measure` against what is wanted."""
    table = [
        at_most(
            "loop",
            f"step of {world['scenario']}, {world['vehicles']} vehicles, us",
            world["step_us"],
            world["bare_us"],
            world["ratio"],
            OVERHEAD,
            "bare mj_step",
        )
        for world in figures["worlds"]
    ]
    small, large = figures["worlds"][-2:]
    table.append(
        at_most(
            "loop",
            f"the same per vehicle, {large['vehicles']} against {small['vehicles']}",
            large["step_us"] / large["vehicles"],
            small["step_us"] / small["vehicles"],
            figures["growth"],
            GROWTH,
        )
    )
    return table
