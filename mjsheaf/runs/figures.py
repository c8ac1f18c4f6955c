"""The figures of a run: errors over time, trajectories, first and last configuration."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.lines import Line2D

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.plotting import (
    LOST,
    draw_team,
    edge_keys,
    finish_map,
    groups_of,
    key,
    label_axes,
    legend_below,
    log_axis,
    new_figure,
    save_figure,
)
from mjsheaf.results.metrics import mean_known, phases_in
from mjsheaf.team import Team


def plot_errors(team: Team, dataset: xr.Dataset, path: Path, bound: tuple[str, Array] | None = None) -> None:
    """Errors over time on logarithmic axes: disagreement, tracking, formation and centering, by group.

    Args:
        team: the team.
        dataset: the run, thinned to what can be seen.
        path: the PNG.
        bound: a name, and a bound on |e(t)|, shape (T,), m; drawn where given, over sqrt(N) as the error is.
    """
    linked = "arrival" in dataset
    figure = new_figure(10.0, 10.5 if linked else 9.0, _title(dataset, "errors over time"))
    groups, names, colours = groups_of(team)
    agents = groups[: len(team.agents)]
    time = dataset["time"].values
    if linked:
        parts: Any = figure.subfigures(2, 1, height_ratios=[4, 1])
        errors, below = parts
        panels = errors.subplots(2, 2, sharex=True)
        _plot_arrival(below.subplots(), dataset)
    else:
        panels = figure.subplots(2, 2, sharex=True)

    def draw(
        axis: Any, title: str, label: str, parts: dict[int, Array], lines: dict[str, tuple[Array, dict[str, Any]]]
    ) -> None:
        """Draw the groups' errors, and lines of the team by name."""
        for k, values in parts.items():
            if not np.isnan(values).all():
                axis.plot(time, values, color=colours[k], linewidth=1.1, label=names[k])
        known = {name: line for name, line in lines.items() if not np.isnan(line[0]).all()}
        drawn = [axis.plot(time, y, color="black", label=name, **style)[0] for name, (y, style) in known.items()]
        if drawn:
            axis.legend(handles=drawn, loc="upper right", frameon=False, fontsize=9)
        log_axis(axis, "y", np.concatenate([*parts.values(), *(y for y, _ in lines.values())]))
        label_axes(axis, title, y=label)
        mark_events(axis, dataset, named=axis in panels[0])

    solid: dict[str, Any] = {"linewidth": 1.8}
    members = {k: agents == k for k in sorted(set(agents.tolist()))}
    eta, square = dataset["disagreement"].values, dataset["tracking_error"].values ** 2
    own = {k: mean_known(eta[:, chosen]) for k, chosen in members.items()}
    draw(panels[0, 0], "disagreement", "mean |η| (m)", own, {"all agents": (mean_known(eta), solid)})
    own = {k: np.sqrt(mean_known(square[:, chosen])) for k, chosen in members.items()}
    lines = {"all agents": (np.sqrt(mean_known(square)), solid)}
    if bound is not None:
        dashed = {"linestyle": "--", "linewidth": 1.4}
        lines[f"{bound[0]} / √N"] = bound[1] / np.sqrt(team.present.sum()), dashed
    draw(panels[0, 1], "tracking error |q* − q|", "RMS over agents (m)", own, lines)
    for axis, name, label, whole in (
        (panels[1, 0], "formation", "RMS edge residual (m)", "all edges inside groups"),
        (panels[1, 1], "centering", "centroid off its place (m)", "largest"),
    ):
        own = dict(enumerate(dataset[f"group_{name}_error"].values.T)) if team.formations else {}
        draw(axis, f"{name} error", label, own, {whole: (dataset[f"{name}_error"].values, solid)})
        axis.set_xlabel("time (s)")
    # Each panel says what its black lines are; the groups' colours are the same in all.
    named = [line for line in panels[0, 0].lines if not str(line.get_label()).startswith("_")]
    legend_below(figure, named[:-1], min(len(members), 6))
    save_figure(figure, path)


