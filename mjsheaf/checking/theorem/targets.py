"""The targets: their path over the span of a run, integrated separately from the agents, and their own law.

Targets do not react to agents, so their path is known before a run. It is integrated under the law of the run, with
held commands if the run holds them, and covered by cells. Steps resolve everything that moves a target: each is a
fraction of a turn of every motion and disturbance, of the time constants of consensus, pull and flow, and of the length
over which the flow changes there (`flow_scale`).

Each step from t to t + h gives a cell. With V and D bounds on |p'| and |f_p'| over it, and W on |omega'|,

    |p(t + s) - chord(s)| <= h^2 (D + W) / 8,       |f_p(t + s) - mean of both ends| <= h D / 2,

the first by the second derivative p'' = f_p' + omega', the second by the first. V and D hold by continuity: while
|p'| <= V, the path stays within h V of its start, where D follows from V and the flow's largest slope, and then
|p'| <= |p'(t)| + h (D + W). If that is at most V, the assumption was right; otherwise V is increased. Steps are short
enough for this to end.

The integration error is controlled: the path is integrated a second time with half the steps and a tenth of the
tolerance. Cells are widened by `error`, many times the difference, so runs of the usual tolerance are covered too. If
the error is too large, the path counts as unknown.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import sparse
from scipy.sparse.linalg import eigsh

from mjsheaf.arrays import Array, IntArray
from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.checking.theorem.flow_bounds import bound_slopes, flow_scale, flow_slope
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.compile.remember import remember_last
from mjsheaf.compile.tiers import tiered
from mjsheaf.errors import UndecidedError, listed, select_true
from mjsheaf.law.edges import LinkArrays
from mjsheaf.law.law import ControlArrays, evaluate_law, new_memory, pack_edges, with_seed
from mjsheaf.law.paths import MotionArrays, add_reference, reference_bounds
from mjsheaf.loop.ideal import new_integrator, slope_of, take_step
from mjsheaf.loop.system import System
from mjsheaf.media import varying
from mjsheaf.media.medium import MediumArrays, moving_velocity, of_kind
from mjsheaf.media.waves import WaveArrays
from mjsheaf.section import Finite, Record

MOST_STEPS = 1_500_000
"""Largest product of integrator steps and targets; a path that needs more counts as unknown."""

_DENSE = 200_000  # largest number of entries of K = H^-1 B that is stored as a matrix
_MOST_NUMBERS = 4_000_000  # of stored harmonic extensions, and of samples stored for comparison with a run
_SHARE_OF_DECAY = 0.25  # largest step as a fraction of the fastest time constant
_SHARE_OF_SCALE = 0.125  # largest motion in a step as a fraction of the length over which the flow changes
_NEARLY = 1.0 - 1e-6  # fraction of the rest of a period that counts as all of it


class Carrier:
    """Map K = H^-1 B from motions of the targets to their harmonic extension.

    If K is too large to store, sigma_max(B) / lambda_min(H) bounds the norms of its blocks.

    Attributes:
        rate: H^-1 c', the velocity of q* while formations change, stacked, shape (n_q,), m/s.
    """

    def __init__(self, system: System) -> None:
        self._team = system.team
        self._problem = problem = system.team.law_problem
        n_q, n_p = problem.B.shape
        rest = problem.extend(np.zeros(n_p))
        self._rest = self._offset = rest
        if system.team.linearised_at is not None and not problem.unique:
            free = problem.sparse_null_basis  # free motions keep their value at the linearisation
            self._rest = rest + free @ (free.T @ (system.team.linearised_at[:n_q] - rest))
        self._K = problem.extend(np.eye(n_p)) - rest if n_q * n_p <= _DENSE else None  # (n_p, n_q)
        self._own = _places(system)
        self._ramp = ramp = system.team.ramp
        self.rate = np.zeros(n_q) if ramp is None else ramp.moved / (ramp.end - ramp.start)

    def extend(self, targets: Array, time: Array | None = None) -> Array:
        """Return q* for targets at (..., M, 3), m, stacked, (..., n_q), m; at times (...), s, or at the start."""
        q_star = self.carry(targets) + self._rest
        if self._ramp is None or time is None:
            return q_star
        return q_star + (time - self._ramp.begin)[..., None] * self.rate

    def slide(self, duration: Array) -> Array:
        """Return the motion of each q*_i due to changing formations in half of durations (T,), s, shape (T, N), m."""
        return 0.5 * duration[:, None] * np.linalg.norm(self._team.unpack(self.rate), axis=1)

    def carry(self, motions: NDArray[Any]) -> NDArray[Any]:
        """Apply K to motions of the targets (..., M, 3); the result is stacked, shape (..., n_q)."""
        flat = motions.reshape(*motions.shape[:-2], -1)[..., self._own]
        if self._K is not None:
            return flat @ self._K
        if np.iscomplexobj(flat):
            return self.carry(motions.real) + 1j * self.carry(motions.imag)
        return self._problem.extend(flat) - self._offset

    def reach(self, radii: Array) -> Array:
        """Bound the motion of each agent's q*_i, shape (..., N), if targets move by at most `radii`, shape (..., M)."""
        if self._blocks is not None:
            with np.errstate(invalid="ignore"):  # a target without a bound that some q*_i does not depend on
                reach = np.asarray(radii @ self._blocks.T)
            return np.where(np.isnan(reach), np.inf, reach)
        return np.repeat(self._norm * np.linalg.norm(radii, axis=-1, keepdims=True), len(self._team.agents), axis=-1)

    def spread(self, radii: Array, slopes: Array, moves: Array) -> Array:
        """Bound |K s + F r|, shape (...), for s within `radii` (..., M), r within `moves`, F in `slopes` (..., N)."""
        with np.errstate(invalid="ignore"):  # an infinite slope where nothing moves
            own = np.where(moves > 0.0, slopes * moves, 0.0)
        if self._blocks is not None:
            return np.linalg.norm(radii @ self._blocks.T + own, axis=-1)
        return self._norm * np.linalg.norm(radii, axis=-1) + np.linalg.norm(own, axis=-1)

    @cached_property
    def _norm(self) -> float:
        """Upper bound on |K|."""
        spectrum = spectrum_of(self._team)
        return spectrum.sigma_max_B / float(spectrum.smallest[0]) if spectrum.smallest.size else np.inf

    @cached_property
    def _blocks(self) -> Array | None:
        """|K_ik|, shape (N, M); None if K is too large."""
        if self._K is None:
            return None
        N, M = len(self._team.agents), len(self._team.targets)
        padded = np.zeros((3 * M, N, 3))
        padded[self._own] = self._team.unpack(self._K)
        return np.linalg.norm(padded.reshape(M, 3, N, 3).transpose(2, 0, 3, 1), ord=2, axis=(2, 3))


