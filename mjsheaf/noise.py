"""Random numbers that are counted, not drawn in turn: number n of a stream is the same in any piece, thread or order.

Philox4x32 with ten rounds (Salmon, Moraes, Dror and Shaw, Parallel random numbers: as easy as 1, 2, 3, SC 2011), and
pairs of normal numbers by Box and Muller.
"""

import numpy as np

from mjsheaf.jit import inline_jit, jit

_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_MULTIPLIERS = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
_WEYL = (np.uint64(0x9E3779B9), np.uint64(0xBB67AE85))
_UNIT = 2.0**-32
LARGEST_NORMAL = float(np.sqrt(-2.0 * np.log(0.5 * _UNIT)))
"""No number of `normals` is larger."""


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


@jit
def normals(seed, stream, number, count):
    """Four independent standard normal numbers.

    Args:
        seed: of the run.
        stream: what they are for, and for whom, two numbers below 2^31.
        number: of the sample.
        count: of four numbers at a time within the sample.
    """
    key = np.uint64(seed) & _LOW, np.uint64(seed) >> _HALF
    words = philox(key, (np.uint64(number), np.uint64(count), np.uint64(stream[0]), np.uint64(stream[1])))
    first, second = np.sqrt(-2.0 * np.log((words[0] + 0.5) * _UNIT)), np.sqrt(-2.0 * np.log((words[2] + 0.5) * _UNIT))
    one, two = 2.0 * np.pi * _UNIT * words[1], 2.0 * np.pi * _UNIT * words[3]
    return first * np.cos(one), first * np.sin(one), second * np.cos(two), second * np.sin(two)
