"""Theorem 1 beside a finished run: the bound on |e(t)|, and how much of it the run used."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf.backends.system import System
from mjsheaf.checking.constants import certify, take_constants
from mjsheaf.checking.region import region_of_run
from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.control.theorem import Theorem
from mjsheaf.results.file import pieces_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RunBound:
    """The bound of a run.

    Attributes:
        applies: whether the gain condition holds over the region of this very run.
        approximate: whether the theorem's setting is only approached: a held law, or bodies.
        reason: why it does not apply, or empty.
        theorem: the theorem with the constants of that region.
        start: time of the first sample, s.
        initial_error: measured |e| there, m.
        ratio: largest measured / bound, after the start, where both are |e(t0)|; None where it does not apply.
        settled_ratio: the same over the second half of the run, where the initial error has less to say.
    """

    applies: bool
    approximate: bool
    reason: str
    theorem: Theorem
    start: float
    initial_error: float
    ratio: float | None
    settled_ratio: float | None

    def at(self, time: Array) -> Array:
        """The theorem's bound on |e| at times in s, in m; infinite where it does not apply."""
        return self.theorem.bound(self.initial_error, time - self.start)


def bound_of_run(system: System, dataset: xr.Dataset) -> RunBound:
    """Evaluate the theorem over the region of a run and compare; the run is read in pieces."""
    places = ["agent_position", "target_position"]
    positions = (
        np.nan_to_num(np.concatenate([piece[name].values for name in places], axis=1))
        for piece in pieces_of(dataset, places)
    )
    region = region_of_run(system, positions, "this run")
    spectrum = spectrum_of(system.team)
    constants = take_constants(system, region, spectrum)
    certificate = certify(system, region, constants, spectrum)
    first = dataset["tracking_error"][0].values
    bound = RunBound(
        applies=certificate.applies,
        approximate=certificate.approximate or dataset.attrs["backend"] == "physics",
        reason=certificate.reason,
        theorem=certificate.theorem,
        start=float(dataset["time"][0]),
        initial_error=float(np.sqrt((first**2).sum())),
        ratio=None,
        settled_ratio=None,
    )
    if not certificate.applies:
        return bound
    ratio, settled, done, half = 0.0, 0.0, 0, dataset.sizes["time"] // 2
    for piece in pieces_of(dataset, ["time", "tracking_error"]):
        error = np.sqrt((piece["tracking_error"].values ** 2).sum(axis=1))
        allowed = bound.at(piece["time"].values)
        ratio = max(ratio, _largest_ratio(error[done == 0 :], allowed[done == 0 :]))
        settled = max(settled, _largest_ratio(error[max(half - done, 0) :], allowed[max(half - done, 0) :]))
        done += len(error)
    return replace(bound, ratio=ratio, settled_ratio=settled)


def _largest_ratio(error: Array, bound: Array) -> float:
    positive = bound > 0.0
    return float(np.max(error[positive] / bound[positive], initial=0.0))
