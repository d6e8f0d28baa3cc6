"""Whether all rows of an IMU recording are one sensor's, that stayed as it was.

Gravity is felt throughout: two sensors in one table, a case that was turned and a unit that changes
show in it by themselves, whatever the axes are and whatever is driven.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.evaluation import limits
from automap.evaluation.plausibility import Finding
from automap.records import FloatArray, ImuData

MIXED_CODE = "imu_mixed"
"""Of readings of two sensors in turn."""
CHANGED_CODE = "imu_changed"
"""Of readings of which a part is another sensor's, or in another unit."""


def two_in_turn(imu: ImuData) -> Finding | None:
    """An error for rows of two sensors in turn, else None: in most windows of some rows those of a
    triad are of two kinds, with nothing between, and go from one to the other and back."""
    if not any(_in_turn(triad) for triad in (imu.accel, imu.gyro)):
        return None
    return Finding(
        "error",
        "its rows are of two sensors in turn: neighbours differ by more than those of either kind",
        "write the readings of one sensor only, each of two into a file of its own",
        MIXED_CODE,
    )


def _in_turn(triad: FloatArray) -> bool:
    rows = limits.MIXED_ROWS
    count = len(triad) // rows
    if count < limits.MIXED_WINDOWS:
        return False
    chosen = np.unique(np.linspace(0, count - 1, limits.MOST_MIXED_WINDOWS).astype(int))
    windows = triad[: count * rows].reshape(count, rows, 3)[chosen]
    digits = [np.diff(np.unique(column)) for column in windows.reshape(-1, 3).T]
    step = max(float(np.median(steps)) if len(steps) else 0.0 for steps in digits)
    windows = windows - windows.mean(axis=1, keepdims=True)
    # the direction in which a window's rows differ most
    most = np.linalg.eigh(np.einsum("kri,krj->kij", windows, windows))[1][:, :, -1]
    along = np.einsum("kri,ki->kr", windows, most)
    ordered = np.sort(along, axis=1)
    few = round(limits.MIXED_LEAST_SHARE * rows)
    gaps = np.diff(ordered, axis=1)[:, few - 1 : rows - few]
    cut = few + np.argmax(gaps, axis=1)
    gap = gaps.max(axis=1)
    flagged = 0
    for values, row, k, between in zip(along, ordered, cut, gap, strict=True):
        spread = max(float(np.ptp(row[:k])), float(np.ptp(row[k:])))
        changes = np.count_nonzero(np.diff(values >= row[k]))
        apart = between > max(spread, limits.MIXED_STEPS * step)
        flagged += bool(apart and changes >= limits.MIXED_LEAST_SHARE * rows)
    return flagged > limits.MIXED_PART * len(chosen)


@dataclass(frozen=True)
class _Split:
    """Values of windows from ``at`` of ``count`` on differ most from those before: ``before`` and
    ``after`` are their medians [d]."""

    count: int
    at: int
    before: FloatArray
    after: FloatArray

    @property
    def sides(self) -> FloatArray:
        """The median of its side at each window [k, d]."""
        first = np.arange(self.count)[:, None] < self.at
        return np.where(first, self.before, self.after)


def other_from(imu: ImuData, begin_s: float = -np.inf, end_s: float = np.inf) -> Finding | None:
    """An error for readings that are in another unit, or of a sensor that lies otherwise, from some
    stamp on, else None; of those from ``begin_s`` to ``end_s`` s after the first, while it drives:
    before and after an IMU may be in somebody's hands."""
    start, force, _ = _windows(imu, begin_s, end_s)
    if len(start) < 2 * limits.CHANGED_LEAST:
        return None
    size = np.linalg.norm(force, axis=1)
    if not (size > 0.0).all():
        return None
    found = _split(np.log(size)[:, None])
    by = abs(float(found.after[0] - found.before[0]))
    rest = np.abs(np.log(size) - found.sides[:, 0])
    if by > np.log(limits.CHANGED_GRAVITY) and _is_all(rest, by):
        was, becomes = np.exp(found.before[0]), np.exp(found.after[0])
        return _changed(
            imu,
            float(start[found.at]),
            f"specific force is {was:.3g} m/s^2 before and {becomes:.3g} from there on, where "
            "gravity is 9.81",
            "two units stand in one file: bring both parts to one, or cut the drive in two there",
        )
    up = force / size[:, None]
    found = _split(up)
    angle = float(_angle(found.before, found.after))
    if angle < limits.CHANGED_RAD or not _is_all(_angle(up, found.sides), angle):
        return None
    return _changed(
        imu,
        float(start[found.at]),
        f"gravity lies {np.degrees(angle):.0f} deg from where it was before, as no road does",
        "the sensor was turned in its mount, or two logs stand in one file: cut the drive in two "
        "there",
    )


