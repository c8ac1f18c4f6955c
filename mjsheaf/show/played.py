"""A run as it is drawn: what is where at each sample, and what stays the same. Every painter reads it from here.

A run is read in pieces of consecutive samples, from memory or from its file, so that memory does not grow with it.
Ideal kinematics have neither height in the plane nor attitude: vehicles lie on the surface, whose z is given in m, and
face where they go.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Literal, Self

import numpy as np
import xarray as xr

from mjsheaf.arrays import Array, IntArray
from mjsheaf.law.obstacles import ObstacleArrays, points_kept_from
from mjsheaf.loop.system import Phase
from mjsheaf.media.medium import WITHOUT_MEAN, mean_flow
from mjsheaf.media.waves import Components
from mjsheaf.results.dataset import labelled_edges
from mjsheaf.results.metrics import mean_known
from mjsheaf.results.store import length_of_piece, pieces_of
from mjsheaf.scenario import Scenario
from mjsheaf.show.style import automatic_scales, groups_of, round_number
from mjsheaf.team import Edge

UPRIGHT: Array = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion w, x, y, z of a level attitude that faces along x."""
EdgeKind = Literal["communication", "one-way", "sensing"]
"""Kinds of drawn edges; one-way: agent i senses agent j, which does not know."""
DrawnEdge = tuple[int, int, EdgeKind]

HEADING_OFFSETS = np.linspace(-0.25, 0.25, 9)  # s, offsets for estimating the heading of a body without attitude
OUTLIER_FACTOR = 100.0  # multiple of the size of a region beyond which a vehicle has blown up
_SIDE = 40  # places along each side of the region in which speeds are looked at


# -- samples -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Poses:
    """A team at T times: V vehicles, N agents first, then the targets.

    Attributes:
        time: Shape (T,), in s.
        positions: Position of each vehicle's controlled point, shape (T, V, 3), m.
        quaternions: Attitude of each vehicle, w x y z. Shape (T, V, 4).
        harmonic_extension: Desired position q* of each agent, shape (T, N, 3), m; NaN for absent agents.
        error: RMS over the agents of the distance from q*, shape (T,), m.
    """

    time: Array
    positions: Array
    quaternions: Array
    harmonic_extension: Array
    error: Array

    def at(self, times: Array) -> "Poses":
        """Interpolate: linear, for attitudes linear and normalised; held before the first and after the last sample.

        Args:
            times: Shape (K,), in s. Those of the samples must increase.
        """
        after = np.searchsorted(self.time, times, side="right").clip(0, len(self.time) - 1)
        before = np.maximum(after - 1, 0)
        span = self.time[after] - self.time[before]
        share = ((times - self.time[before]) / np.where(span > 0, span, 1.0)).clip(0.0, 1.0)

        def between(first: Array, second: Array) -> Array:
            weight = share.reshape(-1, *[1] * (first.ndim - 1))
            with np.errstate(invalid="ignore"):  # a run that blew up has infinite values
                return np.where(weight > 0, (1 - weight) * first + weight * second, first)

        first, second = self.quaternions[before], self.quaternions[after]
        opposite = (first * second).sum(axis=-1, keepdims=True) < 0  # q and -q are one attitude: go the shorter way
        turned = between(first, np.where(opposite, -second, second))
        return Poses(
            times,
            between(self.positions[before], self.positions[after]),
            turned / np.maximum(np.linalg.norm(turned, axis=-1, keepdims=True), 1e-12),
            between(self.harmonic_extension[before], self.harmonic_extension[after]),
            between(self.error[before], self.error[after]),
        )


def number_begun(starts: Sequence[float], time: float) -> int:
    """Return the number of the last that has begun at a time in s, or of the first; starts ascend."""
    return max(bisect_right(starts, time + 1e-9) - 1, 0)


