"""Composition: a vehicle's MJCF means the same in the arena as when MuJoCo compiles it alone.

Oracle: the file compiled alone by MuJoCo.
"""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from mjsheaf.errors import InputError
from mjsheaf.vehicles.arena import compose
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.vehicle import GRAVITY
from tests.builders import TETRAHEDRON, Edit, Part, adding, altered, find
from tests.loop.one_vehicle import alone, ask

IN_DEGREES: list[Part] = [  # every way to write an orientation that depends on the unit
    ("default", '<default class="slanted"><geom euler="0 30 0" type="box" size=".5 .3 .1"/></default>'),
    (
        ".//body",
        """<body name="inner" pos=".3 .2 .1" axisangle="1 2 0 40">
          <geom name="box" type="box" size=".3 .2 .1" euler="10 20 30" mass="7"/>
          <site name="mark" axisangle="0 1 1 70"/>
          <camera name="eye" euler="0 45 0"/>
          <geom class="slanted" name="slanted" mass="3"/>
        </body>""",
    ),
]


def turned_in_degrees(root: ElementTree.Element) -> None:
    """Degrees, which MJCF has where nothing is said."""
    root.remove(find(root, "compiler"))
    find(root, ".//body").set("euler", "0 0 90")
    adding(*IN_DEGREES)(root)


def in_another_order(root: ElementTree.Element) -> None:
    turned_in_degrees(root)
    root.insert(0, ElementTree.Element("compiler", angle="degree", eulerseq="ZYX"))
    find(root, ".//body").set("euler", "90 0 0")


def with_mass_from_geoms(root: ElementTree.Element) -> None:
    """No <inertial>, and compiler settings that decide about mass."""
    find(root, "default/default[@class='collision']/geom").set("mass", "321.12345678901")
    massless = '<body name="massless"><geom size=".1" group="2" density="5000"/></body>'
    adding((".//body", massless), inertiafromgeom="true", boundmass="0.5", inertiagrouprange="3 3")(root)


def in_a_frame(root: ElementTree.Element) -> None:
    world = find(root, "worldbody")
    body = find(world, "body")
    world.remove(body)
    ElementTree.SubElement(world, "frame", euler="0 0 1").append(body)


def with_full_inertia(root: ElementTree.Element) -> None:
    """A mass matrix that is not diagonal, and settings that spoil one which is scaled."""
    find(root, "compiler").attrib.update(boundinertia="90", balanceinertia="true")
    inertial = find(root, ".//inertial")
    inertial.attrib.pop("diaginertia")
    inertial.set("fullinertia", "300 900 1000 50 -20 10")


HALO = ("worldbody", '<geom name="halo" size="1" mass="0"/>')
EDITS: dict[str, Edit | None] = {
    "as it is": None,
    "in degrees": turned_in_degrees,
    "in another order": in_another_order,
    "settings of its own": adding(
        ("", '<option gravity="0 0 -1" timestep="0.5"/>'),
        ("", '<statistic extent="3"/>'),
        ("", '<size memory="10M"/>'),
        ("", '<visual><map zfar="7"/></visual>'),
        angle="degree",
    ),
    "mass from geoms": with_mass_from_geoms,
    "key and sensors": adding(
        ("", '<keyframe><key name="on" ctrl="1 1 1 1"/></keyframe>'),
        (
            "",
            '<sensor><actuatorfrc actuator="thruster_bow_port"/><gyro name="gyro" site="thruster_bow_port"/></sensor>',
        ),
    ),
    "a mesh": adding(
        ("asset", '<mesh name="tetrahedron" file="tetrahedron.obj"/>'),
        (".//body", '<geom name="sail" type="mesh" mesh="tetrahedron" euler="0 0 30" pos="0 0 2" mass="0"/>'),
        meshdir="meshes",
        angle="degree",
    ),
    "in a frame": in_a_frame,
    "a slash": lambda root: find(root, ".//body").set("name", "A/B"),  # as attached parts have it
    "full inertia": with_full_inertia,
    "replicas": adding(  # a geom, two bodies from one; meshes by a path that is stripped, defaults within defaults
        HALO,
        (
            "default",
            """<default class="outer"><geom density="300" size=".2"/>
              <default class="inner"><geom pos="0 0 .1"/></default>
            </default>""",
        ),
        (
            "worldbody",
            """<replicate count="2" offset="1 0 0" euler="0 0 20">
              <body name="pod" pos=".5 0 0" childclass="inner"><geom/></body>
            </replicate>""",
        ),
        strippath="true",
    ),
}


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_a_file_means_the_same_in_the_arena(edit: Edit | None, tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "tetrahedron.obj").write_text(TETRAHEDRON)
    path = altered(tmp_path, "hull", edit)
    vehicle = load_vehicle(path)
    arena = compose([load_vehicle("aerial"), vehicle, vehicle], ["other", "one", "two"])
    model, alone = arena.model, mujoco.MjModel.from_xml_path(str(vehicle.path))
    if np.count_nonzero(alone.body_parentid[1:] == 0) == 1:  # its pose is where it stands
        alone.body_pos[1], alone.body_quat[1] = 0.0, [1.0, 0.0, 0.0, 0.0]
    here, there = mujoco.MjData(model), mujoco.MjData(alone)
    mujoco.mj_kinematics(model, here)
    mujoco.mj_camlight(model, here)
    mujoco.mj_kinematics(alone, there)
    mujoco.mj_camlight(alone, there)
    ends = [*arena.body[1:], model.nbody]
    for v, name in ((1, "one"), (2, "two")):
        own = slice(ends[v] - (alone.nbody - 1), ends[v])  # a body that holds several comes before them
        for field in ("body_mass", "body_inertia"):
            np.testing.assert_allclose(getattr(model, field)[own], getattr(alone, field)[1:], rtol=1e-12, err_msg=field)
        weights = [(1.0 - one.body_gravcomp) * one.opt.gravity[2] for one in (model, alone)]
        np.testing.assert_allclose(weights[0][own], weights[1][1:], rtol=1e-12, err_msg="weight")
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
    """Other elements next to the single body of a file do not change the motion, although an extra body holds both."""
    runs = []
    for vehicle in (name, altered(tmp_path, name, adding(HALO))):
        world = alone(vehicle, heading=40, drift=[1.0, -2.0, 0.5])
        ask(world, [2.0, 1.0, -0.5])
        world.step(1500)
        runs.append(world)
    one, held = runs
    assert one.model.nbody == held.model.nbody - 1
    np.testing.assert_allclose(one.data.qpos[:7], held.data.qpos[:7], rtol=0, atol=1e-10)
    np.testing.assert_allclose(one.data.qvel[:6], held.data.qvel[:6], rtol=0, atol=1e-9)
    assert np.linalg.norm(one.data.qpos[:3]) > 1.0


