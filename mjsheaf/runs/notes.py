"""Notes on a run, in sentences: on the terminal and in summary.json.

    bound         a bound that theory gives is exceeded
    growing       the team's error grows to the end; circling: the team swings by itself
    slip          a value of the files looks like a slip, such as an angle in radians (see `slips`)
    medium        flow and disturbance are faster than a vehicle can be
    saturated     thrusters at a limit for more than a tenth of the time
    limited       commands at the velocity limit for more than a tenth of the time
    stuck         an agent is commanded to move and does not for 5 s (see `stuck`)
    terms         the law's terms do harm (see `harm`)
    changing      the team's error is not settled at the end; approaching: it still falls
    close         vehicles closer than their size, or through each other, while contacts are off
    submerged     an aircraft under water or in the ground

They come in this order, the most important first, each once, for the vehicle that is worst.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from scipy.spatial import cKDTree

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.checking.finished import HeldBound, RunBound
from mjsheaf.checking.stuck import Stuck, find_stuck
from mjsheaf.results.netcdf import pieces_of
from mjsheaf.runs.harm import TermsInRun, listed
from mjsheaf.system import Phase, System
from mjsheaf.vehicles.authority import is_one_sided

if TYPE_CHECKING:
    import xarray as xr

Kind = Literal[
    "bound",
    "growing",
    "circling",
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

_MUCH = 0.1  # of the time, that thrusters or commands may be at a limit
_GUST = 0.01  # of the time, for which a medium may be too fast
_AT_LIMIT = 1.0 - 1e-9  # of the velocity limit
_MOSTLY, _HARDLY = 0.5, 0.05  # of the velocity that is missing, mean square, that jumps are
_FEW = 100  # vehicles up to which all pairs are compared at all samples


@dataclass(frozen=True)
class Note:
    """Something to know of a run.

    Attributes:
        kind: of what.
        text: the sentence.
        agent: id of the agent or target that it is about, the worst of several; None where it is the team.
        time: at which it is worst, or begins, s; None where there is no such time.
        number: how bad: a share of time, or m, m/s, or a ratio to a bound, as the text says.
    """

    kind: Kind
    text: str
    agent: str | None = None
    time: float | None = None
    number: float | None = None

    def record(self) -> dict[str, Any]:
        """What summary.json has of it."""
        return asdict(self)


def notes_of_run(
    phases: Sequence[Phase],
    dataset: "xr.Dataset",
    ending: str | None,
    bounds: Sequence[RunBound | HeldBound],
    terms: TermsInRun | None,
    slips: Sequence[str] = (),
) -> list[Note]:
    """Collect what a user should know of a run, the most important first; the run is read in pieces.

    Args:
        phases: what was run.
        dataset: as `simulate` gives it.
        ending: how it ended (see `finished`).
        bounds: those of its phases.
        terms: what its terms did.
        slips: sentences of `slips_of`, about its files.
    """
    found = [Note("slip", sentence) for sentence in slips]
    found += [Note("bound", bound.violation(), None, bound.worst, bound.ratio) for bound in bounds if bound.violation()]
    found += [Note("terms", sentence) for sentence in (terms.harm if terms else ())]
    found += _about_the_end(dataset, ending)
    stuck = find_stuck(phases, dataset)
    found += _about_stuck(phases[0].system, stuck)
    found += _about_limits(phases, dataset, [one.agent for one in stuck])
    found += _about_the_surface(phases, dataset)
    if dataset.attrs["backend"] == "physics" and not phases[0].system.bodies.contacts:
        found += _about_distances(phases[0].system, dataset)
    kinds = get_args(Kind)
    return sorted(found, key=lambda note: kinds.index(note.kind))


def _about_the_end(dataset: "xr.Dataset", ending: str | None) -> list[Note]:
    """Whether the error still changes, or the team swings by itself."""
    if ending in (None, "settled", "stuck"):  # a note names the agents that are stuck
        return []
    time = dataset["time"].values
    quarter = max(1, len(time) // 4)
    squares = dataset["tracking_error"][-2 * quarter :].values ** 2
    before, last = (np.sqrt(np.nanmean(part)) for part in (squares[:-quarter], squares[-quarter:]))
    size = f"tracking error (RMS over agents) {last:.3g} m in the last quarter, {before:.3g} m in the one before"
    never = "the team does not settle"
    kind: Kind
    if ending == "moving":
        kind, what = ("approaching", "still approaching") if last < before else ("changing", "not settled yet")
        text = f"the team is {what} at the end of the run: {size}; a later time.end shows where it settles"
    elif ending == "growing":
        kind, text = "growing", f"{never}: its error grows to the end ({size}); see mjsheaf check"
    else:
        kind, text = "circling", f"{never}: it swings by itself, without end ({size}); see mjsheaf check"
    return [Note(kind, text, None, float(time[-1]), float(last))]


def _about_stuck(system: System, stuck: Sequence[Stuck]) -> list[Note]:
    """Find agents that are commanded to move and do not."""
    if not stuck:
        return []
    first, names = stuck[0], _and_others(system.team.agents[stuck[0].agent].id, len(stuck) - 1)
    verb = "is" if len(stuck) == 1 else "are"
    text = f"{names} {verb} stuck: commanded to move at {first.asked:.3g} m/s from t = {first.start:.6g} s"
    text += f" to {first.end:.6g} s, {system.team.agents[first.agent].id} does not move ({first.error:.3g} m off)"
    text += f": {first.reason}"
    return [Note("stuck", text, system.team.agents[first.agent].id, first.start, first.error)]


def _about_limits(phases: Sequence[Phase], dataset: "xr.Dataset", stuck: Sequence[int]) -> list[Note]:
    """Agents whose thrusters or commands are at their limits, or whose medium is too fast for them.

    Of agents that are stuck, another note has said why.
    """
    system, bodies = phases[0].system, dataset.attrs["backend"] == "physics"
    names = ["agent_flow", *["velocity_command"] * (not dataset.attrs.get("controller"))]
    names += ["agent_saturation"] * bodies
    agents = system.team.agents
    own = _own_speed(system, bodies)
    N, done = len(agents), 0
    present, full, capped, swept = (np.zeros(N) for _ in range(4))
    excess, fastest, able, when = (np.zeros(N) for _ in range(4))  # where the flow is the most times too fast
    for piece in pieces_of(dataset, names):
        T = piece.sizes["time"]
        there, limit = _conditions(phases, done, T)
        present += there.sum(axis=0)
        if bodies:
            full += ((piece["agent_saturation"].values > 0.0) & there).sum(axis=0)
        if "velocity_command" in names:
            speed = np.linalg.norm(np.nan_to_num(piece["velocity_command"].values), axis=2)
            capped += ((speed >= _AT_LIMIT * limit) & (limit > 0.0) & there).sum(axis=0)
        flow = np.where(there, np.linalg.norm(np.nan_to_num(piece["agent_flow"].values), axis=2), 0.0)
        can = np.minimum(limit, own)
        ratio = np.divide(flow, can, out=np.zeros_like(flow), where=(flow > can) & (can > 0.0))
        swept += (ratio > 0.0).sum(axis=0)
        most = ratio.argmax(axis=0), np.arange(N)
        more = ratio[most] > excess
        for kept, now in ((excess, ratio), (fastest, flow), (able, can)):
            kept[more] = now[most][more]
        when[more] = piece["time"].values[most[0]][more]
        done += T
    full, capped, swept = (count / np.maximum(present, 1) for count in (full, capped, swept))
    full[list(stuck)] = capped[list(stuck)] = 0.0
    found: list[Note] = []

    def worst(badness: Array, least: float) -> tuple[int, str]:
        """The worst agent and a name for all that are bad; -1 where none is."""
        over = int((badness > least).sum())
        v = int(badness.argmax())
        return (v, _and_others(agents[v].id, over - 1)) if over else (-1, "")

    v, ids = worst(full, _MUCH)
    if v >= 0:
        why = _why_saturated(phases, dataset, v)
        text = f"thrusters of {ids} are at a limit for {100 * full[v]:.0f} % of the time: {why}"
        found.append(Note("saturated", text, agents[v].id, None, float(full[v])))
    v, ids = worst(capped, _MUCH)
    if v >= 0:
        text = f"the law asks {ids} for the velocity limit or more for {100 * capped[v]:.0f} % of the time"
        text += "; raise velocity_limit, or lower the gain"
        found.append(Note("limited", text, agents[v].id, None, float(capped[v])))
    v, ids = worst(np.where(swept > _GUST, excess, 0.0), 0.0)
    if v >= 0:
        what = "its vehicle makes" if able[v] == own[v] else "its velocity limit allows"
        text = (
            f"the medium is faster than {ids} can be: {fastest[v]:.3g} m/s about {agents[v].id} at t = {when[v]:.6g} s"
        )
        text += f", where {what} {able[v]:.3g} m/s in its slowest direction"
        found.append(Note("medium", text, agents[v].id, float(when[v]), float(fastest[v])))
    return found


def _why_saturated(phases: Sequence[Phase], dataset: "xr.Dataset", v: int) -> str:
    """Whether the law asks too much of an agent, or chance does, by which its commands jump.

    Thrusters make good what is missing of the velocity asked for: what share of its mean square are jumps tells.
    """
    law = dataset.attrs.get("controller")
    asks, chance = f"the law {law} asks too much" if law else "the law asks too much", _chance(phases)
    if is_one_sided(phases[0].system.vehicles[v]):
        asks = "they do not push both ways, so that it turns with some at full thrust and others at none"
    if not chance:
        return asks
    missing = jumps = 0.0
    period, done, names = phases[0].system.grid.period, 0, ("velocity_command", "agent_position", "agent_flow")
    for piece in pieces_of(dataset, names):
        there = _conditions(phases, done, piece.sizes["time"])[0][:, v, None]
        asked, place, flow = (np.where(there, np.nan_to_num(piece[name].values[:, v]), 0.0) for name in names)
        with np.errstate(all="ignore"):  # a run that blew up
            made = np.diff(place, axis=0) / period - flow[:-1]
            missing += float((np.where(there[1:] & there[:-1], asked[:-1] - made, 0.0) ** 2).sum())
            jumps += float((np.diff(asked, 2, axis=0) ** 2).sum()) / 6.0  # see `harm`
        done += len(asked)
    jump = f"{listed(chance)} make{'s' if len(chance) == 1 else ''} its commands jump; {_calmer(dataset)}"
    if jumps >= _MOSTLY * missing:
        return jump
    return asks if jumps <= _HARDLY * missing else f"{asks}, or {jump}"


def _calmer(dataset: "xr.Dataset") -> str:
    """Advise what makes commands jump less: a lower gain, if the law has one."""
    law = dataset.attrs.get("controller")
    return f"filter measurements in {law}" if law else "lower controller.gain"


def _chance(phases: Sequence[Phase]) -> list[str]:
    """What makes commands jump at random, in words."""
    laws = [phase.system.law for phase in phases]
    links = np.concatenate([law.links.table for law in laws])
    lossy = links["lossy"].any() or any(law.terms.rounds.lossy for law in laws)
    found = {
        "noise of measurements": any((links[name] > 0.0).any() for name in ("noise", "range_noise", "bearing_noise")),
        "loss of messages": lossy,
        "noise of odometry": any(law.terms.noisy for law in laws),
    }
    return [name for name, there in found.items() if there]


def _limits(system: System) -> Array:
    """Largest commanded speed of each agent, shape (N,), m/s."""
    return system.law.limit[: len(system.team.agents)]


def _own_speed(system: System, bodies: bool) -> Array:
    """How fast each agent's vehicle can be in its slowest direction, shape (N,), m/s; infinite without limits."""
    from mjsheaf.vehicles.effects import capability_of, of_each

    if not bodies:
        return np.full(len(system.team.agents), np.inf)
    vehicles = system.vehicles[: len(system.team.agents)]
    return of_each(vehicles, lambda vehicle: capability_of(vehicle).least_speed)