def _places(system: System) -> IntArray:
    """Return the indices of the stacked p in padded positions of the targets (M, 3), flattened."""
    return system.team.slots[system.team.first_state[-1] :] - 3 * len(system.team.agents)


class Cells(NamedTuple):
    """Cells that cover the path of M targets, n of them in the order of time.

    In a cell positions lie within `bend` of the segment centre -+ half, and drifts f_p within `spread` of `drift`.

    Attributes:
        begin, end: Start and end of each cell, shape (n,), s.
        centre, half: Centre of the segment, and half of it, shape (n, M, 3), m.
        bend: Bound on the distance from the segment, shape (n, M), m.
        drift: Mean of f_p at both ends, shape (n, M, 3), m/s.
        spread: Bound on the distance of f_p from `drift`, shape (n, M), m/s.
        slope: Bound on the change of f_p with an error of the positions, shape (n, M), 1/s.
    """

    begin: Array
    end: Array
    centre: Array
    half: Array
    bend: Array
    drift: Array
    spread: Array
    slope: Array


@dataclass(frozen=True)
class TargetPath:
    """Targets of a system over the span of its run; if the path is not known, they stand still and drift is NaN.

    Attributes:
        time: Instants at which the path is stored, shape (T,), s.
        positions: Positions of all vehicles at these instants, agents at their initial positions, shape (T, V, 3), m.
        drift: f_p (reference, consensus and flow without disturbance), the mean of both ends of the cell that begins at
            each instant, shape (T, M, 3), m/s.
        q_star: Harmonic extension at these instants, stacked, shape (T, n_q), m.
        cells: Cells that cover the path; None if it is not known.
        error: Largest error of the path that the cells allow for, m.
        samples: Positions of the targets at each stride-th sample of the run, shape (S, M, 3), m.
        stride: Index step between these samples.
        warning: Reason why the path is not known, or empty.
    """

    time: Array
    positions: Array
    drift: Array
    q_star: Array
    cells: Cells | None
    error: float
    samples: Array
    stride: int
    warning: str


