"""What is added to the picture: decoration in the scene, writing over it, larger vehicles. No GL is needed."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from PIL import Image

from mjsheaf.video import VideoOptions
from mjsheaf.video.camera import View
from mjsheaf.video.curve import number
from mjsheaf.video.decorate import Decorator
from mjsheaf.video.enlarge import enlarge_vehicles, vehicle_radius
from mjsheaf.video.film import Film
from mjsheaf.video.legend import draw_legend
from mjsheaf.video.overlay import Overlay
from mjsheaf.video.sampling import moment
from mjsheaf.video.sprite import WHITE, Sprite, shorten, text

from .small_film import make_film, make_model

VIEW = View(np.zeros(3), 80.0, -60.0, -35.0, 45.0)
LINE = mujoco.mjtGeom.mjGEOM_LINE.value
SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE.value


def decorate(film: Film, options: VideoOptions, time: float) -> list[mujoco.MjvGeom]:
    decorator = Decorator(film, options)
    scene = mujoco.MjvScene(make_model(), decorator.most_geoms)
    decorator.add(scene, moment(film, time), VIEW)
    return list(scene.geoms[: scene.ngeom])


def write(film: Film, options: VideoOptions, time: float = 0.0) -> np.ndarray:
    frame = np.full((options.height, options.width, 3), 128, np.uint8)
    Overlay(film, options).write(frame, moment(film, time), VIEW)
    return frame


class TestDecoration:
    @pytest.mark.parametrize("trail", [0.0, 0.5, 6.0, 1e6])
    @pytest.mark.parametrize("time", [0.0, 0.01, 1.0, 2.0])
    def test_room_is_enough(self, trail: float, time: float) -> None:
        film = make_film(make_model())
        options = VideoOptions(trail=trail)
        assert len(decorate(film, options, time)) < Decorator(film, options).most_geoms

    def test_trails_end_at_the_vehicles_and_fade(self) -> None:
        film = make_film(make_model(), edges=[], surface="none")
        lines = [geom for geom in decorate(film, VideoOptions(trail=1.0), 2.0) if geom.type == LINE]
        blue = [geom for geom in lines if np.allclose(geom.rgba[:3], film.colours[0])]
        alphas = [float(geom.rgba[3]) for geom in blue]
        assert min(alphas) < 0.2
        assert max(alphas) > 0.8
        # A line geom lies along its z axis from its pos, as long as its third size.
        ends = [geom.pos + geom.size[2] * geom.mat[:, 2] for geom in lines]
        for vehicle in film.positions[-1]:
            assert min(np.linalg.norm(end - vehicle) for end in ends) < 0.01

    def test_a_trail_longer_than_the_run_shows_all_of_it(self) -> None:
        film = make_film(make_model(), edges=[], surface="none")
        lines = [geom for geom in decorate(film, VideoOptions(trail=1e6), 2.0) if geom.type == LINE]
        assert len(lines) > 5 * 40  # not one straight line for each of five vehicles

    def test_trails_of_a_crowd_stay_affordable(self) -> None:
        film = make_film(make_model())
        crowd = replace(
            film,
            target_ids=[f"T{k}" for k in range(997)],
            positions=np.repeat(film.positions, 200, axis=1),
            quaternions=np.repeat(film.quaternions, 200, axis=1),
            qpos_address=np.repeat(film.qpos_address, 200),
            body_id=np.repeat(film.body_id, 200),
            group=np.repeat(film.group, 200),
        )
        assert Decorator(crowd, VideoOptions()).most_geoms < 12_000

    def test_parallel_edges_are_drawn_once(self) -> None:
        film = make_film(make_model(), edges=[(0, 1, "communication")], surface="none")
        double = replace(film, edges=[(0, 1, "communication")] * 2)
        options = VideoOptions(trail=0)
        assert len(decorate(film, options, 1.0)) == len(decorate(double, options, 1.0))

    def test_a_ball_of_its_colour_for_each_agent(self) -> None:
        film = make_film(make_model(), surface="none")
        balls = [geom for geom in decorate(film, VideoOptions(), 0.0) if geom.type == SPHERE]
        assert len(balls) == 3
        for ball, goal, group in zip(balls, film.harmonic_extension[0], film.group[:3], strict=True):
            np.testing.assert_allclose(ball.pos, goal, atol=1e-5)
            np.testing.assert_allclose(ball.rgba[:3], film.colours[group], atol=1e-6)

    def test_only_what_is_off_the_surface_gets_a_stem(self) -> None:
        film = make_film(make_model(), edges=[])
        options = VideoOptions(trail=0)
        with_surface, without = (
            len(decorate(replace(film, surface=surface), options, 0.0)) for surface in ("water", "none")
        )
        assert with_surface - without == 2 * 2  # two targets below the water, each a line and its foot

    def test_stems_end_at_the_surface_wherever_it_is(self) -> None:
        film = make_film(make_model(), edges=[])
        film = replace(film, positions=film.positions + np.array([0.0, 0.0, 30.0]), surface_height=30.0)
        with_surface, without = (
            decorate(replace(film, surface=surface), VideoOptions(trail=0), 0.0) for surface in ("water", "none")
        )
        assert len(with_surface) - len(without) == 2 * 2  # still the two targets below the water
        for k, target in enumerate(film.positions[0, 3:]):
            line, foot = with_surface[2 * k : 2 * k + 2]
            np.testing.assert_allclose(foot.pos, [*target[:2], 30.0], atol=1e-5)
            np.testing.assert_allclose(line.pos + line.size[2] * line.mat[:, 2], foot.pos, atol=1e-4)


class TestWriting:
    @pytest.mark.parametrize("size", [(64, 64), (160, 120), (1280, 720), (720, 1280)])
    def test_any_size_of_frame(self, size: tuple[int, int]) -> None:
        frame = write(make_film(make_model()), VideoOptions(width=size[0], height=size[1]))
        assert frame.std() > 1

    def test_status_changes_with_time_and_legend_does_not(self) -> None:
        film = make_film(make_model(), positions=np.zeros((41, 5, 3)))
        options = VideoOptions(width=640, height=360)
        early, late = write(film, options, 0.5), write(film, options, 1.5)
        assert (early[:120] != late[:120]).any()
        np.testing.assert_array_equal(early[240:, :150], late[240:, :150])

    def test_labels_follow_their_vehicles_out_of_the_picture(self) -> None:
        film = make_film(make_model())
        far = replace(film, positions=film.positions + np.array([1e7, 0.0, 0.0]))
        behind = replace(film, positions=film.positions - 1e3 * np.array([0.4, -0.7, -0.6]))
        for gone in (far, behind):
            frame = write(gone, VideoOptions())
            assert (frame[300:400, 400:] == 128).all()

    def test_a_crowd_of_agents_is_not_labelled(self) -> None:
        few = make_film(make_model(), target_ids=[], agent_ids=list("abcde"), harmonic_extension=np.zeros((41, 5, 3)))
        many = replace(
            few,
            agent_ids=[f"a{k}" for k in range(25)],
            positions=np.repeat(few.positions, 5, axis=1),
            quaternions=np.repeat(few.quaternions, 5, axis=1),
            harmonic_extension=np.zeros((41, 25, 3)),
            qpos_address=np.repeat(few.qpos_address, 5),
            body_id=np.repeat(few.body_id, 5),
            group=np.repeat(few.group, 5),
        )
        untouched = [(write(film, VideoOptions())[:, 400:] == 128).all() for film in (few, many)]
        assert untouched == [False, True]

    def test_legend_has_a_row_for_each_thing_and_note(self) -> None:
        film = make_film(make_model())
        plain = draw_legend(film, VideoOptions()).height
        assert draw_legend(film, VideoOptions(speed=2)).height > plain
        assert draw_legend(replace(film, edges=film.edges[:2]), VideoOptions()).height < plain

    @pytest.mark.parametrize(("column", "row"), [(5, 7), (-3, -2), (28, 17), (-40, 5), (5, 40)])
    def test_sprite_is_cut_off_at_the_frame(self, column: int, row: int) -> None:
        rgba = np.random.default_rng(0).integers(0, 256, (6, 8, 4), np.uint8)
        rgba[..., 3] = 255
        frame = np.zeros((20, 30, 3), np.uint8)
        Sprite.of(Image.fromarray(rgba)).lay(frame, column, row)
        expected = np.zeros((120, 130, 3), np.uint8)  # with room for the sprite on all sides
        expected[50 + row : 56 + row, 50 + column : 58 + column] = rgba[..., :3]
        np.testing.assert_array_equal(frame, expected[50:70, 50:80])

    def test_opacity(self) -> None:
        rgba = np.zeros((1, 3, 4), np.uint8)
        rgba[0, :, :] = [[200, 200, 200, 0], [200, 200, 200, 128], [200, 200, 200, 255]]
        frame = np.full((1, 3, 3), 100, np.uint8)
        Sprite.of(Image.fromarray(rgba)).lay(frame, 0, 0)
        np.testing.assert_allclose(frame[0, :, 0].astype(int), [100, 150, 200], atol=1)

    @pytest.mark.parametrize("error", [np.zeros(41), np.full(41, np.nan), np.geomspace(1e-300, 1e300, 41)])
    def test_any_error_can_be_drawn(self, error: np.ndarray) -> None:
        write(make_film(make_model(), error=error), VideoOptions(), 1.0)

    @pytest.mark.parametrize(
        ("value", "written"),
        [(230.33, "230"), (1.5249, "1.52"), (0.0123, "0.0123"), (4.2e-7, "4.2e-07"), (0.0, "0"), (12345.6, "12346")],
    )
    def test_numbers(self, value: float, written: str) -> None:
        assert number(value) == written

    def test_long_names_are_shortened(self) -> None:
        short = shorten("a very long name of a scenario", 20, 120)
        assert short.endswith("…")
        assert text(short, 20, WHITE).width < 130
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

    def test_radius_holds_every_geom_at_any_angle_of_the_hinge(self) -> None:
        model = make_model()
        radius = vehicle_radius(model, make_film(model).body_id)
        assert radius == pytest.approx(2 + 0.5 + 0.2)  # the ball's body, the ball's place in it, its radius
        enlarge_vehicles(model, make_film(model).body_id, 3.0)
        assert vehicle_radius(model, make_film(model).body_id) == pytest.approx(3 * radius)
