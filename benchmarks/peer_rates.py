"""Measure vehicle-steps per second of peers, by this file alone: `PYTHON peer_rates.py SIZE... [--short]`.

It prints one JSON object, of those that can be imported, by name and number of vehicles, and needs nothing of mjsheaf:
most peers want other versions of its libraries, and live in environments of their own. Each runs its own closed loop:
crazyflow at 500 physics steps and 100 commands a second, gym-pybullet-drones at 240 and 48. Where JAX has a GPU,
`--device gpu --world 1` measures crazyflow there, with a drone in each world.
"""

import argparse
import json
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from time import perf_counter
from typing import Any

import numpy as np

MOST_IN_A_WORLD = 1000
"""Drones of crazyflow in one world; more are in several, side by side. Of one with ten thousand it lists all pairs of
geoms, in Python, and was not ready after twenty minutes."""


def crazyflow_rate(size: int, repetitions: int, device: str = "cpu", largest: int = MOST_IN_A_WORLD) -> float:
    """Measure vehicle-steps per second of crazyflow on a device of JAX: hover in still air by position commands.

    More drones than `largest` are in several worlds, of as many each.
    """
    import jax
    from crazyflow.control import Control
    from crazyflow.sim import Sim

    worlds = -(-size // largest)
    drones = -(-size // worlds)
    sim = Sim(worlds, drones, control=Control.state, freq=500, state_freq=100, device=device)
    sim.reset()
    command = np.zeros((worlds, drones, 16), dtype=np.float32)  # position, velocity, acceleration, quaternion, rates
    command[..., :3] = np.asarray(sim.data.states.pos)
    command[..., 2] += 0.5
    command[..., 12] = 1.0
    on_device = jax.device_put(command, jax.devices(device)[0])

    def second() -> None:
        for _ in range(100):
            sim.state_control(on_device)
            sim.step(5)
        jax.block_until_ready(sim.data.states.pos)

    return _rate(worlds * drones, second, 500, repetitions)


def gym_pybullet_drones_rate(size: int, repetitions: int) -> float:
    """Measure vehicle-steps per second of gym-pybullet-drones: hover by its PID controllers, contacts on."""
    from gym_pybullet_drones.control.DSLPIDControl import DSLPIDControl
    from gym_pybullet_drones.envs.CtrlAviary import CtrlAviary
    from gym_pybullet_drones.utils.enums import DroneModel, Physics

    side = int(np.ceil(size**0.5))
    place = np.array([[k % side, k // side, 1.0] for k in range(size)])
    env = CtrlAviary(
        drone_model=DroneModel.CF2X,
        num_drones=size,
        initial_xyzs=place,
        physics=Physics.PYB,
        pyb_freq=240,
        ctrl_freq=48,
        gui=False,
    )
    controllers = [DSLPIDControl(drone_model=DroneModel.CF2X) for _ in range(size)]
    env.reset()
    action = np.zeros((size, 4))

    def quarter() -> None:
        for _ in range(12):
            state = env.step(action)[0]
            for k, controller in enumerate(controllers):
                action[k], _, _ = controller.computeControlFromState(
                    control_timestep=env.CTRL_TIMESTEP, state=state[k], target_pos=place[k] + [0.0, 0.0, 0.5]
                )

    rate = _rate(size, quarter, 60, min(repetitions, 3))
    env.close()
    return rate


PEERS: dict[str, Callable[[int, int], float]] = {
    "crazyflow": crazyflow_rate,
    "gym_pybullet_drones": gym_pybullet_drones_rate,
}


LARGEST = {"crazyflow": 1000, "gym_pybullet_drones": 100}
"""Most vehicles of a peer in the short version: preparing more takes crazyflow half a minute again."""


def _rate(size: int, work: Callable[[], Any], steps: int, repetitions: int) -> float:
    """Return vehicle-steps per second by the clock, the best of many, as peers have threads of their own."""
    begun = perf_counter()
    work()  # compiles
    while perf_counter() - begun < 0.2:
        work()
    seconds = []
    for _ in range(repetitions):
        begun = perf_counter()
        work()
        seconds.append(perf_counter() - begun)
    return size * steps / min(seconds)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("sizes", type=int, nargs="+")
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--device", choices=("cpu", "gpu"), default="cpu", help="where crazyflow runs")
    parser.add_argument("--world", type=int, default=MOST_IN_A_WORLD, help="most drones of crazyflow in one world")
    asked = parser.parse_args()
    rates: dict[str, dict[int, float]] = {}
    on_device = partial(crazyflow_rate, device=asked.device, largest=asked.world)
    for name, rate in (PEERS | {"crazyflow": on_device}).items():
        if find_spec(name) is not None:
            sizes = [size for size in asked.sizes if not asked.short or size <= LARGEST[name]]
            rates[name] = {size: rate(size, 5 if asked.short else 20) for size in sizes}
    print(json.dumps(rates))
