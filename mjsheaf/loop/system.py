"""The closed-loop system that both backends turn into trajectories: team, law, flow, motions and disturbances."""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from mjsheaf.arguments import require_scenario
from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.errors import InputError, in_field
from mjsheaf.law.law import ControlArrays, LawArrays, Station, edges_of, no_station
from mjsheaf.law.obstacles import ObstacleArrays
from mjsheaf.law.paths import PARTS, MotionArrays, position_at, reference_bounds
from mjsheaf.law.safety import Safety, SafetyArrays, pack_safety
from mjsheaf.media import varying
from mjsheaf.media.flow import AXIS, CENTRE, NO_FLOW, FlowField
from mjsheaf.media.medium import (
    MediumArrays,
    Parts,
    WindArrays,
    bounds_of,
    mean_flow,
    pack_medium,
    pack_parts,
)
from mjsheaf.media.varying import Bounds, Exposure
from mjsheaf.team.team import Team, describe_null_modes
from mjsheaf.vehicles.allocation import EffectivenessArrays
from mjsheaf.vehicles.effects import Effects, embody, hold_station
from mjsheaf.vehicles.vehicle import Vehicle, kinds_of

if TYPE_CHECKING:
    from mjsheaf.scenario import Scenario


@dataclass(frozen=True)
class TimeGrid:
    """Sample times.

    Attributes:
        start: Time of the initial condition, s.
        period: Time between samples, s.
        steps: Number of periods.
        continuous: True if the law is also evaluated between samples (control period 0) instead of being held.
    """

    start: float
    period: float
    steps: int
    continuous: bool

    @property
    def samples(self) -> Array:
        """Sample times, shape (steps + 1,), s."""
        return self.span(0, self.steps + 1)

    def span(self, first: int, end: int) -> Array:
        """Times of the samples from `first` up to but without `end`, shape (end - first,), s."""
        return np.asarray(self.start + self.period * np.arange(first, end), dtype=np.float64)


_MOST_EIGENVALUES = 600  # of a matrix whose eigenvalues are all found
_STOP = 0.01  # s; resolution of the responses of vehicles under a continuous law

STILL = "still"
"""Name of the flow field at rest."""

DEFAULT_VEHICLE = {2: "hull", 3: "aerial"}
"""Vehicle of an agent or target of each dimension unless the scenario names another; it takes any effects and tau."""


@dataclass(frozen=True, eq=False)
class PhysicsOptions:
    """Options of the physics backend; the ideal backend ignores them.

    Attributes:
        vehicle: Name of each vehicle's description in models/, or path of a description file, length V.
        time_constant: Time constant that replaces that of every vehicle, s; or None.
        effects: Names of the effects that are on.
        heading: Initial heading of each vehicle, shape (V,), rad.
        timestep: Physics step, s.
        contacts: True if vehicles collide.
        surface: 'water', 'ground' or 'none'; drawn, and the level at which floating vehicles float.
        surface_height: Height of the surface, m.
        engine: Engine that moves the bodies: 'mujoco' or 'fused'; see `mjsheaf.loop.fused`.
        threads: Maximum number of threads of the fused engine.
        stopping_times: Function that computes how long vehicles take to stop, as `mjsheaf.loop.linear.stopping_times`.
        compiled: Vehicles as their files describe them by (name,), and as they are simulated by (name, time constant,
            effects); made on first use and shared by all copies and seeds.
    """

    vehicle: list[str]
    time_constant: float | None
    effects: Effects
    heading: Array
    timestep: float
    contacts: bool
    surface: str
    surface_height: float
    stopping_times: Callable[..., list[float]]
    engine: str = "mujoco"
    threads: int = 1
    compiled: dict[tuple[Any, ...], Vehicle] = field(default_factory=dict, repr=False)

    def refuse_contacts(self) -> None:
        """Refuse contacts on an engine that has none.

        Raises:
            InputError: naming the field.
        """
        if self.contacts and self.engine == "fused":
            raise InputError(
                "physics.contacts: is true, and the fused engine has none; expected false, as with --set "
                "physics.contacts=false, or the engine mujoco"
            )


