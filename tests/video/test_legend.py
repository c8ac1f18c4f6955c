"""The legend is next to the scene, and explains every symbol."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from mjsheaf.errors import InputError
from mjsheaf.scenario import load_scenario
from mjsheaf.show.played import Medium, Stage, largest_speed
from mjsheaf.show.style import STOPS, speed_colours
from mjsheaf.video.camera import View
from mjsheaf.video.film import Film, Frames, VideoOptions, video_options
from mjsheaf.video.overlay import Overlay, add_bars, add_legend, legend_rows
from mjsheaf.video.scene import Decorator
from tests.builders import change_film, make_film, make_model, samples_of
from tests.commands import call

MAGENTA = (255, 0, 255)
VIEW = View(np.zeros(3), 80.0, 120.0, -35.0, 45.0)
MEDIA = [
    Medium(name, [(0.0, np.zeros_like)], np.zeros(0, dtype=np.int64), True, scale, top)
    for scale, (name, top) in enumerate({"wind": 1.5, "current": 0.6}.items())
]


def everything() -> Film:
    """Video content in which every row of a legend has a reason."""
    film = make_film(make_model())
    edges = film.stages[0].edges
    stages = [Stage(0.0, edges, frozenset({1})), Stage(1.0, edges[:2], name="join A2")]
    kinds = ["boat", "boat", "drone", "drone", "buoy"]
    scales = np.array([1.0, 1.0, 6.0, 6.0, 4.0])
    names = [f"group {k}" for k in range(12)]
    return replace(film, stages=stages, kinds=kinds, scales=scales, grid=10.0, group_names=names,
                   colours=np.full((12, 3), 0.5))  # fmt: skip


def rows_of(film: Film, **options: Any) -> list[Line2D]:
    made = VideoOptions(**options)
    return legend_rows(film, made, Frames(film, made).extent.survey)


def test_every_row_has_a_symbol() -> None:
    """Oracle: the drawn symbol has pixels of its own."""
    rows = rows_of(everything(), speed=3.0)
    assert len(rows) == len({str(row.get_label()) for row in rows}) >= 12
    for row in rows:
        figure = Figure((2, 1), dpi=72, facecolor="black")
        label = str(row.get_label())
        row.set_label("")
        legend = add_legend(figure, [row], (20.0, 60.0, 100.0, 50.0), 13.0)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        assert legend.legend_handles[0] is not None
        assert (np.asarray(canvas.buffer_rgba())[..., :3].max(axis=2) > 60).sum() >= 8, label


@pytest.mark.parametrize(
    ("scales", "said"),
    [
        ([1.0, 1.0, 6.0, 6.0, 4.0], ["drawn ×6: drone", "drawn ×4: buoy"]),
        ([1.0, 2.0, 1.0, 1.0, 4.0], ["drawn ×4: buoy", "drawn ×2: A2"]),
        ([3.0] * 5, ["drawn ×3: every vehicle"]),
    ],
    ids=["by kind", "by id", "all"],
)
def test_the_legend_says_how_much_larger_vehicles_are(scales: list[float], said: list[str]) -> None:
    words = [str(row.get_label()) for row in rows_of(replace(everything(), scales=np.array(scales)))]
    assert [each for each in words if each.startswith("drawn")] == said


@pytest.mark.parametrize("size", [(64, 64), (320, 240), (720, 1280), (1280, 720)])
def test_legend_and_scene_share_the_frame(size: tuple[int, int]) -> None:
    """The panel ends where the scene begins: what is written at the left leaves the scene's pixels alone."""
    film = everything()
    options = VideoOptions(width=size[0], height=size[1], speed=3.0)
    assert options.panel + options.scene[0] == size[0]
    assert 0.2 < options.panel / options.unit / 1000 < 0.4
    image = Image.new("RGB", size, MAGENTA)
    gone = change_film(film, positions=samples_of(film).positions + 1e7)  # no labels
    frames = Frames(gone, options)
    overlay = Overlay(replace(gone, media=MEDIA), options, frames.extent.survey)
    overlay.write(image, frames.moment(0), VIEW)
    drawn = np.asarray(image)
    below = drawn[: int(0.8 * size[1]), options.panel :]  # above the scale bar
    assert (below == MAGENTA).all()
    assert (drawn[:, : options.panel - 1] != MAGENTA).any(axis=2).all()


