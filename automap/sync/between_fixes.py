"""Positions that were put on the straight lines between a receiver's own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from automap.gates import exceeds_ratio
from automap.records import BoolArray, Fixes
from automap.sync import limits
from automap.sync.held_values import told_again
from automap.sync.receiver_path import receiver_path


def told_between(fixes: Fixes) -> BoolArray:
    """Rows [n] whose positions lie, but for their digits, on the line from the row before to the
    row after, where all do but every second, third, ... one; else none.

    A receiver's own errors, and bends, are in all rows alike: where they are in every tenth only,
    nothing was measured at the others (mean squares by place in the period, Fisher's F).
    """
    path = receiver_path(fixes)
    inner = np.zeros(len(fixes), np.bool_)
    if len(path) < 2 * limits.LEAST_INTERVALS:
        return inner
    place, step = path.place, np.diff(path.t)
    usual = float(np.median(step))
    digits = np.abs(np.concatenate([np.diff(place.real), np.diff(place.imag)]))
    digit = max(float(digits.min(where=digits > 0.0, initial=np.inf)), limits.LEAST_DIGIT)
    even = np.abs(np.stack([step[:-1], step[1:]]) / usual - 1.0).max(axis=0) < limits.EVEN_STEP
    moves = np.abs(place[2:] - place[:-2]) > limits.MOVED_DIGITS * digit
    rows = 1 + np.flatnonzero(even & moves)
    off = np.abs(place[rows] - 0.5 * (place[rows - 1] + place[rows + 1])) ** 2
    number = np.rint(path.t / usual).astype(np.int64)
    # every fifth row of a tenth's lines lies on one as well: the longest period is theirs
    for period in range(limits.MOST_BETWEEN + 1, 1, -1):
        many = np.bincount(number[rows] % period, minlength=period)
        if many.min() < limits.LEAST_INTERVALS:
            continue
        mean = np.bincount(number[rows] % period, off, minlength=period) / many
        own = int(np.argmax(mean))
        other = np.delete(mean, own)
        # rounded north and east to a digit, a position errs so far from a line
        if other.max() > digit**2 or mean[own] <= digit**2:
            continue
        ratio = float(mean[own] / max(float(other.mean()), limits.LEAST_DIGIT**2))
        chance = exceeds_ratio(ratio, 2 * int(many[own]), 2 * int(many.sum() - many[own]))
        # of as many periods, and places in each
        if chance * limits.MOST_BETWEEN**2 < math.exp(-limits.CERTAIN_LEAD_NATS):
            inner[path.row[number % period != own]] = True
            return inner
    return inner


def nothing_new(fixes: Fixes) -> BoolArray:
    """Rows [n] that say what others said already: again, or between them."""
    again = told_again(fixes)
    own = replace(fixes, lat_rad=np.where(again, np.nan, fixes.lat_rad))
    return again | told_between(own)
