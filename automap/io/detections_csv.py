"""Boxes of an external detector, ``front_detections.csv``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.io.csv_columns import Kind, read_columns
from automap.records import TRACK_PROBABILITIES, Detections, FloatArray, FrameTimes

_BOX = ("x_min", "y_min", "x_max", "y_max")
_REQUIRED: dict[str, Kind] = {
    "frame": "int",
    "class": "text",
    **dict.fromkeys(_BOX, "float"),
    "score": "float",
}
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
    wholly outside an image of ``size`` (width, height) are left out and counted. A
    file with a header alone says that nothing was detected.
    """
    table = read_columns(path, _REQUIRED, _TOLD, may_be_empty=True)
    warnings = table.warnings()
    frame = np.asarray(table.columns["frame"], dtype=np.int64)
    box = np.column_stack([table.columns[name] for name in _BOX])
    score = table.floats("score")
    t_ns, known = times.at(frame)
    finite = np.all(np.isfinite(box), axis=1)
    with np.errstate(invalid="ignore"):
        solid = finite & (box[:, 2] > box[:, 0]) & (box[:, 3] > box[:, 1])
        inside = np.ones(len(frame), dtype=bool)
        if size is not None:
            inside = (box[:, 2] > 0) & (box[:, 3] > 0)
            inside &= (box[:, 0] < size[0]) & (box[:, 1] < size[1])
        rated = (score >= 0) & (score <= 1)
    good = np.ones(len(frame), dtype=bool)
    for mask, what in (
        (known, "in frames without a stamp"),
        (solid, "with a box that has no area (x_min < x_max, y_min < y_max is needed)"),
        (inside, "outside the image; check width and height in the manifest"),
        (rated, "with a score that is not within 0 and 1"),
    ):
        lost = np.flatnonzero(good & ~mask)
        good &= mask
        if len(lost):
            warnings.append(
                f"{path}: {len(lost)} detections left out {what}, the first in line "
                f"{table.line(int(lost[0]))}"
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


def _share(values: FloatArray) -> FloatArray:
    """Probabilities [n]; NaN what is none."""
    with np.errstate(invalid="ignore"):
        return np.where((values >= 0.0) & (values <= 1.0), values, np.nan)
