"""A team becomes a sheaf: edges, offsets from formations, packing, and what is said of free directions.

Oracles: the definition b = delta o, the paper's remark that an edge frame does not matter, and its failing case
(aircraft that track a boat).
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf.errors import InputError
from mjsheaf.team import Edge, Formation, LinearEdge, Member, Team
from mjsheaf.team.edges import Explicit
from mjsheaf.team.team import describe_null_modes
from tests.builders import make_edge, make_member

DIMENSION = {"B1": 2, "U1": 3, "B2": 2, "U2": 3, "V": 3, "S": 2}
LINKS = [("B1", "U1"), ("B2", "U1"), ("B2", "U2")]
SEEN = [("B1", "V"), ("U1", "V"), ("U2", "S"), ("U1", "S"), ("U2", "V")]


def edge(tail: str, head: str, offset: Any = None, **options: Any) -> Edge:
    return replace(make_edge(tail, head, **options), offset=offset)


def members(*ids: str) -> list[Member]:
    return [make_member(v) for v in ids]


def formation(rng: np.random.Generator, name: str, *ids: str) -> Explicit:
    return explicit(name, list(ids), [rng.standard_normal(m.dimension) for m in members(*ids)])


def explicit(name: str, ids: list[str], places: Any) -> Explicit:
    return Explicit(name=name, members=ids, displacements=places)


def mixed_team(
    attitudes: list[tuple[float, float, float]] | None = None, formations: tuple[Formation, ...] = ()
) -> Team:
    frames: Any = [{"name": "local_frame", "attitude": attitude} for attitude in attitudes or ()] or [{}] * 8
    edges = [edge(*pair, **frame) for pair, frame in zip(LINKS + SEEN, frames, strict=True)]
    return Team(members("B1", "U1", "B2", "U2"), members("V", "S"), edges[:3], edges[3:], (), formations)


yaws = st.tuples(st.just(0.0), st.just(0.0), st.floats(-7, 7))


@given(st.lists(yaws, min_size=8, max_size=8), st.integers(0, 2**31))
def test_local_frames_leave_the_disagreement_alone(attitudes: list[tuple[float, float, float]], seed: int) -> None:
    """H, B and c do not depend on the frame in which an edge is measured, offsets included."""
    rng = np.random.default_rng(seed)
    groups = (formation(rng, "g", "B1", "B2", "U2"),)
    one, other = mixed_team(formations=groups).dirichlet, mixed_team(attitudes, groups).dirichlet
    np.testing.assert_allclose(other.H.toarray(), one.H.toarray(), atol=1e-13)
    np.testing.assert_allclose(other.B.toarray(), one.B.toarray(), atol=1e-13)
    np.testing.assert_allclose(other.c, one.c, atol=1e-13)


@given(st.integers(0, 2**31))
def test_formations_become_offsets_delta_o(seed: int) -> None:
    """Displacements are a 0-cochain o, zero off the formations and on targets; edges carry b = delta o."""
    rng = np.random.default_rng(seed)
    groups = formation(rng, "g", "U1", "B2"), formation(rng, "h", "U2")
    team = mixed_team(formations=groups)
    o = {v: np.zeros(n) for v, n in DIMENSION.items()}
    for group in groups:
        o.update(zip(group.members, map(np.array, group.displacements), strict=True))
    stacked = np.concatenate(list(o.values()))
    np.testing.assert_allclose(team.sheaf.offset(), team.sheaf.coboundary() @ stacked, atol=1e-14)
    assert np.any(team.sheaf.offset())
    for v in ("B1", "U1", "B2", "U2"):
        np.testing.assert_array_equal(team.displacement[v], o[v])


def test_an_offset_of_its_own_wins_over_the_formation() -> None:
    group = explicit("g", ["B1", "B2"], (np.ones(2), np.zeros(2)))
    links = [edge("B1", "B2", offset=np.array([7.0, 8.0])), edge("B2", "B1")]
    team = Team(members("B1", "B2"), members("S"), links, [edge("B1", "S")], (), [group])
    np.testing.assert_array_equal(team.communication[0].offset, [7.0, 8.0])
    np.testing.assert_array_equal(team.communication[1].offset, [-1.0, -1.0])
    np.testing.assert_array_equal(team.sensing[0].offset, [1.0, 1.0])
    assert team.formation_edges(group) == list(team.communication)


def test_targets_hold_their_formation_on_their_own_sheaf() -> None:
    places = np.array([[0.0, 1.0], [2.0, 0.0]])
    own = explicit("pair", ["S1", "S2"], places)
    agents, targets = members("B1"), members("S1", "S2")
    team = Team(agents, targets, [], [edge("B1", "S1")], [edge("S1", "S2", weight=3.0)], (), own)
    np.testing.assert_array_equal(team.target_sheaf.offset(), places[0] - places[1])
    L_T = np.kron([[3, -3], [-3, 3]], np.eye(2))
    np.testing.assert_allclose(team.target_sheaf.laplacian().toarray(), L_T, rtol=1e-15)
    np.testing.assert_array_equal(team.sensing[0].offset, np.zeros(2))


@given(st.integers(0, 2**31), st.lists(st.integers(1, 3), max_size=2))
def test_packing_and_spreading_are_inverse(seed: int, batch: list[int]) -> None:
    team = mixed_team()
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((*batch, 15))
    spread = team.unpack(x, fill=np.nan)
    assert spread.shape == (*batch, 6, 3)
    np.testing.assert_array_equal(team.pack(spread), x)
    planar = [n == 2 for n in DIMENSION.values()]
    np.testing.assert_array_equal(np.isnan(spread).any(axis=tuple(range(len(batch)))), [[0, 0, p] for p in planar])
    np.testing.assert_array_equal(team.unpack(x)[..., planar, 2], 0.0)
    agents = team.unpack(x[..., :10])
    assert agents.shape == (*batch, 4, 3)
    np.testing.assert_array_equal(agents, team.unpack(x)[..., :4, :])
    np.testing.assert_array_equal(spread[..., 1, :], x[..., 2:5])


@pytest.mark.parametrize(
    ("agents", "links", "seen", "said"),
    [
        (["U1"], [], ["U1"], ["U1 is free along z"]),
        (["U1", "U2"], [("U1", "U2")], ["U1"], ["U1, U2 are free along z together"]),
        (["U1", "U2"], [], ["U1", "U2"], ["U1 is free along z", "U2 is free along z"]),
        (["B1", "U1"], [("B1", "U1")], ["B1"], ["U1 is free along z"]),
        (["B1"], [], [], ["B1 is free along x", "B1 is free along y"]),
        (["B1"], [], ["B1"], []),
    ],
)
def test_free_directions_are_named(
    agents: list[str], links: list[tuple[str, str]], seen: list[str], said: list[str]
) -> None:
    """The paper's failing case: aircraft that track a boat are free in height."""
    team = Team(members(*agents), members("S"), [edge(*e) for e in links], [edge(v, "S") for v in seen])
    assert team.dirichlet.unique is (not said)
    assert sorted(describe_null_modes(team)) == said


