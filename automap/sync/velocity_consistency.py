"""Whether a receiver's velocities and positions tell of the same motion, and which may be used.

A log of a table may carry speeds in another unit, courses that are turned, values that were
repeated while the receiver had none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.records import BoolArray, Fixes
from automap.sync import limits
from automap.sync.between_fixes import nothing_new
from automap.sync.climb_match import match_climbs
from automap.sync.digits import course_held, course_step
from automap.sync.epoch_means import epoch_means, path_of_means
from automap.sync.held_values import (
    Stretch,
    frozen_positions,
    held_heights,
    in_long_repeats,
    stuck_velocities,
    told_again,
)
from automap.sync.parting import asides, excesses, partings
from automap.sync.path_match import Match, match_paths
from automap.sync.receiver_path import ReceiverPath, receiver_path
from automap.sync.straight_bends import straight_in_bends
from automap.sync.unit_mistakes import unit_mistake
from automap.sync.velocity_findings import Interval, VelocityConsistency


def velocity_consistency(fixes: Fixes) -> VelocityConsistency:
    """Compare the velocities of ``fixes`` with their positions; never raises."""
    step = course_step(fixes)
    held = not step and course_held(fixes)
    if step or held:
        fixes = replace(fixes, vel_ned=fixes.vel_ned * [np.nan, np.nan, 1.0])
    known = nothing_new(fixes)
    between = int(np.count_nonzero(known & ~told_again(fixes)))
    path = receiver_path(replace(fixes, lat_rad=np.where(known, np.nan, fixes.lat_rad)))
    told = np.isfinite(path.velocity)
    if np.count_nonzero(told) < 2:
        none: tuple[Interval, ...] = ()
        return VelocityConsistency(
            *(0.0, Match(), False, None, False, none, none, none, none, None, 1.0),
            height_stuck=_height_stuck(path),
            height_held=_intervals(path, held_heights(path)),
            between=between,
            course_step=step,
            course_held=held,
        )
    fresh = ~in_long_repeats(path)
    match = match_paths(path, told & fresh, fresh)
    right = match.path(path, told)
    worse = max([1.0, *excesses(path, right, told & fresh, fresh)])
    frozen, whole = frozen_positions(path, right, match.velocity(path), worse)
    position = ~_repeating(path, [*frozen, *whole])
    stuck = stuck_velocities(path, right, ~position, worse)
    use = told & ~_repeating(path, [*stuck, *whole])

    again = match_paths(path, use, position)
    match = match if again.scale is None else again
    means = epoch_means(path, use & position)
    right = match.path(path, use) if means is None else path_of_means(path, use & position, means)
    # paths of no relation part the further the longer, those of noisy positions do not
    apart = excesses(path, right, use, position)
    worse = max([1.0, *apart])
    unrelated = 0.5 * max([0.0, *apart[-1:]]) ** 2 > limits.CERTAIN_LEAD_NATS
    match = Match() if unrelated else match
    parted = [] if unrelated else partings(path, right, use, position, worse)
    unit, wrong = unit_mistake(match.scale)
    return VelocityConsistency(
        compared_s=float(np.ptp(path.t[told])),
        match=match,
        scale_wrong=wrong,
        unit=unit,
        unrelated=unrelated,
        velocity_stuck=_intervals(path, stuck),
        position_frozen=_intervals(path, frozen),
        rows_frozen=_intervals(path, whole),
        parted=_intervals(path, parted),
        # a unit is mistaken of all three
        vertical=None if wrong else match_climbs(path, use & position, worse),
        worse=worse,
        means=means,
        height_stuck=_height_stuck(path),
        height_held=_intervals(path, held_heights(path)),
        aside=_intervals(path, asides(path, right, parted)),
        between=between,
        straight_m=0.0 if wrong or unrelated else straight_in_bends(path, right, use & position),
    )


def _height_stuck(path: ReceiverPath) -> bool:
    """Whether the heights are one number over minutes and half a kilometre or more."""
    told = np.isfinite(path.height)
    if np.count_nonzero(told) < 2 or np.ptp(path.height[told]) > 0.0:
        return False
    far = np.abs(path.place[told] - path.place[told][0]).max()
    return bool(np.ptp(path.t[told]) >= limits.LEVEL_S and far >= limits.LEVEL_M)


def _repeating(path: ReceiverPath, stretches: list[Stretch]) -> BoolArray:
    """Rows [n] of stretches that repeat the first of theirs."""
    inside = np.zeros(len(path), np.bool_)
    for stretch in stretches:
        inside[stretch.first + 1 : stretch.last + 1] = True
    return inside


def _intervals(path: ReceiverPath, stretches: list[Stretch]) -> tuple[Interval, ...]:
    start = path.start_gps_s
    return tuple(
        Interval(start + float(path.t[s.first]), start + float(path.t[s.last]), s.metres)
        for s in stretches
    )
