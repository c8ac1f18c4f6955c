"""Building a sheaf: edges in bulk, what is refused and how it is said, and that a sheaf keeps what it was given.

Oracle: the same edges added one at a time, and the dense definition in `strategies`.
"""

import itertools
from collections.abc import Callable, Hashable, Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from mjsheaf import Sheaf
from mjsheaf.errors import InputError, SheafError
from tests.strategies import EdgeSpec, SheafSpec, sheaves

Build = Callable[[Sheaf], Any]
I2, FLAT = np.eye(2), np.eye(2, 3)
UNHASHABLE: Any = [["b"]]
FIELDS = ("tail", "head", "F_tail", "F_head", "b", "K")


def pair() -> Sheaf:
    sheaf = Sheaf({"a": 2, "b": 3, "c": 2})
    sheaf.add_edge("a", "b", I2, FLAT, offset=[1.0, 2.0], weight=2.0)
    return sheaf


def columns(edges: Iterable[EdgeSpec]) -> tuple[tuple[Any, ...], dict[str, Any]]:
    tails, heads, F_tails, F_heads, b, K = ([getattr(e, name) for e in edges] for name in FIELDS)
    return (tails, heads, F_tails, F_heads), {"offset": b, "weight": K}


@given(sheaves())
def test_edges_in_bulk_are_edges_one_at_a_time(spec: SheafSpec) -> None:
    """Those whose maps have equal shapes, or stalks of all dimensions at once: bits, numbers and order are the same.

    Each is the definition, whatever the order of vertices and edges and the direction of edges.
    """
    alike, mixed, single = Sheaf(spec.stalks), Sheaf(spec.stalks), spec.build()
    runs = [tuple(run) for _, run in itertools.groupby(spec.edges, key=lambda e: (e.F_tail.shape, e.F_head.shape))]
    adding: list[tuple[Callable[..., Any], Any]] = [
        (alike.add_edges, runs),
        (mixed.add_mixed_edges, [spec.edges[:1], spec.edges[1:]]),
    ]
    for add, parts in adding:
        added = 0
        for edges in parts:
            arguments, options = columns(edges)
            assert list(add(*arguments, **options)) == list(range(added, added + len(edges)))
            added += len(edges)
    for bulk in (alike, mixed, single):
        assert bulk.shape == bulk.coboundary().shape == (spec.m, spec.n)
        assert bulk.number_of_edges == len(spec.edges)
        np.testing.assert_array_equal(bulk.coboundary().toarray(), spec.delta)
        np.testing.assert_array_equal(bulk.offset(), spec.b)
        L = bulk.laplacian().toarray()
        np.testing.assert_allclose(L, spec.delta.T @ spec.K @ spec.delta, rtol=0, atol=1e-11)
        np.testing.assert_array_equal(L, L.T)
    np.testing.assert_array_equal(alike.laplacian().toarray(), single.laplacian().toarray())
    np.testing.assert_array_equal(alike.whitened_offset(), single.whitened_offset())


def test_edges_added_later_join() -> None:
    """Matrices are made anew after each change."""
    sheaf = pair()
    before = sheaf.laplacian().toarray()
    assert sheaf.add_edge("c", "a", I2, I2) == 1
    assert sheaf.shape == (4, 7)
    after = sheaf.laplacian().toarray()
    np.testing.assert_array_equal(before[5:], 0.0)
    np.testing.assert_array_equal(after[5:, 5:], I2)
    np.testing.assert_array_equal(after[:2, :2], before[:2, :2] + I2)


def test_no_edges_at_once_is_legal() -> None:
    sheaf = pair()
    assert list(sheaf.add_edges([], [], np.zeros((0, 2, 2)), np.zeros((0, 2, 2)))) == []
    assert sheaf.number_of_edges == 1


