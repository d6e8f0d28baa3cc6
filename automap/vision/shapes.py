"""The outlines that faces have, compared with blobs, and measured by their moments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from automap.records import FloatArray
from automap.vision.faces import outline_points
from automap.vision.vocabulary import SHAPES

_GRID = 40
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
def _shape_masks() -> np.ndarray:  # type: ignore[type-arg]
    return np.stack([_mask(boxed_outline(shape)) for shape in SHAPES])


def _mask(points: FloatArray) -> np.ndarray:  # type: ignore[type-arg]
    mask = np.zeros((_GRID, _GRID), np.uint8)
    fixed = np.rint((points * _GRID - 0.5) * (1 << _SHIFT)).astype(np.int32)
    cv2.fillPoly(mask, [fixed], 1, cv2.LINE_8, _SHIFT)
    return mask.astype(bool)


def match_shapes(hull: FloatArray) -> dict[str, float]:
    """Overlap (intersection over union, 0..1) of a hull [k, 2] px with every outline.

    Both are stretched to their bounding box, which takes out size and most of a turn about
    the vertical.
    """
    low, high = hull.min(axis=0) - 0.5, hull.max(axis=0) + 0.5
    # contours run through pixel centres: the blob reaches half a pixel further
    middle = (low + high) / 2.0
    extent = high - low
    grown = middle + (hull - middle) * (extent / np.maximum(extent - 1.0, 1.0))
    mask = _mask((grown - low) / extent)
    masks = _shape_masks()
    both = (masks & mask).sum(axis=(1, 2))
    either = (masks | mask).sum(axis=(1, 2))
    return dict(zip(SHAPES, (both / either).tolist(), strict=True))
