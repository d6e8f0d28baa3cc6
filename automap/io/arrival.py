"""Arrival times: at which host time which byte of a receiver log came in."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.records import NO_TIME, Fixes, IntArray


def read_arrival(path: Path) -> tuple[IntArray, IntArray]:
    """Byte offsets [n] and host times [n], ns, of an arrival file.

    The columns ``offset`` and ``t_ns`` are found by name. A last line that was cut off is
    left out. Raises InputError where a column is missing, a value is no whole number, or
    offsets or times run backwards.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is no text; a CSV with the columns offset,t_ns is needed"
        ) from error
    if not text.strip():
        raise InputError(f"{path} is empty; remove `arrival` from drive.toml or record it again")
    lines = text.split("\n")
    names = [name.strip() for name in lines[0].split(",")]
    for name in ("offset", "t_ns"):
        if name not in names:
            raise InputError(
                f"{path}: line 1 names no column {name}; the columns offset,t_ns are needed"
            )
    at_offset, at_time = names.index("offset"), names.index("t_ns")
    offset: list[int] = []
    times_ns: list[int] = []
    numbers: list[int] = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        cells = line.split(",")
        try:
            pair = int(cells[at_offset]), int(cells[at_time])
        except (IndexError, ValueError) as error:
            if number == len(lines):  # no line end: the recording stopped here
                break
            raise InputError(
                f"{path}: line {number} is {line.strip()[:40]!r}; "
                "a whole number is needed in each of offset and t_ns"
            ) from error
        if number == len(lines) and times_ns and pair[1] < times_ns[-1]:
            break  # the last number was cut off as well
        offset.append(pair[0])
        times_ns.append(pair[1])
        numbers.append(number)
    if not offset:
        raise InputError(f"{path} has no rows; remove `arrival` from drive.toml or record it again")
    try:
        offsets, times = np.asarray(offset, np.int64), np.asarray(times_ns, np.int64)
    except OverflowError as error:
        raise InputError(f"{path}: a number is too large for 64 bits") from error
    for what, values in (("offset", offsets), ("t_ns", times)):
        back = np.flatnonzero(np.diff(values) < 0)
        if len(back):
            raise InputError(
                f"{path}: {what} runs backwards in line {numbers[back[0] + 1]}; "
                "each row must be later in the log than the one before"
            )
    return offsets, times


def attach_arrival(fixes: Fixes, offset: IntArray, t_ns: IntArray) -> Fixes:
    """Fixes with the host time at which each epoch's first byte arrived.

    That is the time of the last row whose offset is not beyond the epoch's first byte;
    epochs before the first row have none.
    """
    row = np.searchsorted(offset, fixes.offset, side="right") - 1
    known = (row >= 0) & (fixes.offset >= 0)
    arrival = np.where(known, t_ns[np.maximum(row, 0)], NO_TIME)
    return dataclasses.replace(fixes, arrival_ns=arrival.astype(np.int64))
