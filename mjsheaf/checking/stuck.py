"""Agents of a finished run that are commanded to move and do not.

An agent is stuck while, for MIN_DURATION or longer and second after second,

- the commanded velocity relative to the medium has a mean above MIN_SPEED, and varies by less than its mean,
- the vehicle moves through the medium at less than a tenth of that, and of the speed of which it is capable, and does
  not gather speed.

An agent that has left the team is not stuck, and neither is one that is carried along by the medium it should rest in.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.checking.authority import authority_of
from mjsheaf.results.netcdf import pieces_of
from mjsheaf.system import Phase, System
from mjsheaf.vehicles.effects import capability_of, turning_of

if TYPE_CHECKING:
    import xarray as xr

MIN_DURATION = 5.0
"""Time for which a stuck agent does not move, s."""
MIN_SPEED = 0.05
"""Commanded speed below which an agent counts as commanded to stay, m/s."""

_BLOCK = 1.0  # s, over which velocities are averaged
_MAX_BLOCKS = 2000
_MAX_MADE = 0.1  # of the commanded speed
_MAX_GAIN = 0.02  # of the commanded speed, that an agent which is still under way gathers from block to block
_MOSTLY = 0.5  # of thrusters at a limit


@dataclass(frozen=True)
class Stuck:
    """The longest time for which one agent is stuck.

    Attributes:
        agent: Its number.
        start, end: Begin and end of that time, s.
        asked: Mean commanded speed meanwhile, m/s.
        error: Tracking error at the end of it, m.
        reason: Cause, in words.
    """

    agent: int
    start: float
    end: float
    asked: float
    error: float
    reason: str

    @property
    def duration(self) -> float:
        """Time from start to end, s."""
        return self.end - self.start


@dataclass(frozen=True)
class _Blocks:
    """Means over blocks of time, of every agent.

    Attributes:
        time: Begin of each block and end of the last, shape (B + 1,), s.
        asked: Commanded velocity relative to the medium, shape (B, N, 3), m/s.
        spread: RMS deviation of that from its mean, shape (B, N), m/s.
        made: Velocity relative to the medium, shape (B, N, 3), m/s.
        speed: RMS of that, shape (B, N), m/s.
        flow: Speed of the medium, shape (B, N), m/s.
        saturation: Fraction of thrusters at a limit, shape (B, N).
        error: Tracking error, shape (B, N), m.
    """

    time: Array
    asked: Array
    spread: Array
    made: Array
    speed: Array
    flow: Array
    saturation: Array
    error: Array


def find_stuck(phases: Sequence[Phase], dataset: "xr.Dataset") -> list[Stuck]:
    """Find the agents of a run on bodies that are stuck, the longest first; it is read in pieces."""
    time = dataset["time"].values
    if dataset.attrs["backend"] != "physics" or len(time) < 2 or time[-1] - time[0] < MIN_DURATION:
        return []
    system = phases[0].system
    blocks = _average(dataset, len(system.team.agents))
    still = _is_still(blocks) & _is_present(phases, blocks.time)
    for v in np.flatnonzero(still.any(axis=0)).tolist():  # at full speed it is not stuck, whatever the command
        still[:, v] &= blocks.speed[:, v] < _MAX_MADE * capability_of(system.vehicles[v]).least_speed
    found = [_longest(system, blocks, still[:, v], v) for v in np.flatnonzero(still.any(axis=0)).tolist()]
    return sorted((stuck for stuck in found if stuck), key=lambda stuck: (-stuck.duration, stuck.agent))


def _average(dataset: "xr.Dataset", agents: int) -> _Blocks:
    """Average a run over blocks of time."""
    time = dataset["time"].values
    span = float(time[-1] - time[0])
    count = min(len(time) - 1, max(1, int(span / _BLOCK)), _MAX_BLOCKS)
    edges = np.linspace(time[0], time[-1], count + 1)
    number, done = np.zeros(count), 0
    sums = {
        **{name: np.zeros((count, agents, 3)) for name in ("asked", "made")},
        **{name: np.zeros((count, agents)) for name in ("spread", "speed", "flow", "saturation", "error")},
    }
    names = ["velocity_command", "agent_velocity", "agent_flow", "agent_saturation", "tracking_error"]
    for piece in pieces_of(dataset, names):
        command, velocity, flow, saturation, error = (np.nan_to_num(piece[name].values) for name in names)
        block = np.clip(np.searchsorted(edges, time[done : done + len(error)], side="right") - 1, 0, count - 1)
        planar = np.isnan(piece["velocity_command"].values[..., 2])
        through = np.where(planar[..., None] & np.array([False, False, True]), 0.0, velocity - flow)
        each = {
            "asked": command,
            "made": through,
            "spread": (command**2).sum(axis=2),
            "speed": (through**2).sum(axis=2),
            "flow": np.linalg.norm(flow, axis=2),
            "saturation": saturation,
            "error": error,
        }
        for name, values in each.items():
            np.add.at(sums[name], block, values)
        np.add.at(number, block, 1.0)
        done += len(error)
    mean = {
        name: np.moveaxis(np.moveaxis(total, 0, -1) / np.maximum(number, 1.0), -1, 0) for name, total in sums.items()
    }
    square = mean["spread"] - (mean["asked"] ** 2).sum(axis=2)
    return _Blocks(edges, **{**mean, "spread": np.sqrt(np.maximum(square, 0.0)), "speed": np.sqrt(mean["speed"])})


def _is_still(blocks: _Blocks) -> BoolArray:
    """Return True for agents that are commanded to move and do not, shape (B, N)."""
    asked = np.linalg.norm(blocks.asked, axis=2)
    gained = np.zeros_like(asked)
    gained[1:] = np.linalg.norm(np.diff(blocks.made, axis=0), axis=2)
    wanted = (asked > MIN_SPEED) & (blocks.spread < asked)
    return np.asarray(wanted & (blocks.speed < _MAX_MADE * asked) & (gained < _MAX_GAIN * asked))


def _is_present(phases: Sequence[Phase], edges: Array) -> BoolArray:
    """Return True for agents that belong to the team in each block, shape (B, N)."""
    present = np.array([phase.system.team.present for phase in phases])
    begin = np.array([phase.time for phase in phases])
    first, last = (np.clip(np.searchsorted(begin, when, side="right") - 1, 0, None) for when in (edges[:-1], edges[1:]))
    return np.asarray(present[first] & present[last])


def _longest(system: System, blocks: _Blocks, still: BoolArray, v: int) -> Stuck | None:
    """Return the longest time for which an agent is still, shape (B,); None where that is too short."""
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
    )


def _reason(system: System, v: int, asked: float, flow: float, saturation: float) -> str:
    """Say why an agent does not move."""
    vehicle = system.vehicles[v]
    able = capability_of(vehicle).least_speed
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
