"""Speed of simulations in this process: the published run, steps of bodies, threads, and assembly."""

from functools import partial
from statistics import median
from time import perf_counter, thread_time

import numpy as np

import mjsheaf
from benchmarks.measuring import WANTED, Row, at_least, at_most, best, elapsed, informs, swarm, timed
from mjsheaf.loop.fused import Fused
from mjsheaf.loop.mujoco_engine import World
from mjsheaf.loop.session import engine_of
from mjsheaf.loop.system import on_engine, phases_of
from mjsheaf.mujoco_import import mujoco
from mjsheaf.scenario import Scenario
from mjsheaf.threads import usable_processors

AUTHORS_S = 38.0
"""Time of the paper's own code, which calls scipy for each agent and step, on a machine with two cores, s."""

_GAINS = (5.0, 8.0, 10.0, 12.0)


def ideal(short: bool = False, end: float | None = None) -> list[Row]:
    """Measure the published run on ideal kinematics: 4,998 held steps of 17 vehicles at a relative tolerance of 1e-9.

    `end` may shorten it, s.
    """
    scenario = mjsheaf.load_scenario("paper", {} if end is None else {"time.end": end})
    system = scenario.system
    mjsheaf.simulate(scenario, backend="ideal")  # compiles
    repetitions = 5 if short else 20
    run = best(lambda: engine_of(system, "ideal").run(), repetitions, thread_time)
    simulate = best(lambda: mjsheaf.simulate(scenario, backend="ideal", progress=False), repetitions, thread_time)
    what = f"published run, {system.grid.steps} steps, s"
    return [
        at_most("ideal", what, run, WANTED["ideal"], run / WANTED["ideal"], 1.0, "required time"),
        informs("ideal", "simulate() of it, s", simulate, AUTHORS_S, "the authors' code"),
    ]


