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

OFF = "off the fixes"
"""A path and its fixes contradict each other: true of whatever is wrong with either, where the
reason's span has the fault in it."""
SPEED = (OFF, "speed", "velocit")
COURSE = (OFF, "course", "heading", "direction", "velocit")
POSITION = (OFF, "position", "spoof", "jump")
STALE = (*POSITION, "stale", "frozen", "stuck", "repeat")
HEIGHT = ("height", "altitude", "vertical", "down", "position")
TIME = (OFF, "clock", r"late\b", "delay", r"lag\b", "stamp", "leap", "future", "skew")
ACCURACY = (OFF, "accuracy", "stated", "position")
ACCEL = (OFF, "imu", "inertial", "acceleromet", "specific force")
GYRO = (OFF, "imu", "inertial", "gyro")


@dataclass(frozen=True)
class Reason:
    """A reason of a verdict; ``spans`` in seconds from the path's first row, none where it is
    about the whole drive."""

    code: str
    text: str
    spans: tuple[Stretch, ...] = ()

    @property
    def claim(self) -> str:
        """What is said to be wrong, without what follows from it and what to do."""
        return re.split(r":|, so ", self.text)[0]


@dataclass(frozen=True)
class Fault:
    """``put`` changes a recording and returns the fault's stretch; it raises DoesNotApplyError
    where the recording has not what would be changed. ``reasons`` are beginnings of words of
    which the code or the claim of a fitting reason has one. ``beyond`` says why nothing in the
    recording can show the fault; such a fault is listed and not counted."""

    name: str
    what: str
    put: Put
    reasons: tuple[str, ...]
    beyond: str = ""

    def fits(self, reason: Reason, span: Stretch) -> bool:
        """Whether a reason is about this fault, which lies in ``span``, in the path's seconds."""
        told = f"{reason.code.replace('_', ' ')} {reason.claim}".lower()
        if not any(re.search(rf"\b{word}", told) for word in self.reasons):
            return False
        there = [s for s in reason.spans if s[0] <= span[1] and s[1] >= span[0]]
        return bool(there) or not reason.spans


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
