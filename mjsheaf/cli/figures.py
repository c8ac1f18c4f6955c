"""The picture of a check: spectrum of H, who is free to drift, and the bounded difference."""

from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from mjsheaf.checking.check import Examination
from mjsheaf.checking.record import CheckRecord, headline
from mjsheaf.checking.theorem.certificate import Certificate
from mjsheaf.loop.system import System
from mjsheaf.show.plots import (
    MOST_NAMED,
    NORMAL,
    TICK,
    WIDTH,
    draw_team,
    edge_keys,
    finish_map,
    key,
    label_axes,
    log_axis,
    new_figure,
    place_names,
    settle,
)
from mjsheaf.show.style import AS_USUAL, BLUE, RED, TARGET, FigureOptions

_FREE, _CARRIED, _OWN, _GAP = RED, BLUE, "#E69F00", "#4B5563"
_TARGET_KEY = key("target", color=TARGET, marker="*")


def draw_check(examination: Examination, options: FigureOptions = AS_USUAL) -> Figure:
    """Draw a check: a figure for `write_figure`."""
    record, system = examination.record, examination.system
    figure = new_figure(WIDTH, 7.4, f"{record.scenario}: {headline(record)}", options)
    ((spectrum, graph), (difference, corner)) = figure.subplots(2, 2)
    keys = {
        "spectrum": _spectrum(spectrum, system, record),
        "who is free to drift": _graph(graph, system, record),
        "bounded difference": _difference(difference, system, examination.certificate),
    }
    corner.set_axis_off()
    settle(figure)
    top = 1.03
    for title, rows in keys.items():
        if rows:
            labels = [str(row.get_label()) for row in rows]
            style: dict[str, Any] = {"title_fontsize": NORMAL, "handlelength": 2.2, "labelspacing": 0.3}
            legend = Legend(corner, rows, labels, title=title, loc="upper left", bbox_to_anchor=(-0.08, top),
                            alignment="left", borderaxespad=0.0, frameon=False, fontsize=TICK, **style)  # fmt: skip
            corner.add_artist(legend)
            top -= legend.get_window_extent().height / corner.bbox.height + 0.02
    place = system.initial[:, :2]
    names = [member.id for member in system.team.members]
    targets = np.arange(len(system.team.agents), len(names))
    named = np.concatenate([targets, np.arange(len(system.team.agents))]) if len(names) <= MOST_NAMED else targets
    place_names(graph, [names[v] for v in named[:MOST_NAMED]], place[named[:MOST_NAMED]], place)
    return figure


def _spectrum(
    axis: Any,
    system: System,
    record: CheckRecord,
    *,
    largest: int = 2000,  # eigenvalues; beyond, only the extremes are drawn
) -> list[Line2D]:
    H = system.team.dirichlet.H
    t, few = record.theorem, H.shape[0] <= largest
    values = np.linalg.eigvalsh(H.toarray()) if few else np.array([t.lambda_min, t.lambda_max])
    floor = max(t.lambda_max * 1e-12, 1e-300)
    null = values <= record.relative_cohomology.tolerance**2 * t.lambda_max + floor
    index = np.arange(1, len(values) + 1)
    shown = np.where(null, t.lambda_max * 1e-4, values)
    axis.plot(index[~null], shown[~null], "o", color=_CARRIED, markersize=4, label="eigenvalues of H")
    if null.any():
        axis.plot(index[null], shown[null], "v", color=_FREE, markersize=7, label="zero: free directions")
    if record.margins.hold is not None:
        limit = 2.0 / (t.gain * record.margins.hold.period)
        axis.axhline(limit, color=_GAP, linestyle="--", label=f"2 / (k1 h) = {limit:.3g}: the held law diverges above")
    if record.margins.bodies.largest_gain is not None:
        limit = t.lambda_max * record.margins.bodies.largest_gain / t.gain
        axis.axhline(limit, color=_FREE, linestyle=":", label=f"{limit:.3g}: vehicles unstable above")
    label_axes(
        axis, f"spectrum of H: {t.lambda_min:.3g} to {t.lambda_max:.3g}", "number of the eigenvalue", "eigenvalue"
    )
    axis.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    log_axis(axis, "y", np.concatenate([np.ravel(line.get_ydata()) for line in axis.lines]))
    return list(axis.get_legend_handles_labels()[0])


