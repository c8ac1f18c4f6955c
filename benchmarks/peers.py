"""Vehicle-steps per second of a closed loop, next to those of other simulators: `make bench TOPICS=peers`."""

import json
import subprocess
import sys
from functools import partial
from itertools import product
from pathlib import Path

from benchmarks import peer_rates
from benchmarks.measuring import Row, at_least, best, informs, swarm
from mjsheaf.errors import InputError
from mjsheaf.loop.fused import Fused
from mjsheaf.loop.mujoco_engine import World
from mjsheaf.loop.session import ENGINES
from mjsheaf.loop.system import on_engine
from mjsheaf.scenario import Scenario
from mjsheaf.threads import usable_processors

PEERS = {
    "crazyflow": {13: 2.9e5, 100: 1.5e6, 1000: 3.6e6},
    "gym_pybullet_drones": {13: 2.5e4, 100: 2.5e4},
}
"""Vehicle-steps per second of crazyflow 0.4.0 and gym-pybullet-drones 2.1 on a machine of two cores without a GPU, by
number of vehicles, for use where they cannot be measured in the same run."""

_OVER_PEERS = {
    ("mujoco", "crazyflow"): {13: 4.0, 100: 1.0},
    ("fused", "crazyflow"): {13: 10.0, 100: 4.0, 1000: 2.5},
    ("mujoco", "gym_pybullet_drones"): {13: 40.0, 100: 40.0},
}
"""Required ratio of our speed to theirs."""


def _quadrotors(size: int) -> Scenario:
    """Return a scenario of `size` quadrotors in wind, one of which the others follow.

    500 physics steps and 100 commands a second; no disturbance, as peers have none.
    """
    rates = {"physics__timestep": 0.002, "controller__control_period": 0.01}
    return swarm(size - 1, "quadrotor", **rates, disturbance__agents__bound=0.0)


def peers(
    short: bool = False, sizes: tuple[int, ...] = (13, 100, 1000, 10_000), python: str | None = None
) -> list[Row]:
    """Measure vehicle-steps per second of a closed loop and of peers: quadrotors that follow another in wind.

    Each simulator runs its own loop with its own controller on: 500 physics steps and 100 commands a second of ours and
    of crazyflow, 240 and 48 of gym-pybullet-drones. Peers and the fused engine may use every core, MuJoCo's one.

    Args:
        short: True to leave out MuJoCo's largest teams, with fewer repetitions.
        sizes: Numbers of vehicles.
        python: Python that has peers installed, which are measured before ours; None takes this one.
    """
    count, repetitions = usable_processors(), 5 if short else 20
    known = {
        name: {size: (rate, "measured elsewhere") for size, rate in rates.items()} for name, rates in PEERS.items()
    }
    for name, rates in measured_peers(python or sys.executable, sizes, short).items():
        known[name] |= {size: (rate, "measured in this run") for size, rate in rates.items()}
    rows = []
    for size, engine in product(sizes, ENGINES):
        if engine == "mujoco" and size > (100 if short else 1000):
            continue
        rate = _rate(size, engine, count, repetitions)
        what = f"{size} quadrotors by {engine}, vehicle-steps/s"
        for peer, by_size in known.items():
            if size not in by_size:
                continue
            (theirs, where), wanted = by_size[size], _OVER_PEERS.get((engine, peer), {}).get(size)
            note = f"{peer}, {where}"
            if peer == "crazyflow" and size > peer_rates.MOST_IN_A_WORLD:
                note += f", in worlds of {peer_rates.MOST_IN_A_WORLD}"
            if wanted:
                rows.append(at_least("peers", what, rate, theirs, rate / theirs, wanted, note))
            else:
                rows.append(informs("peers", what, rate, theirs, note))
        if not any(size in by_size for by_size in known.values()):
            rows.append(informs("peers", what, rate, note="no peer is known"))
    return rows


def _rate(size: int, engine: str, count: int, repetitions: int) -> float:
    """Vehicle-steps per second of quadrotors: by the fused engine on `count` threads, by MuJoCo on one."""
    steps, warming = max(50, 200_000 // size), max(50, 500_000 // size)  # after which clocks no longer rise
    if engine == "mujoco":
        world = World(_quadrotors(size), visible=False)
        world.step(warming)
        return size * steps / best(partial(world.step, steps), repetitions)
    with Fused(on_engine(_quadrotors(size).phases, engine, count)) as bodies:
        bodies.step(warming)
        return size * steps / best(partial(bodies.step, steps), repetitions)


def measured_peers(python: str, sizes: tuple[int, ...], short: bool) -> dict[str, dict[int, float]]:
    """Vehicle-steps per second of the peers that another Python has, by name and number of vehicles.

    Raises:
        InputError: there is no such Python, or it fails.
    """
    script = [str(Path(peer_rates.__file__)), *map(str, sizes), *["--short"] * short]
    try:
        done = subprocess.run([python, *script], capture_output=True, text=True, check=False)
    except OSError as error:
        raise InputError(f"--peers {python}: {error.strerror}; expected a Python that has peers installed") from None
    if done.returncode:
        raise InputError(f"--peers {python}: {' '.join(done.stderr.split())[-300:]}")
    try:
        found: dict[str, dict[str, float]] = json.loads(done.stdout.splitlines()[-1])
        return {name: {int(size): float(rate) for size, rate in rates.items()} for name, rates in found.items()}
    except (IndexError, ValueError, AttributeError, TypeError):
        raise InputError(f"--peers {python}: prints no rates; expected a Python that has peers installed") from None
