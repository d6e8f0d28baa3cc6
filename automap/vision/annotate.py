"""The video or the pictures with the signs that were found drawn into them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from automap.io.atomic import atomic_path
from automap.io.frame_times import frame_times
from automap.io.video import VideoInput, video_chapters
from automap.io.video_decode import decode_frames
from automap.records import Detections, FloatArray, Image
from automap.vision.contact_sheet import short_name

_LONGEST_BRIDGE_S = 1.5
"""Between two views of a track its box is drawn too, unless they are further apart."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_LETTERS = 0.45
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


def annotate_video(
    video: VideoInput,
    found: Detections,
    out: Path,
    warn: Callable[[str], None] = lambda text: None,
    progress: Callable[[float, str], None] = lambda fraction, text: None,
) -> None:
    """Write the whole video with the tracks drawn in, as H.264 in the container ``out`` names.

    A track's box is drawn in the frames between its views too, thinly, at the place in between.
    Raises StageError when ``out`` cannot be written.
    """
    import av

    chapters, _ = video_chapters(video)
    times = frame_times(video, chapters)
    if not chapters or not len(times):
        return
    labels = _labels(found, dict(zip(times.frame.tolist(), times.t_ns.tolist(), strict=True)))
    # players want even sides
    width, height = chapters[0].width // 2 * 2, chapters[0].height // 2 * 2
    first_ns: int | None = None
    last_ms = -1
    with atomic_path(out) as temporary, av.open(str(temporary), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.options = {"crf": "25", "preset": "veryfast"}
        for number, picture in enumerate(decode_frames(chapters, times, None, warn)):
            image = np.ascontiguousarray(picture.image[:height, :width])
            draw(image, labels.get(picture.frame, ()))
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            first_ns = picture.t_ns if first_ns is None else first_ns
            last_ms = max(round((picture.t_ns - first_ns) * 1e-6), last_ms + 1)
            frame.pts, frame.time_base = last_ms, Fraction(1, 1000)
            for packet in stream.encode(frame):
                container.mux(packet)
            if number % 10 == 0:
                progress(number / len(times), f"drawing frame {number} of {len(times)}")
        for packet in stream.encode():
            container.mux(packet)


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


def _labels(found: Detections, stamps: Mapping[int, int]) -> dict[int, list[Label]]:
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
