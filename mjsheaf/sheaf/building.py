"""Checks of what a user gives for the edges of a sheaf; their messages say what is expected."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjsheaf.errors import SheafError
from mjsheaf.sheaf.edges import EdgeBundle, packed

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def checked_bundle(
    tails: Sequence,
    heads: Sequence,
    tail: Index,
    head: Index,
    dimension: Index,
    F_tails: Any,
    F_heads: Any,
    offset: Any,
    weight: Any,
    row: Any,
) -> EdgeBundle:
    """A bundle of k edges of equal stalk dimensions.

    Args:
        tails, heads: the vertices as the user calls them, for messages.
        tail, head: the same by number, shape (k,).
        dimension: dimension of each vertex stalk, shape (V,).
        F_tails, F_heads: maps, shapes (k, m, n_tail) and (k, m, n_head).
        offset: desired values, shape (k, m), or None.
        weight: inner products, shape (k, m, m), or positive numbers of shape (k,) times the identity, or None.
        row: first row of each edge, shape (k,), or of the first edge, from where they follow each other.

    Raises:
        SheafError: loop, wrong shape, non-finite entry, or a weight that is not SPD.
    """
    k = len(tail)
    loops = np.flatnonzero(tail == head)
    if loops.size:
        raise SheafError(f"edge ({tails[loops[0]]!r}, {heads[loops[0]]!r}) is a loop; its ends must differ")
    F_tail, F_head = _of_edges(F_tails, "F_tail", tails, heads), _of_edges(F_heads, "F_head", tails, heads)
    for name, F, vertices, at in (("tail", F_tail, tails, tail), ("head", F_head, heads, head)):
        if F.ndim != 3 or F.shape[0] != k:
            raise SheafError(f"maps of the {name}s have shape {F.shape}; expected ({k}, m, n)")
        wrong = np.flatnonzero(dimension[at] != F.shape[2])
        if wrong.size:
            e = wrong[0]
            raise SheafError(
                f"edge ({tails[e]!r}, {heads[e]!r}): the map of {name} {vertices[e]!r} has shape "
                f"{F.shape[1:]}, but the stalk has dimension {dimension[at[e]]}; "
                f"expected (m, {dimension[at[e]]})"
            )
    m = F_tail.shape[1]
    if F_head.shape[1] != m:
        raise SheafError(
            f"edge ({tails[0]!r}, {heads[0]!r}): the maps have {m} and {F_head.shape[1]} rows; "
            "both must map to the same edge stalk"
        )
    # No memory for zeros: a million edges have enough to store.
    b = np.broadcast_to(0.0, (k, m)) if offset is None else np.array(_of_edges(offset, "offset", tails, heads))
    if b.shape != (k, m):
        raise SheafError(f"offset has shape {b.shape}; expected ({k}, {m})")
    K = None if weight is None else _inner_products(weight, k, m, tails, heads)
    rows = row + m * np.arange(k) if np.ndim(row) == 0 else row
    return EdgeBundle(tail, head, packed([F_tail], [F_head]), (m, F_tail.shape[2], F_head.shape[2]), b, K, rows)


def _inner_products(weight: Any, k: int, m: int, tails: Sequence, heads: Sequence) -> Array:
    K = np.array(_of_edges(weight, "weight", tails, heads))
    if K.shape == (k,):
        K = K[:, None, None] * np.eye(m)
    if K.shape != (k, m, m):
        raise SheafError(f"weight has shape {K.shape}; expected ({k}, {m}, {m}) or ({k},)")
    scale = np.abs(K).max(axis=(1, 2), initial=0.0)
    asymmetry = np.abs(K - K.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
    smallest = np.linalg.eigvalsh(K).min(axis=1, initial=np.inf)
    bad = np.flatnonzero((asymmetry > 1e-12 * scale) | ~(smallest > 1e-14 * scale))
    if bad.size:
        e = bad[0]
        raise SheafError(
            f"edge ({tails[e]!r}, {heads[e]!r}): the weight is not symmetric positive definite "
            f"(smallest eigenvalue {smallest[e]:.3g}, asymmetry {asymmetry[e]:.3g})"
        )
    return K


def finite(x: Any, name: str) -> Array:
    """A copy of an array of finite numbers, or a SheafError that names it."""
    array = np.array(_numbers(x, name))
    if not np.isfinite(array).all():
        raise SheafError(f"{name}: an entry is not finite")
    return array


def _of_edges(x: Any, name: str, tails: Sequence, heads: Sequence) -> Array:
    """One finite entry of an array for each edge; not a copy."""
    array = _numbers(x, name)
    if not np.isfinite(array).all():
        e = np.argwhere(~np.isfinite(array))[0, 0] if array.ndim and len(array) == len(tails) else None
        raise SheafError(f"{'' if e is None else f'edge ({tails[e]!r}, {heads[e]!r}): '}{name}: an entry is not finite")
    return array


def _numbers(x: Any, name: str) -> Array:
    try:
        return np.asarray(x, dtype=np.float64)
    except (TypeError, ValueError):
        raise SheafError(f"{name}: not an array of numbers of equal row lengths") from None
