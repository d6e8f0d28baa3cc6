"""Finished sightings, ``bearings.csv``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.csv_columns import Kind, read_columns
from automap.records import Bearings, FloatArray

_REQUIRED: dict[str, Kind] = {"lat_deg": "float", "lon_deg": "float", "bearing_deg": "float"}
_OPTIONAL: dict[str, Kind] = {"depth_m": "float", "class": "text", "sd_deg": "float"}


def read_bearings(path: Path) -> tuple[Bearings, list[str]]:
    """Read ``lat_deg, lon_deg, bearing_deg [, depth_m, class, sd_deg]``.

    Rows without a position or bearing are left out; a depth or sd that is not positive counts
    as unknown. Returns the sightings and sentences on what was left out. Raises InputError
    when the file cannot be used at all.
    """
    table = read_columns(path, _REQUIRED, _OPTIONAL, may_be_empty=True)
    sentences = table.warnings()
    lat, lon = table.floats("lat_deg"), table.floats("lon_deg")
    bearing = table.floats("bearing_deg")
    with np.errstate(invalid="ignore"):
        good = (np.abs(lat) <= 90.0) & (np.abs(lon) <= 360.0) & np.isfinite(bearing)
    if len(good) and not good.any():
        raise InputError(
            f"{path}: no row has a latitude within 90 deg, a longitude and a bearing; "
            "check the order of the columns."
        )
    if not good.all():
        n = int((~good).sum())
        sentences.append(
            f"{path}: {n} of {len(good)} sightings were left out, the first in line "
            f"{table.line(int(np.flatnonzero(~good)[0]))}: no valid position or bearing."
        )
    names = table.columns.get("class", np.full(len(table), "", np.object_))
    names = np.array([str(n) if n is not None else "" for n in names], np.object_)

    def positive(name: str) -> FloatArray:
        values = table.floats(name)[good]
        with np.errstate(invalid="ignore"):
            return np.where((values > 0.0) & np.isfinite(values), values, np.nan)

    return (
        Bearings(
            lat_rad=np.radians(lat[good]),
            lon_rad=np.radians(lon[good]),
            bearing_rad=np.radians(bearing[good]),
            depth_m=positive("depth_m"),
            class_name=names[good],
            sd_rad=np.radians(positive("sd_deg")),
        ),
        sentences,
    )
