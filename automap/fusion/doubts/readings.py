"""Readings of an IMU that no drive makes: frozen, clipped, or wild for a moment."""

from __future__ import annotations

import numpy as np

from automap.fusion import limits
from automap.fusion.doubts.reason import Reason, Span
from automap.fusion.unusable_readings import Bridged
from automap.records import BoolArray, FloatArray, ImuData, IntArray


def reading_doubts(imu: ImuData, bridged: Bridged, speed: FloatArray) -> list[Reason]:
    """What is wrong with the readings ``imu``, of which the fusion took what is ``bridged``;
    ``speed`` [n] m/s of the vehicle at each of them."""
    if len(imu) < limits.LEAST_JUDGED:
        return []
    t = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)
    moving = speed > limits.DRIVING_SPEED
    frozen = tuple((a, b) for a, b in bridged.frozen if moving[(t >= a) & (t <= b)].any())
    found = [_frozen_reason("the IMU's readings", frozen, bridged=True)] if frozen else []
    return [*(found or _frozen_axis(t, imu, moving)), *_clipped(t, imu), *_wild(bridged)]


def _runs(same: BoolArray) -> tuple[IntArray, IntArray]:
    """First and last sample of each run, of which every sample but the first is ``same``
    [n - 1] as the one before it."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    return edges[::2], edges[1::2]


def _frozen_axis(t: FloatArray, imu: ImuData, moving: BoolArray) -> list[Reason]:
    """Stretches of driving in which the readings of one axis stay the same."""
    values = np.column_stack([imu.gyro, imu.accel])
    same = (np.diff(values, axis=0) == 0.0) & moving[1:, None]
    spans: list[Span] = []
    for column in same.T:
        first, last = _runs(column)
        long = t[last] - t[first] >= limits.FROZEN_AXIS_S
        spans += zip(t[first[long]].tolist(), t[last[long]].tolist(), strict=True)
    if not spans:
        return []
    return [_frozen_reason("readings of one axis of the IMU", tuple(sorted(set(spans))))]


def _frozen_reason(what: str, spans: tuple[Span, ...], bridged: bool = False) -> Reason:
    seconds = sum(b - a for a, b in spans)
    done = "; they were bridged like a gap" if bridged else ""
    return Reason(
        "imu_frozen",
        f"{what} stay the same for {seconds:.1f} s of driving: the sensor or its "
        f"logging hung; look for a loose plug or a full buffer{done}",
        spans,
        inertial=not bridged,
        handled=bridged,
    )


def _clipped(t: FloatArray, imu: ImuData) -> list[Reason]:
    """A channel whose largest readings are all the same, and follow each other: its range ends
    there."""
    # a slow sensor in a quick log says all of it again
    both = np.column_stack([imu.gyro, imu.accel])
    fresh = np.concatenate([[True], (np.diff(both, axis=0) != 0.0).any(axis=1)])
    t, both = t[fresh], both[fresh]
    for what, unit, values in (
        ("gyro", "rad/s", both[:, :3]),
        ("accelerometer", "m/s^2", both[:, 3:]),
    ):
        for axis in range(3):
            size = np.abs(values[:, axis])
            # noise goes on at any value but the last of the range
            at_end = size >= size.max()
            first, last = _runs(at_end[1:] & at_end[:-1])
            long = last - first >= limits.CLIPPED_STEPS
            if not long.any() or size.max() == 0.0:
                continue
            spans = tuple(zip(t[first[long]].tolist(), t[last[long]].tolist(), strict=True))
            seconds = sum(b - a for a, b in spans)
            return [
                Reason(
                    "imu_clipped",
                    f"the {what}'s axis {'xyz'[axis]} stays at {size.max():.3g} {unit}, the end of "
                    f"its range, for {seconds:.1f} s: choose a larger range",
                    spans,
                    inertial=True,
                )
            ]
    return []


def _wild(bridged: Bridged) -> list[Reason]:
    """Single readings far beyond all others."""
    t = bridged.wild_s
    if not len(t):
        return []
    near = limits.STRETCHES_S[0]
    first = t[np.concatenate([[True], np.diff(t) > near])]
    one = len(t) == 1
    return [
        Reason(
            "imu_wild",
            f"{len(t)} reading{'' if one else 's'} of the IMU {'is' if one else 'are'} far beyond "
            f"all others: {'it was' if one else 'they were'} bridged; look for a loose plug",
            tuple((float(at) - near, float(at) + near) for at in first),
            handled=True,
        )
    ]
