"""Ringing: the damping ratio predicted from inertia, against the one measured on bodies in a free-decay test.

A body that follows its commanded velocity with time constants T = M / (M k_v + D) turns q' = -k1 H e into
T e'' + e' + k1 H e = 0. The prediction is the damping ratio of the least damped mode of this equation. For the
measurement, flow, disturbance and targets are at rest. The agents start at rest, displaced from q* along that mode, and
a second-order response is fitted to their decay.

The prediction includes inertia alone, and in a second version the law's hold. Lagging thrusters and vehicles that have
to turn first lower the damping further. The test is therefore repeated without them, and there prediction and
measurement must agree.

Under the Newton direction, H is replaced by the identity: the prediction assumes that the direction is exact.
Feedforward and drift add nothing while targets and medium are at rest, and their odometry has no noise in the test. The
integral is switched off, because it is slow and not part of the prediction. Noise and losses of links are switched off
too. Their delays stay on, although the predictions do not include them.

The module also computes how far the gain can be raised before inertia, lag or the law's hold makes the team ring.
"""

from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from math import isfinite, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import linalg

from mjsheaf.arrays import Array
from mjsheaf.comparing.ladder import effects_of, inertial_tau
from mjsheaf.comparing.measures import positions_at_q_star
from mjsheaf.io.section import FiniteRecord
from mjsheaf.law.links import LinkArrays
from mjsheaf.loop.session import engine_of
from mjsheaf.media import FlowField
from mjsheaf.system import STILL, System
from mjsheaf.vehicles.effects import Effects, capability_of, of_each
from mjsheaf.vehicles.vehicle import Vehicle

Complex = NDArray[np.complex128]

LARGEST_SECOND_ORDER = 600
"""Largest n_q for which eigenvalues of the second-order system of unlike bodies are computed."""

_SHARE_OF_ABILITY = 0.2  # maximum fraction of speed or thrust that the displacement commands
_LARGEST_DISPLACEMENT = 0.5  # m
_TRIES = 4
_DECAYS = 4.0  # length of the test, in time constants of the mode
_LONGEST = 300.0  # s
_POINTS_PER_PERIOD = 12  # of the fitted recurrence
_REAL_ROOT = 1e-6  # relative imaginary part below which a root counts as real
_LEAST_DAMPING = 0.3  # minimum damping ratio at a usable gain
_MOSTLY_INERTIA = 0.8  # fraction of the gain that inertia alone allows; above it, inertia is the limit


class ReleaseRecord(FiniteRecord):
    """One free-decay experiment on bodies."""

    bodies: str
    damping_ratio: float | None = Field(description="damping ratio of the fitted response; null without oscillation")
    frequency_rad_s: float | None
    overshoot: float = Field(description="overshoot beyond q*, as a fraction of the displacement")
    amplitude_m: float = Field(description="displacement of the farthest agent")
    saturation: float
    status: str


class RingingRecord(FiniteRecord):
    """The least damped mode, as predicted from inertia and as measured on bodies."""

    agent: str = Field(description="agent that moves most in the mode")
    predicted_damping_ratio: float = Field(
        description="damping ratio of T e'' + e' + k1 H e = 0, T = M / (M k_v + D); no hold, no lag"
    )
    predicted_damping_ratio_held: float = Field(description="the same under the held law")
    predicted_frequency_rad_s: float
    predicted_overshoot: float = Field(description="overshoot of the same test, as a fraction of the displacement")
    overdamped: bool = Field(description="true if no mode is predicted to oscillate")
    delay_s: float = Field(0.0, description="maximum age of measurements, which the predictions do not include")
    measured: list[ReleaseRecord]

    @property
    def largest_rise(self) -> tuple[float, str]:
        """Largest rise of the measured damping ratio when an effect is left out, and that effect; 0 if unknown."""
        known = [(m.bodies, m.damping_ratio) for m in self.measured if m.damping_ratio is not None]
        rises = [(later[1] - now[1], later[0].split()[-1]) for now, later in pairwise(known)]
        return max(rises, default=(0.0, ""))


