"""Bounded, continuous, seeded disturbances omega_i(t): the paper's Assumption 3.

omega(t) = bound * sum_k a_k d_k sin(2 pi nu_k t + phi_k) with unit directions d_k and weights a_k that sum to 1, so
that |omega(t)| <= bound for all t. Frequencies, phases and directions are drawn once from a seed; the function of time
is smooth, and the same whatever integrates it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjsheaf.compiled import part
from mjsheaf.errors import InputError

Array = NDArray[np.float64]


@part
def disturbance_velocity(harmonics, v, t):
    """omega_v(t) as three numbers; harmonics (V, K, 5) holds amplitude (3) in m/s, rate in rad/s and phase in rad."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(harmonics.shape[1]):
        s = np.sin(harmonics[v, k, 3] * t + harmonics[v, k, 4])
        x += harmonics[v, k, 0] * s
        y += harmonics[v, k, 1] * s
        z += harmonics[v, k, 2] * s
    return x, y, z


@dataclass(frozen=True)
class Disturbance:
    """A kind of disturbance, from which each vehicle draws its own.

    Attributes:
        bound: bound on |omega(t)| in m/s.
        frequencies: lowest and highest frequency in Hz.
        components: number of harmonics.
    """

    bound: float
    frequencies: tuple[float, float] = (0.05, 0.5)
    components: int = 6

    def __post_init__(self) -> None:
        low, high = self.frequencies
        if not (self.bound >= 0.0 and 0.0 < low <= high and self.components >= 1):
            raise InputError("a disturbance needs bound >= 0, 0 < lowest <= highest frequency, and a component")


def draw(kinds: list[Disturbance | None], dimensions: list[int], rng: np.random.Generator) -> Array:
    """Draw the harmonics of each vehicle, shape (V, K, 5); vehicles whose kind is None have none."""
    count = max([kind.components for kind in kinds if kind is not None and kind.bound > 0.0], default=0)
    harmonics = np.zeros((len(kinds), count, 5))
    for v, (kind, n) in enumerate(zip(kinds, dimensions, strict=True)):
        if kind is None or kind.bound == 0.0:
            continue
        k = kind.components
        direction = rng.standard_normal((k, n))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        share = rng.uniform(0.5, 1.0, k)
        harmonics[v, :k, :n] = kind.bound * (share / share.sum())[:, None] * direction
        harmonics[v, :k, 3] = 2.0 * np.pi * rng.uniform(*kind.frequencies, k)
        harmonics[v, :k, 4] = rng.uniform(0.0, 2.0 * np.pi, k)
    return harmonics


def evaluate(harmonics: Array, times: Array) -> Array:
    """omega of every vehicle at many times, shape (T, V, 3), m/s."""
    s = np.sin(times[:, None, None] * harmonics[..., 3] + harmonics[..., 4])
    return np.einsum("tvk,vki->tvi", s, harmonics[..., :3])


def bounds(harmonics: Array) -> Array:
    """omega_bar of every vehicle, the sum of its amplitudes, shape (V,), m/s."""
    return np.asarray(np.linalg.norm(harmonics[..., :3], axis=2).sum(axis=1), dtype=np.float64)
