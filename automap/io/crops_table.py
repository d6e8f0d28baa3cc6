"""The best picture of each track: ``crops.parquet``, and as files for people.

One row per track: camera, track, frame, t_ns, class, score, the box in the frame and in the
picture, and the picture itself as JPEG bytes, some kilobytes each.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from automap.io.atomic import atomic_path
from automap.io.tables import read_table
from automap.records import Crop

_BOX = ("x_min", "y_min", "x_max", "y_max")
_IN_CROP = tuple(f"crop_{name}" for name in _BOX)
COLUMNS = ("camera", "track", "frame", "t_ns", "class", "score", *_BOX, *_IN_CROP, "worth", "jpeg")


def write_crops(path: Path, crops: Sequence[Crop]) -> None:
    """Write the crops as one table, atomically."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    box = np.array([crop.box for crop in crops], np.float64).reshape(-1, 4)
    inside = np.array([crop.box_in_crop for crop in crops], np.float64).reshape(-1, 4)
    columns = {
        "camera": pa.array([crop.camera for crop in crops], pa.string()),
        "track": pa.array([crop.track for crop in crops], pa.int64()),
        "frame": pa.array([crop.frame for crop in crops], pa.int64()),
        "t_ns": pa.array([crop.t_ns for crop in crops], pa.int64()),
        "class": pa.array([crop.class_name for crop in crops], pa.string()),
        "score": pa.array([crop.score for crop in crops], pa.float64()),
        **{name: pa.array(box[:, i]) for i, name in enumerate(_BOX)},
        **{name: pa.array(inside[:, i]) for i, name in enumerate(_IN_CROP)},
        "worth": pa.array([crop.worth for crop in crops], pa.float64()),
        "jpeg": pa.array([crop.jpeg for crop in crops], pa.binary()),
    }
    with atomic_path(path) as temporary:
        # JPEG does not get any smaller
        pq.write_table(pa.table(columns), temporary, compression="none", use_dictionary=False)


def read_crops(path: Path) -> list[Crop]:
    """Read what ``write_crops`` wrote; InputError when it is missing or damaged."""
    return [
        Crop(
            camera=row["camera"],
            track=row["track"],
            frame=row["frame"],
            t_ns=row["t_ns"],
            class_name=row["class"],
            score=row["score"],
            box=np.array([row[name] for name in _BOX]),
            box_in_crop=np.array([row[name] for name in _IN_CROP]),
            jpeg=row["jpeg"],
            worth=row["worth"],
        )
        for row in read_table(path, COLUMNS).to_pylist()
    ]
