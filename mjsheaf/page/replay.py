"""Data that a page replays: samples of a run, resampled to the visible detail, rounded and packed.

Samples are kept more densely where vehicles turn or speed up. Between two kept samples, g sampling periods apart, the
page interpolates linearly, which misses a path of second difference a by at most g^2 a / 8: so the density of kept
samples is (a / 8 tolerance)^(1/2), at least some hundreds in all and at most as many as the size of the page allows.
The error of this and of rounding is measured over every sample of the run, and stated in the page.

Places are relative to an origin near the run, a whole number of kilometres each way, so that those of a team far from
zero keep their digits; `record["origin"]` has it.

An array is packed as integers: positions in steps of a quarter of the tolerance, attitudes in 2^-13, everything else as
32-bit floats with the mantissa rounded to 12 bits (a relative error below 2^-12). Differences along time, with
their sign in the lowest bit, byte plane by byte plane, then compress well; the browser undoes it (web/src/data.js).
"""

import base64
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf.arrays import Array, IntArray
from mjsheaf.page.ghosts import Ghost, add_ghosts
from mjsheaf.page.safety import RECORDED, add_safety
from mjsheaf.results.dataset import join
from mjsheaf.results.metrics import edge_residuals
from mjsheaf.results.netcdf import length_of_piece, pieces_of, split
from mjsheaf.results.variables import labelled_edges
from mjsheaf.show.played import RecordedRun
from mjsheaf.system import Phase
from mjsheaf.team import Edge

_TOLERANCE = 2e-4  # largest error of a path, relative to the scene's size
_FEWEST, _MOST = 400, 3000  # minimum and maximum number of samples
_MOST_POSITIONS = 500_000  # maximum of vehicles times samples, unless _FEWEST requires more
_MOST_HELD = 6_000_000  # maximum number of positions kept between passes over a run
_OUTLIER = 100.0  # multiple of the scene's size beyond which a position has blown up and is clipped
_ORIGINS = 1000.0  # spacing of possible origins, m
_FARTHEST = 1e12  # maximum distance from zero, m; 64-bit floats resolve a tenth of a millimetre there
_ROOM_OF_BLOWN_UP = 4.0  # size of the scene of a run that blew up, as a multiple of the size at its start
REQUIRED = frozenset(
    {"disagreement", "tracking_error", "velocity_command", "agent_flow", "harmonic_extension"}
    | {"formation_error", "centering_error"}
)
"""Variables of every run that a page shows, in addition to positions."""
_WHERE_THERE = (
    *("agent_saturation", "group_formation_error", "group_centering_error", "heard"),
    *("agent_orientation", "target_orientation"),
    *RECORDED,
)
_UNKNOWN = np.iinfo(np.int32).min
_QUATERNION_STEP = 2.0**-13
_DROPPED_BITS = 11  # number of dropped bits of a float's mantissa


@dataclass
class Packer:
    """Arrays over time, packed one after the other.

    Attributes:
        index: Shape (samples, columns) of each array, offset of its unpacked bytes, and step of its integers. A step
            of 0 means that they are the bits of floats.
    """

    index: dict[str, dict[str, Any]] = field(default_factory=dict)
    _planes: list[bytes] = field(default_factory=list)
    _size: int = 0

    def add_fixed(self, name: str, values: Array, step: float) -> Array:
        """Add values rounded to multiples of a step, shape (K, ...); returns them as the page has them."""
        known = np.isfinite(values)
        with np.errstate(invalid="ignore"):
            whole = np.rint(np.clip(np.where(known, values, 0.0) / step, -(2.0**30), 2.0**30)).astype(np.int32)
        self._add(name, np.where(known, whole, _UNKNOWN).astype(np.int32), step)
        return np.where(known, whole * step, np.nan)

    def add_float(self, name: str, values: Array) -> None:
        """Add values with a relative error of at most 2^-12, shape (K, ...)."""
        with np.errstate(over="ignore"):
            bits = np.ascontiguousarray(values, np.float32).view(np.int32)
        half = 1 << (_DROPPED_BITS - 1)
        finite = np.isfinite(values)
        self._add(name, np.where(finite, (bits + half) & -(1 << _DROPPED_BITS), bits).astype(np.int32), 0.0)

    def _add(self, name: str, whole: NDArray[np.int32], step: float) -> None:
        columns = whole.reshape(len(whole), -1)
        self.index[name] = {"shape": columns.shape, "at": self._size, "step": step}
        change = np.diff(columns, axis=0, prepend=np.int32(0))  # modulo 2^32, as the browser adds them
        signed = np.ascontiguousarray(((change << 1) ^ (change >> 31)).T, "<i4")
        self._planes.append(signed.view(np.uint8).reshape(-1, 4).T.tobytes())
        self._size += 4 * columns.size

    def packed(self) -> str:
        """Everything, compressed, in base64."""
        return base64.b64encode(zlib.compress(b"".join(self._planes), 4)).decode("ascii")


