"""Effects outside the theory: sampling, inertia, the loop of the real vehicles, speed limits, lag."""

from dataclasses import replace

import numpy as np
from pydantic import Field
from scipy import linalg

from mjsheaf.arrays import Array
from mjsheaf.checking.authority import authority_of, describe_consequences, may_lack, shortfalls_of
from mjsheaf.checking.loop.body_loop import BodyLoop, held_modes, loop_on_path
from mjsheaf.checking.spectrum import Spectrum
from mjsheaf.checking.theorem.certificate import Certificate
from mjsheaf.checking.theorem.constants import Difference, velocities_along
from mjsheaf.checking.theorem.targets import Carrier, follow_targets
from mjsheaf.io.norms import PER_AGENT_RMS, Norm
from mjsheaf.io.section import Finite, Record
from mjsheaf.law import disagreement
from mjsheaf.media.probe import mean_flow
from mjsheaf.system import System
from mjsheaf.vehicles.effects import capability_of, of_each
from mjsheaf.vehicles.vehicle import Vehicle

LARGEST_SECOND_ORDER = 600
"""Largest n_q for which eigenvalues of the second-order system of unlike bodies are computed."""

MOST_ROWS = 20
"""How many agents are listed with their speeds and lags."""

_FEWEST_INSTANTS = 3  # of a path whose velocity is known
_POSITION_AT_REST = 1e-6  # share of z, against tau v, under which z is at rest
_MOST_LAG_NUMBERS = 1_000_000  # of lags that are solved for


class HoldMargin(Record):
    """A law held over a period h, on ideal kinematics: q grows by (1 - k1 h lambda) in each mode."""

    period: float = Field(description="h, s")
    product: float = Field(description="k1 h lambda_max: below 2 it converges, up to 1 it does not ring")
    largest_gain: float | None = Field(description="2 / (h lambda_max), 1/s; null where H = 0 or a mode grows")
    ringing_gain: float | None = Field(
        description="1 / (h lambda_max): beyond it the fastest mode changes sign at each sample, 1/s; null where H = 0 "
        "or a mode grows"
    )


class Inertia(Record):
    """Inertia alone: tau q'' + q' = u with tau = m / D; what is free does not enter.

    Of unlike bodies the damping is -Re s / |s| of the root s of the second-order system, 1 where that is real; of over
    LARGEST_SECOND_ORDER states a lower bound of the damping ratio of all modes, twice.
    """

    tau: list[float] = Field(description="smallest and largest m / D of the agents, s")
    damping_slowest: Finite = Field(
        description="ratio of the slowest mode, by inertia alone; null: none, or H is asymmetric"
    )
    damping_fastest: Finite = Field(
        description="ratio of the fastest mode, by inertia alone; null: none, or H is asymmetric"
    )


class BodyMargins(BodyLoop, Inertia):
    """Inertia alone, and the loop of the real vehicles."""


class SpeedDemand(Record):
    """Required and possible speed of an agent, m/s."""

    agent: str
    asked: float = Field(description="by the law at the start, k1 |eta_i|")
    limit: Finite = Field(description="that the law keeps; null without one")
    steady: Finite = Field(description="largest |q*'_i - f_i(q*)| along the run; null where a field is singular")
    able: Finite = Field(
        description="all-way speed: steady speed of its body through the medium in the horizontal direction in which "
        "it is slowest; null: unlimited thrusters"
    )
    deficit: Finite = Field(
        description="smallest distance behind q* over the last quarter of the time, of an agent that begins on q* and "
        "heads for it at `limit` or its top speed, the smaller one, m; null where `steady` is"
    )
    able_forward: Finite = Field(
        description="forward speed: steady speed of its body through the medium at full thrust forward; null: "
        "unlimited thrusters"
    )


