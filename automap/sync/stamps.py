"""Stamps of one clock in that of the trajectory: cameras need not share the IMU's."""

from __future__ import annotations

import numpy as np

from automap.errors import InputError
from automap.records import DriveClocks, IntArray
from automap.sync.clock import stated_clock


def in_trajectory_time(t_ns: IntArray, time_base: str, clocks: DriveClocks) -> IntArray:
    """Stamps [n] of the clock ``time_base`` as stamps of the trajectory.

    UNIX time is as good as the computer's clock was set. Raises InputError, without a file
    name, when nothing ties the two clocks to each other.
    """
    if time_base == clocks.time_base or not len(t_ns):
        return t_ns
    if time_base == clocks.arrival_time_base and clocks.arrival is not None:
        own = clocks.arrival
    elif time_base == "boot_ns":
        raise InputError(
            f"it is stamped by the host's clock (time = {time_base!r}) and the "
            f"trajectory with {clocks.time_base!r}, and no arrival times tie the two together; "
            "write the clock that the stamps are in as `time`, or record gnss_arrival.csv"
        )
    else:
        own = stated_clock(t_ns, time_base)
    if not np.isfinite(clocks.clock.sd_offset_s):
        raise InputError(
            f"it is stamped in {time_base!r} and the trajectory in "
            f"{clocks.time_base!r}, whose GPS time is not known; add gps_s to the trajectory"
        )
    return clocks.clock.t_ns(own.gps_s(t_ns))
