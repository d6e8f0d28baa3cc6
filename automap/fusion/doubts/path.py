"""A path against the fixes that it was made of, over stretches of seconds to the whole drive.

A path made of fixes differs from them by no more than they err: their variance less the path's,
which has a part in what they err (residuals of least squares; Teunissen, Adjustment Theory, section
2.3). In the mean over a stretch the fixes' white noise goes; their slow error stays while the
stretch is shorter than it lasts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.earth import local_ned
from automap.frames import rpy_to_matrix
from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason, Span
from automap.fusion.layout import HAS_POS_H, HAS_POS_V
from automap.fusion.limits import DOUBT_PROBABILITY
from automap.fusion.nodes import FixModel
from automap.gates import gate
from automap.interpolation import poses_at_gps
from automap.records import BoolArray, FloatArray, Trajectory


@dataclass(frozen=True)
class Misses:
    """Fixes minus path NED ``miss`` [m, 3] m at ``t`` [m] s from the path's first row, NaN down
    where a fix has no height; variances [m, 3] m^2 of the fixes' white and slow error."""

    t: FloatArray
    miss: FloatArray
    white_var: FloatArray
    slow_var: FloatArray

    def __len__(self) -> int:
        return len(self.t)


def fix_misses(
    path: Trajectory, fixes: FixModel, arm: FloatArray | None = None, latency_s: float = 0.0
) -> Misses:
    """How far fixes, timed in GPS seconds, lie off a path that they are covered by.

    ``arm`` [3] m from the path's point to the antenna in vehicle axes; ``latency_s`` the fixes'
    age at their tag.
    """
    has = (fixes.flags & HAS_POS_H) > 0
    gps_s = fixes.t[has] - latency_s
    at = poses_at_gps(path, gps_s)
    rows = np.flatnonzero(has)[at.covered]
    keep = at.covered
    if not len(rows):
        return Misses(np.zeros(0), *(np.zeros((0, 3)) for _ in range(3)))
    high = (fixes.flags[rows] & HAS_POS_V) > 0
    ref = (float(at.lat_rad[keep][0]), float(at.lon_rad[keep][0]), float(at.height_m[keep][0]))
    height = np.where(high, fixes.values[rows, 2], np.nan)
    seen = local_ned(fixes.values[rows, 0], fixes.values[rows, 1], np.nan_to_num(height), ref)
    found = local_ned(at.lat_rad[keep], at.lon_rad[keep], at.height_m[keep], ref)
    miss = seen.reshape(-1, 3) - found.reshape(-1, 3)
    if arm is not None and arm.any():
        miss -= rpy_to_matrix(at.rpy[keep]) @ arm
    miss[~high, 2] = np.nan
    return Misses(
        gps_s[keep] - path.gps_s[0],
        miss,
        fixes.white_var[rows, :3],
        fixes.stated_sd[rows] ** 2,
    )


def contradicted(misses: Misses, tau_s: float) -> BoolArray:
    """Which fixes [m] lie in a stretch whose fixes are off the path, horizontally and together,
    by more than they err; ``tau_s`` how long a fix's slow error lasts."""
    wrong = np.zeros(len(misses), np.bool_)
    if len(misses) < 2:
        return wrong
    level = slice(0, 2)
    parts = [a[:, level] for a in (misses.white_var, misses.slow_var)]
    # single wild fixes, which the path was right to pass by, shall not speak for a stretch
    most = limits.WILD_MISS_SIGMAS * np.sqrt(sum(parts))
    parts = [np.clip(misses.miss[:, level], -most, most), *parts]
    whole = float(misses.t[-1] - misses.t[0])
    for window in (*(w for w in limits.STRETCHES_S if w < whole), whole):
        # what a shorter stretch has found shall not make a longer one of it
        rest = np.flatnonzero(~wrong)
        off = _off(misses.t[rest], [part[rest] for part in parts], window, window / whole, tau_s)
        wrong[rest[off]] = True
    return wrong


def _off(
    t: FloatArray, parts: list[FloatArray], window: float, share: float, tau_s: float
) -> BoolArray:
    """Which instants ``t`` [m] lie in a stretch of ``window`` s, ``share`` of the drive, that is
    off; ``parts`` [m, 2] each are miss and variances of white and slow error."""
    first = np.arange(len(t)) if share < 1.0 else np.zeros(min(len(t), 1), np.int64)
    stop = np.searchsorted(t, t[first] + window, side="right")
    filled = (stop - first > 2) & (t[stop - 1] - t[first] >= limits.FILLED_STRETCH * window)
    first, stop = first[filled], stop[filled]
    count = (stop - first)[:, None]
    sums = [_cumulated(part) for part in parts]
    mean, white, slow = ((s[stop] - s[first]) / count for s in sums)
    var = white / count + slow * _left_of_slow(window / tau_s)
    off = (mean**2 / var).sum(axis=1) > gate(DOUBT_PROBABILITY * share, 2)
    edges = np.zeros(len(t) + 1, np.int64)
    np.add.at(edges, first[off], 1)
    np.add.at(edges, stop[off], -1)
    return np.asarray(np.cumsum(edges)[:-1] > 0)


def _cumulated(values: FloatArray) -> FloatArray:
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])


def _left_of_slow(x: float) -> float:
    """Variance of the mean of a first-order Gauss-Markov error of variance one over ``x`` of its
    time constants (Papoulis, Probability, Random Variables and Stochastic Processes, 12-1)."""
    return 2.0 * (x - 1.0 + float(np.exp(-x))) / x**2 if x > 1e-3 else 1.0


def spans_of(t: FloatArray, wrong: BoolArray) -> tuple[Span, ...]:
    """The stretches of ``wrong`` instants among ``t`` [m], each to half way to its neighbours."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], wrong.astype(np.int8), [0]])))
    between = np.concatenate([t[:1], 0.5 * (t[1:] + t[:-1]), t[-1:]])
    return tuple(
        (float(between[a]), float(between[b])) for a, b in zip(edges[::2], edges[1::2], strict=True)
    )


def local_error(misses: Misses) -> FloatArray:
    """Horizontal distance [m] m that the fixes about each one are off the path, all together."""
    n = len(misses)
    half = 0.5 * limits.STRETCHES_S[0]
    total = _cumulated(misses.miss[:, :2])
    first = np.searchsorted(misses.t, misses.t - half, side="left")
    stop = np.searchsorted(misses.t, misses.t + half, side="right")
    mean = (total[stop] - total[first]) / (stop - first)[:, None] if n else total[:0]
    return np.asarray(np.hypot(mean[:, 0], mean[:, 1]))


def off_the_fixes(misses: Misses, tau_s: float) -> tuple[list[Reason], float]:
    """The reason that the fixes give, and which share of them is far off the path."""
    wrong = contradicted(misses, tau_s)
    if not wrong.any():
        return [], 0.0
    share = float(wrong.mean())
    error = local_error(misses)[wrong]
    spans = spans_of(misses.t, wrong)
    seconds = sum(b - a for a, b in spans)
    return [
        Reason(
            "off_the_fixes",
            f"for {seconds:.0f} s of the drive the fixes lie {np.median(error):.1f} m off the path "
            f"(up to {error.max():.1f} m), more than they err: look there at the receiver's "
            "log and at the stamps and axes of the IMU",
            spans if share < limits.WORSE_SHARE else (),
        )
    ], share
