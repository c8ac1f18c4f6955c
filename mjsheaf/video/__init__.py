"""Videos of finished runs as MP4, drawn without a display.

Modules:

- film: the content of a video, of a run or of two side by side, the viewer's options, and the content of each frame;
- draw: the whole of it, film and model in, video file out;
- camera, scene, overlay: where the camera is, vehicles, decoration and sea as pixels, what is written over them;
- gl: which offscreen OpenGL works here.
"""

from mjsheaf.video.film import Film, VideoOptions
from mjsheaf.video.gl import available_backend

__all__ = ["Film", "VideoOptions", "available_backend"]