def gyro_unit_from(imu: ImuData, begin_s: float = -np.inf, end_s: float = np.inf) -> Finding | None:
    """An error for a gyro whose unit changes, in readings whose turns have the wrong size; None
    where its noise beside the accelerometer's keeps its size; ``begin_s`` and ``end_s`` as in
    ``other_from``."""
    start, _, noise = _windows(imu, begin_s, end_s)
    if len(start) < 2 * limits.CHANGED_LEAST or not (noise > 0.0).all():
        return None
    found = _split(np.log(noise)[:, None])
    by = float(found.after[0] - found.before[0])
    rest = np.abs(np.log(noise) - found.sides[:, 0])
    if abs(abs(by) - np.log(180.0 / np.pi)) > np.log(2.0) or not _is_all(rest, abs(by)):
        return None
    times, becomes = np.exp(abs(by)), "larger" if by > 0.0 else "smaller"
    return _changed(
        imu,
        float(start[found.at]),
        f"the gyro's noise becomes {times:.0f} times {becomes} beside the accelerometer's",
        "rad/s and deg/s stand in one file: bring both parts to one unit, or cut the drive in two "
        "there",
    )


def _changed(imu: ImuData, at_s: float, text: str, advice: str) -> Finding:
    stamp = int(imu.t_ns[0]) + round(at_s * 1e9)
    return Finding(
        "error",
        f"from t_ns {stamp} on ({at_s:.0f} s after the first reading) its readings are others: "
        f"{text}",
        advice,
        CHANGED_CODE,
    )


def _windows(
    imu: ImuData, begin_s: float, end_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Starts [k] s of windows of the readings from ``begin_s`` to ``end_s``, median specific force
    [k, 3] and the gyro's change from row to row over the accelerometer's [k]."""
    t = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)
    begin, end = max(begin_s, 0.0), min(end_s, float(t[-1]))
    edges = np.arange(begin, end, limits.CHANGED_WINDOW_S)
    rows = np.searchsorted(t, edges)
    starts, force, noise = [], [], []
    for at, a, b in zip(edges, rows, rows[1:], strict=False):
        if b - a < limits.CHANGED_ROWS:
            continue
        starts.append(at)
        force.append(np.median(imu.accel[a:b], axis=0))
        moved = [
            float(np.median(np.abs(np.diff(v[a:b], axis=0)).sum(axis=1)))
            for v in (imu.gyro, imu.accel)
        ]
        noise.append(moved[0] / moved[1] if moved[1] > 0.0 else 0.0)
    return np.array(starts), np.array(force).reshape(-1, 3), np.array(noise)


def _split(values: FloatArray) -> _Split:
    """Where windows [k, d] are best parted into those before and those after, by least squares."""
    n = len(values)
    at = np.arange(limits.CHANGED_LEAST, n - limits.CHANGED_LEAST + 1)
    sums = np.cumsum(values, axis=0)
    before, total = sums[at - 1] / at[:, None], sums[-1]
    after = (total - sums[at - 1]) / (n - at)[:, None]
    gain = at * (n - at) * ((after - before) ** 2).sum(axis=1)
    k = int(at[np.argmax(gain)])
    return _Split(n, k, np.median(values[:k], axis=0), np.median(values[k:], axis=0))


def _is_all(rest: FloatArray, change: float) -> bool:
    """Whether nearly all windows, which lie ``rest`` [k] off their side, are of one side of a
    ``change`` and not between or beyond."""
    return bool(np.quantile(rest, limits.CHANGED_SHARE) < 0.5 * change)


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles, rad, between vectors [..., 3]."""
    across = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.arctan2(across, np.sum(a * b, axis=-1)))
