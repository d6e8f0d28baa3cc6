"""Coordinates in another datum than the receiver's, at the epoch of the recording.

Satellite positions are in a frame that moves over the continents: WGS 84 as broadcast, which is
the ITRF of its day within centimetres. A national datum moves with its plate (Australia 7 cm a
year), so the epoch of the coordinates belongs to the transformation. PROJ knows the published
operations; what is refused here is its habit of taking "no shift at all, good to 3 m" for one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from automap.earth import MEAN_RADIUS
from automap.errors import ConfigError, InputError
from automap.export.operations import area_missed, find_crs, route
from automap.records import FloatArray
from automap.timebase import gps_to_unix

WGS84 = "WGS84"
WGS84_3D = "EPSG:4979"

EPOCH_SLACK_YEARS = 0.5
YEARS = (1980.0, 2100.0)

_KNOWN = {
    "GDA2020": "EPSG:7843",
    "GDA94": "EPSG:4939",
    "ETRS89": "EPSG:4937",
    "ETRF2000": "EPSG:7931",
    "ETRF2014": "EPSG:8403",
    "ETRF2020": "EPSG:10571",
    "NAD83(2011)": "EPSG:6319",
    "NAD83(CSRS)": "EPSG:4955",
    "NZGD2000": "EPSG:4959",
    "SIRGAS2000": "EPSG:4989",
    "JGD2011": "EPSG:6667",
    "ITRF2008": "EPSG:7911",
    "ITRF2014": "EPSG:7912",
    "ITRF2020": "EPSG:9989",
    "WGS84(G1762)": "EPSG:7665",
    "WGS84(G2139)": "EPSG:9754",
}
"""Datums by the names people use; every other one by its EPSG code."""

_REALISATIONS = ((2024.02, "EPSG:9989"), (2021.01, "EPSG:7912"), (0.0, "EPSG:7911"))
"""First year, and the ITRF that the broadcast WGS 84 was aligned to from then on (G2296 to
ITRF2020, G2139 to ITRF2014, G1674 and G1762 to ITRF2008); NGA's notices of realisation."""


@dataclass(frozen=True)
class Datum:
    """A datum as asked for: its ``name``, ``code`` for PROJ, and the ``epoch`` of the recorded
    coordinates in years where one was given."""

    name: str
    code: str
    epoch: float | None = None

    @property
    def is_native(self) -> bool:
        """Whether it is the receiver's own, so that nothing changes."""
        return self.code == WGS84_3D


@dataclass(frozen=True)
class InDatum:
    """Coordinates [n] in ``datum``: degrees, and metres above its ellipsoid.

    ``operation`` and ``accuracy_m`` as PROJ names them (NaN unknown), ``epoch`` of the recorded
    coordinates, ``largest_shift_m`` in plan between the datums, ``warnings`` sentences.
    """

    datum: Datum
    lon_deg: FloatArray
    lat_deg: FloatArray
    height_m: FloatArray
    epoch: float
    operation: str
    accuracy_m: float
    largest_shift_m: float
    warnings: tuple[str, ...] = ()

    @property
    def crs(self) -> str:
        """Name of the coordinate system for GIS files."""
        return self.datum.code


def parse_datum(text: str) -> Datum:
    """A datum from text such as "GDA2020@2026.5", "NAD83(2011)" or "EPSG:7843".

    The number after @ is the year (with fraction) of the recorded coordinates. Raises
    ConfigError for a name that is not known, a projection, or a year that is none.
    """
    name, at, year = text.strip().partition("@")
    epoch = None
    if at:
        try:
            epoch = float(year)
        except ValueError:
            epoch = float("nan")
        if not YEARS[0] <= epoch <= YEARS[1]:
            raise ConfigError(
                f"--datum {text}: after @ stands the year of the coordinates, as in GDA2020@2026.5."
            )
    key = _plain(name)
    if key in ("WGS84", "EPSG4979", "EPSG4326"):
        return Datum(WGS84, "EPSG:4979", epoch)
    for known, code in _KNOWN.items():
        if _plain(known) == key:
            return Datum(known, code, epoch)
    if not re.fullmatch(r"(?i)epsg:\d+", name.strip()):
        import difflib

        near = difflib.get_close_matches(key, [_plain(k) for k in _KNOWN], n=1, cutoff=0.6)
        hint = next((k for k in _KNOWN if near and _plain(k) == near[0]), "")
        advice = f"did you mean {hint}?" if hint else f"known are {', '.join(_KNOWN)}, or EPSG:n."
        raise ConfigError(f"--datum {text}: there is no datum {name!r}; {advice}")
    crs = find_crs(name.strip().upper())
    if not crs.is_geographic:
        raise ConfigError(
            f"--datum {text} is {crs.name}, which has no longitude and latitude; name a datum, "
            "such as GDA2020, and project in the GIS."
        )
    wanted = crs.to_3d() if len(crs.axis_info) < 3 else crs
    authority = wanted.to_authority() or crs.to_authority()
    code = f"{authority[0]}:{authority[1]}" if authority is not None else name
    return Datum(crs.name, code, epoch)


