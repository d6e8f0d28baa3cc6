"""What the receiver's velocities and positions say of each other, and fixes without what is wrong
beyond doubt."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from automap.fusion import limits
from automap.fusion.doubts.reason import Reason, Span
from automap.records import Fixes
from automap.sync.velocity_consistency import Interval, VelocityConsistency, told_intervals

_HELD = ("velocity_stuck", "position_frozen", "rows_frozen")
_LEFT_OUT = ": they were left out; check the receiver's log and how it was made"


def usable_fixes(fixes: Fixes, found: VelocityConsistency) -> Fixes:
    """Fixes without the velocities and positions that cannot be right."""
    velocity, position = fixes.vel_ned.copy(), found.unusable_position(fixes)
    velocity[found.unusable_velocity(fixes), :2] = np.nan
    velocity[found.unusable_vertical_velocity(fixes), 2] = np.nan
    return replace(
        fixes,
        vel_ned=velocity,
        lat_rad=np.where(position, np.nan, fixes.lat_rad),
        lon_rad=np.where(position, np.nan, fixes.lon_rad),
    )


def receiver_doubts(found: VelocityConsistency, start_gps_s: float) -> list[Reason]:
    """Reasons of a receiver that contradicts itself; ``start_gps_s`` of the path's first row.

    What was left out leaves the path as sure as it says. Where positions and velocities part, and
    nothing says which is wrong, the path may be off by as much.
    """
    return list(_doubts(found, start_gps_s))


def _doubts(found: VelocityConsistency, start: float) -> Iterator[Reason]:
    held = dict(
        zip(_HELD, (found.velocity_stuck, found.position_frozen, found.rows_frozen), strict=True)
    )
    for reason in found.reasons:
        spans: tuple[Span, ...] = ()
        if reason.code == "sign_turned":
            # either the path is mirrored or its velocities are: nothing was left out
            text = f"{reason.text}: give the column of the log its sign"
            yield Reason(reason.code, text, state="unusable")
            continue
        if reason.code in held:
            # a receiver that lost its view repeats a fix now and then
            if max(i.seconds for i in held[reason.code]) < limits.HELD_S:
                continue
            spans = _spans(held[reason.code], start)
        yield Reason(reason.code, f"the receiver's {reason.text}{_LEFT_OUT}", spans, handled=True)
    if found.unrelated:
        yield Reason(
            "velocity_unrelated",
            "the receiver's velocities have nothing to do with its positions (they part "
            f"{found.worse:.0f} times as far as a receiver's do): check its log, and whether it "
            "holds two receivers",
        )
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


def _spans(intervals: Sequence[Interval], start: float) -> tuple[Span, ...]:
    return tuple((i.start_gps_s - start, i.end_gps_s - start) for i in intervals)
