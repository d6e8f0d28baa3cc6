"""Positions out of the messages that have them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from automap.io.epoch_fix_type import Kinds, is_spatial
from automap.io.epoch_source import Epochs, Source, among, select
from automap.records import BoolArray, FixType, FloatArray

_ORDER = (
    "NAV-HPPOSLLH",
    "NAV-PVT",
    "NAV-POSLLH",
    "NAV-SOL",
    "PUBX00",
    "GGA",
    "GNS",
    "RMC",
    "GLL",
)
_SENTENCES = ("PUBX00", "GGA", "GNS", "RMC", "GLL")


@dataclass(frozen=True)
class Positions:
    """Latitude and longitude [n] in rad, ellipsoidal height and geoid separation [n], one
    sigma north and east alike [n] and down [n]."""

    lat: FloatArray
    lon: FloatArray
    height: FloatArray
    separation: FloatArray
    sd_level: FloatArray
    sd_down: FloatArray


@dataclass(frozen=True)
class Place:
    """As :class:`Positions` of some epochs [k]; None for what their message does not give."""

    lat: FloatArray
    lon: FloatArray
    height: FloatArray | None = None
    separation: FloatArray | None = None
    sd_level: FloatArray | None = None
    sd_down: FloatArray | None = None


def positions(
    sources: dict[str, Source], fix: Kinds
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Latitude, longitude (rad), ellipsoidal height, geoid separation [n], sd [n, 3].

    NaN where unknown. ``fix`` [n] loses the fixes that turn out to have no position, or no
    height.
    """
    n = len(fix)
    lat, lon, height, separation = (np.empty(n) for _ in range(4))
    sd = np.empty((n, 3))
    targets = {
        "lat": lat,
        "lon": lon,
        "height": height,
        "separation": separation,
        "sd_level": sd[:, :2],
        "sd_down": sd[:, 2],
    }
    missing = np.ones(n, bool)
    open_ = fix != FixType.NONE
    for name in _ORDER:
        if name not in sources:
            continue
        mask = open_ & sources[name].has
        if not mask.any():
            continue
        epochs = select(mask)
        place = _position(sources[name], epochs)
        good = np.abs(place.lat) <= np.pi / 2
        good &= np.abs(place.lon) <= np.pi
        epochs = among(epochs, good)
        _write(targets, epochs, place, good)
        open_[epochs] = missing[epochs] = False
        if name in ("RMC", "GLL"):
            flat = is_spatial(fix[epochs])
            if flat.any():
                fix[among(epochs, flat)] = FixType.TWO_D
        if name in _SENTENCES and "GST" in sources:
            written = np.zeros(n, bool)
            written[epochs] = True
            _error_statistics(sources["GST"], written, sd)
    if missing.any():
        for target in targets.values():
            target[missing] = np.nan
        fix[missing] = FixType.NONE
    return lat, lon, height, separation, sd


def _write(targets: dict[str, FloatArray], epochs: Epochs, place: Place, good: BoolArray) -> None:
    """Put the ``good`` [k] of a place's values into the targets at ``epochs``."""
    every = bool(good.all())
    for field in fields(place):
        value, target = getattr(place, field.name), targets[field.name]
        if value is None:
            target[epochs] = np.nan
            continue
        value = value if every else value[good]
        target[epochs] = value[:, None] if target.ndim == 2 else value


def _position(source: Source, epochs: Epochs) -> Place:
    def get(field: str) -> FloatArray:
        return source.value(field, epochs)

    name = source.name
    if name == "NAV-SOL":
        import pymap3d

        lat, lon, height = pymap3d.ecef2geodetic(
            get("ecefX"), get("ecefY"), get("ecefZ"), deg=False
        )
        sd = get("pAcc") / np.sqrt(3.0)
        return Place(np.asarray(lat), np.asarray(lon), np.asarray(height), None, sd, sd)
    lat, lon = get("lat"), get("lon")
    if name == "NAV-HPPOSLLH":
        lat, lon = lat + get("latHp"), lon + get("lonHp")
    lat, lon = np.radians(lat), np.radians(lon)
    if name.startswith("NAV-"):
        height, msl = get("height"), get("hMSL")
        if name == "NAV-HPPOSLLH":
            height = height + get("heightHp")
            msl = msl + get("hMSLHp")
            lat[source.counts("flags", epochs) & 1 != 0] = np.nan
        return Place(lat, lon, height, height - msl, get("hAcc") / np.sqrt(2.0), get("vAcc"))
    if name == "PUBX00":
        return Place(lat, lon, get("altRef"), None, get("hAcc") / np.sqrt(2.0), get("vAcc"))
    if name in ("GGA", "GNS"):
        separation = _nearest_known(get("sep"))
        return Place(lat, lon, get("alt") + separation, separation)
    return Place(lat, lon)


def _nearest_known(separation: FloatArray) -> FloatArray:
    """The separation, where missing that of a neighbour; 0 when the log has none at all."""
    finite = np.isfinite(separation)
    if finite.all():
        return separation
    known = np.flatnonzero(finite)
    if len(known) == 0:
        return np.zeros_like(separation)
    before = np.searchsorted(known, np.arange(len(separation)), "right") - 1
    return np.asarray(separation[known[np.maximum(before, 0)]], np.float64)


def _error_statistics(gst: Source, written: BoolArray, sd: FloatArray) -> None:
    """Put the sd of GST into ``sd`` [n, 3] of the epochs ``written`` [n]."""
    mask = written & gst.has
    if not mask.any():
        return
    epochs = select(mask)
    told = np.stack([gst.value(f, epochs) for f in ("stdLat", "stdLong", "stdAlt")], axis=1)
    sd[epochs] = np.where(np.isfinite(told), told, sd[epochs])
