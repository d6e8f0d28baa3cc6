"""``map.kml``: signs and the timed track as OGC KML 2.2 with Google's gx:Track.

Elements stand in the order of the OGC schema. Altitudes in KML are above mean sea level:
they are absolute when the height of the geoid over the ellipsoid is known, otherwise
everything is clamped to the ground. Nothing refers to the network.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from automap.export.icons import sign_words
from automap.export.kml_cells import (
    Pieces,
    balloon_cells,
    data_cells,
    field_cells,
    html_text,
    lineage_data,
    name_column,
    sign_schema,
    xml_text,
)
from automap.export.kml_ellipses import ellipse_texts
from automap.export.kml_track import SIGMA_COLOURS, TRACK_SCHEMA, track_elements
from automap.export.path import Path
from automap.export.pieces import Text, TextPiece, flat
from automap.export.sign_columns import SignColumns, SignPiece, Signs
from automap.export.text_columns import (
    TextColumn,
    constant,
    fixed_column,
    line_chunks,
    text_column,
)
from automap.records import FloatArray

CLASS_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#6a3d9a")
"""Colours that colour-blind eyes tell apart (Okabe and Ito), handed to classes in turn."""


def class_colours(names: Iterable[str]) -> dict[str, str]:
    """A colour for each class, by the order of the sorted names."""
    return {
        name: CLASS_COLOURS[i % len(CLASS_COLOURS)] for i, name in enumerate(sorted(set(names)))
    }


@dataclass(frozen=True)
class KmlOptions:
    """What a document has beside signs and path.

    ``sign_geoid_m`` and ``path_geoid_m`` are the heights of the geoid above the ellipsoid at
    the signs and at the points of the path; None or NaN where unknown. ``icons`` are pictures
    of classes and ``pictures`` those of signs (by number), as paths within the KMZ archive.
    ``clamp_signs`` puts the signs on the ground even where their altitude is known; ``typed`` gives
    their fields the types of a schema; ``keyed`` names the pieces of tracks.
    """

    sign_geoid_m: FloatArray | None = None
    path_geoid_m: FloatArray | None = None
    lineage: Mapping[str, Any] = field(default_factory=dict)
    icons: Mapping[str, str] = field(default_factory=dict)
    pictures: Mapping[int, Sequence[str]] = field(default_factory=dict)
    clamp_signs: bool = False
    typed: bool = True
    keyed: bool = False


def map_kml(
    name: str,
    columns: Signs,
    path: Path | None,
    sign_geoid_m: FloatArray | None = None,
    path_geoid_m: FloatArray | None = None,
) -> str:
    """The text of the document ``name``; the geoid's heights as in ``KmlOptions``.

    Without UTC the path is a line without times.
    """
    return kml_bytes(name, columns, path, KmlOptions(sign_geoid_m, path_geoid_m)).decode()


def kml_bytes(name: str, columns: Signs, path: Path | None, options: KmlOptions) -> bytes:
    """The document as UTF-8."""
    return b"".join(flat(kml_texts(name, columns, path, options)))


def kml_texts(name: str, columns: Signs, path: Path | None, options: KmlOptions) -> Iterator[Text]:
    """The same in parts, to be written one after another."""
    for part in _document(name, columns, path, options):
        yield f"{part}\n".encode("utf-8", "replace") if isinstance(part, str) else part


def _document(
    name: str, columns: Signs, path: Path | None, options: KmlOptions
) -> Iterator[str | Text]:
    colours = class_colours(columns.classes)
    style_of = {cls: f"class-{number}" for number, cls in enumerate(colours)}
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield (
        '<kml xmlns="http://www.opengis.net/kml/2.2"'
        ' xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>'
    )
    yield f"<name>{xml_text(name)}</name><open>1</open>"
    yield from _look_at(columns, path)
    for cls, style in style_of.items():
        yield _sign_style(style, colours[cls], options.icons.get(cls))
    yield _line_style("track", "#1f6feb", 3)
    yield _line_style("ellipse", "#444444", 1, fill="#888888")
    for number, colour in enumerate(SIGMA_COLOURS):
        yield _line_style(f"sigma-{number}", colour, 6)
    yield lineage_data(options.lineage)
    if options.typed:
        yield sign_schema(columns.fields)
    yield TRACK_SCHEMA
    yield "<Folder><name>Signs</name><open>0</open>"
    yield from _signs(columns, style_of, options)
    yield "</Folder>"
    yield "<Folder><name>95 % ellipses</name><visibility>0</visibility>"
    yield from ellipse_texts(columns)
    yield "</Folder>"
    if path is not None and len(path):
        altitude = _altitude(options.path_geoid_m, path.height_m)
        yield from track_elements(path, altitude, options.keyed)
    yield "</Document></kml>"


def _look_at(columns: Signs, path: Path | None) -> Iterator[str]:
    if path is not None and len(path):
        lon, lat = path.lon_deg, path.lat_deg
    else:
        lon, lat = columns.lon_deg[columns.located], columns.lat_deg[columns.located]
    if len(lon) == 0:
        return
    turned = np.mod(lon - lon[0] + 180.0, 360.0) - 180.0
    middle = float(lon[0] + 0.5 * (turned.min() + turned.max()))
    middle = (middle + 180.0) % 360.0 - 180.0
    height = float(lat.max() - lat.min())
    width = float(turned.max() - turned.min()) * float(np.cos(np.radians(lat.mean())))
    reach = max(300.0, 111_000.0 * max(height, width) * 1.5)
    yield (
        f"<LookAt><longitude>{middle:.7f}</longitude>"
        f"<latitude>{0.5 * float(lat.min() + lat.max()):.7f}</latitude><altitude>0</altitude>"
        f"<heading>0</heading><tilt>0</tilt><range>{reach:.0f}</range></LookAt>"
    )


def _colour(rgb: str, alpha: str = "ff") -> str:
    """``#rrggbb`` in KML's order, alpha, blue, green, red."""
    return alpha + rgb[5:7] + rgb[3:5] + rgb[1:3]


