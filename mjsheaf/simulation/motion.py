"""The step of a rigid body on a free joint, as MuJoCo takes it: see `fused`."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjsheaf.jit import as_records, inline_jit
from mjsheaf.simulation.loop import HUGE
from mjsheaf.vehicles.vectors import cross, product, row_product, subtract, to_world, triple, upward
from mjsheaf.vehicles.vehicle import Vehicle

# How a kind moves; body axes, about the origin of the body frame.
MOTION = np.dtype(
    [
        ("inverse", "f8", (6, 6)),  # of the matrix in `fused`
        ("inertia", "f8", (3, 3)),  # J, kg m^2
        ("damping", "f8", 3),  # D, N m s/rad
        ("weight", "f8"),  # N
        ("weight_moment", "f8", 3),  # of the weight, upright, N m
        ("mass_moment", "f8", 3),  # m c, kg m
    ],
    align=True,
)

SMALL = 0.01
"""Square of half a turn, rad^2, up to which its sine and cosine are short series."""

NEARLY_UNIT = 1e-8
"""Distance from 1 of a quaternion's square up to which one step of Newton's method makes it 1."""


def pack_motion(vehicles: Sequence[Vehicle], timestep: float) -> NDArray[np.void]:
    """Return a MOTION for each kind of vehicle, for steps of `timestep`, s."""
    motion = np.zeros(len(vehicles), MOTION)
    for one, vehicle in zip(motion, vehicles, strict=True):
        taken = vehicle.joint_damping
        one["inverse"] = np.linalg.inv(vehicle.rigid_mass + timestep * np.diag(taken))
        one["inertia"], one["damping"] = vehicle.inertia, taken[3:]
        one["weight"], one["weight_moment"] = vehicle.weight - vehicle.ballast, vehicle.weight_moment
        one["mass_moment"] = vehicle.mass * vehicle.centre_of_mass
    return as_records(motion)


@inline_jit
def accelerations(one, R, omega, force, moment):
    """Return the linear acceleration in world axes and the angular one in body axes, (3,) each; arguments as `move`."""
    up, lever = upward(R, 1.0), triple(one.mass_moment)
    force = subtract(force, upward(R, one.weight))
    force = subtract(force, cross(omega, cross(omega, lever)))
    moment = subtract(moment, cross(triple(one.weight_moment), up))
    moment = subtract(moment, cross(omega, product(one.inertia, omega)))
    D, inverse = one.damping, one.inverse
    moment = moment[0] - D[0] * omega[0], moment[1] - D[1] * omega[1], moment[2] - D[2] * omega[2]
    x = row_product(inverse[0], force, moment)
    y = row_product(inverse[1], force, moment)
    z = row_product(inverse[2], force, moment)
    along = to_world(R, (x, y, z))
    about = (
        row_product(inverse[3], force, moment),
        row_product(inverse[4], force, moment),
        row_product(inverse[5], force, moment),
    )
    return along, about


@inline_jit
def move(one, body, R, omega, force, moment, h, qpos, qvel):
    """Take MuJoCo's step under a force and a moment in addition to the weight; return True if the state is good.

    Args:
        one: Its MOTION.
        body: Its BODY.
        R, omega: Attitude (9,) and rates (3,).
        force, moment: Force and moment in body axes about the origin, (3,) each, N and N m.
        h: Timestep, s.
        qpos, qvel: State of all vehicles; the body's own is written.
    """
    a, d = body.qpos, body.dof
    along, about = accelerations(one, R, omega, force, moment)
    good = True
    for i in range(3):
        qvel[d + i] += h * along[i]
        qvel[d + 3 + i] += h * about[i]
        qpos[a + i] += h * qvel[d + i]
        good &= (abs(along[i]) < HUGE) & (abs(about[i]) < HUGE) & (abs(qpos[a + i]) < HUGE)
        good &= (abs(qvel[d + i]) < HUGE) & (abs(qvel[d + 3 + i]) < HUGE)
    turn(qpos[a + 3 : a + 7], 0.5 * h * qvel[d + 3], 0.5 * h * qvel[d + 4], 0.5 * h * qvel[d + 5])
    return good


@inline_jit
def turn(q, x, y, z):
    """Make a quaternion q (4,) one again and turn it by twice the body's rotation vector (x, y, z), rad."""
    square = x * x + y * y + z * z
    if square < SMALL:
        c, s = series(square)
    else:
        half = np.sqrt(square)
        c, s = np.cos(half), np.sin(half) / half
    square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    size = 1.5 - 0.5 * square if abs(square - 1.0) < NEARLY_UNIT else 1.0 / np.sqrt(square)
    q[0], q[1], q[2], q[3] = turned((q[0], q[1], q[2], q[3]), size, c, (s * x, s * y, s * z))


@inline_jit
def series(square):
    """Return the cosine of an angle and its sine over the angle, from the square of the angle, rad^2, below SMALL."""
    c = 1.0 + square * (-1.0 / 2.0 + square * (1.0 / 24.0 + square * (-1.0 / 720.0 + square / 40320.0)))
    s = 1.0 + square * (-1.0 / 6.0 + square * (1.0 / 120.0 + square * (-1.0 / 5040.0 + square / 362880.0)))
    return c, s


@inline_jit
def turned(q, size, c, v):
    """Return the quaternion q (4,) times a size, times the unit quaternion with parts c and v (3,)."""
    a, b, e, f = size * q[0], size * q[1], size * q[2], size * q[3]
    x, y, z = v
    return (
        a * c - b * x - e * y - f * z,
        a * x + b * c + e * z - f * y,
        a * y - b * z + e * c + f * x,
        a * z + b * y - e * x + f * c,
    )
