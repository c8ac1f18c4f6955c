"""A vehicle: an MJCF file, a short description of how the medium acts on it, and what follows from both.

The MJCF file says what the body is: mass, inertia, shape, and thrusters as actuators on sites. The description beside
it says what MJCF cannot: in which medium it moves, its drag relative to the medium, its hydrostatics, and how stiffly
its attitude is held. Wrenches are about the origin of the body frame, in body axes (x forward, y port, z up).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from mjsheaf.engine import mujoco
from mjsheaf.errors import InputError
from mjsheaf.reading import Section, describe_validation_error, read_yaml
from mjsheaf.resources import resource_directory

Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s^2

_ROW_NAMES = ("surge force", "sway force", "heave force", "roll moment", "pitch moment", "yaw moment")
_LAGS = {
    int(mujoco.mjtDyn.mjDYN_NONE): "none",
    int(mujoco.mjtDyn.mjDYN_INTEGRATOR): "integrator",
    int(mujoco.mjtDyn.mjDYN_FILTER): "filter",
    int(mujoco.mjtDyn.mjDYN_FILTEREXACT): "filterexact",
}
_SURFACE_ROWS, _ALL_ROWS = [0, 1, 5], [0, 1, 2, 3, 4, 5]

Triple = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=3, max_length=3)]


class Drag(Section):
    """Linear drag relative to the medium, in body axes; give either time_constant or linear."""

    time_constant: Annotated[float, Field(gt=0)] | None = Field(None, description="m / D, s: isotropic")
    linear: Triple | None = Field(None, description="surge, sway, heave, N s/m")
    angular: Triple = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw, N m s/rad")

    @model_validator(mode="after")
    def _one(self) -> "Drag":
        if (self.time_constant is None) == (self.linear is None):
            raise ValueError("give either time_constant or linear")
        if self.linear is not None and min(self.linear) <= 0.0:
            raise ValueError("linear drag must be positive along each axis")
        return self


class Hydrostatics(Section):
    """Restoring of a floating vehicle about its waterline, which is z = 0 of its frame."""

    heave: Annotated[float, Field(gt=0)] = Field(description="N/m")
    roll: Annotated[float, Field(gt=0)] = Field(description="N m/rad")
    pitch: Annotated[float, Field(gt=0)] = Field(description="N m/rad")


class AttitudeHold(Section):
    """Level attitude and initial heading, held by the thrusters as a second-order system."""

    frequency: Annotated[float, Field(gt=0)] = Field(description="natural frequency, rad/s")
    damping: Annotated[float, Field(gt=0)] = Field(1.0, description="damping ratio")


class VehicleDescription(Section):
    """What stands in models/NAME.yaml."""

    summary: str
    mjcf: str = Field(description="MJCF file, beside this one")
    domain: Literal["surface", "volume"] = Field(description="surface: controlled in the plane; volume: in space")
    drag: Drag
    attitude: AttitudeHold
    hydrostatics: Hydrostatics | None = Field(None, description="of a vehicle that floats")

    @model_validator(mode="after")
    def _floats(self) -> "VehicleDescription":
        if (self.domain == "surface") != (self.hydrostatics is not None):
            raise ValueError("a surface vehicle needs hydrostatics, and no other has them")
        return self


@dataclass(frozen=True)
class Vehicle:
    """A vehicle, ready to be controlled.

    Attributes:
        name: of its description.
        description: the description.
        path: its MJCF file.
        mass: kg.
        weight: what thrusters or water must carry, N: m g less what the MJCF compensates (gravcomp).
        centre_of_mass: in the body frame, shape (3,), m.
        inertia: about the origin of the body frame, body axes, shape (3, 3), kg m^2.
        inertials: MJCF attributes of the inertia of each body in the file, depth first, as compiled.
        thrusters: names of the actuators; thruster_K where number K, from 0, has none.
        actuation: MJCF attributes of each thruster's actuator: gain, limits and lag, defaults included.
        W: wrench of each thruster for a command of 1, shape (6, s), N and N m.
        drag: linear drag D along the body axes, shape (3,), N s/m.
    """

    name: str
    description: VehicleDescription
    path: Path
    mass: float
    weight: float
    centre_of_mass: Array
    inertia: Array
    inertials: list[dict[str, Any]]
    thrusters: list[str]
    actuation: list[dict[str, Any]]
    W: Array
    drag: Array

    @property
    def dimension(self) -> int:
        """Dimension of the controlled position: 2 on the surface, 3 in a volume."""
        return 2 if self.description.domain == "surface" else 3

    @property
    def controlled_rows(self) -> list[int]:
        """Rows of the wrench that thrusters must produce: surge, sway and yaw on the surface, all in a volume."""
        return _SURFACE_ROWS if self.dimension == 2 else _ALL_ROWS

    @cached_property
    def allocation(self) -> Array:
        """W^+ on the controlled rows, zero on the others, shape (s, 6): commands that make a wanted wrench.

        The moment rows belong to it: the pseudo-inverse of the force rows alone would spin a free body.
        """
        P = np.zeros((self.W.shape[1], 6))
        P[:, self.controlled_rows] = np.linalg.pinv(self.W[self.controlled_rows])
        return P

    def control_effectiveness(self, R: Array) -> Array:
        """g = C (R D R^T)^-1 R W_f of the reduced model q' = w + g u, shape (n, s), m/s for each unit of command.

        Args:
            R: attitude, body to world, shape (3, 3).
        """
        return (R @ (self.W[:3] / self.drag[:, None]))[: self.dimension]

    def inverse_effectiveness(self, R: Array) -> Array:
        """g^+, the right inverse of g that makes no moment on the body, shape (s, n)."""
        return (self.allocation[:, :3] @ (self.drag[:, None] * R.T))[:, : self.dimension]

    def with_time_constant(self, tau: float | None) -> "Vehicle":
        """The same vehicle with isotropic drag m / tau; None leaves the drag as it is."""
        return self if tau is None else replace(self, drag=np.full(3, self.mass / tau))


def list_vehicles() -> dict[str, Path]:
    """The vehicles that come with mjsheaf: name to description file."""
    return {path.stem: path for path in sorted(resource_directory("models").glob("*.yaml"))}


def load_vehicle(source: str, directory: Path | None = None) -> Vehicle:
    """Load a vehicle.

    Args:
        source: a name in models/, or the path of a description file.
        directory: what a relative path is relative to; None takes the working directory.

    Raises:
        InputError: no such vehicle, or its files are not valid; the message names the file.
    """
    known = list_vehicles()
    path = known.get(source) or (directory or Path()) / source
    if source not in known and path.suffix not in (".yaml", ".yml"):
        raise InputError(f"no vehicle {source!r}; legal are {', '.join(known)}, or the path of a description file")
    try:
        description = VehicleDescription.model_validate(read_yaml(path))
    except ValidationError as error:
        raise InputError(f"{path}: {describe_validation_error(error, VehicleDescription)}") from None
    mjcf = path.parent / description.mjcf
    return _from_model(path.stem, description, mjcf, _compile(mjcf))


def _compile(path: Path) -> mujoco.MjModel:
    """Compile a vehicle's file alone."""
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = False  # would make all of it part of the world, which has no mass
        model = spec.compile()
    except ValueError as error:
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
    if not np.isin(model.actuator_dyntype, list(_LAGS)).all():
        raise InputError(f"{path}: every actuator's dyntype must be one of {', '.join(_LAGS.values())}")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    site = model.actuator_trnid[:, 0]
    axes = data.site_xmat[site].reshape(-1, 3, 3)
    force = np.einsum("kij,kj->ki", axes, model.actuator_gear[:, :3])
    moment = np.cross(data.site_xpos[site], force) + np.einsum("kij,kj->ki", axes, model.actuator_gear[:, 3:])
    W = (np.hstack([force, moment]) * model.actuator_gainprm[:, :1]).T

    if not model.body_mass.sum() > 0.0:
        raise InputError(f"{path}: its mass is 0 kg; legal is a positive one")
    mass, centre, inertia = mass_properties(model, data, slice(None))
    carried = float((model.body_mass * model.body_gravcomp).sum())
    drag = description.drag
    linear = np.full(3, mass / drag.time_constant) if drag.time_constant else np.array(drag.linear, dtype=np.float64)
    vehicle = Vehicle(
        name=name,
        description=description,
        path=path,
        mass=mass,
        weight=(mass - carried) * GRAVITY,
        centre_of_mass=centre,
        inertia=inertia,
        inertials=[_inertial(model, b) for b in range(1, model.nbody)],
        thrusters=_thruster_names(model),
        actuation=[_actuation(model, k) for k in range(model.nu)],
        W=W,
        drag=linear,
    )
    rows = vehicle.controlled_rows
    if np.linalg.matrix_rank(W[rows]) < len(rows):
        left = np.linalg.svd(W[rows])[0][:, -1]
        lacking = _ROW_NAMES[rows[int(np.argmax(np.abs(left)))]]
        raise InputError(
            f"{path}: the thrusters cannot produce every wanted wrench; lacking is {lacking} (Assumption 2)"
        )
    return vehicle


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
        "pos": model.body_ipos[b],
        "quat": model.body_iquat[b],
        "mass": model.body_mass[b],
        "diaginertia": model.body_inertia[b],
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
    """What PyMJCF must be told of actuator k beside where it acts, read from the compiled file.

    The file's own elements would not do: most of it may stand in their default class.
    """
    attributes: dict[str, Any] = {
        "dyntype": _LAGS[int(model.actuator_dyntype[k])],
        "dynprm": model.actuator_dynprm[k],
        "gainprm": model.actuator_gainprm[k],
        "actearly": "true" if model.actuator_actearly[k] else "false",
    }
    for name in ("ctrl", "force", "act"):
        limited = bool(getattr(model, f"actuator_{name}limited")[k])
        attributes[f"{name}limited"] = "true" if limited else "false"
        if limited:
            attributes[f"{name}range"] = getattr(model, f"actuator_{name}range")[k]
    return attributes
