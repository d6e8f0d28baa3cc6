"""``observations.parquet``: every detection with its track, its sign and its residual."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from automap.io.atomic import atomic_path
from automap.io.detections_table import COLUMNS, WHOLE, read_detections
from automap.io.tables import read_table
from automap.records import Detections, IntArray

if TYPE_CHECKING:
    import pyarrow as pa


def read_detection_rows(path: Path) -> tuple[pa.Table, list[tuple[Detections, IntArray]]]:
    """The detections' table as it is, and its content by camera.

    For every camera, in the order of first appearance, the record and the rows [n] of the
    table that it came from. Raises InputError when the file is missing or damaged.
    """
    table = read_table(path, COLUMNS, whole=WHOLE)
    camera = np.asarray(table["camera"].to_pylist(), np.object_)
    return table, [
        (record, np.flatnonzero(camera == name).astype(np.int64))
        for name, record in read_detections(path).items()
    ]


def write_observations(
    path: Path, detections: pa.Table, results: Mapping[str, npt.NDArray[Any]]
) -> None:
    """Write the detections' table with further columns [n]; "" and NaN become null.

    A column of the same name is replaced; the detector's own ``track`` is kept as
    ``detector_track``.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = ["detector_track" if n == "track" else n for n in detections.column_names]
    table = detections.rename_columns(names)
    for name, values in results.items():
        if values.dtype == np.object_:
            column = pa.array([v or None for v in values], pa.string())
        else:
            column = pa.array(values, from_pandas=True)
        if name in table.column_names:
            table = table.set_column(table.column_names.index(name), name, column)
        else:
            table = table.append_column(name, column)
    with atomic_path(path) as temporary:
        pq.write_table(table, temporary, compression="zstd")