def loop(short: bool = False, sizes: tuple[int, ...] = (100, 1000)) -> list[Row]:
    """Measure the cost of closing the loop: `World.step(n)` against bare `mj_step` from the same state.

    The teams are that of `paper`, and swarms of at least two sizes: tilted hexarotors with lagged, limited rotors, in
    wind and disturbances.
    """
    repetitions = 10 if short else 40
    rows = [_step(mjsheaf.load_scenario("paper"), 3 * repetitions)]
    rows += [_step(swarm(size), max(3, repetitions * 100 // max(size, 100))) for size in sizes]
    small, large = ((row.ours or 0.0) / (size + 1) for row, size in zip(rows[-2:], sizes[-2:], strict=True))
    what = f"the same per vehicle, {sizes[-1] + 1} against {sizes[-2] + 1}"
    return [*rows, at_most("loop", what, large, small, large / small, WANTED["swarm growth"])]


def _step(scenario: Scenario, repetitions: int, steps: int = 100) -> Row:
    """Measure the time of a step of one world, us.

    The bare step starts from a copy of the state that the closed loop has just reached, with its commands and forces
    held. Both include lag and limits, which the engine computes. The model is the one that `run` steps, without visual
    geoms. With them, which is the default of World, both steps are slower and their ratio is smaller.
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


def fused(short: bool = False, sizes: tuple[int, ...] = (1, 100, 1000, 10_000)) -> list[Row]:
    """Measure the fused engine on one core: a step per vehicle, and the published run on bodies against MuJoCo.

    The swarms are those of `loop`; the short version omits the largest.
    """
    repetitions, bound = 10 if short else 40, WANTED["fused run"]
    rows = [_fused_swarm(size, repetitions) for size in sizes[: -1 if short else None]]
    system = mjsheaf.load_scenario("paper").system
    (phase,) = on_engine(phases_of(system), "fused")
    engine_of(phase.system).run()  # compiles
    run = best(lambda: engine_of(phase.system).run(), repetitions, thread_time)
    theirs = best(lambda: engine_of(system).run(), max(2, repetitions // 10), thread_time)
    steps = system.grid.steps * system.steps_per_sample
    what = f"published run on bodies, {steps} steps, s"
    rows.append(at_most("fused", what, run, bound, run / bound, 1.0, "required time"))
    rows.append(informs("fused", "the same run against MuJoCo, s", run, theirs, "by MuJoCo"))
    return rows


def _fused_swarm(size: int, repetitions: int) -> Row:
    """Measure the time of a step per vehicle of one swarm on one thread, ns."""
    steps, bound = max(20, 100_000 // size), WANTED["fused"]
    step = partial(Fused(on_engine(swarm(size).phases, "fused")).step, steps)
    step()  # compiles
    alone = 1e9 / (steps * (size + 1)) * best(step, repetitions, thread_time)
    what = f"{size + 1} tilted hexarotors, a vehicle and step, ns"
    return at_most("fused", what, alone, bound, alone / bound, 1.0, "required time")


def threads(
    short: bool = False, sizes: tuple[int, ...] = (5000, 10_000), ends: tuple[float, float] = (49.99, 20.0)
) -> list[Row]:
    """Measure one team on threads with the fused engine, and `simulate_many` on threads, against one thread.

    The results must be equal bit for bit. The short version omits the largest swarm. The runs of `simulate_many` are
    `paper` with different gains, on ideal kinematics and on bodies until `ends`, s.
    """
    count = usable_processors()
    if count == 1:
        return [informs("threads", "threads", 1.0, note="one processor only")]
    repetitions = 10 if short else 40
    rows = [_team_on_threads(size, count, repetitions) for size in sizes[: -1 if short else None]]
    return rows + _runs_on_threads(min(count, len(_GAINS)), 3 if short else 8, ends)


def _team_on_threads(size: int, count: int, repetitions: int) -> Row:
    """Measure the time of a step per vehicle of one swarm, ns, on `count` threads and on one."""
    # A tenth of a second of work, long compared with waking a thread.
    phases, steps = swarm(size).phases, max(20, 1_000_000 // size)
    alone = Fused(on_engine(phases, "fused"))
    with Fused(on_engine(phases, "fused", count)) as together:
        one, several = partial(alone.step, steps), partial(together.step, steps)
        one()  # compiles
        several()
        turns = [(elapsed(one, perf_counter), elapsed(several, perf_counter)) for _ in range(repetitions)]
        same = np.array_equal(alone.positions(), together.positions())
    single, shared = (1e9 / (steps * (size + 1)) * min(times) for times in zip(*turns, strict=True))
    what = f"{size + 1} tilted hexarotors by the fused engine, {count} threads, ns"
    note = "one thread" if same else "one thread; the results DIFFER"
    wanted = WANTED["fused threads"] * count
    return at_least("threads", what, shared, single, median(a / b for a, b in turns), wanted, note)


def _runs_on_threads(count: int, repetitions: int, ends: tuple[float, float]) -> list[Row]:
    """Time `simulate_many`."""
    rows = []
    for backend, end in zip(("ideal", "physics"), ends, strict=True):
        scenarios = [mjsheaf.load_scenario("paper", {"controller.gain": gain, "time.end": end}) for gain in _GAINS]
        mjsheaf.simulate(scenarios[0], backend=backend)  # compiles
        simulate = partial(mjsheaf.simulate_many, scenarios, backend)
        turns = []
        for _ in range(repetitions):
            alone, single = timed(partial(simulate, workers=1))
            together, several = timed(partial(simulate, workers=count))
            turns.append((single, several))
        same = all(a.identical(b) for a, b in zip(alone, together, strict=True))  # type: ignore[union-attr, arg-type]
        note = "one thread" if same else "one thread; the results DIFFER"
        what = f"{len(scenarios)} runs on {backend}, {count} threads, s"
        single, several = (min(times) for times in zip(*turns, strict=True))
        speedup = median(a / b for a, b in turns)
        rows.append(at_least("threads", what, several, single, speedup, WANTED["speed-up"] * count, note))
    return rows


def assembly(short: bool = False, size: int = 1000) -> list[Row]:
    """Measure the assembly of one model (scenario, sheaf, law, bodies with MuJoCo's compiler) once, in wall time."""
    World(swarm(4)).step(1)  # compiles
    total, wanted = elapsed(lambda: World(swarm(size)), perf_counter), WANTED["assembly"]
    what = f"scenario to world, {size + 1} vehicles, s"
    return [at_most("assembly", what, total, wanted, total / wanted, 1.0, "required time")]
