"""Loading of vehicles: the description and the MJCF file, checked against each other, and the files they refer to.

A description names an MJCF file, which may include others and refer to meshes, textures and height fields. None of
these files may lie outside the description's directory. All are checked before MuJoCo opens any of them. MJCF does not
make MuJoCo load code, but plugins that are already loaded may do anything, so plugins are refused. Input that would
crash MuJoCo is refused too: unbounded nested copies, images larger than memory, and non-finite numbers, which MuJoCo
accepts with only a warning.
"""

import math
import os
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
from mjsheaf.engine import mujoco, refusing
from mjsheaf.errors import InputError, expected, in_field, shortened
from mjsheaf.io.files import confined, read_bytes, resource_directory
from mjsheaf.io.section import validation_problems
from mjsheaf.io.yaml import SUFFIXES, read_yaml
from mjsheaf.vehicles.actuators import LAGS, AnyActuator, Mount, Range, Thruster
from mjsheaf.vehicles.body import GRAVITY, ROW_NAMES, Inertial
from mjsheaf.vehicles.steering import Full
from mjsheaf.vehicles.vehicle import Vehicle, VehicleDescription

_LARGEST_FILE = 20_000_000  # maximum size of an XML file, bytes
_DEEPEST = 100  # maximum depth of nested elements
_MOST_COPIES = 1000  # maximum number of copies of one element, including nested copies
_LARGEST_GRID = 4096**2  # pixels of a texture, points of a height field
_LARGEST_NUMBER = 1e12
_ROOTS = ("mujoco", "mujocoinclude")
_COPYING = ("replicate", "composite", "flexcomp")
_GRIDS = {"texture": ("width", "height"), "hfield": ("nrow", "ncol")}
_WORDS = ("name", "class", "childclass")  # attributes that are words, even if they look like numbers
_DIRECTORIES = ("meshdir", "texturedir", "assetdir")
_IN_MESHDIR = ("mesh", "hfield", "skin")
_LAG_NAMES = {int(getattr(mujoco.mjtDyn, f"mjDYN_{name.upper()}")): name for name in LAGS}


class _Reference(NamedTuple):
    """A reference to a file in an MJCF file."""

    tag: str
    name: str
    within: Path  # directory of the file that contains the reference


class _Names(NamedTuple):
    """References and settings of an MJCF file and of the files that it includes."""

    references: list[_Reference]
    directories: dict[str, set[str]]


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
    names, files = _Names([], {name: set() for name in _DIRECTORIES}), [main]
    for path in files:  # grows with the files that they include
        known = len(names.references)
        _read(path, names)
        for reference in names.references[known:]:
            if reference.tag in ("include", "model"):
                files += [file for file in _places(reference, main, names, root) if file not in files]
    # The directories of meshes are known only after all files have been read.
    others = [file for reference in names.references for file in _places(reference, main, names, root)]
    return list(dict.fromkeys([*files, *others]))


def _places(reference: _Reference, main: Path, names: _Names, root: Path) -> list[Path]:
    """List the existing files that MuJoCo may resolve a reference to.

    Raises:
        InputError: A file is outside the root, or is not a regular file.
    """
    tag, name, within = reference
    own = "texturedir" if tag == "texture" else "meshdir"
    directories = names.directories[own] | names.directories["assetdir"]
    if not directories or tag not in ("texture", *_IN_MESHDIR):
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


def _read(path: Path, names: _Names) -> None:
    """Collect the references of one MJCF file.

    Raises:
        InputError: The file cannot be read, is not MJCF, declares a document type, or has a plugin.
    """
    parser = expat.ParserCreate("utf-8")
    copies = [1.0]  # number of copies of each enclosing element

    def begin(tag: str, attributes: dict[str, str]) -> None:
        where = f"{path}: line {parser.CurrentLineNumber}: <{tag}>"
        numbers = {key: _numbers(value) for key, value in attributes.items() if key not in _WORDS}
        for key, found in numbers.items():
            if not all(abs(x) <= _LARGEST_NUMBER for x in found):
                text = attributes[key][:50]
                raise InputError(f"{where}: {key} is {text}; expected numbers of at most {_LARGEST_NUMBER:g}")
        copies.append(copies[-1] * math.prod(numbers.get("count", [1.0]) if tag in _COPYING else [1.0]))
        size = math.prod(numbers.get(key, [1.0])[0] for key in _GRIDS.get(tag, ()) if numbers.get(key, [1.0]))
        for refused, what in (
            (copies[-1] > _MOST_COPIES, f"makes {copies[-1]:g} copies; expected at most {_MOST_COPIES}"),
            (size > _LARGEST_GRID, f"has {size:g} points; expected at most {_LARGEST_GRID}"),
            (len(copies) == 2 and tag not in _ROOTS, "is the root of the file; expected <mujoco>"),
            (len(copies) > _DEEPEST + 1, f"is nested more than {_DEEPEST} levels deep"),
            (tag in ("extension", "plugin"), "is not allowed: plugins are code"),
        ):
            if refused:
                raise InputError(f"{where} {what}")
        for key, value in attributes.items():
            if key.startswith("file"):
                names.references.append(_Reference(tag, value, path.parent))
            elif tag == "compiler" and key in _DIRECTORIES:
                names.directories[key].add(value)

    def doctype(*_: Any) -> None:
        raise InputError(f"{path}: a document type is not allowed; remove <!DOCTYPE")

    parser.StartElementHandler, parser.StartDoctypeDeclHandler = begin, doctype
    parser.EndElementHandler = lambda _: copies.pop()
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no regular file")
    try:
        parser.Parse(read_bytes(path, _LARGEST_FILE), True)
    except expat.ExpatError as error:
        raise InputError(f"{path}: not XML: {error}") from None


