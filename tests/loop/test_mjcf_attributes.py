"""Every attribute that MuJoCo has for what a vehicle's file may contain: modelled, without effect, left out or refused.

Oracle: MuJoCo's own steps of the file as it stands, against those of the arena. The lists are compared with MuJoCo's,
so that an attribute that MuJoCo gains fails here until it is understood.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from mjsheaf.errors import InputError
from mjsheaf.vehicles.arena import compose
from mjsheaf.vehicles.loading import load_vehicle

STEPS, STEP = 60, 0.005  # s
SITES = {"fl": (0.2, 0.2), "fr": (0.2, -0.2), "rl": (-0.2, 0.2), "rr": (-0.2, -0.2), "own": (0.0, 0.0)}
"""Places of the rotors; the last is the one that has changed attributes."""
YAML = (
    "summary: a quadrotor\nmjcf: quad.xml\ndomain: volume\ndrag: {linear: [0.5, 0.5, 0.8]}\nattitude: {frequency: 3}\n"
)

Attributes = Mapping[str, str]


def none_of(names: str) -> dict[str, Attributes | None]:
    """Attributes that no file sets: what an element is, or where it is."""
    return dict.fromkeys(names.split())


def same_names(text: str) -> dict[str, Attributes | None]:
    """Attributes that XML calls as MuJoCo does, with the values that they change to."""
    pairs = (each.split("=") for each in text.split("; "))
    return {name: {name: value} for name, value in pairs}


# What each differs by from the plain file: attributes of XML.
ACTUATOR: dict[str, Attributes | None] = {
    **none_of("compiler id info signature"),
    **same_names(
        "actdim=2; actearly=true; armature=0.1; biasprm=1 2 3; cranklength=0.1; ctrllimited=false; ctrlrange=1 4; "
        "ctrlspec=1; damping=0.1; dynprm=0.1; dyntype=filter; ffrange=0 1; gainprm=2 3 4; "
        "gear=0.1 0.2 1.5 0 0 -0.1; group=3; inheritrange=0.5; lengthrange=0.1 2; name=other; nsample=10; "
        "plugin=mujoco.pid; refsite=rr; velrange=0 1"
    ),
    "actlimited": {"actlimited": "true", "actrange": "0 4"},
    "actrange": {"actlimited": "true", "actrange": "1 4"},
    "biastype": {"biastype": "affine", "biasprm": "0 0 -1"},
    "classname": {"class": "small"},
    "delay": {"delay": "0.02", "nsample": "10"},
    "forcelimited": {"forcelimited": "true", "forcerange": "0 4"},
    "forcerange": {"forcelimited": "true", "forcerange": "1 4"},
    "gaintype": {"gaintype": "affine", "gainprm": "1 0 1"},
    "interp": {"interp": "linear", "nsample": "10"},
    "slidersite": {"slidersite": "rr", "cranksite": "fl", "cranklength": "1", "site": ""},
    "target": {"site": "rl"},
    "trntype": {"body": "quad", "site": ""},
    "type": {"tag": "motor"},
    "userdata": {"user": "1 2"},
}
JOINT: dict[str, Attributes | None] = {
    **none_of("compiler frame id info parent signature"),
    **same_names(
        "armature=1; axis=1 0 0; damping=0.1; frictionloss=0.1; group=2; limited=false; margin=1; name=root; "
        "pos=1 2 3; ref=1; springdamper=0.5 0.5; springref=1; stiffness=1; type=ball"
    ),
    "actfrclimited": {"actuatorfrclimited": "true", "actuatorfrcrange": "0 1"},
    "actfrcrange": {"actuatorfrcrange": "0 1"},
    "actgravcomp": {"actuatorgravcomp": "true"},
    "align": {"align": "true", "tag": "freejoint", "type": ""},
    "classname": {"class": "small"},
    "range": {"range": "0 1", "limited": "false"},
    "solimp_friction": {"solimpfriction": "0.8 0.9 0.01"},
    "solimp_limit": {"solimplimit": "0.8 0.9 0.01"},
    "solref_friction": {"solreffriction": "0.1 1"},
    "solref_limit": {"solreflimit": "0.1 1"},
    "userdata": {"user": "1"},
}
BODY: dict[str, Attributes | None] = {
    **none_of(  # the cases of inertia set explicitinertial
        "classname compiler explicitinertial frame frames fuse id info parent signature simple bodies "
        "cameras geoms joints lights sites"
    ),
    **same_names("childclass=small; gravcomp=0.4; name=other; pos=1 2 3; quat=1 2 3 4; sleep=allowed"),
    "alt": {"euler": "10 20 30"},
    "fullinertia": {"inertial": '<inertial pos=".01 0 .02" mass="1.3" fullinertia=".01 .02 .025 .001 .002 .001"/>'},
    "ialt": {"inertial": '<inertial pos="0 .01 0" euler="10 20 30" mass="1.3" diaginertia=".01 .02 .025"/>'},
    "inertia": {"inertial": '<inertial pos="0 0 0" mass="1.3" diaginertia=".01 .02 .025"/>'},
    "ipos": {"inertial": '<inertial pos=".03 .02 -.05" mass="1.3" diaginertia=".01 .02 .025"/>'},
    "iquat": {"inertial": '<inertial pos="0 0 0" quat="1 2 3 4" mass="1.3" diaginertia=".01 .02 .025"/>'},
    "mass": {"inertial": '<inertial pos="0 0 0" mass="1.4" diaginertia=".01 .02 .025"/>'},
    "mocap": {"mocap": "true", "joint": "none"},
    "plugin": {"inertial": '<plugin plugin="mujoco.elasticity.cable"/>'},
    "userdata": {"user": "1 2"},
}
GEOM: dict[str, Attributes | None] = {
    **none_of("compiler frame hfieldname id info parent signature"),  # a height field is ground, see ELEMENTS
    **same_names(
        "adhesion=1; conaffinity=0; condim=1; contype=0; fitscale=2; friction=0.1; gap=0.1; group=3; margin=0.1; "
        "mass=1.2; material=red; name=hull; pos=.01 -.02 .03; priority=2; quat=1 2 3 4; rgba=1 0 0 1; "
        "size=.1 .2 .3; solimp=0.8 0.9 0.01; solmix=2; solref=0.1 1; surfacevel=1 0 0 0 0 0"
    ),
    "alt": {"euler": "10 20 30"},
    "classname": {"class": "small"},
    "density": {"density": "300", "mass": ""},
    "fluid_coefs": {"fluidshape": "ellipsoid", "fluidcoef": "1 1 1 1 1"},
    "fluid_ellipsoid": {"fluidshape": "ellipsoid"},
    "fromto": {"type": "capsule", "fromto": "0 0 0 .1 .2 .3", "size": ".1"},
    "meshname": {"type": "mesh", "mesh": "solid", "size": ""},
    "plugin": {"inner": '<plugin plugin="mujoco.sdf.bolt"/>', "type": "sdf", "size": ""},
    "type": {"type": "cylinder", "size": ".1 .2"},
    "typeinertia": {"shellinertia": "true"},
    "userdata": {"user": "1"},
}
SITE: dict[str, Attributes | None] = {
    **none_of("compiler frame id info name parent signature"),  # actuators refer to its name
    **same_names("group=5; material=red; pos=.03 .01 .1; quat=4 1 0 0; rgba=1 0 0 1; size=.1"),
    "alt": {"euler": "10 20 30"},
    "classname": {"class": "small"},
    "fromto": {"type": "capsule", "fromto": ".1 .1 .3 0 0 0", "size": ".01", "pos": ""},
    "meshname": {"type": "mesh", "mesh": "solid"},
    "type": {"type": "box", "size": ".1 .1 .1"},
    "userdata": {"user": "1"},
}
OPTION: dict[str, Attributes | None] = {
    **none_of("disableflags enableflags"),
    **same_names(
        "ccd_iterations=10; ccd_tolerance=1e-3; cone=elliptic; density=1.2; gravity=0 0 -3; impratio=2; "
        "integrator=RK4; iterations=5; jacobian=dense; ls_iterations=3; ls_tolerance=0.1; magnetic=1 0 0; "
        "noslip_iterations=2; noslip_tolerance=0.1; o_friction=1 1 1 1 1; o_margin=0.1; "
        "o_solimp=0.8 0.9 0.01 0.5 2; o_solref=0.1 1; sdf_initpoints=4; sdf_iterations=4; sleep_tolerance=0.1; "
        "solver=CG; timestep=0.001; tolerance=1e-3; viscosity=1e-3; wind=1 2 3"
    ),
    "disableactuator": {"actuatorgroupdisable": "0"},
}
FLAGS = {
    "disable": "autoreset constraint contact equality eulerdamp filterparent frictionloss gravity island limit "
    "midphase multiccd nativeccd refsafe sensor warmstart actuation clampctrl damper spring",
    "enable": "diagexact energy fwdinv invdiscrete ipc override sleep",
}
REFUSED_FLAGS = ("actuation", "clampctrl", "damper", "spring")
WORLD = "<worldbody>{}</worldbody>"
ELEMENTS = {  # what a file may contain next to the vehicle's body, and what becomes of it
    "actuators": (WORLD.format('<site name="m"/>') + '<actuator><motor site="m"/></actuator>', "refused: on site 'm'"),
    "bodies": (WORLD.format('<body name="table"><geom size=".1"/></body>'), "said: body 'table'"),
    "cameras": (WORLD.format('<camera name="top" mode="targetbody" target="quad"/>'), "said: camera 'top'"),
    "equalities": ('<equality><connect name="e" body1="quad" anchor="0 0 0"/></equality>', "refused: equality 'e'"),
    "equalities ": (
        WORLD.format('<body name="m" mocap="true"/>') + '<equality><weld name="w" body1="m" body2="quad"/></equality>',
        "refused: equality 'w'",
    ),
    "excludes": (WORLD.format('<body name="t"/>') + '<contact><exclude body1="quad" body2="t"/></contact>', "said: t"),
    "flexes": (
        '<deformable><flex name="f" dim="1" body="quad quad" vertex="0 0 0 1 0 0" element="0 1"/></deformable>',
        "refused: flex 'f'",
    ),
    "frames": (WORLD.format('<frame pos="1 0 0"><geom name="wall" size=".1"/></frame>'), "said: geom 'wall'"),
    "geoms": (WORLD.format('<geom name="floor" type="plane" size="1 1 1"/>'), "said: plane 'floor'"),
    "hfields": (WORLD.format('<geom name="floor" type="hfield" hfield="hills"/>'), "said: height field 'floor'"),
    "joints": (WORLD.format('<body name="door"><joint type="hinge"/><geom size=".1"/></body>'), "said: body 'door'"),
    "keys": ('<keyframe><key name="up" qpos="0 0 9 1 0 0 0" ctrl="1 1 1 1 1"/></keyframe>', "said: keyframe 'up'"),
    "lights": (WORLD.format('<light name="sun" mode="targetbody" target="quad"/>'), "said: light 'sun'"),
    "materials": ('<asset><material name="m"/></asset>', "same"),
    "meshes": ('<asset><mesh name="m" file="solid.obj"/></asset>', "same"),
    "numerics": ('<custom><numeric name="n" data="1 2"/></custom>', "same"),
    "pairs": (
        WORLD.format('<geom name="wall" size="1"/>') + '<contact><pair geom1="wall" geom2="box"/></contact>',
        "said: geom 'wall'",
    ),
    "plugins": ('<extension><plugin plugin="mujoco.pid"/></extension>', "refused: plugin"),
    "sensors": ('<sensor><framepos objtype="site" objname="fl"/><clock name="c"/></sensor>', "said: sensors"),
    "sites": (WORLD.format('<site name="mark"/>'), "said: site 'mark'"),
    "skins": (
        '<deformable><skin name="s" vertex="0 0 0 1 0 0 0 1 0" face="0 1 2"><bone body="quad" bindpos="0 0 0" '
        'bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/></skin></deformable>',
        "same",
    ),
    "tendons": (
        WORLD.format('<site name="m"/>')
        + '<tendon><spatial name="t" stiffness="9"><site site="fl"/><site site="m"/></spatial></tendon>',
        "refused: tendon 't'",
    ),
    "texts": ('<custom><text name="t" data="x"/></custom>', "same"),
    "textures": ('<asset><texture type="skybox" builtin="flat" width="8" height="8"/></asset>', "same"),
    "tuples": (
        WORLD.format('<site name="m"/>')
        + '<custom><tuple name="u"><element objtype="site" objname="m"/></tuple></custom>',
        "said: site 'm'",
    ),
}
ARRAYS = {  # of a compiled model: all follow from the attributes
    "actuator": "acc0 actadr actearly actlimited actnum actrange armature biasprm biastype cranklength ctrladr "
    "ctrllimited ctrlnum ctrlrange ctrlspec damping dampingpoly delay dynprm dyntype forcelimited forcerange gainprm "
    "gaintype gear group history historyadr length0 lengthrange outadr outnum plugin trnid trntype user",
    "body": "bvhadr bvhnum conaffinity contype dofadr dofnum geomadr geomnum gravcomp inertia invweight0 ipos iquat "
    "jntadr jntnum margin mass mocapid parentid plugin pos quat rootid sameframe simple subtreemass treeid user weldid",
}


def element(tag: str, plain: Attributes, change: Attributes, inner: str = "") -> str:
    """Return an element of XML; an attribute of no value is left out."""
    own = {**plain, **change}
    tag, inner = own.pop("tag", tag), own.pop("inner", inner)
    given = " ".join(f'{name}="{value}"' for name, value in own.items() if value)
    return f"<{tag} {given}>{inner}</{tag}>"


def write(folder: Path, extra: str = "", flag: str = "", **changes: Attributes) -> str:
    """Write a quadrotor's file on a free joint in which elements have changed attributes; return its description."""
    change = {kind: dict(changes.get(kind, {})) for kind in ("actuator", "joint", "body", "geom", "site", "option")}
    inertial, has_joint = change["body"].pop("inertial", ""), change["body"].pop("joint", "") != "none"
    sites = [
        element("site", {"name": name, "pos": f"{x} {y} .05"}, change["site"] if name == "own" else {})
        for name, (x, y) in SITES.items()
    ]
    lag = {"dyntype": "filterexact", "dynprm": ".03", "ctrllimited": "true", "ctrlrange": "0 8"}
    motors = [
        element(
            "general",
            {"name": name, "site": name, "gear": f"0 0 1 0 0 {np.sign(x * y) * 0.02}", **lag},
            change["actuator"] if name == "own" else {},
        )
        for name, (x, y) in SITES.items()
    ]
    if change["actuator"].get("tag") == "motor":
        motors[-1] = motors[-1].replace('dyntype="filterexact"', "").replace('dynprm=".03"', "")
    joint = element("joint", {"type": "free"}, change["joint"]) if has_joint else ""
    geom = element("geom", {"name": "box", "type": "box", "size": ".15 .1 .05", "mass": "1.3"}, change["geom"])
    body = element("body", {"name": "quad"}, change["body"], joint + inertial + geom + "".join(sites))
    (folder / "solid.obj").write_text("v 0 0 0\nv .3 0 0\nv 0 .3 0\nv 0 0 .3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    (folder / "quad.xml").write_text(
        '<mujoco><default><default class="small"><geom margin=".1"/></default></default><asset>'
        '<mesh name="solid" file="solid.obj"/><material name="red"/>'
        '<hfield name="hills" nrow="4" ncol="4" size="5 5 1 .1"/></asset>'
        + element("option", {}, change["option"], flag)
        + f"<worldbody>{body}</worldbody>{extra}<actuator>{''.join(motors)}</actuator></mujoco>"
    )
    (folder / "quad.yaml").write_text(YAML + "steering: {largest_tilt: 20}\n")
    return str(folder / "quad.yaml")


