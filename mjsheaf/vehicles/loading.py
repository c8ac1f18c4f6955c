"""Loading of vehicles: the description and the MJCF file, checked against each other, and the files they refer to.

A description names an MJCF file, which may include others and refer to meshes, textures and height fields. None of
these files may lie outside the description's directory. All are checked before MuJoCo opens any of them. Plugins are
refused, because they are code. Nothing else protects MuJoCo from a malicious file.
"""

import json
import os
import re
from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat

import numpy as np
from pydantic import ValidationError

from mjsheaf.arguments import require_type
from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, expected, in_field, joined, listed, shortened
from mjsheaf.files import SUFFIXES, confined, read_bytes, read_yaml, resource_directory
from mjsheaf.mujoco_import import mujoco, refusing
from mjsheaf.section import validation_problems
from mjsheaf.vehicles.actuators import LAGS, AnyActuator, Mount, Range, Thruster
from mjsheaf.vehicles.steering import Full
from mjsheaf.vehicles.vehicle import GRAVITY, ROW_NAMES, Inertial, Vehicle, VehicleDescription

SEEN_GROUPS = 3
"""MuJoCo shows geoms of the first three groups; collision shapes are in later ones."""

_LARGEST_FILE = 20_000_000  # maximum size of an XML file, bytes
_ROUNDING = 1e-9  # of the largest of commands and wrenches
_WORDS = ("name", "class", "childclass")  # attributes that are words, even if they look like numbers
_NO_NUMBER = re.compile(r"(?i)(^|\s)[-+]?(nan|inf(inity)?)(\s|\(|$)")
_DIRECTORIES = ("meshdir", "texturedir", "assetdir")
_GROUND = {mujoco.mjtGeom.mjGEOM_PLANE: "plane", mujoco.mjtGeom.mjGEOM_HFIELD: "height field"}
ACCEPTED = {
    kind: frozenset(names.split())
    for kind, names in {
        "actuator": """
            actearly actlimited actrange biasprm classname compiler ctrllimited ctrlrange dynprm dyntype forcelimited
            forcerange gainprm gear group id info lengthrange name plugin signature target trntype type userdata
        """,
        "joint": """
            actgravcomp align axis classname compiler frame group id info limited margin name parent pos range ref
            signature solimp_friction solimp_limit solref_friction solref_limit springref type userdata
        """,
        "body": """
            alt bodies cameras childclass classname compiler explicitinertial frame frames fullinertia fuse geoms
            gravcomp ialt id inertia info ipos iquat joints lights mass name parent plugin pos quat signature simple
            sites sleep userdata
        """,
        "option": """
            ccd_iterations ccd_tolerance cone density disableflags enableflags gravity impratio integrator iterations
            jacobian ls_iterations ls_tolerance magnetic noslip_iterations noslip_tolerance o_friction o_margin
            o_solimp o_solref sdf_initpoints sdf_iterations sleep_tolerance solver timestep tolerance viscosity wind
        """,
        "flag": """
            autoreset constraint contact equality eulerdamp filterparent frictionloss gravity island limit midphase
            multiccd nativeccd refsafe sensor warmstart
        """,
    }.items()
}
"""Attributes of MuJoCo's elements, and flags that may be disabled, that are modelled or have no effect on a vehicle.

Others must have MuJoCo's default: what MuJoCo gains is refused until it is listed here.
"""
_LAG_NAMES = {int(getattr(mujoco.mjtDyn, f"mjDYN_{name.upper()}")): name for name in LAGS}


class _Reference(NamedTuple):
    """A reference to a file in an MJCF file."""

    tag: str
    name: str
    within: Path  # directory of the file that contains the reference


def files_of(description: Path, mjcf: str) -> list[Path]:
    """List the files of a vehicle.

    Args:
        description: File of its description.
        mjcf: Path of the MJCF file, relative to the description's directory.

    Returns:
        The MJCF file first, then all existing files that it refers to directly or indirectly, as absolute paths with
        links resolved.

    Raises:
        InputError: A file lies outside the directory of the description, or an MJCF file is not valid or has a plugin.
    """
    root = description.parent.resolve()
    with in_field(f"{description}: mjcf"):
        main = confined(mjcf, root)
    references = list[_Reference]()
    directories = {name: set[str]() for name in _DIRECTORIES}
    files = [main]
    for path in files:  # grows with the files that they include
        known = len(references)
        _read(path, references, directories)
        for reference in references[known:]:
            if reference.tag in ("include", "model"):
                files += [file for file in _places(reference, main, directories, root) if file not in files]
    # The directories of meshes are known only after all files have been read.
    others = [file for reference in references for file in _places(reference, main, directories, root)]
    return list(dict.fromkeys([*files, *others]))


