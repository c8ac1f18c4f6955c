"""The arena: every vehicle's MJCF composed into one model, each on a free joint.

MjSpec attaches the files, and compiles each with its own settings. What belongs to the arena alone is taken out first.

Thrusters become actuators on their vehicle's free joint. MuJoCo's site transmission builds a dense Jacobian for each
actuator, which makes a step quadratic in the number of vehicles; on the free joint the gear is the thruster's wrench
itself, force in world axes and moment in body axes, and the forces are the same. As the force part turns with the
body, it is written before every step (see `bodies`).

Obstacles are geoms, which vehicles touch where contacts are on. One at rest belongs to the world. One that moves is a
mocap body: the loop puts it where its motion has it before every step, and contacts push vehicles only. To MuJoCo a
mocap body has no velocity, so that it exerts no drag by friction. The geoms are in the group of collision shapes, which
pictures leave out: they draw obstacles themselves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjsheaf.arrays import Array, IntArray
from mjsheaf.compile.jit import inline_jit
from mjsheaf.errors import InputError
from mjsheaf.files import resource_directory
from mjsheaf.law.obstacles import BOX, CAPSULE, HALF_SPACE, SPHERE, ObstacleArrays, centres
from mjsheaf.law.paths import position_at
from mjsheaf.mujoco_import import mujoco, refusing
from mjsheaf.vehicles.loading import is_at_origin, mass_properties, read_spec
from mjsheaf.vehicles.vehicle import GRAVITY, Vehicle


def attachable(vehicle: Vehicle) -> mujoco.MjSpec:
    """Read a vehicle's file, fit to be attached.

    Every body has the inertia that `vehicle` has for it, whatever geoms and compiler settings would make of it. Gone
    are actuators, which are made anew.

    Raises:
        InputError: the file has changed since the vehicle was loaded.
    """
    spec, _ = read_spec(vehicle.path)
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    settings = spec.compiler  # all of these are in the inertias already
    settings.inertiafromgeom, settings.settotalmass, settings.balanceinertia = 2, -1.0, False
    settings.boundmass = settings.boundinertia = 0.0
    bodies = spec.bodies[1:]  # in MuJoCo's order: depth first
    if len(bodies) != len(vehicle.inertials):
        raise InputError(f"{vehicle.path}: has {len(bodies)} bodies, but {len(vehicle.inertials)} when it was loaded")
    for body, inertial in zip(bodies, vehicle.inertials, strict=True):
        body.explicitinertial, body.mass, body.inertia = True, inertial.mass, inertial.diagonal
        body.ipos, body.iquat = inertial.position, inertial.quaternion
        body.ialt.type, body.fullinertia = mujoco.mjtOrientation.mjORIENTATION_QUAT, np.full(6, np.nan)
    return spec


PREFIX = "obstacle/"
"""Beginning of the names of these bodies and geoms; the id of the obstacle follows."""

_SHAPES = mujoco.mjtGeom
_TYPES = {SPHERE: _SHAPES.mjGEOM_SPHERE, CAPSULE: _SHAPES.mjGEOM_CAPSULE, BOX: _SHAPES.mjGEOM_BOX,
          HALF_SPACE: _SHAPES.mjGEOM_PLANE}  # fmt: skip

_ARENA_BYTES = 2**16
"""Arena memory for a vehicle without contacts, which uses about 500. MuJoCo's default is 150 GB for ten thousand."""

_NO_COLOUR = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)  # MuJoCo's default: the material's colour counts


@dataclass(frozen=True)
class Arena:
    """A compiled model and where each vehicle is in it.

    Attributes:
        model: MuJoCo's model.
        vehicles: what each vehicle is, length V.
        qpos: address of each vehicle's free joint in qpos, shape (V,).
        dof: the same in qvel.
        body: the body on the free joint, shape (V,): the vehicle's own if it has but one, else one made to hold all.
        thruster: first actuator of each vehicle, then the number of actuators, shape (V + 1,).
    """

    model: mujoco.MjModel
    vehicles: list[Vehicle]
    qpos: IntArray
    dof: IntArray
    body: IntArray
    thruster: IntArray


