"""Faults of the receiver's positions and of the accuracy that it states."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.benchmarks.faults.fault import (
    ACCURACY,
    HEIGHT,
    POSITION,
    STALE,
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

RAMP_M, RAMP_S = 50.0, 15.0
# a direction that is along no axis and along no street for long
NORTH, EAST = np.cos(np.radians(35.0)), np.sin(np.radians(35.0))


def _held(columns: str, seconds: float) -> Put:
    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        stretch = driving(recording, seconds)
        recording.log.now.hold(fixes_in(recording, stretch), columns)
        return stretch

    return put


def _tunnel(recording: Recording, _: np.random.Generator) -> Stretch:
    stretch = driving(recording, 60.0)
    rows = fixes_in(recording, stretch)
    now = recording.log.now
    now.hold(rows, "lat lon height course climb")
    now.speed[rows] = 0.0
    now.climb[rows & np.isfinite(now.climb)] = 0.0
    return stretch


def _shifted(seconds: float, shape: Callable[[Floats], Floats], with_velocity: bool) -> Put:
    """Positions moved by ``shape`` metres of the seconds since the begin of the stretch; the end
    of the drive belongs to it where the shape does not come back."""

    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        begin, end = driving(recording, seconds)
        t, now = recording.log.gps_s - begin, recording.log.now
        metres = shape(t)
        if with_velocity:
            step = 0.01
            rate = (shape(t + step) - shape(t - step)) / (2.0 * step)
            now.add_velocity(NORTH * rate, EAST * rate, rate != 0.0)
        now.move(NORTH * metres, EAST * metres)
        back = shape(np.array([seconds + 1.0]))[0] == 0.0
        return begin, end if back else whole(recording)[1]

    return put


def _ramp_back(t: Floats) -> Floats:
    return np.asarray(RAMP_M * np.clip(1.0 - np.abs(t - RAMP_S) / RAMP_S, 0.0, 1.0))


def _ramp(t: Floats) -> Floats:
    return np.asarray(RAMP_M * np.clip(t / RAMP_S, 0.0, 1.0))


def _bow(t: Floats) -> Floats:
    inside = (t >= 0.0) & (t <= 120.0)
    return np.asarray(np.where(inside, 20.0 * np.sin(np.pi * t / 120.0) ** 2, 0.0))


def _step(t: Floats) -> Floats:
    return np.asarray(np.where((t >= 0.0) & (t <= 60.0), 30.0, 0.0))


def _offset(recording: Recording, _: np.random.Generator) -> Stretch:
    recording.log.now.move(10.0 * NORTH, 10.0 * EAST)
    return whole(recording)


def _lying(recording: Recording, _: np.random.Generator) -> Stretch:
    _scale_errors(recording, ("lat", "lon", "height"), 3.0, np.ones(len(recording.log), bool))
    now = recording.log.now
    now.dop = np.minimum(now.dop, 0.5)
    return whole(recording)


def _modest(recording: Recording, _: np.random.Generator) -> Stretch:
    recording.log.now.dop[:] = 20.0
    return whole(recording)


def _latitude_noise(recording: Recording, _: np.random.Generator) -> Stretch:
    stretch = driving(recording, 60.0)
    _scale_errors(recording, ("lat",), 5.0, fixes_in(recording, stretch))
    return stretch


def _scale_errors(
    recording: Recording, columns: tuple[str, ...], factor: float, rows: np.ndarray
) -> None:
    now, true = recording.log.now, recording.path
    # the log's heights are above the sea where it tells the geoid
    true[:, 2] -= np.nan_to_num(now.geoid)
    for k, name in enumerate(("lat", "lon", "height")):
        if name in columns:
            values = getattr(now, name)
            known = rows & np.isfinite(true[:, k])
            values[known] += (factor - 1.0) * (values - true[:, k])[known]


def _geoid(recording: Recording, _: np.random.Generator) -> Stretch:
    geoid = recording.log.now.geoid
    if not np.nan_to_num(geoid).any():
        raise DoesNotApplyError("the log tells no geoid")
    recording.log.now.geoid = -geoid
    return whole(recording)


def _height_steps(recording: Recording, _: np.random.Generator) -> Stretch:
    begin, end = driving(recording, 60.0)
    t = recording.log.gps_s
    # up for 20 s, back for 20 s, up for 20 s
    up = ((t >= begin) & (t < begin + 20.0)) | ((t >= begin + 40.0) & (t <= end))
    recording.log.now.height[up] += 20.0
    return begin, end


def _hemisphere(recording: Recording, _: np.random.Generator) -> Stretch:
    recording.log.now.lat *= -1.0
    return whole(recording)


def _other_side(recording: Recording, _: np.random.Generator) -> Stretch:
    recording.log.now.lon *= -1.0
    return whole(recording)


def _swapped(recording: Recording, _: np.random.Generator) -> Stretch:
    now = recording.log.now
    now.lat, now.lon = now.lon, now.lat
    return whole(recording)


NOT_WITHIN = "the same at every fix: readings and velocities are as they would be with it"
FAULTS = [
    *(
        Fault(
            f"fix-held-{n}",
            f"position, speed and course stay for {n} s",
            _held("lat lon height speed course climb", float(n)),
            (*STALE, "speed", "velocit"),
        )
        for n in (20, 60)
    ),
    Fault(
        "position-held",
        "the position stays for 30 s, speed and course go on",
        _held("lat lon height", 30.0),
        STALE,
    ),
    Fault(
        "tunnel",
        "the last fix, at rest, for 60 s of driving",
        _tunnel,
        (*STALE, "speed", "velocit", "standstill", "stationary"),
    ),
    Fault(
        "position-wander",
        "positions leave by 20 m and come back within 120 s",
        _shifted(120.0, _bow, False),
        POSITION,
    ),
    Fault(
        "spoof-back",
        "positions, with velocities, drift by 50 m in 15 s and back in 15 s",
        _shifted(2 * RAMP_S, _ramp_back, True),
        (*POSITION, "velocit", "speed"),
    ),
    Fault(
        "spoof-stays",
        "positions, with velocities, drift by 50 m in 15 s and stay there",
        _shifted(RAMP_S, _ramp, True),
        (*POSITION, "velocit", "speed"),
    ),
    Fault(
        "ramp-back",
        "positions alone drift by 50 m in 15 s and back",
        _shifted(2 * RAMP_S, _ramp_back, False),
        (*POSITION, "velocit", "speed"),
    ),
    Fault(
        "position-step",
        "positions lie 30 m off for a minute",
        _shifted(60.0, _step, False),
        POSITION,
    ),
    Fault("position-offset", "positions lie 10 m off all the way", _offset, POSITION, NOT_WITHIN),
    Fault("dop-low", "HDOP 0.5 while the errors are tripled", _lying, ACCURACY),
    Fault("dop-high", "HDOP 20 while the fixes are good", _modest, ACCURACY),
    Fault(
        "latitude-noise",
        "the latitude's errors are five times as large for a minute",
        _latitude_noise,
        ACCURACY,
    ),
    Fault(
        "height-steps",
        "heights 20 m too high for 20 s, right for 20 s, too high for 20 s",
        _height_steps,
        HEIGHT,
    ),
    Fault(
        "geoid-sign",
        "the geoid's height has the wrong sign",
        _geoid,
        (*HEIGHT, "geoid"),
    ),
    Fault(
        "hemisphere",
        "north and south are swapped",
        _hemisphere,
        (*POSITION, "latitude", "course", "heading", "velocit"),
    ),
    Fault(
        "hemisphere-east",
        "east and west are swapped",
        _other_side,
        (*POSITION, "longitude", "course", "heading", "velocit"),
    ),
    Fault(
        "latitude-longitude",
        "latitude and longitude are swapped",
        _swapped,
        (*POSITION, "latitude", "longitude", "course", "heading", "velocit"),
    ),
]
