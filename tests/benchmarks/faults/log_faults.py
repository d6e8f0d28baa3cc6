"""Faults of times, and of which messages a log holds."""

from __future__ import annotations

import numpy as np

from tests.benchmarks.faults.fault import (
    POSITION,
    TIME,
    DoesNotApplyError,
    Fault,
    Put,
    Stretch,
    driving,
    whole,
)
from tests.benchmarks.faults.log import Fixes
from tests.benchmarks.faults.recording import NS, Recording
from tests.benchmarks.faults.velocity_faults import earlier

ROLLOVER_S = 1024 * 604_800.0


def _tags_later(seconds: float) -> Put:
    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        recording.log.now.time += seconds
        return whole(recording)

    return put


def _leap_learnt(recording: Recording, _: np.random.Generator) -> Stretch:
    begin, _end = driving(recording, 30.0)
    before = recording.log.gps_s < begin
    recording.log.now.time[before] += 1.0
    return whole(recording)[0], begin


def _moved_in_time(fixes: Fixes, seconds: float) -> None:
    """Every epoch says what was so ``seconds`` before, under its own tag."""
    t = fixes.time
    for name in ("lat", "lon", "height", "speed", "climb"):
        setattr(fixes, name, earlier(t, getattr(fixes, name), seconds))
    fixes.course = earlier(t, fixes.course, seconds, 360.0)


def _late(recording: Recording, _: np.random.Generator) -> Stretch:
    _moved_in_time(recording.log.now, 1.0)
    return whole(recording)


def _filtered(seconds: float) -> Put:
    """Positions and velocities behind a low-pass of the first order, epoch after epoch."""

    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        now = recording.log.now
        course = np.radians(now.course)
        columns = [now.lat, now.lon, now.height, now.speed * np.cos(course)]
        columns += [now.speed * np.sin(course), now.climb]
        keeps = np.exp(-np.diff(now.time) / seconds)
        for values in columns:
            for k, kept in enumerate(keeps, 1):
                if np.isfinite(values[k - 1 : k + 1]).all():
                    values[k] = kept * values[k - 1] + (1.0 - kept) * values[k]
        north, east = columns[3:5]
        known = np.isfinite(north)
        now.speed[known] = np.hypot(north, east)[known]
        now.course[known] = np.degrees(np.arctan2(east, north))[known] % 360.0
        return whole(recording)

    return put


def _half(recording: Recording, rng: np.random.Generator) -> Stretch:
    rows = np.flatnonzero(rng.random(len(recording.log)) < 0.5)
    stretch = whole(recording)
    recording.log = recording.log.take(rows)
    return stretch


def _two_receivers(recording: Recording, _: np.random.Generator) -> Stretch:
    stretch = whole(recording)
    first = recording.log
    second = first.take(np.arange(len(first)))
    _moved_in_time(second.now, -0.5)
    second.now.time += 0.5
    second.now.move(15.0 * np.cos(1.0), 15.0 * np.sin(1.0))
    second.arrival[second.arrival >= 0] += NS // 2
    recording.log = first.with_epochs(second)
    return stretch


def _twice(recording: Recording, _: np.random.Generator) -> Stretch:
    stretch = whole(recording)
    recording.log = recording.log.take(np.repeat(np.arange(len(recording.log)), 2))
    return stretch


def _jitter(recording: Recording, rng: np.random.Generator) -> Stretch:
    recording.log.now.time += rng.uniform(-0.2, 0.2, len(recording.log))
    return whole(recording)


def _bunched(recording: Recording, _: np.random.Generator) -> Stretch:
    log = recording.log
    if (log.arrival < 0).any():
        raise DoesNotApplyError("the drive has no arrival times")
    # what arrives within two seconds is delivered together at their end
    log.arrival = -(-log.arrival // (2 * NS)) * (2 * NS)
    return whole(recording)


FAULTS = [
    Fault(
        "leap-second",
        "times of the fixes one second early: a leap second too many",
        _tags_later(-1.0),
        TIME,
    ),
    Fault(
        "leap-second-learnt",
        "times one second late until a third of the drive, then right",
        _leap_learnt,
        TIME,
    ),
    Fault("fixes-late", "every fix says what was so one second before", _late, TIME),
    Fault(
        "fixes-filtered",
        "fixes smoothed by a filter with a time constant of 1 s",
        _filtered(1.0),
        (*TIME, "smooth"),
    ),
    Fault("half-missing", "half of the fixes are missing", _half, ("missing", "gap", "few")),
    Fault(
        "two-receivers",
        "a second receiver's fixes, 15 m off and half a second later, between",
        _two_receivers,
        (*POSITION, *TIME, "receivers"),
    ),
    Fault("duplicated", "every message stands twice", _twice, ("duplicate", "twice", "repeat")),
    Fault(
        "tag-jitter",
        "times of the fixes off by up to 0.2 s, at random",
        _jitter,
        (*TIME, "jitter", "position"),
    ),
    Fault("arrivals-bunched", "messages arrive in bunches every 2 s", _bunched, (*TIME, "arriv")),
    Fault(
        "week-rollover",
        "dates 1024 weeks early",
        _tags_later(-ROLLOVER_S),
        (*TIME, "week", "date", "rollover"),
    ),
]
