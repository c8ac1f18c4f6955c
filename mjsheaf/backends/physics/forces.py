"""Forces on every vehicle at one instant: the medium's, and the thrusters'.

For a vehicle with attitude R, velocity v, drag D (body axes) in a medium that moves at w, commanded velocity v_c:

    medium    R D R^T (w - v) + hydrostatics          applied forces, qfrc_applied; -d_max v implicitly, by the joint
    thrust    u = W^+ [D R^T v_c; attitude moment] + trim     commands, data.ctrl
    gear      R d_k of each thruster k                 its direction in world axes, model.actuator_gear

so that m v' = R D R^T (v_c + w - v), and q' = w + g u once m / D is small. Nothing here knows the law that gives v_c.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics.arena import Arena
from mjsheaf.backends.system import medium_velocity
from mjsheaf.compiled import kernel

Array = NDArray[np.float64]


class BodyArrays(NamedTuple):
    """What the loop knows of the vehicles.

    qpos, dof (V,), thruster (V + 1,): addresses; direction (A, 3): thrust axis of each thruster in body axes, as
    gear; allocation (A, 6): W^+; drag (V, 3) and largest drag (V,), N s/m; inertia (V, 3, 3), kg m^2; stiffness and
    damping (V,) of the attitude hold, 1/s^2 and 1/s; heading (V,) to hold, rad; lift (V,): weight that thrusters
    carry, N; arm (V, 3): centre of mass, m; buoyancy (V,): weight that the water carries, N; restoring (V, 3): heave,
    roll, pitch; level (V,): height of the water, m.
    """

    qpos: NDArray[np.int64]
    dof: NDArray[np.int64]
    thruster: NDArray[np.int64]
    direction: Array
    allocation: Array
    drag: Array
    largest_drag: Array
    inertia: Array
    stiffness: Array
    damping: Array
    heading: Array
    lift: Array
    arm: Array
    buoyancy: Array
    restoring: Array
    level: Array


def pack_bodies(arena: Arena, heading: Array, level: float) -> BodyArrays:
    """Pack an arena's vehicles; headings (V,) in rad are held, `level` is the height of the water in m."""
    vehicles = arena.vehicles
    floats = [v.description.hydrostatics for v in vehicles]
    frequency = np.array([v.description.attitude.frequency for v in vehicles])
    ratio = np.array([v.description.attitude.damping for v in vehicles])
    weight = np.array([v.weight for v in vehicles])
    afloat = np.array([h is not None for h in floats])
    return BodyArrays(
        qpos=arena.qpos,
        dof=arena.dof,
        thruster=arena.thruster,
        direction=arena.model.actuator_gear[:, :3].copy(),
        allocation=np.vstack([v.allocation for v in vehicles]),
        drag=np.array([v.drag for v in vehicles]),
        largest_drag=np.array([v.drag.max() for v in vehicles]),
        inertia=np.array([v.inertia for v in vehicles]),
        stiffness=frequency**2,
        damping=2.0 * ratio * frequency,
        heading=np.array(heading, dtype=np.float64),
        lift=np.where(afloat, 0.0, weight),
        arm=np.array([v.centre_of_mass for v in vehicles]),
        buoyancy=np.where(afloat, weight, 0.0),
        restoring=np.array([[h.heave, h.roll, h.pitch] if h is not None else [0.0] * 3 for h in floats]),
        level=np.full(len(vehicles), level),
    )