def _places(reference: _Reference, main: Path, settings: dict[str, set[str]], root: Path) -> list[Path]:
    """List the existing files that MuJoCo may resolve a reference to.

    Raises:
        InputError: A file is outside the root, or is not a regular file.
    """
    tag, name, within = reference
    own = "texturedir" if tag == "texture" else "meshdir"
    directories = settings[own] | settings["assetdir"]
    if not directories or tag not in ("texture", "mesh", "hfield", "skin"):
        directories = directories | {""}
    found = []
    for base in sorted({main.parent, within}):
        for directory in sorted(directories):
            for file in sorted({name, Path(name).name}):  # the latter with <compiler strippath="true"/>
                with in_field(f"{main}: <{tag}>"):
                    path = confined(file, base / directory, root)
                if path.is_file():
                    found.append(path)
                elif path.exists() and not path.is_dir():
                    raise InputError(f"{main}: <{tag}>: {name!r} is no regular file")
    return found


def _read(path: Path, references: list[_Reference], directories: dict[str, set[str]]) -> None:
    """Collect the references of one MJCF file, and its directories of meshes and textures.

    Raises:
        InputError: The file cannot be read, is not MJCF, declares a document type, or has a plugin.
    """
    parser = expat.ParserCreate("utf-8")

    def begin(tag: str, attributes: dict[str, str]) -> None:
        if tag in ("extension", "plugin"):
            raise InputError(f"{path}: line {parser.CurrentLineNumber}: <{tag}> is not allowed: plugins are code")
        for key, value in attributes.items():
            if key not in _WORDS and _NO_NUMBER.search(value):  # MuJoCo takes them for numbers that are not given
                raise InputError(f"{path}: line {parser.CurrentLineNumber}: <{tag}>: {key} is {value[:50]}")
            if key.startswith("file"):
                references.append(_Reference(tag, value, path.parent))
            elif tag == "compiler" and key in _DIRECTORIES:
                directories[key].add(value)

    def doctype(*_: Any) -> None:
        raise InputError(f"{path}: a document type is not allowed; remove <!DOCTYPE")

    parser.StartElementHandler, parser.StartDoctypeDeclHandler = begin, doctype
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no regular file")
    try:
        parser.Parse(read_bytes(path, _LARGEST_FILE), True)
    except expat.ExpatError as error:
        raise InputError(f"{path}: not XML: {error}") from None


def list_vehicles() -> dict[str, Path]:
    """List the vehicles that come with mjsheaf: description files by name."""
    return {path.stem: path for path in sorted(resource_directory("models").glob("*.yaml"))}


def load_vehicle(source: str, directory: Path | None = None) -> Vehicle:
    """Load a vehicle.

    Args:
        source: Name in models/, or path of a description file anywhere. Files that the description refers to must lie
            in its directory or below it.
        directory: Base of a relative path; None takes the working directory.

    Raises:
        InputError: There is no such vehicle, or its files are not valid; the message names the file.
    """
    require_type("source", source, str, "the name of a vehicle, or the path of its description")
    known = list_vehicles()
    path = known.get(source) or (directory or Path()) / source
    if source in known:
        mjcf = path.with_suffix(".xml")
        return _shipped(path, path.read_bytes(), mjcf.read_bytes())
    if path.suffix == ".xml":
        name = shortened(path.stem, 50)
        raise InputError(
            f"{shortened(source, 100)}: a model (MJCF) alone is not a vehicle; expected its description, such as "
            f"{name}.yaml with `mjcf: {name}.xml`, a domain, drag and attitude"
        )
    if path.suffix not in SUFFIXES:
        raise InputError(
            f"no vehicle {shortened(source, 100)!r}; expected {', '.join(known)}, or the path of a description file "
            f"({' or '.join(SUFFIXES)})"
        )
    files_of(path, read_description(path).mjcf)  # refuses files outside the directory before they are opened
    return _load(path)


