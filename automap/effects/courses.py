"""The courses of velocities: what turns them, and one velocity with the course of another."""

from __future__ import annotations

import numpy as np

from automap.effects.limits import COURSE_SPEED
from automap.effects.measured_kernels import course_changes
from automap.records import FloatArray


def size_of_course(vel: FloatArray) -> FloatArray:
    """Speeds [k], those that a course has something to say of."""
    return np.asarray(np.maximum(np.hypot(vel[:, 0], vel[:, 1]), COURSE_SPEED))


def turns_of(vel: FloatArray, acc: FloatArray) -> FloatArray:
    """What of accelerations [k, 3] turns velocities [k, 3]."""
    out = np.zeros_like(vel)
    course_changes(np.ascontiguousarray(vel), np.ascontiguousarray(acc), out)
    return out


def with_courses(vel: FloatArray, course_of: FloatArray) -> FloatArray:
    """Velocities [k, 3] with the courses of others, where either crawls hardly: there a course is
    anything, and another with each path."""
    size = np.hypot(vel[:, 0], vel[:, 1])
    other = np.hypot(course_of[:, 0], course_of[:, 1])
    told = np.minimum((np.minimum(size, other) / COURSE_SPEED) ** 2, 1.0)
    moving = other > 0.0
    out = vel.copy()
    for a in range(2):
        turned = np.where(moving, course_of[:, a] / np.where(moving, other, 1.0) * size, vel[:, a])
        out[:, a] += told * (turned - vel[:, a])
    return out
