"""The signs' 95 % ellipses as polygons of a KML document."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from automap.earth import MEAN_RADIUS
from automap.export.kml_cells import Pieces, name_column, xml_text
from automap.export.pieces import TextPiece
from automap.export.sign_columns import SignPiece, Signs, ellipse_rings
from automap.export.text_columns import line_chunks, ring_column
from automap.records import BoolArray, FloatArray

_RING_POINTS = 20
_ELLIPSE_HEAD = "<Placemark><name>"
_ELLIPSE_STYLE = "</name><visibility>0</visibility><styleUrl>#ellipse</styleUrl><MultiGeometry>"
_POLYGON_HEAD = (
    "<Polygon><altitudeMode>clampToGround</altitudeMode><outerBoundaryIs><LinearRing><coordinates>"
)
_POLYGON_END = "</coordinates></LinearRing></outerBoundaryIs></Polygon>"


def ellipse_texts(signs: Signs) -> Iterator[bytes | TextPiece]:
    """The 95 % ellipses of the signs; those that the date line cuts come last."""
    cut: list[str] = []
    far = _far_from_date_line(signs)
    for piece in signs.pieces():
        # what is added to ``cut`` would be lost with a piece that is taken over
        whole = far[piece.start : piece.stop].all()
        key = f"{piece.key} ellipses" if piece.key and whole else ""
        yield TextPiece(key, partial(_whole_ellipses, piece, cut))
    if cut:
        yield "".join(cut).encode("utf-8", "replace")


def _far_from_date_line(signs: Signs) -> BoolArray:
    """Which signs [n] are so far from it that their ellipses surely do not meet it."""
    with np.errstate(all="ignore"):
        # a half axis is at most 1.25 radii, and the Earth no sphere; what is not known is not drawn
        wide = 1.4 * np.degrees(signs.radii_m() / MEAN_RADIUS) / np.cos(np.radians(signs.lat_deg))
        return ~np.asarray(np.abs(signs.lon_deg) + np.abs(wide) >= 180.0, np.bool_)


def _whole_ellipses(piece: SignPiece, cut: list[str]) -> Iterator[memoryview]:
    """Those in one piece; texts of the others are added to ``cut``."""
    columns = piece.columns()
    rings = ellipse_rings(columns, _RING_POINTS)
    drawable = columns.located & np.isfinite(rings).all(axis=(1, 2))
    split = drawable & (np.abs(rings[:, :, 0]).max(axis=1) > 180.0)
    whole = np.flatnonzero(drawable & ~split)
    ids = columns.values["id"]
    pieces: Pieces = [
        _ELLIPSE_HEAD,
        name_column([ids[row] for row in whole.tolist()]),
        _ELLIPSE_STYLE + _POLYGON_HEAD,
        ring_column(rings[whole]),
        _POLYGON_END + "</MultiGeometry></Placemark>\n",
    ]
    for row in np.flatnonzero(split).tolist():
        parts = ring_column(np.stack(_cut_at_date_line(rings[row]))).texts()
        polygons = "".join(f"{_POLYGON_HEAD}{part}{_POLYGON_END}" for part in parts)
        cut.append(
            f"{_ELLIPSE_HEAD}{xml_text(ids[row])}{_ELLIPSE_STYLE}{polygons}"
            "</MultiGeometry></Placemark>\n"
        )
    yield from line_chunks(pieces, len(whole))


def _cut_at_date_line(ring: FloatArray) -> list[FloatArray]:
    # longitudes must stay in -180..180, so a ring on the date line becomes two
    parts = []
    for turn in (-360.0, 0.0, 360.0):
        lon = np.clip(ring[:, 0] + turn, -180.0, 180.0)
        if lon.min() < lon.max():
            parts.append(np.column_stack([lon, ring[:, 1]]))
    return parts
