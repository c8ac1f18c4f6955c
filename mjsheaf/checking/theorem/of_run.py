"""Bounds of a finished run: the fraction of Theorem 1's bound, and of that of the held law, that it reached."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.held_law import envelope
from mjsheaf.checking.loop.linear_law import because_of, unmodelled_parts
from mjsheaf.checking.theorem.certificate import Certificate, certify
from mjsheaf.errors import UndecidedError
from mjsheaf.loop.system import Phase, System, during
from mjsheaf.results.dataset import of_phase
from mjsheaf.results.store import pieces_of

BROKEN = 1.0 + 1e-6
"""A ratio of measured to bound above this breaks the bound."""


@dataclass(frozen=True)
class RunBound:
    """The bound of a run.

    Attributes:
        certificate: Certificate of the system.
        bodies: True for a run with bodies, whose inertia the theorem does not model.
        departure: Largest distance of the run's targets from the certificate's path, m.
        accuracy: Numerical error of the run, which is allowed in addition to the bound, m: from its integrator's
            tolerance, and on bodies a fraction of the initial error.
        blew_up: True if the run ended before its time.
        initial_error: Measured |e| at the first sample, m.
        start: Time of the first sample, s.
        law: Name of the run's law if that is not the paper's, or empty.
        ratio: Largest ratio of |e| to the bound after the start, where both are |e(t0)|; None if no bound applies.
        settled_ratio: The same over the second half of the run, where the initial error matters less.
        worst: Time at which the ratio is attained, s.
    """

    certificate: Certificate
    bodies: bool
    departure: float
    accuracy: float
    blew_up: bool
    initial_error: float
    start: float
    law: str = ""
    ratio: float | None = None
    settled_ratio: float | None = None
    worst: float | None = None

    @property
    def reason(self) -> str:
        """Reason why the theorem does not apply, or empty: the certificate's, or that the targets moved otherwise."""
        law = f"the run has {self.law}, and the theorem is about the paper's law" if self.law else ""
        return law or self.certificate.reason or ("" if self.bodies else self.departed)

    @property
    def departed(self) -> str:
        """Sentence that the targets moved otherwise than was checked; or empty."""
        error = self.certificate.constants.path.error
        return (
            f"the run's targets leave the path that was checked by {self.departure:.2g} m, more than {error:.2g} m"
            if self.departure > error
            else ""
        )

    @property
    def applies(self) -> bool:
        """Return True if the theorem applies to this run."""
        return not self.reason

    @property
    def approximate(self) -> bool:
        """Return True if the run only approaches the theorem's setting: a held law, or bodies."""
        return self.certificate.approximate or self.bodies

    def at(self, time: Array) -> Array:
        """Return the theorem's bound on |e|, m, at times, s; infinite if it does not apply."""
        return self.certificate.bound(self.initial_error, time - self.start)

    @property
    def wrong(self) -> bool:
        """Return True if the run exceeds a bound that applies; a run on bodies may, the ideal law cannot."""
        return bool(self.violation()) and not self.bodies

    def violation(self) -> str:
        """Describe how the run exceeds a bound that applies, in a sentence; empty if it does not."""
        if self.ratio is None or (self.ratio <= BROKEN and (self.bodies or not self.blew_up)):
            return ""
        if self.bodies:
            return (
                f"Theorem 1 is about ideal kinematics; on bodies |e| is up to {self.ratio:.4g} times its bound, at "
                f"t = {self.worst:.6g} s"
            )
        found = "the run blows up, which Theorem 1 excludes"
        if not self.blew_up:
            found = (
                f"|e| reaches {self.ratio:.4g} times the bound of Theorem 1 at t = {self.worst:.6g} s, which proves a "
                "constant wrong"
            )
        t = self.certificate.theorem
        return (
            f"{found}: please report it; constants: k1 = {t.gain:.6g} 1/s, lambda_min = {t.lambda_min:.6g}, "
            f"f_bar = {t.f_bar:.6g} m/s, omega_bar = {t.omega_bar:.6g} m/s, rho = {t.lipschitz:.6g} 1/s, "
            f"lambda_V = {t.rate:.6g} 1/s, |e(t0)| = {self.certificate.constants.initial_error:.6g} m"
        )