def _sign_style(style: str, colour: str, icon: str | None) -> str:
    # the balloon shows the description alone: values in it are escaped as HTML
    look = (
        f"<color>{_colour(colour)}</color><scale>0.9</scale>"
        if icon is None
        else f"<scale>0.9</scale><Icon><href>{xml_text(icon)}</href></Icon>"
    )
    return (
        f"<Style id={quoteattr(style)}><IconStyle>{look}</IconStyle>"
        "<LabelStyle><scale>0.7</scale></LabelStyle>"
        "<BalloonStyle><text>$[description]</text></BalloonStyle></Style>"
    )


def _line_style(style: str, colour: str, width: int, fill: str | None = None) -> str:
    polygon = "" if fill is None else f"<PolyStyle><color>{_colour(fill, '40')}</color></PolyStyle>"
    return (
        f'<Style id="{style}"><LineStyle><color>{_colour(colour)}</color>'
        f"<width>{width}</width></LineStyle>{polygon}</Style>"
    )


def _altitude(geoid: FloatArray | None, height: FloatArray) -> FloatArray:
    if geoid is None:
        return np.full(len(height), np.nan)
    return np.asarray(height - geoid, np.float64)


def _signs(signs: Signs, style_of: dict[str, str], options: KmlOptions) -> Iterator[TextPiece]:
    told = hashlib.sha256(repr((style_of, options.typed, options.clamp_signs)).encode())
    for piece in signs.pieces():
        own = told.copy()
        if options.sign_geoid_m is not None:
            own.update(options.sign_geoid_m[piece.start : piece.stop].tobytes())
        kept = piece.key and not options.pictures
        key = f"{piece.key} {own.hexdigest()[:16]}" if kept else ""
        yield TextPiece(key, partial(_sign_text, piece, style_of, options))


def _sign_text(
    piece: SignPiece, style_of: dict[str, str], options: KmlOptions
) -> Iterator[memoryview]:
    columns = piece.columns()
    yield from line_chunks(_placemarks(columns, style_of, options, piece.start), len(columns))


def _placemarks(
    columns: SignColumns, style_of: dict[str, str], options: KmlOptions, start: int
) -> Pieces:
    """Those of a part that begins with the sign number ``start``."""
    geoid = options.sign_geoid_m
    geoid = None if geoid is None else geoid[start : start + len(columns)]
    classes = columns.values["class"]
    cells = field_cells(columns)
    return [
        "<Placemark><name>",
        name_column(columns.values["id"]),
        "</name><snippet/><description><![CDATA[<h3>",
        text_column(classes, lambda cls: html_text(sign_words(cls))),
        "</h3>",
        _pictures(range(start, start + len(columns)), options),
        "<table>",
        *balloon_cells(cells),
        "</table>]]></description><styleUrl>#",
        text_column(classes, lambda cls: style_of[cls]),
        "</styleUrl><ExtendedData>",
        *data_cells(cells, options.typed),
        "</ExtendedData>",
        *_points(columns, _altitude(geoid, columns.height_m), options.clamp_signs),
        "</Placemark>\n",
    ]


def _pictures(rows: range, options: KmlOptions) -> str | TextColumn:
    if not options.pictures:
        return ""
    hrefs = [tuple(options.pictures.get(row, ())) for row in rows]
    return text_column(hrefs, lambda own: "".join(f'<img src="{html_text(h)}"/> ' for h in own))


def _points(columns: SignColumns, altitude: FloatArray, clamp: bool) -> Pieces:
    n = len(columns)
    there = columns.located
    high = there & np.isfinite(altitude)
    mode = constant("absolute", n).where(high & (not clamp))
    ground = constant("clampToGround", n).where(there & ~(high & (not clamp)))
    return [
        constant("<Point><altitudeMode>", n).where(there),
        mode,
        ground,
        constant("</altitudeMode><coordinates>", n).where(there),
        fixed_column(columns.lon_deg, 7).where(there),
        constant(",", n).where(there),
        fixed_column(columns.lat_deg, 7).where(there),
        constant(",", n).where(high),
        fixed_column(altitude, 2).where(high),
        constant("</coordinates></Point>", n).where(there),
    ]
