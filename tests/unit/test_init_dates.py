"""``automap init`` and dates of which day and month may be either."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import pytest

from automap.timebase import gps_to_unix
from pipeline.check.command import check_drive
from pipeline.init.choose import draft_of
from pipeline.init.found import look
from pipeline.init.settle import settle
from tests.slow_cases import others_slow
from tests.unit.foreign_tables import imu_unix_s, sample

DAYS_FIRST, MONTHS_FIRST = "%d/%m/%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S.%f"
LATER_S = 20 * 86400.0
"""From the 14th of March to the 3rd of April, which may be the 4th of March."""


def _folder(folder: Path, imu: str, fixes: str) -> None:
    """The sample's readings and fixes as tables with the dates of two patterns."""
    folder.mkdir()
    recording = sample()
    assert recording.imu is not None
    assert recording.fixes is not None

    def dated(unix_s: float, pattern: str) -> str:
        return datetime.fromtimestamp(unix_s + LATER_S, UTC).strftime(pattern)

    rows = ["timestamp,gx,gy,gz,ax,ay,az"]
    readings = zip(imu_unix_s(), recording.imu.gyro, recording.imu.accel, strict=True)
    for at, gyro, accel in readings:
        values = ",".join(f"{v:.6f}" for v in (*gyro, *accel))
        rows.append(f"{dated(float(at), imu)},{values}")
    (folder / "imu.csv").write_text("\n".join(rows) + "\n")
    rows = ["time,lat,lon"]
    found = recording.fixes
    unix_s = gps_to_unix(found.gps_s)
    for at, lat, lon in zip(unix_s, found.lat_rad, found.lon_rad, strict=True):
        if lat == lat:
            place = f"{lat * 57.29577951308232:.8f},{lon * 57.29577951308232:.8f}"
            rows.append(f"{dated(float(at), fixes)},{place}")
    (folder / "gps.csv").write_text("\n".join(rows) + "\n")


@pytest.mark.parametrize(
    ("imu", "fixes"), others_slow([(MONTHS_FIRST, DAYS_FIRST), (DAYS_FIRST, MONTHS_FIRST)])
)
def test_readings_and_fixes_of_one_day_are_read_so(tmp_path: Path, imu: str, fixes: str) -> None:
    """Where both may be either they meet on two days, which is doubted."""
    _folder(tmp_path / "d", imu, fixes)
    draft = draft_of(look(tmp_path / "d"), tmp_path / "d", None)
    settle(draft)
    assert "so its dates are those of the fixes" in draft.why("imu", "time_format")
    patterns = {draft.get(section, "time_format") for section in ("imu", "gnss")}
    assert {pattern[:5] for pattern in patterns} == {"%d/%m", "%m/%d"}
    assert sum("the dates could be" in doubt for doubt in draft.doubts) == 2
    (tmp_path / "d" / "drive.toml").write_text(draft.manifest("d"), encoding="utf-8")
    told = [each.text for each in check_drive(tmp_path / "d").findings]
    assert any(re.match("IMU and fixes overlap for 6", text) for text in told)


def test_fixes_whose_date_is_known_leave_no_doubt(tmp_path: Path) -> None:
    _folder(tmp_path / "d", MONTHS_FIRST, "%Y-%m-%d %H:%M:%S.%f")
    draft = draft_of(look(tmp_path / "d"), tmp_path / "d", None)
    settle(draft)
    assert draft.get("imu", "time_format").startswith("%m/%d/%Y")
    assert not any("the dates could be" in doubt for doubt in draft.doubts)


def test_dates_that_agree_stay_and_are_doubted(tmp_path: Path) -> None:
    _folder(tmp_path / "d", DAYS_FIRST, DAYS_FIRST)
    draft = draft_of(look(tmp_path / "d"), tmp_path / "d", None)
    settle(draft)
    assert sum("the dates could be" in doubt for doubt in draft.doubts) == 2
    assert draft.get("imu", "time_format").startswith("%d/%m/%Y")
