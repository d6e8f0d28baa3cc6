"""What the receiver's velocities and positions say of each other, and fixes without what is wrong
beyond doubt."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.path import Misses
from automap.fusion.doubts.reason import Reason, Span, State
from automap.fusion.limits import LEAST_JUDGED
from automap.fusion.measurements.position import has_position, states_accuracy
from automap.fusion.measurements.velocity import told_later
from automap.fusion.options import FusionOptions
from automap.gates import sd_by_median
from automap.records import BoolArray, Fixes, FixType, FloatArray, ReceiverFilter
from automap.sync.between_fixes import nothing_new
from automap.sync.held_values import held_at_rest
from automap.sync.limits import DELAY_SD_S
from automap.sync.path_match import Estimate
from automap.sync.velocity_findings import Interval, VelocityConsistency, told_intervals

_HELD = ("velocity_stuck", "position_frozen", "rows_frozen", "height_held")
_LEFT_OUT = ": they were left out; check the receiver's log and how it was made"


def usable_fixes(fixes: Fixes, found: VelocityConsistency) -> Fixes:
    """Fixes without the velocities and positions that cannot be right; courses against another
    north are turned to that of the positions, positions older than their velocities are dated back.
    """
    again = nothing_new(fixes)
    velocity = fixes.vel_ned.copy()
    position = found.unusable_position(fixes) | again | held_at_rest(fixes)
    velocity[again] = np.nan
    velocity[found.unusable_velocity(fixes), :2] = np.nan
    velocity[found.unusable_vertical_velocity(fixes), 2] = np.nan
    if found.course_off and found.match.turn_rad is not None:
        velocity[:, :2] = velocity[:, :2] @ _turned_by(found.match.turn_rad.value).T
    held = found.held_height(fixes)
    height = np.where(found.height_stuck | held, np.nan, fixes.height_m)
    usable = replace(
        fixes,
        vel_ned=velocity,
        height_m=height,
        # a solution that keeps its height is of three satellites
        fix_type=np.where(held, np.minimum(fixes.fix_type, FixType.TWO_D), fixes.fix_type),
        lat_rad=np.where(position, np.nan, fixes.lat_rad),
        lon_rad=np.where(position, np.nan, fixes.lon_rad),
    )
    late_s = found.positions_late_s
    return _dated_positions(usable, late_s) if late_s else usable


def _dated_positions(fixes: Fixes, late_s: float) -> Fixes:
    """Fixes whose positions are those told ``late_s`` s after; unknown where there is none."""
    told = np.isfinite(fixes.lat_rad) & np.isfinite(fixes.lon_rad) & np.isfinite(fixes.gps_s)
    told &= fixes.fix_type >= FixType.TWO_D
    rows = np.flatnonzero(told)
    rows = rows[np.argsort(fixes.gps_s[rows], kind="stable")]
    dated = np.full((len(fixes), 3), np.nan)
    if len(rows) > 1:
        t = fixes.gps_s[rows]
        within = ~_far(t, t + late_s)
        places = fixes.lat_rad[rows], np.unwrap(fixes.lon_rad[rows]), fixes.height_m[rows]
        dated[rows[within]] = np.column_stack(
            [np.interp(t[within] + late_s, t, place) for place in places]
        )
    return replace(fixes, lat_rad=dated[:, 0], lon_rad=dated[:, 1], height_m=dated[:, 2])


def _far(t: FloatArray, at: FloatArray) -> BoolArray:
    """Which instants ``at`` [k] lie after the last of ``t`` [m] or in a gap of them."""
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    gap = t[after] - t[after - 1] > limits.GAP_STEPS * np.median(np.diff(t))
    return np.asarray((at > t[-1]) | gap)


def _turned_by(angle: float) -> FloatArray:
    """Matrix [2, 2] that turns north and east clockwise by ``angle`` rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def told_late(lag: Estimate | None) -> float:
    """By how much, s, velocities are told late; 0 where chance makes as much."""
    return lag.value if lag is not None and abs(lag.value) > limits.LAG_SIGMAS * lag.sd else 0.0


