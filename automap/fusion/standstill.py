"""When the vehicle stands still, from the IMU's quietness and the receiver's speed.

A generalised likelihood ratio in spirit (Skog et al. 2010, "Zero-velocity detection: an
algorithm evaluation"), with the noise level taken from the recording itself: windows are
compared with the quietest ones of the drive, and only where the receiver agrees.
"""

from __future__ import annotations

import numpy as np

from automap.earth import local_ned, metres_per_radian
from automap.fusion import limits
from automap.fusion.layout import HAS_POS_H
from automap.fusion.nodes import FixModel, fix_speed
from automap.gates import gate, sigmas
from automap.records import FloatArray


def shown_speed(fixes: FixModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times [m], horizontal speeds [m] and their sd [m]: the receiver's, and where it tells none
    at all, those that its positions show.

    A speed of positions is that from the mean of the fixes of some seconds before to the mean of
    those after.
    """
    told = fix_speed(fixes)
    if len(told[0]):
        return told
    has = (fixes.flags & HAS_POS_H) > 0
    t, values, var = fixes.t[has], fixes.values[has], fixes.white_var[has, :2].max(axis=1)
    if len(t) == 0:
        return told
    reference = (float(values[0, 0]), float(values[0, 1]), float(values[0, 2]))
    ned = local_ned(values[:, 0], values[:, 1], np.full(len(t), reference[2]), reference)
    sums = np.cumsum(np.column_stack([t, ned.reshape(-1, 3)[:, :2], var]), axis=0)
    sums = np.concatenate([np.zeros((1, 4)), sums])
    first = np.searchsorted(t, t - limits.POSITION_SPEED_S)
    last = np.searchsorted(t, t + limits.POSITION_SPEED_S, "right")
    row = np.arange(len(t))
    n_before, n_after = row - first, last - row - 1
    enough = (n_before >= limits.POSITION_SPEED_FIXES) & (n_after >= limits.POSITION_SPEED_FIXES)
    row, n_before, n_after = row[enough], n_before[enough, None], n_after[enough, None]
    before = (sums[row] - sums[first[enough]]) / n_before
    after = (sums[last[enough]] - sums[row + 1]) / n_after
    lasted, north, east, _ = (after - before).T
    noise = before[:, 3] / n_before[:, 0] + after[:, 3] / n_after[:, 0]
    # two axes, as of the receiver's speeds
    return t[row], np.hypot(north, east) / lasted, np.sqrt(2.0 * noise) / lasted


def find_standstill(
    t: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    speed_t: FloatArray,
    speed: FloatArray,
    speed_sd: FloatArray,
) -> list[tuple[float, float]]:
    """Intervals (start, stop) in s during which the vehicle stands.

    ``t`` [n], ``gyro`` and ``accel`` [n, 3] readings; ``speed_t`` [m], ``speed`` [m] the
    receiver's horizontal speed with ``speed_sd`` [m], see ``shown_speed``. The speed must be
    compatible with zero throughout; then the windowed spread of the readings must be within
    a factor of the quietest such windows, which keeps slow creeping out.
    """
    if len(t) < 10 or len(speed_t) == 0:
        return []
    dt = float(np.median(np.diff(t)))
    width = max(round(limits.STANDSTILL_WINDOW_S / dt), 5)
    spread_a = _rolling_sd(accel, width)
    spread_g = _rolling_sd(gyro, width)
    doubt = sigmas(limits.MOVES_PROBABILITY) * speed_sd
    limit = np.interp(t, speed_t, np.maximum(doubt, limits.LEAST_SLOW_SPEED))
    nearest = np.abs(t - speed_t[np.clip(np.searchsorted(speed_t, t), 0, len(speed_t) - 1)])
    before = np.abs(t - speed_t[np.clip(np.searchsorted(speed_t, t) - 1, 0, len(speed_t) - 1)])
    speed = np.interp(t, speed_t, speed)
    slow = speed < np.minimum(limit, limits.MOST_SLOW_SPEED)
    slow &= np.minimum(nearest, before) < limits.FIX_REACH_S
    if not slow.any():
        return []
    # quiet means: like the quietest of the slow windows, and clearly quieter than driving
    floor_a = float(np.percentile(spread_a[slow], limits.QUIETEST_PERCENTILE))
    floor_g = float(np.percentile(spread_g[slow], limits.QUIETEST_PERCENTILE))
    moving = speed > limits.DRIVING_SPEED
    if moving.any():
        floor_a = min(floor_a, limits.QUIET_FORCE * float(np.median(spread_a[moving])))
        floor_g = min(floor_g, limits.QUIET_RATE * float(np.median(spread_g[moving])))
    quiet = slow & (spread_a < limits.QUIET_FACTOR * floor_a)
    quiet &= spread_g < limits.QUIET_FACTOR * floor_g
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]])))
    out, half = [], 0.5 * limits.STANDSTILL_WINDOW_S
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        a, b = float(t[start]) + half, float(t[stop - 1]) - half
        if b - a >= limits.LEAST_STANDSTILL_S - 2.0 * half:
            out.append((a, b))
    return out


def unmoved(standstill: list[tuple[float, float]], fixes: FixModel) -> list[tuple[float, float]]:
    """The intervals over which positions stay: a speed of zero alone may be a log's.

    The ends of an interval are compared by the means of their fixes' quarter.
    """
    has = (fixes.flags & HAS_POS_H) > 0
    t, values = fixes.t[has], fixes.values[has]
    limit = gate(limits.MOVES_PROBABILITY, 2)
    out = []
    for start, stop in standstill:
        inside = (t >= start) & (t <= stop)
        n = int(inside.sum())
        if n >= 2:
            part = max(n // 4, 1)
            rows = np.flatnonzero(inside)
            first, last = (
                values[rows[:part], :2].mean(axis=0),
                values[rows[-part:], :2].mean(axis=0),
            )
            north, east = metres_per_radian(first[:1], values[rows[:1], 2])
            moved = (last - first) * [float(north[0]), float(east[0])]
            sd = np.sqrt(
                fixes.white_var[has][rows, :2].max(axis=0)
                + fixes.whole_sd[has][rows, :2].max(axis=0) ** 2
            )
            if float((moved**2 / (2.0 * sd**2)).sum()) > limit:
                continue
        out.append((start, stop))
    return out


def rest_gyro_bias(
    t: FloatArray, gyro: FloatArray, standstill: list[tuple[float, float]]
) -> FloatArray | None:
    """Mean reading [3] at rest in rad/s over all standstill, None without any."""
    mask = np.zeros(len(t), dtype=bool)
    for start, stop in standstill:
        mask |= (t >= start) & (t <= stop)
    return gyro[mask].mean(axis=0) if mask.any() else None


def _rolling_sd(values: FloatArray, width: int) -> FloatArray:
    """Norm over axes of the centred moving standard deviation [n]."""
    from scipy.ndimage import uniform_filter1d

    mean = uniform_filter1d(values, width, axis=0, mode="nearest")
    square = uniform_filter1d((values - values.mean(axis=0)) ** 2, width, axis=0, mode="nearest")
    var = square - (mean - values.mean(axis=0)) ** 2
    return np.asarray(np.sqrt(np.maximum(var, 0.0).sum(axis=1)))