def test_weights_may_be_numbers() -> None:
    sheaf, other = Sheaf({"a": 2, "b": 2}), Sheaf({"a": 2, "b": 2})
    F = np.array([I2, 2 * I2])
    sheaf.add_edges("aa", "bb", F, F, weight=[3.0, 0.5])
    other.add_edges("aa", "bb", F, F, weight=[3.0 * I2, 0.5 * I2])
    np.testing.assert_array_equal(sheaf.laplacian().toarray(), other.laplacian().toarray())


def test_later_changes_of_what_was_given_do_not_reach_the_sheaf() -> None:
    def build() -> tuple[Sheaf, dict[str, int], list[np.ndarray]]:
        stalks = {"a": 2, "b": 2, "c": 1}
        single = [I2.copy(), 3.0 * I2, np.ones(2), 2.0 * I2]
        many = [np.ones((1, 1, 1)), np.ones((1, 1, 2)), np.ones((1, 1)), np.full((1, 1, 1), 2.0)]
        sheaf = Sheaf(stalks)
        sheaf.add_edge("a", "b", single[0], single[1], offset=single[2], weight=single[3])
        sheaf.add_edges(["c"], ["a"], many[0], many[1], offset=many[2], weight=many[3])
        return sheaf, stalks, single + many

    changed, stalks, arrays = build()
    stalks["a"] = 7
    for array in arrays:
        array[:] = np.nan
    untouched, _, _ = build()
    assert changed.shape == untouched.shape
    np.testing.assert_array_equal(changed.coboundary().toarray(), untouched.coboundary().toarray())
    np.testing.assert_array_equal(changed.laplacian().toarray(), untouched.laplacian().toarray())
    np.testing.assert_array_equal(changed.offset(), untouched.offset())

    value = {"b": np.zeros(2)}
    extension = changed.harmonic_extension(value)
    value["b"][:] = np.nan
    assert np.isfinite(extension.x["b"]).all()


def test_cochains_are_packed_in_vertex_order() -> None:
    sheaf = pair()
    by_vertex: dict[Hashable, list[int]] = {"c": [6, 7], "a": [1, 2], "b": [3, 4, 5]}
    x = sheaf.pack(by_vertex)
    np.testing.assert_array_equal(x, [1, 2, 3, 4, 5, 6, 7])
    assert {v: list(value) for v, value in sheaf.unpack(x).items()} == by_vertex
    np.testing.assert_array_equal(sheaf.columns(["c", "a"]), [5, 6, 0, 1])


