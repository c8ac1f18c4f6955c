"""Spectrum of H and relative cohomology of a team, and the effects of losing a single edge, agent or target.

The spectrum of H sets the speed of the law, and sigma_max(B) how strongly targets pull. Both are computed from
D = K^{1/2} delta on the agents, with H = D^T D: eigenvalues are squares of singular values of D, so none is negative.
The relative cohomology, the null space of delta, determines which of them are zero; inner products do not change it.
Connected components of D are treated separately.

The relative cohomology H^0(G, G_p; F) is described by the agents that are free to drift, or barely held.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import linalg, sparse

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import UndecidedError, select_true
from mjsheaf.section import Record
from mjsheaf.sheaf import RANK_TOLERANCE
from mjsheaf.sheaf.edges import parts
from mjsheaf.sheaf.nonlinear import FREE_MOTION, SOLVED_RANK_TOLERANCE, StationaryProblem
from mjsheaf.sheaf.sections import (
    DENSE_COLUMNS,
    largest_singular_value,
    shifted_factor,
    smallest_eigenvectors,
    sparse_null_space,
    sparser_rows,
)
from mjsheaf.team import GROUND, Edge, Team
from mjsheaf.team.team import describe, describe_nearly, null_mode_of, null_modes

DENSE_STATES = 600
"""Largest component of H whose eigenvalues are found densely."""

EIGENVALUE_TOLERANCE = 1e-8
"""Relative accuracy of the eigenvalues of larger components."""


@dataclass(frozen=True)
class Spectrum:
    """Eigenvalues of H (n, n) and the largest singular value of B. The maps have no unit, so neither do these.

    Attributes:
        lambda_min: Smallest eigenvalue of H; exactly 0 if the relative cohomology is not trivial.
        lambda_max: Largest eigenvalue of H.
        sigma_max_B: Largest singular value of B; 0 if nothing is sensed.
        nullity: Number of zero eigenvalues, the dimension of the relative cohomology.
        smallest: Smallest eigenvalues above zero, ascending, shape (k,).
        vectors: Their orthonormal eigenvectors in the order of the stacked q, shape (n, k).
    """

    lambda_min: float
    lambda_max: float
    sigma_max_B: float
    nullity: int
    smallest: Array
    vectors: Array


def spectrum_of(team: Team, count: int = 6) -> Spectrum:
    """Compute the spectrum of a team, with `count` of the smallest eigenvalues above zero, or fewer if H has fewer.

    Above DENSE_STATES states, a copy of a multiple eigenvalue of one component may be missing.
    """
    known = _spectra.setdefault(team, {})
    if count in known:
        return known[count]
    problem = team.dirichlet
    if isinstance(problem, StationaryProblem):  # edges do not fit together: real parts if H is not symmetric
        nullity = problem.null_basis.shape[1]
        values, every = problem.eigenvectors
        largest = float(values.max(initial=0.0))
        smallest, vectors = values[nullity : nullity + count], every[:, nullity : nullity + count]
    else:
        (_, D), null = agent_coboundary(team), problem.sparse_null_basis
        nullity = null.shape[1]
        largest = largest_singular_value(D) ** 2
        smallest, vectors = _above_zero(D, null, count)
    known[count] = Spectrum(
        lambda_min=0.0 if nullity or not smallest.size else float(smallest[0]),
        lambda_max=largest,
        sigma_max_B=largest_singular_value(problem.B),
        nullity=nullity,
        smallest=smallest,
        vectors=vectors,
    )
    return known[count]


_spectra: WeakKeyDictionary[Team, dict[int, Spectrum]] = WeakKeyDictionary()  # a study's runs may share their team


def agent_coboundary(team: Team) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Return the coboundary on the agents, rows in the order of the sheaf's edges, columns in that of the stacked q.

    Returns:
        delta, shape (m, n), whose null space is the relative cohomology; and D = K^{1/2} delta, (m, n), with H = D^T D.
    """
    columns = team.sheaf.columns(team.agent_ids)
    return team.sheaf.coboundary()[:, columns], team.sheaf.whitened_coboundary()[:, columns]


def smallest_eigenvalue(delta: sparse.csr_array, D: sparse.csr_array) -> float:
    """Compute the smallest eigenvalue of H = D^T D; exactly 0 if the null space of delta is not trivial."""
    if D.shape[1] <= DENSE_STATES:
        values = np.linalg.eigvalsh((D.T @ D).toarray())
        # Eigenvalues of H are good to about 1e-14 of the largest: these to 1e-8. And delta is then injective, unless
        # inner products span 12 decades.
        if values[0] > 1e-6 * values[-1]:
            return float(values[0])
    null = sparse_null_space(delta)
    return 0.0 if null.shape[1] else float(_above_zero(D, null, 1)[0][0])


