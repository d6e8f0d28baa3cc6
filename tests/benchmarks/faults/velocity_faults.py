"""Faults of the receiver's speed and course."""

from __future__ import annotations

import numpy as np

from tests.benchmarks.faults.fault import (
    COURSE,
    SPEED,
    DoesNotApplyError,
    Fault,
    Put,
    Stretch,
    driving,
    fixes_in,
    whole,
)
from tests.benchmarks.faults.log import Floats
from tests.benchmarks.faults.recording import Recording

KMH_PER_KNOT = 1.852


def _speed_times(factor: float) -> Put:
    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        recording.log.now.speed *= factor
        return whole(recording)

    return put


def _km_per_hour(recording: Recording, _: np.random.Generator) -> Stretch:
    if recording.kind != "nmea":
        raise DoesNotApplyError("only NMEA's speeds are in knots")
    recording.log.now.speed *= KMH_PER_KNOT
    return whole(recording)


def _reversed(recording: Recording, _: np.random.Generator) -> Stretch:
    recording.log.now.course = (recording.log.now.course + 180.0) % 360.0
    return whole(recording)


def earlier(t: Floats, values: Floats, seconds: float, period: float | None = None) -> Floats:
    """What a column [n] said ``seconds`` before; ``period`` 360 for angles in degrees."""
    known = np.isfinite(values)
    if not known.any():
        return values
    line = np.unwrap(values[known], period=period) if period else values[known]
    out = np.interp(t - seconds, t[known], line)
    return np.asarray(out % period if period else out)


def _course_late(recording: Recording, _: np.random.Generator) -> Stretch:
    now = recording.log.now
    now.course = earlier(now.time, now.course, 0.5, 360.0)
    return whole(recording)


def _stopped(seconds: float) -> Put:
    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        stretch = driving(recording, seconds)
        rows = fixes_in(recording, stretch)
        recording.log.now.speed[rows] = 0.0
        climb = recording.log.now.climb
        climb[rows & np.isfinite(climb)] = 0.0
        return stretch

    return put


def _held(columns: str, seconds: float) -> Put:
    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        stretch = driving(recording, seconds)
        recording.log.now.hold(fixes_in(recording, stretch), columns)
        return stretch

    return put


FAULTS = [
    Fault("speed-zero", "the speed is 0 all the way", _speed_times(0.0), SPEED),
    Fault("speed-kmh", "km/h sent as knots", _km_per_hour, SPEED),
    Fault("speed-high", "the speed is 5 % high", _speed_times(1.05), SPEED),
    Fault("course-reversed", "the course is turned by 180 deg", _reversed, COURSE),
    Fault(
        "course-late",
        "the course is that of 0.5 s before",
        _course_late,
        (*COURSE, "delay", r"lag\b"),
    ),
    *(
        Fault(
            f"velocity-zero-{n}",
            f"speed 0 for {n} s of driving",
            _stopped(float(n)),
            (*SPEED, "standstill", "stationary"),
        )
        for n in (10, 20, 60)
    ),
    Fault(
        "velocity-held-20",
        "speed and course stay for 20 s, the position goes on",
        _held("speed course climb", 20.0),
        (*SPEED, *COURSE, "stale", "frozen", "stuck"),
    ),
]