@dataclass(frozen=True)
class Mode:
    """The least damped mode of a team whose bodies follow commanded velocities with their time constants.

    Attributes:
        damping: Damping ratio; above 1 the mode does not oscillate.
        frequency: Natural frequency |s|, rad/s.
        rate: Decay rate, 1/s.
        displacement: Displacement of the agents' stacked positions, scaled to 1 for the farthest agent, shape (n,).
        oscillates: True if the root of the mode is complex.
        left: Row that maps (e, e') to the mode's coordinate, shape (2n,). For an overdamped mode, the coordinate is
            along the displacement.
        who: Agent that moves most.
    """

    damping: float
    frequency: float
    rate: float
    displacement: Array
    oscillates: bool
    left: Complex
    who: str


def ringing_of(system: System) -> RingingRecord | None:
    """Predict and measure the least damped mode; None for teams of too many states, or without a mode."""
    if not 0 < system.team.dirichlet.H.shape[0] <= LARGEST_SECOND_ORDER:
        return None
    matrix = second_order(system)
    mode = least_damped(system, matrix)
    still = _displaced_at_rest(system, mode)
    step, n = linalg.expm(matrix * still.grid.period), len(mode.displacement)
    begun = np.r_[mode.displacement, np.zeros(n)]
    states = list(accumulate(range(still.grid.steps), lambda state, _: step @ state, initial=begun))
    measured = [
        _release(replace(still, bodies=replace(still.bodies, effects=effects, contacts=False)), mode, bodies)
        for bodies, effects in _decay_variants(system)
    ]
    return RingingRecord(
        agent=mode.who,
        predicted_damping_ratio=mode.damping,
        predicted_damping_ratio_held=_held_damping(system, matrix, mode),
        predicted_frequency_rad_s=mode.frequency,
        predicted_overshoot=_overshoot(np.array(states)[:, :n], mode),
        overdamped=not mode.oscillates,
        delay_s=system.grid.period * _late(system),
        measured=measured,
    )


def predicted_damping(system: System) -> float:
    """Predict the damping ratio of the least damped mode from inertia; infinite for a team of too many states."""
    if not 0 < system.team.dirichlet.H.shape[0] <= LARGEST_SECOND_ORDER or system.gain <= 0.0:
        return float("inf")
    return least_damped(system, second_order(system)).damping


def second_order(system: System) -> Array:
    """Compute the matrix A in (e, e')' = A (e, e') for T e'' + e' + k1 H e = 0, shape (2n, 2n).

    T comes from inertia alone, along each vehicle's axes at its initial heading.
    """
    H = _stiffness(system)
    blocks = []
    for v, (agent, vehicle) in enumerate(zip(system.team.agents, system.vehicles, strict=False)):
        c, s = np.cos(system.bodies.heading[v]), np.sin(system.bodies.heading[v])
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])[: agent.dimension, : agent.dimension]
        blocks.append(R / inertial_tau(vehicle) @ R.T)
    quickness = linalg.block_diag(*blocks)  # T^-1, 1/s
    zero, identity = np.zeros_like(H), np.eye(len(H))
    return np.block([[zero, identity], [-system.gain * quickness @ H, -quickness]])


def _stiffness(system: System) -> Array:
    """Return the matrix that the law multiplies e by: H, or the identity with the Newton direction, shape (n, n)."""
    H = system.team.dirichlet.H.toarray()
    return np.eye(len(H)) if system.law.terms.newton else np.asarray(H)


