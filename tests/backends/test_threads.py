"""Bodies on several threads: the same bits on any number of threads, and no thread waits forever."""

import signal
import threading
import time
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import load_scenario, simulate
from mjsheaf import threads as processors
from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import InputError
from mjsheaf.jit import jit
from mjsheaf.scenario import Scenario
from mjsheaf.simulation.engine import Engine
from mjsheaf.simulation.fused import Fused
from mjsheaf.simulation.gate import ThreadTeam, refill, take, wait
from mjsheaf.simulation.loop import finish_law, run_law, share_law
from mjsheaf.simulation.session import ENGINES, Session, moved_by
from mjsheaf.simulation.world import SplitWorld
from mjsheaf.system import on_engine
from mjsheaf.tiers import Tiered
from tests.builders import make_scenario, mixed_scenario, refused

SWARM = {"swarm.size": 60, "time.end": 1.0}


def bits(result: Any) -> dict[str, bytes]:
    assert isinstance(result, xr.Dataset)
    return {str(name): np.ascontiguousarray(result[name]).tobytes() for name in result.data_vars}


@pytest.fixture
def thread_teams(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Record the number of threads of each thread team made inside the block."""
    counts: list[int] = []

    class Counted(ThreadTeam):
        def __init__(self, count: int) -> None:
            super().__init__(count)
            counts.append(count)

    monkeypatch.setattr("mjsheaf.simulation.threaded.ThreadTeam", Counted)
    return counts


@pytest.mark.parametrize("name", ["swarm_radio_shadow", "swarm"])
@pytest.mark.parametrize("engine", ENGINES)
def test_threads_do_not_change_a_bit(engine: str, name: str, thread_teams: list[int]) -> None:
    """Of a swarm over links that fail, with events in mid-run, and of one whose law is divided among threads.

    MuJoCo's one thread is `World`.
    """
    scenario = load_scenario(name, SWARM)
    one, *more = (bits(simulate(scenario, engine=engine, threads=threads)) for threads in (1, 2, 3))
    assert all(other == one for other in more)
    assert thread_teams == ([1, 2, 3] if engine == "fused" else [2, 3])


@pytest.mark.parametrize(("name", "held"), [("paper", False), ("harbour", True)])
def test_a_divided_law_is_the_law(name: str, held: bool) -> None:
    """Any number of threads may measure its edges, and then command vehicles in any order and in any groups."""
    scenario = load_scenario(name, {"physics.contacts": False})
    run = Fused(on_engine(scenario.phases, "fused"))
    loop, _ = run.compiled
    assert loop.params.control.stages.joint == ()
    V, rng = len(run.system.team.members), np.random.default_rng(1)
    if held:
        loop.params.station.holds[:2] = True
    loop.state.qpos[:] += rng.normal(size=7 * V)
    memory = loop.state.memory
    Tiered(run_law, records=True)(loop, loop.params.start)
    expected = memory.flat.tobytes()
    memory.flat[:] = np.nan
    memory.supplied[:] = 0.0
    for thread in rng.permutation(3):
        Tiered(share_law, records=True)((), loop, loop.params.start, int(thread), 3)
    ends = np.sort(rng.choice(np.arange(1, V), 3, replace=False)).tolist()
    for first, last in rng.permutation(np.column_stack(([0, *ends], [*ends, V]))).tolist():
        Tiered(finish_law, records=True)((), loop, 0, first, last)
    assert memory.flat.tobytes() == expected


def test_laws_with_stages_for_the_whole_team_are_not_divided() -> None:
    joint = {name: load_scenario(name).system.control.stages.joint for name in ("noisy_harbour", "paper_safe", "swarm")}
    assert joint == {"noisy_harbour": (1,), "paper_safe": (1,), "swarm": ()}
    assert load_scenario("range_formation").system.control.stages.joint == (1,)


@pytest.mark.parametrize(("quota", "expected"), [("max 100000", 8), ("150000 100000", 2), ("1000 100000", 1), ("", 8)])
def test_a_container_has_the_processors_of_its_quota(
    quota: str, expected: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: range(8))
    monkeypatch.setattr(processors, "_QUOTA", tmp_path / "cpu.max")
    (tmp_path / "cpu.max").write_text(quota)
    assert processors.usable_processors() == expected
    monkeypatch.setattr("psutil.cpu_percent", lambda *_, **__: [100.0, 0.0] * 4)
    assert processors.free_processors() == max(1, expected - 4)


def test_long_runs_take_the_idle_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short one takes one, as does one with contacts."""
    monkeypatch.setattr("mjsheaf.simulation.session.free_processors", lambda: 7)
    long = {"swarm.size": 60, "time.end": 100.0}

    def threads(engine: str = "mujoco", asked: int | None = None, **changes: Any) -> int:
        scenario = load_scenario("swarm", long | {name.replace("__", "."): value for name, value in changes.items()})
        return moved_by(scenario.phases, "physics", engine, asked)[0].system.bodies.threads

    assert threads() == threads("fused") == 7
    assert threads(asked=3) == 3
    assert threads(time__end=1.0) == threads(physics__contacts=True) == 1


def unstable() -> Scenario:
    """Hulls with a gain that is too high: commands diverge at different samples."""
    hulls = [{"id": f"A{k}", "position": [0.1 * 9.0 ** -(k % 5), float(k)]} for k in range(20)]
    wild = {"gain": 1e3, "control_period": 0.01}
    targets = [{"id": f"T{k}", "position": [0.0, float(k)]} for k in range(20)]
    sensing = [[f"A{k}", f"T{k}"] for k in range(20)]
    fields = {"agents": hulls, "targets": targets, "sensing": sensing, "controller": wild, "time": {"end": 2.0}}
    return make_scenario(fields)


@pytest.mark.parametrize("engine", ENGINES)
def test_runs_that_blow_up_are_the_same_on_any_number_of_threads(engine: str) -> None:
    """Every sample up to the last good one is whole, also of vehicles that come after the one that was bad."""
    runs = [simulate(unstable(), engine=engine, threads=threads) for threads in (1, 2, 3)]
    world = simulate(unstable())
    for run in runs:
        assert run.attrs["status"] == "unstable"
        assert run.attrs["message"] == runs[0].attrs["message"]
        assert bits(run) == bits(runs[0])
        assert run.sizes["time"] == world.sizes["time"]
        for name, values in world.data_vars.items():
            np.testing.assert_allclose(run[name], values, rtol=1e-6, atol=1e-6, err_msg=str(name))


# -- threads that wait for one another ---------------------------------------------------------------------------------


@jit
def meet(count, threads, gate):
    good = True
    for k in range(count):
        good = good and wait(gate, k + 1, threads)
    return good


@pytest.mark.long
def test_threads_meet_as_often_as_asked_and_leave_when_one_will_not_come() -> None:
    thread_team, came = ThreadTeam(3), [False] * 3
    thread_team.run(lambda thread, gate: came.__setitem__(thread, meet(10_000, 3, gate)))
    assert came == [True] * 3

    for lost in range(3):  # the caller's own thread too, as by Ctrl-C

        def work(thread: int, gate: Any, lost: int = lost) -> None:
            if thread == lost:
                time.sleep(0.01)
                raise KeyboardInterrupt
            came[thread] = meet(10_000, 3, gate)

        with pytest.raises(KeyboardInterrupt):
            thread_team.run(work)
        assert not any(value for thread, value in enumerate(came) if thread != lost)
        came[:] = [True] * 3
    before = threading.active_count()
    thread_team.close()
    assert threading.active_count() == before - 2


@jit
def take_all(times, thread, threads, gate):
    unit = take(gate, thread, threads, times.shape[0])
    while unit >= 0:
        times[unit] += 1
        unit = take(gate, thread, threads, times.shape[0])


def take_all_of(times: Array, threads: int, thread: int, gate: IntArray) -> None:
    """Take part as a thread of a thread team does."""
    take_all(times, thread, threads, gate)


def test_every_unit_of_work_is_taken_once_whoever_comes() -> None:
    """All threads at once, or one that finds the others missing; also where some have no share."""
    for threads, units in ((1, 5), (2, 7), (3, 100), (4, 3)):
        times, gate = np.zeros(units), ThreadTeam.gate(threads)
        for thread in range(threads):
            refill(gate, threads)
            take_all(times, thread, threads, gate)
            np.testing.assert_array_equal(times, thread + 1.0)
        thread_team = ThreadTeam(threads)
        thread_team.run(partial(take_all_of, times, threads))
        thread_team.close()
        np.testing.assert_array_equal(times, threads + 1.0)


def step_on(engine: Engine) -> None:
    """Take 20 periods after 20 periods."""
    while True:
        engine.step(20 * engine.steps_per_sample)


@pytest.mark.parametrize(
    ("backend", "engine", "threads"), [("ideal", "mujoco", 1), *product(["physics"], ENGINES, [1, 2])]
)
def test_steps_are_counted_that_were_taken_before_ctrl_c(backend: str, engine: str, threads: int) -> None:
    """A timer's signal arrives in compiled code; what is counted is where a run is that nobody interrupted."""
    scenario = load_scenario("swarm", {"swarm.size": 30, "time.end": 4.0})

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    with (
        Session(scenario, backend, engine=engine, threads=threads) as run,
        Session(scenario, backend, engine=engine, threads=threads) as other,
    ):
        try:
            for one in (run, other):
                one.engine.step(1)
            signal.setitimer(signal.ITIMER_REAL, 5e-3)
            with pytest.raises(KeyboardInterrupt):
                step_on(run.engine)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)
        other.engine.step(run.engine.steps_taken - 1)
        np.testing.assert_array_equal(run.engine.positions(), other.engine.positions())


