"""The times of a table: counts of any unit, dates with times of day, GPS weeks."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from automap.io.calendar_text import ISO, filled_up, has_date, has_time, parse_stamps, pattern_of
from automap.io.csv_numbers import Kind
from automap.io.table_form import TableKind
from automap.io.table_units import UNITS
from automap.records import BoolArray, FloatArray, IntArray
from automap.timebase import DAY_S, WEEK_S, unix_to_gps

Clock = Literal["host", "unix", "gps", "day"]
"""What stamps count from: a moment nobody knows, 1970 (UTC), 1980-01-06 (GPS time), midnight."""

USUAL_HZ: dict[TableKind, float] = {"imu": 100.0, "gnss": 1.0, "odometer": 10.0, "arrival": 10.0}
_RATES_HZ: dict[TableKind, tuple[float, float]] = {
    "imu": (0.5, 5e4),
    "gnss": (0.01, 500.0),
    "odometer": (0.01, 5e4),
    "arrival": (1e-3, 5e4),
}
"""Between which rows of a recording come. Loggers of fixes save one in a minute, navigators give
two hundred a second; an IMU of less than a reading in two seconds tells no turn of a car."""
_FIRST_S, _LAST_S = 946_684_800.0, 4_102_444_800.0
"""2000 and 2100 as seconds since 1970."""
_BEFORE = "0123456789"
_EXCEL_DAYS = 25_569
"""From 1899-12-30, which Excel counts days from, to 1970."""
_COMPACT = re.compile(r"([01]\d|2[0-3])[0-5]\d[0-5]\d(\.\d*)?")
_WRAPS_NS = (2**32 * 1_000, 2**32 * 1_000_000)
"""After which counters of 32 bits begin again, as Arduino's ``micros()`` and ``millis()``."""
_NEAR_NS = 60_000_000_000
"""A step back by one of these, but for so much, is one. Chosen: no logger that runs waits longer,
and one that was started anew steps back by any other time."""


@dataclass(frozen=True)
class TimeForm:
    """How the cells of a time become nanoseconds: ``unit`` of a count, or ``pattern`` of a text;
    ``clock`` is what they count from then. ``excel`` for days since 1899-12-30."""

    clock: Clock
    unit: str | None = None
    pattern: str | None = None
    excel: bool = False

    def kind(self, role: str) -> Kind:
        """What a column of this time is read as."""
        if self.pattern is not None:
            return "text"
        return "int" if self.unit == "ns" and role not in ("week", "tow") else "float"

    @property
    def is_local(self) -> bool:
        """Whether these are dates of a clock on a wall, whose zone they do not tell."""
        return self.excel or (self.clock == "unix" and "%z" not in (self.pattern or "%z"))

    @property
    def spelled(self) -> str:
        """The ``time_format`` of a manifest that says the same."""
        if self.pattern is not None or self.excel:
            return self.pattern or "excel"
        return f"{self.clock}_{self.unit}" if self.clock in ("unix", "gps") else str(self.unit)


_MOST = 1e20
"""Of a time in any unit: nanoseconds since 1970 are 2e18."""
EXCEL = TimeForm("unix", "d", excel=True)


def stated_form(time_format: str) -> TimeForm:
    """The form that a manifest's ``time_format`` says."""
    if time_format == ISO or "%" in time_format:
        return TimeForm("unix" if has_date(time_format) else "day", pattern=time_format)
    if time_format == EXCEL.spelled:
        return EXCEL
    clock, _, unit = time_format.rpartition("_")
    return TimeForm("unix" if clock == "unix" else "gps" if clock == "gps" else "host", unit=unit)


def numbers_of(cells: Sequence[str], decimal: str) -> FloatArray:
    """Cells [n] as numbers, NaN where one is none, or none of a time."""
    values = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        text = cell.replace(",", ".") if decimal == "," else cell
        if text[-1:] in (*_BEFORE, ".") and "_" not in text:
            try:
                values[row] = float(text)
            except ValueError:
                continue
    values[np.abs(values) > _MOST] = np.nan
    return values


