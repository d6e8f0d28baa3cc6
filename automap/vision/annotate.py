"""The signs that were found, drawn into their pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import Detections, FloatArray, Image
from automap.vision.contact_sheet import short_name

_LONGEST_BRIDGE_S = 1.5
"""Between two views of a track its box is drawn too, unless they are further apart."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_LETTERS = 0.45
"""Size of the letters, in that of the font."""
_COLOURS = (
    (60, 200, 60), (60, 160, 255), (255, 160, 60), (220, 80, 220), (60, 220, 220), (255, 220, 60),
)  # fmt: skip


@dataclass(frozen=True)
class Label:
    """A box to be drawn: ``sure`` if it was found in this very picture."""

    box: FloatArray
    text: str
    colour: tuple[int, int, int]
    sure: bool


def draw(image: Image, labels: Sequence[Label]) -> None:
    """Draw boxes with their names into a picture, in place; a name covers no other box."""
    margin = np.array([-2, -2, 2, 2])
    boxes = [np.rint(label.box).astype(np.int64) + margin for label in labels]
    for label, box in zip(labels, boxes, strict=True):
        x0, y0, x1, y1 = (int(v) for v in box)
        cv2.rectangle(image, (x0, y0), (x1, y1), label.colour, 2 if label.sure else 1)
        (wide, high), _ = cv2.getTextSize(label.text, _FONT, _LETTERS, 1)
        left, top = _place(image.shape[:2], (x0, y0, x1, y1), (wide + 4, high + 6), boxes)
        cv2.rectangle(image, (left, top), (left + wide + 4, top + high + 6), label.colour, -1)
        start = (left + 2, top + high + 2)
        cv2.putText(image, label.text, start, _FONT, _LETTERS, (20, 20, 20), 1, cv2.LINE_AA)


def _place(
    shape: tuple[int, ...],
    box: tuple[int, int, int, int],
    size: tuple[int, int],
    boxes: Sequence[npt.NDArray[np.int64]],
) -> tuple[int, int]:
    """The corner of a label of (width, height) above, below, right or left of its box, within
    the picture, where it covers the fewest boxes."""
    x0, y0, x1, y1 = box
    wide, high = size
    most = (max(shape[1] - wide - 1, 0), max(shape[0] - high - 1, 0))
    corners = [(x0, y0 - high - 2), (x0, y1 + 2), (x1 + 2, y0), (x0 - wide - 2, y0)]
    inside = [(min(max(x, 0), most[0]), min(max(y, 0), most[1])) for x, y in corners]

    def covered(corner: tuple[int, int]) -> int:
        left, top = corner
        return sum(
            left < b[2] and left + wide > b[0] and top < b[3] and top + high > b[1] for b in boxes
        )

    return min(inside, key=covered)


def label_for(box: FloatArray, class_name: str, score: float, track: int, sure: bool) -> Label:
    """The label of one detection."""
    number = f"{track} " if track >= 0 else ""
    text = f"{number}{short_name(class_name)} {score:.2f}"
    return Label(box, text, _COLOURS[track % len(_COLOURS)], sure)


def frame_labels(found: Detections, stamps: Mapping[int, int]) -> dict[int, list[Label]]:
    """Labels by the number of the frame, whose stamps in ns are ``stamps``.

    A track's box is drawn in the frames between its views too, thinly, at the place in between.
    """
    labels: dict[int, list[Label]] = {}
    for row in range(len(found)):
        label = label_for(
            found.box[row], str(found.class_name[row]), float(found.score[row]),
            int(found.track[row]), True,
        )  # fmt: skip
        labels.setdefault(int(found.frame[row]), []).append(label)
    for frame, label in _bridges(found, stamps):
        labels.setdefault(frame, []).append(label)
    return labels


def _bridges(found: Detections, stamps: Mapping[int, int]) -> Iterator[tuple[int, Label]]:
    """Boxes in the frames between two views of a track."""
    for track in np.unique(found.track[found.track >= 0]):
        rows = np.flatnonzero(found.track == track)
        for one, two in pairwise(rows.tolist()):
            first, last = int(found.frame[one]), int(found.frame[two])
            span = int(found.t_ns[two] - found.t_ns[one])
            if not 0 < span * 1e-9 <= _LONGEST_BRIDGE_S:
                continue
            for frame in range(first + 1, last):
                if frame in stamps:
                    part = (stamps[frame] - int(found.t_ns[one])) / span
                    box = (1.0 - part) * found.box[one] + part * found.box[two]
                    name, score = str(found.class_name[one]), float(found.score[one])
                    yield frame, label_for(box, name, score, int(track), False)