def motion(model: mujoco.MjModel, prefix: str, pose: list[float] | None) -> NDArray[np.float64]:
    """Step a model under random commands; return places of the vehicle's sites, shape (STEPS, 5, 3), m.

    The arena has actuators on the free joint, with forces in world axes; those are turned with the body. Drag, which is
    the description's there, and contacts are off.
    """
    model.opt.timestep, model.opt.density, model.opt.viscosity = STEP, 0.0, 0.0
    model.opt.integrator, model.opt.enableflags = mujoco.mjtIntegrator.mjINT_EULER, 0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    gears, places = model.actuator_gear.copy(), []
    sites = [model.site(f"{prefix}{name}").id for name in SITES]
    body = model.site_bodyid[sites[0]]
    if pose is not None:
        start = model.jnt_qposadr[model.body_jntadr[body]]
        data.qpos[start : start + 7] = pose
    for _ in range(STEPS):
        data.ctrl[:] = rng.uniform(-3.0, 12.0, model.nu)
        mujoco.mj_kinematics(model, data)
        if prefix:
            model.actuator_gear[:, :3] = gears[:, :3] @ data.xmat[body].reshape(3, 3).T
        mujoco.mj_step(model, data)
        places.append(data.site_xpos[sites].copy())
    assert np.abs(places[-1] - places[0]).max() > 0.01
    return np.array(places)


