"""Boxes of an external detector, ``front_detections.csv``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.csv_columns import Kind, read_columns
from automap.records import (
    TRACK_PROBABILITIES,
    BoolArray,
    Detections,
    FloatArray,
    FrameTimes,
    IntArray,
)

_BOX = ("x_min", "y_min", "x_max", "y_max")
_REQUIRED: dict[str, Kind] = {
    "frame": "float",
    "class": "text",
    **dict.fromkeys(_BOX, "float"),
    "score": "float",
}
_SAME = 1.0 / 3.0
"""IoU from which boxes of one frame are of one thing: the same box half its width aside, where
neither's middle lies in the other. Signs hide one another, and those beside one another touch."""
_FRAMES = "frames count from 0 over all chapters, and are no times"
_SIZE = "boxes are in pixels of the manifest's width and height"
_MOST = 0.5
"""Share of the rows that may be unusable: with more the file is not what it is read as."""
_MOST_OUTSIDE = 0.2
"""The same of boxes wholly outside the picture. Chosen: a tracker that predicts goes on beyond the
edge for some frames of each track, and of boxes of a picture twice as large a third is there."""
_TOLD: dict[str, Kind] = {"track": "int", **dict.fromkeys(TRACK_PROBABILITIES, "float")}


@dataclass(frozen=True)
class DetectionFile:
    """Usable detections, in the order of frames, and what was left out, in sentences."""

    data: Detections
    warnings: tuple[str, ...]


def read_detections_csv(
    path: Path,
    times: FrameTimes,
    camera: str = "front",
    size: tuple[int, int] | None = None,
) -> DetectionFile:
    """Read ``frame, class, x_min, y_min, x_max, y_max, score`` and, where there are such columns,
    ``track``, ``class_probability`` and ``group_probability``.

    ``times`` gives the stamp of each frame; boxes in frames without a stamp, without area, or
    wholly outside an image of ``size`` (width, height) are left out and counted, and so
    are those that a better one of their frame covers. A file with a header alone says that
    nothing was detected. Raises InputError where the columns cannot mean what their names say.
    """
    table = read_columns(path, _REQUIRED, _TOLD, may_be_empty=True)
    warnings = table.warnings()
    number = table.floats("frame")
    box = np.column_stack([table.columns[name] for name in _BOX])
    score = table.floats("score")
    with np.errstate(invalid="ignore"):
        whole = (np.abs(number) < 2.0**53) & (number == np.round(number))
        frame = np.where(whole, number, -1.0).astype(np.int64)
        t_ns, known = times.at(frame)
        solid = np.all(np.isfinite(box), axis=1) & np.all(box[:, 2:] > box[:, :2], axis=1)
        inside = np.ones(len(frame), dtype=bool)
        if size is not None:
            inside = np.all((box[:, 2:] > 0) & (box[:, :2] < size), axis=1)
        rated = (score >= 0) & (score <= 1)
    if solid.any() and (box[solid, 2:] - box[solid, :2]).max() <= 1.0:
        raise InputError(
            f"{path}: no box is wider or higher than a pixel, so they are shares of the picture; "
            "multiply them by its width and height."
        )
    good = np.ones(len(frame), dtype=bool)
    for mask, what, remedy, most in (
        (whole, "whose frame is no whole number", _FRAMES, _MOST),
        (known, "in frames without a stamp", _FRAMES, _MOST),
        (
            solid,
            "with a box that has no area (x_min < x_max, y_min < y_max is needed)",
            "x_max and y_max are corners; to widths and heights add x_min and y_min",
            _MOST,
        ),
        (inside, "outside the image; check width and height in the manifest", _SIZE, _MOST_OUTSIDE),
        (rated, "with a score that is not within 0 and 1", "divide percents by 100", _MOST),
    ):
        lost = np.flatnonzero(good & ~mask)
        good &= mask
        if not len(lost):
            continue
        first = f"the first in line {table.line(int(lost[0]))}"
        if len(lost) > max(most * len(frame), 1):
            raise InputError(
                f"{path}: {len(lost)} of {len(frame)} detections {what}, {first}: {remedy}."
            )
        warnings.append(f"{path}: {len(lost)} detections left out {what}, {first}")
    good[good] = once = _once(frame[good], box[good], score[good])
    if not once.all():
        warnings.append(
            f"{path}: {np.count_nonzero(~once)} detections left out that a better one of their "
            "frame covers; a detector gives each thing once (non-maximum suppression)"
        )
    rows = np.flatnonzero(good)
    rows = rows[np.argsort(frame[rows], kind="stable")]
    track = table.columns.get("track", np.full(len(frame), -1, dtype=np.int64))
    return DetectionFile(
        data=Detections(
            frame=frame[rows],
            t_ns=t_ns[rows],
            class_name=np.asarray(table.columns["class"][rows], dtype=object),
            box=np.ascontiguousarray(box[rows]),
            score=score[rows],
            track=np.asarray(track[rows], dtype=np.int64),
            camera=camera,
            class_probability=_share(table.floats("class_probability")[rows]),
            group_probability=_share(table.floats("group_probability")[rows]),
        ),
        warnings=tuple(warnings),
    )


def _once(frame: IntArray, box: FloatArray, score: FloatArray) -> BoolArray:
    """Which boxes [n] no better one of their frame covers; of equals the first stays."""
    order = np.lexsort((-score, frame))
    frame, box = frame[order], box[order]
    # of a damaged box it may be infinite
    with np.errstate(over="ignore"):
        area = np.prod(box[:, 2:] - box[:, :2], axis=1)
    once = np.ones(len(frame), dtype=bool)
    for step in range(1, len(frame)):
        better = np.flatnonzero(frame[step:] == frame[:-step])
        if not len(better):
            break
        worse = better + step
        low = np.maximum(box[better, :2], box[worse, :2])
        high = np.minimum(box[better, 2:], box[worse, 2:])
        shared = np.prod((high - low).clip(min=0.0), axis=1)
        once[worse[shared > _SAME * (area[better] + area[worse] - shared)]] = False
    once[order] = once.copy()
    return once


def _share(values: FloatArray) -> FloatArray:
    """Probabilities [n]; NaN what is none."""
    with np.errstate(invalid="ignore"):
        return np.where((values >= 0.0) & (values <= 1.0), values, np.nan)
