"""Figures of the introduction to sheaves: a boat, a drone and two targets, computed with Sheaf and drawn obliquely."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from stalks import PLACES, PROJECTION, sheaf, vector

from mjsheaf import Sheaf
from mjsheaf.arrays import Array
from mjsheaf.show.plots import new_figure

TARGETS = {"buoy": np.array([0.0, 0.0]), "balloon": np.array([6.0, 3.0, 9.0])}
"""Positions of the targets of the second page, m."""
STARTS = {"boat": np.array([1.0, 4.0]), "drone": np.array([6.5, 0.0, 3.0])}
"""Positions where boat and drone begin on the second page, m."""

BLUE = "#0072B2"
ORANGE = "#B45309"
GREEN = "#047857"
PURPLE = "#7C3AED"
RED = "#B91C1C"
GREY = "#4B5563"
COLOURS = {"boat": BLUE, "drone": ORANGE, "buoy": GREEN, "balloon": PURPLE}
_EAST = np.array([1.0, 0.0])
_NORTH = np.array([0.42, 0.36])
_UP = np.array([0.0, 0.45])


def team() -> Sheaf:
    """Return the sheaf of the second page: the boat senses the buoy, the drone the balloon, and both compare."""
    s = Sheaf({"boat": 2, "drone": 3, "buoy": 2, "balloon": 3})
    s.add_edge("boat", "drone", np.eye(2), PROJECTION)
    s.add_edge("boat", "buoy", np.eye(2), np.eye(2))
    s.add_edge("drone", "balloon", np.eye(3), np.eye(3))
    return s


def loop() -> Sheaf:
    """Return the sheaf of three boats that all compare positions with each other."""
    s = Sheaf({"A": 2, "B": 2, "C": 2})
    for tail, head in (("A", "B"), ("B", "C"), ("C", "A")):
        s.add_edge(tail, head, np.eye(2), np.eye(2))
    return s


def follow(H: Array, pull: Array, start: Array, times: Array) -> Array:
    """Solve x' = pull - H x exactly at the given times, shape (samples, n)."""
    values, vectors = np.linalg.eigh(H)
    decays = np.exp(-np.outer(times, values))
    slow = np.where(values > 1e-12, values, 1.0)
    gains = np.where(values > 1e-12, (1.0 - decays) / slow, times[:, None])
    return np.asarray((decays * (vectors.T @ start) + gains * (vectors.T @ pull)) @ vectors.T)


def draw_comparison() -> Figure:
    """Draw the boat and the drone in space, what each shows to the edge, and their difference."""
    figure, axis = _scene(7.4, 4.0, (7.0, 4.0), 8.0)
    boat = PLACES["boat"]
    drone = PLACES["drone"]
    shown = PROJECTION @ drone
    _line(axis, [drone, [*shown, 0.0]], ORANGE, linestyle=(0, (4, 3)))
    _arrow(axis, shown, boat, RED)
    _mark(axis, "shadow", shown)
    _mark(axis, "boat", boat)
    _mark(axis, "drone", drone)
    _label(axis, drone, (0.7, 0.05), f"drone: state {vector(drone)} in $\\mathbb{{R}}^3$", ORANGE)
    _label(axis, [*shown, 4.3], (0.2, 0.0), "its restriction map\nforgets the height", ORANGE)
    _label(axis, shown, (0.25, -0.25), f"the edge receives {vector(shown)} in $\\mathbb{{R}}^2$", ORANGE)
    _label(axis, boat, (-0.45, 0.95), f"boat: state {vector(boat)} in $\\mathbb{{R}}^2$", BLUE, "center")
    _label(axis, boat, (-0.6, 0.1), f"the edge receives {vector(boat)}", BLUE, "right")
    difference = sheaf().coboundary() @ np.concatenate([boat, drone])
    middle = 0.5 * (boat + shown)
    _label(axis, middle, (-0.3, -0.35), f"disagreement {vector(difference)} m", RED, "center")
    return figure


