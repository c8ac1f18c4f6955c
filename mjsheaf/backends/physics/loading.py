"""Loading a vehicle: its description and its MJCF file, checked against each other."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from mjsheaf.backends.physics.description import VehicleDescription
from mjsheaf.backends.physics.sources import files_of
from mjsheaf.backends.physics.vehicle import GRAVITY, ROW_NAMES, Control, Vehicle
from mjsheaf.engine import mujoco
from mjsheaf.errors import InputError
from mjsheaf.reading import describe_validation_error, read_yaml
from mjsheaf.resources import resource_directory

Array = NDArray[np.float64]

LAGS = {
    "none": mujoco.mjtDyn.mjDYN_NONE,
    "filter": mujoco.mjtDyn.mjDYN_FILTER,
    "filterexact": mujoco.mjtDyn.mjDYN_FILTEREXACT,
}
"""How a thruster may follow its command: MJCF's dyntype."""

_LAG_NAMES = {int(lag): name for name, lag in LAGS.items()}


def list_vehicles() -> dict[str, Path]:
    """The vehicles that come with mjsheaf: name to description file."""
    return {path.stem: path for path in sorted(resource_directory("models").glob("*.yaml"))}


def load_vehicle(source: str, directory: Path | None = None) -> Vehicle:
    """Load a vehicle.

    Args:
        source: a name in models/, or the path of a description file, which may lie anywhere; what it names may not: all
            its files lie in its directory or below it.
        directory: what a relative path is relative to; None takes the working directory.

    Raises:
        InputError: no such vehicle, or its files are not valid; the message names the file.
    """
    known = list_vehicles()
    path = known.get(source) or (directory or Path()) / source
    if source not in known and path.suffix not in (".yaml", ".yml"):
        shown = source if len(source) <= 100 else source[:97] + "..."
        raise InputError(f"no vehicle {shown!r}; expected {', '.join(known)}, or the path of a description file")
    description = read_description(path)
    mjcf = path.parent / description.mjcf
    if source not in known:
        files_of(path, description.mjcf)  # refuses what lies outside, before anything opens it
    return _from_model(path.stem, description, mjcf, _compile(mjcf))


def read_description(path: Path) -> VehicleDescription:
    """Read a vehicle's description.

    Raises:
        InputError: the file is not valid, or is no file; the message names it.
    """
    if os.path.exists(path) and not os.path.isfile(path):  # a pipe would be waited on for ever
        raise InputError(f"{path}: is no regular file; expected the description of a vehicle")
    try:
        return VehicleDescription.model_validate(read_yaml(path))
    except ValidationError as error:
        raise InputError(f"{path}: {describe_validation_error(error, VehicleDescription)}") from None


def _compile(path: Path) -> mujoco.MjModel:
    """Compile a vehicle's file alone."""
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = False  # would make all of it part of the world, which has no mass
        model = spec.compile()
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:  # RuntimeError: no memory for it
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    # Of the world they have no mass, but once that is a vehicle's frame they would have.
    plate = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    for geom in spec.worldbody.geoms:
        heavy = geom.density > 0.0 if np.isnan(geom.mass) else geom.mass > 0.0
        if heavy and geom.type not in plate:
            name = f"geom {geom.name!r}" if geom.name else "a geom"
            raise InputError(
                f'{path}: {name} with mass stands in <worldbody> itself; put it into a <body>, or mass="0"'
            )
    return model


def _from_model(name: str, description: VehicleDescription, path: Path, model: mujoco.MjModel) -> Vehicle:
    if model.nq:
        raise InputError(f"{path}: must have no joints; mjsheaf gives the vehicle its free joint")
    if not (model.actuator_trntype == mujoco.mjtTrn.mjTRN_SITE).all():
        raise InputError(f"{path}: every actuator must act on a site")
    if not (
        (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED).all()
        and (model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE).all()
    ):
        raise InputError(f"{path}: every actuator must have a fixed gain and no bias")
    if not np.isin(model.actuator_dyntype, list(_LAG_NAMES)).all():
        raise InputError(f"{path}: every actuator's dyntype must be one of {', '.join(LAGS)}")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    site = model.actuator_trnid[:, 0]
    axes = data.site_xmat[site].reshape(-1, 3, 3)
    force = np.einsum("kij,kj->ki", axes, model.actuator_gear[:, :3])
    moment = np.cross(data.site_xpos[site], force) + np.einsum("kij,kj->ki", axes, model.actuator_gear[:, 3:])
    W = (np.hstack([force, moment]) * model.actuator_gainprm[:, :1]).T

    if not model.body_mass.sum() > 0.0:
        raise InputError(f"{path}: its mass is 0 kg; expected a positive one")
    mass, centre, inertia = mass_properties(model, data, slice(None))
    carried = float((model.body_mass * model.body_gravcomp).sum())
    drag, steering = description.drag, description.steering
    linear = np.full(3, mass / drag.time_constant) if drag.time_constant else np.array(drag.linear, dtype=np.float64)
    control: Control = "full"
    if steering is not None:
        control = "hand_point" if steering.hand_point is not None else "thrust_vector"
    vehicle = Vehicle(
        name=name,
        description=description,
        path=path,
        control=control,
        mass=mass,
        weight=(mass - carried) * GRAVITY,
        ballast=0.0,
        centre_of_mass=centre,
        inertia=inertia,
        inertials=[_inertial(model, b) for b in range(1, model.nbody)],
        thrusters=_thruster_names(model),
        actuation=[_actuation(model, k) for k in range(model.nu)],
        W=W,
        drag=linear,
        angular_drag=np.array(drag.angular, dtype=np.float64),
        quadratic_drag=np.array([*drag.quadratic, *drag.angular_quadratic], dtype=np.float64),
        added_mass=np.array(description.added_mass or [0.0] * 6, dtype=np.float64),
        rate=description.autopilot.rate if description.autopilot else 0.0,
        hand=(steering.hand_point or 0.0) if steering else 0.0,
        tilt=(steering.largest_tilt or 0.0) if steering else 0.0,
    )
    _check(vehicle)
    return vehicle


