"""GPX tracks (1.0 and 1.1) as fixes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from xml.etree import ElementTree as Xml

import numpy as np

from automap.errors import InputError
from automap.io.cut_times import uncut_stamps
from automap.io.stamps import order_stamps
from automap.records import NO_TIME, Fixes, FixType, FloatArray
from automap.timebase import unix_to_gps

_GPX = re.compile(rb"<(?:\w+:)?gpx[\s>]")
_NUMBERS = ("ele", "geoidheight", "speed", "course", "hdop", "sat")
"""Of a point, and of the extensions of Garmin and of programs of phones: m, m/s, degrees."""
_HEAD = 1 << 14


def looks_like_gpx(data: bytes) -> bool:
    """Whether a file is GPX, by its root, which may stand behind comments."""
    return _GPX.search(data[:_HEAD]) is not None


def decode_gpx(data: bytes, name: str) -> tuple[Fixes, list[str]]:
    """The points of all tracks in a file, in the order of time, and warnings.

    Heights of GPX are above the sea; without the geoid's they are taken as ellipsoidal, as those of
    tables are. Raises InputError where it cannot be read or holds no point with a time.
    """
    if b"<!ENTITY" in data:
        raise InputError(f"{name}: it defines entities, which no GPX does; write it anew")
    try:
        points = list(_points(Xml.fromstring(data)))
    except (Xml.ParseError, LookupError, ValueError) as error:
        raise InputError(f"{name} is not whole as GPX: {error}; write it anew") from error
    rows = np.array(points, np.float64).reshape(len(points), 3 + len(_NUMBERS))
    timed = rows[np.isfinite(rows[:, 0])]
    if not len(timed):
        raise InputError(
            f"{name}: none of its {len(rows)} track points has a time, as in a planned route; "
            "give the track as it was recorded"
        )
    warnings = []
    if len(timed) < len(rows):
        warnings.append(f"{len(rows) - len(timed)} track points without a time are left out")
    t_ns, said = uncut_stamps(np.rint(timed[:, 0] * 1e9).astype(np.int64), *timed[:, 1:3].T)
    warnings += said
    timed[:, 0] = t_ns * 1e-9
    order = order_stamps(t_ns)
    if order is None:
        raise InputError(f"{name}: its times jump back and forth; give one track of one recorder")
    if len(order.keep) < len(timed):
        lost = len(timed) - len(order.keep)
        warnings.append(
            f"{lost} track points are left out, since their times repeat others or do not continue "
            "those of the rest; give each drive a file of its own"
        )
    return _fixes(timed[order.keep], warnings), warnings


def _points(root: Xml.Element) -> Iterator[list[float]]:
    """UNIX time, latitude, longitude, deg, and the numbers of each point of a track."""
    for point in root.iter():
        if _local(point) != "trkpt":
            continue
        told = {_local(each): (each.text or "").strip() for each in point.iter()}
        numbers = [_number(told.get(key)) for key in _NUMBERS]
        place = [_number(point.get("lat")), _number(point.get("lon"))]
        yield [_unix_s(told.get("time")), *place, *numbers]


def _local(element: Xml.Element) -> str:
    return str(element.tag).rpartition("}")[2].lower()


def _number(text: str | None) -> float:
    try:
        return float(text) if text else np.nan
    except ValueError:
        return np.nan


def _unix_s(text: str | None) -> float:
    """Times without a zone are UTC, as GPX says."""
    try:
        at = datetime.fromisoformat(text) if text else None
    except ValueError:
        at = None
    if at is None:
        return np.nan
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def _fixes(rows: FloatArray, warnings: list[str]) -> Fixes:
    unix_s, lat, lon, msl, geoid, speed, course, hdop, sats = rows.T
    good = (np.abs(lat) <= 90.0) & (np.abs(lon) <= 180.0) & ((lat != 0.0) | (lon != 0.0))
    if not np.isfinite(geoid).any():
        geoid = np.zeros_like(msl)
    height = msl + geoid
    course = np.radians(np.where((speed == 0.0) & np.isnan(course), 0.0, course))
    level = np.stack([speed * np.cos(course), speed * np.sin(course)], axis=1)
    unknown = np.full((len(rows), 3), np.nan)
    kind = np.where(np.isfinite(height), FixType.THREE_D, FixType.TWO_D)
    return Fixes(
        gps_s=unix_to_gps(unix_s),
        lat_rad=np.where(good, np.radians(lat), np.nan),
        lon_rad=np.where(good, np.radians(lon), np.nan),
        height_m=np.where(good, height, np.nan),
        vel_ned=np.column_stack([level, unknown[:, 0]]),
        sd_pos_ned=unknown,
        sd_vel_ned=unknown.copy(),
        fix_type=np.where(good, kind, FixType.NONE).astype(np.int64),
        n_sats=np.where(np.isfinite(sats) & (sats >= 0), sats, -1.0).astype(np.int64),
        hdop=hdop,
        geoid_sep_m=geoid,
        offset=np.full(len(rows), -1, np.int64),
        arrival_ns=np.full(len(rows), NO_TIME, np.int64),
    )
