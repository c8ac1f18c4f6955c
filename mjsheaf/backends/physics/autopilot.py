"""The vehicle's onboard computer: from the velocity that the law wants to thruster commands within their limits.

It knows its vehicle, its attitude, and what it measures: velocity through the medium v_r and rates omega. It is not
handed the medium. With the commanded velocity v_c relative to the medium, in body axes, and d the vehicle's drag law:

    force      F = d(v_c) + M k_v (v_c - v_r), so that q' = w + v_c is left, with time constant M / (M k_v + D)
    attitude   J (k theta - b omega), theta twice the vector part of the quaternion to the wanted attitude (Wie and
               Barba, J. Guidance 8, 1985: for small angles the rotation vector)
    commands   u = W^+ [weight] + s_1 W^+ [roll, pitch] + s_2 W^+ [yaw] + s_3 W^+ [F], each s in [0, 1], one after the
               other, the largest within limits

A multirotor with parallel rotors thrusts weight + F along its own z axis and turns that axis there (Lee, Leok and
McClamroch, Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010). A boat with surge and yaw only steers a
point at l ahead of its origin: surge makes that point's velocity forward, and the yaw rate (v_c,y - v_r,y) / l its
velocity to port.
"""

import numpy as np

from mjsheaf.backends.physics.bodies import HAND_POINT, THRUST_VECTOR
from mjsheaf.compiled import kernel

_SHARE_OF_FALL = 0.5  # a multirotor that points its thrust sinks with at most this much of its weight
_TIPPED = 0.5  # cosine of the tilt beyond which turning back comes before carrying the weight


@kernel
def drive(bodies, v, command, R, quaternion, measured, ctrl, F):
    """Write the commands of vehicle v's thrusters.

    Args:
        bodies: see BodyArrays.
        v: number of the vehicle.
        command: velocity wanted relative to the medium, world axes, shape (3,), m/s.
        R, quaternion: attitude, body to world, shapes (3, 3) and (4,).
        measured: velocity through the medium and rates, body axes, shape (6,), m/s and rad/s.
        ctrl: commands of all thrusters, shape (A,); those of the vehicle are written.
        F: scratch, shape (12,): wrench for translation, then weight and attitude.
    """
    for i in range(3):
        wanted = R[0, i] * command[0] + R[1, i] * command[1] + R[2, i] * command[2]
        F[i] = _force(bodies, v, i, wanted, measured[i])
        F[3 + i] = 0.0
        F[6 + i] = R[2, i] * bodies.lift[v]
    w, x, y, z = bodies.heading[v, 0], 0.0, 0.0, bodies.heading[v, 1]
    if bodies.control[v] == HAND_POINT:
        F[1] = F[2] = 0.0
        to_port = R[0, 1] * command[0] + R[1, 1] * command[1] + R[2, 1] * command[2]
        F[5] = _force(bodies, v, 5, (to_port - measured[1]) / bodies.hand[v], measured[5])
        F[9] = F[10] = F[11] = 0.0
    else:
        if bodies.control[v] == THRUST_VECTOR:
            w, x, y, z = _point_thrust(bodies, v, R, F)
        _turn_to(bodies, v, w, x, y, z, quaternion, measured, F)
        _keep_from_turning(bodies, v, measured, F)
    _allocate(bodies, v, R[2, 2], ctrl, F)


@kernel
def _force(bodies, v, i, wanted, measured):
    """d(v_c) + M k_v (v_c - v_r) along or about one axis."""
    feedforward = (bodies.drag[v, i] + bodies.quadratic[v, i] * abs(wanted)) * wanted
    return feedforward + bodies.gain[v, i] * (wanted - measured)


@kernel
def _point_thrust(bodies, v, R, F):
    """Turn the force F[:3] that is wanted beside the weight into thrust along z, and give the attitude that makes it.

    The force is scaled, never turned, until thrust, tilt and sinking are within what the vehicle may do.
    """
    lift = bodies.lift[v]
    x = R[0, 0] * F[0] + R[0, 1] * F[1] + R[0, 2] * F[2]
    y = R[1, 0] * F[0] + R[1, 1] * F[1] + R[1, 2] * F[2]
    z = R[2, 0] * F[0] + R[2, 1] * F[1] + R[2, 2] * F[2]
    share = 1.0
    if -z > _SHARE_OF_FALL * lift:
        share = _SHARE_OF_FALL * lift / -z
    slope = bodies.slope[v]
    beyond = np.sqrt(x * x + y * y) - slope * z
    if share * beyond > slope * lift:
        share = slope * lift / beyond
    square, most = x * x + y * y + z * z, bodies.most_thrust[v]
    if share * share * square + 2.0 * share * z * lift + lift * lift > most * most:
        share = (np.sqrt(z * z * lift * lift + square * (most * most - lift * lift)) - z * lift) / square
    x, y, z = share * x, share * y, lift + share * z
    thrust = np.sqrt(x * x + y * y + z * z)
    # What the attitude makes of it now; the rest follows once the vehicle has turned.
    F[0] = F[1] = F[6] = F[7] = 0.0
    F[2] = x * R[0, 2] + y * R[1, 2] + z * R[2, 2] - F[8]
    # The shortest turn that brings z to the thrust, after the turn to the heading.
    a, b, c = thrust + z, -y, x
    size = 1.0 / np.sqrt(a * a + b * b + c * c)
    a, b, c = a * size, b * size, c * size
    hw, hz = bodies.heading[v, 0], bodies.heading[v, 1]
    return a * hw, b * hw + c * hz, c * hw - b * hz, a * hz


