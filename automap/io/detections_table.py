"""Boxes of signs as a Parquet table: ``detections.parquet``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from automap.io.tables import read_table, write_columns
from automap.records import TRACK_PROBABILITIES, Detections

COLUMNS = (
    "camera",
    "frame",
    "t_ns",
    "class",
    "x_min",
    "y_min",
    "x_max",
    "y_max",
    "score",
    "track",
)


WHOLE = ("frame", "t_ns", "track")
"""Of these, whole numbers."""

VIEW_CLASS = "view_class"
"""What the single view looks like; a table of an earlier version has no such column, and none of
the tracks' probabilities."""

CLASS_SHARES = "class_shares"
"""What the views of the track give to each class; likewise."""

CONTRAST, CONTRAST_NOTE = "contrast", "contrast_note"
"""Of the face in the single view, and why it could not be told; likewise."""


def write_detections(path: Path, cameras: Sequence[Detections]) -> None:
    """Write the boxes of one or more cameras as one table, atomically; none give no rows."""
    import pyarrow as pa

    boxes = np.concatenate([d.box.reshape(-1, 4) for d in cameras] or [np.zeros((0, 4))])
    names = [str(c) for d in cameras for c in d.class_name]
    views = [
        str(c) for d in cameras for c in (d.class_name if d.view_class is None else d.view_class)
    ]
    owner = [d.camera for d in cameras for _ in range(len(d))]

    def joined(arrays: list[np.ndarray], kind: type) -> np.ndarray:
        return np.concatenate(arrays).astype(kind) if arrays else np.zeros(0, kind)

    write_columns(
        path,
        {
            "camera": pa.array(owner, pa.string()),
            "frame": joined([d.frame for d in cameras], np.int64),
            "t_ns": joined([d.t_ns for d in cameras], np.int64),
            "class": pa.array(names, pa.string()),
            "x_min": boxes[:, 0],
            "y_min": boxes[:, 1],
            "x_max": boxes[:, 2],
            "y_max": boxes[:, 3],
            "score": joined([d.score for d in cameras], np.float64),
            "track": joined([d.track for d in cameras], np.int64),
            VIEW_CLASS: pa.array(views, pa.string()),
            **{
                name: joined([d.told(name) for d in cameras], np.float64)
                for name in (*TRACK_PROBABILITIES, CONTRAST)
            },
            **{
                name: pa.array(
                    [text or None for d in cameras for text in _texts(d, name)], pa.string()
                )
                for name in (CLASS_SHARES, CONTRAST_NOTE)
            },
        },
    )


def _texts(found: Detections, name: str) -> list[str]:
    values = getattr(found, name)
    return [""] * len(found) if values is None else [str(value) for value in values]


def read_detections(path: Path) -> dict[str, Detections]:
    """The boxes by camera, rows in the order of the table.

    Raises InputError when the file is missing, damaged or lacks a column.
    """
    table = read_table(path, COLUMNS, (*COLUMNS[4:9], *TRACK_PROBABILITIES, CONTRAST), WHOLE)
    columns = {name: table.column(name).to_numpy() for name in COLUMNS}
    camera = columns["camera"].astype(object)
    views = None
    if VIEW_CLASS in table.column_names:
        views = table.column(VIEW_CLASS).to_numpy().astype(object)
    told = {
        name: table.column(name).to_numpy().astype(np.float64)
        for name in (*TRACK_PROBABILITIES, CONTRAST)
        if name in table.column_names
    }
    for name in {CLASS_SHARES, CONTRAST_NOTE} & set(table.column_names):
        notes = [note or "" for note in table.column(name).to_pylist()]
        told[name] = np.array([*notes, None], object)[:-1]
    found = {}
    for name in dict.fromkeys(camera.tolist()):
        rows = camera == name
        found[str(name)] = Detections(
            frame=columns["frame"][rows].astype(np.int64),
            t_ns=columns["t_ns"][rows].astype(np.int64),
            class_name=columns["class"][rows].astype(object),
            box=np.stack([columns[c][rows] for c in COLUMNS[4:8]], axis=1).astype(np.float64),
            score=columns["score"][rows].astype(np.float64),
            track=columns["track"][rows].astype(np.int64),
            camera=str(name),
            view_class=None if views is None else views[rows],
            **{key: values[rows] for key, values in told.items()},
        )
    return found
