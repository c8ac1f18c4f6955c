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

which is M where an edge fits, h = h*, and differs from it by the curvature of h elsewhere. For bearings that do not
fit, S is not symmetric.
"""

import itertools
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse.linalg import splu

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import SheafError
from mjsheaf.sheaf.edges import Cochains, assembled
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
_FIRST_DAMPING = 1e-4
_MAX_DAMPING = 1e6
_STALE_ABOVE = 0.1  # ratio of two gradients above which H is factored again
_MAX_STEPS = 200
_CONVERGED = 1e-14  # of the pulls: a gradient of this size is rounding
_STATIONARY = 1e-9  # of the pulls: largest gradient of what counts as a stationary point
_CONTRACTION = 0.5 ** np.arange(14)  # of the team's extent: largest changes of steps, one midpoint after the other
_MIDPOINTS = 20  # steps that are taken from their midpoints; near a point reflection more would be needed
_STRAIGHT = 1e-3  # of the team's extent: longest step that needs no midpoint; ten times the tolerance of midpoints
_SMALLEST_STEP = 1e-15  # of the team's extent
_SLOW = 1e-12  # of the pulls: above it a gradient that hardly falls is no rounding
_MAX_NEWTON = 8
_MAX_FOLLOWED = 120  # steps along the law
_TRIED = 4  # steps from one trial of Newton's method to the next
_NEWTON = 0.25  # ratio of two gradients up to which Newton's method converges at once
_LONGEST = 0.1  # of the team's extent: longest step of Newton's method
_ROUNDING = 1e-13
_MAX_DENSE = 600  # largest number of free coordinates whose singular values serve to solve
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


class LinearMaps(NamedTuple):
    """A linear edge that agrees to first order with an edge at some z.

    Attributes:
        F_tail, F_head: J F_tail and J F_head, J = dh/dz up to sign.
        weight: K there.
        offset: Desired value of F_tail x_tail - F_head x_head.
    """

    F_tail: Array
    F_head: Array
    weight: Array
    offset: Array


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


def linear_maps(edge: NonlinearEdge, z: Array) -> LinearMaps:
    """Linearise an edge at the relative position z, shape (m,)."""
    if edge.measures == "position":
        return LinearMaps(edge.F_tail, edge.F_head, edge.weight, edge.b)
    h, J = measure(edge.measures, z)
    if edge.measures == "range":
        weight = edge.weight[:1, :1]
        offset = J @ edge.b - edge.desired
    else:
        weight = edge.weight * (float(np.linalg.norm(z)) or 1.0)
        offset = J @ edge.b + h - edge.desired
    return LinearMaps(J @ edge.F_tail, J @ edge.F_head, weight, offset)


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
        if r.shape[-1] > _MAX_DENSE:
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
        return _pack(self._dimension, self.edges)

    def pack(self, x: Any) -> Array:
        """Return a 0-cochain, given as a mapping or a vector, as a vector, shape (n,)."""
        return self._stalks.pack(x)

    def relative(self, x: Any) -> list[Array]:
        """Return z of every edge."""
        arrays = self._arrays
        return np.split(arrays.D @ self.pack(x) + arrays.lift, arrays.first[1:-1])

    def jacobian(self, x: Any) -> Sheaf:
        """Return the sheaf of the linear edges that agree with these to first order at x, with their offsets."""
        sheaf = Sheaf(self._dimension)
        linear = [linear_maps(edge, z) for edge, z in zip(self.edges, self.relative(x), strict=True)]
        sheaf.add_mixed_edges(
            [e.tail for e in self.edges],
            [e.head for e in self.edges],
            [e.F_tail for e in linear],
            [e.F_head for e in linear],
            offset=[e.offset for e in linear],
            weight=[e.weight for e in linear],
        )
        return sheaf

    def misfits(self, x: Any) -> list[Array | None]:
        """Return S = dc/dz, shape (m_e, m_e), of every edge that does not fit at x; None where S is M.

        A difference that could only move what counts as a free motion is rounding.
        """
        arrays = self._arrays
        z = arrays.D @ self.pack(x) + arrays.lift
        exact, fitting = (sparse.csr_array(of(z, arrays.K)) for of in (arrays.slope, arrays.metric))
        tolerance = FREE_MOTION * _largest(fitting.data)
        rows = [slice(begin, end) for begin, end in itertools.pairwise(arrays.first.tolist())]
        fits = [_largest((exact[r, r] - fitting[r, r]).data) <= tolerance for r in rows]
        return [None if one else exact[r, r].toarray() for one, r in zip(fits, rows, strict=True)]

    def desired_of(self, aims: Array) -> Array:
        """Return h* of every row, shape (T, m), from a vector of every edge (T, m), opposite to the desired z.

        h* of positions is the vector itself, that of ranges its length, and that of bearings its direction, turned
        round.
        """
        length = self._arrays.lengths(aims)
        bearing = np.divide(-aims, length, out=np.zeros_like(aims), where=length > 0.0)
        return np.where(self._arrays.code == 0, aims, np.where(self._arrays.code == 1, length, bearing))

    def residuals(self, x: Array, desired: Array | None = None) -> Array:
        """Compute |h - h*| of every edge at 0-cochains (T, n), shape (T, E); of a bearing times abs(z).

        `desired` has other values h* of every row, shape (T, m), one for each cochain.
        """
        arrays = self._arrays
        desired = arrays.desired if desired is None else desired
        z = (arrays.D @ x.T).T + arrays.lift
        off = np.where(arrays.code == 0, z + desired, z - arrays.lengths(z) * desired)
        begin = arrays.first[:-1]
        of_range = np.abs(arrays.norms(z) - desired[..., begin])
        return np.where(arrays.code[begin] == 1, of_range, arrays.norms(off))

    def gradient(self, x: Any) -> Array:
        """Return D^T c of every vertex, shape (n,): the disagreement eta, against which the law moves agents."""
        arrays = self._arrays
        return np.asarray(arrays.pulled.T @ arrays.pull(arrays.D @ self.pack(x) + arrays.lift))

    def gradient_jacobian(self, x: Any) -> sparse.csr_array:
        """Return the Jacobian H = D^T S D of `gradient`, shape (n, n)."""
        arrays = self._arrays
        slope = arrays.slope(arrays.D @ self.pack(x) + arrays.lift, arrays.K)
        return sparse.csr_array(arrays.pulled.T @ slope @ arrays.D)

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
        weight: w of each row, shape (m,); 0 where K is in `K`.
        K: Weights of edges that compare positions, shape (m, m).
        pairs: Rows and columns of the blocks of range and bearing edges, shape (2, P).
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
    K: sparse.csr_array
    pairs: IntArray
    directed: bool
    conservative: bool

    def norms(self, z: Array) -> Array:
        """Return the norm of each edge's part of z (..., m), shape (..., E)."""
        if not z.size:
            return np.zeros((*z.shape[:-1], len(self.first) - 1))
        return np.asarray(np.sqrt(np.add.reduceat(z * z, self.first[:-1], axis=-1)))

    def lengths(self, z: Array) -> Array:
        """Return abs(z) of the edge of each row, shape (..., m)."""
        return np.repeat(self.norms(z), np.diff(self.first), axis=-1)

    def directions(self, z: Array) -> tuple[Array, Array]:
        """Return g and 1 / abs(z) of each row; 0 where abs(z) is 0."""
        length = self.lengths(z)
        inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
        return z * inverse, inverse

    def along(self, g: Array) -> Array:
        """Return g . h* of the edge of each row."""
        if not len(g):
            return g
        return np.asarray(np.repeat(np.add.reduceat(g * self.desired, self.first[:-1]), np.diff(self.first)))

    def pull(self, z: Array) -> Array:
        """Return c, shape (m,)."""
        g, _ = self.directions(z)
        ranged = np.where(self.lengths(z) > 0.0, z - self.desired * g, 0.0)
        borne = np.where(self.lengths(z) > 0.0, self.along(g) * g - self.desired, 0.0)
        nonlinear = self.weight * np.where(self.code == 1, ranged, borne)
        return np.asarray(self.K @ (z + self.desired) + nonlinear)

    def metric(self, z: Array, K: sparse.csr_array | Array) -> sparse.csr_array | Array:
        """Return M, shape (m, m), in the form of K."""
        g, inverse = self.directions(z)
        r, s = self.pairs
        outer = g[r] * g[s]
        return self._with_blocks(K, np.where(self.code[r] == 1, outer, ((r == s) - outer) * inverse[r]))

    def slope(self, z: Array, K: sparse.csr_array | Array) -> sparse.csr_array | Array:
        """Return S = dc/dz, shape (m, m), in the form of K."""
        g, inverse = self.directions(z)
        r, s = self.pairs
        outer = g[r] * g[s]
        across = (r == s) - outer
        along = self.along(g)
        ranged = np.where(inverse[r] > 0.0, across + outer - self.desired[r] * inverse[r] * across, 0.0)
        borne = inverse[r] * (along[r] * across + g[r] * (self.desired[s] - along[s] * g[s]))
        return self._with_blocks(K, np.where(self.code[r] == 1, ranged, borne))

    def _with_blocks(self, K: sparse.csr_array | Array, blocks: Array) -> sparse.csr_array | Array:
        """Add weighted blocks of the range and bearing edges to K, in its form."""
        r, s = self.pairs
        weighted = self.weight[r] * blocks
        if not isinstance(K, np.ndarray):
            return sparse.csr_array(K + sparse.coo_array((weighted, (r, s)), shape=K.shape))
        M = K.copy()
        M[r, s] += weighted  # each pair is there once
        return M

    def residual(self, z: Array) -> float:
        """Return the K-norm of h - h* over all edges."""
        length = self.lengths(z)
        g, _ = self.directions(z)
        e = z + self.desired
        each = 1.0 / np.repeat(np.diff(self.first), np.diff(self.first))
        ranged = (length - self.desired) ** 2 * each
        borne = length * (g - self.desired) ** 2
        return float(np.sqrt(e @ (self.K @ e) + self.weight @ np.where(self.code == 1, ranged, borne)))


