"""The smoothed motion of a fitted drive, as signals over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.earth import gravity
from automap.effects.gnss import low_pass
from automap.frames import quat_to_matrix
from automap.fusion.kernel_runs import run_dense
from automap.fusion.passes import Pass
from automap.records import FloatArray


@dataclass(frozen=True)
class Motion:
    """The smoothed motion at the IMU's epochs.

    ``t`` [n] s, ``pos`` [n, 3] rad, rad, m, ``vel`` [n, 3] NED, ``dcm`` [n, 3, 3] body to NED,
    ``rate`` and ``force`` [n, 3] corrected readings, ``acc`` [n, 3] NED over ground.
    """

    t: FloatArray
    pos: FloatArray
    vel: FloatArray
    dcm: FloatArray
    rate: FloatArray
    force: FloatArray
    acc: FloatArray


def motion_of(last: Pass) -> Motion:
    """The smoothed motion of a pass at the IMU's epochs."""
    dense, readings = run_dense(
        last.problem, last.nodes, last.smooth.nominal, last.smooth.params, True, with_rates=True
    )
    bad = ~(np.isfinite(dense).all(axis=1) & np.isfinite(readings).all(axis=1))
    if bad.any():
        good = np.flatnonzero(~bad)
        nearest = good[np.clip(np.searchsorted(good, np.flatnonzero(bad)), 0, len(good) - 1)]
        dense[bad], readings[bad] = dense[nearest], readings[nearest]
    t = last.problem.t
    dcm = quat_to_matrix(dense[:, 6:10])
    step = max(float(np.median(np.diff(t))), 1e-4)
    from scipy.ndimage import uniform_filter1d

    width = max(2 * round(0.05 / step) + 1, 1)
    force = uniform_filter1d(readings[:, 3:], width, axis=0, mode="nearest")
    acc = np.einsum("nij,nj->ni", dcm, force)
    acc[:, 2] += float(gravity(float(dense[0, 0]), float(dense[0, 2])))
    return Motion(t, dense[:, :3], dense[:, 3:6], dcm, readings[:, :3], readings[:, 3:], acc)


def at_times(motion: Motion, signal: FloatArray, t: FloatArray) -> FloatArray:
    """A signal [n, k] of the motion at instants [m], linear between epochs."""
    flat = signal.reshape(len(motion.t), -1)
    out = np.stack([np.interp(t, motion.t, column) for column in flat.T], axis=1)
    return np.asarray(out.reshape((len(t), *signal.shape[1:])))


def lagged(motion: Motion, signal: FloatArray, tau_s: float) -> FloatArray:
    """A ``signal`` [n, 3] of the motion after a first-order low-pass of time constant ``tau_s``."""
    step = max(float(np.median(np.diff(motion.t))), 1e-4)
    grid = np.arange(motion.t[0], motion.t[-1] + step, step)
    even = np.stack([np.interp(grid, motion.t, v) for v in signal.T], axis=1)
    passed = low_pass(even, step, tau_s)
    return np.stack([np.interp(motion.t, grid, v) for v in passed.T], axis=1)
