"""What a drive's readings say by themselves, and what they show of the motion.

They are as large as the path that was made of them: of a long drive the two are looked at one after
the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from automap.fusion.delay_states import SKEW_STATE
from automap.fusion.doubts.estimates import Estimates, of_axes
from automap.fusion.doubts.readings import reading_doubts
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.triads import triad_doubts
from automap.fusion.doubts.turns import turn_doubts
from automap.fusion.free_inertial import FreeInertial, free_inertial
from automap.fusion.result import FusionResult
from automap.fusion.unusable_readings import Bridged, bridge_unusable
from automap.records import ClockModel, Fixes, FloatArray, ImuData, IntArray


@dataclass(frozen=True)
class InertialEvidence:
    """Reasons that readings give ``alone``, and as ``triads`` of one motion; the readings at
    ``t_ns`` [n] integrated by themselves, ``free``, None where something speaks against them."""

    alone: list[Reason]
    triads: list[Reason]
    free: FreeInertial | None
    t_ns: IntArray


def of_readings(
    read_imu: Callable[[], ImuData],
    as_read: Callable[[ImuData], ImuData],
    result: FusionResult,
    t_ns: IntArray,
    gps_s: FloatArray,
    speed: FloatArray,
    fixes: Fixes,
    clock: ClockModel,
    found: Estimates,
    wanted: FloatArray,
    delay_is_clock: bool,
    beside: Sequence[Reason],
) -> InertialEvidence:
    """The evidence of what ``read_imu`` reads, in vehicle axes, of which ``as_read`` makes that of
    the sensor's own.

    The path's rows are at ``t_ns`` and ``gps_s`` [k] with a ``speed`` [k] m/s; it is integrated
    beside the instants ``wanted`` [m], s from its first row. ``beside`` are the reasons that speak
    against the IMU already.
    """
    imu = read_imu()
    # the path may begin behind readings that told nothing, and end before those of another trip
    first, last = np.searchsorted(imu.t_ns, [t_ns[0], t_ns[-1] + 1])
    imu = imu.at(slice(int(first), int(last)))
    bridged = bridge_unusable(imu)
    at_readings = np.interp(imu.t_ns, t_ns, speed)
    told = np.isfinite(fixes.vel_ned[:, :2]).all(axis=1)
    fix_s = np.asarray((clock.t_ns(fixes.gps_s[told]) - int(imu.t_ns[0])) * 1e-9)
    turn = result.mounting.matrix
    alone = [
        *reading_doubts(as_read(imu), bridged, at_readings),
        *turn_doubts(bridged.imu, turn, fix_s, fixes.vel_ned[told]),
    ]

    def refuted(*reasons: Reason) -> bool:
        return any(reason.inertial for reason in (*alone, *beside, *reasons))

    # an IMU that errs by itself is no witness, and what errs in one way seems to in others
    triads = [] if refuted() else list(triad_doubts(bridged.imu, turn, at_readings))
    free = None
    if not refuted(*triads):
        free = _free(result, t_ns, gps_s, bridged, found, wanted, delay_is_clock)
    return InertialEvidence(alone, triads, free, imu.t_ns)


def _free(
    result: FusionResult,
    t_ns: IntArray,
    gps_s: FloatArray,
    bridged: Bridged,
    found: Estimates,
    wanted: FloatArray,
    delay_is_clock: bool,
) -> FreeInertial:
    """The readings by themselves, timed in s from the path's first row, beside ``wanted`` [m] s."""
    turn, imu = result.mounting.matrix, bridged.imu
    stamps = (imu.t_ns - imu.t_ns[0]) * 1e-9
    # the path's rows are of the stamps' instants; readings may be of earlier ones
    late = 0.0 if delay_is_clock else result.delay.mean + found.get(SKEW_STATE, (0.0,))[0] * stamps
    # the path has rows in holes between readings too; both rise
    row = np.searchsorted(t_ns, imu.t_ns)
    row = row[np.take(t_ns, row, mode="clip") == imu.t_ns]
    at = gps_s[row] - gps_s[0] - late
    bias = np.concatenate([of_axes(found, "gyro_bias"), of_axes(found, "accel_bias")])
    return free_inertial(at, imu.gyro, imu.accel, bridged.stretch_s, wanted, turn, bias)