class Lag(Record):
    """The largest quasi-static lag |(H^-1 f_B)_i| / k1 of an agent along the run: k1 H e = f_B once e' is small."""

    agent: str
    lag: Finite = Field(description="m; null where a field is singular")
    norm: Norm = Field(PER_AGENT_RMS, description="which norm `lag` is: of this agent alone")


class OneSided(Record):
    """Agents whose vehicle cannot push in some directions, or hardly."""

    agents: list[str] = Field(description="ids")
    vehicle: str = Field(description="name of their vehicle")
    lacking: list[str] = Field(description="directions in which it cannot push while it does nothing else")
    meaning: str = Field(description="what follows")


class Margins(Record):
    """Margins of effects outside the theory."""

    hold: HoldMargin | None = Field(description="null where the law is continuous, or H is not symmetric")
    bodies: BodyMargins
    speed: list[SpeedDemand] = Field(description=f"the most demanding agents first, at most {MOST_ROWS}")
    lag: list[Lag] = Field(description=f"the largest first, at most {MOST_ROWS}")
    one_sided: list[OneSided] = Field([], description="vehicles whose thrusters do not push both ways")
    slow_targets: dict[str, tuple[float, float]] = Field(
        {}, description="targets whose vehicles cannot keep to their path: speed that it takes, and top speed, m/s"
    )
    falling: dict[str, str] = Field(
        {}, description="agents whose vehicle turns over and falls once it leans to its limit: why, with numbers"
    )


def margins(system: System, certificate: Certificate) -> Margins:
    """All margins of a system."""
    spectrum, difference = certificate.spectrum, certificate.constants.difference
    agents = system.vehicles[: len(system.team.agents)]
    inertia = body_margin(system, spectrum, of_each(agents, lambda vehicle: float(vehicle.reduced_model().tau.max())))
    loop = loop_on_path(system, certificate)
    able = of_each(agents, lambda vehicle: capability_of(vehicle).least_speed)
    forward = of_each(agents, lambda vehicle: capability_of(vehicle).forward_speed)
    return Margins(
        hold=hold_margin(system, spectrum),
        bodies=BodyMargins(**dict(inertia), **dict(loop)),
        speed=_speed_demands(system, certificate, able, forward),
        lag=_lags(system, difference),
        one_sided=_one_sided(system),
        slow_targets=_slow_targets(system, certificate),
        falling=_falling(system),
    )


def _slow_targets(system: System, certificate: Certificate) -> dict[str, tuple[float, float]]:
    """Return the targets that are pulled to a path, and whose vehicles are too slow for it in the last quarter."""
    path, N = certificate.constants.path, len(system.team.agents)
    held = system.motion.pull[N:] > 0.0
    if path.cells is None or not held.any() or len(path.time) < _FEWEST_INSTANTS:
        return {}
    along = np.gradient(path.positions[:, N:], path.time, axis=0)
    flow = np.array([mean_flow(system, v, 0.0, path.positions[:, v]) for v in range(N, N + len(held))])
    top = of_each(system.vehicles[N:], _top_speed)
    taken = np.linalg.norm(np.where(np.isfinite(flow), along.transpose(1, 0, 2) - flow, 0.0), axis=2)
    late = path.time >= path.time[0] + 0.75 * (path.time[-1] - path.time[0])
    slow = held & (taken[:, late].mean(axis=1) > top)
    return {
        system.team.target_ids[k]: (float(taken[k, late].mean()), float(top[k])) for k in np.flatnonzero(slow).tolist()
    }


def _top_speed(vehicle: Vehicle) -> float:
    """Return the larger of a vehicle's forward and all-way speeds, m/s."""
    able = capability_of(vehicle)
    return max(able.forward_speed, able.least_speed)


