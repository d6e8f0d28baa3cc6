"""Positions that are older, or aside, behind a hole in the fixes are told beside the readings."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from automap.fusion.doubts.hole import hole_doubts
from automap.fusion.doubts.position_jump import beside_readings, places_of
from automap.fusion.doubts.reason import Reason
from automap.fusion.nodes import model_fixes
from automap.fusion.options import FusionOptions
from automap.records import ImuData
from tests.unit.fusion_drive import Sensor, record
from tests.unit.fusion_motion import Motion, city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive, shifted
from tests.unit.test_fusion_velocity_step import DURATION, free_of, path_of

HOLE_S = 5.0
USUAL = Receiver(rate=1.0, wander=(1.0, 1.0, 1.8), white=(0.4, 0.4, 0.8))


@cache
def corrected_drive(seed: int) -> tuple[Motion, ImuData]:
    """A drive whose readings have lost their biases, as those that are compared have."""
    motion = city_drive(DURATION, seed)
    return motion, record(motion, Sensor(gyro_bias=(0.0,) * 3, accel_bias=(0.0,) * 3), seed)


def told(seed: int, older_s: float = 0.0, right: float = 0.0) -> list[Reason]:
    """Of fixes that go on behind a hole at speed ``older_s`` older and ``right`` m to the right."""
    motion, imu = corrected_drive(seed)
    fixes = receive(motion, USUAL, seed)
    t = fixes.gps_s - GPS0
    speed = np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1])
    slowest = [speed[abs(t - (at + 0.5 * HOLE_S)) < HOLE_S].min() for at in t[50:-50]]
    start = float(t[50 + np.argmax(slowest)])
    behind = t >= start + HOLE_S
    north, east = fixes.vel_ned[np.argmax(behind), :2] / speed[np.argmax(behind)]
    fixes = shifted(fixes, behind[:, None] * right * np.array([-east, north, 0.0]))
    fixes = replace(fixes, gps_s=fixes.gps_s + older_s * behind)
    kept = np.flatnonzero((t < start) | behind)
    fixes = type(fixes)(*(np.asarray(getattr(fixes, n))[kept] for n in fixes.__dataclass_fields__))
    path = path_of(motion, imu, (0.01, -0.01, 0.01))
    places = places_of(model_fixes(fixes, fixes.gps_s, FusionOptions()))
    seen = beside_readings(places, free_of(imu), path, np.zeros(3), 0.0)
    return list(hole_doubts(seen, path, 0.0, 1.0))


@pytest.mark.parametrize("seed", [3, 4, 5, 6])
def test_a_hole_by_itself_is_no_doubt(seed: int) -> None:
    assert told(seed) == []


@pytest.mark.parametrize("seed", [3, 4])
def test_positions_older_behind_a_hole(seed: int) -> None:
    (reason,) = told(seed, older_s=0.8)
    assert reason.code == "age_changes"
    assert reason.late_s == pytest.approx(0.8, abs=0.3)
    assert " older" in reason.text


@pytest.mark.parametrize("seed", [3, 4])
def test_positions_aside_behind_a_hole(seed: int) -> None:
    (reason,) = told(seed, right=12.0)
    assert reason.code == "positions_shift"
    assert reason.error_m == pytest.approx(12.0, abs=4.0)
