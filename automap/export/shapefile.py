"""Signs as a zipped Shapefile: names of ten letters, with a legend of them in the archive.

Its tables hold no time of day and no text beyond 254 bytes, so times are texts and long texts end.
"""

from __future__ import annotations

import csv
import io
import struct
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from automap.errors import StageError
from automap.export.fields import SIGN_FIELDS, Field
from automap.export.layers import Layer, sign_layer
from automap.export.projected import Plane, projected_layer
from automap.export.sign_columns import SignColumns
from automap.io.atomic import atomic_path

SHORT = {
    "value_unit": "unit",
    "confidence": "confid",
    "class_probability": "p_class",
    "group_probability": "p_group",
    "height_above_road_m": "h_road_m",
    "sd_above_road_m": "sd_road_m",
    "height_msl_m": "h_msl_m",
    "facing_deg": "facing",
    "facing_sd_deg": "facing_sd",
    "path_offset_m": "path_off",
    "road_direction": "road_dir",
    "n_back_views": "n_back",
    "contrast_sd": "contr_sd",
    "contrast_note": "contr_note",
    "picture_file": "picture",
    "street_file": "street",
    "cov_ee_m2": "cov_ee",
    "cov_en_m2": "cov_en",
    "cov_nn_m2": "cov_nn",
}
"""Names that a Shapefile's tables cannot hold, or that say more with fewer letters."""
LONGEST_NAME, LONGEST_TEXT = 10, 254
LEGEND = "signs_columns.csv"
_DATE = (1980, 1, 1, 0, 0, 0)
_OPTIONS = {"ENCODING": "UTF-8", "DBF_DATE_LAST_UPDATE": "1980-01-01"}
"""The same signs give the same bytes on another day."""
_HEAD = 100
"""Bytes of the header of .shp and .shx."""


def short_name(name: str) -> str:
    """A column's name in the Shapefile."""
    return SHORT.get(name, name)


def write_shapefile(path: Path, columns: SignColumns, crs: str, plane: Plane | None = None) -> None:
    """Write ``path``, a .zip with ``signs.shp`` and its kin, and the legend; in ``crs``, to which
    ``plane`` projects. Raises StageError where it cannot be written whole."""
    from pyogrio.errors import DataLayerError, DataSourceError

    from automap.export.gis import failure_of, write_layer

    layer = _plain(sign_layer(columns), columns)
    if plane is not None:
        layer = projected_layer(layer, plane)
    with tempfile.TemporaryDirectory() as folder:
        shape = Path(folder) / "signs.shp"
        try:
            write_layer(shape, layer, "ESRI Shapefile", crs, layer_options=_OPTIONS)
        except (DataSourceError, DataLayerError) as error:
            raise failure_of(path, layer.name, error) from error
        parts = {file.name: file.read_bytes() for file in sorted(Path(folder).iterdir())}
        if not whole(parts, len(layer)):
            raise StageError(
                f"{path} could not be written whole; make sure that the disk of temporary files "
                f"({folder}) is sound and has room, and write it again"
            )
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, content in parts.items():
            _add(archive, name, content)
        _add(archive, LEGEND, legend_csv(columns.fields).encode())


def whole(parts: Mapping[str, bytes], count: int) -> bool:
    """Whether the files of a Shapefile hold all of ``count`` signs: GDAL does not see that one
    could not be written, or not in the middle (ESRI Shapefile Technical Description, 1998)."""
    if not {f"signs.{kind}" for kind in ("shp", "shx", "dbf", "prj", "cpg")} <= set(parts):
        return False
    shp, shx, dbf = (parts[f"signs.{kind}"] for kind in ("shp", "shx", "dbf"))
    if len(shx) != _HEAD + 8 * count or len(shp) < _HEAD or len(dbf) < 32:
        return False
    # in words of 16 bits, the highest byte first, as are the records' numbers
    starts = 2 * np.frombuffer(shx, ">i4", offset=_HEAD).reshape(-1, 2)[:, 0].astype(np.int64)
    if 2 * struct.unpack(">i", shp[24:28])[0] != len(shp) or np.any(starts > len(shp) - 4):
        return False
    numbers = [struct.unpack_from(">i", shp, start)[0] for start in starts]
    # a table's records are text throughout, as wide as its columns together
    records, head, length = struct.unpack_from("<IHH", dbf, 4)
    texts = dbf[head : head + count * length]
    return bool(
        numbers == list(range(1, count + 1))
        and records == count
        and head > 32
        and 1 + sum(dbf[48 : head - 1 : 32]) == length
        and all(dbf[32 : head - 1 : 32])
        and len(texts) == count * length
        and b"\0" not in texts
        and parts["signs.prj"]
        and parts["signs.cpg"]
    )


def legend_csv(fields: Sequence[Field] = SIGN_FIELDS) -> str:
    """The short names, what they are called elsewhere, units and meanings."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    writer.writerow(["column", "name", "unit", "meaning"])
    for field in fields:
        writer.writerow([short_name(field.name), field.name, field.unit, field.meaning])
    return stream.getvalue()


def _plain(layer: Layer, columns: SignColumns) -> Layer:
    """The layer in what such a table can hold."""
    arrays = {}
    for field in columns.fields:
        values = layer.columns[field.name]
        if field.kind == "time":
            texts = columns.values[field.name] if columns.utc_known else [None] * len(columns)
            values = np.array([*texts, None], object)[:-1]
        elif values.dtype == object:
            values = np.array([None if v is None else _cut(v) for v in values] + [None], object)[
                :-1
            ]
        arrays[short_name(field.name)] = values
    missing = {short_name(name): mask for name, mask in layer.missing.items()}
    return Layer("signs", layer.geometry_type, layer.wkb, arrays, missing)


def _cut(text: str) -> str:
    return text.encode()[:LONGEST_TEXT].decode("utf-8", "ignore")


def _add(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    info = zipfile.ZipInfo(name, _DATE)
    info.compress_type = zipfile.ZIP_DEFLATED
    archive.writestr(info, content)