def _above_zero(D: sparse.csr_array, null: sparse.csc_array, count: int) -> tuple[Array, Array]:
    """Compute the `count` smallest eigenvalues of D^T D above zero, and their vectors.

    D has shape (m, n); `null` is an orthonormal basis of the null space of delta, shape (n, r).
    """
    null_rows = null.tocsr()
    found: list[tuple[float, IntArray, Array]] = []
    for _, members, part in parts(sparser_rows(D)):
        known = null_rows[members]
        known = known[:, np.unique(known.indices)].toarray()
        wanted = min(count, len(members) - known.shape[1])
        if wanted:
            values, vectors = _of_component(part, known, wanted)
            found += [(float(value), members, vector) for value, vector in zip(values, vectors.T, strict=True)]
    found = sorted(found, key=lambda pair: pair[0])[:count]
    vectors = np.zeros((D.shape[1], len(found)))
    for k, (_, members, vector) in enumerate(found):
        vectors[members, k] = vector
    return np.array([value for value, _, _ in found]), vectors


def _of_component(D: sparse.csr_array, known: Array, count: int) -> tuple[Array, Array]:
    """Compute the `count` smallest eigenvalues of D^T D outside its null space `known`, with orthonormal vectors."""
    gram = D.T @ D
    n, r = known.shape
    if n <= DENSE_STATES:
        values, candidates = linalg.eigh(gram.toarray(), subset_by_index=(0, r + count - 1))
        # Below, errors of eigenvectors of H, squared, show in their eigenvalues: D has better ones.
        if values[r] < 1e-10 * gram.diagonal().sum():
            R = np.linalg.qr(D.toarray(), mode="r") if D.shape[0] > n else D.toarray()
            candidates = linalg.svd(R)[2][: -(r + count) - 1 : -1].T
    else:
        # The Gershgorin bound serves as scale; the shift keeps the factorisation regular, far below what matters.
        candidates = smallest_eigenvectors(
            shifted_factor(gram, 1e-10 * float(abs(gram).sum(axis=1).max())), known, count, EIGENVALUE_TOLERANCE
        )
    if r:
        # Eigenvectors of H mix its null space with what is close to it; the null space itself was found on D, exactly.
        candidates = np.linalg.svd(candidates - known @ (known.T @ candidates), full_matrices=False)[0][:, :count]
    # Squaring lost what is under 1e-8 of the largest singular value; D still has it.
    _, singular, turn = np.linalg.svd(np.linalg.qr(D @ candidates, mode="r"), full_matrices=True)
    singular = np.append(singular, np.zeros(count - len(singular)))  # a component of fewer rows than columns
    return singular[::-1] ** 2, (candidates @ turn.T)[:, ::-1]


NEARLY = 1e-3
"""Fraction of the largest eigenvalue up to which a direction counts as barely held."""

MOST_NEARLY = 3
"""Largest number of barely held directions that are listed."""


class FreeDirection(Record):
    """A direction in which agents can drift without effect on any edge or anchor, such as "A3 is free along z"."""

    description: str
    motion: dict[str, list[float]] = Field(description="motion of each agent that moves, largest entry 1")


class NearNull(Record):
    """A direction with a small eigenvalue: it converges slowly, and a small disturbance moves it far."""

    description: str
    eigenvalue: float = Field(description="eigenvalue of H")
    ratio: float = Field(description="ratio to the largest eigenvalue of H")


class RelativeCohomology(Record):
    """H^0(G, G_p; F), explained."""

    dimension: int = Field(description="0 if the harmonic extension is unique")
    tolerance: float = Field(description="size of singular values that count as zero, relative to the largest")
    method: str
    basis: list[FreeDirection] = Field(description="one direction for each dimension, few agents in each")
    near_null: list[NearNull] = Field(description=f"eigenvalues up to {NEARLY:g} of the largest, at most {MOST_NEARLY}")


def explain(team: Team, spectrum: Spectrum | None = None) -> RelativeCohomology:
    """Explain the relative cohomology of a team, whose spectrum may be known already."""
    spectrum = spectrum or spectrum_of(team)
    basis = [
        FreeDirection(
            description=describe(team, mode),
            motion={
                team.agents[a].id: step[: team.agents[a].dimension].tolist()
                for a, step in zip(mode.agents, mode.steps.round(9), strict=True)
            },
        )
        for mode in null_modes(team)
    ]
    near = spectrum.smallest[:MOST_NEARLY] <= NEARLY * spectrum.lambda_max
    return RelativeCohomology(
        dimension=len(basis),
        tolerance=RANK_TOLERANCE if team.linearised_at is None else SOLVED_RANK_TOLERANCE,
        basis=basis,
        near_null=[
            NearNull(
                description=describe_nearly(team, null_mode_of(team, spectrum.vectors[:, k])),
                eigenvalue=float(spectrum.smallest[k]),
                ratio=float(spectrum.smallest[k] / spectrum.lambda_max),
            )
            for k in np.flatnonzero(near)
        ],
        method="singular values, dense"
        if team.dirichlet.H.shape[0] <= DENSE_COLUMNS
        else f"singular values of each connected component, dense up to {DENSE_COLUMNS} states and by shift-invert "
        "Lanczos beyond",
    )