def _load(path: Path) -> Vehicle:
    description = read_description(path)
    mjcf = path.parent / description.mjcf
    model, data, left_out = _compile(mjcf)
    return replace(_from_model(path.stem, description, mjcf, model, data), left_out=left_out)


@cache
def _shipped(path: Path, *content: bytes) -> Vehicle:
    """Load a vehicle that comes with mjsheaf and has this content; the runs of a study share it."""
    return _load(path)


def read_description(path: Path) -> VehicleDescription:
    """Read a vehicle's description.

    Raises:
        InputError: The file is not valid, or is not a regular file; the message names it.
    """
    if os.path.exists(path) and not os.path.isfile(path):  # reading a pipe would block forever
        raise InputError(f"{path}: is no regular file; expected the description of a vehicle")
    try:
        return VehicleDescription.model_validate(read_yaml(path))
    except ValidationError as error:
        raise InputError(*validation_problems(error, VehicleDescription)).within(path) from None


def propose_description(path: Path, name: str) -> str:
    """Return a description of the vehicle in an MJCF file, with TODO for each number that the file does not say.

    A vehicle whose thrusters cannot lift its weight moves on the surface. One whose thrusters do not push along every
    axis is steered at its bows, or leans.

    Args:
        path: The MJCF file.
        name: Its name in the description.

    Raises:
        InputError: The file is not valid, or refers to files outside its directory.
    """
    files_of(path, path.name)
    model, data, left_out = _compile(path)
    size, thrusters = _size(model, data), _actuators(path, model, data, {})
    mass, _, inertia = mass_properties(model, data, slice(None))
    W = np.array([thruster.wrench for thruster in thrusters]).reshape(-1, 6)
    weight = GRAVITY * float((model.body_mass * (1.0 - model.body_gravcomp)).sum())
    up = [one for one in thrusters if abs(one.wrench[2]) > _ROUNDING * np.abs(W).max()]
    flies = sum(max(one.wrench[2] * np.array(one.thrust)) for one in up) > weight
    lag = max((thruster.lag for thruster in thrusters), default=0.0)
    frequency = 2.0 if not flies else 0.3 / lag if lag else 10.0
    about = " ".join(f"{moment:.4g}" for moment in np.diag(inertia))
    ranges = [f"# {one.name}: {one.thrust[0]:g} to {one.thrust[1]:g} N, lag {one.lag:g} s" for one in thrusters]
    lines = [
        f"# {path.name}: {mass:.4g} kg; inertia about the origin {about} kg m^2; longest side {size:.3g} m.",
        *ranges,
        *([f"# Left out: {listed(left_out)}."] if left_out else []),
        "# The file does not say the rest. Replace each TODO by a number, and check what is proposed: the guide",
        "# `Bring a vehicle` says where numbers come from. Name thrusters that turn, or have a rudder, in `actuators`.",
        f"summary: {json.dumps(path.stem)}",
        f"mjcf: {json.dumps(name)}",
        f"domain: {'volume' if flies else 'surface'}  # proposed",
        "drag:",
        "  linear: [TODO, TODO, TODO]  # surge, sway, heave, N s/m",
    ]
    if not flies:
        lines.append("  angular: [TODO, TODO, TODO]  # roll, pitch, yaw, N m s/rad")
        lines.append("hydrostatics: {heave: TODO, roll: TODO, pitch: TODO}  # N/m, N m/rad")
    lines.append(f"attitude: {{frequency: {frequency:.2g}}}  # rad/s, proposed")
    if not thrusters:
        return "\n".join([*lines, "drifts: true  # it has no thrusters", ""])
    lines.append(f"autopilot: {{rate: {0.2 * frequency if flies else 1.0:.2g}}}  # 1/s, proposed")
    rows = Full.rows[3 if flies else 2]
    if np.linalg.matrix_rank(W[:, rows]) < len(rows):
        proposed = "largest_tilt: 30}  # degrees" if flies else f"hand_point: {0.5 * size or 1.0:.2g}}}  # m ahead"
        lines.append(f"steering: {{{proposed}, proposed")
    return "\n".join([*lines, ""])


