"""Worlds side by side: each ends as it does alone, whatever the others do.

Oracle: `simulate` on the fused engine, one run at a time, and its errors as summaries have them.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import load_scenario, simulate
from mjsheaf.errors import InputError
from mjsheaf.results.metrics import late_errors, summarize
from mjsheaf.scenario import Scenario
from mjsheaf.simulation.batch import Batch
from mjsheaf.simulation.fused import Fused
from tests.builders import mixed_scenario, refused

WILD = 1e5  # 1/s: a gain that blows up at once
LINKED: dict[str, Any] = {
    "links": {"all": {"noise": 0.02, "delay": 0.02, "loss": 0.2}},
    "disturbance": {"agents": {"bound": 0.5}},
    "time": {"end": 0.5},
}


def linked(seed: int, gain: float, **fields: Any) -> Scenario:
    """Unlike vehicles under terms, over links with noise and losses."""
    terms = {"feedforward": {"rounds": 2}, "drift": {"filter": 1.0}}
    return mixed_scenario(seed=seed, controller={"gain": gain, "control_period": 0.02, **terms}, **LINKED, **fields)


def batch_of(scenarios: list[Scenario], **how: Any) -> Batch:
    return Batch([Fused(scenario.phases) for scenario in scenarios], **how)


def require_as_alone(batch: Batch, scenarios: list[Scenario], alone: list[xr.Dataset]) -> None:
    """Positions at the end to the bit, and the errors of the run."""
    for w, (scenario, run, outcome) in enumerate(zip(scenarios, alone, batch.outcomes(), strict=True)):
        team, loop = scenario.team, batch.rows.loop_of(w)
        assert outcome.message == run.attrs["message"]
        assert outcome.samples == run.sizes["time"]
        final, late = summarize(team, run), late_errors(team, run)
        assert outcome.tracking_error == pytest.approx(final["tracking_error"], rel=1e-12)
        assert outcome.mean_disagreement == pytest.approx(final["mean_disagreement"], rel=1e-12)
        if run.attrs["status"] == "finished":
            np.testing.assert_array_equal(loop.state.x[: len(team.agents)], np.nan_to_num(run["agent_position"][-1]))
            assert outcome.late_tracking_error == pytest.approx(late["tracking_error"], rel=1e-12)
            assert outcome.late_mean_disagreement == pytest.approx(late["mean_disagreement"], rel=1e-12)
        else:
            assert outcome.late_tracking_error is None


@pytest.mark.parametrize(("threads", "members"), [(1, 1), (2, 3)])
def test_worlds_of_several_blocks_end_as_they_do_alone(threads: int, members: int) -> None:
    changes = {"time.end": 0.1, "disturbance.agents.bound": 0.2}
    scenarios = [load_scenario("paper", changes).with_seed(seed) for seed in range(3)]
    batch = batch_of(scenarios)
    assert list(batch.rows.loop.params.fleet.blocks) == [0, 13, 17]  # boats, and what they follow
    batch.run(threads, members)
    require_as_alone(batch, scenarios, [simulate(scenario, engine="fused", threads=1) for scenario in scenarios])


@pytest.mark.parametrize(("threads", "members"), [(1, 1), (2, 1), (3, 1)])
def test_worlds_end_as_they_do_alone(threads: int, members: int) -> None:
    """Different seeds and gains, over links; one world diverges and does not affect the others."""
    scenarios = [linked(0, 1.0), linked(1, 2.0), linked(2, WILD), linked(0, 1.0)]
    alone = [simulate(scenario, engine="fused", threads=1) for scenario in scenarios]
    assert [run.attrs["status"] for run in alone] == ["finished", "finished", "unstable", "finished"]
    batch = batch_of(scenarios)
    batch.run(threads, members)
    require_as_alone(batch, scenarios, alone)
    outcomes = batch.outcomes()
    assert outcomes[0] == outcomes[3] != outcomes[1]


def test_worlds_may_begin_elsewhere_and_have_a_continuous_law() -> None:
    scenarios = [
        mixed_scenario(
            seed=seed,
            spread={"position": 0.5},
            controller={"gain": 1.0, "control_period": 0, "record_period": 0.02},
            time={"end": 0.1},
        )
        for seed in range(3)
    ]
    alone = [simulate(scenario, engine="fused", threads=1) for scenario in scenarios]
    batch = batch_of(scenarios)
    batch.run(2)
    require_as_alone(batch, scenarios, alone)
    assert len({outcome.tracking_error for outcome in batch.outcomes()}) == 3


def test_the_ratio_is_the_largest_of_error_and_bound_after_the_start() -> None:
    scenarios = [linked(seed, 1.0) for seed in range(2)]
    alone = [simulate(scenario, engine="fused", threads=1) for scenario in scenarios]
    bounds = [np.linspace(9.0, 1.0 + w, run.sizes["time"]) for w, run in enumerate(alone)]
    batch = batch_of(scenarios, bounds=bounds)
    batch.run()
    for run, bound, outcome in zip(alone, bounds, batch.outcomes(), strict=True):
        share = np.sqrt((run["tracking_error"].values ** 2).sum(axis=1)) / bound
        assert outcome.ratio == pytest.approx(share[1:].max(), rel=1e-12)
        assert outcome.settled_ratio == pytest.approx(share[len(share) // 2 :].max(), rel=1e-12)
    free = batch_of(scenarios)
    free.run()
    assert [outcome.ratio for outcome in free.outcomes()] == [None, None]


@pytest.mark.slow
@pytest.mark.parametrize("members", [1, 3])
def test_the_layout_of_a_card_gives_the_same_bits(members: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The layout of a GPU: each number of all worlds is contiguous, and members of a world have one vehicle each."""
    scenarios = [linked(0, 1.0), linked(1, 2.0), linked(2, WILD)]
    monkeypatch.setattr("mjsheaf.simulation.bodies.split_into_blocks", lambda kind: np.arange(len(kind) + 1))
    plain, columns = batch_of(scenarios), batch_of(scenarios, order="F")
    plain.run()
    columns.run(members=members)
    assert columns.outcomes() == plain.outcomes()
    for w in range(3):
        np.testing.assert_array_equal(columns.rows.loop_of(w).state.qpos, plain.rows.loop_of(w).state.qpos)
        np.testing.assert_array_equal(
            columns.rows.loop_of(w).state.memory.flat, plain.rows.loop_of(w).state.memory.flat
        )


