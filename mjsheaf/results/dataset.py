"""A run as an xarray Dataset with CF attributes, the contents of result.nc."""

import json
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import astuple
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf._version import __version__
from mjsheaf.arrays import Array, IntArray
from mjsheaf.law.links import NEW
from mjsheaf.law.terms import traffic_of
from mjsheaf.loop.log import Trajectory
from mjsheaf.results import variables as declared
from mjsheaf.results.variables import Samples, labelled_edges
from mjsheaf.system import Phase, System
from mjsheaf.team.shapes import Path

Coordinate = tuple[str | tuple[str, ...], NDArray[Any], dict[str, Any]]
"""Dimensions, values and attributes, in the form that xarray expects."""


def make_dataset(trajectory: Trajectory, backend: str, seed: int) -> xr.Dataset:
    """Collect a recorded trajectory and its errors.

    Args:
        trajectory: Trajectory of the run, or a piece of it.
        backend: 'ideal' or 'physics'.
        seed: Seed of the scenario.

    Returns:
        Dataset over the dimensions time, agent, target and axis; docs/reference/results.md lists the variables.
        Attributes give the scenario, backend, status and groups.
    """
    return next(make_datasets([trajectory], backend, seed))


def make_datasets(
    pieces: Iterable[Trajectory],
    backend: str,
    seed: int,
    phases: Sequence[Phase] = (),
    first: int = 0,
    path: Path | None = None,
    only: Collection[str] | None = None,
) -> Iterator[xr.Dataset]:
    """Collect a trajectory in pieces, each as in `make_dataset`.

    The last piece has the run's status, the communication between agents (see `terms.traffic_of`) and the fraction of
    measurements that arrived. `phases` determine the phase of each sample and the edges that have a link at some time;
    a run of one phase does not need them. `first` is the number of the first sample in the run, and `path` has q* up to
    there. In each phase q* begins anew. `only` names the variables to collect; all unless given.
    """
    attributes: dict[str, Any] = {}
    delivery = Delivery([phase.system for phase in phases])
    traffic = np.zeros(3, dtype=np.int64)
    done = first
    path = path or Path()
    starts = {phase.start for phase in phases}
    for piece in pieces:
        if done in starts:
            path.last = path.held = None
            path.moving = True
        attributes = attributes or _attributes(piece.system, backend, seed) | _about_phases(phases)
        delivery.add(piece)
        samples = np.arange(done, done + len(piece.time))
        done += len(piece.time)
        read_from = Samples(piece, delivery.edges, delivery.sizes, delivery.share, path)
        dataset = gather(read_from, _number_phases(phases or [Phase(0, piece.system)], samples), only)
        traffic += len(piece.time) * np.array(astuple(traffic_of(piece.system.law.terms, piece.system.team)))
        dataset.attrs = attributes | {"status": piece.status, "message": piece.message}
        dataset.attrs |= dict(zip(("exchange_rounds", "messages", "numbers_sent"), traffic.tolist(), strict=True))
        yield dataset


def join(pieces: Iterable[xr.Dataset]) -> xr.Dataset:
    """Join the datasets of a run's pieces."""
    parts = list(pieces)
    if len(parts) == 1:
        return parts[0]
    first, last = parts[0], parts[-1]
    variables: dict[Any, Any] = {}
    for name, variable in first.variables.items():  # equal except for `time`; xarray would check this slowly
        if "time" in variable.dims:
            values = np.concatenate([part.variables[name].values for part in parts], variable.dims.index("time"))
            variables[name] = variable.dims, values, variable.attrs, variable.encoding
        else:
            variables[name] = (last if name == "delivery" else first).variables[name]
    coordinates = {name: variables.pop(name) for name in first.coords}
    return xr.Dataset(variables, coordinates, last.attrs)


def in_pieces(pieces: Iterable[xr.Dataset], samples: int) -> Iterator[xr.Dataset]:
    """Split a run into pieces of `samples` samples, except for the last, whatever its present pieces are."""
    held: list[xr.Dataset] = []
    for piece in pieces:
        held.append(piece)
        while sum(part.sizes["time"] for part in held) > samples:
            whole = join(held)
            yield whole.isel(time=slice(0, samples))
            held = [whole.isel(time=slice(samples, None))]
    if held:
        yield join(held)


def _number_phases(phases: Sequence[Phase], samples: IntArray) -> Coordinate:
    """Return the coordinate `phase` of samples: the number of each one's phase, and the start of each phase.

    `flag_values` and `flag_meanings` follow CF: numbers, and words without blanks. `events` has the original words as a
    JSON list of lists.
    """
    starts = [phase.start for phase in phases]
    number = np.searchsorted(starts, samples, side="right") - 1
    meanings = [re.sub(r"[^\w.+@-]+", "_", phase.name).strip("_") for phase in phases]
    several = len(phases) > 1  # files return an array of one number as a number
    numbers = np.arange(len(phases), dtype=np.int32)
    times = np.array([phase.time for phase in phases])
    attributes = {
        "units": "1",
        "long_name": "number of the phase of the run, from 0 on",
        "flag_values": numbers if several else numbers[0],
        "flag_meanings": " ".join(meanings),
        "start_times": times if several else times[0],
        "start_times_units": "s",
        "events": json.dumps([list(phase.events) for phase in phases]),
    }
    return "time", number.astype(np.int32), attributes


def _about_phases(phases: Sequence[Phase]) -> dict[str, Any]:
    """Return the attributes for a run with events: its phases, and the directions that are free in any of them."""
    if not any(phase.events for phase in phases):
        return {}
    told = json.dumps([{"time": phase.time, "events": list(phase.events)} for phase in phases])
    free = dict.fromkeys(words for phase in phases for words in phase.system.free_directions)
    return {"phases": told, "free_directions": "; ".join(free)}


