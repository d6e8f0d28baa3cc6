"""Velocities and positions of recorded receivers: as they are, and with damage put in."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from automap.io.drive import load_drive
from automap.io.receiver import read_receiver_log
from automap.io.recording import read_recording
from automap.records import Fixes
from automap.sync.velocity_consistency import velocity_consistency
from pipeline.check.velocity import check
from tests.slow_cases import others_slow
from tests.unit.receiver_damage import driving, held, redirected, scaled, shifted, zeroed

DRIVES = (
    "balzer-car",
    "gsdc-mtv1",
    "gsdc-mtv1-xl",
    "iphone-austin",
    "kitti-20110926-0009",
    "kitti-20110926-0014",
    "kitti-20110926-0032",
    "kitti-20110926-0059",
    "kitti-20110926-0101",
    "kitti-20110926-0104",
    "kitti-20110930-0020",
    "kitti-20110930-0033",
    "kitti-20110930-0034",
    "kitti-20111003-0034",
    "rtk-car-a",
)
DAMAGED = ("gsdc-mtv1", "iphone-austin", "kitti-20110926-0014", "kitti-20110926-0104", "rtk-car-a")
"""One of each receiver; what each damage makes of the others is left to the slow tests."""
PLACE = ("lat_rad", "lon_rad", "height_m")


def fixes_of(shared_data: Path, name: str) -> Fixes:
    folder = shared_data / "drives" / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    fixes = read_recording(load_drive(folder)).fixes
    assert fixes is not None
    return fixes


@pytest.mark.parametrize("name", DRIVES)
def test_no_false_alarm(shared_data: Path, name: str) -> None:
    fixes = fixes_of(shared_data, name)
    found = velocity_consistency(fixes)
    assert found.match.scale is not None
    assert found.match.scale.value == pytest.approx(1.0, abs=4.0 * max(found.match.scale.sd, 1e-3))
    assert {finding.severity for finding in check(fixes)} <= {"ok", "info"}
    assert not found.unusable_velocity(fixes).sum() > 1
    # iphone-austin: a row that is the one before, at 5 m/s
    expected = ["rows_frozen"] if name == "iphone-austin" else []
    assert [reason.code for reason in found.reasons] == expected
    assert (found.means is not None) == (name == "rtk-car-a")
    # balzer-car: 9 m/s by positions, 7.5 by velocities over 18 s, with five satellites
    assert len(found.parted) == (name == "balzer-car")


@pytest.mark.parametrize(
    ("name", "speed_s", "course_s"),
    [
        ("rtk-car-a", 0.125, 0.125),
        ("gsdc-mtv1", 0.23, 0.65),
        ("gsdc-mtv1-xl", 0.69, 0.42),
        ("balzer-car", None, 0.5),
    ],
)
def test_known_lags(
    shared_data: Path, name: str, speed_s: float | None, course_s: float | None
) -> None:
    """Those of the data's description are against the truth; positions are late themselves."""
    match = velocity_consistency(fixes_of(shared_data, name)).match
    late_positions_s = 0.2
    for lag, known in ((match.speed_lag_s, speed_s), (match.course_lag_s, course_s)):
        if known is not None:
            assert lag is not None
            assert lag.value == pytest.approx(known, abs=late_positions_s + 2.0 * lag.sd)


@functools.cache
def _sound(shared_data: Path, name: str) -> set[str]:
    """What is told of a drive without damage."""
    return {reason.code for reason in velocity_consistency(fixes_of(shared_data, name)).reasons}


@pytest.mark.parametrize(
    "name",
    others_slow(sorted(DRIVES, key=lambda name: name not in DAMAGED), len(DAMAGED)),
)
@pytest.mark.parametrize(
    ("code", "damage"),
    [
        ("velocity_unit", lambda f: scaled(f, 1.852)),
        ("velocity_unit", lambda f: scaled(f, 1.0 / 3.6)),
        ("course_turned", lambda f: redirected(f, [[-1, 0], [0, -1]])),
        ("course_turned", lambda f: redirected(f, [[0, 1], [-1, 0]])),
        ("velocity_stuck", lambda f: zeroed(f, driving(f, 10.0))),
        ("velocity_stuck", lambda f: zeroed(f, np.ones(len(f), np.bool_))),
        ("position_frozen", lambda f: held(f, driving(f, 10.0), *PLACE)),
        ("rows_frozen", lambda f: held(f, driving(f, 10.0), *PLACE, "vel_ned")),
    ],
)
def test_damage_is_found(
    shared_data: Path, name: str, code: str, damage: Callable[[Fixes], Fixes]
) -> None:
    fixes = fixes_of(shared_data, name)
    sound = _sound(shared_data, name)
    found = {reason.code for reason in velocity_consistency(damage(fixes)).reasons}
    assert code in found
    assert found - sound <= {code}


@pytest.mark.parametrize("name", DRIVES)
def test_a_jump_is_a_parting(shared_data: Path, name: str) -> None:
    fixes = fixes_of(shared_data, name)
    middle = fixes.gps_s > fixes.gps_s[len(fixes) // 2]
    found = velocity_consistency(shifted(fixes, middle, 40.0))
    at = fixes.gps_s[middle][0]
    assert any(part.start_gps_s <= at <= part.end_gps_s for part in found.parted)
    assert not {reason.code for reason in found.reasons} - {"rows_frozen"}


@pytest.mark.slow
def test_captures_that_stand_or_walk(shared_data: Path) -> None:
    folder = shared_data / "gnss_logs"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    logs = [path for path in sorted(folder.rglob("*")) if path.suffix in (".log", ".ubx", ".pos")]
    assert logs
    for log in logs:
        found = velocity_consistency(read_receiver_log(log).fixes)
        assert found.reasons == (), log
        assert not found.unrelated
        assert found.can_tell == log.name.startswith("gnss_1730")
