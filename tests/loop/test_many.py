"""Many runs on threads: the bits of one by one, in order, and no run lost to another's error."""

import threading
from typing import Any

import pytest
import xarray as xr
from threadpoolctl import threadpool_info, threadpool_limits

from mjsheaf import simulate, simulate_many
from mjsheaf.errors import InputError, NotUniqueError
from mjsheaf.scenario import Scenario
from mjsheaf.threads import one_thread
from tests.builders import bits, mixed_scenario, refused

DISTURBED = {"agents": {"bound": 0.5}, "targets": {"bound": 0.3}}


def runs() -> list[Scenario]:
    control = [{"gain": gain, "control_period": 0.01} for gain in (1.0, 2.0, 3.0)]
    one = [mixed_scenario(controller=c, disturbance=DISTURBED, seed=k) for k, c in enumerate(control)]
    return [*one, mixed_scenario(seed=7, disturbance=DISTURBED, time={"end": 0.3})]


def test_linear_algebra_has_one_thread_until_the_last_run_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """The number is the process's, and its bits depend on it."""
    seen: list[set[int]] = []

    def solve(*_: object, **__: object) -> None:
        one_thread(lambda: None)()  # as a run does that ends before the others
        seen.append({each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"})

    monkeypatch.setattr("mjsheaf.runs.simulate.simulate", solve)
    with threadpool_limits(2, "blas"):
        simulate_many(runs(), workers=4)
    assert seen == [{1}] * 4


@pytest.mark.parametrize("how", [{"backend": "ideal"}, {"engine": "mujoco"}, {"engine": "fused"}], ids=str)
def test_threads_give_the_bits_of_one_by_one(how: dict[str, Any]) -> None:
    """Seeds and gains over links, one that blows up, events, and a team that the fused engine refuses."""
    noisy = {"links": {"all": {"noise": 0.02, "loss": 0.2}}, "disturbance": DISTURBED}
    lost = [{"time": 0.1, "lose": "back"}]
    scenarios = [
        mixed_scenario(seed=0, **noisy),
        mixed_scenario(seed=1, **noisy),
        mixed_scenario(seed=0, disturbance=DISTURBED),
        mixed_scenario(seed=2, controller={"gain": 1e5, "control_period": 0.01}, **noisy),
        mixed_scenario(seed=0, events=lost, **noisy),
        mixed_scenario(seed=3, events=lost, **noisy),
        mixed_scenario(seed=0, **noisy),
    ]
    touching = mixed_scenario(seed=0, physics={"contacts": True})
    alone = [simulate(scenario, **how) for scenario in scenarios]
    for workers in (1, 3, None):
        results = simulate_many([*scenarios[:6], touching, *scenarios[6:]], **how, workers=workers)
        assert isinstance(results.pop(6), InputError) == (how == {"engine": "fused"})
        for scenario, own, result in zip(scenarios, alone, results, strict=True):
            assert bits(result) == bits(own), f"{workers} workers"
            assert isinstance(result, xr.Dataset)
            assert result.identical(own)
            assert result.encoding["scenario"] is scenario
    assert [run.attrs["status"] == "unstable" for run in alone] == [k == 3 for k in range(7)]
    assert len({bits(run)["agent_position"] for run in alone}) == 6  # the first is the last


def test_a_refused_scenario_does_not_lose_the_others() -> None:
    """Refused: no agent senses a target. Diverged: a gain beyond the margin of the hold, which is a result."""
    wild = mixed_scenario(controller={"gain": 1e4, "control_period": 0.01})
    free = mixed_scenario(sensing=[["boat", "ship"]], communication=[["boat", "front"]], formations=[])
    good, refused, broken, again = simulate_many([mixed_scenario(), free, wild, mixed_scenario()], "ideal", workers=2)
    assert isinstance(refused, NotUniqueError)
    assert isinstance(broken, xr.Dataset)
    assert broken.attrs["status"] == "unstable"
    assert bits(good) == bits(again)
    (allowed,) = simulate_many([free], "ideal", allow_drift=True)
    assert isinstance(allowed, xr.Dataset)


def test_progress_counts_runs_in_the_calling_thread() -> None:
    seen: list[tuple[int, int]] = []
    threads: set[int] = set()

    def progress(done: int, of: int) -> None:
        seen.append((done, of))
        threads.add(threading.get_ident())

    simulate_many(runs(), "ideal", workers=2, progress=progress)
    assert seen == [(k, 4) for k in range(1, 5)]
    assert threads == {threading.get_ident()}


@pytest.mark.long
def test_an_interrupted_set_of_runs_ends_soon() -> None:
    """Whatever ends the caller ends the runs that have begun, at their next look, and those that have not."""

    def stop(done: int, of: int) -> None:
        raise KeyboardInterrupt

    long = [mixed_scenario(time={"end": 1e5}, controller={"gain": 3.0, "control_period": 0.01}) for _ in range(3)]
    with pytest.raises(KeyboardInterrupt):
        simulate_many([mixed_scenario(), *long], "ideal", workers=2, progress=stop)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ThreadPoolExecutor")]


def test_nothing_to_run_and_bad_arguments() -> None:
    assert simulate_many([], "ideal") == []
    with refused(InputError, "workers", 0, 1):
        simulate_many([mixed_scenario()], workers=0)
    with refused(InputError, "'real'", "physics", "ideal"):
        simulate_many([mixed_scenario()], "real")
    for wrong, what in (("midpoint", "number 0"), (mixed_scenario(), "scenarios is a Scenario")):
        with refused(InputError, what, "Scenario"):
            simulate_many(wrong)  # type: ignore[arg-type]
