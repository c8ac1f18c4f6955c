"""Random numbers that are counted, not drawn in turn: number n of a stream is the same in any piece, thread or order.

Philox4x32 with ten rounds (Salmon, Moraes, Dror and Shaw, Parallel random numbers: as easy as 1, 2, 3, SC 2011), and
pairs of normal numbers by Box and Muller.
"""

from hashlib import blake2b

import numpy as np

from mjsheaf.compile.jit import inline_jit, jit

_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_MULTIPLIERS = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
_WEYL = (np.uint64(0x9E3779B9), np.uint64(0xBB67AE85))
_UNIT = 2.0**-32
LARGEST_NORMAL = float(np.sqrt(-2.0 * np.log(0.5 * _UNIT)))
"""No number of `normals` is larger."""


def stream_of(*words: object) -> tuple[int, int]:
    """Return the stream with this name: 61 bits that depend on nothing but the words.

    The first number is at least 2^30 and both are below 2^31.
    """
    word = blake2b(" ".join(map(str, words)).encode(), digest_size=8).digest()
    return 2**30 + (int.from_bytes(word[:4]) >> 2), int.from_bytes(word[4:]) >> 1


def generator_of(seed: int, *words: object) -> np.random.Generator:
    """Return a generator for what is drawn once, before a run, by its seed and name.

    It is independent of the generators of other names, and of how many there are.
    """
    words_of_seed = [seed] if seed < 2**32 else [seed & (2**32 - 1), seed >> 32]
    # The same generator as for a list of integers, which NumPy would split into words in twice the time.
    return np.random.default_rng(np.array([*words_of_seed, *stream_of(*words)], dtype=np.uint32))


def next_seed(seed: int) -> int:
    """Return the seed of the episode that follows that of a seed: below 2^53, which JSON and doubles keep exactly."""
    first, second = stream_of(seed, "next episode")
    return (first & (2**22 - 1)) << 31 | second


@inline_jit
def philox(key, counter):
    """Four words of 32 bits, as uint64, for a key of two such words and a counter of four."""
    k0, k1 = key
    a, b, c, d = counter
    for _ in range(10):
        p, q = _MULTIPLIERS[0] * a, _MULTIPLIERS[1] * c
        a, b, c, d = (q >> _HALF) ^ b ^ k0, q & _LOW, (p >> _HALF) ^ d ^ k1, p & _LOW
        k0, k1 = (k0 + _WEYL[0]) & _LOW, (k1 + _WEYL[1]) & _LOW
    return a, b, c, d


@inline_jit
def _words(seed, stream, number, count):
    key = np.uint64(seed) & _LOW, np.uint64(seed) >> _HALF
    return philox(key, (np.uint64(number), np.uint64(count), np.uint64(stream[0]), np.uint64(stream[1])))


@inline_jit
def uniforms(seed, stream, number, count):
    """Four independent numbers in (0, 1); with the same arguments `normals` is made of the same words."""
    a, b, c, d = _words(seed, stream, number, count)
    return (a + 0.5) * _UNIT, (b + 0.5) * _UNIT, (c + 0.5) * _UNIT, (d + 0.5) * _UNIT


@inline_jit
def normal_of(p):
    """The standard normal number below which a share p of them lies, 0 < p < 1, to 1.2e-9 of it.

    Acklam, An algorithm for computing the inverse normal cumulative distribution function (2003). One in twenty numbers
    takes the logarithm, which costs as much as all else.
    """
    q = p - 0.5
    if abs(q) <= 0.47575:
        r = q * q
        above = ((-39.69683028665376 * r + 220.9460984245205) * r - 275.9285104469687) * r + 138.3577518672690
        below = ((-54.47609879822406 * r + 161.5858368580409) * r - 155.6989798598866) * r + 66.80131188771972
        above = (above * r - 30.66479806614716) * r + 2.506628277459239
        return q * above / ((below * r - 13.28068155288572) * r + 1.0)
    r = np.sqrt(-2.0 * np.log(min(p, 1.0 - p)))
    above = ((-0.007784894002430293 * r - 0.3223964580411365) * r - 2.400758277161838) * r - 2.549732539343734
    below = ((0.007784695709041462 * r + 0.3224671290700398) * r + 2.445134137142996) * r + 3.754408661907416
    return np.copysign(((above * r + 4.374664141464968) * r + 2.938163982698783) / (below * r + 1.0), q)


@jit
def normals(seed, stream, number, count):
    """Return four independent standard normal numbers.

    Args:
        seed: Seed of the run.
        stream: Purpose of the numbers and their vehicle or edge, two numbers below 2^31.
        number: Number of the sample.
        count: Number of the group of four within the sample.
    """
    words = _words(seed, stream, number, count)
    first, second = np.sqrt(-2.0 * np.log((words[0] + 0.5) * _UNIT)), np.sqrt(-2.0 * np.log((words[2] + 0.5) * _UNIT))
    one, two = 2.0 * np.pi * _UNIT * words[1], 2.0 * np.pi * _UNIT * words[3]
    return first * np.cos(one), first * np.sin(one), second * np.cos(two), second * np.sin(two)
