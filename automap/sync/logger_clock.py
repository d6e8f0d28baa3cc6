"""Stamps of a sensor's own clock on that of the computer that logged it."""

from __future__ import annotations

import numpy as np

from automap.errors import InputError
from automap.records import IntArray
from automap.sync import limits
from automap.sync.envelope import lower_envelope


def on_logger_clock(stamp_ns: IntArray, arrival_ns: IntArray) -> IntArray:
    """Stamps [n] of the sensor's clock on the logger's, whose arrival times [n] are never early.

    The line below all delays between the two clocks ties them to each other. Raises InputError,
    without a file name, where the arrival times do not go with the stamps.
    """
    own = (stamp_ns - stamp_ns[0]) * 1e-9
    delay = (arrival_ns - arrival_ns[0]) * 1e-9 - own
    if own[-1] <= 0.0 or np.ptp(delay) > max(0.02 * own[-1], 2.0):
        raise InputError(
            "the IMU's clock and the arrival times of its tag do not go together; check "
            "which column is the time (--columns) and that the tag belongs to the log."
        )
    edge = lower_envelope(own, delay, limits.SENSOR_DRIFT_SD, limits.TICK_S)
    shift_ns = np.rint(edge.at(own) * 1e9).astype(np.int64)
    return np.asarray(arrival_ns[0] + (stamp_ns - stamp_ns[0]) + shift_ns, np.int64)
