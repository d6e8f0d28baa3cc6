"""A list of signs as some authority keeps it: any table of points, with any names of columns."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io.header_names import role_named, take_apart
from automap.io.inventory_places import read_places
from automap.io.vector_layer import VectorLayer, column_named, numbers, read_layer, texts
from automap.records import FloatArray

ROLES = {
    "id": (
        *("id", "signid", "assetid", "objectid", "zeichenid", "nummer", "nr", "number", "ref"),
        *("lfdnr", "laufendenummer", "inventarnummer", "inventarnr", "schildnr", "standortnr"),
        *("osmid", "fid", "gid", "uuid", "name"),
    ),
    "class": (
        *("class", "trafficsign", "signclass", "signcode", "signtype", "vzkat", "vznr", "vz"),
        *("zeichennummer", "zeichennr", "verkehrszeichen", "zeichen", "mutcd", "mutcdcode", "code"),
        *("vznummer", "vzkatnr", "vzkatnummer", "zeichencode", "vzcode"),
        *("type", "typ", "value", "klasse", "category"),
    ),
    "lat": ("lat", "latitude", "latdeg", "breite", "geogrbreite", "latitudedeg", "breitengrad"),
    "lon": (
        *("lon", "lng", "long", "longitude", "londeg", "laenge", "laengengrad", "longitudedeg"),
        "geogrlaenge",
    ),
    "x": ("x", "easting", "east", "rechtswert", "rw", "ostwert", "e", "xcoord", "koordx", "pointx"),
    "y": (
        "y",
        "northing",
        "north",
        "hochwert",
        "hw",
        "nordwert",
        "n",
        "ycoord",
        "koordy",
        "pointy",
    ),
    "facing": (
        *("facing", "facingdeg", "direction", "bearing", "azimuth", "azimut", "heading"),
        *("richtung", "ausrichtung", "blickrichtung", "orientation", "orientierung"),
    ),
    "sd": ("sd", "sdm", "accuracy", "accuracym", "sigma", "genauigkeit", "precision"),
    "value": ("speed", "speedlimit", "limit", "maxspeed", "wert", "text", "aufschrift", "value"),
    "status": ("status", "assetstatus", "signstatus", "lifecycle", "lifecyclestatus", "zustand"),
}
"""What is read of a list, and names that such columns have, without marks and in lower case."""

_POINTS = (
    *("N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE"),
    *("S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW"),
)
_COMPASS = {name: 22.5 * k for k, name in enumerate(_POINTS)}


_GONE = frozenset(
    [
        *("removed", "decommissioned", "retired", "abandoned", "disposed", "demolished"),
        *("deleted", "inactive", "entfernt", "abgebaut", "demontiert", "stillgelegt"),
        *("gelöscht", "inaktiv"),
    ]
)
_TO_COME = frozenset(("planned", "proposed", "geplant", "vorgesehen"))
"""What a status says of signs that do not stand: its first word; and the only one, since what is
planned for a sign that stands comes after it ("planned replacement")."""
_NUMBER = re.compile(r"(\d+)(?:[.,]0+)?(?:\s*(?:km/?h|kph|mph))?", re.IGNORECASE)


@dataclass(frozen=True)
class InventoryFile:
    """Listed signs [n] as they are told: ``ids``, ``codes`` ("" none), positions in rad (NaN for
    none), ``facing_rad`` and ``sd_m`` (NaN unknown); the names of the columns by role, and of those
    ``unread``; sentences about what is doubtful."""

    ids: list[str]
    codes: list[str]
    lat_rad: FloatArray
    lon_rad: FloatArray
    facing_rad: FloatArray
    sd_m: FloatArray
    columns: dict[str, str]
    unread: tuple[str, ...] = ()
    warnings: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.ids)


def read_inventory(
    path: Path,
    stated: Mapping[str, str] | None = None,
    crs: str | None = None,
    layer: str | None = None,
    near: tuple[FloatArray, FloatArray] | None = None,
) -> InventoryFile:
    """Read the list in ``path``.

    ``stated`` names columns by role (``ROLES``), others are guessed; ``crs`` replaces the file's
    own; ``near`` are latitudes and longitudes (rad) where the signs should be: coordinates that
    only lie there when they are read otherwise (``read_places``) are, with a warning. Entries that
    by their status do not stand are left out. Raises InputError for a list without positions or in
    an unknown coordinate system, ConfigError for an unknown role or column.
    """
    table = read_layer(path, layer)
    columns = _columns(path, table, stated or {})
    warnings: list[str] = []
    table = _standing(path, table, columns, warnings)
    if not len(table):
        raise InputError(f"{path}: holds no entries of signs that stand.")
    lon, lat = read_places(path, table, columns, crs, near, warnings)
    if "class" not in columns:
        have = ", ".join(list(table.columns)[:12]) or "none"
        warnings.append(
            f"{path}: no column says what the signs are (columns: {have}), so classes are not "
            "compared; name one with --columns class=NAME."
        )

    def column(role: str) -> list[str]:
        return texts(table.columns[columns[role]]) if role in columns else [""] * len(table)

    ids, often = column("id"), Counter(column("id"))
    if len(often) < len(ids):
        ids = [
            name if name and often[name] == 1 else f"{name or 'row'}#{k}"
            for k, name in enumerate(ids, start=1)
        ]
        if "id" in columns:
            warnings.append(f"{path}: names of entries repeat; their places are added to them.")
    codes, values = column("class"), column("value")
    blank = codes.count("")
    if blank and "class" in columns:
        warnings.append(
            f"{path}: {columns['class']} is empty in {blank} of {len(table)} entries; they are "
            "compared by their places alone."
        )
    facing = _directions(column("facing"))
    _tell_odd(
        path,
        column("facing"),
        facing,
        warnings,
        "directions of {} entries are neither degrees within 360 nor points of the compass",
    )
    sd = np.full(len(table), np.nan)
    if "sd" in columns:
        sd = numbers(table.columns[columns["sd"]])
        sd[~((sd > 0.0) & np.isfinite(sd))] = np.nan
    _tell_odd(path, column("sd"), sd, warnings, "accuracies of {} entries are no metres above 0")
    return InventoryFile(
        ids,
        [_with_value(code, value) for code, value in zip(codes, values, strict=True)],
        np.radians(lat),
        np.radians(lon),
        np.radians(facing),
        sd,
        columns,
        tuple(name for name in table.columns if name not in columns.values()),
        warnings,
    )


def _columns(path: Path, table: VectorLayer, stated: Mapping[str, str]) -> dict[str, str]:
    for role, name in stated.items():
        if role not in ROLES:
            raise ConfigError(f"--columns: no {role!r}; it takes {', '.join(ROLES)}.")
        if name not in table.columns:
            have = ", ".join(table.columns) or "no columns"
            raise ConfigError(f"--columns {role}={name}: {path} has {have}.")
    columns = dict(stated)
    for role, names in ROLES.items():
        found = column_named(table.columns, names)
        if role not in columns and found is not None and found not in columns.values():
            columns[role] = found
    for name in table.columns if {"lat", "lon"}.isdisjoint(columns) else ():
        # "Latitude (WGS84)", "GPS_LAT", and other languages
        role = (role_named(take_apart(name), "gnss") or ("",))[0]
        if role in ("lat", "lon") and name not in columns.values():
            columns.setdefault(role, name)
    return columns


def _standing(
    path: Path, table: VectorLayer, columns: Mapping[str, str], warnings: list[str]
) -> VectorLayer:
    """The entries of signs that stand, by what their status says."""
    if "status" not in columns:
        return table
    said = texts(table.columns[columns["status"]])
    words = [re.findall(r"[^\W\d_]+", cell.lower()) for cell in said]
    kept = np.array(
        [not w or not (w[0] in _GONE or (len(w) == 1 and w[0] in _TO_COME)) for w in words]
    )
    if kept.all():
        return table
    example = said[int(np.argmin(kept))][:20]
    warnings.append(
        f"{path}: {int((~kept).sum())} of {len(table)} entries do not stand by their "
        f"{columns['status']}, such as {example!r}; they are left out."
    )
    geometry = None if table.geometry is None else table.geometry[kept]
    cells = {name: column[kept] for name, column in table.columns.items()}
    return VectorLayer(geometry, table.crs, cells, int(kept.sum()))


def _tell_odd(
    path: Path, cells: list[str], values: FloatArray, warnings: list[str], what: str
) -> None:
    """Warn of cells that say something of which ``values`` have nothing."""
    odd = [cell for cell, value in zip(cells, values, strict=True) if cell and np.isnan(value)]
    if odd:
        warnings.append(
            f"{path}: {what.format(len(odd))}, such as {odd[0][:20]!r}; they are not used."
        )


def _directions(cells: list[str]) -> FloatArray:
    """Degrees, or points of the compass; NaN for what is neither."""
    result = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        if cell.upper() in _COMPASS:
            result[k] = _COMPASS[cell.upper()]
            continue
        value = numbers(np.array([cell.rstrip("°")], object))[0]
        if abs(value) <= 360.0:
            result[k] = value
    return result


def _with_value(code: str, value: str) -> str:
    """``R4-1`` with 60 in a column of its own is ``R4-1[60]``; one with a number keeps it.
    OpenStreetMap's word for limits stands beside the tag that has the number."""
    number = _NUMBER.fullmatch(value.strip())
    digits = number[1] if number else ""
    if digits and code.strip().lower() == "maxspeed":
        return f"maximum speed limit {digits}"
    bare = code.split(":")[-1].strip().upper().removeprefix("VZ").strip()
    if digits and bare in ("274", "278", "R4-1", "R4-12", "R2-1"):
        return f"{code}[{digits}]"
    return code
