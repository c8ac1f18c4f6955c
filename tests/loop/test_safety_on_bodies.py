"""Vehicles of every kind that exchange places do not touch: the filter's margins cover how bodies lag behind commands.

The radius of a vehicle is that of a sphere about it. `MJSHEAF_EXCHANGES=200` tries more.
"""

import os
from typing import Any

import numpy as np
import pytest

from mjsheaf import Scenario, Session, simulate
from mjsheaf.loop.linear import HeldPoint, linearise, step_responses
from mjsheaf.vehicles.loading import list_vehicles
from tests.builders import build_scenario

PASSIVE = {"buoy"}
PLANAR = ["hull", "otter", "otter_rudder", "wamv", "wamv_azimuth"]
SPATIAL = ["aerial", "crazyflie", "hexarotor", "quadrotor", "submersible", "x500"]
WITHOUT_MODEL = {"otter_rudder", "wamv_azimuth"}
SEEDS = range(int(os.environ.get("MJSHEAF_EXCHANGES", "5")))


def places(rng: np.random.Generator, n: int, dimension: int) -> Any:
    """Random places apart from one another, shape (n, dimension), m."""
    gap = 20.0 if dimension == 2 else 12.0
    found: list[Any] = []
    while len(found) < n:
        size = gap * n ** (1 / dimension)
        place = rng.uniform(-size, size, dimension)
        if dimension == 3:
            place[2] = 40.0 + 0.3 * place[2]
        if all(np.linalg.norm(place - other) >= gap for other in found):
            found.append(place)
    return np.array(found)


def exchange(seed: int) -> Scenario:
    """A team of random vehicles, each on its way to a random place."""
    rng = np.random.default_rng(seed)
    dimension, n = int(rng.integers(2, 4)), int(rng.integers(4, 11))
    kinds = rng.choice(PLANAR if dimension == 2 else SPATIAL, n)
    starts, goals = places(rng, n, dimension), places(rng, n, dimension)
    agents = {
        f"A{k}": {
            "position": starts[k].tolist(),
            "velocity_limit": float(rng.uniform(0.5, 2.0)),
            "vehicle": str(kinds[k]),
            "heading": float(rng.uniform(-180.0, 180.0)),
        }
        for k in range(n)
    }
    period = float(rng.choice([0.02, 0.05, 0.1]))
    safety = {
        "distance": "size",
        "rate": float(rng.choice([0.3, 1.0])),
        "tie_break": str(rng.choice(["none", "right_hand"])),
        "authority": str(rng.choice(["equal", "by_speed"])),
    }
    return anchored(agents, goals.tolist(), time=60.0, law={"gain": 0.3, "control_period": period}, safety=safety)


def anchored(agents: dict[str, Any], goals: list[Any], time: float, law: dict[str, Any], safety: Any) -> Scenario:
    """A team whose agents are each anchored at a place."""
    anchors = [
        {"agent": id, "axes": list("xyz"[: len(goal)]), "value": goal} for id, goal in zip(agents, goals, strict=True)
    ]
    return build_scenario(agents, {}, [], anchors=anchors, time={"end": time}, controller=law, safety=safety)


def test_every_vehicle_takes_part() -> None:
    assert {*PLANAR, *SPATIAL} | PASSIVE == set(list_vehicles())


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("seed", SEEDS)
def test_no_pair_touches(seed: int) -> None:
    scenario = exchange(seed)
    run = simulate(scenario, engine="fused", threads=1)
    assert run.status == "finished"
    x = np.nan_to_num(run.agent_position.values)
    radius = scenario.whole.vehicle_radii[: x.shape[1]]
    first, second = np.triu_indices(x.shape[1], 1)
    gaps = np.linalg.norm(x[:, first] - x[:, second], axis=2) - radius[first] - radius[second]
    assert gaps.min() > 0.0


def alone(vehicle: str, speed: float) -> Scenario:
    """One vehicle that keeps a distance."""
    place = [0.0, 0.0] if vehicle in PLANAR else [0.0, 0.0, 40.0]
    agent = {"position": place, "velocity_limit": speed, "vehicle": vehicle}
    law = {"gain": 0.5, "control_period": 0.05}
    return anchored({"A": agent}, [place], time=30.0, law=law, safety={"distance": 1.0})


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", [*PLANAR, *SPATIAL])
@pytest.mark.parametrize("speed", [0.5, 1.5])
def test_no_commands_bring_a_vehicle_past_its_margin(vehicle: str, speed: float) -> None:
    """From its top speed a vehicle comes to rest within its margin.

    Likewise from the worst that `stopping_time` allows: commands that change sign as the difference of step responses.

    At 1.5 m/s, such commands saturate the hexarotor's rotors and the Otter's thrusters: the way to a stop is within the
    margin even so, but not how far they are from where their commands alone would have moved them.
    """
    scenario = alone(vehicle, speed)
    system = scenario.whole
    (model,) = linearise(
        [HeldPoint(system.vehicles[0], np.zeros(3), 0.0)], system.control, system.timestep, system.steps_per_sample
    )
    assert isinstance(model, str) == (vehicle in WITHOUT_MODEL)
    margin = system.safety_margins[0]
    session = Session(scenario, engine="fused", commanded=True)
    for axis, along in enumerate(np.eye(3)[: system.vehicles[0].dimension]):
        commands = [np.ones(300)]
        if not isinstance(model, str):
            s = step_responses(model, system.grid.period)[:, axis, axis]
            before = min(len(s) // 2, 250)
            later = max(range(1, before), key=lambda i: np.abs(s[i : before + i] - s[:before]).sum())
            commands += [np.sign(s[later : before + later] - s[:before]), np.sign(1.0 - s[:before])]
        for signs in commands:
            session.reset()
            ahead, start = np.zeros(3), session.observe().truth.positions[0].copy()
            for sign in signs[::-1]:
                session.step(speed * sign * along[None])
                ahead += system.grid.period * speed * sign * along
            stop = session.observe().truth.positions[0].copy()
            assert speed > 1.0 or isinstance(model, str) or abs((start + ahead - stop) @ along) < margin
            farthest = 0.0
            for _ in range(200):
                session.step(np.zeros((1, 3)))
                farthest = max(farthest, float(abs((session.observe().truth.positions[0] - stop) @ along)))
            assert (signs != 1.0).any() or 0.4 * speed * system.vehicles[0].reduced_model().tau.min() < farthest
            assert farthest < margin
