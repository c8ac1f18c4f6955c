"""Composition: a vehicle's MJCF means the same in the arena as when MuJoCo compiles it alone.

Oracle: the file compiled alone by MuJoCo.
"""

import inspect
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from mjsheaf.backends.physics import arena as arena_module
from mjsheaf.backends.physics import compose, load_vehicle
from mjsheaf.backends.physics.vehicle import GRAVITY
from mjsheaf.errors import InputError
from mjsheaf.resources import resource_directory

from .alone import alone, ask
from .vehicles import Edit, altered, find

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def turned_in_degrees(root: ElementTree.Element) -> None:
    """Degrees, which MJCF has where nothing is said; every way to write an orientation that depends on it."""
    root.remove(find(root, "compiler"))
    body = find(root, ".//body")
    body.set("euler", "0 0 90")
    inner = ElementTree.SubElement(body, "body", name="inner", pos=".3 .2 .1", axisangle="1 2 0 40")
    ElementTree.SubElement(inner, "geom", name="box", type="box", size=".3 .2 .1", euler="10 20 30", mass="7")
    ElementTree.SubElement(inner, "site", name="mark", axisangle="0 1 1 70")
    ElementTree.SubElement(inner, "camera", name="eye", euler="0 45 0")
    slanted = ElementTree.SubElement(find(root, "default"), "default", {"class": "slanted"})
    ElementTree.SubElement(slanted, "geom", euler="0 30 0", type="box", size=".5 .3 .1")
    ElementTree.SubElement(inner, "geom", {"class": "slanted", "name": "slanted", "mass": "3"})


def in_another_order(root: ElementTree.Element) -> None:
    turned_in_degrees(root)
    root.insert(0, ElementTree.Element("compiler", angle="degree", eulerseq="ZYX"))
    find(root, ".//body").set("euler", "90 0 0")


def with_settings_of_its_own(root: ElementTree.Element) -> None:
    find(root, "compiler").set("angle", "degree")
    ElementTree.SubElement(root, "option", gravity="0 0 -1", timestep="0.5")
    ElementTree.SubElement(root, "statistic", extent="3")
    ElementTree.SubElement(root, "size", memory="10M")
    visual = ElementTree.SubElement(root, "visual")
    ElementTree.SubElement(visual, "map", zfar="7")


def with_mass_from_geoms(root: ElementTree.Element) -> None:
    """No <inertial>, and compiler settings that decide about mass."""
    find(root, "compiler").attrib.update(inertiafromgeom="true", boundmass="0.5", inertiagrouprange="3 3")
    find(root, "default/default[@class='collision']/geom").set("mass", "321.12345678901")
    body = find(root, ".//body")
    massless = ElementTree.SubElement(body, "body", name="massless")
    ElementTree.SubElement(massless, "geom", size=".1", group="2", density="5000")


def with_key_and_sensors(root: ElementTree.Element) -> None:
    ElementTree.SubElement(ElementTree.SubElement(root, "keyframe"), "key", name="on", ctrl="1 1 1 1")
    sensor = ElementTree.SubElement(root, "sensor")
    ElementTree.SubElement(sensor, "actuatorfrc", actuator="thruster_bow_port")
    ElementTree.SubElement(sensor, "gyro", name="gyro", site="thruster_bow_port")


def with_a_mesh(root: ElementTree.Element) -> None:
    find(root, "compiler").attrib.update(meshdir="meshes", angle="degree")
    ElementTree.SubElement(find(root, "asset"), "mesh", name="tetrahedron", file="tetrahedron.obj")
    ElementTree.SubElement(
        find(root, ".//body"),
        "geom",
        name="sail",
        type="mesh",
        mesh="tetrahedron",
        euler="0 0 30",
        pos="0 0 2",
        mass="0",
    )


def with_a_second_body(root: ElementTree.Element) -> None:
    """Beside the first, with a material of the file's."""
    second = ElementTree.SubElement(find(root, "worldbody"), "body", name="second", pos="1 0 .5")
    ElementTree.SubElement(second, "geom", name="ball", size=".1", mass="3", material="livery")


def with_world_geom(root: ElementTree.Element) -> None:
    ElementTree.SubElement(find(root, "worldbody"), "geom", name="halo", size="1", mass="0")