@pytest.mark.slow
def test_single_precision_is_near_double() -> None:
    """Of a stable loop: the positions themselves are known to 1e-6 m here, and errors do not add up.

    With a term, from a time that is no number in single precision, where the first sample is taken twice.
    """
    integral = {"time.start": 0.1, "time.end": 2.0, "controller.integral.gain": 0.5}
    scenarios = [load_scenario("midpoint", integral), load_scenario("midpoint", {**integral, "controller.gain": 2.0})]
    double, single = batch_of(scenarios), batch_of(scenarios, number=np.float32)
    double.run()
    single.run()
    for one, other in zip(double.outcomes(), single.outcomes(), strict=True):
        assert other.tracking_error == pytest.approx(one.tracking_error, abs=1e-3)
        assert other.tracking_error != one.tracking_error


def test_what_worlds_do_not_share_is_refused_by_its_field() -> None:
    plain = linked(0, 1.0)
    for other, field in (
        (linked(0, 1.0, physics={"timestep": 0.01}), "timestep"),
        (linked(0, 1.0, vehicles={"tau": 0.5}), "fleet"),
        (load_scenario("midpoint"), "edges"),
    ):
        with refused(InputError, field, "run 1"):
            batch_of([plain, other])
    first = plain.phases[0]
    with refused(InputError, "events", "0.2 s", "none"):
        Batch([Fused([first, replace(first, start=10)])])
    with refused(InputError, "events"):
        batch_of([linked(0, 1.0, events=[{"time": 0.2, "lose": "back"}])])
    with refused(InputError, "physics.contacts"):
        batch_of([linked(0, 1.0, physics={"contacts": True})])
    with refused(InputError, "no run"):
        batch_of([])


def test_a_batch_that_is_left_stops_and_worlds_that_have_ended_are_known() -> None:
    worlds = [linked(seed, 1.0) for seed in range(30)]
    batch = batch_of(worlds)
    running = batch.each()
    first = next(running)
    running.close()
    assert batch.outcome(first).samples == worlds[0].system.grid.steps + 1
    with refused(InputError, "29", "not at its end"):
        batch.outcome(29)
    with refused(InputError, "once"):
        batch.run()


def test_what_would_be_read_beyond_its_arrays_is_refused() -> None:
    """Bounds that are too few or too short, threads and members that are none, and a second run."""
    T = linked(0, 1.0).system.grid.steps + 1
    for bounds in (
        [np.ones(T)],
        [np.ones(3)] * 2,
        [np.ones(T), np.ones(T + 1)],
        [1.0, 1.0],
        [-np.ones(T)] * 2,
        [["a"] * T] * 2,
    ):
        with refused(InputError, "bounds", "2 runs"):
            batch_of([linked(0, 1.0), linked(1, 1.0)], bounds=bounds)
    with refused(InputError, "float16", "float32"):
        batch_of([linked(0, 1.0)], number=np.float16)
    batch = batch_of([linked(0, 1.0)])
    with refused(InputError, "run"):
        batch.outcomes()
    for threads, members, wrong in ((0, 1, "threads"), (1, 0, "members"), (1, -1, "members")):
        with refused(InputError, wrong, 1):
            batch.run(threads, members)
    batch.run()
    assert len(batch.outcomes()) == 1
    with refused(InputError, "once"):
        batch.run()
