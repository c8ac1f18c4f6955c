"""Vehicles: what is read from MJCF and description, and the control effectiveness that follows.

Oracles: wrenches worked out here from the sites' positions and axes as they stand in the MJCF text; the definition
g = C (R D R^T)^-1 R W_f; and that u = g^+ v makes the drag's force for v and no moment.
"""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.steering import Full
from mjsheaf.vehicles.vehicle import Vehicle
from tests.builders import ONE_BOAT, RAFT, Edit, adding, altered, attitudes, find, refused, setting, xml_of, yaws
from tests.commands import answer_of, is_refusal

NAMES = ("hull", "aerial", "submersible")
ANISOTROPIC = np.array([300.0, 700.0, 1100.0])


def numbers(text: str | None) -> Array:
    return np.array([float(x) for x in (text or "").split()])


def wrenches(root: ElementTree.Element) -> Array:
    """W, shape (6, s), from the text: force along the site's z axis, moment about the origin, rotor torque."""
    columns = []
    for actuator in find(root, "actuator"):
        site = find(root, f".//site[@name='{actuator.get('site')}']")
        axis = numbers(site.get("zaxis", "0 0 1"))
        axis /= np.linalg.norm(axis)
        gear = numbers(actuator.get("gear", "0 0 1 0 0 0"))
        gain = float(actuator.get("gainprm", "1"))
        force = gear[2] * axis
        columns.append(gain * np.concatenate([force, np.cross(numbers(site.get("pos")), force) + gear[5] * axis]))
    return np.array(columns).T


@pytest.mark.parametrize("name", NAMES)
def test_wrenches_are_those_of_the_thrusters_in_the_file(name: str) -> None:
    vehicle = load_vehicle(name)
    np.testing.assert_allclose(vehicle.W, wrenches(xml_of(name)), atol=1e-12)
    assert vehicle.thrusters == [a.get("name") for a in find(xml_of(name), "actuator")]
    inertial = find(xml_of(name), ".//inertial")
    assert vehicle.mass == float(inertial.get("mass", ""))
    np.testing.assert_allclose(vehicle.inertia, np.diag(numbers(inertial.get("diaginertia"))), atol=1e-12)
    np.testing.assert_allclose(vehicle.drag, vehicle.mass / 0.05, rtol=1e-14)
    assert vehicle.weight == pytest.approx(0.0 if name == "submersible" else 9.81 * vehicle.mass)
    assert vehicle.dimension == (2 if name == "hull" else 3)


def require_right_inverse(vehicle: Vehicle) -> None:
    """Require g g^+ = I, and that the commands g^+ v push with R D R^T v and turn the body in no direction.

    At any attitude in a volume; a boat's thrusters lie in its deck's plane, so for it at any heading.
    """
    n = vehicle.dimension
    for k, R in enumerate(yaws(20) if n == 2 else attitudes(20)):
        g, g_pinv = vehicle.reduced_model().g(R), vehicle.reduced_model().g_inverse(R)
        D = R @ np.diag(vehicle.drag) @ R.T
        np.testing.assert_allclose(g, np.linalg.solve(D, R @ vehicle.W[:3])[:n], atol=1e-14)
        np.testing.assert_allclose(g @ g_pinv, np.eye(n), atol=1e-12)
        v = np.random.default_rng(k).standard_normal(n)
        wrench = vehicle.W @ (g_pinv @ v)
        wanted = R.T @ (D[:, :n] @ v)
        np.testing.assert_allclose(wrench[:3], wanted, atol=1e-9)
        np.testing.assert_allclose(wrench[3:], 0.0, atol=1e-9)


@pytest.mark.parametrize("drag", [None, ANISOTROPIC], ids=["isotropic", "anisotropic"])
@pytest.mark.parametrize("name", NAMES)
def test_effectiveness_has_a_right_inverse_without_moment(name: str, drag: Array | None) -> None:
    vehicle = load_vehicle(name)
    require_right_inverse(vehicle if drag is None else replace(vehicle, drag=drag))


# -- the model decides -----------------------------------------------------------------------------------------------


def thruster(attribute: str, value: str) -> Edit:
    """Change an attribute of the second thruster's actuator, or of its site."""

    def edit(root: ElementTree.Element) -> None:
        actuator = find(root, "actuator")[1]
        element = find(root, f".//site[@name='{actuator.get('site')}']") if attribute in ("pos", "zaxis") else actuator
        assert element.get(attribute) != value
        element.set(attribute, value)

    return edit