@dataclass(frozen=True, eq=False)
class System:
    """A team under the law, ready to be integrated.

    Attributes:
        name: Name of the scenario.
        team: Agents, targets and the sheaf.
        initial: Initial positions, padded, shape (V, 3), m; planar vehicles have z = 0.
        grid: Sample times.
        gain: Proportional gain k1, 1/s.
        law, motion, effectiveness: Packed parts.
        harmonics: Harmonics of the disturbances, shape (V, K, 5).
        flows: Flow fields.
        flow_names: Name of each flow field, as video and page show it.
        field: Index of the flow field at each vehicle, shape (V,).
        tolerance: Relative and absolute tolerance of the ideal backend's integrator for each step.
        bodies: Options of the physics backend.
        stopped: True for each vehicle whose thrusters have stopped, shape (V,); None if all of them run.
        waiting: Station of the vehicles that hold their position: agents until they join, and fixed targets; None if
            there are none.
        seed: Seed of gusts and waves.
        safety: Fields of the safety filter; None without one.
        earlier_medium: Bound on the medium's speed around each vehicle in earlier phases, shape (V,), m/s; 0 if there
            are none.
        unlimited: True to limit no command; the safety filter stays that of the velocity limits.
    """

    name: str
    team: Team
    initial: Array
    grid: TimeGrid
    gain: float
    law: LawArrays
    motion: MotionArrays
    harmonics: Array
    effectiveness: EffectivenessArrays
    flows: list[FlowField]
    flow_names: tuple[str, ...]
    field: IntArray
    tolerance: tuple[float, float]
    bodies: PhysicsOptions
    stopped: BoolArray | None = None
    waiting: Station | None = None
    seed: int = 0
    safety: Safety | None = None
    earlier_medium: Array | float = 0.0
    unlimited: bool = False

    def described_vehicle(self, name: str) -> Vehicle:
        """Return a vehicle as its files describe it; they are compiled once for a system and all copies of it.

        Raises:
            InputError: The vehicle is unknown, or its files are not valid.
        """
        known = self.bodies.compiled
        if (name,) not in known:
            from mjsheaf.vehicles.loading import load_vehicle  # imports MuJoCo, which ideal kinematics can do without

            known.setdefault((name,), load_vehicle(name))
        return known[name,]

    @cached_property
    def vehicles(self) -> list[Vehicle]:
        """Return the vehicle of every agent and target, in order, with the configured effects and time constant.

        Raises:
            InputError: A vehicle is unknown, its files are not valid, or it does not fit the dimension of its agent or
                target; the message begins with the field.
        """
        plan, vehicles = self.bodies, []
        for v, (member, name) in enumerate(zip(self.team.members, plan.vehicle, strict=True)):
            with in_field(f"{'agents' if v < len(self.team.agents) else 'targets'}.{member.id}.vehicle"):
                key = name, plan.time_constant, plan.effects
                if key not in plan.compiled:
                    own = self.described_vehicle(name).with_time_constant(plan.time_constant)
                    plan.compiled.setdefault(key, embody(own, plan.effects))  # several threads may be here
                vehicle = plan.compiled[key]
                if vehicle.dimension != member.dimension:
                    raise InputError(
                        f"{name!r} moves in {vehicle.dimension} dimensions, but {member.id} has {member.dimension}; "
                        "see mjsheaf list --vehicles"
                    )
                if not vehicle.actuators and v < len(self.team.agents):
                    raise InputError(f"{name!r} has no thrusters and cannot be an agent; expected it on a target")
                if not vehicle.actuators and (self.motion.path[v, 1] > 0 or self.motion.amplitude[v].any()):
                    raise InputError(
                        f"{name!r} has no thrusters and cannot follow a path; expected a target with motion adrift, or "
                        "with none, which drifts"
                    )
                if not vehicle.actuators and self.waiting is not None and bool(self.waiting.holds[v]):
                    raise InputError(
                        f"{name!r} has no thrusters and cannot stay where it is; expected a target with motion adrift"
                    )
            vehicles.append(vehicle)
        return vehicles

    @cached_property
    def steps_per_sample(self) -> int:
        """Physics steps between samples.

        Raises:
            InputError: The timestep does not divide the period.
        """
        return whole_ratio(self.grid.period, self.bodies.timestep)

    @cached_property
    def timestep(self) -> float:
        """The physics step that divides a period exactly, s: sample times then agree with the ideal backend's."""
        return self.grid.period / self.steps_per_sample

    @cached_property
    def local(self) -> "System":
        """The system near q* of its initial positions: the team linearised there; itself if all edges are linear."""
        if self.team.linear and not self.team.free:
            return self
        team = self.team.remaining.linearised_about(self.remaining.initial)
        return replace(self.remaining, team=team, law=self.remaining.law._replace(edges=edges_of(team)))

    @cached_property
    def free_directions(self) -> list[str]:
        """Directions in which q* of the present agents is free, in words; of a team without targets none."""
        team = self.team.remaining
        return [] if team.free else describe_null_modes(team if team.plain else self.local.team)  # linearised near q*

    @cached_property
    def control(self) -> ControlArrays:
        """The law and the references for compiled code."""
        return ControlArrays(self._completed(self.law, np.zeros(len(self.planar))), self.motion)

    @cached_property
    def control_of_bodies(self) -> ControlArrays:
        """The same on bodies: feedforward also leads by their time constants, and safety distances have margins."""
        law, terms = self.law, self.law.terms
        if not (terms.lead.any() or self.safety):
            return self.control
        if terms.lead.any():
            tau = np.array([vehicle.reduced_model().tau[0] for vehicle in self.vehicles[: terms.agents]])
            law = law._replace(terms=terms._replace(lead=terms.lead * (1.0 + tau / terms.period)))
        margins = self.safety_margins if self.safety else np.zeros(len(self.planar))
        return ControlArrays(self._completed(law, margins), self.motion)

    def _completed(self, law: LawArrays, margins: Array) -> LawArrays:
        """Return the law with the scenario's safety filter, with margins (V,), m, in addition to its distance.

        Velocity limits are taken away last, if they are: the filter follows from them.
        """
        if self.safety is not None:
            law = law._replace(safety=self.separation(margins))
        if self.unlimited:
            law = law._replace(limit=np.where(law.limit > 0.0, np.inf, 0.0))  # absent agents are commanded to rest
        return law

    def separation(self, margins: Array) -> SafetyArrays:
        """Return the safety filter for compiled code, with margins (V,), m, in addition to its distance.

        Raises:
            InputError: See `mjsheaf.law.safety.pack_safety`.
        """
        assert self.safety is not None
        N, planar, grid = len(self.team.agents), self.planar, self.grid
        yields = np.arange(len(planar)) < N
        yields[:N] &= self.team.present
        carried, unsteady = self._medium_parts
        speed = self.target_speeds.copy()
        if self.waiting is not None:  # these command the medium's velocity, as it was up to a period ago
            holds = self.waiting.holds
            speed[holds] = (self.medium_speeds + (0.0 if grid.continuous else 2.0) * unsteady)[holds]
        return pack_safety(
            self.safety,
            ids=self.team.agent_ids,
            planar=planar,
            height=self.bodies.surface_height,
            limit=self.law.limit,
            yields=yields,
            radius=self.vehicle_radii if self.safety.distance == "size" else np.zeros(len(planar)),
            margin=margins,
            speed=speed,
            carried=carried,
            unsteady=unsteady,
            period=self._hold,
            start=grid.start,
            end=grid.start + grid.steps * grid.period,
        )

    @cached_property
    def target_speeds(self) -> Array:
        """Bound on the commanded speed of each target, 0 for agents, shape (V,), m/s.

        A target commands v + pull (r - p) at each sample and holds it for h. Let e = p - r, W a bound on the medium's
        speed, and A one on |r''|. From one sample to the next, e_(k+1) = (1 - pull h) e_k + d, where d is the integral
        of the medium's velocity, at most h W, less r_(k+1) - r_k - h r'_k, at most h^2 A / 2. So for pull h < 2
        |e_k| <= b = max(|e_0|, (h W + h^2 A / 2) / (1 - |1 - pull h|)), by induction, because for this b
        |1 - pull h| b + h W + h^2 A / 2 <= b. The command is at most sup |r'| + pull b, also between samples. With
        h -> 0, it is max(|e_0|, W / pull), which is the bound of a continuous law.

        For pull h >= 2 there is no bound: errors do not decay. Then |e_0| counts, and `check` gives no guarantee.
        """
        speed, acceleration = reference_bounds(self.motion, parts=PARTS)
        pull, hold = self.motion.pull, self._hold
        starts = np.array([position_at(self.motion, v, self.grid.start) for v in range(len(pull))]).reshape(-1, 3)
        away = np.linalg.norm(starts - self.initial, axis=1)
        pushed = np.maximum(self.medium_speeds, self.earlier_medium) + 0.5 * hold * acceleration
        decay = np.minimum(pull, 2.0 / hold - pull) if hold > 0.0 else pull  # (1 - |1 - pull h|) / h
        away = np.maximum(away, np.divide(pushed, decay, out=np.zeros_like(pull), where=decay > 0.0))
        return np.asarray(speed + pull * away)

    @cached_property
    def medium_speeds(self) -> Array:
        """Bound on the medium's speed around each vehicle, shape (V,), m/s; without the parts that have no bound."""
        carried, unsteady = self._medium_parts
        return np.asarray(np.linalg.norm(carried, axis=1) + unsteady)

    @property
    def _medium_parts(self) -> tuple[Array, Array]:
        """Return the uniform part of the medium's velocity, shape (V, 3), and a bound on the rest, shape (V,), m/s."""
        carried = np.array([self.flows[k].table[0, CENTRE:AXIS] for k in self.field]).reshape(-1, 3)
        carried[self.planar, 2] = 0.0
        kernels = np.array([self.flows[k].kernel_speed for k in self.field])
        return carried, np.nan_to_num(kernels + self.largest_disturbance, posinf=0.0)

    @property
    def obstacles(self) -> ObstacleArrays | None:
        """Obstacles that agents keep away from; None without a section `safety`."""
        return self.control.law.safety.obstacles if self.safety else None

    @property
    def vehicle_radii(self) -> Array:
        """Radius of a ball about its origin that contains the visible geoms of each vehicle, shape (V,), m."""
        return np.array([vehicle.radius for vehicle in self.vehicles])

    @cached_property
    def safety_margins(self) -> Array:
        """Distance that each body needs in addition to the separation, shape (V,), m.

        After the command to stop, which is delayed by at most one period, a vehicle travels at most its speed v times
        `stopping_times`. The point that the law moves is a hand length ahead of its origin. The speed is at most the
        velocity limit of an agent, or its vehicle's top speed if it has none. See `without_margin`.
        """
        top = np.where(self.without_margin, 0.0, np.maximum(self._top_speeds, self.target_speeds))
        hand = np.array([vehicle.steering.hand for vehicle in self.vehicles])
        return np.asarray(top * (self.stopping_times + self._hold) + hand)

    @cached_property
    def without_margin(self) -> BoolArray:
        """True for agents with neither a velocity limit nor a top speed: no margin suffices for them, shape (V,)."""
        return ~np.isfinite(self._top_speeds)

    @cached_property
    def _top_speeds(self) -> Array:
        """Largest speed of each agent through the medium, shape (V,), m/s; targets have 0."""
        top = self.law.limit.copy()
        top[len(self.team.agents) :] = 0.0
        unlimited = np.flatnonzero(np.isinf(top))
        top[unlimited] = [self.vehicles[v].capability.top_speed for v in unlimited]
        return top

    @cached_property
    def stopping_times(self) -> Array:
        """Distance to a stop of each body over its speed, shape (V,), s.

        For a first-order vehicle it is the time constant tau. A vehicle that overshoots can travel farther; see
        `mjsheaf.loop.linear.stopping_time`. A vehicle without thrusters or without a linear model gets tau.
        """
        steps = max(1, round(_STOP / self.timestep)) if self.grid.continuous else self.steps_per_sample
        kinds, number = kinds_of(self.vehicles)
        return np.array(self.bodies.stopping_times(kinds, self.control, self.timestep, steps))[number]

    @cached_property
    def station(self) -> Station:
        """The positions that vehicles hold, and gains for ideal kinematics."""
        V = len(self.team.members)
        return (self.waiting or no_station(V)).with_time_constants(np.zeros(V), self._hold)

    @cached_property
    def station_of_bodies(self) -> Station:
        """The same with gains for the time constants of the bodies."""
        if self.waiting is None:
            return self.station
        tau = np.array([vehicle.reduced_model().tau.max() for vehicle in self.vehicles])
        return self.waiting.with_time_constants(tau, self._hold)

    @property
    def _hold(self) -> float:
        """Return the hold time of a command, s."""
        return 0.0 if self.grid.continuous else self.grid.period

    @property
    def planar(self) -> BoolArray:
        """True for vehicles that live in the plane, shape (V,)."""
        return np.array([member.dimension == 2 for member in self.team.members])

    @cached_property
    def moving(self) -> Parts:
        """Gusts, waves and other moving parts of the medium, for compiled code.

        Raises:
            InputError: A frozen field of gusts would be too long, or a file does not cover the run; the message begins
                with the field.
        """
        if all(flow.is_steady for flow in self.flows):
            return ()
        met = np.array(self.flow_names)[self.field] != STILL
        wind = np.zeros((len(self.field), 3))
        for k, flow in enumerate(self.flows):
            wind[self.field == k] = flow.velocity(self.initial[self.field == k])
        wind[self.planar, 2] = 0.0
        grid, level = self.grid, self.bodies.surface_height
        end = grid.start + grid.steps * grid.period
        ids = [member.id for member in self.team.members]
        exposed = Exposure(met, ids, self.initial, wind, level, grid.start, end, grid.period, self.seed)
        with in_field("flow"):
            return pack_parts(self.flows, self.flow_names, self.field, self.planar, exposed)

    @cached_property
    def wind(self) -> Parts:
        """The air above hulls, a part of the medium of bodies; empty without `flow.air`, or if no hull has windage.

        Raises:
            InputError: See `moving`.
        """
        air, heights = self.flow_named("wind"), np.array([vehicle.windage[3] for vehicle in self.vehicles])
        if "dimension" not in air.model_fields_set or not heights.any():
            return ()
        field, harmonics = np.zeros_like(self.field), self.harmonics[:, :0]
        above = replace(
            self, initial=self._above_hulls, flows=[air], flow_names=("wind",), field=field, harmonics=harmonics
        )
        return (WindArrays((heights > 0.0).astype(np.int64), above.medium),)

    @property
    def _above_hulls(self) -> Array:
        """Return the points at which air acts on hulls at their initial positions, shape (V, 3), m."""
        heights = [self.bodies.surface_height + vehicle.windage[3] for vehicle in self.vehicles]
        return np.column_stack([self.initial[:, :2], heights])

    @cached_property
    def mean_wind(self) -> Array:
        """Velocity of the air above each hull's initial position relative to the water, shape (V, 3), m/s.

        It is the mean without gusts and waves at the end of the run, and zero for vehicles on which no wind acts.
        """
        for wind in self.wind:
            v, end = int(np.argmax(wind.met)), self.grid.start + self.grid.steps * self.grid.period  # of any hull
            air = mean_flow(wind.air, v, end, self._above_hulls)
            return (air - mean_flow(self.medium, v, end, self.initial)) * wind.met[:, None] * [1.0, 1.0, 0.0]
        return np.zeros_like(self.initial)

    def drift_in_wind(self, medium: Array) -> Array:
        """Compute the velocity that wind adds to the commands of agents that hold station, shape (N, 3), m/s.

        Args:
            medium: Velocity of the water relative to the place of each agent, shape (N, 3), m/s.
        """
        drift = np.zeros_like(medium)
        for i in np.flatnonzero(self.mean_wind[: len(medium)].any(axis=1)).tolist():
            heading, wind = float(self.bodies.heading[i]), self.mean_wind[i] + medium[i]
            drift[i, :2] = -medium[i, :2] - hold_station(self.vehicles[i], heading, medium[i], wind)[1]
        return drift

    def require_fitting(self) -> None:
        """Require that the moving parts of the medium and the safety filter fit the run.

        Raises:
            InputError: They do not; the message begins with the field.
        """
        _ = self.moving
        if self.safety is not None:
            _ = self.control

    @cached_property
    def medium(self) -> MediumArrays:
        """Parameters of the medium for compiled code."""
        return self.steady_medium._replace(harmonics=varying.pack(self.harmonics), parts=self.moving)

    @cached_property
    def steady_medium(self) -> MediumArrays:
        """The same without disturbances, gusts, waves and other moving parts."""
        return pack_medium(len(self.team.agents), self.planar, self.flows, self.field, self.bodies.surface_height)

    @cached_property
    def moving_bounds(self) -> Bounds:
        """Bounds of gusts, waves and other moving parts of the medium."""
        return bounds_of(self.moving, len(self.field))

    @cached_property
    def largest_disturbance(self) -> Array:
        """Bounds on the part of the medium's velocity that changes with time, for each vehicle, shape (V,), m/s.

        Infinite for a vehicle that meets gusts.
        """
        return varying.bounds(self.harmonics) + self.moving_bounds.speed

    def flow_named(self, name: str) -> FlowField:
        """Return the flow field of a name; one at rest if there is none."""
        return dict(zip(self.flow_names, self.flows, strict=True)).get(name) or NO_FLOW

    def fields_met(self, first: int, last: int) -> list[tuple[FlowField, bool]]:
        """Return each flow field that vehicles from first to last meet, with True if in the plane; every pair once."""
        members = self.team.members
        met = dict.fromkeys((int(self.field[v]), members[v].dimension == 2) for v in range(first, last))
        return [(self.flows[k], planar) for k, planar in met]

    @cached_property
    def remaining(self) -> "System":
        """The system that `check` analyses: the present agents and all targets, with fixed targets at rest.

        A fixed target is treated as one that no medium moves. If no agent is absent and no target is fixed, this is the
        system itself.
        """
        system, team = self, self.team
        if team.absent:
            agents = np.flatnonzero(team.present)
            rows = np.concatenate([agents, np.arange(len(team.agents), len(team.members))])
            by_vehicle = ("pull", "origin", "amplitude", "rate", "phase", "path", "period")
            g, plan = self.effectiveness, self.bodies
            system = replace(
                self,
                team=team.remaining,
                initial=self.initial[rows],
                law=self.law.selected(rows, len(agents)),
                motion=self.motion._replace(**{name: getattr(self.motion, name)[rows] for name in by_vehicle}),
                harmonics=self.harmonics[rows],
                effectiveness=g._replace(**{name: getattr(g, name)[agents] for name in g._fields}),
                field=self.field[rows],
                bodies=replace(plan, vehicle=[plan.vehicle[v] for v in rows], heading=plan.heading[rows]),
                stopped=None if self.stopped is None else self.stopped[rows],
                waiting=None if self.waiting is None else Station(*(part[rows] for part in self.waiting)),
                earlier_medium=np.broadcast_to(self.earlier_medium, len(self.planar))[rows],
            )
        if system.waiting is None:
            return system
        holds, flows = system.waiting.holds, [*self.flows, NO_FLOW]  # no medium is about them, so they stay there
        return replace(
            system,
            flows=flows,
            flow_names=(*self.flow_names, STILL),
            field=np.where(holds, len(flows) - 1, system.field),
            harmonics=np.where(holds[:, None, None], 0.0, system.harmonics),
            waiting=None,
        )

    @cached_property
    def largest_eigenvalue(self) -> float:
        """The number x for which the paper's held law is stable near q* if k1 h x < 2.

        That is lambda_max(H) if H is symmetric. A complex eigenvalue lambda counts as |lambda|^2 / Re lambda.
        """
        team = self.local.team
        H = team.law_problem.H
        if not team.symmetric and H.shape[0] > _MOST_EIGENVALUES:
            return float(abs(H).sum(axis=1).max())  # no eigenvalue is larger
        if not team.symmetric:
            values = np.linalg.eigvals(H.toarray())
            values = values[np.abs(values) > 1e-9 * np.abs(values).max(initial=0.0)]
            with np.errstate(divide="ignore"):
                return float((np.abs(values) ** 2 / np.maximum(values.real, 0.0)).max(initial=0.0))
        if H.shape[0] <= _MOST_EIGENVALUES:
            return float(np.linalg.eigvalsh(H.toarray())[-1])
        from scipy.sparse.linalg import eigsh

        return float(eigsh(H, k=1, which="LA", v0=np.ones(H.shape[0]), return_eigenvectors=False)[0])