def least_damped(system: System, matrix: Array) -> Mode:
    """Find the mode with the smallest -Re s / |s|; if none oscillates, the one closest to oscillating."""
    n = len(matrix) // 2
    roots, right = linalg.eig(matrix)
    ratio = -roots.real / np.abs(roots)
    k = int(np.argmin(np.where(roots.imag >= 0.0, ratio, np.inf)))
    oscillates = bool(abs(roots[k].imag) > _REAL_ROOT * abs(roots[k]))
    if oscillates:
        shape = right[:n, k] / right[np.argmax(np.abs(right[:n, k])), k]
        displacement, left = shape.real, np.linalg.pinv(right)[k]
        damping, frequency, rate = float(ratio[k]), float(abs(roots[k])), float(-roots[k].real)
    else:
        values, vectors = np.linalg.eigh(_stiffness(system))
        displacement, stiffness = vectors[:, -1], system.gain * float(values[-1])
        left = np.concatenate([displacement, np.zeros(n)]).astype(complex)
        quickness = float(-displacement @ matrix[n:, n:] @ displacement)
        frequency = float(np.sqrt(stiffness * quickness))
        damping = quickness / (2.0 * frequency)
        rate = frequency * (damping - np.sqrt(max(damping**2 - 1.0, 0.0)))
    moved = np.linalg.norm(system.team.unpack(displacement), axis=1)
    who = system.team.agent_ids[int(moved.argmax())]
    return Mode(damping, frequency, rate, displacement / moved.max(), oscillates, left, who)


def _held_damping(system: System, matrix: Array, mode: Mode) -> float:
    """Compute the smallest -Re s / |s| of the bodies under a law held over h, exactly, from eigenvalues exp(s h)."""
    n, h = len(matrix) // 2, system.grid.period
    if system.grid.continuous or not mode.oscillates:
        return mode.damping
    free = matrix.copy()
    push = free[:, :n].copy()  # effect of the law, which holds the e measured at the start of the period
    free[:, :n] = 0.0
    held = linalg.expm(h * np.block([[free, push], [np.zeros((n, 3 * n))]]))
    roots = np.log(linalg.eigvals(held[: 2 * n, : 2 * n] + np.pad(held[: 2 * n, 2 * n :], ((0, 0), (0, n))))) / h
    return float((-roots.real / np.abs(roots)).min())


def fit_roots(signals: Array, period: float) -> Complex:
    """Fit the two roots s of a second-order response that all signals share, by Prony's method.

    Samples a period h apart obey y(t + 2 h) = a y(t + h) + b y(t), whose characteristic roots are exp(s h).

    Args:
        signals: Samples of K signals, shape (K, T).
        period: Time h between samples, s.
    """
    later, now, before = signals[:, 2:].ravel(), signals[:, 1:-1].ravel(), signals[:, :-2].ravel()
    a, b = np.linalg.lstsq(np.column_stack([now, before]), later, rcond=None)[0]
    z = np.roots([1.0, -a, -b]).astype(complex)
    return np.asarray(np.log(np.where(z == 0.0, 1e-300, z)) / period)


def _displaced_at_rest(system: System, mode: Mode) -> System:
    """Return the system with everything at rest and its agents displaced from q* along the mode."""
    team, grid = system.team, system.grid
    V, N = len(team.members), len(team.agents)
    asked = system.gain * np.linalg.norm(team.unpack(_stiffness(system) @ mode.displacement), axis=1)
    able = np.minimum(of_each(system.vehicles[:N], _ability), system.law.limit[:N])
    amplitude = min(_LARGEST_DISPLACEMENT, float((_SHARE_OF_ABILITY * able / np.maximum(asked, 1e-300)).min()))
    initial = positions_at_q_star(system, system.initial[None])[0]
    initial[:N] += amplitude * team.unpack(mode.displacement)
    span = _DECAYS / mode.rate
    if mode.oscillates:  # long enough for the first overshoot
        span = max(span, 1.5 * np.pi / np.sqrt(mode.frequency**2 - mode.rate**2))
    steps = int(np.ceil(min(span, _LONGEST) / grid.period))
    return replace(
        system,
        initial=initial,
        grid=replace(grid, start=0.0, steps=max(steps, 8)),
        law=system.law._replace(
            gain=np.where(np.arange(V) < N, system.law.gain, 0.0),
            terms=system.law.terms._replace(noise=0.0, bias=0.0, integral=0.0),
            links=_only_late(system.law.links),
        ),
        motion=system.motion._replace(
            pull=np.zeros(V), amplitude=np.zeros((V, 3)), path=np.zeros((V, 2), dtype=np.int64)
        ),
        harmonics=np.zeros_like(system.harmonics),
        flows=[FlowField(dimension=3)],
        flow_names=(STILL,),
        field=np.zeros(V, dtype=np.int64),
    )


