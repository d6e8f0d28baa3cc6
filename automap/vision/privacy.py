"""Pictures of streets in which nobody can be recognised and no number plate be read.

Everything but the signs is reduced to a resolution at which faces and letters are gone. That holds
for each face and each plate alike; a detector of faces leaves those that it overlooks.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from automap.records import FloatArray, Image

LEGIBLE_PX_PER_M = 20.0
"""Finest resolution that is left: one pixel is 5 cm, a face 3 px wide. EN 62676-4 (video
surveillance, application guidelines) wants 25 px/m to tell that a person is there, 125 to recognise
somebody known. Letters of a plate, 75 mm high, are 1.5 px then: a reader that knows their shapes,
places, contrast and where the pixels lie gets 20 of 100 letters right and no whole plate, at 25
px/m 31 of 100, at 40 px/m half of all plates (``tests/benchmarks/plate_legibility.py``)."""
NEAREST_M = 3.0
"""What is nearer to the lens than that, the vehicle's own bonnet leaves no room for."""
NARROWEST_DEG = 40.0
"""Horizontal view of a camera of which nothing is known: those of dash cameras are wider."""
RIM, RIM_PX = 0.06, 1.0
"""What stays sharp around a sign's box, in parts of its longer side, and at least."""
GREATEST_SHARE = 0.15
"""Share of the frame beyond which a box is no sign but a mistake that shows the street."""


def reduction(width: int, focal_px: float | None = None) -> float:
    """How many pixels of a frame become one: for a frame ``width`` px wide, of a camera with this
    focal length in px where that is known."""
    if focal_px is None or not focal_px > 0.0:
        focal_px = 0.5 * width / np.tan(np.radians(0.5 * NARROWEST_DEG))
    return max(float(focal_px) / (LEGIBLE_PX_PER_M * NEAREST_M), 1.0)


def hide_street(image: Image, boxes: FloatArray, factor: float) -> Image:
    """A BGR picture or a part of one, each ``factor`` pixels made one, but for the boxes [k, 4]."""
    height, width = image.shape[:2]
    cells = (max(round(width / factor), 1), max(round(height / factor), 1))
    small = cv2.resize(image, cells, interpolation=cv2.INTER_AREA)
    hidden = np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)
    for box in np.asarray(boxes, np.float64).reshape(-1, 4):
        left, top, right, bottom = rimmed(box, width, height)
        hidden[top:bottom, left:right] = image[top:bottom, left:right]
    return hidden


def street_hidden(
    image: Image, boxes: Sequence[FloatArray], focal_px: float | None = None
) -> Image:
    """A whole BGR frame with nothing recognisable but the boxes [4] that may be signs."""
    height, width = image.shape[:2]
    sharp = [b for b in boxes if np.isfinite(b).all() and not is_mistake(b, width, height)]
    return hide_street(image, np.array(sharp).reshape(-1, 4), reduction(width, focal_px))


def rimmed(box: FloatArray, width: int, height: int) -> tuple[int, int, int, int]:
    """Columns and rows (left, top, right, bottom) of a box [4] with its rim, within the picture."""
    x0, y0, x1, y1 = (float(value) for value in box)
    rim = max(RIM * max(x1 - x0, y1 - y0), RIM_PX)
    left, top = max(int(np.floor(x0 - rim + 0.5)), 0), max(int(np.floor(y0 - rim + 0.5)), 0)
    right = min(int(np.ceil(x1 + rim + 0.5)), width)
    bottom = min(int(np.ceil(y1 + rim + 0.5)), height)
    return left, top, max(right, left), max(bottom, top)


def is_mistake(box: FloatArray, width: int, height: int) -> bool:
    """Whether a box [4] covers so much of a frame that it shows the street and no sign."""
    left, top, right, bottom = rimmed(box, width, height)
    return (right - left) * (bottom - top) > GREATEST_SHARE * width * height
