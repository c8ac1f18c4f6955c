"""Vehicle-steps per second of a closed loop, beside what others reach; a peer that is installed is measured too.

Each simulator runs its own loop, with its own controller on: 500 physics steps and 100 commands a second of ours and
of crazyflow, 240 and 48 of gym-pybullet-drones. The peers' part needs neither MuJoCo of ours nor numba, so that it can
be run by the Python of an environment in which a peer is installed: see benchmarks/peers.py.
"""

from collections.abc import Callable
from importlib.util import find_spec
from time import perf_counter
from typing import Any

import numpy as np

from mjsheaf.bench.clock import best_wall
from mjsheaf.bench.rows import Row, at_least, informs

SIZES = (13, 100)

MEASURED_ELSEWHERE = {
    "crazyflow": {13: 2.9e5, 100: 1.5e6},
    "gym_pybullet_drones": {13: 2.5e4, 100: 2.5e4},
}
"""Vehicle-steps per second of crazyflow 0.4.0 and gym-pybullet-drones 2.1 on a machine of two cores without a GPU."""

WANTED = {"crazyflow": {13: 4.0, 100: 1.0}, "gym_pybullet_drones": {13: 40.0, 100: 40.0}}

VEHICLE = "quadrotor"


def measure(short: bool = False, sizes: tuple[int, ...] = SIZES) -> dict[str, Any]:
    """Ours, and each peer that can be imported here.

    Args:
        short: fewer repetitions.
        sizes: numbers of vehicles.

    Returns:
        `mjsheaf`, `bare` (mj_step of the same model) and each peer that is here: vehicle-steps per second for each
        size, as text to number.
    """
    repetitions = 5 if short else 20
    rates = {str(size): our_rates(size, repetitions) for size in sizes}
    found = {name: {size: rate[k] for size, rate in rates.items()} for k, name in enumerate(("mjsheaf", "bare"))}
    return found | measure_peers(sizes, repetitions)


def measure_peers(sizes: tuple[int, ...] = SIZES, repetitions: int = 5) -> dict[str, dict[str, float]]:
    """Each peer that can be imported by this Python; see `measure`."""
    return {
        name: {str(size): rate(size, repetitions) for size in sizes}
        for name, rate in PEERS.items()
        if find_spec(name) is not None
    }


def our_rates(size: int, repetitions: int) -> tuple[float, float]:
    """Vehicle-steps per second of `World.step`, and of bare `mj_step`: quadrotors that follow another in wind."""
    from mjsheaf.bench.swarm import swarm
    from mjsheaf.engine import mujoco
    from mjsheaf.simulation.loop import World

    # The target is a vehicle too. No disturbance, as peers have none; wind there is.
    rates = {"physics__timestep": 0.002, "controller__control_period": 0.01}
    world = World(swarm(size - 1, VEHICLE, **rates, disturbance__agents__bound=0.0), visible=False)
    closed = _rate(size, lambda: world.step(500), 500, repetitions)
    return closed, _rate(size, lambda: mujoco.mj_step(world.model, world.data, 50), 50, repetitions)


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
    """Vehicle-steps per second by the wall's clock, ours as well as those of peers with threads of their own."""
    begun = perf_counter()
    work()  # compiles
    while perf_counter() - begun < 0.2:
        work()
    return size * steps / best_wall(work, repetitions)


def rows(figures: dict[str, Any]) -> list[Row]:
    """The figures of `measure` against what is wanted: peers measured here where they are installed."""
    table = [
        informs("peers", f"{size} quadrotors, vehicle-steps/s", rate, figures["bare"][size], "bare mj_step")
        for size, rate in figures["mjsheaf"].items()
    ]
    for peer, elsewhere in MEASURED_ELSEWHERE.items():
        for size, known in elsewhere.items():
            if str(size) not in figures["mjsheaf"]:
                continue
            here = figures.get(peer, {}).get(str(size))
            ours, theirs = figures["mjsheaf"][str(size)], here or known
            note = f"{peer}, measured {'here' if here else 'elsewhere'}"
            what = f"{size} quadrotors, vehicle-steps/s"
            table.append(at_least("peers", what, ours, theirs, ours / theirs, WANTED[peer][size], note))
    return table
