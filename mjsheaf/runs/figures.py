"""The figures. Matplotlib's object interface is used throughout: no global state, no display."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from mjsheaf.plotting import (
    draw_team,
    finish_map,
    fit_logarithmic,
    group_of_vehicles,
    new_figure,
    palette,
    save_figure,
    thin,
)
from mjsheaf.team import Team

Array = NDArray[np.float64]

_MOST_POINTS = 4000  # of a curve: more cannot be seen


def plot_errors(
    team: Team, dataset: xr.Dataset, path: Path, bound: Array | None = None, approximate: bool = False
) -> None:
    """Errors over time on logarithmic axes: disagreement, tracking, formation and centering, by group.

    Args:
        team: the team.
        dataset: the run.
        path: the PNG.
        bound: Theorem 1's bound on |e(t)|, shape (T,), m; drawn where given, over sqrt(N) as the error is.
        approximate: whether the bound is only approximate: a held law, or bodies.
    """
    figure = new_figure(10.0, 9.0)
    _title(figure, dataset, "errors over time")
    colours = palette(len(team.formations))
    groups, names = group_of_vehicles(team)
    agents = groups[: len(team.agents)]
    keep = thin(dataset.sizes["time"], _MOST_POINTS)
    time = dataset["time"].values[keep]
    eta, tracking = dataset["disagreement"].values[keep], dataset["tracking_error"].values[keep]
    panels = figure.subplots(2, 2, sharex=True)

    def draw(axis: Any, title: str, label: str, total: Array, parts: dict[int, Array], total_name: str) -> None:
        for k, values in parts.items():
            if not np.isnan(values).all():
                axis.plot(time, values, color=colours[k], linewidth=1.1, label=names[k])
        if not np.isnan(total).all():
            axis.plot(time, total, color="black", linewidth=1.8, label=total_name)
            axis.legend(handles=axis.lines[-1:], loc="upper right", frameon=False, fontsize=9)
        fit_logarithmic(axis, np.concatenate([total, *parts.values()]), 2.0, 1e-12)
        axis.set_title(title, fontsize=11)
        axis.set_ylabel(label)
        axis.grid(True, which="major", alpha=0.3)

    present = sorted(set(agents.tolist()))
    draw(
        panels[0, 0], "disagreement", "mean |η| (m)", eta.mean(axis=1),
        {k: eta[:, agents == k].mean(axis=1) for k in present}, "all agents",
    )  # fmt: skip
    draw(
        panels[0, 1], "tracking error |q* − q|", "RMS over agents (m)", np.sqrt((tracking**2).mean(axis=1)),
        {k: np.sqrt((tracking[:, agents == k] ** 2).mean(axis=1)) for k in present}, "all agents",
    )  # fmt: skip
    if bound is not None:
        panels[0, 1].plot(time, bound[keep] / np.sqrt(len(team.agents)), color="black", linestyle="--", linewidth=1.4)
        panels[0, 1].lines[-1].set_label("Theorem 1 / √N" + ", approximate" * approximate)
        panels[0, 1].legend(handles=panels[0, 1].lines[-2:], loc="upper right", frameon=False, fontsize=9)
        panels[0, 1].set_ylim(top=2.0 * max(bound.max() / np.sqrt(len(team.agents)), panels[0, 1].get_ylim()[1] / 2.0))
    by_group = range(len(team.formations))
    formation = dataset["group_formation_error"].values[keep] if team.formations else np.zeros((len(time), 0))
    centering = dataset["group_centering_error"].values[keep] if team.formations else np.zeros((len(time), 0))
    draw(
        panels[1, 0], "formation error", "RMS edge residual (m)", dataset["formation_error"].values[keep],
        {k: formation[:, k] for k in by_group}, "all edges inside groups",
    )  # fmt: skip
    draw(
        panels[1, 1], "centering error", "centroid off its place (m)", dataset["centering_error"].values[keep],
        {k: centering[:, k] for k in by_group}, "largest",
    )  # fmt: skip
    for axis in panels[1]:
        axis.set_xlabel("time (s)")
    # Each panel says what its black line is; the groups' colours are the same in all.
    handles, labels = (x[:-1] for x in panels[0, 0].get_legend_handles_labels())
    figure.legend(handles, labels, loc="lower center", ncols=min(max(len(labels), 1), 6), frameon=False, fontsize=9)
    figure.subplots_adjust(left=0.09, right=0.98, top=0.90, bottom=0.12, hspace=0.16, wspace=0.22)
    save_figure(figure, path)


def plot_trajectories(team: Team, dataset: xr.Dataset, path: Path) -> None:
    """All trajectories over the whole run, in space or, for a planar team, in the plane."""
    spatial = any(m.dimension == 3 for m in team.members)
    figure = new_figure(10.0, 8.0)
    _title(figure, dataset, "all trajectories")
    axis: Any = figure.add_subplot(projection="3d" if spatial else None)
    colours = palette(len(team.formations))
    groups, names = group_of_vehicles(team)
    positions = _positions(dataset)[thin(dataset.sizes["time"], _MOST_POINTS)]
    count = 3 if spatial else 2
    for v in range(positions.shape[1]):
        target = v >= len(team.agents)
        xyz = positions[:, v, :count].T
        axis.plot(*xyz, color=colours[groups[v]], linewidth=0.8, alpha=0.75, linestyle="--" if target else "-")
        axis.plot(*xyz[:, :1], marker="o", markersize=4, color=colours[groups[v]], markerfacecolor="white")
        axis.plot(*xyz[:, -1:], marker="*" if target else "o", markersize=9 if target else 5, color=colours[groups[v]])
    axis.set_xlabel("x (m)")
    axis.set_ylabel("y (m)")
    if spatial:
        axis.set_zlabel("z (m)")
        axis.view_init(elev=28, azim=-60)
    if spatial:  # equal scales, and as large as the figure allows
        limits = (axis.get_xlim(), axis.get_ylim(), axis.get_zlim())
        axis.set_box_aspect([high - low for low, high in limits], zoom=1.12)
    else:
        axis.set_aspect("equal", adjustable="datalim")
    axis.grid(True, alpha=0.3)
    figure.legend(
        handles=_legend(groups, names, colours, edges=False), loc="lower center", ncols=4, frameon=False, fontsize=9
    )
    figure.subplots_adjust(left=0.07, right=0.97, top=0.93, bottom=0.14)
    save_figure(figure, path)


def plot_configurations(team: Team, dataset: xr.Dataset, path: Path) -> None:
    """Initial against final configuration from above, with edges and each agent's harmonic extension."""
    figure = new_figure(14.0, 7.0)
    _title(figure, dataset, "initial and final configuration, seen from above")
    colours = palette(len(team.formations))
    groups, names = group_of_vehicles(team)
    positions, q_star = _positions(dataset), dataset["harmonic_extension"].values
    panels = figure.subplots(1, 2)
    for axis, k, word in zip(panels, (0, -1), ("initial", "final"), strict=True):
        draw_team(axis, team, positions[k, :, :2], "#D62728")
        for v in range(len(team.agents)):
            axis.plot(*q_star[k, v, :2], marker="x", markersize=8, color=colours[groups[v]], zorder=2)
        axis.set_title(f"{word}, t = {float(dataset['time'][k]):.6g} s", fontsize=11)
        finish_map(axis, 0.08)
    figure.legend(
        handles=_legend(groups, names, colours, edges=True), loc="lower center", ncols=5, frameon=False, fontsize=9
    )
    figure.subplots_adjust(left=0.06, right=0.98, top=0.89, bottom=0.18, wspace=0.16)
    save_figure(figure, path)