def _falling(system: System) -> dict[str, str]:
    """Say why a vehicle turns over and falls once it leans to its limit, for each agent that has such a vehicle."""
    agents = system.team.agents
    kinds = {id(vehicle): shortfalls_of(vehicle) for vehicle in system.vehicles[: len(agents)]}
    lacking = {key: [one.sentence for one in found if one.falls] for key, found in kinds.items()}
    return {
        agent.id: lacking[id(vehicle)][0]
        for agent, vehicle in zip(agents, system.vehicles, strict=False)
        if lacking[id(vehicle)]
    }


def _one_sided(system: System) -> list[OneSided]:
    """Kinds of vehicles whose thrusters do not push both ways, with their agents."""
    agents = system.team.agents
    kinds = {id(vehicle): vehicle for vehicle in system.vehicles[: len(agents)] if may_lack(vehicle)}
    found = []
    for key, vehicle in kinds.items():
        authority = authority_of(vehicle)
        if authority.lacking:
            ids = [agent.id for agent, own in zip(agents, system.vehicles, strict=False) if id(own) == key]
            meaning = describe_consequences(vehicle, authority)
            found.append(OneSided(agents=ids, vehicle=vehicle.name, lacking=list(authority.lacking), meaning=meaning))
    return found


def hold_margin(system: System, spectrum: Spectrum) -> HoldMargin | None:
    """The margin of the held law, or None where the law is continuous or H is not symmetric."""
    if system.grid.continuous or not system.team.symmetric:
        return None
    h = system.grid.period
    decays = spectrum.lambda_max > 0.0 and (spectrum.smallest > 0.0).all()
    ringing = 1.0 / (h * spectrum.lambda_max) if decays else None
    return HoldMargin(
        period=h,
        product=system.gain * h * spectrum.lambda_max,
        largest_gain=None if ringing is None else 2.0 * ringing,
        ringing_gain=ringing,
    )


def body_margin(system: System, spectrum: Spectrum, tau: Array) -> Inertia:
    """The damping that inertia alone leaves, 1 / (2 sqrt(k1 lambda tau)) where all bodies are alike.

    `tau` is the time constant m / D of each agent along its most sluggish controlled axis, shape (N,), s.
    """
    k, low, high = system.gain, float(tau.min()), float(tau.max())
    if not (spectrum.smallest > 0.0).all() or not spectrum.smallest.size or not system.team.symmetric:  # none is known
        damping = np.array([np.inf])
    elif high - low <= 1e-9 * high:
        damping = 1.0 / (2.0 * np.sqrt(k * np.array([spectrum.smallest[0], spectrum.lambda_max]) * low))
    elif system.team.dirichlet.H.shape[0] > LARGEST_SECOND_ORDER:
        damping = 1.0 / (2.0 * np.sqrt(k * np.array([spectrum.lambda_max]) * high))
    else:
        damping = _damping_of_unlike(system, spectrum, tau)
    return Inertia(tau=[low, high], damping_slowest=damping[0], damping_fastest=damping[-1])


def _damping_of_unlike(system: System, spectrum: Spectrum, tau: Array) -> Array:
    """The damping of every mode by inertia alone, the slowest first."""
    each = np.concatenate([np.full(a.dimension, t) for a, t in zip(system.team.agents, tau, strict=True)])
    modes, Q = held_modes(system, spectrum)
    m = len(modes)
    swing = np.block([[np.zeros((m, m)), Q.T], [-system.gain / each[:, None] * Q * modes, -np.diag(1.0 / each)]])
    values, vectors = linalg.eig(swing)  # on (z, v): z the held coordinates, v all velocities
    z, v = np.linalg.norm(vectors[:m], axis=0), np.linalg.norm(vectors[m:], axis=0)
    roots = values[z > _POSITION_AT_REST * tau.min() * v]  # the others coast along what is free
    return np.asarray((-roots.real / np.abs(roots))[np.argsort(np.abs(roots))])


