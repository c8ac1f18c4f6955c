"""Random sheaves and teams for the laws; sheaves are kept as plain lists, so that oracles need none of the library.

Maps, offsets and weights have small whole entries: ranks are then exact, kernels are common, and a failing example is
short. Stalks have mixed dimensions, maps are rectangular, edges may be parallel, graphs may be disconnected.
"""

import itertools
import os
from collections.abc import Hashable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.stats import ortho_group

from mjsheaf import Sheaf
from mjsheaf.team import Edge, Member, Team
from tests.builders import hold, make_edge, make_member, make_team

Array = NDArray[np.float64]


def scaled(count: int) -> int:
    """Return the number of examples where others have 60: in proportion."""
    return count * settings().max_examples // 60


def examples(count: int) -> settings:
    """Return settings for a law that needs `count` examples where others have 60."""
    return settings(max_examples=scaled(count))


SEED = int(os.environ.get("MJSHEAF_SEED", "0"))
"""Of `make test-all`, which prints it: random studies begin with other cases."""


def cases(every: int, usual: int) -> range:
    """Return the numbers of the random cases of a long study; `tried` says how many."""
    return range(10_000 * SEED, 10_000 * SEED + tried(every, usual))


def tried(every: int, usual: int) -> int:
    """Return the number of random cases of a long study: `every` one with the profile `all`, else the `usual` share."""
    return every if settings().max_examples >= settings.get_profile("all").max_examples else usual


def slow(*values: Any) -> Any:
    """Return parameters that are tried with the slow tests alone."""
    return pytest.param(*values, marks=pytest.mark.slow)


def long(*values: Any) -> Any:
    """Return parameters that are tried in `make test-all` only."""
    return pytest.param(*values, marks=pytest.mark.long)


@dataclass(frozen=True)
class EdgeSpec:
    """An edge (tail, head) with maps F_tail (m, n_tail), F_head (m, n_head), offset b (m,) and weight K (m, m)."""

    tail: Hashable
    head: Hashable
    F_tail: Array
    F_head: Array
    b: Array
    K: Array

    def in_frame(self, Q: Array) -> "EdgeSpec":
        """The same edge with the edge stalk in coordinates turned by the orthogonal matrix Q."""
        return replace(self, F_tail=Q @ self.F_tail, F_head=Q @ self.F_head, b=Q @ self.b, K=Q @ self.K @ Q.T)

    def reversed(self) -> "EdgeSpec":
        """The same constraint, written from the other end."""
        return EdgeSpec(self.head, self.tail, self.F_head, self.F_tail, -self.b, self.K)


@dataclass(frozen=True)
class SheafSpec:
    """Stalk dimensions by vertex, in order, and edges in order."""

    stalks: dict[Hashable, int]
    edges: tuple[EdgeSpec, ...]

    def build(self) -> Sheaf:
        """The library's sheaf."""
        sheaf = Sheaf(self.stalks)
        for e in self.edges:
            sheaf.add_edge(e.tail, e.head, e.F_tail, e.F_head, offset=e.b, weight=e.K)
        return sheaf

    def span(self, vertex: Hashable) -> slice:
        """Columns of a vertex."""
        names = list(self.stalks)
        first = sum(self.stalks[v] for v in names[: names.index(vertex)])
        return slice(first, first + self.stalks[vertex])

    def columns(self, vertices: list[Hashable]) -> NDArray[np.int64]:
        """Columns of several vertices, in the order given."""
        every = np.arange(self.n)
        return np.concatenate([every[:0], *(every[self.span(v)] for v in vertices)])

    def rest(self, vertices: list[Hashable]) -> list[Hashable]:
        """The other vertices, in order."""
        return [v for v in self.stalks if v not in vertices]

    @property
    def n(self) -> int:
        """Dimension of C^0."""
        return sum(self.stalks.values())

    @property
    def m(self) -> int:
        """Dimension of C^1."""
        return sum(len(e.b) for e in self.edges)

    @property
    def delta(self) -> Array:
        """The coboundary as a dense matrix, written block by block from its definition."""
        delta, row = np.zeros((self.m, self.n)), 0
        for e in self.edges:
            rows = slice(row, row + len(e.b))
            delta[rows, self.span(e.tail)] += e.F_tail
            delta[rows, self.span(e.head)] -= e.F_head
            row += len(e.b)
        return delta

    @property
    def K(self) -> Array:  # noqa: N802 - the paper's symbol
        """The inner product of C^1, shape (m, m)."""
        return block_diag(np.zeros((0, 0)), *(e.K for e in self.edges))

    @property
    def b(self) -> Array:
        """The offsets, shape (m,)."""
        return np.concatenate([np.zeros(0), *(e.b for e in self.edges)])

    def energy(self, x: Array) -> float:
        """1/2 |delta x - b|_K^2."""
        r = self.delta @ x - self.b
        return 0.5 * float(r @ self.K @ r)


def _whole(shape: int | tuple[int, ...], size: int = 2) -> st.SearchStrategy[Array]:
    return arrays(np.float64, shape, elements=st.integers(-size, size).map(float))