def compose(
    vehicles: Sequence[Vehicle],
    ids: Sequence[str],
    *,
    timestep: float = 0.001,
    contacts: bool = False,
    surface: str = "none",
    surface_height: float = 0.0,
    colours: Array | None = None,
    visible: bool = True,
    obstacles: Mapping[str, Any] | None = None,
) -> Arena:
    """Put vehicles into one arena.

    Args:
        vehicles: Models of the vehicles.
        ids: Unique names of the vehicles.
        timestep: Physics step, s.
        contacts: True if vehicles collide with one another.
        surface: Surface of the scene: water, ground or none.
        surface_height: Height z of the surface, m.
        colours: RGB of each vehicle's livery, shape (V, 3), or None.
        visible: False omits purely visual geoms, which have no mass and no contacts. The physics is the same bit for
            bit; a step is about a sixth faster.
        obstacles: Arguments of `add_obstacles`, by name; None without any.

    Raises:
        InputError: A vehicle's file cannot be combined with the others in one model, or would change its meaning there.
    """
    scene = str(resource_directory("models") / "arena.xml")
    with refusing(scene):
        root = mujoco.MjSpec.from_file(scene)
    root.option.timestep = timestep
    root.option.gravity = [0.0, 0.0, -GRAVITY]
    if not contacts:
        root.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        root.memory = _ARENA_BYTES * (100 + len(vehicles))
    if surface != "none":
        root.worldbody.add_geom(
            name=surface, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, surface_height],
            material=surface, contype=0, conaffinity=0,
        )  # fmt: skip
    if obstacles is not None:
        add_obstacles(root, **obstacles)
    _attach_all(root, vehicles, ids, colours, visible)
    with refusing("the vehicles do not compile into one model"):
        model = root.compile()
    joint = np.array([model.joint(f"{name}/").id for name in ids])
    arena = Arena(
        model=model,
        vehicles=list(vehicles),
        qpos=model.jnt_qposadr[joint].astype(np.int64),
        dof=model.jnt_dofadr[joint].astype(np.int64),
        body=model.jnt_bodyid[joint].astype(np.int64),
        thruster=np.concatenate([[0], np.cumsum([len(v.channels) for v in vehicles])]).astype(np.int64),
    )
    for v, vehicle in enumerate(vehicles):
        model.dof_damping[arena.dof[v] : arena.dof[v] + 6] = vehicle.joint_damping
    _check_masses(arena)
    return arena


def _attach_all(
    root: mujoco.MjSpec, vehicles: Sequence[Vehicle], ids: Sequence[str], colours: Array | None, visible: bool
) -> None:
    """Attach vehicles to an arena; arguments as of `compose`."""
    kinds = {key: _prepared(v, visible) for key, v in {id(vehicle): vehicle for vehicle in vehicles}.items()}
    for spec, _, _ in kinds.values():
        root.assets = {**root.assets, **spec.assets}
    # Attaching looks at all that is there already: in groups of sqrt(V), a thousand take one second, not ten.
    size = int(np.ceil(np.sqrt(len(vehicles))))
    first_of_kind: dict[int, str] = {}
    for first in range(0, len(vehicles), size):
        group = mujoco.MjSpec()
        group.copy_during_attach = True
        looks: dict[str, tuple[str, Array | None]] = {}
        for v in range(first, min(first + size, len(vehicles))):
            key, name = id(vehicles[v]), ids[v]
            owner = first_of_kind.setdefault(key, name)
            looks[name] = owner, None if colours is None else colours[v]
            whole, bare, alone = kinds[key]
            _attach(group, whole if owner == name else bare, alone, vehicles[v], name)
        _paint(group, looks)
        with refusing("the vehicles do not fit into one model"):
            root.attach(group, prefix="", frame=root.worldbody.add_frame())


def _prepared(vehicle: Vehicle, visible: bool) -> tuple[mujoco.MjSpec, mujoco.MjSpec, bool]:
    """Return a vehicle's specification for attachment, a bare copy, and True if it is a single body.

    The bare copy has no materials and textures. The first vehicle of a kind shares its own with the others, because
    MuJoCo cannot draw a model with a thousand of them. A single body at the origin, level and without siblings, can be
    placed on the free joint directly. A step is then a quarter faster than with an extra body that contains the file's
    content. If the model is not visible, purely visual geoms are omitted.
    """
    spec = attachable(vehicle)
    world = spec.worldbody
    alone = len(world.bodies) == 1 and is_at_origin(world.bodies[0])
    alone = alone and not (world.geoms or world.sites or world.cameras or world.lights)
    only_seen = [geom for geom in spec.geoms if geom.contype == 0 and geom.conaffinity == 0]
    for geom in [] if visible else only_seen:  # their mass, if any, is in the bodies' inertia already
        spec.delete(geom)
    bare = spec.copy()
    for asset in [*bare.materials, *bare.textures]:
        bare.delete(asset)
    return spec, bare, alone


