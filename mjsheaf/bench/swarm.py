"""The scenario `swarm` in any size, to measure with."""

from typing import Any

from mjsheaf.scenario import Scenario, load_scenario


def swarm(size: int, vehicle: str = "hexarotor", **overrides: Any) -> Scenario:
    """`size` vehicles that follow another in wind, and shake.

    Args:
        size: number of agents; the target is one vehicle more.
        vehicle: name in models/.
        overrides: field to value, with __ for the dots of `--set`.
    """
    changes = {field.replace("__", "."): value for field, value in overrides.items()}
    return load_scenario("swarm", {"swarm.size": size, "swarm.vehicle": vehicle, **changes})