@dataclass(frozen=True)
class Scene:
    """Place of a run.

    Attributes:
        centre: median position. Shape (3,), m.
        size: distance within which nearly everything stays, at least 1, m.
    """

    centre: Array
    size: float

    @classmethod
    def of(cls, positions: Array) -> "Scene":
        """Measure positions, shape (..., 3), some of which may be of a run that blew up."""
        points = positions.reshape(-1, 3)
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            return cls(np.zeros(3), 1.0)
        centre = np.median(points, axis=0)
        away = np.abs(points - centre).max(axis=1)
        near = away <= 10.0 * max(float(np.quantile(away, 0.6)), 1.0)
        return cls(centre, max(float(away[near].max()), 1.0))

    @property
    def tolerance(self) -> float:
        """Maximum error of a path, m; see the module."""
        return _TOLERANCE * self.size

    @property
    def step(self) -> float:
        """Step of packed positions, m."""
        return self.tolerance / 4.0

    def confined(self, points: Array) -> Array:
        """Clip points that are extremely far out; NaN stays."""
        far = _OUTLIER * self.size
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(points), np.clip(points, self.centre - far, self.centre + far), np.nan)


@dataclass(frozen=True)
class Replay:
    """A run, packed.

    Attributes:
        record: Data for the page: times, names, arrays, scene and errors.
        data: the arrays of `record["arrays"]`.
    """

    record: dict[str, Any]
    data: str


def pack(
    dataset: xr.Dataset,
    phases: Sequence[Phase],
    surface_height: float,
    bounds: dict[str, Array],
    ideal: xr.Dataset | None = None,
    ghosts: Sequence[Ghost] = (),
    ahead: Array | None = None,
) -> Replay:
    """Pack a run.

    Args:
        dataset: the run, in memory or opened.
        phases: Phases of the run.
        surface_height: z of the surface that planar vehicles lie on where they have no height, m.
        bounds: Bounds by name, on the team's RMS tracking error at every sample of the run, shape (T,), m.
        ideal: the same scenario on ideal kinematics, shown as ghosts; or None.
        ghosts: Other runs, drawn translucent.
        ahead: Points that a run in progress is expected to reach, shape (K, 3), m; None for a finished run.
    """
    origin = origin_of(dataset)
    pieces = _Positions(dataset, surface_height, origin)
    scene, bend = _survey(pieces, dataset.sizes["time"], phases)
    if ahead is not None:
        scene = Scene.of(np.concatenate([next(iter(pieces))[:1].reshape(-1, 3), ahead - origin]))
    elif dataset.attrs["status"] != "finished":  # vehicles that blew up leave the picture
        began = Scene.of(next(iter(pieces))[:1])
        scene = Scene(began.centre, min(scene.size, _ROOM_OF_BLOWN_UP * began.size))
    rows = _kept(bend, scene.tolerance, dataset.sizes["agent"] + dataset.sizes["target"], _event_rows(phases))
    time = dataset["time"].values[rows]
    packer = Packer()
    own = _at_rows(dataset, [name for name in (*sorted(REQUIRED), *_WHERE_THERE) if name in dataset], rows)
    positions = _positions_at(pieces, rows)
    shown = scene.step * np.rint(scene.confined(positions) / scene.step)
    described = add_samples(packer, dataset, own, positions, phases, rows, scene, origin)
    for k, values in enumerate(bounds.values()):
        packer.add_float(f"bound{k}", np.where(np.abs(values) < 1e30, values, np.nan)[rows])
    record: dict[str, Any] = {
        "time": [round(t, 9) for t in time.tolist()],
        "samples": int(dataset.sizes["time"]),
        "origin": origin.tolist(),
        "centre": scene.centre.tolist(),
        "size": scene.size,
        **described,
        "bounds": list(bounds),
        "largest_error": _largest_error(pieces, dataset["time"].values, scene, time, shown),
    }
    if ideal is not None:
        end = ideal["time"].values[-1]
        other = RecordedRun(ideal, surface_height).at(np.minimum(time, end)).positions - origin
        packer.add_fixed("ghost", scene.confined(other), scene.step)
        apart = np.linalg.norm((positions - other)[:, : dataset.sizes["agent"]], axis=2)
        packer.add_float("apart", np.where(time[:, None] <= end + 1e-9, apart, np.nan))
    record["ghosts"] = add_ghosts(packer, ghosts, dataset, time, scene, origin)
    record["arrays"] = packer.index
    return Replay(record, packer.packed())


