"""Ending of a finished run, and agents that are commanded to move and do not.

`run`, `sweep`, `compare` and the trial of `check` judge the ending by the tracking error E(t) of the team, the RMS over
agents of |q*_i - q_i|, over the last quarters of a run:

    diverging    E, or an oscillation of the team that nothing explains, grows, and does not grow more slowly
    settled      E keeps its level; any remaining oscillation is driven by something, or decays
    not settled  anything else: E still changes, an oscillation that nothing explains does not decay, or an agent that
                 is commanded to move does not, to the end (see below)

Targets that move, disturbances, gusts, waves and noise drive a team. The errors then show an unstable loop only where
the team oscillates by more than the motion of q*, bounded changes of the medium and the noise of its links explain. So
`checking.loop.body_loop.ending_of_run` also analyses the loop of its vehicles.

An agent is stuck while, for MIN_DURATION or longer, in every second,

- the commanded velocity relative to the medium has a mean above MIN_SPEED, and varies by less than its mean,
- the vehicle moves through the medium at less than a tenth of that and of its top speed in its slowest direction, and
  does not accelerate.

An agent that has left the team is not stuck. Neither is an agent that should rest relative to the medium and drifts
with it, nor one whose command holds it against the wind on its hull, that is, differs from the command that does so by
at most half of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import xarray as xr

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.loop.system import Phase, System, phases_of
from mjsheaf.media.medium import WITHOUT_MEAN
from mjsheaf.results.dataset import of_phase
from mjsheaf.results.store import thinned
from mjsheaf.vehicles.effects import authority_of, turning_of

Ending = Literal["settled", "not settled", "diverging"]

ROUNDING = 1e-9
"""Largest errors, and oscillations of them, that count as rounding, m."""
_MIN_UNDECAYED = 0.95  # amplitude of an oscillation in a quarter over that of the quarter before; below, it decays

_MIN_SAMPLES = 8
# A mode of the law passes on at most the motion of q* at each frequency, and a loop at 0.8 of its largest gain about
# four times that. So q* does not explain an oscillation larger than this factor times its own. That of q* is counted
# about a parabola: a target that slows down drives none. That takes at most a fifth from 1.5 periods a quarter, and
# fewer hardly count as an oscillation.
_MAX_OF_Q_STAR = 5.0
# Noise of a standard deviation s moves a mode of the law by s sqrt(k h / (2 - k h lambda)) RMS, with lambda its
# eigenvalue of H, for maps and weights of size 1. That is less than s, unless the gain is near its limit. So noise does
# not explain an oscillation larger than this factor times s, over all axes of an agent.
_MAX_OF_NOISE = 3.0
# A disturbance of d m/s moves a free agent by d / omega m at a frequency of omega rad/s. It does not explain an
# oscillation larger than this factor times that. One sine at the resonance of a mode over links that delay moves it by
# 2.7 d / omega RMS at 0.7 of the largest stable gain, and by 4.1 d / omega at 0.8.
_MAX_OF_DISTURBANCE = 3.0


def ending_of_motion(
    run: System | Sequence[Phase], dataset: xr.Dataset, stuck: Sequence["Stuck"] | None = None
) -> Ending | None:
    """Judge the end of a finished run, or of its last phase if it has events; None below 8 samples.

    Args:
        run: System of the run, or its phases.
        dataset: Result of `simulate`.
        stuck: Agents that `find_stuck` finds stuck at the end, if the caller has them.
    """
    system, last = of_phase(run, dataset, -1)
    q_star, positions = (np.nan_to_num(last[name].values) for name in ("harmonic_extension", "agent_position"))
    offsets = q_star - positions
    error = np.sqrt((offsets**2).sum(axis=2).mean(axis=1))
    ending = judge(error, offsets if is_unexplained(system, last["time"].values, q_star, offsets) else None)
    if ending == "settled" and stuck is None:
        stuck = [one for one in find_stuck(phases_of(run), dataset) if one.at_end]
    return "not settled" if ending == "settled" and stuck else ending


def is_unexplained(system: System, time: Array, q_star: Array, offsets: Array) -> bool:
    """Return True if neither q*, noise nor the medium explains the motion of agents about q* over the last quarter.

    False also if something acts on them whose effect is not known, or for fewer than 8 samples.

    Args:
        system: System of the phase.
        time: Sample times, shape (T,), s.
        q_star: q* of all agents, shape (T, N, 3), m.
        offsets: Offset of every agent, or of some, from its q*, shape (T, n, 3), m.
    """
    links = system.law.links.table
    angles = any(edge.measures == "bearing" for edge in system.team.measuring_edges) and links["noise"].any()
    unknown = angles or links["bearing_noise"].any() or system.law.terms.noise > 0.0
    unknown |= any(isinstance(part, WITHOUT_MEAN) for part in system.moving)
    unknown |= system.planar[: len(system.team.agents)].any() and not system.flow_named("wind").is_steady  # over hulls
    if unknown or len(time) < _MIN_SAMPLES:
        return False
    noise = float(max(links["noise"].max(initial=0.0), links["range_noise"].max(initial=0.0)))
    quarter = _quarters(offsets)[-1]
    half_period = float(time[-1] - time[-len(quarter)]) / max(_reversals(quarter), 1)
    disturbance = float(system.largest_disturbance[: len(system.team.agents)].max(initial=0.0))
    swing = _swing(quarter)
    places = _quarters(q_star)[-1]  # of the team, for any agent
    squares = np.linalg.lstsq(np.vander(np.linspace(-1.0, 1.0, len(places)), 3), places.reshape(len(places), -1))[1]
    of_q_star = float(np.sqrt(squares.sum() / len(places)))  # about parabolas; 0 for up to three samples
    explained = _MAX_OF_NOISE * noise, _MAX_OF_DISTURBANCE * disturbance * half_period / np.pi
    return swing > max(*explained, _MAX_OF_Q_STAR * of_q_star)


def judge(error: Array, offsets: Array | None = None) -> Ending | None:
    """Judge the end of a run; None for fewer than 8 samples, or if the error is not finite.

    Args:
        error: Error of the team, shape (T,), m.
        offsets: Offset of every agent from its q*, shape (T, N, 3), m, if nothing explains their motion; else None.
    """
    if not _is_judgeable(error):
        return None
    # A fainter oscillation than a ten-thousandth of the range of the error does not count.
    swing = None if offsets is None else undecayed_swing(offsets, max(1e-4 * float(np.ptp(error)), ROUNDING))
    if swing is not None:
        return "not settled" if swing <= 2.0 - _MIN_UNDECAYED else "diverging"
    if is_level(error):
        return "settled"
    first, before, last = (_mean(quarter)[0] for quarter in _quarters(error))
    # A rise that slows more is a transient.
    return "diverging" if before > first and last - before > 0.9 * (before - first) else "not settled"


def undecayed_swing(offsets: Array, least: float, min_ratio: float = _MIN_UNDECAYED) -> float | None:
    """Return the amplitude of an oscillation in the last quarter over that in the quarter before.

    None if offsets (T, N, 3), m, do not oscillate at the end by more than `least`, m, or if the ratio is less.
    """
    third, fourth = _quarters(offsets)[-2:]
    ratio = _swing(fourth) / max(_swing(third), 1e-300)
    oscillates = _swing(fourth) > least and _reversals(fourth) >= 3  # fewer may be a drift
    return ratio if oscillates and ratio >= min_ratio else None


def _is_judgeable(error: Array) -> bool:
    """Return True if an error has enough samples, all finite."""
    return len(error) >= _MIN_SAMPLES and bool(np.isfinite(error).all())


def is_level(error: Array) -> bool:
    """Return True if the mean of an error (T,), m, over the last quarter equals that over the quarter before.

    They may differ by 1e-9 m, by 1 % of the range of the error, by 5 % of both that range and the mean, or by the
    effect of unfinished periods of an oscillation.

    An error that decays to zero as exp(-r t) is level if r T is above 7.3. One that decays to a constant is level once
    it changes little relative to that constant. One that oscillates about a constant is level if a quarter contains at
    least one period.
    """
    quarters = _quarters(error)
    (first, _), (before, _), (level, _) = means = [_mean(quarter) for quarter in quarters]
    trend = (level - before) * (before - first) > 0.0 and all(whole for _, whole in means)
    through, reversals = float(np.ptp(error)), _reversals(quarters[-1])
    allowed = max(0.01 * through, 0.05 * min(through, level), ROUNDING)
    if reversals >= 2 and not trend:
        # A sine of n half periods and a part of one has a mean of at most its amplitude over n pi.
        allowed = max(allowed, 2.0 * float(np.ptp(quarters[-1])) / reversals / np.pi)
    return abs(level - before) <= allowed


def settling_time(time: Array, error: Array) -> float | None:
    """Return the time from the start until an error has become level, s; None if it never does.

    It is the first sample from which on the error stays below 1.25 times its maximum over the second half of the run
    plus 2 % of its maximum over the run. The transient is then small relative to the remaining constant, oscillation or
    noise.

    Args:
        time: Sample times, shape (T,), s.
        error: Error of the team, shape (T,), m.
    """
    if not _is_judgeable(error) or not is_level(error):
        return None
    limit = 1.25 * error[len(error) // 2 :].max() + 0.02 * float(error.max())
    outside = np.flatnonzero(error > limit)
    return float(time[int(outside[-1]) + 1 if outside.size else 0] - time[0])


def _quarters(values: Array) -> list[Array]:
    """Return the last three quarters of a series, of equal length."""
    n = len(values) // 4
    return [values[len(values) - k * n : len(values) - (k - 1) * n] for k in (3, 2, 1)]


def _mean(quarter: Array) -> tuple[float, bool]:
    """Return the mean of a quarter over its whole periods, or over all of it without one, and True for the former.

    If the rise of the trend exceeds the range of the rest, the whole quarter is averaged: that of a part is far off.
    """
    trend = np.linspace(-0.5, 0.5, len(quarter))
    rise = 12.0 * (trend @ quarter) / len(quarter)
    level = quarter - quarter.mean() - rise * trend
    rising = np.flatnonzero((level[:-1] < 0.0) & (level[1:] >= 0.0))
    if len(rising) < 2 or abs(rise) > np.ptp(level):
        return float(quarter.mean()), len(rising) >= 2
    return float(quarter[rising[0] : rising[-1]].mean()), True


def _swing(offsets: Array) -> float:
    """Return the RMS over time and agents of the distance of offsets (T, N, 3), m, from their mean, m."""
    return float(np.sqrt(offsets.var(axis=0).sum(axis=-1).mean())) if len(offsets) else 0.0


def swing_at_end(offsets: Array) -> float:
    """Return the RMS over the last quarter and agents of the distance of offsets (T, N, 3), m, from their mean, m."""
    return _swing(_quarters(offsets)[-1])


def _reversals(values: Array) -> int:
    """Count the crossings of the mean by the component of (T, ...) that varies most."""
    flat = values.reshape(len(values), -1)
    own = flat[:, int(flat.var(axis=0).argmax())]
    sign = np.sign(own - own.mean())
    sign = sign[sign != 0.0]
    return int((sign[1:] != sign[:-1]).sum())


# -- agents that do not move -------------------------------------------------------------------------------------------

MIN_DURATION = 5.0
"""Time for which a stuck agent does not move, s."""
MIN_SPEED = 0.05
"""Commanded speed below which an agent counts as commanded to stay, m/s."""

_BLOCK = 1.0  # s, over which velocities are averaged
_MAX_MADE = 0.1  # largest speed of a stuck agent, as a fraction of the commanded one
# Fraction of thrusters at a limit; and relative difference of a command from that which holds a hull against the wind.
_MOSTLY = 0.5


@dataclass(frozen=True)
class Stuck:
    """The longest time for which one agent is stuck.

    Attributes:
        agent: Number of the agent.
        start, end: Start and end of that time, s.
        asked: Mean commanded speed meanwhile, m/s.
        error: Tracking error at the end of it, m.
        reason: Cause, in words.
        at_end: True if it lasts to the end of the run, away from the agent's place.
    """

    agent: int
    start: float
    end: float
    asked: float
    error: float
    reason: str
    at_end: bool = False

    @property
    def duration(self) -> float:
        """Time from start to end, s."""
        return self.end - self.start


@dataclass(frozen=True)
class _Blocks:
    """Means over blocks of time, of every agent.

    Attributes:
        time: Start of each block and end of the last, shape (B + 1,), s.
        asked: Mean of the commanded velocity relative to the medium, shape (B, N, 3), m/s.
        speed: RMS of the velocity relative to the medium, shape (B, N), m/s.
        flow: Speed of the medium, shape (B, N), m/s.
        saturation: Fraction of thrusters at a limit, shape (B, N).
        error: Tracking error, shape (B, N), m.
        still: True for agents that are commanded to move but do not, shape (B, N).
    """

    time: Array
    asked: Array
    speed: Array
    flow: Array
    saturation: Array
    error: Array
    still: BoolArray


def find_stuck(phases: Sequence[Phase], dataset: xr.Dataset) -> list[Stuck]:
    """Find the agents of a run on bodies that are stuck, the longest first."""
    time = dataset["time"].values
    if dataset.attrs["backend"] != "physics" or len(time) < 2 or time[-1] - time[0] < MIN_DURATION:
        return []
    system = phases[0].system
    blocks = _average(dataset)
    present = np.array([phase.system.team.present for phase in phases])
    number = np.clip(np.searchsorted([phase.time for phase in phases], blocks.time, side="right") - 1, 0, None)
    still = blocks.still & present[number[:-1]] & present[number[1:]]
    held = -system.drift_in_wind(np.zeros((still.shape[1], 3)))  # command of an agent at rest in wind
    for v in np.flatnonzero(still.any(axis=0)).tolist():  # at full speed it is not stuck, whatever the command
        still[:, v] &= blocks.speed[:, v] < _MAX_MADE * system.vehicles[v].capability.least_speed
        # Nor is it stuck if the command holds it against the wind on its hull.
        beyond = np.linalg.norm(blocks.asked[:, v] - held[v], axis=1)
        still[:, v] &= (beyond > _MOSTLY * np.linalg.norm(held[v])) | (blocks.saturation[:, v] > _MOSTLY)
    found = [_longest(system, blocks, still[:, v], v) for v in np.flatnonzero(still.any(axis=0)).tolist()]
    return sorted((stuck for stuck in found if stuck), key=lambda stuck: (-stuck.duration, stuck.agent))


def _average(dataset: xr.Dataset) -> _Blocks:
    """Average a run over at most 2000 blocks of time; a long run is thinned."""
    names = ["velocity_command", "agent_velocity", "agent_flow", "agent_saturation", "tracking_error"]
    data = thinned(dataset[["agent_position", *names]])
    time = data["time"].values
    command, velocity, flow, saturation, error = (np.nan_to_num(data[name].values) for name in names)
    through = velocity - flow
    through[..., 2][np.isnan(data["velocity_command"].values[..., 2])] = 0.0  # of vehicles in the plane
    count = min(len(time) - 1, max(1, int((time[-1] - time[0]) / _BLOCK)), 2000)
    edges = np.linspace(time[0], time[-1], count + 1)
    first = np.searchsorted(time, edges[:-1])
    size = np.maximum(np.diff(np.append(first, len(time))), 1)

    def mean(values: Array) -> Array:
        return (np.add.reduceat(values, first).T / size).T

    asked = mean(command)
    wanted = np.linalg.norm(asked, axis=2)
    speed = np.sqrt(mean((through**2).sum(axis=2)))
    gained = np.zeros_like(wanted)
    gained[1:] = np.linalg.norm(np.diff(mean(through), axis=0), axis=2)
    steady = mean((command**2).sum(axis=2)) < 2.0 * wanted**2  # the command varies by less than its mean
    # From block to block the speed of a stuck agent grows by less than a fiftieth of the commanded one.
    still = (wanted > MIN_SPEED) & steady & (speed < _MAX_MADE * wanted) & (gained < 0.02 * wanted)
    return _Blocks(
        time=edges,
        asked=asked,
        speed=speed,
        flow=mean(np.linalg.norm(flow, axis=2)),
        saturation=mean(saturation),
        error=mean(error),
        still=still,
    )


def _longest(system: System, blocks: _Blocks, still: BoolArray, v: int) -> Stuck | None:
    """Return the longest time for which an agent is still; None if that is too short."""
    change = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    begins, ends = change[::2], change[1::2]
    k = int((blocks.time[ends] - blocks.time[begins]).argmax())
    begin, end = int(begins[k]), int(ends[k])
    if blocks.time[end] - blocks.time[begin] < MIN_DURATION - 1e-9:
        return None
    part = slice(begin, end)
    asked = float(np.linalg.norm(blocks.asked[part, v], axis=1).mean())
    return Stuck(
        agent=v,
        start=float(blocks.time[begin]),
        end=float(blocks.time[end]),
        asked=asked,
        error=float(blocks.error[end - 1, v]),
        reason=_reason(system, v, asked, float(blocks.flow[part, v].mean()), float(blocks.saturation[part, v].mean())),
        at_end=end == len(still) and float(blocks.error[end - 1, v]) > ROUNDING,
    )


def _reason(system: System, v: int, asked: float, flow: float, saturation: float) -> str:
    """Return the reason why an agent does not move."""
    vehicle = system.vehicles[v]
    able = vehicle.capability.least_speed
    if flow > able:
        return f"the medium moves at {flow:.3g} m/s, and its vehicle makes {able:.3g} m/s"
    authority = authority_of(vehicle)
    if authority.lacking:
        turning = turning_of(vehicle)
        if turning is not None and asked < 2.0 * turning.speed:
            return (
                f"its vehicle cannot push astern, and drifts rather than turn round for less than "
                f"{turning.speed:.2g} m/s; a higher gain brings it nearer"
            )
        return f"its thrusters are one-sided: they push {authority.describe()}"
    held = "its thrusters push against each other, or something holds it"
    return "its thrusters are at a limit" if saturation > _MOSTLY else held
