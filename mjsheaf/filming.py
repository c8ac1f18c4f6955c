"""From a run's data to its video: what the video package needs to know, gathered."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from mjsheaf.plotting import group_of_vehicles, palette
from mjsheaf.recorded import Recorded
from mjsheaf.scenario import Scenario
from mjsheaf.video import Film, VideoOptions

DRAFT_FPS = 15

if TYPE_CHECKING:
    from mjsheaf.engine import mujoco
    from mjsheaf.system import System


def film_run(
    scenario: Scenario,
    dataset: xr.Dataset,
    path: Path,
    options: VideoOptions,
    progress: Callable[[int, int], None] | None = None,
    system: "System | None" = None,
) -> int:
    """Draw a run to an MP4.

    Args:
        scenario: the scenario that was run.
        dataset: its data, in memory or opened: it is read as it is drawn.
        path: the file.
        options: size, rate, camera.
        progress: called with (frames done, frames in all).
        system: the scenario's, where it was built already.

    Returns:
        The number of frames.
    """
    from mjsheaf.video import draw_video

    film, model = film_of(scenario, dataset, system)
    return draw_video(film, model, path, options, progress)


def film_of(scenario: Scenario, dataset: xr.Dataset, system: "System | None" = None) -> "tuple[Film, mujoco.MjModel]":
    """What is drawn of a run, and the model that it is drawn with.

    Args:
        scenario: the scenario that was run.
        dataset: its data, in memory or opened: the film reads from it as it is drawn.
        system: the scenario's, where it was built already.
    """
    from mjsheaf.simulation.loop import arena_of

    system = scenario.system if system is None else system
    team = system.team
    group, names = group_of_vehicles(team)
    colours = palette(len(team.formations))
    arena = arena_of(system, colours[group])
    recorded = Recorded(dataset, scenario.scene.height)
    number = {m.id: v for v, m in enumerate(team.members)}
    film = Film(
        name=scenario.name,
        subtitle=_subtitle(scenario, dataset),
        time=recorded.time,
        agent_ids=team.agent_ids,
        target_ids=team.target_ids,
        positions=recorded.series("positions"),
        quaternions=recorded.series("quaternions"),
        qpos_address=arena.qpos,
        body_id=arena.body,
        harmonic_extension=recorded.series("harmonic_extension"),
        group=group,
        group_names=names,
        colours=colours,
        edges=[(number[e.tail], number[e.head], "communication") for e in team.communication]
        + [(number[e.tail], number[e.head], "sensing") for e in team.sensing],
        error_name="mean |η|",
        error=recorded.series("error"),
        error_unit="m",
        surface=scenario.scene.surface,
        surface_height=scenario.scene.height,
    )
    return film, arena.model


def video_options(scenario: Scenario, **changes: float | int | str | None) -> VideoOptions:
    """The scenario's video section as options; changes that are None leave it as it is.

    A draft has at most 15 frames a second, unless `fps` is among the changes.
    """
    changes = {name: value for name, value in changes.items() if value is not None}
    given = scenario.video.model_dump() | {"vehicle_scale": scenario.scene.vehicle_scale} | changes
    if given["quality"] == "draft" and "fps" not in changes:
        given["fps"] = min(given["fps"], DRAFT_FPS)
    return VideoOptions(**given)


def _subtitle(scenario: Scenario, dataset: xr.Dataset) -> str:
    word = "MuJoCo bodies" if dataset.attrs["backend"] == "physics" else "ideal kinematics"
    unstable = "" if dataset.attrs["status"] == "finished" else ", blew up"
    return f"{word}, gain {scenario.controller.gain:g} 1/s{unstable}"
