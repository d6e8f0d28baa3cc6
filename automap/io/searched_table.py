"""Which frames a detector searched: ``searched.parquet``, one row a frame, with the part it saw."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from automap.io.tables import read_table, write_columns
from automap.records import Detections, Looked

_REGION = ("x_min", "y_min", "x_max", "y_max")


def write_searched(path: Path, cameras: Sequence[Detections]) -> None:
    """Write what each camera's boxes were looked for in; cameras of which that is not known have
    no rows."""
    import pyarrow as pa

    known = [(d.camera, d.looked) for d in cameras if d.looked is not None]
    region = np.concatenate([looked.region for _, looked in known] or [np.zeros((0, 4))])
    frame = np.concatenate([looked.frame for _, looked in known] or [np.zeros(0, np.int64)])
    owner = [camera for camera, looked in known for _ in range(len(looked))]
    columns = {"camera": pa.array(owner, pa.string()), "frame": frame.astype(np.int64)}
    write_columns(path, columns | {name: region[:, k] for k, name in enumerate(_REGION)})


def read_searched(path: Path) -> dict[str, Looked]:
    """The frames by camera; InputError when the file is missing, damaged or lacks a column."""
    table = read_table(path, ("camera", "frame", *_REGION), _REGION, ("frame",))
    camera = np.array([*table.column("camera").to_pylist(), None], object)[:-1]
    frame = table.column("frame").to_numpy().astype(np.int64)
    region = np.column_stack([table.column(n).to_numpy().astype(np.float64) for n in _REGION])
    return {
        str(name): Looked(frame[camera == name], region[camera == name])
        for name in dict.fromkeys(camera.tolist())
    }
