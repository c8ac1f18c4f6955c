"""Videos of finished runs as MP4, drawn without a display.

Modules:

- film: the content of a video of one run or two side by side, the viewer's options, and the content of each frame;
- draw: drawing of a video file from its content and the model;
- camera, scene, overlay: position of the camera; pixels of vehicles, decoration and sea; curves and labels over them;
- gl: choice of an offscreen OpenGL that works on this machine.
"""

from mjsheaf.video.film import Film, VideoOptions
from mjsheaf.video.gl import available_backend

__all__ = ["Film", "VideoOptions", "available_backend"]
