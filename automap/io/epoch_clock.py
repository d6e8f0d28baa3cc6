"""What each message of a receiver log says of the time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from automap import timebase as tb
from automap.io.nmea import NmeaTable
from automap.io.ubx import Table, physical
from automap.records import BoolArray, FloatArray, IntArray

_FIX_OK = 1


@dataclass(frozen=True)
class Clock:
    """What one type's messages [n] say of the time.

    ``partial`` time of week (UBX) or UTC time of day (``is_utc``), s; ``full`` where week or
    date is told (NaN else): GPS seconds, or UTC seconds when ``is_utc``; ``trusted`` whether
    that was told with a valid clock; ``leap`` GPS minus UTC as the receiver has it; ``fine``
    s to add to a time of week.
    """

    is_utc: bool
    partial: FloatArray
    full: FloatArray
    trusted: BoolArray
    leap: FloatArray
    fine: FloatArray

    def __len__(self) -> int:
        return len(self.partial)


def ubx_clock(name: str, table: Table) -> Clock:
    """Clock of a UBX type."""
    n = len(table)
    tow = physical(name, table, "iTOW")
    full, leap, fine = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n)
    trusted = np.zeros(n, bool)
    if name in ("NAV-TIMEGPS", "NAV-SOL"):
        fine = physical(name, table, "fTOW")
        fine[np.abs(fine) > 1e-3] = 0.0
        if name == "NAV-TIMEGPS":
            trusted = (table["valid"] & 3) == 3
            leap = np.where(table["valid"] & 4, table["leapS"].astype(np.float64), np.nan)
        else:
            trusted = (table["flags"] & 0x0C) == 0x0C
        full = tb.week_to_gps(table["week"], tow)
        full[~trusted] = np.nan
    elif name in ("NAV-PVT", "NAV-TIMEUTC"):
        pvt = name == "NAV-PVT"
        second = table["second" if pvt else "sec"].astype(np.float64)
        second += physical(name, table, "nano")
        of_day = table["hour"] * 3600.0 + table["min"] * 60.0 + second
        if pvt:
            told = (table["valid"] & 3) == 3
            trusted = told & (((table["valid"] & 4) != 0) | ((table["flags"] & _FIX_OK) != 0))
        else:
            told = (table["valid"] & 7) == 7
            trusted = told
        told = told & (table["month"] >= 1) & (table["month"] <= 12) & (table["day"] >= 1)
        trusted = trusted & told
        about = _calendar_to_gps(table["year"], table["month"], table["day"], of_day)
        full = tb.nearest_in_period(tow, tb.WEEK_S, about)
        full[~told] = np.nan
        ahead = np.mod(tow - of_day + 0.5, tb.DAY_S) - 0.5
        leap = np.rint(ahead)
        leap[~(told & (ahead < 60.0))] = np.nan
        fine = leap - ahead
        fine[~(np.abs(fine) < 1e-3)] = 0.0
    return Clock(False, tow, full, trusted, leap, fine)


def nmea_clock(name: str, table: NmeaTable) -> Clock:
    """Clock of a sentence type; one that gives no time has NaN throughout."""
    n = len(table["offset"])
    none = np.full(n, np.nan)
    of_day = np.asarray(table.get("time", none), np.float64)
    trusted = np.zeros(n, bool)
    if name == "RMC":
        told = np.abs(table["date"]) < 1e6
        date = np.where(told, table["date"], 0.0).astype(np.int64)
        trusted = table["status"] == ord("A")
        first, lengths = _runs(date)
        day, month, year = date[first] // 10_000, date[first] // 100 % 100, date[first] % 100
        year += np.where(year >= 80, 1900, 2000)
    elif name == "ZDA":
        parts = [
            np.where(np.abs(table[part]) < 1e6, table[part], 0.0).astype(np.int64)
            for part in ("year", "month", "day")
        ]
        told = parts[0] >= 1980
        first, lengths = _runs(*parts)
        year, month, day = (part[first] for part in parts)
    else:
        return Clock(True, of_day, none, trusted, none, np.zeros(n))
    usual = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
    told = told & np.repeat(usual, lengths)
    utc = np.repeat(tb.days_since_epoch(year, month, day) * float(tb.DAY_S), lengths) + of_day
    utc[~told] = np.nan
    return Clock(True, of_day, utc, trusted & told, none, np.zeros(n))


def _runs(*columns: npt.NDArray[Any]) -> tuple[IntArray, IntArray]:
    """First row and length of each stretch of rows that are equal in all columns [n].

    Dates change once a day, so what depends on them alone is computed once for a stretch.
    """
    new = np.ones(len(columns[0]), bool)
    new[1:] = columns[0][1:] != columns[0][:-1]
    for column in columns[1:]:
        new[1:] |= column[1:] != column[:-1]
    first = np.flatnonzero(new)
    return first, np.diff(first, append=len(new))


def _calendar_to_gps(
    year: npt.NDArray[Any], month: npt.NDArray[Any], day: npt.NDArray[Any], of_day: FloatArray
) -> FloatArray:
    """As :func:`automap.timebase.calendar_to_gps`, fast where no leap second is near."""
    first, lengths = _runs(day, month, year)
    midnight = tb.days_since_epoch(year[first], month[first], day[first]) * float(tb.DAY_S)
    leap = tb.leap_seconds_at_utc(midnight - tb.DAY_S)
    if (leap != tb.leap_seconds_at_utc(midnight + tb.DAY_S)).any():
        return tb.calendar_to_gps(year, month, day, of_day)
    gps = np.repeat(midnight, lengths) + of_day
    gps += np.repeat(leap, lengths)
    return np.asarray(gps, np.float64)


def has_fix(name: str, table: Table | NmeaTable) -> npt.NDArray[np.bool_] | None:
    """Whether each message [n] reports a fix; None for a type that does not say."""
    if name == "GGA":
        return np.asarray(table["quality"] > 0)
    if name in ("RMC", "GLL"):
        return np.asarray(table["status"] == ord("A"))
    if name == "GNS":
        return np.isfinite(np.asarray(table["lat"], np.float64))
    if name in ("NAV-PVT", "NAV-SOL", "NAV-STATUS"):
        return np.asarray((table["flags"] & _FIX_OK) != 0)
    return None
