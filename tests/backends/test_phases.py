"""Runs of several phases, and worlds that go on from a state: against runs of one phase, bit for bit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mjsheaf import World
from mjsheaf.errors import InputError
from mjsheaf.runs.simulate import stream
from mjsheaf.simulation.ideal import run_ideal, stream_ideal
from mjsheaf.simulation.physics import run_physics, stream_physics
from mjsheaf.simulation.trajectory import Log
from mjsheaf.system import Phase, System, phases_of
from mjsheaf.team import Team
from tests.builders import mixed_scenario

BACKENDS = [(run_ideal, stream_ideal), (run_physics, stream_physics)]


def without_an_edge(system: System) -> System:
    """The same vehicles, with the first edge among agents silent and another gain."""
    team = system.team
    fewer = Team(team.agents, team.targets, team.communication[1:], team.sensing, team.target_edges, team.formations)
    from mjsheaf.control import pack_law

    law = pack_law(fewer, 2.0, 0.0, system.law.limit)
    return replace(system, team=fewer, gain=2.0, law=law)


@pytest.mark.parametrize("backend", BACKENDS, ids=["ideal", "bodies"])
@pytest.mark.parametrize("period", [0.0, 0.01], ids=["continuous", "held"])
def test_a_team_that_changes_half_way(backend: Any, period: float) -> None:
    run, pieces = backend
    system = mixed_scenario(time={"end": 0.4}, controller={"gain": 8.0, "control_period": period}).system
    other = without_an_edge(system)
    whole = run(system)
    same = [Phase(0, system), Phase(20, system)]
    together = {name: np.concatenate([getattr(p.log, name) for p in pieces(same, 7)]) for name in Log._fields}
    for name in Log._fields:
        np.testing.assert_array_equal(together[name], getattr(whole.log, name), err_msg=name)
    changed = list(pieces([Phase(0, system), Phase(20, other)], 1000))
    assert [len(piece.time) for piece in changed] == [20, 21]
    assert [piece.system.team for piece in changed] == [system.team, other.team]
    for name in ("positions", "velocity", "command", "quaternions"):
        np.testing.assert_array_equal(getattr(changed[0].log, name), getattr(whole.log, name)[:20], err_msg=name)
    # Positions carry over; the law that is sampled there is the new one.
    np.testing.assert_array_equal(changed[1].positions[0], whole.positions[20])
    n = system.team.dirichlet.H.shape[0]
    x = other.team.pack(changed[1].positions)
    H, B, c = other.team.dirichlet.H, other.team.dirichlet.B, other.team.dirichlet.c
    eta = np.array([H @ q[:n] - B @ q[n:] - c for q in x])
    np.testing.assert_allclose(other.team.pack(changed[1].log.residual)[:, :n], eta, rtol=0, atol=1e-10)
    assert np.abs(changed[1].positions[-1] - whole.positions[-1]).max() > 1e-3


def test_metrics_are_those_of_the_phase() -> None:
    system = mixed_scenario(time={"end": 0.4}).system
    other = without_an_edge(system)
    for backend in ("ideal", "physics"):
        before, after = stream([Phase(0, system), Phase(20, other)], backend, 0)
        for team, data in ((system.team, before), (other.team, after)):
            positions = np.concatenate([data["agent_position"].values, data["target_position"].values], axis=1)
            x = team.pack(np.nan_to_num(positions))
            q_star = team.dirichlet.extend(x[:, team.dirichlet.H.shape[0] :])
            np.testing.assert_allclose(
                team.pack(np.nan_to_num(np.concatenate([data["harmonic_extension"].values, positions[:, 3:]], axis=1)))[
                    :, : q_star.shape[1]
                ],
                q_star,
                atol=1e-12,
            )


@pytest.mark.parametrize("starts", [[], [1], [0, 0], [0, 9, 5], [0, 999]])
def test_phases_that_do_not_follow_one_another(starts: list[int]) -> None:
    system = mixed_scenario(time={"end": 0.4}).system
    with pytest.raises(InputError, match="phase"):
        phases_of([Phase(k, system) for k in starts])


@pytest.mark.parametrize("steps", [1, 7, 10, 23])
@pytest.mark.parametrize("period", [0.0, 0.01], ids=["continuous", "held"])
def test_a_world_goes_on_from_a_state_to_the_bit(period: float, steps: int) -> None:
    """Also between two samples, where the held command is the law's memory; and in a world that was elsewhere."""
    scenario = mixed_scenario(
        controller={"gain": 8.0, "control_period": period}, disturbance={"agents": {"bound": 1.0}}
    )
    one, other = World(scenario), World(scenario)
    one.step(steps)
    state = one.get_state()
    one.step(40)
    for world in (one, other):
        world.step(5)
        world.set_state(state)
        np.testing.assert_array_equal(world.get_state(), state)
        assert world.time == pytest.approx(steps * 0.001)
    again = World(scenario)
    again.step(steps)
    for world in (one, other, again):
        world.step(33)
    for world in (one, other):
        np.testing.assert_array_equal(world.get_state(), again.get_state())
        np.testing.assert_array_equal(world.positions(), again.positions())


def test_a_state_of_another_scenario_is_refused_and_changes_nothing() -> None:
    world = World(mixed_scenario())
    world.step(3)
    before = world.get_state()
    for state in (before[:-1], np.append(before, 0.0), before[:5], np.zeros((2, 2))):
        with pytest.raises(InputError, match="state has shape"):
            world.set_state(state)
        np.testing.assert_array_equal(world.get_state(), before)
