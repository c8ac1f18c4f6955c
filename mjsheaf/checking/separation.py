"""Check of the safety filter; see `mjsheaf.law.safety`.

The harmonic extension is compared with the distances that the scenario requires, and with those that the filter keeps
at the scenario's rate, which may be larger than the formation. If vehicles at q* are too close, filter and law
contradict each other. The requirements of the filter's theorem are decided one by one.

To stay at q*, agent i commands u = q*' - w_i, relative to a medium at w_i. With n = z / |z|, its constraint against a
vehicle at distance d is n . u >= w (p - gamma (d^2 - D^2) / (2 d)), see `mjsheaf.law.safety`. It holds from

    d = (s + sqrt(s^2 + gamma^2 D^2)) / gamma,    s = p - n . u / w,

where p bounds the speed at which the other vehicle and the media close in, and w is the agent's weight, which is 1
towards vehicles and obstacles that do not yield. s is the closing speed that the filter must allow for. It is p for an
agent that commands zero velocity. An agent that holds its place downwind of another vehicle, or follows it, commands a
velocity towards it. The filter does not assume that the other vehicle keeps moving, so s is larger. To come as near as
d, gamma must be 2 d s / (d^2 - D^2).

If a constraint does not hold at q*, the filter replaces the command there, and q* is not an equilibrium of the team.

All other results of `check` assume that the filter does not act. Bounds on errors are undecided, because they do not
include the velocities that the filter adds.
"""

from collections import Counter
from collections.abc import Iterator

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field
from scipy.spatial import cKDTree

from mjsheaf.arrays import Array
from mjsheaf.checking.theorem.certificate import Certificate
from mjsheaf.checking.theorem.targets import Carrier
from mjsheaf.errors import select_true
from mjsheaf.law.obstacles import distances, nearest_points
from mjsheaf.law.safety import SafetyArrays
from mjsheaf.loop.system import System
from mjsheaf.section import Finite, Record

MOSTLY = 0.5
"""Fraction of the time above which a fault counts as lasting."""

_MOST_PAIRS = 200  # maximum number of pairs in a record, the closest ones
_MAX_MET = 16  # others that an agent can meet if all turn right: 16 drones pass on a circle, 40 block one another
_ROUNDING = 1e-9  # tolerance of a distance, m, and of a speed, m/s


class TooClose(Record):
    """A pair that is closer than it should be."""

    pair: list[str] = Field(description="ids of an agent and another vehicle or an obstacle")
    time: float = Field(description="when they are closest, s")
    gap: float = Field(description="their distance minus the required one, below 0, m")
    fraction: float = Field(description="fraction of the samples at which they are too close")


class Standoff(Record):
    """An agent that the filter keeps farther away than its place in q*, although q* satisfies the distance itself.

    Distances are those at the sample that requires the highest rate.
    """

    pair: list[str] = Field(description="ids of the agent, and of the vehicle or obstacle that it is kept away from")
    time: float = Field(description="time of that sample, s")
    desired: float = Field(description="distance in q*, m")
    kept: float = Field(description="distance that the filter keeps from an agent that is to stay in its place, m")
    rate: Finite = Field(
        description="smallest safety.rate for which the places fit at all samples, 1/s; null: none up to 1 / "
        "control_period suffices"
    )
    fraction: float = Field(description="fraction of the samples at which the places do not fit")

    @property
    def lasts(self) -> bool:
        """True if the places do not fit at most samples: the formation cannot be reached."""
        return self.fraction > MOSTLY


class SafetyRecord(Record):
    """Guarantees of the safety filter, which do not depend on links."""

    unsafe: list[TooClose] = Field(description="pairs whose places in q* are too close, at samples of the run")
    changing: bool = Field(description="true while formations change: then every such pair is a problem")
    standoff: list[Standoff] = Field(
        description="agents that the filter keeps farther from something than their places in q*, on ideal kinematics; "
        "none are listed if the targets' path is not known"
    )
    standoff_on_bodies: list[Standoff] = Field(description="the same on bodies, which keep larger distances")
    initial: list[TooClose] = Field(description="pairs that begin too close; the filter drives them apart")
    crossing: list[list[str]] = Field(
        description="pairs that get closer than required on straight ways to the places that they have at the start, "
        "and may block one another: with tie_break right_hand, only those with a target or an obstacle, which do not "
        f"yield, or with an agent that meets more than {_MAX_MET} others"
    )
    guaranteed: bool = Field(
        description="true if, on ideal kinematics, a pair that keeps its distance never loses it as long as every "
        "agent's constraints are feasible, and no air acts on their hulls on bodies"
    )
    reasons: list[str] = Field(description="reasons why there is no guarantee")
    range: float = Field(description="distance within which agents see others, m")
    rate: float = Field(description="gamma, 1/s")
    parting: Finite = Field(
        description="largest relative speed of the media around two vehicles that the constraints include, m/s"
    )
    margins: dict[str, float] = Field(
        description="addition to the distance for each vehicle on bodies: its stopping distance, m"
    )
    without_margin: list[str] = Field(
        description="agents with neither a velocity_limit nor a vehicle with a top speed: their margin does not "
        "include a stopping distance"
    )