@pytest.mark.parametrize(
    ("attribute", "value"),
    [("gear", "0 0 .5 0 0 .3"), ("gainprm", "0.5"), ("zaxis", "3 4 12"), ("pos", "0.9 -0.4 0")],
)
def test_a_thruster_that_is_altered_changes_its_column_and_the_commands(
    attribute: str, value: str, tmp_path: Path
) -> None:
    """Whatever it is now, the wrenches are those of the file, and commands g^+ v make no moment still."""
    edit, root = thruster(attribute, value), xml_of("aerial")
    edit(root)
    one, other = load_vehicle("aerial"), load_vehicle(altered(tmp_path, "aerial", edit))
    np.testing.assert_allclose(other.W, wrenches(root), atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(np.abs(other.W - one.W).max(axis=0) > 1e-9), [1])
    require_right_inverse(other)


# -- what is refused -------------------------------------------------------------------------------------------------


def without(*names: str) -> Edit:
    def edit(root: ElementTree.Element) -> None:
        actuators = find(root, "actuator")
        for actuator in list(actuators):
            if actuator.get("name") in names or not names:
                actuators.remove(actuator)

    return edit


def flat(root: ElementTree.Element) -> None:
    """Every thruster straight up: no way forward."""
    for site in root.iter("site"):
        site.set("zaxis", "0 0 1")


def aft_only(root: ElementTree.Element) -> None:
    """As on an Otter: two thrusters along x."""
    without("thruster_bow_port", "thruster_bow_starboard")(root)
    for site in root.iter("site"):
        if site.get("name"):
            site.set("zaxis", "1 0 0")


def still_yaw(name: str) -> dict[str, Any]:
    drag = load_vehicle(name).description.drag.model_dump(exclude_none=True)
    return {**drag, "angular": [*drag["angular"][:2], 0.0]}


def pod(**fields: Any) -> dict[str, Any]:
    """An azimuthing engine."""
    return {"actuators": {"thruster_port": {"kind": "azimuth", "angle": [-90, 90], "rate": 60} | fields}}


def blade(name: str = "propeller", **fields: Any) -> dict[str, Any]:
    """A rudder."""
    whole = {"kind": "rudder", "angle": 35, "rate": 40, "behind": 0.2, "diameter": 0.25, "area": 0.03, "span": 0.2}
    return {"actuators": {name: {**whole, "slipstream": 0.5, **fields}}}


def windage(**fields: Any) -> dict[str, Any]:
    return {"windage": {"area": [1, 2], "coefficients": [0.5, 0.7, 0.1], "height": 1} | fields}


