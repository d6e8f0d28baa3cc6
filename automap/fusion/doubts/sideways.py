"""A nose that is far off its course: no car goes sideways for seconds.

Where the IMU was turned in the vehicle, its rates tell a turn that the vehicle did not make. The
filter takes one such turn for noise of the gyro, and its path goes on askew until the vehicle
constraint has drawn the heading back.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason, Span
from automap.fusion.gnss_only import course_errors
from automap.fusion.limits import DOUBT_PROBABILITY, LEAST_COURSE_SPEED
from automap.fusion.options import FusionOptions
from automap.gates import sigmas
from automap.lever_arm import moved_to
from automap.records import FloatArray, Trajectory


def sideways(
    stretches: Iterable[Trajectory], options: FusionOptions, axle: FloatArray
) -> Iterator[Reason]:
    """The reason that a path in stretches gives whose headings are off the courses of the point
    that does not slide, ``axle`` [3] m from the IMU, by more than both err and vehicles slide."""
    start, t, off = None, [], []
    for path in stretches:
        start = path.gps_s[0] if start is None else start
        slip, sd = slip_of(moved_to(path, axle), options)
        sure = np.abs(slip) > sigmas(DOUBT_PROBABILITY) * sd
        t.append(path.gps_s[sure] - start)
        off.append(np.abs(slip[sure]))
    sure_t, sure_off = np.concatenate(t), np.concatenate(off)
    if len(sure_t):
        worst = int(np.argmax(sure_off))
        yield Reason(
            "path_sideways",
            f"the vehicle would go sideways by {np.degrees(sure_off[worst]):.0f} deg at "
            f"{sure_t[worst]:.0f} s of the drive, which is more than cars slide: the IMU was "
            "turned in it there, or the receiver's velocities are of another motion; fasten the "
            "IMU, and cut the drive there",
            tuple(_round(sure_t)),
        )


def slip_of(path: Trajectory, options: FusionOptions) -> tuple[FloatArray, FloatArray]:
    """Heading minus course [n] rad, forward or in reverse, 0 where the vehicle constraint does not
    hold, and its one sigma.

    A wheel that climbs a kerb rolls the body about the wheels of the other side, and the IMU goes
    sideways by the roll rate times its height.
    """
    velocity = path.vel_ned[:, :2]
    course = np.arctan2(velocity[:, 1], velocity[:, 0])
    slip = (path.rpy[:, 2] - course + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    err = course_errors(path.gps_s, velocity, path.sd_vel_ned[:, :2], options)
    roll = np.unwrap(path.rpy[:, 0])
    roll_rate = np.gradient(roll, path.gps_s) if len(roll) > 1 else np.zeros_like(roll)
    rolls = limits.ROLL_ARM_M * roll_rate / np.maximum(speed, LEAST_COURSE_SPEED)
    sd = np.sqrt(path.sd_rpy[:, 2] ** 2 + err**2 + rolls**2)
    return np.where(speed > options.nhc_min_speed, slip, 0.0), sd


def _round(sure: FloatArray) -> Iterator[Span]:
    """Stretches about the instants ``sure`` [m] s: a smoother bends a heading off before and after
    what it cannot follow."""
    half = 0.5 * limits.STRETCHES_S[0]
    parts = np.split(sure, np.flatnonzero(np.diff(sure) > 2.0 * half) + 1)
    yield from ((float(part[0]) - half, float(part[-1]) + half) for part in parts)