def _conditions(phases: Sequence[Phase], first: int, count: int) -> tuple[BoolArray, Array]:
    """Who is present at so many samples from the first on, and their limits of speed then, shapes (T, N), m/s."""
    number = np.searchsorted([phase.start for phase in phases], np.arange(first, first + count), side="right") - 1
    there = np.array([phase.system.team.present for phase in phases])
    limit = np.array([_limits(phase.system) for phase in phases])
    return there[number], limit[number]


def _lost(phases: Sequence[Phase], first: int, count: int) -> BoolArray:
    """Return which vehicles are lost at so many samples from the first on, shape (T, V)."""
    number = np.searchsorted([phase.start for phase in phases], np.arange(first, first + count), side="right") - 1
    none = np.zeros(len(phases[0].system.team.members), dtype=np.bool_)
    return np.array([none if phase.system.stopped is None else phase.system.stopped for phase in phases])[number]


def _about_the_surface(phases: Sequence[Phase], dataset: "xr.Dataset") -> list[Note]:
    """Find aircraft that go below the surface of the scene.

    Lost ones rest on it, and targets that start below it are meant to be there.
    """
    system = phases[0].system
    surface, height = system.bodies.surface, system.bodies.surface_height
    agents = len(system.team.agents)
    meant = (system.initial[:, 2] < height) & (np.arange(len(system.initial)) >= agents)
    flying = [(v, member) for v, member in enumerate(system.team.members) if member.dimension == 3 and not meant[v]]
    if surface == "none" or not flying:
        return []
    bodies, N = dataset.attrs["backend"] == "physics", len(system.team.agents)
    names = [f"{kind}_{'height' if bodies else 'position'}" for kind in ("agent", "target")]
    deepest = (0.0, -1)
    below: dict[int, float] = {}
    done = 0
    for piece in pieces_of(dataset, names):
        z = np.concatenate([piece[name].values if bodies else piece[name].values[..., 2] for name in names], axis=1)
        lost = _lost(phases, done, len(z))
        done += len(z)
        for v, _ in flying:
            below_surface = np.where(lost[:, v], 0.0, height - z[:, v])
            under = np.flatnonzero(below_surface > 0.0)
            if under.size:
                below.setdefault(v, float(piece["time"].values[under[0]]))
                deepest = max(deepest, (float(below_surface.max()), v), key=lambda found: found[0])
    if not below:
        return []
    depth, v = deepest
    member = system.team.members[v]
    where = "under water" if surface == "water" else "in the ground"
    what = "an aircraft" if v < N else "a target in space"
    verb = "goes" if len(below) == 1 else "go"
    text = f"{_and_others(member.id, len(below) - 1)} {verb} {where}: {member.id}, {what}, is below the surface from "
    text += f"t = {below[v]:.6g} s on, by up to {depth:.3g} m; the surface does not stop what moves in space"
    return [Note("submerged", text, member.id, below[v], depth)]


