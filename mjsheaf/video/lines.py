"""Many lines in one call of OpenGL: as geoms of MuJoCo's scene, each of a thousand takes twenty microseconds."""

from collections.abc import Sequence
from ctypes import c_void_p
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatRows = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Lines:
    """Straight lines of one width.

    Attributes:
        ends: where each begins and ends. Shape (n, 2, 3), in m.
        rgba: colour and opacity of each. Shape (n, 4), 0..1.
        width: in pixels.
    """

    ends: FloatRows
    rgba: FloatRows
    width: float

    @classmethod
    def of(cls, starts: npt.ArrayLike, ends: npt.ArrayLike, rgba: npt.ArrayLike, width: float) -> "Lines":
        """Join starts and ends, each of shape (n, 3); one colour (4,) is for all."""
        both = np.stack([np.asarray(starts), np.asarray(ends)], axis=1, dtype=np.float32, casting="same_kind")
        colours = np.broadcast_to(np.asarray(rgba, np.float32), (len(both), 4))
        return cls(both, colours, width)


def draw_lines(batches: Sequence[Lines]) -> None:
    """Draw into the current context's buffer, over what MuJoCo drew there and behind what is nearer.

    MuJoCo leaves its camera's matrices and its depth test in place; everything that is changed is put back.
    """
    # PyOpenGL binds its library when first imported, which must be after the context was made: see gl.
    from OpenGL import GL
    from OpenGL.raw.GL.VERSION import GL_1_1 as RAW  # the plain functions keep no reference to arrays

    gl: Any = GL
    gl.glPushAttrib(
        gl.GL_ENABLE_BIT | gl.GL_LINE_BIT | gl.GL_COLOR_BUFFER_BIT | gl.GL_CURRENT_BIT | gl.GL_DEPTH_BUFFER_BIT
    )
    gl.glPushClientAttrib(gl.GL_CLIENT_VERTEX_ARRAY_BIT)
    try:
        for wanted in (gl.GL_LIGHTING, gl.GL_TEXTURE_2D, gl.GL_CULL_FACE):
            gl.glDisable(wanted)
        gl.glEnable(gl.GL_BLEND)
        gl.glBlendFunc(gl.GL_SRC_ALPHA, gl.GL_ONE_MINUS_SRC_ALPHA)
        gl.glDepthMask(gl.GL_FALSE)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)
        gl.glDisableClientState(gl.GL_NORMAL_ARRAY)
        gl.glDisableClientState(gl.GL_TEXTURE_COORD_ARRAY)
        gl.glEnableClientState(gl.GL_VERTEX_ARRAY)
        gl.glEnableClientState(gl.GL_COLOR_ARRAY)
        for lines in batches:
            ends = np.ascontiguousarray(lines.ends)
            colours = np.repeat(lines.rgba, 2, axis=0)
            gl.glLineWidth(lines.width)
            RAW.glVertexPointer(3, gl.GL_FLOAT, 0, ends.ctypes.data_as(c_void_p))
            RAW.glColorPointer(4, gl.GL_FLOAT, 0, colours.ctypes.data_as(c_void_p))
            gl.glDrawArrays(gl.GL_LINES, 0, 2 * len(ends))
    finally:
        gl.glPopClientAttrib()
        gl.glPopAttrib()
