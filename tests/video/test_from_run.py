"""From a run's data to what is drawn."""

from copy import copy
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from PIL import Image, ImageDraw

from mjsheaf import medium, simulate
from mjsheaf.results.store import open_dataset, write_dataset
from mjsheaf.runs import simulate as running
from mjsheaf.runs.simulate import stream
from mjsheaf.scenario import load_scenario
from mjsheaf.show.played import Poses
from mjsheaf.video.camera import View
from mjsheaf.video.draw import Painter
from mjsheaf.video.film import Frames, VideoOptions, film_of, video_options
from mjsheaf.video.overlay import Overlay
from mjsheaf.video.scene import Decorator
from tests.builders import ONE_BOAT, boat_and_drone, make_scenario
from tests.commands import drawing

WINDY: dict[str, Any] = {
    "target_formation": {"gain": 0.1},
    "flow": {"agents": {"dimension": 3, "drift": [1, 0.5, 0]}, "targets": {"dimension": 3, "drift": [1, 1, 0]}},
}


@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_the_film_knows_where_the_surface_is(backend: str) -> None:
    """Boats float on it, and stems end on it."""
    scenario = make_scenario(ONE_BOAT | {"scene": {"surface": "water", "height": 12.0}})
    film, _ = film_of(scenario, simulate(scenario, backend=backend))
    assert (film.surface, film.surface_height) == ("water", 12.0)
    np.testing.assert_allclose(film.run.at(film.run.time).positions[..., 2], 12.0, atol=1e-6)


