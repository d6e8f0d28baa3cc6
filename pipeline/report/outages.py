"""When the receiver gave no position."""

from __future__ import annotations

import numpy as np

from automap.records import Fixes, FixType

LEAST_OUTAGE_S = 2.0


def outages(fixes: Fixes) -> list[tuple[float, float]]:
    """Start and end in GPS seconds of the spans without a fix.

    A span counts when it is longer than two seconds and three usual steps between fixes.
    """
    good = (
        np.isfinite(fixes.gps_s)
        & np.isfinite(fixes.lat_rad)
        & (fixes.fix_type != int(FixType.NONE))
    )
    times = np.sort(fixes.gps_s[good])
    if len(times) < 2:
        return []
    steps = np.diff(times)
    limit = max(LEAST_OUTAGE_S, 3.0 * float(np.median(steps)))
    holes = np.flatnonzero(steps > limit)
    return [(float(times[i]), float(times[i + 1])) for i in holes]