@st.composite
def sheaves(draw: st.DrawFn, *, offsets: bool = True) -> SheafSpec:
    """A random sheaf of 1 to 5 vertices; vertex names are text and numbers in no particular order."""
    names: list[Hashable] = draw(st.permutations(["a", "b", 3, ("c", 1), "d"]))[: draw(st.integers(1, 5))]
    stalks = {v: draw(st.integers(0, 3)) for v in names}
    edges = []
    for _ in range(draw(st.integers(0, 7)) if len(names) > 1 else 0):
        tail, head = draw(st.permutations(names))[:2]
        m = draw(st.integers(1, 3))
        A = draw(_whole((m, m), 1))
        edges.append(
            EdgeSpec(
                tail,
                head,
                draw(_whole((m, stalks[tail]))),
                draw(_whole((m, stalks[head]))),
                draw(_whole(m, 9)) if offsets else np.zeros(m),
                A @ A.T + np.eye(m),
            )
        )
    return SheafSpec(stalks, tuple(edges))


@st.composite
def sheaves_with_boundary(draw: st.DrawFn) -> tuple[SheafSpec, list[Hashable], Array]:
    """A random sheaf, some of its vertices in any order, and a value for them."""
    spec = draw(sheaves())
    names = draw(st.permutations(list(spec.stalks)))
    boundary = names[: draw(st.integers(0, len(names)))]
    return spec, boundary, draw(_whole(len(spec.columns(boundary)), 9))


def vectors(n: int) -> st.SearchStrategy[Array]:
    """Vectors of length n with whole entries."""
    return _whole(n, 9)


def orthogonal(m: int, seed: int) -> Array:
    """A random orthogonal matrix, shape (m, m)."""
    if m == 1:
        return np.array([[1.0 if seed % 2 else -1.0]])
    return ortho_group.rvs(m, random_state=seed)


def exact_rank(matrix: Array) -> int:
    """Rank of a matrix of whole numbers, by elimination in fractions."""
    rows = [[Fraction(int(x)) for x in row] for row in matrix]
    rank = 0
    for column in range(matrix.shape[1]):
        pivot = next((k for k in range(rank, len(rows)) if rows[k][column]), None)
        if pivot is None:
            continue
        rows[rank], rows[pivot] = rows[pivot], rows[rank]
        for k in range(rank + 1, len(rows)):
            ratio = rows[k][column] / rows[rank][column]
            rows[k] = [x - ratio * y for x, y in zip(rows[k], rows[rank], strict=True)]
        rank += 1
    return rank


def split(spec: SheafSpec, vertices: list[Hashable], x: Array) -> dict[Hashable, Array]:
    """Cut a vector of values of the given vertices into one value for each."""
    ends = np.cumsum([spec.stalks[v] for v in vertices])
    return dict(zip(vertices, np.split(x, ends[:-1]), strict=True)) if vertices else {}


@st.composite
def shared_teams(draw: st.DrawFn, most_agents: int = 4, most_targets: int = 2) -> Team:
    """A random team with 'shared' maps, often disconnected, sometimes with parallel edges and anchors."""
    agents = [f"{draw(st.sampled_from('BU'))}{k}" for k in range(draw(st.integers(1, most_agents)))]
    targets = [f"{draw(st.sampled_from('SV'))}{k}" for k in range(draw(st.integers(1, most_targets)))]
    pairs = list(itertools.permutations(agents, 2))
    links = draw(st.lists(st.sampled_from(pairs), max_size=6)) if pairs else []
    seen = draw(st.lists(st.tuples(st.sampled_from(agents), st.sampled_from(targets)), max_size=5))
    held = draw(st.lists(st.tuples(st.sampled_from(agents), st.sampled_from("xy")), max_size=2))
    weights = st.sampled_from([1.0, 0.25, 3.0])
    return make_team(
        " ".join(agents),
        " ".join(targets),
        [make_edge(*pair, weight=draw(weights)) for pair in links],
        [make_edge(*pair, weight=draw(weights)) for pair in seen],
        [hold(agent, axis) for agent, axis in held],
    )


@st.composite
def whole_number_teams(draw: st.DrawFn) -> Team:
    """A random team whose maps have small whole entries: ranks are exact, and kernels are common and oblique."""
    agents = [make_member(f"{draw(st.sampled_from('BU'))}{k}") for k in range(draw(st.integers(1, 4)))]
    targets = [make_member("S"), make_member("V")]

    def some(tails: list[Member], heads: list[Member], most: int) -> list[Edge]:
        pairs = [(a, b) for a in tails for b in heads if a is not b]
        edges = []
        for a, b in draw(st.lists(st.sampled_from(pairs), max_size=most)) if pairs else []:
            m = draw(st.integers(1, 3))
            F_a, F_b = (
                draw(arrays(np.float64, (m, v.dimension), elements=st.integers(-2, 2).map(float))) for v in (a, b)
            )
            edges.append(Edge(a.id, b.id, F_a, F_b, np.eye(m)))
        return edges

    return Team(agents, targets, some(agents, agents, 5), some(agents, targets, 4))
