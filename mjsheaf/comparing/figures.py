"""Figures of a comparison: errors of the variants over time, the error budget, convergence in the time constant."""

from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from mjsheaf.comparing.causes import CompareRecord
from mjsheaf.comparing.variants import (
    FORMATION,
    RMS_OVER,
    TEAM,
    TRACKING,
    BudgetRecord,
    Run,
    RungRecord,
    display_name,
    distances,
)
from mjsheaf.results.store import thin
from mjsheaf.show.plots import (
    NORMAL,
    SMALL,
    TICK,
    WIDTH,
    label_axes,
    label_ends,
    legend_below,
    log_axis,
    mark_times,
    new_figure,
    save_figure,
    settle,
    spread_ends,
)
from mjsheaf.show.style import AS_USUAL, BLUE, RED, FigureOptions, line_style

_ALL, _BASE, _GREY = RED, "#8A94A6", "#C4CAD4"
_GREYS = {0: "#7B8494", 1: "#5B6472", 2: "#2F3A4A"}  # colours of the first three variants, which have no effect yet
_MOST_POINTS, _MOST_PANELS = 1500, 4


def plot_rungs(record: CompareRecord, runs: dict[str, Run], path: Path, options: FigureOptions = AS_USUAL) -> None:
    """Plot the team's tracking and formation error and its distance to the ideal run over time, one line per variant.

    Lines differ in colour, dashes and marker, and are labelled at their ends.
    """
    ideal = runs["ideal"]
    drawn = {
        TRACKING: "tracking error (m)\nRMS over agents",
        FORMATION: "formation error (m)\nRMS over edges in groups",
        "distance": "distance to the ideal run (m)\nof the agent farthest from it",
    }
    if np.isnan(ideal.series[TEAM][FORMATION]).all():  # a team without formations
        del drawn[FORMATION]
    title = f"{record.scenario}: what each effect does, {record.law_in_words}"
    rungs = choose_rungs(record)
    figure = new_figure(WIDTH, 1.1 + max(2.1, 0.2 * len(rungs)) * len(drawn), title, options)
    panels = figure.subplots(len(drawn), 1, sharex=True)
    start = float(ideal.time[0])
    end = start + record.time_s
    eventful = [phase for phase in record.phases if phase.events]
    for axis, (name, title) in zip(panels, drawn.items(), strict=True):
        ends = _draw_rungs(axis, name, rungs, runs)
        label_axes(axis, "", y=title)
        axis.axvspan(end - record.time_s / 2, end, color="black", alpha=0.04, linewidth=0)
        axis.set_xlim(start, end)
        mark_times(axis, [phase.start for phase in eventful])
        label_ends(axis, ends)
    happened = [f"{k}: {', '.join(phase.events)} ({phase.start:.6g} s)" for k, phase in enumerate(eventful, 1)]
    shaded = "time (s); the error budget of the whole run covers the shaded half"
    panels[-1].set_xlabel(f"{shaded}\n{fill('   '.join(happened), 100)}".strip(), fontsize=NORMAL)
    figure.align_ylabels(panels)
    settle(figure)
    for axis in panels:
        spread_ends(axis)
    save_figure(figure, path, options)


def _draw_rungs(axis: Any, name: str, rungs: list[RungRecord], runs: dict[str, Run]) -> list[tuple[float, str, Any]]:
    """Draw an error of the team, or the distance to the ideal run, over time, one line per variant.

    Returns:
        Last value, label and colour of each line.
    """
    values = [np.zeros(0)]
    ends = []
    for k, rung in enumerate(rungs):
        run = runs[rung.key]
        apart = distances(run.dataset, runs["ideal"].dataset).max(axis=1)
        keep = thin(len(apart), _MOST_POINTS)
        y = (run.series[TEAM] | {"distance": apart})[name][keep]
        y = np.where(y > 0.0, y, np.nan)  # a logarithmic axis has no zero
        label = f"{rung.label} (BLOWS UP)"
        if rung.status == "finished":
            values.append(y)
            label = rung.label
        if np.isfinite(y).any():
            style = _style(rung, k)
            axis.plot(run.time[keep], y, **style)
            ends.append((float(y[np.isfinite(y)][-1]), label, style["color"]))
    log_axis(axis, "y", np.concatenate(values), decades=4)
    return ends


def plot_budget(record: CompareRecord, path: Path, options: FigureOptions = AS_USUAL) -> None:
    """Plot bars of what each effect adds alone, and what removing it gives back, for the team and its groups."""
    known = record.scopes
    scopes = known[:1] if len(known) == 2 else known[: _MOST_PANELS + 1]  # a single group repeats the team
    budgets = [record.budget(scope, record.measure, "late") for scope in scopes]
    order = sorted(budgets[0].effects, key=lambda item: abs(item.give_back_m or 0.0))
    names = ["targets become bodies", "agents become bodies", "interaction of effects"]
    rows = ["at q* already", *names, *(display_name(item.effect) for item in order)]
    what = f"{display_name(record.measure)} ({RMS_OVER[record.measure]} and the second half)"
    figure = new_figure(
        max(WIDTH, 1.9 + 1.75 * len(scopes)),
        1.2 + 0.36 * len(rows),
        f"{record.scenario}: causes of the {what}",
        options,
    )
    panels = np.atleast_1d(figure.subplots(1, len(scopes), sharey=True))
    for axis, scope, budget in zip(panels, scopes, budgets, strict=True):
        _bars(axis, scope, budget, [item.effect for item in order])
    panels[0].set_yticks(range(len(rows)), rows, fontsize=NORMAL)
    legend_below(figure, panels[0].get_legend_handles_labels()[0], 2)
    save_figure(figure, path, options)


