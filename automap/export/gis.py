"""``map.gpkg``, ``signs.parquet`` and other formats of geographic information systems.

All in WGS-84 with ellipsoidal heights. Every file appears whole or not at all.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import StageError
from automap.export.fields import SIGN_FIELDS, STAMP_FIELDS
from automap.export.layers import Layer, point_wkb, times_of_texts
from automap.export.sign_columns import SignColumns
from automap.io.atomic import atomic_path

WGS84_3D = "EPSG:4979"


def write_layers(path: Path, layers: Sequence[Layer], driver: str = "GPKG") -> None:
    """Write layers into one file with GDAL (a FlatGeobuf file holds one layer only).

    Raises StageError when GDAL cannot write the file.
    """
    from pyogrio.errors import DataLayerError, DataSourceError
    from pyogrio.raw import write

    with atomic_path(path) as temporary:
        for number, layer in enumerate(layers):
            # a FlatGeobuf file with an index cannot hold features without a position
            unindexed = driver == "FlatGeobuf" and any(wkb is None for wkb in layer.wkb)
            masks = [layer.missing.get(name) for name in layer.columns]
            try:
                write(
                    temporary,
                    geometry=layer.wkb,
                    field_data=list(layer.columns.values()),
                    fields=list(layer.columns),
                    field_mask=masks,
                    layer=layer.name,
                    driver=driver,
                    geometry_type=layer.geometry_type,
                    crs=WGS84_3D,
                    append=number > 0,
                    nan_as_null=True,
                    layer_options={"SPATIAL_INDEX": "NO"} if unindexed else None,
                    gdal_tz_offsets={
                        name: np.full(len(layer), 100, np.int64)
                        for name, values in layer.columns.items()
                        if values.dtype.kind == "M"
                    },
                )
            except (DataSourceError, DataLayerError) as error:
                raise StageError(f"cannot write layer {layer.name} of {path}: {error}.") from error


def write_geoparquet(path: Path, columns: SignColumns) -> None:
    """Write signs as GeoParquet 1.1: WKB points, a bbox column as covering, field meanings.

    The coordinate system is OGC:CRS84h, WGS-84 longitude, latitude and ellipsoidal height.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays: list[Any] = []
    fields: list[Any] = []
    kinds = {"text": pa.string(), "integer": pa.int64(), "real": pa.float64()}
    kinds |= {"time": pa.timestamp("ms", tz="UTC"), "list": pa.list_(pa.string())}
    for field in (*SIGN_FIELDS, *STAMP_FIELDS):
        values = columns.values[field.name]
        if field.kind == "time":
            values = times_of_texts(values if columns.utc_known else [None] * len(columns))
        elif field.kind == "text":
            values = [_utf8(value) for value in values]
        elif field.kind == "list":
            values = [[_utf8(item) for item in value] for value in values]
        arrays.append(pa.array(values, kinds[field.kind], from_pandas=True))
        note = {"unit": field.unit, "description": field.meaning}
        fields.append(pa.field(field.name, kinds[field.kind], metadata=note))
    box = _box_column(columns)
    arrays += [box, pa.array(point_wkb(columns), pa.binary())]
    fields += [pa.field("bbox", box.type), pa.field("geometry", pa.binary())]
    schema = pa.schema(fields, metadata={"geo": json.dumps(_geo_metadata(columns))})
    with atomic_path(path) as temporary:
        pq.write_table(pa.table(arrays, schema=schema), temporary, compression="zstd")


def _utf8(text: str | None) -> str | None:
    return None if text is None else text.encode("utf-8", "replace").decode("utf-8")


def _box_column(columns: SignColumns) -> Any:
    import pyarrow as pa

    hidden = ~columns.located
    lon = pa.array(columns.lon_deg, mask=hidden)
    lat = pa.array(columns.lat_deg, mask=hidden)
    return pa.StructArray.from_arrays([lon, lat, lon, lat], ["xmin", "ymin", "xmax", "ymax"])


def _geo_metadata(columns: SignColumns) -> dict[str, Any]:
    from pyproj import CRS

    located = columns.located
    high = located & np.isfinite(columns.height_m)
    types = [
        name for name, present in (("Point", located & ~high), ("Point Z", high)) if present.any()
    ]
    geometry: dict[str, Any] = {
        "encoding": "WKB",
        "geometry_types": types,
        "crs": CRS.from_user_input("OGC:CRS84h").to_json_dict(),
        "covering": {
            "bbox": {name: ["bbox", name] for name in ("xmin", "ymin", "xmax", "ymax")},
        },
    }
    if located.any():
        from automap.export.geojson import bounding_box

        geometry["bbox"] = [float(text) for text in bounding_box(columns) or ()]
    return {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": geometry}}


def signs_csv(columns: SignColumns) -> str:
    """Signs as CSV (RFC 4180): position first, then every field; unknown values are empty."""
    import csv
    import io

    from automap.export.geojson import json_tokens

    texts: list[list[str]] = [
        _number_texts(columns.lon_deg, 9),
        _number_texts(columns.lat_deg, 9),
        _number_texts(columns.height_m, 3),
    ]
    for field in SIGN_FIELDS:
        values = columns.values[field.name]
        if field.kind == "real":
            tokens = json_tokens(field, values)
            texts.append(["" if token == "null" else token for token in tokens])
        elif field.kind == "list":
            texts.append([";".join(value) for value in values])
        else:
            texts.append(["" if value is None else str(value) for value in values])
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    writer.writerow(["lon_deg", "lat_deg", "height_m", *(field.name for field in SIGN_FIELDS)])
    writer.writerows(zip(*texts, strict=True))
    return stream.getvalue().encode("utf-8", "replace").decode("utf-8")


def _number_texts(values: Any, decimals: int) -> list[str]:
    return [f"{value:.{decimals}f}" if np.isfinite(value) else "" for value in values.tolist()]
