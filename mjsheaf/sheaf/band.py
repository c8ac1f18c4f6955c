"""Cholesky's factorisation of a band, by compiled loops.

LAPACK's would be as fast on narrow bands and faster on wide ones, but its bits depend on the number of threads.
"""

import numpy as np

from mjsheaf.compiled import kernel


@kernel
def factor_band(band):
    """Factor A = C C^T in place; return whether A is positive definite to rounding.

    Args:
        band: A[i, j], i >= j, is band[j, i - j]; then so is C. Shape (n, bandwidth + 1).
    """
    n, width = band.shape
    for j in range(n):
        if not band[j, 0] > 0.0:
            return False
        count = min(width, n - j)
        root = np.sqrt(band[j, 0])
        for i in range(count):
            band[j, i] /= root
        for i in range(1, count):
            factor = band[j, i]
            if factor != 0.0:
                for k in range(count - i):
                    band[j + i, k] -= factor * band[j, i + k]
    return True


@kernel
def solve_band(band, x):
    """Solve C C^T x = b in place, for b of shape (n, k)."""
    n, width = band.shape
    columns = x.shape[1]
    for j in range(n):
        for c in range(columns):
            x[j, c] /= band[j, 0]
        for i in range(1, min(width, n - j)):
            factor = band[j, i]
            for c in range(columns):
                x[j + i, c] -= factor * x[j, c]
    for j in range(n - 1, -1, -1):
        for i in range(1, min(width, n - j)):
            factor = band[j, i]
            for c in range(columns):
                x[j, c] -= factor * x[j + i, c]
        for c in range(columns):
            x[j, c] /= band[j, 0]
