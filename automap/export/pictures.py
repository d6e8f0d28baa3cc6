"""Pictures of the signs: which views to show, the sign cut out of the frame, and the street.

A sign's picture shows nothing beyond its own box and a narrow rim; one of the street around it
has nothing else sharp, so that faces and number plates stay out of the map.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.effects.lens import cut_off
from automap.records import FloatArray, Image

if TYPE_CHECKING:
    import pyarrow as pa


VIEWS = 3
"""Pictures a sign: the largest, and ones from about two and four times as far."""

_LARGEST_PX = 128
_SMALLEST_PX = 48
_QUALITY = 80
_CONTEXT_PX = 480
"""Width of a picture of the street: it shows on which post, and more is not sharp anyway."""

_COLUMNS = ("camera", "frame", "t_ns", "x_min", "y_min", "x_max", "y_max", "score", "sign_id")


@dataclass(frozen=True)
class SignView:
    """One view of a sign that is worth a picture: ``rank`` 1 is the nearest."""

    sign_id: str
    rank: int
    camera: str
    frame: int
    t_ns: int
    box: FloatArray
    score: float
    range_m: float

    @property
    def file(self) -> str:
        """Name of the picture's file; whatever the sign is called, it stays in its folder."""
        return f"{safe_name(self.sign_id)}-{self.rank}.jpg"

    @property
    def context_file(self) -> str:
        """Name of the file with the street around the sign."""
        return f"{safe_name(self.sign_id)}-context.jpg"


def safe_name(sign_id: str) -> str:
    """A sign's id as part of a file name; ids with other than plain characters by digest."""
    if re.fullmatch(r"[A-Za-z0-9_-]{1,64}", sign_id):
        return sign_id
    return "sign_" + hashlib.sha256(sign_id.encode("utf-8", "replace")).hexdigest()[:16]


def choose_views(
    observations: pa.Table,
    sign_ids: Sequence[str],
    sizes: Mapping[str, tuple[float, float]] | None = None,
) -> list[SignView]:
    """Views of the signs of these ids, ordered by camera and frame.

    The first of a sign is its largest box, the others are near a half and a quarter of that
    size. Detections that the position does not rest on, or without a sensible box, are left out,
    and where a sign has others those that the edge of the picture cuts off: ``sizes`` are width
    and height of each camera's.
    """
    if any(name not in observations.column_names for name in _COLUMNS):
        return []
    columns = {name: observations.column(name).to_pylist() for name in _COLUMNS}
    ranges = _floats(observations, "range_m")
    used = (
        np.asarray(observations.column("used").to_numpy(), bool)
        if "used" in observations.column_names
        else np.ones(observations.num_rows, bool)
    )
    boxes = np.column_stack([_floats(observations, name) for name in _COLUMNS[3:7]])
    size = np.sqrt(
        np.maximum(boxes[:, 2] - boxes[:, 0], 0) * np.maximum(boxes[:, 3] - boxes[:, 1], 0)
    )
    wanted = set(sign_ids)
    rows_of: dict[str, list[int]] = {}
    for row, sign_id in enumerate(columns["sign_id"]):
        if sign_id in wanted and used[row] and size[row] > 1.0:
            rows_of.setdefault(sign_id, []).append(row)
    views = []
    side = np.array([(sizes or {}).get(str(c), (np.inf, np.inf)) for c in columns["camera"]])
    whole = ~cut_off(boxes, side.reshape(-1, 2))
    for sign_id, rows in rows_of.items():
        rows = [row for row in rows if whole[row]] or rows
        for rank, row in enumerate(_spread(size, rows), start=1):
            score = columns["score"][row]
            views.append(
                SignView(
                    sign_id,
                    rank,
                    str(columns["camera"][row]),
                    int(columns["frame"][row]),
                    int(columns["t_ns"][row]),
                    boxes[row],
                    float("nan") if score is None else float(score),
                    float(ranges[row]),
                )
            )
    return sorted(views, key=lambda view: (view.camera, view.frame, view.sign_id, view.rank))


def _spread(size: FloatArray, rows: list[int]) -> list[int]:
    """The largest of the rows and ones of about a half and a quarter of its size."""
    chosen = [max(rows, key=lambda row: size[row])]
    for rank in range(1, VIEWS):
        target = size[chosen[0]] * 0.5**rank
        left = [row for row in rows if row not in chosen]
        if not left:
            break
        best = min(left, key=lambda row: abs(np.log(size[row] / target)))
        # a picture from the same distance tells nothing new
        if size[best] > 0.85 * size[chosen[-1]]:
            break
        chosen.append(best)
    return chosen


def _floats(table: pa.Table, name: str) -> FloatArray:
    if name not in table.column_names:
        return np.full(table.num_rows, np.nan)
    return np.asarray(table.column(name).to_numpy(), np.float64)


def sign_picture(image: Image, box: FloatArray) -> bytes | None:
    """The box [4] of a BGR frame with a narrow rim, as JPEG of 48 to 128 px; None if it is no
    sensible part of the frame."""
    import cv2

    from automap.vision.privacy import rimmed

    if not _is_sensible(image, box):
        return None
    left, top, right, bottom = rimmed(box, image.shape[1], image.shape[0])
    part: Any = np.ascontiguousarray(image[top:bottom, left:right])
    largest = max(part.shape[:2])
    scale = float(np.clip(largest, _SMALLEST_PX, _LARGEST_PX)) / largest
    if scale != 1.0:
        way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
        size = (max(round(part.shape[1] * scale), 1), max(round(part.shape[0] * scale), 1))
        part = cv2.resize(part, size, interpolation=way)
    return _jpeg(part)


def context_picture(
    image: Image, box: FloatArray, focal_px: float | None = None, hide: bool = True
) -> bytes | None:
    """The whole BGR frame as JPEG of at most 480 px in width, with nothing recognisable but the
    box [4]; ``hide`` False leaves all as it is. ``focal_px`` is the camera's, if known. None where
    the box is no sensible part of the frame."""
    import cv2

    from automap.vision.privacy import street_hidden

    if not _is_sensible(image, box):
        return None
    height, width = image.shape[:2]
    shown = street_hidden(image, [box], focal_px) if hide else image
    if width > _CONTEXT_PX:
        size = (_CONTEXT_PX, max(round(height * _CONTEXT_PX / width), 1))
        shown = np.asarray(cv2.resize(shown, size, interpolation=cv2.INTER_AREA), np.uint8)
    return _jpeg(shown)


def _is_sensible(image: Image, box: FloatArray) -> bool:
    """Whether a box [4] may be a sign in this frame."""
    from automap.vision.privacy import is_mistake, rimmed

    height, width = image.shape[:2]
    if not min(box[2] - box[0], box[3] - box[1]) >= 1.0:
        return False
    left, top, right, bottom = rimmed(box, width, height)
    return min(right - left, bottom - top) >= 2 and not is_mistake(box, width, height)


def _jpeg(image: Image) -> bytes | None:
    import cv2

    good, data = cv2.imencode(
        ".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    )
    return bytes(data.tobytes()) if good else None
