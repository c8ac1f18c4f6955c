"""Solvers of the harmonic extension.

Oracles: scipy's conjugate gradients, with a dense preconditioner written from its definition.
"""

import numpy as np
import pytest
from scipy import linalg, sparse
from scipy.sparse.linalg import cg

from mjsheaf import Sheaf
from mjsheaf.errors import SheafError
from mjsheaf.sheaf import sheaf as solvers
from mjsheaf.sheaf.sheaf import conjugate_gradients
from tests.builders import bundle_on_a_grid
from tests.commands import python


@pytest.mark.parametrize("relaxation", [0.7, 1.0, 1.75])
def test_compiled_conjugate_gradients_are_the_textbook_ones(relaxation: float) -> None:
    """Preconditioned by M = (I/w + L) w (I/w + L^T) / (2 - w), without a trick: the same iterates as scipy's."""
    rng = np.random.default_rng(0)
    n = 30
    A = rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.2)
    A = A @ A.T + np.eye(n)
    A /= np.sqrt(np.outer(np.diag(A), np.diag(A)))
    U, b = np.triu(A, 1), rng.standard_normal(n)
    upper = sparse.csr_array(U)
    arrays = upper.indptr.astype(np.int64), upper.indices, upper.data
    half = np.eye(n) / relaxation + U
    M = half.T @ (relaxation * half)
    for step in range(1, 9):
        x, _ = cg(A, b, M=np.linalg.inv(M), rtol=0.0, maxiter=step)
        found, iterations = conjugate_gradients(*arrays, b, relaxation, 0.0, step)
        assert iterations == step
        np.testing.assert_allclose(found, x, rtol=1e-8, atol=1e-10)
    found, _ = conjugate_gradients(*arrays, b, relaxation, 1e-13, 1000)
    np.testing.assert_allclose(found, linalg.solve(A, b, assume_a="pos"), rtol=1e-9)


def test_a_path_of_twenty_thousand_is_a_straight_line() -> None:
    """Condition 1e8, far from what conjugate gradients could do."""
    n = 20_000
    path = Sheaf(dict.fromkeys(range(n), 1))
    maps = np.ones((n - 1, 1, 1))
    path.add_edges(range(n - 1), range(1, n), maps, maps)
    extension = path.harmonic_extension({0: 0.0, n - 1: 1.0})
    assert extension.unique
    np.testing.assert_allclose(np.concatenate(list(extension.x.values())), np.linspace(0.0, 1.0, n), atol=1e-9)


def test_what_does_not_converge_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solvers, "MOST_ITERATIONS", 5)
    sheaf, _ = bundle_on_a_grid(80)
    with pytest.raises(SheafError, match=r"residual \S+ .* 5 .* 1e-08"):
        sheaf.harmonic_extension({0: [1.0, 2.0, 3.0]})


def test_what_is_too_badly_conditioned_is_said() -> None:
    """Weights over 16 decades on more states than are decomposed densely."""
    n = 1500
    path = Sheaf(dict.fromkeys(range(n), 1))
    maps = np.ones((n - 1, 1, 1))
    path.add_edges(range(n - 1), range(1, n), maps, maps, weight=[1e-17 if i == 3 else 1.0 for i in range(n - 1)])
    with pytest.raises(SheafError, match="1499 states"):
        path.harmonic_extension({0: 1.0})


EXTENSIONS = """
import hashlib, itertools, numpy as np
from tests.builders import build_scenario, bundle_on_a_grid

def show(x):
    print(hashlib.sha256(x.tobytes()).hexdigest())

for side in (40, 80):
    found = bundle_on_a_grid(side)[0].harmonic_extension({0: [1, 2, 3], 700: [3, 2, 1]})
    show(np.concatenate(list(found.x.values())))
agents = {f"A{i}": place for i, place in enumerate(np.random.default_rng(1).uniform(-20, 20, (40, 2)).tolist())}
ranges = [{"between": pair, "measures": "range"} for pair in itertools.combinations(agents, 2)]
ring = {"name": "ring", "shape": "polygon", "radius": 10, "members": list(agents)}
sensing = [["A0", "T"], ["A1", "T"]]
team = build_scenario(agents, {"T": [1, 2]}, sensing, communication=ranges, formations=[ring]).team
show(team.extend(np.array([1.0, 2.0]), np.concatenate(list(agents.values()))))
"""


@pytest.mark.long
def test_the_bits_do_not_depend_on_the_number_of_threads() -> None:
    """Of an extension by conjugate gradients, of one by a factor, and of q* where all agents measure all ranges."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
    one, two = (python(EXTENSIONS, None, **dict.fromkeys(names, threads)) for threads in ("1", "2"))
    assert (one.returncode, one.stdout.count("\n")) == (0, 3), one.stderr
    assert one.stdout == two.stdout
