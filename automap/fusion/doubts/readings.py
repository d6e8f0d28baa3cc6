"""Readings of an IMU that no drive makes: frozen, clipped, or wild for a moment."""

from __future__ import annotations

import numpy as np

from automap.fusion import limits
from automap.fusion.doubts.limits import STRETCHES_S
from automap.fusion.doubts.reason import Reason, Span
from automap.fusion.stuck_readings import clipped_axes, frozen_axes
from automap.fusion.unusable_readings import Bridged
from automap.records import BoolArray, FloatArray, ImuData

_TRIADS = {"g": ("gyro", "rad/s"), "a": ("accelerometer", "m/s^2")}


def reading_doubts(imu: ImuData, bridged: Bridged, speed: FloatArray) -> list[Reason]:
    """What is wrong with the readings ``imu``, in the sensor's own axes, of which the fusion took
    what is ``bridged``; ``speed`` [n] m/s of the vehicle at each of them."""
    if len(imu) < limits.LEAST_JUDGED:
        return []
    t = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)
    moving = speed > limits.DRIVING_SPEED
    frozen = tuple((a, b) for a, b in bridged.frozen if moving[(t >= a) & (t <= b)].any())
    found = [_frozen_reason("the IMU's readings", frozen, bridged=True)] if frozen else []
    return [*(found or _frozen_axis(imu, moving)), *_clipped(imu), *_wild(bridged)]


def _frozen_axis(imu: ImuData, moving: BoolArray) -> list[Reason]:
    """Stretches of driving in which the readings of one axis stay the same."""
    spans = sorted({span for axis in frozen_axes(imu, moving) for span in axis.spans})
    return [_frozen_reason("readings of one axis of the IMU", tuple(spans))] if spans else []


def _frozen_reason(what: str, spans: tuple[Span, ...], bridged: bool = False) -> Reason:
    seconds = sum(b - a for a, b in spans)
    # a whole row has six noises, an axis one, which a coarse step hides
    coarse = "" if bridged else ", or its steps are coarser than its noise"
    stay = "stay the same or go on lines" if bridged else "stay the same"
    done = "; they were bridged like a gap" if bridged else ""
    return Reason(
        "imu_frozen",
        f"{what} {stay} for {seconds:.1f} s of driving: the sensor or its "
        f"logging hung{coarse}; look for a loose plug or a full buffer{done}",
        spans,
        inertial=not bridged,
        handled=bridged,
    )


def _clipped(imu: ImuData) -> list[Reason]:
    """The first axis that ends at its range."""
    for axis in clipped_axes(imu)[:1]:
        what, unit = _TRIADS[axis.column[0]]
        text = (
            f"the {what}'s axis {axis.column[1]} stays at {axis.value:.3g} {unit}, the end of its "
            f"range, for {axis.seconds:.1f} s: choose a larger range"
        )
        return [Reason("imu_clipped", text, axis.spans, inertial=True)]
    return []


def _wild(bridged: Bridged) -> list[Reason]:
    """Single readings far beyond all others."""
    t = bridged.wild_s
    if not len(t):
        return []
    near = STRETCHES_S[0]
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
