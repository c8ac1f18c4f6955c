"""What the medium does to a vehicle: drag relative to it, buoyancy, added mass; and what the vehicle measures of it.

For a vehicle with attitude R, velocity v and rates omega in a medium that moves at w, with v_r = R^T (v - w):

    drag           -D v_r - Q |v_r| v_r, and the same about the axes                          body axes
    hydrostatics   weight carried at the centre of buoyancy, -K (z - level, roll, pitch)
    added mass     -M_A a - C_A(v_r) v_r  (Kirchhoff; Fossen, Handbook of Marine Craft Hydrodynamics, 2011, ch. 6)

Linear drag that does not fight added mass is split: the largest coefficient is damping of the free joint, which MuJoCo
integrates implicitly, so that stiff drag costs no small steps; the joint damps along world axes, so the difference to
R D R^T, and what the medium's own velocity adds, is applied as a force.

Added mass cannot be fed back as a force: that diverges once it exceeds the mass. Instead every wrench F on the body but
those of contacts is applied as S F with S = M_RB (M_RB + M_A)^-1, and MuJoCo's M_RB a = S F is (M_RB + M_A) a = F. The
medium's acceleration is neglected.
"""

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.system import medium_velocity
from mjsheaf.compiled import kernel

Array = NDArray[np.float64]


@kernel
def rotation(q, at, R):
    """Write the rotation of the unit quaternion q[at : at + 4] (w, x, y, z), body to world, into R (3, 3)."""
    w, x, y, z = q[at], q[at + 1], q[at + 2], q[at + 3]
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@kernel
def measure(bodies, medium, v, t, qpos, qvel, R, measured):
    """Write what vehicle v measures: attitude R (3, 3), velocity through the medium and rates in body axes (6,)."""
    a, d = bodies.qpos[v], bodies.dof[v]
    rotation(qpos, a + 3, R)
    z = 0.0 if medium.planar[v] else qpos[a + 2]
    wx, wy, wz = medium_velocity(medium, v, t, qpos[a], qpos[a + 1], z)
    x, y, z = qvel[d] - wx, qvel[d + 1] - wy, qvel[d + 2] - wz
    for i in range(3):
        measured[i] = R[0, i] * x + R[1, i] * y + R[2, i] * z
        measured[3 + i] = qvel[d + 3 + i]


@kernel
def push(bodies, v, qpos, qvel, R, measured, applied, F):
    """Write the medium's wrench on vehicle v into `applied`: force in world, moment in body axes; F is scratch."""
    a, d = bodies.qpos[v], bodies.dof[v]
    x, y, z = qvel[d], qvel[d + 1], qvel[d + 2]
    implicit = bodies.damping[v, 0]
    for i in range(3):
        s, r = measured[i], measured[3 + i]
        along = R[0, i] * x + R[1, i] * y + R[2, i] * z
        F[i] = implicit * along - (bodies.drag[v, i] + bodies.quadratic[v, i] * abs(s)) * s
        explicit = (1.0 - bodies.damping[v, 1]) * bodies.drag[v, 3 + i]
        F[3 + i] = -(explicit + bodies.quadratic[v, 3 + i] * abs(r)) * r
    if bodies.buoyancy[v] > 0.0:
        # A moment K (b_z x e_z) rights the hull; its height and its tilt are small.
        lift = bodies.buoyancy[v] - bodies.restoring[v, 0] * (qpos[a + 2] - bodies.level[v])
        for i in range(3):
            F[i] += R[2, i] * lift
        _add_moment(bodies.centre[v], bodies.buoyancy[v], R, F)
        F[3] -= bodies.restoring[v, 1] * R[2, 1]
        F[4] += bodies.restoring[v, 2] * R[2, 0]
    if bodies.ballast[v] > 0.0:
        for i in range(3):
            F[i] -= R[2, i] * bodies.ballast[v]
        _add_moment(bodies.arm[v], -bodies.ballast[v], R, F)
    if bodies.added[v]:
        _share_with_medium(bodies, v, R, measured, F)
    for i in range(3):
        applied[d + i] = R[i, 0] * F[0] + R[i, 1] * F[1] + R[i, 2] * F[2]
        applied[d + 3 + i] = F[3 + i]


@kernel
def _add_moment(at, force, R, F):
    """Add the moment of a vertical force (N, up) at a point of the body, in body axes."""
    x, y, z = R[2, 0] * force, R[2, 1] * force, R[2, 2] * force
    F[3] += at[1] * z - at[2] * y
    F[4] += at[2] * x - at[0] * z
    F[5] += at[0] * y - at[1] * x


@kernel
def _share_with_medium(bodies, v, R, measured, F):
    """Turn the wrench F (6,), in place, into the one under which MuJoCo's body moves as if it had its added mass.

    MuJoCo solves M_RB a + h = Q + G with h the rigid body's centrifugal wrench and G its weight. Wanted is
    (M_RB + M_A) a + h = F + G + C with C = M_A [omega x v_r; 0] - C_A(v_r) v_r, as a is taken in axes that do not turn.
    Hence Q = S (F + G - h + C) + h - G.
    """
    m, c, A = bodies.mass[v], bodies.arm[v], bodies.added_mass[v]
    x, y, z, p, q, r = measured[0], measured[1], measured[2], measured[3], measured[4], measured[5]
    # h: m omega x (omega x c) and omega x I omega
    ox, oy, oz = q * c[2] - r * c[1], r * c[0] - p * c[2], p * c[1] - q * c[0]
    J = bodies.rigid[v]
    Lx = J[0, 0] * p + J[0, 1] * q + J[0, 2] * r
    Ly = J[1, 0] * p + J[1, 1] * q + J[1, 2] * r
    Lz = J[2, 0] * p + J[2, 1] * q + J[2, 2] * r
    weight = bodies.weight[v]
    gx, gy, gz = -R[2, 0] * weight, -R[2, 1] * weight, -R[2, 2] * weight
    own = (
        gx - m * (q * oz - r * oy),
        gy - m * (r * ox - p * oz),
        gz - m * (p * oy - q * ox),
        c[1] * gz - c[2] * gy - (q * Lz - r * Ly),
        c[2] * gx - c[0] * gz - (r * Lx - p * Lz),
        c[0] * gy - c[1] * gx - (p * Ly - q * Lx),
    )  # G - h
    Px, Py, Pz = A[0] * x, A[1] * y, A[2] * z  # momentum of the medium
    Hx, Hy, Hz = A[3] * p, A[4] * q, A[5] * r
    coupling = (
        A[0] * (q * z - r * y) - (q * Pz - r * Py),
        A[1] * (r * x - p * z) - (r * Px - p * Pz),
        A[2] * (p * y - q * x) - (p * Py - q * Px),
        -(y * Pz - z * Py) - (q * Hz - r * Hy),
        -(z * Px - x * Pz) - (r * Hx - p * Hz),
        -(x * Py - y * Px) - (p * Hy - q * Hx),
    )  # C
    t0, t1, t2 = F[0] + own[0] + coupling[0], F[1] + own[1] + coupling[1], F[2] + own[2] + coupling[2]
    t3, t4, t5 = F[3] + own[3] + coupling[3], F[4] + own[4] + coupling[4], F[5] + own[5] + coupling[5]
    S = bodies.share[v]
    for i in range(6):
        F[i] = S[i, 0] * t0 + S[i, 1] * t1 + S[i, 2] * t2 + S[i, 3] * t3 + S[i, 4] * t4 + S[i, 5] * t5 - own[i]