def test_a_long_legend_fits() -> None:
    figure = Figure((4, 4), dpi=72)
    words = "a thing with a name that is far too long for the panel, and then some"
    rows = [Line2D([], [], label=words, marker="o", linestyle="none")] * 40
    legend = add_legend(figure, rows, (10.0, 200.0, 120.0, 150.0), 13.0)
    box = legend.get_window_extent()
    assert box.height <= 150.0
    assert box.width <= 130.0


def test_bars_are_labelled_in_metres_per_second() -> None:
    figure = Figure((4, 4), dpi=72)
    add_bars(figure, MEDIA, 10.0, 200.0, 1.0)
    below, above = figure.axes
    for axes, name, top in ((above, "wind", "1.5 m/s"), (below, "current", "0.6 m/s")):
        assert axes.get_title(loc="left") == f"speed of the {name}"
        assert [label.get_text() for label in axes.get_xticklabels()][-1] == top
        (bar,) = axes.images
        shades = np.asarray(bar.get_array())[0]
        assert np.abs(shades[0] - shades[-1]).max() > 0.3
    assert above.get_position().y0 > below.get_position().y1


def test_colours_of_two_media_differ_and_show_speed() -> None:
    fraction = np.linspace(0.0, 1.0, 11)
    scales = [speed_colours(k, fraction) for k in range(len(STOPS))]
    assert (np.linalg.norm(scales[0][:, :3] - scales[1][:, :3], axis=1) > 0.4).all()
    for shades in scales:
        assert (np.diff(shades[:, 3]) > 0).all()  # slow ones are fainter
        assert np.linalg.norm(shades[-1, :3] - shades[2, :3]) > 0.5


def test_the_legend_is_always_there(capsys: pytest.CaptureFixture[str]) -> None:
    """Files that were written when it could be turned off are read; what would turn it off is refused."""
    assert video_options(load_scenario("midpoint", {"video.legend": True})).panel > 0
    with pytest.raises(InputError, match=r"video\.legend"):
        load_scenario("midpoint", {"video.legend": False})
    for option in ("--no-legend", "--scale=2"):
        assert call("video", "runs/none", option) == 2
        assert "No such option" in capsys.readouterr().err


def test_a_slow_jet_stands_out_from_a_slower_drift() -> None:
    def velocity(places: np.ndarray) -> np.ndarray:
        jet = np.abs(places[:, 1]) < 5.0
        return np.stack([np.where(jet, 0.5, 0.1), *np.zeros((2, len(places)))], axis=1)

    film = replace(make_film(make_model()), media=[Medium("current", [(0.0, velocity)], np.arange(5), True, 1, 0.5)])
    options = VideoOptions()
    frames = Frames(film, options)
    decorator = Decorator(film, options)
    assert largest_speed(velocity, samples_of(film).positions.reshape(-1, 3)) == 0.5
    decorator.lay_out_arrows(VIEW)
    lines = decorator._arrows(frames.moment(0), VIEW, 0)
    shafts, rgba = lines.ends[: len(lines.ends) // 3], lines.rgba[: len(lines.ends) // 3]
    lengths = np.linalg.norm(np.diff(shafts, axis=1)[:, 0], axis=1)
    fast = np.abs(shafts[:, 0, 1]) < 5.0
    assert lengths[fast].min() > 4.0 * lengths[~fast].max()
    assert np.abs(rgba[fast, :3].mean(axis=0) - rgba[~fast, :3].mean(axis=0)).max() > 0.3