class _Steps(NamedTuple):
    """Steps of the integrator, n of them in the order of time, for M targets.

    Attributes:
        begin, end: Start and end of each step, shape (n,), s.
        start, stop: Positions there, shape (n, M, 3), m.
        velocity: p' at the start, shape (n, M, 3), m/s.
        drift: Mean of f_p at both ends, shape (n, M, 3), m/s.
    """

    begin: Array
    end: Array
    start: Array
    stop: Array
    velocity: Array
    drift: Array


class _Setting(NamedTuple):
    """Constants of the integration of the targets' path.

    Attributes:
        control: Law and references of the targets alone.
        turn: Step much shorter than the time scales of motion and disturbance, s.
        decay: Fastest rate of moving parts of the medium and, if the law is continuous, of consensus and pull, 1/s.
        share: Step size as a fraction of the usual one.
        times: Sample times, shape (T,), s.
        stride: Index step between stored samples.
    """

    control: ControlArrays
    turn: float
    decay: float
    share: float
    times: Array
    stride: int


@inline_jit
def _shortened(setting, medium, h, x, velocity):
    """Return the step h, s, shortened to one that resolves flow and law at x."""
    for v in range(x.shape[0]):
        p = velocity[v]
        speed = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
        table = medium.kernels[medium.rows[v, 0] : medium.rows[v, 1]]
        reach = setting.share * _SHARE_OF_SCALE * flow_scale(table, x[v, 0], x[v, 1], x[v, 2])
        rate = setting.decay
        if reach < np.inf:
            rate += flow_slope(table, x[v, 0], x[v, 1], x[v, 2], reach)
            h = min(h, reach / (speed + 1e-300))
        h = min(h, setting.share * _SHARE_OF_DECAY / (rate + 1e-300))
    return h


@inline_jit
def _accepted_step(follow, run, t, h, x):
    """Take the longest step of at most h, s, within the tolerance; return it, or 0 if none is, and its error."""
    error = np.inf
    while not error < 1.0:
        if not h > 1e-14 * max(run.period, abs(t)):  # also true for NaN
            return 0.0, error
        error = take_step(follow, run, t, h, x, 0, x.shape[0])
        if not error < 1.0:
            h *= max(0.2, 0.9 * error**-0.2) if error < 1e300 else 0.2
    return h, error


@inline_jit
def _add_drift(run, x, slope, drift):
    """Add half of f_p at x; f_p is x' without the disturbance."""
    for v in range(slope.shape[0]):
        w = moving_velocity(run.medium, run.medium_state, v, x[v, 0], x[v, 1], x[v, 2])
        for i in range(3):
            drift[v, i] += 0.5 * (slope[v, i] - w[i])


@inline_jit
def _copy(x, out):
    for v in range(x.shape[0]):
        for i in range(3):
            out[v, i] = x[v, i]


