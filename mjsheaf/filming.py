"""From a run's data to its video: what the video package needs to know, gathered."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf.plots.palette import group_of_vehicles, palette
from mjsheaf.scenario import Scenario
from mjsheaf.video import Film, VideoOptions

if TYPE_CHECKING:
    from mjsheaf.engine import mujoco

Array = NDArray[np.float64]


def film_run(
    scenario: Scenario,
    dataset: xr.Dataset,
    path: Path,
    options: VideoOptions,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Draw a run to an MP4.

    Args:
        scenario: the scenario that was run.
        dataset: its data.
        path: the file.
        options: size, rate, camera.
        progress: called with (frames done, frames in all).

    Returns:
        The number of frames.
    """
    from mjsheaf.video import draw_video

    film, model = film_of(scenario, dataset)
    return draw_video(film, model, path, options, progress)


def film_of(scenario: Scenario, dataset: xr.Dataset) -> "tuple[Film, mujoco.MjModel]":
    """What is drawn of a run, and the model that it is drawn with.

    Args:
        scenario: the scenario that was run.
        dataset: its data.
    """
    from mjsheaf.backends.physics.world import arena_of

    system = scenario.system()
    team = system.team
    group, names = group_of_vehicles(team)
    colours = palette(len(team.formations))
    arena = arena_of(system, colours[group])
    positions, quaternions = _poses(scenario, dataset)
    q_star = dataset["harmonic_extension"].values.copy()
    height = positions[:, : q_star.shape[1], 2]
    q_star[..., 2] = np.where(np.isnan(q_star[..., 2]), height, q_star[..., 2])
    number = {m.id: v for v, m in enumerate(team.members)}
    film = Film(
        name=scenario.name,
        subtitle=_subtitle(scenario, dataset),
        time=dataset["time"].values,
        agent_ids=team.agent_ids,
        target_ids=team.target_ids,
        positions=positions,
        quaternions=quaternions,
        qpos_address=arena.qpos,
        body_id=arena.body,
        harmonic_extension=q_star,
        group=group,
        group_names=names,
        colours=colours,
        edges=[(number[e.tail], number[e.head], "communication") for e in team.communication]
        + [(number[e.tail], number[e.head], "sensing") for e in team.sensing],
        error_name="mean |η|",
        error=dataset["disagreement"].values.mean(axis=1),
        error_unit="m",
        surface=scenario.scene.surface,
        surface_height=scenario.scene.height,
    )
    return film, arena.model


def video_options(scenario: Scenario, **changes: float | int | None) -> VideoOptions:
    """The scenario's video section as options; changes that are None leave it as it is."""
    given = scenario.video.model_dump() | {"vehicle_scale": scenario.scene.vehicle_scale}
    return VideoOptions(**given | {name: value for name, value in changes.items() if value is not None})


def _subtitle(scenario: Scenario, dataset: xr.Dataset) -> str:
    word = "MuJoCo bodies" if dataset.attrs["backend"] == "physics" else "ideal kinematics"
    unstable = "" if dataset.attrs["status"] == "finished" else ", blew up"
    return f"{word}, gain {scenario.controller.gain:g} 1/s{unstable}"


def _poses(scenario: Scenario, dataset: xr.Dataset) -> tuple[Array, Array]:
    """Positions (T, V, 3) and attitudes (T, V, 4) of the bodies.

    Ideal kinematics have neither height in the plane nor attitude: vehicles lie on the surface and face where they go.
    """
    positions = np.concatenate([dataset["agent_position"].values, dataset["target_position"].values], axis=1)
    if dataset.attrs["backend"] == "physics":
        positions[..., 2] = np.concatenate([dataset["agent_height"].values, dataset["target_height"].values], axis=1)
        both = [dataset["agent_orientation"].values, dataset["target_orientation"].values]
        return positions, np.concatenate(both, axis=1)
    positions[..., 2] = np.where(np.isnan(positions[..., 2]), scenario.scene.height, positions[..., 2])
    return positions, _facing_forward(dataset["time"].values, positions)


def _facing_forward(time: Array, positions: Array) -> Array:
    """Level attitudes whose heading follows the horizontal velocity, smoothed over half a second."""
    quaternions = np.zeros((*positions.shape[:2], 4))
    quaternions[..., 0] = 1.0
    if len(time) < 3:
        return quaternions
    window = max(1, min(len(time), round(0.5 / float(time[1] - time[0]))))
    velocity = np.gradient(positions[..., :2], time, axis=0)
    speed = np.linalg.norm(velocity, axis=2, keepdims=True)
    direction = velocity / np.maximum(speed, 1e-9)  # the first seconds are fast: each instant has an equal say
    kernel = np.ones(window) / window
    for v in range(positions.shape[1]):
        smooth = np.column_stack([np.convolve(direction[:, v, i], kernel, mode="same") for i in range(2)])
        heading = np.arctan2(smooth[:, 1], smooth[:, 0])
        quaternions[:, v, 0], quaternions[:, v, 3] = np.cos(heading / 2), np.sin(heading / 2)
    return quaternions
