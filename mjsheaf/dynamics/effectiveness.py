"""Control effectiveness g_i(q, t) of an ideal agent: full row rank, and possibly more inputs than states.

g(q, t) = R(psi(q, t)) W: a thruster layout W fixed in a frame whose heading psi = psi_0 + psi_q . q + psi_t t depends
on position and time. R turns about z. As R is a rotation, g^+ = W^+ R^T, and g has full row rank where W has.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.errors import InputError
from mjsheaf.jit import jit
from mjsheaf.section import Matrix, Number, Point, Section

RANK_TOLERANCE = 1e-9
"""A singular value of g at most this much of the largest counts as zero."""


class EffectivenessArrays(NamedTuple):
    """Layouts of all agents, padded: W (N, 3, s), pinv (N, s, 3), heading (N, 5): psi_0, psi_q (3), psi_t.

    `given` (N,) marks the agents that have one; the others have g = I. `inputs` (N,) is each one's number s of inputs.
    """

    given: BoolArray
    inputs: IntArray
    W: Array
    pinv: Array
    heading: Array


class ControlEffectiveness(Section):
    """g(q, t) = R(psi) layout with psi = heading + gradient . q + rate t; ideal backend."""

    layout: Matrix = Field(
        description="W, one row for each coordinate, one column for each input [m/s per unit of input]"
    )
    heading: Number = Field(0.0, description="psi_0 [degrees]")
    heading_gradient: Point | None = Field(None, description="psi_q [degrees/m]")
    heading_rate: Number = Field(0.0, description="psi_t [degrees/s]")


@jit
def allocate(effectiveness, i, q, t, velocity, u):
    """Write u = g^+(q, t) velocity of agent i into u (s,), then g(q, t) u back into velocity (3,)."""
    h = effectiveness.heading[i]
    psi = h[0] + h[1] * q[0] + h[2] * q[1] + h[3] * q[2] + h[4] * t
    c, s = np.cos(psi), np.sin(psi)
    bx, by, bz = c * velocity[0] + s * velocity[1], c * velocity[1] - s * velocity[0], velocity[2]
    P, W = effectiveness.pinv[i], effectiveness.W[i]
    bx2, by2, bz2 = 0.0, 0.0, 0.0
    for k in range(P.shape[0]):
        u[k] = P[k, 0] * bx + P[k, 1] * by + P[k, 2] * bz
        bx2 += W[0, k] * u[k]
        by2 += W[1, k] * u[k]
        bz2 += W[2, k] * u[k]
    velocity[0], velocity[1], velocity[2] = c * bx2 - s * by2, s * bx2 + c * by2, bz2


def pack(models: list[ControlEffectiveness | None], dimensions: list[int]) -> EffectivenessArrays:
    """Pack the agents' models (None: g = I) into arrays.

    Raises:
        InputError: a layout has rows of unequal length or the wrong number of them.
    """
    N = len(models)
    width = max([3, *(len(g.layout[0]) for g in models if g is not None)])
    arrays = EffectivenessArrays(
        np.zeros(N, dtype=np.bool_),
        np.array(dimensions, dtype=np.int64),
        np.zeros((N, 3, width)),
        np.zeros((N, width, 3)),
        np.zeros((N, 5)),
    )
    for i, (g, n) in enumerate(zip(models, dimensions, strict=True)):
        if g is None:
            arrays.W[i, :n, :n] = arrays.pinv[i, :n, :n] = np.eye(n)
            continue
        if len({len(row) for row in g.layout}) != 1 or len(g.layout) != n:
            raise InputError(f"control effectiveness must have {n} rows of equal length")
        W = np.asarray(g.layout, dtype=np.float64)
        s = W.shape[1]
        arrays.given[i], arrays.inputs[i] = True, s
        arrays.W[i, :n, :s], arrays.pinv[i, :s, :n] = W, np.linalg.pinv(W)
        arrays.heading[i, 0], arrays.heading[i, 4] = np.deg2rad(g.heading), np.deg2rad(g.heading_rate)
        if g.heading_gradient is not None:
            if len(g.heading_gradient) != n:
                raise InputError(f"heading gradient has {len(g.heading_gradient)} entries; expected {n}")
            arrays.heading[i, 1 : 1 + n] = np.deg2rad(g.heading_gradient)
    return arrays


def without_full_row_rank(arrays: EffectivenessArrays, dimensions: list[int]) -> list[int]:
    """Numbers of the agents whose layout is not of full row rank (Assumption 2): g g^+ = I fails for them."""
    deficient = []
    for n in set(dimensions):
        of = np.flatnonzero(np.array(dimensions) == n)
        singular = np.linalg.svd(arrays.W[of, :n], compute_uv=False)
        deficient += [int(i) for i, sigma in zip(of, singular, strict=True) if is_rank_deficient(sigma)]
    return sorted(deficient)


def is_rank_deficient(singular: NDArray[np.floating]) -> bool:
    """Return True if singular values, largest first, show that g lacks full row rank, relative to the largest."""
    return bool(singular[-1] <= RANK_TOLERANCE * singular[0])
