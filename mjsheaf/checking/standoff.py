"""Distances that the safety filter keeps around the places in q*, which may be larger than the formation.

To stay at q*, agent i commands u = q*' - w_i, relative to a medium at w_i. With n = z / |z|, its constraint against a
vehicle at distance d is n . u >= w (p - gamma (d^2 - D^2) / (2 d)), see `mjsheaf.law.safety`. It holds from

    d = (s + sqrt(s^2 + gamma^2 D^2)) / gamma,    s = p - n . u / w,

where p bounds the speed at which the other vehicle and the media close in, and w is the agent's weight: 1 towards what
does not cooperate. s is the closing speed that the filter has to expect. It is p for an agent that commands nothing. An
agent that holds its place downwind of another vehicle, or follows it, commands a velocity towards it: the filter does
not count on the other vehicle to keep going, so s is larger. To come as near as d takes gamma = 2 d s / (d^2 - D^2).

If a constraint does not hold at q*, the filter replaces the command there, and q* is no equilibrium of the team.
"""

from typing import NamedTuple

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from mjsheaf.arrays import Array, IntArray
from mjsheaf.io.section import Finite, Record
from mjsheaf.law.obstacles import distances, nearest_points
from mjsheaf.law.safety import SafetyArrays
from mjsheaf.system import System

MOSTLY = 0.5
"""Fraction of the samples above which a formation cannot be reached."""

_MOST_PAIRS = 200  # maximum number of pairs in a record
_MOST_TIMES = 100  # maximum number of samples
_MOST_COMPARED = 4_000_000  # pairs times samples, about
_ROUNDING = 1e-9  # tolerance of a distance, m, and of a speed, m/s
_SMALLEST = 1e-6  # horizontal part of a direction below which a planar agent cannot act along it


class Standoff(Record):
    """An agent that the filter keeps farther away than its place in q*, which is not closer than the distance itself.

    Distances are those at the sample that takes the highest rate.
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


class _Constraints(NamedTuple):
    """Constraints of agents in their places, at one sample.

    Attributes:
        agent, other: Number of the agent, and of the vehicle, or of the obstacle after the vehicles.
        away: Distance in q*, m.
        keep, least: Distance to keep, with and without margins, m.
        closing: s, m/s.
    """

    agent: IntArray
    other: IntArray
    away: Array
    keep: Array
    least: Array
    closing: Array


def standoffs(
    system: System, safety: SafetyArrays, least: SafetyArrays, names: list[str], times: Array, places: Array
) -> list[Standoff]:
    """List the pairs whose places do not fit, those that take the highest rate first.

    Args:
        system: System whose q* is known over its run.
        safety: Arrays of the filter, with margins or without.
        least: The same without margins. Places that are closer than that are unsafe, and not listed here.
        names: Ids of vehicles and obstacles.
        times: Sample times, shape (T,), s.
        places: Places in q*, and those of the targets, in space, shape (T, V, 3), m.
    """
    T, V = places.shape[:2]
    velocity = np.gradient(places, times, axis=0) if T > 1 else np.zeros_like(places)
    count = min(T, _MOST_TIMES, max(2, _MOST_COMPARED // V**2))
    rows = np.unique(np.linspace(0, T - 1, count).astype(np.int64))
    each = [_constraints(system, safety, least, times[k], places[k], velocity[k]) for k in rows]
    sample = np.repeat(rows, [len(found.agent) for found in each])
    c = _Constraints._make(np.concatenate(parts) for parts in zip(*each, strict=True))
    gamma, room = safety.rate, c.away**2 - c.keep**2
    misfit = (c.closing > gamma * room / (2.0 * c.away) + _ROUNDING) & (c.away >= c.least - _ROUNDING)
    if not misfit.any():
        return []
    c = _Constraints._make(part[misfit] for part in c)
    sample = sample[misfit]
    room = room[misfit]
    kept = np.minimum((c.closing + np.hypot(c.closing, gamma * c.keep)) / gamma, safety.reach)
    rate = np.divide(2.0 * c.away * c.closing, room, out=np.full(len(room), np.inf), where=room > 0.0)
    if not system.grid.continuous:
        rate[rate * system.grid.period > 1.0] = np.inf
    order = np.lexsort((c.away - kept, -rate))
    keys = c.agent * len(names) + c.other
    _, first, shares = np.unique(keys[order], return_index=True, return_counts=True)
    return [
        Standoff(
            pair=[names[c.agent[k]], names[c.other[k]]],
            time=times[sample[k]],
            desired=c.away[k],
            kept=kept[k],
            rate=rate[k],
            fraction=share / len(rows),
        )
        for k, share in sorted(zip(order[first], shares, strict=True), key=lambda row: (-rate[row[0]], row[0]))
    ][:_MOST_PAIRS]


def _constraints(
    system: System, safety: SafetyArrays, least: SafetyArrays, time: float, places: Array, velocity: Array
) -> _Constraints:
    """Return the constraints of all agents within range of something, at places and velocities (V, 3)."""
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
    acts = safety.yields[agent_of] & (away > 0.0) & (np.linalg.norm(z, axis=1) > _SMALLEST * away)
    towards = np.einsum("pi,pi->p", z[acts], command[agent_of[acts]]) / away[acts]

    def distance_of(arrays: SafetyArrays) -> Array:
        pair = arrays.radius[agent] + arrays.radius[other]
        return np.concatenate([pair, arrays.clearance[near]])[acts]

    return _Constraints(
        agent=agent_of[acts],
        other=other_of[acts],
        away=away[acts],
        keep=distance_of(safety),
        least=distance_of(least),
        closing=parting[acts] - towards / weight[acts],
    )
