"""Obstacles that vehicles touch where contacts are on. Oracles: signed distances, MuJoCo's own geoms, plain runs."""

from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf import load_scenario, simulate
from mjsheaf.law.obstacles import centres, distances
from mjsheaf.mujoco_import import mujoco
from mjsheaf.vehicles.arena import PREFIX
from tests.builders import OBSTACLES, build_scenario

_WALLS = [*OBSTACLES, {"id": "ground", "kind": "half_space", "point": [0.0, 0.0, 0.5], "normal": [0.0, 0.1, 1.0]}]


def world(**overrides: Any) -> mjsheaf.World:
    fields = {"safety.obstacles": _WALLS, "physics.contacts": True, "time.end": 3} | overrides
    return mjsheaf.World(load_scenario("swap", fields))


def signed(kind: int, size: Any, points: Any) -> Any:
    """Signed distance of points in a geom's own frame, by MuJoCo's definition of its sizes."""
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return points[:, 2]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        over = np.abs(points) - size
        return np.linalg.norm(np.maximum(over, 0.0), axis=1) + np.minimum(over.max(axis=1), 0.0)
    half = size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
    core = points - np.clip(points[:, 2:], -half, half) * [0.0, 0.0, 1.0]
    return np.linalg.norm(core, axis=1) - size[0]


@pytest.mark.long
def test_geoms_are_where_obstacles_are() -> None:
    """Signed distances of points from MuJoCo's geoms are those that the filter keeps, also after a while."""
    own = world()
    obstacles, timestep = own.system.obstacles, own.system.timestep
    assert obstacles is not None
    rng = np.random.default_rng(5)
    for steps in (0, 700, 700):
        own.step(steps)
        time = own.data.time - (timestep if own.data.time else 0.0)  # at which the last step put them
        points = rng.uniform([-6.0, -6.0, 0.0], [6.0, 6.0, 9.0], (40, 3))
        away = distances(obstacles, np.array([time]), points[None])[0]
        for n, name in enumerate(("pole", "crate", "ball", "ground")):
            g = own.model.geom(f"{PREFIX}{name}").id
            local = (points - own.data.geom_xpos[g]) @ own.data.geom_xmat[g].reshape(3, 3)
            found = signed(own.model.geom_type[g], own.model.geom_size[g], local)
            np.testing.assert_allclose(found, away[:, n], atol=1e-9)
        np.testing.assert_allclose(own.data.geom(f"{PREFIX}ball").xpos, centres(obstacles, time)[2], atol=1e-9)


@pytest.mark.long
def test_a_wall_that_is_faster_than_a_boat_pushes_it() -> None:
    """Without contacts the wall passes through the boat; with them the boat's origin stays outside."""
    motion = {"kind": "waypoints", "points": [[10.0, 0.0, 0.0]], "speed": 0.8}
    wall = {"kind": "box", "centre": [-6.0, 0.0, 0.0], "sides": [2.0, 20.0, 6.0], "motion": motion}
    nearest = {}
    for contacts in (False, True):
        scenario = build_scenario(
            {"A": {"position": [0.0, 0.0], "vehicle": "otter"}},
            {},
            [],
            time={"end": 12},
            controller={"gain": 0.5, "velocity_limit": 0.2},
            anchors=[{"agent": "A", "axes": ["x", "y"], "value": [0.0, 0.0]}],
            physics={"timestep": 0.002, "contacts": contacts},
            safety={"distance": 0.5, "obstacles": [wall]},
        )
        run = simulate(scenario)
        obstacles = scenario.system.obstacles
        assert obstacles is not None
        away = distances(obstacles, run["time"].values, run["agent_body_position"].values)
        nearest[contacts] = float(away.min())
    assert nearest[False] < 0.0
    assert nearest[True] > 0.5  # about half the boat's length


def test_models_without_contacts_have_no_obstacles() -> None:
    """Nothing is added where nothing touches: the same model, and the same bits with contacts and nothing near."""
    own = world(**{"physics.contacts": False})
    names = [own.model.geom(g).name for g in range(own.model.ngeom)]
    assert not [name for name in names if name.startswith(PREFIX)]
    far = [{"kind": "sphere", "centre": [900.0, 0.0, 10.0], "radius": 1.0}]
    runs = [
        simulate(load_scenario("swap", {"safety.obstacles": far, "physics.contacts": on, "time.end": 0.5}))
        for on in (False, True)
    ]
    np.testing.assert_array_equal(runs[0]["agent_position"], runs[1]["agent_position"])


@pytest.mark.long
def test_a_state_has_moving_obstacles() -> None:
    """A run that is continued from a state repeats itself to the bit."""
    one, other = world(), world()
    one.step(400)
    other.set_state(one.get_state())
    for own in (one, other):
        own.step(300)
    np.testing.assert_array_equal(one.data.qpos, other.data.qpos)
    np.testing.assert_array_equal(one.data.mocap_pos, other.data.mocap_pos)
