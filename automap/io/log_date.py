"""The date of a receiver log that tells none: from other stamps of the drive, or from a name."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np

from automap import timebase as tb
from automap.io.epoch_join import EARLIEST_GPS_S
from automap.records import NO_TIME, Fixes, FloatArray, IntArray

_DATE = re.compile(r"(?<!\d)(20\d\d)([-_.]?)(\d\d)\2(\d\d)(?=\D|\d{6}(?!\d)|$)")
"""Year, month and day; a time of day may follow without a separator."""
_MIDDAY_S = 0.5 * tb.DAY_S
"""A date alone is off by half a day at most from its noon."""


@dataclass(frozen=True)
class Dated:
    """``shift_s`` to add to times of a log without a date, and where the date is ``source``."""

    shift_s: float
    source: str


def find_date(
    fixes: Fixes,
    period_s: float,
    arrival_time: str,
    imu: tuple[str, IntArray] | None,
    names: tuple[Path, ...],
) -> Dated | None:
    """The date of ``fixes`` whose times are known within a ``period_s``: a day of UTC or a week of
    GPS time. None where nothing tells it.

    ``arrival_time`` is the clock of their arrival, ``imu`` that of the readings and their stamps
    [n] in ns; ``names`` are files and folders that may be called by the date, the best one first.
    """
    dated = np.isfinite(fixes.gps_s)
    if not dated.any():
        return None
    first_s = float(fixes.gps_s[np.flatnonzero(dated)[0]])
    for source, known_s, gps_s in _references(fixes, dated, first_s, arrival_time, imu, names):
        if gps_s < EARLIEST_GPS_S:
            continue
        if period_s == tb.WEEK_S:
            return Dated(float(np.rint((gps_s - known_s) / period_s)) * period_s, source)
        days = float(np.rint((float(tb.gps_to_utc(gps_s)) - known_s) / tb.DAY_S)) * tb.DAY_S
        return Dated(float(tb.utc_to_gps(first_s + days)) - first_s, source)
    return None


def date_of_name(name: str) -> date | None:
    """The first date in a name, such as 2026-03-14, 2026_03_14 or 20260314; None without."""
    for year, _, month, day in _DATE.findall(name):
        try:
            return date(int(year), int(month), int(day))
        except ValueError:
            continue
    return None


def _references(
    fixes: Fixes,
    dated: np.ndarray,
    first_s: float,
    arrival_time: str,
    imu: tuple[str, IntArray] | None,
    names: tuple[Path, ...],
) -> Iterator[tuple[str, float, float]]:
    """What tells the date, and of one instant the time in the log and the GPS time."""
    came = dated & (fixes.arrival_ns != NO_TIME)
    arrived = _gps_s(arrival_time, fixes.arrival_ns[came])
    if len(arrived):
        yield (
            "the arrival times",
            float(np.median(fixes.gps_s[came])),
            float(np.median(arrived)),
        )
    readings = np.zeros(0) if imu is None else _gps_s(*imu)
    if len(readings):
        middle = float(np.median(fixes.gps_s[dated]))
        yield "the IMU's stamps", middle, float(np.median(readings))
    for path in names:
        day = date_of_name(path.name)
        if day is not None:
            # the day in UTC on which the log begins
            of_day = np.mod(first_s, tb.DAY_S)
            midday = float(tb.calendar_to_gps(day.year, day.month, day.day, _MIDDAY_S))
            yield f"the name {path.name}", first_s - of_day + _MIDDAY_S, midday


def _gps_s(clock: str, t_ns: IntArray) -> FloatArray:
    """GPS time [n] of stamps of a clock that has a date; empty for one that has none."""
    if clock == "unix_ns":
        return tb.unix_to_gps(t_ns * 1e-9)
    return np.asarray(t_ns * 1e-9) if clock == "gps_ns" else np.zeros(0)
