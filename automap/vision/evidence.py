"""Whether a blob without a known face is the plate of a sign at all."""

from __future__ import annotations

import numpy as np

from automap.records import FloatArray
from automap.vision.detector import Image
from automap.vision.templates import face_patch

_RING = (0.80, 0.97)
_INSIDE = 0.62
_LUMA = np.array([0.114, 0.587, 0.299], np.float32)
"""Weights of blue, green and red, ITU-R BT.601."""
_CLOSED = 0.75
# glass and shaded walls reflect the sky: weakly blue is no paint
_LEAST_TINT = {"red": 15.0, "blue": 45.0, "yellow": 40.0}
_MARKED = (0.06, 0.75)


def looks_like_plate(
    image: Image, colour_map: Image, box: FloatArray, shape: str, group: str
) -> bool:
    """Judge the inside of a blob in ``box`` [4] px.

    The rim has the colour all around. A red one encloses something that is not red; a red
    octagon or a blue plate carries a paler mark, a yellow one a darker. Plain coloured areas,
    such as cars, awnings and lamps, have neither.
    """
    luma = face_patch(image, box, shape) @ _LUMA
    tint = face_patch(colour_map, box, shape)
    n = luma.shape[0]
    axis = (np.arange(n) - (n - 1) / 2.0) / ((n - 8) / 2.0)
    if shape in ("triangle-up", "triangle-down"):
        reach = _triangle_reach(axis, up=shape == "triangle-up")
    elif shape == "square":
        reach = np.maximum(np.abs(axis)[None, :], np.abs(axis)[:, None])
    elif shape == "diamond":
        reach = np.abs(axis)[None, :] + np.abs(axis)[:, None]
    else:
        reach = np.hypot(axis[None, :], axis[:, None])
    ring = (reach > _RING[0]) & (reach < _RING[1])
    inside = reach < _INSIDE
    rim_tint = float(np.median(tint[ring]))
    if rim_tint < _LEAST_TINT[group.partition("-")[0]]:
        return False
    around = float((tint[ring] > 0.5 * rim_tint).mean())
    if around < _CLOSED:
        return False
    if group in ("red-circle", "red-triangle-up", "red-triangle-down"):
        # a middle of another colour
        return float((tint[inside] < 0.5 * rim_tint).mean()) > 0.5
    plate = float(np.median(luma[ring]))
    contrast = max(25.0, 0.25 * plate)
    # marks are black on yellow and white on the others
    towards = -1.0 if group == "yellow-diamond" else 1.0
    marked = float((towards * (luma[inside] - plate) > contrast).mean())
    return _MARKED[0] < marked < _MARKED[1]


def _triangle_reach(axis: FloatArray, up: bool) -> FloatArray:
    """0 at the centroid, 1 on the sides of the equilateral triangle in the unit square."""
    x, y = axis[None, :], axis[:, None] if up else -axis[:, None]
    height = np.sqrt(3.0)
    base = height / 2.0  # of the lower side, in units of half the width
    inner = height / 3.0
    centre = base - inner
    down = (y - centre) / inner
    slope = (np.abs(x) * np.cos(np.pi / 6) - (y - centre) * np.sin(np.pi / 6)) / inner
    return np.asarray(np.maximum(down, slope))