def draw_sections() -> Figure:
    """Draw states in which boat and drone agree, and desired differences around a loop that no placement has."""
    figure = new_figure(7.4, 3.6, "")
    figure.set_layout_engine("none")
    left = _oblique(figure, (0.0, 0.0, 0.5, 1.0), (4.0, 4.0), 8.5)
    left.text(0.5, 0.95, "global sections: all edges agree", transform=left.transAxes, ha="center", fontsize=10)
    place = np.array([2.0, 2.0])
    _line(left, [[*place, 0.0], [*place, 8.5]], GREY, linestyle=(0, (4, 3)))
    _mark(left, "boat", place)
    for height in (2.8, 5.0, 7.2):
        _mark(left, "drone", np.array([*place, height]))
    _label(left, [*place, 5.0], (0.65, 0.05), "any height", ORANGE)
    _label(left, place, (0.65, 0.1), "any place", BLUE)
    kernel = sheaf().betti()[0]
    _label(left, [2.8, 0.0], (0.0, -0.55), f"{kernel} numbers describe them: dim $H^0$ = {kernel}", "black", "center")
    right = figure.add_axes((0.52, 0.0, 0.46, 1.0))
    _draw_loop(right)
    return figure


def _draw_loop(axis: Any) -> None:
    """Draw three boats whose desired differences do not add up to zero around the loop."""
    corners = {"A": np.array([0.0, 0.0]), "B": np.array([4.0, 0.0]), "C": np.array([2.0, 3.0])}
    wanted = (("A", "B", [-4, 0]), ("B", "C", [2, -3]), ("C", "A", [2, 4]))
    places = {("A", "B"): (2.0, -0.45), ("B", "C"): (3.35, 1.6), ("C", "A"): (0.65, 1.6)}
    axis.set(xlim=(-1.7, 5.7), ylim=(-2.0, 4.4), aspect="equal")
    axis.set_axis_off()
    axis.text(2.0, 4.0, "$H^1$: differences that do not close", ha="center", fontsize=10)
    for tail, head, b in wanted:
        start = corners[tail]
        end = corners[head]
        axis.plot(*np.transpose([start, end]), color=GREY, linewidth=1.2, zorder=1)
        side = "left" if tail == "B" else "right" if tail == "C" else "center"
        text = f"{tail} − {head} = {vector(b)}"
        axis.text(*places[tail, head], text, ha=side, va="center", fontsize=8.5, color=GREY)
    for name, place in corners.items():
        axis.scatter(*place, s=260, color=BLUE, zorder=2)
        axis.text(*place, name, ha="center", va="center", fontsize=9, color="white", weight="bold", zorder=3)
    total = np.sum([b for *_, b in wanted], axis=0)
    axis.text(2.0, -1.05, f"the sum around the loop is {vector(total)}, not (0, 0)", ha="center", va="center",
              fontsize=8.5, color=RED)  # fmt: skip
    axis.text(2.0, -1.65, f"2 numbers must vanish: dim $H^1$ = {loop().betti()[1]}", ha="center", va="center",
              fontsize=9)  # fmt: skip


def draw_diffusion() -> Figure:
    """Draw the paths of x' = -L x from the first page's state, and the disagreement along them."""
    s = sheaf()
    times = np.linspace(0.0, 3.0, 121)
    start = np.concatenate([PLACES["boat"], PLACES["drone"]])
    L = s.laplacian().toarray()
    paths = follow(L, np.zeros(5), start, times)
    figure = new_figure(7.4, 3.7, "")
    figure.set_layout_engine("none")
    left = _oblique(figure, (0.0, 0.0, 0.6, 1.0), (5.0, 4.0), 8.5)
    _draw_paths(left, {"boat": paths[:, :2], "drone": paths[:, 2:]})
    _line(left, [paths[-1, 2:], [*paths[-1, 2:4], 0.0]], GREY, linestyle=(0, (4, 3)))
    _label(left, paths[-1, 2:], (0.0, 0.55), "the drone keeps its height", ORANGE, "center")
    _label(left, paths[-1, :2], (0.3, -0.4), "they meet halfway", BLUE, "center")
    right = figure.add_axes((0.7, 0.2, 0.27, 0.62))
    right.plot(times, np.linalg.norm(paths @ s.coboundary().toarray().T, axis=1), color=RED, linewidth=1.8)
    largest = np.linalg.eigvalsh(L)[-1]
    right.set(xlabel="time (s)", ylabel="disagreement |$\\delta x$| (m)", xlim=(0.0, 3.0), ylim=(0.0, 5.0))
    right.text(0.75, 1.6, f"falls as $e^{{-{largest:.0f} t}}$", fontsize=9, color=RED)
    right.spines[["top", "right"]].set_visible(False)
    return figure