def add_samples(
    packer: Packer,
    dataset: xr.Dataset,
    own: xr.Dataset,
    positions: Array,
    phases: Sequence[Phase],
    rows: IntArray,
    scene: Scene,
    origin: Array,
) -> dict[str, Any]:
    """Add everything that the page shows of some samples of the run.

    Args:
        packer: Destination.
        dataset: The run, or a piece of it that contains the samples.
        own: The samples.
        positions: Positions at the samples from the origin, shape (K, V, 3), m.
        phases: Phases of the run.
        rows: Numbers of the samples in the run.
        scene: Place of the run.
        origin: Origin of the page's places, shape (3,), m.

    Returns:
        Descriptions of the `edges` and `obstacles`.
    """
    packer.add_fixed("position", scene.confined(positions), scene.step)
    q_star = own["harmonic_extension"].values - origin
    q_star = np.where(np.isnan(q_star), positions[:, : q_star.shape[1]] * [np.nan, np.nan, 1.0], q_star)
    packer.add_fixed("q_star", scene.confined(q_star), scene.step)
    if dataset.attrs["backend"] == "physics":
        attitude = np.concatenate([own[f"{kind}_orientation"].values for kind in ("agent", "target")], axis=1)
    else:  # headings along the velocity
        attitude = RecordedRun(dataset, 0.0).at(own["time"].values).quaternions
    packer.add_fixed("quaternion", _continuous(attitude), _QUATERNION_STEP)
    _add_curves(packer, own)
    edges = _add_edges(packer, phases, positions + origin, own, rows)
    return {"edges": edges} | add_safety(packer, phases[0].system, own, positions, scene, origin)


def _add_curves(packer: Packer, own: xr.Dataset) -> None:
    """Add the recorded variables of agents and groups that the page shows."""
    packer.add_float("disagreement", own["disagreement"].values)
    packer.add_float("tracking_error", own["tracking_error"].values)
    packer.add_float("speed", np.linalg.norm(np.nan_to_num(own["velocity_command"].values), axis=2))
    packer.add_fixed("flow", np.nan_to_num(own["agent_flow"].values), 0.01)
    for name in ("formation_error", "centering_error", "group_formation_error", "group_centering_error"):
        if name in own:
            packer.add_float(name, own[name].values)
    if "agent_saturation" in own:
        packer.add_fixed("saturation", own["agent_saturation"].values, 2.0**-7)


def origin_of(dataset: xr.Dataset) -> Array:
    """A place near where a run begins, shape (3,), m: see the module."""
    names = [f"{kind}_position" for kind in ("agent", "target")]
    first = np.nan_to_num(np.concatenate([dataset[name][:1].values.reshape(-1, 3) for name in names]))
    first = first[np.abs(first).max(axis=1) < _FARTHEST]
    return _ORIGINS * np.round(np.median(first, axis=0) / _ORIGINS) if len(first) else np.zeros(3)


