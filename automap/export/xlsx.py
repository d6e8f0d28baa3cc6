"""Signs as a workbook of Excel's: a sheet of signs with their pictures, and what its columns mean.

Texts are written as texts, so that nothing of a recording is computed.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import StageError
from automap.export.dictionary import POSITION_FIELDS, plane_fields
from automap.export.fields import Field
from automap.export.kml_cells import clean_text
from automap.export.sign_columns import SignColumns
from automap.io.atomic import atomic_path

if TYPE_CHECKING:
    from xlsxwriter.worksheet import Worksheet

    from automap.export.projected import Plane

LAST_ROW = 1_048_575
"""Excel's last row of a sheet that has a head."""
_PICTURE_PX, _ROW_PT = 56, 44
"""Of a picture's longer side, and the height of a row that shows it: 56 px are 42 pt."""
_WIDE = {
    "class": 36, "name": 24, "first_seen": 18, "last_seen": 18, "picture_file": 26,
    "street_file": 30, "drives": 24, "note": 40, "contrast_note": 16, "reviewed": 28,
}  # fmt: skip
"""Characters; what is cut off by its neighbour cannot be read."""
_DATE = datetime(1980, 1, 1)
"""In place of the time of writing: the same map is then the same file."""


def write_xlsx(
    path: Path,
    columns: SignColumns,
    pictures: Mapping[str, bytes] | None = None,
    lineage: Mapping[str, Any] | None = None,
    plane: Plane | None = None,
) -> None:
    """Write the workbook; ``pictures`` JPEGs by sign, positions in the ``plane`` besides.

    Raises StageError for more signs than a sheet holds.
    """
    import xlsxwriter
    import xlsxwriter.exceptions

    if len(columns) > LAST_ROW:
        raise StageError(
            f"{path}: a sheet holds {LAST_ROW} signs and the map has {len(columns)}; take csv."
        )
    with atomic_path(path) as temporary:
        book = xlsxwriter.Workbook(
            str(temporary), {"strings_to_formulas": False, "strings_to_urls": False}
        )
        book.set_properties({"created": _DATE})
        bold = book.add_format({"bold": True, "bottom": 1})
        places = _places(columns, plane)
        fields = (*places, *columns.fields)
        values = {field.name: own for field, own in places.items()} | dict(columns.values)
        sheet = book.add_worksheet("signs")
        _write_signs(book, sheet, fields, values, columns.utc_known, bold)
        for row, name in enumerate(columns.values["id"], start=1):
            if pictures and name in pictures:
                _insert(sheet, row, pictures[name])
        sheet = book.add_worksheet("columns")
        sheet.write_row(0, 0, ["column", "unit", "meaning"], bold)
        for row, field in enumerate(fields, start=1):
            sheet.write_row(row, 0, [field.name, field.unit, field.meaning])
        sheet.set_column(0, 0, 22)
        sheet.set_column(2, 2, 80)
        sheet = book.add_worksheet("map")
        for row, (key, value) in enumerate((lineage or {}).items()):
            sheet.write_string(row, 0, str(key))
            sheet.write_string(row, 1, clean_text(_said(value))[:32_000])
        sheet.set_column(0, 1, 30)
        try:
            book.close()
        except xlsxwriter.exceptions.FileCreateError as error:
            # its own wrapping of what the disk said
            raise error.args[0] if isinstance(error.args[0], OSError) else error from None


def _said(value: Any) -> str:
    """What a file says of itself, as people write lists and tables."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {own}" for key, own in value.items())
    return ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def _places(columns: SignColumns, plane: Plane | None) -> dict[Field, Any]:
    """The columns of positions [n], with those in the plane if there is one."""
    degrees = (columns.lon_deg, columns.lat_deg, columns.height_m)
    places: dict[Field, Any] = dict(zip(POSITION_FIELDS, degrees, strict=True))
    if plane is not None:
        crs = plane.projection.crs
        own = (*plane.points(*degrees), [crs] * len(columns))
        places |= dict(zip(plane_fields(crs), own, strict=True))
    return places


def _write_signs(
    book: Any,
    sheet: Worksheet,
    fields: Sequence[Field],
    columns: Mapping[str, Any],
    utc_known: bool,
    bold: Any,
) -> None:
    when = book.add_format({"num_format": "yyyy-mm-dd hh:mm:ss"})
    formats = {
        f.decimals: book.add_format({"num_format": "0." + "0" * f.decimals if f.decimals else "0"})
        for f in fields
        if f.decimals is not None
    }
    degrees = book.add_format({"num_format": "0.0000000"})
    n = len(columns["id"])
    sheet.write_row(0, 0, ["picture", *(field.name for field in fields)], bold)
    sheet.freeze_panes(1, 2)
    sheet.autofilter(0, 0, max(n, 1), len(fields))
    sheet.set_column(0, 0, 10)
    sheet.set_column(1, len(fields), 12)
    for number, field in enumerate(fields, start=1):
        if field.name in _WIDE:
            sheet.set_column(number, number, _WIDE[field.name])
        values = columns.get(field.name)
        cell_format = (
            degrees
            if field.name in ("lon_deg", "lat_deg")
            else formats.get(-1 if field.decimals is None else field.decimals)
        )
        for row, value in enumerate(values if values is not None else (), start=1):
            if value is None or (isinstance(value, float) and not np.isfinite(value)):
                continue
            if field.kind == "time" and utc_known:
                sheet.write_datetime(row, number, datetime.fromisoformat(value[:-1]), when)
            elif field.kind in ("real", "integer", "time"):
                sheet.write_number(row, number, float(value), cell_format)
            else:
                text = ", ".join(value) if field.kind == "list" else str(value)
                sheet.write_string(row, number, clean_text(text)[:32_000])


def _insert(sheet: Worksheet, row: int, jpeg: bytes) -> None:
    import cv2

    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        return
    scale = _PICTURE_PX / max(image.shape[:2])
    sheet.set_row(row, _ROW_PT)
    sheet.insert_image(
        row, 0, "sign.jpg",
        {"image_data": io.BytesIO(jpeg), "x_scale": scale, "y_scale": scale, "x_offset": 2,
         "y_offset": 1, "object_position": 1},
    )  # fmt: skip
