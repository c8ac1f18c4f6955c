"""The decentralized law: the local form, the ensemble form, and what neither may know.

Oracles: the definitions eta = (delta^T K (delta x - b)) on the agents and d = -+F^T K (y + b), in plain numpy; the
harmonic extension; and the spectrum of the published run.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mjsheaf import load_scenario
from mjsheaf.law import LawArrays, disagreement, pack_law
from mjsheaf.law.terms import limit_speed
from mjsheaf.team import Edge, Member, Team
from mjsheaf.team.edges import Explicit
from tests.builders import FACTS

Array = NDArray[np.float64]


def incident_edges(team: Team, agent: str) -> list[Edge]:
    """The edges at an agent, in the order of the sheaf: all that it can measure."""
    return [e for e in team.communication + team.sensing + team.anchors if agent in e.between]


def range_bearing(y: Array) -> tuple[float, Array]:
    """Range |y| in m and unit bearing y / |y|; at range 0 the bearing is zero, so that range * bearing is y."""
    r = float(np.linalg.norm(y))
    return r, y / r if r > 0.0 else np.zeros_like(y)


class LocalLaw:
    """The law of one agent as the paper has it, which is handed its own measurements and nothing else.

    On an edge e = (i, j) with measurement y_e = F_j x_j - F_i x_i and desired value b_e, the tail forms
    d = -F_i^T K (y_e + b_e) and the head d = F_j^T K (y_e + b_e); eta_i is the sum of its d.
    """

    def __init__(self, team: Team, agent: str, gain: float) -> None:
        incident = incident_edges(team, agent)
        self.edges = [(e.tail, e.head) for e in incident]
        self._gain, self._dimension = gain, team.sheaf.dimension(agent)
        self._pullback = [-e.F_tail.T @ e.weight if e.tail == agent else e.F_head.T @ e.weight for e in incident]
        self._offset = [e.b for e in incident]

    def disagreement(self, measurements: list[Array]) -> Array:
        """eta_i from the measurements y_e of the agent's edges, shape (n_i,), m."""
        eta = np.zeros(self._dimension)
        for pullback, y, b in zip(self._pullback, measurements, self._offset, strict=True):
            eta += pullback @ (y + b)
        return eta

    def command(self, measurements: list[Array]) -> Array:
        """-k1 eta_i, shape (n_i,), m/s."""
        return -self._gain * self.disagreement(measurements)


@dataclass(frozen=True)
class Case:
    """A team, positions x (V, 3) with whole numbers in metres and zero for z in the plane, and a generator."""

    team: Team
    x: Array
    rng: np.random.Generator


def formation(name: str, members: list[Member], rng: np.random.Generator) -> Explicit:
    places = [rng.standard_normal(m.dimension).tolist() for m in members]
    return Explicit(name=name, members=[m.id for m in members], displacements=places)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Random teams of mixed dimensions, with rectangular maps, parallel edges, weights and offsets of every kind."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    agents = [Member(f"A{k}", draw(st.sampled_from([2, 3]))) for k in range(draw(st.integers(1, 5)))]
    targets = [Member(f"T{k}", draw(st.sampled_from([2, 3]))) for k in range(draw(st.integers(1, 3)))]

    def edges(tails: list[Member], heads: list[Member], most: int) -> list[Edge]:
        pairs = [(i, j) for i in tails for j in heads if i is not j]
        chosen = draw(st.lists(st.sampled_from(pairs), max_size=most)) if pairs else []
        made = []
        for i, j in chosen:
            m = int(rng.integers(1, 4))
            root = rng.standard_normal((m, m))
            maps = rng.standard_normal((m, i.dimension)), rng.standard_normal((m, j.dimension))
            offset = rng.standard_normal(m) if rng.random() < 0.5 else None
            made.append(Edge(i.id, j.id, *maps, root @ root.T + 0.1 * np.eye(m), offset))
        return made

    inside = [a for a in agents if draw(st.booleans())]
    groups = [formation("g", inside, rng)] if inside else []
    shape = formation("t", targets, rng)
    team = Team(
        agents, targets, edges(agents, agents, 8), edges(agents, targets, 6), edges(targets, targets, 4), groups, shape
    )
    x = team.unpack(rng.integers(-50, 50, team.sheaf.shape[1]).astype(float))
    return Case(team, x, rng)


