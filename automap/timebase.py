"""Clocks: GPS time, UTC, UNIX time, GPS weeks and what rolls over.

GPS time here is continuous seconds since 1980-01-06T00:00:00 UTC, without leap seconds.
"UTC seconds" count from the same instant but as a calendar does, 86400 to the day, so that
``gps = utc + leap``. A leap second itself (23:59:60) has the same UTC seconds as the
midnight that follows; converters that see a calendar time take it apart themselves
(:func:`calendar_to_gps`). All functions take scalars or arrays.

References: IS-GPS-200, 3.3.4 and 20.3.3.5.2.4; IERS Bulletin C for the leap seconds.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray, IntArray

DAY_S, WEEK_S = 86_400, 604_800
ROLLOVER_S = 1024 * WEEK_S
"""Period of the ten-bit week number of the legacy GPS message, 19.6 years."""

QUARTER_S = 900.0
"""Zones and summer times differ by multiples of it."""
MOST_ZONE_H = 14.0
"""No zone is further from UTC (Line Islands)."""

UNIX_OF_GPS_EPOCH = 315_964_800
"""UNIX time of 1980-01-06T00:00:00 UTC."""

LEAP_SECOND_DATES: tuple[tuple[int, int], ...] = (
    (1981, 7),
    (1982, 7),
    (1983, 7),
    (1985, 7),
    (1988, 1),
    (1990, 1),
    (1991, 1),
    (1992, 7),
    (1993, 7),
    (1994, 7),
    (1996, 1),
    (1997, 7),
    (1999, 1),
    (2006, 1),
    (2009, 1),
    (2012, 7),
    (2015, 7),
    (2017, 1),
)
"""Year and month on whose first day one more second between GPS time and UTC took effect."""


def days_since_epoch(year: npt.ArrayLike, month: npt.ArrayLike, day: npt.ArrayLike) -> IntArray:
    """Days [n] from 1980-01-06 to a Gregorian date.

    A month or day out of range counts on (day 32 of January is 1 February); callers check
    plausibility. Reference: H. Hinnant, "chrono-compatible low-level date algorithms".
    """
    y = np.asarray(year, np.int64)
    m = np.asarray(month, np.int64)
    y = np.where(m <= 2, y - 1, y)
    era = y // 400
    year_of_era = y - era * 400
    day_of_year = (153 * (m + np.where(m > 2, -3, 9)) + 2) // 5 + np.asarray(day, np.int64) - 1
    day_of_era = year_of_era * 365 + year_of_era // 4 - year_of_era // 100 + day_of_year
    unix_days = era * 146_097 + day_of_era - 719_468
    return np.asarray(unix_days - UNIX_OF_GPS_EPOCH // DAY_S, np.int64)


def _leap_table() -> tuple[FloatArray, FloatArray]:
    """When each leap second took effect, in UTC seconds [k] and in GPS seconds [k]."""
    years = [year for year, _ in LEAP_SECOND_DATES]
    months = [month for _, month in LEAP_SECOND_DATES]
    utc = days_since_epoch(years, months, [1] * len(years)).astype(np.float64) * DAY_S
    return utc, utc + np.arange(1, len(utc) + 1)


LEAP_UTC_S, LEAP_GPS_S = _leap_table()


def leap_seconds_at_utc(utc_s: npt.ArrayLike) -> FloatArray:
    """GPS minus UTC [n], seconds, at UTC seconds [n]."""
    return np.searchsorted(LEAP_UTC_S, np.asarray(utc_s, np.float64), "right").astype(np.float64)


def leap_seconds_at_gps(gps_s: npt.ArrayLike) -> FloatArray:
    """GPS minus UTC [n], seconds, at GPS seconds [n]."""
    return np.searchsorted(LEAP_GPS_S, np.asarray(gps_s, np.float64), "right").astype(np.float64)


def utc_to_gps(utc_s: npt.ArrayLike) -> FloatArray:
    """GPS seconds [n] of UTC seconds [n] (both since 1980-01-06)."""
    utc = np.asarray(utc_s, np.float64)
    return np.asarray(utc + leap_seconds_at_utc(utc), np.float64)


def gps_to_utc(gps_s: npt.ArrayLike) -> FloatArray:
    """UTC seconds [n] of GPS seconds [n] (both since 1980-01-06)."""
    gps = np.asarray(gps_s, np.float64)
    return np.asarray(gps - leap_seconds_at_gps(gps), np.float64)


def unix_to_gps(unix_s: npt.ArrayLike) -> FloatArray:
    """GPS seconds [n] of UNIX seconds [n]."""
    return utc_to_gps(np.asarray(unix_s, np.float64) - UNIX_OF_GPS_EPOCH)


def gps_to_unix(gps_s: npt.ArrayLike) -> FloatArray:
    """UNIX seconds [n] of GPS seconds [n]."""
    return np.asarray(gps_to_utc(gps_s) + UNIX_OF_GPS_EPOCH, np.float64)


def calendar_to_gps(
    year: npt.ArrayLike,
    month: npt.ArrayLike,
    day: npt.ArrayLike,
    second_of_day: npt.ArrayLike,
) -> FloatArray:
    """GPS seconds [n] of a UTC date and second of the day [n].

    ``second_of_day`` may reach 86401, so 23:59:60 is told apart from the midnight after it:
    the leap seconds are those of the minute's start, as UTC inserts them at its end.
    """
    seconds = np.asarray(second_of_day, np.float64)
    midnight = days_since_epoch(year, month, day).astype(np.float64) * DAY_S
    minute = midnight + np.minimum(np.floor(seconds / 60.0), 1439.0) * 60.0
    return np.asarray(midnight + seconds + leap_seconds_at_utc(minute), np.float64)


def week_to_gps(week: npt.ArrayLike, tow_s: npt.ArrayLike) -> FloatArray:
    """GPS seconds [n] of full GPS weeks [n] and times of week [n]."""
    return np.asarray(
        np.asarray(week, np.float64) * WEEK_S + np.asarray(tow_s, np.float64), np.float64
    )


def gps_to_week(gps_s: npt.ArrayLike) -> tuple[IntArray, FloatArray]:
    """Full GPS weeks [n] and times of week [n], seconds in [0, 604800), of GPS seconds [n]."""
    gps = np.asarray(gps_s, np.float64)
    week = np.floor(gps / WEEK_S)
    return week.astype(np.int64), np.asarray(gps - week * WEEK_S, np.float64)


def nearest_in_period(
    partial: npt.ArrayLike, period: float, reference: npt.ArrayLike
) -> FloatArray:
    """The times [n] that equal ``partial`` modulo ``period`` and lie nearest to ``reference``.

    With a period of a day this finds the date of a time of day, with a week the week of a
    time of week, with 1024 weeks the era of a ten-bit week.
    """
    part = np.asarray(partial, np.float64)
    turns = np.rint((np.asarray(reference, np.float64) - part) / period)
    return np.asarray(part + turns * period, np.float64)


def undo_rollover(gps_s: npt.ArrayLike, not_before_s: float) -> FloatArray:
    """GPS seconds [n] moved on by whole 1024-week eras until none is before ``not_before_s``.

    A receiver whose firmware has outlived its era reports dates 19.6 years too early.
    """
    gps = np.asarray(gps_s, np.float64)
    eras = np.ceil((not_before_s - gps) / ROLLOVER_S)
    return np.asarray(gps + np.maximum(eras, 0.0) * ROLLOVER_S, np.float64)


def gps_to_iso(gps_s: float) -> str:
    """One GPS time as UTC text for people, to the millisecond.

    Within a leap second the text shows the last second of the day a second time.
    """
    utc = float(gps_to_utc(gps_s))
    milliseconds = np.datetime64("1980-01-06", "ms") + np.timedelta64(round(utc * 1e3), "ms")
    return f"{milliseconds}Z"