def test_the_video_shows_whom_the_safety_filter_restrains(monkeypatch: pytest.MonkeyPatch) -> None:
    """A halo for each agent that it acts on, on the spot, and a line towards the vehicle or obstacle of the cause."""
    wall = {"kind": "half_space", "point": [0.0, 0.0, 4.0], "normal": [0.0, 0.0, 1.0]}
    scenario = load_scenario("swap", {"time.end": 6, "safety.obstacles": [wall]})
    run = simulate(scenario, backend="ideal")
    film, _ = film_of(scenario, run)
    added: list[Any] = []
    monkeypatch.setattr("mjsheaf.video.scene._add_balls", lambda _, places, *__: added.extend(places))
    painter, nobody = Decorator(film, VideoOptions()), np.zeros((0, 2), dtype=np.int64)
    view, restrained = View(np.zeros(3), 20.0, 90.0, -30.0, 45.0), 0
    for number in range(0, 100, 10):
        moment = Frames(film, VideoOptions(fps=20, speed=1)).moment(number)
        acting = run.sel(time=moment.time, method="nearest")
        agents = np.flatnonzero(acting["safety_correction"].values > 0.0)
        added.clear()
        (lines,) = painter._pointers(cast(Any, None), moment, nobody, view)
        np.testing.assert_array_equal(np.reshape(added, (-1, 3)), moment.positions[agents])
        assert film.restraints is not None
        _, ends = film.restraints(moment.time, moment.positions)
        causes = acting["safety_cause"].values[agents].astype(int)
        for end, agent, cause in zip(ends, agents, causes, strict=True):
            foot = [*moment.positions[agent, :2], 4.0]
            np.testing.assert_allclose(end, moment.positions[cause - 1] if cause <= film.vehicles else foot, atol=1e-9)
        np.testing.assert_allclose(lines.ends[:, 0], moment.positions[agents], atol=1e-5)
        restrained += len(agents)
    assert restrained > 10


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_a_film_read_from_a_file_in_pieces_is_that_of_the_data_in_memory(
    backend: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(running, "samples_in_piece", lambda system: 37)
    scenario = boat_and_drone(3.0, **WINDY)
    write_dataset(stream(scenario.system, backend, 0), tmp_path / "a.nc")
    in_memory = film_of(scenario, simulate(scenario, backend))[0].run
    with open_dataset(tmp_path / "a.nc") as dataset:
        read = film_of(scenario, dataset)[0].run
        assert_same(read.at(read.time), in_memory.at(in_memory.time))
        for times in ([0.0], [0.364], [2.9, 3.0], [0.365, 0.37, 0.375], [0.5, 2.5, 1.0]):  # over the edges of pieces
            assert_same(read.at(np.array(times)), in_memory.at(np.array(times)))


def assert_same(one: Poses, other: Poses) -> None:
    for name, values in vars(one).items():
        np.testing.assert_allclose(values, getattr(other, name), rtol=0, atol=1e-12, err_msg=name)


def test_a_body_without_attitude_faces_where_it_goes() -> None:
    """Oracle: the direction of the recorded velocity of a target on a smooth path."""
    scenario = boat_and_drone(3.0, **WINDY)
    run = film_of(scenario, simulate(scenario, "ideal"))[0].run
    samples = run.at(np.linspace(1.0, 2.0, 7))
    velocity = (run.at(samples.time + 1e-2).positions - run.at(samples.time - 1e-2).positions)[:, 2, :2]
    heading = 2 * np.arctan2(samples.quaternions[:, 2, 3], samples.quaternions[:, 2, 0])
    np.testing.assert_allclose(
        np.stack([np.cos(heading), np.sin(heading)]).T,
        velocity / np.linalg.norm(velocity, axis=1, keepdims=True),
        atol=1e-3,
    )


@drawing
@pytest.mark.parametrize("surface", ["water", "ground"])
def test_squares_of_the_surface_have_the_size_that_the_legend_says(surface: str) -> None:
    """Seen from above, brightness repeats. Oracle: the shift at which the picture is most like itself."""
    scenario = boat_and_drone(0.05, scene={"surface": surface})
    options = video_options(scenario, width=640, height=640, elevation=-90.0, azimuth=90.0, distance=200.0, trail=0.0)
    film, model = film_of(scenario, simulate(scenario, "ideal"))
    with Painter(film, model, options) as painter:
        row = np.array(painter.draw(0)())[470, 240:].astype(float).sum(axis=1)
        pixel = painter.camera[0].metres_per_pixel(640)
    row -= row.mean()
    likeness = [row[shift:] @ row[:-shift] / len(row[shift:]) for shift in range(20, 300)]
    period = (20 + int(np.argmax(likeness))) * pixel
    assert film.grid is not None
    assert period == pytest.approx(film.grid * (2 if surface == "ground" else 1), rel=0.05)


def test_draft_is_of_the_same_size_with_fewer_pixels_and_frames() -> None:
    good, draft = (video_options(boat_and_drone(), quality=quality) for quality in ("good", "draft"))
    assert (draft.width, draft.height) == (good.width, good.height)
    assert good.drawn == good.scene == (good.width - good.panel, good.height)
    assert draft.drawn == (good.drawn[0] // 2, good.drawn[1] // 2)
    assert (good.fps, draft.fps) == (30, 15)
    assert video_options(boat_and_drone(video={"quality": "draft"})).fps == 15
    assert video_options(boat_and_drone(video={"fps": 10}), quality="draft").fps == 10
    assert video_options(boat_and_drone(), quality="draft", fps=60).fps == 60


@drawing
@pytest.mark.slow
def test_a_swarm_of_hundreds_can_be_drawn() -> None:
    """With five materials a vehicle, 199 of them were more than MuJoCo draws. Oracle: the picture is full of them."""
    scenario = load_scenario("swarm", {"swarm.size": 210, "time.end": 0.02, "video.width": 320, "video.height": 180})
    film, model = film_of(scenario, simulate(scenario, backend="ideal"))
    with Painter(film, model, video_options(scenario, quality="draft", trail=0.0)) as painter:
        frame = np.array(painter.draw(0)())
    bare = copy(model)
    bare.geom_rgba[np.isin(bare.geom_bodyid, film.body_id), 3] = 0.0  # vehicles that cannot be seen
    with Painter(film, bare, video_options(scenario, quality="draft", trail=0.0)) as painter:
        without = np.array(painter.draw(0)())
    assert (frame != without).any(axis=2).sum() > 210


@pytest.mark.slow
@pytest.mark.parametrize("named", [{}, {"hexarotor": 4.0, "boat": 3.0, "H2": 1.5}])
def test_vehicles_are_scaled_by_kind_and_by_id(named: dict[str, float]) -> None:
    scenario = load_scenario("harbour", {"time.end": 0.02, "scene.vehicle_scale": 2.5, "scene.vehicle_scales": named})
    film, _ = film_of(scenario, simulate(scenario, backend="ideal"))
    ids = [*film.agent_ids, *film.target_ids]
    wanted = [named.get(name, named.get(kind, 2.5)) for name, kind in zip(ids, film.kinds, strict=True)]
    assert film.scales.tolist() == wanted


def test_arrows_show_the_medium() -> None:
    film, _ = film_of(boat_and_drone(3.0, **WINDY), simulate(boat_and_drone(0.1, **WINDY), backend="ideal"))
    options = VideoOptions()
    frames = Frames(film, options)
    view = View(np.array([3.0, 1.0, 1.0]), 30.0, -60.0, -35.0, 45.0)
    decorator = Decorator(film, options)
    decorator.lay_out_arrows(view)
    assert [medium.name for medium in film.media] == ["flow about agents", "flow about targets"]
    moment = frames.moment(0)
    for k, (drift, height) in enumerate([([1.0, 0.5, 0.0], 1.0), ([1.0, 1.0, 0.0], 2.0)]):
        ends = decorator._arrows(moment, view, k).ends
        shafts = ends[: len(ends) // 3]
        along = np.diff(shafts, axis=1)[:, 0]
        assert len(shafts) > 50
        directions = along / np.linalg.norm(along, axis=1)[:, None]
        np.testing.assert_allclose(directions - np.divide(drift, np.linalg.norm(drift)), 0.0, atol=1e-5)
        np.testing.assert_allclose(shafts[..., 2], height, atol=1e-5)
        assert np.ptp(np.linalg.norm(along, axis=1)) < 1e-4
        tips = ends[len(shafts) :, 0]
        np.testing.assert_allclose(tips, np.tile(shafts[:, 1], (2, 1)), atol=1e-5)  # heads begin at the tips


def test_a_medium_at_rest_has_no_arrows() -> None:
    scenario = load_scenario("midpoint", {"time.end": 0.1})
    assert not film_of(scenario, simulate(scenario, backend="ideal"))[0].media


@pytest.mark.parametrize("distance", [0.3, 7.0, 900.0])
def test_the_bar_is_as_long_as_it_says(distance: float) -> None:
    """Oracle: two points at this distance, side by side at the centre, as the camera projects them."""
    film, _ = film_of(boat_and_drone(3.0, **WINDY), simulate(boat_and_drone(0.1, **WINDY), backend="ideal"))
    options = VideoOptions(width=1000, height=720)
    image = Image.new("RGB", (1000, 720), (128, 128, 128))
    view = View(np.zeros(3), distance, 90.0, -35.0, 45.0)
    written: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ImageDraw.ImageDraw, "text", lambda self, place, words, *_, **__: written.append(words))
        Overlay(film, options, Frames(film, options).extent.survey).write(image, Frames(film, options).moment(0), view)
    (length,) = [float(words.split()[0]) for words in written if "centre" in words]
    assert float(f"{length:.0e}"[0]) in (1, 2, 5)
    bright = np.flatnonzero((np.asarray(image)[692] > 250).all(axis=1))
    pixels, _ = view.project(np.array([[0.0, 0.0, 0.0], [length, 0.0, 0.0]]), 1000, 720)
    assert bright[bright > 700].max() - bright[bright > 700].min() == pytest.approx(np.ptp(pixels[:, 0]), abs=4)


@pytest.mark.parametrize(("name", "vehicle"), [("double_gyre", "A1"), ("harbour_gusts", "W1")])
def test_arrows_of_a_current_that_changes_with_time_are_the_current_of_the_moment(name: str, vehicle: str) -> None:
    scenario = load_scenario(name)
    film, _ = film_of(scenario, simulate(scenario, backend="ideal"))
    (current,) = (one for one in film.media if one.level)
    points = np.array([[40.0, 30.0, 0.0], [35.0, 42.0, 0.0], [20.0, 25.0, 0.0]])
    real = medium(scenario)
    assert len(current.shots[1:]) > 10
    for time, _ in current.shots[1:]:
        found = current.at(points, time + 0.1)
        for place, velocity in zip(points, found, strict=True):
            assert velocity == pytest.approx(real.velocity(vehicle, [time], place)[0], abs=1e-12)
    assert np.ptp([current.at(points, time)[0, 0] for time, _ in current.shots[1:]]) > 0.05
    assert current.top == pytest.approx(0.6, abs=0.2)
