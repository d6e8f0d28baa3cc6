"""The velocity of the antenna, from a fix."""

from __future__ import annotations

import numpy as np

from automap.effects.limits import COURSE_SPEED
from automap.effects.measured_kernels import antenna_velocity
from automap.fusion.arrays import ModelArrays, NodeArrays
from automap.fusion.layout import CH_VEL, HAS_VEL_H, HAS_VEL_V
from automap.fusion.limits import DOWN_FACTOR
from automap.fusion.measurements.state import AtNode
from automap.fusion.options import FusionOptions
from automap.jit import kernel
from automap.records import BoolArray, Fixes, FixType, FloatArray


def velocity_errors(fixes: Fixes, factor: FloatArray, options: FusionOptions) -> FloatArray:
    """Sigma NED [n, 3] m/s of velocities: the receiver's figure times ``factor`` [n]."""
    sd = np.where(
        np.isfinite(fixes.sd_vel_ned) & (fixes.sd_vel_ned > 0),
        fixes.sd_vel_ned,
        options.velocity_sd * np.array([1.0, 1.0, DOWN_FACTOR]),
    )
    return np.maximum(sd * factor[:, None], options.min_velocity_sd)


def has_velocity(fixes: Fixes) -> tuple[BoolArray, BoolArray]:
    """Which fixes [n] have a horizontal velocity, and which a vertical one too."""
    level = np.isfinite(fixes.vel_ned[:, :2]).all(axis=1) & (fixes.fix_type > FixType.NONE)
    return level, level & np.isfinite(fixes.vel_ned[:, 2])


def told_later(t: FloatArray, velocity: FloatArray, speed_s: float, course_s: float) -> FloatArray:
    """Horizontal velocities [n, 2] m/s at times ``t`` [n] s, of speeds that are told ``speed_s`` s
    and courses that are told ``course_s`` s after them; at a crawl a course turns as those before
    and after it do."""
    speed, course = np.hypot(*velocity.T), np.arctan2(velocity[:, 1], velocity[:, 0])
    moving = speed > COURSE_SPEED
    later = np.interp(t + speed_s, t, speed)
    if moving.any():
        known = np.unwrap(course[moving])
        then = np.interp(t + course_s, t[moving], known)
        turned = course + then - np.interp(t, t[moving], known)
        course = np.where(later > COURSE_SPEED, then, turned)
    return np.column_stack([later * np.cos(course), later * np.sin(course)])


@kernel
def velocity(
    nodes: NodeArrays, k: int, at: AtNode, model: ModelArrays, h: FloatArray, z: FloatArray
) -> tuple[int, int]:
    """Residual ``z`` [3] m/s NED and rows ``h`` [3, n]: number of rows, first channel (loosely
    coupled: Groves, section 14.3)."""
    flags, fix = nodes.flags[k], nodes.fix[k]
    horizontal, vertical = (flags & HAS_VEL_H) != 0, (flags & HAS_VEL_V) != 0
    if not (horizontal or vertical):
        return 0, 0
    terms, params, signals, room = model.on_velocity, at.params, at.signals, at.room
    antenna_velocity(
        h, z, at.vel, at.c, at.rate, at.acc, params, terms.codes, terms.weights, signals, room
    )
    for a in range(3):
        z[a] = fix[3 + a] - z[a]
    if horizontal:
        return (3 if vertical else 2), CH_VEL
    z[0] = z[2]
    h[0, :] = h[2, :]
    return 1, CH_VEL + 2
