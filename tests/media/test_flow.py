"""Flow fields: velocity.

Oracle: the kernels of the published run written out in numpy, at its own numbers (tests/data/paper_facts.json).
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf.errors import InputError
from mjsheaf.media.flow import FlowField, Source, decay
from tests.builders import FACTS, field_of, of_facts
from tests.oracles.flow import flow_velocity

SETS = ("agent_field", "target_field")


@pytest.mark.parametrize("name", SETS)
def test_velocity_is_that_of_the_published_run(name: str) -> None:
    facts, rng = FACTS[name], np.random.default_rng(0)
    n, poles = facts["dimension"], [*facts["sources"], *facts["vortices"]]
    points = np.concatenate(
        [scale * rng.standard_normal((200, n)) for scale in (0.3, 3.0, 60.0)]
        + [np.array(p[:n]) + scale * rng.standard_normal((20, n)) for p in poles for scale in (0.0, 0.01, 0.2)]
    )
    field = of_facts(facts)
    np.testing.assert_allclose(field.velocity(points), flow_velocity(field, points), rtol=1e-12, atol=1e-14)


@given(st.integers(0, 2**31), st.sampled_from([2, 3]), st.sampled_from([2, 3]))
def test_any_field_is_the_sum_of_its_kernels(seed: int, dimension: int, of_points: int) -> None:
    """Random kernels, axes that are not unit vectors, and points of either dimension."""
    rng = np.random.default_rng(seed)
    n = dimension
    field = field_of(
        n,
        rng.uniform(0.5, 2.0),
        rng.standard_normal(n).tolist(),
        rng.standard_normal((2, n + 1)).tolist(),
        rng.standard_normal((2, 3 if n == 2 else 7)).tolist(),
        np.hstack([rng.standard_normal((2, 2 * n + 1)), rng.uniform(0.5, 2.0, (2, 2))]).tolist(),
    )
    points = 3.0 * rng.standard_normal((20, of_points))
    np.testing.assert_allclose(field.velocity(points), flow_velocity(field, points), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("shape", [(), (4,), (2, 3), (2, 1, 3), (0,)])
def test_many_points_at_once_are_the_points_one_by_one(name: str, shape: tuple[int, ...]) -> None:
    field, d = of_facts(FACTS[name]), FACTS[name]["dimension"]
    points = np.random.default_rng(6).standard_normal((*shape, d))
    w = field.velocity(points)
    assert w.shape == (*shape, d)
    for index in np.ndindex(*shape):
        np.testing.assert_array_equal(w[index], field.velocity(points[index]))


def test_decay_in_python_has_the_bits_of_the_compiled_one() -> None:
    in_python = getattr(decay, "py_func", decay)
    for x in (0.0, 1e-300, 0.3, 1.5, 36.7, 600.0, 700.0):
        assert in_python(x) == decay(x) == pytest.approx(np.exp(-x), rel=3e-16)
    assert np.isnan([in_python(np.nan), decay(np.nan)]).all()  # a position that is no number is reported elsewhere


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: field_of(4), "dimension: .*not 4"),
        (lambda: field_of(2, sources=[[0, 0, 1]]), "give a 'core' radius"),
        (lambda: field_of(3, -1.0, vortices=[[0, 0, 0, 0, 0, 1, 1]]), "core: .*not -1.0"),
        (lambda: FlowField(dimension=3, core=0, sources=[Source(centre=[0, 0], alpha=1)]), "sources.0.centre has 2"),
        (lambda: field_of(2, 0.1, vortices=[[0, 0, 1], [0, 0, 0, 0, 1, 1]]), "vortices: .*in the plane the axis is z"),
        (lambda: field_of(2, drift=[1, 2, 3]), "drift has 3 numbers; expected 2"),
        (lambda: field_of(2, channels=[[0, 0, 0, 0, 1, 1, 1]]), "non-zero direction and a positive width and length"),
        (lambda: field_of(2, channels=[[0, 0, 1, 0, 1, 1e-160, 1]]), "width and length, of 1e-100 m at least"),
        (lambda: field_of(2).velocity(1.0), r"points have shape \(\); expected \(\.\.\., 2\) or \(\.\.\., 3\)"),
        (lambda: field_of(2).velocity(np.zeros((2, 4))), r"points have shape \(2, 4\)"),
    ],
)
def test_wrong_fields_are_refused(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
