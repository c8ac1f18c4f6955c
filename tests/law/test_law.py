"""The decentralized law: its definition by each agent's own edges, and what it may not know.

Oracles: the definition, edge by edge; the harmonic extension; and the spectrum of the published run.
"""

from dataclasses import dataclass

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag

from mjsheaf import load_scenario
from mjsheaf.arrays import Array
from mjsheaf.law.law import disagreement, pack_law
from mjsheaf.law.terms import limit_speed
from mjsheaf.team import Edge, Member, Team
from mjsheaf.team.edges import Explicit
from tests.builders import FACTS
from tests.oracles import law as oracle


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


def neighbours(team: Team, agent: str) -> set[str]:
    return {v for e in team.measuring_edges if agent in e.between for v in e.between} | {agent}


@given(cases())
def test_ensemble_disagreement_is_its_definition(case: Case) -> None:
    """Sums over the edges of each vehicle, which are H q - B p - c on agents; nothing in z for those in the plane.

    That is -H e with e = q* - q, also where H is singular.
    """
    team, residual = case.team, ensemble(case.team, case.x)
    edges = (*team.communication, *team.sensing, *team.target_edges)
    K = block_diag(np.zeros((0, 0)), *(e.weight for e in edges))
    size = 1e-12 * (1.0 + np.abs(team.sheaf.coboundary().T @ K).sum() * 100.0)
    expected = oracle.disagreement(team, case.x) + oracle.disagreement(team, case.x, team.target_edges)
    np.testing.assert_allclose(residual, expected, atol=size)
    problem, n_q = team.dirichlet, team.first_state[-1]
    q, p = np.split(team.pack(case.x), [n_q])
    np.testing.assert_allclose(team.pack(residual)[:n_q], problem.H @ q - problem.B @ p - problem.c, atol=size)
    e = problem.extend(p) - q
    size = 1e-10 * (1.0 + np.abs(problem.H.toarray()).max(initial=0.0) * (100.0 + np.abs(e).max(initial=0.0)))
    np.testing.assert_allclose(team.pack(residual)[:n_q], -(problem.H @ e), atol=size)
    planar = [m.dimension == 2 for m in team.members]
    np.testing.assert_array_equal(residual[planar, 2], 0.0)


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
        lost = moved.copy()
        lost[far] = np.nan  # not even a number
        np.testing.assert_array_equal(ensemble(team, lost)[i], before[i])


def test_spectrum_of_the_published_team() -> None:
    """H is the scalar matrix of the published graph on each of the two coordinates: each eigenvalue twice."""
    values = np.linalg.eigvalsh(load_scenario("paper").team.dirichlet.H.toarray())
    np.testing.assert_allclose(values[:2], FACTS["spectrum"]["lambda_min"], rtol=1e-12)
    np.testing.assert_allclose(values[-2:], FACTS["spectrum"]["lambda_max"], rtol=1e-12)
    np.testing.assert_allclose(values[0::2], values[1::2], rtol=1e-10)


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
