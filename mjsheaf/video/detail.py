"""How far and how finely a model is drawn, given where the camera is."""

import mujoco
import numpy as np

from mjsheaf.video.camera import CameraPath
from mjsheaf.video.film import VideoOptions

NEAR, FAR = 0.02, 40.0  # nearest and farthest drawn, as parts of the camera's shortest and longest distance
FEWEST_SLICES = 12  # sides of a round thing
FLATNESS = 0.6  # how far a side may be from the circle, in pixels


def set_depth_range(model: mujoco.MjModel, camera: CameraPath) -> None:
    """Draw from NEAR to FAR; MuJoCo's own range comes from the model's first pose, not from this run."""
    # MuJoCo has both in units of the model's extent.
    model.vis.map.znear = NEAR * float(camera.distance.min()) / model.stat.extent
    model.vis.map.zfar = FAR * float(camera.distance.max()) / model.stat.extent


def set_smoothness(model: mujoco.MjModel, camera: CameraPath, vehicle_radius: float, options: VideoOptions) -> None:
    """Give round things no more sides than can be seen: vehicles of small round parts cost half of a frame.

    Args:
        model: changed; it never gets more sides than it had.
        camera: decides how large vehicles look.
        vehicle_radius: of the largest vehicle, in m.
        options: give the height with which the scene is drawn.
    """
    pixels = vehicle_radius / camera.view(int(camera.distance.argmin())).metres_per_pixel(options.drawn[1])
    # The largest round part is taken to be a third of its vehicle. n sides miss a circle of radius r by
    # r (1 - cos(pi / n)).
    part = max(pixels / 3, 2 * FLATNESS)
    slices = max(int(np.ceil(np.pi / np.arccos(1 - FLATNESS / part))), FEWEST_SLICES)
    model.vis.quality.numslices = min(model.vis.quality.numslices, slices)
    model.vis.quality.numstacks = min(model.vis.quality.numstacks, slices * 2 // 3)
