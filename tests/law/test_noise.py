"""Counted random numbers.

Oracles: the known answers of Random123 (kat_vectors) for Philox4x32 with ten rounds; what standard normal numbers must
be, with bounds of five standard errors; the odometry that is drawn from them.
"""

import numpy as np
import pytest
from scipy import stats

from mjsheaf.arrays import Array
from mjsheaf.noise import normals, philox

ONES = 0xFFFFFFFF


@pytest.mark.parametrize(
    ("key", "counter", "words"),
    [
        ((0, 0), (0, 0, 0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((ONES, ONES), (ONES, ONES, ONES, ONES), (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0xA4093822, 0x299F31D0),
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_known_answers(key: tuple[int, ...], counter: tuple[int, ...], words: tuple[int, ...]) -> None:
    found = philox(tuple(map(np.uint64, key)), tuple(map(np.uint64, counter)))
    assert tuple(map(int, found)) == words


def drawn(seed: int, stream: tuple[int, int], count: int) -> Array:
    return np.array([normals(seed, stream, n, 0) for n in range(count)])


def test_they_are_standard_normal() -> None:
    x = drawn(3, (1, 5), 50_000).ravel()
    n = len(x)
    assert abs(x.mean()) < 5 / np.sqrt(n)
    assert abs(x.var() - 1.0) < 5 * np.sqrt(2 / n)
    assert abs(stats.skew(x)) < 5 * np.sqrt(6 / n)
    assert abs(stats.kurtosis(x)) < 5 * np.sqrt(24 / n)
    assert stats.kstest(x, "norm").pvalue > 1e-4
    assert np.abs(x).max() < 6.7  # words of 32 bits reach no farther
    assert np.isfinite(x).all()


def test_streams_samples_seeds_and_the_four_of_a_draw_are_independent() -> None:
    """Also where only one word of key or counter differs by one, in its lower half or its upper."""
    count = 20_000
    one = drawn(7, (1, 0), count)
    others = [
        *(one[:, k] for k in range(4)),
        one[:, 0][np.r_[1:count, 0]],
        drawn(7, (1, 1), count)[:, 0],
        drawn(7, (2, 0), count)[:, 0],
        drawn(8, (1, 0), count)[:, 0],
        drawn(7 + 2**32, (1, 0), count)[:, 0],
        np.array([normals(7, (1, 0), n, 1)[0] for n in range(count)]),
    ]
    for values in (np.array(others), np.abs(others)):
        correlation = np.corrcoef(values)
        np.testing.assert_array_less(np.abs(correlation - np.eye(len(others))), 5 / np.sqrt(count))