def read_spec(path: Path) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """Read a vehicle's file without the parts that belong to a scene.

    The body with the free joint is the vehicle, and everything else in the world is the scene. In a file without a free
    joint, all bodies are the vehicle, and planes, height fields, and the lights and cameras of the world are the scene.
    The free joint, the pose of the vehicle's body, sensors, keyframes and options are left out too. Gravity is kept, so
    bodies have their weight in the file.

    Returns:
        The specification, and the names of the parts that are left out.

    Raises:
        InputError: The file is not valid, or has something that changes a vehicle's motion and is not modelled; the
            message names it.
    """
    with refusing(str(path)):
        spec = mujoco.MjSpec.from_file(str(path))
    spec.nuserdata, spec.memory, spec.njmax, spec.nconmax = 0, -1, -1, -1  # room for what a vehicle alone does not use
    with in_field(str(path)):
        left_out = _remove_scene(spec)
        _require_modelled(spec)
        for joint in list(spec.joints):
            left_out.append(_name("free joint", joint))
            joint.parent.sleep = mujoco.mjtSleepPolicy.mjSLEEP_AUTO  # others need a joint
            spec.delete(joint)
        left_out += _move_to_origin(spec.worldbody)
        left_out += _take_gravity(spec)
    return spec, tuple(dict.fromkeys(left_out))


def _name(kind: str, element: Any) -> str:
    article = "an" if kind[0] in "aeiou" else "a"
    return f"{kind} {element.name!r}" if element.name else f"{article} {kind}"


def _remove_scene(spec: mujoco.MjSpec) -> list[str]:
    """Remove everything but the vehicle with its free joint from a specification; return the names of what is removed.

    Raises:
        InputError: There are several vehicles, an actuator acts on something else, or something may hold the vehicle.
    """
    for kind, elements in (("equality", spec.equalities), ("tendon", spec.tendons), ("flex", spec.flexes)):
        for element in elements:
            raise InputError(f"{_name(kind, element)} is not modelled; expected a rigid body with actuators on sites")
    world, free = spec.worldbody, mujoco.mjtJoint.mjJNT_FREE
    free_bodies = [body for body in world.bodies if any(joint.type == free for joint in body.joints)]
    if len(free_bodies) > 1:
        several = joined([_name("body", body) for body in free_bodies])
        raise InputError(f"{several} have free joints; expected one: a file has one vehicle")
    if free_bodies:
        own_sites = free_bodies[0].find_all("site")
        scene = [(_GROUND.get(geom.type, "geom"), geom) for geom in world.geoms]
        scene += [("site", site) for site in world.sites]
        scene += [("body", body) for body in world.bodies if not any(joint.type == free for joint in body.joints)]
    else:
        own_sites = spec.sites
        scene = [(_GROUND[geom.type], geom) for geom in spec.geoms if geom.type in _GROUND]
    scene += [("light", light) for light in world.lights] + [("camera", camera) for camera in world.cameras]
    sites = {site.name for site in own_sites}
    for actuator in spec.actuators:
        if actuator.trntype != mujoco.mjtTrn.mjTRN_SITE or actuator.target not in sites:
            raise InputError(
                f"{_name('actuator', actuator)} acts on {_shown(actuator.trntype)} {actuator.target!r}; every actuator "
                "must act on a site of the vehicle"
            )
    scene += [("keyframe", key) for key in spec.keys]
    left_out = [_name(kind, element) for kind, element in scene]
    for kind, element in scene if spec.compiler.settotalmass > 0.0 else []:
        if kind == "body":
            raise InputError(f"compiler: settotalmass counts {_name(kind, element)} too; expected the vehicle alone")
    if spec.sensors:
        left_out.append("sensors")
    skies = [texture for texture in spec.textures if texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX]
    for element in [*spec.sensors, *spec.tuples, *skies, *(element for _, element in scene)]:
        spec.delete(element)
    geoms, bodies = {geom.name for geom in spec.geoms}, {body.name for body in spec.bodies}
    missing = [pair for pair in spec.pairs if not {pair.geomname1, pair.geomname2} <= geoms]
    missing += [one for one in [*spec.cameras, *spec.lights] if one.targetbody and one.targetbody not in bodies]
    for element in missing:
        spec.delete(element)
    return left_out


