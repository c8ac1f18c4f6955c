"""What a vehicle's MJCF has of a scene is left out, and what cannot move with it is refused, as it is loaded."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from mjsheaf import Scenario, check, simulate
from mjsheaf.errors import InputError
from mjsheaf.vehicles import loading
from mjsheaf.vehicles.arena import compose
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.vehicle import GRAVITY
from tests.builders import Edit, Part, adding, altered, find, pursuit
from tests.commands import answer_of

SCENE: list[Part] = [  # a floor with a material, a body with a height field, light, camera, and what refers to them
    ("asset", '<hfield name="hills" nrow="4" ncol="4" size="5 5 1 .1"/>'),
    ("worldbody", '<geom name="floor" type="plane" size="0 0 .1" material="livery"/>'),
    ("worldbody", '<body name="ground"><geom type="hfield" hfield="hills" name="hills"/></body>'),
    ("worldbody", '<light pos="0 0 3"/>'),
    ("worldbody", '<camera name="top" pos="0 0 9"/>'),
    (
        "",
        """<sensor>
          <distance geom1="floor" geom2="collision" cutoff="1"/>
          <framepos objtype="camera" objname="top"/>
        </sensor>""",
    ),
    ("", '<contact><pair geom1="floor" geom2="collision"/></contact>'),
]
MOCAP = ("worldbody", '<body name="goal" mocap="true"><geom size=".1" mass="0"/></body>')


def one(vehicle: str) -> Scenario:
    return pursuit([0, 0, 9], [1, 0, 9], {"vehicle": vehicle}, time={"end": 0.1})


def as_published(root: ElementTree.Element) -> None:
    """As files of collections are: a free joint where it stands, furniture, a sky, keyframe, sensors, options."""
    find(root, "worldbody/body").attrib.update(pos="0 0 0.1", euler="0 0 1")
    adding(
        *SCENE,
        MOCAP,
        ("worldbody/body", '<freejoint name="root"/>'),
        ("worldbody/body", '<camera name="eye" mode="targetbody" target="ground"/>'),
        ("worldbody", '<geom name="wall" type="box" size="1 1 1" pos="3 0 0"/>'),
        ("", '<option timestep="0.01" integrator="RK4" density="1.225" viscosity="1.8e-5"/>'),
        ("", '<keyframe><key name="hover" qpos="0 0 1 1 0 0 0"/></keyframe>'),
        ("asset", '<texture type="skybox" builtin="flat" width="8" height="48"/>'),
    )(root)


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
    runs = [simulate(one(name), engine="mujoco") for name in (str(tmp_path / "x500.yaml"), "x500")]
    np.testing.assert_array_equal(runs[0].agent_position, runs[1].agent_position)


def test_what_is_left_out_is_a_note_and_in_the_list(tmp_path: Path) -> None:
    path = altered(tmp_path, "x500", adding(*SCENE))
    shown = " ".join(answer_of("list", "--vehicles", path).out.split())
    assert "plane 'floor', height field 'hills', a light, camera 'top'" in shown
    (note,) = [text for text in check(one(path), trial=False)["notes"] if "left out" in text]
    assert note.startswith("left out of x500.xml: plane 'floor', height field 'hills', a light")


def two_vehicles(root: ElementTree.Element) -> None:
    as_published(root)
    adding(("worldbody", '<body name="ball"><freejoint/><geom size=".1"/></body>'))(root)


def away_from_others(root: ElementTree.Element) -> None:
    """Without a free joint nothing says which of several bodies is the vehicle, and where its origin is."""
    find(root, "worldbody/body").set("pos", "0 0 3")
    adding(("worldbody", '<body name="table" pos="1 0 0"><geom size=".1"/></body>'))(root)


TILTED = adding(("", '<option gravity="1 0 -9.81"/>'))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (two_vehicles, r"x500\.xml: body 'body' and body 'ball' have free joints; expected one"),
        (away_from_others, r"x500\.xml: body 'body' is neither at the origin nor alone in <worldbody>"),
        (TILTED, r"x500\.xml: option: gravity is 1 0 -9\.81; expected one along z"),
    ],
)
def test_what_would_move_it_otherwise_is_refused(edit: Edit, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        load_vehicle(altered(tmp_path, "x500", edit))


@pytest.mark.parametrize("down", [0.0, 1.62, 9.8])
def test_a_vehicle_has_the_weight_of_its_file(down: float, tmp_path: Path) -> None:
    edit = adding(("", f'<option gravity="0 0 {-down}"/>'))
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