@tiered(seconds=1.0, numbers=np.inf)
@jit
def _follow(follow, setting, run, x, steps, samples, place, end):
    """Follow the targets until the end, until there are `end` steps, or until no step is short enough.

    `follow` is the setting's `control` if the law is continuous, None if it is held; `run` is the integrator. `place`
    is the position on the path at which an earlier call ended: the number of steps, the last sample, the time since
    then, s, and the step to try, s. The position at which this call ends is returned.
    """
    times = setting.times
    period = run.period
    count, k, done, step = place
    while k < len(times) - 1:
        if done == 0.0 and follow is None:
            evaluate_law(setting.control, times[k], x, None, run.memory)
        while done < period:
            t = times[k] + done
            slope_of(follow, run, t, x, 0, x.shape[0], run.slope[0])
            h = min(min(step, setting.share * setting.turn), period - done)
            h = _shortened(setting, run.medium, h, x, run.slope[0])
            if count == end:
                return count, k, done, step
            steps.drift[count] = 0.0
            _add_drift(run, x, run.slope[0], steps.drift[count])  # the disturbance in `run` is still that at t
            _copy(run.slope[0], steps.velocity[count])
            _copy(x, steps.start[count])
            if h > _NEARLY * (period - done):  # so that no tiny step remains
                h = period - done
            h, error = _accepted_step(follow, run, t, h, x)
            if h == 0.0:
                return count, k, done, h
            step = h * (10.0 if error == 0.0 else min(10.0, 0.9 * error**-0.2))
            last = h >= period - done
            steps.begin[count] = t
            steps.end[count] = times[k + 1] if last else t + h
            _add_drift(run, run.state, run.slope[6], steps.drift[count])  # the disturbance in `run` is that at t + h
            _copy(run.state, x)
            _copy(x, steps.stop[count])
            count += 1
            done = period if last else done + h
        k, done = k + 1, 0.0
        if k % setting.stride == 0:
            _copy(x, samples[k // setting.stride])
    return count, k, done, step


@jit
def _references(motion, times, nowhere, out):
    """Write v of each reference at times (n,), s, shape (n, M, 3), m/s; `nowhere` (3,) is any point, without pull."""
    for k in range(len(times)):
        for v in range(out.shape[1]):
            add_reference(motion, v, times[k], nowhere, out[k, v])


def _path_key(system: System, carrier: Carrier | None = None) -> tuple[Any, ...]:
    """Return everything on which the targets' path depends; of the agents, only the initial positions."""
    alone, team = _targets_alone(system), (system.team.members, sorted(system.team.absent), system.law.edges)
    ramp = system.team.ramp
    return (
        alone,
        team,
        None if ramp is None else (ramp.begin, ramp.start, ramp.end, ramp.moved),
        system.initial,
        system.grid,
        system.effectiveness,
        MOST_STEPS,
    )


@remember_last(_path_key)
def follow_targets(
    system: System,
    carrier: Carrier | None = None,
    *,
    sampled: int = 2000,
    tolerance: float = 1e-10,
    differences: float = 20.0,
    largest: float = 1e-4,
) -> TargetPath:
    """Follow the targets alone over the span of a run, by Dormand and Prince's pair of order 5(4); see the module.

    Args:
        system: System under the law.
        carrier: Carrier of the system if the caller has one.
        sampled: Approximate number of instants at which the path is stored, for pictures and estimates.
        tolerance: Tolerance of the integrator for each step, relative and absolute.
        differences: Ratio of `TargetPath.error` to the difference of two integrations.
        largest: Error above which a path counts as unknown, m, and relative to its farthest position.
    """
    N, M, n_q = len(system.team.agents), len(system.team.targets), int(system.team.first_state[-1])
    extend = (carrier or Carrier(system)).extend
    span = system.grid.span(0, system.grid.steps + 1)[[0, -1]]
    still = np.repeat(system.initial[None], 2, axis=0)
    if M == 0:
        none = still[:, N:]
        return TargetPath(span, still, none, extend(none, span), None, 0.0, none[:1], 1, "there are no targets")
    try:
        if not np.isfinite(system.moving_bounds.speed[N:]).all():
            raise UndecidedError("they meet gusts, which are not bounded")
        finer, _ = _integrate(system, share=0.5, tolerance=0.1 * tolerance)
        farthest = float(np.abs(finer).max())
        error = 1e-6 + 1e-8 * farthest  # m, at least
        samples, steps = _integrate(system, share=1.0, tolerance=tolerance)
        apart = float(np.abs(samples - finer).max())
        if differences * apart > max(largest * farthest, largest):
            raise UndecidedError(f"two integrations of their path end {apart:.2g} m apart: it is too sensitive")
        error = max(error, differences * apart)
        cells = _cells_of(system, steps, error)
    except UndecidedError as unknown:
        return TargetPath(
            span,
            still,
            np.full((2, M, 3), np.nan),
            extend(still[:, N:], span),
            None,
            np.inf,
            still[:0, N:],
            1,
            str(unknown),
        )
    most = max(50, _MOST_NUMBERS // max(n_q, 3 * len(system.team.members)))
    kept = np.unique(np.linspace(0, len(cells.begin) - 1, min(sampled, most)).astype(np.int64))
    time, drift = np.append(cells.begin[kept], cells.end[-1]), np.append(cells.drift[kept], cells.drift[-1:], axis=0)
    positions = np.repeat(system.initial[None], len(time), axis=0)
    positions[:-1, N:], positions[-1, N:] = cells.centre[kept] - cells.half[kept], cells.centre[-1] + cells.half[-1]
    return TargetPath(
        time,
        positions,
        drift,
        extend(positions[:, N:], time),
        cells,
        error,
        samples[:: _between(system)],
        _stride(system),
        "",
    )


def _require_one_side(system: System, cells: Cells) -> None:
    """Refuse a path through the surface of waves, where the velocity that a target in space meets jumps."""
    N = len(system.team.agents)
    for waves in of_kind(system.moving, WaveArrays):
        low, high = (cells.centre[..., 2] + s * (np.abs(cells.half[..., 2]) + cells.bend) for s in (-1.0, 1.0))
        through = np.any((low < waves.level[0]) & (waves.level[0] <= high), axis=0) & (waves.met[N:] == 2)
        for k in np.flatnonzero(through):
            raise UndecidedError(f"{system.team.target_ids[k]} passes through the surface of the waves")


def _integrate(
    system: System,
    share: float,
    tolerance: float,
    *,
    first_cells: int = 50,
) -> tuple[Array, _Steps]:
    """Integrate the targets; return their positions at every stride-th sample, shape (S, M, 3), and the steps.

    Args:
        system: System under the law.
        share: Step size as a fraction of the usual one.
        tolerance: Tolerance of the integrator for each step, relative and absolute.
        first_cells: Steps of the first compiled call; later calls take more.
    """
    control, medium, x = _targets_alone(system)
    M, stride, between, grid = len(x), _stride(system), _between(system), system.grid
    period = grid.period / between
    times = np.asarray(grid.start + period * np.arange(grid.steps * between + 1), dtype=np.float64)
    samples = np.empty(((len(times) - 1) // stride + 1, M, 3))
    samples[0] = x
    run = new_integrator(medium, system.effectiveness, (tolerance, tolerance), period, new_memory(control.law, M))
    decay = float(system.moving_bounds.slope[len(system.team.agents) :].max(initial=0.0))
    if grid.continuous:
        decay += targets_loop(system).rate
    setting = _Setting(control, _turn(system, control.motion), decay, share, times, stride)
    follow = control if grid.continuous else None
    n = max(1, int(MOST_STEPS / (share * M)))  # memory is taken as it is written to
    steps = _Steps(*map(np.empty, [(n,)] * 2 + [(n, M, 3)] * 4))
    count, k, since, step = place = (0, 0, 0.0, period)
    while count < n and k < len(times) - 1 and step > 0.0:
        count, k, since, step = place = _follow(
            follow, setting, run, x, steps, samples, place, min(2 * count + first_cells, n)
        )
    now = times[k] + since
    if k == len(times) - 1:
        return samples, _Steps(*(part[:count].copy() for part in steps))
    if count == n:
        raise UndecidedError(
            f"their path is too long or too stiff to follow: {n} steps lead to t = {now:.4g} s of {times[-1]:.4g} s"
        )
    fastest = system.team.target_ids[int(np.nan_to_num(np.linalg.norm(run.slope[0], axis=1), nan=np.inf).argmax())]
    raise UndecidedError(_beyond(fastest, now))


def _beyond(name: str, time: float) -> str:
    """Return why a target cannot be followed beyond a time, s."""
    return (
        f"{name} cannot be followed beyond t = {time:.6g} s: it runs into a singularity, or moves too fast for the "
        "resolution of floating-point time"
    )


def _cells_of(
    system: System,
    steps: _Steps,
    error: float,
    *,
    slack: float = 1.05,  # ratio of the next V to the one that was required
    guesses: int = 100,  # largest number of values of V
) -> Cells:
    """Return cells that contain every path within `error`, m, of the steps; see the module.

    Raises:
        UndecidedError: The speed cannot be bounded over a step, or the path leads through the surface of waves.
    """
    N, own = len(system.team.agents), slice(len(system.team.agents), None)
    control = _targets_alone(system)[0]
    pull, gain, moving, harmonics = control.motion.pull, control.law.gain, system.moving_bounds, system.harmonics[own]
    fastest, acceleration = reference_bounds(control.motion)
    shaken = (np.linalg.norm(harmonics[..., :3], axis=2) * np.abs(harmonics[..., 3])).sum(axis=1) + moving.change[own]
    L, places = system.team.target_sheaf.laplacian(), _places(system)

    def consensus(velocity: Array, size: Any) -> Array:
        """Return the absolute values of L_T or |L_T| times velocities (n, M, 3), shape (n, M, 3)."""
        moved = np.zeros((len(velocity), velocity[0].size))
        moved[:, places] = (size(L) @ velocity.reshape(len(velocity), -1)[:, places].T).T
        return np.abs(moved).reshape(velocity.shape)

    def alike(speed: Array) -> Array:
        return np.broadcast_to(speed[..., None], (*speed.shape, 3))

    h = (steps.end - steps.begin)[:, None]
    speed = np.linalg.norm(steps.velocity, axis=2)
    V, D, flow, slope, shake = speed.copy(), *np.zeros((4, *speed.shape))
    wrong = np.arange(len(speed))
    for _ in range(guesses):
        v = V[wrong]
        for k in range(len(pull)):
            slope[wrong, k] = bound_slopes(
                system.flows[int(system.field[N + k])], steps.start[wrong, k], h[wrong, 0] * v[:, k] + error
            )
        flow[wrong] = D[wrong] = np.where(v > 0.0, slope[wrong] * v, 0.0)
        if system.grid.continuous:
            D[wrong] += acceleration + pull * (fastest + v) + gain * np.linalg.norm(consensus(alike(v), abs), axis=2)
        shake[wrong] = shaken + np.where(moving.slope[own] > 0.0, moving.slope[own] * v, 0.0)
        largest = speed[wrong] + h[wrong] * (D[wrong] + shake[wrong])
        right = (largest <= v).all(axis=1)
        V[wrong] = np.where(right[:, None], v, slack * largest)
        wrong = wrong[~right]
        if not len(wrong):
            break
    else:
        raise UndecidedError(_beyond(system.team.target_ids[int(V[wrong[0]].argmax())], float(steps.begin[wrong[0]])))
    slope += pull + gain * np.linalg.norm(consensus(np.ones((1, len(pull), 3)), abs)[0], axis=1)
    if system.grid.continuous:  # consensus and pull act on p' and v - p' at the start, changed by h (D + W)
        lead = np.zeros_like(steps.velocity)
        _references(control.motion._replace(pull=np.zeros_like(pull)), steps.begin, np.zeros(3), lead)
        gap = np.linalg.norm(lead - steps.velocity, axis=2)
        for _ in range(2):
            change = h * (D + shake)
            moved = consensus(steps.velocity, lambda L: L) + consensus(alike(change), abs)
            acting = acceleration + pull * (gap + h * acceleration + change) + gain * np.linalg.norm(moved, axis=2)
            D = np.minimum(D, flow + acting)
    cells = Cells(
        begin=steps.begin,
        end=steps.end,
        centre=0.5 * (steps.start + steps.stop),
        half=0.5 * (steps.stop - steps.start),
        bend=0.125 * h * h * (D + shake),
        drift=steps.drift,
        spread=0.5 * h * D + error * slope,
        slope=slope,
    )
    _require_one_side(system, cells)
    return cells._replace(bend=cells.bend + error)


def _between(
    system: System,
    *,
    compared: int = 2000,  # least number of instants, about, at which two integrations of a continuous law are compared
) -> int:
    """Return the number of parts of a sample period, so that two integrations are compared at enough instants."""
    return max(1, compared // system.grid.steps) if system.grid.continuous else 1


def _stride(system: System) -> int:
    """Return the index step between stored samples."""
    return max(1, -(-3 * len(system.team.targets) * system.grid.steps // _MOST_NUMBERS))


def _targets_alone(system: System) -> tuple[ControlArrays, MediumArrays, Array]:
    """Pack law, references, medium and initial positions of the targets alone; they receive from no agent."""
    N, law, motion, medium = len(system.team.agents), system.law, system.motion, system.medium
    edges = pack_edges(system.team.targets, [(system.team.target_edges, True)])
    alone = law.without_terms._replace(edges=edges, gain=law.gain[N:], limit=law.limit[N:])
    alone = with_seed(alone._replace(links=LinkArrays()), 0)  # none of it is random
    own = {name: getattr(motion, name)[N:] for name in motion._fields if name not in ("knots", "coefficients")}
    around = medium._replace(
        agents=0,
        planar=medium.planar[N:],
        rows=medium.rows[N:],
        harmonics=varying.pack(system.harmonics[N:]),
        parts=tuple(part._replace(met=part.met[N:]) for part in medium.parts),
    )
    return ControlArrays(alone, motion._replace(**own)), around, system.initial[N:].copy()


def _turn(
    system: System,
    motion: MotionArrays,
    *,
    angle: float = 0.125,  # rad of the fastest motion or disturbance
) -> float:
    """Return a step that is much shorter than the time scales of motions and disturbances of the targets, s."""
    harmonics = system.harmonics[len(system.team.agents) :]
    fastest = max(
        system.moving_bounds.rate,
        float(np.abs(motion.rate).max(initial=0.0)),
        float(np.abs(harmonics[..., 3]).max(initial=0.0)),
    )
    pieces = np.diff(motion.knots)
    if (pieces > 0.0).any():  # one turn in each piece of a path through waypoints
        fastest = max(fastest, 2.0 * np.pi / float(pieces[pieces > 0.0].min()))
    return angle / fastest if fastest > 0.0 else np.inf


# -- the targets' own law ----------------------------------------------------------------------------------------------
#
# With p the stacked positions of the targets, k_T the gain of their consensus, L_T its Laplacian and P = diag(pull),
# the law commands v(t) + P (r(t) - p) - k_T (L_T p - c_T). Held over a period h on ideal kinematics, where a flow and a
# disturbance only add to what drives it,
#
#     p_{k+1} = (I - h S) p_k + ...,    S = k_T L_T + P,
#
# and S is symmetric and positive semidefinite. In an eigenvector of S with the eigenvalue mu > 0 the factor is 1 - h
# mu: it decays exactly if h mu < 2. If mu = 0, the law does not act on the mode, which then cannot diverge. So the law
# is stable exactly if h lambda_max(S) < 2. The continuous law, p' = -S p + ..., always is.
#
# On bodies the same commands go to vehicles with inertia: see `body_loop`.


class TargetsOnBodies(Record):
    """The targets' law closed through the vehicles that carry targets, for small motions."""

    stable: bool | None = Field(description="whether every mode that the law acts on decays; null: see reason")
    spectral_radius: Finite = Field(
        description="largest factor of a mode that moves a position, over a control period; null if undecided"
    )
    reason: str = Field(description="why it is undecided, or empty")


class TargetsLoop(Record):
    """The targets' own law, consensus and pull, held over a control period."""

    stable: bool = Field(description="on ideal kinematics; the continuous law always is")
    rate: float = Field(description="lambda_max(k_T L_T + pull), 1/s; 0 if targets follow neither path nor others")
    product: Finite = Field(description="control period times rate: stable below 2; null if the law is continuous")
    spectral_radius: Finite = Field(
        description="largest |1 - h mu| over the rates mu > 0 of its modes; null if there are none, or the law is "
        "continuous"
    )
    parts: list[str] = Field(description="parts of the law that act on targets: pull, consensus")
    targets: list[str] = Field(description="targets that move most in the fastest mode, if it does not decay")
    largest_period: Finite = Field(description="2 / rate: control periods below it are stable, s; null if rate is 0")
    bodies: TargetsOnBodies | None = Field(
        None, description="the same law on the targets' vehicles; null if it was not analysed, or rate is 0"
    )

    def verdict(self) -> str:
        """Describe how the loop diverges, on ideal kinematics or on bodies, with a fix; empty if it does not."""
        if not self.stable:
            fixes = {"pull": "motion.pull", "consensus": "target_formation.gain"}
            lower = " or ".join(fixes[part] for part in self.parts)
            return (
                f"{self.failure}; choose controller.control_period below {self.largest_period:.4g} s, "
                f"or a lower {lower}"
            )
        if self.bodies is not None and self.bodies.stable is False:
            return (
                "the targets' own law is unstable on their vehicles (spectral radius "
                f"{self.bodies.spectral_radius:.4g}); choose a lower motion.pull or target_formation.gain"
            )
        return ""

    @property
    def failure(self) -> str:
        """Reason why the law diverges on ideal kinematics; empty if it does not."""
        if self.stable:
            return ""
        return (
            f"the targets' own held law diverges: {' and '.join(self.parts)} of {listed(self.targets)} at "
            f"{self.rate:.4g} 1/s times the control period is {self.product:.4g}, expected below 2"
        )


def targets_loop(
    system: System,
    *,
    limit: float = 2.0 - 1e-9,  # of h lambda_max(S), below which modes decay
    dense: int = 600,  # rows of S up to which all eigenvalues are computed; else only the largest is
    involved: float = 0.5,  # fraction of the largest motion in the fastest mode, above which a target is named
) -> TargetsLoop:
    """Decide whether the targets' own law decays on ideal kinematics."""
    N, h = len(system.team.agents), system.grid.period
    S = stiffness(system)
    values, vector = np.zeros(0), np.zeros(S.shape[0])
    if S.nnz and S.shape[0] <= dense:
        values, vectors = np.linalg.eigh(S.toarray())
        values, vector = values[values > max(1e-12 * values[-1], 0.0)], vectors[:, -1]
    elif S.nnz:
        values, vectors = eigsh(S, k=1, which="LA", v0=np.ones(S.shape[0]))
        vector = vectors[:, 0]
    rate = float(values[-1]) if len(values) else 0.0
    held = rate > 0.0 and not system.grid.continuous
    stable = not held or h * rate < limit
    names = []
    if not stable:
        ends = np.cumsum([target.dimension for target in system.team.targets])
        moved = np.array([np.linalg.norm(part) for part in np.split(vector, ends[:-1])])
        names = [system.team.target_ids[k] for k in np.flatnonzero(moved >= involved * moved.max())]
    acts = {
        "pull": bool(system.motion.pull[N:].any()),
        "consensus": bool(system.law.gain[N:].any() and system.team.target_edges),
    }
    return TargetsLoop(
        stable=stable,
        rate=rate,
        product=None if system.grid.continuous else h * rate,
        spectral_radius=float(np.abs(1.0 - h * values).max()) if held else None,
        parts=select_true(acts),
        targets=names,
        largest_period=2.0 / rate if rate > 0.0 else None,
    )


def stiffness(system: System) -> sparse.csr_array:
    """Return S = k_T L_T + P on the stacked positions of the targets, shape (n_p, n_p), 1/s.

    Rows and columns of fixed targets and others without consensus and pull are 0.
    """
    team, N = system.team, len(system.team.agents)
    if not team.targets:
        return sparse.csr_array((0, 0))
    pull = np.repeat(system.motion.pull[N:], [target.dimension for target in team.targets])
    gain = float(system.law.gain[N:].max(initial=0.0))
    acts = sparse.diags_array(np.repeat(system.law.gain[N:] > 0.0, [target.dimension for target in team.targets]) * 1.0)
    return sparse.csr_array(gain * (acts @ team.target_sheaf.laplacian() @ acts) + sparse.diags_array(pull))