def is_moving(code: str) -> bool:
    """Whether coordinates in a system change with time, as in an ITRF, so that they need an
    epoch."""
    datum = find_crs(code).datum
    return datum is not None and "Dynamic" in datum.type_name


def _plain(name: str) -> str:
    return re.sub(r"[^A-Z0-9]", "", name.upper())


def to_datum(
    lon_deg: FloatArray,
    lat_deg: FloatArray,
    height_m: FloatArray,
    datum: Datum,
    recorded: float | None,
    frame: str | None = None,
) -> InDatum:
    """Recorded coordinates [n] in another datum.

    ``recorded`` is the year of the recording, where it is known; the datum's own epoch goes
    before it. ``frame`` is the EPSG code of the frame that the coordinates are in, by default
    that of WGS 84 as it was broadcast then. A height that is not known (NaN) stays so. Raises
    ConfigError when no year is known, InputError when the datum is not made for the place or
    PROJ has no operation that is good enough, with what is missing.
    """
    lon, lat = np.asarray(lon_deg, np.float64), np.asarray(lat_deg, np.float64)
    height = np.asarray(height_m, np.float64)
    sentences: list[str] = []
    epoch = datum.epoch if datum.epoch is not None else recorded
    if datum.is_native:
        year = float("nan") if epoch is None else epoch
        return InDatum(datum, lon, lat, height, year, "none", 0.0, 0.0)
    if epoch is None or not np.isfinite(epoch):
        raise ConfigError(
            f"--datum {datum.name}: the recording has no date; give the year of the coordinates, "
            f"as in {datum.name}@2026.5."
        )
    if recorded is not None and abs(epoch - recorded) > EPOCH_SLACK_YEARS:
        sentences.append(
            f"--datum says {epoch:.1f} and the recording is of {recorded:.1f}; {epoch:.1f} is "
            "taken, though plates move up to 7 cm a year."
        )
    good = np.isfinite(lon) & np.isfinite(lat)
    out_lon, out_lat, out_height = lon.copy(), lat.copy(), height.copy()
    source = frame or next(code for first, code in _REALISATIONS if epoch >= first)
    if not good.any():
        return InDatum(
            datum, out_lon, out_lat, out_height, epoch, "none", 0.0, 0.0, tuple(sentences)
        )
    west, south, east, north = (
        float(v) for v in (lon[good].min(), lat[good].min(), lon[good].max(), lat[good].max())
    )
    _check_area(datum, lon[good], lat[good])
    way = route(source, datum.code, f"--datum {datum.name}", (west, south, east, north))
    high = np.where(np.isfinite(height[good]), height[good], 0.0)
    moved = way.transform(lon[good], lat[good], high, epoch)
    out_lon[good], out_lat[good] = moved[0], moved[1]
    if not (np.isfinite(out_lon[good]).all() and np.isfinite(out_lat[good]).all()):
        raise InputError(
            f"--datum {datum.name}: PROJ cannot transform all of the map's positions; is the "
            "datum made for this place?"
        )
    out_height[good] = np.where(np.isfinite(height[good]), moved[2], np.nan)
    turn = np.radians((out_lon - lon + 180.0) % 360.0 - 180.0) * np.cos(np.radians(lat))
    shift = MEAN_RADIUS * np.hypot(turn, np.radians(out_lat - lat))
    return InDatum(
        datum,
        out_lon,
        out_lat,
        out_height,
        epoch, way.description, way.accuracy_m,
        float(np.nanmax(shift)), tuple(sentences),
    )  # fmt: skip


def _check_area(datum: Datum, lon: FloatArray, lat: FloatArray) -> None:
    missed = area_missed(datum.code, lon, lat)
    if missed:
        raise InputError(
            f"--datum {datum.name} is made for {missed}, and the map lies elsewhere; "
            "name the datum of its country."
        )


def decimal_year(gps_s: float) -> float:
    """Year with fraction of a GPS time in s."""
    moment = np.datetime64(round(float(gps_to_unix(gps_s))), "s")
    year = moment.astype("datetime64[Y]")
    start, end = year.astype("datetime64[s]"), (year + 1).astype("datetime64[s]")
    return float(1970 + year.astype(int) + (moment - start) / (end - start))
