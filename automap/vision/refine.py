"""Sub-pixel boxes from the moments of a soft mask."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from automap.records import FloatArray
from automap.vision.detector import Image
from automap.vision.shapes import shape_moments


@dataclass(frozen=True)
class BlobMoments:
    """Centroid and standard deviations of a blob's filled area, px."""

    mean_x: float
    mean_y: float
    sd_x: float
    sd_y: float


def moments_box(moments: BlobMoments, shape: str) -> FloatArray:
    """Box [4] px of the outline ``shape`` that has these moments."""
    ideal = shape_moments(shape)
    w, h = moments.sd_x / np.sqrt(ideal.var_x), moments.sd_y / np.sqrt(ideal.var_y)
    left, top = moments.mean_x - ideal.centre_x * w, moments.mean_y - ideal.centre_y * h
    return np.array([left, top, left + w, top + h])


def blob_moments(colour_map: Image, hull: FloatArray) -> BlobMoments | None:
    """Moments of the coloured blob whose hull is [k, 2] px.

    Each pixel counts by how far its colour lies between the background's and the blob's;
    the interior counts fully whatever is painted there. Centroid and variances of that mask
    give centre and extent, which averages over the whole rim and is far finer than its
    outermost pixels. None when the blob does not stand out.
    """
    low = np.floor(hull.min(axis=0)).astype(int)
    high = np.ceil(hull.max(axis=0)).astype(int)
    extent = high - low + 1
    margin = int(np.clip(extent.max() * 0.15, 3, 8))
    x0, y0 = np.maximum(low - margin, 0)
    x1, y1 = np.minimum(high + margin + 1, [colour_map.shape[1], colour_map.shape[0]])
    region = colour_map[y0:y1, x0:x1].astype(np.float64)
    filled = np.zeros(region.shape, np.uint8)
    cv2.fillConvexPoly(filled, np.rint(hull - [x0, y0]).astype(np.int32), 1)
    wide = cv2.dilate(filled, np.ones((3, 3), np.uint8), iterations=2)
    core = cv2.erode(
        filled, np.ones((3, 3), np.uint8), iterations=2, borderType=cv2.BORDER_CONSTANT
    )
    rim = (filled == 1) & (core == 0)
    outside = wide == 0
    if not outside.any() or not rim.any():
        return None
    background = float(np.median(region[outside]))
    edge = region[rim]
    bright = int(0.8 * (len(edge) - 1))
    colour = float(np.partition(edge, bright)[bright])
    if colour - background < 12.0:
        return None
    soft = np.clip((region - background) / (colour - background), 0.0, 1.0)
    soft[core == 1] = 1.0
    soft[outside] = 0.0
    total = soft.sum()
    xs, ys = np.arange(x0, x1, dtype=np.float64), np.arange(y0, y1, dtype=np.float64)
    along_x, along_y = soft.sum(axis=0) / total, soft.sum(axis=1) / total
    mx, my = float(along_x @ xs), float(along_y @ ys)
    # a pixel is a square of its own variance
    vx = float(along_x @ (xs - mx) ** 2) + 1.0 / 12.0
    vy = float(along_y @ (ys - my) ** 2) + 1.0 / 12.0
    return BlobMoments(mx, my, float(np.sqrt(vx)), float(np.sqrt(vy)))