def _late(system: System) -> int:
    """Return the maximum age of measurements, in periods."""
    return int(np.max(system.law.links.table["delay"], initial=0))


def _only_late(links: LinkArrays) -> LinkArrays:
    """Return the links with their delays alone."""
    table = links.table.copy()
    for name in ("lossy", "bursts", "bearing", "noise", "bias", "range_noise", "bearing_noise"):
        table[name] = 0
    table["range"] = np.inf
    return links._replace(table=table)


def _ability(vehicle: Vehicle) -> float:
    """Compute the commanded speed that a vehicle at rest can follow without saturating its thrust, m/s."""
    able, mass = capability_of(vehicle), vehicle.moving_mass[: vehicle.dimension]
    return min(able.least_speed, able.least_thrust / float((mass * vehicle.rate + vehicle.drag[: len(mass)]).max()))


def _decay_variants(system: System) -> list[tuple[str, Effects]]:
    """List labels and effects of the experiments, which switch off effects outside the prediction in turn."""
    present = effects_of(system, system.bodies.vehicle[: len(system.team.agents)])
    unknown = [effect for effect in ("lag", "underactuation") if effect in present]
    return [("as given", system.bodies.effects)] + [
        (f"without {' and '.join(off)}", system.bodies.effects.model_copy(update=dict.fromkeys(off, False)))
        for off in accumulate([effect] for effect in unknown)
    ]


def _release(system: System, mode: Mode, bodies: str) -> ReleaseRecord:
    """Release the agents from rest; if a thruster saturates, repeat from half the displacement."""
    team, N = system.team, len(system.team.agents)
    targets = np.broadcast_to(system.initial[N:], (system.grid.steps + 1, len(team.targets), 3)).copy()
    q_star = positions_at_q_star(system, system.initial[None])[0]
    offset = (system.initial - q_star)[:N]
    for attempt in range(_TRIES):
        initial = q_star.copy()
        initial[:N] += offset / 2.0**attempt
        run = engine_of(replace(system, initial=initial)).run(targets)
        saturated = float(run.log.saturation[:, :N].mean())
        if saturated == 0.0 or run.status != "finished":
            break
    e = (team.pack(run.positions) - team.pack(q_star))[:, : len(mode.displacement)]
    damping, frequency = _fit_decay(e, mode, system.grid.period) if run.status == "finished" else (None, None)
    overshoot = _overshoot(e, mode)
    return ReleaseRecord(
        bodies=bodies,
        damping_ratio=damping,
        frequency_rad_s=frequency,
        overshoot=overshoot if isfinite(overshoot) else 0.0,
        amplitude_m=float(np.linalg.norm(offset, axis=1).max()) / 2.0**attempt,
        saturation=saturated,
        status=run.status,
    )


def _fit_decay(e: Array, mode: Mode, period: float) -> tuple[float | None, float | None]:
    """Fit damping ratio and natural frequency to errors, shape (T, n), m; None if they do not oscillate."""
    own = np.concatenate([e, np.gradient(e, period, axis=0, edge_order=2)], axis=1) @ mode.left
    step = max(1, round(2.0 * np.pi / mode.frequency / _POINTS_PER_PERIOD / period))
    signals = np.stack([own.real, own.imag])[: 2 if mode.oscillates else 1]
    # The samples at each offset satisfy the same recurrence. They are cut to one length and share one fit.
    count = signals.shape[1] // step
    if count < 5:
        return None, None
    runs = signals[:, : count * step].reshape(len(signals), count, step)
    roots = fit_roots(np.moveaxis(runs, 1, 2).reshape(-1, count)[:, 1:], step * period)
    s = roots[np.argmax(roots.imag)]
    oscillates = abs(s.imag) > _REAL_ROOT * abs(s)
    return (float(-s.real / abs(s)), float(abs(s))) if oscillates else (None, None)


def _overshoot(e: Array, mode: Mode) -> float:
    """Compute the overshoot of errors along the displacement, shape (T, n), as a fraction of their initial value."""
    along = e @ mode.displacement
    return max(0.0, float(-along.min() / along[0]))


