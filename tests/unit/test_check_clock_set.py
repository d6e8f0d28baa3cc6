"""Clocks that were set by quarters of an hour while they recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.records import Fixes
from pipeline.check.clock_set import FIX_CODE, IMU_CODE, fixes_set, one_set
from tests.unit.receiver_scene import simulated_fixes

SEED = 9931


def jumped(fixes: Fixes, at: int, size_s: float) -> Fixes:
    moved = fixes.gps_s.copy()
    moved[at:] += size_s
    return replace(fixes, gps_s=moved)


def fastest(fixes: Fixes) -> int:
    """A fix within the middle half that is driven over fast."""
    quarter = len(fixes) // 4
    speed = np.hypot(*fixes.vel_ned[quarter:-quarter, :2].T)
    return quarter + int(np.argmax(speed))


def readings(fixes: Fixes) -> np.ndarray:
    return np.arange(fixes.gps_s[0], fixes.gps_s[-1], 0.01)


@pytest.mark.parametrize("minutes", [60, 30, 135])
def test_times_that_jump_while_the_vehicle_drives_on(minutes: int) -> None:
    fixes = simulated_fixes(SEED, seconds=120.0)
    found = fixes_set(jumped(fixes, fastest(fixes), 60.0 * minutes))
    assert found is not None
    assert found.code == FIX_CODE
    assert f"jump by {minutes} min after" in found.text


@pytest.mark.parametrize("seconds", [0.0, 90.0, 3590.0])
def test_other_gaps_are_no_set_clock(seconds: float) -> None:
    fixes = simulated_fixes(SEED, seconds=120.0)
    moved = jumped(fixes, fastest(fixes), seconds)
    assert fixes_set(moved) is None
    assert one_set(readings(fixes), moved) is None


def test_a_vehicle_that_is_elsewhere_after_an_hour() -> None:
    fixes = simulated_fixes(SEED, seconds=120.0)
    at = fastest(fixes)
    far = fixes.lat_rad.copy()
    far[at:] += 100.0 / 6.4e6
    assert fixes_set(replace(jumped(fixes, at, 3600.0), lat_rad=far)) is None


@pytest.mark.parametrize("of", [IMU_CODE, FIX_CODE])
def test_one_clock_is_set_and_the_other_is_not(of: str) -> None:
    fixes = simulated_fixes(SEED, seconds=120.0)
    t = readings(fixes)
    middle = float(fixes.gps_s[len(fixes) // 2])
    if of == IMU_CODE:
        t = np.where(t > middle, t + 3600.0, t)
    else:
        fixes = jumped(fixes, len(fixes) // 2, 3600.0)
    found = one_set(t, fixes)
    assert found is not None
    assert found.code == of


def test_an_hour_of_readings_that_was_lost() -> None:
    fixes = simulated_fixes(SEED, seconds=1200.0)
    t = readings(fixes)
    gap = (t > t[0] + 120.0) & (t <= t[0] + 1020.0)
    assert one_set(t[~gap], fixes) is None