def draw_extension() -> Figure:
    """Draw the harmonic extension between buoy and balloon as springs at rest, and the paths of the law towards it."""
    s = team()
    problem = s.dirichlet_problem(list(TARGETS))
    best = s.harmonic_extension(TARGETS).x
    pull = problem.B @ np.concatenate(list(TARGETS.values()))
    start = np.concatenate(list(STARTS.values()))
    paths = follow(problem.H.toarray(), pull, start, np.linspace(0.0, 8.0, 161))
    figure, axis = _scene(7.4, 4.4, (7.5, 4.5), 9.5)
    shadow = np.array([*best["drone"][:2], 0.0])
    _line(axis, [best["drone"], shadow], ORANGE, linestyle=(0, (4, 3)))
    _spring(axis, TARGETS["buoy"], best["boat"])
    _spring(axis, best["boat"], shadow)
    _spring(axis, best["drone"], TARGETS["balloon"])
    _draw_paths(axis, {"boat": paths[:, :2], "drone": paths[:, 2:]})
    _mark(axis, "shadow", shadow[:2])
    for name, place in TARGETS.items():
        _mark(axis, name, place)
    _label(axis, TARGETS["buoy"], (-0.1, -0.45), f"buoy {vector(TARGETS['buoy'])}", GREEN, "center")
    _label(axis, TARGETS["balloon"], (0.4, 0.0), f"balloon {vector(TARGETS['balloon'])}", PURPLE)
    _label(axis, best["boat"], (0.4, -0.3), f"boat settles at {vector(best['boat'])}", BLUE)
    _label(axis, best["drone"], (-0.7, 0.2), f"drone settles at {vector(best['drone'])}", ORANGE, "right")
    _label(axis, STARTS["boat"], (-0.3, 0.2), "boat starts", BLUE, "right")
    _label(axis, STARTS["drone"], (0.35, 0.0), "drone starts", ORANGE)
    return figure


def _scene(width: float, height: float, ground: Sequence[float], top: float) -> tuple[Figure, Any]:
    """Make a figure of one oblique view."""
    figure = new_figure(width, height, "")
    figure.set_layout_engine("none")
    return figure, _oblique(figure, (0.0, 0.0, 1.0, 1.0), ground, top)


def _oblique(figure: Figure, place: tuple[float, float, float, float], ground: Sequence[float], top: float) -> Any:
    """Add axes with a grid on the water, ground[0] m east by ground[1] m north, and room for heights up to `top`, m."""
    axis = figure.add_axes(place)
    corners = _flat([[0, 0], [ground[0], 0], ground, [0, ground[1]]])
    axis.add_patch(Polygon(corners, facecolor="#DBEAFE", edgecolor="none", zorder=0))
    for east in np.arange(0.0, ground[0] + 0.1, 1.0):
        _line(axis, [[east, 0.0], [east, ground[1]]], "#BFDBFE", linewidth=0.6, zorder=0)
    for north in np.arange(0.0, ground[1] + 0.1, 1.0):
        _line(axis, [[0.0, north], [ground[0], north]], "#BFDBFE", linewidth=0.6, zorder=0)
    width, height = figure.get_size_inches() * place[2:]
    low = -1.0
    high = top * _UP[1] + 1.6
    span = (high - low) * width / height
    middle = 0.5 * (ground[0] + ground[1] * _NORTH[0])
    axis.set(xlim=(middle - 0.5 * span, middle + 0.5 * span), ylim=(low, high), aspect="equal")
    axis.set_axis_off()
    return axis


def _flat(points: Any) -> Array:
    """Project points in the plane or in space, shape (k, 2) or (k, 3), onto the drawing, shape (k, 2)."""
    points = np.asarray(points, dtype=float)
    drawn = points[:, :1] * _EAST + points[:, 1:2] * _NORTH
    if points.shape[1] == 3:
        drawn = drawn + points[:, 2:] * _UP
    return np.asarray(drawn)