def _plot_arrival(axis: Any, dataset: xr.Dataset) -> None:
    """The share of measurements that arrive, the mean over a hundredth of the run about each sample."""
    time, share = dataset["time"].values, dataset["arrival"].values
    total = np.cumsum(np.r_[0.0, share])
    half, k = max(1, len(share) // 200), np.arange(len(share))
    low, high = np.maximum(k - half, 0), np.minimum(k + half + 1, len(share))
    axis.plot(time, (total[high] - total[low]) / (high - low), color="black", linewidth=1.2)
    label_axes(axis, "measurements that arrive", "time (s)", "share of edges")
    axis.set_ylim(-0.03, 1.03)
    mark_events(axis, dataset, named=False)


def mark_events(axis: Any, dataset: xr.Dataset, *, named: bool) -> None:
    """Mark when each phase of a run with events begins, and name what happens there."""
    for phase in phases_in(dataset):
        if phase["events"]:
            axis.axvline(phase["time"], color=LOST, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
            if named:
                place = {"xycoords": axis.get_xaxis_transform(), "xytext": (3, 3), "textcoords": "offset points"}
                words = "\n".join(phase["events"])
                axis.annotate(words, (phase["time"], 0.0), rotation=90, fontsize=7.5, color="dimgrey", **place)


def plot_trajectories(team: Team, dataset: xr.Dataset, path: Path) -> None:
    """All trajectories over the whole run, in space or, for a planar team, in the plane; the run thinned.

    Absent agents are grey, and drawn as far as they stay where the others are.
    """
    count = max(m.dimension for m in team.members)
    figure = new_figure(10.0, 8.0, _title(dataset, "all trajectories"))
    axis: Any = figure.add_subplot(projection="3d" if count == 3 else None)
    groups, names, colours = groups_of(team)
    absent = np.isnan(dataset["tracking_error"].values).T
    tracks = np.moveaxis(_positions(dataset)[..., :count], 0, 2)
    low, high = _room(tracks, absent)
    for v, whole in enumerate(tracks):
        target, colour, xyz = v >= len(team.agents), colours[groups[v]], whole
        if not target and absent[v].any():
            outside = ((whole < low) | (whole > high)).any(axis=0)
            axis.plot(*np.where(absent[v] & ~outside, whole, np.nan), color=LOST, linewidth=0.8)
            xyz = whole[:, ~absent[v]]
        axis.plot(*xyz, color=colour, linewidth=0.8, alpha=0.75, linestyle="--" if target else "-")
        axis.plot(*xyz[:, :1], marker="o", markersize=4, color=colour, markerfacecolor="white")
        lost = not target and absent[v, -1]
        end, size = ("X", 7) if lost else ("*", 9) if target else ("o", 5)
        axis.plot(*xyz[:, -1:], marker=end, markersize=size, color=LOST if lost else colour)
    label_axes(axis, "", "x (m)", "y (m)")
    if count == 3:  # equal scales, and as large as the figure allows
        axis.set_zlabel("z (m)")
        axis.view_init(elev=28, azim=-60)
        axis.set_box_aspect(np.ptp([axis.get_xlim(), axis.get_ylim(), axis.get_zlim()], axis=1), zoom=1.05)
    else:
        axis.set_aspect("equal", adjustable="datalim")
    ends = [key("start", color="black", marker="o", markerfacecolor="white"), key("end", color="black", marker="o")]
    if absent[:, -1].any():
        ends.append(key("lost", color=LOST, marker="X"))
    legend_below(figure, [*_group_keys(groups, names, colours), *ends], 4)
    save_figure(figure, path)


def _room(tracks: Array, absent: BoolArray) -> tuple[Array, Array]:
    """Corners, a tenth larger each way, of the box about tracks (V, axes, T) but for agents while absent (N, T)."""
    known = tracks.copy()
    known[: len(absent)] = np.where(absent[:, None], np.nan, known[: len(absent)])
    low, high = (bound(known, axis=(0, 2))[:, None] for bound in (np.nanmin, np.nanmax))
    return low - 0.1 * (high - low), high + 0.1 * (high - low)


def plot_configurations(team: Team, last: Team, dataset: xr.Dataset, path: Path) -> None:
    """Initial against final configuration from above, with edges and each agent's harmonic extension.

    `last` is the team of the last phase; absent agents are grey.
    """
    figure = new_figure(14.0, 7.0, _title(dataset, "initial and final configuration, seen from above"))
    groups, names, colours = groups_of(team)
    shown = zip(figure.subplots(1, 2), (0, -1), ("initial", "final"), (team, last), strict=True)
    for axis, k, word, now_team in shown:
        now = dataset.isel(time=[k])
        draw_team(axis, now_team, _positions(now)[0, :, :2])
        for i, goal in enumerate(now["harmonic_extension"].values[0, :, :2]):
            axis.plot(*goal, marker="x", markersize=8, color=colours[groups[i]], zorder=2)
        finish_map(axis, f"{word}, t = {float(now['time'][0]):.6g} s", "x (m)", 0.08)
    goals = key("harmonic extension q*", color="black", marker="x")
    legend_below(figure, [*_group_keys(groups, names, colours), *edge_keys(), goals], 5)
    save_figure(figure, path)


def _title(dataset: xr.Dataset, what: str) -> str:
    attrs = dataset.attrs
    unstable = "" if attrs["status"] == "finished" else "   (run blew up)"
    return f"{attrs['scenario']}: {what}   [{attrs['backend']}, gain {attrs['gain']:g} 1/s]{unstable}"


def _positions(dataset: xr.Dataset) -> Array:
    """Positions (T, V, 3); planar vehicles at z = 0."""
    both = [dataset["agent_position"].values, dataset["target_position"].values]
    return np.nan_to_num(np.concatenate(both, axis=1))


def _group_keys(groups: IntArray, names: list[str], colours: Array) -> list[Line2D]:
    style = {True: {"marker": "*", "linestyle": "--"}, False: {"marker": "o", "linestyle": "-"}}
    return [key(names[k], color=colours[k], **style[names[k] == "targets"]) for k in sorted(set(groups.tolist()))]
