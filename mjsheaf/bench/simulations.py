"""Speed of simulations in this process: the published run, steps of bodies, threads, assembly, and peers."""

from functools import partial
from statistics import median
from time import perf_counter, thread_time

import mjsheaf
from mjsheaf.bench import WANTED, Row, at_least, at_most, best, elapsed, informs, swarm, timed
from mjsheaf.engine import mujoco
from mjsheaf.scenario import Scenario
from mjsheaf.simulation.fused import Fused
from mjsheaf.simulation.ideal import run_ideal
from mjsheaf.simulation.physics import run_physics
from mjsheaf.simulation.world import World
from mjsheaf.system import on_engine, phases_of
from mjsheaf.threads import usable_processors

AUTHORS_S = 38.0
"""The paper's own code, which calls scipy for each agent and step, on a machine of two cores."""

PEERS = {
    "crazyflow": {13: (2.9e5, 4.0), 100: (1.5e6, 1.0)},
    "gym_pybullet_drones": {13: (2.5e4, 40.0), 100: (2.5e4, 40.0)},
}
"""Vehicle-steps per second of crazyflow 0.4.0 and gym-pybullet-drones 2.1 on a machine of two cores without a GPU, by
number of vehicles, and what ours are wanted to be over that. benchmarks/peers.py measures them where they are."""

FUSED_PEERS = {13: (2.9e5, 10.0), 100: (1.5e6, 4.0), 1000: (3.6e6, 2.5)}
"""The same of crazyflow 0.4.0, which takes both cores, for the fused engine on as many."""

_GAINS = (5.0, 8.0, 10.0, 12.0)


def ideal(short: bool = False, end: float | None = None) -> list[Row]:
    """The published run on ideal kinematics: 4,998 held steps of 17 vehicles at a relative tolerance of 1e-9.

    It may end earlier, at `end`, s.
    """
    scenario = mjsheaf.load_scenario("paper", {} if end is None else {"time.end": end})
    system = scenario.system
    mjsheaf.simulate(scenario, backend="ideal")  # compiles
    repetitions = 5 if short else 20
    run = best(lambda: run_ideal(system), repetitions, thread_time)
    simulate = best(lambda: mjsheaf.simulate(scenario, backend="ideal"), repetitions, thread_time)
    what = f"published run, {system.grid.steps} steps, s"
    return [
        at_most("ideal", what, run, WANTED["ideal"], run / WANTED["ideal"], 1.0, "wanted time"),
        informs("ideal", "simulate() of it, s", simulate, AUTHORS_S, "the authors' code"),
    ]


