"""The step of a rigid body on a free joint, as MuJoCo takes it: see `fused`."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjsheaf.jit import as_records, inline_jit
from mjsheaf.loop.loop import HUGE
from mjsheaf.vehicles.vectors import cross, product, rotation, row_product, subtract, to_world, triple, upward
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
    """Return the linear acceleration in world axes and the angular one in body axes, (3,) each."""
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
def at(field, i):
    """Return a vector in lane i of a field of a block."""
    return field[0, i], field[1, i], field[2, i]


@inline_jit
def put(field, i, a):
    """Write a vector to lane i of a field of a block."""
    field[0, i] = a[0]
    field[1, i] = a[1]
    field[2, i] = a[2]


@inline_jit
def attitude(b, i):
    """Return the rotation of the vehicle in lane i of a block, body to world."""
    q = b.quaternion
    return rotation(q[0, i], q[1, i], q[2, i], q[3, i])


@inline_jit
def move(one, h, b, i):
    """Take MuJoCo's step in a lane of a block, except for the turn, and write whether its state is good.

    Args:
        one: MOTION of the vehicle; the force and moment in the block are in addition to its weight.
        h: Timestep, s.
        b, i: Block and lane of the vehicle; see `block`.
    """
    along, about = accelerations(one, attitude(b, i), at(b.rates, i), at(b.force, i), at(b.moment, i))
    sound = True
    for j in range(3):
        b.velocity[j, i] += h * along[j]
        b.rates[j, i] += h * about[j]
        b.position[j, i] += h * b.velocity[j, i]
        sound &= (abs(along[j]) < HUGE) & (abs(about[j]) < HUGE) & (abs(b.position[j, i]) < HUGE)
        sound &= (abs(b.velocity[j, i]) < HUGE) & (abs(b.rates[j, i]) < HUGE)
    b.sound[i] = 1.0 if sound else 0.0


@inline_jit
def turn(h, lanes, b):
    """Make the quaternions in the lanes of a block one again, and turn them by the rates over a step of h, s."""
    large = 0.0
    for i in range(lanes):
        x, y, z = _half_turn(h, b, i)
        square, norm = x * x + y * y + z * z, _square_norm(b, i)
        b.parts[0, i], b.parts[1, i] = series(square)
        b.size[i] = 1.5 - 0.5 * norm
        b.large[i] = 0.0 if (square < SMALL) & (abs(norm - 1.0) < NEARLY_UNIT) else 1.0
    for i in range(lanes):
        large += b.large[i]
    if large > 0.0:
        for i in range(lanes):
            x, y, z = _half_turn(h, b, i)
            square, norm = x * x + y * y + z * z, _square_norm(b, i)
            if not square < SMALL:
                half = np.sqrt(square)
                b.parts[0, i] = np.cos(half)
                b.parts[1, i] = np.sin(half) / half
            if not abs(norm - 1.0) < NEARLY_UNIT:
                b.size[i] = 1.0 / np.sqrt(norm)
    for i in range(lanes):
        (x, y, z), s, q = _half_turn(h, b, i), b.parts[1, i], b.quaternion
        after = turned((q[0, i], q[1, i], q[2, i], q[3, i]), b.size[i], b.parts[0, i], (s * x, s * y, s * z))
        for j in range(4):
            q[j, i] = after[j]


@inline_jit
def _half_turn(h, b, i):
    return 0.5 * h * b.rates[0, i], 0.5 * h * b.rates[1, i], 0.5 * h * b.rates[2, i]


@inline_jit
def _square_norm(b, i):
    q = b.quaternion
    return q[0, i] * q[0, i] + q[1, i] * q[1, i] + q[2, i] * q[2, i] + q[3, i] * q[3, i]


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
