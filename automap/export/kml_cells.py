"""Values of signs as text of a KML document: typed data and the table of the balloon."""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from typing import Any
from xml.sax.saxutils import escape

from automap.export.fields import SIGN_FIELDS, Field
from automap.export.geojson import json_tokens
from automap.export.sign_columns import SignColumns

_ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_KML_TYPES = {"real": "double", "integer": "int", "text": "string", "time": "string"}
_NUMBERS = ("real", "integer")


def xml_text(value: Any) -> str:
    """Text for an element: markup escaped, characters that XML 1.0 forbids replaced."""
    return escape(_ILLEGAL.sub("\ufffd", str(value)))


def sign_schema() -> str:
    """The Schema element that gives the fields their types and meanings."""
    fields = "".join(
        f'<SimpleField name="{field.name}" type="{_KML_TYPES.get(field.kind, "string")}">'
        f"<displayName>{xml_text(_label(field))}</displayName></SimpleField>"
        for field in SIGN_FIELDS
    )
    return f'<Schema name="sign" id="sign">{fields}</Schema>'


def _label(field: Field) -> str:
    return f"{field.meaning} ({field.unit})" if field.unit else field.meaning


def plain_values(columns: SignColumns) -> list[list[str | None]]:
    """Every field as plain text, None where unknown; one list a field."""
    texts: list[list[str | None]] = []
    for field in SIGN_FIELDS:
        values = columns.values[field.name]
        if field.kind in ("real", "integer"):
            tokens = json_tokens(field, values)
            texts.append([None if token == "null" else token for token in tokens])
        elif field.kind == "list":
            texts.append([", ".join(value) or None for value in values])
        else:
            texts.append([None if value in (None, "") else str(value) for value in values])
    return texts


def data_cells(field: Field, values: list[str | None]) -> list[str]:
    """A field's SimpleData elements, empty where the value is unknown."""
    head, end = f'<SimpleData name="{field.name}">', "</SimpleData>"
    text = str if field.kind in _NUMBERS else _each_once(xml_text)
    return ["" if value is None else f"{head}{text(value)}{end}" for value in values]


def balloon_cells(field: Field, values: list[str | None]) -> list[str]:
    """A field's rows of the balloon's table, as XML text."""
    head = xml_text(f"<tr><td>{html_text(_label(field))}</td><td>")
    end = xml_text("</td></tr>")
    safe = _each_once(lambda value: xml_text(html_text(value)))
    text = str if field.kind in _NUMBERS else safe
    return ["" if value is None else f"{head}{text(value)}{end}" for value in values]


def html_text(text: str) -> str:
    """Text as HTML of a balloon, so that hostile text stays text.

    The dollar sign is spelled as an entity, else ``$[...]`` in a value would be replaced by
    another field.
    """
    return html.escape(_ILLEGAL.sub("\ufffd", text)).replace("$", "&#36;")


def _each_once(convert: Callable[[str], str]) -> Callable[[str], str]:
    known: dict[str, str] = {}

    def converted(value: str) -> str:
        if value not in known:
            known[value] = convert(value)
        return known[value]

    return converted