def _about_distances(system: System, dataset: "xr.Dataset") -> list[Note]:
    """Vehicles that are closer than their size; of teams of more than 100, when each is closest to another."""
    from mjsheaf.simulation.arena import size_of
    from mjsheaf.vehicles.effects import of_each

    members = system.team.members
    if len(members) < 2:
        return []
    sizes = of_each(system.vehicles, size_of)
    kinds, measured = ("agent", "target"), ("body_position", "orientation", "separation")
    names = [f"{kind}_{what}" for kind in kinds for what in measured]
    closest: tuple[float, float, float, tuple[int, int], Any] = (1.0, 0.0, 0.0, (0, 0), None)
    together: set[int] = set()
    for piece in pieces_of(dataset, names):
        x, turned, apart = (
            np.concatenate([piece[f"{kind}_{what}"].values for kind in kinds], axis=1) for what in measured
        )
        for k, i, j, distance in _close_pairs(x, apart, sizes):
            together |= {i, j}
            share = distance / (0.5 * (sizes[i] + sizes[j]))
            if share < closest[0]:
                placed = x[k, [i, j]], turned[k, [i, j]]
                closest = share, distance, float(piece["time"].values[k]), (i, j), placed
    share, distance, time, (i, j), placed = closest
    if placed is None:
        return []
    pair = f"{members[i].id} and {members[j].id}"
    through = _overlap([system.vehicles[v] for v in (i, j)], *placed)
    size = 0.5 * (sizes[i] + sizes[j])
    what = "go through each other" if through else f"come closer to each other than their size, {size:.3g} m"
    text = f"{pair} {what}: their origins are {distance:.3g} m apart at t = {time:.6g} s"
    if len(together) > 2:
        text += f"; {len(together)} vehicles come closer to another one than their size"
    text += ". Contacts are off (physics.contacts: false), so that vehicles do not collide"
    return [Note("close", text, members[i].id, time, distance)]