def _line(axis: Any, points: Any, colour: str, **style: Any) -> None:
    axis.plot(*_flat(points).T, color=colour, **({"linewidth": 1.2, "zorder": 1} | style))


def _arrow(axis: Any, start: Any, end: Any, colour: str) -> None:
    begin, tip = _flat([start, end])
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 2.0, "shrinkA": 5.0, "shrinkB": 22.0}
    axis.annotate("", tip, begin, arrowprops=style, zorder=2)


def _spring(axis: Any, start: Any, end: Any) -> None:
    """Draw a spring between two points."""
    start = np.append(start, np.zeros(3 - len(start)))
    end = np.append(end, np.zeros(3 - len(end)))
    begin, tip = _flat([start, end])
    along = tip - begin
    normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    share = np.linspace(0.0, 1.0, 201)
    wave = np.where((share > 0.15) & (share < 0.85), 0.11 * np.sin((share - 0.15) / 0.7 * 14.0 * np.pi), 0.0)
    axis.plot(*(begin + share[:, None] * along + wave[:, None] * normal).T, color=GREY, linewidth=1.0, zorder=1)


def _draw_paths(axis: Any, paths: Mapping[str, Array]) -> None:
    """Draw where each vehicle goes, and its marks at the start and at the end."""
    for name, path in paths.items():
        _line(axis, path, COLOURS[name], linewidth=1.8, zorder=2)
        axis.scatter(*_flat(path[:1]).T, s=30, facecolor="white", edgecolor=COLOURS[name], zorder=3)
        _mark(axis, name, path[-1])


def _mark(axis: Any, name: str, place: Any) -> None:
    """Draw a vehicle, a target or a shadow at its place."""
    x, y = _flat([place])[0]
    if name == "boat":
        hull = np.array([[-0.45, 0.0], [-0.32, -0.17], [0.3, -0.17], [0.52, 0.0]])
        axis.add_patch(Polygon(np.add(hull, [x, y + 0.05]), facecolor=BLUE, edgecolor="white", linewidth=0.8, zorder=4))
        axis.add_patch(Polygon([[x, y + 0.1], [x, y + 0.5], [x + 0.3, y + 0.1]], facecolor=BLUE, alpha=0.6, zorder=4))
    elif name == "drone":
        axis.plot([x - 0.33, x + 0.33], [y, y], color=ORANGE, linewidth=2.2, zorder=4)
        for side in (-0.33, 0.33):
            axis.plot([x + side - 0.2, x + side + 0.2], [y + 0.1, y + 0.1], color=ORANGE, linewidth=1.6, zorder=4)
            axis.plot([x + side, x + side], [y, y + 0.1], color=ORANGE, linewidth=1.6, zorder=4)
        axis.scatter(x, y - 0.03, s=38, color=ORANGE, zorder=4)
    elif name == "balloon":
        axis.scatter(x, y + 0.1, s=190, color=PURPLE, edgecolor="white", zorder=4)
    elif name == "buoy":
        axis.scatter(x, y, s=110, color=GREEN, marker="^", edgecolor="white", zorder=4)
    else:
        axis.scatter(x, y, s=45, facecolor="white", edgecolor=ORANGE, linewidth=1.6, zorder=3)


def _label(axis: Any, place: Any, shift: tuple[float, float], text: str, colour: str, side: str = "left") -> None:
    x, y = _flat([place])[0]
    axis.text(x + shift[0], y + shift[1], text, ha=side, va="center", fontsize=9, color=colour, zorder=5)


FIGURES = {
    "sheaf_comparison": draw_comparison,
    "sheaf_sections": draw_sections,
    "sheaf_diffusion": draw_diffusion,
    "sheaf_extension": draw_extension,
}
"""Functions that draw the figures, by file name."""


def write(directory: Path) -> None:
    """Write every figure as SVG; equal figures give equal bytes."""
    directory.mkdir(parents=True, exist_ok=True)
    for name, draw in FIGURES.items():
        with rc_context({"svg.hashsalt": "mjsheaf"}):
            draw().savefig(
                directory / f"{name}.svg", format="svg", metadata={"Date": None, "Creator": None}, facecolor="white"
            )
