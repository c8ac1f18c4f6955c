"""Nonlinear sheaves: edges that compare positions, ranges or bearings, and harmonic extensions by Gauss-Newton.

On an edge from tail to head, z = F_head x_head - F_tail x_tail + lift is the relative position. The edge measures

| measures | h           | desired h*                    | weight K | pulls z by c             | M of D^T M D      |
|----------|-------------|-------------------------------|----------|--------------------------|-------------------|
| position | -z          | F_tail x_tail - F_head x_head | K        | K (z + h*)               | K                 |
| range    | abs(z)      | a distance                    | w        | w (1 - h*/abs(z)) z      | w g g^T           |
| bearing  | g = z/abs(z)| a unit vector, tail to head   | w abs(z) | -w P h*, P = I - g g^T   | w P/abs(z)        |

The disagreement is D^T c, where D is the coboundary of z. A directed edge pulls its tail alone: D^T loses the head's
columns, and H is not symmetric. For positions and ranges, c is the derivative of the energy 1/2 |h - h*|_K^2. For
bearings there is no such energy, because the weight depends on z. If z = 0 there is no direction, and a range or
bearing edge exerts no pull.

D^T M D is the matrix of Gauss-Newton. The Jacobian of the disagreement is H = D^T S D with the slope S = dc/dz,

    range      w ((1 - r/abs(z)) P + g g^T)
    bearing    w/abs(z) ((g . h*) P + g (P h*)^T),

If an edge fits (h = h*), S = M; otherwise they differ by the curvature of h. For bearings that do not fit, S is not
symmetric.
"""

import itertools
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse.linalg import splu

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import SheafError
from mjsheaf.sheaf.edges import Cochains
from mjsheaf.sheaf.sections import RANK_TOLERANCE
from mjsheaf.sheaf.sheaf import HarmonicExtension, Sheaf

Measure = Literal["position", "range", "bearing"]
MEASURES: tuple[Measure, ...] = ("position", "range", "bearing")
SOLVED_RANK_TOLERANCE = 1e-4
"""Relative tolerance of the rank of a Jacobian at a stationary point that was solved for.

Near a degenerate one, such as a line held by ranges, the disagreement grows with the cube of the distance. Where it is
rounding, 1e-14, the point is still about 2e-5 of the size of the team away, and so are the Jacobian's entries.
"""

FREE_MOTION = SOLVED_RANK_TOLERANCE**2
"""Size of an eigenvalue of H, relative to the largest, up to which its motion counts as free."""

UNIT_TOLERANCE = 1e-6
"""Largest difference of a desired bearing's length from 1; below it the vector is normalised."""

_DAMPING = 1e-8  # of H, relative to its largest diagonal entry: keeps free motions where they are
_CONVERGED = 1e-14  # of the pulls: a gradient of this size is rounding
_STATIONARY = 1e-9  # of the pulls: largest gradient of what counts as a stationary point
_STRAIGHT = 1e-3  # of the team's extent: longest step that needs no midpoint; ten times the tolerance of midpoints
_SMALLEST_STEP = 1e-15  # of the team's extent
_SLOW = 1e-12  # of the pulls: above it a gradient that hardly falls is no rounding
_TRIED = 4  # steps from one trial of Newton's method to the next
_LONGEST = 0.1  # of the team's extent: longest step of Newton's method
_ROUNDING = 1e-13
_EXACT = 1e-7  # of the team's extent: residual of edges that fit
_DENSE = 200  # largest number of free coordinates whose matrices are dense: sparse ones take 50 us an operation


@dataclass(frozen=True)
class NonlinearEdge:
    """An edge of a nonlinear sheaf; see the module for the symbols.

    Attributes:
        tail, head: Vertices.
        F_tail, F_head: Restriction maps, shapes (m, n_tail) and (m, n_head).
        weight: K, shape (m, m); a multiple of the identity unless positions are compared.
        offset: Desired value h*: of F_tail x_tail - F_head x_head for positions, shape (m,); a distance, shape (1,); or
            a unit vector, (m,). None for zero.
        measures: What is compared: position, range or bearing.
        directed: True if only the tail is pulled.
        lift: Constant part of z, shape (m,); None for zero. The offset of positions contains it.
    """

    tail: Any
    head: Any
    F_tail: Array
    F_head: Array
    weight: Array
    offset: Array | None = None
    measures: Measure = "position"
    directed: bool = False
    lift: Array | None = None

    @property
    def b(self) -> Array:
        """Term added to F_head x_head - F_tail x_tail: the desired value of positions, else the lift, shape (m,)."""
        added = self.offset if self.measures == "position" else self.lift
        return np.zeros(len(self.F_tail)) if added is None else added

    @property
    def desired(self) -> Array:
        """Desired value h*, of a bearing a unit vector to rounding; zero unless given."""
        if self.offset is None:
            return np.zeros(1)
        return self.offset / float(np.linalg.norm(self.offset)) if self.measures == "bearing" else self.offset


