"""Range and bearing edges in the law: a stage between measurement and pullback.

Let z = y + b be the relative position of an edge and g = z / |z|. The vector pulled back instead of z is

    range      (1 - r / |z|) z
    bearing    (g . g*) g - g*

(see `mjsheaf.sheaf.nonlinear`), and zero if z is 0, as without a measurement. The kinds of a team's edges are a named
tuple in `EdgeArrays`, or () if all edges compare positions. The type () makes numba compile nothing for this stage.

Rounds of feedforward and newton solve with H = sum F^T w M F over edges, F x = F_head x_head - F_tail x_tail. M is that
of the measured z: g g^T of a range, min(1 / |z|, s) (I - g g^T) of a bearing, with s twice 1 / |z| at the initial
q*, and 0 if z is 0. Projections are between 0 and I, so 0 <= M <= a I with a = 1 of a range and a = s of a bearing, and

    0 <= H <= sum a w F^T F    at every x,

whose largest eigenvalue is the upper bound that Chebyshev's iteration takes. Its polynomial is between 0 and 1 from 0
to the lower bound: a lower bound that is too large for the present H slows the rounds down, and no error grows in them.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array, IntArray
from mjsheaf.compile.jit import inline_jit
from mjsheaf.noise import normal_of
from mjsheaf.team import Edge, Team

POSITION, RANGE, BEARING = 0, 1, 2
"""Kinds of edges."""


class EdgeKinds(NamedTuple):
    """Kinds of the edges of a team.

    Attributes:
        code: POSITION, RANGE or BEARING, shape (E,).
        desired: The distance in the first number of a range edge, the unit vector of a bearing edge, shape (m,).
    """

    code: IntArray
    desired: Array


def pack_kinds(edges: Sequence[Edge]) -> Any:
    """Return the EdgeKinds of edges; () if all compare positions."""
    if all(edge.measures == "position" for edge in edges):
        return ()
    names = ("position", "range", "bearing")
    desired = []
    for edge in edges:
        value = np.zeros(len(edge.F_tail))
        if edge.measures != "position" and edge.offset is not None:
            value[: len(edge.offset)] = edge.offset
        desired.append(value)
    return EdgeKinds(np.array([names.index(edge.measures) for edge in edges], dtype=np.int64), np.concatenate(desired))


@inline_jit
def compare(kinds, edges, y, out):
    """Write into out (m,) what is pulled back, less b, from measurements y (m,); out may be y.

    Nothing is written if all edges compare positions: then y is what is pulled back.
    """
    if len(kinds) == 0:
        return
    for e in range(edges.tail.shape[0]):
        first, end = edges.first[e], edges.first[e + 1]
        if kinds.code[e] == POSITION:
            for r in range(first, end):
                out[r] = y[r]
            continue
        square, along = 0.0, 0.0
        for r in range(first, end):
            z = y[r] + edges.b[r]
            square += z * z
            along += z * kinds.desired[r]
        length = np.sqrt(square)
        if length == 0.0:
            for r in range(first, end):
                out[r] = -edges.b[r]
        elif kinds.code[e] == RANGE:
            share = 1.0 - kinds.desired[first] / length
            for r in range(first, end):
                out[r] = share * (y[r] + edges.b[r]) - edges.b[r]
        else:
            share = along / square
            for r in range(first, end):
                out[r] = share * (y[r] + edges.b[r]) - kinds.desired[r] - edges.b[r]


class Slopes(NamedTuple):
    """Bounds on H of a team with range and bearing edges, for rounds.

    Attributes:
        low: Smallest eigenvalue of H above zero at the initial q*.
        steepest: Largest 1 / |z| of communication and sensing edges, shape (C + S,), 1/m.
        bound: Team of position edges whose H is nowhere smaller.
        free: True if motions are free at the initial q*. Rounds of newton then begin with 0 at every sample, because
            what is free changes with the positions.
    """

    low: float
    steepest: Array
    bound: Team
    free: bool


_STEEPER = 2.0  # largest 1 / |z| that rounds count, over that at the initial q*


def bound_slopes(team: Team, positions: Array) -> Slopes | None:
    """Bound H of the present agents of a team whose members begin at padded positions (V, 3), m.

    Absent agents have no q*, and measure at no edge.

    Returns:
        The bounds; None if H is not symmetric.
    """
    if team.directed:
        return None
    there = np.concatenate([team.present, np.ones(len(team.targets), dtype=np.bool_)])
    shape = team.remaining.linearised(team.remaining.at_rest(positions[there]))
    steepest = []
    changed = {}
    for edge, local in zip(team.measuring_edges, shape.measuring_edges, strict=True):
        ratio = _STEEPER * edge.weight[0, 0] / local.weight[0, 0] if edge.measures == "bearing" else 1.0
        steepest.append(ratio)
        linear = replace(edge, measures="position", weight=ratio * edge.weight, offset=np.zeros(len(edge.F_tail)))
        changed[id(edge)] = linear
    problem = shape.dirichlet
    return Slopes(problem.eigenvalues[0], np.array(steepest), team.with_edges(changed), not problem.unique)


@inline_jit
def slope(kinds, steepest, edges, y, e):
    """Return a and c of M = a I + c z z^T of an edge at its measured z = y + b, without its weight.

    Both are 0 if a range or bearing edge measures nothing.

    Args:
        kinds: Kinds of the edges.
        steepest: Largest 1 / |z| of communication and sensing edges, shape (C + S,), 1/m.
        edges: Edges of the law.
        y: Measurements, shape (m,), m.
        e: Number of the edge.
    """
    if len(kinds) == 0:
        return 1.0, 0.0
    if kinds.code[e] == POSITION:
        return 1.0, 0.0
    square = 0.0
    for r in range(edges.first[e], edges.first[e + 1]):
        square += (y[r] + edges.b[r]) * (y[r] + edges.b[r])
    if square == 0.0:
        return 0.0, 0.0
    if kinds.code[e] == RANGE:
        return 0.0, 1.0 / square
    inverse = min(1.0 / np.sqrt(square), steepest[e])
    return inverse, -inverse / square


@inline_jit
def disturb(kinds, link, edges, first, end, draw, y):
    """Add the errors of a link to the range or the bearing of its edge, in y[first:end]; False of a position edge.

    A range gets noise and bias in m; a bearing is turned by a random angle about every axis, with noise in rad.
    """
    if len(kinds) == 0:
        return False
    code = kinds.code[link.edge]
    if code == POSITION:
        return False
    square, along = 0.0, 0.0
    for r in range(first, end):
        z = y[r] + edges.b[r]
        square += z * z
        along += z * normal_of(draw[1 + (r - first) % 3])
    length = np.sqrt(square)
    if length == 0.0:
        return True
    if code == RANGE:
        scale = (length + link.noise * normal_of(draw[1]) + link.bias) / length
        for r in range(first, end):
            y[r] = scale * (y[r] + edges.b[r]) - edges.b[r]
        return True
    across = 0.0
    for r in range(first, end):
        n = normal_of(draw[1 + (r - first) % 3]) - along * (y[r] + edges.b[r]) / square
        across += n * n
    across = np.sqrt(across)
    angle = link.noise * across
    turned = length * np.sin(angle) / across if across > 0.0 else 0.0
    for r in range(first, end):
        z = y[r] + edges.b[r]
        n = normal_of(draw[1 + (r - first) % 3]) - along * z / square
        y[r] = np.cos(angle) * z + turned * n - edges.b[r]
    return True