def _check(vehicle: Vehicle) -> None:
    """Refuse a vehicle whose thrusters cannot do what its way of control asks of them.

    Raises:
        InputError: naming what is lacking.
    """
    rows, path = vehicle.controlled_rows, vehicle.path
    if np.linalg.matrix_rank(vehicle.W[rows]) < len(rows):
        left = np.linalg.svd(vehicle.W[rows])[0][:, -1]
        lacking = ROW_NAMES[rows[int(np.argmax(np.abs(left)))]]
        steering = "" if vehicle.control != "full" else "; an underactuated vehicle needs `steering` in its description"
        raise InputError(
            f"{path}: the thrusters cannot produce every wanted wrench; lacking is {lacking} (Assumption 2){steering}"
        )
    if vehicle.control == "hand_point" and not vehicle.angular_drag[2] > 0.0:
        raise InputError(f"{path}: a hand point needs a positive drag.angular in yaw, as g divides by it")
    trim, (low, high) = vehicle.trim, vehicle.limits.T
    short = np.flatnonzero((trim < low) | (trim > high))
    if short.size:
        k = short[0]
        raise InputError(
            f"{path}: cannot carry its own weight: {vehicle.thrusters[k]} would need a command of {trim[k]:.4g}, "
            f"its range is {low[k]:.4g} to {high[k]:.4g}"
        )


def mass_properties(model: mujoco.MjModel, data: mujoco.MjData, bodies: slice) -> tuple[float, Array, Array]:
    """Mass in kg, centre of mass (3,) in m and inertia about the origin (3, 3) in kg m^2 of a slice of the bodies.

    World axes, for the bodies where `data` has them.
    """
    m, r, axes = model.body_mass[bodies], data.xipos[bodies], data.ximat[bodies].reshape(-1, 3, 3)
    mass, second = float(m.sum()), np.einsum("b,bi,bj->ij", m, r, r)
    inertia = np.einsum("bij,bj,bkj->ik", axes, model.body_inertia[bodies], axes)
    return mass, m @ r / mass, inertia + np.trace(second) * np.eye(3) - second


def _inertial(model: mujoco.MjModel, b: int) -> dict[str, Any]:
    return {
        "pos": model.body_ipos[b].copy(),
        "quat": model.body_iquat[b].copy(),
        "mass": model.body_mass[b],
        "diaginertia": model.body_inertia[b].copy(),
    }


def _thruster_names(model: mujoco.MjModel) -> list[str]:
    names = [model.actuator(k).name for k in range(model.nu)]
    for k in range(model.nu):
        if not names[k]:
            name = f"thruster_{k}"
            while name in names:
                name += "_"
            names[k] = name
    return names


def _actuation(model: mujoco.MjModel, k: int) -> dict[str, Any]:
    """What the arena must be told of actuator k beside where it acts, read from the compiled file.

    The file's own elements would not do: most of it may stand in their default class.
    """
    attributes: dict[str, Any] = {
        "dyntype": _LAG_NAMES[int(model.actuator_dyntype[k])],
        "dynprm": model.actuator_dynprm[k].copy(),
        "gainprm": model.actuator_gainprm[k].copy(),
        "actearly": "true" if model.actuator_actearly[k] else "false",
    }
    for name in ("ctrl", "force", "act"):
        limited = bool(getattr(model, f"actuator_{name}limited")[k])
        attributes[f"{name}limited"] = "true" if limited else "false"
        if limited:
            attributes[f"{name}range"] = getattr(model, f"actuator_{name}range")[k].copy()
    return attributes