def guessed_form(
    cells: Sequence[str], decimal: str, unit: str | None, kind: TableKind, *, gps: bool = False
) -> TimeForm | None:
    """The form of a column of times by its first cells; None when it is no time.

    ``unit`` is what its name tells, ``gps`` whether the name says that it is GPS time.
    """
    values = numbers_of(cells, decimal)
    known = values[np.isfinite(values)]
    if 2 * len(known) < len(cells):
        pattern = pattern_of(cells)
        if pattern is None or not has_time(pattern):
            return None
        return TimeForm("unix" if has_date(pattern) else "day", pattern=pattern)
    if unit in (None, "s") and (_is_clock(known) or _has_digits_of_a_clock(cells)):
        return TimeForm("day", pattern="%H%M%S")
    steps = np.diff(known)
    steps = steps[steps > 0.0]
    step = float(np.median(steps)) if len(steps) else 0.0
    size = float(np.median(np.abs(known))) if len(known) else 0.0
    if unit is None and _is_excel(size, step, kind):
        return EXCEL
    since_1970 = [
        name
        for name in ("s", "ms", "us", "ns")
        if _FIRST_S <= size * UNITS["time"][name] * 1e-9 <= _LAST_S and _runs(step, name, kind)
    ]
    if unit is None and since_1970:
        unit = since_1970[0]
    if unit is None and step > 0.0:
        usual = np.log(USUAL_HZ[kind])
        unit = min(
            ("s", "ms", "us", "ns"),
            # the logarithm of a quotient that may be no number
            key=lambda name: abs(np.log(1e9 / UNITS["time"][name]) - np.log(step) - usual),
        )
    if unit is None:
        return None
    if gps:
        return TimeForm("gps", unit)
    return TimeForm("unix" if unit in since_1970 else "host", unit)


def _is_clock(values: FloatArray) -> bool:
    """Whether numbers are hours, minutes and seconds in one, as NMEA has them: at each minute's end
    they leap by forty."""
    steps = np.diff(values)
    usual = float(np.median(steps)) if len(steps) else 0.0
    leaps = np.abs(steps - 40.0 - usual) < 0.5 * usual
    inside = (values >= 0.0) & (values < 240_000.0) & (values % 100.0 < 60.0)
    inside &= values % 10_000.0 < 6_000.0
    even = np.abs(steps - usual) < 0.5 * usual
    return bool(0.0 < usual < 30.0 and inside.all() and leaps.any() and (even | leaps).all())


def _has_digits_of_a_clock(cells: Sequence[str]) -> bool:
    """Whether numbers have the six digits of hours, minutes and seconds, zeros before them too,
    which no count has."""
    filled = [cell for cell in cells if cell]
    zeros = any(cell.startswith("0") for cell in filled)
    return zeros and all(map(_COMPACT.fullmatch, filled))


def _is_excel(size: float, step: float, kind: TableKind) -> bool:
    """Whether numbers are days since 1899: of this century, and stepping as a recording does then,
    which as seconds they would not."""
    unix_s = 86400.0 * (size - _EXCEL_DAYS)
    return step > 0.0 and _FIRST_S <= unix_s <= _LAST_S and _runs(step, "d", kind) and step < 1e-3


def _runs(step: float, unit: str, kind: TableKind) -> bool:
    """Whether steps of a unit are those of a recording, or unknown."""
    slowest, fastest = _RATES_HZ[kind]
    return step == 0.0 or slowest < 1e9 / (step * UNITS["time"][unit]) < fastest


def contradiction(cells: Sequence[str], decimal: str, unit: str, kind: TableKind) -> str | None:
    """What to write where the unit in a column's name cannot be that of its cells, else None."""
    values = numbers_of(cells, decimal)
    steps = np.diff(values[np.isfinite(values)])
    steps = steps[steps > 0.0]
    if len(steps) < 2 or _runs(float(np.median(steps)), unit, kind):
        return None
    likely = guessed_form(cells, decimal, None, kind)
    written = "s" if likely is None else likely.spelled
    step = float(np.median(steps))
    return (
        f'steps of {step:g} are no {unit}; if they are {written}, write time_format = "{written}"'
    )