def verdict(description: str, attribute: str, called: str = "") -> str:
    """Return 'refused', 'said' or 'same' for a file in which an attribute differs, which MJCF may call otherwise.

    Raises:
        AssertionError: The motion is another than that of the file, and nothing says so.
    """
    try:
        vehicle = load_vehicle(description)
    except InputError as error:
        message = str(error)
        assert "\n" not in message
        assert "quad.xml" in message, message
        assert attribute in message or (called and called in message), message
        return "refused"
    own = mujoco.MjModel.from_xml_path(str(vehicle.path))
    pose = None if attribute == "align" else [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]  # a joint that is aligned is elsewhere
    difference = np.abs(motion(own, "", pose) - motion(compose([vehicle], ["A"]).model, "A/", pose)).max()
    if any(re.search(rf"(?<!\w){attribute}(?!\w)", text) for text in vehicle.left_out):
        return "said"
    assert difference < 1e-10
    return "same"


KINDS: dict[str, tuple[Any, dict[str, Attributes | None]]] = {
    "actuator": (mujoco.MjsActuator, ACTUATOR),
    "joint": (mujoco.MjsJoint, JOINT),
    "body": (mujoco.MjsBody, BODY),
    "geom": (mujoco.MjsGeom, GEOM),
    "site": (mujoco.MjsSite, SITE),
    "option": (mujoco.MjOption, OPTION),
}
REFUSED = {
    "actuator": "actdim armature biastype cranklength ctrlspec damping delay ffrange gaintype inheritrange interp "
    "nsample plugin refsite slidersite trntype velrange",
    "joint": "actfrclimited actfrcrange armature damping frictionloss springdamper stiffness type",
    "body": "mocap plugin",
    "geom": "plugin",
    "site": "",
    "option": "disableactuator",
}
CALLED = {"slidersite": "slidercrank", "trntype": "body 'quad'", "type": "joint"}
SAID = {"option": {*OPTION} - {"disableactuator", "disableflags", "enableflags", "gravity"}}
CASES = [(kind, name) for kind, (_, known) in KINDS.items() for name, change in known.items() if change is not None]


