"""Sightings and paths of one cell as tables, which DuckDB and geopandas read without us."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.io.atomic import atomic_path
from automap.io.tables import read_table
from automap.records import FloatArray, IntArray

if TYPE_CHECKING:
    import pyarrow as pa

_POINT = np.dtype([("order", "u1"), ("type", "<u4"), ("x", "<f8"), ("y", "<f8")])
"""A point in well-known binary, little-endian."""


def write_points(path: Path, columns: Mapping[str, Any], lat: FloatArray, lon: FloatArray) -> None:
    """Write columns [n] with points at ``lat``, ``lon`` rad as GeoParquet 1.1 (OGC:CRS84)."""
    import pyarrow as pa

    points = np.empty(len(lat), _POINT)
    points["order"], points["type"] = 1, 1
    points["x"], points["y"] = np.degrees(lon), np.degrees(lat)
    size = _POINT.itemsize
    offsets = np.arange(0, size * (len(lat) + 1), size, dtype=np.int32)
    geometry = pa.Array.from_buffers(
        pa.binary(), len(lat), [None, pa.py_buffer(offsets), pa.py_buffer(points.tobytes())]
    )
    table = pa.table({**{k: pa.array(v) for k, v in columns.items()}, "geometry": geometry})
    told = {
        "version": "1.1.0",
        "primary_column": "geometry",
        "columns": {"geometry": {"encoding": "WKB", "geometry_types": ["Point"]}},
    }
    _write(path, table.replace_schema_metadata({"geo": json.dumps(told)}))


def pack_points(path: Path, paths: Sequence[Path], later: Mapping[str, float | str]) -> None:
    """Write the rows of files, one at least, that ``write_points`` wrote into one; ``later`` as in
    ``read_points``."""
    _write(path, _joined([read_table(each) for each in paths], later))


def _write(path: Path, table: pa.Table) -> None:
    import pyarrow.parquet as pq

    with atomic_path(path) as temporary:
        pq.write_table(table, temporary, compression="zstd")


def read_points(
    paths: Sequence[Path],
    which: Callable[[pa.Table], IntArray],
    later: Mapping[str, float | str] | None = None,
) -> dict[str, Any]:
    """Columns [n] of those rows of all the files that ``which`` names, in its order, without the
    points; {} without files. Columns that came ``later``, which some files may lack, have one value
    there."""
    if not paths:
        return {}
    tables = [read_table(path).drop_columns(["geometry"]) for path in paths]
    table = _joined(tables, later or {})
    # texts as objects are dear, and a cell's margins are the smaller part of the cells beside it
    table = table.take(which(table))
    return {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}


def _joined(tables: Sequence[pa.Table], later: Mapping[str, float | str]) -> pa.Table:
    import pyarrow as pa

    whole = []
    for table in tables:
        for name, value in later.items():
            if name not in table.column_names:
                kind = pa.string() if isinstance(value, str) else pa.float64()
                table = table.append_column(name, pa.array([value] * len(table), kind))
        whole.append(table)
    # by name: a column that came later stands last where it was lacking
    return pa.concat_tables([part.select(whole[0].column_names) for part in whole])