def safety_record(system: System, certificate: Certificate) -> SafetyRecord | None:
    """Return the guarantees of the filter; None without one."""
    if system.safety is None:
        return None
    arrays = system.separation(np.zeros(len(system.planar)))
    names = [member.id for member in system.team.members] + system.safety.obstacle_ids
    times, places = _places(system, certificate)
    initial = system.initial[None] + arrays.lift
    reasons = _reasons(system, arrays, names)
    wide = system.separation(system.safety_margins)
    known = not system.team.targets or certificate.constants.path.cells is not None
    ideal, bodies = (standoffs(system, of, arrays, names, times, places) if known else [] for of in (arrays, wide))
    about = arrays.unsteady + np.linalg.norm(arrays.carried, axis=1)
    moving = system.largest_disturbance + [system.flows[k].kernel_speed for k in system.field]
    return SafetyRecord(
        unsafe=find_too_close(arrays, names, times, places),
        changing=bool(system.team.ramp or system.team.changing),
        standoff=ideal,
        standoff_on_bodies=bodies,
        initial=find_too_close(arrays, names, times[:1], initial),
        crossing=_crossings(arrays, names, times[0], initial[0], places[0]),
        guaranteed=not reasons,
        reasons=reasons,
        range=arrays.reach,
        rate=arrays.rate,
        parting=2.0 * float(np.max(about)) if np.isfinite(moving).all() else None,
        margins=dict(zip(names, system.safety_margins.tolist(), strict=False)),
        without_margin=[names[v] for v in np.flatnonzero(system.without_margin)],
    )


def _crossings(
    safety: SafetyArrays, names: list[str], time: float, start: Array, places: Array, *, samples: int = 400
) -> list[list[str]]:
    """Return the pairs that may block one another; see `SafetyRecord.crossing`.

    Args:
        safety: Parameters of the safety filter.
        names: Ids of vehicles and obstacles, which are taken where they begin.
        time: Start of the run, s.
        start: Initial positions in space, shape (V, 3), m.
        places: Places in q*, and positions of the targets, at the start, in space, shape (V, 3), m.
        samples: Number of samples of a way, at which distances to obstacles are taken.
    """
    N, V = safety.agents, len(safety.radius)
    way = places - start
    pairs = list[tuple[int, int]]()
    for i in range(N):
        apart, moved = start[i + 1 :] - start[i], way[i + 1 :] - way[i]
        square = np.maximum((moved**2).sum(axis=1), 1e-300)
        share = np.clip(-(apart * moved).sum(axis=1) / square, 0.0, 1.0)  # of the way, at which they are closest
        nearest = np.linalg.norm(apart + share[:, None] * moved, axis=1)
        required = np.minimum(safety.radius[i] + safety.radius[i + 1 :], np.linalg.norm(apart, axis=1))
        pairs += [(i, i + 1 + j) for j in np.flatnonzero(nearest < required - _ROUNDING).tolist()]
    ways = start[:N] + np.linspace(0.0, 1.0, samples)[:, None, None] * way[:N]
    clear = distances(safety.obstacles, np.full(samples, time), ways) - safety.clearance[:N, None]
    pairs += [(i, V + j) for i, j in np.argwhere(clear.min(axis=0) < np.minimum(clear[0], 0.0) - _ROUNDING).tolist()]
    if safety.right:
        met = Counter(agent for pair in pairs for agent in pair)
        pairs = [(i, j) for i, j in pairs if j >= N or max(met[i], met[j]) > _MAX_MET]
    return [[names[i], names[j]] for i, j in pairs[:_MOST_PAIRS]]


