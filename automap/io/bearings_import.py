"""Finished sightings and known positions as other programs write them: CSV with their names."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.csv_columns import CsvColumns, Kind, read_columns
from automap.records import FloatArray

SIGHTING_NAMES: dict[str, tuple[str, ...]] = {
    "lat_deg": ("lat_deg", "lat", "latitude", "camera_lat", "y"),
    "lon_deg": ("lon_deg", "lon", "lng", "long", "longitude", "camera_lon", "x"),
    "bearing_deg": ("bearing_deg", "bearing", "azimuth", "azimuth_deg", "heading"),
    "depth_m": ("depth_m", "depth", "distance", "distance_m", "range", "range_m"),
    "class": ("class", "label", "category", "type"),
    "sd_deg": ("sd_deg", "bearing_sd_deg", "sd"),
}
"""Column of ``bearings.csv`` -> names that it goes by elsewhere, the likeliest first."""

_REQUIRED = ("lat_deg", "lon_deg", "bearing_deg")


def read_foreign_bearings(path: Path) -> tuple[dict[str, np.ndarray], list[str]]:
    """Columns of ``bearings.csv`` [n] from a table with other names, and what was left out.

    Latitude, longitude and bearing are required; a depth that is not positive is NaN. Raises
    InputError when one of them is missing or no row can be used.
    """
    found = {name: _column(path, name) for name in SIGHTING_NAMES}
    missing = [name for name in _REQUIRED if found[name] is None]
    if missing:
        raise InputError(
            f"{path}: no column for {missing[0]}; name it {' or '.join(SIGHTING_NAMES[missing[0]])}"
            " in the first line."
        )
    table = _read(path, {name: foreign for name, foreign in found.items() if foreign})
    columns: dict[str, np.ndarray] = {}
    for name, foreign in found.items():
        if foreign is None:
            continue
        if name == "class":
            values = [str(v) if v is not None else "" for v in table.columns[foreign]]
            columns[name] = np.array(values, np.object_)
        else:
            columns[name] = table.floats(foreign)
    sentences = table.warnings()
    good = _on_earth(columns["lat_deg"], columns["lon_deg"]) & np.isfinite(columns["bearing_deg"])
    if not good.any():
        raise InputError(
            f"{path}: no row has a latitude within 90 deg, a longitude and a bearing; check the "
            "order of the columns."
        )
    if not good.all():
        first = table.line(int(np.flatnonzero(~good)[0]))
        sentences.append(
            f"{path}: {int((~good).sum())} of {len(good)} sightings were left out, the first in "
            f"line {first}: no valid position or bearing."
        )
    columns = {name: values[good] for name, values in columns.items()}
    for name in ("depth_m", "sd_deg"):
        if name in columns:
            columns[name] = np.where(columns[name] > 0.0, columns[name], np.nan)
    return columns, sentences


def read_foreign_points(path: Path) -> tuple[FloatArray, FloatArray]:
    """Latitudes and longitudes [n] in degrees of known positions, from a CSV."""
    names: dict[str, str] = {}
    for name in ("lat_deg", "lon_deg"):
        foreign = _column(path, name)
        if foreign is None:
            raise InputError(
                f"{path}: no column for {name}; name it {' or '.join(SIGHTING_NAMES[name])} in "
                "the first line."
            )
        names[name] = foreign
    table = _read(path, names)
    lat, lon = table.floats(names["lat_deg"]), table.floats(names["lon_deg"])
    good = _on_earth(lat, lon)
    if not good.all():
        line = table.line(int(np.flatnonzero(~good)[0]))
        raise InputError(f"{path}: line {line} is no position; give latitude and longitude.")
    return lat, lon


def _on_earth(lat: FloatArray, lon: FloatArray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(lat) <= 90.0) & (np.abs(lon) <= 360.0))


def _header(path: Path) -> list[str]:
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            line = next((text for text in stream if text.strip()), "")
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); check the path and its rights."
        ) from error
    for delimiter in (",", ";", "\t"):
        if delimiter in line:
            return [name.strip().strip('"').lower() for name in line.split(delimiter)]
    return line.lower().split()


def _column(path: Path, name: str) -> str | None:
    present = _header(path)
    return next((foreign for foreign in SIGHTING_NAMES[name] if foreign in present), None)


def _read(path: Path, names: dict[str, str]) -> CsvColumns:
    kinds: dict[str, Kind] = {
        foreign: "text" if name == "class" else "float" for name, foreign in names.items()
    }
    return read_columns(path, kinds)
