"""Diagnose a run: notes for the terminal and summary.json, and warnings about the law's terms.

    bound         a theoretical bound is exceeded
    shape         a formation ends as its mirror image, on a line, or reflected in a point
    diverging     the team's error grows to the end
    slip          a value in the files looks like a mistake, such as a static target in a flow (see `slips`)
    medium        flow and disturbance are faster than a vehicle can move
    saturated     thrusters at a limit for more than a tenth of the time
    limited       commands at the velocity limit for more than a tenth of the time
    stuck         an agent does not move for 5 s although it is commanded to (see `results.ending`)
    terms         with terms of the law, commands jump, or are at velocity limits, or thrusters saturate
    changing      the team's error has not converged at the end; approaching: it still falls
    close         vehicles closer than their size while contacts are off
    submerged     an aircraft under water or in the ground

Notes are in this order, the most important first. There is one per kind, about the vehicle with the worst value.

A smooth command has almost no second difference from sample to sample. White noise of deviation s has a second
difference of sqrt(6) s. This measures the jump of a run, as RMS over agents and the second half of the run. Commands
are recorded after limiting, so jumps that a limit cuts off are larger than they appear.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from scipy.spatial import cKDTree

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.checking.theorem.of_run import HeldBound, RunBound
from mjsheaf.errors import joined
from mjsheaf.results.dataset import of_phase
from mjsheaf.results.ending import Stuck, find_stuck
from mjsheaf.results.netcdf import pieces_of
from mjsheaf.runs.reflections import describe_reflections
from mjsheaf.system import Phase, System

if TYPE_CHECKING:
    import xarray as xr

Kind = Literal[
    "bound",
    "shape",
    "diverging",
    "slip",
    "medium",
    "saturated",
    "limited",
    "stuck",
    "terms",
    "changing",
    "approaching",
    "close",
    "submerged",
]
"""Kinds of notes, the most important first."""

MAX_LIMITED_FRACTION = 0.1
"""Fraction of the time for which thrusters or commands may be at a limit."""
MAX_GUST_FRACTION = 0.01
"""Fraction of the time for which a medium may be too fast."""

_DIVING = "submersible"  # the vehicle that belongs under water
_AT_LIMIT = 1.0 - 1e-9  # of the velocity limit
EXHAUSTIVE_LIMIT = 100
"""Number of vehicles up to which all pairs are compared at all samples."""
MAX_JUMP = 0.1
"""Jump of the command, as a fraction of the RMS commanded speed, above which a warning is given."""
MIN_JUMP = 1e-6
"""Jump of the command that counts as rounding, m/s."""
MAX_SHARE = 0.2
"""Fraction of time and agents at the velocity limit, or of time and thrusters at a limit, in a healthy run."""
MIN_SAMPLES = 8
"""Minimum number of samples for an examination of terms."""


@dataclass(frozen=True)
class Note:
    """A diagnostic of a run.

    Attributes:
        kind: Kind of diagnostic.
        text: Sentence about it.
        agent: Id of the agent or target with the worst value; None for the team.
        time: Time of the worst value, or of the start, s; None if there is no such time.
        number: Severity: a fraction of time, m, m/s, or a ratio to a bound, as the text says.
    """

    kind: Kind
    text: str
    agent: str | None = None
    time: float | None = None
    number: float | None = None

    def record(self) -> dict[str, Any]:
        """Return the entry of summary.json."""
        return asdict(self)


@dataclass(frozen=True)
class TermsInRun:
    """Behaviour of a law's terms over the second half of a run.

    Attributes:
        on: Names of the terms.
        jump: Deviation of the white noise whose command jumps as much from sample to sample, RMS, m/s.
        commanded: Commanded speed, RMS over the whole run, m/s.
        at_limit: Fraction of samples and agents at the velocity limit.
        saturated: Fraction of time and agents' thrusters at a limit; None on ideal kinematics.
        warnings: Sentences with the fault and what may help; empty in a healthy run.
    """

    on: tuple[str, ...]
    jump: float
    commanded: float
    at_limit: float
    saturated: float | None
    warnings: tuple[str, ...] = ()

    def record(self) -> dict[str, Any]:
        """Return the entry of summary.json."""
        return {
            "on": list(self.on),
            "jump_m_s": self.jump,
            "commanded_m_s": self.commanded,
            "share_at_limit": self.at_limit,
            "share_saturated": self.saturated,
            "harm": list(self.warnings),
        }


def notes_of_run(
    phases: Sequence[Phase],
    dataset: "xr.Dataset",
    ending: str | None,
    bounds: Sequence[RunBound | HeldBound],
    terms: TermsInRun | None,
    slips: Sequence[str] = (),
) -> list[Note]:
    """Collect the notes on a run, the most important first; the run is read in pieces.

    Args:
        phases: Phases of the run.
        dataset: Result of `simulate`.
        ending: Ending of the run; see `results.ending`.
        bounds: Bounds of its phases.
        terms: Behaviour of its terms, or None.
        slips: Sentences of `slips_of` about its files.
    """
    stuck = find_stuck(phases, dataset)
    found = [
        *(Note("slip", sentence) for sentence in slips),
        *(Note("bound", bound.violation(), None, bound.worst, bound.ratio) for bound in bounds if bound.violation()),
        *(Note("terms", sentence) for sentence in (terms.warnings if terms else ())),
        *(Note("shape", sentence) for sentence in describe_reflections(phases[-1].system.team, dataset)),
        *(_about_the_end(dataset, ending) if not any(one.end >= dataset["time"].values[-1] for one in stuck) else ()),
        *_about_stuck(phases[0].system, stuck),
        *_about_limits(phases, dataset, [one.agent for one in stuck]),
        *_about_the_surface(phases, dataset),
    ]
    if dataset.attrs["backend"] == "physics" and not phases[0].system.bodies.contacts:
        found += _about_distances(phases[0].system, dataset)
    kinds = get_args(Kind)
    return sorted(found, key=lambda note: kinds.index(note.kind))


def _about_the_end(dataset: "xr.Dataset", ending: str | None) -> list[Note]:
    """Report an error that still changes or grows."""
    if ending in (None, "settled"):
        return []
    time = dataset["time"].values
    quarter = max(1, len(time) // 4)
    squares = dataset["tracking_error"][-2 * quarter :].values ** 2
    before, last = (np.sqrt(np.nanmean(part)) for part in (squares[:-quarter], squares[-quarter:]))
    size = f"tracking error (RMS over agents) {last:.3g} m in the last quarter, {before:.3g} m in the one before"
    kind: Kind = "approaching" if last < before else "changing"
    what = "is still approaching" if last < before else "has not converged"
    text = f"the team {what} at the end of the run: {size}; a later time.end shows its final error"
    if ending == "diverging":
        kind = "diverging"
        text = f"the team does not converge: its error diverges ({size}); see mjsheaf check"
    return [Note(kind, text, None, float(time[-1]), float(last))]


def _about_stuck(system: System, stuck: Sequence[Stuck]) -> list[Note]:
    """Report agents that do not move although they are commanded to."""
    if not stuck:
        return []
    first = stuck[0]
    name = system.team.agents[first.agent].id
    verb = "is" if len(stuck) == 1 else "are"
    text = (
        f"{_and_others(name, len(stuck) - 1)} {verb} stuck: commanded to move at {first.asked:.3g} m/s from "
        f"t = {first.start:.6g} s to {first.end:.6g} s, {name} does not move ({first.error:.3g} m off): {first.reason}"
    )
    return [Note("stuck", text, name, first.start, first.error)]


@dataclass(frozen=True)
class _Limits:
    """Time that agents spend at their limits, and in a medium that is too fast for them.

    Attributes:
        saturated: Fraction of the time with a thruster at a limit, shape (N,).
        limited: Fraction of the time at the velocity limit, shape (N,).
        exceeded: Fraction of the time in a medium that is too fast, shape (N,).
        excess: Largest ratio of the medium's speed to the agent's, 0 if it is never above 1, shape (N,).
        medium: Speed of the medium at that sample, shape (N,), m/s.
        possible: Possible speed of the agent at that sample, shape (N,), m/s.
        time: Time of that sample, shape (N,), s.
    """

    saturated: Array
    limited: Array
    exceeded: Array
    excess: Array
    medium: Array
    possible: Array
    time: Array


def _measure_limits(phases: Sequence[Phase], dataset: "xr.Dataset", own_speed: Array) -> _Limits:
    """Measure the limits of a run; `own_speed` is the speed of each agent's vehicle, shape (N,), m/s."""
    bodies = dataset.attrs["backend"] == "physics"
    by_law = not dataset.attrs.get("controller")
    names = ["agent_flow", *["velocity_command"] * by_law, *["agent_saturation"] * bodies]
    agents = np.arange(len(own_speed))
    present, saturated, limited, exceeded, excess, medium, possible, time = np.zeros((8, len(agents)))
    done = 0
    for chunk in pieces_of(dataset, names):
        there, limit = _conditions(phases, done, chunk.sizes["time"])
        done += chunk.sizes["time"]
        present += there.sum(axis=0)
        if bodies:
            saturated += ((chunk["agent_saturation"].values > 0.0) & there).sum(axis=0)
        if by_law:
            commanded = np.linalg.norm(np.nan_to_num(chunk["velocity_command"].values), axis=2)
            limited += ((commanded >= _AT_LIMIT * limit) & (limit > 0.0) & there).sum(axis=0)
        flow = np.where(there, np.linalg.norm(np.nan_to_num(chunk["agent_flow"].values), axis=2), 0.0)
        able = np.minimum(limit, own_speed)
        ratio = np.divide(flow, able, out=np.zeros_like(flow), where=(flow > able) & (able > 0.0))
        exceeded += (ratio > 0.0).sum(axis=0)
        worst = ratio.argmax(axis=0)
        found = np.stack([values[worst, agents] for values in (ratio, flow, able)] + [chunk["time"].values[worst]])
        excess, medium, possible, time = np.where(found[0] > excess, found, [excess, medium, possible, time])
    count = np.maximum(present, 1)
    return _Limits(saturated / count, limited / count, exceeded / count, excess, medium, possible, time)