def _speed_demands(system: System, certificate: Certificate, able: Array, forward: Array) -> list[SpeedDemand]:
    """Compute the required speeds of agents, at the start or along q*, the largest fraction of their limit first."""
    team = system.team
    time, carried = _carried_along(system, certificate)
    along = np.linalg.norm(carried, axis=2)
    steady = along.max(axis=0)
    behind = _behind(time, carried, np.minimum(system.law.limit[: len(team.agents)], np.maximum(able, forward)))
    deficit = behind[time >= time[0] + 0.75 * (time[-1] - time[0])].min(axis=0)
    asked = system.gain * np.linalg.norm(disagreement(system.law, system.initial)[: len(team.agents)], axis=1)
    limits = system.law.limit[: len(asked)]
    most = np.fmax(asked, steady)  # a singular field leaves no steady speed
    order = np.argsort(-most / np.where(np.isfinite(limits), limits, 1e300), kind="stable")[:MOST_ROWS]
    return [
        SpeedDemand(
            agent=team.agents[i].id,
            asked=asked[i],
            limit=limits[i],
            steady=steady[i],
            able=able[i],
            deficit=deficit[i],
            able_forward=forward[i],
        )
        for i in order.tolist()
    ]


def _behind(time: Array, carried: Array, top: Array) -> Array:
    """Compute how far agents fall behind q* that head straight for it, each at most at its top speed.

    They begin on q*. The medium is as fast about an agent as about its place: e' = u + f_q(q*) - q*' with |u| <= top.

    Args:
        time: Instants, shape (T,), s.
        carried: f_q(q*) - q*' there, shape (T, N, 3), m/s.
        top: Top speeds, shape (N,), m/s.

    Returns:
        Distances, shape (T, N), m; 0 of those that are as fast as q* throughout, NaN from where the field is singular.
    """
    behind = np.zeros(carried.shape[:2])
    slow = np.flatnonzero(~(np.linalg.norm(carried, axis=2).max(axis=0) <= top))
    e = np.zeros((len(slow), 3))
    for k, dt in enumerate(np.diff(time) if len(slow) else ()):
        e += carried[k + 1, slow] * dt
        distance = np.linalg.norm(e, axis=1)
        behind[k + 1, slow] = left = np.maximum(distance - top[slow] * dt, 0.0)
        e *= (left / np.maximum(distance, 1e-300))[:, None]
    return behind


def _carried_along(system: System, certificate: Certificate) -> tuple[Array, Array]:
    """Return instants of the path, shape (T,), s, and the velocities f_q(q*) - q*' there, shape (T, N, 3), m/s.

    Targets that meet gusts have no certain path. Theirs is the one without gusts.
    """
    constants = certificate.constants
    path = constants.path
    relative = constants.difference.values + constants.difference.shaken  # f_B + H^-1 B omega
    if path.cells is None and not np.isfinite(system.moving_bounds.speed).all():
        calm = replace(system, flows=[flow.model_copy(update={"gusts": None}) for flow in system.flows])
        carrier = Carrier(calm, certificate.spectrum)
        path = follow_targets(calm, carrier)
        carried, own, shaken = velocities_along(calm, path, carrier)
        relative = carried - own + shaken if path.cells is not None else np.full_like(carried, np.nan)
    return path.time, system.team.unpack(relative)


def _lags(system: System, difference: Difference) -> list[Lag]:
    """The largest lags of agents along the run, in order."""
    problem, f_B = system.team.dirichlet, difference.values
    lag = np.full(len(system.team.agents), np.nan)
    if np.isfinite(f_B).all() and system.team.symmetric:
        few = max(20, _MOST_LAG_NUMBERS // f_B.shape[1])  # an estimate: some of the instants do where H is large
        solved = problem.solve(f_B[:: -(-len(f_B) // few)]) / system.gain
        lag = np.linalg.norm(system.team.unpack(solved), axis=2).max(axis=0)
    order = np.argsort(-lag, kind="stable")[:MOST_ROWS]
    return [Lag(agent=system.team.agents[i].id, lag=lag[i]) for i in order.tolist()]
