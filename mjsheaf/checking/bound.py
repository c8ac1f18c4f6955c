"""Theorem 1 beside a finished run: the bound on |e(t)|, and how much of it the run used."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf.checking.certificate import Certificate, certify
from mjsheaf.control.theorem import Theorem
from mjsheaf.results.netcdf import pieces_of
from mjsheaf.system import System

Array = NDArray[np.float64]

_STEPS = 100.0  # of the integrator, whose tolerance a run's error may be off by
_SHARE_ON_BODIES = 0.01  # of the initial error: below it inertia is all that is seen

BROKEN = 1.0 + 1e-6
"""A ratio of measured to bound above this breaks the bound."""


@dataclass(frozen=True)
class RunBound:
    """The bound of a run.

    Attributes:
        certificate: what the theory says of the system.
        bodies: whether the run was one of bodies: their inertia is not in the theorem.
        departure: largest distance of the run's targets from the path for which the certificate holds, m.
        accuracy: errors below it do not count, m: the run's own accuracy, by its integrator's tolerance, and on bodies
            a share of the initial error.
        blew_up: whether the run ended before its time.
        initial_error: measured |e| at the first sample, m.
        start: time of the first sample, s.
        ratio: largest measured / bound, after the start, where both are |e(t0)|; None where it does not apply.
        settled_ratio: the same over the second half of the run, where the initial error has less to say.
        worst: when the ratio is attained, s.
    """

    certificate: Certificate
    bodies: bool
    departure: float
    accuracy: float
    blew_up: bool
    initial_error: float
    start: float
    ratio: float | None = None
    settled_ratio: float | None = None
    worst: float | None = None

    @property
    def theorem(self) -> Theorem:
        """Theorem 1 with the certificate's constants."""
        return self.certificate.theorem

    @property
    def reason(self) -> str:
        """Why the theorem does not apply, or empty: that of the certificate, or that the run has other targets."""
        error = self.certificate.region.path.error
        if self.certificate.reason or self.bodies or self.departure <= error:
            return self.certificate.reason
        return f"the run's targets leave the path that was checked by {self.departure:.2g} m, more than {error:.2g} m"

    @property
    def applies(self) -> bool:
        """Whether the theorem applies, and the run is one of those it speaks of."""
        return not self.reason

    @property
    def approximate(self) -> bool:
        """Whether the theorem's setting is only approached: a held law, or bodies."""
        return self.certificate.approximate or self.bodies

    def at(self, time: Array) -> Array:
        """The theorem's bound on |e| at times in s, in m; infinite where it does not apply."""
        return self.certificate.bound(self.initial_error, time - self.start)

    @property
    def wrong(self) -> bool:
        """Whether the run exceeds a bound that applies, which bodies may and the ideal law cannot."""
        return bool(self.violation()) and not self.bodies

    def violation(self) -> str:
        """What to say of a run that exceeds a bound that applies; empty where it does not."""
        if self.ratio is None:
            return ""
        if self.blew_up and not self.bodies:
            why = "the run blows up, which Theorem 1 excludes: please report it"
            return f"{why}; constants: {self.certificate.describe_constants()}"
        if self.ratio <= BROKEN:
            return ""
        found = f"|e| reaches {self.ratio:.4g} times the bound of Theorem 1 at t = {self.worst:.6g} s"
        if self.bodies:
            return f"{found}: bodies have inertia, which the theorem does not know"
        constants = self.certificate.describe_constants()
        return f"{found}, which proves a constant wrong: please report it; constants: {constants}"


def bound_of_run(system: System, dataset: xr.Dataset) -> RunBound:
    """Hold a run against its system's certificate; the run is read in pieces."""
    certificate, bodies = certify(system), dataset.attrs["backend"] == "physics"
    first = dataset["tracking_error"][0].values
    start, initial_error = float(dataset["time"][0]), float(np.sqrt((first**2).sum()))
    farthest, departure = _departure(certificate, dataset)
    rtol, atol = system.tolerance
    bound = RunBound(
        certificate=certificate,
        bodies=bodies,
        departure=departure,
        accuracy=max(_STEPS * (atol + rtol * farthest), _SHARE_ON_BODIES * initial_error * bodies),
        blew_up=dataset.attrs["status"] == "unstable",
        initial_error=initial_error,
        start=start,
    )
    return bound if bound.reason else _compared(bound, dataset)


def _compared(bound: RunBound, dataset: xr.Dataset) -> RunBound:
    ratio, settled, worst, done, half = 0.0, 0.0, bound.start, 0, dataset.sizes["time"] // 2
    for piece in pieces_of(dataset, ["time", "tracking_error"]):
        time = piece["time"].values
        error = np.sqrt((piece["tracking_error"].values ** 2).sum(axis=1))
        share = error / (bound.at(time) + bound.accuracy)
        if done == 0:
            share[0] = 0.0  # where both are |e(t0)|
        if share.max(initial=0.0) > ratio:
            ratio, worst = float(share.max()), float(time[share.argmax()])
        settled = max(settled, float(share[max(half - done, 0) :].max(initial=0.0)))
        done += len(error)
    return replace(bound, ratio=ratio, settled_ratio=settled, worst=worst)


def _departure(certificate: Certificate, dataset: xr.Dataset) -> tuple[float, float]:
    """The farthest position of the run, and the largest distance of its targets from the certificate's path, m."""
    path, departure, farthest, done = certificate.region.path, 0.0, 0.0, 0
    for piece in pieces_of(dataset, ["agent_position", "target_position"]):
        targets = np.nan_to_num(piece["target_position"].values)
        farthest = max(farthest, float(np.abs(targets).max(initial=0.0)))
        farthest = max(farthest, float(np.nanmax(np.abs(piece["agent_position"].values), initial=0.0)))
        first = -done % path.stride
        known = path.samples[(done + first) // path.stride :][: len(targets[first :: path.stride])]
        apart = np.linalg.norm(targets[first :: path.stride][: len(known)] - known, axis=2)
        departure = max(departure, float(apart.max(initial=0.0)))
        done += len(targets)
    return farthest, departure
