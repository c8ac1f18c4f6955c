"""Commands of actuators as actions: they replace law and autopilot, and nothing else.

Oracles: the run whose recorded commands are given again, to the bit; free fall; the weight of a drone.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf import Session, load_scenario
from mjsheaf.envs import Episode, dm_env, env, parallel_env
from mjsheaf.errors import InputError
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, mixed_scenario, refused
from tests.envs.test_faces import require_conformance
from tests.envs.test_vector import compare

G = 9.81  # m/s^2
KINDS = ["quadrotor", "x500", "otter", "otter_rudder", "wamv_azimuth"]


def fleet(kinds: list[str] = KINDS, **fields: Any) -> Scenario:
    """Vehicles far from each other that track a drone in still air and water; one physics step a period."""
    agents = {
        kind: {"vehicle": kind, "position": [10.0 * k, 0.0, 20.0][: 3 if kind in ("quadrotor", "x500") else 2]}
        for k, kind in enumerate(kinds)
    }
    usual: dict[str, Any] = {
        "time": {"end": 0.2},
        "controller": {"gain": 0.1, "control_period": 0.002},
        "physics": {"timestep": 0.002, "contacts": False},
    }
    target = {"vehicle": "x500", "position": [0.0, 10.0, 20.0]}
    return build_scenario(agents, {"drone": target}, [[kind, "drone"] for kind in kinds], **usual | fields)


def hold(episode: Episode, command: dict[str, Any], periods: int) -> None:
    """Hold a command for some periods."""
    for _ in range(periods):
        episode.act(command)
        episode.advance(episode.world.steps_per_sample)
    assert episode.message == ""


def test_the_recorded_commands_of_a_run_are_the_run_to_the_bit() -> None:
    """With one physics step a period, the commands that are recorded are all that the autopilot ever gave."""
    scenario = fleet()
    for engine in ("mujoco", "fused"):
        run = Session(scenario, engine=engine).engine.run()
        episode = Episode(scenario, action="thrust", engine=engine)
        ends = np.cumsum(episode.dimensions)
        for commands, positions in zip(run.log.thruster_command, run.log.positions, strict=True):
            np.testing.assert_array_equal(episode.world.positions(), positions)
            own = np.split(commands[: ends[-1]], ends[:-1])
            hold(episode, dict(zip(episode.agents, own, strict=True)), 1)
        assert (np.abs(run.log.positions[-1] - run.log.positions[0])[: len(KINDS)].max(axis=1) > 1e-4).all()


def test_hover_thrust_keeps_a_drone_up_and_zero_lets_it_fall() -> None:
    episode = Episode(fleet(["quadrotor"], time={"end": 2.0}), action="thrust")
    drone = episode.scenario.whole.vehicles[0]
    hold(episode, {"quadrotor": drone.trim}, 500)
    np.testing.assert_allclose(episode.world.positions()[0], [0.0, 0.0, 20.0], atol=1e-3)  # for a second
    episode.reset()
    hold(episode, {}, 500)
    fall = 20.0 - episode.world.positions()[0, 2]
    assert 0.7 * 0.5 * G < fall < 0.5 * G  # its rotors take time to stop, and air holds it
    idle = parallel_env(fleet(["x500"]), action="thrust")
    idle.reset()
    idle.step({"x500": np.zeros(4)})
    np.testing.assert_array_equal(idle.episode.world._loop.state.ctrl[:4], 1.0)  # its rotors never stop


def test_actions_are_fractions_of_the_limits_of_the_actuators() -> None:
    scenario = load_scenario("harbour", {"time.end": 1.0})
    team = parallel_env(scenario, action="thrust")
    for agent, vehicle in zip(scenario.team.agents, scenario.whole.vehicles, strict=False):
        limits = np.array([(channel.low, channel.high) for channel in vehicle.channels])
        space = team.action_space(agent.id)
        np.testing.assert_array_equal(team.episode.bounds[agent.id], limits.T)
        np.testing.assert_array_equal(space.low, np.where(limits[:, 0] < 0.0, -1.0, 0.0))
        np.testing.assert_array_equal(space.high, 1.0)
    scenario = fleet(["otter", "otter_rudder"])
    team = parallel_env(scenario, action="thrust")
    team.reset()
    team.step({"otter": np.array([-1.0, 0.5]), "otter_rudder": np.array([2.0, -0.5])})
    np.testing.assert_allclose(team.episode.world._loop.state.ctrl[:4], [-66.71, 59.84, 239.36, -0.5 * np.deg2rad(35)])
    spec = dm_env(scenario, action="thrust").action_spec()["otter"]
    np.testing.assert_array_equal([spec.minimum, spec.maximum], [[-66.71] * 2, [119.68] * 2])


def test_absent_agents_fall_stop_or_wait_whatever_their_action() -> None:
    events = [{"time": 0.1, "lose": "otter"}, {"time": 0.2, "join": "quadrotor"}]
    scenario = fleet(events=events, time={"end": 0.4})
    resting, acting = (Episode(scenario, action="thrust") for _ in range(2))
    full = {name: limits[1] for name, limits in resting.bounds.items()}
    for k in range(100):
        hold(resting, {name: command for name, command in full.items() if name not in ("quadrotor", "otter")}, 1)
        hold(acting, {name: command for name, command in full.items() if name != "otter" or k >= 50}, 1)
        np.testing.assert_array_equal(resting.world.positions(), acting.world.positions())
    assert resting.world.positions()[0, 2] == pytest.approx(20.0, abs=1e-3)  # it waits under its autopilot


@pytest.mark.filterwarnings("error")
def test_the_conformance_suites_pass() -> None:
    require_conformance(fleet(time={"end": 0.1}), action="thrust")


@pytest.mark.long
def test_a_vector_environment_takes_thrusts() -> None:
    compare(fleet(spread={"position": 0.5}), 8, action="thrust")
    compare(load_scenario("harbour", {"physics.contacts": False}), 3, action="thrust")


def test_a_copy_of_physics_goes_on_under_the_same_thrust() -> None:
    team = dm_env(fleet(), action="thrust")
    team.reset()
    team.step({"quadrotor": [9.0, 9.0, 9.0, 9.0]})
    copied = team.physics.copy()
    for physics in (team.physics, copied):
        physics.step(20)
    assert copied.data.qpos.tobytes() == team.physics.data.qpos.tobytes()


def test_what_has_no_thrusters_or_limits_is_refused() -> None:
    scenario = mixed_scenario()
    with refused(InputError, "'thrust'", "boat (vehicle hull)", "no limits", "'residual'"):
        env(scenario, action="thrust")
    with refused(InputError, "commanded is 'thrust'", "ideal kinematics", "physics"):
        Session(scenario, "ideal", commanded="thrust")
    drones = fleet(["quadrotor"])
    with refused(InputError, "action of quadrotor", "4 finite commands of its actuators"):
        parallel_env(drones, action="thrust").episode.act({"quadrotor": np.zeros(3)}, normalized=True)
    with Session(drones, commanded="thrust") as session:
        session.step([3.0, 3.0, 3.0, 3.0])
        with refused(InputError, "(4,) finite commands of actuators"):
            session.step(np.zeros((1, 3)))
