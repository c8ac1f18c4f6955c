"""What a vehicle's MJCF has of a scene is left out, and what cannot move with it is refused, as it is loaded."""

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from mjsheaf import check, load_scenario, simulate
from mjsheaf.errors import InputError
from mjsheaf.simulation.arena import compose
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import altered, find
from tests.commands import answer_of


def with_scene(root: ElementTree.Element) -> None:
    """A floor with a material, a body with a height field, light, camera, and what refers to them."""
    world, asset = find(root, "worldbody"), find(root, "asset")
    ElementTree.SubElement(asset, "hfield", name="hills", nrow="4", ncol="4", size="5 5 1 .1")
    ElementTree.SubElement(world, "geom", name="floor", type="plane", size="0 0 .1", material="livery")
    ElementTree.SubElement(
        ElementTree.SubElement(world, "body", name="ground"), "geom", type="hfield", hfield="hills", name="hills"
    )
    ElementTree.SubElement(world, "light", pos="0 0 3")
    ElementTree.SubElement(world, "camera", name="top", pos="0 0 9")
    sensor = ElementTree.SubElement(root, "sensor")
    ElementTree.SubElement(sensor, "distance", geom1="floor", geom2="collision", cutoff="1")
    ElementTree.SubElement(sensor, "framepos", objtype="camera", objname="top")
    ElementTree.SubElement(ElementTree.SubElement(root, "contact"), "pair", geom1="floor", geom2="collision")


def with_mocap(root: ElementTree.Element) -> None:
    ElementTree.SubElement(
        ElementTree.SubElement(find(root, "worldbody"), "body", name="goal", mocap="true"), "geom", size=".1", mass="0"
    )


def test_a_scene_is_left_out(tmp_path: Path) -> None:
    vehicle, plain = load_vehicle(altered(tmp_path, "x500", with_scene)), load_vehicle("x500")
    assert vehicle.left_out == ("plane 'floor'", "height field 'hills'", "a light", "camera 'top'", "2 sensors")
    assert plain.left_out == ()
    assert vehicle.mass == plain.mass
    np.testing.assert_array_equal(vehicle.inertia, plain.inertia)
    np.testing.assert_array_equal(vehicle.W, plain.W)
    model = compose([vehicle, vehicle], ["A", "B"]).model
    assert not np.isin(model.geom_type, [mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD]).any()
    own = [model.camera(k).name for k in range(model.ncam)]
    assert not [name for name in own if "top" in name]


def test_a_list_says_what_is_left_out(tmp_path: Path) -> None:
    shown = " ".join(answer_of("list", "--vehicles", altered(tmp_path, "x500", with_scene)).out.split())
    assert "plane 'floor', height field 'hills', a light, camera 'top'" in shown


@pytest.mark.parametrize(
    "ask",
    [
        lambda path: load_vehicle(path),
        lambda path: check(load_scenario(one(path)), trial=False),
        lambda path: simulate(load_scenario(one(path)), engine="fused"),
        lambda path: simulate(load_scenario(one(path)), engine="mujoco"),
    ],
    ids=["load", "check", "fused", "mujoco"],
)
def test_a_mocap_body_is_refused_with_its_name_everywhere(ask: Callable[[str], object], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"x500\.xml: body 'goal' has mocap"):
        ask(altered(tmp_path, "x500", with_mocap))


def one(vehicle: str) -> dict[str, object]:
    return {
        "time": {"end": 0.1},
        "agents": [{"id": "A", "position": [0, 0, 9], "vehicle": vehicle}],
        "targets": [{"id": "T", "position": [1, 0, 9]}],
        "sensing": [["A", "T"]],
    }
