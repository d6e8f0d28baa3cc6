"""Receiver messages joined into epochs: every message its GPS time, every time its messages.

Messages know their time only in part: UBX ones the time of week, most sentences the time of
day. Walking the log in order, each part is completed to the time nearest the one before it,
so weeks and days roll over by themselves, and a full date anywhere in the log dates it all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap import timebase as tb
from automap.io import epoch_kernels as ek
from automap.io.epoch_clock import Clock, has_fix, nmea_clock, ubx_clock
from automap.io.nmea import NmeaTable
from automap.io.ubx import Table
from automap.records import BoolArray, FloatArray, IntArray

EARLIEST_GPS_S = 1356.0 * tb.WEEK_S
"""Start of 2006, before u-blox 5: an earlier date is one of a past 1024-week era."""

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

_NAVIGATION = (*SOURCES[: SOURCES.index("NAV-STATUS")], "VTG")
"""These carry position or velocity; an epoch without any of them is none."""
_UNTIMED = ("VTG", "GSA")
_DATED = ("NAV-PVT", "NAV-SOL", "NAV-TIMEGPS", "NAV-TIMEUTC", "RMC", "ZDA")
_GOES_ON_S = 2.0
"""A time of day that moves on by no more than this, or two usual steps, goes on. Two drives of
differing days in one log would meet so once in 20 000, were their times of day drawn."""


@dataclass(frozen=True)
class Joined:
    """Epochs [m] in log order.

    ``rows`` [m] for each type that the log has: its row in that type's table, -1 for none;
    ``gps_s`` [m]; ``offset`` [m]
    of the first message; ``no_navigation`` counts times with neither position nor velocity,
    ``untimed`` messages whose time could not be read; ``dated`` is False where the log never
    says the week or date; ``moved_eras`` tells of dates moved on by 1024 weeks, ``redated``
    counts messages whose date the time of day beside them contradicted.
    """

    rows: dict[str, npt.NDArray[np.int32]]
    gps_s: FloatArray
    offset: IntArray
    no_navigation: int
    untimed: int
    dated: bool
    moved_eras: bool
    redated: int


@dataclass(frozen=True)
class _Messages:
    """All messages [n] that make up epochs, part after part, a part [p] being one type.

    ``order`` [n] gives them in log order, ``part`` [n] their parts in that order; part p has
    the messages from ``starts[p]`` to ``starts[p + 1]``.
    """

    names: list[str]
    tables: list[Table | NmeaTable]
    clocks: list[Clock]
    offset: IntArray
    starts: IntArray
    order: IntArray
    part: npt.NDArray[np.int8]

    def of_part(self, name: str) -> slice:
        """The messages of a type."""
        p = self.names.index(name)
        return slice(int(self.starts[p]), int(self.starts[p + 1]))

    def among(self, names: tuple[str, ...]) -> BoolArray:
        """Whether each part [p] is one of ``names``."""
        return np.array([name in names for name in self.names])

    def gather(self, field: str) -> npt.NDArray[np.generic]:
        """One field of all clocks [n]."""
        values = [getattr(clock, field) for clock in self.clocks]
        # a copy, for what is in it will be changed
        return np.concatenate(values) if len(values) > 1 else values[0].copy()


def _messages(
    ubx: dict[str, Table], nmea: dict[str, NmeaTable], log_bytes: int
) -> _Messages | None:
    names: list[str] = []
    tables: list[Table | NmeaTable] = []
    clocks: list[Clock] = []
    for name in SOURCES:
        if name in ubx:
            if len(ubx[name]):
                tables.append(ubx[name])
                clocks.append(ubx_clock(name, ubx[name]))
                names.append(name)
        elif name in nmea:
            tables.append(nmea[name])
            clocks.append(nmea_clock(name, nmea[name]))
            names.append(name)
    if not names:
        return None
    starts = np.concatenate([[0], np.cumsum([len(clock) for clock in clocks])]).astype(np.int64)
    offset = np.concatenate([np.asarray(table["offset"], np.int64) for table in tables])
    order = np.empty(len(offset), np.int64)
    part = np.empty(len(offset), np.int8)
    ek.merge_kernel.run(log_bytes, offset, starts[:-1].copy(), starts[1:], order, part)
    return _Messages(names, tables, clocks, offset, starts, order, part)


def join_epochs(
    ubx: dict[str, Table],
    nmea: dict[str, NmeaTable],
    log_bytes: int,
    not_before_s: float = EARLIEST_GPS_S,
) -> Joined | None:
    """Join the messages of a log into epochs; None when no message belongs to one.

    ``not_before_s`` GPS time before which a trusted date cannot be true. ``log_bytes`` is the
    size of the log.
    """
    messages = _messages(ubx, nmea, log_bytes)
    if messages is None:
        return None
    order, part = messages.order, messages.part
    is_utc = np.array([clock.is_utc for clock in messages.clocks])
    full = messages.gather("full").astype(np.float64, copy=False)
    moved = _keep_trusted(messages, full, log_bytes, not_before_s)
    redated = sum(
        _agree_on_date(full[messages.of_part(name)]) for name in messages.names if name in _DATED
    )
    partial = messages.gather("partial")
    fine = messages.gather("fine")
    leap = messages.gather("leap")
    n = len(order)
    gps = np.empty(n)
    ek.resolve_kernel.run(log_bytes, order, part, is_utc, partial, full, leap, tb.LEAP_UTC_S, gps)
    epoch = np.empty(n, np.int64)
    n_epochs = ek.join_kernel.run(
        log_bytes,
        order,
        part,
        messages.among(_UNTIMED),
        messages.among(("NAV-EOE",)),
        gps,
        np.zeros(ek.WINDOW),
        np.zeros(ek.WINDOW, np.int64),
        epoch,
    )
    rows = np.full((len(messages.names), n_epochs), -1, np.int32)
    first = np.full(n_epochs, -1, np.int64)
    time = np.full(n_epochs, np.nan)
    ek.fill_kernel.run(
        log_bytes,
        order,
        part,
        messages.starts,
        is_utc,
        messages.offset,
        gps,
        fine,
        full,
        epoch,
        np.full(n_epochs, -1, np.int8),
        rows,
        first,
        time,
    )
    keep = (rows[messages.among(_NAVIGATION)] >= 0).any(axis=0)
    no_navigation = n_epochs - int(np.count_nonzero(keep))
    if no_navigation:
        rows, time, first = rows[:, keep], time[keep], first[keep]
    return Joined(
        rows=dict(zip(messages.names, rows, strict=True)),
        gps_s=time,
        offset=first,
        no_navigation=no_navigation,
        untimed=int(np.count_nonzero(epoch < 0)),
        dated=bool(np.isfinite(full).any()),
        moved_eras=moved,
        redated=redated,
    )


def _keep_trusted(
    messages: _Messages, full: FloatArray, log_bytes: int, not_before_s: float
) -> bool:
    """Take dates out of ``full`` [n] that nothing vouches for, move on those of a past era.

    Where no date has a valid clock all stay. Returns whether any was moved.
    """
    trusted = messages.gather("trusted").astype(bool, copy=False)
    # ZDA has no validity flag: its date counts while the receiver reports a fix
    if "ZDA" in messages.names and not trusted.any():
        zda = messages.of_part("ZDA")
        trusted[zda] = _fix_state(messages, log_bytes)[zda] & np.isfinite(full[zda])
    if trusted.any():
        full[~trusted] = np.nan
    early = full < not_before_s
    moved = bool((early & trusted).any())
    if moved:
        full[early] = tb.undo_rollover(full[early], not_before_s)
    return moved


def _agree_on_date(full: FloatArray) -> int:
    """Give times [n] of one type, in log order, NaN where no date is told, one date where the
    time of day goes on and the date does not; returns how many were changed.

    The date of most of them holds; of dates whole eras of the ten-bit week apart the latest,
    for firmware that does not know the era begins with the first.
    """
    rows = np.flatnonzero(np.isfinite(full))
    steps = np.diff(full[rows])
    days = np.rint(steps / tb.DAY_S).astype(np.int64)
    if not days.any():
        return 0
    usual = max(_GOES_ON_S, 2.0 * float(np.median(np.abs(steps))))
    era_days = tb.ROLLOVER_S // tb.DAY_S
    # no two drives are whole eras apart, however long nothing was logged between
    goes_on = (np.abs(steps - days * tb.DAY_S) <= usual) | (days % era_days == 0)
    log = np.concatenate([[0], np.cumsum(~goes_on)])
    off = np.concatenate([[0], np.cumsum(np.where(goes_on, days, 0))])
    changed = 0
    for one in np.unique(log[1:][goes_on & (days != 0)]):
        mine = np.flatnonzero(log == one)
        _, which, counts = np.unique(off[mine] % era_days, return_inverse=True, return_counts=True)
        best = int(off[mine[which == np.argmax(counts)]].max())
        full[rows[mine]] += (best - off[mine]) * float(tb.DAY_S)
        changed += int(np.count_nonzero(off[mine] != best))
    return changed


def _fix_state(messages: _Messages, log_bytes: int) -> BoolArray:
    """Whether the latest message that says so reported a fix [n]."""
    known, value = [], []
    for name, table, clock in zip(messages.names, messages.tables, messages.clocks, strict=True):
        state = has_fix(name, table)
        known.append(np.full(len(clock), state is not None))
        value.append(np.zeros(len(clock), bool) if state is None else state)
    latest = np.zeros(len(messages.order), bool)
    ek.latest_kernel.run(
        log_bytes, messages.order, np.concatenate(known), np.concatenate(value), latest
    )
    return latest
