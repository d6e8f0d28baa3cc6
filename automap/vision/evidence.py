"""Whether a blob without a known face is the plate of a sign at all."""

from __future__ import annotations

import cv2
import numpy as np

from automap.records import FloatArray
from automap.vision.detector import Image
from automap.vision.templates import face_patch

_RING = (0.80, 0.97)
_INSIDE = 0.62


def looks_like_plate(
    image: Image, colour_map: Image, box: FloatArray, shape: str, group: str
) -> bool:
    """Judge the inside of a blob in ``box`` [4] px.

    A red rim encloses something pale or dark that is not red; a red octagon, a blue or a
    yellow plate carries a mark that contrasts with it. Plain coloured areas, such as cars,
    awnings and lamps, have neither.
    """
    luma = face_patch(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), box, shape)
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
    if rim_tint < 15.0:
        return False
    if group in ("red-circle", "red-triangle-up", "red-triangle-down"):
        # a ring all around, and a middle of another colour
        around = float((tint[ring] > 0.5 * rim_tint).mean())
        free = float((tint[inside] < 0.5 * rim_tint).mean())
        return around > 0.75 and free > 0.5
    plate = float(np.median(luma[ring]))
    spread = np.abs(luma[inside] - plate)
    contrast = max(25.0, 0.25 * plate)
    marked = float((spread > contrast).mean())
    return 0.06 < marked < 0.75


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
