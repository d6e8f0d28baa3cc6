"""Values of signs as text of a KML document: typed data and the table of the balloon."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from automap.export.fields import ROAD_FIELDS, SIGN_FIELDS, Field
from automap.export.geojson import json_column
from automap.export.sign_columns import SignColumns
from automap.export.text_columns import (
    TextColumn,
    constant,
    plain_column,
    special_characters,
    text_column,
)
from automap.records import BoolArray

_ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_SPECIAL = special_characters("&<>\"'$")
_KML_TYPES = {"real": "double", "integer": "int", "text": "string", "time": "string"}

Pieces = list[str | TextColumn]

BALLOON_FIELDS = (
    "code",
    "confidence",
    "ce95_m",
    "sd_u_m",
    "height_above_road_m",
    "sd_above_road_m",
    "facing_deg",
    "facing_sd_deg",
    "size_m",
    "side",
    "path_offset_m",
    "support",
    "face_order",
    "main_sign",
    "n_back_views",
    "contrast",
    "contrast_sd",
    "contrast_note",
    "seen_share",
    "n_looked",
    "road_name",
    "road_id",
    "chainage_m",
    "offset_m",
    "road_side",
    "road_direction",
    "road_check",
    "n_views",
    "first_seen",
    "last_seen",
    "drives",
    "status",
    "note",
    "reviewer",
    "reviewed",
)
"""What the balloon shows of a sign, in this order; the typed data hold every field."""


def clean_text(value: Any) -> str:
    """A text without the characters that XML 1.0 forbids."""
    return _ILLEGAL.sub("\ufffd", str(value))


def xml_text(value: Any) -> str:
    """Text for an element: markup escaped, characters that XML 1.0 forbids replaced."""
    return escape(clean_text(value))


def html_text(text: str) -> str:
    """Text as HTML of a balloon, so that hostile text stays text.

    The dollar sign is spelled as an entity, else ``$[...]`` in a value would be replaced by
    another field.
    """
    return html.escape(_ILLEGAL.sub("\ufffd", text)).replace("$", "&#36;")


def sign_schema(fields: Sequence[Field] = SIGN_FIELDS) -> str:
    """The Schema element that gives the fields their types and meanings."""
    parts = "".join(
        f'<SimpleField name="{field.name}" type="{_KML_TYPES.get(field.kind, "string")}">'
        f"<displayName>{xml_text(_label(field))}</displayName></SimpleField>"
        for field in fields
    )
    return f'<Schema name="sign" id="sign">{parts}</Schema>'


def _label(field: Field) -> str:
    return f"{field.meaning} ({field.unit})" if field.unit else field.meaning


def lineage_data(lineage: Mapping[str, Any]) -> str:
    """Where the map comes from, as the document's ExtendedData."""
    rows = "".join(
        f'<Data name="{xml_text(key)}"><value>{xml_text(value)}</value></Data>'
        for key, value in lineage.items()
    )
    return f"<ExtendedData>{rows}</ExtendedData>" if rows else ""


@dataclass(frozen=True)
class Cells:
    """One field of all signs: as XML text, as HTML text, and which signs have a value."""

    xml: TextColumn
    html: TextColumn
    known: BoolArray


def field_cells(columns: SignColumns) -> dict[str, Cells]:
    """Every field of the signs as text."""
    return {field.name: _cells(field, columns.values[field.name]) for field in columns.fields}


def _cells(field: Field, values: Any) -> Cells:
    if field.kind == "real":
        texts = json_column(field, values)
        return Cells(texts, texts, np.isfinite(np.asarray(values, np.float64)))
    if field.kind == "integer" and isinstance(values, np.ndarray):
        texts = json_column(field, values)
        return Cells(texts, texts, np.ones(len(values), np.bool_))
    if field.kind == "list":
        values = [", ".join(value) for value in values]
    plain = plain_column(values, _SPECIAL)
    if plain is None:
        # without a clock the times are host stamps
        values = ["" if value is None else str(value) for value in values]
        plain = plain_column(values, _SPECIAL)
    if plain is not None:
        return Cells(plain, plain, plain.length > 0)
    texts = text_column(values, xml_text)
    return Cells(texts, text_column(values, html_text), texts.length > 0)


def data_cells(cells: Mapping[str, Cells], typed: bool) -> Pieces:
    """The values of every field, left out where unknown: by the schema's types, or as plain Data,
    which GDAL reads from an archive too, where it does not find the schema."""
    pieces: Pieces = ['<SchemaData schemaUrl="#sign">'] if typed else []
    for name, own in cells.items():
        head, end = f'<SimpleData name="{name}">', "</SimpleData>"
        if not typed:
            head, end = f'<Data name="{name}"><value>', "</value></Data>"
        pieces += _framed(head, own.xml, end, own.known)
    return [*pieces, "</SchemaData>"] if typed else pieces


def balloon_cells(cells: Mapping[str, Cells]) -> Pieces:
    """Rows of the balloon's table as HTML within a CDATA section."""
    by_name = {field.name: field for field in (*SIGN_FIELDS, *ROAD_FIELDS)}
    pieces: Pieces = []
    for name in (name for name in BALLOON_FIELDS if name in cells):
        field = by_name[name]
        # the ends of rows and cells may be left out in HTML
        head = f"<tr><td>{html_text(field.title)}<td>"
        unit = field.unit_text
        pieces += _framed(head, cells[name].html, html_text(unit), cells[name].known)
    return pieces


def name_column(values: list[Any]) -> TextColumn:
    """Texts for elements."""
    return text_column(values, xml_text, special=_SPECIAL)


def _framed(head: str, texts: TextColumn, end: str, known: BoolArray) -> Pieces:
    if known.all():
        return [head, texts, end]
    n = len(known)
    return [constant(head, n).where(known), texts.where(known), constant(end, n).where(known)]
