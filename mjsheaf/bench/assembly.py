"""Putting a thousand vehicles into one model: the scenario, the system, and the world with MuJoCo's compiler."""

from time import perf_counter
from typing import Any

from mjsheaf.bench.rows import Row, at_most
from mjsheaf.bench.swarm import swarm
from mjsheaf.simulation.loop import World

WANTED_S = 6.0


def measure(short: bool = False, size: int = 1000) -> dict[str, Any]:
    """Time each stage once, by the wall; compiled loops are compiled before.

    Args:
        short: no difference; it is one pass.
        size: number of vehicles.

    Returns:
        `vehicles`; in s: `scenario_s` (checking what is written), `system_s` (sheaf and law), `world_s` (bodies and
        MuJoCo's compiler, first commands), `total_s` of the three.
    """
    World(swarm(4)).step(1)
    clock = [perf_counter()]
    scenario = swarm(size)
    clock.append(perf_counter())
    system = scenario.system
    clock.append(perf_counter())
    world = World(system)
    clock.append(perf_counter())
    return {
        "vehicles": len(world.arena.vehicles),
        "scenario_s": clock[1] - clock[0],
        "system_s": clock[2] - clock[1],
        "world_s": clock[3] - clock[2],
        "total_s": clock[3] - clock[0],
    }


def rows(figures: dict[str, Any]) -> list[Row]:
    """The figures of `measure` against what is wanted."""
    total = figures["total_s"]
    what = f"scenario to world, {figures['vehicles']} vehicles, s"
    return [at_most("assembly", what, total, WANTED_S, total / WANTED_S, 1.0, "wanted time")]
