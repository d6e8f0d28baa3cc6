"""Arrival times: at which host time which byte of a receiver log came in."""

from __future__ import annotations

import dataclasses
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.named_table import read_table
from automap.io.table_form import TableForm
from automap.records import NO_TIME, Fixes, IntArray

MOST_BACKWARDS = 0.1
"""Share of rows that may run backwards and be left out as garbled; more are no clock."""


@dataclass(frozen=True)
class ArrivalTimes:
    """Byte offsets [n] and the host times [n], ns, at which those bytes came; ``warnings`` say
    what was left out, ``notes`` what was guessed."""

    offset: IntArray
    t_ns: IntArray
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_arrival(path: Path, form: TableForm | None = None) -> ArrivalTimes:
    """Read ``offset, t_ns``; other names and times as ``form`` says or by a guess.

    Rows that cannot be read, or run backwards, are left out and counted. Raises InputError
    where a column is missing, nothing is left, or more than a few rows run backwards.
    """
    table = read_table(path, "arrival", form)
    if table.t_ns is None:
        raise InputError(
            f"{path}: line {table.rows.header_line} names no column t_ns; the columns offset,t_ns "
            "are needed"
        )
    offset, t_ns = np.asarray(table.rows.columns["offset"], np.int64), table.t_ns
    warnings = table.rows.warnings()
    kept = np.arange(len(offset))
    for what, values in (("offset", offset), ("t_ns", t_ns)):
        forward = _not_backwards(values[kept])
        lost = np.setdiff1d(np.arange(len(kept)), forward)
        # a last line that was cut off within a number is no fault of the clock
        if len(lost) and lost.tolist() != [len(kept) - 1]:
            line = table.rows.line(int(kept[lost[0]]))
            if len(lost) > MOST_BACKWARDS * len(kept):
                back = int(kept[np.flatnonzero(np.diff(values[kept]) < 0)[0] + 1])
                raise InputError(
                    f"{path}: {what} runs backwards in line {table.rows.line(back)}; "
                    "each row must be later in the log than the one before"
                )
            warnings.append(
                f"{path}: {len(lost)} rows where {what} does not fit those around were left out, "
                f"the first in line {line}"
            )
        kept = kept[forward]
    return ArrivalTimes(offset[kept], t_ns[kept], tuple(warnings), table.notes)


def _not_backwards(values: IntArray) -> IntArray:
    """Rows of the longest piece of a column [n] that never falls."""
    if np.all(np.diff(values) >= 0):
        return np.arange(len(values))
    ends: list[int] = []
    rows: list[int] = []
    before = np.full(len(values), -1, np.int64)
    for row, value in enumerate(values.tolist()):
        at = bisect_right(ends, value)
        before[row] = rows[at - 1] if at else -1
        ends[at : at + 1], rows[at : at + 1] = [value], [row]
    chain, row = [], rows[-1]
    while row >= 0:
        chain.append(row)
        row = int(before[row])
    return np.array(chain[::-1], np.int64)


def attach_arrival(fixes: Fixes, arrival: ArrivalTimes) -> Fixes:
    """Fixes with the host time at which each epoch's first byte arrived.

    That is the time of the last row whose offset is not beyond the epoch's first byte;
    epochs before the first row have none.
    """
    row = np.searchsorted(arrival.offset, fixes.offset, side="right") - 1
    known = (row >= 0) & (fixes.offset >= 0)
    came_ns = np.where(known, arrival.t_ns[np.maximum(row, 0)], NO_TIME)
    return dataclasses.replace(fixes, arrival_ns=came_ns.astype(np.int64))
