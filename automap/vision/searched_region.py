"""Which part of a frame is searched, and what a detector finds in it."""

from __future__ import annotations

import numpy as np

from automap.records import FloatArray, Image, IntArray
from automap.vision import limits
from automap.vision.detector import Detector, FoundSigns, RegionDetector
from automap.vision.parallel import Beside


def searched_region(image: Image, height_share: float, beside: Beside, hint: float) -> FloatArray:
    """x_min, y_min, x_max, y_max [4] of the upper part of a picture, ``height_share`` of it, or of
    that near the signs of at least the score ``hint`` in the frames ``beside`` it."""
    height, width = image.shape[:2]
    lowest = height
    if height_share < 1.0:
        # networks work on multiples of 32 rows
        lowest = max(int(height * height_share) // 32 * 32, min(32, height))
    low, high = np.zeros(2, np.int64), np.array([width, lowest])
    if beside is not None:
        boxes = np.concatenate([found.box[found.score >= hint] for found in beside])
        # as far as a sign moves, and what a network wants to see around it
        margin = limits.AROUND_PX + np.max(boxes[:, 2:] - boxes[:, :2], initial=0.0)
        margin += limits.MOVED_SHARE * width
        low = np.maximum(np.floor(boxes[:, :2].min(axis=0) - margin), 0).astype(np.int64)
        high = np.minimum(np.ceil(boxes[:, 2:].max(axis=0) + margin), high).astype(np.int64)
        low = np.minimum(low, high - 1)
    return np.concatenate([low, high]).astype(np.float64)


def find_in(detector: Detector, image: Image, region: FloatArray) -> FoundSigns:
    """The signs in a region [4] of a picture, in its pixels, without those that its edge cuts."""
    height, width = image.shape[:2]
    low, high = np.split(region.astype(np.int64), 2)
    if isinstance(detector, RegionDetector):
        left, top, right, bottom = region.tolist()
        found = detector.detect_in(image, (left, top, right, bottom))
        box = found.box
    else:
        found = detector.detect(image[low[1] : high[1], low[0] : high[0]])
        box = found.box + np.tile(low, 2)
    # what is cut off inside the picture has a box that is too small
    cut = ((box[:, :2] < low + limits.CUT_PX) & (low > 0)).any(axis=1)
    cut |= ((box[:, 2:] > high - 1 - limits.CUT_PX) & (high < (width, height))).any(axis=1)
    return some(
        FoundSigns(found.class_name, box, found.score, found.alternatives), np.flatnonzero(~cut)
    )


def some(found: FoundSigns, keep: IntArray) -> FoundSigns:
    """Those of the signs that ``keep`` [k] numbers."""
    if len(keep) == len(found):
        return found
    return FoundSigns(
        tuple(found.class_name[i] for i in keep),
        found.box[keep],
        found.score[keep],
        None if found.alternatives is None else tuple(found.alternatives[i] for i in keep),
    )