A, T = members("B1", "U1"), members("S")


def grouped(*groups: tuple[str, list[str], Any]) -> Team:
    return Team(A, T, [], [], (), [explicit(*group) for group in groups])


def sensing(*numbers: Any) -> Team:
    return Team(A, T, [], [Edge("B1", "S", *numbers)])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Team([], T, [], []), "at least one agent"),
        (lambda: Team([*A, Member("B1", 3)], T, [], []), "id 'B1' is used twice"),
        (lambda: Team(A, T, [], [], [edge("S", "B1")]), "target_edges.0: .* B1 is an agent"),
        (lambda: grouped(("g", ["B9"], [[0, 0]])), "formations.0: members: unknown id 'B9'; expected one of B1, U1"),
        (lambda: grouped(("g", ["B1", "B1"], [[0, 0]] * 2)), "formations.0: members: 'B1' is named twice"),
        (
            lambda: grouped(("g", ["B1"], [[0, 0]]), ("h", ["B1"], [[0, 0]])),
            "formations.1: members: 'B1' is already in formation 'g'",
        ),
        (lambda: grouped(("g", ["B1"], [[0, 0]]), ("g", ["U1"], [[0, 0, 0]])), "formations: each needs its own name"),
        (lambda: grouped(("g", ["U1"], [[0, 0]])), "formations.0: displacement 0 has 2 entries.*dimension 3"),
        (lambda: Team(A, T, [LinearEdge(between=["B1", "U1"])] * 2, []), "communication.1: .*parallel: true"),
        (lambda: Team(A, T, [edge("B1", "B1")], []), r"communication.0: \(B1, B1\)"),
        (
            lambda: sensing(np.eye(2), np.eye(3, 2), np.eye(2)),
            r"sensing.0: \(B1, S\): the maps have shapes \(2, 2\) and \(3, 2\)",
        ),
        (lambda: sensing(np.eye(2), np.eye(2), -np.eye(2)), "weight is not symmetric positive definite"),
        (lambda: sensing(np.eye(2), np.eye(2), np.eye(2), np.full(2, np.nan)), "an entry is not finite"),
    ],
)
def test_teams_that_do_not_fit_are_refused(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