TILTING = adding((".//body", '<joint name="tilt" type="hinge"/>'))
ADHERING = adding(("actuator", '<adhesion body="body" gain="1"/>'))
AFFINE, MUSCULAR = setting("actuator/*", biastype="affine"), setting("actuator/*", dyntype="muscle")
AGROUND = adding(("worldbody", '<geom name="ballast" size="1"/>'))
WEAK = setting(".//default[@class='thruster']/general", ctrlrange="0 3")
FLOATS = {"heave": 1, "roll": 1, "pitch": 1}
ONE_ROW_LESS = "cannot produce every required wrench"
CLASS = "default/default[@class='thruster']"
NOT_AHEAD = "actuators.propeller: a rudder needs a propeller with a thrust straight ahead of 1 N"
REFUSED: list[tuple[Any, ...]] = [  # a vehicle, an edit of its MJCF and fields of its description, what the error names
    ("hull", TILTING, "hull.xml: joint 'tilt' of body 'body'", "a vehicle must have no joints"),
    ("hull", ADHERING, "hull.xml: an actuator acts on body 'body'", "every actuator must act on a site"),
    ("hull", AFFINE, "hull.xml: actuator 'thruster_bow_port'", "biastype is affine", "expected none"),
    ("hull", MUSCULAR, "'thruster_bow_port'", "dyntype must be one of none, filter, filterexact"),
    ("hull", setting(".//inertial", mass="0"), "hull.xml: its mass is 0 kg; expected a positive one"),
    ("hull", AGROUND, "hull.xml: geom 'ballast' with mass is directly in <worldbody>"),
    ("hull", setting(".//inertial", colour="red"), "hull.xml", "unrecognized attribute", "colour"),
    ("hull", without("thruster_bow_port", "thruster_stern_starboard"), "hull.xml", ONE_ROW_LESS, "Assumption 2"),
    ("hull", flat, "hull.xml", ONE_ROW_LESS, "is missing"),
    ("hull", without(), "hull.xml", ONE_ROW_LESS),
    ("hull", {"hydrostatics": None}, "a surface vehicle needs hydrostatics"),
    ("aerial", {"hydrostatics": FLOATS}, "needs hydrostatics, and other vehicles must not"),
    ("hull", {"mjcf": "boat.xml"}, "boat.xml"),
    ("hull", {"colour": "red"}, "hull.yaml: colour: unknown field; expected actuators"),
    ("hull", {"drag": {}}, "hull.yaml: drag: give either time_constant or linear"),
    ("hull", {"drag": {"linear": [1, 2, 0]}}, "drag.linear.2", "above 0"),
    ("hull", {"drag": {"time_constant": 0}}, "drag.time_constant: expected a number above 0"),
    ("hull", {"domain": "ground"}, "domain: expected 'surface' or 'volume'"),
    ("hull", {"drifts": True}, "a drifting vehicle has no thrusters"),
    ("hexarotor", WEAK, "hexarotor.xml", "weight", 3.776),
    ("quadrotor", WEAK, "quadrotor.xml", "weight", "0 to 3"),
    ("otter", {"drag": still_yaw("otter")}, "otter.yaml", "drag.angular", "yaw"),
    ("otter", {"steering": None}, "sway", "Assumption 2", "steering"),
    ("wamv", aft_only, "sway", "steering"),
    ("hexarotor", flat, "Assumption 2", "steering"),
    ("otter", {"steering": {"largest_tilt": 30}}, "otter.yaml", "steering", "hand_point"),
    ("quadrotor", {"steering": {"hand_point": 1}}, "quadrotor.yaml", "steering", "largest_tilt"),
    ("otter", {"steering": {}}, "otter.yaml", "steering", "hand_point", "largest_tilt"),
    ("otter", {"steering": {"hand_point": 1, "foo": 1}}, "steering.foo", "hand_point"),
    ("quadrotor", {"steering": {"largest_tilt": 90}}, "steering.largest_tilt"),
    ("wamv", {"added_mass": [1, 2, 3]}, "added_mass", 6),
    ("wamv", {"added_mass": [1, 2, 3, 4, 5, -6]}, "added_mass.5"),
    ("wamv", {"autopilot": {"rate": 0}}, "autopilot.rate", 0),
    ("wamv", {"attitude": None}, "wamv.yaml", "attitude"),
    ("wamv_azimuth", {"actuators": {"pod": pod()["actuators"]["thruster_port"]}}, "actuators.pod", "thruster_port"),
    ("wamv_azimuth", pod(angle=[90, -90]), "actuators.thruster_port: angle: expected the lowest, then the highest"),
    ("wamv_azimuth", pod(angle=[-400, 0]), "actuators.thruster_port: angle", "-360 to 360"),
    ("wamv_azimuth", pod(rate=0), "actuators.thruster_port.rate", "above 0"),
    ("wamv_azimuth", pod(kind="wing"), "actuators.thruster_port.kind", "azimuth"),
    ("wamv_azimuth", pod(reach=1), "thruster_port.reach: unknown field; expected angle, kind, lag, rate"),
    ("wamv_azimuth", (setting(f"{CLASS}/site", zaxis="0 1 1"), pod()), "expected a horizontal thrust"),
    ("submersible", blade("x"), "a rudder steers a vehicle on the surface"),
    ("otter_rudder", (setting(f"{CLASS}/site", zaxis="1 1 0"), blade()), NOT_AHEAD),
    ("otter_rudder", (setting(f"{CLASS}/general", gainprm="2"), blade()), NOT_AHEAD),
    ("otter_rudder", blade(area=3.0, span=5.0), "propeller: its drag at full deflection exceeds the thrust"),
    ("otter_rudder", blade(angle=90), "actuators.propeller.angle", "below 90"),
    ("otter_rudder", blade(slipstream=0), "actuators.propeller.slipstream", "above 0"),
    ("otter_rudder", {"actuators": {"propeller": {"kind": "rudder"}}}, "actuators.propeller.angle: missing"),
    ("x500", windage(), "windage is that of a vehicle on the surface"),
    ("otter", windage(area=[1, 0]), "windage.area"),
    ("otter", windage(coefficients=[0.5, -0.7, 0.1]), "windage.coefficients"),
    ("otter", {"windage": {"area": [1, 2], "coefficients": [0.5, 0.7, 0.1]}}, "windage.height"),
    ("otter", windage(length=0), "windage.length"),
]