class _Positions:
    """Positions of all vehicles from an origin, piece by piece, shape (n, V, 3), m, as `RecordedRun` has them.

    Those of a run that is not long are read but once, and kept as 32-bit floats.
    """

    def __init__(self, dataset: xr.Dataset, surface_height: float, origin: Array) -> None:
        vehicles = dataset.sizes["agent"] + dataset.sizes["target"]
        self._dataset, self._surface, self._origin = dataset, surface_height, origin
        self._held: list[Array] | None = [] if dataset.sizes["time"] * vehicles <= _MOST_HELD else None

    def __iter__(self) -> Iterator[Array]:
        if self._held is None:
            yield from self._pieces()
            return
        if not self._held:
            self._held = [places.astype(np.float32) for places in self._pieces()]
        yield from self._held

    def _pieces(self) -> Iterator[Array]:
        for piece in pieces_of(self._dataset, _position_names(self._dataset)):
            yield positions_of(piece, self._surface) - self._origin


def _position_names(dataset: xr.Dataset) -> list[str]:
    """Return the variables that `positions_of` needs."""
    quantities = ["position", "height"] if dataset.attrs["backend"] == "physics" else ["position"]
    return [f"{kind}_{quantity}" for quantity in quantities for kind in ("agent", "target")]


def positions_of(piece: xr.Dataset, surface_height: float) -> Array:
    """Return the positions of all vehicles in space, shape (n, V, 3), m."""
    names = _position_names(piece)
    places = np.concatenate([piece[name].values for name in names[:2]], axis=1)
    places[..., 2] = (
        np.concatenate([piece[name].values for name in names[2:]], axis=1)
        if len(names) > 2
        else np.where(np.isnan(places[..., 2]), surface_height, places[..., 2])
    )
    return places


def _positions_at(pieces: Iterable[Array], rows: IntArray) -> Array:
    """Positions at some samples, shape (K, V, 3), m."""
    found, done = [], 0
    for places in pieces:
        found.append(places[rows[(rows >= done) & (rows < done + len(places))] - done])
        done += len(places)
    return np.concatenate(found).astype(np.float64)


