"""How QGIS draws the layers of a map; the faces of the signs are in the documents."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as Xml

from automap.export.assemblies import ASSEMBLY_FIELDS
from automap.export.dictionary import OBSERVATION_FIELDS, TRACK_FIELDS
from automap.export.fields import ROAD_FIELDS, SIGN_FIELDS, STAMP_FIELDS, Field
from automap.export.icons import words_apart
from automap.export.kml_cells import clean_text
from automap.export.kml_track import SIGMA_COLOURS, UNKNOWN_COLOUR
from automap.export.qml import (
    QgisStyle,
    add_labels,
    add_layer,
    add_symbol,
    by_expression,
    document,
    document_text,
    dot,
    name_columns,
    range_or_category,
    rgba,
)
from automap.export.sld import ellipse_sld, sign_sld, track_sld

_BEYOND = 1e6
_SEEN_SCALE = 1000
"""Hundreds of dots would be all that a map of a town shows."""
_OF_SIGNS = (*SIGN_FIELDS, *ROAD_FIELDS, *STAMP_FIELDS)
_SIZE_MM = "CASE WHEN @map_scale < 5000 THEN 7 WHEN @map_scale < 30000 THEN 4 ELSE 2 END"
"""Of a sign: faces to be read in a street, dots in a town, where thousands would cover it."""
_ARROW_SCALE = 5000
_ARROW = {"name": "arrow", "offset": "0,-5.5", "offset_unit": "MM"}
"""Beyond the face's 3.5 mm. No triangle: turned by 120 deg it looks the same."""
_TIP = """<b>[% coalesce("name", "class") %]</b> [% coalesce("code", '') %]<br>
<img height="90" src="[% 'file:///' || regexp_replace(decode_uri(@layer, 'path'), '[^/]*$', '') ||
"picture_file" %]"><br>
[% "id" %], [% coalesce("status", '') %], confidence [% coalesce(round("confidence", 2), '?') %]<br>
95 % within [% coalesce(round("ce95_m", 2), '?') %] m<br>
[% coalesce(round("height_above_road_m", 2), '?') %] m above the road, sd
[% coalesce(round("sd_above_road_m", 2), '?') %] m<br>
faces [% coalesce(round("facing_deg"), '?') %] deg, sd
[% coalesce(round("facing_sd_deg"), '?') %] deg
[% coalesce('<br>' || "note", '') %]"""
"""The picture lies in the folder ``pictures`` beside the map."""
_FORM_PICTURE = (
    """<img id="face" height="240"><script>document.getElementById("face").src = """
    """expression.evaluate("'file:///' || regexp_replace(decode_uri(@layer, 'path'), """
    r"""'[^/]*$', '') || \"picture_file\"");</script>"""
)
"""On one line, as QGIS wants an expression in a script."""
_FORM_TABS = {
    "Sign": ("name", "code", "value", "value_unit", "status", "confidence", "note", "reviewer"),
    "Place": ("height_above_road_m", "sd_above_road_m", "height_msl_m", "facing_deg",
              "facing_sd_deg", "side", "path_offset_m", "size_m", "support", "ce95_m", "sd_u_m"),
    "Sightings": ("n_views", "first_seen", "last_seen", "drives", "existence",
                  "class_probability", "seen_share", "n_looked"),
    "Condition": ("contrast", "contrast_sd", "contrast_note", "face_order", "main_sign",
                  "n_back_views", "picture_file", "street_file"),
}  # fmt: skip
"""Columns of the form, tab by tab; the picture is on the first."""


def sign_style(
    icons: Mapping[str, bytes], colours: Mapping[str, str], fields: Sequence[Field] = SIGN_FIELDS
) -> QgisStyle:
    """Signs as the faces of their classes (PNG), with an arrow the way they face, names when
    zoomed in, readable columns and a tip with the picture.

    A class without a picture is a dot in its colour (#rrggbb). The form has the columns ``fields``.
    """
    root, renderer = document("categorizedSymbol", {"attr": "class"})
    names = words_apart(colours)
    categories = Xml.SubElement(renderer, "categories")
    symbols = Xml.SubElement(renderer, "symbols")
    for number, (name, colour) in enumerate(sorted(colours.items())):
        range_or_category(
            categories, "category", number, clean_text(names[name]), value=clean_text(name)
        )
        if name in icons:
            picture = "base64:" + base64.b64encode(icons[name]).decode()
            layer = ("RasterMarker", {"imageFile": picture, "size": "7", "size_unit": "MM"})
        else:
            layer = ("SimpleMarker", dot(colour, "3"))
        symbol = add_symbol(symbols, number, "marker", *layer)
        by_expression(symbol[-1], size=_SIZE_MM)
        _arrow(symbol, colour)
    range_or_category(categories, "category", len(colours), "other", value="")
    add_symbol(symbols, len(colours), "marker", "SimpleMarker", dot(UNKNOWN_COLOUR, "3"))
    add_labels(root, "name", scale=2500)
    name_columns(root, _OF_SIGNS, 'concat("name", \' \', "id")')
    Xml.SubElement(root, "mapTip").text = _TIP
    _form(root, fields)
    return QgisStyle("signs", document_text(root), "faces by class", sign_sld(colours, names))


