"""Wild fixes found before the filter sees them, by the majority of the drive's fixes.

A filter that meets wrong fixes first believes them and then distrusts the right ones. Seen
over the whole drive, positions that contradict all others, linked by the receiver's
velocities, stand out however many there are in a row. Iteratively reweighted smoothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.earth import local_ned
from automap.fusion import limits
from automap.fusion.kernels.axis import smooth_axis
from automap.fusion.layout import HAS_POS_H, HAS_POS_V, HAS_VEL_H
from automap.fusion.nodes import FixModel
from automap.gates import gate
from automap.records import BoolArray, FloatArray, IntArray

NEVER = 1e12
"""No innovation surprises: which fixes are wild the rounds decide, all together."""
NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Screening:
    """Fixes with the wild ones' variances raised; rows of the wild ones in the fix table, and
    the largest distance in m."""

    fixes: FixModel
    outliers: IntArray
    largest_m: float

    @property
    def n_outliers(self) -> int:
        """How many fixes are wild."""
        return len(self.outliers)


def screen_fixes(model: FixModel, tau_s: float) -> Screening:
    """Raise the white position variance of fixes that contradict the drive's majority.

    ``tau_s`` correlation time of the receiver's slow error. The distance of a fix from the
    smoothed path of all others counts against its white and slow error together, and against
    what most fixes of the drive lie off where that is more.
    """
    use = np.flatnonzero((model.flags & HAS_POS_H) > 0)
    use = use[np.concatenate([[True], np.diff(model.t[use]) > 0])] if len(use) else use
    if len(use) < 4:
        return Screening(model, NONE, 0.0)
    t = model.t[use]
    first = model.values[use[0]]
    has_height = (model.flags[use] & HAS_POS_V) > 0
    height = np.where(has_height, model.values[use, 2], first[2])
    ned = local_ned(
        model.values[use, 0], model.values[use, 1], height, (first[0], first[1], float(height[0]))
    ).reshape(-1, 3)
    has_velocity = (model.flags[use] & HAS_VEL_H) > 0
    expected = model.white_var[use, :3] + model.whole_sd[use] ** 2
    velocity_var = model.white_var[use, 3:5] + _delay_var(t, model.values[use, 3:5], has_velocity)
    outlier_from = gate(limits.OUTLIER_PROBABILITY, 2)
    extra = np.zeros(len(use))
    distance = np.zeros(len(use))
    for _ in range(limits.SCREENING_ROUNDS):
        miss = np.zeros((len(use), 2))
        for axis in range(2):
            out = np.zeros((len(use), 4))
            smooth_axis(
                t,
                np.column_stack([ned[:, axis], model.values[use, 3 + axis]]),
                np.column_stack([np.ones(len(use), dtype=bool), has_velocity]),
                np.column_stack([expected[:, axis] + extra, velocity_var[:, axis]]),
                np.zeros((len(use), 2)),
                limits.ROAD_ACCELERATION_PSD[axis],
                (tau_s, tau_s),
                NEVER,
                out,
            )
            miss[:, axis] = ned[:, axis] - out[:, 0]
        squared = (miss**2 / expected[:, :2]).sum(axis=1)
        # a receiver that errs by more than it states is not wild at every fix in four
        squared /= max(float(np.median(squared)) / gate(0.5, 2), 1.0)
        distance = np.hypot(miss[:, 0], miss[:, 1])
        before = extra
        extra = np.where(squared > outlier_from, (limits.OUTLIER_SD * distance) ** 2, 0.0)
        if np.array_equal(extra > 0, before > 0):
            break
    outliers = extra > 0
    if not outliers.any():
        return Screening(model, NONE, 0.0)
    var = model.white_var.copy()
    var[use[outliers], :3] += extra[outliers][:, None]
    return Screening(
        replace(model, white_var=var), model.row[use[outliers]], float(distance[outliers].max())
    )


def _delay_var(t: FloatArray, velocity: FloatArray, known: BoolArray) -> FloatArray:
    """Variances [n, 2] in m^2/s^2 of velocities for not knowing of which instant they are."""
    if int(known.sum()) < 2:
        return np.zeros_like(velocity)
    window = limits.VELOCITY_DELAY_WINDOW_S
    half = 0.5 * window
    change = [
        np.interp(t + half, t[known], v[known]) - np.interp(t - half, t[known], v[known])
        for v in velocity.T
    ]
    return np.asarray((limits.VELOCITY_DELAY_SD_S * np.column_stack(change) / window) ** 2)