def joined(chunk: xr.Dataset, quantity: str) -> Array:
    """Return a quantity of the agents and of the targets of consecutive samples, shape (T, V, ...)."""
    return np.concatenate([chunk[f"{kind}_{quantity}"].values for kind in ("agent", "target")], axis=1)


def has_bodies(dataset: xr.Dataset) -> bool:
    """Return True if a run has bodies, with heights and attitudes."""
    return bool(dataset.attrs["backend"] == "physics")


def positions_in(chunk: xr.Dataset, surface_height: float) -> Array:
    """Return the positions of all vehicles in space, shape (T, V, 3), m."""
    positions = joined(chunk, "position")
    z = positions[..., 2]
    positions[..., 2] = joined(chunk, "height") if has_bodies(chunk) else np.where(np.isnan(z), surface_height, z)
    return positions


def goals_in(chunk: xr.Dataset, positions: Array) -> Array:
    """Return q* in space, shape (T, N, 3), m, at the height of its agent where it has none; NaN for absent agents."""
    q_star = chunk["harmonic_extension"].values.copy()
    unknown = np.isnan(q_star[..., 2])
    q_star[unknown, 2] = positions[:, : q_star.shape[1], 2][unknown]
    return q_star


class RecordedRun:
    """A run's data, read piece by piece when they are looked at.

    Attributes:
        time: Times of all samples, shape (T,), s.
    """

    def __init__(self, dataset: xr.Dataset, surface_height: float) -> None:
        """Read nothing yet; `surface_height` is z of the surface, m."""
        self._dataset, self._surface = dataset, surface_height
        self.time: Array = dataset["time"].values
        self._length = length_of_piece(dataset)
        self._piece = lru_cache(2)(self._read)

    def at(self, times: Array) -> Poses:
        """Interpolate; see `Poses.at`."""
        found = self._interpolate(times)
        return found if has_bodies(self._dataset) else replace(found, quaternions=self._headings(times))

    def positions(self) -> Iterator[tuple[Array, Array]]:
        """Yield times, shape (n,), s, and positions, shape (n, V, 3), m, of all samples, piece by piece."""
        quantities = ("position", "height") if has_bodies(self._dataset) else ("position",)
        names = [f"{kind}_{quantity}" for quantity in quantities for kind in ("agent", "target")]
        pieces = pieces_of(self._dataset, names)
        return ((piece["time"].values, positions_in(piece, self._surface)) for piece in pieces)

    def _interpolate(self, times: Array) -> Poses:
        """Interpolate as `at`, without headings."""
        # Only the two samples around each time are stored.
        after = np.searchsorted(self.time, times, side="right").clip(0, len(self.time) - 1)
        rows = np.unique([after, np.maximum(after - 1, 0)])
        pieces = [
            [values[rows[rows // self._length == piece] - piece * self._length] for values in self._piece(piece)]
            for piece in np.unique(rows // self._length).tolist()
        ]
        return Poses(*(np.concatenate(values) for values in zip(*pieces, strict=True))).at(times)

    def _read(self, number: int) -> list[Array]:
        """Return the fields of `Poses` over one piece of the data; attitudes that there are none of are upright."""
        piece = self._dataset.isel(time=slice(number * self._length, (number + 1) * self._length))
        positions = positions_in(piece, self._surface)
        upright = np.broadcast_to(UPRIGHT, (*positions.shape[:2], 4))
        attitudes = joined(piece, "orientation") if has_bodies(piece) else upright
        error = np.sqrt(mean_known(piece["tracking_error"].values ** 2))
        return [piece["time"].values, positions, attitudes, goals_in(piece, positions), error]

    def _headings(self, times: Array) -> Array:
        """Return level attitudes along the horizontal velocity, smoothed over half a second, shape (K, V, 4)."""
        around = self._interpolate((times[:, None] + HEADING_OFFSETS).ravel()).positions[..., :2]
        steps = np.diff(around.reshape(len(times), len(HEADING_OFFSETS), -1, 2), axis=1)
        # Each instant has an equal say, however fast it is: the first seconds are fast.
        directions = steps / np.maximum(np.linalg.norm(steps, axis=-1, keepdims=True), 1e-9)
        along = directions.sum(axis=1)
        half = np.arctan2(along[..., 1], along[..., 0]) / 2
        return np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=-1)


@dataclass(frozen=True)
class Region:
    """Place of a run, blow-ups aside.

    Attributes:
        centre: Median position, shape (3,), m.
        size: Distance within which nearly everything stays, at least 1, m.
    """

    centre: Array
    size: float

    @property
    def step(self) -> float:
        """Step of packed positions on a page, m."""
        return 5e-5 * self.size

    @classmethod
    def of(cls, positions: Array, part: float | None = None) -> Self:
        """Measure positions, shape (..., 3), some of which may be of a run that blew up.

        The size holds a part of them if one is given.
        """
        points = positions.reshape(-1, 3)
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            return cls(np.zeros(3), 1.0)
        centre = np.median(points, axis=0)
        away = np.abs(points - centre).max(axis=1)
        near = away <= 10.0 * max(float(np.quantile(away, 0.6)), 1.0)
        size = away[near].max() if part is None else np.quantile(away, part)
        return cls(centre, max(float(size), 1.0))

    def confined(self, points: Array) -> Array:
        """Clip points that are extremely far out; NaN stays."""
        far = OUTLIER_FACTOR * self.size
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(points), np.clip(points, self.centre - far, self.centre + far), np.nan)


# -- edges and the safety filter ---------------------------------------------------------------------------------------


def edges_of(phases: Sequence[Phase]) -> dict[tuple[str, str], Edge]:
    """Return all edges of a run by kind and name, in the order in which its phases have them."""
    return {name: edge for phase in phases for name, edge in labelled_edges(phase.system)}


def residuals_in(chunk: xr.Dataset, phases: Sequence[Phase], positions: Array) -> Array:
    """Compute the residual of every edge of `edges_of` at samples, shape (T, E), m; NaN while it does not exist.

    Args:
        chunk: The samples.
        phases: Phases of the run.
        positions: Positions at the samples, shape (T, V, 3), m.
    """
    number = {key: e for e, key in enumerate(edges_of(phases))}
    phase_of_each = chunk["phase"].values
    residual = np.full((len(positions), len(number)), np.nan)
    for k in np.unique(phase_of_each).tolist():
        here, system = phase_of_each == k, phases[k].system
        labelled = labelled_edges(system)
        columns = [number[key] for key, _ in labelled]
        with np.errstate(all="ignore"):  # of what blew up
            own = system.team.edge_residuals(positions[here], chunk["time"].values[here])[:, : len(labelled)]
        residual[np.ix_(here, columns)] = own
    return residual


def kept_from(chunk: xr.Dataset, obstacles: ObstacleArrays, positions: Array) -> tuple[IntArray, Array]:
    """Find what the safety filter keeps each agent away from at samples.

    Args:
        chunk: The samples.
        obstacles: The obstacles.
        positions: Positions at the samples, shape (T, V, 3), m.

    Returns:
        Number of a vehicle, from 1, or of an obstacle after the vehicles, 0 for none, shape (T, N); and the nearest
        point of that, shape (T, N, 3), m, NaN for none.
    """
    cause = np.where(chunk["safety_correction"].values > 0.0, chunk["safety_cause"].values, 0).astype(np.int64)
    return cause, points_kept_from(obstacles, cause, chunk["time"].values, positions)


# -- flow and waves ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Medium:
    """Medium that moves about some of the vehicles, drawn as arrows.

    Attributes:
        name: such as 'wind'.
        shots: Times from which it moves alike, s, in order, and functions that compute its velocities then, shape
            (K, 3), m/s, at points, shape (K, 3), m.
        vehicles: numbers of those that meet it. Shape (M,).
        level: True if it moves in the plane alone, at the surface.
        scale: Number of the scale of colours that shows its speed; see `style.STOPS`.
        top: End of that scale, m/s.
    """

    name: str
    shots: Sequence[tuple[float, Callable[[Array], Array]]]
    vehicles: IntArray
    level: bool
    scale: int = 0
    top: float = 1.0

    def at(self, places: Array, time: float) -> Array:
        """Compute velocities, shape (K, 3), m/s; not finite at a singular point.

        Args:
            places: Points, shape (K, 3), m.
            time: Time, s.
        """
        _, velocity = self.shots[number_begun([start for start, _ in self.shots], time)]
        with np.errstate(all="ignore"):
            return velocity(places) * [1.0, 1.0, not self.level]


def largest_speed(velocity: Callable[[Array], Array], places: Array) -> float:
    """Choose the end of a medium's scale of speeds, in m/s: a round number that the flow about a run hardly exceeds.

    Args:
        velocity: Velocities, shape (n, 3), m/s, at points, shape (n, 3), m.
        places: Where vehicles meet the medium, shape (n, 3), m.

    Returns:
        The end of the scale; 0 where the medium is at rest.
    """
    known = places[np.isfinite(places).all(axis=1)]
    if not len(known):
        return 0.0
    low, high = known.min(axis=0), known.max(axis=0)
    room = 0.15 * float((high - low)[:2].max()) + 1.0
    x, y = (np.linspace(low[k] - room, high[k] + room, _SIDE) for k in range(2))
    level = float(np.median(known[:, 2]))
    grid = np.stack([*np.meshgrid(x, y), np.full((_SIDE, _SIDE), level)], axis=-1).reshape(-1, 3)
    with np.errstate(all="ignore"):
        speeds = np.linalg.norm(velocity(grid), axis=1)
    speeds = speeds[np.isfinite(speeds)]
    fastest = float(np.quantile(speeds, 0.98)) if len(speeds) else 0.0  # a singular vortex has no largest speed
    return round_number(fastest, up=True) if fastest > 1e-9 else 0.0


def media_of(phases: Sequence[Phase], places: Array) -> list[Medium]:
    """List the flow fields that vehicles meet and that move in a phase of the run.

    Args:
        phases: The phases.
        places: Positions at a few moments, shape (K, V, 3), m; NaN for absent agents.
    """
    systems = {name: phase.system for phase in phases for name in phase.system.flow_names}
    found = []
    for name, system in systems.items():
        k = system.flow_names.index(name)
        met = np.flatnonzero(system.field == k)
        if name == "wind" and not len(met):  # it pushes hulls
            met = np.flatnonzero(sum(wind.met for wind in system.wind))
        if not len(met):
            continue
        level = all(system.team.members[v].dimension == 2 for v in met)
        medium = Medium(name, _snapshots(phases, name, int(met[0])), met, level, k)
        seen = places[:, met].reshape(-1, 3)
        tops = [largest_speed(partial(medium.at, time=time), seen) for time, _ in medium.shots]
        found.append(replace(medium, top=max(tops)))
    return [medium for medium in found if medium.top > 0.0]


def _snapshots(phases: Sequence[Phase], name: str, vehicle: int) -> list[tuple[float, Callable[[Array], Array]]]:
    """List velocities of a flow and the times at which they begin: several of a flow that changes with time.

    Args:
        phases: The phases.
        name: Name of the flow field.
        vehicle: Number of a vehicle that meets it.
    """
    found: list[tuple[float, Callable[[Array], Array]]] = []
    flow = None
    for phase in phases:
        before, flow, grid = flow, phase.system.flow_named(name), phase.system.grid
        if any(part.met[vehicle] for part in phase.system.moving if not isinstance(part, WITHOUT_MEAN)):
            times = phase.time + grid.period * grid.steps * np.arange(24) / 24
            found += [(time, partial(mean_flow, phase.system.medium, vehicle, time)) for time in times.tolist()]
        elif flow != before:
            found.append((phase.time, flow.velocity))
    return found


@dataclass(frozen=True)
class Sea:
    """Waves about a height, from a time on.

    Attributes:
        start: time from which on the sea is this one, s.
        waves: its waves.
        level: z of the undisturbed surface, m.
    """

    start: float
    waves: Components
    level: float

    def surface(self, x: Array, y: Array, time: float) -> Array:
        """Return elevation, m, and slopes along x and y on a grid, shape (3, X, Y).

        A wave's phase k . x - omega t is a sum over x and y, so all waves on the grid are one product of matrices. A
        wave that is too short for the grid at a place is left out there.

        Args:
            x: Places of the grid's lines along x, increasing, shape (X,), m.
            y: Places along y, shape (Y,), m.
            time: Time, s.
        """
        waves = self.waves
        k_x, k_y = waves.number * waves.unit.T
        along_x = _faded(k_x, x) * np.exp(1j * np.outer(x, k_x))
        along_y = _faded(k_y, y) * np.exp(1j * np.outer(y, k_y))
        now = waves.amplitude * np.exp(1j * (waves.phase - waves.rate * time))
        factors = (now, 1j * k_x * now, 1j * k_y * now)
        return np.stack([((along_x * factor) @ along_y.T).real for factor in factors])


def _faded(number: Array, places: Array) -> Array:
    """Return how much of each wave a grid can show: 1 down to 0, shape (P, N); wave numbers (N,), places (P,)."""
    spacing = np.gradient(places)
    return np.asarray(np.exp(-((np.outer(spacing, number) / 1.5) ** 4)))  # it fades from 1.5 rad on


def seas_of(phases: Sequence[Phase]) -> list[Sea]:
    """List the sea of each phase of a run, level in a phase without waves; empty if no phase has waves."""
    found = []
    for phase in phases:
        waves = [flow.waves.components_of(phase.system.seed) for flow in phase.system.flows if flow.waves is not None]
        found.append(waves[0] if waves else None)
    some = next((waves for waves in found if waves is not None), None)
    if some is None:
        return []
    calm = some._replace(amplitude=np.zeros_like(some.amplitude))
    return [
        Sea(phase.time, waves or calm, phase.system.bodies.surface_height)
        for phase, waves in zip(phases, found, strict=True)
    ]


# -- the whole ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Stage:
    """State that holds from some time on.

    Attributes:
        start: Start time, s.
        edges: Pairs of vehicles (i, j, kind) that exchange states or measure each other.
        absent: Indices of the agents that failed or have yet to join. They are drawn in grey and not followed.
        name: Name of the event, drawn next to the time.
    """

    start: float
    edges: Sequence[DrawnEdge]
    absent: frozenset[int] = frozenset()
    name: str = ""


@dataclass(frozen=True, kw_only=True)
class Played:
    """A run, ready to be drawn.

    Attributes:
        name: Name of the scenario.
        run: Poses of all vehicles over time, in memory or read from a file when they are looked at.
        agent_ids: Labels of the N agents.
        target_ids: Labels of the V - N targets.
        group: Index of each vehicle's group, which gives its colour, shape (V,).
        group_names: Names of the G groups, for the legend.
        colours: Colour of each group, RGB in 0..1, shape (G, 3).
        stages: States between events, in order. The first one holds at the start.
        surface: Plane of the scene, if any. Vehicles off it are joined to it by a vertical line.
        surface_height: z of that plane, m.
        kinds: Kind of each vehicle. Empty if each is a kind of its own.
        radii: Radius about its origin that holds each vehicle, shape (V,), m.
        scales: Times that each vehicle is drawn larger, shape (V,).
        media: Moving media around the vehicles.
        obstacles: What agents keep away from; None without any.
        restraints: Computes, from a time in s and the positions, shape (V, 3), m, the positions of the agents that the
            safety filter restrains then and the points that it keeps them away from, shapes (M, 3), m; None without it.
        seas: Waves of the surface, in order of their start times; empty for a level surface.
    """

    name: str
    run: Poses | RecordedRun
    agent_ids: list[str]
    target_ids: list[str]
    group: IntArray
    group_names: list[str]
    colours: Array
    stages: Sequence[Stage]
    radii: Array
    scales: Array
    surface: Literal["water", "ground", "none"] = "none"
    surface_height: float = 0.0
    kinds: Sequence[str] = ()
    media: Sequence[Medium] = ()
    obstacles: ObstacleArrays | None = None
    restraints: Callable[[float, Array], tuple[Array, Array]] | None = None
    seas: Sequence[Sea] = ()

    @property
    def agents(self) -> int:
        """Number of agents, N."""
        return len(self.agent_ids)

    @property
    def ids(self) -> list[str]:
        """Labels of all vehicles."""
        return [*self.agent_ids, *self.target_ids]

    @property
    def vehicles(self) -> int:
        """Number of vehicles, V: agents and targets."""
        return len(self.ids)

    def stage(self, time: float) -> int:
        """Return the index of the stage at a time in s."""
        return number_begun([stage.start for stage in self.stages], time)

    def absent(self, time: float) -> frozenset[int]:
        """Numbers of the agents that are absent at a time in s."""
        return self.stages[self.stage(time)].absent

    def places(self) -> Array:
        """Return positions at a few moments of the run, shape (K, V, 3), m; NaN for absent agents."""
        times = np.linspace(self.run.time[0], self.run.time[-1], 9)
        positions = self.run.at(times).positions.copy()
        for row, time in enumerate(times.tolist()):
            positions[row, sorted(self.absent(time))] = np.nan
        return positions


def played(scenario: Scenario, dataset: xr.Dataset, phases: Sequence[Phase]) -> Played:
    """Read a run for drawing it.

    Args:
        scenario: Scenario that was run.
        dataset: Data of the run, in memory or an open file.
        phases: Phases of the run.
    """
    system = phases[0].system
    team, safety, scene = system.team, system.control.law.safety, scenario.scene
    group, names, colours = groups_of(team)
    stages = []
    for phase in phases:
        then = phase.system.team
        absent = frozenset(np.flatnonzero(~then.present).tolist())
        edges: list[DrawnEdge] = [
            *(
                (then.index[e.tail], then.index[e.head], "one-way" if e.directed else "communication")
                for e in then.communication
            ),
            *((then.index[e.tail], then.index[e.head], "sensing") for e in then.sensing),
        ]
        stages.append(Stage(phase.time, edges, absent, ", ".join(phase.events)))
    found = Played(
        name=scenario.name,
        run=RecordedRun(dataset, scene.height),
        agent_ids=team.agent_ids,
        target_ids=team.target_ids,
        group=group,
        group_names=names,
        colours=colours,
        stages=stages,
        radii=system.vehicle_radii,
        scales=np.ones(len(group)),
        surface=scene.surface,
        surface_height=scene.height,
        kinds=system.bodies.vehicle,
        obstacles=system.obstacles,
        restraints=partial(_restraints, dataset, safety.obstacles) if "safety_cause" in dataset else None,
        seas=seas_of(phases) if scene.surface == "water" else (),
    )
    places, given = found.places(), scenario.drawn_scales
    automatic = automatic_scales(found.kinds, found.radii, places)
    scales = np.where(np.isnan(given), automatic, given)
    return replace(found, media=media_of(phases, places), scales=scales)


def _restraints(dataset: xr.Dataset, obstacles: ObstacleArrays, time: float, positions: Array) -> tuple[Array, Array]:
    """Find the agents that the filter restrains at a time in s, and what it keeps them away from."""
    now = dataset[["safety_cause", "safety_correction"]].sel(time=[time], method="nearest").assign_coords(time=[time])
    cause, ends = kept_from(now, obstacles, positions[None])
    agents = np.flatnonzero(cause[0])
    return positions[agents], ends[0, agents]
