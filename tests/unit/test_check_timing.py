"""Fixes of driving without readings, and two trips in a recording, are named before a run."""

from __future__ import annotations

import numpy as np
import pytest

from automap.records import Fixes
from pipeline.check.timing import _driven_unread_s, _trips
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive


def _log() -> Fixes:
    return receive(city_drive(180.0, 4), Receiver(rate=1.0), 5)


def test_driving_before_or_behind_the_readings_is_counted() -> None:
    fixes = _log()
    speed = np.hypot(*fixes.vel_ned[:, :2].T)
    half = GPS0 + np.arange(0.0, 90.0, 0.01)
    behind = np.count_nonzero((fixes.gps_s > half[-1]) & (speed > 3.0))
    assert _driven_unread_s(half, fixes) == pytest.approx(behind, abs=1.5)
    assert _driven_unread_s(GPS0 + np.arange(0.0, 181.0, 0.01), fixes) == 0.0


def test_two_trips_are_told_with_how_far_apart_they_are() -> None:
    fixes = _log()
    behind = fixes.gps_s > GPS0 + 90.0
    k = int(np.argmax(behind))
    for place in (fixes.lat_rad, fixes.lon_rad):
        place[behind] -= place[k] - place[k - 1]
    moved = Fixes(**vars(fixes) | {"gps_s": fixes.gps_s + 900.0 * behind})
    t = np.arange(0.0, 90.0, 0.01)
    read = GPS0 + np.concatenate([t, t + 990.0])
    assert _trips(read, moved) == []
    moved.lat_rad[behind] += 1e-4
    (found,) = _trips(read, moved)
    assert found.severity == "warning"
    assert "for 15 min from" in found.text
    # readings all the way lead over it
    assert _trips(GPS0 + np.arange(0.0, 1080.0, 0.01), moved) == []