@dataclass(frozen=True)
class Phase:
    """Part of a run under one system. Law, links, motions of targets, medium and effectiveness may differ by phase.

    Vehicles, initial positions, sample times and options of bodies are those of the whole run: see `phases_of`.

    Attributes:
        start: Number of the sample at which it begins.
        system: System of the phase.
        events: Events at its start, in words; usually none for the first phase.
    """

    start: int
    system: System
    events: tuple[str, ...] = ()

    @property
    def time(self) -> float:
        """Time at which it begins, s."""
        return float(self.system.grid.span(self.start, self.start + 1)[0])

    @property
    def name(self) -> str:
        """Its events in one line."""
        return ", ".join(self.events) or "start"


def whole_ratio(period: float, timestep: float) -> int:
    """Return the number of physics steps in a period.

    Raises:
        InputError: It is not a whole number.
    """
    ratio = period / timestep
    if not (0.5 < ratio < 1e9 and abs(ratio - round(ratio)) <= 1e-6 * ratio):
        raise InputError(
            f"physics.timestep: {timestep} s does not divide controller.control_period (or record_period), {period} s; "
            "the period must be a whole multiple of it"
        )
    return round(ratio)


def on_engine(phases: Sequence[Phase], engine: str, threads: int = 1) -> tuple[Phase, ...]:
    """Return the same run with its bodies moved by `engine` on up to `threads` threads."""
    plan = phases[0].system.bodies
    if (plan.engine, plan.threads) == (engine, threads):
        return tuple(phases)
    moved = {id(phase.system): copy(phase.system) for phase in phases}  # with all that no engine changes
    for system in moved.values():
        vars(system)["bodies"] = replace(system.bodies, engine=engine, threads=threads)
    return tuple(Phase(phase.start, moved[id(phase.system)], phase.events) for phase in phases)


