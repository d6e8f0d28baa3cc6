"""``signs.parquet``: signs as GeoParquet 1.1, WGS-84 with ellipsoidal heights unless asked else."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from automap.export.fields import STAMP_FIELDS
from automap.export.geojson import longitude_range
from automap.export.layers import point_wkb, times_of_texts
from automap.export.projected import Plane, projected_wkb
from automap.export.sign_columns import SignColumns, Signs
from automap.export.storable import utf8_texts
from automap.io.atomic import atomic_path
from automap.io.tables import write_row_groups
from automap.records import FloatArray

ROW_GROUP = 65_536
"""Signs a row group: readers skip whole groups by their bounding box."""


def write_geoparquet(
    path: Path,
    signs: Signs,
    lineage: Mapping[str, Any] | None = None,
    crs: str | None = None,
    epoch: float | None = None,
    plane: Plane | None = None,
) -> None:
    """Write signs as GeoParquet 1.1: WKB points, a bbox column as covering, field meanings.

    The coordinate system is OGC:CRS84h, WGS-84 longitude, latitude and ellipsoidal height, or
    ``crs``, in which the columns' coordinates then are, or to which ``plane`` projects them.
    ``epoch`` is the year, with decimals, at
    which the coordinates hold. ``lineage`` stands under the key ``automap``.
    """
    places: tuple[FloatArray, ...] = signs.lon_deg, signs.lat_deg, signs.height_m
    if plane is not None:
        places = plane.points(*places)
    metadata = {"geo": json.dumps(_geo_metadata(signs, places, crs or "OGC:CRS84h", epoch))}
    if lineage:
        metadata["automap"] = json.dumps(lineage, default=str)
    tables = (_geo_table(part, plane).replace_schema_metadata(metadata) for part in signs.parts())
    with atomic_path(path) as temporary:
        write_row_groups(temporary, tables, ROW_GROUP, compression="zstd")


def _geo_table(columns: SignColumns, plane: Plane | None) -> Any:
    """The rows of some signs, with what each column means."""
    import pyarrow as pa

    arrays: list[Any] = []
    fields: list[Any] = []
    kinds = {"text": pa.string(), "integer": pa.int64(), "real": pa.float64()}
    kinds |= {"time": pa.timestamp("ms", tz="UTC"), "list": pa.list_(pa.string())}
    for field in (*columns.fields, *STAMP_FIELDS):
        values = columns.values[field.name]
        if field.kind == "time":
            values = times_of_texts(values if columns.utc_known else [None] * len(columns))
        elif field.kind == "text":
            values = utf8_texts(values)
        elif field.kind == "list":
            values = [utf8_texts(value) for value in values]
        arrays.append(pa.array(values, kinds[field.kind], from_pandas=True))
        note = {"unit": field.unit, "description": field.meaning}
        fields.append(pa.field(field.name, kinds[field.kind], metadata=note))
    points = point_wkb(columns)
    places: tuple[FloatArray, ...] = columns.lon_deg, columns.lat_deg, columns.height_m
    if plane is not None:
        points, places = projected_wkb(points, plane), plane.points(*places)
    box = _box_column(columns, places)
    arrays += [box, pa.array(points, pa.binary())]
    fields += [pa.field("bbox", box.type), pa.field("geometry", pa.binary())]
    return pa.table(arrays, schema=pa.schema(fields))


def _box_column(columns: SignColumns, places: Sequence[FloatArray]) -> Any:
    import pyarrow as pa

    hidden = ~columns.located
    x, y = (pa.array(values, mask=hidden) for values in places[:2])
    return pa.StructArray.from_arrays([x, y, x, y], ["xmin", "ymin", "xmax", "ymax"])


def _geo_metadata(
    columns: Signs, places: Sequence[FloatArray], crs: str, epoch: float | None
) -> dict[str, Any]:
    from pyproj import CRS

    system = CRS.from_user_input(crs)
    located = columns.located
    high = located & np.isfinite(columns.height_m)
    types = [
        name for name, present in (("Point", located & ~high), ("Point Z", high)) if present.any()
    ]
    geometry: dict[str, Any] = {
        "encoding": "WKB",
        "geometry_types": types,
        "crs": system.to_json_dict(),
        "covering": {
            "bbox": {name: ["bbox", name] for name in ("xmin", "ymin", "xmax", "ymax")},
        },
    }
    if epoch is not None:
        geometry["epoch"] = round(epoch, 3)
    if located.any():
        x, y, height = (values[located] for values in places)
        west, east = float(x.min()), float(x.max())
        if system.is_geographic:
            west, east = longitude_range(x)
        low, top = [west, float(y.min())], [east, float(y.max())]
        if high.sum() == located.sum():
            low.append(float(height.min()))
            top.append(float(height.max()))
        geometry["bbox"] = low + top
    return {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": geometry}}
