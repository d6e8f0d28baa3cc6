"""Documents of QGIS's own style language, QML, and their parts.

Everything that a style needs is in it; no file, no font and no network is referred to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as Xml

from automap.export.fields import Field

_HEAD = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
_VERSION = "3.22.0"
_CATEGORIES = "Symbology|Labeling|Fields|MapTips|Rendering|Forms"


@dataclass(frozen=True)
class QgisStyle:
    """The default look of one layer; ``qml`` is the document, ``sld`` the same for
    other programs, as far as that goes."""

    layer: str
    qml: str
    description: str
    sld: str = ""


def document(kind: str, attributes: Mapping[str, str]) -> tuple[Xml.Element, Xml.Element]:
    """A document and its renderer of a ``kind`` with further ``attributes``."""
    root = Xml.Element("qgis", version=_VERSION, styleCategories=_CATEGORIES)
    common = {"type": kind, "forceraster": "0", "symbollevels": "0", "enableorderby": "0"}
    renderer = Xml.SubElement(root, "renderer-v2", common | dict(attributes))
    return root, renderer


def range_or_category(
    parent: Xml.Element, tag: str, number: int, label: str, **values: str
) -> None:
    """A part of a renderer, drawn by the symbol of its ``number`` and called ``label``."""
    common = {"render": "true", "symbol": str(number), "label": label}
    Xml.SubElement(parent, tag, common | values)


def name_columns(root: Xml.Element, fields: Sequence[Field], shown_as: str) -> None:
    """Readable names of the columns, with their units, and what stands for a feature in lists."""
    Xml.SubElement(root, "previewExpression").text = shown_as
    aliases = Xml.SubElement(root, "aliases")
    for number, field in enumerate(fields):
        unit = f" ({field.unit})" if field.unit else ""
        alias = field.title + unit
        Xml.SubElement(aliases, "alias", field=field.name, index=str(number), name=alias)


def by_expression(layer: Xml.Element, **properties: str) -> None:
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


def add_symbol(
    parent: Xml.Element, number: int, kind: str, layer_class: str, values: Mapping[str, str]
) -> Xml.Element:
    """The symbol of a ``number``, a marker, line or fill, with its first layer."""
    symbol = Xml.SubElement(
        parent, "symbol", name=str(number), type=kind, alpha="1", clip_to_extent="1", force_rhr="0"
    )
    add_layer(symbol, layer_class, values)
    return symbol


def add_layer(symbol: Xml.Element, layer_class: str, values: Mapping[str, str]) -> Xml.Element:
    """A further layer of a symbol."""
    common = {"class": layer_class, "enabled": "1", "locked": "0", "pass": "0"}
    layer = Xml.SubElement(symbol, "layer", common)
    options = Xml.SubElement(layer, "Option", type="Map")
    for key, value in values.items():
        Xml.SubElement(options, "Option", name=key, type="QString", value=value)
    return layer


def add_labels(root: Xml.Element, attribute: str, scale: int, expression: bool = False) -> None:
    """Labels below the points, of a column or an ``expression``, from a ``scale`` on."""
    labelling = Xml.SubElement(root, "labeling", type="simple")
    settings = Xml.SubElement(labelling, "settings", calloutType="simple")
    style = Xml.SubElement(
        settings, "text-style", fieldName=attribute, fontSize="8", textColor="28,33,40,255",
        isExpression=str(int(expression)), fontSizeUnit="Point",
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


def dot(colour: str, size: str) -> dict[str, str]:
    """A round marker of a colour (#rrggbb) and a size in mm, with a white rim."""
    return {
        "name": "circle",
        "color": rgba(colour),
        "size": size,
        "size_unit": "MM",
        "outline_color": rgba("#ffffff"),
        "outline_width": "0.2",
        "outline_style": "solid",
    }


def rgba(colour: str, alpha: int = 255) -> str:
    """A colour (#rrggbb) as QGIS writes it."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"{red},{green},{blue},{alpha}"


def document_text(root: Xml.Element) -> str:
    """The document as a file or a table holds it."""
    return _HEAD + Xml.tostring(root, encoding="unicode")
