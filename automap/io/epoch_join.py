"""Receiver messages joined into epochs: every message its GPS time, every time its messages.

Messages know their time only in part: UBX ones the time of week, most sentences the time of
day. Walking the log in order, each part is completed to the time nearest the one before it,
so weeks and days roll over by themselves, and a full date anywhere in the log dates it all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from automap import timebase as tb
from automap.io.nmea import NmeaTable
from automap.io.ubx import Table, physical
from automap.records import FloatArray, IntArray

EARLIEST_GPS_S = 1356.0 * tb.WEEK_S
"""Start of 2006, before u-blox 5: an earlier date is one of a past 1024-week era."""

JOIN_TOLERANCE_S = 0.0105
"""Sentences give the time to 10 ms, rounded or cut, of an epoch that UBX gives to 1 ms."""

SOURCES = (
    "NAV-PVT",
    "NAV-HPPOSLLH",
    "NAV-POSLLH",
    "NAV-VELNED",
    "NAV-SOL",
    "PUBX00",
    "GGA",
    "GNS",
    "RMC",
    "GLL",
    "NAV-STATUS",
    "NAV-COV",
    "NAV-DOP",
    "NAV-TIMEGPS",
    "NAV-TIMEUTC",
    "NAV-EOE",
    "GST",
    "ZDA",
    "VTG",
    "GSA",
)
"""Message types that make up epochs."""

CODE = {name: code for code, name in enumerate(SOURCES)}
_N_NAVIGATION = CODE["NAV-STATUS"]
"""Codes below this carry position or velocity; an epoch without any of them is none."""
_UNTIMED = (CODE["VTG"], CODE["GSA"])
_EOE = CODE["NAV-EOE"]
_FIX_OK = 1


@dataclass(frozen=True)
class Joined:
    """Epochs [m] in log order.

    ``rows`` [s, m] row in the table of each source, -1 for none; ``gps_s`` [m]; ``offset`` [m]
    of the first message; ``no_navigation`` counts times with neither position nor velocity,
    ``untimed`` messages whose time could not be read; ``dated`` is False where the log never
    says the week or date; ``moved_eras`` tells of dates moved on by 1024 weeks.
    """

    rows: npt.NDArray[np.int32]
    gps_s: FloatArray
    offset: IntArray
    no_navigation: int
    untimed: int
    dated: bool
    moved_eras: bool


@dataclass(frozen=True)
class _Clock:
    """What one type's messages [n] say of the time.

    ``partial`` s modulo ``period``; ``full`` GPS time where week or date is told (NaN else);
    ``trusted`` whether that was told with a valid clock; ``leap`` GPS minus UTC as the
    receiver has it; ``fine`` s to add to a UBX time of week.
    """

    partial: FloatArray
    period: float
    full: FloatArray
    trusted: npt.NDArray[np.bool_]
    leap: FloatArray
    fine: FloatArray


def _ubx_clock(name: str, table: Table) -> _Clock:
    n = len(table)
    tow = physical(name, table, "iTOW")
    full, leap, fine = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n)
    trusted = np.zeros(n, bool)
    if name in ("NAV-TIMEGPS", "NAV-SOL"):
        fine = physical(name, table, "fTOW")
        fine[np.abs(fine) > 1e-3] = 0.0
        if name == "NAV-TIMEGPS":
            told = (table["valid"] & 3) == 3
            leap = np.where(table["valid"] & 4, table["leapS"].astype(np.float64), np.nan)
        else:
            told = (table["flags"] & 0x0C) == 0x0C
        full = np.where(told, tb.week_to_gps(table["week"], tow), np.nan)
        trusted = told
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
        told &= (table["month"] >= 1) & (table["month"] <= 12) & (table["day"] >= 1)
        trusted &= told
        about = tb.calendar_to_gps(table["year"], table["month"], table["day"], of_day)
        full = np.where(told, tb.nearest_in_period(tow, tb.WEEK_S, about), np.nan)
        ahead = np.mod(tow - of_day + 0.5, tb.DAY_S) - 0.5
        leap = np.where(told & (ahead < 60.0), np.rint(ahead), np.nan)
        fine = np.where(np.abs(ahead - leap) < 1e-3, leap - ahead, 0.0)
    return _Clock(tow, tb.WEEK_S, full, trusted, leap, fine)


def _nmea_clock(name: str, table: NmeaTable) -> _Clock:
    """``full`` holds UTC seconds here; the leap seconds are added once all clocks are known."""
    of_day = np.asarray(table["time"], np.float64)
    n = len(of_day)
    utc, trusted = np.full(n, np.nan), np.zeros(n, bool)
    if name == "RMC":
        date = np.nan_to_num(table["date"]).astype(np.int64)
        day, month, year = date // 10_000, date // 100 % 100, date % 100
        year = year + np.where(year >= 80, 1900, 2000)
        told = np.isfinite(table["date"])
        trusted = table["status"] == ord("A")
    elif name == "ZDA":
        day, month, year = (
            np.nan_to_num(table[part]).astype(np.int64) for part in ("day", "month", "year")
        )
        told = year >= 1980
    else:
        return _Clock(of_day, tb.DAY_S, utc, trusted, utc.copy(), np.zeros(n))
    told = told & (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
    utc = np.where(told, tb.days_since_epoch(year, month, day) * float(tb.DAY_S) + of_day, np.nan)
    return _Clock(of_day, tb.DAY_S, utc, trusted & told, np.full(n, np.nan), np.zeros(n))


def _has_fix(name: str, table: Table | NmeaTable) -> npt.NDArray[np.int8] | None:
    """Whether each message reports a fix (1), none (0); None for a type that does not say."""
    if name == "GGA":
        return np.asarray(table["quality"] > 0, np.int8)
    if name in ("RMC", "GLL"):
        return np.asarray(table["status"] == ord("A"), np.int8)
    if name == "GNS":
        return np.asarray(np.isfinite(np.asarray(table["lat"], np.float64)), np.int8)
    if name in ("NAV-PVT", "NAV-SOL", "NAV-STATUS"):
        return np.asarray(table["flags"] & _FIX_OK, np.int8)
    return None


@njit(cache=True)
def _leap_at(utc: float, table: FloatArray) -> float:
    count = 0.0
    for k in range(len(table)):
        if utc >= table[k]:
            count += 1.0
    return count


@njit(cache=True)
def _resolve_kernel(
    partial: FloatArray,
    period: FloatArray,
    full: FloatArray,
    leap: FloatArray,
    leap_table: FloatArray,
    gps: FloatArray,
) -> None:
    """Complete each partial time to the one nearest to the time before it in the log.

    ``leap`` is NaN where a UTC time of day is to be read with the table of leap seconds.
    """
    reference = np.nan
    for i in range(len(full)):
        if not np.isnan(full[i]):
            reference = full[i]
            break
    for i in range(len(full)):
        if not np.isnan(full[i]):
            gps[i] = full[i]
            reference = full[i]
            continue
        gps[i] = np.nan
        part = partial[i]
        if np.isnan(part):
            continue
        if np.isnan(reference):
            reference = part
        added = leap[i]
        if np.isnan(added):
            added = _leap_at(reference, leap_table)
            time = part + added + period[i] * np.rint((reference - part - added) / period[i])
            midnight = time - added - part
            at = _leap_at(midnight + 60.0 * np.floor(min(part, 86399.0) / 60.0), leap_table)
            time += at - added
        else:
            time = part + added + period[i] * np.rint((reference - part - added) / period[i])
        gps[i] = time
        reference = time


@njit(cache=True)
def _join_kernel(
    code: npt.NDArray[np.int8], gps: FloatArray, untimed: int, eoe: int, epoch: IntArray
) -> int:
    """Number of the epoch [n] of each message (-1 none); returns how many epochs there are.

    A message joins one of the last four epochs if that has its time (the date aside) and not
    yet its type; otherwise it opens an epoch. Messages without a time go to the epoch that
    is open, or to the next one when an end-of-epoch message has closed it.
    """
    window = 4
    times = np.zeros(window)
    present = np.zeros(window, np.int64)
    count = 0
    closed = True
    for i in range(len(code)):
        bit = 1 << int(code[i])
        if code[i] >= untimed:
            epoch[i] = count if closed else count - 1
            continue
        if np.isnan(gps[i]):
            epoch[i] = -1
            continue
        found = -1
        for back in range(1, min(window, count) + 1):
            slot = (count - back) % window
            apart = abs(gps[i] - times[slot])
            apart -= 86400.0 * np.rint(apart / 86400.0)
            if abs(apart) <= JOIN_TOLERANCE_S and not present[slot] & bit:
                found = count - back
                present[slot] |= bit
                break
        if found < 0:
            found = count
            times[count % window] = gps[i]
            present[count % window] = bit
            count += 1
            closed = False
        if code[i] == eoe:
            closed = closed or found == count - 1
        epoch[i] = found
    for i in range(len(code)):
        if epoch[i] >= count:
            epoch[i] = -1
    return count


@njit(cache=True)
def _forward_fill(values: FloatArray) -> FloatArray:
    """NaN replaced by the value before it, at the start by the first one [n]."""
    filled = values.copy()
    last = np.nan
    for i in range(len(values)):
        if not np.isnan(values[i]):
            last = values[i]
            break
    for i in range(len(values)):
        if np.isnan(values[i]):
            filled[i] = last
        else:
            last = values[i]
    return filled


@njit(cache=True)
def _fill_kernel(
    code: npt.NDArray[np.int8],
    row: IntArray,
    offset: IntArray,
    gps: FloatArray,
    fine: FloatArray,
    full: FloatArray,
    is_utc: npt.NDArray[np.bool_],
    epoch: IntArray,
    rows: npt.NDArray[np.int32],
    epoch_offset: IntArray,
    epoch_gps: FloatArray,
) -> None:
    """Write each message [n] into its epoch [m]: the first of a type and the best time stay.

    Times go by rank: a bare time of day, one with its date, UBX, UBX with its fraction of
    a millisecond; within a rank the first message's counts.
    """
    rank_of = np.full(len(epoch_gps), -1, np.int8)
    for i in range(len(code)):
        e = epoch[i]
        if e < 0:
            continue
        if rows[code[i], e] < 0:
            rows[code[i], e] = row[i]
        if epoch_offset[e] < 0 or offset[i] < epoch_offset[e]:
            epoch_offset[e] = offset[i]
        if np.isnan(gps[i]):
            continue
        rank = int(not np.isnan(full[i])) if is_utc[i] else 2 + int(fine[i] != 0.0)
        if rank > rank_of[e]:
            rank_of[e] = rank
            epoch_gps[e] = gps[i] + fine[i]


def join_epochs(
    ubx: dict[str, Table], nmea: dict[str, NmeaTable], not_before_s: float = EARLIEST_GPS_S
) -> Joined | None:
    """Join the messages of a log into epochs; None when no message belongs to one.

    ``not_before_s`` GPS time before which a trusted date cannot be true.
    """
    parts: list[tuple[int, Table | NmeaTable, _Clock, bool]] = []
    for name, code in CODE.items():
        table: Table | NmeaTable | None = ubx.get(name)
        if table is not None:
            if len(table):
                parts.append((code, table, _ubx_clock(name, ubx[name]), False))
            continue
        table = nmea.get(name)
        if table is None:
            continue
        n = len(table["offset"])
        if code in _UNTIMED:
            gap = np.full(n, np.nan)
            clock = _Clock(gap, tb.DAY_S, gap, np.zeros(n, bool), gap, np.zeros(n))
        else:
            clock = _nmea_clock(name, nmea[name])
        parts.append((code, table, clock, True))
    if not parts:
        return None

    offset = np.concatenate([np.asarray(t["offset"], np.int64) for _, t, _, _ in parts])
    order = np.argsort(offset, kind="stable")

    def gather(values: list[FloatArray]) -> FloatArray:
        return np.asarray(np.concatenate(values)[order], np.float64)

    sizes = [len(clock.partial) for _, _, clock, _ in parts]
    codes = np.repeat(np.asarray([c for c, _, _, _ in parts], np.int8), sizes)[order]
    row = np.concatenate([np.arange(size) for size in sizes])[order]
    is_utc = np.repeat([utc for _, _, _, utc in parts], sizes)[order]
    period = np.repeat([clock.period for _, _, clock, _ in parts], sizes)[order]
    partial = gather([clock.partial for _, _, clock, _ in parts])
    full = gather([clock.full for _, _, clock, _ in parts])
    trusted = np.concatenate([clock.trusted for _, _, clock, _ in parts])[order]
    leap = gather([clock.leap for _, _, clock, _ in parts])

    # ZDA has no validity flag: its date counts while the receiver reports a fix
    zda = codes == CODE["ZDA"]
    if zda.any() and not trusted[~zda].any():
        fix = _fix_state(parts, order)
        trusted[zda] = (fix[zda] > 0) & np.isfinite(full[zda])
    if trusted.any():
        full[~trusted] = np.nan
    early = full < not_before_s
    moved = bool((early & trusted).any())
    if moved:
        full[early] = tb.undo_rollover(full[early], not_before_s)
    leap = np.where(is_utc, _forward_fill(leap), 0.0)
    dated_utc = is_utc & np.isfinite(full)
    if dated_utc.any():
        utc, of_day = full[dated_utc], partial[dated_utc]
        minute = utc - of_day + np.floor(np.minimum(of_day, 86_399.0) / 60.0) * 60.0
        told = leap[dated_utc]
        full[dated_utc] = utc + np.where(np.isfinite(told), told, tb.leap_seconds_at_utc(minute))

    gps = np.empty(len(codes))
    _resolve_kernel(partial, period, full, leap, tb.LEAP_UTC_S, gps)
    epoch = np.empty(len(codes), np.int64)
    n_epochs = _join_kernel(codes, gps, _UNTIMED[0], _EOE, epoch)
    fine = gather([clock.fine for _, _, clock, _ in parts])
    rows = np.full((len(SOURCES), n_epochs), -1, np.int32)
    first = np.full(n_epochs, -1, np.int64)
    time = np.full(n_epochs, np.nan)
    _fill_kernel(codes, row, offset[order], gps, fine, full, is_utc, epoch, rows, first, time)
    keep = (rows[:_N_NAVIGATION] >= 0).any(axis=0) | (rows[CODE["VTG"]] >= 0)
    return Joined(
        rows=rows[:, keep],
        gps_s=time[keep],
        offset=first[keep],
        no_navigation=int(np.count_nonzero(~keep)),
        untimed=int(np.count_nonzero(epoch < 0)),
        dated=bool(np.isfinite(full).any()),
        moved_eras=moved,
    )


def _fix_state(
    parts: list[tuple[int, Table | NmeaTable, _Clock, bool]], order: IntArray
) -> FloatArray:
    """Whether the latest message that says so reported a fix [n], in log order."""
    states = []
    for code, table, clock, _ in parts:
        state = _has_fix(SOURCES[code], table)
        n = len(clock.partial)
        states.append(np.full(n, np.nan) if state is None else state.astype(np.float64))
    return _forward_fill(np.concatenate(states)[order])
