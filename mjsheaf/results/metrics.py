"""Error norms of a run: distances from the desired positions at every sample, final errors, and expectations."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, repeat
from typing import Any

import numpy as np
import xarray as xr
from scipy.spatial import cKDTree

from mjsheaf.arrays import Array, IntArray
from mjsheaf.law.obstacles import distances
from mjsheaf.law.safety import SafetyArrays
from mjsheaf.scenario.scenario import Expect
from mjsheaf.section import PER_AGENT_RMS, finite
from mjsheaf.team import Formation, Team
from mjsheaf.team.links import KINDS
from mjsheaf.team.team import Path

ROUNDING_ERROR = 1e-9
"""Errors below this are rounding, which differs between machines, m."""
_ROUNDING = 1e-12  # fraction of the largest displacement below which a mean displacement counts as zero


@dataclass(frozen=True)
class Errors:
    """Errors of a run of T samples, in m; those of absent agents are NaN, and groups are their present members.

    Attributes:
        harmonic_extension: q*, padded with NaN, shape (T, N, 3).
        tracking: |q*_i - q_i|, shape (T, N).
        formation: residual norm |F_i x_i - F_j x_j - b_e| of each edge inside a formation, for each group, (T, edges);
            of a range the error of the distance, of a bearing the distance times the error of the unit vector.
        centering: Distance of each group's centroid from its desired position, shape (T,): the projection of its
            target plus the mean of the members' desired displacements. NaN if the group has no target.
    """

    harmonic_extension: Array
    tracking: Array
    formation: dict[str, Array]
    centering: dict[str, Array]

    def formation_rms(self, group: str | None = None) -> Array:
        """Compute the RMS error over the edges of a group, or of all groups, shape (T,), m; NaN without edges."""
        residuals = self.formation.values() if group is None else [self.formation[group]]
        r = np.concatenate([np.zeros((len(self.tracking), 0)), *residuals], axis=1)
        return np.sqrt((r**2).mean(axis=1)) if r.shape[1] else np.full(len(r), np.nan)

    def largest_centering(self) -> Array:
        """Compute the largest centering error over groups with a target, shape (T,), m; NaN if there are none."""
        distances = [d for d in self.centering.values() if not np.isnan(d).all()]
        return np.max(distances, axis=0) if distances else np.full(len(self.tracking), np.nan)


def lengths(vectors: Array) -> Array:
    """Return the lengths of vectors (..., n), shape (...); numpy's norm over a short axis takes five times as long."""
    squares = vectors * vectors
    return np.sqrt(sum((squares[..., k] for k in range(1, squares.shape[-1])), squares[..., 0]))


def evaluate_errors(team: Team, positions: Array, path: Path | None = None, time: Array | None = None) -> Errors:
    """Compute all errors from positions (T, V, 3), m, with a q* that continues a path if one is given.

    Times (T,), s, are needed while formations change.
    """
    q, p = team.split(positions)
    q_star = team.extend(p, q, path, time)
    residuals = team.edge_residuals(positions, time)
    number = {id(edge): e for e, edge in enumerate(team.measuring_edges)}
    inside = {f.name: [number[id(edge)] for edge in team.formation_edges(f)] for f in team.formations}
    return Errors(
        harmonic_extension=team.unpack(q_star, np.nan),
        tracking=lengths(team.unpack(q_star - q)),
        formation={name: residuals[:, edges] for name, edges in inside.items()},
        centering={f.name: _centering(team, f, positions, time) for f in team.formations},
    )


def _centering(team: Team, formation: Formation, positions: Array, time: Array | None) -> Array:
    """Compute the distance of the centroid from the target's projection plus the mean desired displacement, (T,), m.

    Only the coordinates that all members and the target share count. An explicit `offset` of an edge changes the law,
    but not the desired positions of the formation.
    """
    known = [m for m in formation.members if m not in team.absent]
    if formation.about is None or not known:
        return np.full(len(positions), np.nan)
    members = [team.index[m] for m in known]
    target = team.index[formation.about]
    shared = min(team.members[v].dimension for v in [*members, target])
    mean = _mean_place(team, known, shared)
    if team.ramp is not None:
        first, last = (_mean_place(one, known, shared) for one in (team.ramp.first, team.ramp.last))
        mean = first + team.ramp.share(time) * (last - first)
    centroid = positions[:, members, :shared].mean(axis=1)
    return lengths(centroid - positions[:, target, :shared] - mean)


def _mean_place(team: Team, members: Sequence[str], axes: int) -> Array:
    """Return the mean of the first coordinates of the members' displacements, shape (axes,), m."""
    wanted = np.array([team.displacement[m][:axes] for m in members])
    mean = wanted.mean(axis=0)
    mean[np.abs(mean) <= _ROUNDING * np.abs(wanted).max()] = 0.0  # a polygon's corners cancel only up to rounding
    return np.asarray(mean)


