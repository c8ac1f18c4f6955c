"""Trial of a mission: the scenario is run on bodies, without files, and its end is judged.

The analysis of `check` covers linear loops and bounds. The trial covers everything else in a run: limits of thrusters,
large angles, the safety filter, losses, gusts. It uses the fused engine, or MuJoCo if contacts are on, with the
scenario's seed. Its verdict is the same on every machine, because the part that is tried depends only on the number of
vehicle-steps.

If nothing else fails, further runs find causes. One without the safety filter, and one without velocity limits, decide
whether these hold up agents that are away. One on ideal kinematics decides whether vehicles that make too little of
their commands keep agents away, or the law does. One without noise, gusts, waves and disturbances decides whether these
drive an oscillation, or only hide a limit cycle.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from pydantic import Field

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.checking.loop.body_loop import ending_of_run
from mjsheaf.checking.separation import TooClose, too_close_in
from mjsheaf.errors import InputError, NotUniqueError, RankError, with_verb
from mjsheaf.loop.engine import samples_in_piece
from mjsheaf.loop.session import engine_of, prepare_run
from mjsheaf.loop.system import Phase, System
from mjsheaf.results.dataset import join, make_datasets, of_phase
from mjsheaf.results.ending import (
    MIN_DURATION,
    MIN_SPEED,
    ROUNDING,
    Stuck,
    find_stuck,
    is_unexplained,
    swing_at_end,
    undecayed_swing,
)
from mjsheaf.results.metrics import check_expectation, late_errors, safety_of, summarize, summarize_phases
from mjsheaf.scenario import Scenario
from mjsheaf.section import PER_AGENT_RMS, Finite, Norm, Record
from mjsheaf.vehicles.effects import authority_of

MAX_VEHICLE_STEPS = 100_000_000
"""Largest number of vehicles times physics steps of a trial; for a larger mission, only the beginning is tried."""

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
_OFTEN = 0.1  # largest fraction of the second half that a vehicle may spend at a limit
_FAR_BY = 1.0  # m: errors and motions that count
_NEARLY = 1.0 - 1e-9  # fraction of the velocity limit at which a command is at it
_DEPTH = 0.1  # m below the surface, at which an aircraft has fallen


class TrialProblem(Record):
    """A reason why a mission failed when it was tried."""

    kind: str = Field(
        description="refused, blow_up, diverging, saturated, deadlock, held_up, stuck, too_close, limit_cycle, target, "
        "fallen, far_off, or expectation"
    )
    text: str = Field(description="a sentence with agent, time and number")
    agent: str | None = Field(None, description="id of the agent with the worst value; null for the team")
    time: Finite = Field(None, description="time of the problem, s; null if it has none")
    number: Finite = Field(None, description="severity, m; null if only the text gives it")


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
        description="settled, not settled or diverging, as in summary.json; null: see `problems`"
    )
    problems: list[TrialProblem] = Field(description="why the mission failed, the most important first")


def try_mission(
    scenario: Scenario, foreseen: float | None = None, progress: Callable[[int, int], None] | None = None
) -> TrialRecord:
    """Run a scenario on bodies and judge the run.

    Args:
        scenario: The scenario.
        foreseen: Predicted tracking error, RMS over agents and the second half, m; None if unknown.
        progress: Called with the samples done and the number of samples.

    Raises:
        InputError: The scenario cannot be simulated for a reason that is not one of the theory's assumptions.
    """
    try:
        phases = prepare_run(scenario, "physics", "mujoco" if scenario.whole.bodies.contacts else "fused")
    except (NotUniqueError, RankError) as error:
        return _refused(error)
    try:
        run = _run(scenario, phases, progress)
    except InputError as error:  # of a registered term
        return _refused(error)
    data = run.data
    finished = data.attrs["status"] == "finished"
    late = late_errors(phases[0].system.team, data)["tracking_error"]
    stuck = [one for one in find_stuck(phases, data) if one.at_end] if finished else []
    problems = list(_problems(run, stuck))
    if finished and all(one.kind == "expectation" for one in problems):
        found = (list(rule(run)) for rule in (_held_up, _without_headway, _circling_in_calm))
        problems = [*next(filter(None, found), []), *problems]
    if finished and not problems and run.complete and late is not None:
        problems += _far_off(phases, data, late, foreseen)
    return TrialRecord(
        ok=not problems,
        seconds=float(data["time"][-1] - data["time"][0]),
        complete=run.complete,
        tracking_error=late,
        ending=ending_of_run(phases, data, stuck) if finished else None,
        problems=problems,
    )


def _refused(error: Exception) -> TrialRecord:
    """Return the record of a trial that an error ends."""
    return TrialRecord(
        ok=False,
        seconds=0.0,
        complete=False,
        tracking_error=None,
        ending=None,
        problems=[TrialProblem(kind="refused", text=f"the run is refused: {error}")],
    )


def _away(data: xr.Dataset, *, behind: float = 0.5, share: float = 0.1) -> Array:
    """Return the error above which each agent is away from its place, m, shape (N,).

    One that has come within half a metre, and within a tenth of its largest error, has done its way: it rests where its
    vehicle cannot follow the small commands that are left, as a boat that cannot go astern. The tenth is for small
    teams and for agents that never got under way, which are away however near they are.

    Args:
        data: The run.
        behind: Error above which an agent is away, m; that of agents that fall behind in `record._of_slow`.
        share: Fraction of its largest error, above which it is, too.
    """
    return np.minimum(behind, share * np.nan_to_num(data["tracking_error"].values).max(axis=0))


class _Run(NamedTuple):
    """A run in memory.

    Attributes:
        scenario: The scenario.
        phases: Its phases.
        progress: Called with the samples done and the number of samples.
        data: The variables that are judged, at samples that may be thinned.
        complete: True if the run reaches the end of the mission, or blew up before it.
        initial: Pairs that are too close at the first sample.
        closest: Pairs that are too close at some sample, each when it is closest.
    """

    scenario: Scenario
    phases: Sequence[Phase]
    progress: Callable[[int, int], None] | None
    data: xr.Dataset
    complete: bool
    initial: Mapping[tuple[str, ...], TooClose]
    closest: Mapping[tuple[str, ...], TooClose]

    def again(
        self, change: Callable[[System], System] = lambda system: system, backend: str = "physics"
    ) -> xr.Dataset | None:
        """Run it once more, with changed systems; return the data of the last phase, or None if the run fails."""
        phases = [replace(phase, system=change(phase.system)) for phase in self.phases]
        try:
            data = _run(self.scenario, phases, self.progress, backend).data
        except InputError:  # of a registered term
            return None
        return of_phase(phases, data, -1)[1] if data.attrs["status"] == "finished" else None


def _run(
    scenario: Scenario,
    phases: Sequence[Phase],
    progress: Callable[[int, int], None] | None,
    backend: str = "physics",
) -> _Run:
    """Run the part of a mission that fits."""
    system = phases[0].system
    end = system.grid.steps + 1
    parts: list[xr.Dataset] = []
    done = 0
    initial: dict[tuple[str, ...], TooClose] = {}
    closest: dict[tuple[str, ...], TooClose] = {}
    with engine_of(phases, backend) as engine:
        fitting = MAX_VEHICLE_STEPS // (len(system.team.members) * system.steps_per_sample)
        samples = min(end, max(fitting, 1) + 1)
        stride = -(-samples * len(system.team.agents) // _MAX_JUDGED)
        recorded = engine.record(min(samples_in_piece(system), samples))
        for piece in make_datasets(recorded, backend, scenario.seed, phases):
            part = piece.isel(time=slice(0, samples - done))
            if "separation" in part:
                initial = initial if done else too_close_in(system, part.isel(time=[0]))
                nearer = too_close_in(system, part)
                closest |= {p: w for p, w in nearer.items() if p not in closest or w.gap < closest[p].gap}
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
    complete = samples == end or data.attrs["status"] != "finished"
    return _Run(scenario, phases, progress, data, complete, initial, closest)


def _problems(
    run: _Run,
    resting: Sequence[Stuck],
    *,
    closer: float = 1.1,
    rounding: float = 1e-6,
) -> Iterator[TrialProblem]:
    """Yield why a run fails, the most important first.

    Args:
        run: The trial.
        resting: Agents that do not move at its end.
        closer: A pair fails if its shortfall in distance exceeds this times its shortfall at the start.
        rounding: Error of distances, m.
    """
    data, whole = run.data, run.phases[0].system
    team, end = whole.team, float(data["time"][-1])
    if data.attrs["status"] != "finished":
        yield TrialProblem(kind="blow_up", text=data.attrs["message"], time=end)
        return
    safety = safety_of(data)
    for pair, worst in sorted(run.closest.items(), key=lambda item: item[1].gap):
        start = run.initial[pair].gap if pair in run.initial else 0.0  # these vehicles may have to stop first
        if worst.gap < closer * start - rounding:
            who = " and ".join(pair)
            text = f"{who} come {-worst.gap:.3g} m closer than the required distance at t = {worst.time:.6g} s"
            yield TrialProblem(kind="too_close", text=text, agent=pair[0], time=worst.time, number=-worst.gap)
            break
    off = np.nan_to_num(data["tracking_error"].values[-1])
    deadlocked = np.isin(team.agent_ids, safety["deadlocked"] if safety else [])
    words = "deadlocked: the safety filter keeps {name} {number:.3g} m off at t = {time:.6g} s"
    yield from _failing("deadlock", team.agent_ids, deadlocked, off, end, words)
    least = _away(data)
    stuck = [one for one in resting if one.error > least[one.agent]]
    if stuck:
        first = team.agent_ids[stuck[0].agent]
        text = (
            f"{with_verb(first, len(stuck) - 1)} stuck: {first} does not move from t = {stuck[0].start:.6g} s to the "
            f"end, {stuck[0].error:.3g} m off: {stuck[0].reason}"
        )
        yield TrialProblem(kind="stuck", text=text, agent=first, time=stuck[0].start, number=stuck[0].error)
    system, last = of_phase(run.phases, data, -1)
    yield from _diverging(system, last, _away(data.sel(agent=last["agent"]), behind=_FAR_BY))
    yield from _circling(system, last, _in_limit_cycle(system, last, _FAR_BY))
    if whole.waiting is not None:
        N = len(team.agents)
        places = np.nan_to_num(data["target_position"].values[-1])
        away = np.where(whole.waiting.holds[N:], np.linalg.norm(places - whole.waiting.position[N:], axis=1), 0.0)
        words = "fixed, and carried off: {name} is {number:.3g} m from its place, which its vehicle cannot hold"
        yield from _failing("target", team.target_ids, away > _FAR_BY, away, end, words)
    depth = np.nan_to_num(system.bodies.surface_height - data["agent_height"].values)
    N = depth.shape[1]
    flying = ~whole.planar[:N] & (whole.initial[:N, 2] > system.bodies.surface_height)
    present = np.isfinite(data["tracking_error"].values)  # one that is lost falls
    depth = np.where(flying & present & (system.bodies.surface != "none"), depth, 0.0)
    deepest = depth.max(axis=0)
    since = float(data["time"][int((depth[:, deepest.argmax()] > _DEPTH).argmax())])
    words = "below the surface, from t = {time:.6g} s on: {name} by up to {number:.3g} m"
    yield from _failing("fallen", team.agent_ids, deepest > _DEPTH, deepest, since, words)
    if run.complete and run.scenario.expect.controller is None:
        final, own = summarize(team, data), summarize_phases(team, data)
        for check in check_expectation(run.scenario.expect, "physics", "finished", final, own, safety)["checks"]:
            if not check["met"] and check["measure"] != "refused":
                value = "none" if check["found"] is None else f"{check['found']:.4g} m"
                text = f"expect.physics.{check['measure']} is {value} at t = {end:.6g} s, bound {check['bound']:g} m"
                yield TrialProblem(kind="expectation", text=text, time=end, number=check["found"])


def _failing(
    kind: str, ids: Sequence[str], failed: BoolArray, severity: Array, time: float, words: str, **numbers: Array
) -> Iterator[TrialProblem]:
    """Yield one problem for all agents that fail, or nothing.

    Args:
        kind: Kind of the problem.
        ids: Ids of the agents, length N.
        failed: True for those that fail, shape (N,).
        severity: Sizes of the problem, m, shape (N,); the text describes the agent with the largest one.
        time: Time of the problem, s.
        words: Text after "A is" and "A and 2 others are", with `{name}`, `{number}`, `{time}` and the other numbers.
        numbers: Other numbers of each agent, shape (N,).
    """
    if failed.any():
        worst = int(np.where(failed, severity, -np.inf).argmax())
        others = {key: values[worst] for key, values in numbers.items()}
        number = float(severity[worst])
        told = words.format(name=ids[worst], number=number, time=time, **others)
        yield TrialProblem(
            kind=kind,
            text=f"{with_verb(ids[worst], int(failed.sum()) - 1)} {told}",
            agent=ids[worst],
            time=time,
            number=number,
        )


def _diverging(
    system: System,
    last: xr.Dataset,
    far: Array,
    *,
    growth: float = 1.5,
    faster: float = 2.0,
    speeds_up: float = 1.1,
    slow: float = 1.1,
    steady: float = 0.9,
    small: float = 0.2,
) -> Iterator[TrialProblem]:
    """Yield agents whose error grows to the end of the last phase while they are at a limit, or at a growing rate.

    An error that grows is no fault by itself: it also grows behind a target that accelerates. Growth that an event
    ends, such as the end of a radio shadow, is not counted either.

    Args:
        system: System of the last phase.
        last: Its data.
        far: Mean errors of the last quarter up to which growth at a limit does not count, m, shape (N,).
        growth: Mean error of the last quarter over that about half-way, above which it has grown.
        faster: Growth of one quarter over that of the last, above which the error grows without bound.
        speeds_up: Mean speed of q* in the last quarter over that of the third, above which a target speeds up.
        slow: Mean error of the last quarter over that of the second, above which steady growth counts.
        steady: Growth of one quarter over that of the last; growth that slows down by more is a transient.
        small: Errors that grow by less do not count, m.
    """
    errors = last["tracking_error"].values
    time = last["time"].values
    q_star = np.nan_to_num(last["harmonic_extension"].values)
    if len(errors) < _MIN_SAMPLES or time[-1] - time[0] < MIN_DURATION:
        return
    _, second, third, fourth = _of_quarters(last)
    eighth = len(errors) // 8
    middle = errors[len(errors) // 2 - eighth : len(errors) // 2 + eighth + 1].mean(axis=0)
    limited = _limited(system, last)
    rises = (third > second) & (fourth - third > steady * (third - second)) & (fourth > slow * second + small)
    grown = (fourth > growth * middle + small) | rises
    runs_away = (third > second) & (fourth - third > faster * (third - second)) & (fourth > growth * middle + _FAR_BY)
    speeds = [np.linalg.norm(np.diff(q, axis=0), axis=2).mean(axis=0) for q in np.array_split(q_star, 4)]
    runs_away &= speeds[3] <= speeds_up * speeds[2]  # else the error follows the target
    at_limit = limited > _OFTEN
    failed = at_limit & grown & (fourth > far) | runs_away
    words = (
        "left behind: the mean error of {name} grows from {middle:.3g} m about the middle to {number:.3g} m in the "
        "last quarter, up to t = {time:.6g} s"
    )
    kind = "diverging"
    if failed.any() and at_limit[np.where(failed, fourth, -np.inf).argmax()]:
        kind = "saturated"
        words += ", at a limit of its vehicle or its speed for {limited:.0f} % of the second half"
    yield from _failing(
        kind, system.team.agent_ids, failed, fourth, float(time[-1]), words, middle=middle, limited=100.0 * limited
    )


def _held_up(
    run: _Run,
    *,
    least: float = 0.1,
    share: float = 0.2,
    mostly: float = 0.5,
    far_at_limit: float = 3.0,
    level: float = 0.995,
    far_filtered: float = 1.5,
) -> Iterator[TrialProblem]:
    """Yield agents that the safety filter or a velocity limit holds up, away from their places, without an approach.

    That a filter acts, or a command is at its limit, does not hold an agent up by itself. One more run, without it,
    shows how far off the agent is then.

    Args:
        run: The trial.
        least: Mean change of commands in the last quarter, up to which the filter does not hold an agent up, m/s.
        share: That change over the mean speed that is left of the commands, without the part against wind, up to which
            it does not, either.
        mostly: Fraction of the last quarter at the velocity limit, up to which the limit does not hold an agent up.
        far_at_limit: Mean error in the last quarter up to which a velocity limit does not count, m.
        level: That error over the mean one of the quarter before, up to which a limit does not count, either.
        far_filtered: Mean error in the last quarter up to which the filter does not count, m.
    """
    system, last = of_phase(run.phases, run.data, -1)
    if last.sizes["time"] < _MIN_SAMPLES or last["time"][-1] - last["time"][0] < 4.0 * MIN_DURATION:
        return
    quarters = _of_quarters(last)
    _, _, third, off = quarters
    end = last.isel(time=slice(-(last.sizes["time"] // 4), None))
    speed = np.linalg.norm(np.nan_to_num(end["velocity_command"].values), axis=2)
    limited = (speed >= _NEARLY * system.law.limit[: speed.shape[1]]).mean(axis=0) > mostly
    causes: dict[str, tuple[BoolArray, dict[str, Any]]] = {}
    limited &= off > np.maximum(far_at_limit, level * third)
    causes["velocity limits"] = limited, {"unlimited": True}
    if "safety_correction" in end:
        changed = end["safety_correction"].mean("time").values
        acts = changed > np.maximum(least, share * np.linalg.norm(_by_second(system, end)[0], axis=2).mean(axis=0))
        causes["the safety filter"] = acts & (off > far_filtered), {"safety": None}
    for cause, (held, without) in causes.items():
        held &= ~_are_approaching(quarters)
        if not held.any():
            continue
        words = "held up: {name} is {number:.3g} m off in the last quarter, up to t = {time:.6g} s, "
        other = run.again(partial(replace, **without))
        if other is not None:
            left = _of_quarters(other)[3]
            words += f"and {{left:.3g}} m without {cause}"
        elif "unlimited" in without:  # the limit may be what keeps the loop within bounds
            continue
        else:
            left = np.zeros(len(off))
            words += f"and the run fails without {cause}"
        held &= _is_nearer(left, off)
        yield from _failing("held_up", system.team.agent_ids, held, off, float(last["time"][-1]), words, left=left)


def _is_nearer(left: Array, off: Array) -> BoolArray:
    """Return which mean errors are smaller in another run: by 15 %, and by a metre or half (the smaller), (N,)."""
    return off - left > np.maximum(0.15 * off, np.minimum(_FAR_BY, 0.5 * off))


def _without_headway(
    run: _Run,
    *,
    least: float = 0.1,
    off_lacking: float = 1.5,
    off_idle: float = 2.0,
    headway: float = 0.2,
    steadiness: float = 0.5,
    share: float = 0.75,
    off: float = 2.8,
    nearer: float = 0.98,
    much: float = 1.5,
) -> Iterator[TrialProblem]:
    """Yield agents that move in another direction than commanded, or too little, and do not approach their places.

    Examples are boats that circle about their places, and drones whose commands jump faster than they can lean. One
    more run, on ideal kinematics, shows how far off the law itself leaves them; it excuses no one that makes next to
    nothing of a steady command.

    Args:
        run: The trial.
        least: Commanded speed below which an agent counts as commanded to stay, m/s.
        off_lacking: Mean error in the last quarter above which too little headway counts for a vehicle that lacks
            directions and has a steady command, m.
        off_idle: The same for any other, m.
        headway: Least fraction of the commanded speed that an agent must reach in its direction.
        steadiness: Size of the mean command over the mean size of commands, above which these are steady.
        share: Least fraction of its commanded velocity that an agent must reach, if it is away.
        off: Mean error in the last quarter above which it is, m.
        nearer: That error over the mean one of the quarter before, up to which an agent approaches its place.
        much: The ideal error over that on bodies, above which the law itself fails, which excuses no one.
    """
    system, last = of_phase(run.phases, run.data, -1)
    if last.sizes["time"] < _MIN_SAMPLES or last["time"][-1] - last["time"][0] < 4.0 * MIN_DURATION:
        return
    quarters = _of_quarters(last)
    third, fourth = quarters[2:]
    end = last.isel(time=slice(-(last.sizes["time"] // 4), None))
    command, made = _by_second(system, end)
    size, along = np.linalg.norm(command, axis=2), (made * command).sum(axis=2)
    commanded, towards = size.mean(axis=0), (along / np.where(size > 0.0, size, 1.0)).mean(axis=0)
    idle = (towards < headway * commanded) & (fourth > off_lacking) & ~_are_approaching(quarters)
    steady = np.linalg.norm(command.mean(axis=0), axis=1) > steadiness * commanded
    for i in np.flatnonzero(idle & (fourth <= off_idle)).tolist():
        idle[i] = steady[i] and bool(authority_of(system.vehicles[i]).lacking)
    part = along.sum(axis=0) / np.maximum((size**2).sum(axis=0), ROUNDING)
    short = (part < share) & (fourth > off) & (fourth > nearer * third)
    failed = (commanded > least) & (idle | short)
    if not failed.any():
        return
    words = (
        "without headway: {name} is commanded {commanded:.3g} m/s and makes {towards:.3g} m/s of it, {number:.3g} m "
        "off to the end at t = {time:.6g} s"
    )
    numbers = {"commanded": commanded, "towards": towards}
    ideal = run.again(backend="ideal")
    if ideal is None:
        words += "; on ideal kinematics the run fails"
    else:
        left = numbers["left"] = _of_quarters(ideal)[3]
        failed &= idle & steady | _is_nearer(left, fourth) | (left > much * fourth)
        words += "; on ideal kinematics it is {left:.3g} m off"
    yield from _failing("stuck", system.team.agent_ids, failed, fourth, float(last["time"][-1]), words, **numbers)


def _of_quarters(last: xr.Dataset) -> Array:
    """Return the mean errors over the quarters of a phase, m, shape (4, N); NaN for agents that are absent."""
    errors = last["tracking_error"]
    return np.array([errors.isel(time=part).mean("time") for part in np.array_split(np.arange(len(errors)), 4)])


def _are_approaching(quarters: Array, *, falls: float = 0.5**0.25, before: float = 0.98) -> BoolArray:
    """Return which agents are on their first way to their places, shape (N,).

    Their mean error falls from each quarter of the phase to the next, and so fast at the end that less than half of it
    is left after another run. That of an agent that circles may fall too, but not in every quarter.

    Args:
        quarters: Mean errors, m, shape (4, N); of agents that are absent, or of fewer samples than quarters, NaN.
        falls: Mean error of the last quarter over that of the third, below which it falls so fast.
        before: The same ratio of the quarters before, below which it falls.
    """
    first, second, third, fourth = quarters
    return (second < before * first) & (third < before * second) & (fourth < falls * third)


def _by_second(system: System, data: xr.Dataset) -> tuple[Array, Array]:
    """Return commanded velocities, and velocities through the medium, shape (T, N, 3), m/s.

    Both are means over a second: commands jump with noise and losses, and velocities follow them later. The part of a
    command that holds an agent against the wind on its hull is left out.

    Args:
        system: System of the run.
        data: A part of the run.
    """
    seconds = max(1, int(float(data["time"][-1] - data["time"][0])))
    blocks = np.array_split(np.arange(data.sizes["time"]), min(seconds, data.sizes["time"]))
    level = np.isnan(data["velocity_command"].values)  # of vehicles in the plane
    through = np.where(level, 0.0, data["agent_velocity"] - data["agent_flow"])
    command, made = (
        np.concatenate([np.broadcast_to(values[block].mean(axis=0), values[block].shape) for block in blocks])
        for values in (np.nan_to_num(data["velocity_command"].values), np.nan_to_num(through))
    )
    return command + np.nan_to_num(system.drift_in_wind(-made.mean(axis=0))), made


def _offsets(last: xr.Dataset) -> Array:
    """Return the offset of each agent from q*, as a team of one, shape (N, T, 1, 3), m."""
    return np.moveaxis(np.nan_to_num((last["harmonic_extension"] - last["agent_position"]).values), 1, 0)[:, :, None]


def _in_limit_cycle(system: System, last: xr.Dataset, *limits: float) -> BoolArray:
    """Return which agents oscillate to the end of a phase, and nothing explains it; limits of `undecayed_swing`."""
    time, q_star = last["time"].values, np.nan_to_num(last["harmonic_extension"].values)
    return np.array(
        [
            undecayed_swing(own, *limits) is not None and is_unexplained(system, time, q_star, own)
            for own in _offsets(last)
        ]
    )


def _circling(
    system: System,
    last: xr.Dataset,
    failed: BoolArray,
    why: str = "neither the motion of q* nor noise nor the medium explains it",
    **numbers: Array,
) -> Iterator[TrialProblem]:
    """Yield the agents of `failed`, which are in a limit cycle, with the end of the sentence and its numbers."""
    swing = np.array([swing_at_end(own) for own in _offsets(last)])
    words = "in a limit cycle: {name} oscillates by {number:.3g} m RMS to the end at t = {time:.6g} s, and " + why
    yield from _failing("limit_cycle", system.team.agent_ids, failed, swing, float(last["time"][-1]), words, **numbers)


def _circling_in_calm(
    run: _Run,
    *,
    least: float = 1.5,
) -> Iterator[TrialProblem]:
    """Yield agents in a limit cycle that noise or the medium could explain, if it is there without these.

    Args:
        run: The trial.
        least: Oscillations of the run that count, m RMS.
    """
    system, last = of_phase(run.phases, run.data, -1)
    calm = _calm(system)
    failed = _in_limit_cycle(calm, last, least, 0.0)  # a swing in noise may decay by chance
    other = run.again(_calm) if failed.any() else None
    if other is not None:
        failed &= _in_limit_cycle(calm, other, _FAR_BY)
        why = "by {calmly:.3g} m without noise, gusts, waves and disturbances"
        yield from _circling(system, last, failed, why, calmly=np.array([swing_at_end(own) for own in _offsets(other)]))


def _calm(system: System) -> System:
    """Return a system without noise of links and odometry, gusts, waves and disturbances; all else stays."""
    law, table = system.law, system.law.links.table.copy()
    for name in ("noise", "range_noise", "bearing_noise"):
        table[name] = 0.0
    law = law._replace(links=law.links._replace(table=table), terms=law.terms._replace(noise=0.0))
    flows = [flow.model_copy(update={"gusts": None, "waves": None}) for flow in system.flows]
    return replace(system, law=law, flows=flows, harmonics=np.zeros_like(system.harmonics))


def _far_off(
    phases: Sequence[Phase],
    data: xr.Dataset,
    error: float,
    foreseen: float | None,
    *,
    far: float = 3.0,
    at_rest: float = 1e-3,
) -> Iterator[TrialProblem]:
    """Yield the problem of an error far above the predicted one, or of a law that comes to rest far from q*.

    Agents on their first way to q* are not counted in the former: the prediction has no limits of thrust and turning,
    which draw it out. A law with range or bearing edges comes to rest where its disagreement is 0, which may be far
    from q*.

    Args:
        phases: Phases of the run.
        data: The run.
        error: Its tracking error, m.
        foreseen: Predicted error, m; None if it is not known.
        far: Ratio of the error to the predicted one, above which it is a problem.
        at_rest: Mean disagreement over mean tracking error, below which a law is at rest.
    """
    system, last = of_phase(phases, data, -1)
    end = float(data["time"][-1])
    errors = last["tracking_error"]
    count = last.sizes["time"]
    approaching = _are_approaching(_of_quarters(last))
    half = np.where(approaching, 0.0, errors.values[count // 2 :])
    counted = float(np.sqrt(np.nanmean(np.square(half))))
    if foreseen is not None and counted > far * foreseen + _FAR_BY:
        limited = np.where(approaching, 0.0, _limited(system, last))
        v = int(limited.argmax())
        name = system.team.agent_ids[v] if limited[v] > _OFTEN else None
        share = f": {name} is at a limit of its vehicle or its speed for {100.0 * limited[v]:.0f} % of that time"
        text = f"the error is {error:.3g} m (RMS over agents, second half), and the analysis foresees {foreseen:.3g} m"
        if approaching.any():
            text += f"; agents on their first way to q* aside, it is {counted:.3g} m"
        yield TrialProblem(kind="far_off", text=text + (share if name else ""), agent=name, time=end, number=error)
    elif not phases[-1].system.team.linear:
        disagreement, away = (
            np.nanmean(last[name].values[-max(1, count // 4) :]) for name in ("disagreement", "tracking_error")
        )
        if away > _FAR_BY and disagreement < at_rest * away:
            text = f"the team rests {away:.3g} m from q* (mean over agents), in another equilibrium of the law"
            yield TrialProblem(kind="far_off", text=text, time=end, number=float(away))


def _limited(
    system: System,
    data: xr.Dataset,
    *,
    unmade: float = 0.03,
    shortfall: float = 0.2,
) -> Array:
    """Return the fraction of the second half for which each agent is at a limit, shape (N,).

    At a limit, the command is at the velocity limit, or a thruster saturates while the vehicle makes less than the
    command: one that makes it lacks nothing, and its error is the law's. The margin is small, since a command grows
    slowly behind a place that moves a little faster than the vehicle, and means over a second have little noise. An
    agent is at a limit throughout if its mean velocity over the second half is too small for the commands, as for a
    vehicle whose tilt is limited: these follow their commands less closely.

    Args:
        system: System of the run.
        data: The run.
        unmade: Missing fraction of the commanded velocity, above which a saturated thruster limits a vehicle.
        shortfall: The same fraction for a vehicle whose thrusters do not saturate.
    """
    half = data.isel(time=slice(data.sizes["time"] // 2, None))
    command, made = _by_second(system, half)
    asked = np.nan_to_num(half["velocity_command"].values)
    saturated = np.nan_to_num(half["agent_saturation"].values) > 0.0
    at_limit = saturated & ((made * command).sum(axis=2) < (1.0 - unmade) * (command**2).sum(axis=2))
    at_limit |= np.linalg.norm(asked, axis=2) >= _NEARLY * system.law.limit[: asked.shape[1]]
    commanded = np.linalg.norm(asked.mean(axis=0), axis=1)
    missing = (command - made).mean(axis=0)
    short = (commanded > MIN_SPEED) & (np.linalg.norm(missing, axis=1) > shortfall * commanded)
    return np.where(short, 1.0, at_limit.mean(axis=0))
