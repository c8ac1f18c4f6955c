"""Vehicles: what is read from MJCF and description, and the control effectiveness that follows.

Oracles: wrenches worked out here from the sites' positions and axes as they stand in the MJCF text; the definition
g = C (R D R^T)^-1 R W_f; and that u = g^+ v makes the drag's force for v and no moment.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from mjsheaf.errors import InputError
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from mjsheaf.vehicles.vehicle import Vehicle
from tests.builders import Edit, altered, attitudes, find, xml_of, yaws

Array = NDArray[np.float64]

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


def test_these_vehicles_come_with_mjsheaf() -> None:
    assert set(NAMES) <= set(list_vehicles())


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


def test_inertia_is_about_the_origin_of_the_frame(tmp_path: Path) -> None:
    """The parallel-axis theorem, for a centre of mass that is elsewhere."""
    shift = np.array([0.2, -0.1, 0.3])

    def edit(root: ElementTree.Element) -> None:
        find(root, ".//inertial").set("pos", ".2 -.1 .3")

    vehicle, plain = load_vehicle(altered(tmp_path, "aerial", edit)), load_vehicle("aerial")
    np.testing.assert_allclose(vehicle.centre_of_mass, shift, atol=1e-14)
    moved = plain.mass * (shift @ shift * np.eye(3) - np.outer(shift, shift))
    np.testing.assert_allclose(vehicle.inertia, plain.inertia + moved, atol=1e-12)


@pytest.mark.parametrize("drag", [None, ANISOTROPIC], ids=["isotropic", "anisotropic"])
@pytest.mark.parametrize("name", NAMES)
def test_effectiveness_has_a_right_inverse_without_moment(name: str, drag: Array | None) -> None:
    """g g^+ = I, and the commands g^+ v push with R D R^T v and turn the body in no direction.

    At any attitude in a volume; a boat's thrusters lie in its deck's plane, so for it at any heading.
    """
    vehicle = load_vehicle(name)
    if drag is not None:
        vehicle = replace(vehicle, drag=drag)
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


def test_the_plain_pseudo_inverse_would_spin_the_body(tmp_path: Path) -> None:
    """The allocation needs the moment rows: without them an asymmetric boat turns on a sideways command."""

    def edit(root: ElementTree.Element) -> None:
        find(root, ".//actuator/general[@name='thruster_bow_port']").set("gainprm", "0.3")

    vehicle = load_vehicle(altered(tmp_path, "hull", edit))
    plain = np.linalg.pinv(vehicle.W[:3])[:, 1] * 100.0
    assert abs((vehicle.W @ plain)[5]) > 10.0
    np.testing.assert_allclose(vehicle.W @ (vehicle.allocation[:, 1] * 100.0), [0, 100, 0, 0, 0, 0], atol=1e-10)


# -- the model decides -----------------------------------------------------------------------------------------------


def thruster(attribute: str, value: str) -> Edit:
    """Change an attribute of the second thruster's actuator, or of its site."""

    def edit(root: ElementTree.Element) -> None:
        actuator = find(root, "actuator")[1]
        element = find(root, f".//site[@name='{actuator.get('site')}']") if attribute in ("pos", "zaxis") else actuator
        assert element.get(attribute) != value
        element.set(attribute, value)

    return edit


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("attribute", ["gear", "gainprm"])
def test_weakening_a_thruster_weakens_its_column_of_g(name: str, attribute: str, tmp_path: Path) -> None:
    was = find(xml_of(name), "actuator")[1].get("gear", "0 0 1 0 0 0")
    half = " ".join(str(0.5 * x) for x in numbers(was)) if attribute == "gear" else "0.5"
    one, other = load_vehicle(name), load_vehicle(altered(tmp_path, name, thruster(attribute, half)))
    R = yaws(1)[0]
    share = np.where(np.arange(len(one.thrusters)) == 1, 0.5, 1.0)
    np.testing.assert_allclose(other.W, one.W * share, atol=1e-12)
    np.testing.assert_allclose(other.reduced_model().g(R), one.reduced_model().g(R) * share, atol=1e-14)
    assert np.abs(other.reduced_model().g_inverse(R) - one.reduced_model().g_inverse(R)).max() > 1.0
    n = one.dimension
    np.testing.assert_allclose(other.reduced_model().g(R) @ other.reduced_model().g_inverse(R), np.eye(n), atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_turning_a_thruster_turns_its_column_of_g(name: str, tmp_path: Path) -> None:
    edit = thruster("zaxis", "3 4 0" if name == "hull" else "3 4 12")
    one, other = load_vehicle(name), load_vehicle(altered(tmp_path, name, edit))
    np.testing.assert_allclose(other.W, wrenches(edited(name, edit)), atol=1e-12)
    R = yaws(1)[0]
    changed = np.abs(other.reduced_model().g(R) - one.reduced_model().g(R)).max(axis=0) > 1e-9
    np.testing.assert_array_equal(np.flatnonzero(changed), [1])
    n = one.dimension
    np.testing.assert_allclose(other.reduced_model().g(R) @ other.reduced_model().g_inverse(R), np.eye(n), atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_moving_a_thruster_changes_its_moments_and_the_commands(name: str, tmp_path: Path) -> None:
    """The force of a thruster is the same wherever it sits: g keeps its entries, g^+ does not."""
    edit = thruster("pos", "0.9 -0.4 0")
    one, other = load_vehicle(name), load_vehicle(altered(tmp_path, name, edit))
    np.testing.assert_allclose(other.W, wrenches(edited(name, edit)), atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(np.abs(other.W - one.W).max(axis=0) > 1e-9), [1])
    R = yaws(1)[0]
    np.testing.assert_allclose(other.reduced_model().g(R), one.reduced_model().g(R), atol=1e-14)
    assert np.abs(other.reduced_model().g_inverse(R) - one.reduced_model().g_inverse(R)).max() > 1.0
    wrench = other.W @ other.reduced_model().g_inverse(R)
    np.testing.assert_allclose(wrench[3:], 0.0, atol=1e-9)


def edited(name: str, edit: Edit) -> ElementTree.Element:
    root = xml_of(name)
    edit(root)
    return root


def test_mass_and_drag_scale_g(tmp_path: Path) -> None:
    """G = W_f / D: with m / D given a heavier body drags more; with drag given mass does not matter."""

    def heavier(root: ElementTree.Element) -> None:
        find(root, ".//inertial").set("mass", "800")

    R = np.eye(3)
    plain = load_vehicle("hull").reduced_model().g(R)
    doubled = load_vehicle(altered(tmp_path / "a", "hull", heavier)).reduced_model().g(R)
    np.testing.assert_allclose(doubled, plain / 2, rtol=1e-14)
    given = {"linear": [2000.0, 4000.0, 9000.0], "angular": [1.0, 2.0, 3.0]}
    light, heavy = (
        load_vehicle(altered(tmp_path / k, "hull", e, drag=given)) for k, e in (("b", None), ("c", heavier))
    )
    np.testing.assert_array_equal(light.reduced_model().g(R), heavy.reduced_model().g(R))
    np.testing.assert_allclose(light.reduced_model().g(R), plain * [[4.0], [2.0]], rtol=1e-14)
    assert light.with_time_constant(None) is light
    np.testing.assert_array_equal(light.with_time_constant(0.1).drag, [4000.0] * 3)


# -- what is refused -------------------------------------------------------------------------------------------------


def with_joint(root: ElementTree.Element) -> None:
    ElementTree.SubElement(find(root, ".//body"), "joint", name="tilt", type="hinge")


def without(*names: str) -> Edit:
    def edit(root: ElementTree.Element) -> None:
        actuators = find(root, "actuator")
        for actuator in list(actuators):
            if actuator.get("name") in names or not names:
                actuators.remove(actuator)

    return edit


def on_a_body(root: ElementTree.Element) -> None:
    actuators = find(root, "actuator")
    ElementTree.SubElement(actuators, "adhesion", body="body", ctrlrange="0 1", gain="1")


def with_bias(root: ElementTree.Element) -> None:
    find(root, "actuator")[0].set("biastype", "affine")


def with_muscle(root: ElementTree.Element) -> None:
    find(root, "actuator")[0].set("dyntype", "muscle")


def weightless(root: ElementTree.Element) -> None:
    find(root, ".//inertial").set("mass", "0")


def heavy_world(root: ElementTree.Element) -> None:
    ElementTree.SubElement(find(root, "worldbody"), "geom", name="ballast", type="box", size="1 1 1")


def broken(root: ElementTree.Element) -> None:
    find(root, ".//inertial").set("colour", "red")


def flat(root: ElementTree.Element) -> None:
    """Every thruster straight up: no way forward."""
    for site in root.iter("site"):
        site.set("zaxis", "0 0 1")


@pytest.mark.parametrize(
    ("name", "edit", "description", "message"),
    [
        (
            "hull",
            with_joint,
            {},
            r"hull\.xml: joint 'tilt' of body 'body': a vehicle must have no joints; mjsheaf gives",
        ),
        ("hull", on_a_body, {}, r"hull\.xml: an actuator acts on body 'body'; every actuator must act on a site"),
        (
            "hull",
            with_bias,
            {},
            r"hull\.xml: actuator 'thruster_bow_port': biastype is affine, which is not modelled; expected none",
        ),
        (
            "hull",
            with_muscle,
            {},
            r"'thruster_bow_port': dyntype must be one of none, filter, filterexact",
        ),
        ("hull", weightless, {}, r"hull\.xml: its mass is 0 kg; expected a positive one"),
        ("hull", heavy_world, {}, r"hull\.xml: geom 'ballast' with mass is directly in <worldbody>; put it into a"),
        ("hull", broken, {}, r"hull\.xml: .*unrecognized attribute: 'colour'"),
        (
            "hull",
            without("thruster_bow_port", "thruster_stern_starboard"),
            {},
            r"hull\.xml: the thrusters cannot produce every required wrench; .* is missing \(Assumption 2\)",
        ),
        ("hull", flat, {}, r"(surge force|sway force|yaw moment) is missing"),
        ("aerial", without("thruster_left"), {}, r"aerial\.xml: the thrusters cannot produce every required wrench"),
        ("hull", without(), {}, r"hull\.xml: the thrusters cannot produce every required wrench"),
        ("hull", None, {"hydrostatics": None}, r"a surface vehicle needs hydrostatics"),
        (
            "aerial",
            None,
            {"hydrostatics": {"heave": 1, "roll": 1, "pitch": 1}},
            r"needs hydrostatics, and other vehicles must not",
        ),
        ("hull", None, {"mjcf": "boat.xml"}, r"boat\.xml"),
        (
            "hull",
            None,
            {"colour": "red"},
            r"hull\.yaml: colour: unknown field; expected actuators",
        ),
        ("hull", None, {"drag": {}}, r"hull\.yaml: drag: give either time_constant or linear"),
        ("hull", None, {"drag": {"linear": [1, 2, 0]}}, r"drag\.linear\.2: .*above 0"),
        ("hull", None, {"drag": {"time_constant": 0}}, r"drag\.time_constant: expected a number above 0"),
        ("hull", None, {"domain": "ground"}, r"domain: expected 'surface' or 'volume'"),
    ],
)
def test_wrong_vehicle_files_are_refused(
    name: str, edit: Edit | None, description: dict[str, Any], message: str, tmp_path: Path
) -> None:
    path = altered(tmp_path, name, edit, **description)
    with pytest.raises(InputError, match=message):
        load_vehicle(path)


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


def test_vehicles_are_not_shared_state() -> None:
    one = load_vehicle("hull")
    assert isinstance(one, Vehicle)
    slow = one.with_time_constant(1.0)
    assert one.drag[0] == pytest.approx(8000.0)
    assert slow.drag[0] == pytest.approx(400.0)


def test_a_vehicle_that_all_runs_share_cannot_be_written_into() -> None:
    vehicle = load_vehicle("hexarotor")
    for values in (vehicle.drag, vehicle.inertia, vehicle.inertials[0].diagonal, vehicle.actuators[0].wrench):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
