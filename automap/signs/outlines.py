"""The outlines of faces, by shape and by class."""

from __future__ import annotations

import math

import numpy as np

from automap.records import FloatArray
from automap.signs.vocabulary import SHAPES, load_vocabulary

UNSURE_SHAPES = ("square",)
"""Groups of plates that are wider or taller than square as well."""


def outline_points(shape: str, n: int = 96) -> FloatArray:
    """Corners [k, 2] of a face's outline in the unit square, clockwise, y down.

    A circle has ``n`` points. Triangles are equilateral, as high as they can be in the
    square, and centred in it.
    """
    if shape == "circle":
        a = np.arange(n) * (2.0 * math.pi / n)
        return np.stack([0.5 + 0.5 * np.cos(a), 0.5 + 0.5 * np.sin(a)], axis=1)
    if shape == "octagon":
        a = (np.arange(8) + 0.5) * (math.pi / 4.0)
        r = 0.5 / math.cos(math.pi / 8.0)
        return np.stack([0.5 + r * np.cos(a), 0.5 + r * np.sin(a)], axis=1)
    h = math.sqrt(3.0) / 2.0
    top = (1.0 - h) / 2.0
    corners = {
        "triangle-up": [(0.5, top), (1.0, top + h), (0.0, top + h)],
        "triangle-down": [(0.0, top), (1.0, top), (0.5, top + h)],
        "diamond": [(0.5, 0.0), (1.0, 0.5), (0.5, 1.0), (0.0, 0.5)],
        "square": [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)],
    }
    return np.array(corners[shape], np.float64)


def outline_of(name: str) -> tuple[str, bool]:
    """Shape of the face of a class or of a group's own name, and whether its width over its height
    is known from that: not that of plates, nor of a face that the table of classes lacks."""
    group = load_vocabulary().group_of(name) or ""
    shape = next((shape for shape in SHAPES if group.endswith(shape)), "square")
    return shape, shape not in UNSURE_SHAPES