@pytest.mark.parametrize(("name", "change", "named"), [(name, change, named) for name, change, *named in REFUSED])
def test_wrong_vehicle_files_are_refused(name: str, change: Any, named: list[Any], tmp_path: Path) -> None:
    edit, description = change if isinstance(change, tuple) else (change, {}) if callable(change) else (None, change)
    with refused(InputError, *named):
        load_vehicle(altered(tmp_path, name, edit, **description))


def test_unknown_vehicles_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no vehicle 'boat'; expected aerial, .*hull.*, or the path of a descript"):
        load_vehicle("boat")
    with pytest.raises(InputError, match=r"boat\.xml: a model .* expected .* boat\.yaml with `mjcf: boat\.xml`"):
        load_vehicle("folder/boat.xml")
    with pytest.raises(InputError, match=r"nowhere\.yaml: cannot be read"):
        load_vehicle(str(tmp_path / "nowhere.yaml"))


def test_a_relative_path_is_of_the_directory_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    altered(tmp_path / "boats", "hull", summary="of the folder")
    assert load_vehicle("boats/hull.yaml", tmp_path).description.summary == "of the folder"
    assert load_vehicle(str(tmp_path / "boats" / "hull.yaml"), Path("elsewhere")).path.parent == tmp_path / "boats"
    assert load_vehicle("hull", tmp_path / "boats").description.summary != "of the folder"  # a name is a name
    with pytest.raises(InputError, match=r"boats/hull\.yaml: cannot be read"):
        load_vehicle("boats/hull.yaml")
    monkeypatch.chdir(tmp_path)
    assert load_vehicle("boats/hull.yaml").description.summary == "of the folder"


def test_a_vehicle_that_all_runs_share_cannot_be_written_into() -> None:
    vehicle = load_vehicle("hexarotor")
    for values in (vehicle.drag, vehicle.inertia, vehicle.inertials[0].diagonal, vehicle.actuators[0].wrench):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0


# -- a user's vehicle: tests/data/raft.xml and raft.yaml ---------------------------------------------------------------


def test_a_raft_is_what_its_files_say() -> None:
    """60 kg; thrusters in X at arms of .707 m; tau = (M + l D) / (M k_v + D) = (70 + .1 60) / (70 + 60) s."""
    raft = load_vehicle(str(RAFT))
    assert (raft.mass, raft.dimension, raft.steering, raft.weight) == (60.0, 2, Full(), 60.0 * 9.81)
    c = np.sqrt(0.5)
    np.testing.assert_allclose(raft.W[0], [c, c, c, c], atol=1e-12)
    np.testing.assert_allclose(raft.W[1], [-c, c, c, -c], atol=1e-12)
    np.testing.assert_allclose(raft.W[5], [-2 * 0.5 * c, 2 * 0.5 * c, -2 * 0.5 * c, 2 * 0.5 * c], atol=1e-12)
    np.testing.assert_allclose(raft.reduced_model().tau, 76 / 130, rtol=1e-12)
    np.testing.assert_array_equal(raft.limits, [[-40, 40]] * 4)
    assert raft.thrusters == ["bow_port", "bow_starboard", "stern_port", "stern_starboard"]


def test_a_wrong_vehicle_is_one_line_on_stderr(tmp_path: Path) -> None:
    """Exit code 2, and the line names the scenario's file, the vehicle's file, and what is wrong."""
    shutil.copy(RAFT.with_suffix(".xml"), tmp_path)
    (tmp_path / "raft.yaml").write_text(RAFT.read_text().replace("attitude:", "altitude:"))
    (tmp_path / "rafts.yaml").write_text(yaml.safe_dump(ONE_BOAT | {"vehicles": {"agents": "raft.yaml"}}))
    answer = answer_of("run", tmp_path / "rafts.yaml", "--no-video", "--out", tmp_path / "out")
    assert is_refusal(answer, "rafts.yaml", "raft.yaml", "altitude")
