"""A trajectory from fixes alone: a constant-velocity smoother on the local tangent plane.

For drives without an inertial sensor. States per axis: position, velocity, and what lasts of the
receiver's errors of both; white acceleration as process noise. Heading is the
course, pitch the slope of the path, roll zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from automap.earth import from_local_ned
from automap.effects import CATALOGUE
from automap.effects.limits import COURSE_SPEED
from automap.fusion.fix_axes import smooth_epochs, usable_epochs
from automap.fusion.limits import (
    LEAST_COURSE_SPEED,
    UNKNOWN_HEADING_SD,
    UNKNOWN_LEAN_SD,
)
from automap.fusion.measurements.position import common_errors, lasting_share, unseen_errors
from automap.fusion.nodes import model_fixes
from automap.fusion.options import FusionOptions
from automap.records import BoolArray, ClockModel, Fixes, FloatArray, Trajectory

TO_AXLE_SD = CATALOGUE["nhc_lever_arm"].parameters[0].prior_sd


def smooth_fixes(
    fixes: Fixes,
    clock: ClockModel,
    options: FusionOptions,
    factors: Mapping[str, float] = MappingProxyType({}),
) -> Trajectory:
    """Smoothed trajectory at the fixes' epochs, one row per usable fix; ``factors`` on the sizes of
    the fixes' errors by level, as ``fix_levels`` finds them.

    ``t_ns`` are the epochs on the clock's host time.

    Raises:
        InputError: fewer than two usable fixes.
    """
    at = usable_epochs(fixes, options)
    position, velocity = np.zeros((len(at.t), 3)), np.zeros((len(at.t), 3))
    sd_pos, sd_vel = np.zeros((len(at.t), 3)), np.zeros((len(at.t), 3))
    # what a receiver says of its velocities may be too much, but no position shows what they err
    # by together, as by their age
    plain = {level: max(value, 1.0) for level, value in factors.items()}
    for axis in range(3):
        out = np.zeros((len(at.t), 4))
        smooth_epochs(at, axis, options, plain, out)
        stated = out[:, 3].copy()
        smooth_epochs(at, axis, options, factors, out)
        position[:, axis], velocity[:, axis], sd_pos[:, axis], sd_vel[:, axis] = out.T
        sd_vel[:, axis] = np.maximum(sd_vel[:, axis], stated)
    sd_pos = np.hypot(sd_pos, unseen_errors(at.stated_sd, options, factors))
    t, ref = at.t, at.ref
    lat, lon, h = from_local_ned(position, ref)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    rpy = np.zeros((len(t), 3))
    course, moves = np.arctan2(velocity[:, 1], velocity[:, 0]), speed > COURSE_SPEED
    rpy[:, 2] = _hold(course, moves)
    rpy[:, 1] = np.where(speed > COURSE_SPEED, np.arctan2(-velocity[:, 2], speed), 0.0)
    lean = np.full(len(t), UNKNOWN_LEAN_SD)
    sd_heading = course_errors(t, velocity[:, :2], sd_vel[:, :2], options)
    # a vehicle at rest does not turn: it is as unsure as it was, and by what it turned creeping
    turned = _hold(course[::-1], moves[::-1])[::-1] - rpy[:, 2]
    held = np.hypot(_hold(sd_heading, moves), np.angle(np.exp(1j * turned)))
    if moves.any():
        sd_heading = np.where(moves, sd_heading, np.minimum(held, UNKNOWN_HEADING_SD))
    slip = np.radians(options.nhc_lasting_deg)
    sd_rpy = np.stack([lean, lean, np.hypot(sd_heading, slip)], axis=1)
    gps_s = fixes.gps_s[at.row]
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
        np.array(slip),
    )


def course_errors(
    t: FloatArray, velocity: FloatArray, sd: FloatArray, options: FusionOptions
) -> FloatArray:
    """Sigma [n] rad of the courses of ``velocity`` [n, 2] with ``sd`` [n, 2] m/s at ``t`` [n] s, as
    headings.

    A course errs by the velocity's error across it. A nose is off it by what the vehicle slides,
    as in the vehicle constraint, and in a bend, where the antenna is not over the axle that does
    not slide, by the arm over the bend's radius (Rajamani, Vehicle Dynamics and Control, 2.2).
    """
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    least = np.maximum(speed, LEAST_COURSE_SPEED)
    change = np.gradient(velocity, t, axis=0) if len(t) > 1 else np.zeros_like(velocity)
    north, east = (velocity / least[:, None]).T
    across = np.hypot(east * sd[:, 0], north * sd[:, 1])
    across = np.where(speed < LEAST_COURSE_SPEED, np.hypot(sd[:, 0], sd[:, 1]), across)
    lateral = north * change[:, 1] - east * change[:, 0]
    slides = np.hypot(options.nhc_sd, options.nhc_slip * lateral)
    swings = TO_AXLE_SD * lateral / least
    off = np.sqrt(across**2 + slides**2 + swings**2) / least
    return np.asarray(np.minimum(off, UNKNOWN_HEADING_SD))


def as_sure_as_fixes(
    path: Trajectory,
    fixes: Fixes,
    options: FusionOptions,
    factors: Mapping[str, float] = MappingProxyType({}),
) -> Trajectory:
    """The ``path`` of ``fixes`` alone with a position nowhere surer than the errors of its fixes
    that last: how long they do nobody has told, and a motion that no IMU has seen does not tell
    them from the way that was driven, so that the smoother's averages over minutes promise too
    much."""
    path = uncorrected(path, fixes, options)
    model = model_fixes(fixes, fixes.gps_s, options)
    has = (model.flags & 1) > 0
    if not has.any():
        return path
    lasts = np.hypot(
        lasting_share(options, factors) * model.stated_sd,
        unseen_errors(model.stated_sd, options, factors),
    )
    return at_least(path, model.t[has], lasts[has])


def as_old_as(path: Trajectory, age_sd_s: float) -> Trajectory:
    """The ``path`` with positions as unsure along the way as it goes in ``age_sd_s``: of which
    instant fixes are, and how late their clock is, no path of theirs alone shows."""
    along = np.abs(path.vel_ned) * age_sd_s
    return replace(path, sd_pos_ned=np.hypot(path.sd_pos_ned, along))


def at_least(path: Trajectory, gps_s: FloatArray, sd: FloatArray) -> Trajectory:
    """The ``path`` with a position nowhere surer than ``sd`` [k, 3] m at ``gps_s`` [k] s."""
    least = np.stack([np.interp(path.gps_s, gps_s, column) for column in sd.T], axis=1)
    return replace(path, sd_pos_ned=np.maximum(path.sd_pos_ned, least))


def uncorrected(path: Trajectory, fixes: Fixes, options: FusionOptions) -> Trajectory:
    """The ``path`` with a position nowhere surer than uncorrected ``fixes`` can be."""
    rows = np.flatnonzero(np.isfinite(fixes.lat_rad) & np.isfinite(fixes.gps_s))
    if not len(rows):
        return path
    rows = rows[np.argsort(fixes.gps_s[rows], kind="stable")]
    return at_least(path, fixes.gps_s[rows], common_errors(fixes, options)[rows])


def _hold(angle: FloatArray, valid: BoolArray) -> FloatArray:
    """Angles with invalid ones replaced by the last valid, or the first where there is none."""
    if not valid.any():
        return np.zeros_like(angle)
    index = np.where(valid, np.arange(len(angle)), -1)
    index = np.maximum.accumulate(index)
    index = np.where(index < 0, int(np.flatnonzero(valid)[0]), index)
    return np.asarray(angle[index])
