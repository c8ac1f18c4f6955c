"""Films of runs that blew up: positions that no picture can hold, or none at all."""

from dataclasses import dataclass, replace

import numpy as np

from mjsheaf.video.film import Film
from mjsheaf.video.series import FloatArray, Series, blocks, changed, rows

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
        examined = np.arange(0, len(film.time), max(1, len(film.time) // EXAMINED))
        positions = rows(film.positions, examined).reshape(-1, 3)
        positions = positions[np.isfinite(positions).all(axis=-1)]
        if not len(positions):
            return cls(np.zeros(3), 1.0)
        centre: FloatArray = np.median(positions, axis=0)
        return cls(centre, max(float(np.quantile(np.abs(positions - centre).max(axis=-1), 0.75)), 1.0))

    def drawable(self, film: Film) -> Film:
        """Make every position and attitude one that can be drawn.

        A vehicle without a position stays where it was last, in a film that is read in blocks where it was last in
        its block; one that is absurdly far goes no farther.
        """
        return replace(
            film,
            positions=changed(film.positions, self._confined),
            harmonic_extension=changed(film.harmonic_extension, self._confined),
            quaternions=changed(film.quaternions, _attitudes),
        )

    def followed(self, positions: Series) -> Series:
        """Put what blew up where it last was sane, for the camera to stay with the rest.

        Args:
            positions: of the film's vehicles, or its harmonic extension. Shape (T, n, 3), in m.
        """
        vehicles = positions.shape[1]
        last = np.zeros(vehicles, np.int64)  # sample at which each was last near
        place = np.repeat(self.centre[None], vehicles, axis=0)  # and where it was then
        gone = np.zeros(vehicles, bool)
        for start, block in blocks(positions):
            distance = self._distance(block)
            absurd = distance > ABSURD * self.size
            near = (distance <= LET_GO * self.size) & ~np.logical_or.accumulate(absurd, axis=0) & ~gone
            for vehicle in np.flatnonzero(near.any(axis=0)):
                sample = int(np.flatnonzero(near[:, vehicle])[-1])
                last[vehicle], place[vehicle] = start + sample, block[sample, vehicle]
            gone |= absurd.any(axis=0)
        if not gone.any():
            return positions

        def stay(start: int, block: FloatArray) -> FloatArray:
            after = gone & (start + np.arange(len(block))[:, None] >= last)
            return np.where(after[..., None], place, block)

        return changed(positions, stay)

    def _confined(self, _: int, positions: FloatArray) -> FloatArray:
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


def _attitudes(_: int, quaternions: FloatArray) -> FloatArray:
    """Make those that are not known upright."""
    known = np.isfinite(quaternions).all(axis=-1, keepdims=True)
    return quaternions if known.all() else np.where(known, quaternions, [1.0, 0.0, 0.0, 0.0])