def during(phases: Sequence[Phase], k: int, initial: Array | None = None) -> System:
    """Return the system of the agents present in phase k of a run, over that phase alone.

    `initial` holds the positions of all vehicles at its start, shape (V, 3), m; None takes the run's initial positions.
    """
    phase, grid = phases[k], phases[k].system.grid
    end = phases[k + 1].start if k + 1 < len(phases) else grid.steps
    own = replace(grid, start=phase.time, steps=max(end - phase.start, 1))
    system = phase.system if initial is None else replace(phase.system, initial=initial)
    return system.remaining if own == grid else replace(system.remaining, grid=own)


def phases_of(run: "Scenario | System | Sequence[Phase]") -> tuple[Phase, ...]:
    """Return the phases of a run: those of a scenario, or one for a system alone.

    Raises:
        InputError: The argument is not a run; or phases do not begin with sample 0, are not in order, or differ in what
            is common to the whole run, which the message names.
    """
    given = [Phase(0, run)] if isinstance(run, System) else run
    if not (isinstance(given, list | tuple) and all(isinstance(phase, Phase) for phase in given)):
        require_scenario(run)
        given = cast("Scenario", run).phases
    phases = tuple(given)
    starts = [phase.start for phase in phases]
    if not phases or starts[0] != 0 or starts != sorted(set(starts)) or starts[-1] > phases[0].system.grid.steps:
        raise InputError(f"phases start at samples {starts}; expected 0 first, then later samples of the run, in order")
    common = _fixed(phases[0].system)
    for phase in phases[1:]:
        for name, own in _fixed(phase.system).items():
            if not np.array_equal(own, common[name]) if isinstance(own, np.ndarray) else own != common[name]:
                raise InputError(
                    f"the phase from sample {phase.start} has other {name} than the first; expected the same in all "
                    "phases, which may differ in law, edges, links, motions, medium and effectiveness"
                )
    return tuple(_after_earlier(phases))


def _after_earlier(phases: Sequence[Phase]) -> Iterator[Phase]:
    """Yield phases whose safety filter accounts for the distance that earlier media may have carried pulled targets."""
    earlier = np.zeros(len(phases[0].system.planar))
    for phase in phases:
        system = phase.system
        matters = system.safety is not None and (system.motion.pull > 0.0).any()
        if matters and (earlier > np.maximum(system.medium_speeds, system.earlier_medium)).any():
            system = replace(system, earlier_medium=earlier)
        yield phase if system is phase.system else replace(phase, system=system)
        if phase is not phases[-1]:
            earlier = np.maximum(earlier, system.medium_speeds)


def _fixed(system: System) -> dict[str, Any]:
    """Return each part that no phase can change, by name."""
    plan = system.bodies
    names = ("time_constant", "effects", "timestep", "contacts", "surface", "surface_height", "engine", "threads")
    return {
        "vehicles (team.members)": system.team.members,
        "sample times (grid)": system.grid,
        "initial positions (initial)": system.initial,
        "vehicle descriptions (bodies.vehicle)": plan.vehicle,
        "headings (bodies.heading)": plan.heading,
        **{f"bodies.{name}": getattr(plan, name) for name in names},
    }