def _pack(stalks: Mapping[Any, int], edges: Sequence[NonlinearEdge]) -> _Arrays:
    """Pack the edges of a sheaf with these stalks."""
    none = np.zeros(0)
    sizes = np.array([len(e.F_tail) for e in edges], dtype=np.int64)
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    m = int(first[-1])
    code = np.repeat([MEASURES.index(e.measures) for e in edges], sizes).astype(np.int64)
    moved, pulled = Sheaf(stalks), Sheaf(stalks)
    ends = [e.tail for e in edges], [e.head for e in edges]
    tails = [-e.F_tail for e in edges]
    moved.add_mixed_edges(*ends, tails, [-e.F_head for e in edges])
    pulled.add_mixed_edges(*ends, tails, [0.0 * e.F_head if e.directed else -e.F_head for e in edges])
    rows = [np.arange(begin, end) for begin, end in itertools.pairwise(first)]
    linear = [(r[:, None], r[None], e.weight) for e, r in zip(edges, rows, strict=True) if e.measures == "position"]
    curved = [r for e, r in zip(edges, rows, strict=True) if e.measures != "position"]
    pairs = [np.stack([np.repeat(r, len(r)), np.tile(r, len(r))]) for r in curved]
    return _Arrays(
        D=moved.edges.delta,
        pulled=pulled.edges.delta,
        lift=np.concatenate([none, *(np.zeros(len(e.b)) if e.measures == "position" else e.b for e in edges)]),
        first=first,
        code=code,
        desired=np.concatenate([none, *(np.broadcast_to(e.desired, len(e.F_tail)) for e in edges)]),
        weight=np.where(code > 0, np.concatenate([none, *(np.diag(e.weight) for e in edges)]), 0.0),
        K=assembled(linear, (m, m)).tocsr(),
        pairs=np.concatenate([np.zeros((2, 0), dtype=np.int64), *pairs], axis=1),
        directed=any(e.directed for e in edges),
        conservative=not any(e.directed or e.measures == "bearing" for e in edges),
    )


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
    if isinstance(H, np.ndarray):
        solve = _factor(np.block([[shift * np.eye(n), H], [H.T, -shift * np.eye(n)]]))
    else:
        damped = shift * sparse.eye_array(n)
        solve = _factor(sparse.block_array([[damped, H], [H.T, -damped]]))
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
        small = len(W) <= _DENSE
        parts = (arrays.D[:, W], arrays.pulled[:, W].T, arrays.K)
        self._moved, self._pulled, self._K = (part.toarray() if small else sparse.csr_array(part) for part in parts)
        self._held = arrays.D[:, U]
        self._solve: Factored | None = None

    def relative(self, x: Array, boundary: Array) -> Array:
        """Return z of all edges, shape (m,)."""
        return np.asarray(self._moved @ x + (self._held @ boundary + self.arrays.lift))

    def settle(self, x: Array, boundary: Array, *, free: bool = False) -> Settled:
        """Find a stationary point from x, shape (n_W,), with boundary values (n_U,).

        Where edges do not fit together, Gauss-Newton is slow or does not converge. Newton's method, with the Jacobian
        of the disagreement, then takes the last steps, if need be from a point to which the law moves from x.

        With `free` motions H is factored at every step: an old one would push what is free now. Bearings are then
        linearised at the midpoints of the first long steps, so that a scale that is free stays that of the start.
        """
        arrays = self.arrays
        base = self._held @ boundary + arrays.lift
        z = self._moved @ x + base
        gradient = self._pulled @ arrays.pull(z)
        stiffest = _largest(arrays.weight) + _largest(arrays.K.data)
        extent = _largest(z) + _largest(arrays.desired)
        scales = (_DAMPING, stiffest, extent)
        damping = _DAMPING
        start = x
        self._solve = None if free else self._solve
        for iteration in range(_MAX_STEPS):
            size = _largest(gradient)
            if size <= _CONVERGED * stiffest * extent or damping > _MAX_DAMPING:
                break
            stale = self._solve is not None
            if self._solve is None:
                self._solve = self._factored(z, damping, stiffest)
            step = _limited(self._solve(-gradient), extent)
            if free and iteration < _MIDPOINTS and (arrays.code == 2).any() and _largest(step) > _STRAIGHT * extent:
                step = self._midpoint_step(x, step, base, (damping, stiffest, extent))
            moved = self._moved @ (x + step) + base
            after = self._pulled @ arrays.pull(moved)
            worse = self._is_worse(z, moved, gradient, after, stiffest * extent)
            slow = worse or _largest(after) > _STALE_ABOVE * size
            if slow or free:
                self._solve = None
            if slow and not stale and iteration % _TRIED == 0 and size > _SLOW * stiffest * extent:
                exact = self._newton(x, base, scales)
                if exact is not None and arrays.residual(self._moved @ exact + base) > _EXACT * stiffest**0.5 * extent:
                    return self._settled(exact, base, scales)  # where edges fit, Gauss-Newton finds the nearest point
            if worse:
                damping = damping if stale else max(10.0 * damping, _FIRST_DAMPING)
                continue
            x = x + step
            z = moved
            gradient = after
            damping = max(0.1 * damping, _DAMPING)
            if _largest(step) <= _SMALLEST_STEP * extent:
                break
        found = self._settled(x, base, scales)
        exact = None if found.converged else self._follow_law(start, base, scales)
        return found if exact is None else self._settled(exact, base, scales)

    def _settled(self, x: Array, base: Array, scales: tuple[float, float, float]) -> Settled:
        """Return x (n_W,) with its residual, and whether it is stationary; see `_newton` for the arguments."""
        _, stiffest, extent = scales
        z = self._moved @ x + base
        gradient = self._pulled @ self.arrays.pull(z)
        return Settled(x, _largest(gradient) <= _STATIONARY * stiffest * extent, self.arrays.residual(z))

    def _follow_law(self, x: Array, base: Array, scales: tuple[float, float, float]) -> Array | None:
        """Return the stationary point to which the law moves from x (n_W,), in implicit steps; None if it finds none.

        A step is that of the implicit Euler method, as long as the disagreement allows, x' = -D^T c.
        """
        _, stiffest, extent = scales
        z = self._moved @ x + base
        gradient = self._pulled @ self.arrays.pull(z)
        shift = stiffest
        for k in range(_MAX_FOLLOWED):
            exact = None if k % _TRIED else self._newton(x, base, scales)
            if exact is not None:
                return exact
            H = self._pulled @ self.arrays.slope(z, self._K) @ self._moved
            size = float(np.linalg.norm(gradient))
            x = x + _limited(_factor(H, shift)(-gradient), _LONGEST * extent)
            z = self._moved @ x + base
            gradient = self._pulled @ self.arrays.pull(z)
            shift *= min(max(float(np.linalg.norm(gradient)) / size, 0.5), 2.0)
        return None

    def _newton(self, x: Array, base: Array, scales: tuple[float, float, float]) -> Array | None:
        """Return the stationary point to which Newton's method converges at once from x (n_W,); None if it does not.

        Its steps are orthogonal to the free motions of H, and each of them reduces the disagreement to a fraction. None
        too if the law moves away from that point: it lies uphill.

        Args:
            x: Start.
            base: z of all edges where x is 0.
            scales: Damping, stiffest weight and extent of the team.
        """
        damping, stiffest, extent = scales
        first = self._moved @ x + base
        z = first
        start = x
        uphill = gradient = self._pulled @ self.arrays.pull(z)
        for k in range(_MAX_NEWTON):
            size = _largest(gradient)
            H = self._pulled @ self.arrays.slope(z, self._K) @ self._moved
            step = _factor_across(H, damping * float(np.abs(H.diagonal()).max(initial=0.0)))(-gradient)
            if not _largest(step) <= _LONGEST * extent:
                return None
            z = self._moved @ (x + step) + base
            gradient = self._pulled @ self.arrays.pull(z)
            falls = _largest(gradient) <= _NEWTON * size
            if not falls and not (k and size <= _SLOW * stiffest * extent):
                return None
            if falls:
                x = x + step
            if not falls or _largest(gradient) <= _CONVERGED * stiffest * extent:
                break
        else:
            return None
        if self.arrays.conservative:
            away = self._is_worse(first, self._moved @ x + base, uphill, uphill, stiffest * extent)
        else:
            away = float(uphill @ (x - start)) >= 0.0
        return None if away else x

    def _midpoint_step(self, x: Array, step: Array, base: Array, scales: tuple[float, float, float]) -> Array:
        """Return the step from x (n_W,) that Gauss-Newton takes if it linearises at the midpoint m of the step.

        It is orthogonal to what is free at m. Where scaling about c is free, (m - c) . step = 0, so |x - c| stays as
        it does in the law. NaN if the midpoints do not converge.

        Args:
            x, step: Start, and a first step from there.
            base: z of all edges where x is 0.
            scales: Damping, stiffest weight and extent of the team.
        """
        damping, stiffest, extent = scales
        for longest in extent * _CONTRACTION:
            z = self._moved @ (x + 0.5 * step) + base
            aim = self._pulled @ (0.5 * (self.arrays.metric(z, self._K) @ (self._moved @ step)) - self.arrays.pull(z))
            last = step
            step = _limited(self._factored(z, damping, stiffest)(aim), extent)
            change = _largest(step - last)
            if change <= 0.1 * _STRAIGHT * extent:
                return step
            if change > longest:
                break
        return np.full_like(step, np.nan)

    def _factored(self, z: Array, damping: float, stiffest: float) -> Factored:
        H = self._pulled @ self.arrays.metric(z, self._K) @ self._moved
        shift = damping * max(float(H.diagonal().max(initial=0.0)), _DAMPING * stiffest)
        return _factor_across(H, shift) if self.arrays.directed else _factor(H, shift)

    def _is_worse(self, z: Array, moved: Array, before: Array, after: Array, scale: float) -> bool:
        """Return True if a step raises the energy or, where there is none, more than doubles the gradient."""
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
