"""The verdict on the path of the fixes alone: of a drive without an IMU, or with one that errs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.fusion.doubts.heights import separation_doubts
from automap.fusion.doubts.own_velocities import smoothed_doubts
from automap.fusion.doubts.path import fix_misses, off_the_fixes
from automap.fusion.doubts.position_jump import height_jumps, jump_doubts, places_of, position_jumps
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.receiver import (
    accuracy_doubts,
    dated_velocities,
    overstated,
    receiver_doubts,
)
from automap.fusion.doubts.slow_drift import drifting, pattern_doubts
from automap.fusion.fix_levels import fix_levels
from automap.fusion.gnss_only import as_old_as, as_sure_as_fixes, smooth_fixes
from automap.fusion.measurements.position import age_sd_of
from automap.fusion.nodes import as_shown, model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.result import Prior
from automap.fusion.weighed import Weighed, level_sd, weighed_path
from automap.fusion.widening import widen
from automap.lever_arm import moved_to
from automap.records import ClockModel, Fixes, FloatArray, Trajectory
from automap.sync.velocity_findings import VelocityConsistency

NO_DELAY = Prior(0.0, 0.0)


def weigh_alone(
    fixes: Fixes,
    clock: ClockModel,
    options: FusionOptions,
    receiver: VelocityConsistency,
    lever_arm: FloatArray | None = None,
    told: Sequence[Reason] = (),
    delay: Prior = NO_DELAY,
) -> Weighed:
    """The path of ``fixes`` alone, judged; ``receiver`` and ``lever_arm`` as in ``weigh``, ``told``
    what is known already, ``delay`` s by how much the clock's stamps are later than they should be.
    It is that of the antenna where nobody stated an arm.

    Raises:
        InputError: fewer than two usable fixes.
    """
    dated = dated_velocities(fixes, receiver)
    levels = fix_levels(dated, options)
    alone = smooth_fixes(dated, clock, options, levels)
    path = as_sure_as_fixes(alone, fixes, options, levels)
    path = replace(path, t_ns=path.t_ns + round(delay.mean * 1e9))
    path = as_old_as(path, math.hypot(age_sd_of(fixes, clock, options), delay.sd))
    stated = model_fixes(fixes, fixes.gps_s, options)
    misses = fix_misses(path, as_shown(stated, options, levels))
    off, _ = off_the_fixes(misses, options.wander_tau_s)
    off += overstated(fix_misses(path, stated))
    reasons = [*told, *receiver_doubts(receiver, float(path.gps_s[0])), *off]
    reasons += [*smoothed_doubts(fixes, receiver), *accuracy_doubts(fixes, options)]
    reasons += separation_doubts(fixes, reasons)
    reasons += jump_doubts(position_jumps(places_of(stated)), path)
    reasons += jump_doubts(height_jumps(stated, path), path)
    sd = level_sd([path])
    more, drifts = pattern_doubts(dated, alone, options, levels, sd, reasons)
    reasons += more
    path = drifting(widen(path, reasons, misses, None), drifts)
    at = at_sensor(path, lever_arm)
    return weighed_path(lambda: iter([at]), reasons, alone=True)


def at_sensor(path: Trajectory, arm: FloatArray | None) -> Trajectory:
    """The path of a sensor, by that of the antenna ``arm`` [3] m forward, right and down of it."""
    if arm is None:
        return path
    moved = moved_to(path, -arm)
    # courses one after the other tell a turn no better than that there is one
    swing = moved.vel_ned - path.vel_ned
    return replace(moved, sd_vel_ned=np.hypot(moved.sd_vel_ned, swing))


def seen_at_sensor(path: Trajectory, arm: FloatArray, age_s: float) -> Trajectory:
    """The path of a sensor at the instants that fixes tell of, by that of their antenna, ``arm``
    [3] m forward, right and down of it, dated by tags that are ``age_s`` later."""
    return at_sensor(replace(path, gps_s=path.gps_s - age_s), arm)
