"""What a class is called in a country, and the number that its face shows."""

from __future__ import annotations

import re

from automap.signs.classes import ClassEntry, load_classes
from automap.signs.codes import LIMITS, OTHER_CODES, SIDES
from automap.signs.vocabulary import load_vocabulary

_LIMIT = re.compile(r"(?:regulatory--)?(?:end-of-)?(?:maximum-)?speed-limit-(\d{1,3})(?:--\w+)?")
_MILES = ("US", "GB", "LR", "MM")
"""Countries whose signs give speeds in miles an hour."""


def country_code(country: str | None) -> str:
    """A country as ISO 3166 alpha-2 in capitals; nothing for what is none."""
    return country.upper() if country and re.fullmatch("[A-Za-z]{2}", country) else ""


def class_entry(class_name: str) -> ClassEntry | None:
    """The class of the table, or a variant of the same face (g1, g2 ...)."""
    classes = load_classes()
    if class_name in classes:
        return classes[class_name]
    bare = bare_name(class_name)
    return next((entry for name, entry in classes.items() if bare_name(name) == bare), None)


def is_known_class(class_name: str) -> bool:
    """Whether it is a class of the package's, in full or its middle part."""
    middles = {full.split("--")[1] for full in load_classes() if "--" in full}
    known = class_name in middles or class_name in load_vocabulary().classes
    return known or class_entry(class_name) is not None


def bare_name(class_name: str) -> str:
    """A class without the number of its variant."""
    return re.sub(r"--g\d+$", "", class_name)


def national_code(class_name: str, country: str | None) -> str | None:
    """The code of a class in a country after the country's, ``AU:R4-1[60]``; where the country has
    none that is known, that of the Vienna Convention, ``VIENNA:C14[60]``; None without one."""
    place, entry = country_code(country), class_entry(class_name)
    if entry is None or not place:
        return None
    if place in entry.codes:
        return f"{place}:{entry.codes[place]}"
    limit = _LIMIT.fullmatch(entry.name)
    for where in (place, "VIENNA"):
        if where in LIMITS and limit and "end-of-" not in entry.name:
            return f"{where}:{LIMITS[where]}[{limit[1]}]"
        own = (code for code, name in OTHER_CODES.get(where, {}).items() if name == entry.name)
        code = next(own, SIDES.get(entry.name) if where == "VIENNA" else None)
        if code:
            return f"{where}:{code}"
    return None


def shown_value(class_name: str, country: str | None) -> tuple[float, str] | None:
    """The number on a face and its unit, "km/h" or "mph" by the country; None without one."""
    limit = _LIMIT.fullmatch(class_name)
    if limit is None:
        return None
    return float(limit[1]), "mph" if country_code(country) in _MILES else "km/h"
