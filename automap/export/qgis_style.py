"""How QGIS draws the layers of a map: documents in its own style language, QML.

Everything that a style needs is in it, the faces of the signs among it; no file, no font and
no network is referred to.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as Xml

from automap.export.assemblies import ASSEMBLY_FIELDS
from automap.export.dictionary import OBSERVATION_FIELDS, TRACK_FIELDS
from automap.export.fields import ROAD_FIELDS, SIGN_FIELDS, STAMP_FIELDS, Field
from automap.export.icons import words_apart
from automap.export.kml_cells import clean_text
from automap.export.kml_track import SIGMA_COLOURS, UNKNOWN_COLOUR
from automap.export.sld import ellipse_sld, sign_sld, track_sld

_HEAD = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
_VERSION = "3.22.0"
_CATEGORIES = "Symbology|Labeling|Fields|MapTips|Rendering|Forms"
_BEYOND = 1e6
_SEEN_SCALE = 1000
"""Hundreds of dots would be all that a map of a town shows."""


@dataclass(frozen=True)
class QgisStyle:
    """The default look of one layer; ``qml`` is the document, ``sld`` the same for
    other programs, as far as that goes."""

    layer: str
    qml: str
    description: str
    sld: str = ""


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
    root, renderer = _document("categorizedSymbol", {"attr": "class"})
    names = words_apart(colours)
    categories = Xml.SubElement(renderer, "categories")
    symbols = Xml.SubElement(renderer, "symbols")
    for number, (name, colour) in enumerate(sorted(colours.items())):
        _range_or_category(
            categories, "category", number, clean_text(names[name]), value=clean_text(name)
        )
        if name in icons:
            picture = "base64:" + base64.b64encode(icons[name]).decode()
            layer = ("RasterMarker", {"imageFile": picture, "size": "7", "size_unit": "MM"})
        else:
            layer = ("SimpleMarker", _dot(colour, "3"))
        symbol = _symbol(symbols, number, "marker", *layer)
        _by_expression(symbol[-1], size=_SIZE_MM)
        _arrow(symbol, colour)
    _range_or_category(categories, "category", len(colours), "other", value="")
    _symbol(symbols, len(colours), "marker", "SimpleMarker", _dot(UNKNOWN_COLOUR, "3"))
    _labels(root, "name", scale=2500)
    _columns(root, _OF_SIGNS, 'concat("name", \' \', "id")')
    Xml.SubElement(root, "mapTip").text = _TIP
    _form(root, fields)
    return QgisStyle("signs", _text(root), "faces by class", sign_sld(colours, names))


def track_style(limits: Sequence[float], labels: Sequence[str]) -> QgisStyle:
    """The path coloured by its horizontal sigma, with the limits between the classes in m."""
    root, renderer = _document(
        "graduatedSymbol", {"attr": "sd_h_m", "graduatedMethod": "GraduatedColor"}
    )
    ranges = Xml.SubElement(renderer, "ranges")
    symbols = Xml.SubElement(renderer, "symbols")
    edges = [0.0, *limits, _BEYOND]
    names = list(labels) or ["path"]
    for number, label in enumerate(names):
        lower, upper = f"{edges[number]:.6f}", f"{edges[number + 1]:.6f}"
        _range_or_category(ranges, "range", number, label, lower=lower, upper=upper)
        last = max(len(names) - 1, 1)
        colour = SIGMA_COLOURS[round(number * (len(SIGMA_COLOURS) - 1) / last)]
        _symbol(
            symbols,
            number,
            "line",
            "SimpleLine",
            {"line_color": _rgba(colour), "line_width": "1", "line_width_unit": "MM",
             "capstyle": "round", "joinstyle": "round"},
        )  # fmt: skip
    _columns(root, TRACK_FIELDS, '"utc"')
    return QgisStyle("trajectory", _text(root), "horizontal sigma", track_sld(limits, labels))


def ellipse_style() -> QgisStyle:
    """The 95 % ellipses: a pale fill with a thin outline."""
    root, renderer = _document("singleSymbol", {})
    symbols = Xml.SubElement(renderer, "symbols")
    _symbol(
        symbols,
        0,
        "fill",
        "SimpleFill",
        {"color": _rgba("#888888", 64), "outline_color": _rgba("#444444"), "style": "solid",
         "outline_width": "0.26", "outline_width_unit": "MM", "outline_style": "solid"},
    )  # fmt: skip
    _columns(root, _OF_SIGNS, 'concat("name", \' \', "id")')
    return QgisStyle("ellipses", _text(root), "95 % of the horizontal position", ellipse_sld())


def assembly_style() -> QgisStyle:
    """Posts and gantries: dots below the faces."""
    root, renderer = _document("singleSymbol", {})
    _symbol(
        Xml.SubElement(renderer, "symbols"), 0, "marker", "SimpleMarker", _dot("#444444", "1.2")
    )
    _columns(root, ASSEMBLY_FIELDS, 'concat("kind", \' \', "id")')
    return QgisStyle("assemblies", _text(root), "posts and gantries")


def observation_style() -> QgisStyle:
    """The places from which signs were seen: small grey dots, in a street only."""
    root, renderer = _document("singleSymbol", {})
    shown = {"hasScaleBasedVisibilityFlag": "1", "minScale": str(_SEEN_SCALE), "maxScale": "0"}
    root.attrib.update(shown)
    # without a rim: rims of hundreds would hide the path below
    dot = _dot(UNKNOWN_COLOUR, "0.8") | {"outline_style": "no"}
    _symbol(Xml.SubElement(renderer, "symbols"), 0, "marker", "SimpleMarker", dot)
    _columns(root, OBSERVATION_FIELDS, 'concat("class", \' \', "utc")')
    return QgisStyle("observations", _text(root), "where signs were seen from")


def _document(kind: str, attributes: Mapping[str, str]) -> tuple[Xml.Element, Xml.Element]:
    root = Xml.Element("qgis", version=_VERSION, styleCategories=_CATEGORIES)
    common = {"type": kind, "forceraster": "0", "symbollevels": "0", "enableorderby": "0"}
    renderer = Xml.SubElement(root, "renderer-v2", common | dict(attributes))
    return root, renderer


def _range_or_category(
    parent: Xml.Element, tag: str, number: int, label: str, **values: str
) -> None:
    common = {"render": "true", "symbol": str(number), "label": label}
    Xml.SubElement(parent, tag, common | values)


def _columns(root: Xml.Element, fields: Sequence[Field], shown_as: str) -> None:
    """Readable names of the columns, with their units, and what stands for a feature in lists."""
    Xml.SubElement(root, "previewExpression").text = shown_as
    aliases = Xml.SubElement(root, "aliases")
    for number, field in enumerate(fields):
        unit = f" ({field.unit})" if field.unit else ""
        alias = field.title + unit
        Xml.SubElement(aliases, "alias", field=field.name, index=str(number), name=alias)


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


def _by_expression(layer: Xml.Element, **properties: str) -> None:
    """Properties of a symbol's layer that an expression gives."""
    parent = Xml.SubElement(layer, "data_defined_properties")
    whole = Xml.SubElement(parent, "Option", type="Map")
    Xml.SubElement(whole, "Option", name="name", type="QString", value="")
    each = Xml.SubElement(whole, "Option", name="properties", type="Map")
    for name, expression in properties.items():
        own = Xml.SubElement(each, "Option", name=name, type="Map")
        Xml.SubElement(own, "Option", name="active", type="bool", value="true")
        Xml.SubElement(own, "Option", name="expression", type="QString", value=expression)
        Xml.SubElement(own, "Option", name="type", type="int", value="3")
    Xml.SubElement(whole, "Option", name="type", type="QString", value="collection")