_Edge = TypeVar("_Edge", bound=NonlinearEdge)


def measure(measures: Measure, z: Array) -> tuple[Array, Array]:
    """Compute a range or bearing h at the relative position z, shape (m,), and its derivative; zero where z is.

    Returns:
        h, shape (1,) of a range, (m,) of a bearing; and J = dh/dz, shape (1, m) or (m, m).
    """
    length = float(np.linalg.norm(z))
    g = z / length if length > 0.0 else np.zeros_like(z)
    if measures == "range":
        return np.array([length]), g[None]
    J = (np.eye(len(z)) - np.outer(g, g)) / length if length > 0.0 else np.zeros((len(z), len(z)))
    return g, J


def linear_edge(edge: _Edge, z: Array) -> _Edge:
    """Return the edge that compares positions and agrees to first order with an edge at its z, shape (m,).

    Its maps are J F_tail and J F_head, J = dh/dz up to sign, and its weight is K there.
    """
    if edge.measures == "position":
        return replace(edge, offset=edge.b, lift=None)
    h, J = measure(edge.measures, z)
    if edge.measures == "range":
        weight = edge.weight[:1, :1]
        offset = J @ edge.b - edge.desired
    else:
        weight = edge.weight * (float(np.linalg.norm(z)) or 1.0)
        offset = J @ edge.b + h - edge.desired
    F_tail = J @ edge.F_tail
    F_head = J @ edge.F_head
    return replace(edge, F_tail=F_tail, F_head=F_head, weight=weight, offset=offset, measures="position", lift=None)


def linear_sheaf(stalks: Mapping[Any, int], edges: Sequence[NonlinearEdge]) -> Sheaf:
    """Return the sheaf of edges that compare positions, with their offsets; directed ones count as if they were not."""
    sheaf = Sheaf(stalks)
    sheaf.add_mixed_edges(
        [e.tail for e in edges],
        [e.head for e in edges],
        [e.F_tail for e in edges],
        [e.F_head for e in edges],
        offset=[e.b for e in edges],
        weight=[e.weight for e in edges],
    )
    return sheaf


def desired_value(measures: Measure, value: ArrayLike, m: int) -> Array:
    """Return a desired value as an array; a bearing is normalised.

    Raises:
        SheafError: It has another length, a range is not positive, or a bearing is not a unit vector.
    """
    found = np.atleast_1d(np.asarray(value, dtype=np.float64))
    size = 1 if measures == "range" else m
    if found.shape != (size,) or not np.isfinite(found).all():
        what = {"range": "a distance", "bearing": "a unit vector"}.get(measures, "a value for each row of the maps")
        raise SheafError(f"desired value has shape {found.shape}; expected ({size},), {what}")
    if measures == "range" and not found[0] > 0.0:
        raise SheafError(f"desired range is {found[0]:g}; expected a positive distance")
    if measures == "bearing":
        length = float(np.linalg.norm(found))
        if abs(length - 1.0) > UNIT_TOLERANCE:
            raise SheafError(
                f"desired bearing has the length {length:.9g}; expected a unit vector from tail to head, to "
                f"{UNIT_TOLERANCE:g}"
            )
        found = found / length
    return found


