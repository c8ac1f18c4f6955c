"""Vectors in space as tuples, for compiled code: they stay in registers and cannot alias each other in memory.

A rotation is a tuple of its nine entries by rows; it maps body axes to world axes.
"""

from mjsheaf.compile.jit import inline_jit


@inline_jit
def rotation(w, x, y, z):
    """Compute the rotation of a unit quaternion."""
    return (
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    )


@inline_jit
def to_world(R, a):
    """R a."""
    return (
        R[0] * a[0] + R[1] * a[1] + R[2] * a[2],
        R[3] * a[0] + R[4] * a[1] + R[5] * a[2],
        R[6] * a[0] + R[7] * a[1] + R[8] * a[2],
    )


@inline_jit
def to_body(R, a):
    """R^T a."""
    return (
        R[0] * a[0] + R[3] * a[1] + R[6] * a[2],
        R[1] * a[0] + R[4] * a[1] + R[7] * a[2],
        R[2] * a[0] + R[5] * a[1] + R[8] * a[2],
    )


@inline_jit
def upward(R, size):
    """Compute R^T e_z times a size, a vertical vector in body axes."""
    return R[6] * size, R[7] * size, R[8] * size


@inline_jit
def add(a, b):
    """Compute a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inline_jit
def subtract(a, b):
    """Compute a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline_jit
def cross(a, b):
    """Compute a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline_jit
def square_of(a):
    """Compute |a|^2."""
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]


@inline_jit
def triple(row):
    """Return the first three entries of an array."""
    return row[0], row[1], row[2]


@inline_jit
def product(M, a):
    """Compute M a for an array M (3, 3)."""
    return (
        M[0, 0] * a[0] + M[0, 1] * a[1] + M[0, 2] * a[2],
        M[1, 0] * a[0] + M[1, 1] * a[1] + M[1, 2] * a[2],
        M[2, 0] * a[0] + M[2, 1] * a[1] + M[2, 2] * a[2],
    )


@inline_jit
def row_product(row, a, b):
    """Compute a row (6,) times [a; b]."""
    first = row[0] * a[0] + row[1] * a[1] + row[2] * a[2]
    return first + row[3] * b[0] + row[4] * b[1] + row[5] * b[2]
