"""Trial of a mission: the scenario is run once on bodies, without files, and its end is judged.

The analysis of `check` is about linear loops and bounds. The trial is about everything else that a run contains: limits
of thrusters, large angles, the safety filter, losses, gusts. It runs on the fused engine, and on MuJoCo where contacts
are on, with the scenario's seed. Its verdict is the same on every machine: the part that is tried depends on the
number of vehicle-steps alone.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array, IntArray
from mjsheaf.checking.finished import MIN_DURATION, MIN_SPEED, ROUNDING, ending_of_run, find_stuck
from mjsheaf.checking.separation import TooClose, too_close_in
from mjsheaf.errors import InputError, NotUniqueError, RankError
from mjsheaf.io.norms import PER_AGENT_RMS, Norm
from mjsheaf.io.section import Finite, Record
from mjsheaf.loop.session import engine_of, moved_by, require_simulable
from mjsheaf.loop.trajectory import samples_in_piece
from mjsheaf.results.dataset import join, make_datasets, of_phase
from mjsheaf.results.metrics import check_expectation, late_errors, safety_of, summarize, summarize_phases
from mjsheaf.scenario import Scenario
from mjsheaf.system import Phase, System

if TYPE_CHECKING:
    import xarray as xr

MAX_VEHICLE_STEPS = 100_000_000
"""Largest number of vehicles times physics steps of a trial; of a larger mission the beginning is tried."""

_MAX_JUDGED = 1_000_000  # agents times samples that are judged; more are thinned evenly
_JUDGED = (
    "agent_position",
    "target_position",
    "harmonic_extension",
    "tracking_error",
    "disagreement",
    "formation_error",
    "centering_error",
    "group_formation_error",
    "group_centering_error",
    "velocity_command",
    "agent_velocity",
    "agent_flow",
    "agent_saturation",
    "agent_height",
    "separation",
    "safety_correction",
    "safety_violation",
)
_MIN_SAMPLES = 8  # of a phase whose end is judged
_ROUNDING = 1e-6  # m, of distances
_CLOSER = 1.1  # times the distance that a pair lacks at the start
_OFTEN = 0.1  # largest fraction of the second half that a vehicle may spend at a limit
_AT_LIMIT = 1.0 - 1e-9  # of the velocity limit
_SHORTFALL = 0.2  # fraction of the commanded velocity that a vehicle does not make, above which it is at a limit
_GROWTH = 1.5  # mean error of the last quarter over that about the middle, above which it has grown
_FASTER = 2.0  # growth of one quarter over that of the last, above which the error grows without bound
_SPEEDS_UP = 1.1  # mean speed of q* in the last quarter over that of the third, above which a target speeds up
_SLOW = 1.1  # mean error of the last quarter over that of the second, above which steady growth counts
_STILL = 0.05  # RMS motion of q* over that of an agent about it, below which q* rests
_UNDECAYED = 0.95  # amplitude of the last quarter over that of the third, above which an oscillation does not decay
_RESONANCE = 3.0  # times the motion by a disturbance alone, below which an oscillation may be due to it
_REVERSALS = 4  # in the second half, from which on a motion is an oscillation
_MIN_COMMAND = 0.1  # m/s, below which an agent counts as commanded to stay
_MIN_SHARE = 0.65  # part of its commanded velocity that an agent makes unless it is short of it
_MIN_HEADWAY = 0.15  # fraction of the commanded speed that an agent makes in its direction
_APPROACHING = 0.9  # mean error of the last quarter over that of the third, below which an agent approaches
_AT_REST = 1e-3  # mean disagreement over mean tracking error, below which a law is at rest
_FAR = 3.0  # times the error that the analysis foresees
_FAR_BY = 1.0  # m: further than that
_SMALL = 0.2  # m: errors that grow by less do not count
_STEADY = 0.9  # of the growth of one quarter over the last: growth that slows down by more is a transient


class TrialProblem(Record):
    """A reason why a mission failed when it was tried."""

    kind: str = Field(
        description="refused, blow_up, diverging, saturated, deadlock, stuck, too_close, limit_cycle, target, fallen, "
        "far_off, or expectation"
    )
    text: str = Field(description="a sentence with agent, time and number")
    agent: str | None = Field(description="id of the agent with the worst value; null for the team")
    time: Finite = Field(description="when, s; null where that has no meaning")
    number: Finite = Field(description="severity in m; null where the text has it alone")


class TrialRecord(Record):
    """A run of the scenario on bodies with its seed, and how it ended."""

    ok: bool = Field(description="nothing failed")
    seconds: float = Field(description="simulated time that was tried, s")
    complete: bool = Field(description="false if the mission is too large to be tried to its end")
    tracking_error: Finite = Field(
        description="RMS over agents and the second half of the time that was tried, m; null: none"
    )
    norm: Norm = Field(PER_AGENT_RMS, description="which norm `tracking_error` is")
    ending: str | None = Field(
        description="settled, moving, growing, circling or stuck, as in summary.json; null: see `problems`"
    )
    problems: list[TrialProblem] = Field(description="why the mission failed, the most important first")


def try_mission(
    scenario: Scenario, foreseen: float | None = None, progress: Callable[[int, int], None] | None = None
) -> TrialRecord:
    """Run a scenario on bodies and judge the run.

    Args:
        scenario: The scenario.
        foreseen: Tracking error that the analysis foresees, RMS over agents and the second half, m; None if unknown.
        progress: Called with the samples done and the number of samples.

    Raises:
        InputError: The scenario cannot be simulated for a reason that is not one of the theory's assumptions.
    """
    contacts = scenario.whole.bodies.contacts
    phases = moved_by(scenario.phases, "physics", "mujoco" if contacts else "fused")
    try:
        require_simulable(phases, "physics")
    except (NotUniqueError, RankError) as error:
        return _refused(error)
    try:
        run = _run(scenario, phases, progress)
    except InputError as error:  # of a registered term
        return _refused(error)
    data = run.data
    finished = data.attrs["status"] == "finished"
    late = late_errors(phases[0].system.team, data)["tracking_error"]
    problems = list(_problems(scenario, phases, run))
    if finished and not problems and run.complete and late is not None:
        problems += _far_off(phases, data, late, foreseen)
    return TrialRecord(
        ok=not problems,
        seconds=float(data["time"][-1] - data["time"][0]),
        complete=run.complete,
        tracking_error=late,
        ending=ending_of_run(phases, data) if finished else None,
        problems=problems,
    )


def _refused(error: Exception) -> TrialRecord:
    """Return the record of a trial that an error ends."""
    problem = TrialProblem(kind="refused", text=f"the run is refused: {error}", agent=None, time=None, number=None)
    return TrialRecord(ok=False, seconds=0.0, complete=False, tracking_error=None, ending=None, problems=[problem])


class _Run(NamedTuple):
    """A run in memory.

    Attributes:
        data: The variables that are judged, at samples that may be thinned.
        complete: True if the run reaches the end of the mission, or blew up before it.
        initial: Pairs that are too close at the first sample.
        closest: Pairs that are too close at some sample, each when it is closest.
    """

    data: "xr.Dataset"
    complete: bool
    initial: Mapping[tuple[str, ...], TooClose]
    closest: Mapping[tuple[str, ...], TooClose]


def _run(scenario: Scenario, phases: Sequence[Phase], progress: Callable[[int, int], None] | None) -> _Run:
    """Run the part of a mission that fits."""
    system = phases[0].system
    end = system.grid.steps + 1
    parts: list[xr.Dataset] = []
    done = 0
    initial: dict[tuple[str, ...], TooClose] = {}
    closest: dict[tuple[str, ...], TooClose] = {}
    with engine_of(phases, "physics") as engine:
        fitting = MAX_VEHICLE_STEPS // (len(system.team.members) * engine.steps_per_sample)
        samples = min(end, max(fitting, 1) + 1)
        stride = -(-samples * len(system.team.agents) // _MAX_JUDGED)
        recorded = engine.record(min(samples_in_piece(system), samples))
        for piece in make_datasets(recorded, "physics", scenario.seed, phases):
            part = piece.isel(time=slice(0, samples - done))
            if "separation" in part:
                if not done:
                    initial = too_close_in(system, part.isel(time=[0]))
                for pair, worst in too_close_in(system, part).items():
                    if pair not in closest or worst.gap < closest[pair].gap:
                        closest[pair] = worst
            length = part.sizes["time"]
            ends = done + length == samples or part.attrs["status"] != "finished"
            chosen = sorted({*range(-done % stride, length, stride), *([length - 1] if ends else [])})
            parts.append(part[[name for name in _JUDGED if name in part]].isel(time=chosen))
            done += length
            if progress:
                progress(done, samples)
            if done == samples:
                break
    data = join(part for part in parts if part.sizes["time"])
    return _Run(data, samples == end or data.attrs["status"] != "finished", initial, closest)


def _problems(scenario: Scenario, phases: Sequence[Phase], run: _Run) -> Iterator[TrialProblem]:
    """Yield why a run fails, the most important first."""
    data = run.data
    team = phases[0].system.team
    end = float(data["time"][-1])
    if data.attrs["status"] != "finished":
        yield TrialProblem(kind="blow_up", text=data.attrs["message"], agent=None, time=end, number=None)
        return
    safety = safety_of(data)
    for pair, worst in sorted(run.closest.items(), key=lambda item: item[1].gap):
        start = run.initial[pair].gap if pair in run.initial else 0.0  # these vehicles may have to stop first
        if worst.gap < _CLOSER * start - _ROUNDING:
            who = " and ".join(pair)
            text = f"{who} come {-worst.gap:.3g} m closer than the required distance at t = {worst.time:.6g} s"
            yield TrialProblem(kind="too_close", text=text, agent=pair[0], time=worst.time, number=-worst.gap)
            break
    off = dict(zip(team.agent_ids, np.nan_to_num(data["tracking_error"].values[-1]).tolist(), strict=True))
    deadlocked = sorted(safety["deadlocked"] if safety else [], key=off.__getitem__, reverse=True)
    if deadlocked:
        first = deadlocked[0]
        who = _are(first, len(deadlocked) - 1)
        text = f"{who} deadlocked: the safety filter keeps {first} {off[first]:.3g} m off at t = {end:.6g} s"
        yield TrialProblem(kind="deadlock", text=text, agent=first, time=end, number=off[first])
    stuck = [one for one in find_stuck(phases, data) if one.end >= end and one.error > ROUNDING]
    if stuck:
        first = team.agent_ids[stuck[0].agent]
        text = (
            f"{_are(first, len(stuck) - 1)} stuck: {first} does not move from t = {stuck[0].start:.6g} s to the end, "
            f"{stuck[0].error:.3g} m off: {stuck[0].reason}"
        )
        yield TrialProblem(kind="stuck", text=text, agent=first, time=stuck[0].start, number=stuck[0].error)
    system, last = of_phase(phases, data, -1)
    growing = list(_diverging(system, last))
    yield from growing
    if not stuck and not growing:
        yield from _without_headway(system, last)
    yield from _circling(system, last)
    yield from _carried_targets(phases[0].system, data)
    yield from _fallen(system, last)
    if run.complete and scenario.expect.controller is None:
        final, own = summarize(team, data), summarize_phases(team, data)
        checks = check_expectation(scenario.expect, "physics", "finished", final, own, safety)["checks"]
        for check in checks:
            if not check["met"] and check["measure"] != "refused":
                value = "none" if check["found"] is None else f"{check['found']:.4g} m"
                text = f"expect.physics.{check['measure']} is {value} at t = {end:.6g} s, bound {check['bound']:g} m"
                yield TrialProblem(kind="expectation", text=text, agent=None, time=end, number=check["found"])


def _diverging(system: System, last: "xr.Dataset") -> Iterator[TrialProblem]:
    """Yield agents whose error grows to the end of the last phase while they are at a limit, or ever faster.

    An error that grows is no fault by itself: it also follows a target that speeds up. Neither is one that an event
    ends, such as the end of a shadow.
    """
    errors = last["tracking_error"].values
    time = last["time"].values
    q_star = np.nan_to_num(last["harmonic_extension"].values)
    if len(errors) < _MIN_SAMPLES or time[-1] - time[0] < MIN_DURATION:
        return
    _, second, third, fourth = (part.mean(axis=0) for part in np.array_split(errors, 4))
    eighth = len(errors) // 8
    middle = errors[len(errors) // 2 - eighth : len(errors) // 2 + eighth + 1].mean(axis=0)
    limited = _limited(system, last)
    steadily = (third > second) & (fourth - third > _STEADY * (third - second)) & (fourth > _SLOW * second + _SMALL)
    grown = (fourth > _GROWTH * middle + _SMALL) | steadily
    faster = (third > second) & (fourth - third > _FASTER * (third - second)) & (fourth > _GROWTH * middle + _FAR_BY)
    speeds = [np.linalg.norm(np.diff(q, axis=0), axis=2).mean(axis=0) for q in np.array_split(q_star, 4)]
    faster &= speeds[3] <= _SPEEDS_UP * speeds[2]  # else the error follows the target
    failed = np.flatnonzero((limited > _OFTEN) & grown | faster)
    if not len(failed):
        return
    worst, name, who = _worst_of(system, failed, fourth)
    at_limit = limited[worst] > _OFTEN
    limits = f"at a limit of its vehicle or its speed for {100.0 * limited[worst]:.0f} % of the second half"
    text = (
        f"{who} left behind: the mean error of {name} grows from {middle[worst]:.3g} m about the middle to "
        f"{fourth[worst]:.3g} m in the last quarter, up to t = {time[-1]:.6g} s" + (f", {limits}" if at_limit else "")
    )
    kind = "saturated" if at_limit else "diverging"
    yield TrialProblem(kind=kind, text=text, agent=name, time=float(time[-1]), number=float(fourth[worst]))


def _without_headway(system: System, last: "xr.Dataset") -> Iterator[TrialProblem]:
    """Yield agents that move, but not where they are commanded to, or too little, and do not get nearer.

    Boats that circle about their places are such agents, and drones whose commands jump faster than they can lean.
    """
    duration = 0.25 * float(last["time"][-1] - last["time"][0])
    if last.sizes["time"] < _MIN_SAMPLES or duration < MIN_DURATION:
        return
    third, fourth = (part.mean(axis=0) for part in np.array_split(last["tracking_error"].values, 4)[2:])
    quarter = last.isel(time=slice(-(last.sizes["time"] // 4), None))
    # Means over a second: commands jump with noise and losses, and velocities follow them later.
    seconds = max(1, int(float(quarter["time"][-1] - quarter["time"][0])))
    made = np.nan_to_num((quarter["agent_velocity"] - quarter["agent_flow"]).values)
    command, made = (
        np.array([block.mean(axis=0) for block in np.array_split(values, min(seconds, len(values)))])
        for values in (np.nan_to_num(quarter["velocity_command"].values), made)
    )
    size = np.linalg.norm(command, axis=2)
    headway = ((made * command).sum(axis=2) / np.where(size > 0.0, size, 1.0)).mean(axis=0)
    commanded = size.mean(axis=0)
    idle = (headway < _MIN_HEADWAY * commanded) & (fourth > 2.0 * _FAR_BY) & (fourth > _APPROACHING * third)
    share = (made * command).sum(axis=(0, 2)) / np.maximum((command**2).sum(axis=(0, 2)), ROUNDING)
    short = (share < _MIN_SHARE) & (fourth > 3.0 * _FAR_BY) & (fourth > third)
    failed = np.flatnonzero((commanded > _MIN_COMMAND) & (idle | short))
    if len(failed):
        time = float(last["time"][-1])
        worst, name, who = _worst_of(system, failed, fourth)
        text = (
            f"{who} without headway: {name} is commanded {commanded[worst]:.3g} m/s and makes "
            f"{headway[worst]:.3g} m/s of it, {fourth[worst]:.3g} m off to the end at t = {time:.6g} s"
        )
        yield TrialProblem(kind="stuck", text=text, agent=name, time=time, number=float(fourth[worst]))


def _circling(system: System, last: "xr.Dataset") -> Iterator[TrialProblem]:
    """Yield agents in a limit cycle: they oscillate without decay over the last phase, and nothing drives them.

    A bounded disturbance of d m/s moves an agent by d / omega m at a frequency of omega rad/s.
    """
    if last.sizes["time"] < _MIN_SAMPLES or system.moving:
        return
    q_star = np.nan_to_num(last["harmonic_extension"].values)
    offsets = q_star - np.nan_to_num(last["agent_position"].values)
    third, fourth = (np.sqrt(part.var(axis=0).sum(axis=1)) for part in np.array_split(offsets, 4)[2:])
    half = offsets[len(offsets) // 2 :] - offsets[len(offsets) // 2 :].mean(axis=0)
    widest = np.take_along_axis(half, half.var(axis=0).argmax(axis=1)[None, :, None], axis=2)[..., 0]
    reversals = (np.diff(np.sign(widest), axis=0) != 0.0).sum(axis=0)
    span = 0.5 * float(last["time"][-1] - last["time"][0])
    shaken = system.largest_disturbance[: len(fourth)] * span / (np.pi * np.maximum(reversals, 1))
    driven = np.sqrt(q_star[-len(half) :].var(axis=0).sum(axis=1)) > _STILL * fourth
    driven |= fourth < _RESONANCE * shaken
    circling = np.flatnonzero((fourth > _FAR_BY) & (fourth > _UNDECAYED * third) & (reversals >= _REVERSALS) & ~driven)
    if len(circling):
        time = float(last["time"][-1])
        worst, name, who = _worst_of(system, circling, fourth)
        text = (
            f"{who} in a limit cycle: {name} oscillates by {fourth[worst]:.3g} m RMS to the end at "
            f"t = {time:.6g} s, and nothing drives it"
        )
        yield TrialProblem(kind="limit_cycle", text=text, agent=name, time=time, number=float(fourth[worst]))


def _fallen(system: System, last: "xr.Dataset") -> Iterator[TrialProblem]:
    """Yield the aircraft that is below the surface at the end of the last phase, and began above it."""
    height = system.bodies.surface_height
    heights = np.nan_to_num(last["agent_height"].values[-1], nan=height)
    flying = np.array([agent.dimension == 3 for agent in system.team.agents])
    flying &= system.initial[: len(flying), 2] > height
    fallen = np.where(flying & (system.bodies.surface != "none"), height - heights, 0.0)
    v = int(fallen.argmax())
    if fallen[v] > _FAR_BY:
        name, time = system.team.agent_ids[v], float(last["time"][-1])
        text = f"{name} is {fallen[v]:.3g} m below the surface at t = {time:.6g} s"
        yield TrialProblem(kind="fallen", text=text, agent=name, time=time, number=float(fallen[v]))


def _carried_targets(system: System, data: "xr.Dataset") -> Iterator[TrialProblem]:
    """Yield the fixed target that is carried farthest from its place."""
    N = len(system.team.agents)
    if system.waiting is None or not system.waiting.holds[N:].any():
        return
    places = np.nan_to_num(data["target_position"].values[-1])
    away = np.where(system.waiting.holds[N:], np.linalg.norm(places - system.waiting.position[N:], axis=1), 0.0)
    k = int(away.argmax())
    if away[k] > _FAR_BY:
        name, end = system.team.target_ids[k], float(data["time"][-1])
        text = f"{name} is fixed, and is {away[k]:.3g} m from its place at t = {end:.6g} s: its vehicle cannot hold it"
        yield TrialProblem(kind="target", text=text, agent=name, time=end, number=float(away[k]))


def _far_off(
    phases: Sequence[Phase], data: "xr.Dataset", error: float, foreseen: float | None
) -> Iterator[TrialProblem]:
    """Yield that the error is far beyond what the analysis foresees, in m, or that a law that is local rests elsewhere.

    A law with range or bearing edges rests where its disagreement is 0, which may be far from q*.
    """
    system, last = of_phase(phases, data, -1)
    limited = _limited(system, last)
    v = int(limited.argmax())
    time = float(last["time"][-1])
    size = f"the error is {error:.3g} m (RMS over agents, second half)"
    if foreseen is not None and error > _FAR * foreseen + _FAR_BY:
        text = f"{size}, and the analysis foresees {foreseen:.3g} m"
        name = None
        if limited[v] > _OFTEN:
            name = system.team.agent_ids[v]
            text += f": {name} is at a limit of its vehicle or its speed for {100.0 * limited[v]:.0f} % of that time"
        yield TrialProblem(kind="far_off", text=text, agent=name, time=time, number=error)
    elif not phases[-1].system.team.linear:
        quarter = slice(-max(1, last.sizes["time"] // 4), None)
        disagreement, away = (np.nanmean(last[name].values[quarter]) for name in ("disagreement", "tracking_error"))
        if away > _FAR_BY and disagreement < _AT_REST * away:
            text = f"the team rests {away:.3g} m from q* (mean over agents), in another equilibrium of the law"
            yield TrialProblem(kind="far_off", text=text, agent=None, time=time, number=float(away))


def _limited(system: System, data: "xr.Dataset") -> Array:
    """Return the fraction of the second half for which each agent is at a limit, shape (N,).

    That is: a thruster saturates, the command is at the velocity limit, or the vehicle, averaged over the second half,
    makes less of its commanded velocity than it should, as one whose tilt is limited.
    """
    half = slice(data.sizes["time"] // 2, None)
    command, velocity, flow, saturation = (
        np.nan_to_num(data[name].values[half])
        for name in ("velocity_command", "agent_velocity", "agent_flow", "agent_saturation")
    )
    limit = system.law.limit[: command.shape[1]]
    at_limit = (saturation > 0.0) | (np.linalg.norm(command, axis=2) >= _AT_LIMIT * limit)
    planar = np.isnan(data["velocity_command"].values[0, :, 2])
    made = velocity - flow
    made[:, planar, 2] = 0.0
    commanded = np.linalg.norm(command.mean(axis=0), axis=1)
    missing = np.linalg.norm((command - made).mean(axis=0), axis=1)
    short = (commanded > MIN_SPEED) & (missing > _SHORTFALL * commanded)
    return np.where(short, 1.0, at_limit.mean(axis=0))


def _are(name: str, others: int) -> str:
    """Return a name with the number of others and the verb, as a sentence about them begins."""
    return f"{name} and {others} other{'s' if others > 1 else ''} are" if others else f"{name} is"


def _worst_of(system: System, failed: IntArray, severity: Array) -> tuple[int, str, str]:
    """Return the number and id of the agent that fails worst, and the beginning of a sentence about all that fail."""
    worst = int(failed[int(severity[failed].argmax())])
    name = system.team.agent_ids[worst]
    return worst, name, _are(name, len(failed) - 1)
