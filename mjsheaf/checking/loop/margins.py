"""Effects outside the theory: sampling, the loop of the real vehicles, speed limits."""

import math
from dataclasses import replace

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.body_loop import BodyLoop, loop_on_path, medium_on_path
from mjsheaf.checking.spectrum import Spectrum
from mjsheaf.checking.theorem.certificate import Certificate
from mjsheaf.checking.theorem.constants import velocities_along
from mjsheaf.checking.theorem.targets import Carrier, follow_targets
from mjsheaf.law.law import disagreement
from mjsheaf.loop.system import System
from mjsheaf.media.medium import mean_flow
from mjsheaf.section import Finite, Record
from mjsheaf.vehicles.effects import (
    authority_of,
    describe_consequences,
    largest_wind,
    may_lack,
    shortfalls_of,
)
from mjsheaf.vehicles.vehicle import kinds_of

MOST_ROWS = 20
"""Largest number of agents that are listed with their speeds."""


class HoldMargin(Record):
    """A law held over a period h, on ideal kinematics: the factor of each mode over a period is 1 - k1 h lambda."""

    period: float = Field(description="h, s")
    product: float = Field(description="k1 h lambda_max: below 2 it converges, up to 1 it does not ring")
    largest_gain: float | None = Field(description="2 / (h lambda_max), 1/s; null if H = 0 or a mode grows")
    ringing_gain: float | None = Field(
        description="1 / (h lambda_max): above it the fastest mode changes sign at each sample, 1/s; null if H = 0 "
        "or a mode grows"
    )


class BodyMargins(BodyLoop):
    """The loop of the real vehicles, and their time constants."""

    tau: list[float] = Field(description="smallest and largest m / D of the agents, s")


class SpeedDemand(Record):
    """Required and possible speed of an agent, m/s."""

    agent: str
    asked: float = Field(description="speed commanded by the law at the start, k1 |eta_i|")
    limit: Finite = Field(description="velocity limit of the law; null without one")
    steady: Finite = Field(description="largest |q*'_i - f_i(q*)| along the run; null if a field is singular")
    able: Finite = Field(
        description="all-way speed; steady speed of its body through the medium in the horizontal direction in which "
        "it is slowest; null: unlimited thrusters"
    )
    deficit: Finite = Field(
        description="smallest distance behind q* over the last quarter of the time, m, for an agent that begins on q* "
        "and moves towards it at the smaller of `limit` and its top speed; null if `steady` is"
    )
    able_forward: Finite = Field(
        description="forward speed; steady speed of its body through the medium at full thrust forward; null: "
        "unlimited thrusters"
    )
    able_fastest: Finite = Field(
        description="top speed; steady speed of its body through the medium in the horizontal direction in which it is "
        "fastest; null: unlimited thrusters"
    )

    @property
    def top_speed(self) -> float:
        """Top speed of its vehicle, m/s; infinite if its thrusters have no limits."""
        return math.inf if self.able_fastest is None else self.able_fastest

    @property
    def limited(self) -> bool:
        """True if its velocity limit is below the top speed of its vehicle."""
        return self.limit is not None and self.limit < self.top_speed

    @property
    def largest(self) -> float:
        """The smaller one of its velocity limit and the top speed of its vehicle, m/s."""
        return self.top_speed if self.limit is None else min(self.limit, self.top_speed)


class OneSided(Record):
    """Agents whose vehicle has no thrust, or little, in some directions."""

    agents: list[str] = Field(description="ids")
    vehicle: str = Field(description="name of their vehicle")
    lacking: list[str] = Field(description="directions in which it cannot push while it does nothing else")
    meaning: str = Field(description="consequence")


class Margins(Record):
    """Margins of effects outside the theory."""

    hold: HoldMargin | None = Field(description="null if the law is continuous, or H is not symmetric")
    bodies: BodyMargins
    speed: list[SpeedDemand] = Field(description=f"the most demanding agents first, at most {MOST_ROWS}")
    one_sided: list[OneSided] = Field([], description="vehicles whose thrusters do not push both ways")
    slow_targets: dict[str, tuple[float, float]] = Field(
        {}, description="targets whose vehicles cannot follow their path: required speed, and top speed, m/s"
    )
    wind: dict[str, tuple[float, Finite]] = Field(
        {},
        description="agents on which wind acts: mean wind above them, relative to their places, and the largest wind "
        "from there in which actuators and velocity limit hold them, m/s; null: not known, or above 200 m/s",
    )
    turning: list[str] = Field([], description="boats that turn to where they are commanded, at a hand point: ids")
    falling: dict[str, str] = Field(
        {}, description="agents whose vehicle turns over and falls once it leans to its limit: why, with numbers"
    )


def margins(system: System, certificate: Certificate) -> Margins:
    """Compute all margins of a system."""
    agents = system.vehicles[: len(system.team.agents)]
    kinds, _ = kinds_of(agents)
    tau = [float(vehicle.reduced_model().tau.max()) for vehicle in kinds]
    falling = dict[str, str]()
    one_sided = []
    for vehicle in kinds:
        ids = [agent.id for agent, own in zip(system.team.agents, agents, strict=True) if own is vehicle]
        falling |= {id: one.sentence for one in reversed(shortfalls_of(vehicle)) if one.falls for id in ids}
        if may_lack(vehicle) and (authority := authority_of(vehicle)).lacking:
            meaning = describe_consequences(vehicle, authority)
            one_sided.append(
                OneSided(agents=ids, vehicle=vehicle.name, lacking=list(authority.lacking), meaning=meaning)
            )
    return Margins(
        hold=hold_margin(system, certificate.spectrum),
        bodies=BodyMargins(tau=[min(tau), max(tau)], **dict(loop_on_path(system, certificate))),
        speed=_speed_demands(system, certificate),
        one_sided=one_sided,
        slow_targets=_slow_targets(system, certificate),
        wind=_wind_margins(system, certificate),
        turning=[agent.id for agent, own in zip(system.team.agents, agents, strict=True) if own.steering.hand > 0.0],
        falling=falling,
    )


