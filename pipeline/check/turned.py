"""Whether the IMU lay in one half of a drive as in the other, by the forces of its motion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from automap.evaluation.limits import CHANGED_RAD
from automap.evaluation.one_sensor import CHANGED_CODE
from automap.evaluation.plausibility import Finding
from automap.fusion.limits import DRIVING_SPEED
from automap.gates import sigmas
from automap.records import ClockModel, Fixes, FloatArray, ImuData
from automap.sync.axes_evidence import AxesEvidence, Followed
from pipeline.check import limits
from pipeline.check.axes import seen_motion


def seen_halves(imu: ImuData, fixes: Fixes, clock: ClockModel) -> list[AxesEvidence]:
    """What the readings show beside the ``fixes`` of the first and the second half of their
    time."""
    begin, end = (float(t) for t in clock.gps_s(imu.t_ns[[0, -1]]))
    middle = 0.5 * (begin + end)
    return [
        seen_motion(imu, replace(fixes, gps_s=np.where(part, fixes.gps_s, np.nan)), clock)
        for part in (fixes.gps_s < middle, fixes.gps_s >= middle)
    ]


def turned_meanwhile(imu: ImuData, fixes: Fixes | None, clock: ClockModel | None) -> Finding | None:
    """An error for a sensor that lies otherwise in the second half of the drive, turned about the
    vertical, which gravity does not show; None where it does not, or the motion does not tell."""
    if fixes is None or clock is None:
        return None
    # who walks holds a sensor now so, now so
    if not (np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1]) > DRIVING_SPEED).any():
        return None
    up = np.median(imu.accel, axis=0)
    up /= max(float(np.linalg.norm(up)), 1e-12)
    found = [_forward(half, up) for half in seen_halves(imu, fixes, clock)]
    if found[0] is None or found[1] is None:
        return None
    (before, before_sd), (after, after_sd) = found[0], found[1]
    turned = math.remainder(after - before, 2.0 * math.pi)
    sd = math.hypot(before_sd, after_sd)
    if abs(turned) <= CHANGED_RAD + sigmas(limits.WRONG_AXES) * sd:
        return None
    return Finding(
        "error",
        f"changes of speed and turns are felt {math.degrees(abs(turned)):.0f} deg (sigma "
        f"{math.degrees(sd):.0f}) from where they are in the first half of the drive in its second",
        "the sensor was turned in its mount, or two logs stand in one file: find when, and cut the "
        "drive in two there",
        CHANGED_CODE,
    )


def _forward(seen: AxesEvidence, up: FloatArray) -> tuple[float, float] | None:
    """The azimuth, rad, of the vehicle's forward axis in the readings, about ``up`` [3], and its
    sigma; None where the motion does not tell it."""
    helper = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = np.cross(up, helper)
    first /= np.linalg.norm(first)
    level = np.stack([first, np.cross(up, first)])
    told = [
        azimuth
        for azimuth in (_azimuth(seen.surge, level, 0.0), _azimuth(seen.lateral, level, 0.5))
        if azimuth is not None
    ]
    if not told:
        return None
    weight = np.array([1.0 / sd**2 for _, sd in told])
    off = [math.remainder(azimuth - told[0][0], 2.0 * math.pi) for azimuth, _ in told]
    mean = float(weight @ off / weight.sum())
    # where the two contradict each other neither is as sure as it says
    scatter = float(weight @ (np.array(off) - mean) ** 2)
    return told[0][0] + mean, math.sqrt(max(scatter, 1.0) / weight.sum())


def _azimuth(
    seen: Followed | None, level: FloatArray, quarters: float
) -> tuple[float, float] | None:
    """The azimuth of the force that goes with what was ``seen``, in the axes ``level`` [2, 3], less
    ``quarters`` of pi to the right, and its sigma by least squares."""
    if seen is None or seen.share < limits.LEAST_SHARE or seen.count <= 3.0:
        return None
    normal = level @ seen.xx @ level.T
    slope = np.linalg.solve(normal, level @ seen.xy)
    length = float(np.linalg.norm(slope))
    rest = max(seen.yy - float(slope @ level @ seen.xy), 0.0)
    if length <= 0.0:
        return None
    across = np.array([-slope[1], slope[0]]) / length
    var = rest / (seen.count - 3.0) * float(across @ np.linalg.solve(normal, across))
    # azimuths grow to the left, about up
    azimuth = math.atan2(slope[1], slope[0]) + quarters * math.pi
    return azimuth, math.sqrt(var) / length