def _survey(pieces: Iterable[Array], samples: int, phases: Sequence[Phase]) -> tuple[Scene, Array]:
    """Positions of the present agents and the targets, and the largest second difference of a path, (T,), m."""
    every, done = max(1, samples // 400), 0
    seen, bends, before = [], [], np.zeros((0, 1, 3))
    starts = [phase.start for phase in phases]
    for places in pieces:
        rows = np.arange(-done % every, len(places), every)
        some = places[rows].copy()
        phase = np.searchsorted(starts, done + rows, side="right") - 1
        for k in np.unique(phase):
            some[np.ix_(phase == k, np.flatnonzero(~phases[k].system.team.present))] = np.nan
        seen.append(some)
        joined = np.concatenate([before, places]) if len(before) else places
        with np.errstate(all="ignore"):
            second = joined[2:] - 2.0 * joined[1:-1] + joined[:-2]
            bends.append(np.sqrt(np.nan_to_num(np.einsum("tvi,tvi->tv", second, second), posinf=1e30).max(axis=1)))
        before, done = joined[-2:], done + len(places)
    bend = np.concatenate([[0.0], *bends, [0.0]])[:samples].astype(np.float64)
    return Scene.of(np.concatenate(seen)), bend


def _kept(bend: Array, tolerance: float, vehicles: int, events: list[int]) -> IntArray:
    """Select the samples to keep, including the first, the last and those at events (see the module)."""
    T = len(bend)
    most = int(np.clip(_MOST_POSITIONS // vehicles, _FEWEST, _MOST))
    if most >= T:
        return np.arange(T)
    wide = np.maximum.reduce([bend, np.roll(bend, 1), np.roll(bend, -1)])
    wanted, least = 1.4 * np.sqrt(wide / (8.0 * tolerance)), 0.7 * min(most, 2000) / T
    low, high = 0.0, 1.0
    for _ in range(30):  # bisect for the largest fraction of the desired density that fits
        share = 0.5 * (low + high)
        low, high = (share, high) if np.clip(share * wanted, least, 1.0).sum() < most else (low, share)
    steps = np.floor(np.cumsum(np.clip(high * wanted, least, 1.0)))
    kept = np.flatnonzero(np.diff(steps, prepend=0.0) > 0.0)
    beside = [row for event in events for row in (event - 1, event) if 0 <= row < T]
    return np.unique(np.concatenate([[0, T - 1], kept, beside])).astype(np.int64)


def _event_rows(phases: Sequence[Phase]) -> list[int]:
    return [phase.start for phase in phases[1:]]


def _at_rows(dataset: xr.Dataset, names: list[str], rows: IntArray) -> xr.Dataset:
    """Some variables at some samples, in memory; the data are read piece by piece."""
    step = length_of_piece(dataset)
    found = []
    for begin, piece in zip(range(0, dataset.sizes["time"], step), split(dataset[names], step), strict=True):
        here = rows[(rows >= begin) & (rows < begin + step)] - begin
        if len(here):
            found.append(piece.load().isel(time=here))
    return join(found)


def _continuous(quaternions: Array) -> Array:
    """Choose the sign of each attitude (K, V, 4) that is nearer to the previous one."""
    known = np.where(np.isfinite(quaternions), quaternions, [1.0, 0.0, 0.0, 0.0])
    turns = np.sign((known[1:] * known[:-1]).sum(axis=-1))
    signs = np.cumprod(np.where(turns < 0.0, -1.0, 1.0), axis=0)
    return np.asarray(known * np.concatenate([np.ones((1, known.shape[1])), signs])[..., None])


def _largest_error(pieces: Iterable[Array], every: Array, scene: Scene, time: Array, shown: Array) -> float:
    """Compute the largest distance of a vehicle from its position on the page, m, except for vehicles that blew up."""
    largest, done = 0.0, 0
    for places in pieces:
        now = every[done : done + len(places)]
        done += len(places)
        after = np.searchsorted(time, now, side="right").clip(1, max(len(time) - 1, 1))
        if len(time) == 1:
            between = np.broadcast_to(shown, places.shape)
        else:
            share = ((now - time[after - 1]) / (time[after] - time[after - 1])).clip(0.0, 1.0)[:, None, None]
            between = shown[after - 1] + share * (shown[after] - shown[after - 1])
        with np.errstate(all="ignore"):
            away = np.linalg.norm(places - between, axis=2)
            inside = np.abs(places - scene.centre).max(axis=2) < 10.0 * scene.size
        largest = max(largest, float(np.nan_to_num(away[inside]).max(initial=0.0)))
    return largest


def edges_of(phases: Sequence[Phase]) -> dict[tuple[str, str], Edge]:
    """Return all edges of a run by kind and name, in the order of the page."""
    found: dict[tuple[str, str], Edge] = {}
    for phase in phases:
        found |= dict(labelled_edges(phase.system))
    return found


def _add_edges(
    packer: Packer, phases: Sequence[Phase], positions: Array, own: xr.Dataset, rows: IntArray
) -> list[dict[str, Any]]:
    """Add every edge's residual at every kept sample: NaN while it does not exist, negative while nothing is received.

    Returns:
        Description of each edge: ends, kind, name, dimension of its residual, and True if only its tail senses.
    """
    found = edges_of(phases)
    number, index = {key: e for e, key in enumerate(found)}, phases[0].system.team.index
    residual = np.full((len(rows), len(found)), np.nan)
    starts = [phase.start for phase in phases] + [int(rows[-1]) + 1]
    for phase, begin, end in zip(phases, starts, starts[1:], strict=False):
        here = (rows >= begin) & (rows < end)
        labelled = labelled_edges(phase.system)
        columns = np.array([number[key] for key, _ in labelled], dtype=np.int64)
        if here.any() and labelled:
            edges = [edge for _, edge in labelled]
            with np.errstate(all="ignore"):  # of what blew up
                residual[np.ix_(here, columns)] = edge_residuals(phase.system.team, edges, positions[here])
    if "heard" in own:
        _mark_silence(residual, number, own)
    packer.add_float("residual", residual)
    return [
        {
            "tail": index[edge.tail],
            "head": index[edge.head],
            "kind": kind,
            "name": name,
            "numbers": len(edge.b),
            "directed": edge.directed,
        }
        for (kind, name), edge in found.items()
    ]


def _mark_silence(residual: Array, number: dict[tuple[str, str], int], own: xr.Dataset) -> None:
    """Make the residuals (K, E) of edges negative while they receive nothing."""
    heard = {name: k for k, name in enumerate(own["measuring_edge"].values.tolist())}
    for key, e in number.items():
        if " ".join(key) in heard:
            silent = own["heard"].values[:, heard[" ".join(key)]] == 0
            residual[silent, e] = -np.abs(residual[silent, e])
