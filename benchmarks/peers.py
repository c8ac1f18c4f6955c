"""Measure vehicle-steps per second of peers, and print one JSON object: python benchmarks/peers.py [--short].

`mjsheaf bench peers` measures ours beside figures of peers from another machine; this measures those that the Python
which runs it can import. It needs nothing of mjsheaf: most peers want other versions of its libraries, and live in
environments of their own. Each runs its own closed loop: crazyflow at 500 physics steps and 100 commands a second,
gym-pybullet-drones at 240 and 48.
"""

import argparse
import json
from collections.abc import Callable
from importlib.util import find_spec
from time import perf_counter
from typing import Any

import numpy as np

SIZES = (13, 100)


def crazyflow_rate(size: int, repetitions: int) -> float:
    """Vehicle-steps per second of crazyflow on this processor: hover in still air by position commands."""
    import jax
    from crazyflow.control import Control
    from crazyflow.sim import Sim

    sim = Sim(n_drones=size, control=Control.state, freq=500, state_freq=100, device="cpu")
    sim.reset()
    command = np.zeros((1, size, 16), dtype=np.float32)  # position, velocity, acceleration, quaternion, rates
    command[..., :3] = np.asarray(sim.data.states.pos)
    command[..., 2] += 0.5
    command[..., 12] = 1.0

    def second() -> None:
        for _ in range(100):
            sim.state_control(command)
            sim.step(5)
        jax.block_until_ready(sim.data.states.pos)

    return _rate(size, second, 500, repetitions)


def gym_pybullet_drones_rate(size: int, repetitions: int) -> float:
    """Vehicle-steps per second of gym-pybullet-drones: hover by its PID controllers, contacts on."""
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


def _rate(size: int, work: Callable[[], Any], steps: int, repetitions: int) -> float:
    """Vehicle-steps per second by the wall's clock, the best of many, as peers have threads of their own."""
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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="fewer repetitions")
    repetitions = 5 if parser.parse_args().short else 20
    found = {name: rate for name, rate in PEERS.items() if find_spec(name) is not None}
    print(
        json.dumps({name: {size: rate(size, repetitions) for size in SIZES} for name, rate in found.items()}, indent=2)
    )
