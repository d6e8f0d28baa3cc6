"""A trajectory from fixes alone: a constant-velocity smoother on the local tangent plane.

For drives without an inertial sensor. States per axis: position, velocity, and the slowly
wandering part of the receiver's error; white acceleration as process noise. Heading is the
course, pitch the slope of the path, roll zero.
"""

from __future__ import annotations

import numpy as np

from automap.earth import from_local_ned, local_ned
from automap.errors import InputError
from automap.fusion.measurements import model_fixes
from automap.fusion.model import FusionOptions
from automap.records import ClockModel, Fixes, FloatArray, Trajectory

ACCELERATION_PSD = (1.0, 1.0, 0.1)
"""White acceleration of road traffic north, east, down, (m/s^2)^2/Hz."""
COURSE_SPEED = 1.0
"""Below this speed in m/s a course means nothing and the last heading is kept."""


def smooth_fixes(fixes: Fixes, clock: ClockModel, options: FusionOptions) -> Trajectory:
    """Smoothed trajectory at the fixes' epochs, one row per usable fix.

    ``t_ns`` are the epochs on the clock's host time.

    Raises:
        InputError: fewer than two usable fixes.
    """
    t_all = fixes.gps_s - np.nanmin(fixes.gps_s) if len(fixes) else np.zeros(0)
    model = model_fixes(fixes, np.asarray(t_all), options)
    has = (model.flags & 1) > 0
    if int(has.sum()) < 2:
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
    for axis in range(3):
        bit = 1 if axis < 2 else 2
        axis_result = _smooth_axis(
            t,
            ned[:, axis],
            (flags & bit) > 0,
            values[:, 3 + axis],
            (flags & (4 * bit)) > 0,
            model.white_var[rows, axis],
            model.white_var[rows, 3 + axis],
            model.wander_sd[rows, axis],
            ACCELERATION_PSD[axis],
            options.wander_tau_s,
        )
        position[:, axis], velocity[:, axis], sd_pos[:, axis], sd_vel[:, axis] = axis_result
    lat, lon, h = from_local_ned(position, ref)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    rpy = np.zeros((len(t), 3))
    rpy[:, 2] = _hold(np.arctan2(velocity[:, 1], velocity[:, 0]), speed > COURSE_SPEED)
    rpy[:, 1] = np.where(speed > COURSE_SPEED, np.arctan2(-velocity[:, 2], speed), 0.0)
    sd_course = np.hypot(sd_vel[:, 0], sd_vel[:, 1]) / np.maximum(speed, 0.3)
    sd_rpy = np.stack(
        [np.full(len(t), 0.05), np.full(len(t), 0.05), np.minimum(sd_course + 0.03, 1.8)], axis=1
    )
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


def _smooth_axis(
    t: FloatArray,
    z_pos: FloatArray,
    use_pos: np.ndarray,
    z_vel: FloatArray,
    use_vel: np.ndarray,
    var_pos: FloatArray,
    var_vel: FloatArray,
    wander: FloatArray,
    psd: float,
    tau: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Forward filter and RTS smoother of one axis; position, velocity and their sd."""
    n = len(t)
    x = np.array([z_pos[np.flatnonzero(use_pos)[0]] if use_pos.any() else 0.0, 0.0, 0.0])
    p = np.diag([100.0**2, 30.0**2, 1.0])
    xs, ps = np.zeros((n, 3)), np.zeros((n, 3, 3))
    xp, pp, fs = np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    for k in range(n):
        dt = t[k] - t[k - 1] if k else 0.0
        d = np.exp(-dt / tau)
        f = np.array([[1.0, dt, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, d]])
        q = np.diag([0.0, 0.0, 1.0 - d * d])
        q[:2, :2] = psd * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        x, p = f @ x, f @ p @ f.T + q
        xp[k], pp[k], fs[k] = x, p, f
        for used, h, z, var in (
            (use_pos[k], np.array([1.0, 0.0, wander[k]]), z_pos[k], var_pos[k]),
            (use_vel[k], np.array([0.0, 1.0, 0.0]), z_vel[k], var_vel[k]),
        ):
            if not used:
                continue
            ph = p @ h
            nu = z - h @ x
            # a surprising fix is trusted less, as in the inertial filter
            s = max(float(h @ ph + var), float(nu * nu / 10.8))
            x = x + ph * (nu / s)
            p = p - np.outer(ph, ph) / s
        xs[k], ps[k] = x, p
    for k in range(n - 2, -1, -1):
        gain = np.linalg.solve(pp[k + 1].T, (ps[k] @ fs[k + 1].T).T).T
        xs[k] = xs[k] + gain @ (xs[k + 1] - xp[k + 1])
        ps[k] = ps[k] + gain @ (ps[k + 1] - pp[k + 1]) @ gain.T
    sd = np.sqrt(np.maximum(np.einsum("kii->ki", ps), 0.0))
    return xs[:, 0], xs[:, 1], sd[:, 0], sd[:, 1]


def _hold(angle: FloatArray, valid: np.ndarray) -> FloatArray:
    """Angles with invalid ones replaced by the last valid, or the first where there is none."""
    if not valid.any():
        return np.zeros_like(angle)
    index = np.where(valid, np.arange(len(angle)), -1)
    index = np.maximum.accumulate(index)
    index = np.where(index < 0, int(np.flatnonzero(valid)[0]), index)
    return np.asarray(angle[index])