def standoffs(
    system: System,
    safety: SafetyArrays,
    least: SafetyArrays,
    names: list[str],
    times: Array,
    places: Array,
    most: int = 100,
) -> list[Standoff]:
    """List the pairs whose places do not fit, those that require the highest rate first.

    Args:
        system: System whose q* is known over its run.
        safety: Arrays of the filter, with margins or without.
        least: The same without margins. Places that are closer than that are unsafe, and not listed here.
        names: Ids of vehicles and obstacles.
        times: Sample times, shape (T,), s.
        places: Places in q*, and those of the targets, in space, shape (T, V, 3), m.
        most: Largest number of samples that are used; large teams use fewer.
    """
    T, V = places.shape[:2]
    velocity = np.gradient(places, times, axis=0) if T > 1 else np.zeros_like(places)
    rows = np.unique(np.linspace(0, T - 1, min(T, most, max(2, 4_000_000 // V**2))).astype(np.int64))
    c = pd.concat(
        [_constraints(system, safety, least, times[k], places[k], velocity[k]).assign(time=times[k]) for k in rows],
        ignore_index=True,
    )
    gamma, room = safety.rate, c.away**2 - c.keep**2
    misfit = (c.closing > gamma * room / (2.0 * c.away) + _ROUNDING) & (c.away >= c.least - _ROUNDING)
    if not misfit.any():
        return []
    c["kept"] = np.minimum((c.closing + np.hypot(c.closing, gamma * c.keep)) / gamma, safety.reach)
    c["rate"] = (2.0 * c.away * c.closing / room.where(room > 0.0)).fillna(np.inf)
    if not system.grid.continuous:
        c.loc[c.rate * system.grid.period > 1.0, "rate"] = np.inf
    c = c[misfit].assign(short=c.away - c.kept).sort_values(["rate", "short"], ascending=[False, True])
    c["fraction"] = c.groupby(["agent", "other"]).time.transform("size") / len(rows)
    worst = c.drop_duplicates(["agent", "other"]).sort_index().sort_values("rate", ascending=False, kind="stable")
    return [
        Standoff(
            pair=[names[one.agent], names[one.other]],
            time=one.time,
            desired=one.away,
            kept=one.kept,
            rate=one.rate,
            fraction=one.fraction,
        )
        for one in worst.head(_MOST_PAIRS).itertuples()
    ]


def _constraints(
    system: System, safety: SafetyArrays, least: SafetyArrays, time: float, places: Array, velocity: Array
) -> pd.DataFrame:
    """Return the constraints of all agents within range of something, at places and velocities (V, 3).

    Columns are the numbers of the agent and of the other vehicle, or of the obstacle after the vehicles; the distance
    `away` in q*, and those to `keep` with and `least` without margins, m; and `closing`, s in m/s.
    """
    N, V = safety.agents, len(places)
    own = (places - safety.lift)[:N]
    wind = np.zeros((N, 3))
    for k, flow in enumerate(system.flows):
        met = system.field[:N] == k
        wind[met] = flow.velocity(own[met])
    wind[safety.planar[:N], 2] = 0.0
    command = velocity[:N] - wind
    pairs = cKDTree(places).query_pairs(safety.reach, output_type="ndarray").reshape(-1, 2)
    agent, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    agent, other = agent[agent < N], other[agent < N]
    share = safety.pairing[:, 1]
    weight = share[agent] / (share[agent] + share[other])
    parting = safety.pairing[agent, 2] + safety.pairing[other, 2]
    parting += np.linalg.norm(safety.carried[agent] - safety.carried[other], axis=1)
    z = places[agent] - places[other]
    clear = distances(safety.obstacles, np.array([time]), places[None, :N])[0]
    near, which = np.nonzero(clear <= safety.reach)
    surface = nearest_points(safety.obstacles, which, np.full(len(near), time), places[near])
    about = np.linalg.norm(safety.carried[near], axis=1) + safety.unsteady[near]
    z = np.concatenate([z, places[near] - surface])
    away = np.concatenate([np.linalg.norm(places[agent] - places[other], axis=1), clear[near, which]])
    agent_of, other_of = np.concatenate([agent, near]), np.concatenate([other, V + which])
    parting = np.concatenate([parting, about + safety.obstacles.speed[which]])
    weight = np.concatenate([weight, np.ones(len(near))])
    z[safety.planar[agent_of], 2] = 0.0
    # A planar agent cannot act along a direction that is nearly vertical.
    acts = safety.yields[agent_of] & (away > 0.0) & (np.linalg.norm(z, axis=1) > 1e-6 * away)
    towards = np.einsum("pi,pi->p", z[acts], command[agent_of[acts]]) / away[acts]

    def distance_of(arrays: SafetyArrays) -> Array:
        pair = arrays.radius[agent] + arrays.radius[other]
        return np.concatenate([pair, arrays.clearance[near]])[acts]

    return pd.DataFrame(
        {
            "agent": agent_of[acts],
            "other": other_of[acts],
            "away": away[acts],
            "keep": distance_of(safety),
            "least": distance_of(least),
            "closing": parting[acts] - towards / weight[acts],
        }
    )


def _places(system: System, certificate: Certificate, *, samples_of_ramp: int = 1000) -> tuple[Array, Array]:
    """Return times (T,) in s and q* with the targets there, in space, shape (T, V, 3), m.

    While range and bearing edges change, q* is that of the team itself, at fewer than 2 * `samples_of_ramp` samples.
    """
    path, team = certificate.constants.path, system.team
    start = system.grid.start
    samples = path.samples if path.cells is not None else path.samples[:1]
    times: Array = start + system.grid.period * path.stride * np.arange(len(samples), dtype=np.float64)
    if not len(samples):
        times, samples = np.array([start]), system.initial[None, len(team.agents) :]
    if path.cells is None and (team.ramp or team.changing):  # places change although nothing is known of the targets
        times = system.grid.samples[:: max(1, system.grid.steps // samples_of_ramp)]
        samples = np.repeat(samples[:1], len(times), axis=0)
    if team.changing is None:
        q_star: Array = team.unpack(Carrier(system).extend(samples, times))
    else:
        every = max(1, len(times) // samples_of_ramp)
        times, samples = times[::every], samples[::every]
        near = np.repeat(system.initial[None, : len(team.agents)], len(times), axis=0)
        q_star = team.changing.harmonic_extension(np.concatenate([near, samples], axis=1), times)
    lift = np.zeros((len(system.planar), 3))
    lift[system.planar, 2] = system.bodies.surface_height
    return times, np.concatenate([q_star, samples], axis=1) + lift


def too_close_in(system: System, run: xr.Dataset) -> dict[tuple[str, ...], TooClose]:
    """Return the pairs that are too close in a run or a piece of it, each when it is closest, the closest first."""
    run = run.isel(time=np.flatnonzero(run["separation"].values < 0.0))
    if not run.sizes["time"]:
        return {}
    safety, what = system.separation(np.zeros(len(system.planar))), "body_position"
    what = what if f"agent_{what}" in run else "position"
    places = np.concatenate([run[f"{kind}_{what}"].values for kind in ("agent", "target")], axis=1)
    places = np.where(np.isnan(places), [[0.0, 0.0, member.height] for member in system.team.members], places)
    names = [member.id for member in system.team.members] + (system.safety.obstacle_ids if system.safety else [])
    return {tuple(one.pair): one for one in find_too_close(safety, names, run["time"].values, places)}


def find_too_close(safety: SafetyArrays, names: list[str], times: Array, places: Array) -> list[TooClose]:
    """List the pairs of an agent and something else that are too close at some time, the closest first.

    Args:
        safety: Parameters of the safety filter.
        names: Ids of vehicles and obstacles.
        times: Sample times, shape (T,), s.
        places: Positions in space, shape (T, V, 3), m.
    """
    worst = dict[tuple[int, int], tuple[float, float]]()
    count: Counter[tuple[int, int]] = Counter()
    N, V = safety.agents, len(safety.radius)
    reach = 2.0 * float(safety.radius.max())
    clear = distances(safety.obstacles, times, places[:, :N]) - safety.clearance[:N, None]
    for k, at in enumerate(places):
        pairs = cKDTree(at).query_pairs(reach, output_type="ndarray").reshape(-1, 2)
        gaps = np.linalg.norm(at[pairs[:, 0]] - at[pairs[:, 1]], axis=1) - safety.radius[pairs].sum(axis=1)
        found = [
            *((int(i), int(j), gap) for (i, j), gap in zip(pairs, gaps.tolist(), strict=True) if min(i, j) < N),
            *((int(i), V + int(j), float(clear[k, i, j])) for i, j in np.argwhere(clear[k] < 0.0)),
        ]
        for i, j, gap in found:
            if gap < -_ROUNDING:
                count[i, j] += 1
                if gap < worst.get((i, j), (0.0, 0.0))[0]:
                    worst[i, j] = gap, float(times[k])
    return [
        TooClose(pair=[names[i], names[j]], time=time, gap=gap, fraction=count[i, j] / len(times))
        for (i, j), (gap, time) in sorted(worst.items(), key=lambda item: item[1][0])[:_MOST_PAIRS]
    ]


def _reasons(system: System, safety: SafetyArrays, names: list[str]) -> list[str]:
    """Return the requirements of the theorem that are not met."""
    N, period = safety.agents, system.grid.period
    held = not system.grid.continuous
    agents = [v for v in range(N) if safety.yields[v]]
    unlimited = next((names[v] for v in agents if not np.isfinite(system.law.limit[v])), "")
    blown = next((names[v] for wind in system.wind for v in agents if wind.met[v]), "")
    product = safety.rate * period
    moved = len(system.team.target_edges) and (system.law.gain[N:] > 0.0).any()
    kernels = np.array([system.flows[k].kernel_speed for k in system.field])
    unbounded = np.isinf([kernels, system.largest_disturbance])
    steep, gusty = (names[v] for v in unbounded.argmax(axis=1))
    found = {
        "the law is continuous: the theorem is about commands that are held for a period": not held,
        f"rate times the control period is {product:.3g}, above 1: take a smaller safety.rate": held and product > 1.0,
        f"{unlimited} has no velocity_limit": unlimited,
        f"the flow about {steep} has a source or vortex without a core, of unbounded speed": unbounded[0].any(),
        f"the gusts that {gusty} meets are Gaussian, which no speed bounds": unbounded[1].any(),
        f"on bodies, the air pushes the hull of {blown}, whose error the margins do not include": blown,
        "the targets' own consensus moves them at a speed for which there is no bound here": moved,
    }
    for name, pull in zip(names[N:], system.motion.pull[N:].tolist(), strict=False):
        why = (
            f"motion.pull of {name} times the control period is {pull * period:.3g}, not below 2: nothing bounds its "
            "distance from its path"
        )
        found[why] = held and pull * period >= 2.0
    return [*select_true(found), *_of_speeds(system, safety, agents, names)]


def _of_speeds(system: System, safety: SafetyArrays, agents: list[int], names: list[str]) -> Iterator[str]:
    """Yield why agents may not detect others in time, or may be slower than vehicles and obstacles to avoid."""
    limit = system.law.limit
    period = 0.0 if system.grid.continuous else system.grid.period
    own = [v for v in agents if np.isfinite(limit[v])]
    if not own:
        return
    about = safety.unsteady + np.linalg.norm(safety.carried, axis=1)
    others = np.flatnonzero(~safety.yields)
    ids = [*(names[v] for v in others), *names[len(about) :]]
    speeds = np.concatenate(
        [safety.pairing[others, 2] + np.linalg.norm(safety.carried[others], axis=1), safety.obstacles.speed]
    )
    slowest = min(own, key=limit.__getitem__)
    relative = speeds + about[slowest]
    too_fast = np.flatnonzero(relative >= limit[slowest])
    if too_fast.size:
        yield (
            f"{ids[too_fast[0]]} may come at {relative[too_fast[0]]:.3g} m/s relative to the medium about "
            f"{names[slowest]}, which commands at most {limit[slowest]:.3g} m/s"
        )
    # Another agent that a different flow carries may come faster than an agent can make way for it.
    carried, unsteady, share = safety.carried[own], safety.unsteady[own], safety.pairing[own, 1]
    apart = np.linalg.norm(carried[:, None] - np.unique(carried, axis=0), axis=2).max(axis=1)
    speed = (apart + unsteady + unsteady.max()) * share / (share + share.min())
    slow = np.flatnonzero(speed >= limit[own])
    if len(slow) and len(own) > 1:
        v = own[slow[0]]
        yield (
            f"the flow may carry another agent towards {names[v]}, which then has to command up to "
            f"{speed[slow[0]]:.3g} m/s against its limit of {limit[v]:.3g} m/s"
        )
    fastest = float(limit[own].max())
    closing = fastest + max(fastest, *speeds, 0.0) + 2.0 * float(about.max())
    D = max(2.0 * float(safety.radius.max()), float(safety.clearance.max()))
    if safety.reach < D + closing * period:
        yield f"safety.range is {safety.reach:.3g} m; expected at least {D + closing * period:.3g} m, a period ahead"
