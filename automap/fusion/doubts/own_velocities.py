"""Velocities that tell nothing that the positions beside them do not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.receiver import told_late
from automap.fusion.measurements.position import carrier_sd
from automap.records import Fixes
from automap.sync.limits import BEST_VELOCITY_SD
from automap.sync.velocity_findings import VelocityConsistency


def own_velocities(fixes: Fixes, found: VelocityConsistency) -> Fixes:
    """Fixes without velocities that are the ways between positions, or, beside carrier-phase ones,
    means over a longer time than these need to tell as much.

    As velocities of an instant they would tell of an arm of the antenna, or of a delay, what is the
    mean over an interval in which the body sways; and the noise of positions would count twice.
    """
    if found.means is not None:
        return replace(fixes, vel_ned=np.full_like(fixes.vel_ned, np.nan))
    if not smoothed_s(fixes, found):
        return fixes
    by_carrier = np.isfinite(carrier_sd(fixes))
    return replace(fixes, vel_ned=np.where(by_carrier[:, None], np.nan, fixes.vel_ned))


def smoothed_s(fixes: Fixes, found: VelocityConsistency) -> float:
    """Over how long, s, velocities beside carrier-phase positions are means where these tell the
    mean of as long better than any receiver its velocity; else 0.

    A symmetric filter that is late by so much is twice as long. Two positions that are so far apart
    tell its mean to the root of two of what they err by over its length, and how the velocity
    changes meanwhile, which the filter has taken out.
    """
    sd = carrier_sd(fixes)
    known = np.isfinite(sd)
    if not known.any():
        return 0.0
    late = min(told_late(found.match.speed_lag_s), told_late(found.match.course_lag_s))
    length = 2.0 * max(late, 0.0)
    tells = math.sqrt(2.0) * float(np.median(sd[known])) < BEST_VELOCITY_SD * length
    return length if tells else 0.0


def smoothed_doubts(fixes: Fixes, found: VelocityConsistency) -> list[Reason]:
    """The reason that such velocities give; ``fixes`` with them or without."""
    length = 0.0 if found.means is not None else smoothed_s(fixes, found)
    if not length:
        return []
    return [
        Reason(
            "velocity_smoothed",
            f"the receiver's velocities are means over some {length:.1f} s, of which its "
            "carrier-phase positions tell more: the path is made without them; log velocities of "
            "an instant",
            state="good",
            handled=True,
        )
    ]
