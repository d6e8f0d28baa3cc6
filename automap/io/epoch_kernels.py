"""The loops that walk a log's messages in order; see :mod:`automap.io.epoch_join`.

Messages stand type by type in their arrays [n]; ``order`` [n] gives them in log order.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from automap.io.kernel import Kernel
from automap.records import BoolArray, FloatArray, IntArray

JOIN_TOLERANCE_S = 0.0105
"""Sentences give the time to 10 ms, rounded or cut, of an epoch that UBX gives to 1 ms."""

WINDOW = 4
"""How many epochs back a message may still belong to."""

_DAY = 86_400.0
_WEEK = 604_800.0


@Kernel
def merge_kernel(
    offset: IntArray, at: IntArray, ends: IntArray, order: IntArray, part: npt.NDArray[np.int8]
) -> None:
    """Bring messages [n], by offset within each of the parts [p], in order of offset.

    ``at`` [p] is where each part begins and is moved to its end, ``ends`` [p]; ``part`` [n]
    is the part of each message in log order.
    """
    for place in range(len(order)):
        chosen = -1
        least = 0
        for p in range(len(at)):
            if at[p] < ends[p] and (chosen < 0 or offset[at[p]] < least):
                chosen = p
                least = offset[at[p]]
        order[place] = at[chosen]
        part[place] = chosen
        at[chosen] += 1


@Kernel
def _leap_at(utc: float, table: FloatArray) -> float:
    count = len(table)
    while count > 0 and not utc >= table[count - 1]:
        count -= 1
    return float(count)


@Kernel
def resolve_kernel(
    order: IntArray,
    part: npt.NDArray[np.int8],
    is_utc: BoolArray,
    partial: FloatArray,
    full: FloatArray,
    leap: FloatArray,
    leap_table: FloatArray,
    gps: FloatArray,
) -> None:
    """GPS time [n] of each message: its own, or that nearest to the time before it in the log.

    ``is_utc`` [p] are the parts whose ``full`` is UTC and becomes GPS time here. ``leap`` is
    what the receiver tells; the latest figure counts for the sentences, before the first one
    that, and where there is none the table of leap seconds.
    """
    first_leap = np.nan
    for place in range(len(order)):
        if leap[order[place]] == leap[order[place]]:
            first_leap = leap[order[place]]
            break
    told = first_leap
    reference = np.nan
    for place in range(len(order)):
        i = order[place]
        if leap[i] == leap[i]:
            told = leap[i]
        if full[i] != full[i]:
            continue
        if is_utc[part[place]]:
            if told == told:
                full[i] += told
            else:
                of_day = partial[i]
                minute = full[i] - of_day + np.floor(min(of_day, 86399.0) / 60.0) * 60.0
                full[i] += _leap_at(minute, leap_table)
        if reference != reference:
            reference = full[i]
    told = first_leap
    for place in range(len(order)):
        i = order[place]
        if leap[i] == leap[i]:
            told = leap[i]
        if full[i] == full[i]:
            gps[i] = full[i]
            reference = full[i]
            continue
        gps[i] = np.nan
        own = partial[i]
        if own != own:
            continue
        if reference != reference:
            reference = own
        if not is_utc[part[place]]:
            time = own + _WEEK * np.rint((reference - own) / _WEEK)
        elif told == told:
            time = own + told + _DAY * np.rint((reference - own - told) / _DAY)
        else:
            added = _leap_at(reference, leap_table)
            time = own + added + _DAY * np.rint((reference - own - added) / _DAY)
            midnight = time - added - own
            minute = midnight + 60.0 * np.floor(min(own, 86399.0) / 60.0)
            time += _leap_at(minute, leap_table) - added
        gps[i] = time
        reference = time


@Kernel
def join_kernel(
    order: IntArray,
    part: npt.NDArray[np.int8],
    untimed: BoolArray,
    closing: BoolArray,
    gps: FloatArray,
    times: FloatArray,
    present: IntArray,
    epoch: IntArray,
) -> int:
    """Number of the epoch [n] of each message (-1 none); returns how many epochs there are.

    A message joins one of the last epochs if that has its time (the date aside) and not yet
    its type; otherwise it opens an epoch. Messages of an ``untimed`` part [p] go to the epoch
    that is open, or to the next one when an end-of-epoch message (``closing`` [p]) has closed
    it. ``times``, ``present`` [WINDOW] are zeros to work with.
    """
    count = 0
    closed = True
    for place in range(len(order)):
        i = order[place]
        p = part[place]
        if untimed[p]:
            epoch[i] = count if closed else count - 1
            continue
        time = gps[i]
        if time != time:
            epoch[i] = -1
            continue
        bit = 1 << p
        found = -1
        for back in range(1, min(WINDOW, count) + 1):
            slot = (count - back) % WINDOW
            apart = abs(time - times[slot])
            if apart > 43_200.0:
                apart = abs(apart - _DAY * np.rint(apart / _DAY))
            if apart <= JOIN_TOLERANCE_S and not present[slot] & bit:
                found = count - back
                present[slot] |= bit
                break
        if found < 0:
            found = count
            times[count % WINDOW] = time
            present[count % WINDOW] = bit
            count += 1
            closed = False
        if closing[p]:
            closed = closed or found == count - 1
        epoch[i] = found
    for i in range(len(epoch)):
        # after the last end of an epoch none was opened
        if epoch[i] >= count:
            epoch[i] = -1
    return count


@Kernel
def fill_kernel(
    order: IntArray,
    part: npt.NDArray[np.int8],
    starts: IntArray,
    is_utc: BoolArray,
    offset: IntArray,
    gps: FloatArray,
    fine: FloatArray,
    full: FloatArray,
    epoch: IntArray,
    rank_of: npt.NDArray[np.int8],
    rows: npt.NDArray[np.int32],
    epoch_offset: IntArray,
    epoch_gps: FloatArray,
) -> None:
    """Write each message [n] into its epoch [m]: the first of a type and the best time stay.

    Times go by rank (-1 beforehand): a bare time of day, one with its date, UBX, UBX with its
    fraction of a millisecond; within a rank the first message's counts. ``starts`` [p] is
    where each part begins, ``rows`` [p, m] and ``epoch_offset`` [m] are -1 beforehand.
    """
    for place in range(len(order)):
        i = order[place]
        e = epoch[i]
        if e < 0:
            continue
        p = part[place]
        if rows[p, e] < 0:
            rows[p, e] = i - starts[p]
        if epoch_offset[e] < 0 or offset[i] < epoch_offset[e]:
            epoch_offset[e] = offset[i]
        if gps[i] != gps[i]:
            continue
        # truth values count as 0 and 1
        rank = 0 + (full[i] == full[i]) if is_utc[p] else 2 + (fine[i] != 0.0)
        if rank > rank_of[e]:
            rank_of[e] = rank
            epoch_gps[e] = gps[i] + fine[i]


@Kernel
def latest_kernel(order: IntArray, known: BoolArray, value: BoolArray, latest: BoolArray) -> None:
    """Of each message [n] the value that the latest known one before it gave, before the
    first one that."""
    state = False
    for place in range(len(order)):
        if known[order[place]]:
            state = value[order[place]]
            break
    for place in range(len(order)):
        i = order[place]
        if known[i]:
            state = value[i]
        latest[i] = state