def day_pattern(dates: Sequence[str], times: Sequence[str]) -> str | None:
    """The pattern of dates and times of day in two columns, a blank between them."""
    date = pattern_of([filled_up(cell, of_day=False) for cell in dates])
    time = pattern_of([filled_up(cell, of_day=True) for cell in times])
    if date is None or time is None or not has_date(date) or has_time(date) or has_date(time):
        return None
    return f"{date} {time}"


def stamps(
    columns: Mapping[str, np.ndarray], form: TimeForm, utc_offset_h: float
) -> tuple[IntArray, BoolArray]:
    """Nanoseconds [n] of ``form.clock`` from the time columns that were read, and which are good.

    ``columns`` by our names: one count or text, or ``date`` and ``time_of_day``, or ``week``
    and ``tow``.
    """
    if "week" in columns and "tow" in columns:
        week, tow = (np.asarray(columns[name], np.float64) for name in ("week", "tow"))
        # NaN compares false
        good = (np.abs(week) < 1e4) & (np.abs(tow) * UNITS["time"][form.unit or "s"] < 1e18)
        whole = np.where(good, week, 0.0).astype(np.int64) * WEEK_S * 1_000_000_000
        return whole + _counted(np.where(good, tow, 0.0), form.unit or "s"), good
    if form.pattern is not None:
        if "date" in columns and "time_of_day" in columns:
            cells = [
                f"{filled_up(date, of_day=False)} {filled_up(time, of_day=True)}"
                for date, time in zip(columns["date"], columns["time_of_day"], strict=True)
            ]
        else:
            cells = list(next(iter(columns.values())))
        return parse_stamps(cells, form.pattern, utc_offset_h)
    values = next(iter(columns.values()))
    if form.excel:
        good = np.abs(values) < 1e6
        days = np.floor(np.where(good, values, 0.0))
        of_day = np.rint((np.where(good, values, 0.0) - days) * UNITS["time"]["d"] / 1e3)
        whole = (days.astype(np.int64) - _EXCEL_DAYS) * DAY_S - round(utc_offset_h * 3600.0)
        return whole * 1_000_000_000 + of_day.astype(np.int64) * 1000, good
    if values.dtype == np.int64 and form.unit == "ns":
        t_ns, good = np.asarray(values), np.ones(len(values), bool)
    else:
        good = np.abs(values) < 9e18 / UNITS["time"][form.unit or "s"]
        t_ns = _counted(np.where(good, values, 0.0), form.unit or "s")
    if form.clock == "host":
        t_ns = t_ns.copy()
        t_ns[good] = _unwrapped(t_ns[good])
    return t_ns, good


def _unwrapped(t_ns: IntArray) -> IntArray:
    """Stamps [n] of a counter of 32 bits that ran over, running on beyond its end."""
    steps = np.diff(t_ns, prepend=t_ns[:1])
    for wrap in _WRAPS_NS:
        back, ahead = np.abs(steps + wrap) < _NEAR_NS, np.abs(steps - wrap) < _NEAR_NS
        # a wrong stamp goes there and back
        if back.any() and not ahead.any():
            t_ns = t_ns + wrap * np.cumsum(back)
    return t_ns


def _counted(values: np.ndarray, unit: str) -> IntArray:
    """Counts [n] of a unit in whole nanoseconds, the fraction apart so that none is lost."""
    factor = round(UNITS["time"][unit])
    whole = np.floor(values)
    rest = np.rint((values - whole) * factor).astype(np.int64)
    return np.asarray(whole.astype(np.int64) * factor + rest)


def to_gps_s(t_ns: IntArray, clock: Clock) -> FloatArray:
    """GPS seconds [n] of stamps; without a date they count from the first day of 1980."""
    whole, rest = np.divmod(t_ns, 1_000_000_000)
    if clock == "unix":
        return np.asarray(unix_to_gps(whole) + rest * 1e-9)
    return np.asarray(whole + rest * 1e-9)
