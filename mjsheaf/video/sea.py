"""The sea of a run with waves: a lit surface over their elevation, out to the horizon.

A wave's phase k . x - omega t is a sum over x and y, so that all waves on a grid of n by n points are one product of
matrices. The grid is finest where the camera looks. A wave that is too short for the grid at a place is left out there.
"""

from collections.abc import Sequence
from ctypes import c_void_p
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjsheaf.media.waves import Components
from mjsheaf.video.camera import View, axes
from mjsheaf.video.film import FloatArray

POINTS = 201  # of the grid along x and along y
REACH = 36.0  # from its middle to its edge, in distances of the camera
GRADING = 6.0  # about exp(GRADING) is the ratio of the widest spacing to the finest
SHORTEST = 1.5  # k times the spacing, in rad, from which on a wave fades

DEEP = np.array([0.04, 0.21, 0.33])  # colours, RGB in 0..1: of the water,
CREST = np.array([0.20, 0.50, 0.58])  # of high water, through which light falls,
HORIZON = np.array([0.80, 0.88, 0.94])  # and of the sky, low and high
ZENITH = np.array([0.32, 0.52, 0.76])
SUN = np.array([0.48, 0.36, 0.80])  # unit vector to it
GLITTER = 60.0  # exponent of the sun's reflection
HAZE = 14.0  # distances of the camera at which the water has nearly the colour of the horizon
OPACITY = 0.88  # what is under water shows through


@dataclass(frozen=True)
class Sea:
    """Waves about a height, from a time on.

    Attributes:
        start: time from which on the sea is this one, s.
        waves: its waves.
        level: z of the undisturbed surface, m.
    """

    start: float
    waves: Components
    level: float

    def surface(self, x: FloatArray, y: FloatArray, time: float) -> FloatArray:
        """Return elevation, m, and slopes along x and y on a grid, shape (3, X, Y).

        Args:
            x: Places of the grid's lines along x, increasing, shape (X,), m.
            y: Places along y, shape (Y,), m.
            time: Time, s.
        """
        waves = self.waves
        k_x, k_y = waves.number * waves.unit.T
        along_x = _faded(k_x, x) * np.exp(1j * np.outer(x, k_x))
        along_y = _faded(k_y, y) * np.exp(1j * np.outer(y, k_y))
        now = waves.amplitude * np.exp(1j * (waves.phase - waves.rate * time))
        factors = (now, 1j * k_x * now, 1j * k_y * now)
        return np.stack([((along_x * factor) @ along_y.T).real for factor in factors])


def sea_at(seas: Sequence[Sea], time: float) -> Sea | None:
    """Return the sea at a time, the last that has begun, or the first; None without waves."""
    begun = [sea for sea in seas if sea.start <= time + 1e-9]
    return next(iter(begun[-1:] or seas), None)


def _faded(number: FloatArray, places: FloatArray) -> FloatArray:
    """Return how much of each wave a grid can show: 1 down to 0, shape (P, N); wave numbers (N,), places (P,)."""
    spacing = np.gradient(places)
    return np.asarray(np.exp(-((np.outer(spacing, number) / SHORTEST) ** 4)))


def mesh(sea: Sea, view: View, time: float) -> tuple[FloatArray, FloatArray]:
    """Return a graded grid on the surface about the point that a camera looks at.

    Args:
        sea: The sea.
        view: The camera's view.
        time: Time, s.

    Returns:
        Points, shape (P, P, 3), m, and their colours, RGBA in 0..1, shape (P, P, 4).
    """
    graded = REACH * view.distance * np.sinh(np.linspace(-GRADING, GRADING, POINTS)) / np.sinh(GRADING)
    x = view.lookat[0] + graded
    y = view.lookat[1] + graded
    height, slope_x, slope_y = sea.surface(x, y, time)
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), sea.level + height], axis=-1)
    normal = np.stack([-slope_x, -slope_y, np.ones_like(height)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    to_eye = view.lookat - view.distance * axes(view.azimuth, view.elevation)[2] - points
    away = np.linalg.norm(to_eye, axis=-1, keepdims=True)
    to_eye /= away
    rgb = _lit(normal, to_eye, height / max(4.0 * np.sqrt(np.sum(sea.waves.amplitude**2) / 2.0), 1e-9))
    haze = 1.0 - np.exp(-((away / (HAZE * view.distance)) ** 2) * 3.0)
    rgb += haze * (HORIZON - rgb)
    return points, np.concatenate([rgb, np.maximum(haze, OPACITY)], axis=-1)


def _lit(normal: FloatArray, to_eye: FloatArray, height: FloatArray) -> FloatArray:
    """Return colours of water, RGB, by its normals, unit vectors to the eye, and elevations over H_s.

    It reflects the sky by Schlick's formula, and the sun.
    """
    facing = np.clip(np.sum(normal * to_eye, axis=-1, keepdims=True), 0.0, 1.0)
    mirrored = 2.0 * facing * normal - to_eye
    sky = HORIZON + np.clip(mirrored[..., 2:], 0.0, 1.0) * (ZENITH - HORIZON)
    water = DEEP + np.clip(0.5 + height, 0.0, 1.0)[..., None] * (CREST - DEEP)
    water *= 0.25 + 0.9 * np.clip(normal @ SUN, 0.0, 1.0)[..., None]
    fresnel = 0.02 + 0.98 * (1.0 - facing) ** 5
    glitter = 0.5 * np.clip(mirrored @ SUN, 0.0, 1.0)[..., None] ** GLITTER
    return np.asarray(np.clip(water + fresnel * (sky - water) + glitter, 0.0, 1.0))


def _triangles() -> FloatArray:
    """Return the corners of the grid's triangles, shape (n,)."""
    corner = np.arange(POINTS * POINTS).reshape(POINTS, POINTS)[:-1, :-1].ravel()
    corners = [corner, corner + POINTS, corner + 1, corner + 1, corner + POINTS, corner + POINTS + 1]
    return np.stack(corners, axis=1).ravel().astype(np.uint32)


TRIANGLES = _triangles()


def draw_sea(points: FloatArray, rgba: FloatArray) -> None:
    """Draw a mesh into the current context's buffer, where nothing nearer is; it hides nothing that is drawn later.

    Args:
        points: Corners of the triangles, shape (P, P, 3), m.
        rgba: Their colours in 0..1, shape (P, P, 4).
    """
    from OpenGL import GL
    from OpenGL.raw.GL.VERSION import GL_1_1 as RAW

    gl: Any = GL
    vertices = np.ascontiguousarray(points, np.float32)
    colours = np.ascontiguousarray(rgba, np.float32)
    RAW.glVertexPointer(3, gl.GL_FLOAT, 0, vertices.ctypes.data_as(c_void_p))
    RAW.glColorPointer(4, gl.GL_FLOAT, 0, colours.ctypes.data_as(c_void_p))
    gl.glBindBuffer(gl.GL_ELEMENT_ARRAY_BUFFER, 0)
    RAW.glDrawElements(gl.GL_TRIANGLES, len(TRIANGLES), gl.GL_UNSIGNED_INT, TRIANGLES.ctypes.data_as(c_void_p))
