"""Draws a finished run to an MP4, without a display.

Where to look:

- film: a team over time, the viewer's options, and what each frame shows of them;
- from_run: a film of a run's data;
- draw: the whole of it, film and model in, video file out;
- camera, scene, overlay: where the camera is, and what is added to the vehicles and written over them;
- gl, renderer: how it becomes pixels.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mjsheaf.video.film import Film, VideoOptions
from mjsheaf.video.gl import available_backend

if TYPE_CHECKING:
    from mjsheaf.video.draw import draw_video

__all__ = ["Film", "VideoOptions", "available_backend", "draw_video"]


def __getattr__(name: str) -> Any:
    # draw_video is imported when first used, for it imports MuJoCo, and that fails where the variable MUJOCO_GL
    # names a backend that is not there: `available_backend` must be able to say so first.
    if name == "draw_video":
        return import_module("mjsheaf.video.draw").draw_video
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