# -- H that is not symmetric ------------------------------------------------------------------------------------------


Complex = NDArray[np.complex128]


def matrix_of(team: Team) -> Array:
    """Return H of a team of linear edges, shape (n, n).

    Raises:
        UndecidedError: It is too large.
    """
    n_q = int(team.remaining.first_state[-1])
    if n_q > DENSE_STATES:
        raise UndecidedError(f"H has {n_q} rows; all its eigenvalues are found up to {DENSE_STATES}")
    return team.law_problem.H.toarray()


def zero_of(
    team: Team,
    *,
    zero: float = 1e-9,  # fraction of the largest eigenvalue of H, up to which one counts as zero
) -> float:
    """Return the size of an eigenvalue of H, relative to the largest, up to which it counts as zero."""
    return zero if team.linearised_at is None else FREE_MOTION


def held_eigenvalues(team: Team) -> Complex:
    """Return the eigenvalues of H of a team of linear edges that determine the loop, by real part, shape (n,).

    Without zeros if a team without targets is free to move.

    Raises:
        UndecidedError: H is too large.
    """
    values = np.linalg.eigvals(matrix_of(team)).astype(np.complex128)
    values = values[np.argsort(values.real, kind="stable")]
    zero = np.abs(values) <= zero_of(team) * float(np.abs(values).max(initial=0.0))
    return values[~zero] if team.free else np.where(zero, 0.0, values)


# -- single losses -----------------------------------------------------------------------------------------------------


Kind = Literal["sensing", "communication", "anchor", "agent", "link", "target"]

CONNECTED = "agent graph connected"
"""Broken if agents that were connected no longer are."""

SENSED = "every target sensed"
"""Broken if a target that was sensed no longer is."""

TRIVIAL = "relative cohomology trivial"
"""Broken if agents have a null mode that they did not have."""

MOST_CRITICAL = 50
EXACT_STATES = 200
EXACT_LOSSES = 1000
"""Largest numbers of agent states and single losses for which H is decomposed again after each loss."""


class Loss(Record):
    """Effect of losing one edge, agent or target, or all edges between two ends (a link)."""

    kind: Kind
    name: str = Field(description='such as "A1 - T2", "A1 - A4 (1 of 2)" or "A2 along z"')
    breaks: tuple[str, ...] = Field(description="requirements that fail because of the loss")
    lambda_min: float | None = Field(description="smallest eigenvalue of H after the loss; null if not computed")


Single = tuple[Loss, list[int], int | None]
"""A loss with its effect on CONNECTED and SENSED, which needs no linear algebra and is exact at any size; the lost
edges, by their indices in the sheaf's order; and the number of the lost agent, or None."""


class Fragility(Record):
    """Single losses that break an assumption."""

    exact: bool = Field(description="whether H was decomposed after each loss; else lambda_min is not known")
    method: str
    critical: list[Loss] = Field(description=f"losses that break something, at most {MOST_CRITICAL}")
    critical_count: int
    worst: Loss | None = Field(description="the loss that breaks nothing with the smallest lambda_min; null if unknown")


def fragility(team: Team) -> Fragility:
    """Find the losses of `single_losses` that break something, and the worst of the others."""
    losses, exact = single_losses(team)
    critical = [loss for loss in losses if loss.breaks]
    method = (
        f"exact: H decomposed again after each of {len(losses)} losses"
        if exact
        else f"over {EXACT_STATES} states or {EXACT_LOSSES} single losses, or edges that do not fit together: "
        "bridges and articulation points of the agent graph, targets, and those that a single edge or agent senses; "
        "lambda_min and the relative cohomology after a loss were not computed"
    )
    return Fragility(
        exact=exact,
        method=method,
        critical=critical[:MOST_CRITICAL],
        critical_count=len(critical),
        worst=next((loss for loss in losses if not loss.breaks), None) if exact and team.dirichlet.unique else None,
    )


def single_losses(team: Team) -> tuple[list[Loss], bool]:
    """Try out each single loss; for a large team, find only those that break CONNECTED or SENSED.

    With an agent its edges are lost, with a target those that sense it; the last agent is never lost. Parallel edges
    are lost one at a time, and all together if the link between their ends is cut.

    Returns:
        The losses, those that break something first, then by lambda_min; and whether each was tried out on H.
    """
    singles = list(_singles(team))
    if team.stressed or team.dirichlet.H.shape[0] > EXACT_STATES or len(singles) > EXACT_LOSSES:
        return [loss for loss, _, _ in singles if loss.breaks], False
    losses = list(_try_out(team, singles))
    losses.sort(key=lambda loss: (not loss.breaks, round(loss.lambda_min or 0.0, 12)))  # rounding does not choose
    return losses, True