def separations(positions: Array) -> Array:
    """Compute each vehicle's distance to its nearest neighbour from positions (T, V, 3), shape (T, V), m; else NaN.

    Up to 100 vehicles are compared pair by pair.
    """
    T, V, _ = positions.shape
    found = np.full((T, V), np.nan)
    known = np.flatnonzero(np.isfinite(positions).all(axis=(1, 2))) if V > 1 else np.empty(0, dtype=np.int64)
    if V > 100:
        _find_nearest(positions, known, found)
        return found
    x, y, z = np.ascontiguousarray(positions.T)  # (V, T) each
    nearest = np.full((V, T), np.inf)
    for shift in range(1, V):  # every pair once, which is much faster than a tree for each sample
        squares = (x[shift:] - x[:-shift]) ** 2 + (y[shift:] - y[:-shift]) ** 2 + (z[shift:] - z[:-shift]) ** 2
        for near in (nearest[shift:], nearest[:-shift]):
            np.minimum(near, squares, out=near)
    found[known] = np.sqrt(nearest.T[known])
    return found


def _find_nearest(positions: Array, known: IntArray, found: Array) -> None:
    """Write the distances of many vehicles to their nearest neighbours at the samples `known` into found (T, V).

    Six neighbours that were near at an earlier sample contain the nearest one as long as it is nearer than others can
    be. Those were `far` away, and two vehicles approach each other by at most twice the largest displacement, less the
    mean one.
    """
    before, far, near = np.zeros(positions.shape[1:]), np.zeros(1), np.zeros((1, positions.shape[1]), dtype=np.int64)
    for k in known:
        x = positions[k]
        moved = x - before
        reach = 2.0 * np.linalg.norm(moved - moved.mean(axis=0), axis=1).max()
        found[k] = np.linalg.norm(x[near] - x, axis=2).min(axis=0)
        if not ((found[k] + reach) * (1.0 + _ROUNDING) < far).all():
            away, who = cKDTree(x, balanced_tree=False, compact_nodes=False).query(x, 8)  # itself, six, and one beyond
            others = np.where(who == np.arange(len(x))[:, None], who[:, :1], who)  # of one place, another may be first
            before, found[k], far, near = x, away[:, 1], away[:, -1], others[:, 1:-1].T


def clearances(safety: SafetyArrays, times: Array, places: Array) -> Array:
    """Compute the smallest distance minus the required one over all pairs with an agent, shape (T,), m.

    Args:
        safety: Parameters of the safety filter, without margins.
        times: Times of the samples, s.
        places: Positions in space, shape (T, V, 3), m; a vehicle at NaN does not count.
    """
    N, radius = safety.agents, safety.radius
    found = np.full(len(times), np.inf)
    for k, at in enumerate(places):
        known = np.flatnonzero(np.isfinite(at).all(axis=1))
        tree = cKDTree(at[known])
        agents = known[known < N]
        if len(known) < 2 or not len(agents):
            continue
        # The smallest gap of the nearest pairs bounds the distance of all pairs with a smaller gap.
        near, who = tree.query(at[agents], 2)
        left = (near[:, 1] - radius[agents] - radius[known[who[:, 1]]]).min()
        reach = max(left, 0.0) + 2.0 * radius[known].max()
        pairs = known[tree.query_pairs(reach * (1.0 + 1e-12), output_type="ndarray").reshape(-1, 2)]
        pairs = pairs[(pairs < N).any(axis=1)]
        away = np.linalg.norm(at[pairs[:, 0]] - at[pairs[:, 1]], axis=1) - radius[pairs].sum(axis=1)
        found[k] = min(left, away.min(initial=np.inf))
    if len(safety.obstacles.kind):
        clear = distances(safety.obstacles, times, places[:, :N]) - safety.clearance[:N, None]
        found = np.fmin(found, np.nanmin(clear, axis=(1, 2)))
    return found


