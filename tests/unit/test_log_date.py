"""The date of logs that tell none."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from input_drive import BOOT_NS, LEAP_S, START, write_drive

from automap import timebase as tb
from automap.io.drive import load_drive
from automap.io.log_date import date_of_name, find_date
from automap.io.recording import Recording, read_recording
from pipeline.check.judge import judge
from tests.unit.receiver_scene import simulated_fixes

START_GPS_S = (START - datetime(1980, 1, 6, tzinfo=UTC)).total_seconds() + LEAP_S
UNIX_NS = round(START.timestamp() * 1e9)
ISO = START.date().isoformat()


def dateless(folder: Path, imu: str = "", gnss: str = "") -> Path:
    """A drive whose log has GGA only, told of by no arrival times."""
    write_drive(folder, imu, gnss)
    log = folder / "gnss.nmea"
    kept = [line for line in log.read_text().splitlines() if line.startswith("$GNGGA")]
    log.write_text("".join(f"{line}\r\n" for line in kept))
    (folder / "gnss_arrival.csv").unlink()
    return folder


def arrivals(folder: Path, start_ns: int) -> None:
    """Arrival times from ``start_ns`` on, an epoch a second."""
    rows = ["offset,t_ns"]
    offset = 0
    for k, line in enumerate((folder / "gnss.nmea").read_bytes().splitlines(keepends=True)):
        rows.append(f"{offset},{start_ns + k * 1_000_000_000 + 80_000_000}")
        offset += len(line)
    (folder / "gnss_arrival.csv").write_text("\n".join(rows) + "\n")


def imu_stamped(folder: Path, start_ns: int) -> None:
    """The readings' stamps moved to begin at ``start_ns``."""
    file = folder / "imu.csv"
    head, *rows = file.read_text().splitlines()
    moved = [
        f"{int(row.split(',', 1)[0]) - BOOT_NS + start_ns},{row.split(',', 1)[1]}" for row in rows
    ]
    file.write_text("\n".join([head, *moved]) + "\n")


def told(recording: Recording) -> str:
    (text,) = [text for text in recording.warnings if "tells the date" in text]
    return text


def started(recording: Recording) -> float:
    assert recording.fixes is not None
    return float(recording.fixes.gps_s[0])


def test_by_arrival_times(tmp_path: Path) -> None:
    folder = dateless(tmp_path / "drive", gnss='arrival_time = "unix_ns"')
    arrivals(folder, UNIX_NS)
    recording = read_recording(load_drive(folder))
    assert started(recording) == pytest.approx(START_GPS_S, abs=1e-3)
    assert f"it is {ISO} (UTC) by the arrival times" in told(recording)


def test_arrival_times_of_a_host_that_has_no_date_tell_none(tmp_path: Path) -> None:
    folder = dateless(tmp_path / "drive")
    arrivals(folder, BOOT_NS)
    recording = read_recording(load_drive(folder))
    assert 0.0 <= started(recording) < tb.DAY_S
    assert "times count from the first day or week of 1980" in told(recording)


@pytest.mark.parametrize(
    ("clock", "start_ns"), [("unix_ns", UNIX_NS), ("gps_ns", round(START_GPS_S * 1e9))]
)
def test_by_the_readings_and_check_finds_them_at_one_time(
    tmp_path: Path, clock: str, start_ns: int
) -> None:
    folder = dateless(tmp_path / "drive", imu=f'time = "{clock}"')
    imu_stamped(folder, start_ns)
    drive = load_drive(folder)
    recording = read_recording(drive)
    assert started(recording) == pytest.approx(START_GPS_S, abs=1e-3)
    assert f"it is {ISO} (UTC) by the IMU's stamps" in told(recording)
    codes = {item.finding.code for item in judge(drive, recording).found}
    assert "no_overlap" not in codes


@pytest.mark.parametrize(
    ("folder_name", "file_name", "source"),
    [
        ("drive", "log-2024-05-01.nmea", "log-2024-05-01.nmea"),
        ("20240501_100000", "gnss.nmea", "20240501_100000"),
        ("2023-01-01", "20240501100000.nmea", "20240501100000.nmea"),
    ],
)
def test_by_a_name(tmp_path: Path, folder_name: str, file_name: str, source: str) -> None:
    folder = dateless(tmp_path / folder_name, gnss=f'file = "{file_name}"')
    if file_name != "gnss.nmea":
        (folder / "gnss.nmea").rename(folder / file_name)
    recording = read_recording(load_drive(folder))
    assert started(recording) == pytest.approx(START_GPS_S, abs=1e-3)
    assert f"it is {ISO} (UTC) by the name {source}" in told(recording)


def test_a_table_of_times_of_day(tmp_path: Path) -> None:
    folder = dateless(tmp_path / "2024-05-01", gnss='file = "fixes.csv"')
    rows = [f"10:00:{k:02d},{48.0 + 1e-4 * k:.6f},11.0" for k in range(50)]
    (folder / "fixes.csv").write_text("time_of_day,lat,lon\n" + "\n".join(rows) + "\n")
    recording = read_recording(load_drive(folder))
    assert recording.failures == ()
    assert started(recording) == pytest.approx(START_GPS_S, abs=1e-3)


def test_a_dated_log_is_left_alone(tmp_path: Path) -> None:
    recording = read_recording(load_drive(write_drive(tmp_path / "2020-01-01")))
    assert started(recording) == pytest.approx(START_GPS_S, abs=1e-3)
    assert not any("tells the date" in text for text in recording.warnings)


def test_weeks_go_by_the_name_to_the_day() -> None:
    fixes = simulated_fixes(1, seconds=20.0)
    true = fixes.gps_s
    fixes = replace(fixes, gps_s=np.mod(true, tb.WEEK_S))
    day = tb.gps_to_iso(float(true[0]))[:10]
    found = find_date(fixes, tb.WEEK_S, "boot_ns", None, (Path("gnss.ubx"), Path(day)))
    assert found is not None
    np.testing.assert_allclose(fixes.gps_s + found.shift_s, true)


@given(st.dates(date(2006, 1, 1), date(2099, 12, 31)), st.sampled_from(["-", "_", ".", ""]))
def test_dates_in_names(day: date, separator: str) -> None:
    text = separator.join((f"{day.year}", f"{day.month:02d}", f"{day.day:02d}"))
    for name in (text, f"drive {text}.nmea", f"a12_{text}-10.nmea", f"{text}T101500"):
        assert date_of_name(name) == day


@given(st.text())
def test_no_name_breaks_it(name: str) -> None:
    found = date_of_name(name)
    assert found is None or re.search(str(found.year), name)


@pytest.mark.parametrize(
    "name", ["", "gnss.nmea", "2026-13-14", "20260230", "1202603141", "2026-0314"]
)
def test_what_is_no_date(name: str) -> None:
    assert date_of_name(name) is None
