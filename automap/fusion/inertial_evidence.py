"""What a drive's readings say by themselves, and what they show of the motion.

They are as large as the path that was made of them: of a long drive the two are looked at one after
the other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from automap.fusion.delay_states import SKEW_STATE
from automap.fusion.doubts import outcome
from automap.fusion.doubts.estimates import (
    impossible_ages,
    impossible_errors,
    levels_at_bound,
    of_axes,
)
from automap.fusion.doubts.position_jump import heights_of, places_of
from automap.fusion.doubts.readings import reading_doubts
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.triads import triad_doubts
from automap.fusion.doubts.turns import turn_doubts
from automap.fusion.doubts.velocity_step import told_times
from automap.fusion.free_inertial import FreeInertial, free_inertial
from automap.fusion.judged import Judged
from automap.fusion.rest_noise import shaken_levels
from automap.fusion.unusable_readings import Bridged, bridge_unusable
from automap.records import FloatArray, ImuData, IntArray


@dataclass(frozen=True)
class InertialEvidence:
    """``reasons`` that readings, and what was estimated of their errors, give, and those of noise
    ``at_bound``; the readings at ``t_ns`` [n] integrated by themselves, ``free``, None where
    something speaks against them."""

    reasons: list[Reason]
    at_bound: list[Reason]
    free: FreeInertial | None
    t_ns: IntArray

    @property
    def blamed(self) -> bool:
        """Whether something speaks against the IMU."""
        return any(reason.inertial for reason in (*self.reasons, *self.at_bound))


@dataclass(frozen=True)
class _Beside:
    """Of the path's rows, at ``t_ns`` and ``gps_s`` [k], the ``speed`` [k] m/s; it is integrated
    beside the instants ``wanted`` [m], s from its first row."""

    t_ns: IntArray
    gps_s: FloatArray
    speed: FloatArray
    wanted: FloatArray


def of_readings(
    drive: Judged,
    read_imu: Callable[[], ImuData],
    as_read: Callable[[ImuData], ImuData],
    parting: bool,
) -> InertialEvidence:
    """The evidence of what ``read_imu`` reads, in vehicle axes, of which ``as_read`` makes that of
    the sensor's own; ``parting``: the innovations speak against the path."""
    at_bound = _at_bound(drive, read_imu)
    of_estimates, beside = _of_path(drive, parting)
    imu = read_imu()
    # the path may begin behind readings that told nothing, and end before those of another trip
    first, last = np.searchsorted(imu.t_ns, [beside.t_ns[0], beside.t_ns[-1] + 1])
    imu = imu.at(slice(int(first), int(last)))
    bridged = bridge_unusable(imu)
    at_readings = np.interp(imu.t_ns, beside.t_ns, beside.speed)
    velocity = drive.fixes.vel_ned
    told = np.isfinite(velocity[:, :2]).all(axis=1)
    fix_s = np.asarray((drive.clock.t_ns(drive.fixes.gps_s[told]) - int(imu.t_ns[0])) * 1e-9)
    turn = drive.result.mounting.matrix
    reasons = [
        *reading_doubts(as_read(imu), bridged, at_readings),
        *turn_doubts(bridged.imu, turn, fix_s, velocity[told]),
        *of_estimates,
    ]

    def refuted() -> bool:
        return any(reason.inertial for reason in reasons)

    # an IMU that errs by itself is no witness, and what errs in one way seems to in others
    if not refuted():
        reasons += triad_doubts(bridged.imu, turn, at_readings)
    free = None if refuted() else _free(drive, beside, bridged)
    return InertialEvidence(reasons, at_bound, free, imu.t_ns)


def _at_bound(drive: Judged, read_imu: Callable[[], ImuData]) -> list[Reason]:
    """What noise at its bounds says, but of readings that are shaken so at rest."""
    factors, tuned = drive.result.noise_factors, drive.options.tune
    found = levels_at_bound(factors, tuned)
    if not any(reason.inertial for reason in found):
        return found
    return levels_at_bound(factors, tuned, shaken_levels(read_imu(), drive.options))


def _of_path(drive: Judged, parting: bool) -> tuple[list[Reason], _Beside]:
    """What estimates and path say against the IMU, and what of the path its readings are seen
    beside: all of the path that is kept while they are read."""
    path = drive.fused.motion()
    start = float(path.gps_s[0])
    fix_s = np.concatenate([at(drive.stated).t for at in (places_of, heights_of)]) - start
    wanted = np.concatenate([*told_times(drive.fixes, path, drive.found), fix_s])
    by_arrival = drive.delay_is_clock and drive.clock.method == "arrival"
    reasons = [
        *impossible_ages(drive.found, by_arrival, drive.delay.mean),
        *impossible_errors(drive.found, parting),
        *outcome.leaning(path),
    ]
    speed = np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1])
    return reasons, _Beside(drive.fused.t_ns, path.gps_s, speed, wanted)


def _free(drive: Judged, beside: _Beside, bridged: Bridged) -> FreeInertial:
    """The readings by themselves, timed in s from the path's first row."""
    turn, imu, found, gps_s = drive.result.mounting.matrix, bridged.imu, drive.found, beside.gps_s
    stamps = (imu.t_ns - imu.t_ns[0]) * 1e-9
    # the path's rows are of the stamps' instants; readings may be of earlier ones
    late: float | FloatArray = 0.0
    if not drive.delay_is_clock:
        late = drive.result.delay.mean + found.get(SKEW_STATE, (0.0,))[0] * stamps
    # the path has rows in holes between readings too; both rise
    row = np.searchsorted(beside.t_ns, imu.t_ns)
    row = row[np.take(beside.t_ns, row, mode="clip") == imu.t_ns]
    at = gps_s[row] - gps_s[0] - late
    bias = np.concatenate([of_axes(found, "gyro_bias"), of_axes(found, "accel_bias")])
    return free_inertial(at, imu.gyro, imu.accel, bridged.stretch_s, beside.wanted, turn, bias)
