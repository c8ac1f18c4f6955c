"""Runs of several phases, and worlds that continue from a state, equal runs of one phase bit for bit."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mjsheaf import World
from mjsheaf.errors import InputError
from mjsheaf.law.law import pack_law
from mjsheaf.loop.fused import Fused, Worlds
from mjsheaf.loop.system import Phase, System, phases_of
from mjsheaf.runs.simulate import stream
from mjsheaf.scenario import Scenario
from mjsheaf.team import Team
from tests.builders import build_scenario, list_members, mixed_scenario, two_boats
from tests.running import run_ideal, run_physics, stream_ideal, stream_physics

BACKENDS = [(run_ideal, stream_ideal), (run_physics, stream_physics)]


@pytest.mark.parametrize("backend", BACKENDS, ids=["ideal", "bodies"])
@pytest.mark.parametrize("period", [0.0, 0.01], ids=["continuous", "held"])
def test_a_team_that_changes_half_way(backend: Any, period: float) -> None:
    """It loses the first edge among agents and has another gain."""
    run, pieces = backend
    system = mixed_scenario(time={"end": 0.4}, controller={"gain": 8.0, "control_period": period}).system
    team = system.team
    fewer = Team(team.agents, team.targets, team.communication[1:], team.sensing, team.target_edges, team.formations)
    other = replace(system, team=fewer, gain=2.0, law=pack_law(fewer, 2.0, 0.0, system.law.limit))
    whole = run(system)
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


@pytest.mark.parametrize("starts", [[], [1], [0, 0], [0, 9, 5], [0, 999]])
def test_phases_that_do_not_follow_one_another(starts: list[int]) -> None:
    system = mixed_scenario(time={"end": 0.4}).system
    with pytest.raises(InputError, match="phase"):
        phases_of([Phase(k, system) for k in starts])


def require_resumable(run: Scenario | list[Phase], steps: Sequence[int], last: int) -> None:
    """Require that a new world, and one that was elsewhere, go on from the states after these steps to the bit."""
    world, whole, other, states = World(run), World(run), World(run), {}
    for step in steps:
        world.step(step - world.steps_taken)
        states[step] = world.time, world.get_state()
    whole.step(last)
    end, places = whole.get_state(), whole.positions()
    other.step(5)
    for step, (time, state) in states.items():
        for resumed in (World(run), other):
            resumed.set_state(state)
            np.testing.assert_array_equal(resumed.get_state(), state)
            assert resumed.time == time
            resumed.step(last - step)
            np.testing.assert_array_equal(resumed.get_state(), end, err_msg=f"from step {step}")
            np.testing.assert_array_equal(resumed.positions(), places)


@pytest.mark.parametrize("period", [0.0, 0.02], ids=["continuous", "held"])
def test_a_world_goes_on_from_a_state_to_the_bit(period: float) -> None:
    """Also between two samples; thrusts that lag and angles of thrusters are in it."""
    law = {"gain": 8.0, "control_period": period, "record_period": 0.02}
    boats = two_boats("wamv_azimuth", "otter_rudder", controller=law, disturbance={"agents": {"bound": 1.0}})
    require_resumable(boats, [1, 7, 8, 23], 56)


# -- what a phase may change, and what it may not ----------------------------------------------------------------------


def in_a_flow(drift: list[float], **fields: Any) -> Scenario:
    """Sixteen boats that lie where they should: they drift together, and the law has nothing to do."""
    agents = {f"A{k}": [1.0, 2.0] for k in range(15)}
    usual: dict[str, Any] = {
        "time": {"end": 3.0},
        "controller": {"gain": 1.0, "control_period": 0.1},
        "flow": {"water": {"dimension": 2, "drift": drift}},
        "vehicles": {"tau": 0.1},
        "physics": {"timestep": 0.01},
    }
    return build_scenario(agents, {"T": [1.0, 2.0]}, [[id, "T"] for id in agents], **usual | fields)


@pytest.mark.parametrize("disturbed", [False, True])
def test_a_world_goes_on_from_a_state_in_another_medium(disturbed: bool) -> None:
    """Also where the phases have disturbances of unlike sizes."""
    gusts = {"disturbance": {"agents": {"bound": 0.5}}} if disturbed else {}
    run = [Phase(0, in_a_flow([0, 0]).system), Phase(10, in_a_flow([2.0, 0], **gusts).system)]
    require_resumable(run, [100], 137)
    world = World(run)
    world.step(100)
    state = world.get_state()
    world.step(37)
    assert np.abs(world.positions()[0] - [1.0, 2.0, 0.0]).max() > 0.1
    world.reset()
    world.step(100)
    np.testing.assert_array_equal(world.get_state(), state)


@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_a_phase_brings_its_own_motions_of_targets(backend: str) -> None:
    def moving(amplitude: float) -> System:
        motion = {"kind": "lissajous", "amplitude": [amplitude, 0], "rate": [0.1, 0.1], "phase": [0, 0]}
        return in_a_flow([0, 0], target_motion=motion).system

    plain, slow = [Phase(0, moving(40.0))], [Phase(0, moving(40.0)), Phase(15, moving(10.0))]
    pieces = [stream(run, backend, 0) for run in (plain, slow)]
    speeds = [np.concatenate([data["target_velocity"].values for data in each])[:, 0, 0] for each in pieces]
    np.testing.assert_array_equal(speeds[0][:15], speeds[1][:15])
    assert speeds[0][30] == pytest.approx(4.0 * np.cos(0.3), rel=0.01)
    assert speeds[1][30] == pytest.approx(speeds[0][30] / 4.0, rel=1e-3)


def test_a_phase_brings_its_own_effectiveness_on_ideal_kinematics() -> None:
    whole = in_a_flow([0, 0], spread={"position": 1.0}).system
    aft = list_members({f"A{k}": [1.0, 2.0] for k in range(15)}, effectiveness={"layout": [[0.0], [1.0]]})
    other = in_a_flow([0, 0], spread={"position": 1.0}, agents=aft).system
    first, second = (d["agent_velocity"].values for d in stream([Phase(0, whole), Phase(5, other)], "ideal", 0))
    assert np.abs(first[..., 0]).max() > 0.1
    assert not second[..., 0].any()
    assert np.abs(second[..., 1]).max() > 0.1


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("bodies.vehicle", {"vehicle": ["otter"] * 16}),
        ("bodies.timestep", {"timestep": 0.02}),
        ("bodies.surface_height", {"surface_height": 1.0}),
        ("bodies.engine", {"engine": "fused"}),
        ("initial", {}),
        ("grid", {}),
    ],
)
def test_a_phase_cannot_change_the_vehicles_or_the_clock(name: str, change: dict[str, Any]) -> None:
    system = in_a_flow([0, 0]).system
    other = replace(system, bodies=replace(system.bodies, **change))
    if name == "initial":
        other = replace(system, initial=system.initial + 1.0)
    elif name == "grid":
        other = replace(system, grid=replace(system.grid, steps=9))
    with pytest.raises(InputError, match=rf"phase from sample 8 has other .*{name}.*expected the same") as error:
        phases_of([Phase(0, system), Phase(8, other)])
    assert "\n" not in str(error.value)


def test_worlds_that_step_together_refuse_phases() -> None:
    still, moving = (in_a_flow(drift).system for drift in ([0.0, 0.0], [2.0, 0.0]))
    with pytest.raises(InputError, match=r"without events.* in worlds"):
        Worlds([Fused([Phase(0, still), Phase(10, moving)])])


# -- states where a phase begins ---------------------------------------------------------------------------------------

FEEDFORWARD = {"feedforward": {"rounds": 2}}
LOSE = [{"time": 0.2, "lose": "A2"}, {"time": 0.3, "join": "A2"}]
GAIN = [{"time": 0.2, "set": {"controller.gain": 2}}]


@pytest.mark.parametrize(
    ("law", "links", "events"),
    [
        (FEEDFORWARD, {}, GAIN),
        (FEEDFORWARD, {}, LOSE),
        ({"integral": {"gain": 0.1}}, {}, GAIN),
        ({"newton": {"rounds": 2}}, {}, LOSE),
        ({}, {"delay": 0.1}, [{"time": 0.2, "set": {"links.all.hold": 0.3}}]),
        ({}, {"delay": 0.1, "loss": 0.2}, GAIN),
        ({}, {}, [{"time": 0.2, "cut": ["A1", "A2"]}, {"time": 0.3, "restore": ["A1", "A2"]}]),
        ({}, {}, LOSE),
    ],
    ids=["feedforward-gain", "feedforward-lose", "integral", "newton", "hold", "delay", "cut", "lose"],
)
def test_a_state_taken_where_a_phase_begins_is_that_of_the_new_phase(
    law: dict[str, Any], links: dict[str, Any], events: list[dict[str, Any]]
) -> None:
    scenario = two_boats(
        "hull",
        "hull",
        time={"end": 0.4},
        controller={"gain": 1.0, "control_period": 0.02, **law},
        links={"all": links},
        events=events,
    )
    require_resumable(scenario, [4 * sample for sample in (9, 10, 11, 14, 15, 16)], 80)