def ensemble(team: Team, x: Array) -> Array:
    """The residuals of all vehicles by the compiled form, shape (V, 3)."""
    return disagreement(pack_law(team, 1.0, 1.0, np.full(len(x), np.inf)), x)


def measure(team: Team, agent: str, x: Array) -> list[Array]:
    """Return the agent's measurements: range times bearing on each of its edges, and nothing else."""
    number = {m.id: (v, m.dimension) for v, m in enumerate(team.members)}
    y = []
    for e in incident_edges(team, agent):
        (tail, n_tail), (head, n_head) = number[e.tail], number[e.head]
        distance, bearing = range_bearing(e.F_head @ x[head, :n_head] - e.F_tail @ x[tail, :n_tail])
        y.append(distance * bearing)
    return y


def neighbours(team: Team, agent: str) -> set[str]:
    return {v for e in incident_edges(team, agent) for v in (e.tail, e.head)} | {agent}


@given(cases())
def test_local_law_is_the_ensemble_law(case: Case) -> None:
    team = case.team
    eta = ensemble(team, case.x)
    for i, agent in enumerate(team.agents):
        local = LocalLaw(team, agent.id, 3.0)
        measured = measure(team, agent.id, case.x)
        size = 1.0 + np.abs(case.x).max() * 100.0
        np.testing.assert_allclose(
            local.disagreement(measured), eta[i, : agent.dimension], rtol=1e-12, atol=1e-12 * size
        )


@given(cases())
def test_ensemble_disagreement_is_its_definition(case: Case) -> None:
    """eta = H q - B p - c on the agents, L_T p - c_T on the targets; nothing in z for those in the plane."""
    team, residual = case.team, ensemble(case.team, case.x)
    x = team.pack(case.x)
    sheaf, K, row = team.sheaf, np.zeros((team.sheaf.shape[0],) * 2), 0
    for e in (*team.communication, *team.sensing, *team.target_edges):
        K[row : row + len(e.weight), row : row + len(e.weight)] = e.weight
        row += len(e.weight)
    delta = sheaf.coboundary().toarray()
    n_q = sum(a.dimension for a in team.agents)
    n_T = sum(len(e.weight) for e in team.target_edges)
    size = 1e-12 * (1.0 + np.abs(delta.T @ K).sum() * 100.0)
    pulled = delta.T @ K @ (delta @ x - sheaf.offset())
    np.testing.assert_allclose(team.pack(residual)[:n_q], pulled[:n_q], atol=size)
    own = slice(row - n_T, row)
    targets = delta[own, n_q:].T @ K[own, own] @ (delta[own] @ x - sheaf.offset()[own])
    np.testing.assert_allclose(team.pack(residual)[n_q:], targets, atol=size)
    problem = team.dirichlet
    by_blocks = problem.H @ x[:n_q] - problem.B @ x[n_q:] - problem.c
    np.testing.assert_allclose(team.pack(residual)[:n_q], by_blocks, atol=size)
    planar = [m.dimension == 2 for m in team.members]
    np.testing.assert_array_equal(residual[planar, 2], 0.0)


@given(cases())
def test_disagreement_is_minus_h_times_the_tracking_error(case: Case) -> None:
    """Eta = -H e with e = q* - q, also where H is singular."""
    team = case.team
    x = team.pack(case.x)
    n_q = team.dirichlet.H.shape[0]
    e = team.dirichlet.extend(x[n_q:]) - x[:n_q]
    eta = team.pack(ensemble(team, case.x))[:n_q]
    size = 1.0 + np.abs(team.dirichlet.H.toarray()).max(initial=0.0) * (100.0 + np.abs(e).max(initial=0.0))
    np.testing.assert_allclose(eta, -(team.dirichlet.H @ e), atol=1e-10 * size)


@given(cases())
def test_vehicles_that_are_no_neighbours_do_not_change_a_bit(case: Case) -> None:
    team = case.team
    before = ensemble(team, case.x)
    for i, agent in enumerate(team.agents):
        near = neighbours(team, agent.id)
        far = [v for v, m in enumerate(team.members) if m.id not in near]
        moved = case.x.copy()
        moved[far] = 1e6 * case.rng.standard_normal((len(far), 3))
        np.testing.assert_array_equal(ensemble(team, moved)[i], before[i])
        local = LocalLaw(team, agent.id, 1.0)
        assert {v for e in local.edges for v in e} | {agent.id} == near
        command = local.command(measure(team, agent.id, case.x))
        np.testing.assert_array_equal(local.command(measure(team, agent.id, moved)), command)
        lost = moved.copy()
        lost[far] = np.nan  # not even a number
        np.testing.assert_array_equal(ensemble(team, lost)[i], before[i])


