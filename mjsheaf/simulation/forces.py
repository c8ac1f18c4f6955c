"""What the medium does to a vehicle: drag relative to it, buoyancy, added mass; and what the vehicle measures of it.

For a vehicle with attitude R, velocity v and rates omega in a medium that moves at w, with v_r = R^T (v - w):

    drag           -D v_r - Q |v_r| v_r, and the same about the axes                          body axes
    hydrostatics   weight carried at the centre of buoyancy, -K (z - level, roll, pitch)
    added mass     -M_A a - C_A(v_r) v_r  (Kirchhoff; Fossen, Handbook of Marine Craft Hydrodynamics, 2011, ch. 6)

Linear drag that is stiff, and does not fight added mass, is split: the largest coefficient is damping of the free
joint, which MuJoCo integrates implicitly, so that it costs no small steps; the joint damps along world axes, so the
difference to R D R^T, and what the medium's own velocity adds, is applied as a force.

Added mass cannot be fed back as a force: that diverges once it exceeds the mass. Instead every wrench F on the body but
those of contacts is applied as S F with S = M_RB (M_RB + M_A)^-1, and MuJoCo's M_RB a = S F is (M_RB + M_A) a = F. The
medium's acceleration is neglected.
"""

from mjsheaf.jit import inline_jit
from mjsheaf.system import medium_velocity
from mjsheaf.vehicles.steering import drag_force
from mjsheaf.vehicles.vectors import add, cross, product, row_product, subtract, to_body, to_world, triple, upward


@inline_jit
def velocity_through_medium(kind, body, medium, sines, v, qpos, qvel, R):
    """Velocity of vehicle v through the medium, in body axes, (3,), m/s; R is its attitude, (9,)."""
    a, d = body.qpos, body.dof
    w = medium_velocity(medium, sines, v, qpos[a], qpos[a + 1], 0.0 if kind.planar else qpos[a + 2])
    return to_body(R, subtract((qvel[d], qvel[d + 1], qvel[d + 2]), w))


@inline_jit
def apply_medium_wrench(kind, body, qpos, qvel, R, s, omega, applied):
    """Write the medium's wrench into `applied` (qfrc_applied): force in world axes, moment in body axes.

    s and omega are the velocity through the medium and the rates in body axes, (3,) each.
    """
    a, d = body.qpos, body.dof
    D, Q, k = kind.drag, kind.quadratic, kind.explicit
    force = drag_force(kind, s)
    force = -force[0], -force[1], -force[2]
    moment = (
        -(k * D[3] + Q[3] * abs(omega[0])) * omega[0],
        -(k * D[4] + Q[4] * abs(omega[1])) * omega[1],
        -(k * D[5] + Q[5] * abs(omega[2])) * omega[2],
    )
    if kind.buoyancy > 0.0:
        # A moment K (b_z x e_z) rights the hull; its height and its tilt are small.
        force = add(force, upward(R, kind.buoyancy - kind.restoring[0] * (qpos[a + 2] - kind.level)))
        moment = add(moment, cross(triple(kind.centre), upward(R, kind.buoyancy)))
        moment = moment[0] - kind.restoring[1] * R[7], moment[1] + kind.restoring[2] * R[6], moment[2]
    if kind.ballast > 0.0:
        weight = upward(R, -kind.ballast)
        force, moment = add(force, weight), add(moment, cross(triple(kind.ballast_point), weight))
    if kind.added:
        force, moment = _share_with_medium(kind, R, s, omega, force, moment)
    force = to_world(R, force)
    for i in range(3):
        applied[d + i] = force[i] + kind.implicit * qvel[d + i]
        applied[d + 3 + i] = moment[i]


@inline_jit
def _share_with_medium(kind, R, s, omega, force, moment):
    """The wrench under which MuJoCo's body moves as one with added mass does under the given one, body axes.

    MuJoCo solves M_RB a + h = Q + G with h the rigid body's centrifugal wrench and G its weight. Wanted is
    (M_RB + M_A) a + h = F + G + C with C = M_A [omega x v_r; 0] - C_A(v_r) v_r, as a is taken in axes that do not turn.
    Hence Q = S (F + G - h + C) + h - G.
    """
    m, c, A = kind.mass, triple(kind.com), kind.added_mass
    weight = upward(R, -kind.weight)
    outward = cross(omega, cross(omega, c))
    own_force = weight[0] - m * outward[0], weight[1] - m * outward[1], weight[2] - m * outward[2]
    own_moment = subtract(cross(c, weight), cross(omega, product(kind.rigid, omega)))  # G - h
    P = A[0] * s[0], A[1] * s[1], A[2] * s[2]  # momentum of the medium
    L = A[3] * omega[0], A[4] * omega[1], A[5] * omega[2]
    turn = cross(omega, s)
    coupling = subtract((A[0] * turn[0], A[1] * turn[1], A[2] * turn[2]), cross(omega, P))
    munk = add(cross(s, P), cross(omega, L))
    f = add(add(force, own_force), coupling)
    n = subtract(add(moment, own_moment), munk)
    S = kind.rigid_wrench_map
    shared_force = row_product(S[0], f, n), row_product(S[1], f, n), row_product(S[2], f, n)
    shared_moment = row_product(S[3], f, n), row_product(S[4], f, n), row_product(S[5], f, n)
    return subtract(shared_force, own_force), subtract(shared_moment, own_moment)
