"""How other programs than QGIS draw the layers: Styled Layer Descriptor 1.0 (OGC 02-070).

It stands beside QGIS's own document in ``layer_styles``. Version 1.0 holds no pictures within
itself, so that signs are marks in the colours of their classes. None of its six marks points
anywhere (its triangle has three ways alike), so that an arrow of text shows the way that they face.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree as Xml

from automap.export.kml_cells import clean_text
from automap.export.kml_track import SIGMA_COLOURS

_SPACES = {"xmlns": "http://www.opengis.net/sld", "xmlns:ogc": "http://www.opengis.net/ogc"}
_NEAR = "5000"
"""Scale from which on names and arrows are shown."""


def sign_sld(colours: Mapping[str, str], words: Mapping[str, str]) -> str:
    """Signs as dots in the ``colours`` (#rrggbb) of their classes, which ``words`` names."""
    root, rules = _document("signs")
    for name, colour in sorted(colours.items()):
        rule = _rule(rules, clean_text(words[name]))
        _compare(rule, "PropertyIsEqualTo", "class", clean_text(name))
        _mark(rule, "circle", colour, "8")
    near = _rule(rules, "faces", closer=True)
    where = Xml.SubElement(near, "ogc:Filter")
    where = Xml.SubElement(where, "ogc:Not")
    null = Xml.SubElement(where, "ogc:PropertyIsNull")
    Xml.SubElement(null, "ogc:PropertyName").text = "facing_deg"
    arrow, place = _text(near, "14")
    arrow.text = "\N{UPWARDS ARROW}"
    anchor = Xml.SubElement(place, "AnchorPoint")
    # it begins at the sign, about which it turns clockwise
    Xml.SubElement(anchor, "AnchorPointX").text = "0.5"
    Xml.SubElement(anchor, "AnchorPointY").text = "0"
    turn = Xml.SubElement(place, "Rotation")
    Xml.SubElement(turn, "ogc:PropertyName").text = "facing_deg"
    label, _ = _text(_rule(rules, "names", closer=True), "10")
    Xml.SubElement(label, "ogc:PropertyName").text = "name"
    return Xml.tostring(root, encoding="unicode")


def _text(rule: Xml.Element, size: str) -> tuple[Xml.Element, Xml.Element]:
    """The label of a text and its placement, to be filled."""
    text = Xml.SubElement(rule, "TextSymbolizer")
    label, font = Xml.SubElement(text, "Label"), Xml.SubElement(text, "Font")
    Xml.SubElement(font, "CssParameter", name="font-size").text = size
    place = Xml.SubElement(Xml.SubElement(text, "LabelPlacement"), "PointPlacement")
    _fill(text, "#1c2128")
    return label, place


def track_sld(limits: Sequence[float], labels: Sequence[str]) -> str:
    """The path coloured by its horizontal sigma, with the limits between the classes in m."""
    root, rules = _document("trajectory")
    names = list(labels) or ["path"]
    for number, label in enumerate(names):
        rule = _rule(rules, label)
        bounds = [("PropertyIsGreaterThanOrEqualTo", limits[number - 1])] if number else []
        if number < len(limits):
            bounds.append(("PropertyIsLessThan", limits[number]))
        _between(rule, "sd_h_m", bounds)
        colour = round(number * (len(SIGMA_COLOURS) - 1) / max(len(names) - 1, 1))
        _stroke(Xml.SubElement(rule, "LineSymbolizer"), SIGMA_COLOURS[colour], "3")
    return Xml.tostring(root, encoding="unicode")


def ellipse_sld() -> str:
    """The 95 % ellipses: a pale fill with a thin outline."""
    root, rules = _document("ellipses")
    shape = Xml.SubElement(_rule(rules, "95 %"), "PolygonSymbolizer")
    _fill(shape, "#888888", "0.25")
    _stroke(shape, "#444444", "1")
    return Xml.tostring(root, encoding="unicode")


def _document(layer: str) -> tuple[Xml.Element, Xml.Element]:
    root = Xml.Element("StyledLayerDescriptor", _SPACES | {"version": "1.0.0"})
    named = Xml.SubElement(root, "NamedLayer")
    Xml.SubElement(named, "Name").text = layer
    style = Xml.SubElement(named, "UserStyle")
    Xml.SubElement(style, "Name").text = layer
    return root, Xml.SubElement(style, "FeatureTypeStyle")


def _rule(parent: Xml.Element, title: str, closer: bool = False) -> Xml.Element:
    rule = Xml.SubElement(parent, "Rule")
    Xml.SubElement(rule, "Name").text = title
    Xml.SubElement(rule, "Title").text = title
    if closer:
        Xml.SubElement(rule, "MaxScaleDenominator").text = _NEAR
    return rule


def _compare(parent: Xml.Element, how: str, column: str, value: str) -> None:
    where = Xml.SubElement(Xml.SubElement(parent, "ogc:Filter"), f"ogc:{how}")
    Xml.SubElement(where, "ogc:PropertyName").text = column
    Xml.SubElement(where, "ogc:Literal").text = value


def _between(rule: Xml.Element, column: str, bounds: Sequence[tuple[str, float]]) -> None:
    if not bounds:
        return
    where = Xml.SubElement(rule, "ogc:Filter")
    parent = Xml.SubElement(where, "ogc:And") if len(bounds) > 1 else where
    for how, value in bounds:
        one = Xml.SubElement(parent, f"ogc:{how}")
        Xml.SubElement(one, "ogc:PropertyName").text = column
        Xml.SubElement(one, "ogc:Literal").text = f"{value:.6f}"


def _mark(rule: Xml.Element, shape: str, colour: str, size: str) -> Xml.Element:
    graphic = Xml.SubElement(Xml.SubElement(rule, "PointSymbolizer"), "Graphic")
    mark = Xml.SubElement(graphic, "Mark")
    Xml.SubElement(mark, "WellKnownName").text = shape
    _fill(mark, colour)
    _stroke(mark, "#ffffff", "0.5")
    Xml.SubElement(graphic, "Size").text = size
    return graphic


def _fill(parent: Xml.Element, colour: str, opacity: str = "1") -> None:
    fill = Xml.SubElement(parent, "Fill")
    Xml.SubElement(fill, "CssParameter", name="fill").text = colour
    Xml.SubElement(fill, "CssParameter", name="fill-opacity").text = opacity


def _stroke(parent: Xml.Element, colour: str, width: str) -> None:
    stroke = Xml.SubElement(parent, "Stroke")
    Xml.SubElement(stroke, "CssParameter", name="stroke").text = colour
    Xml.SubElement(stroke, "CssParameter", name="stroke-width").text = width
