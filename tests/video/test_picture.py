"""Additions to the picture: decoration in the scene, text over it, larger vehicles. No GL is needed."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from PIL import Image

from mjsheaf.video.camera import View
from mjsheaf.video.film import Film, Frames, Moment, VideoOptions
from mjsheaf.video.overlay import Overlay, font, shorten
from mjsheaf.video.scene import HEAD_AT, HEADS, Decorator, Lines, enlarge_vehicles
from tests.builders import change_film, make_film, make_model, samples_of

VIEW = View(np.zeros(3), 80.0, -60.0, -35.0, 45.0)
SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE.value


def moment(film: Film, options: VideoOptions, time: float) -> Moment:
    frames = Frames(film, options)
    return frames.moment(int(np.abs(frames.times - time).argmin()))


def decorate(film: Film, options: VideoOptions, time: float) -> tuple[list[mujoco.MjvGeom], list[Lines]]:
    decorator = Decorator(film, options)
    scene = mujoco.MjvScene(make_model(), decorator.most_geoms)
    lines = decorator.add(scene, moment(film, options, time), VIEW)
    return list(scene.geoms[: scene.ngeom]), lines


def count(lines: list[Lines]) -> int:
    return sum(len(batch.ends) for batch in lines)


def crowded(film: Film, agents: int, targets: int) -> Film:
    run, every = samples_of(film), np.arange(agents + targets) % film.vehicles
    of_run = {name: getattr(run, name)[:, every] for name in ("positions", "quaternions")}
    of_film = {name: getattr(film, name)[every] for name in ("qpos_address", "body_id", "group", "scales")}
    return change_film(
        film,
        agent_ids=[f"A{k}" for k in range(agents)],
        target_ids=[f"T{k}" for k in range(targets)],
        harmonic_extension=np.zeros((len(run.time), agents, 3)),
        edges=[],
        **of_run,
        **of_film,
    )


def overlay(film: Film, options: VideoOptions) -> Overlay:
    return Overlay(film, options, Frames(film, options).extent.survey)


def write(film: Film, options: VideoOptions, time: float = 0.0) -> np.ndarray:
    image = Image.new("RGB", (options.width, options.height), (128, 128, 128))
    overlay(film, options).write(image, moment(film, options, time), VIEW)
    return np.asarray(image)


class TestDecoration:
    @pytest.mark.parametrize("trail", [0.0, 0.5, 6.0, 1e6])
    @pytest.mark.parametrize("time", [0.0, 0.01, 1.0, 2.0])
    def test_room_is_enough(self, trail: float, time: float) -> None:
        film = make_film(make_model())
        options = VideoOptions(trail=trail)
        balls, lines = decorate(film, options, time)
        assert len(balls) == 3 + 2 <= Decorator(film, options).most_geoms  # at q*, and at the foot of a stem
        assert all(np.isfinite(batch.ends).all() and len(batch.rgba) == len(batch.ends) for batch in lines)

    def test_trails_end_at_the_vehicles_and_fade(self) -> None:
        film = make_film(make_model(), edges=[], surface="none")
        _, lines = decorate(film, VideoOptions(trail=1.0), 2.0)
        ends, rgba = (np.concatenate([getattr(batch, name) for batch in lines]) for name in ("ends", "rgba"))
        alphas = rgba[np.isclose(rgba[:, :3], film.colours[0]).all(axis=1), 3]
        assert alphas.min() < 0.2
        assert alphas.max() > 0.8
        for vehicle in samples_of(film).positions[-1]:
            assert np.linalg.norm(ends[:, 1] - vehicle, axis=1).min() < 0.01

    def test_trails_of_a_crowd_stay_affordable(self) -> None:
        film = make_film(make_model())
        crowd = crowded(film, 3, 997)
        balls, lines = decorate(crowd, VideoOptions(), 2.0)
        assert len(balls) + count(lines) < 12_000

    def test_parallel_edges_are_drawn_once(self) -> None:
        film = make_film(make_model(), edges=[(0, 1, "communication")], surface="none")
        double = change_film(film, edges=[(0, 1, "communication")] * 2)
        one, two = (count(decorate(f, VideoOptions(trail=0), 1.0)[1]) for f in (film, double))
        assert one == two

    def test_one_way_edges_have_arrowheads_towards_the_agent_sensed(self) -> None:
        film = make_film(make_model(), edges=[(1, 0, "one-way"), (1, 2, "communication")], surface="none")
        _, lines = decorate(film, VideoOptions(trail=0), 0.0)
        (barbs,) = [batch.ends for batch in lines if len(batch.ends) and np.allclose(batch.rgba, HEADS)]
        tail, head = samples_of(film).positions[0, [1, 0]]
        along = (head - tail) / ((head - tail) @ (head - tail))
        first, last = ((barbs[:, end] - tail) @ along for end in (0, 1))
        np.testing.assert_allclose(first, HEAD_AT, atol=1e-5)
        assert (last < HEAD_AT - 0.01).all()  # they lean back to the agent that senses
        np.testing.assert_allclose((barbs[:, 1].mean(axis=0) - tail) @ along, last, atol=1e-5)  # one on each side
        words = [row.get_label() for row in overlay(film, VideoOptions()).rows]
        assert {"agent senses agent, one way", "agents communicate"} <= set(words)

    def test_only_edges_to_targets_are_dashed(self) -> None:
        edges: Any = [(0, 3, "sensing"), (2, 4, "sensing"), (0, 1, "communication")]
        film = make_film(make_model(), surface="none", edges=edges)
        _, lines = decorate(film, VideoOptions(trail=0), 0.0)
        (dashed,) = [batch for batch in lines if batch.dash]
        places = samples_of(film).positions[0]
        np.testing.assert_allclose(dashed.ends, [places[[0, 3]], places[[2, 4]]], atol=1e-5)

    def test_a_ball_of_its_colour_for_each_agent(self) -> None:
        film = make_film(make_model(), surface="none")
        balls, _ = decorate(film, VideoOptions(), 0.0)
        assert len(balls) == 3
        for ball, goal, group in zip(balls, samples_of(film).harmonic_extension[0], film.group[:3], strict=True):
            assert ball.type == SPHERE
            np.testing.assert_allclose(ball.pos, goal, atol=1e-5)
            np.testing.assert_allclose(ball.rgba[:3], film.colours[group], atol=1e-6)

    def test_only_what_is_off_the_surface_gets_a_stem_that_ends_there(self) -> None:
        film = make_film(make_model(), edges=[])
        places = samples_of(film).positions + np.array([0.0, 0.0, 30.0])
        film = change_film(film, positions=places, harmonic_extension=places[:, :3], surface_height=30.0)
        options = VideoOptions(trail=0)
        (feet, lines), (bare, without) = (
            decorate(replace(film, surface=surface), options, 0.0) for surface in ("water", "none")
        )
        assert len(feet) - len(bare) == count(lines) - count(without) == 2  # of the targets, which are below
        ends = np.concatenate([batch.ends for batch in lines])
        for target in places[0, 3:]:
            wanted = [*target[:2], 30.0]
            assert min(np.abs(foot.pos - wanted).max() for foot in feet) < 1e-5
            assert np.abs(ends - [target, wanted]).max(axis=(1, 2)).min() < 1e-4


class TestWriting:
    def test_status_changes_with_time_and_legend_does_not(self) -> None:
        film = make_film(make_model(), positions=np.zeros((41, 5, 3)))
        options = VideoOptions(width=640, height=360)
        early, late = write(film, options, 0.5), write(film, options, 1.5)
        assert (early[:120] != late[:120]).any()
        np.testing.assert_array_equal(early[240:, :150], late[240:, :150])

    def test_labels_follow_their_vehicles_out_of_the_picture(self) -> None:
        film = make_film(make_model())
        far = change_film(film, positions=samples_of(film).positions + np.array([1e7, 0.0, 0.0]))
        behind = change_film(film, positions=samples_of(film).positions - 1e3 * np.array([0.4, -0.7, -0.6]))
        for gone in (far, behind):
            frame = write(gone, VideoOptions())
            assert (frame[300:400, 400:] == 128).all()

    def test_a_crowd_of_agents_is_not_labelled(self) -> None:
        few = crowded(film := make_film(make_model()), 5, 0)
        many = crowded(film, 25, 0)
        untouched = [(write(film, VideoOptions())[:600, 400:] == 128).all() for film in (few, many)]  # above the bar
        assert untouched == [False, True]

    def test_the_curve_grows_with_time_and_ends_at_the_dot(self) -> None:
        """The error falls by a known factor: its curve is straight on the log scale. Oracle: that straight line."""
        film = make_film(make_model(), end=2.0)
        options = VideoOptions(fps=20)
        shown = overlay(film, options)
        columns, rows = shown._curve
        straight = np.interp(shown._curve_time, [0.0, 2.0], rows[[0, -1]])
        np.testing.assert_allclose(rows, straight, atol=0.1)
        early, late = (write(film, options, time).astype(int) for time in (0.5, 2.0))
        middle = int(np.interp(0.5, shown._curve_time, columns))
        band = slice(int(rows[0]) - 5, int(rows[-1]) + 5)
        blue = [(frame[band, :, 2] - frame[band, :, 0] > 60).any(axis=0) for frame in (early, late)]
        assert np.flatnonzero(blue[0]).max() <= middle
        assert np.flatnonzero(blue[1]).max() > columns[-1] - 12  # up to the dot, which is white
        np.testing.assert_array_equal(blue[0][: middle - 12], blue[1][: middle - 12])

    @pytest.mark.parametrize("error", [np.zeros(41), np.full(41, np.nan), np.geomspace(1e-300, 1e300, 41)])
    def test_any_error_can_be_drawn(self, error: np.ndarray) -> None:
        write(make_film(make_model(), error=error), VideoOptions(), 1.0)

    def test_long_names_are_shortened(self) -> None:
        short = shorten("a very long name of a scenario", 20, 120)
        assert short.endswith("…")
        assert font(20).getlength(short) <= 120
        assert shorten("paper", 20, 120) == "paper"


class TestEnlarging:
    def test_geoms_move_away_from_the_root_body(self) -> None:
        model = make_model()
        film = make_film(model)
        before, after = mujoco.MjData(model), None
        mujoco.mj_kinematics(model, before)
        enlarge_vehicles(model, film.body_id, 3.0)
        after = mujoco.MjData(model)
        mujoco.mj_kinematics(model, after)
        for name, size in (("box1", [3.0, 1.5, 0.9]), ("ball1", [0.6, 0.0, 0.0])):
            origin = before.body("vehicle1").xpos
            expected = origin + 3 * (before.geom(name).xpos - origin)
            np.testing.assert_allclose(after.geom(name).xpos, expected)
            np.testing.assert_allclose(model.geom(name).size, size)
        assert model.geom("water").size.tolist() == make_model().geom("water").size.tolist()