def dated_velocities(fixes: Fixes, found: VelocityConsistency) -> Fixes:
    """Fixes whose speeds and courses are those of the positions' instants, for a smoother that
    knows no lag: each is taken from as much later as the receiver told it late.

    A velocity is unknown where there is none within reach to take it from.
    """
    speed_lag, course_lag = (
        # positions that were late are dated already
        late + found.positions_late_s if (late := told_late(lag)) else 0.0
        for lag in (found.match.speed_lag_s, found.match.course_lag_s)
    )
    told = np.isfinite(fixes.vel_ned[:, :2]).all(axis=1) & np.isfinite(fixes.gps_s)
    rows = np.flatnonzero(told)
    rows = rows[np.argsort(fixes.gps_s[rows], kind="stable")]
    if len(rows) < 2 or speed_lag == course_lag == 0.0:
        return fixes
    t, velocity = fixes.gps_s[rows], fixes.vel_ned.copy()
    velocity[rows, :2] = told_later(t, velocity[rows, :2], speed_lag, course_lag)
    velocity[rows[_far(t, t + max(speed_lag, course_lag))], :2] = np.nan
    return replace(fixes, vel_ned=velocity)


def receiver_doubts(
    found: VelocityConsistency,
    start_gps_s: float,
    felt: bool = False,
    velocity_late_s: float = DELAY_SD_S,
) -> list[Reason]:
    """Reasons of a receiver that contradicts itself; ``start_gps_s`` of the path's first row,
    ``felt``: an IMU feels the speeds of its positions; its velocities may be ``velocity_late_s``
    late.

    What was left out leaves the path as sure as it says. Where positions and velocities part, and
    nothing says which is wrong, the path may be off by as much.
    """
    return list(_doubts(found, start_gps_s, felt, velocity_late_s))


def accuracy_doubts(fixes: Fixes, options: FusionOptions) -> list[Reason]:
    """The reason that most positions give which state more than they can know."""
    placed, _ = has_position(fixes)
    stated = placed & (fixes.sd_pos_ned[:, :2] > 0.0).all(axis=1)
    beyond = stated & ~states_accuracy(fixes, options)[:, :2].all(axis=1)
    if np.count_nonzero(beyond) <= 0.5 * np.count_nonzero(placed):
        return []
    level = float(np.median(np.hypot(*fixes.sd_pos_ned[beyond, :2].T)))
    return [
        Reason(
            "accuracy_understated",
            f"without corrections the receiver states positions to {level:.2f} m, which orbits, "
            "clocks and the air do not allow: the path is no surer than one of fixes that state "
            "nothing; check the unit of its accuracy, and the log for what kind of fixes they are",
            state="good",
            handled=True,
        )
    ]


def overstated(misses: Misses) -> list[Reason]:
    """The reason that fixes give which lie far nearer to a path than they say of themselves;
    ``misses`` with the variances that they state."""
    if len(misses) < LEAST_JUDGED:
        return []
    stated = math.sqrt(float(np.median(misses.slow_var[:, :2])))
    scatter = sd_by_median(misses.miss[:, :2].ravel())
    if scatter > limits.SMALLEST_SHARE * stated:
        return []
    return [
        Reason(
            "accuracy_overstated",
            f"the receiver states positions to {stated:.0f} m an axis, and they lie within "
            f"{scatter:.2g} m of the way that its velocities and the IMU show: the sigmas are as "
            "large as it states; check the unit of its accuracy, and its HDOP",
            state="good",
            handled=True,
        )
    ]