def _arrow(symbol: Xml.Element, colour: str) -> None:
    """An arrow from the sign the way its face looks."""
    layer = _layer(symbol, "SimpleMarker", _dot(colour, "4") | _ARROW)
    shown = f'"facing_deg" IS NOT NULL AND @map_scale < {_ARROW_SCALE}'
    _by_expression(layer, angle='"facing_deg"', enabled=shown)


def _symbol(
    parent: Xml.Element, number: int, kind: str, layer_class: str, values: Mapping[str, str]
) -> Xml.Element:
    symbol = Xml.SubElement(
        parent, "symbol", name=str(number), type=kind, alpha="1", clip_to_extent="1", force_rhr="0"
    )
    _layer(symbol, layer_class, values)
    return symbol


def _layer(symbol: Xml.Element, layer_class: str, values: Mapping[str, str]) -> Xml.Element:
    common = {"class": layer_class, "enabled": "1", "locked": "0", "pass": "0"}
    layer = Xml.SubElement(symbol, "layer", common)
    options = Xml.SubElement(layer, "Option", type="Map")
    for key, value in values.items():
        Xml.SubElement(options, "Option", name=key, type="QString", value=value)
    return layer


def _labels(root: Xml.Element, attribute: str, scale: int) -> None:
    labelling = Xml.SubElement(root, "labeling", type="simple")
    settings = Xml.SubElement(labelling, "settings", calloutType="simple")
    style = Xml.SubElement(
        settings, "text-style", fieldName=attribute, fontSize="8", textColor="28,33,40,255",
        isExpression="0", fontSizeUnit="Point",
    )  # fmt: skip
    Xml.SubElement(
        style, "text-buffer", bufferDraw="1", bufferSize="0.8", bufferSizeUnits="MM",
        bufferColor="255,255,255,255", bufferOpacity="1",
    )  # fmt: skip
    # below the face
    Xml.SubElement(
        settings, "placement", placement="1", quadOffset="7", yOffset="5.5", offsetUnits="MM"
    )
    Xml.SubElement(
        settings, "rendering", scaleVisibility="1", scaleMin="0", scaleMax=str(scale),
        drawLabels="1",
    )  # fmt: skip


def _dot(colour: str, size: str) -> dict[str, str]:
    return {
        "name": "circle",
        "color": _rgba(colour),
        "size": size,
        "size_unit": "MM",
        "outline_color": _rgba("#ffffff"),
        "outline_width": "0.2",
        "outline_style": "solid",
    }


def _rgba(colour: str, alpha: int = 255) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"{red},{green},{blue},{alpha}"


def _text(root: Xml.Element) -> str:
    return _HEAD + Xml.tostring(root, encoding="unicode")
