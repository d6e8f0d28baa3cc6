"""Sigmas of a path as large as what contradicts it, where it does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from automap.fusion import limits
from automap.fusion.doubts.difference import Difference, between, no_difference, within
from automap.fusion.doubts.limits import STEP_WINDOW_S
from automap.fusion.doubts.path import Misses, local_error
from automap.fusion.doubts.reason import Reason
from automap.records import FloatArray, Trajectory


def widen(
    path: Trajectory, reasons: Sequence[Reason], misses: Misses, alone: Trajectory | None
) -> Trajectory:
    """The path with sigmas as ``widening`` makes them."""
    return widening(path, reasons, misses, alone)(path, slice(0, len(path)))


def widening(
    path: Trajectory, reasons: Sequence[Reason], misses: Misses, alone: Trajectory | None
) -> Callable[[Trajectory, slice], Trajectory]:
    """What gives a stretch of the path, which has the rows ``rows`` of it, sigmas as large as what
    ``reasons`` show, where they show it.

    There the horizontal error counts as no smaller than that to the fixes round about, and than
    the distance to the path ``alone`` of the fixes; those of velocity and heading as no smaller
    than they differ from that path's. What may be of another instant is, tilts too, as unsure as it
    changes.
    """
    reasons = [reason for reason in reasons if not reason.handled]
    if not reasons:
        return lambda stretch, rows: stretch
    missed = local_error(misses)
    away = None if alone is None else between(path, alone)
    return lambda stretch, rows: _widened(stretch, rows, path, reasons, (misses.t, missed), away)


def _widened(
    stretch: Trajectory,
    rows: slice,
    path: Trajectory,
    reasons: Sequence[Reason],
    missed: tuple[FloatArray, FloatArray],
    away: Callable[[FloatArray], Difference] | None,
) -> Trajectory:
    t = stretch.gps_s - path.gps_s[0]
    error = np.interp(t, *missed) if len(missed[0]) else np.zeros(len(t))
    apart = no_difference(len(t)) if away is None else away(stretch.gps_s)
    factor, floor, high = np.ones(len(t)), np.zeros(len(t)), np.zeros(len(t))
    doubted, turned = np.zeros(len(t), np.bool_), np.zeros(len(t))
    swerving = np.zeros(len(t))
    late, only, led = np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t), np.bool_)
    for reason in reasons:
        there = np.zeros(len(t), np.bool_)
        for a, b in reason.spans:
            there |= (t >= a) & (t <= b)
        if not reason.spans:
            there[:] = True
        doubted |= there & (reason.state != "good")
        led |= there & reason.led
        if not reason.span_errors_m:
            floor[there] = np.maximum(floor[there], reason.error_m)
        for least, errors in ((floor, reason.span_errors_m), (high, reason.span_heights_m)):
            for (a, b), metres in zip(reason.spans, errors, strict=False):
                known = slice(np.searchsorted(t, a), np.searchsorted(t, b, side="right"))
                least[known] = np.maximum(least[known], metres)
        over = zip(reason.spans, reason.span_errors_m, strict=False) if reason.led else ()
        for (a, b), metres in over:
            # off by so much half way between the ends that it is led from: half a wave
            known = slice(np.searchsorted(t, a), np.searchsorted(t, b, side="right"))
            swerving[known] = np.maximum(
                swerving[known], 0.5 * np.pi * metres / (b - a + 2.0 * STEP_WINDOW_S)
            )
        factor[there] = np.maximum(factor[there], reason.factor)
        high[there] = np.maximum(high[there], reason.height_m)
        late[there] = np.maximum(late[there], reason.late_s)
        only[there] = np.maximum(only[there], reason.moved_s)
        turned[there] = np.maximum(turned[there], reason.heading)
    # fixes say nothing of a path that an IMU leads past them
    doubted &= ~led
    moved, motion = within(path, late, rows), within(path, np.maximum(late, only), rows)
    floor = np.max([floor, moved.position, doubted * np.maximum(error, apart.position)], axis=0)
    off = np.maximum(motion.velocity, doubted[:, None] * apart.velocity)
    off = np.maximum(off, swerving[:, None] * [1.0, 1.0, 0.0])
    turned = np.max([turned, motion.heading, doubted * apart.heading], axis=0)
    sd = stretch.sd_pos_ned * factor[:, None]
    # per axis: an error of this length may have any direction
    sd[:, :2] = np.sqrt(sd[:, :2] ** 2 + 0.5 * floor[:, None] ** 2)
    sd[:, 2] = np.hypot(sd[:, 2], np.maximum(high, moved.height))
    rpy = stretch.sd_rpy * factor[:, None]
    rpy[:, :2] = np.hypot(rpy[:, :2], motion.tilt)
    rpy[:, 2] = np.minimum(np.hypot(rpy[:, 2], turned), limits.UNKNOWN_HEADING_SD)
    return replace(
        stretch,
        sd_pos_ned=sd,
        sd_vel_ned=np.hypot(stretch.sd_vel_ned * factor[:, None], off),
        sd_rpy=rpy,
    )