def safety_of(dataset: xr.Dataset) -> dict[str, Any] | None:
    """Return the field `safety` of summary.json from the data of a whole run; None without a filter.

    An agent is deadlocked if the filter still keeps it from its place: over the last tenth of the run, the filter acts
    at most samples, its mean correction exceeds half of the mean speed that remains, and the tracking error does not
    fall to a tenth. So agents that stop are deadlocked, and also agents that circle without arriving, which
    `circling` names: they still move by a fifth of their error, in the world and relative to the centre of the team.
    """
    if "separation" not in dataset:
        return None
    correction, command = dataset["safety_correction"].values, dataset["velocity_command"].values
    agents = [str(name) for name in dataset["agent"].values]
    end = slice(-max(2, len(correction) // 10), None)
    speed = np.sqrt(np.nansum(command[end] ** 2, axis=2))
    stuck = (correction[end] > 0.0).mean(axis=0) > 0.5
    stuck &= correction[end].mean(axis=0) > 0.5 * speed.mean(axis=0)
    error = dataset["tracking_error"].values[end]
    stuck &= ~(error[-1] < 0.1 * error[0])
    places = dataset["agent_position"].values[end]
    there = np.isfinite(places)
    middle = np.where(there, places, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)  # of the present agents
    circling = stuck.copy()
    for path in (places, places - middle[:, None]):
        moved = np.sqrt(np.nansum((path - path[0]) ** 2, axis=2)).max(axis=0)
        circling &= moved > 0.2 * error.mean(axis=0)
    infeasible = (dataset["safety_violation"].values > 0.0).mean(axis=0)
    return {
        "smallest_separation": finite(dataset["separation"].values.min()),
        "filtered": dict(zip(agents, (correction > 0.0).mean(axis=0).tolist(), strict=True)),
        "deadlocked": [name for name, one in zip(agents, stuck, strict=True) if one],
        "circling": [name for name, one in zip(agents, circling, strict=True) if one],
        "infeasible": {name: share for name, share in zip(agents, infeasible.tolist(), strict=True) if share},
    }


def mean_known(values: Array) -> Array:
    """Compute the mean over agents of values (T, N) that are not NaN, shape (T,); NaN if all are."""
    known = ~np.isnan(values)
    if known.all():
        return np.asarray(values.mean(axis=1))
    count = known.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(known, values, 0.0).sum(axis=1) / count)


MEASURES = ("mean_disagreement", "tracking_error", "formation_error", "centering_error")


def error_series(
    team: Team, positions: Array, time: Array | None = None
) -> tuple[dict[str, Array], dict[str, dict[str, Array]]]:
    """Compute the errors over time of the team and of each group from positions alone, by measure, shape (T,), m.

    They are NaN if undefined, and without `mean_disagreement`.

    Args:
        team: Team whose errors are computed.
        positions: Positions of the vehicles, shape (T, V, 3), m.
        time: Times of the samples, shape (T,), s; they matter while formations change.
    """
    errors = evaluate_errors(team, positions, time=time)

    def measures(members: list[int] | slice, formation: Array, centering: Array) -> dict[str, Array]:
        tracking = np.sqrt(mean_known(errors.tracking[:, members] ** 2))
        return {"tracking_error": tracking, "formation_error": formation, "centering_error": centering}

    groups = {
        f.name: measures([team.index[m] for m in f.members], errors.formation_rms(f.name), errors.centering[f.name])
        for f in team.formations
    }
    return measures(slice(None), errors.formation_rms(), errors.largest_centering()), groups


def series_of(team: Team, dataset: xr.Dataset, begin: int) -> tuple[dict[str, Array], dict[str, dict[str, Array]]]:
    """Return the errors over time of a run from sample `begin` on, as `error_series` and `mean_disagreement`."""

    def read(name: str) -> Array:
        return np.asarray(dataset.variables[name][begin:].values)  # in less time than from a part of the dataset

    eta, tracking = read("disagreement"), read("tracking_error")

    def measures(members: list[int] | slice, name: str, k: int | None) -> dict[str, Array]:
        own = {f"{kind}_error": read(f"{name}{kind}_error") for kind in ("formation", "centering")}
        return {
            "mean_disagreement": mean_known(eta[:, members]),
            "tracking_error": np.sqrt(mean_known(tracking[:, members] ** 2)),
            **(own if k is None else {measure: values[:, k] for measure, values in own.items()}),
        }

    groups = {f.name: measures([team.index[m] for m in f.members], "group_", k) for k, f in enumerate(team.formations)}
    return measures(slice(None), "", None), groups


def summarize(team: Team, dataset: xr.Dataset) -> dict[str, Any]:
    """Return the errors of the team and of each group at the last sample, m; None if a measure is undefined.

    The field `norm` records that none of them is a norm over the whole team: `tracking_error` is the RMS over agents.
    """
    everyone, groups = series_of(team, dataset, -1)
    final, *own = (
        {**{name: finite(x[0]) for name, x in series.items()}, "norm": PER_AGENT_RMS}
        for series in (everyone, *groups.values())
    )
    return {"time": float(dataset["time"][-1]), **final, "groups": dict(zip(groups, own, strict=True))}


def summarize_phases(team: Team, dataset: xr.Dataset) -> list[dict[str, Any]]:
    """List the phases of a run with events: start, s, events, and errors at the last sample, m.

    Phases that the run did not reach, and those without samples, have no errors.
    """
    found, time = phases_in(dataset), dataset["time"].values
    starts = np.searchsorted(time, [phase["time"] for phase in found] + [np.inf], side="left")
    for phase, begin, end in zip(found, starts, starts[1:], strict=False):
        phase["final"] = summarize(team, dataset.isel(time=slice(begin, end))) if end > begin else None
    return found


def phases_in(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """List the phases of a run with events: `time` of the first sample, s, and `events` in words; else none."""
    return json.loads(dataset.attrs["phases"]) if "phases" in dataset.attrs else []


def error_series_of(team: Team, dataset: xr.Dataset) -> dict[str, list[float | None]]:
    """Return time, s, and the team's errors over time, m, as plain numbers; None if a measure is undefined."""
    everyone, _ = series_of(team, dataset, 0)
    series = {"time": dataset["time"].values, **everyone}
    return {name: [finite(x) for x in values.tolist()] for name, values in series.items()}


def late_errors(team: Team, dataset: xr.Dataset) -> dict[str, float | None]:
    """Compute the RMS of the team's errors over the second half of a run, m; None if a measure is undefined."""
    time = dataset["time"].values
    everyone, _ = series_of(team, dataset, int(np.searchsorted(time, 0.5 * (time[0] + time[-1]) - 1e-9)))
    return {name: finite(np.sqrt((x**2).mean())) for name, x in everyone.items()}


def communication(dataset: xr.Dataset, samples: int, period: float) -> dict[str, float]:
    """Compute the exchanges per second, and the numbers that an agent sends per second, as a mean over agents.

    In an exchange every agent sends to all its neighbours. Each round of a term of the law is an exchange: the ends of
    a communication edge of dimension m send m numbers to each other. The paper's law measures, and sends nothing.

    Args:
        dataset: Data of a run, which may be thinned.
        samples: Number of samples of the whole run.
        period: Time between samples, s.
    """
    time = samples * period
    return {
        "exchanges_per_second": dataset.attrs["exchange_rounds"] / time,
        "numbers_per_agent_second": dataset.attrs["numbers_sent"] / (time * dataset.sizes["agent"]),
    }


def delivery_of(dataset: xr.Dataset) -> dict[str, Any] | None:
    """Return the fraction of measurements that arrived, for each kind as a mean over edges with links, and per edge.

    None without links. A kind is None if it has no such edges, or if the run is too short for a measurement to arrive.
    """
    if "delivery" not in dataset:
        return None
    share, kind, edge = (dataset[name].values for name in ("delivery", "edge_kind", "edge"))
    found: dict[str, Any] = {}
    for name in KINDS:
        known = share[(kind == name) & np.isfinite(share)]
        found[name] = float(known.mean()) if len(known) else None
    found["edges"] = {
        name: dict(zip(edge[kind == name], map(finite, share[kind == name]), strict=True)) for name in KINDS
    }
    return found


def law_in_words(dataset: xr.Dataset) -> str:
    """Describe the law of a run for titles: the gain of the paper's law, or the name of a law in Python."""
    attrs = dataset.attrs
    return f"law {attrs['controller']}" if attrs.get("controller") else f"gain {attrs['gain']:g} 1/s"


def engine_of(dataset: xr.Dataset) -> str | None:
    """Return the physics engine of a run; None for ideal kinematics."""
    return str(dataset.attrs.get("engine", "mujoco")) if dataset.attrs["backend"] == "physics" else None


def check_expectation(
    expect: Expect,
    backend: str,
    status: str,
    final: dict[str, Any],
    phases: Sequence[dict[str, Any]] = (),
    safety: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Compare final errors, and those at the end of each phase, with the scenario's `expect:` block for a backend.

    `safety` is what `safety_of` returns: its smallest separation must be at least the expected one.

    Returns:
        {"met": True, False, or None without expectations; "checks": one record per bound}. If a refusal is expected, a
        run does not meet it.
    """
    bounds = getattr(expect, backend)
    checks: list[dict[str, Any]] = []

    def compare(measure: str, bound: float | None, found: float | None, *, at_least: bool = False) -> None:
        if bound is not None:
            fits = found is not None and (found >= bound - ROUNDING_ERROR if at_least else found <= bound)
            met = status == "finished" and fits
            checks.append({"measure": measure, "bound": bound, "found": found, "met": met})

    if expect.refused is not None:
        checks.append({"measure": "refused", "bound": expect.refused, "found": None, "met": False})
    if bounds is not None:
        smallest = (safety or {}).get("smallest_separation")
        compare("smallest_separation", bounds.smallest_separation, smallest, at_least=True)
        pairs = zip(bounds.phases or [], chain(phases, repeat({"final": None})), strict=False)
        ends = [(f"phases.{k}.", part, phase) for k, (part, phase) in enumerate(pairs)]
        for place, part, phase in [("", bounds, {"final": final}), *ends]:
            for name in MEASURES:
                compare(place + name, getattr(part, name), (phase["final"] or {}).get(name))
    return {"met": all(c["met"] for c in checks) if checks else None, "checks": checks}