def _about_limits(phases: Sequence[Phase], dataset: "xr.Dataset", stuck: Sequence[int]) -> list[Note]:
    """Report agents whose thrusters or commands are at their limits, or whose medium is too fast for them.

    Agents that are stuck have a note of their own.
    """
    system = phases[0].system
    ids = [agent.id for agent in system.team.agents]
    own_speed = _own_speed(system, dataset.attrs["backend"] == "physics")
    limits = _measure_limits(phases, dataset, own_speed)
    limits.saturated[stuck] = 0.0
    limits.limited[stuck] = 0.0
    notes = []
    for v, names in _worst(limits.saturated, MAX_LIMITED_FRACTION, ids):
        fraction = float(limits.saturated[v])
        text = f"thrusters of {names} are at a limit for {100 * fraction:.0f} % of the time"
        notes.append(Note("saturated", text, ids[v], None, fraction))
    for v, names in _worst(limits.limited, MAX_LIMITED_FRACTION, ids):
        fraction = float(limits.limited[v])
        text = f"the law commands {names} at or above the velocity limit for {100 * fraction:.0f} % of the time"
        notes.append(Note("limited", f"{text}; raise velocity_limit, or lower the gain", ids[v], None, fraction))
    for v, names in _worst(np.where(limits.exceeded > MAX_GUST_FRACTION, limits.excess, 0.0), 0.0, ids):
        speed = float(limits.medium[v])
        time = float(limits.time[v])
        what = "its vehicle reaches" if limits.possible[v] == own_speed[v] else "its velocity limit allows"
        text = (
            f"the medium is faster than {names} can move: {speed:.3g} m/s around {ids[v]} at t = {time:.6g} s, "
            f"where {what} {limits.possible[v]:.3g} m/s in its slowest direction"
        )
        notes.append(Note("medium", text, ids[v], time, speed))
    return notes


