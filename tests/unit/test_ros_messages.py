"""What ROS messages say of themselves: no fix, no altitude, no accuracy, nothing measured."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from automap.io.pos_writer import pos_log
from automap.io.rosbag import Bag, read_fixes, says_unmeasured
from automap.io.rtklib import decode_pos
from automap.records import FixType
from automap.timebase import unix_to_gps
from pipeline.importers import rosbag
from pipeline.importers.target import Import

TOPIC = "/gps/fix"


class _Made:
    """Messages without a file."""

    def __init__(self, messages: list[Any]) -> None:
        self._messages = messages

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        for i, message in enumerate(self._messages):
            yield 1_700_000_000_000_000_000 + i * 200_000_000, message


def bag(*messages: Any) -> Bag:
    return cast(Bag, _Made(list(messages)))


def fix(status: int = 0, altitude: float = 150.0, kind: int = 2) -> SimpleNamespace:
    return SimpleNamespace(
        latitude=50.0,
        longitude=8.0,
        altitude=altitude,
        status=SimpleNamespace(status=status),
        position_covariance=np.diag([4.0, 1.0, 9.0]).ravel() * (kind > 0),
        position_covariance_type=kind,
    )


def test_a_status_that_is_unknown_is_no_fix_where_others_have_one() -> None:
    fixes = read_fixes(bag(fix(-2), fix(-1), fix(0)), TOPIC, None)
    assert fixes.fix_type.tolist() == [FixType.NONE, FixType.NONE, FixType.THREE_D]
    assert ["1 of 3 messages" in text for text in fixes.warnings] == [True]


def test_where_no_message_has_a_status_all_are_fixes_and_told() -> None:
    fixes = read_fixes(bag(fix(-2), fix(-2)), TOPIC, None)
    assert fixes.fix_type.tolist() == [FixType.THREE_D] * 2
    assert len(fixes.warnings) == 1
    assert "status -2" in fixes.warnings[0]


def test_unknown_accuracies_are_told() -> None:
    assert read_fixes(bag(fix()), TOPIC, None).warnings == ()
    fixes = read_fixes(bag(fix(kind=0)), TOPIC, None)
    assert np.isnan(fixes.sd_pos_ned).all()
    assert "states an accuracy" in fixes.warnings[0]


def test_a_missing_altitude_is_told_and_stays_unknown_in_the_drive() -> None:
    fixes = read_fixes(bag(fix(), fix(altitude=np.nan)), TOPIC, None)
    assert "1 of 2 messages" in fixes.warnings[0]
    places = (fixes.lat_deg, fixes.lon_deg, fixes.height_m, fixes.fix_type)
    log, _ = pos_log(unix_to_gps(fixes.t_ns * 1e-9), *places, fixes.sd_pos_ned)
    read, warnings, _, lost = decode_pos(log, "gnss.pos")
    assert (warnings, lost) == ([], 0)
    np.testing.assert_allclose(np.degrees(read.lat_rad), 50.0)
    np.testing.assert_array_equal(read.height_m, [150.0, np.nan])
    assert read.fix_type.tolist() == [FixType.THREE_D, FixType.TWO_D]


def test_a_damaged_height_is_still_a_damaged_row() -> None:
    gps_s, lat, lon, height = (np.full(3, v) for v in (1.4e9, 50.0, 8.0, 150.0))
    log, _ = pos_log(gps_s, lat, lon, height, np.full(3, FixType.THREE_D))
    read, warnings, _, lost = decode_pos(log.replace(b"150.0000", b"1x0.0000", 1), "gnss.pos")
    assert (len(read), lost) == (2, 1)
    assert "cannot be read" in warnings[0]


def imu(mark: float) -> SimpleNamespace:
    marked = np.array([mark, *np.zeros(8)])
    return SimpleNamespace(
        angular_velocity_covariance=np.zeros(9), linear_acceleration_covariance=marked
    )


@pytest.mark.parametrize("mark", [0.0, -1.0])
@pytest.mark.parametrize("varies", [False, True])
def test_what_was_not_measured_is_no_reading(mark: float, varies: bool) -> None:
    assert says_unmeasured(bag(imu(mark)), "/imu") == ({"linear_acceleration"} if mark else set())
    said: list[str] = []
    run = cast(Import, SimpleNamespace(source="x.bag", warn=said.append))
    moving = np.arange(12.0).reshape(4, 3)
    accel = moving if varies else np.zeros((4, 3))
    assert rosbag._measured(run, bag(imu(mark)), "/imu", moving, accel) is varies
    assert len(said) == (not varies or mark < 0.0)


def test_gravity_that_was_taken_out_is_not_called_upside_down() -> None:
    said: list[str] = []
    run = cast(Import, SimpleNamespace(source="x.bag", warn=said.append))
    taken_out = np.tile([0.3, 0.1, -0.2], (10, 1))
    assert rosbag._usual_axes(run, "/imu", True, taken_out) == "FLU"
    assert said == []
    assert rosbag._usual_axes(run, "/imu", True, np.tile([0.0, 0.0, -9.8], (10, 1))) == "unknown"
    assert "upside down" in said[0]
