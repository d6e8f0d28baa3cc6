"""The detector's boxes of one drive, with the signs that they were taken for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray, IntArray


@dataclass(frozen=True)
class Boxes:
    """Detections [n] of one drive in the order of camera, frame.

    ``row`` is the row of ``observations.parquet``, ``box`` [n, 4] x_min, y_min, x_max, y_max in
    pixels, ``sign_id`` text or None, ``residual_px`` NaN where the file has none.
    """

    camera: npt.NDArray[np.object_]
    frame: IntArray
    t_ns: IntArray
    class_name: npt.NDArray[np.object_]
    box: FloatArray
    score: FloatArray
    sign_id: npt.NDArray[np.object_]
    used: npt.NDArray[np.bool_]
    residual_px: FloatArray
    row: IntArray

    def __len__(self) -> int:
        return len(self.frame)


def read_boxes(path: Path) -> Boxes:
    """Read ``observations.parquet`` or ``detections.parquet``; raises InputError or what numpy and
    pyarrow raise for a damaged one."""
    from automap.io.detections_table import COLUMNS
    from automap.io.tables import floats, ints, read_table

    table = read_table(path, COLUMNS[:9])
    n = table.num_rows
    have = set(table.column_names)
    camera = np.array(table.column("camera").to_pylist(), object)
    frame = ints(table, "frame")
    order = np.argsort(frame, kind="stable")

    def texts(name: str) -> npt.NDArray[np.object_]:
        values = table.column(name).to_pylist() if name in have else [None] * n
        array = np.empty(n, object)
        array[:] = values
        return array[order]

    residual = np.full(n, np.nan)
    if {"residual_x_px", "residual_y_px"} <= have:
        residual = np.hypot(floats(table, "residual_x_px"), floats(table, "residual_y_px"))
    used = np.ones(n, bool)
    if "used" in have:
        used = np.asarray(table.column("used").fill_null(False).to_numpy(), bool)
    return Boxes(
        camera=camera[order],
        frame=frame[order],
        t_ns=ints(table, "t_ns")[order],
        class_name=texts("class"),
        box=np.column_stack([floats(table, c) for c in COLUMNS[4:8]])[order],
        score=floats(table, "score")[order],
        sign_id=texts("sign_id"),
        used=used[order],
        residual_px=residual[order],
        row=order.astype(np.int64),
    )
