"""The sign classes that the classifier names: groups, usual sizes, codes, countries."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files

# countries whose signs follow the Vienna Convention closely enough that the German set serves
_LIKE_GERMANY = frozenset(
    {
        "AD",
        "AL",
        "AT",
        "BA",
        "BE",
        "BG",
        "BY",
        "CH",
        "CY",
        "CZ",
        "DE",
        "DK",
        "EE",
        "ES",
        "FI",
        "FR",
        "GB",
        "GR",
        "HR",
        "HU",
        "IE",
        "IS",
        "IT",
        "LI",
        "LT",
        "LU",
        "LV",
        "MC",
        "MD",
        "ME",
        "MK",
        "MT",
        "NL",
        "NO",
        "PL",
        "PT",
        "RO",
        "RS",
        "RU",
        "SE",
        "SI",
        "SK",
        "SM",
        "TR",
        "UA",
        "VA",
        "XK",
    }
)
_LIKE_AUSTRALIA = frozenset({"AU", "NZ", "PG", "FJ"})


@dataclass(frozen=True)
class ClassEntry:
    """One class: Mapillary ``name``, ``group`` of shape and colour, usual width ``size_m``.

    ``codes``: national codes by country; ``gtsdb``: its number in the German benchmarks;
    ``osm``: the readable value of OpenStreetMap's ``traffic_sign``; ``art``: drawings of it.
    """

    name: str
    group: str
    size_m: float
    art: tuple[str, ...]
    gtsdb: int | None = None
    osm: str | None = None
    codes: Mapping[str, str] = field(default_factory=dict)


@cache
def load_classes() -> dict[str, ClassEntry]:
    """All classes by name, in the order of the table."""
    text = files("automap.signs").joinpath("data/classes.toml").read_text(encoding="utf-8")
    rows = tomllib.loads(text)["class"]
    entries = [ClassEntry(**{**row, "art": tuple(row["art"])}) for row in rows]
    return {entry.name: entry for entry in entries}


@cache
def country_set(country: str | None) -> frozenset[str]:
    """Names of the classes that occur in a country (ISO 3166 alpha-2).

    All of them for a country without a set of its own, or none given.
    """
    classes = load_classes()
    code = (country or "").upper()
    table = "AU" if code in _LIKE_AUSTRALIA else "DE" if code in _LIKE_GERMANY else None
    if table is None:
        return frozenset(classes)
    return frozenset(name for name, entry in classes.items() if table in entry.codes)


def national_code(name: str, country: str) -> str | None:
    """The code of a class in a country's own catalogue, such as ``R4-1[60]``; None if unknown."""
    entry = load_classes().get(name)
    return None if entry is None else entry.codes.get(country.upper())
