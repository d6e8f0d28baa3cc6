"""Rows that a log or a receiver put between what it measured: on the straight lines from one fix to
the next, on the way on from the last one, or reckoned without satellites."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from automap.gates import exceeds_ratio
from automap.records import BoolArray, Fixes, FixType, FloatArray
from automap.sync import limits
from automap.sync.held_values import repeated, told_again
from automap.sync.receiver_path import ReceiverPath, receiver_path


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
    place, step, digit = path.place, np.diff(path.t), _digit_m(path)
    usual = float(np.median(step))
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


def _digit_m(path: ReceiverPath) -> float:
    """The last digit of the positions, m: the least step of a coordinate."""
    steps = np.diff(path.place)
    sizes = np.abs(np.concatenate([steps.real, steps.imag]))
    return max(float(sizes.min(where=sizes > 0.0, initial=np.inf)), limits.LEAST_DIGIT)


def carried_on(fixes: Fixes) -> BoolArray:
    """Rows [n] that repeat the velocity of the last measured fix, and whose position is the way on
    from it by that velocity, where the receiver measures at every second, third, ... row; else
    none.

    A velocity that is measured at all rows changes at any: at one place in the period only, by
    chance, once in the period to the power of the changes.
    """
    path = receiver_path(fixes)
    moves = np.isfinite(path.velocity) & (np.abs(path.velocity) > limits.SLOW_M_S)
    none = np.zeros(len(fixes), np.bool_)
    if np.count_nonzero(moves) < 2 * limits.LEAST_INTERVALS:
        return none
    usual = float(np.median(np.diff(path.t)))
    # tags are even in GPS time: a receiver measures at whole parts of the second
    number = np.rint((path.start_gps_s % 1.0 + path.t) / usual).astype(np.int64)
    same = np.concatenate([[False], np.diff(path.velocity) == 0.0])
    changes = np.flatnonzero(moves & ~same)
    for period in range(limits.MOST_BETWEEN + 1, 1, -1):
        many = np.bincount(number[changes] % period, minlength=period)
        own, strays = int(np.argmax(many)), int(many.sum() - many.max())
        measured = int(np.count_nonzero(moves & (number % period == own)))
        if strays > limits.STRAY_SHARE * many.max() or 2 * many.max() < measured:
            continue
        if (int(many.max()) - strays) * math.log(period) < limits.CERTAIN_LEAD_NATS:
            continue
        first = np.maximum.accumulate(np.where(same, 0, np.arange(len(path))))
        late = path.t - path.t[first]
        off = np.abs(path.place - path.place[first] - path.velocity[first] * late)
        held = same & moves & (number % period != own) & (late < period * usual)
        speed = np.abs(path.velocity[first])
        told = limits.COURSE_DIGIT_RAD * speed + limits.SPEED_DIGIT
        far = off > 2.0 * _digit_m(path) + told * late
        if held.any() and far[held].mean() < limits.STRAY_SHARE:
            # at walking pace and at rest, too, nothing is measured there
            none[path.row[same & (number % period != own)]] = True
        return none
    return none


def coasted(fixes: Fixes) -> BoolArray:
    """Rows [n] of a receiver that has lost its view and goes straight on: they repeat the velocity
    of the last measured fix, and their positions lie, but for their digits, evenly on a line.

    How often a velocity repeats by chance while the vehicle drives, the other rows show.
    """
    path = receiver_path(fixes)
    none = np.zeros(len(fixes), np.bool_)
    moves = np.isfinite(path.velocity) & (np.abs(path.velocity) > limits.SLOW_M_S)
    same = moves[1:] & (np.diff(path.velocity) == 0.0)
    digit = _digit_m(path) if len(path) > 1 else 0.0
    for first, last in repeated(same):
        many = last - first
        others = np.count_nonzero(moves) - many, np.count_nonzero(same) - many
        nats = -many * math.log((others[1] + 1.0) / (others[0] + 2.0))
        if many < limits.LEAST_REPEATS or nats < limits.CERTAIN_LEAD_NATS:
            continue
        rows = slice(first, last + 1)
        share = (path.t[rows] - path.t[first]) / (path.t[last] - path.t[first])
        way = path.place[last] - path.place[first]
        off = np.abs(path.place[rows] - path.place[first] - share * way).max()
        # positions that stay are another thing, and what tells of hills is measured
        if abs(way) > many * digit and off < 2.0 * digit and _even_heights(path, rows, share):
            none[path.row[first + 1 : last + 1]] = True
    return none


def _even_heights(path: ReceiverPath, rows: slice, share: FloatArray) -> bool:
    """Whether heights of ``rows`` lie, but for their digits, on a line at its ``share`` [m]."""
    height = path.height[rows]
    steps = np.abs(np.diff(path.height))
    digit = float(steps.min(where=steps > 0.0, initial=np.inf))
    off = np.abs(height - height[0] - share * (height[-1] - height[0]))
    return not np.isfinite(off).all() or bool(off.max() < 2.0 * digit)


def reckoned(fixes: Fixes) -> BoolArray:
    """Rows [n] whose positions the receiver says to have reckoned on without satellites, of a log
    most of whose positions it measured; else none.

    A tenth of a degree a second or a hundredth of the way is in none of its figures, and all rows
    err by it alike.
    """
    rows = (fixes.fix_type == FixType.DEAD_RECKONING) & np.isfinite(fixes.lat_rad)
    measured = (fixes.fix_type > FixType.DEAD_RECKONING) & np.isfinite(fixes.lat_rad)
    return np.asarray(rows & (np.count_nonzero(measured) > np.count_nonzero(rows)))


def nothing_new(fixes: Fixes) -> BoolArray:
    """Rows [n] that measured nothing: that say what others said already, again, between them or on
    from them, or that the receiver reckoned."""
    again = told_again(fixes) | reckoned(fixes)
    own = replace(fixes, lat_rad=np.where(again, np.nan, fixes.lat_rad))
    between = told_between(own)
    return again | (between if between.any() else carried_on(own)) | coasted(own)
