"""A table of fixes in place of a receiver's log: times, positions and whatever else it tells."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.cut_times import uncut_stamps
from automap.io.epoch_fix_type import GGA_FIX
from automap.io.epoch_velocity import STANDSTILL_SPEED
from automap.io.fix_units import exchanged, told_by_numbers
from automap.io.named_table import NamedTable, read_table
from automap.io.rtklib import QUALITY
from automap.io.stamps import order_stamps
from automap.io.table_form import DEFAULT_UNIT, QUANTITIES, TableForm
from automap.io.table_times import to_gps_s
from automap.io.table_units import UNITS, to_si
from automap.records import NO_TIME, BoolArray, Fixes, FixType, FloatArray, IntArray
from automap.timebase import DAY_S

_HELD_ROWS = 2
"""Rows between changes of a fix, in the middle of them, from which on a table holds its fixes."""

_UNKNOWN_COURSE = -1.5 * np.pi / 180.0
"""Below the -1 deg that says that there is none courses count from -180 to 180."""

_CODES, _SKY = 100, 1000
"""No code of a fix and no number of satellites is as large."""
_DIMENSIONS = np.array([FixType.NONE, FixType.NONE, FixType.TWO_D, FixType.THREE_D], np.int64)


@dataclass(frozen=True)
class RowStamps:
    """Host times [n], ns, of the lines [n] of a file that an inertial sensor wrote as well."""

    line: IntArray
    t_ns: IntArray


@dataclass(frozen=True)
class FixTable:
    """Fixes of a table; ``rows`` it had, ``held`` of them repeat the one before; ``period_s`` a day
    where its times are times of day without a date. ``units`` by our names that only its numbers
    told."""

    fixes: Fixes
    rows: int
    held: int
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    period_s: float | None
    units: Mapping[str, str] = field(default_factory=dict)


def row_stamps(path: Path, form: TableForm) -> RowStamps:
    """When the rows of a table were written, by its inertial sensor's stamps."""
    table = read_table(path, "imu", form)
    if table.t_ns is None:
        raise InputError(f"{path}: no column is a time of the readings.")
    return RowStamps(_lines(table), table.t_ns)


def read_fix_table(
    path: Path, form: TableForm | None = None, written: RowStamps | None = None
) -> FixTable:
    """Read a table of fixes.

    A fix that is held over several rows is taken once, at its first. ``written`` gives the
    arrival of each row; a column ``arrival``, or times of a clock without a date, do so too.
    Raises InputError where no time or position is found or nothing usable is left.
    """
    table = read_table(path, "gnss", form)
    if table.t_ns is None:
        raise InputError(
            f"{path}: no column is a time; say in drive.toml which one is: "
            'columns = { t = "..." }, or date and time_of_day, or week and tow.'
        )
    warnings = table.rows.warnings()
    t_ns, said = uncut_stamps(table.t_ns, table.column("lat"), table.column("lon"))
    table = replace(table, t_ns=t_ns)
    warnings += [f"{path}: {text}" for text in said]
    first = _first_rows(table)
    held = len(table) - int(np.count_nonzero(first))
    rows = np.flatnonzero(first)
    order = order_stamps(t_ns[rows])
    if order is None:
        raise InputError(
            f"{path}: its times jump back and forth thousands of times, so they are no clock; "
            "name the right column in drive.toml."
        )
    if len(order.keep) < len(rows):
        lost = len(rows) - len(order.keep)
        left_out = _lines(table)[np.delete(rows, order.keep)]
        warnings.append(
            f"{path}: {lost} fixes, lines {left_out.min()} to {left_out.max()}, are left out, "
            "since their times do not continue those of the rest; if a clock was set back there, "
            "correct them, and if they are another drive, put them in a folder of their own"
        )
    rows = rows[order.keep]
    columns = table.columns
    if exchanged(columns["lat"][rows], columns["lon"][rows]):
        table = replace(table, columns={**columns, "lat": columns["lon"], "lon": columns["lat"]})
        warnings.append(
            f"{path}: latitudes and longitudes stand in each other's columns, by their numbers, "
            "and were exchanged; name the columns in drive.toml."
        )
    table, units = _in_si(path, table, rows)
    fixes, said = _fixes(path, table, rows, written)
    if not np.any(fixes.fix_type != FixType.NONE):
        raise InputError(
            f"{path}: no row has a latitude within 90 deg and a longitude; check which column is "
            "which, and their units."
        )
    period_s = float(DAY_S) if table.clock == "day" else None
    notes = [f"{path}: {role} is in {unit}, by its numbers" for role, unit in units.items()]
    return FixTable(
        fixes, len(table), held, (*warnings, *said), (*table.notes, *notes), period_s, units
    )