@pytest.mark.parametrize(
    "edit",
    [
        None,
        turned_in_degrees,
        in_another_order,
        with_settings_of_its_own,
        with_mass_from_geoms,
        with_key_and_sensors,
        with_a_mesh,
        with_world_geom,
        with_a_second_body,
    ],
)
def test_a_file_means_the_same_in_the_arena(edit: Edit | None, tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "tetrahedron.obj").write_text(TETRAHEDRON)
    path = altered(tmp_path, "hull", edit)
    vehicle = load_vehicle(path)
    arena = compose([load_vehicle("aerial"), vehicle, vehicle], ["other", "one", "two"])
    model, alone = arena.model, mujoco.MjModel.from_xml_path(str(vehicle.path))
    here, there = mujoco.MjData(model), mujoco.MjData(alone)
    mujoco.mj_kinematics(model, here)
    mujoco.mj_camlight(model, here)
    mujoco.mj_kinematics(alone, there)
    mujoco.mj_camlight(alone, there)
    ends = [*arena.body[1:], model.nbody]
    for v, name in ((1, "one"), (2, "two")):
        own = slice(ends[v] - (alone.nbody - 1), ends[v])  # a body that holds several comes before them
        for field in ("body_mass", "body_inertia", "body_gravcomp"):
            np.testing.assert_allclose(getattr(model, field)[own], getattr(alone, field)[1:], rtol=1e-12, err_msg=field)
        for field in ("xpos", "xmat", "xipos", "ximat"):
            np.testing.assert_allclose(getattr(here, field)[own], getattr(there, field)[1:], atol=1e-12, err_msg=field)
        for kind, count, label in (
            ("geom", alone.ngeom, "geom"),
            ("site", alone.nsite, "site"),
            ("cam", alone.ncam, "camera"),
        ):
            for k in range(count):
                given = getattr(alone, label)(k).name
                if given:
                    at = getattr(model, label)(f"{name}/{given}").id
                    for field in (f"{kind}_xpos", f"{kind}_xmat"):
                        np.testing.assert_allclose(getattr(here, field)[at], getattr(there, field)[k], atol=1e-12)
    np.testing.assert_array_equal(model.opt.gravity, [0.0, 0.0, -GRAVITY])
    assert (model.opt.timestep, model.stat.extent) == (0.001, 20.0)


@pytest.mark.parametrize("name", ["hexarotor", "quadrotor"])
def test_a_body_on_the_joint_moves_as_one_that_is_held(name: str, tmp_path: Path) -> None:
    """What a file has beside its one body makes no difference to the motion, though a body must then hold both."""
    runs = []
    for vehicle in (name, altered(tmp_path, name, with_world_geom)):
        world = alone(vehicle, heading=40, drift=[1.0, -2.0, 0.5])
        ask(world, [2.0, 1.0, -0.5])
        world.step(1500)
        runs.append(world)
    one, held = runs
    assert one.model.nbody == held.model.nbody - 1
    np.testing.assert_allclose(one.data.qpos[:7], held.data.qpos[:7], rtol=0, atol=1e-10)
    np.testing.assert_allclose(one.data.qvel[:6], held.data.qvel[:6], rtol=0, atol=1e-9)
    assert np.linalg.norm(one.data.qpos[:3]) > 1.0


def test_gravity_stands_in_one_place() -> None:
    assert "gravity" not in (resource_directory("models") / "arena.xml").read_text()
    assert "9.8" not in inspect.getsource(arena_module)


def test_a_difference_from_the_file_alone_is_noticed() -> None:
    vehicle = load_vehicle("hull")
    heavier = [{**inertial, "mass": 401.0} for inertial in vehicle.inertials]
    fatter = [{**inertial, "diaginertia": [201.0, 1000.0, 1100.0]} for inertial in vehicle.inertials]
    ahead = [{**inertial, "pos": [0.01, 0.0, 0.0]} for inertial in vehicle.inertials]
    for inertials, what in ((heavier, "mass"), (fatter, "inertia"), (ahead, "centre of mass")):
        with pytest.raises(InputError, match=rf"hull\.xml: its {what} is .* in the arena, but .* when compiled alone"):
            compose([load_vehicle("aerial"), replace(vehicle, inertials=inertials)], ["A", "B"])


def without_names(root: ElementTree.Element) -> None:
    first, second, third, _ = find(root, "actuator")
    first.attrib.pop("name")
    second.attrib.pop("name")
    third.set("name", "thruster_1")


def test_thrusters_without_a_name_get_one(tmp_path: Path) -> None:
    vehicle = load_vehicle(altered(tmp_path, "hull", without_names))
    assert vehicle.thrusters == ["thruster_0", "thruster_1_", "thruster_1", "thruster_stern_starboard"]
    model = compose([vehicle], ["A"]).model
    assert [model.actuator(k).name for k in range(model.nu)] == [f"A/{name}" for name in vehicle.thrusters]


def in_a_frame(root: ElementTree.Element) -> None:
    world = find(root, "worldbody")
    body = find(world, "body")
    world.remove(body)
    ElementTree.SubElement(world, "frame", euler="0 0 1").append(body)


def with_a_slash(root: ElementTree.Element) -> None:
    """PyMJCF keeps the slash for what is attached."""
    find(root, ".//body").set("name", "A/B")


@pytest.mark.parametrize("edit", [in_a_frame, with_a_slash])
def test_what_pymjcf_cannot_read_is_refused(edit: Edit, tmp_path: Path) -> None:
    vehicle = load_vehicle(altered(tmp_path, "hull", edit))
    with pytest.raises(InputError, match=r"hull\.xml: PyMJCF cannot read it: "):
        compose([vehicle], ["A"])