def of_phase(run: System | Sequence[Phase], dataset: xr.Dataset, which: int) -> tuple[System, xr.Dataset]:
    """Return the system of one phase of a run and its samples, both restricted to the present agents.

    Without events, this is the whole run.

    Args:
        run: System of the run, or its phases.
        dataset: Data of the run.
        which: Number of the phase; -1 is the last phase that the run reached.
    """
    phases = (Phase(0, run),) if isinstance(run, System) else run
    if len(phases) == 1 and not phases[0].system.team.absent:
        return phases[0].system, dataset
    time = dataset["time"].values
    half = 0.5 * phases[0].system.grid.period
    begin = np.searchsorted(time, [phase.time - half for phase in phases])
    reached = [k for k in range(len(phases)) if begin[k] < len(time)]
    k = reached[which]
    end = begin[k + 1] if k + 1 in reached else len(time)
    present = np.flatnonzero(phases[k].system.team.present)
    return phases[k].system.remaining, dataset.isel(time=slice(begin[k], end), agent=present)


class Delivery:
    """Fraction of measurements that arrive over the links of a run, counted piece by piece.

    Attributes:
        edges: Kind and name of the edges that have a link in some phase, in order.
        sizes: Number of components that each communication or sensing edge measures, with or without a link.
        share: Fraction of possible new measurements that arrived, shape (L,). Phases without the link count as 1; NaN
            if none was possible.
    """

    def __init__(self, systems: Sequence[System]) -> None:
        """Start counting in a run under these systems; systems of later pieces are added."""
        self._number: dict[tuple[str, str], int] = {}
        self.sizes: dict[tuple[str, str], int] = {}
        self._new, self._due, self._waiting = (np.zeros(0, dtype=np.int64) for _ in range(3))
        for system in systems:
            self._enter(system)

    @property
    def edges(self) -> list[tuple[str, str]]:
        """Kind and name of each link's edge."""
        return list(self._number)

    @property
    def share(self) -> Array:
        """Fraction of measurements that arrived, shape (L,); see the class."""
        return np.where(self._due > 0, self._new / np.maximum(self._due, 1), np.nan)

    def _enter(self, system: System) -> IntArray:
        """Return the numbers of a system's links, in order."""
        labelled = labelled_edges(system)
        self.sizes |= {key: len(edge.b) for key, edge in labelled}
        keys = [labelled[e][0] for e in system.law.links.table["edge"]]
        for key in keys:
            self._number.setdefault(key, len(self._number))
        more = (0, len(self._number) - len(self._new))
        self._new, self._due, self._waiting = (np.pad(x, more) for x in (self._new, self._due, self._waiting))
        return np.array([self._number[key] for key in keys], dtype=np.int64)

    def add(self, piece: Trajectory) -> None:
        """Count the measurements of a piece."""
        own, table, T = self._enter(piece.system), piece.system.law.links.table, len(piece.time)
        under_way = self._waiting.copy()  # number of samples since each link appeared, up to its delay
        self._waiting[:] = 0
        self._waiting[own] = np.minimum(under_way[own] + T, table["delay"])
        self._due[own] += T - (self._waiting[own] - under_way[own])
        self._new[own] += (piece.log.heard == NEW).sum(axis=0)
        there = {self._number[key] for key, _ in labelled_edges(piece.system) if key in self._number}
        plain = sorted(there.difference(own.tolist()))
        self._due[plain] += T
        self._new[plain] += T


def gather(samples: Samples, phase: Coordinate, only: Collection[str] | None = None) -> xr.Dataset:
    """Read the coordinates of a run and its variables, or `only` some of them, from its samples."""
    time = "time", samples.trajectory.time, {"long_name": "time", "units": "s"}
    # Collected first, because adding variables one by one aligns all of them each time.
    coordinates: dict[str, Coordinate] = {"time": time}
    variables: dict[str, Coordinate] = {}
    chosen = [entry for entry in declared.VARIABLES if only is None or entry.name in only]
    for found, entries in ((coordinates, declared.COORDINATES), (variables, chosen)):
        for entry in entries:
            if entry.where(samples):
                found[entry.name] = entry.dimensions, samples.read(entry), entry.attributes(samples)
            if entry.name == "axis":
                found["phase"] = phase
    return xr.Dataset(variables, coordinates)


def law_of(system: System) -> str:
    """Name the compiled law of a system: the paper's, and the terms that it has in addition."""
    terms = system.law.term_names
    return f"paper's law with {' and '.join(terms)}" if terms else "paper's law"


def _attributes(system: System, backend: str, seed: int) -> dict[str, Any]:
    """Return the attributes of result.nc except for the status."""
    team = system.team
    return {
        "Conventions": "CF-1.11",
        "title": f"mjsheaf run of scenario {system.name}",
        "source": f"mjsheaf {__version__}",
        "scenario": system.name,
        "backend": backend,
        **({"engine": system.bodies.engine} if backend == "physics" and system.bodies.engine != "mujoco" else {}),
        "status": "",
        "message": "",
        "free_directions": "; ".join(system.free_directions),
        "seed": seed,
        "law": law_of(system),
        "gain": system.gain,
        "control_period": 0.0 if system.grid.continuous else system.grid.period,
        "groups": json.dumps(
            {f.name: {"members": list(f.members), "about": f.about or ""} for f in team.formations}, sort_keys=True
        ),
    }