@kernel
def rotation(q, at, R):
    """Write the rotation of the unit quaternion q[at : at + 4] (w, x, y, z), body to world, into R (3, 3)."""
    w, x, y, z = q[at], q[at + 1], q[at + 2], q[at + 3]
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@kernel
def apply_forces(bodies, medium, t, command, qpos, qvel, ctrl, gear, applied, R, wrench):
    """Write thruster commands, gears and applied forces for the state at time t.

    Args:
        bodies, medium: see BodyArrays and MediumArrays.
        t: s.
        command: commanded velocity of each vehicle relative to the medium, shape (V, 3), m/s.
        qpos, qvel: MuJoCo's state.
        ctrl, gear, applied: MuJoCo's arrays that are written: data.ctrl, model.actuator_gear, data.qfrc_applied.
        R, wrench: scratch, shapes (3, 3) and (6,).
    """
    for v in range(command.shape[0]):
        a, d = bodies.qpos[v], bodies.dof[v]
        rotation(qpos, a + 3, R)
        planar = medium.planar[v]
        z = 0.0 if planar else qpos[a + 2]
        wx, wy, wz = medium_velocity(medium, v, t, qpos[a], qpos[a + 1], z)

        # Medium: R D R^T w, and what R D R^T v differs from the implicit damping d_max v.
        largest = bodies.largest_drag[v]
        for i in range(3):
            along_w = R[0, i] * wx + R[1, i] * wy + R[2, i] * wz
            along_v = R[0, i] * qvel[d] + R[1, i] * qvel[d + 1] + R[2, i] * qvel[d + 2]
            wrench[i] = bodies.drag[v, i] * along_w + (largest - bodies.drag[v, i]) * along_v
        for i in range(3):
            applied[d + i] = R[i, 0] * wrench[0] + R[i, 1] * wrench[1] + R[i, 2] * wrench[2]
            applied[d + 3 + i] = 0.0
        if bodies.buoyancy[v] > 0.0:
            # Water carries the weight through the centre of mass and rights the hull: moment K (b_z x e_z), body axes.
            applied[d + 2] += bodies.buoyancy[v] - bodies.restoring[v, 0] * (qpos[a + 2] - bodies.level[v])
            bx, by, bz = (
                R[2, 0] * bodies.buoyancy[v],
                R[2, 1] * bodies.buoyancy[v],
                R[2, 2] * bodies.buoyancy[v],
            )
            cx, cy, cz = bodies.arm[v, 0], bodies.arm[v, 1], bodies.arm[v, 2]
            applied[d + 3] += cy * bz - cz * by - bodies.restoring[v, 1] * R[2, 1]
            applied[d + 4] += cz * bx - cx * bz + bodies.restoring[v, 2] * R[2, 0]
            applied[d + 5] += cx * by - cy * bx

        # Thrust: the force that the law wants, in body axes, with the weight that thrusters carry.
        for i in range(3):
            wanted = R[0, i] * command[v, 0] + R[1, i] * command[v, 1] + R[2, i] * command[v, 2]
            wrench[i] = bodies.drag[v, i] * wanted
        fx, fy, fz = R[2, 0] * bodies.lift[v], R[2, 1] * bodies.lift[v], R[2, 2] * bodies.lift[v]

        # Attitude: the rotation vector from R to the level attitude with the heading to hold, in body axes.
        c, s = np.cos(bodies.heading[v]), np.sin(bodies.heading[v])
        # E = R^T R_z(heading); its skew part is sin(angle) times the axis, its trace gives the angle.
        e00, e10, e20 = R[0, 0] * c + R[1, 0] * s, R[0, 1] * c + R[1, 1] * s, R[0, 2] * c + R[1, 2] * s
        e01, e11, e21 = R[1, 0] * c - R[0, 0] * s, R[1, 1] * c - R[0, 1] * s, R[1, 2] * c - R[0, 2] * s
        e02, e12, e22 = R[2, 0], R[2, 1], R[2, 2]
        ax, ay, az = 0.5 * (e21 - e12), 0.5 * (e02 - e20), 0.5 * (e10 - e01)
        sine = np.sqrt(ax * ax + ay * ay + az * az)
        angle = np.arctan2(sine, 0.5 * (e00 + e11 + e22 - 1.0))
        scale = angle / sine if sine > 1e-12 else 1.0
        k, b = bodies.stiffness[v], bodies.damping[v]
        ax = k * scale * ax - b * qvel[d + 3]
        ay = k * scale * ay - b * qvel[d + 4]
        az = k * scale * az - b * qvel[d + 5]
        J = bodies.inertia[v]
        wrench[3] = J[0, 0] * ax + J[0, 1] * ay + J[0, 2] * az + bodies.arm[v, 1] * fz - bodies.arm[v, 2] * fy
        wrench[4] = J[1, 0] * ax + J[1, 1] * ay + J[1, 2] * az + bodies.arm[v, 2] * fx - bodies.arm[v, 0] * fz
        wrench[5] = J[2, 0] * ax + J[2, 1] * ay + J[2, 2] * az + bodies.arm[v, 0] * fy - bodies.arm[v, 1] * fx
        wrench[0] += fx
        wrench[1] += fy
        wrench[2] += fz

        for k in range(bodies.thruster[v], bodies.thruster[v + 1]):
            u = 0.0
            for i in range(6):
                u += bodies.allocation[k, i] * wrench[i]
            ctrl[k] = u
            for i in range(3):
                gear[k, i] = (
                    R[i, 0] * bodies.direction[k, 0]
                    + R[i, 1] * bodies.direction[k, 1]
                    + R[i, 2] * bodies.direction[k, 2]
                )