def plot_convergence(record: CompareRecord, path: Path, options: FigureOptions = AS_USUAL) -> None:
    """Plot the distance to the ideal run against the time constant, with fitted and predicted slope."""
    figure = new_figure(
        0.65 * WIDTH,
        3.6,
        f"{record.scenario}: bodies converge to the ideal run as their time constant tau shrinks",
        options,
    )
    axis: Any = figure.add_subplot()
    found = record.convergence
    known = [(p.tau_s, p.distance_m) for p in found.points if p.distance_m]
    if known and found.slope is not None and found.constant is not None:
        tau, distance = np.array(known).T
        span = np.array([tau.min() / 1.3, tau.max() * 1.3])
        first = distance[-1] / tau[-1]
        axis.loglog(span, first * span, color=_GREY, linewidth=5, label="slope 1, predicted by theory")
        axis.loglog(span, found.constant * span**found.slope, color=_ALL, label=f"fitted slope {found.slope:.3f}")
        axis.loglog(tau, distance, "o", color="black", label="bodies with inertia alone")
        axis.legend(frameon=False, fontsize=TICK)
        log_axis(axis, "x", span)
        log_axis(axis, "y", np.concatenate([distance, first * span]))
    else:
        axis.text(
            0.5,
            0.5,
            fill(found.reason or "too few runs finished", 60),
            transform=axis.transAxes,
            ha="center",
            va="center",
            fontsize=NORMAL,
        )
        axis.set(xticks=[], yticks=[])
    watched = f"both start at q*; from {found.start_s:.2g} s to {found.end_s:.2g} s"
    y = f"largest distance of an agent to its ideal run (m)\n{watched}"
    label_axes(axis, "", "time constant tau of every vehicle (s)", y)
    save_figure(figure, path, options)


def choose_rungs(record: CompareRecord) -> list[RungRecord]:
    """Return the variants that are drawn: bodies with one effect, all effects, other laws and links, and ideal ones."""
    kinds = ("part", "base", "alone", "law", "links", "all")
    bodies = [rung for rung in record.ladder if rung.kind in kinds and not rung.key.startswith("ideal")]
    return [*bodies, record.rung("ideal")]


def _style(rung: RungRecord, k: int) -> dict[str, Any]:
    """Return the style of the k-th variant's line; those of 'ideal' and 'all' have no markers."""
    if rung.kind == "ideal":
        return {"color": "black", "linewidth": 1.5, "linestyle": (0, (4, 2)), "zorder": 4}
    if rung.kind == "all":
        return {"color": _ALL, "linewidth": 1.7, "zorder": 3}
    return line_style(k) | {"linewidth": 0.9, "markersize": 3.5} | ({"color": _GREYS[k]} if k in _GREYS else {})


def _bars(axis: Any, scope: str, budget: BudgetRecord, order: list[str]) -> None:
    """Draw the panel of one scope: at_q_star as text, three bars, then two bars for each effect, in mm."""
    effects = sorted(budget.effects, key=lambda item: order.index(item.effect))
    y = 4.0 + np.arange(len(order))
    _barh(axis, np.arange(1, 4), [budget.targets_m, budget.agents_m, budget.interaction_m], 0.5, _BASE)
    _barh(axis, y + 0.2, [e.alone_m for e in effects], 0.36, BLUE, "added to ideal thrusters, alone")
    _barh(
        axis,
        y - 0.2,
        [e.give_back_m for e in effects],
        0.36,
        _ALL,
        "given back when it is removed from all (below 0: worse without it)",
    )
    floor = "blew up" if budget.at_q_star_m is None else f"{1000.0 * budget.at_q_star_m:.0f} mm (no bar)"
    # No bar: it would dwarf the others.
    axis.annotate(floor, (0.0, 0), xytext=(4, 0), textcoords="offset points", va="center", fontsize=SMALL)
    for line in (0.5, 3.5):
        axis.axhline(line, color=_GREY, linewidth=0.8)
    axis.axvline(0.0, color="black", linewidth=0.8)
    ideal, whole = ("blew up" if v is None else f"{v:.3g} m" for v in (budget.ideal_m, budget.all_m))
    title = "the whole team" if scope == TEAM else f"group {scope}"
    label_axes(axis, "", "part of the error (mm)")
    axis.grid(False, axis="y")
    axis.set_title(f"{title}\nideal {ideal}\nas given {whole}", fontsize=TICK)
    axis.set_ylim(-0.6, 3.6 + len(order))
    axis.margins(x=0.3)  # room for the numbers next to the bars
    axis.locator_params(axis="x", nbins=4)


def _barh(axis: Any, y: Any, values: list[float | None], height: float, colour: str, label: str | None = None) -> None:
    """Draw bars with their values, given in m and drawn in mm."""
    lengths = [1000.0 * (value or 0.0) for value in values]
    texts = ["0" if abs(x) < 0.05 else f"{x:+.1f}" if abs(x) < 10 else f"{x:+.0f}" for x in lengths]
    bars = axis.barh(y, lengths, height=height, color=colour, label=label if values else None)
    shown = ["blew up" if value is None else text for value, text in zip(values, texts, strict=True)]
    axis.bar_label(bars, shown, padding=3, fontsize=SMALL)
