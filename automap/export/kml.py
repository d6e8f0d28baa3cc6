"""``map.kml``: signs and the timed track as OGC KML 2.2 with Google's gx:Track.

Elements stand in the order of the OGC schema. Altitudes in KML are above mean sea level:
they are absolute when the height of the geoid over the ellipsoid is known, otherwise
everything is clamped to the ground. Nothing refers to the network.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

import numpy as np

from automap.export.clock import iso_texts
from automap.export.fields import SIGN_FIELDS
from automap.export.kml_cells import (
    balloon_cells,
    data_cells,
    html_text,
    plain_values,
    sign_schema,
    xml_text,
)
from automap.export.path import Path, split_at_date_line
from automap.export.sign_columns import SignColumns, ellipse_rings
from automap.records import FloatArray

_RING_POINTS = 24
_POLYGON = (
    "<Polygon><altitudeMode>clampToGround</altitudeMode><outerBoundaryIs><LinearRing>"
    f"<coordinates>{' '.join(['%.7f,%.7f'] * (_RING_POINTS + 1))}</coordinates>"
    "</LinearRing></outerBoundaryIs></Polygon>"
)

CLASS_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#6a3d9a")
"""Colours that colour-blind eyes tell apart (Okabe and Ito), handed to classes in turn."""


def class_colours(names: list[str]) -> dict[str, str]:
    """A colour for each class, by the order of the sorted names."""
    return {
        name: CLASS_COLOURS[i % len(CLASS_COLOURS)] for i, name in enumerate(sorted(set(names)))
    }


def map_kml(
    name: str,
    columns: SignColumns,
    path: Path | None,
    sign_geoid_m: FloatArray | None = None,
    path_geoid_m: FloatArray | None = None,
) -> str:
    """The text of the document ``name``.

    ``sign_geoid_m`` and ``path_geoid_m`` are the heights of the geoid above the ellipsoid at
    the signs and at the points of the path; None or NaN where unknown. Without UTC the path
    is a line without times.
    """
    return "\n".join(_document(name, columns, path, sign_geoid_m, path_geoid_m)) + "\n"


def _document(
    name: str,
    columns: SignColumns,
    path: Path | None,
    sign_geoid: FloatArray | None,
    path_geoid: FloatArray | None,
) -> Iterator[str]:
    colours = class_colours(columns.values["class"])
    style_of = {cls: f"class-{number}" for number, cls in enumerate(colours)}
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield (
        '<kml xmlns="http://www.opengis.net/kml/2.2"'
        ' xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>'
    )
    yield f"<name>{xml_text(name)}</name><open>1</open>"
    yield from _look_at(columns, path)
    for cls, style in style_of.items():
        yield _sign_style(style, colours[cls])
    yield _line_style("track", "#1f6feb", 3)
    yield _line_style("ellipse", "#444444", 1, fill="#888888")
    yield sign_schema()
    yield "<Folder><name>Signs</name><open>0</open>"
    yield from _signs(columns, style_of, sign_geoid)
    yield "</Folder>"
    yield "<Folder><name>95 % ellipses</name><visibility>0</visibility>"
    yield from _ellipses(columns)
    yield "</Folder>"
    if path is not None and len(path):
        yield from _track(path, path_geoid)
    yield "</Document></kml>"


def _look_at(columns: SignColumns, path: Path | None) -> Iterator[str]:
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


def _sign_style(style: str, colour: str) -> str:
    # the balloon shows the description alone: values in it are escaped as HTML
    return (
        f"<Style id={quoteattr(style)}><IconStyle><color>{_colour(colour)}</color>"
        "<scale>0.9</scale></IconStyle><LabelStyle><scale>0.7</scale></LabelStyle>"
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


def _signs(
    columns: SignColumns, style_of: dict[str, str], geoid: FloatArray | None
) -> Iterator[str]:
    plain = plain_values(columns)
    data = _rows([data_cells(*pair) for pair in zip(SIGN_FIELDS, plain, strict=True)])
    cells = _rows([balloon_cells(*pair) for pair in zip(SIGN_FIELDS, plain, strict=True)])
    altitude = _altitude(geoid, columns.height_m).tolist()
    located = columns.located.tolist()
    heads = {name: xml_text(f"<h3>{html_text(name)}</h3><table>") for name in style_of}
    end = xml_text("</table>")
    rows = zip(
        columns.values["id"],
        columns.values["class"],
        columns.lon_deg.tolist(),
        columns.lat_deg.tolist(),
        strict=True,
    )
    for number, (name, class_name, lon, lat) in enumerate(rows):
        point = _point(lon, lat, altitude[number]) if located[number] else ""
        yield (
            f"<Placemark><name>{xml_text(name)}</name><snippet/>"
            f"<description>{heads[class_name]}{cells[number]}{end}</description>"
            f"<styleUrl>#{style_of[class_name]}</styleUrl>"
            f'<ExtendedData><SchemaData schemaUrl="#sign">{data[number]}</SchemaData>'
            f"</ExtendedData>{point}</Placemark>"
        )


def _rows(cells: list[list[str]]) -> list[str]:
    return ["".join(row) for row in zip(*cells, strict=True)]


def _point(lon: float, lat: float, altitude: float) -> str:
    if np.isfinite(altitude):
        return (
            "<Point><altitudeMode>absolute</altitudeMode>"
            f"<coordinates>{lon:.7f},{lat:.7f},{altitude:.2f}</coordinates></Point>"
        )
    return (
        "<Point><altitudeMode>clampToGround</altitudeMode>"
        f"<coordinates>{lon:.7f},{lat:.7f}</coordinates></Point>"
    )


def _ellipses(columns: SignColumns) -> Iterator[str]:
    if len(columns) == 0:
        return
    rings = ellipse_rings(columns, _RING_POINTS)
    drawable = columns.located & np.isfinite(rings).all(axis=(1, 2))
    flat = rings.reshape(len(rings), -1).tolist()
    near_date_line = (np.abs(rings[:, :, 0]).max(axis=1) > 180.0).tolist()
    ids = columns.values["id"]
    for number in np.flatnonzero(drawable).tolist():
        parts = _cut_at_date_line(rings[number]) if near_date_line[number] else [flat[number]]
        polygons = "".join([_POLYGON % tuple(part) for part in parts])
        yield (
            f"<Placemark><name>{xml_text(ids[number])}</name>"
            "<visibility>0</visibility><styleUrl>#ellipse</styleUrl>"
            f"<MultiGeometry>{polygons}</MultiGeometry></Placemark>"
        )


def _cut_at_date_line(ring: FloatArray) -> list[list[float]]:
    # longitudes must stay in -180..180, so a ring on the date line becomes two
    parts = []
    for turn in (-360.0, 0.0, 360.0):
        lon = np.clip(ring[:, 0] + turn, -180.0, 180.0)
        if lon.min() < lon.max():
            parts.append(np.column_stack([lon, ring[:, 1]]).ravel().tolist())
    return parts


def _track(path: Path, geoid: FloatArray | None) -> Iterator[str]:
    altitude = _altitude(geoid, path.height_m)
    absolute = bool(np.isfinite(altitude).all())
    mode = "absolute" if absolute else "clampToGround"
    altitudes = np.where(np.isfinite(altitude), altitude, 0.0) if absolute else 0 * altitude
    altitudes = np.nan_to_num(altitudes)
    head = f"<altitudeMode>{mode}</altitudeMode>"
    yield "<Folder><name>Trajectory</name>"
    if np.isnat(path.utc).any():
        for run in split_at_date_line(path.lon_deg):
            corners = " ".join(
                f"{lon:.7f},{lat:.7f},{alt:.2f}"
                for lon, lat, alt in zip(
                    path.lon_deg[run].tolist(),
                    path.lat_deg[run].tolist(),
                    altitudes[run].tolist(),
                    strict=True,
                )
            )
            yield (
                "<Placemark><name>Track</name><styleUrl>#track</styleUrl><LineString>"
                f"{head}<coordinates>{corners}</coordinates></LineString></Placemark>"
            )
    else:
        yield f"<Placemark><name>Track</name><styleUrl>#track</styleUrl><gx:Track>{head}"
        yield from (f"<when>{when}</when>" for when in iso_texts(path.utc))
        for lon, lat, alt in zip(
            path.lon_deg.tolist(), path.lat_deg.tolist(), altitudes.tolist(), strict=True
        ):
            yield f"<gx:coord>{lon:.7f} {lat:.7f} {alt:.2f}</gx:coord>"
        rpy = np.nan_to_num(path.rpy_deg)
        for roll, pitch, yaw in rpy.tolist():
            # heading, tilt, roll
            yield f"<gx:angles>{yaw % 360.0:.2f} {pitch:.2f} {roll:.2f}</gx:angles>"
        yield "</gx:Track></Placemark>"
    yield "</Folder>"
