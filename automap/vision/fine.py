"""Where a picture much larger than the networks need is searched pixel by pixel.

A far sign is few pixels and stands near the horizon; a near one shows in a copy, and what may be a
small sign elsewhere, a hint of it. So the cost grows slower than the pixels.
"""

from __future__ import annotations

import cv2
import numpy as np

from automap.records import BoolArray, FloatArray
from automap.vision import limits

Window = tuple[int, int, int, int]
"""x_min, y_min, x_max, y_max in whole pixels, the last ones outside."""


def fine_windows(height: int, window: Window, hints: FloatArray) -> list[Window]:
    """Parts of a ``window`` of a picture of this ``height`` to be searched at full size.

    A band about the middle of the picture, and what is around ``hints`` [n, 4] px outside of it.
    """
    x0, y0, x1, y1 = window
    cell = limits.FINE_CELL_PX
    rows, columns = -(-(y1 - y0) // cell), -(-(x1 - x0) // cell)
    if rows <= 0 or columns <= 0:
        return []
    top, bottom = (
        int(np.clip(round((share * height - y0) / cell), 0, rows)) for share in limits.FAR_ROWS
    )
    asked = np.zeros((rows, columns), np.uint8)
    small = (hints[:, 2:] - hints[:, :2]).max(axis=1, initial=0.0) <= limits.LARGEST_FINE_PX
    low = np.floor((hints[small, :2] - limits.FINE_MARGIN_PX - [x0, y0]) / cell).astype(int)
    high = np.ceil((hints[small, 2:] + limits.FINE_MARGIN_PX - [x0, y0]) / cell).astype(int)
    for (left, up), (right, down) in zip(np.maximum(low, 0), np.maximum(high, 0), strict=True):
        asked[up:down, left:right] = 1
    asked[top:bottom] = 0
    count, _, stats, _ = cv2.connectedComponentsWithStats(asked, connectivity=4)
    pieces = [(0, top, columns, bottom)] if bottom > top else []
    for left, up, wide, high_, _ in stats[1:count].tolist():
        pieces.append((left, up, left + wide, up + high_))
    return [
        (x0 + a * cell, y0 + b * cell, min(x0 + c * cell, x1), min(y0 + d * cell, y1))
        for a, b, c, d in pieces
    ]


def whole(boxes: FloatArray, part: Window, window: Window) -> BoolArray:
    """Which boxes [n, 4] found in a ``part`` of a ``window`` are small and not cut off by its edge,
    as a mask [n]: the copy shows all others whole."""
    size = (boxes[:, 2:] - boxes[:, :2]).max(axis=1, initial=0.0)
    kept = size <= limits.LARGEST_FINE_PX
    for k in range(2):
        if part[k] > window[k]:
            kept &= boxes[:, k] > part[k] + limits.CUT_PX
        if part[k + 2] < window[k + 2]:
            kept &= boxes[:, k + 2] < part[k + 2] - 1 - limits.CUT_PX
    return np.asarray(kept, np.bool_)