@given(cases())
def test_a_neighbour_does_matter(case: Case) -> None:
    """The other half of locality: an agent does feel each vehicle that it shares an edge with."""
    team = case.team
    before = ensemble(team, case.x)
    for v, member in enumerate(team.members):
        moved = case.x.copy()
        moved[v, : member.dimension] += 1.0
        felt = {a.id for i, a in enumerate(team.agents) if np.any(ensemble(team, moved)[i] != before[i])}
        assert felt == {a.id for a in team.agents if member.id in neighbours(team, a.id) - {a.id}} | (
            {member.id} & {a.id for a in team.agents if len(neighbours(team, a.id)) > 1}
        )


def test_a_local_law_wants_just_its_measurements() -> None:
    edge = Edge("A", "T", np.eye(2), np.eye(2), np.eye(2))
    local = LocalLaw(Team([Member("A", 2)], [Member("T", 2)], [], [edge]), "A", 2.0)
    np.testing.assert_array_equal(local.command([np.array([3.0, -1.0])]), [6.0, -2.0])
    with pytest.raises(ValueError, match="argument"):
        local.command([])


def test_range_zero_gives_the_command_of_the_offset_alone() -> None:
    edge = Edge("A", "T", np.eye(2), np.eye(2), 5.0 * np.eye(2), np.array([1.0, 2.0]))
    local = LocalLaw(Team([Member("A", 2)], [Member("T", 2)], [], [edge]), "A", 1.0)
    distance, bearing = range_bearing(np.zeros(2))
    np.testing.assert_array_equal(local.command([distance * bearing]), [5.0, 10.0])


@pytest.fixture(scope="module")
def published() -> Team:
    return load_scenario("paper").system.team


def test_spectrum_of_the_published_team(published: Team) -> None:
    """H is the scalar matrix of the published graph on each of the two coordinates: each eigenvalue twice."""
    values = np.linalg.eigvalsh(published.dirichlet.H.toarray())
    np.testing.assert_allclose(values[:2], FACTS["spectrum"]["lambda_min"], rtol=1e-12)
    np.testing.assert_allclose(values[-2:], FACTS["spectrum"]["lambda_max"], rtol=1e-12)
    np.testing.assert_allclose(values[0::2], values[1::2], rtol=1e-10)


def test_disagreement_of_the_published_start() -> None:
    system = load_scenario("paper").system
    mean = np.linalg.norm(disagreement(system.law, system.initial)[:13], axis=1).mean()
    np.testing.assert_allclose(mean, FACTS["checkpoints_gain_10"]["mean_disagreement"]["0.01"], rtol=1e-13)


def test_packed_law_keeps_gains_and_limits(published: Team) -> None:
    limits = np.arange(1.0, 18.0)
    law: LawArrays = pack_law(published, 10.0, 0.05, limits)
    np.testing.assert_array_equal(law.gain, [10.0] * 13 + [0.05] * 4)
    np.testing.assert_array_equal(law.limit, limits)


@given(st.integers(0, 2**31))
def test_speed_limits_shorten_and_never_turn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    velocity = rng.standard_normal((7, 5, 3)) * 10.0 ** rng.uniform(-3, 3, (7, 5, 1))
    velocity[0, 0] = 0.0
    limit = np.array([0.5, 1.0, 10.0, 1e4, np.inf])
    limited = velocity.copy()
    for t in range(7):
        for v in range(5):
            limit_speed(limit[v], limited[t, v])
    speed, given_speed = np.linalg.norm(limited, axis=2), np.linalg.norm(velocity, axis=2)
    np.testing.assert_allclose(speed, np.minimum(given_speed, limit), rtol=1e-13)
    np.testing.assert_allclose(np.cross(limited, velocity), 0.0, atol=1e-12 * given_speed.max() ** 2)
    assert np.all(np.sum(limited * velocity, axis=2) >= 0.0)
