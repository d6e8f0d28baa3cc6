"""How QGIS draws the layers of a comparison with an inventory."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

from automap.export.fields import Field
from automap.export.qml import (
    QgisStyle,
    add_labels,
    add_symbol,
    document,
    document_text,
    dot,
    name_columns,
    range_or_category,
    rgba,
)

_KINDS = {
    "missing": ("#c1121f", "missing: in view, and not found"),
    "new": ("#0072b2", "new: on the map and not in the inventory"),
    "class": ("#6a3d9a", "another class than listed"),
    "moved": ("#d55e00", "moved"),
    "unconfirmed": ("#e69f00", "unconfirmed: not found, as signs that stand may be"),
    "matched": ("#009e73", "matched"),
    "not_seen": ("#888888", "not seen: nothing is said"),
}
"""Colour and legend of each kind, what is to be done first."""
_FIELDS = (
    Field("kind", "text", "", "what became of the sign"),
    Field("probability", "real", "", "that this is so"),
    Field("sure", "text", "", "yes: for work"),
    Field("id", "text", "", "sign of the map"),
    Field("listed_id", "text", "", "entry of the inventory"),
    Field("class", "text", "", "class on the map"),
    Field("listed_class", "text", "", "class that the inventory has"),
    Field("listed_code", "text", "", "code that the inventory has"),
    Field("distance_m", "real", "m", "from where it is listed to where it was found"),
    Field("sd_m", "real", "m", "one sigma of that per axis"),
    Field("facing_deg", "real", "deg", "direction the face looks"),
    Field("more_drives", "real", "", "past an unconfirmed sign, until it is surely gone"),
    Field("code", "text", "", "code of the class on the map"),
)
_WORDS = "replace(\"kind\", '_', ' ')"
_TIP = f"""<b>[% {_WORDS} %]</b>, probability [% round("probability", 2) %]<br>
found: [% coalesce("class", 'nothing') %] [% coalesce("id", '') %]<br>
listed: [% coalesce("listed_class", "listed_code", 'nothing') %] [% coalesce("listed_id", '') %]
[% coalesce('<br>' || round("distance_m", 1) || ' m from where it is listed', '') %]"""


def comparison_styles() -> list[QgisStyle]:
    """Points in the colours of their kinds, those that need no look smaller, with a tip; lines
    from where signs are listed to where they were found."""
    root, renderer = document("categorizedSymbol", {"attr": "kind"})
    categories = Xml.SubElement(renderer, "categories")
    symbols = Xml.SubElement(renderer, "symbols")
    for number, (kind, (colour, label)) in enumerate(_KINDS.items()):
        range_or_category(categories, "category", number, label, value=kind)
        size = "2.4" if kind in ("matched", "not_seen") else "4"
        add_symbol(symbols, number, "marker", "SimpleMarker", dot(colour, size))
    add_labels(root, f"{_WORDS} || coalesce(' ' || \"listed_id\", '')", 2500, expression=True)
    name_columns(root, _FIELDS, 'concat("kind", \' \', coalesce("listed_id", "id"))')
    Xml.SubElement(root, "mapTip").text = _TIP
    points = QgisStyle("comparison", document_text(root), "what became of each sign")
    root, renderer = document("singleSymbol", {})
    line = {"line_color": rgba("#444444"), "line_width": "0.4", "line_width_unit": "MM"}
    add_symbol(Xml.SubElement(renderer, "symbols"), 0, "line", "SimpleLine", line)
    name_columns(root, _FIELDS, 'concat("kind", \' \', "listed_id")')
    return [points, QgisStyle("shifts", document_text(root), "from where it is listed")]
