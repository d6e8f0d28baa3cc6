"""``map.gpkg``, ``signs.parquet`` and other formats of geographic information systems.

All in WGS-84 with ellipsoidal heights. Every file appears whole or not at all.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import StageError
from automap.export.csv_text import csv_cell
from automap.export.datum import WGS84_3D
from automap.export.dictionary import plane_fields
from automap.export.geopackage import complete_geopackage, lost_of
from automap.export.layers import Layer, LayerParts, in_one
from automap.export.projected import Plane
from automap.export.qml import QgisStyle
from automap.export.sign_columns import SignColumns
from automap.io.atomic import atomic_path, write_failure

_PLACE = "geom"
"""The column of a layer's geometry, as GDAL calls it in a GeoPackage."""
_FULL_BYTES = 1 << 17
"""A disk with less room is full to GDAL, which writes in larger pieces."""


def write_layers(
    path: Path,
    layers: Sequence[Layer | LayerParts],
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
        parts = [in_one(layer) if isinstance(layer, Layer) else layer for layer in layers]
        for number, layer in enumerate(parts):
            options: dict[str, str] = {}
            if driver == "FlatGeobuf":
                options = {"TITLE": layer.name, "DESCRIPTION": text} if lineage else {}
                # an index cannot hold features without a position
                if any(wkb is None for part in layer.parts() for wkb in part.wkb):
                    options["SPATIAL_INDEX"] = "NO"
            form: dict[str, Any] = {}
            if driver == "GPKG":
                # QGIS and GDAL of some years ago know 1.3, and take times with milliseconds only
                options = {"DATETIME_PRECISION": "MILLISECOND"}
                form = {"dataset_options": {"VERSION": "1.3"}} if number == 0 else {}
            metadata = {"AUTOMAP": text} if lineage and driver == "GPKG" else None
            more = {"append": number > 0, "dataset_metadata": metadata} | form
            try:
                write_parts(target, layer, driver, crs, layer_options=options or None, **more)
            except (DataSourceError, DataLayerError) as error:
                raise failure_of(path, layer.name, error) from error
        if isinstance(target, BytesIO):
            temporary.write_bytes(target.getbuffer())
        if driver == "GPKG":
            complete_geopackage(temporary, [layer.name for layer in layers], styles, epoch)
            lost = lost_of(temporary, {layer.name: layer.count for layer in parts})
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


def write_parts(
    path: Path | BytesIO, layer: LayerParts, driver: str, crs: str, **more: Any
) -> None:
    """The same of a layer in parts, of which one at a time is in memory."""
    import pyarrow as pa
    from pyogrio.raw import write_arrow

    parts = iter(layer.parts())
    first = _batch(next(parts))
    failed: list[BaseException] = []

    def batches() -> Iterator[pa.RecordBatch]:
        # GDAL would tell of it, and of an interrupt, as of a failure of its own
        try:
            yield first
            yield from map(_batch, parts)
        except BaseException as error:
            failed.append(error)
            raise

    reader = pa.RecordBatchReader.from_batches(first.schema, batches())
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "GPKG: bad application_id", RuntimeWarning)
        try:
            write_arrow(
                reader, path, layer=layer.name, driver=driver, geometry_name=_PLACE,
                geometry_type=layer.geometry_type, crs=crs, **more,
            )  # fmt: skip
        finally:
            if failed:
                raise failed[0]


def _batch(layer: Layer) -> Any:
    """A layer's features as Arrow has them: what is missing is null, times are UTC."""
    import pyarrow as pa

    arrays: dict[str, Any] = {}
    for name, values in layer.columns.items():
        if values.dtype.kind == "M":
            arrays[name] = pa.array(values).cast(pa.timestamp("ms", tz="UTC"))
        elif values.dtype.kind == "O":
            arrays[name] = pa.array(values, pa.string())
        else:
            arrays[name] = pa.array(values, mask=layer.missing.get(name), from_pandas=True)
    fields = [pa.field(name, array.type) for name, array in arrays.items()]
    fields.append(pa.field(_PLACE, pa.binary(), metadata={"ARROW:extension:name": "geoarrow.wkb"}))
    places = pa.array(layer.wkb, pa.binary())
    return pa.RecordBatch.from_arrays([*arrays.values(), places], schema=pa.schema(fields))


def failure_of(path: Path, layer: str, error: Exception) -> StageError:
    """GDAL's failure to write a layer in our words: of a full disk it says many things."""
    if shutil.disk_usage(path.parent).free < _FULL_BYTES:
        return write_failure(path, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    return StageError(f"cannot write layer {layer} of {path}: {error}.")


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
