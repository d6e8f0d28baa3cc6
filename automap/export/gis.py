"""``map.gpkg``, ``signs.parquet`` and other formats of geographic information systems.

All in WGS-84 with ellipsoidal heights. Every file appears whole or not at all.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import warnings
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import StageError
from automap.export.csv_text import csv_cell
from automap.export.datum import WGS84_3D
from automap.export.dictionary import plane_fields
from automap.export.fields import STAMP_FIELDS
from automap.export.geojson import longitude_range
from automap.export.geopackage import complete_geopackage, lost_of
from automap.export.layers import Layer, point_wkb, times_of_texts
from automap.export.projected import Plane, projected_wkb
from automap.export.qgis_style import QgisStyle
from automap.export.sign_columns import SignColumns
from automap.io.atomic import atomic_path, write_failure
from automap.records import FloatArray

ROW_GROUP = 65_536
"""Signs a row group of GeoParquet: readers skip whole groups by their bounding box."""
_FULL_BYTES = 1 << 17
"""A disk with less room is full to GDAL, which writes in larger pieces."""


def write_layers(
    path: Path,
    layers: Sequence[Layer],
    driver: str = "GPKG",
    lineage: Mapping[str, Any] | None = None,
    crs: str = WGS84_3D,
    styles: Sequence[QgisStyle] = (),
    epoch: float | None = None,
) -> None:
    """Write layers into one file with GDAL (a FlatGeobuf file holds one layer only).

    ``lineage`` goes into the file's own metadata. A GeoPackage also gets the meaning of its
    columns and the ``styles`` that QGIS takes when it opens a layer. ``crs`` is that of the
    layers' geometries, ``epoch`` the year in which they hold, with decimals.
    Raises StageError when GDAL cannot write the file.
    """
    from pyogrio.errors import DataLayerError, DataSourceError

    text = json.dumps(lineage or {}, default=str)
    with atomic_path(path) as temporary:
        # GDAL does not see that a FlatGeobuf file could not be written
        target = BytesIO() if driver == "FlatGeobuf" else temporary
        for number, layer in enumerate(layers):
            options: dict[str, str] = {}
            if driver == "FlatGeobuf":
                options = {"TITLE": layer.name, "DESCRIPTION": text} if lineage else {}
                # an index cannot hold features without a position
                if any(wkb is None for wkb in layer.wkb):
                    options["SPATIAL_INDEX"] = "NO"
            form: dict[str, Any] = {}
            if driver == "GPKG":
                # QGIS and GDAL of some years ago know 1.3, and take times with milliseconds only
                options = {"DATETIME_PRECISION": "MILLISECOND"}
                form = {"dataset_options": {"VERSION": "1.3"}} if number == 0 else {}
            metadata = {"AUTOMAP": text} if lineage and driver == "GPKG" else None
            more = {"append": number > 0, "dataset_metadata": metadata} | form
            try:
                write_layer(target, layer, driver, crs, layer_options=options or None, **more)
            except (DataSourceError, DataLayerError) as error:
                raise failure_of(path, layer, error) from error
        if isinstance(target, BytesIO):
            temporary.write_bytes(target.getbuffer())
        if driver == "GPKG":
            complete_geopackage(temporary, [layer.name for layer in layers], styles, epoch)
            lost = lost_of(temporary, {layer.name: len(layer.wkb) for layer in layers})
            if lost:
                raise StageError(
                    f"{path} could not be written whole: {lost}; make sure that the disk is sound "
                    "and has room, and write it again"
                )


def write_layer(path: Path | BytesIO, layer: Layer, driver: str, crs: str, **more: Any) -> None:
    """Write one layer with GDAL; raises what pyogrio raises.

    Of a header that GDAL could not write it only warns; ``lost_of`` looks at it afterwards.
    """
    from pyogrio.raw import write

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "GPKG: bad application_id", RuntimeWarning)
        write(
            path,
            geometry=layer.wkb,
            field_data=list(layer.columns.values()),
            fields=list(layer.columns),
            field_mask=[layer.missing.get(name) for name in layer.columns],
            layer=layer.name,
            driver=driver,
            geometry_type=layer.geometry_type,
            crs=crs,
            nan_as_null=True,
            gdal_tz_offsets={
                name: np.full(len(layer), 100, np.int64)
                for name, values in layer.columns.items()
                if values.dtype.kind == "M"
            },
            **more,
        )


def failure_of(path: Path, layer: Layer, error: Exception) -> StageError:
    """GDAL's failure to write a layer in our words: of a full disk it says many things."""
    if shutil.disk_usage(path.parent).free < _FULL_BYTES:
        return write_failure(path, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    return StageError(f"cannot write layer {layer.name} of {path}: {error}.")


def write_geoparquet(
    path: Path,
    columns: SignColumns,
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
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays: list[Any] = []
    fields: list[Any] = []
    kinds = {"text": pa.string(), "integer": pa.int64(), "real": pa.float64()}
    kinds |= {"time": pa.timestamp("ms", tz="UTC"), "list": pa.list_(pa.string())}
    for field in (*columns.fields, *STAMP_FIELDS):
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
    points = point_wkb(columns)
    places: tuple[FloatArray, ...] = columns.lon_deg, columns.lat_deg, columns.height_m
    if plane is not None:
        points, places = projected_wkb(points, plane), plane.points(*places)
    box = _box_column(columns, places)
    arrays += [box, pa.array(points, pa.binary())]
    fields += [pa.field("bbox", box.type), pa.field("geometry", pa.binary())]
    metadata = {"geo": json.dumps(_geo_metadata(columns, places, crs or "OGC:CRS84h", epoch))}
    if lineage:
        metadata["automap"] = json.dumps(lineage, default=str)
    schema = pa.schema(fields, metadata=metadata)
    with atomic_path(path) as temporary:
        pq.write_table(
            pa.table(arrays, schema=schema),
            temporary,
            compression="zstd",
            row_group_size=ROW_GROUP,
        )


def _utf8(text: str | None) -> str | None:
    return None if text is None else text.encode("utf-8", "replace").decode("utf-8")


def _box_column(columns: SignColumns, places: Sequence[FloatArray]) -> Any:
    import pyarrow as pa

    hidden = ~columns.located
    x, y = (pa.array(values, mask=hidden) for values in places[:2])
    return pa.StructArray.from_arrays([x, y, x, y], ["xmin", "ymin", "xmax", "ymax"])


def _geo_metadata(
    columns: SignColumns, places: Sequence[FloatArray], crs: str, epoch: float | None
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


def signs_csv(columns: SignColumns, plane: Plane | None = None) -> str:
    """Signs as CSV (RFC 4180): position first, with that in the ``plane`` if there is one, then
    every field; unknown values are empty.

    A text that a spreadsheet would compute gets an apostrophe in front.
    """
    import csv
    import io

    from automap.export.geojson import json_tokens

    texts: list[list[str]] = [
        _number_texts(columns.lon_deg, 9),
        _number_texts(columns.lat_deg, 9),
        _number_texts(columns.height_m, 3),
    ]
    heads = ["lon_deg", "lat_deg", "height_m"]
    if plane is not None:
        crs = plane.projection.crs
        places = plane.points(columns.lon_deg, columns.lat_deg, columns.height_m)
        texts += [_number_texts(values, 3) for values in places]
        texts.append([crs] * len(columns))
        heads += [field.name for field in plane_fields(crs)]
    for field in columns.fields:
        values = columns.values[field.name]
        if field.kind == "real":
            tokens = json_tokens(field, values)
            texts.append(["" if token == "null" else token for token in tokens])
        elif field.kind == "list":
            texts.append([csv_cell(";".join(value)) for value in values])
        elif field.kind == "text":
            texts.append(["" if value is None else csv_cell(str(value)) for value in values])
        else:
            texts.append(["" if value is None else str(value) for value in values])
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    writer.writerow([*heads, *(field.name for field in columns.fields)])
    writer.writerows(zip(*texts, strict=True))
    return stream.getvalue().encode("utf-8", "replace").decode("utf-8")


def _number_texts(values: Any, decimals: int) -> list[str]:
    return [f"{value:.{decimals}f}" if np.isfinite(value) else "" for value in values.tolist()]
