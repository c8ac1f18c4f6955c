"""Films of runs that blew up: positions that no picture can hold, or none at all."""

from dataclasses import dataclass, replace

import numpy as np

from mjsheaf.video.film import Film, FloatArray

ABSURD = 100.0  # a vehicle that is ever farther than this many times the reach has blown up,
LET_GO = 3.0  # and the camera follows it no more once it is farther than this many times the reach
EXAMINED = 2000  # samples from which the reach is found


@dataclass(frozen=True)
class Reach:
    """What far means in a film: measured against the run itself, and robustly.

    Attributes:
        centre: the middle of everything at all times. Shape (3,), in m.
        size: the distance from it within which three quarters of everything lies, at least 1, in m.
    """

    centre: FloatArray
    size: float

    @classmethod
    def of(cls, film: Film) -> "Reach":
        """Measure a film."""
        positions = film.positions[:: max(1, len(film.time) // EXAMINED)].reshape(-1, 3)
        positions = positions[np.isfinite(positions).all(axis=-1)]
        if not len(positions):
            return cls(np.zeros(3), 1.0)
        centre: FloatArray = np.median(positions, axis=0)
        return cls(centre, max(float(np.quantile(np.abs(positions - centre).max(axis=-1), 0.75)), 1.0))

    def drawable(self, film: Film) -> Film:
        """Make every position and attitude one that can be drawn.

        A vehicle without a position stays where it was last; one that is absurdly far goes no farther.
        """
        known = np.isfinite(film.quaternions).all(axis=-1, keepdims=True)
        return replace(
            film,
            positions=self._confined(film.positions),
            harmonic_extension=self._confined(film.harmonic_extension),
            quaternions=film.quaternions if known.all() else np.where(known, film.quaternions, [1, 0, 0, 0]),
        )

    def followed(self, positions: FloatArray) -> FloatArray:
        """Put what blew up where it last was sane, for the camera to stay with the rest.

        Args:
            positions: of the film's vehicles, or its harmonic extension. Shape (T, n, 3), in m.
        """
        distance = self._distance(positions)
        absurd = distance > ABSURD * self.size
        if not absurd.any():
            return positions
        result = positions.copy()
        for vehicle in np.flatnonzero(absurd.any(axis=0)):
            gone = int(np.argmax(absurd[:, vehicle]))
            near = np.flatnonzero(distance[:gone, vehicle] <= LET_GO * self.size)
            last = int(near[-1]) if len(near) else 0
            result[last:, vehicle] = positions[last, vehicle] if len(near) else self.centre
        return result

    def _confined(self, positions: FloatArray) -> FloatArray:
        """Fill gaps in positions (T, n, 3) from before, and keep them from being absurd."""
        if (self._distance(positions) <= ABSURD * self.size).all():
            return positions
        # The last sample with a position, up to each sample; -1, and so the centre, where there is none yet.
        finite = np.isfinite(positions).all(axis=-1)
        last = np.maximum.accumulate(np.where(finite, np.arange(len(positions))[:, None], -1), axis=0)
        filled = np.take_along_axis(positions, np.maximum(last, 0)[..., None], axis=0)
        limit = ABSURD * self.size
        return np.clip(np.where((last >= 0)[..., None], filled, self.centre), self.centre - limit, self.centre + limit)

    def _distance(self, positions: FloatArray) -> FloatArray:
        """Return the largest coordinate relative to the centre, infinite where there is no position."""
        distance = np.abs(positions - self.centre).max(axis=-1)
        return np.where(np.isnan(distance), np.inf, distance)