def _try_out(team: Team, singles: Iterable[Single]) -> Iterator[Loss]:
    """Yield each loss with lambda_min of H after it; it breaks TRIVIAL too if an agent is then free to drift."""
    delta, D = agent_coboundary(team)
    free = team.dirichlet.sparse_null_basis.shape[1]
    sizes = [len(edge.b) for _, edge in _edges(team)]
    edge_of_row = np.repeat(np.arange(len(sizes)), sizes)
    agent_of_state = team.slots[: D.shape[1]] // 3
    for loss, edges, agent in singles:
        lost = agent_of_state == agent
        # Free directions of the lost agent alone are lost with it.
        gone = sparse_null_space(delta[:, lost]).shape[1] if free and lost.any() else 0
        left = [x[~np.isin(edge_of_row, edges)][:, ~lost] for x in (delta, D)]
        lambda_min = smallest_eigenvalue(*left)
        frees = lambda_min == 0.0 and sparse_null_space(left[0]).shape[1] > free - gone
        breaks = (*loss.breaks, TRIVIAL) if frees else loss.breaks
        yield loss.model_copy(update={"breaks": breaks, "lambda_min": lambda_min})


def _edges(team: Team) -> list[tuple[Kind | None, Edge]]:
    """Return the edges in the order of the sheaf, with the kind of those that can be lost."""
    kinds: list[tuple[Kind | None, tuple[Edge, ...]]] = [
        ("communication", team.communication),
        ("sensing", team.sensing),
        (None, team.target_edges),
        ("anchor", team.anchors),
    ]
    return [(kind, edge) for kind, edges in kinds for edge in edges]


def _singles(team: Team) -> Iterator[Single]:
    """Yield everything that can be lost alone: edges, one of parallel ones at a time, links, targets, and agents."""
    import networkx as nx

    edges = _edges(team)
    graph = nx.Graph(list(map(_ends, team.communication)))
    graph.add_nodes_from(team.agent_ids)
    bridges = {(min(pair), max(pair)) for pair in nx.bridges(graph)}
    cuts = set(nx.articulation_points(graph))
    links = Counter(map(_ends, team.communication))
    sensors = Counter(edge.head for edge in team.sensing)

    def single(kind: Kind, name: str, numbers: list[int], agent: int | None = None) -> Single:
        lost = [edges[e] for e in numbers]
        apart = Counter(_ends(edge) for own, edge in lost if own == "communication")
        unseen = Counter(edge.head for own, edge in lost if own == "sensing")
        cut = any(pair in bridges and count == links[pair] for pair, count in apart.items())
        disconnects = cut if agent is None else name in cuts
        blinds = any(count == sensors[target] for target, count in unseen.items())
        breaks = select_true({CONNECTED: disconnects, SENSED: blinds})
        return Loss(kind=kind, name=name, breaks=tuple(breaks), lambda_min=None), numbers, agent

    incident = defaultdict[str, list[int]](list)
    parallel = defaultdict[tuple[str, ...], list[int]](list)
    for e, (kind, edge) in enumerate(edges):
        parallel[_ends(edge)].append(e)
        if kind is not None:
            incident[edge.tail].append(e)
            incident[edge.head].append(e)
    for e, (kind, edge) in enumerate(edges):
        if kind is not None:
            alike = parallel[_ends(edge)]
            which = f" ({alike.index(e) + 1} of {len(alike)})" if len(alike) > 1 else ""
            yield single(kind, _name(edge) + which, [e])
    for several in parallel.values():
        kind, edge = edges[several[0]]
        if kind not in (None, "anchor") and len(several) > 1:
            yield single("link", f"{edge.tail} - {edge.head} (all {len(several)})", several)
    for target in sensors:
        yield single("target", target, incident[target])
    if len(team.agents) > 1:
        for i, agent in enumerate(team.agent_ids):
            yield single("agent", agent, incident[agent], i)


def _ends(edge: Edge) -> tuple[str, ...]:
    """Return the ends that parallel edges share; for an anchor, the name of what it holds."""
    return (_name(edge),) if edge.head == GROUND else (min(edge.tail, edge.head), max(edge.tail, edge.head))


def _name(edge: Edge) -> str:
    if edge.head != GROUND:
        return f"{edge.tail} - {edge.head}"
    axes = ["xyz"[k] for k in np.flatnonzero(np.any(edge.F_tail != 0.0, axis=0))]
    return f"{edge.tail} along {', '.join(axes)}" if len(axes) == len(edge.F_tail) else f"{edge.tail} to a fixed value"