class StationaryProblem:
    """The equation H x = B y + c of a stationary point near which it is linearised, in the form of a Dirichlet problem.

    H is the Jacobian of a disagreement: it need be neither symmetric nor without negative eigenvalues.

    Attributes:
        H: Shape (n_W, n_W).
        B: Shape (n_W, n_U).
        symmetric: True if H is symmetric.
    """

    def __init__(self, jacobian: sparse.csr_array, x: Array, boundary: Array) -> None:
        """Linearise at a stationary point.

        Args:
            jacobian: Derivatives of the disagreement by free and boundary values, shape (n_W, n_W + n_U).
            x, boundary: Values there, shapes (n_W,) and (n_U,).
        """
        n = len(x)
        self.H = sparse.csr_array(jacobian[:, :n])
        self.B = sparse.csr_array(-jacobian[:, n:])
        skew = abs(self.H - self.H.T)
        self.symmetric = bool(skew.max() <= FREE_MOTION * abs(self.H).max()) if skew.nnz else True
        self._x = x
        self._boundary = boundary

    @cached_property
    def _singular(self) -> tuple[Array, Array, Array]:
        return np.linalg.svd(self.H.toarray())

    @cached_property
    def null_basis(self) -> Array:
        """Orthonormal basis of the motions that change nothing, shape (n_W, dimension)."""
        _, sizes, rows = self._singular
        return np.asarray(rows[np.count_nonzero(sizes > FREE_MOTION * sizes.max(initial=0.0)) :].T)

    @cached_property
    def sparse_null_basis(self) -> sparse.csc_array:
        """`null_basis` as a sparse array."""
        return sparse.csc_array(self.null_basis)

    @property
    def c(self) -> Array:
        """Constant part of the equation, shape (n_W,)."""
        return np.asarray(self.H @ self._x - self.B @ self._boundary)

    @property
    def eigenvalues(self) -> tuple[float, float]:
        """The smallest eigenvalue of H that is not that of a free motion, and the largest; 1 if H = 0."""
        values = self.eigenvectors[0][self.null_basis.shape[1] :]
        return (float(values[0]), float(values[-1])) if len(values) else (1.0, 1.0)

    @property
    def unique(self) -> bool:
        """True if the stationary point is isolated."""
        return self.null_basis.shape[1] == 0

    @cached_property
    def eigenvectors(self) -> tuple[Array, Array]:
        """Eigenvalues of H, ascending after those of free motions, and eigenvectors; orthonormal if H is symmetric.

        Of an asymmetric H the real parts of both.
        """
        H = self.H.toarray()
        if self.symmetric:
            values, vectors = np.linalg.eigh(0.5 * (H + H.T))
        else:
            each, right = np.linalg.eig(H)
            values = each.real
            vectors = right.real / np.linalg.norm(right.real, axis=0)
        order = np.argsort(np.where(np.abs(values) <= FREE_MOTION * np.abs(values).max(initial=0.0), -np.inf, values))
        return values[order], vectors[:, order]

    def solve(self, right_hand_side: ArrayLike) -> Array:
        """Compute the shortest x with H x = r for vectors r of shape (..., n_W), in the sense of least squares."""
        r = np.asarray(right_hand_side, dtype=np.float64)
        if r.shape[-1] > 600:  # singular values would take long
            solve = _factor_across(self.H, _DAMPING * float(np.abs(self.H.diagonal()).max()))
            return np.array([solve(each) for each in r.reshape(-1, r.shape[-1])]).reshape(r.shape)
        u, sizes, rows = self._singular
        kept = sizes > FREE_MOTION * sizes.max(initial=0.0)
        return np.asarray(((r @ u[:, kept]) / sizes[kept]) @ rows[kept])

    def extend(self, boundary: ArrayLike) -> Array:
        """Compute stationary points, shape (..., n_W), for boundary vectors of shape (..., n_U), to first order."""
        return np.asarray(self._x + self.solve((np.asarray(boundary) - self._boundary) @ self.B.T.toarray()))