REFUSED: list[tuple[Build, str]] = [
    (lambda s: s.add_edge("a", "x", I2, I2), r"unknown vertex 'x'; the vertices are 'a', 'b', 'c'"),
    (lambda s: s.add_edges(UNHASHABLE, "a", [I2], [I2]), r"unknown vertex \['b'\]; the vertices are 'a', 'b', 'c'"),
    (lambda s: s.add_edge("a", "a", I2, I2), r"edge \('a', 'a'\) is a loop; its ends must differ"),
    (
        lambda s: s.add_edge("a", "b", I2, I2),
        r"edge \('a', 'b'\): the map of head 'b' has shape \(2, 2\), but the stalk has dimension 3; expected \(m, 3\)",
    ),
    (lambda s: s.add_edge("b", "a", I2, I2), r"the map of tail 'b' has shape \(2, 2\).*expected \(m, 3\)"),
    (lambda s: s.add_edge("a", "c", I2, np.eye(3, 2)), r"the maps have 2 and 3 rows; both must map to the same"),
    (lambda s: s.add_edge("a", "c", [1.0, 0.0], I2), r"maps of the tails have shape \(1, 2\); expected \(1, m, n\)"),
    (lambda s: s.add_edges("ac", "ca", [I2], [I2]), r"maps of the tails have shape \(1, 2, 2\); expected \(2, m, n\)"),
    (lambda s: s.add_edges("ac", "c", [I2, I2], [I2, I2]), r"2 tails but 1 heads"),
    (lambda s: s.add_edge("a", "c", I2, I2, weight=np.nan), r"an entry is not finite"),
    (lambda s: s.add_edge("a", "c", [[1, 2], [3]], I2), r"not an array of numbers of equal row lengths"),
    (lambda s: s.add_edge("a", "c", I2, I2, offset=[1.0]), r"offset has shape \(1, 1\); expected \(1, 2\)"),
    (lambda s: s.add_edge("a", "c", I2, I2, weight=np.eye(3)), r"weight has shape \(1, 3, 3\); expected \(1, 2, 2\)"),
    (lambda s: s.add_edge("a", "c", I2, I2, weight=0.0), r"weight is not symmetric positive definite"),
    (lambda s: s.add_edge("a", "c", I2, I2, weight=[[1, 2], [2, 1]]), r"smallest eigenvalue -1"),
    (lambda s: s.add_edge("a", "c", I2, I2, weight=np.ones((2, 2))), r"not symmetric positive definite"),
    (lambda s: s.add_edge("a", "c", I2, I2, weight=[[2, 0.5], [0.4, 2]]), r"asymmetry 0\.1\)"),
    (lambda s: s.add_edges("ac", "ca", [I2, I2], [I2, I2 * np.inf]), r"edge \('c', 'a'\): F_head: an entry is not"),
    (lambda s: s.add_mixed_edges("ac", "ca", [I2], [I2, I2]), r"2 tails: each edge needs a head and two maps"),
    (lambda s: s.add_mixed_edges("ab", "ba", [I2, FLAT], [FLAT, FLAT]), r"edge \('b', 'a'\): the map of head 'a'"),
    (lambda s: s.add_edges("ac", "ca", [I2, I2], [I2, I2], weight=[I2, -I2]), r"edge \('c', 'a'\): the weight is not"),
]


@pytest.mark.parametrize(("build", "message"), REFUSED, ids=[message[:40] for _, message in REFUSED])
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_wrong_edges_are_refused_and_nothing_is_added(build: Build, message: str) -> None:
    sheaf, untouched = pair(), pair()
    with pytest.raises(SheafError, match=message):
        build(sheaf)
    assert sheaf.number_of_edges == 1
    np.testing.assert_array_equal(sheaf.coboundary().toarray(), untouched.coboundary().toarray())
    np.testing.assert_array_equal(sheaf.laplacian().toarray(), untouched.laplacian().toarray())
    assert sheaf.add_edge("c", "a", I2, I2) == 1


def test_stalks_need_whole_dimensions_and_a_sheaf_a_vertex() -> None:
    wrong: tuple[Any, ...] = (-1, 1.5, True, "2", None)
    for dimension in wrong:
        with pytest.raises(SheafError, match="'a': dimension"):
            Sheaf({"a": dimension})
    with pytest.raises(SheafError, match="at least one vertex"):
        Sheaf({})
    assert issubclass(SheafError, InputError)  # exit code 2, and ValueError


@pytest.mark.parametrize(
    ("x", "message"),
    [
        (np.zeros(6), r"a 0-cochain has shape \(7,\); this one has \(6,\)"),
        (np.full(7, np.nan), "0-cochain: an entry is not finite"),
        ({"a": [0, 0], "b": [0, 0, 0]}, r"missing \['c'\], unknown \[\]"),
        ({"a": [0, 0], "b": [0, 0, 0], "c": [0, 0], "d": 1}, r"missing \[\], unknown \['d'\]"),
        ({"a": [0, 0, 0], "b": [0, 0, 0], "c": [0, 0]}, r"value of vertex 'a' has shape \(3,\); expected \(2,\)"),
    ],
)
def test_wrong_cochains_are_refused(x: Any, message: str) -> None:
    for use in (pair().pack, pair().dirichlet_energy, pair().nearest_global_section):
        with pytest.raises(SheafError, match=message):
            use(x)