def test_an_interrupted_run_leaves_no_thread_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where a thread could not be started, while another waits for it already."""
    before = threading.active_count()

    def interrupted(done: int, of: int) -> None:
        raise KeyboardInterrupt

    for engine in ENGINES:
        with pytest.raises(KeyboardInterrupt):
            simulate(load_scenario("swarm_radio_shadow", SWARM), engine=engine, threads=3, progress=interrupted)
        assert threading.active_count() == before

    thread_team, handed = ThreadTeam(3), list[Any]()
    assert thread_team._pool
    submit = thread_team._pool.submit

    def once(*work: Any) -> Any:
        if handed:
            raise RuntimeError("can't start new thread")
        handed.append(submit(*work))
        return handed[0]

    monkeypatch.setattr(thread_team._pool, "submit", once)
    with pytest.raises(RuntimeError, match="start new thread"):
        thread_team.run(lambda thread, gate: meet(10_000, 3, gate))
    assert handed[0].done()
    thread_team.close()


# -- what is refused ---------------------------------------------------------------------------------------------------


def test_threads_that_cannot_be_are_refused() -> None:
    touching = mixed_scenario(physics={"contacts": True})
    with refused(InputError, "physics.contacts", "2 threads", "false"):
        simulate(touching, threads=2)
    with refused(InputError, "physics.contacts"):
        SplitWorld(on_engine(touching.phases, "mujoco", 2))
    simulate(touching, threads=1)
    with refused(InputError, "threads", 2, "ideal"):
        simulate(mixed_scenario(), "ideal", threads=2)
    with refused(InputError, "threads", 0, 1):
        simulate(mixed_scenario(), threads=0)