def _doubts(
    found: VelocityConsistency, start: float, felt: bool, velocity_late_s: float
) -> Iterator[Reason]:
    held = dict(
        zip(
            _HELD,
            (found.velocity_stuck, found.position_frozen, found.rows_frozen, found.height_held),
            strict=True,
        )
    )
    for reason in found.reasons:
        spans: tuple[Span, ...] = ()
        if reason.code == "sign_turned":
            # either the path is mirrored or its velocities are: nothing was left out
            text = f"{reason.text}: give the column of the log its sign"
            yield Reason(reason.code, text, state="unusable")
            continue
        if reason.code == "velocity_unit" and found.may_be_minutes and not felt:
            text = f"the receiver's {reason.text}: nothing in the drive tells which; check its log"
            yield Reason(reason.code, text, error_m=limits.MINUTES_OFF_M)
            continue
        if reason.code == "course_off":
            text = f"the receiver's {reason.text}: they were turned back; log them from true north"
            yield Reason(reason.code, text, handled=True)
            continue
        if reason.code == "height_scale" and found.vertical is not None:
            text = f"the receiver's {reason.text}: the heights of the path and of the signs are as "
            text += "wrong; check the unit of the heights in the receiver's log"
            off = found.vertical.height_m * abs(1.0 - 1.0 / found.vertical.feet)
            yield Reason(reason.code, text, height_m=off)
            continue
        if reason.code == "positions_late":
            text = (
                f"the receiver's {reason.text}: they were dated back; turn its smoothing of "
                "positions off, or log those that belong to the times"
            )
            # velocities have an age, and a filter that follows slowly is late by differing times:
            # how much more by one than by the other, what the path sees of the rest is in its noise
            late_s = found.lateness_apart_s + velocity_late_s
            state: State = "doubtful" if velocity_late_s >= DELAY_SD_S else "good"
            yield Reason(reason.code, text, state=state, late_s=late_s)
            continue
        if reason.code == "positions_straight":
            text = f"the receiver's {reason.text}; log the receiver's own"
            yield Reason(reason.code, text, error_m=found.straight_m)
            continue
        if reason.code in held:
            # a receiver that lost its view repeats a fix now and then
            if max(i.seconds for i in held[reason.code]) < limits.HELD_S:
                continue
            spans = _spans(held[reason.code], start)
        state = "good" if reason.code in ("course_coarse", "height_held") else "doubtful"
        text = f"the receiver's {reason.text}{_LEFT_OUT}"
        yield Reason(reason.code, text, spans, state=state, handled=True)
    if found.unrelated:
        yield Reason(
            "velocity_unrelated",
            "the receiver's velocities have nothing to do with its positions (they part "
            f"{found.worse:.0f} times as far as a receiver's do): check its log, and whether it "
            "holds two receivers",
        )
    if found.means is not None:
        text = f"{found.means.text}: the path is made without it"
        yield Reason("velocity_of_positions", text, state="good", handled=True)
    if found.behind is not None:
        yield _smoothed(found.behind)
    if found.between:
        text = (
            f"{found.between} of the log's positions lie on the straight lines between the others, "
            "or on from the last one by its velocity, evenly, or the receiver says to have "
            "reckoned them without satellites: nothing was measured there, so they were left out; "
            "log the receiver's own"
        )
        yield Reason("fixes_interpolated", text, state="good", handled=True)
    if found.parted:
        worst = max(interval.metres for interval in found.parted)
        yield Reason(
            "positions_parted",
            "the receiver's positions and velocities contradict each other "
            f"{told_intervals(found.parted)}: reflections, or a signal that is not the "
            "satellites'; do not rely on what was mapped there",
            _spans(found.parted, start),
            error_m=worst,
        )
    if found.aside:
        worst = max(interval.metres for interval in found.aside)
        yield Reason(
            "positions_aside",
            f"between such jumps the receiver's positions lie up to {worst:.0f} m aside of where "
            "they are otherwise: reflections, or another antenna or receiver",
            _spans(found.aside, start),
            error_m=worst,
        )


def _smoothed(behind: ReceiverFilter) -> Reason:
    told = [("velocities", behind.velocity_s), ("positions", behind.position_s)]
    over = " and its ".join(f"{what} over {seconds:.1f} s" for what, seconds in told if seconds)
    text = (
        f"the receiver smooths its {over}, as its turns beside those of the IMU show: that was "
        "taken back; log its own fixes, without a filter"
    )
    return Reason("fixes_smoothed", text, state="good", handled=True)


def _spans(intervals: Sequence[Interval], start: float) -> tuple[Span, ...]:
    return tuple((i.start_gps_s - start, i.end_gps_s - start) for i in intervals)