def _require_modelled(spec: mujoco.MjSpec) -> None:
    """Refuse a specification that MuJoCo would move in another way than a rigid body with thrusters.

    Raises:
        InputError: The message names the element and its attribute.
    """
    for joint in spec.joints:
        if joint.type != mujoco.mjtJoint.mjJNT_FREE or joint.parent.parent.name != "world":
            raise InputError(
                f"{_name('joint', joint)} of {_name('body', joint.parent)}: a vehicle must have no joints; mjsheaf "
                "gives the vehicle its free joint"
            )
    for body in spec.bodies:
        if body.mocap:
            raise InputError(
                f'{_name("body", body)} has mocap="true", so it would not move with the vehicle; remove it, or the '
                "attribute"
            )
    plain = mujoco.MjSpec()
    body = plain.worldbody.add_body()
    for kind, elements, default in (
        ("actuator", spec.actuators, plain.add_actuator()),
        ("joint", spec.joints, body.add_freejoint()),
        ("body", spec.bodies[1:], body),
        ("option", [spec.option], mujoco.MjSpec().option),
    ):
        for element in elements:
            what = kind if kind == "option" else _name(kind, element)
            for attribute in dir(element):
                value = getattr(element, attribute)
                if attribute.startswith("_") or attribute in ACCEPTED[kind] or callable(value):
                    continue
                if not np.array_equal(value, getattr(default, attribute)):
                    wanted = _shown(getattr(default, attribute))
                    raise InputError(
                        f"{what}: {attribute} is {_shown(value)}, which is not modelled; expected {wanted}"
                    )
    for actuator in spec.actuators:
        if int(actuator.dyntype) not in _LAG_NAMES:
            raise InputError(f"{_name('actuator', actuator)}: dyntype must be one of {', '.join(LAGS)}")


def _shown(value: Any) -> str:
    """Return an attribute of an element as MJCF has it."""
    if isinstance(value, str):
        return repr(value)
    return value.name.split("_")[1].lower() if hasattr(value, "name") else " ".join(f"{x:g}" for x in np.ravel(value))


def _move_to_origin(world: mujoco.MjsBody) -> list[str]:
    """Put the vehicle's body at the origin, level: its pose is where it stands; return the name of what is omitted.

    Raises:
        InputError: Several elements in the world are the vehicle, none of them at the origin.
    """
    if any(is_at_origin(body) for body in world.bodies) or not world.bodies:
        return []
    if len(world.bodies) > 1 or world.geoms or world.sites:
        raise InputError(
            f"{_name('body', world.bodies[0])} is neither at the origin nor alone in <worldbody>; expected a free "
            'joint in the body that is the vehicle, or pos="0 0 0"'
        )
    place = world.bodies[0]
    while place is not None:
        place.pos, place.quat, place.alt.type = [0, 0, 0], [1, 0, 0, 0], mujoco.mjtOrientation.mjORIENTATION_QUAT
        place = place.frame
    return [f"pose of {_name('body', world.bodies[0])}"]


def is_at_origin(body: mujoco.MjsBody) -> bool:
    """Return True if a body of the world is at the origin, level, and in no frame."""
    turned = body.alt.type != mujoco.mjtOrientation.mjORIENTATION_QUAT or not np.array_equal(body.quat, [1, 0, 0, 0])
    return not (turned or body.frame or np.any(body.pos))


def _take_gravity(spec: mujoco.MjSpec) -> list[str]:
    """Give bodies their weight under the file's gravity, and forget all options; return the names of those left out.

    Raises:
        InputError: Gravity is not along z, or a flag changes the motion of a vehicle.
    """
    option, default = spec.option, mujoco.MjSpec().option
    weightless = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    for name, bit in mujoco.mjtDisableBit.__members__.items():
        prefix, _, flag = name.lower().partition("_")
        if prefix == "mjdsbl" and option.disableflags & int(bit) and flag not in ACCEPTED["flag"]:
            raise InputError(f'option: flag {flag}="disable" is not modelled; expected "enable"')
    x, y, z = np.zeros(3) if option.disableflags & weightless else option.gravity
    if x or y:
        raise InputError(f"option: gravity is {_shown(option.gravity)}; expected one along z")
    for body in spec.bodies[1:] if z != -GRAVITY else []:
        body.gravcomp = 1.0 + z / GRAVITY * (1.0 - body.gravcomp)
    kept = {"gravity", "disableflags", "enableflags"}
    own = sorted(ACCEPTED["option"] - kept)
    names = [name for name in own if not np.array_equal(getattr(option, name), getattr(default, name))]
    names += ["flag"] if option.disableflags & ~weightless or option.enableflags else []
    of_drag = " (drag is that of the description)" if option.density or option.viscosity else ""
    spec.option = default
    return [f"option {', '.join(names)}{of_drag}"] if names else []


