"""A receiver's fixes as two paths in the plane: the one its positions show, and the one that its
velocities integrate to.

Horizontal vectors are complex numbers, north + i east: a turn is a factor then, and a mirroring
the conjugate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from automap.earth import metres_per_radian
from automap.records import BoolArray, Fixes, FixType, FloatArray, IntArray
from automap.sync import limits
from automap.sync.digits import rounded_m

ComplexArray = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class ReceiverPath:
    """Fixes with a position, in the order of time, no two at once.

    ``row`` [n] their rows among the fixes, ``t`` [n] s after the first; ``place`` [n] m from the
    first; ``velocity`` [n] m/s as told, NaN without; ``height`` [n] m, ``climb`` [n] m/s upwards,
    NaN without. ``sd`` [n] m, the receiver's own figure of a coordinate, zero without;
    ``rounded_m`` what its digits make one err by.
    """

    row: IntArray
    t: FloatArray
    start_gps_s: float
    place: ComplexArray
    velocity: ComplexArray
    height: FloatArray
    climb: FloatArray
    sd: FloatArray
    rounded_m: float = 0.0

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True)
class Windows:
    """Stretches from row ``first`` [m] to row ``last`` [m] of a path, about equally long."""

    first: IntArray
    last: IntArray

    def __len__(self) -> int:
        return len(self.first)

    @overload
    def change(self, values: FloatArray) -> FloatArray: ...

    @overload
    def change(self, values: ComplexArray) -> ComplexArray: ...

    def change(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """By how much values [n] of the rows change over each window [m]."""
        return np.asarray(values[self.last] - values[self.first])

    def part(self, keep: BoolArray) -> Windows:
        """Some of them."""
        return Windows(self.first[keep], self.last[keep])


def receiver_path(fixes: Fixes) -> ReceiverPath:
    """The paths of ``fixes``. Steps are taken in the local metres of each, as the velocities are
    told, so that no convergence of meridians builds up along a drive."""
    good = (fixes.fix_type >= FixType.TWO_D) & np.isfinite(fixes.gps_s)
    good &= np.isfinite(fixes.lat_rad) & np.isfinite(fixes.lon_rad)
    row = np.flatnonzero(good)
    row = row[np.argsort(fixes.gps_s[row], kind="stable")]
    if len(row):
        later = np.diff(fixes.gps_s[row]) > limits.TICK_S
        row = row[np.concatenate([[True], later])]
    gps_s, lat, lon = fixes.gps_s[row], fixes.lat_rad[row], np.unwrap(fixes.lon_rad[row])
    height = fixes.height_m[row]
    middle = 0.5 * (lat[1:] + lat[:-1])
    per_lat, per_lon = metres_per_radian(middle, np.nan_to_num(height[1:]))
    steps = np.diff(lat) * per_lat + 1j * np.diff(lon) * per_lon
    start = float(gps_s[0]) if len(row) else 0.0
    velocity = fixes.vel_ned[row, 0] + 1j * fixes.vel_ned[row, 1]
    sd = np.nan_to_num(fixes.sd_pos_ned[row, :2].max(axis=1)) if len(row) else np.zeros(0)
    return ReceiverPath(
        row=row,
        t=gps_s - start,
        start_gps_s=start,
        place=np.concatenate([np.zeros(min(1, len(row))), np.cumsum(steps)]).astype(complex),
        velocity=velocity,
        height=height,
        climb=-fixes.vel_ned[row, 2],
        sd=sd,
        rounded_m=rounded_m(fixes),
    )


def integrated(
    path: ReceiverPath, use: BoolArray, speed_lag_s: float = 0.0, course_lag_s: float = 0.0
) -> ComplexArray:
    """The path [n] that the velocities of the rows ``use`` [n] add up to, were their speeds and
    courses told so much late; from zero.

    Speed and course are interpolated each for itself, so that a bend keeps its speed. At a
    standstill a course is anything: it is that of the motion before and after. Where velocities are
    missing for long there is no motion.
    """
    known = use & np.isfinite(path.velocity)
    t, told = path.t[known], path.velocity[known]
    if len(t) < 2:
        return np.zeros(len(path), complex)
    speed = np.abs(told)
    has_course = speed > limits.COURSE_SHARE * float(np.quantile(speed, limits.FAST_QUANTILE))
    if not np.any(has_course):
        return np.zeros(len(path), complex)
    course = np.unwrap(np.angle(told[has_course]))
    step = min(limits.INTEGRATION_S, float(np.median(np.diff(t))))
    # where nothing is told nothing moves
    idle = np.maximum(np.diff(path.t) - limits.GAP_WITHIN_DRIVE_S, 0.0)
    at = path.t - np.concatenate([[0.0], np.cumsum(idle)])
    t = at[known]
    grid = np.arange(0.0, at[-1] + step, step)
    rate = np.interp(grid + speed_lag_s, t, speed) * np.exp(
        1j * np.interp(grid + course_lag_s, t[has_course], course)
    )
    after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    rate[t[after] - t[after - 1] > limits.FIX_GAP_S] = 0.0
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * step)])
    return np.asarray(np.interp(at, grid, sums), complex)


def windows(
    path: ReceiverPath, use: BoolArray, length_s: float, positions: BoolArray, apart: bool = False
) -> Windows:
    """Windows of ``length_s`` from and to rows ``positions`` [n], within which no velocity of the
    rows ``use`` [n] is missing for longer than a motion may be bridged; ``apart``: none begins
    before the last one ends.
    """
    rows = np.flatnonzero(positions)
    t = path.t[rows]
    if len(t) < 2:
        return Windows(rows[:0], rows[:0])
    known = path.t[use & np.isfinite(path.velocity)]
    if len(known) < 2:
        return Windows(rows[:0], rows[:0])
    length = max(length_s, float(np.median(np.diff(t))))
    last = np.searchsorted(t, t + length - 0.5 * float(np.median(np.diff(t))))
    first = np.flatnonzero(last < len(t))
    last = last[first]
    span = t[last] - t[first]
    steps = np.diff(known)
    holes = np.concatenate([[0.0], np.cumsum(np.where(steps > limits.FIX_GAP_S, steps, 0.0))])
    lost = np.interp(t, known, holes)
    outside = (t < known[0] - limits.FIX_GAP_S) | (t > known[-1] + limits.FIX_GAP_S)
    keep = (span < limits.LONG_WINDOW * length) & (lost[last] - lost[first] <= 0.0)
    keep &= ~(outside[first] | outside[last])
    first, last = first[keep], last[keep]
    if apart and len(first):
        chosen, end = [], -1
        for k in range(len(first)):
            if first[k] >= end:
                chosen.append(k)
                end = last[k]
        first, last = first[chosen], last[chosen]
    return Windows(rows[first], rows[last])


def plausible_sd(path: ReceiverPath, over: Windows) -> FloatArray:
    """By how much, m one sigma of a coordinate [m], the two paths of a sound receiver part over
    windows: noise and wander of the positions, and what its velocities err by."""
    t = over.change(path.t)
    wander = np.maximum(limits.WANDER_SD_M, np.maximum(path.sd[over.first], path.sd[over.last]))
    noise = math.hypot(limits.POSITION_NOISE_M, path.rounded_m)
    positions = 2.0 * (noise**2 - wander**2 * np.expm1(-t / limits.WANDER_TAU_S))
    return np.asarray(np.sqrt(positions + velocity_sd(path, over) ** 2))


def velocity_sd(path: ReceiverPath, over: Windows) -> FloatArray:
    """What a sound receiver's velocities alone err by over windows, m one sigma of a coordinate
    [m]: an error that lasts for seconds, and a delay that is not known."""
    t = over.change(path.t)
    tau = limits.VELOCITY_ERROR_TAU_S
    lasting = 2.0 * limits.VELOCITY_ERROR_SD**2 * tau * (t + tau * np.expm1(-t / tau))
    known = np.isfinite(path.velocity)
    if not np.any(known):
        return np.asarray(np.sqrt(lasting))
    velocity = np.interp(path.t, path.t[known], path.velocity[known])
    delayed = limits.DELAY_SD_S * np.abs(over.change(velocity))
    return np.asarray(np.sqrt(lasting + delayed**2))