def _title(figure: Figure, dataset: xr.Dataset, what: str) -> None:
    attrs = dataset.attrs
    unstable = "" if attrs["status"] == "finished" else "   (run blew up)"
    figure.suptitle(f"{attrs['scenario']}: {what}   [{attrs['backend']}, gain {attrs['gain']:g} 1/s]{unstable}")


def _positions(dataset: xr.Dataset) -> Array:
    """Positions (T, V, 3); planar vehicles at z = 0."""
    both = [dataset["agent_position"].values, dataset["target_position"].values]
    return np.nan_to_num(np.concatenate(both, axis=1))


def _legend(groups: NDArray[np.int64], names: list[str], colours: Array, *, edges: bool) -> list[Line2D]:
    handles = []
    for k in sorted(set(groups.tolist())):
        target = names[k] == "targets"
        handles.append(
            Line2D([], [], color=colours[k], marker="*" if target else "o", linestyle="--" if target else "-",
                   label=names[k])
        )  # fmt: skip
    if edges:
        handles += [
            Line2D([], [], color="#8A94A6", linestyle="-", label="communication"),
            Line2D([], [], color="#D62728", linestyle=":", label="sensing"),
            Line2D([], [], color="black", marker="x", linestyle="", label="harmonic extension q*"),
        ]
    else:
        handles += [
            Line2D([], [], color="black", marker="o", markerfacecolor="white", linestyle="", label="start"),
            Line2D([], [], color="black", marker="o", linestyle="", label="end"),
        ]
    return handles