@pytest.mark.parametrize("kind", KINDS)
def test_all_attributes_of_mujoco_are_known(kind: str) -> None:
    of_mujoco, known = KINDS[kind]
    names = {name for name in dir(of_mujoco) if not name.startswith("_")}
    assert {name for name in names if not callable(getattr(of_mujoco, name))} == set(known)


@pytest.mark.parametrize(("kind", "name"), CASES, ids=[f"{kind} {name}" for kind, name in CASES])
def test_an_attribute_means_what_mujoco_makes_of_it(kind: str, name: str, tmp_path: Path) -> None:
    change = KINDS[kind][1][name]
    assert change is not None
    changes: dict[str, Any] = {kind: change}
    found = verdict(write(tmp_path, **changes), name, CALLED.get(name, next(iter(change))))
    expected = "refused" if name in REFUSED[kind].split() else "said" if name in SAID.get(kind, ()) else "same"
    assert found == expected


@pytest.mark.parametrize(("setting", "flag"), [(setting, flag) for setting in FLAGS for flag in FLAGS[setting].split()])
def test_a_flag_is_left_out_or_refused(setting: str, flag: str, tmp_path: Path) -> None:
    option = {"integrator": "discrete", "solver": "CG"} if flag == "ipc" else {}  # without which MuJoCo refuses it
    path = write(tmp_path, flag=f'<flag {flag}="{setting}"/>', body={"gravcomp": "0.3"}, option=option)
    found = verdict(path, "flag", flag)
    refused = setting == "disable" and flag in REFUSED_FLAGS
    assert found == ("refused" if refused else "same" if flag == "gravity" else "said")


