"""Station keeping: vehicles that have yet to join hold their position, each by itself.

Vehicle v at x commands gain (position - x) - w relative to the medium, whose velocity w it measures there: over
ground it returns to its position at the rate of the gain. The speed is limited as the vehicle's commands are.

The gain is 1 / (4 (tau + h)), at most MAX_GAIN, with the time constant tau of the body and the control period h: the
loop of position and velocity is then critically damped or slower.
"""

from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.jit import inline_jit
from mjsheaf.law.terms import limit_speed

MAX_GAIN = 1.0
"""Largest gain of station keeping, 1/s."""


class Station(NamedTuple):
    """Positions that vehicles hold, for compiled code.

    Attributes:
        holds: True for each vehicle that holds its position, shape (V,).
        position: Controlled position to hold, padded, shape (V, 3), m.
        gain: Gain of each vehicle, shape (V,), 1/s.
        limit: Largest commanded speed of each vehicle, shape (V,), m/s.
    """

    holds: BoolArray
    position: Array
    gain: Array
    limit: Array

    def with_time_constants(self, tau: Array, period: float) -> "Station":
        """Return the same station with gains for time constants tau (V,) and a control period, in s."""
        delay = np.maximum(tau + period, 0.25 / MAX_GAIN)
        return self._replace(gain=0.25 / delay)


def no_station(V: int) -> Station:
    """Return a station that none of V vehicles keeps."""
    return Station(np.zeros(V, dtype=np.bool_), np.zeros((V, 3)), np.zeros(V), np.full(V, np.inf))


@inline_jit
def keep_station(station, v, x, w, command):
    """Write into command (3,) the velocity with which vehicle v at x (3,) holds its position in a medium at w (3,)."""
    for i in range(3):
        command[i] = station.gain[v] * (station.position[v, i] - x[i]) - w[i]
    limit_speed(station.limit[v], command)