def _graph(axis: Any, system: System, record: CheckRecord) -> list[Line2D]:
    place = system.initial[:, :2]
    draw_team(axis, system.team, place)
    reach = 0.12 * max(float(np.ptp(place, axis=0).max()), 1.0)
    for direction in record.relative_cohomology.basis:
        for agent, motion in direction.motion.items():
            start, step = place[system.team.index[agent]], np.array(motion[:2])
            if np.linalg.norm(step) > 1e-6:
                for sign in (1.0, -1.0):
                    axis.annotate("", start + sign * reach * step / np.linalg.norm(step), start,
                                  arrowprops={"arrowstyle": "-|>", "color": _FREE, "lw": 1.5}, zorder=4)  # fmt: skip
            if len(motion) > 2 and abs(motion[2]) > 1e-6:  # up and down: a ring with a dot, as arrows seen head-on
                axis.plot(*start, "o", markersize=13, markerfacecolor="none", markeredgecolor=_FREE, mew=1.5, zorder=5)
                axis.plot(*start, ".", color=_FREE, markersize=4, zorder=5)
    dimension, keys = record.relative_cohomology.dimension, [*edge_keys(system.team), _TARGET_KEY]
    if dimension:
        up_and_down = key("free along z", color=_FREE, marker="o", markerfacecolor="none", markersize=9, mew=1.5)
        keys += [up_and_down, key("free in the plane", color=_FREE, lw=2)]
    title = f"free to drift: {f'dimension {dimension}' if dimension else 'nobody'}"
    finish_map(axis, title, "x (m), initial configuration from above", 0.15)
    return keys


def _difference(axis: Any, system: System, certificate: Certificate) -> list[Line2D]:
    """The paper's figure of Assumption 7, at the instant at which the difference is largest."""
    team = system.team
    path, along = certificate.constants.path, certificate.constants.difference
    size = np.linalg.norm(along.values, axis=1)
    if not np.isfinite(size).all():
        why = path.warning or "a target or q* meets a singular kernel"
        label_axes(axis, "bounded difference")
        axis.text(0.5, 0.5, fill(f"not known: {why}", 40), transform=axis.transAxes, ha="center", va="center",
                  fontsize=NORMAL)  # fmt: skip
        axis.set(xticks=[], yticks=[])
        return []
    k, N = int(np.argmax(size)), len(team.agents)
    q_star, targets = team.unpack(path.q_star[k])[:, :2], path.positions[k, N:, :2]
    arrows = [team.unpack(x[k])[:, :2] for x in (along.own, along.carried)]
    longest = max(float(np.linalg.norm(a, axis=1).max()) for a in arrows) or 1.0
    scale = 0.2 * max(float(np.ptp(np.vstack([q_star, targets]), axis=0).max()), 1.0) / longest
    axis.plot(*targets.T, "*", color=TARGET, markersize=8, zorder=2)
    axis.plot(*q_star.T, "x", color="black", markersize=5, zorder=3)
    for a, colour in zip(arrows, (_OWN, _CARRIED), strict=True):
        axis.quiver(
            *q_star.T, *(scale * a).T, angles="xy", scale_units="xy", scale=1, color=colour, width=5e-3, zorder=4
        )
    ends = [[q + scale * a, q + scale * b] for q, a, b in zip(q_star, *arrows, strict=True)]
    axis.add_collection(LineCollection(ends, colors=_GAP, linestyles="--", linewidths=1.0, zorder=5))
    # Arrows do not count for the limits of the axes.
    axis.update_datalim(np.concatenate([*ends, targets]))
    axis.autoscale_view()
    title = f"bounded difference: |f_B| = {size[k]:.3g} m/s at t = {path.time[k]:.4g} s"
    finish_map(axis, title, "x (m), from above", 0.1)
    return [
        key("q*", color="black", marker="x"),
        _TARGET_KEY,
        key("targets' drift, extended: $H^{-1} B f_p$", color=_CARRIED, lw=2),
        key("agents' own drift $f_q(q^*)$", color=_OWN, lw=2),
        key("the gap $f_B$", color=_GAP, linestyle="--"),
    ]
