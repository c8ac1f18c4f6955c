"""Theorem 1 beside a finished run: the bound on |e(t)|, and how much of it the run used."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf.backends.system import System
from mjsheaf.checking.constants import certify, take_constants
from mjsheaf.checking.region import region_of_run
from mjsheaf.checking.spectrum import spectrum_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RunBound:
    """The bound of a run.

    Attributes:
        applies: whether the gain condition holds over the region of this very run.
        approximate: whether the theorem's setting is only approached: a held law, or bodies.
        reason: why it does not apply, or empty.
        error: measured |e(t)|, shape (T,), m.
        bound: the theorem's, shape (T,), m; infinite where it does not apply.
        ratio: largest measured / bound, after the start, where both are |e(t0)|; None where it does not apply.
        settled_ratio: the same over the second half of the run, where the initial error has less to say.
    """

    applies: bool
    approximate: bool
    reason: str
    error: Array
    bound: Array
    ratio: float | None
    settled_ratio: float | None


def bound_of_run(system: System, dataset: xr.Dataset) -> RunBound:
    """Evaluate the theorem over the region of a run and compare."""
    both = [dataset[name].values for name in ("agent_position", "target_position")]
    region = region_of_run(system, np.nan_to_num(np.concatenate(both, axis=1)), "this run")
    spectrum = spectrum_of(system.team)
    constants = take_constants(system, region, spectrum)
    certificate = certify(system, region, constants, spectrum)
    error = np.sqrt((dataset["tracking_error"].values ** 2).sum(axis=1))
    time = dataset["time"].values
    bound = certificate.theorem.bound(float(error[0]), time - time[0])
    half = len(error) // 2
    return RunBound(
        applies=certificate.applies,
        approximate=certificate.approximate or dataset.attrs["backend"] == "physics",
        reason=certificate.reason,
        error=error,
        bound=bound,
        ratio=_largest_ratio(error[1:], bound[1:]) if certificate.applies else None,
        settled_ratio=_largest_ratio(error[half:], bound[half:]) if certificate.applies else None,
    )


def _largest_ratio(error: Array, bound: Array) -> float:
    positive = bound > 0.0
    return float(np.max(error[positive] / bound[positive], initial=0.0))
