"""Control effectiveness: right inverses, and the turns that the compiled code gives a layout.

Oracle: `matrix`, g(q, t) = R(psi) W written out, and numpy's pseudo-inverse of it.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from mjsheaf.errors import InputError
from mjsheaf.vehicles import allocation as effectiveness
from mjsheaf.vehicles.allocation import ControlEffectiveness
from tests.builders import turn


def matrix(g: ControlEffectiveness, q: ArrayLike, t: float) -> NDArray[np.float64]:
    """g(q, t) at the position q (n,) in m and the time t in s, shape (n, s)."""
    W = np.array(g.layout, dtype=np.float64)
    psi = g.heading + g.heading_rate * t + (0.0 if g.heading_gradient is None else np.dot(g.heading_gradient, q))
    W[:2] = turn(np.deg2rad(psi)) @ W[:2]
    return W


@st.composite
def models(draw: st.DrawFn) -> tuple[list[ControlEffectiveness | None], list[int], np.random.Generator]:
    """Agents with n states and s >= n inputs each, some with g = I; every turn depends on position and time."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    sizes = draw(st.lists(st.sampled_from([2, 3]), min_size=1, max_size=4))
    made: list[ControlEffectiveness | None] = []
    for n in sizes:
        s = draw(st.integers(n, 6))
        W = rng.standard_normal((n, s)) + 2.0 * np.eye(n, s)
        g = ControlEffectiveness(
            layout=W.tolist(),
            heading=rng.uniform(-180, 180),
            heading_gradient=(50.0 * rng.standard_normal(n)).tolist(),
            heading_rate=rng.uniform(-100, 100),
        )
        made.append(draw(st.sampled_from([g, g, None])))
    return made, sizes, rng


@given(models())
def test_allocation_is_the_pseudo_inverse_and_gives_the_velocity_back(case: tuple[Any, ...]) -> None:
    """U = g^+ v with g of `matrix`; then g u = v, as g g^+ = I: full row rank, whatever s."""
    made, sizes, rng = case
    packed = effectiveness.pack(made, sizes)
    for i, (g, n) in enumerate(zip(made, sizes, strict=True)):
        assert packed.given[i] == (g is not None)
        q, t, velocity = np.zeros(3), float(rng.uniform(0, 50)), np.zeros(3)
        q[:n], velocity[:n] = rng.uniform(-20, 20, n), rng.standard_normal(n)
        G = np.eye(n) if g is None else matrix(g, q[:n], t)
        got, u = velocity.copy(), np.full(packed.pinv.shape[1], np.nan)
        effectiveness.allocate(packed, i, q, t, got, u)
        s = G.shape[1]
        np.testing.assert_allclose(u[:s], np.linalg.pinv(G) @ velocity[:n], atol=1e-10)
        np.testing.assert_array_equal(u[s:], 0.0)
        np.testing.assert_allclose(G @ u[:s], velocity[:n], atol=1e-11)
        np.testing.assert_allclose(got, velocity, atol=1e-11)
        assert np.linalg.matrix_rank(G) == n


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (ControlEffectiveness(layout=[[1, 0, 0]]), "must have 2 rows of equal length"),
        (ControlEffectiveness(layout=[[1, 0], [0]]), "must have 2 rows of equal length"),
        (
            ControlEffectiveness(layout=[[1, 0], [0, 1]], heading_gradient=[1, 0, 0]),
            "heading gradient has 3 entries; expected 2",
        ),
    ],
)
def test_models_of_the_wrong_shape_are_refused(model: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        effectiveness.pack([model], [2])


def test_layouts_without_full_row_rank_are_known() -> None:
    """Assumption 2: such a team may be described and checked, but not run on ideal kinematics."""
    models = [ControlEffectiveness(layout=[[1, 2], [2, 4]]), ControlEffectiveness(layout=[[1, 0], [1, 1]]), None]
    models.append(ControlEffectiveness(layout=[[1], [1]]))
    arrays = effectiveness.pack(models, [2] * 4)
    assert effectiveness.without_full_row_rank(arrays, [2] * 4) == [0, 3]