def _numbers(value: str) -> list[float]:
    """Split an attribute into numbers; empty if one of its words is not a number."""
    try:
        return [float(word) for word in value.split()]
    except ValueError:
        return []


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
        return _shipped(path)
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
    model, left_out = _compile(mjcf)
    return replace(_from_model(path.stem, description, mjcf, model), left_out=left_out)


_shipped = cache(_load)  # the runs of a study share it


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


def read_spec(path: Path) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """Read a vehicle's file without what belongs to a scene.

    That is its ground (planes and height fields), and the lights and cameras of its world, with the sensors and contact
    pairs that refer to them.

    Returns:
        The specification, and the names of the elements that are left out.

    Raises:
        InputError: The file is not valid, or has an element that cannot move with a vehicle; the message names it.
    """
    with refusing(str(path)):
        spec = mujoco.MjSpec.from_file(str(path))
    for body in spec.bodies:
        if body.mocap:
            raise InputError(
                f'{path}: body {body.name!r} has mocap="true", so it would not move with the vehicle; remove it, or '
                "the attribute"
            )
    ground = {mujoco.mjtGeom.mjGEOM_PLANE: "plane", mujoco.mjtGeom.mjGEOM_HFIELD: "height field"}
    world = spec.worldbody
    scene = [(ground[geom.type], geom) for geom in spec.geoms if geom.type in ground]
    scene += [("light", light) for light in world.lights] + [("camera", camera) for camera in world.cameras]
    left_out = tuple(f"{kind} {element.name!r}" if element.name else f"a {kind}" for kind, element in scene)
    geom, camera = mujoco.mjtObj.mjOBJ_GEOM, mujoco.mjtObj.mjOBJ_CAMERA
    gone = {(camera if kind == "camera" else geom, element.name) for kind, element in scene if kind != "light"}
    for sensor in list(spec.sensors):
        if gone & {(sensor.objtype, sensor.objname), (sensor.reftype, sensor.refname)}:
            spec.delete(sensor)
    for pair in list(spec.pairs):
        if gone & {(geom, pair.geomname1), (geom, pair.geomname2)}:
            spec.delete(pair)
    for _, element in scene:
        spec.delete(element)
    return spec, left_out


def _compile(path: Path) -> tuple[mujoco.MjModel, tuple[str, ...]]:
    """Compile a vehicle's file alone; also return what is left out, as `read_spec` does."""
    spec, left_out = read_spec(path)
    with refusing(str(path)):
        spec.compiler.fusestatic = False  # fusing would merge the vehicle into the world, which has no mass
        model = spec.compile()
    # Geoms of the world have no mass, but they would get one when the world becomes the vehicle's frame.
    for geom in spec.worldbody.geoms:
        if geom.density > 0.0 if np.isnan(geom.mass) else geom.mass > 0.0:
            name = f"geom {geom.name!r}" if geom.name else "a geom"
            raise InputError(
                f'{path}: {name} with mass is directly in <worldbody>; put it into a <body>, or set mass="0"'
            )
    return model, left_out


def _require_supported(model: mujoco.MjModel, path: Path) -> None:
    """Refuse a model with joints, without mass, or with actuators that mjsheaf does not know."""
    for holds, wanted in (
        (not model.nq, "must have no joints; mjsheaf gives the vehicle its free joint"),
        ((model.actuator_trntype == mujoco.mjtTrn.mjTRN_SITE).all(), "every actuator must act on a site"),
        (
            (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED).all()
            and (model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE).all(),
            "every actuator must have a fixed gain and no bias",
        ),
        (
            np.isin(model.actuator_dyntype, list(_LAG_NAMES)).all(),
            f"every actuator's dyntype must be one of {', '.join(LAGS)}",
        ),
        (model.body_mass.sum() > 0.0, "its mass is 0 kg; expected a positive one"),
    ):
        if not holds:
            raise InputError(f"{path}: {wanted}")


def _from_model(name: str, description: VehicleDescription, path: Path, model: mujoco.MjModel) -> Vehicle:
    _require_supported(model, path)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass, centre, inertia = mass_properties(model, data, slice(None))
    carried = float((model.body_mass * model.body_gravcomp).sum())
    drag = description.drag
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
        actuators=_actuators(path, model, data, description.actuators),
        hold=description.attitude,
        drag=linear,
        angular_drag=np.array(drag.angular, dtype=np.float64),
        quadratic_drag=np.array([*drag.quadratic, *drag.angular_quadratic], dtype=np.float64),
        added_mass=np.array(description.added_mass or [0.0] * 6, dtype=np.float64),
    )
    _check(vehicle)
    return vehicle


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
    if fault := vehicle.steering.fault(vehicle):
        raise InputError(f"{path}: {fault}")
    trim, (low, high) = vehicle.trim, vehicle.limits.T
    short = np.flatnonzero((trim < low) | (trim > high))
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


def _thruster_names(model: mujoco.MjModel) -> list[str]:
    names = [model.actuator(k).name for k in range(model.nu)]
    for k in range(model.nu):
        new = (f"thruster_{k}{'_' * i}" for i in count())
        names[k] = names[k] or next(name for name in new if name not in names)
    return names


def _actuators(
    path: Path, model: mujoco.MjModel, data: mujoco.MjData, described: dict[str, AnyActuator]
) -> list[Thruster]:
    """Read the actuators from a compiled file, because attributes in the XML may come from default classes.

    Raises:
        InputError: An actuator in the description does not exist, or does not have the thrust that the description
            requires.
    """
    names = _thruster_names(model)
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
