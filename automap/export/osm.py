"""Signs as a file for review in JOSM: new nodes that no program uploads by itself.

``upload="false"`` on the file makes JOSM refuse an upload without a deliberate confirmation;
the note for the reviewer stands in ``fixme``. AutoMap never contacts OpenStreetMap.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

import numpy as np

from automap import __version__
from automap.export.beliefs import belief_text
from automap.export.icons import sign_words
from automap.export.kml_cells import clean_text
from automap.export.osm_tags import direction_tag, traffic_sign_tags
from automap.export.sign_columns import SignColumns

LONGEST = 255
"""Characters that OpenStreetMap allows in a key or a value."""


def josm_file(columns: SignColumns, country: str | None = None) -> str:
    """The text of the file; signs without a position are left out, for a node must have one."""
    return "\n".join(_document(columns, country)) + "\n"


def _document(columns: SignColumns, country: str | None) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield f'<osm version="0.6" generator="AutoMap {__version__}" upload="false">'
    rows = np.flatnonzero(columns.located).tolist()
    for number, row in enumerate(rows, start=1):
        lat, lon = float(columns.lat_deg[row]), float(columns.lon_deg[row])
        yield f'  <node id="-{number}" visible="true" lat="{lat:.7f}" lon="{lon:.7f}">'
        for key, value in sign_tags(columns, row, country).items():
            text = clean_text(value).encode("utf-8", "replace").decode()
            yield f"    <tag k={quoteattr(key)} v={quoteattr(text[:LONGEST])}/>"
        yield "  </node>"
    yield "</osm>"


def sign_tags(columns: SignColumns, row: int, country: str | None = None) -> dict[str, str]:
    """The tags of one sign: what it says, where it looks, its side, and what to check."""
    values = columns.values
    tags = traffic_sign_tags(values["class"][row], country)
    tags |= direction_tag(values["facing_deg"][row], values["facing_sd_deg"][row])
    if values["side"][row] in ("left", "right"):
        tags["side"] = values["side"][row]
    last = values["last_seen"][row]
    if columns.utc_known and last:
        tags["survey:date"] = str(last)[:10]
    tags["source"] = "AutoMap"
    if values["note"][row]:
        tags["note"] = values["note"][row]
    # what a person has looked at needs no second look
    if values["status"][row] not in ("accepted", "corrected", "added"):
        tags["fixme"] = _review(columns, row, coded=tags.get("traffic_sign") != "yes")
    return tags


def _review(columns: SignColumns, row: int, coded: bool) -> str:
    values = columns.values
    kind, apart, _ = values["class"][row].partition("--")
    words = sign_words(values["class"][row]) or "sign"
    # where no code tells it: a roundabout is warned of, and ordered
    parts = [f"check: {words}" + (f" ({kind})" if apart and not coded else "")]
    confidence, radius = float(values["confidence"][row]), float(values["ce95_m"][row])
    if np.isfinite(confidence):
        parts.append(f"confidence {belief_text(confidence)}")
    if np.isfinite(radius):
        parts.append(f"95 % within {radius:.1f} m")
    on_road = values.get("road_id")
    if on_road is not None and on_road[row]:
        parts.append(f"{values['road_direction'][row]} on {on_road[row]}")
        if values["road_check"][row]:
            parts.append(values["road_check"][row])
    if values["status"][row] not in ("ok", ""):
        parts.append(f"status {values['status'][row]}")
    parts.append(f"AutoMap sign {values['id'][row]}")
    return ", ".join(parts)
