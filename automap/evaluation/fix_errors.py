"""What a recorded receiver's fixes have wrong: errors of position and velocity against a truth."""

from __future__ import annotations

import numpy as np

from automap.evaluation.limits import DELAY_STEP_S, GREATEST_DELAY_S, LEAST_SPEED
from automap.evaluation.trajectory_errors import raw_fix_errors
from automap.interpolation import poses_at_gps
from automap.records import FixErrors, Fixes, FixType, FloatArray, Trajectory


def fix_errors(
    fixes: Fixes, truth: Trajectory, lever_arm_m: FloatArray, with_delays: bool = False
) -> FixErrors:
    """Errors of all epochs that the truth covers, in the order of time.

    Velocities are compared with the truth at the receiver's own delays, one of the speed and one of
    the course, each where the two agree best: what a delay does depends on how one drives.
    ``with_delays`` leaves the delays in the errors and says that there are none. Along and across
    are those of the delayed course. The truth needs GPS times and velocities. ``lever_arm_m`` [3]
    from IMU to antenna.
    """
    usable = (fixes.fix_type >= FixType.TWO_D) & np.isfinite(fixes.lat_rad)
    usable &= poses_at_gps(truth, fixes.gps_s).covered
    rows = np.flatnonzero(usable)
    rows = rows[np.argsort(fixes.gps_s[rows], kind="stable")]
    used = Fixes(**{name: values[rows] for name, values in vars(fixes).items()})
    position = raw_fix_errors(used, truth, lever_arm_m)
    t, vel = used.gps_s, used.vel_ned
    speed_delay, course_delay = (0.0, 0.0) if with_delays else delays(t, vel, truth)
    slow, turned = (poses_at_gps(truth, t - late) for late in (speed_delay, course_delay))
    heading = _heading(turned.vel_ned, turned.rpy[:, 2])
    size = np.hypot(slow.vel_ned[:, 0], slow.vel_ned[:, 1])
    level = vel[:, :2] - size[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    c, s = np.cos(heading), np.sin(heading)
    velocity = np.stack(
        [
            c * level[:, 0] + s * level[:, 1],
            c * level[:, 1] - s * level[:, 0],
            vel[:, 2] - slow.vel_ned[:, 2],
        ],
        axis=1,
    )
    return FixErrors(t, position, velocity, speed_delay, course_delay)


def delays(gps_s: FloatArray, vel_ned: FloatArray, truth: Trajectory) -> tuple[float, float]:
    """By how many seconds speeds and courses of a receiver are older than their tag, each where
    its scatter about the truth is least; zero where nothing moves. ``vel_ned`` [n, 3] m/s."""
    speed, course = _polar(vel_ned)
    tried: FloatArray = np.arange(0.0, GREATEST_DELAY_S, DELAY_STEP_S)
    scatter = np.full((2, len(tried)), np.inf)
    for i, late in enumerate(tried):
        true_speed, true_course = _polar(poses_at_gps(truth, gps_s - late).vel_ned)
        use = np.isfinite(speed) & (np.nan_to_num(true_speed) > LEAST_SPEED)
        if np.count_nonzero(use) < 3:
            continue
        off = speed[use] - true_speed[use]
        aside = (course[use] - true_course[use] + np.pi) % (2.0 * np.pi) - np.pi
        scatter[:, i] = np.std(off), np.std(np.sin(aside) * true_speed[use])
    if not np.isfinite(scatter[0]).all():
        return 0.0, 0.0
    best = tried[np.argmin(scatter, axis=1)]
    return float(best[0]), float(best[1])


def _polar(vel_ned: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.hypot(vel_ned[:, 0], vel_ned[:, 1]), np.arctan2(vel_ned[:, 1], vel_ned[:, 0])


def _heading(vel_ned: FloatArray, yaw: FloatArray) -> FloatArray:
    """Direction of travel [n] in rad; the yaw where there is one and the vehicle hardly moves."""
    speed, course = _polar(vel_ned)
    return np.where((speed < LEAST_SPEED) & np.isfinite(yaw), yaw, course)