def _compile(path: Path) -> tuple[mujoco.MjModel, mujoco.MjData, tuple[str, ...]]:
    """Compile a vehicle's file alone; return it in its initial state, and the names of what `read_spec` leaves out."""
    spec, left_out = read_spec(path)
    with refusing(str(path)):
        spec.compiler.fusestatic = False  # fusing would merge the vehicle into the world, which has no mass
        model = spec.compile()
    # Geoms of the world have no mass, but they would get one when the world becomes the vehicle's frame.
    for geom in spec.worldbody.geoms:
        if geom.density > 0.0 if np.isnan(geom.mass) else geom.mass > 0.0:
            raise InputError(
                f"{path}: {_name('geom', geom)} with mass is directly in <worldbody>; put it into a <body>, or set "
                'mass="0"'
            )
    if not model.body_mass.sum() > 0.0:
        raise InputError(f"{path}: its mass is 0 kg; expected a positive one")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data, left_out


def _from_model(
    name: str,
    description: VehicleDescription,
    path: Path,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    *,
    heaviest: float = 1e12,
) -> Vehicle:
    mass, centre, inertia = mass_properties(model, data, slice(None))
    about_centre = inertia - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    movable = mass <= heaviest and np.isfinite(inertia).all()
    if not (movable and np.linalg.eigvalsh(about_centre)[0] > mujoco.mjMINVAL):
        raise InputError(f"{path}: its mass or inertia is too small or too large to move; expected those of a vehicle")
    carried = float((model.body_mass * model.body_gravcomp).sum())
    drag, size, windage = description.drag, _size(model, data), description.windage
    reach = np.zeros(model.nbody)  # how far a body's origin is from the vehicle's at most; parents come first
    for body in range(1, model.nbody):
        reach[body] = reach[model.body_parentid[body]] + np.linalg.norm(model.body_pos[body])
    farthest = reach[model.geom_bodyid] + np.linalg.norm(model.geom_pos, axis=1) + model.geom_rbound
    linear = np.full(3, mass / drag.time_constant) if drag.time_constant else np.array(drag.linear, dtype=np.float64)
    vehicle = Vehicle(
        name=name,
        description=description,
        path=path,
        steering=description.steering or Full(),
        rate=description.autopilot.rate if description.autopilot else 0.0,
        dimension=2 if description.domain == "surface" else 3,
        mass=mass,
        weight=(mass - carried) * GRAVITY,
        ballast=0.0,
        centre_of_mass=centre,
        weight_moment=GRAVITY * (model.body_mass * (1.0 - model.body_gravcomp)) @ data.xipos,
        inertia=inertia,
        inertials=[
            Inertial(*(x[b].copy() for x in (model.body_ipos, model.body_iquat, model.body_mass, model.body_inertia)))
            for b in range(1, model.nbody)
        ],
        radius=float(farthest[model.geom_group < SEEN_GROUPS].max(initial=0.05)),
        size=size,
        actuators=_actuators(path, model, data, description.actuators),
        hold=description.attitude,
        drag=linear,
        angular_drag=np.array(drag.angular, dtype=np.float64),
        quadratic_drag=np.array([*drag.quadratic, *drag.angular_quadratic], dtype=np.float64),
        added_mass=np.array(description.added_mass or [0.0] * 6, dtype=np.float64),
        windage=np.zeros(4) if windage is None else windage.pack(size),
    )
    _check(vehicle)
    return vehicle


