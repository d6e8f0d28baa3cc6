"""The steps in which an inertial sensor's readings come, and what they are taken for.

Where what is between two steps is cut off, towards zero, readings are half a step too small and
nothing is read below one: a dead zone in all but the cause. What is rounded to coarse steps, or
told anew only once it has changed by enough, is noise in all but the cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from automap.gap import limits
from automap.gap.fit import Fit
from automap.records import FloatArray

ZONES = {"gyro_dead_zone": "gyro", "accel_dead_zone": "accel"}
"""Effects that look so, and whose readings they are of."""
_OFF = 0.05
"""Of a step: a log's digits leave readings less than that off its multiples, chance hardly all."""


def cut_off(fits: Sequence[Fit], effect: str, values: Mapping[str, tuple[float, float]]) -> str:
    """What a dead zone may be where the readings come in steps of its size, in words; nothing of
    other effects, and where steps are finer. ``values`` parameter (axis) -> value and sd."""
    if effect not in ZONES:
        return ""
    axis = max(values, key=lambda a: values[a][0] / max(values[a][1], 1e-12))
    size, sd = values[axis]
    steps = [
        step_of(getattr(fit.opened.drive.imu, ZONES[effect])[:, "xyz".index(axis)]) for fit in fits
    ]
    step = min(steps)
    # half a step is cut off in the mean, nearly a whole one where a sensor reads little;
    # what is known poorly is no reason to blame steps that are far finer, or none
    if not 0.5 * step - 2.0 * sd < size < min(step + 2.0 * sd, 2.0 * step):
        return ""
    return f"readings that are cut off towards zero, in the steps of {step:.3g} in which they come"


def coarse(fits: Sequence[Fit], level: str) -> str:
    """What makes a sensor's ("gyro", "accel") readings noisier than it is, in words: an axis that
    is held, or steps whose rounding alone is as much as a claim of noise needs; nothing mostly."""
    unit = {"gyro": "rad/s", "accel": "m/s^2"}[level]
    for fit in fits:
        imu = fit.opened.drive.imu
        interval_s = float(np.median(np.diff(imu.t_ns))) * 1e-9
        stated = getattr(fit.model.options, f"{level}_noise")
        for axis, readings in zip("xyz", getattr(imu, level).T, strict=True):
            step, change = step_of(readings), held_until(readings)
            if change > 1.5 * step:
                return (
                    f"its {axis} axis is told anew only when it has changed by {change:.2g} {unit}"
                )
            # the variance of rounding is even over a step
            density = step * (interval_s / 12.0) ** 0.5
            if density**2 > (limits.SCALE_FACTOR**2 - 1.0) * stated**2:
                return f"its {axis} axis comes in steps of {step:.2g} {unit}"
    return ""


def coarse_readings(fits: Sequence[Fit]) -> tuple[str, ...]:
    """A sentence for each sensor whose readings are held or come in coarse steps."""
    causes = {level: coarse(fits, level) for level in ("gyro", "accel")}
    return tuple(
        f"readings of the {level} are coarser than its noise as stated: {cause}"
        for level, cause in causes.items()
        if cause
    )


def held_until(readings: FloatArray) -> float:
    """The least by which readings [n] change, but for one in twenty, where most are the same as
    the one before; 0 where they are not."""
    apart = np.abs(np.diff(readings))
    changes = apart[apart > 0.0]
    if len(changes) == 0 or len(changes) > 0.5 * len(apart):
        return 0.0
    return float(np.quantile(changes, 0.05))


def step_of(readings: FloatArray) -> float:
    """The step of which all differences of readings [n] are multiples; 0 where there is none."""
    levels = np.unique(readings[np.isfinite(readings)])
    if not 2 < len(levels) < len(readings) / 2:
        # what is hardly ever read twice comes in no steps that could be seen
        return 0.0
    apart = np.diff(levels)
    # equal but for the last bits
    apart = apart[apart > _OFF * np.median(apart)]
    count = np.rint(apart / apart.min())
    step = float(apart.sum() / count.sum())
    return step if np.abs(apart / step - count).max() < _OFF else 0.0