def loop(short: bool = False, sizes: tuple[int, ...] = (100, 1000)) -> list[Row]:
    """What closing the loop costs: `World.step(n)` against bare `mj_step` of the same model from the same state.

    The team of `paper`, and swarms (of at least two sizes) of tilted hexarotors with lagged, limited rotors, in wind
    and disturbances.
    """
    repetitions = 10 if short else 40
    rows = [_step(mjsheaf.load_scenario("paper"), 3 * repetitions)]
    rows += [_step(swarm(size), max(3, repetitions * 100 // max(size, 100))) for size in sizes]
    small, large = ((row.ours or 0.0) / (size + 1) for row, size in zip(rows[-2:], sizes[-2:], strict=True))
    what = f"the same per vehicle, {sizes[-1] + 1} against {sizes[-2] + 1}"
    return [*rows, at_most("loop", what, large, small, large / small, WANTED["swarm growth"])]


def _step(scenario: Scenario, repetitions: int, steps: int = 100) -> Row:
    """Time steps of one world, in us of a step.

    The bare step starts from a copy of the state that the closed loop has just reached, with its commands and forces
    held. Lag and limits are the engine's own, and in both. The model is the one that `run` steps, without what is only
    to be seen; with that, as a World has it unless told otherwise, both steps are slower and their ratio is smaller.
    """
    world = World(scenario, visible=False)
    world.step(200)  # before the clock starts
    model, twin = world.model, mujoco.MjData(world.model)
    turns = []
    for _ in range(repetitions):
        mujoco.mj_copyData(twin, model, world.data)
        bare = elapsed(lambda: mujoco.mj_step(model, twin, steps))
        turns.append((elapsed(lambda: world.step(steps)), bare))
    closed, bare = (1e6 * min(times) / steps for times in zip(*turns, strict=True))
    ratio = median(ours / bare for ours, bare in turns)
    what = f"step of {scenario.name}, {len(world.arena.vehicles)} vehicles, us"
    return at_most("loop", what, closed, bare, ratio, WANTED["loop"], "bare mj_step")


def fused(short: bool = False, sizes: tuple[int, ...] = (100, 1000, 10_000), peers: bool = True) -> list[Row]:
    """The fused engine: a step per vehicle, threads, the published run on bodies beside MuJoCo's, and quadrotors.

    Swarms are those of `loop`; the short version does without the last. Whether to measure the quadrotors says `peers`.
    """
    repetitions, count = 10 if short else 40, usable_processors()
    rows = [row for size in sizes[: 2 if short else None] for row in _fused_swarm(size, count, repetitions)]
    system, bound = mjsheaf.load_scenario("paper").system, WANTED["fused run"]
    (phase,) = on_engine(phases_of(system), "fused")
    run_physics(phase.system)  # compiles
    run = best(lambda: run_physics(phase.system), repetitions, thread_time)
    theirs = best(lambda: run_physics(system), max(2, repetitions // 10), thread_time)
    steps = system.grid.steps * round(system.grid.period / system.bodies.timestep)
    what = f"published run on bodies, {steps} steps, s"
    rows.append(at_most("fused", what, run, bound, run / bound, 1.0, "wanted time"))
    rows.append(informs("fused", "the same beside MuJoCo's, s", run, theirs, "by MuJoCo"))
    for size, (known, wanted) in FUSED_PEERS.items() if peers else ():
        bodies = Fused(on_engine(_quadrotors(size).phases, "fused", count))
        bodies.step(5000)
        rate = size * 500 / best(partial(bodies.step, 500), repetitions)
        what = f"{size} quadrotors, vehicle-steps/s, {count} threads"
        rows.append(at_least("fused", what, rate, known, rate / known, wanted, "crazyflow, measured elsewhere"))
    return rows


def _fused_swarm(size: int, count: int, repetitions: int) -> list[Row]:
    """Time steps of one swarm per vehicle, in ns: on one thread, and on `count`."""
    phases, steps, bound = swarm(size).phases, max(20, 100_000 // size), WANTED["fused"]
    one, several = (partial(Fused(on_engine(phases, "fused", n)).step, steps) for n in (1, count))
    one()  # compiles
    several()
    own = 1e9 / (steps * (size + 1))
    alone = own * best(one, repetitions, thread_time)
    what = f"{size + 1} tilted hexarotors, a vehicle and step, ns"
    rows = [at_most("fused", what, alone, bound, alone / bound, 1.0, "wanted time")]
    if count > 1 and size >= 1000:
        turns = [(elapsed(one, perf_counter), elapsed(several, perf_counter)) for _ in range(repetitions)]
        single, together = (own * min(times) for times in zip(*turns, strict=True))
        speedup = median(a / b for a, b in turns)
        wanted = WANTED["fused threads"] * count
        rows.append(
            at_least("fused", f"the same, {count} threads, ns", together, single, speedup, wanted, "one thread")
        )
    return rows


def _quadrotors(size: int) -> Scenario:
    """So many quadrotors, of which one is followed, in wind: 500 physics steps and 100 commands a second.

    No disturbance, as peers have none.
    """
    rates = {"physics__timestep": 0.002, "controller__control_period": 0.01}
    return swarm(size - 1, "quadrotor", **rates, disturbance__agents__bound=0.0)


def threads(short: bool = False, ends: tuple[float, float] = (49.99, 20.0)) -> list[Row]:
    """Runs of `paper` with different gains: `simulate_many` on threads against one at a time, bit for bit the same.

    Those on ideal kinematics and on bodies have `ends` of their own, s.
    """
    count = min(usable_processors(), len(_GAINS))
    rows = []
    for backend, end in zip(("ideal", "physics"), ends, strict=True):
        scenarios = [mjsheaf.load_scenario("paper", {"controller.gain": gain, "time.end": end}) for gain in _GAINS]
        mjsheaf.simulate(scenarios[0], backend=backend)  # compiles
        simulate = partial(mjsheaf.simulate_many, scenarios, backend)
        turns = []
        for _ in range(3 if short else 8):
            alone, single = timed(partial(simulate, workers=1))
            together, several = timed(partial(simulate, workers=count))
            turns.append((single, several))
        same = all(a.identical(b) for a, b in zip(alone, together, strict=True))  # type: ignore[union-attr, arg-type]
        note = "one thread" if same else "one thread; the results DIFFER"
        what = f"{len(scenarios)} runs on {backend}, {count} threads, s"
        single, several = (min(times) for times in zip(*turns, strict=True))
        speedup = median(a / b for a, b in turns)
        if count == 1:
            rows.append(informs("threads", what, several, single, "one processor only"))
        else:
            rows.append(at_least("threads", what, several, single, speedup, WANTED["speed-up"] * count, note))
    return rows


def assembly(short: bool = False, size: int = 1000) -> list[Row]:
    """Putting agents into one model: scenario, sheaf and law, bodies with MuJoCo's compiler; once, by the wall."""
    World(swarm(4)).step(1)  # compiles
    total, wanted = elapsed(lambda: World(swarm(size)), perf_counter), WANTED["assembly"]
    what = f"scenario to world, {size + 1} vehicles, s"
    return [at_most("assembly", what, total, wanted, total / wanted, 1.0, "wanted time")]


def peers(short: bool = False, sizes: tuple[int, ...] = (13, 100)) -> list[Row]:
    """Vehicle-steps per second of a closed loop, beside what others reach: quadrotors that follow another in wind.

    Each simulator runs its own loop with its own controller on: 500 physics steps and 100 commands a second of ours and
    of crazyflow, 240 and 48 of gym-pybullet-drones. `sizes` are numbers of vehicles.
    """
    rows = []
    for size in sizes:
        world = World(_quadrotors(size), visible=False)
        world.step(5000)  # a second of work, after which clocks no longer rise
        repetitions = 5 if short else 20
        ours = size * 500 / best(lambda w=world: w.step(500), repetitions)  # type: ignore[misc]
        bare = size * 50 / best(lambda w=world: mujoco.mj_step(w.model, w.data, 50), repetitions)  # type: ignore[misc]
        what = f"{size} quadrotors, vehicle-steps/s"
        rows.append(informs("peers", what, ours, bare, "bare mj_step"))
        for peer, known in PEERS.items():
            if size in known:
                theirs, wanted = known[size]
                rows.append(at_least("peers", what, ours, theirs, ours / theirs, wanted, f"{peer}, measured elsewhere"))
    return rows