def track_style(limits: Sequence[float], labels: Sequence[str]) -> QgisStyle:
    """The path coloured by its horizontal sigma, with the limits between the classes in m."""
    root, renderer = document(
        "graduatedSymbol", {"attr": "sd_h_m", "graduatedMethod": "GraduatedColor"}
    )
    ranges = Xml.SubElement(renderer, "ranges")
    symbols = Xml.SubElement(renderer, "symbols")
    edges = [0.0, *limits, _BEYOND]
    names = list(labels) or ["path"]
    for number, label in enumerate(names):
        lower, upper = f"{edges[number]:.6f}", f"{edges[number + 1]:.6f}"
        range_or_category(ranges, "range", number, label, lower=lower, upper=upper)
        last = max(len(names) - 1, 1)
        colour = SIGMA_COLOURS[round(number * (len(SIGMA_COLOURS) - 1) / last)]
        add_symbol(
            symbols,
            number,
            "line",
            "SimpleLine",
            {"line_color": rgba(colour), "line_width": "1", "line_width_unit": "MM",
             "capstyle": "round", "joinstyle": "round"},
        )  # fmt: skip
    name_columns(root, TRACK_FIELDS, '"utc"')
    return QgisStyle(
        "trajectory", document_text(root), "horizontal sigma", track_sld(limits, labels)
    )


def ellipse_style() -> QgisStyle:
    """The 95 % ellipses: a pale fill with a thin outline."""
    root, renderer = document("singleSymbol", {})
    symbols = Xml.SubElement(renderer, "symbols")
    add_symbol(
        symbols,
        0,
        "fill",
        "SimpleFill",
        {"color": rgba("#888888", 64), "outline_color": rgba("#444444"), "style": "solid",
         "outline_width": "0.26", "outline_width_unit": "MM", "outline_style": "solid"},
    )  # fmt: skip
    name_columns(root, _OF_SIGNS, 'concat("name", \' \', "id")')
    return QgisStyle(
        "ellipses", document_text(root), "95 % of the horizontal position", ellipse_sld()
    )


def assembly_style() -> QgisStyle:
    """Posts and gantries: dots below the faces."""
    root, renderer = document("singleSymbol", {})
    add_symbol(
        Xml.SubElement(renderer, "symbols"), 0, "marker", "SimpleMarker", dot("#444444", "1.2")
    )
    name_columns(root, ASSEMBLY_FIELDS, 'concat("kind", \' \', "id")')
    return QgisStyle("assemblies", document_text(root), "posts and gantries")


def observation_style() -> QgisStyle:
    """The places from which signs were seen: small grey dots, in a street only."""
    root, renderer = document("singleSymbol", {})
    shown = {"hasScaleBasedVisibilityFlag": "1", "minScale": str(_SEEN_SCALE), "maxScale": "0"}
    root.attrib.update(shown)
    # without a rim: rims of hundreds would hide the path below
    grey = dot(UNKNOWN_COLOUR, "0.8") | {"outline_style": "no"}
    add_symbol(Xml.SubElement(renderer, "symbols"), 0, "marker", "SimpleMarker", grey)
    name_columns(root, OBSERVATION_FIELDS, 'concat("class", \' \', "utc")')
    return QgisStyle("observations", document_text(root), "where signs were seen from")


def _form(root: Xml.Element, fields: Sequence[Field]) -> None:
    """The form of a sign in tabs, with its picture."""
    Xml.SubElement(root, "editorlayout").text = "tablayout"
    form = Xml.SubElement(root, "attributeEditorForm")
    number = {field.name: str(index) for index, field in enumerate(fields)}
    roads = tuple(field.name for field in ROAD_FIELDS if field in fields)
    for tab, names in (*_FORM_TABS.items(), *([("Road", roads)] if roads else [])):
        box = Xml.SubElement(
            form, "attributeEditorContainer", name=tab, groupBox="0", columnCount="1", showLabel="1"
        )
        if tab == "Sign":
            picture = Xml.SubElement(
                box, "attributeEditorHtmlElement", name="Picture", showLabel="0"
            )
            picture.text = _FORM_PICTURE
        for name in names:
            Xml.SubElement(
                box, "attributeEditorField", name=name, index=number[name], showLabel="1"
            )


def _arrow(symbol: Xml.Element, colour: str) -> None:
    """An arrow from the sign the way its face looks."""
    layer = add_layer(symbol, "SimpleMarker", dot(colour, "4") | _ARROW)
    shown = f'"facing_deg" IS NOT NULL AND @map_scale < {_ARROW_SCALE}'
    by_expression(layer, angle='"facing_deg"', enabled=shown)
