"""Diagnose a run: notes for the terminal and summary.json, and warnings about the law's terms.

    bound         a theoretical bound is exceeded
    shape         a formation ends as its mirror image, on a line, or reflected in a point
    diverging     the team's error grows to the end
    slip          a value in the files looks like a mistake, such as a static target in a flow (see `slips_of`)
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

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import xarray as xr
from scipy.spatial import cKDTree

from mjsheaf.arrays import Array
from mjsheaf.checking.theorem.of_run import HeldBound, RunBound
from mjsheaf.errors import and_others, with_verb
from mjsheaf.errors import joined as in_words
from mjsheaf.loop.system import Phase, System
from mjsheaf.results.dataset import of_phase
from mjsheaf.results.ending import Stuck, find_stuck
from mjsheaf.results.store import pieces_of
from mjsheaf.show.played import joined
from mjsheaf.team import Team

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

_FLAT = 1e-3  # extent, as a fraction of the longest one, below which a shape is a line or a plane
_ALIKE = 0.05  # maximum misfit of equal shapes, as a fraction of their size
_AT_LIMIT = 1.0 - 1e-9  # of the velocity limit
MAX_SHARE = 0.2
"""Fraction of time and agents at the velocity limit, or of time and thrusters at a limit, in a healthy run."""


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


def notes_of_run(
    phases: Sequence[Phase],
    dataset: xr.Dataset,
    ending: str | None,
    bounds: Sequence[RunBound | HeldBound],
    terms: dict[str, Any] | None,
    slips: Sequence[str] = (),
) -> list[Note]:
    """Collect the notes on a run, the most important first; the run is read in pieces.

    Args:
        phases: Phases of the run.
        dataset: Result of `simulate`.
        ending: Ending of the run; see `results.ending`.
        bounds: Bounds of its phases.
        terms: Result of `examine_terms`.
        slips: Sentences of `slips_of` about its files.
    """
    stuck = find_stuck(phases, dataset)
    stuck_to_the_end = any(one.at_end for one in stuck)  # reported in its own note
    found = [
        *(Note("slip", sentence) for sentence in slips),
        *(Note("bound", bound.violation(), None, bound.worst, bound.ratio) for bound in bounds if bound.violation()),
        *(Note("terms", sentence) for sentence in (terms["harm"] if terms else ())),
        *(Note("shape", sentence) for sentence in describe_reflections(phases[-1].system.team, dataset)),
        *(() if ending == "not settled" and stuck_to_the_end else _about_the_end(dataset, ending)),
        *_about_stuck(phases[0].system, stuck),
        *_about_limits(phases, dataset, [one.agent for one in stuck]),
        *_about_the_surface(phases, dataset),
    ]
    if dataset.attrs["backend"] == "physics" and not phases[0].system.bodies.contacts:
        found += _about_distances(phases[0].system, dataset)
    return sorted(found, key=lambda note: get_args(Kind).index(note.kind))


def _about_the_end(dataset: xr.Dataset, ending: str | None) -> list[Note]:
    """Report an error that still changes or grows."""
    if ending in (None, "settled"):
        return []
    time = dataset["time"].values
    quarter = max(1, len(time) // 4)
    squares = dataset["tracking_error"][-2 * quarter :].values ** 2
    before, last = (np.sqrt(np.nanmean(part)) for part in (squares[:-quarter], squares[-quarter:]))
    size = f"tracking error (RMS over agents) {last:.3g} m in the last quarter, {before:.3g} m in the one before"
    kind: Kind = "changing"
    if ending == "diverging":
        kind = "diverging"
        text = f"the team does not converge: its error diverges ({size}); see mjsheaf check"
    elif last < 0.95 * before:
        kind = "approaching"
        text = f"the team is still approaching at the end of the run: {size}; a later time.end shows its final error"
    elif last > 1.05 * before:
        text = f"the team has not converged at the end of the run: {size}; a later time.end shows its final error"
    else:
        text = f"the team has not settled: {size}; see mjsheaf check"
    return [Note(kind, text, None, float(time[-1]), float(last))]


def _about_stuck(system: System, stuck: Sequence[Stuck]) -> list[Note]:
    """Report agents that do not move although they are commanded to."""
    if not stuck:
        return []
    first = stuck[0]
    name = system.team.agents[first.agent].id
    text = (
        f"{with_verb(name, len(stuck) - 1)} stuck: commanded to move at {first.asked:.3g} m/s from "
        f"t = {first.start:.6g} s to {first.end:.6g} s, {name} does not move ({first.error:.3g} m off): {first.reason}"
    )
    return [Note("stuck", text, name, first.start, first.error)]


def _about_limits(phases: Sequence[Phase], dataset: xr.Dataset, stuck: Sequence[int]) -> list[Note]:
    """Report agents whose thrusters or commands are at their limits, or whose medium is too fast for them.

    Thrusters and commands may be at a limit for a tenth of the time.
    Agents that are stuck have a note of their own.
    """
    system = phases[0].system
    bodies = dataset.attrs["backend"] == "physics"
    ids = system.team.agent_ids
    by_law = not dataset.attrs.get("controller")
    N = len(ids)
    # Speed of the vehicle in its slowest direction.
    own_speed = np.array([v.capability.least_speed for v in system.vehicles[:N]]) if bodies else np.full(N, np.inf)
    present_in = np.array([phase.system.team.present for phase in phases])
    limit_in = np.array([phase.system.law.limit[:N] for phase in phases])
    present, saturated, limited, exceeded = np.zeros((4, N))  # numbers of samples
    worst = np.zeros((4, N))  # at the largest ratio of the medium's speed to the agent's: it, both speeds, time
    names = ["agent_flow", "phase", *["velocity_command"] * by_law, *["agent_saturation"] * bodies]
    for chunk in pieces_of(dataset, names):
        there, limit = (values[chunk["phase"].values] for values in (present_in, limit_in))
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
        row = ratio.argmax(axis=0)
        time = np.broadcast_to(chunk["time"].values[:, None], flow.shape)
        found = np.stack([values[row, np.arange(N)] for values in (ratio, flow, able, time)])
        worst = np.where(found[0] > worst[0], found, worst)
    notes = []
    texts: dict[Kind, tuple[Array, str]] = {
        "saturated": (saturated, "thrusters of {} are at a limit for {:.0%} of the time"),
        "limited": (
            limited,
            "the law commands {} at or above the velocity limit for {:.0%} of the time; raise velocity_limit, or lower "
            "the gain",
        ),
    }
    for kind, (samples, text) in texts.items():
        fraction = samples / np.maximum(present, 1)
        fraction[stuck] = 0.0
        v = int(fraction.argmax())
        count = int((fraction > 0.1).sum())
        if count:
            sentence = text.format(and_others(ids[v], count - 1), fraction[v]).replace("%", " %")
            notes.append(Note(kind, sentence, ids[v], None, float(fraction[v])))
    excess = np.where(exceeded > 0.01 * np.maximum(present, 1), worst[0], 0.0)  # for more than a hundredth of the time
    if excess.any():
        v = int(excess.argmax())
        _, speed, possible, when = worst[:, v].tolist()
        what = "its vehicle reaches" if possible == own_speed[v] else "its velocity limit allows"
        text = (
            f"the medium is faster than {and_others(ids[v], int((excess > 0.0).sum()) - 1)} can move: {speed:.3g} m/s "
            f"around {ids[v]} at t = {when:.6g} s, where {what} {possible:.3g} m/s in its slowest direction"
        )
        notes.append(Note("medium", text, ids[v], when, speed))
    return notes


def _about_the_surface(phases: Sequence[Phase], dataset: xr.Dataset) -> list[Note]:
    """Report aircraft that go below the surface of the scene.

    Lost aircraft rest on it. Submersibles, and targets that start below it, are meant to be there.
    """
    system = phases[0].system
    members = system.team.members
    N = len(system.team.agents)
    height = system.bodies.surface_height
    named = zip(members, system.bodies.vehicle, strict=True)
    flying = np.array([member.dimension == 3 and vehicle != "submersible" for member, vehicle in named])
    flying[N:] &= system.initial[N:, 2] >= height
    if system.bodies.surface == "none" or not flying.any():
        return []
    bodies = dataset.attrs["backend"] == "physics"
    nobody = np.zeros(len(members), dtype=np.bool_)
    lost = np.array([nobody if phase.system.stopped is None else phase.system.stopped for phase in phases])
    first, depth = np.full(len(members), np.inf), np.zeros(len(members))  # time and largest depth below the surface
    quantity = "height" if bodies else "position"
    for piece in pieces_of(dataset, [f"agent_{quantity}", f"target_{quantity}", "phase"]):
        z = joined(piece, quantity) if bodies else joined(piece, quantity)[..., 2]
        # NaN after a blow-up compares as False.
        below = np.where(flying & ~lost[piece["phase"].values] & (z < height), height - z, 0.0)
        first = np.minimum(first, np.where(below > 0.0, piece["time"].values[:, None], np.inf).min(axis=0))
        depth = np.maximum(depth, below.max(axis=0))
    under = int(np.isfinite(first).sum())
    if not under:
        return []
    v = int(depth.argmax())
    name = members[v].id
    where = "under water" if system.bodies.surface == "water" else "in the ground"
    what = "an aircraft" if v < N else "a target in space"
    text = (
        f"{with_verb(name, under - 1, 'goes', 'go')} {where}: {name}, {what}, is below the surface from "
        f"t = {first[v]:.6g} s on, by up to {depth[v]:.3g} m; the surface does not stop vehicles in space"
    )
    return [Note("submerged", text, name, float(first[v]), float(depth[v]))]


def _about_distances(system: System, dataset: xr.Dataset) -> list[Note]:
    """Report vehicles closer than their size, where each of them is closest to another."""
    members = system.team.members
    if len(members) < 2:
        return []
    sizes = np.array([vehicle.size for vehicle in system.vehicles])
    found: list[tuple[float, float, float, int, int]] = []  # distance over size; distance, m; time, s; both vehicles
    names = [f"{kind}_{what}" for kind in ("agent", "target") for what in ("body_position", "separation")]
    for piece in pieces_of(dataset, names):
        apart = joined(piece, "separation")
        near = piece.isel(time=np.unique(apart.argmin(axis=0)[apart.min(axis=0) < sizes.max()]))
        for when, x in zip(near["time"].values.tolist(), joined(near, "body_position"), strict=True):
            pairs = cKDTree(x).query_pairs(float(sizes.max()), output_type="ndarray")
            distance = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
            share = distance / (0.5 * sizes[pairs].sum(axis=1))
            found += [(share[n], distance[n], when, *pairs[n].tolist()) for n in np.flatnonzero(share < 1.0)]
    if not found:
        return []
    _, distance, time, i, j = min(found)
    together = {vehicle for *_, i, j in found for vehicle in (i, j)}
    others = f"; {len(together)} vehicles come closer to another one than their size" if len(together) > 2 else ""
    text = (
        f"{members[i].id} and {members[j].id} come closer to each other than their size, "
        f"{0.5 * (sizes[i] + sizes[j]):.3g} m: their origins are {distance:.3g} m apart at t = {time:.6g} s{others}. "
        "Contacts are off (physics.contacts: false), so vehicles do not collide"
    )
    return [Note("close", text, members[i].id, time, distance)]


def examine_terms(run: System | Sequence[Phase], dataset: xr.Dataset) -> dict[str, Any] | None:
    """Examine the terms of the law in a run, or in its last phase if it has events; the run is read in pieces.

    Args:
        run: System of the run, or its phases.
        dataset: Result of `simulate`.

    Returns:
        The entry of summary.json on their behaviour over the second half; None for the paper's law, a law in Python,
        and fewer than 8 samples. It has the names of the terms (`on`), the deviation of the white noise whose command
        jumps as much from sample to sample and the commanded speed (`jump_m_s`, `commanded_m_s`, RMS, the latter over
        the whole run), the fractions of samples at the velocity limit and of thrusters at a limit (`share_at_limit`,
        `share_saturated`, None on ideal kinematics), and sentences with the fault and a possible remedy (`harm`).
    """
    system, dataset = of_phase(run, dataset, -1)
    bodies, count = dataset.attrs["backend"] == "physics", dataset.sizes["time"]
    terms = (system.control_of_bodies if bodies else system.control).law.terms
    # Minimum number of samples for an examination of terms.
    if not terms.agents or dataset.attrs.get("controller") or count < 8:
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
    jump = float(np.sqrt(jumps / (6.0 * (rest - 2) * terms.agents)))
    commanded = float(np.sqrt(speed / (count * terms.agents)))
    at_limit /= rest * terms.agents
    saturated /= rest
    on = in_words(terms.names)
    warning = []
    if jump > max(0.1 * commanded, 1e-6):  # smaller jumps, m/s, count as rounding
        warning = [
            f"with {on}, commands jump by {jump:.3g} m/s RMS from sample to sample "
            f"({100 * jump / commanded:.0f}% of the commanded speed): lower controller.gain "
            f"({system.gain:g} 1/s) or the terms' own gains, or raise their filters; see mjsheaf check"
        ]
    elif at_limit > MAX_SHARE:
        warning = [
            f"agents are at their velocity limit for {100 * at_limit:.0f}% of the second half, so {on} cannot "
            "act: raise velocity_limit, or slow the targets"
        ]
    elif saturated > MAX_SHARE:
        warning = [
            f"agents' thrusters are at a limit for {100 * saturated:.0f}% of the second half, with {on}: lower "
            "controller.gain or velocity_limit, or slow the targets"
        ]
    return {
        "on": list(terms.names),
        "jump_m_s": jump,
        "commanded_m_s": commanded,
        "share_at_limit": at_limit,
        "share_saturated": saturated if bodies else None,
        "harm": warning,
    }


# -- formations that end in another equilibrium of their edges ---------------------------------------------------------


def describe_reflections(team: Team, dataset: xr.Dataset) -> Iterator[str]:
    """Yield a sentence about each formation that ends in an equilibrium other than its desired shape.

    Range edges do not distinguish a shape from its mirror image, and a team that starts on a line stays on it. Bearing
    edges have one more equilibrium, the shape reflected in a point, which is unstable.
    """
    if team.linear:
        return
    end = np.nan_to_num(dataset["agent_position"][-1].values)
    for formation in team.formations:
        members = [member for member in formation.members if member not in team.absent]
        kinds = {edge.measures for edge in team.formation_edges(formation)}
        if len(members) < 3 or kinds <= {"position"}:
            continue
        places = np.zeros((len(members), 3))  # the desired ones about their centroid
        for row, member in zip(places, members, strict=True):
            row[: len(team.displacement[member])] = team.displacement[member]
        found = _fault(end[[team.index[m] for m in members]], places - places.mean(axis=0), kinds)
        if found:
            yield f"formation {formation.name} ends {found}"


def _fault(x: Array, places: Array, kinds: Set[str]) -> str:
    """Describe how a shape x (n, 3) differs from the desired one `places` (n, 3); empty if it does not."""
    x = x - x.mean(axis=0)
    size, wanted = np.linalg.norm(x), np.linalg.norm(places)
    if not (size > 0.0 and wanted > 0.0):
        return ""
    extent = np.linalg.svd(x, compute_uv=False)
    if extent[1] <= _FLAT * extent[0] and np.linalg.matrix_rank(places, rtol=_FLAT) > 1:
        return "on a line, where range edges keep it: start its members off a line"
    if kinds == {"bearing"}:
        across = np.linalg.norm(x / size + places / wanted)
        return "reflected in a point, an unstable equilibrium of bearing edges" if across <= _ALIKE else ""
    # Minimum misfit of different shapes, as a fraction of their size.
    if "bearing" not in kinds and _misfit(x, places, 1.0) > 0.2 and _misfit(x, places, -1.0) <= _ALIKE:
        return "as the mirror image of its shape, which has the same distances"
    return ""


def _misfit(x: Array, places: Array, handedness: float) -> float:
    """Compute the misfit of a shape, relative to its size, after the best rotation (1) or reflection (-1) of places."""
    axes = int(np.linalg.matrix_rank(places, rtol=_FLAT))
    if axes < 2 or np.linalg.matrix_rank(x, rtol=_FLAT) > axes:
        return np.inf
    axes = 3 if axes == 3 else 2
    u, s, v = np.linalg.svd(places[:, :axes].T @ x[:, :axes])
    s[-1] *= handedness * np.sign(np.linalg.det(u @ v))
    square = (x**2).sum() + (places**2).sum() - 2.0 * s.sum()
    return float(np.sqrt(max(square, 0.0)) / np.linalg.norm(places))