class NonlinearSheaf:
    """A sheaf whose edges compare positions, ranges or bearings of vectors in the stalks of their ends."""

    def __init__(self, stalks: Mapping[Any, int], edges: Iterable[NonlinearEdge] = ()) -> None:
        """Make a sheaf; `stalks` maps each vertex to its dimension, in order, and `edges` fit these."""
        self._stalks = Cochains(stalks)
        self._dimension = dict(stalks)
        self.edges = list(edges)

    def add_edge(
        self,
        tail: Hashable,
        head: Hashable,
        F_tail: ArrayLike,
        F_head: ArrayLike,
        *,
        measures: Measure = "position",
        desired: ArrayLike | None = None,
        weight: ArrayLike = 1.0,
        lift: ArrayLike | None = None,
        directed: bool = False,
    ) -> int:
        """Add an edge and return its number.

        Args:
            tail, head: Vertices.
            F_tail, F_head: Restriction maps, shapes (m, n_tail) and (m, n_head).
            measures: What the edge compares.
            desired: Desired value: of F_tail x_tail - F_head x_head for positions (zero unless given), a distance, or
                the unit vector from tail to head.
            weight: A positive number, or for positions an SPD matrix (m, m).
            lift: Constant part of z, shape (m,); zero unless given.
            directed: True if only the tail is pulled.

        Raises:
            SheafError: An unknown vertex, a loop, a wrong shape, no desired range or bearing, or a bad value.
        """
        where = f"edge ({tail!r}, {head!r})"
        if measures not in MEASURES:
            raise SheafError(f"{where}: measures {measures!r}; expected one of {', '.join(MEASURES)}")
        if desired is None and measures != "position":
            raise SheafError(f"{where}: no desired {measures}; expected one")
        if np.ndim(weight) and measures != "position":
            raise SheafError(f"{where}: weight has shape {np.shape(weight)}; expected a positive number")
        plain = Sheaf(self._dimension)
        plain.add_edge(tail, head, F_tail, F_head, weight=weight)
        (own,) = plain.edges.bundles
        m = own.F_tail.shape[1]
        constant = np.zeros(m) if lift is None else np.asarray(lift, dtype=np.float64).reshape(m)
        offset = desired_value(measures, np.zeros(m) if desired is None else desired, m)
        if measures == "position":
            offset = offset + constant
        assert own.weight is not None
        edge = NonlinearEdge(
            tail, head, own.F_tail[0], own.F_head[0], own.weight[0], offset, measures, directed, constant
        )
        self.edges.append(edge)
        self.__dict__.pop("_arrays", None)
        return len(self.edges) - 1

    @cached_property
    def _arrays(self) -> "_Arrays":
        edges = self.edges
        none = np.zeros(0)
        sizes = np.array([len(e.F_tail) for e in edges], dtype=np.int64)
        first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        code = np.repeat([MEASURES.index(e.measures) for e in edges], sizes).astype(np.int64)
        moved, pulled = Sheaf(self._dimension), Sheaf(self._dimension)
        ends = [e.tail for e in edges], [e.head for e in edges]
        tails = [-e.F_tail for e in edges]
        moved.add_mixed_edges(*ends, tails, [-e.F_head for e in edges])
        pulled.add_mixed_edges(*ends, tails, [0.0 * e.F_head if e.directed else -e.F_head for e in edges])
        weights = [e.weight if e.measures == "position" else 0.0 * e.weight for e in edges]
        rows = [np.arange(begin, end) for begin, end in itertools.pairwise(first)]
        pairs = [np.stack([np.repeat(r, len(r)), np.tile(r, len(r))]) for r in rows]
        return _Arrays(
            D=moved.edges.delta,
            pulled=pulled.edges.delta,
            lift=np.concatenate([none, *(np.zeros(len(e.b)) if e.measures == "position" else e.b for e in edges)]),
            first=first,
            code=code,
            desired=np.concatenate([none, *(np.broadcast_to(e.desired, len(e.F_tail)) for e in edges)]),
            weight=np.where(code > 0, np.concatenate([none, *(np.diag(e.weight) for e in edges)]), 0.0),
            pairs=np.concatenate([np.zeros((2, 0), dtype=np.int64), *pairs], axis=1),
            K=np.concatenate([none, *(weight.ravel() for weight in weights)]),
            directed=any(e.directed for e in edges),
            conservative=not any(e.directed or e.measures == "bearing" for e in edges),
        )

    def pack(self, x: Any) -> Array:
        """Return a 0-cochain, given as a mapping or a vector, as a vector, shape (n,)."""
        return self._stalks.pack(x)

    def relative(self, x: Any) -> list[Array]:
        """Return z of every edge."""
        arrays = self._arrays
        return np.split(arrays.D @ self.pack(x) + arrays.lift, arrays.first[1:-1])

    def jacobian(self, x: Any) -> Sheaf:
        """Return the sheaf of the linear edges that agree with these to first order at x, with their offsets."""
        linear = [linear_edge(edge, z) for edge, z in zip(self.edges, self.relative(x), strict=True)]
        return linear_sheaf(self._dimension, linear)

    def misfits(self, x: Any) -> list[Array | None]:
        """Return S = dc/dz, shape (m_e, m_e), of every edge that does not fit at x; None where S is M.

        A difference that could only move what counts as a free motion is rounding.
        """
        arrays = self._arrays
        z = arrays.D @ self.pack(x) + arrays.lift
        exact = arrays.slope(z, arrays.desired)
        fitting = arrays.slope(z, arrays.measured(z))
        tolerance = FREE_MOTION * _largest(fitting)
        sizes = np.diff(arrays.first)
        of_each = (np.split(blocks, np.cumsum(sizes**2))[:-1] for blocks in (exact, exact - fitting))
        return [
            None if _largest(off) <= tolerance else block.reshape(m, m)
            for block, off, m in zip(*of_each, sizes.tolist(), strict=True)
        ]

    def desired_of(self, aims: Array) -> Array:
        """Return h* of every row, shape (T, m), from a vector of every edge (T, m), opposite to the desired z.

        h* of positions is the vector itself, that of ranges its length, and that of bearings its direction, turned
        round.
        """
        return np.where(self._arrays.code == 0, aims, self._arrays.measured(-aims))

    def residuals(self, x: Array, desired: Array | None = None) -> Array:
        """Compute |h - h*| of every edge at 0-cochains (T, n), shape (T, E); of a bearing times abs(z).

        `desired` has other values h* of every row, shape (T, m), one for each cochain.
        """
        arrays = self._arrays
        desired = arrays.desired if desired is None else desired
        z = (arrays.D @ x.T).T + arrays.lift
        off = z + desired
        if not arrays.code.any():  # every edge compares positions
            return np.sqrt(arrays.edge_totals(off * off))
        length = arrays.lengths(z)
        off = np.where(arrays.code == 0, off, z - length * desired)
        each = np.where(arrays.code == 1, np.abs(length - desired), arrays.lengths(off))
        return np.asarray(each[..., arrays.first[:-1]])

    def gradient(self, x: Any) -> Array:
        """Return D^T c of every vertex, shape (n,): the disagreement eta, against which the law moves agents."""
        arrays = self._arrays
        return np.asarray(arrays.pulled.T @ arrays.pull(arrays.D @ self.pack(x) + arrays.lift))

    def gradient_jacobian(self, x: Any) -> sparse.csr_array:
        """Return the Jacobian H = D^T S D of `gradient`, shape (n, n)."""
        arrays = self._arrays
        slope = arrays.slope(arrays.D @ self.pack(x) + arrays.lift, arrays.desired)
        return sparse.csr_array(arrays.pulled.T @ arrays.matrix(slope) @ arrays.D)

    def solver(self, boundary: Sequence[Hashable]) -> "StationarySolver":
        """Return what extends values on boundary vertices, in their order, for many of them."""
        U = self._stalks.columns_of(self._stalks.numbers(list(boundary)))
        W = self._stalks.columns_of(np.flatnonzero(self._stalks.free(list(boundary))))
        return StationarySolver(self._arrays, U, W)

    def harmonic_extension(self, boundary: Mapping[Any, ArrayLike], start: Any) -> HarmonicExtension:
        """Extend values of boundary vertices to a stationary point of the energy, by Gauss-Newton from `start`.

        If there are several stationary points, the result is one near the start. Free motions stay at their start, and
        `null_basis` has those that are free to first order.

        Args:
            boundary: Values of boundary vertices.
            start: Value of every vertex, as a mapping or a vector; values of boundary vertices are ignored.

        Raises:
            SheafError: The iteration does not converge.
        """
        known = {v: np.asarray(value, dtype=np.float64) for v, value in boundary.items()}
        solver = self.solver(list(known))
        x = self.pack(start).copy()
        x[solver.U] = np.concatenate([np.zeros(0), *known.values()])
        found = solver.settle(x[solver.W], x[solver.U], free=True)
        if not found.converged:
            raise SheafError("Gauss-Newton does not converge from this start; expected another")
        x[solver.W] = found.x
        if all(misfit is None for misfit in self.misfits(x)):
            basis = self.jacobian(x).relative_sections(list(known), rtol=RANK_TOLERANCE)
        else:
            basis = StationaryProblem(self.gradient_jacobian(x)[solver.W][:, solver.W], found.x, np.zeros(0)).null_basis
        values: Any = self._stalks.unpack(x)
        return HarmonicExtension(values, basis.shape[1] == 0, basis, 0.5 * found.residual**2)


