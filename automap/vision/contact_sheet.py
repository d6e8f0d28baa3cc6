"""One picture of all signs that were found."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from automap.records import Crop, Image

_CELL, _CAPTION, _COLUMNS, _MOST = 144, 34, 8, 400
"""Of the sheet: px, px, cells in a row, and cells in all."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def contact_sheet(crops: Sequence[Crop]) -> bytes:
    """A JPEG with the crop of each track, its number, class and score.

    With more than 400 tracks the 400 best are shown and the heading says so. None give an
    empty sheet with a heading.
    """
    shown = sorted(crops, key=lambda crop: -crop.worth)[:_MOST]
    shown.sort(key=lambda crop: (crop.camera, crop.track))
    columns = max(min(_COLUMNS, len(shown)), 4)
    rows = -(-len(shown) // columns)
    heading = f"{len(crops)} signs"
    if len(shown) < len(crops):
        heading = f"the {len(shown)} best of {heading}"
    sheet = np.full((_CAPTION + rows * (_CELL + _CAPTION), columns * _CELL, 3), 245, np.uint8)
    _text(sheet, heading, 6, 22, 0.55)
    for number, crop in enumerate(shown):
        left = number % columns * _CELL
        top = _CAPTION + number // columns * (_CELL + _CAPTION)
        _paste(sheet, crop, left, top)
        _text(
            sheet, f"{crop.track}  {crop.score:.2f}  frame {crop.frame}", left + 4, top + _CELL + 12
        )
        _text(sheet, short_name(crop.class_name), left + 4, top + _CELL + 27)
    coded, data = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, 85])
    if not coded:
        raise ValueError(f"a sheet of {sheet.shape} cannot be coded")
    return data.tobytes()


def short_name(class_name: str) -> str:
    """A class name without its family and variant, in at most 22 letters."""
    parts = class_name.split("--")
    name = parts[1] if len(parts) > 1 else class_name
    return name if len(name) <= 22 else name[:21] + "~"


def _paste(sheet: Image, crop: Crop, left: int, top: int) -> None:
    picture = cv2.imdecode(np.frombuffer(crop.jpeg, np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        return
    scale = (_CELL - 8) / max(picture.shape[:2])
    size = (max(int(picture.shape[1] * scale), 1), max(int(picture.shape[0] * scale), 1))
    picture = cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)
    x = left + (_CELL - size[0]) // 2
    y = top + (_CELL - size[1]) // 2
    sheet[y : y + size[1], x : x + size[0]] = picture
    box = np.rint((crop.box_in_crop + 0.5) * scale - 0.5).astype(int)
    low, high = (x + int(box[0]), y + int(box[1])), (x + int(box[2]), y + int(box[3]))
    cv2.rectangle(sheet, low, high, (60, 200, 60), 1)


def _text(sheet: Image, text: str, x: int, y: int, scale: float = 0.36) -> None:
    cv2.putText(sheet, text, (x, y), _FONT, scale, (40, 40, 40), 1, cv2.LINE_AA)