def _in_si(path: Path, table: NamedTable, rows: IntArray) -> tuple[NamedTable, Mapping[str, str]]:
    """The table in SI where nothing but its numbers tells the units, and those units."""
    assert table.t_ns is not None
    seconds = (table.t_ns[rows] - table.t_ns[rows[0]]) * 1e-9
    shown = {role: values[rows] for role, values in table.columns.items()}
    units = told_by_numbers(path, seconds, shown, table.guess.assumed)
    columns = dict(table.columns)
    for role, unit in units.items():
        quantity = QUANTITIES["gnss"][role]
        assert quantity is not None
        # back to the numbers of the file
        numbers = columns[role] / UNITS[quantity][DEFAULT_UNIT[quantity]]
        columns[role] = to_si(numbers, unit, quantity)
    return replace(table, columns=columns), units


def _lines(table: NamedTable) -> IntArray:
    if table.rows.line_numbers is not None:
        return table.rows.line_numbers
    return table.rows.first_line + np.arange(len(table), dtype=np.int64)


def _first_rows(table: NamedTable) -> BoolArray:
    """The rows [n] that begin a fix: all, or those where a held time, or held values, change."""
    assert table.t_ns is not None
    n = len(table)
    tick = np.ones(n, bool)
    tick[1:] = np.diff(table.t_ns) != 0
    if _held(tick):
        return tick
    change = np.zeros(n, bool)
    for role in ("lat", "lon", "height", "msl", "speed", "course", "vn", "ve"):
        values = table.column(role)
        same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
        change[1:] |= ~same
    change[0] = True
    return change if _held(change) else np.ones(n, bool)


def _held(first: BoolArray) -> bool:
    lengths = np.diff(np.flatnonzero(first))
    return bool(len(lengths)) and float(np.median(lengths)) >= _HELD_ROWS


def _fixes(
    path: Path, table: NamedTable, rows: IntArray, written: RowStamps | None
) -> tuple[Fixes, list[str]]:
    assert table.t_ns is not None
    said: list[str] = []

    def get(role: str, least: float = -np.inf) -> FloatArray:
        values = table.column(role)[rows]
        # phones write -1 for what they do not know
        return np.where((values >= least) & np.isfinite(values), values, np.nan)

    lat, lon = get("lat"), get("lon")
    good = (np.abs(lat) <= np.pi / 2) & (np.abs(lon) <= 2 * np.pi) & ((lat != 0) | (lon != 0))
    lon = np.where(lon > np.pi, lon - 2 * np.pi, lon)
    height, separation = _height(get("height"), get("msl"), get("geoid_sep"))
    fix = np.where(np.isfinite(height), FixType.THREE_D, FixType.TWO_D).astype(np.int64)
    if "quality" in table.columns:
        fix, unknown = _fix_types(get("quality"), table, fix)
        if unknown:
            said.append(
                f"{path}: {unknown} fixes have a quality that no kind of fix has; they are taken "
                "as plain ones; if the column is none of fixes, name the right one in drive.toml"
            )
    fix = np.where(good, fix, FixType.NONE)
    none = fix == FixType.NONE
    if none.any():
        said.append(f"{path}: {int(none.sum())} of {len(rows)} fixes have no valid position")
    velocity, sd_velocity = _velocity(get)
    sd_level = get("h_acc", 0.0) / np.sqrt(2.0)
    sd_down = get("v_acc", 0.0)
    own = [get(role, 0.0) for role in ("sd_n", "sd_e", "sd_d")]
    sd = np.stack(
        [
            np.where(np.isfinite(axis), axis, stated)
            for axis, stated in zip(own, (sd_level, sd_level, sd_down), strict=True)
        ],
        axis=1,
    )
    sd[~(sd > 0.0)] = np.nan
    for values in (lat, lon, height):
        values[none] = np.nan
    for vectors in (velocity, sd, sd_velocity):
        vectors[none] = np.nan
    if table.clock == "host":
        said.append(f"{path}: no column tells the date, so times count from the first day of 1980")
    sats = get("n_sats", 0.0)
    fixes = Fixes(
        gps_s=to_gps_s(table.t_ns[rows], table.clock),
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=velocity,
        sd_pos_ned=sd,
        sd_vel_ned=sd_velocity,
        fix_type=fix.astype(np.int64),
        n_sats=np.where(sats < _SKY, sats, -1.0).astype(np.int64),
        hdop=get("hdop", 0.0),
        geoid_sep_m=separation,
        offset=np.full(len(rows), -1, np.int64),
        arrival_ns=_arrival(table, rows, written),
    )
    return fixes, said