@kernel
def _turn_to(bodies, v, w, x, y, z, quaternion, measured, F):
    """Write the moment that turns the vehicle to the attitude (w, x, y, z) into F[9:]."""
    a, b, c, d = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    # conj(quaternion) times the wanted one
    cosine = a * w + b * x + c * y + d * z
    sign = 2.0 if cosine >= 0.0 else -2.0
    k, damping = bodies.stiffness[v], bodies.rate_damping[v]
    ax = k * sign * (a * x - b * w - c * z + d * y) - damping * measured[3]
    ay = k * sign * (a * y + b * z - c * w - d * x) - damping * measured[4]
    az = k * sign * (a * z - b * y + c * x - d * w) - damping * measured[5]
    J = bodies.inertia[v]
    for i in range(3):
        F[9 + i] = J[i, 0] * ax + J[i, 1] * ay + J[i, 2] * az


@kernel
def _keep_from_turning(bodies, v, measured, F):
    """Write the moment that goes with the force F[:3] into F[3:6].

    Thrust and drag act at the origin, and what is left of them accelerates the centre of mass c: that takes c times it.
    """
    x = F[0] - (bodies.drag[v, 0] + bodies.quadratic[v, 0] * abs(measured[0])) * measured[0]
    y = F[1] - (bodies.drag[v, 1] + bodies.quadratic[v, 1] * abs(measured[1])) * measured[1]
    z = F[2] - (bodies.drag[v, 2] + bodies.quadratic[v, 2] * abs(measured[2])) * measured[2]
    c = bodies.arm[v]
    F[3], F[4], F[5] = c[1] * z - c[2] * y, c[2] * x - c[0] * z, c[0] * y - c[1] * x


@kernel
def _allocate(bodies, v, upright, ctrl, F):
    """Commands for weight F[6:9], moment F[9:12] and translation F[:6], in that order of rank.

    `upright` is the cosine of the tilt.
    """
    cx, cy, cz = bodies.arm[v, 0], bodies.arm[v, 1], bodies.arm[v, 2]
    mx, my, mz = cy * F[8] - cz * F[7], cz * F[6] - cx * F[8], cx * F[7] - cy * F[6]  # of the weight
    first, last = bodies.thruster[v], bodies.thruster[v + 1]
    x, y, z = F[0] + F[6], F[1] + F[7], F[2] + F[8]
    p, q, r = F[3] + F[9] + mx, F[4] + F[10] + my, F[5] + F[11] + mz
    within = True
    for k in range(first, last):
        row = bodies.allocation[k]
        u = row[0] * x + row[1] * y + row[2] * z + row[3] * p + row[4] * q + row[5] * r
        ctrl[k] = u
        if u < bodies.limits[k, 0] or u > bodies.limits[k, 1]:
            within = False
    if within:
        return
    if upright < _TIPPED and bodies.lift[v] > 0.0:
        # Thrusters asked for a weight that they cannot carry would be at their limits, and none left to turn.
        F[0] += F[6]
        F[1] += F[7]
        F[2] += F[8] - _TIPPED * bodies.lift[v]
        F[3], F[4], F[5] = F[3] + mx, F[4] + my, F[5] + mz
        F[6], F[7], F[8] = 0.0, 0.0, _TIPPED * bodies.lift[v]
        mx = my = mz = 0.0
    for k in range(first, last):
        row = bodies.allocation[k]
        ctrl[k] = row[0] * F[6] + row[1] * F[7] + row[2] * F[8] + row[3] * mx + row[4] * my + row[5] * mz
    _add_within(bodies, first, last, ctrl, 0.0, 0.0, 0.0, F[9], F[10], 0.0)
    # Yaw comes after roll and pitch: rotors make little of it, and what points up must not wait for it.
    _add_within(bodies, first, last, ctrl, 0.0, 0.0, 0.0, 0.0, 0.0, F[11])
    _add_within(bodies, first, last, ctrl, F[0], F[1], F[2], F[3], F[4], F[5])
    for k in range(first, last):
        ctrl[k] = _at_most(ctrl[k], bodies.limits[k])


@kernel
def _add_within(bodies, first, last, ctrl, x, y, z, p, q, r):
    """Add the commands for a wrench, or the largest share of them that keeps every thruster within its limits."""
    share = 1.0
    for k in range(first, last):
        row = bodies.allocation[k]
        du = row[0] * x + row[1] * y + row[2] * z + row[3] * p + row[4] * q + row[5] * r
        share = min(share, _room(ctrl[k], du, bodies.limits[k]))
    for k in range(first, last):
        row = bodies.allocation[k]
        ctrl[k] += share * (row[0] * x + row[1] * y + row[2] * z + row[3] * p + row[4] * q + row[5] * r)


@kernel
def _room(u, du, limits):
    """The largest share, 0 to 1, of du that keeps u + du within limits."""
    room = 1.0
    if u + du > limits[1] and du > 0.0:
        room = max(0.0, (limits[1] - u) / du)
    elif u + du < limits[0] and du < 0.0:
        room = max(0.0, (limits[0] - u) / du)
    return room


@kernel
def _at_most(u, limits):
    """A command within its limits, at one if within rounding of it. What is not finite stays, to be seen."""
    slack = 1e-9 * (limits[1] - limits[0])
    if u > limits[1] - slack:
        return limits[1] if u < np.inf else u
    if u < limits[0] + slack:
        return limits[0] if u > -np.inf else u
    return u
