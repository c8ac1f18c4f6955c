"""Warnings about valid but suspicious values: an angle that was written in radians. `check` and `run` print them."""

import math

from mjsheaf.errors import listed
from mjsheaf.scenario.scenario import Agent, Scenario, Target
from mjsheaf.vehicles.steering import ThrustVector
from mjsheaf.vehicles.vehicle import Vehicle

_LEAST_TILT = 2.0  # degrees; a multirotor that tilts less hardly moves, and 2 rad would not be a tilt


def slips_of(scenario: Scenario) -> list[str]:
    """Return a warning for each suspicious value in a scenario and its vehicles, in sentences."""
    vehicles = {id(vehicle): vehicle for vehicle in scenario.system.vehicles}
    return [*_headings(scenario), *(slip for vehicle in vehicles.values() for slip in slips_of_vehicle(vehicle))]


def slips_of_vehicle(vehicle: Vehicle) -> list[str]:
    """Return a warning for each suspicious value in a vehicle's description, in sentences."""
    if not isinstance(vehicle.steering, ThrustVector) or vehicle.steering.largest_tilt >= _LEAST_TILT:
        return []
    tilt = vehicle.steering.largest_tilt
    return [
        f"steering.largest_tilt of {vehicle.name} is {tilt:g} degrees, so that it hardly leans; "
        f"{tilt:g} rad are {math.degrees(tilt):.3g} degrees"
    ]


def _headings(scenario: Scenario) -> list[str]:
    """Headings that look like radians: within a turn in rad, and at least half of those that are not whole numbers."""
    members: list[Agent | Target] = [*scenario.agents, *scenario.targets]
    broken = {m.id: m.heading for m in members if m.heading is not None and not m.heading.is_integer()}
    small = {name: heading for name, heading in broken.items() if abs(heading) <= 2.0 * math.pi + 0.01}
    if 2 * len(small) < len(broken) or not small:  # headings all around are degrees, and some of them are small
        return []
    heading = next(iter(small.values()))
    example = f"{heading:g} rad are {math.degrees(heading):.4g} degrees"
    return [f"headings are in degrees, and of {listed(small)} they look like radians: {example}"]
