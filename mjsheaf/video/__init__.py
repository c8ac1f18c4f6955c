"""Draws a finished run to an MP4, without a display.

Modules:

- film: the content of a video: a team over time, the viewer's options, and the content of each frame;
- from_run: the content of a run's video, or of two runs side by side;
- draw: the whole of it, film and model in, video file out;
- camera, scene, overlay: where the camera is, vehicles and decoration as pixels, what is written over them;
- sizes, flow: scales of vehicles and colours of speeds, which the page shares;
- legend, text: the panel next to the scene, and lettering;
- gl: which offscreen OpenGL works here.

`draw` and `scene` import MuJoCo, which fails where MUJOCO_GL names a backend that is not there: ask
`available_backend` before importing them.
"""

from mjsheaf.video.film import Film, VideoOptions
from mjsheaf.video.gl import available_backend

__all__ = ["Film", "VideoOptions", "available_backend"]