def _height(
    height: FloatArray, msl: FloatArray, separation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Ellipsoidal heights [n], and the geoid's above the ellipsoid [n]."""
    if np.isfinite(height).any():
        apart = np.where(np.isfinite(separation), separation, height - msl)
        return height, apart
    if not np.isfinite(separation).any():
        separation = np.zeros_like(msl)
    return msl + separation, separation


def _fix_types(quality: FloatArray, table: NamedTable, usual: IntArray) -> tuple[IntArray, int]:
    """Types of fixes [n] by a column that gives NMEA's or RTKLIB's quality or the dimensions, and
    how many have a number that is none of these and are ``usual``."""
    name = str(table.guess.form.columns.get("quality", "")).strip()
    code = np.where(np.abs(quality) < _CODES, quality, 0.0).astype(np.int64)
    largest = int(code.max(initial=0))
    if name == "Q":
        kinds = QUALITY
    elif "qual" in name.lower() or largest > 3:
        kinds = GGA_FIX.astype(np.int64)
    elif largest <= 1:
        return np.where(code == 1, usual, FixType.NONE).astype(np.int64), 0
    else:
        kinds = _DIMENSIONS
    unknown = code >= len(kinds)
    told = np.where(unknown, usual, kinds[np.clip(code, 0, len(kinds) - 1)])
    flat = (told > FixType.TWO_D) & (usual == FixType.TWO_D)
    return np.where(flat, FixType.TWO_D, told).astype(np.int64), int(np.count_nonzero(unknown))


def _velocity(get: Callable[..., FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Velocity NED [n, 3] and its sd [n, 3] of components, else of speed and course."""
    north, east, down = get("vn"), get("ve"), get("vd")
    down = np.where(np.isfinite(down), down, -get("vu"))
    speed, course = get("speed", 0.0), get("course")
    if not np.nanmin(course, initial=0.0) < _UNKNOWN_COURSE:
        course = get("course", 0.0)
    if np.isfinite(course).any():
        # without any the velocities known would be those at rest, which look like a slow vehicle's
        course = np.where(np.isnan(course) & (speed < STANDSTILL_SPEED), 0.0, course)
    north = np.where(np.isfinite(north), north, speed * np.cos(course))
    east = np.where(np.isfinite(east), east, speed * np.sin(course))
    along = get("speed_acc", 0.0)
    turned = get("course_acc", 0.0) * speed
    across = np.where(np.isfinite(turned), np.maximum(turned, 0.1 * along), along)
    sd_north = np.hypot(along * np.cos(course), across * np.sin(course))
    sd_east = np.hypot(along * np.sin(course), across * np.cos(course))
    unknown = np.isnan(course)
    sd_north, sd_east = np.where(unknown, along, sd_north), np.where(unknown, along, sd_east)
    sd_down = np.where(np.isfinite(down), along, np.nan)
    sd = np.stack([sd_north, sd_east, sd_down], axis=1)
    sd[~(sd > 0.0)] = np.nan
    return np.stack([north, east, down], axis=1), sd


def _arrival(table: NamedTable, rows: IntArray, written: RowStamps | None) -> IntArray:
    """Host times [k] at which the rows came, NO_TIME where nothing tells."""
    assert table.t_ns is not None
    came = np.full(len(rows), NO_TIME, np.int64)
    if "arrival" in table.columns:
        told = table.columns["arrival"][rows]
        known = np.isfinite(told) & (np.abs(told) < 9e18)
        came[known] = told[known].astype(np.int64)
    elif written is not None and len(written.line):
        line = _lines(table)[rows]
        at = np.minimum(np.searchsorted(written.line, line), len(written.line) - 1)
        same = written.line[at] == line
        came[same] = written.t_ns[at[same]]
    elif table.clock == "host":
        came = table.t_ns[rows]
    return came