def _paint(group: mujoco.MjSpec, looks: dict[str, tuple[str, Array | None]]) -> None:
    """Give every vehicle in a group the materials of another, and the RGB (3,) of its livery unless None.

    The colour stands in the geoms: there it overrides that of their material and keeps its shine.
    """
    for element in (*group.geoms, *group.sites, *group.tendons, *group.skins):
        if not element.material:
            continue
        name, material = element.material.split("/", 1)
        owner, colour = looks[name]
        element.material = f"{owner}/{material}"
        if material == "livery" and colour is not None and np.array_equal(element.rgba, _NO_COLOUR):
            element.rgba = [*colour, 1.0]


def _attach(root: mujoco.MjSpec, spec: mujoco.MjSpec, alone: bool, vehicle: Vehicle, name: str) -> None:
    with refusing(f"{vehicle.path}: cannot be put into the arena"):
        if alone:  # the whole of a kind would bring a copy of its default classes too, at ten times the cost
            body = root.worldbody.add_frame().attach_body(spec.worldbody.bodies[0], f"{name}/", "")
        else:
            body = root.worldbody.add_body(name=f"{name}/")
            root.attach(spec, prefix=f"{name}/", frame=body.add_frame())
    body.add_freejoint(name=f"{name}/")
    for actuator, gears in zip(vehicle.actuators, vehicle.by_actuator(vehicle.gears), strict=True):
        for channel in actuator.to_mujoco(gears):
            own = {"name": f"{name}/{channel['name']}", "target": f"{name}/", "trntype": mujoco.mjtTrn.mjTRN_JOINT}
            root.add_actuator(**channel | own)


def _check_masses(arena: Arena) -> None:
    """Compare every vehicle in the arena with its file compiled alone: the allocation stands on the latter.

    Raises:
        InputError: mass, centre of mass or inertia differ.
    """
    data = mujoco.MjData(arena.model)
    mujoco.mj_kinematics(arena.model, data)  # every frame at the origin, level
    ends = [*arena.body[1:], arena.model.nbody]
    for vehicle, first, end in zip(arena.vehicles, arena.body, ends, strict=True):
        mass, centre, inertia = mass_properties(arena.model, data, slice(first, end))
        size = np.sqrt(np.trace(vehicle.inertia) / vehicle.mass)
        for what, here, alone, scale in (
            ("mass", mass, vehicle.mass, vehicle.mass),
            ("centre of mass", centre, vehicle.centre_of_mass, size),
            ("inertia", inertia, vehicle.inertia, vehicle.mass * size**2),
        ):
            if not np.allclose(here, alone, rtol=0.0, atol=1e-9 * scale):
                values = f"{what} is {here} in the arena, but {alone} when compiled alone"
                raise InputError(f"{vehicle.path}: its {' '.join(values.split())}")


def add_obstacles(
    root: mujoco.MjSpec, obstacles: ObstacleArrays, ids: Sequence[str], time: float, *, group: int = 3
) -> None:
    """Add obstacles of these ids to an arena, where they are at a time in s, in the group of collision shapes."""
    for n, (id, centre) in enumerate(zip(ids, centres(obstacles, time), strict=True)):
        kind, (x, y, z), size = int(obstacles.kind[n]), obstacles.axes[n], obstacles.size[n]
        columns = (y, z, x) if kind in (CAPSULE, HALF_SPACE) else (x, y, z)  # theirs is the z axis
        extent = {
            SPHERE: [size[0], 0.0, 0.0],
            CAPSULE: [size[1], size[0], 0.0],
            BOX: size,
            HALF_SPACE: [0.0, 0.0, 1.0],
        }[kind]
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.column_stack(columns).ravel())
        body = root.worldbody.add_body(
            name=f"{PREFIX}{id}", pos=centre, quat=quaternion, mocap=bool(obstacles.speed[n] > 0.0)
        )
        body.add_geom(name=f"{PREFIX}{id}", type=_TYPES[kind], size=extent, group=group, rgba=[0.78, 0.55, 0.38, 1.0])


def movers_of(obstacles: ObstacleArrays | None) -> tuple[Any, ...]:
    """Return numbers and motion of the obstacles that are mocap bodies, in order; () without any."""
    if obstacles is None or not (obstacles.speed > 0.0).any():
        return ()
    return np.flatnonzero(obstacles.speed > 0.0), obstacles.motion


@inline_jit
def place_obstacles(movers, t, places):
    """Write where obstacles are at time t, s, into mocap_pos (M, 3), m; nothing if `movers` is ()."""
    if len(movers) == 0:
        return
    for m in range(places.shape[0]):
        x, y, z = position_at(movers[1], movers[0][m], t)
        places[m, 0] = x
        places[m, 1] = y
        places[m, 2] = z