def _size(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the longest side of the box about all geoms along the axes, m; 0 without geoms."""
    frames = data.geom_xmat.reshape(-1, 3, 3)
    middle = data.geom_xpos + np.einsum("gij,gj->gi", frames, model.geom_aabb[:, :3])
    half = np.einsum("gij,gj->gi", np.abs(frames), model.geom_aabb[:, 3:])
    return float(((middle + half).max(axis=0) - (middle - half).min(axis=0)).max()) if model.ngeom else 0.0


def _check(vehicle: Vehicle) -> None:
    """Refuse a vehicle whose thrusters cannot produce the wrenches that its steering commands.

    A vehicle that drifts has no thrusters.

    Raises:
        InputError: The message names the missing direction.
    """
    if vehicle.description.drifts:
        if vehicle.actuators:
            raise InputError(f"{vehicle.path}: a drifting vehicle has no thrusters; remove <actuator>, or drifts: true")
        return
    rows, path = vehicle.controlled_rows, vehicle.path
    if np.linalg.matrix_rank(vehicle.W[rows]) < len(rows):
        left = np.linalg.svd(vehicle.W[rows])[0][:, -1]
        lacking = ROW_NAMES[rows[int(np.argmax(np.abs(left)))]]
        steered = vehicle.steering.underactuated
        steering = "" if steered else "; an underactuated vehicle needs `steering` in its description"
        raise InputError(
            f"{path}: the thrusters cannot produce every required wrench; {lacking} is missing (Assumption 2){steering}"
        )
    trim, (low, high) = vehicle.trim, vehicle.limits.T
    rounding = _ROUNDING * np.abs(trim).max(initial=0.0)
    short = np.flatnonzero((trim < low - rounding) | (trim > high + rounding))
    if short.size:
        k = short[0]
        raise InputError(
            f"{path}: cannot carry its own weight: {vehicle.thrusters[k]} would need a command of {trim[k]:.4g}, "
            f"but its range is {low[k]:.4g} to {high[k]:.4g}"
        )


def mass_properties(model: mujoco.MjModel, data: mujoco.MjData, bodies: slice) -> tuple[float, Array, Array]:
    """Compute mass, kg, centre of mass, (3,), m, and inertia about the origin, (3, 3), kg m^2, of a slice of bodies.

    They are in world axes, with the bodies at the poses in `data`.
    """
    m, r, axes = model.body_mass[bodies], data.xipos[bodies], data.ximat[bodies].reshape(-1, 3, 3)
    mass, second = float(m.sum()), np.einsum("b,bi,bj->ij", m, r, r)
    inertia = np.einsum("bij,bj,bkj->ik", axes, model.body_inertia[bodies], axes)
    return mass, m @ r / mass, inertia + np.trace(second) * np.eye(3) - second


def _actuators(
    path: Path, model: mujoco.MjModel, data: mujoco.MjData, described: dict[str, AnyActuator]
) -> list[Thruster]:
    """Read the actuators from a compiled file, because attributes in the XML may come from default classes.

    Raises:
        InputError: An actuator in the description does not exist, or does not have the thrust that the description
            requires.
    """
    names = [model.actuator(k).name for k in range(model.nu)]
    for k in range(model.nu):
        new = (f"thruster_{k}{'_' * i}" for i in count())
        names[k] = names[k] or next(name for name in new if name not in names)
    for name in described:
        if name not in names:
            raise InputError(f"{path}: actuators.{name} of the description does not exist; {expected(name, names)}")
    site, gains = model.actuator_trnid[:, 0], model.actuator_gainprm[:, :1]
    axes, arms = data.site_xmat[site].reshape(-1, 3, 3), data.site_xpos[site]
    force = np.einsum("kij,kj->ki", axes, model.actuator_gear[:, :3])
    torque = np.einsum("kij,kj->ki", axes, model.actuator_gear[:, 3:])
    wrenches = np.hstack([force, np.cross(arms, force) + torque]) * gains
    actuators = []
    for k, name in enumerate(names):
        thruster = Thruster(
            name=name,
            wrench=wrenches[k],
            gain=float(gains[k, 0]),
            ctrl=_range(model, "ctrl", k),
            force=_range(model, "force", k),
            act=_range(model, "act", k),
            law=_LAG_NAMES[int(model.actuator_dyntype[k])],
            time_constant=float(model.actuator_dynprm[k, 0]),
            early=bool(model.actuator_actearly[k]),
        )
        if name in described:
            mount = Mount(arms[k], force[k] * gains[k], torque[k] * gains[k])
            with in_field(f"{path}: actuators.{name}"):
                thruster = described[name].fit(thruster, mount)
        actuators.append(thruster)
    return actuators


def _range(model: mujoco.MjModel, what: str, k: int) -> Range:
    if not getattr(model, f"actuator_{what}limited")[k]:
        return None
    low, high = getattr(model, f"actuator_{what}range")[k]
    return float(low), float(high)