def test_all_flags_arrays_and_elements_of_mujoco_are_known() -> None:
    for kind, prefix, setting in (
        (mujoco.mjtDisableBit, "mjDSBL_", "disable"),
        (mujoco.mjtEnableBit, "mjENBL_", "enable"),
    ):
        flags = {name.removeprefix(prefix).lower() for name in kind.__members__ if name.startswith(prefix)}
        assert flags == set(FLAGS[setting].split())
    for of, arrays in ARRAYS.items():
        of_model = {name.removeprefix(f"{of}_") for name in dir(mujoco.MjModel) if name.startswith(f"{of}_")}
        assert of_model == set(arrays.split())
    spec = mujoco.MjSpec()
    names = {name for name in dir(spec) if not name.startswith("_")} - {"copy_during_attach"}  # which cannot be read
    assert {name for name in names if isinstance(getattr(spec, name), list | tuple)} == {*map(str.strip, ELEMENTS)}


@pytest.mark.parametrize("name", ELEMENTS)
def test_an_element_next_to_the_vehicle_is_left_out_without_effect_or_refused(name: str, tmp_path: Path) -> None:
    extra, expected = ELEMENTS[name]
    outcome, _, words = expected.partition(": ")
    assert verdict(write(tmp_path, extra), words or name, words) == outcome


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('mass="1.3"', 'mass="nan(1)"', "mass is nan"),
        ('mass="1.3"', 'mass="0x1p900"', "too small or too large to move"),
        (
            '<geom name="box"',
            '<inertial pos="0 0 0" mass="1" diaginertia="1e-20 1e-20 1e-20"/><geom name="box"',
            "too small or too large to move",
        ),
        ("<mujoco>", '<mujoco><compiler settotalmass="2"/>', "settotalmass counts body 'table' too"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_numbers_that_no_vehicle_has_are_refused_where_it_is_read(
    old: str, new: str, words: str, tmp_path: Path
) -> None:
    path = write(tmp_path, WORLD.format('<body name="table"><geom size=".1"/></body>'))
    (tmp_path / "quad.xml").write_text((tmp_path / "quad.xml").read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=rf"quad.xml: .*{words}"):
        load_vehicle(path)


def test_room_that_a_file_asks_for_is_not_taken(tmp_path: Path) -> None:
    path = write(tmp_path)
    for size in ('memory="1"', 'memory="1000P"', 'nuserdata="2000000000"'):
        text = (tmp_path / "quad.xml").read_text()
        (tmp_path / "quad.xml").write_text(text.replace("<mujoco>", f"<mujoco><size {size}/>"))
        assert load_vehicle(path).mass == pytest.approx(1.3)
        (tmp_path / "quad.xml").write_text(text)