def bound_of_run(run: System | Sequence[Phase], dataset: xr.Dataset, which: int = 0) -> RunBound:
    """Compare one phase of a run with its system's certificate from its start on; the run is read in pieces."""
    last = dataset["time"].values[-1:]
    system, dataset = _phase_of(run, dataset, which)
    certificate, bodies = certify(system), dataset.attrs["backend"] == "physics"
    initial_error = float(np.sqrt((dataset["tracking_error"][0].values ** 2).sum()))
    # The farthest coordinate of the run, and the largest distance of its targets from the certificate's path, m.
    path, departure, farthest, done = certificate.constants.path, 0.0, 0.0, 0
    for piece in pieces_of(dataset, ["agent_position", "target_position"]):
        agents, targets = piece["agent_position"].values, np.nan_to_num(piece["target_position"].values)
        farthest = max(farthest, *(float(np.nanmax(np.abs(x), initial=0.0)) for x in (agents, targets)))
        first = -done % path.stride
        known = path.samples[(done + first) // path.stride :][: len(targets[first :: path.stride])]
        apart = np.linalg.norm(targets[first :: path.stride][: len(known)] - known, axis=2)
        departure = max(departure, float(apart.max(initial=0.0)))
        done += len(targets)
    bound = RunBound(
        certificate=certificate,
        bodies=bodies,
        departure=departure,
        accuracy=_accuracy(system, farthest, initial_error, bodies),
        blew_up=dataset.attrs["status"] == "unstable" and bool((dataset["time"].values[-1:] == last).all()),
        initial_error=initial_error,
        start=float(dataset["time"][0]),
        law=_other_law(system, dataset.attrs.get("controller", "")),
    )
    if bound.reason:
        return bound
    error, time = _measured(dataset)
    ratio, settled, worst = _largest(np.nan_to_num(error / (bound.at(time) + bound.accuracy), posinf=np.inf), time)
    return replace(bound, ratio=ratio, settled_ratio=settled, worst=worst)


def _accuracy(
    system: System,
    farthest: float,
    initial_error: float,
    bodies: bool,
    *,
    tolerances: float = 100.0,  # error of a run over the tolerance of its integrator
    on_bodies: float = 0.01,  # fraction of the initial error, below which only inertia matters
) -> float:
    """Bound the numerical error of a run whose farthest coordinate is `farthest`, m: see `RunBound`."""
    rtol, atol = system.tolerance
    return max(tolerances * (atol + rtol * farthest), on_bodies * initial_error * bodies)


def bound_ahead(system: System) -> Array | None:
    """Return Theorem 1's bound on |e|, plus accuracy, at the samples of a run on bodies, shape (T,), m; or None.

    It is known before the run, and holds if the targets follow their predicted path.
    """
    system = system.remaining
    certificate = certify(system)
    if _other_law(system, "") or certificate.reason:
        return None
    q, p = system.team.split(system.initial)
    initial_error = float(np.linalg.norm(system.team.extend(p) - q))
    elapsed = system.grid.samples - system.grid.start
    farthest = float(np.abs(system.initial).max())
    return certificate.bound(initial_error, elapsed) + _accuracy(system, farthest, initial_error, bodies=True)


@dataclass(frozen=True)
class HeldBound:
    """The bound of the held law on a run: see `held_law`.

    Attributes:
        samples: Bound on |e| at each sample, shape (T,), m; None if there is none.
        reason: Reason why there is none, or empty.
        ratio, settled_ratio, worst: See `RunBound`.
    """

    samples: Array | None
    reason: str
    ratio: float | None = None
    settled_ratio: float | None = None
    worst: float | None = None

    @property
    def wrong(self) -> bool:
        """Return True if the run exceeds the bound."""
        return self.ratio is not None and self.ratio > BROKEN

    def violation(self) -> str:
        """Describe how the run exceeds the bound, in a sentence; empty if it does not."""
        if not self.wrong:
            return ""
        where = f"|e| reaches {self.ratio:.4g} times the bound of the held law at t = {self.worst:.6g} s"
        return f"{where}, which proves it wrong: please report it"


def held_bound_of_run(
    run: System | Sequence[Phase], dataset: xr.Dataset, theorem: RunBound, which: int = 0
) -> HeldBound:
    """Compare one phase of a run with the bound of its held law.

    The bound does not cover bodies, laws in Python, and terms with memory from an earlier phase.
    """
    system, dataset = _phase_of(run, dataset, which)
    python = f"the run has {theorem.law}" if dataset.attrs.get("controller") else ""
    reason = "the run is one of bodies" if theorem.bodies else python or theorem.departed
    if not reason and which > 0 and system.law.extended:
        reason = "terms remember the phase before, which the bound does not cover"
    if reason:
        return HeldBound(None, reason)
    try:
        bound = envelope(system, theorem.certificate)
    except UndecidedError as why:
        return HeldBound(None, str(why))
    if bound.clipped:
        return HeldBound(None, bound.clipped)
    error, time = _measured(dataset)
    samples = bound.samples[: len(error)]
    return HeldBound(samples, "", *_largest(np.nan_to_num(error / (samples + theorem.accuracy), nan=np.inf), time))


def _phase_of(run: System | Sequence[Phase], dataset: xr.Dataset, which: int) -> tuple[System, xr.Dataset]:
    """Return system and data as `of_phase`, the system over that phase alone, from the run's state at its start."""
    system, own = of_phase(run, dataset, which)
    if isinstance(run, System) or len(run) == 1:
        return system, own
    initial = None
    if which > 0:
        start = [np.nan_to_num(own[name][0].values) for name in ("agent_position", "target_position")]
        initial = run[which].system.initial.copy()
        here = np.append(run[which].system.team.present, np.ones(len(system.team.targets), dtype=np.bool_))
        initial[here] = np.concatenate(start)
    return during(run, which, initial), own


def bounds_of_phases(phases: Sequence[Phase], dataset: xr.Dataset) -> list[tuple[RunBound, HeldBound]]:
    """Compare each phase that a run reached with the bounds of Theorem 1 and of the held law."""
    end = float(dataset["time"][-1]) + 0.5 * phases[0].system.grid.period
    came = [k for k, phase in enumerate(phases) if k == 0 or phase.time < end]
    theorems = [bound_of_run(phases, dataset, k) for k in came]
    return [
        (theorem, held_bound_of_run(phases, dataset, theorem, k)) for k, theorem in zip(came, theorems, strict=True)
    ]


def _other_law(system: System, controller: str) -> str:
    """Return the name of a run's law in words if it is not the paper's; else empty."""
    if controller:
        return f"a law of its own, {controller}"
    if parts := unmodelled_parts(system):
        return f"a law that is not certified, {because_of(parts)}"
    return "terms beyond -k1 eta" if system.law.extended else ""


def _largest(share: Array, time: Array) -> tuple[float, float, float]:
    """Return the largest fraction of a bound after the start, that of the second half, and the time of the first, s."""
    share[0] = 0.0
    worst = int(share.argmax())
    return float(share[worst]), float(share[len(share) // 2 :].max()), float(time[worst])


def _measured(dataset: xr.Dataset) -> tuple[Array, Array]:
    """Return |e| at the samples of a run, m, and their times, s, shape (T,) each."""
    pieces = (piece["tracking_error"].values for piece in pieces_of(dataset, ["tracking_error"]))
    return np.concatenate([np.sqrt((values**2).sum(axis=1)) for values in pieces]), dataset["time"].values
