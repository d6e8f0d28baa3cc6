"""The best picture of each track, as a small JPEG, in which only the sign is sharp."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from automap.effects.lens import cut_off
from automap.records import Crop, FloatArray, Image
from automap.vision import limits
from automap.vision.privacy import hide_street, is_mistake, reduction

_SURROUND = 0.35
"""What is shown around a box, in parts of its longer side."""
_SMALLEST_PX, _LARGEST_PX, _QUALITY = 64, 160, 85
"""Of the pictures kept: sides in px, and that of JPEG."""


class BestCrops:
    """Keeps one crop a track while a video is searched: a few kilobytes for each sign."""

    def __init__(self, camera: str, focal_px: float | None = None) -> None:
        self._camera, self._focal_px = camera, focal_px
        self._best: dict[int, Crop] = {}

    def offer(
        self,
        image: Image,
        frame: int,
        t_ns: int,
        track: int,
        class_name: str,
        box: FloatArray,
        score: float,
    ) -> None:
        """Take this view of a track if it is better than the best so far."""
        height, width = image.shape[:2]
        sides = box[2:] - box[:2]
        cut = bool(cut_off(box[None], np.array([width, height], np.float64))[0])
        worth = float(
            score * np.sqrt(max(float(sides.min()), 1.0)) * (limits.CUT_WORTH if cut else 1.0)
        )
        known = self._best.get(track)
        if known is not None and worth < limits.BETTER_VIEW * known.worth:
            return
        picture, inside = cut_out(image, box, self._reduction(width))
        coded, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        if coded:
            self._best[track] = Crop(
                self._camera, track, frame, t_ns, class_name, score,
                np.asarray(box, np.float64), inside, data.tobytes(), worth,
            )  # fmt: skip

    def _reduction(self, width: int) -> float:
        """Of a frame of this width, whatever its focal length was taken for."""
        return max(reduction(width), reduction(width, self._focal_px))

    def crops(self, class_of: dict[int, str]) -> list[Crop]:
        """The crops in the order of the tracks, named after the tracks' classes."""
        return [
            replace(crop, class_name=class_of.get(track, crop.class_name))
            for track, crop in sorted(self._best.items())
        ]


def cut_out(image: Image, box: FloatArray, factor: float = 1.0) -> tuple[Image, FloatArray]:
    """A box with its surround, scaled to 64 to 160 px, and the box in that picture.

    ``factor`` pixels are made one around the box, as ``privacy`` has it; all of a box that is no
    sign but shows the street.
    """
    height, width = image.shape[:2]
    x0, y0, x1, y1 = (float(v) for v in box)
    half = max((0.5 + _SURROUND) * max(x1 - x0, y1 - y0), 4.0)
    middle_x, middle_y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    left, top = max(int(middle_x - half), 0), max(int(middle_y - half), 0)
    right = min(int(np.ceil(middle_x + half)) + 1, width)
    bottom = min(int(np.ceil(middle_y + half)) + 1, height)
    left, top = min(left, width - 1), min(top, height - 1)
    part = image[top : max(bottom, top + 1), left : max(right, left + 1)]
    if factor > 1.0:
        own = np.array([x0 - left, y0 - top, x1 - left, y1 - top])
        sharp = own[:0] if is_mistake(box, width, height) else own
        part = hide_street(np.ascontiguousarray(part), sharp, factor)
    largest = max(part.shape[:2])
    scale = float(np.clip(largest, _SMALLEST_PX, _LARGEST_PX)) / largest
    size = (max(round(part.shape[1] * scale), 1), max(round(part.shape[0] * scale), 1))
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    shown = cv2.resize(np.ascontiguousarray(part), size, interpolation=way)
    inside = (np.array([x0 - left, y0 - top, x1 - left, y1 - top]) + 0.5) * scale - 0.5
    return np.asarray(shown, np.uint8), inside
