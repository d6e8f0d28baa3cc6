"""A trajectory from fixes alone: a constant-velocity smoother on the local tangent plane.

For drives without an inertial sensor. States per axis: position, velocity, and what lasts of the
receiver's errors of both; white acceleration as process noise. Heading is the
course, pitch the slope of the path, roll zero.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.earth import from_local_ned, local_ned
from automap.effects.limits import COURSE_SPEED
from automap.errors import InputError
from automap.fusion.kernels.axis import smooth_axis
from automap.fusion.limits import (
    COURSE_SLIP_SD,
    LEAST_COURSE_SPEED,
    LEAST_FIXES,
    ROAD_ACCELERATION_PSD,
    UNKNOWN_HEADING_SD,
    UNKNOWN_LEAN_SD,
)
from automap.fusion.measurements.position import lasting_share, unseen_errors
from automap.fusion.nodes import model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.screening import screen_fixes
from automap.gates import gate
from automap.records import BoolArray, ClockModel, Fixes, FloatArray, Trajectory


def smooth_fixes(fixes: Fixes, clock: ClockModel, options: FusionOptions) -> Trajectory:
    """Smoothed trajectory at the fixes' epochs, one row per usable fix.

    ``t_ns`` are the epochs on the clock's host time.

    Raises:
        InputError: fewer than two usable fixes.
    """
    t_all = fixes.gps_s - np.nanmin(fixes.gps_s) if len(fixes) else np.zeros(0)
    model = model_fixes(fixes, np.asarray(t_all), options)
    model = screen_fixes(model, options.wander_tau_s).fixes
    has = (model.flags & 1) > 0
    if int(has.sum()) < LEAST_FIXES:
        raise InputError(
            f"only {int(has.sum())} fixes have a position; the receiver had no view of the sky or "
            "the log is cut: check it with 'automap check'"
        )
    keep = np.concatenate([[True], np.diff(model.t) > 0])
    rows = np.flatnonzero(keep)
    t, values, flags = model.t[rows], model.values[rows], model.flags[rows]
    first = int(np.flatnonzero(has[rows])[0])
    has_height = np.flatnonzero((flags & 2) > 0)
    height0 = float(values[has_height[0], 2]) if len(has_height) else 0.0
    ref = (float(values[first, 0]), float(values[first, 1]), height0)
    height = np.where((flags & 2) > 0, values[:, 2], height0)
    ned = local_ned(values[:, 0], values[:, 1], height, ref).reshape(-1, 3)
    position, velocity = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    sd_pos, sd_vel = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    # what a receiver's own filter leaves in a velocity is as large as what it says, and lasts
    lasting = np.maximum(np.sqrt(model.white_var[rows, 3:6]), options.velocity_wander_sd)
    surprise = gate(options.gate_probability, 1)
    share = lasting_share(options, {})
    for axis in range(3):
        bit = 1 if axis < 2 else 2
        out = np.zeros((len(t), 4))
        smooth_axis(
            t,
            np.column_stack([ned[:, axis], values[:, 3 + axis]]),
            np.column_stack([(flags & bit) > 0, (flags & (4 * bit)) > 0]),
            model.white_var[rows][:, [axis, 3 + axis]],
            np.column_stack([share[axis] * model.stated_sd[rows, axis], lasting[:, axis]]),
            ROAD_ACCELERATION_PSD[axis],
            (options.wander_tau_s, options.velocity_wander_tau_s),
            surprise,
            out,
        )
        position[:, axis], velocity[:, axis], sd_pos[:, axis], sd_vel[:, axis] = out.T
    sd_pos = np.hypot(sd_pos, unseen_errors(model.stated_sd[rows], options, {}))
    lat, lon, h = from_local_ned(position, ref)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    rpy = np.zeros((len(t), 3))
    rpy[:, 2] = _hold(np.arctan2(velocity[:, 1], velocity[:, 0]), speed > COURSE_SPEED)
    rpy[:, 1] = np.where(speed > COURSE_SPEED, np.arctan2(-velocity[:, 2], speed), 0.0)
    sd_course = np.hypot(sd_vel[:, 0], sd_vel[:, 1]) / np.maximum(speed, LEAST_COURSE_SPEED)
    lean = np.full(len(t), UNKNOWN_LEAN_SD)
    sd_heading = np.minimum(sd_course + COURSE_SLIP_SD, UNKNOWN_HEADING_SD)
    sd_rpy = np.stack([lean, lean, sd_heading], axis=1)
    gps_s = fixes.gps_s[model.row[rows]]
    return Trajectory(
        clock.t_ns(gps_s),
        gps_s,
        np.atleast_1d(lat),
        np.atleast_1d(lon),
        np.atleast_1d(h),
        velocity,
        rpy,
        sd_pos,
        sd_vel,
        sd_rpy,
    )


def unaveraged(path: Trajectory, fixes: Fixes, options: FusionOptions) -> Trajectory:
    """The ``path`` of ``fixes`` alone with a position nowhere surer than the errors of its fixes
    that last: how long they do nobody has told, and a motion that no IMU has seen does not tell
    them from the way that was driven, so that the smoother's averages over minutes promise too
    much."""
    model = model_fixes(fixes, fixes.gps_s, options)
    has = (model.flags & 1) > 0
    if not has.any():
        return path
    lasts = np.hypot(
        lasting_share(options, {}) * model.stated_sd, unseen_errors(model.stated_sd, options, {})
    )
    least = np.stack([np.interp(path.gps_s, model.t[has], lasts[has, a]) for a in range(3)], axis=1)
    return replace(path, sd_pos_ned=np.maximum(path.sd_pos_ned, least))


def _hold(angle: FloatArray, valid: BoolArray) -> FloatArray:
    """Angles with invalid ones replaced by the last valid, or the first where there is none."""
    if not valid.any():
        return np.zeros_like(angle)
    index = np.where(valid, np.arange(len(angle)), -1)
    index = np.maximum.accumulate(index)
    index = np.where(index < 0, int(np.flatnonzero(valid)[0]), index)
    return np.asarray(angle[index])