def _worst(badness: Array, limit: float, ids: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Yield the number of the worst agent, and a name for all agents above a limit, if there are any."""
    above = int((badness > limit).sum())
    if above:
        v = int(badness.argmax())
        yield v, _and_others(ids[v], above - 1)


def _own_speed(system: System, bodies: bool) -> Array:
    """Compute the speed of each agent's vehicle in its slowest direction, shape (N,), m/s; infinite without limits."""
    from mjsheaf.vehicles.effects import capability_of, of_each

    if not bodies:
        return np.full(len(system.team.agents), np.inf)
    return of_each(system.vehicles[: len(system.team.agents)], lambda vehicle: capability_of(vehicle).least_speed)


def _conditions(phases: Sequence[Phase], first: int, count: int) -> tuple[BoolArray, Array]:
    """Return which agents are present at `count` samples from `first` on, and their speed limits, (T, N), m/s."""
    there = [phase.system.team.present for phase in phases]
    limit = [phase.system.law.limit[: len(phase.system.team.agents)] for phase in phases]
    return _by_phase(there, phases, first, count), _by_phase(limit, phases, first, count)


def _by_phase(values: Sequence[Any], phases: Sequence[Phase], first: int, count: int) -> Any:
    """Return the value of the phase of each of `count` samples from `first` on."""
    samples = np.arange(first, first + count)
    return np.array(values)[np.searchsorted([phase.start for phase in phases], samples, side="right") - 1]


def _about_the_surface(phases: Sequence[Phase], dataset: "xr.Dataset") -> list[Note]:
    """Report aircraft that go below the surface of the scene.

    Lost aircraft rest on it. Submersibles, and targets that start below it, are meant to be there.
    """
    system = phases[0].system
    members = system.team.members
    N = len(system.team.agents)
    flying = np.array([member.dimension == 3 for member in members])
    flying[N:] &= system.initial[N:, 2] >= system.bodies.surface_height
    flying &= np.array([name != _DIVING for name in system.bodies.vehicle])
    if system.bodies.surface == "none" or not flying.any():
        return []
    first, depth = _submersion(phases, dataset, flying)
    under = int(np.isfinite(first).sum())
    if not under:
        return []
    v = int(depth.argmax())
    name = members[v].id
    where = "under water" if system.bodies.surface == "water" else "in the ground"
    what = "an aircraft" if v < N else "a target in space"
    verb = "goes" if under == 1 else "go"
    text = (
        f"{_and_others(name, under - 1)} {verb} {where}: {name}, {what}, is below the surface from "
        f"t = {first[v]:.6g} s on, by up to {depth[v]:.3g} m; the surface does not stop vehicles in space"
    )
    return [Note("submerged", text, name, float(first[v]), float(depth[v]))]


def _submersion(phases: Sequence[Phase], dataset: "xr.Dataset", flying: BoolArray) -> tuple[Array, Array]:
    """Return when flying vehicles are first below the surface, s, infinite if never, and how deep, m; shapes (V,)."""
    bodies = dataset.attrs["backend"] == "physics"
    names = [f"{kind}_{'height' if bodies else 'position'}" for kind in ("agent", "target")]
    height = phases[0].system.bodies.surface_height
    first = np.full(len(flying), np.inf)
    depth = np.zeros(len(flying))
    done = 0
    for chunk in pieces_of(dataset, names):
        z = np.concatenate([chunk[name].values if bodies else chunk[name].values[..., 2] for name in names], axis=1)
        lost = _by_phase([_stopped(phase.system) for phase in phases], phases, done, len(z))
        done += len(z)
        below = np.where(flying & ~lost & (z < height), height - z, 0.0)
        time = np.where(below > 0.0, chunk["time"].values[:, None], np.inf)
        first = np.minimum(first, time.min(axis=0))
        depth = np.maximum(depth, below.max(axis=0))
    return first, depth


def _stopped(system: System) -> BoolArray:
    """Return which vehicles are lost, shape (V,)."""
    return np.zeros(len(system.team.members), dtype=np.bool_) if system.stopped is None else system.stopped


def _about_distances(system: System, dataset: "xr.Dataset") -> list[Note]:
    """Report vehicles closer than their size; in teams of more than 100, only where each is closest to another."""
    members = system.team.members
    if len(members) < 2:
        return []
    sizes = np.array([vehicle.size for vehicle in system.vehicles])
    kinds = ("agent", "target")
    closest = 1.0
    found: tuple[float, float, int, int] | None = None  # distance, m; time, s; both vehicles
    together: set[int] = set()
    for piece in pieces_of(dataset, [f"{kind}_{what}" for kind in kinds for what in ("body_position", "separation")]):
        x, apart = (
            np.concatenate([piece[f"{kind}_{what}"].values for kind in kinds], axis=1)
            for what in ("body_position", "separation")
        )
        for k, i, j, distance in _close_pairs(x, apart, sizes):
            together |= {i, j}
            share = distance / (0.5 * (sizes[i] + sizes[j]))
            if share < closest:
                closest = share
                found = distance, float(piece["time"].values[k]), i, j
    if found is None:
        return []
    distance, time, i, j = found
    others = f"; {len(together)} vehicles come closer to another one than their size" if len(together) > 2 else ""
    text = (
        f"{members[i].id} and {members[j].id} come closer to each other than their size, "
        f"{0.5 * (sizes[i] + sizes[j]):.3g} m: their origins are {distance:.3g} m apart at t = {time:.6g} s{others}. "
        "Contacts are off (physics.contacts: false), so vehicles do not collide"
    )
    return [Note("close", text, members[i].id, time, distance)]


def _close_pairs(x: Array, apart: Array, sizes: Array) -> "list[tuple[int, int, int, float]]":
    """List pairs closer than their size: the sample at which they are closest, both vehicles, and their distance, m.

    Args:
        x: Origins of bodies, shape (T, V, 3), m.
        apart: Distance to the nearest other vehicle, shape (T, V), m.
        sizes: Sizes of vehicles, shape (V,), m.
    """
    V, most, found = len(sizes), float(sizes.max()), []
    if V <= EXHAUSTIVE_LIMIT:
        if not (apart < most).any():
            return []
        for i in range(V - 1):
            distance = np.linalg.norm(x[:, i + 1 :] - x[:, i : i + 1], axis=2)
            k = distance.argmin(axis=0)
            least = distance[k, np.arange(V - 1 - i)]
            near = np.flatnonzero(least < 0.5 * (sizes[i] + sizes[i + 1 :]))
            found += [(int(k[n]), i, int(i + 1 + n), float(least[n])) for n in near]
        return found
    for k in np.unique(apart.argmin(axis=0)[apart.min(axis=0) < most]).tolist():
        pairs = cKDTree(x[k]).query_pairs(most, output_type="ndarray")
        distance = np.linalg.norm(x[k, pairs[:, 0]] - x[k, pairs[:, 1]], axis=1)
        near = distance < 0.5 * sizes[pairs].sum(axis=1)
        found += [(k, int(i), int(j), float(d)) for (i, j), d in zip(pairs[near], distance[near], strict=True)]
    return found


def _and_others(name: str, others: int) -> str:
    return name + (f" and {others} other{'s' * (others > 1)}" if others else "")


def examine_terms(run: System | Sequence[Phase], dataset: "xr.Dataset") -> TermsInRun | None:
    """Examine the terms of the law in a run, or in its last phase if it has events; the run is read in pieces.

    Args:
        run: System of the run, or its phases.
        dataset: Result of `simulate`.

    Returns:
        Behaviour of the terms; None for the paper's law, a law in Python, and fewer than 8 samples.
    """
    system, dataset = of_phase(run, dataset, -1)
    bodies, count = dataset.attrs["backend"] == "physics", dataset.sizes["time"]
    terms = (system.control_of_bodies if bodies else system.control).law.terms
    if not terms.agents or dataset.attrs.get("controller") or count < MIN_SAMPLES:
        return None
    limit, begin, done = system.law.limit[: terms.agents], count // 2, 0
    thrusters = np.array([len(vehicle.thrusters) for vehicle in system.vehicles[: terms.agents]]) if bodies else None
    speed = jumps = at_limit = saturated = 0.0
    before = np.zeros((0, terms.agents, 3))
    for piece in pieces_of(dataset, ["velocity_command", *["agent_saturation"] * bodies]):
        command = np.nan_to_num(piece["velocity_command"].values)
        square = (command**2).sum(axis=2)
        late = max(begin - done, 0)
        speed += float(square.sum())
        at_limit += float((np.sqrt(square[late:]) >= _AT_LIMIT * limit).sum())
        if thrusters is not None:
            saturated += float((piece["agent_saturation"].values[late:] @ (thrusters / thrusters.sum())).sum())
        before = np.concatenate([before[-2:], command[late:]])
        jumps += float((np.diff(before, 2, axis=0) ** 2).sum())
        done += len(command)
    rest = count - begin
    found = TermsInRun(
        on=terms.names,
        jump=float(np.sqrt(jumps / (6.0 * (rest - 2) * terms.agents))),
        commanded=float(np.sqrt(speed / (count * terms.agents))),
        at_limit=at_limit / (rest * terms.agents),
        saturated=saturated / rest if bodies else None,
    )
    warning = _harm(system, found)
    return replace(found, warnings=(warning,) if warning else ())


def _harm(system: System, found: TermsInRun) -> str:
    """Compose a warning about the terms; empty for a healthy run."""
    on = joined(found.on)
    saturated = found.saturated or 0.0
    if found.jump > max(MAX_JUMP * found.commanded, MIN_JUMP):
        return (
            f"with {on}, commands jump by {found.jump:.3g} m/s RMS from sample to sample "
            f"({100 * found.jump / found.commanded:.0f}% of the commanded speed): lower controller.gain "
            f"({system.gain:g} 1/s) or the terms' own gains, or raise their filters; see mjsheaf check"
        )
    if found.at_limit > MAX_SHARE:
        return (
            f"agents are at their velocity limit for {100 * found.at_limit:.0f}% of the second half, so {on} cannot "
            "act: raise velocity_limit, or slow the targets"
        )
    if saturated > MAX_SHARE:
        return (
            f"agents' thrusters are at a limit for {100 * saturated:.0f}% of the second half, with {on}: lower "
            "controller.gain or velocity_limit, or slow the targets"
        )
    return ""
