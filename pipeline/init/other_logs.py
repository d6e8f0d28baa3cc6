"""Receiver logs beside the one that is taken: whether their places are at the same times."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from automap.earth import local_ned
from automap.errors import AutoMapError
from automap.io.receiver import read_receiver_log
from automap.records import Fixes, FloatArray

MOST_S = 20
"""GPS time is 18 leap seconds before UTC; a receiver that has not learnt them errs by some."""
CLEARLY = 3.0
"""Times by which places agree better with one log later: the way of a second in a town is 10 m,
receivers side by side are 3 m apart."""
FEW = 30
"""Fixes that two logs share at least."""


def told(taken: Path, others: Iterable[Path]) -> list[str]:
    """A sentence for each log that is not taken."""
    others = list(others)
    try:
        own = read_receiver_log(taken).fixes if others else None
    except AutoMapError:
        own = None
    return [_told(taken, own, other) for other in others]


def _told(taken: Path, own: Fixes | None, other: Path) -> str:
    sentence = f"{other.name} is a receiver's log too and is not taken"
    try:
        late = None if own is None else seconds_late(own, read_receiver_log(other).fixes)
    except AutoMapError as error:
        return f"{sentence}: {error}".rstrip(".")
    if not late:
        return sentence
    return (
        f"{sentence}; it has the same places {abs(late)} s {'later' if late > 0 else 'earlier'} "
        f"than {taken.name}, so the seconds of one of the two are wrong, as by leap seconds: take "
        "the one whose times are UTC by another clock"
    )


def seconds_late(own: Fixes, other: Fixes) -> int | None:
    """The whole seconds by which ``other`` has the places of ``own`` later; None where places or
    times have nothing in common, or standing tells nothing."""
    t, place = _path(own, own)
    u, there = _path(other, own)
    if len(t) < 2 or len(u) < 2:
        return None
    shifts = np.arange(-MOST_S, MOST_S + 1)
    apart = np.full(len(shifts), np.inf)
    for k, shift in enumerate(shifts):
        shared = (u - shift >= t[0]) & (u - shift <= t[-1])
        if np.count_nonzero(shared) >= FEW:
            at = np.column_stack([np.interp(u[shared] - shift, t, axis) for axis in place.T])
            apart[k] = float(np.sqrt(np.mean(np.sum((there[shared] - at) ** 2, axis=1))))
    best = int(np.argmin(apart))
    if not np.isfinite(apart[best]):
        return None
    return int(shifts[best]) if apart[best] * CLEARLY < apart[MOST_S] else 0


def _path(fixes: Fixes, origin: Fixes) -> tuple[FloatArray, FloatArray]:
    """Times [n], GPS s, and places [n, 2] north, east, m, of the fixes that have both."""
    known = np.isfinite(fixes.gps_s) & np.isfinite(fixes.lat_rad)
    first = np.flatnonzero(np.isfinite(origin.lat_rad))[:1]
    if not len(first) or not known.any():
        return np.empty(0), np.empty((0, 2))
    reference = (float(origin.lat_rad[first[0]]), float(origin.lon_rad[first[0]]), 0.0)
    flat = np.zeros(np.count_nonzero(known))
    ned = local_ned(fixes.lat_rad[known], fixes.lon_rad[known], flat, reference)
    return fixes.gps_s[known], ned[:, :2]