@dataclass
class _Arrays:
    """All edges of a nonlinear sheaf, with m rows of z in all; see the module.

    Attributes:
        D: Coboundary of z, shape (m, n).
        pulled: The same without heads that are not pulled.
        lift: Shape (m,).
        first: First row of each edge, and m at the end, shape (E + 1,).
        code: Index in MEASURES of the edge of each row, shape (m,).
        desired: h*, of a range in each of its rows, shape (m,).
        weight: w of each row, shape (m,); 0 of edges that compare positions.
        pairs: Rows and columns of the edges' blocks in a matrix (m, m), shape (2, P).
        K: Weights of edges that compare positions in these blocks, shape (P,); 0 in those of others.
        directed: True if an edge is directed, so that neither H nor the matrix of Gauss-Newton is symmetric.
        conservative: True if c is the derivative of an energy at all ends: no edge is directed, none a bearing.
    """

    D: sparse.csr_array
    pulled: sparse.csr_array
    lift: Array
    first: IntArray
    code: IntArray
    desired: Array
    weight: Array
    pairs: IntArray
    K: Array
    directed: bool
    conservative: bool

    @cached_property
    def _edge(self) -> IntArray:
        """Edge of each row, shape (m,)."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))

    def edge_totals(self, values: Array) -> Array:
        """Return the sum over the rows of each edge, shape (..., E), of values of every row, shape (..., m)."""
        return np.asarray(np.add.reduceat(values, self.first[:-1], axis=-1))

    def totals(self, values: Array) -> Array:
        """Return the sum over the rows of each edge in each of them, shape (..., m)."""
        return np.asarray(self.edge_totals(values)[..., self._edge])

    def lengths(self, z: Array) -> Array:
        """Return abs(z) of the edge of each row, shape (..., m)."""
        return np.sqrt(self.totals(z * z))

    def directions(self, z: Array) -> tuple[Array, Array, Array]:
        """Return g, 1 / abs(z) and abs(z) of each row; the first two are 0 where the last is."""
        length = self.lengths(z)
        inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
        return z * inverse, inverse, length

    def measured(self, z: Array) -> Array:
        """Return h of the edge of each row, shape (..., m): a range in each of its rows, of positions g."""
        g, _, length = self.directions(z)
        return np.where(self.code == 1, length, g)

    def pull(self, z: Array) -> Array:
        """Return c, shape (m,)."""
        g, inverse, _ = self.directions(z)
        borne = np.where(inverse > 0.0, self.totals(g * self.desired) * g - self.desired, 0.0)
        nonlinear = self.weight * np.where(self.code == 1, z - self.desired * g, borne)
        return self.product(self.K, z + self.desired) + nonlinear

    def slope(self, z: Array, desired: Array) -> Array:
        """Return the blocks of S = dc/dz, shape (P,), for desired values (m,); those of M for the values measured."""
        g, inverse, _ = self.directions(z)
        r, s = self.pairs
        outer = g[r] * g[s]
        across = (r == s) - outer
        along = self.totals(g * desired)
        ranged = np.where(inverse[r] > 0.0, across + outer - desired[r] * inverse[r] * across, 0.0)
        borne = inverse[r] * (along[r] * across + g[r] * (desired[s] - along[s] * g[s]))
        return np.asarray(self.K + self.weight[r] * np.where(self.code[r] == 1, ranged, borne))

    def matrix(self, blocks: Array) -> sparse.csr_array:
        """Return the matrix of blocks (P,), shape (m, m); pairs are in the order of its rows."""
        r, s = self.pairs
        m = len(self.code)
        return sparse.csr_array((blocks, s, np.searchsorted(r, np.arange(m + 1))), shape=(m, m))

    def product(self, blocks: Array, z: Array) -> Array:
        """Return the product of that matrix with a vector (m,)."""
        r, s = self.pairs
        return np.asarray(np.bincount(r, blocks * z[s], len(z)), np.float64)

    def residual(self, z: Array) -> float:
        """Return the K-norm of h - h* over all edges."""
        e = z + self.desired
        g, _, length = self.directions(z)
        scale = np.where(self.code == 1, 1.0 / np.diff(self.first)[self._edge], length)
        squares = scale * (np.where(self.code == 1, length, g) - self.desired) ** 2
        return float(np.sqrt(e @ self.product(self.K, e) + self.weight @ squares))


Factored: TypeAlias = Callable[[Array], Array]
"""Solution of a linear problem for a right-hand side (n,), by factors of its matrix."""


def _factor(H: sparse.csr_array | Array, shift: float = 0.0) -> Factored:
    """Factor H + shift I."""
    if not isinstance(H, np.ndarray):
        return splu(sparse.csc_array(H + shift * sparse.eye_array(H.shape[0]) if shift else H)).solve
    factors = lu_factor(H + shift * np.eye(len(H)), check_finite=False)
    return lambda right: np.asarray(lu_solve(factors, right, check_finite=False))


def _factor_across(H: sparse.csr_array | Array, shift: float) -> Factored:
    """Factor H, which need not be symmetric, for steps s that minimise |H s - r|^2 + shift^2 |s|^2.

    A solution of (H + shift) s = r has the part of r outside the range of H, over the shift, along what is free. This
    one has none. [[shift, H], [H^T, -shift]] is solved instead of the normal equations, whose condition is the square.
    """
    n = H.shape[0]
    shift = shift or 1.0
    identity, block = (np.eye, np.block) if isinstance(H, np.ndarray) else (sparse.eye_array, sparse.block_array)
    damped = shift * identity(n)
    solve = _factor(block([[damped, H], [H.T, -damped]]))
    return lambda right: solve(np.concatenate([right, np.zeros(n)]))[n:]


class Settled(NamedTuple):
    """A stationary point.

    Attributes:
        x: Values of the free vertices, stacked, shape (n_W,).
        converged: True if the gradient vanishes there.
        residual: Norm of h - h* over all edges, with weights K.
    """

    x: Array
    converged: bool
    residual: float


class StationarySolver:
    """Stationary points of the energy with some vertices held: D^T c = 0 on the others, by damped Gauss-Newton.

    H is factored again only where the gradient falls by less than a factor of ten, so that a path of boundary values
    costs a few triangular solutions a sample.

    Attributes:
        arrays: The edges.
        U, W: Coordinates of the boundary, in the order of boundary vectors, and the others.
    """

    def __init__(self, arrays: _Arrays, U: IntArray, W: IntArray) -> None:
        self.arrays = arrays
        self.U = U
        self.W = W
        self._moved = self._form(arrays.D[:, W])
        self._pulled = self._form(arrays.pulled[:, W].T)
        self._held = arrays.D[:, U]
        self._stiffest = _largest(arrays.weight) + _largest(arrays.K)
        self._extent = 1.0  # of the team and of its desired values, at the present sample
        self._base = arrays.lift  # z where x = 0, at the present sample
        self._solve: Factored | None = None

    def relative(self, x: Array, boundary: Array) -> Array:
        """Return z of all edges, shape (m,)."""
        return np.asarray(self._moved @ x + (self._held @ boundary + self.arrays.lift))

    def settle(self, x: Array, boundary: Array, *, free: bool = False) -> Settled:
        """Find a stationary point from x, shape (n_W,), with boundary values (n_U,).

        If edges do not fit together, Gauss-Newton is slow or does not converge. The last steps then use Newton's
        method, with the Jacobian of the disagreement, if necessary from a point to which the law moves from x.

        With `free` motions H is factored at every step, because an old factor would act on directions that are free
        now. Bearings are then linearised at the midpoints of the first long steps, so that a free scale stays that of
        the start.
        """
        arrays = self.arrays
        self._base = self._held @ boundary + arrays.lift
        z, gradient = self._at(x)
        self._extent = _largest(z) + _largest(arrays.desired)
        extent, scale = self._extent, self._stiffest * self._extent
        damping = _DAMPING
        start = x
        self._solve = None if free else self._solve
        for iteration in range(200):  # steps of Gauss-Newton at most
            size = _largest(gradient)
            if size <= _CONVERGED * scale or damping > 1e6:
                break
            stale = self._solve is not None
            if self._solve is None:
                self._solve = self._factored(z, damping)
            step = _limited(self._solve(-gradient), extent)
            # Near a point reflection more than 20 steps from midpoints would be needed.
            if free and iteration < 20 and (arrays.code == 2).any() and _largest(step) > _STRAIGHT * extent:
                step = self._midpoint_step(x, step, damping)
            moved, after = self._at(x + step)
            worse = self._is_worse(z, moved, gradient, after)
            slow = worse or _largest(after) > 0.1 * size  # then H is factored again
            if slow or free:
                self._solve = None
            if slow and not stale and iteration % _TRIED == 0 and size > _SLOW * scale:
                exact = self._newton(x)
                if exact is not None and exact.residual > _EXACT * self._stiffest**0.5 * extent:
                    return exact  # where edges fit, Gauss-Newton finds the nearest point
            if worse:
                damping = damping if stale else max(10.0 * damping, 1e-4)
                continue
            x = x + step
            z = moved
            gradient = after
            damping = max(0.1 * damping, _DAMPING)
            if _largest(step) <= _SMALLEST_STEP * extent:
                break
        found = self._settled(x)
        if not found.converged:
            followed = self._follow_law(start)
            if followed is not None:
                return followed
        return found

    def _form(self, matrix: sparse.sparray) -> sparse.csr_array | Array:
        """Return a matrix in the form in which those of this problem are."""
        return matrix.toarray() if len(self.W) <= _DENSE else sparse.csr_array(matrix)

    def _at(self, x: Array) -> tuple[Array, Array]:
        """Return z of all edges, shape (m,), and the gradient, shape (n_W,), at x, shape (n_W,)."""
        z = self._moved @ x + self._base
        return z, self._pulled @ self.arrays.pull(z)

    def _jacobian(self, z: Array, desired: Array) -> sparse.csr_array | Array:
        """Return D^T S D, shape (n_W, n_W); see `_Arrays.slope`."""
        arrays = self.arrays
        return self._pulled @ (arrays.matrix(arrays.slope(z, desired)) @ self._moved)

    def _settled(self, x: Array) -> Settled:
        """Return x (n_W,) with its residual, and whether it is stationary."""
        z, gradient = self._at(x)
        return Settled(x, _largest(gradient) <= _STATIONARY * self._stiffest * self._extent, self.arrays.residual(z))

    def _follow_law(self, x: Array) -> Settled | None:
        """Return the stationary point to which the law moves from x (n_W,), in implicit steps; None if it finds none.

        A step is that of the implicit Euler method, as long as the disagreement allows, x' = -D^T c.
        """
        z, gradient = self._at(x)
        shift = self._stiffest
        for k in range(120):  # steps along the law at most
            exact = None if k % _TRIED else self._newton(x)
            if exact is not None:
                return exact
            size = float(np.linalg.norm(gradient))
            step = _factor(self._jacobian(z, self.arrays.desired), shift)(-gradient)
            x = x + _limited(step, _LONGEST * self._extent)
            z, gradient = self._at(x)
            shift *= min(max(float(np.linalg.norm(gradient)) / size, 0.5), 2.0)
        return None

    def _newton(self, x: Array) -> Settled | None:
        """Return the stationary point to which Newton's method converges at once from x (n_W,); None if it does not.

        Its steps are orthogonal to the free motions of H, and each of them reduces the disagreement to a fraction. None
        too if the law moves away from that point: it lies uphill.
        """
        scale = self._stiffest * self._extent
        first, uphill = self._at(x)
        z = first
        gradient = uphill
        start = x
        for k in range(8):  # steps of Newton's method at most
            size = _largest(gradient)
            H = self._jacobian(z, self.arrays.desired)
            step = _factor_across(H, _DAMPING * _largest(H.diagonal()))(-gradient)
            if not _largest(step) <= _LONGEST * self._extent:
                return None
            z, gradient = self._at(x + step)
            falls = _largest(gradient) <= 0.25 * size  # as where the method converges at once
            if not falls and not (k and size <= _SLOW * scale):
                return None
            if falls:
                x = x + step
            if not falls or _largest(gradient) <= _CONVERGED * scale:
                break
        else:
            return None
        if self.arrays.conservative:
            away = self._is_worse(first, self._at(x)[0], uphill, uphill)
        else:
            away = float(uphill @ (x - start)) >= 0.0
        return None if away else self._settled(x)

    def _midpoint_step(self, x: Array, step: Array, damping: float) -> Array:
        """Return the step from x (n_W,) that Gauss-Newton takes if it linearises at the midpoint m of a first step.

        It is orthogonal to what is free at m. Where scaling about c is free, (m - c) . step = 0, so |x - c| stays as
        it does in the law. NaN if the midpoints do not converge.
        """
        arrays = self.arrays
        # The largest changes of the step from one midpoint to the next: they halve.
        for longest in self._extent * 0.5 ** np.arange(14):
            z, gradient = self._at(x + 0.5 * step)
            bent = arrays.product(arrays.slope(z, arrays.measured(z)), self._moved @ step)
            last = step
            step = _limited(self._factored(z, damping)(self._pulled @ (0.5 * bent) - gradient), self._extent)
            change = _largest(step - last)
            if change <= 0.1 * _STRAIGHT * self._extent:
                return step
            if change > longest:
                break
        return np.full_like(step, np.nan)

    def _factored(self, z: Array, damping: float) -> Factored:
        """Factor the damped matrix of Gauss-Newton."""
        H = self._jacobian(z, self.arrays.measured(z))
        shift = damping * max(float(H.diagonal().max(initial=0.0)), _DAMPING * self._stiffest)
        return _factor_across(H, shift) if self.arrays.directed else _factor(H, shift)

    def _is_worse(self, z: Array, moved: Array, before: Array, after: Array) -> bool:
        """Return True if a step raises the energy or, where there is none, more than doubles the gradient."""
        scale = self._stiffest * self._extent
        if not (np.isfinite(moved).all() and np.isfinite(after).all()):
            return True
        if self.arrays.conservative:
            energy, lowered = (self.arrays.residual(at) ** 2 for at in (z, moved))
            return lowered > energy + _ROUNDING * scale * scale
        return float(np.linalg.norm(after)) > 2.0 * float(np.linalg.norm(before)) + _ROUNDING * scale


def _largest(x: Array) -> float:
    """Return the largest size of an entry; 0 without entries."""
    return float(np.abs(x).max(initial=0.0))


def _limited(step: Array, longest: float) -> Array:
    """Return a step, shortened until no coordinate changes by more than the longest."""
    return step * min(1.0, longest / (_largest(step) or 1.0))
