"""Bodies of the fused engine on several threads: the same bits on any number of threads."""

import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjsheaf import load_scenario, simulate
from mjsheaf import threads as processors
from mjsheaf.loop.engine import Engine
from mjsheaf.loop.session import ENGINES, Session, prepare_run
from mjsheaf.scenario import Scenario
from tests.builders import bits, build_scenario, mixed_scenario

SWARM = {"swarm.size": 60, "time.end": 1.0}


@pytest.fixture(autouse=True)
def any_team_is_worth_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjsheaf.loop.fused._WORTH_A_THREAD", 1)


@pytest.mark.long
@pytest.mark.parametrize("name", ["swarm_radio_shadow", "swarm"])
def test_threads_do_not_change_a_bit(name: str) -> None:
    """Of a swarm over links that fail, and of one over exact links, with another wind in mid-run."""
    events = [{"time": 0.5, "set": {"flow.air.drift": [2.0, 0.0, 0.0]}}]
    scenario = load_scenario(name, SWARM | {"events": events})
    one, *more = (bits(simulate(scenario, engine="fused", threads=threads)) for threads in (1, 2, 3))
    assert all(other == one for other in more)


@pytest.mark.parametrize(("quota", "expected"), [("max 100000", 8), ("150000 100000", 2), ("1000 100000", 1), ("", 8)])
def test_a_container_has_the_processors_of_its_quota(
    quota: str, expected: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: range(8))
    monkeypatch.setattr(processors, "_QUOTA", tmp_path / "cpu.max")
    (tmp_path / "cpu.max").write_text(quota)
    assert processors.usable_processors() == expected


def test_the_fused_engine_may_take_all_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjsheaf.loop.session.usable_processors", lambda: 7)
    scenario = load_scenario("swarm", SWARM)
    allowed = {
        (engine, asked): prepare_run(scenario, "physics", engine, asked)[0].system.bodies.threads
        for engine in ENGINES
        for asked in (None, 3)
    }
    assert allowed == {("mujoco", None): 1, ("mujoco", 3): 1, ("fused", None): 7, ("fused", 3): 3}


def unstable() -> Scenario:
    """Hulls with a gain that is too high: commands diverge at different samples."""
    hulls = {f"A{k}": [0.1 * 9.0 ** -(k % 5), float(k)] for k in range(20)}
    targets = {f"T{k}": [0.0, float(k)] for k in range(20)}
    wild = {"gain": 1e3, "control_period": 0.01}
    return build_scenario(hulls, targets, zip(hulls, targets, strict=True), controller=wild, time={"end": 2.0})


def test_runs_that_blow_up_are_the_same_on_any_number_of_threads() -> None:
    """Every sample up to the last good one is whole, also of vehicles that come after the one that was bad."""
    runs = [simulate(unstable(), engine="fused", threads=threads) for threads in (1, 2, 3)]
    world = simulate(unstable())
    for run in runs:
        assert run.attrs["status"] == "unstable"
        assert run.attrs["message"] == runs[0].attrs["message"]
        assert bits(run) == bits(runs[0])
        assert run.sizes["time"] == world.sizes["time"]
        assert run.attrs["message"].split(" (")[0] == world.attrs["message"].split(" (")[0]
        assert run.attrs["message"].split("; ")[1:] == world.attrs["message"].split("; ")[1:]
        for name, values in world.data_vars.items():
            np.testing.assert_allclose(run[name], values, rtol=1e-6, atol=1e-6, err_msg=str(name))


def step_on(engine: Engine) -> None:
    """Take 20 periods after 20 periods."""
    while True:
        engine.step(20 * engine.steps_per_sample)


@pytest.mark.parametrize(
    ("backend", "engine", "threads"),
    [("ideal", "mujoco", 1), ("physics", "mujoco", 1), ("physics", "fused", 1), ("physics", "fused", 2)],
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


def test_an_interrupted_run_leaves_no_thread_behind() -> None:
    before = threading.active_count()

    def interrupted(done: int, of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(load_scenario("swarm_radio_shadow", SWARM), engine="fused", threads=3, progress=interrupted)
    assert threading.active_count() == before


def test_contacts_are_simulated_whatever_threads_are_allowed() -> None:
    touching = mixed_scenario(physics={"contacts": True}, time={"end": 0.05})
    assert bits(simulate(touching, threads=2)) == bits(simulate(touching, threads=1))


def test_a_run_goes_on_after_its_threads_have_ended() -> None:
    """On one thread, to the same bits."""
    scenario = load_scenario("swarm", SWARM)
    found = []
    for close in (False, True):
        with Session(scenario, engine="fused", threads=3) as session:
            session.step()
            if close:
                session.engine.close()
            session.step()
            found.append(session.engine.positions())
    np.testing.assert_array_equal(found[0], found[1])
