"""Conjugate gradients for a matrix I + U + U^T of which only the strict upper triangle U is stored.

The preconditioner is symmetric successive over-relaxation, M = (I/w + U^T) w (I/w + U) for any 0 < w < 2, which is
positive definite. With Eisenstat's trick (SIAM J. Sci. Stat. Comput. 2, 1981) an iteration costs one pass over U
backwards and one forwards, as much as without a preconditioner: A = (I/w + U^T) + (I/w + U) + (1 - 2/w) I, so that of
the product with A between the two triangular solutions little is left to do.
"""

import numpy as np

from mjsheaf.compiled import allocating_kernel, kernel


@kernel
def scale_symmetrically(indptr, indices, values, diagonal):
    """Turn the diagonal d into 1 / sqrt(d), and U into that on both sides of it; a zero of d has no row, and becomes 1.

    Args:
        indptr, indices, values: compressed rows of U.
        diagonal: shape (n,).
    """
    for i in range(len(diagonal)):
        diagonal[i] = 1.0 / np.sqrt(diagonal[i]) if diagonal[i] > 0.0 else 1.0
    for i in range(len(diagonal)):
        for k in range(indptr[i], indptr[i + 1]):
            values[k] *= diagonal[i] * diagonal[indices[k]]


@allocating_kernel
def conjugate_gradients(indptr, indices, values, b, relaxation, tolerance, most):
    """Solve (I + U + U^T) x = b from x = 0.

    Args:
        indptr, indices, values: compressed rows of U.
        b: right-hand side, shape (n,), in the range of the matrix.
        relaxation: w.
        tolerance: by how much to shrink the norm of the preconditioned residual.
        most: most iterations.

    Returns:
        x and the number of iterations.
    """
    n = len(b)
    x, p, w, q = np.zeros(n), np.zeros(n), np.empty(n), np.empty(n)
    # Everything is multiplied by w once, so that the triangles have unit diagonals: r = (I + w U^T)^-1 w b.
    r = relaxation * b
    for i in range(n):
        value = relaxation * r[i]
        for k in range(indptr[i], indptr[i + 1]):
            r[indices[k]] -= values[k] * value
    square = 0.0
    for i in range(n):
        square += r[i] * r[i]
    enough, beta, iterations = tolerance * tolerance * square, 0.0, 0
    while iterations < most and square > enough:
        iterations += 1
        for i in range(n - 1, -1, -1):  # w = (I + w U)^-1 p
            p[i] = r[i] + beta * p[i]
            total = 0.0
            for k in range(indptr[i], indptr[i + 1]):
                total += values[k] * w[indices[k]]
            w[i] = p[i] - relaxation * total
            q[i] = p[i] + (relaxation - 2.0) * w[i]
        curvature = 0.0
        for i in range(n):  # q = w + (I + w U^T)^-1 (p + (w - 2) w)
            value = relaxation * q[i]
            for k in range(indptr[i], indptr[i + 1]):
                q[indices[k]] -= values[k] * value
            q[i] += w[i]
            curvature += p[i] * q[i]
        if not curvature > 0.0:  # b was not in the range, or rounding is all that is left
            break
        alpha, new = square / curvature, 0.0
        for i in range(n):
            x[i] += alpha * w[i]
            r[i] -= alpha * q[i]
            new += r[i] * r[i]
        beta, square = new / square, new
    return x, iterations
