"""What a fault is: a change of one thing in a recording, and the reasons that would name it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.benchmarks.faults.log import Mask
from tests.benchmarks.faults.recording import Recording

Stretch = tuple[float, float]
"""GPS times of a fault's begin and end."""
Put = Callable[[Recording, np.random.Generator], Stretch]

SPEED = ("speed", "velocit")
COURSE = ("course", "heading", "direction", "velocit")
POSITION = ("position", "spoof", "jump")
STALE = (*POSITION, "stale", "frozen", "stuck", "repeat")
HEIGHT = ("height", "altitude", "vertical")
TIME = ("time", "clock", "late", "delay", "lag", "stamp", "leap")
ACCURACY = ("accuracy", "hdop", "sigma", "stated", "position")
ACCEL = ("imu", "acceleromet", "accelerat", "reading", "specific force")
GYRO = ("imu", "gyro", "rate", "reading")


@dataclass(frozen=True)
class Fault:
    """``put`` changes a recording and returns the fault's stretch; it raises DoesNotApplyError
    where the recording has not what would be changed. ``reasons`` are beginnings of words of
    which a fitting reason has one. ``beyond`` says why nothing in the recording can show the
    fault; such a fault is listed and not counted."""

    name: str
    what: str
    put: Put
    reasons: tuple[str, ...]
    beyond: str = ""

    def fits(self, reason: str) -> bool:
        """Whether a reason of the verdict is about this fault."""
        return any(re.search(rf"\b{word}", reason.lower()) for word in self.reasons)


class DoesNotApplyError(Exception):
    """A recording lacks what a fault would change."""


def whole(recording: Recording) -> Stretch:
    """From the first to the last fix."""
    t = recording.log.gps_s
    return float(t[0]), float(t[-1])


def driving(recording: Recording, seconds: float) -> Stretch:
    """The first stretch past a third of the drive that is driven without a stop; where there is
    none, the one whose slowest moment is the fastest."""
    t, speed = recording.log.gps_s, recording.log.was.speed
    # ten seconds are left behind a fault, to come back from it
    last = recording.length_s - seconds - 10.0
    starts = t[0] + np.arange(min(0.34 * recording.length_s, last), last + 1e-9, 1.0)
    slowest = [float(speed[(t >= s) & (t <= s + seconds)].min()) for s in starts]
    moving = np.flatnonzero(np.array(slowest) > 4.0)
    best = int(moving[0]) if len(moving) else int(np.argmax(slowest))
    return float(starts[best]), float(starts[best] + seconds)


def fixes_in(recording: Recording, stretch: Stretch) -> Mask:
    """The fixes [n] of a stretch."""
    t = recording.log.gps_s
    return np.asarray((t >= stretch[0]) & (t <= stretch[1]))


def readings_in(recording: Recording, stretch: Stretch) -> Mask:
    """The IMU's rows [n] of a stretch."""
    first, last = (recording.stamp(t) for t in stretch)
    return np.asarray((recording.imu.t_ns >= first) & (recording.imu.t_ns <= last))