@dataclass(frozen=True)
class GainLimit:
    """A gain at which a team begins to ring.

    Attributes:
        gain: k1, 1/s.
        effect: Effect that limits the gain; see `gains.GainLimitRecord`.
        agent: Agent that moves most in the mode; empty if unknown.
    """

    gain: float
    effect: Literal["inertia", "lag", "underactuation", "hold", "links"]
    agent: str


def usable_gain(system: System, ringing: RingingRecord | None) -> float | None:
    """Return the lowest of `gain_limits`, 1/s, which may be below the present gain; None if every gain is usable."""
    return min((limit.gain for limit in gain_limits(system, ringing)), default=None)


def gain_limits(system: System, ringing: RingingRecord | None) -> list[GainLimit]:
    """Find the gains at which the least damped mode's damping ratio falls to 0.3 and the held law begins to ring.

    Let k be the gain relative to the present one. With inertia alone, the damping ratio of a mode falls as
    zeta / sqrt(k). A delay l (h / 2 of the hold, a link's delay, a thruster's lag) lowers it by about omega l / 2. This
    reduction grows as sqrt(k):

        zeta / sqrt(k) - delta sqrt(k) = 0.3

    Here delta is the larger of two reductions: that of hold and links, and zeta minus the ratio measured on bodies.
    With measurements d periods old, the held law does not ring up to k1 h lambda_max = d^d / (d + 1)^(d + 1).

    Args:
        system: System of the scenario.
        ringing: Prediction and experiments. None for a team of too many states: the largest eigenvalue and the slowest
            agent then bound the damping of every mode.

    Returns:
        One limit for bodies and, if the law is held, one for the hold; none if every gain is usable.
    """
    stiffest = 1.0 if system.law.terms.newton else system.largest_eigenvalue
    if system.gain <= 0.0 or stiffest <= 0.0:
        return []
    limits = [_limit_of_damping(system, ringing, stiffest)]
    if not system.grid.continuous:
        delayed = _late(system)
        calm = delayed**delayed / (delayed + 1.0) ** (delayed + 1)
        limits.append(GainLimit(calm / (system.grid.period * stiffest), "links" if delayed else "hold", ""))
    return limits


def _limit_of_damping(system: System, ringing: RingingRecord | None, stiffest: float) -> GainLimit:
    """Find the gain at which the least damped mode's damping ratio falls to 0.3."""
    if ringing is None:
        slowest = max(float(inertial_tau(v).max()) for v in system.vehicles[: len(system.team.agents)])
        frequency = sqrt(system.gain * stiffest / slowest)
        damping = 0.5 / (frequency * slowest)
        measured = None
    else:
        frequency = ringing.predicted_frequency_rad_s
        damping = ringing.predicted_damping_ratio
        measured = ringing.measured[0].damping_ratio
    delayed = _late(system)
    period = 0.0 if system.grid.continuous else system.grid.period
    of_hold = frequency * period * (1.0 + 2.0 * delayed) / 4.0
    of_bodies = 0.0 if measured is None else damping - measured
    delta = max(of_hold, of_bodies)
    # The root sqrt(k) of delta k + 0.3 sqrt(k) - damping = 0, in the form that is valid for delta = 0 too.
    root = 2.0 * damping / (_LEAST_DAMPING + sqrt(_LEAST_DAMPING**2 + 4.0 * delta * damping))
    effect: Literal["inertia", "lag", "underactuation", "hold", "links"] = "links" if delayed else "hold"
    if root**2 >= _MOSTLY_INERTIA * (damping / _LEAST_DAMPING) ** 2:
        effect = "inertia"
    elif of_bodies > of_hold:
        effect = _blamed_effect(ringing)
    return GainLimit(system.gain * root**2, effect, "" if ringing is None else ringing.agent)


def _blamed_effect(ringing: RingingRecord | None) -> Literal["inertia", "lag", "underactuation"]:
    """Find the effect whose absence raises the measured damping ratio most; inertia if none does."""
    rise, effect = (0.0, "") if ringing is None else ringing.largest_rise
    if rise <= 0.0:
        return "inertia"
    return "lag" if effect == "lag" else "underactuation"
