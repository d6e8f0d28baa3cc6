"""OpenStreetMap tags of a sign: ``traffic_sign`` by national code or by the common word.

Codes stand after the country, as the wiki's page on ``traffic_sign`` has it: ``AU:R4-1[60]``.
A class without a code in the country gets the human-readable value; one without either
``yes``, which says that there is a sign and not which.
"""

from __future__ import annotations

import math
import re

from automap.signs.national import bare_name, class_entry, national_code, shown_value

_WORDS = {
    "stop": "stop",
    "yield": "give_way",
    "give-way": "give_way",
    "maximum-speed-limit": "maxspeed",
    "speed-limit": "maxspeed",
}
"""For detectors that name their classes otherwise."""
DIRECTION_SD = 11.5
"""Of ``direction``, deg, at most: 95 % of such are within 22.5 deg, so that N is not NE."""


def traffic_sign_tags(class_name: str, country: str | None = None) -> dict[str, str]:
    """Tags of a class, named as Mapillary names it, in a country (ISO 3166 alpha-2)."""
    entry, code = class_entry(class_name), national_code(class_name, country)
    # the wiki knows codes of countries
    if code and not code.startswith("VIENNA:"):
        tags = {"traffic_sign": code}
    elif entry is not None and entry.osm:
        tags = {"traffic_sign": entry.osm}
    elif class_name.startswith("warning--"):
        tags = {"traffic_sign": "hazard"}
    else:
        bare = bare_name(class_name).split("--")[-1]
        tags = {"traffic_sign": _WORDS.get(re.sub(r"-\d+$", "", bare), "yes")}
    shown = shown_value(class_name, country)
    if shown and "end-of-" not in class_name:
        value, unit = shown
        tags["maxspeed"] = f"{value:.0f} mph" if unit == "mph" else f"{value:.0f}"
    return tags


def direction_tag(facing_deg: float, sd_deg: float) -> dict[str, str]:
    """Where the face looks; nothing where that is not known to a cardinal point of eight."""
    if not (math.isfinite(facing_deg) and sd_deg <= DIRECTION_SD):
        return {}
    return {"direction": str(round(float(facing_deg)) % 360)}
