"""The outlines that faces have, compared with blobs, and measured by their moments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from automap.vision.faces import outline_points
from automap.vision.vocabulary import SHAPES

_GRID = 48
_REACH = 3.0
_SHIFT = 4


@dataclass(frozen=True)
class ShapeMoments:
    """Of an outline in its own bounding box, both axes scaled to 1: centroid and variances."""

    centre_x: float
    centre_y: float
    var_x: float
    var_y: float


def boxed_outline(shape: str) -> FloatArray:
    """Corners [k, 2] of an outline, stretched to fill the unit square."""
    points = outline_points(shape)
    low, high = points.min(axis=0), points.max(axis=0)
    return np.asarray((points - low) / (high - low))


@cache
def shape_moments(shape: str) -> ShapeMoments:
    """Centroid and variances of the area within an outline."""
    m = cv2.moments((boxed_outline(shape) * 1000.0).astype(np.float32))
    area = m["m00"]
    return ShapeMoments(
        m["m10"] / area / 1e3,
        m["m01"] / area / 1e3,
        m["mu20"] / area / 1e6,
        m["mu02"] / area / 1e6,
    )


@cache
def _shape_masks() -> npt.NDArray[np.bool_]:
    masks = []
    for shape in SHAPES:
        m = shape_moments(shape)
        centred = boxed_outline(shape) - [m.centre_x, m.centre_y]
        masks.append(_mask(centred / np.sqrt([m.var_x, m.var_y])))
    return np.stack(masks)


def _mask(points: FloatArray) -> npt.NDArray[np.bool_]:
    """Cells within a polygon [k, 2] given in standard deviations about its centroid."""
    mask = np.zeros((_GRID, _GRID), np.uint8)
    cells = (points / (2.0 * _REACH) + 0.5) * _GRID - 0.5
    fixed = np.rint(cells * (1 << _SHIFT)).astype(np.int32)
    cv2.fillPoly(mask, [fixed], 1, cv2.LINE_8, _SHIFT)
    return mask.astype(bool)


def match_shapes(hull: FloatArray) -> dict[str, float]:
    """Overlap (intersection over union, 0..1) of a hull [k, 2] px with every outline.

    Both are brought to the same centroid and variances, which takes out place, size and most
    of a turn about the vertical, and hardly depends on corners that blur has rounded off.
    """
    m = cv2.moments(hull.astype(np.float32))
    if m["m00"] <= 0.0:
        return dict.fromkeys(SHAPES, 0.0)
    centre = np.array([m["m10"], m["m01"]]) / m["m00"]
    spread = np.sqrt(np.array([m["mu20"], m["mu02"]]) / m["m00"])
    mask = _mask((hull - centre) / np.maximum(spread, 1e-6))
    masks = _shape_masks()
    both = (masks & mask).sum(axis=(1, 2))
    either = (masks | mask).sum(axis=(1, 2))
    return dict(zip(SHAPES, (both / either).tolist(), strict=True))
