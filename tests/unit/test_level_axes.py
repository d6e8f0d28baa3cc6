"""Axes by gravity where nothing moves as a vehicle does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.importers.level_axes import is_slow
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive


def test_speeds_without_a_course_hide_no_motion() -> None:
    """Of such a log velocities are known at rest alone."""
    fixes = receive(city_drive(60.0, 1), Receiver(1.0, (1.0, 1.0, 2.0)), 1)
    moving = np.hypot(*fixes.vel_ned[:, :2].T) > 0.5
    assert moving.any()
    assert not moving.all()
    velocity = np.where(moving[:, None], np.nan, fixes.vel_ned)
    assert not is_slow(replace(fixes, vel_ned=velocity))
    place = fixes.lat_rad[0] + 0.0 * fixes.lat_rad, fixes.lon_rad[0] + 0.0 * fixes.lon_rad
    walk = replace(fixes, vel_ned=velocity, lat_rad=place[0], lon_rad=place[1])
    assert is_slow(walk)
