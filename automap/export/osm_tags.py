"""OpenStreetMap tags of a sign: ``traffic_sign`` by national code or by the common word.

Codes stand after the country, as the wiki's page on ``traffic_sign`` has it, a value in
brackets: ``AU:R4-1[60]``. A class without a code in the country gets the human-readable value;
one without either ``yes``, which says that there is a sign and not which.
"""

from __future__ import annotations

import re

_WORDS = {
    "stop": "stop",
    "yield": "give_way",
    "give-way": "give_way",
    "no-entry": "no_entry",
    "do-not-enter": "no_entry",
    "maximum-speed-limit": "maxspeed",
    "speed-limit": "maxspeed",
    "no-overtaking": "overtaking",
    "end-of-city": "city_limit",
    "city-limit": "city_limit",
    "maximum-height-limit": "maxheight",
    "maximum-weight-limit": "maxweight",
    "maximum-width-limit": "maxwidth",
}

_CODES: dict[str, dict[str, str]] = {
    # AS 1742.1
    "AU": {
        "stop": "R1-1",
        "yield": "R1-2",
        "give-way": "R1-2",
        "roundabout": "R1-3",
        "no-entry": "R2-4",
        "keep-left": "R2-3(L)",
        "keep-right": "R2-3(R)",
        "maximum-speed-limit": "R4-1[{}]",
        "speed-limit": "R4-1[{}]",
        "warning roundabout": "W2-7",
        "warning curve-left": "W1-3(L)",
        "warning curve-right": "W1-3(R)",
        "warning traffic-signals": "W3-3",
        "warning pedestrians-crossing": "W6-1",
        "warning children": "W6-3",
        "warning road-bump": "W5-10",
    },
    # the catalogue of the StVO
    "DE": {
        "stop": "206",
        "yield": "205",
        "give-way": "205",
        "priority-road": "306",
        "roundabout": "215",
        "no-entry": "267",
        "keep-left": "222-10",
        "keep-right": "222-20",
        "go-straight": "209-30",
        "maximum-speed-limit": "274[{}]",
        "speed-limit": "274[{}]",
        "no-overtaking": "276",
        "warning curve-left": "103-10",
        "warning curve-right": "103-20",
        "warning traffic-signals": "131",
        "warning pedestrians-crossing": "133-10",
        "warning children": "136-10",
        "warning road-bump": "112",
        "parking": "314",
        "pedestrians-crossing": "350",
    },
    # MUTCD
    "US": {
        "stop": "R1-1",
        "yield": "R1-2",
        "no-entry": "R5-1",
        "do-not-enter": "R5-1",
        "keep-right": "R4-7",
        "keep-left": "R4-8",
        "maximum-speed-limit": "R2-1[{}]",
        "speed-limit": "R2-1[{}]",
        "warning curve-left": "W1-2L",
        "warning curve-right": "W1-2R",
        "warning traffic-signals": "W3-3",
        "warning pedestrians-crossing": "W11-2",
    },
}

_MILES = ("US", "GB", "LR", "MM")


def traffic_sign_tags(class_name: str, country: str | None = None) -> dict[str, str]:
    """Tags of a class, named as Mapillary names it, in a country (ISO 3166 alpha-2)."""
    kind, bare, number = _parts(class_name)
    country = country.upper() if country and re.fullmatch("[A-Za-z]{2}", country) else ""
    codes = _CODES.get(country, {})
    code = codes.get(f"{kind} {bare}") or (codes.get(bare) if kind != "warning" else None)
    tags: dict[str, str] = {}
    if code and ("{}" not in code or number):
        tags["traffic_sign"] = f"{country}:{code.format(number)}"
    elif kind != "warning" and bare in _WORDS:
        tags["traffic_sign"] = _WORDS[bare]
    elif kind == "warning":
        tags["traffic_sign"] = "hazard"
    else:
        tags["traffic_sign"] = "yes"
    if bare in ("maximum-speed-limit", "speed-limit") and number:
        tags["maxspeed"] = f"{number} mph" if country in _MILES else number
    return tags


def _parts(class_name: str) -> tuple[str, str, str]:
    """Kind, name without number, and number of a class."""
    parts = [part for part in class_name.split("--") if not re.fullmatch(r"g\d+", part)]
    kind, bare = (parts[0], parts[1]) if len(parts) > 1 else ("", parts[0] if parts else "")
    match = re.fullmatch(r"(.*?)-?(\d{1,3})", bare)
    return (kind, match[1], match[2]) if match else (kind, bare, "")