def _wind_margins(system: System, certificate: Certificate) -> dict[str, tuple[float, float]]:
    """Return the wind above each agent on which it acts, and the largest in which it holds station, m/s."""
    found, windy = {}, np.flatnonzero(system.mean_wind[: len(system.team.agents)].any(axis=1)).tolist()
    current = np.nan_to_num(medium_on_path(system, certificate.constants.path)) if windy else np.zeros(0)
    for i in windy:
        wind, heading, limit = (
            system.mean_wind[i] + current[i],
            float(system.bodies.heading[i]),
            float(system.law.limit[i]),
        )
        found[system.team.agents[i].id] = (
            float(np.linalg.norm(wind)),
            largest_wind(system.vehicles[i], heading, current[i], wind, limit),
        )
    return found


def _slow_targets(system: System, certificate: Certificate) -> dict[str, tuple[float, float]]:
    """Return the targets that are pulled to a path, and whose vehicles are too slow for it in the last quarter."""
    path, N = certificate.constants.path, len(system.team.agents)
    held = system.motion.pull[N:] > 0.0
    if path.cells is None or not held.any() or len(path.time) < 3:
        return {}
    along = np.gradient(path.positions[:, N:], path.time, axis=0)
    flow = np.array([mean_flow(system.medium, v, 0.0, path.positions[:, v]) for v in range(N, N + len(held))])
    top = np.array([vehicle.capability.top_speed for vehicle in system.vehicles[N:]])
    taken = np.linalg.norm(np.where(np.isfinite(flow), along.transpose(1, 0, 2) - flow, 0.0), axis=2)
    late = path.time >= path.time[0] + 0.75 * (path.time[-1] - path.time[0])
    return {
        system.team.target_ids[k]: (float(taken[k, late].mean()), float(top[k]))
        for k in np.flatnonzero(held & (taken[:, late].mean(axis=1) > top)).tolist()
    }


def hold_margin(system: System, spectrum: Spectrum) -> HoldMargin | None:
    """Compute the margin of the held law; None if the law is continuous or H is not symmetric."""
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


def _speed_demands(system: System, certificate: Certificate) -> list[SpeedDemand]:
    """Compute the required speeds of agents, at the start or along q*, the largest fraction of their limit first."""
    team = system.team
    agents = system.vehicles[: len(team.agents)]
    able = [vehicle.capability for vehicle in agents]
    top = np.array([one.top_speed for one in able])
    path = certificate.constants.path
    difference = certificate.constants.difference
    relative = difference.values + difference.shaken  # f_B + H^-1 B omega
    if path.cells is None and not np.isfinite(system.moving_bounds.speed).all():
        # The path of targets in gusts is not known; the path without gusts is used.
        calm = replace(system, flows=[flow.model_copy(update={"gusts": None}) for flow in system.flows])
        carrier = Carrier(calm)
        path = follow_targets(calm, carrier)
        above, own, shaken = velocities_along(calm, path, carrier)
        relative = above - own + shaken if path.cells is not None else np.full_like(above, np.nan)
    time, carried = path.time, team.unpack(relative)  # f_q(q*) - q*' there, shape (T, N, 3), m/s
    steady = np.linalg.norm(carried, axis=2).max(axis=0)
    behind = _behind(time, carried, np.minimum(system.law.limit[: len(team.agents)], top))
    deficit = behind[time >= time[0] + 0.75 * (time[-1] - time[0])].min(axis=0)
    asked = system.gain * np.linalg.norm(disagreement(system.law, system.initial)[: len(team.agents)], axis=1)
    limits = system.law.limit[: len(asked)]
    demanded = np.fmax(asked, steady)  # a singular field leaves no steady speed
    order = np.argsort(-demanded / np.where(np.isfinite(limits), limits, 1e300), kind="stable")[:MOST_ROWS]
    return [
        SpeedDemand(
            agent=team.agents[i].id,
            asked=asked[i],
            limit=limits[i],
            steady=steady[i],
            able=able[i].least_speed,
            deficit=deficit[i],
            able_forward=able[i].forward_speed,
            able_fastest=able[i].top_speed,
        )
        for i in order.tolist()
    ]


def _behind(time: Array, carried: Array, top: Array) -> Array:
    """Compute the distance of agents behind q* that move straight towards it, each at most at its top speed.

    They begin on q*. The flow at an agent is taken to be that at its place: e' = u + f_q(q*) - q*' with |u| <= top.

    Args:
        time: Instants, shape (T,), s.
        carried: f_q(q*) - q*' there, shape (T, N, 3), m/s.
        top: Top speeds, shape (N,), m/s.

    Returns:
        Distances, shape (T, N), m; 0 for agents that are as fast as q* throughout, NaN once the field is singular.
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