def _close_pairs(x: Array, apart: Array, sizes: Array) -> "list[tuple[int, int, int, float]]":
    """Sample, two vehicles and their distance, m, for each pair closer than their size, when they are closest.

    Args:
        x: origins of bodies, shape (T, V, 3), m.
        apart: distance to the nearest other vehicle, shape (T, V), m.
        sizes: shape (V,), m.
    """
    V, most, found = len(sizes), float(sizes.max()), []
    if V <= _FEW:
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


def _overlap(vehicles: "list[Any]", positions: Array, quaternions: Array) -> bool:
    """Whether two vehicles at positions (2, 3), m, and attitudes (2, 4) share space; geoms count as convex."""
    from mjsheaf.engine import mujoco
    from mjsheaf.simulation.arena import compose

    arena = compose(vehicles, ["a", "b"])
    model, data = arena.model, mujoco.MjData(arena.model)
    for at, position, quaternion in zip(arena.qpos, positions, quaternions, strict=True):
        data.qpos[at : at + 7] = *position, *quaternion
    mujoco.mj_kinematics(model, data)
    owner = model.body_rootid[model.geom_bodyid]
    first, second = (np.flatnonzero(owner == body) for body in arena.body)
    return any(mujoco.mj_geomDistance(model, data, int(a), int(b), 1.0, None) <= 0.0 for a in first for b in second)


def _and_others(name: str, others: int) -> str:
    return name + (f" and {others} other{'s' * (others > 1)}" if others else "")