def test_a_difference_from_the_file_alone_is_noticed() -> None:
    vehicle = load_vehicle("hull")
    heavier = [inertial._replace(mass=401.0) for inertial in vehicle.inertials]
    fatter = [inertial._replace(diagonal=np.array([201.0, 1000.0, 1100.0])) for inertial in vehicle.inertials]
    ahead = [inertial._replace(position=np.array([0.01, 0.0, 0.0])) for inertial in vehicle.inertials]
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


PLAIN = 'contype="0" conaffinity="0" mass="0" size=".1"'
LOOKS = adding(  # a textured sail, a site and a second body with materials, a livery geom with a colour of its own
    ("asset", '<texture name="cloth" type="2d" builtin="checker" width="8" height="8" rgb1="1 0 0"/>'),
    ("asset", '<material name="sail" texture="cloth" shininess=".7"/>'),
    (".//body", f'<geom name="sail" material="sail" {PLAIN}/>'),
    (".//body", f'<geom name="own" material="livery" rgba="0 1 0 .4" {PLAIN}/>'),
    (".//body", '<site name="lamp" material="livery"/>'),
    ("worldbody", f'<body name="second" pos="1 0 .5"><geom name="ball" material="livery" {PLAIN}/></body>'),
)


def look(model: mujoco.MjModel, kind: str, k: int) -> tuple[np.ndarray, list[float], list[int]]:
    """Return the drawn appearance: colour, which that of the geom overrides; shine; True if there is a texture."""
    rgba, material = getattr(model, f"{kind}_rgba")[k], int(getattr(model, f"{kind}_matid")[k])
    if material < 0:
        return rgba, [], []
    own = not np.array_equal(rgba, np.array([0.5, 0.5, 0.5, 1.0], np.float32))
    shine = [float(getattr(model, f"mat_{name}")[material]) for name in ("emission", "specular", "shininess")]
    return rgba if own else model.mat_rgba[material], shine, (model.mat_texid[material] >= 0).tolist()


@pytest.mark.parametrize("edit", [None, LOOKS], ids=["hull", "with looks"])
def test_vehicles_look_as_in_their_file_and_share_materials(edit: Edit | None, tmp_path: Path) -> None:
    """MuJoCo draws at most 999 materials: their number is that of the kinds' files, however many vehicles there are."""
    vehicle, other = load_vehicle(altered(tmp_path, "hull", edit)), load_vehicle("aerial")
    alone = mujoco.MjModel.from_xml_path(str(vehicle.path))
    livery = alone.material("livery").id
    sizes = []
    for copies in (2, 30):
        names = [f"V{k}" for k in range(copies)]
        colours = np.random.default_rng(copies).uniform(size=(copies + 1, 3))
        model = compose([other, *[vehicle] * copies], ["A", *names], colours=colours).model
        sizes.append((model.nmat, model.ntex))
        for v, name in enumerate(names, 1):
            for kind, count in (("geom", alone.ngeom), ("site", alone.nsite)):
                bodies = getattr(model, f"{kind}_bodyid")
                first = [k for k, body in enumerate(bodies) if model.body(body).name.split("/")[0] == name]
                assert len(first) == count
                for here, there in zip(first, range(count), strict=True):
                    colour, *rest = look(model, kind, here)
                    expected, *as_alone = look(alone, kind, there)
                    if getattr(alone, f"{kind}_matid")[there] == livery and expected[3] == 1.0:
                        expected = np.array([*colours[v], 1.0])
                    np.testing.assert_allclose(colour, expected, atol=1e-6)
                    assert rest == as_alone
    assert sizes[0] == sizes[1]
    assert sizes[0][0] < 20
