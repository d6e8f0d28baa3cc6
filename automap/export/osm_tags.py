"""OpenStreetMap tags of a sign: ``traffic_sign`` by national code or by the common word.

Codes stand after the country, as the wiki's page on ``traffic_sign`` has it: ``AU:R4-1[60]``.
A class without a code in the country gets the human-readable value; one without either
``yes``, which says that there is a sign and not which.
"""

from __future__ import annotations

import re

from automap.signs.classes import ClassEntry, load_classes

_WORDS = {
    "stop": "stop",
    "yield": "give_way",
    "give-way": "give_way",
    "maximum-speed-limit": "maxspeed",
    "speed-limit": "maxspeed",
}
"""For detectors that name their classes otherwise."""

_LIMIT = re.compile(r"(?:regulatory--)?(?:maximum-)?speed-limit-(\d{1,3})(?:--g\d+)?")
_MILES = ("US", "GB", "LR", "MM")


def traffic_sign_tags(class_name: str, country: str | None = None) -> dict[str, str]:
    """Tags of a class, named as Mapillary names it, in a country (ISO 3166 alpha-2)."""
    country = country.upper() if country and re.fullmatch("[A-Za-z]{2}", country) else ""
    entry = _entry(class_name)
    code = entry.codes.get(country) if entry is not None else None
    if code:
        tags = {"traffic_sign": f"{country}:{code}"}
    elif entry is not None and entry.osm:
        tags = {"traffic_sign": entry.osm}
    elif class_name.startswith("warning--"):
        tags = {"traffic_sign": "hazard"}
    else:
        bare = _bare(class_name).split("--")[-1]
        tags = {"traffic_sign": _WORDS.get(re.sub(r"-\d+$", "", bare), "yes")}
    limit = _LIMIT.fullmatch(class_name)
    if limit:
        tags["maxspeed"] = f"{limit[1]} mph" if country in _MILES else limit[1]
    return tags


def _bare(class_name: str) -> str:
    return re.sub(r"--g\d+$", "", class_name)


def _entry(class_name: str) -> ClassEntry | None:
    """The class of the table, or a variant of the same face (g1, g2 ...)."""
    classes = load_classes()
    if class_name in classes:
        return classes[class_name]
    bare = _bare(class_name)
    return next((entry for name, entry in classes.items() if _bare(name) == bare), None)
