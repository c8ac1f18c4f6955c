"""What a vehicle's MJCF has of a scene is left out, and what cannot move with it is refused, as it is loaded."""

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from mjsheaf import check, load_scenario, simulate
from mjsheaf.errors import InputError
from mjsheaf.vehicles import loading
from mjsheaf.vehicles.arena import compose
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.vehicle import GRAVITY
from tests.builders import Edit, altered, find
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
    assert vehicle.left_out == ("plane 'floor'", "height field 'hills'", "a light", "camera 'top'", "sensors")
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


def as_published(root: ElementTree.Element) -> None:
    """As files of collections are: a free joint where it stands, furniture, a sky, keyframe, sensors, options."""
    with_scene(root)
    with_mocap(root)
    world = find(root, "worldbody")
    body = find(world, "body")
    body.set("pos", "0 0 0.1")
    body.set("euler", "0 0 1")
    ElementTree.SubElement(body, "freejoint", name="root")
    ElementTree.SubElement(body, "camera", name="eye", mode="targetbody", target="ground")
    ElementTree.SubElement(world, "geom", name="wall", type="box", size="1 1 1", pos="3 0 0")
    ElementTree.SubElement(root, "option", timestep="0.01", integrator="RK4", density="1.225", viscosity="1.8e-5")
    ElementTree.SubElement(ElementTree.SubElement(root, "keyframe"), "key", name="hover", qpos="0 0 1 1 0 0 0")
    ElementTree.SubElement(find(root, "asset"), "texture", type="skybox", builtin="flat", width="8", height="48")


def test_a_published_file_is_the_vehicle_alone(tmp_path: Path) -> None:
    """The model is that of the same file without all that, to the bit; each part that is left out is said once."""
    published, plain = load_vehicle(altered(tmp_path, "x500", as_published)), load_vehicle("x500")
    said = ", ".join(published.left_out)
    for part in (
        "free joint 'root'", "pose of body 'body'", "plane 'floor'", "geom 'wall'", "body 'ground'", "body 'goal'",
        "a light", "camera 'top'", "keyframe 'hover'", "sensors",
        "option density, integrator, timestep, viscosity (drag is that of the description)",
    ):  # fmt: skip
        assert said.count(part) == 1, (part, said)
    models = [compose([vehicle, vehicle], ["A", "B"]).model for vehicle in (published, plain)]
    for name in ("ngeom", "ncam", "nlight", "nsensor", "nbody", "ntex", "nkey"):
        assert getattr(models[0], name) == getattr(models[1], name), name
    for name in ("body_mass", "body_inertia", "body_ipos", "body_pos", "actuator_gear", "geom_pos", "site_pos"):
        np.testing.assert_array_equal(getattr(models[0], name), getattr(models[1], name))
    runs = [simulate(load_scenario(one(name)), engine="mujoco") for name in (str(tmp_path / "x500.yaml"), "x500")]
    np.testing.assert_array_equal(runs[0].agent_position, runs[1].agent_position)


@pytest.mark.parametrize("ask", [lambda path: check(load_scenario(one(path)), trial=False)["notes"]], ids=["check"])
def test_what_is_left_out_is_a_note(ask: Callable[[str], list[str]], tmp_path: Path) -> None:
    (note,) = [text for text in ask(altered(tmp_path, "x500", with_scene)) if "left out" in text]
    assert note.startswith("left out of x500.xml: plane 'floor', height field 'hills', a light")


def on_a_wall(root: ElementTree.Element) -> None:
    as_published(root)
    ElementTree.SubElement(find(root, "worldbody"), "site", name="hook")
    find(root, "actuator")[0].set("site", "hook")


def two_vehicles(root: ElementTree.Element) -> None:
    as_published(root)
    ball = ElementTree.SubElement(find(root, "worldbody"), "body", name="ball")
    ElementTree.SubElement(ball, "freejoint")
    ElementTree.SubElement(ball, "geom", size=".1")


def away_from_others(root: ElementTree.Element) -> None:
    """Without a free joint nothing says which of several bodies is the vehicle, and where its origin is."""
    world = find(root, "worldbody")
    find(world, "body").set("pos", "0 0 3")
    ElementTree.SubElement(ElementTree.SubElement(world, "body", name="table", pos="1 0 0"), "geom", size=".1")


def with_damping(root: ElementTree.Element) -> None:
    """From a default class, as in some published files."""
    ElementTree.SubElement(find(root, "default"), "joint", damping="1")
    ElementTree.SubElement(find(root, ".//body"), "joint", name="root", type="free")


def tilted_gravity(root: ElementTree.Element) -> None:
    ElementTree.SubElement(root, "option", gravity="1 0 -9.81")


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (on_a_wall, r"x500\.xml: actuator '\w+' acts on site 'hook'; every actuator must act on a site of the vehicle"),
        (two_vehicles, r"x500\.xml: body 'body' and body 'ball' have free joints; expected one"),
        (away_from_others, r"x500\.xml: body 'body' is neither at the origin nor alone in <worldbody>"),
        (with_damping, r"x500\.xml: joint 'root': damping is 1 0 0, which is not modelled; expected 0 0 0"),
        (tilted_gravity, r"x500\.xml: option: gravity is 1 0 -9\.81; expected one along z"),
    ],
)
def test_what_would_move_it_otherwise_is_refused(edit: Edit, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        load_vehicle(altered(tmp_path, "x500", edit))


@pytest.mark.parametrize("down", [0.0, 1.62, 9.8])
def test_a_vehicle_has_the_weight_of_its_file(down: float, tmp_path: Path) -> None:
    def edit(root: ElementTree.Element) -> None:
        ElementTree.SubElement(root, "option", gravity=f"0 0 {-down}")

    vehicle = load_vehicle(altered(tmp_path, "submersible", edit))
    plain = load_vehicle("submersible")
    assert vehicle.weight == pytest.approx(plain.weight * down / GRAVITY)
    drone = load_vehicle(altered(tmp_path, "aerial", edit))
    assert drone.weight == pytest.approx(drone.mass * down, abs=1e-12)
    np.testing.assert_allclose(drone.W @ drone.trim, [0, 0, drone.mass * down, 0, 0, 0], atol=1e-9)


def test_a_shipped_vehicle_is_read_again_where_its_files_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    altered(tmp_path, "hull")
    monkeypatch.setattr(loading, "list_vehicles", lambda: {"hull": tmp_path / "hull.yaml"})
    first = load_vehicle("hull")
    assert load_vehicle("hull") is first
    altered(tmp_path, "hull", lambda root: find(root, ".//inertial").set("mass", "401"))
    assert load_vehicle("hull").mass == 401.0
