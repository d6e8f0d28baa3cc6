"""``automap init`` of real recordings, as their authors published them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from automap.io.drive import load_drive
from automap.io.recording import read_recording
from pipeline.check.command import check_drive
from pipeline.cli.root import run_command


@pytest.fixture(autouse=True)
def _links(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Links into the recordings are the user's own here."""
    monkeypatch.setenv("AUTOMAP_ALLOW_OUTSIDE", str(shared_data))


def made(drive: Path) -> dict[str, Any]:
    """What the manifest says of a drive that can be used."""
    report = check_drive(drive)
    assert report.usable, report.text()
    assert not [f for f in report.findings if f.severity == "error"], report.text()
    return tomllib.loads((drive / "drive.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("file", "imu", "fastest"),
    [
        # a phone in g, negated as iOS has it; stamps of the sensors since the phone started
        (
            "phone/austin-iphone-x.csv",
            {"accel_unit": "g", "gyro_unit": "rad/s", "time": "boot_ns"},
            26.0,
        ),
        # deg/s and km/h that no name tells
        pytest.param(
            "car/balzer-2014-03-26.csv",
            {"accel_unit": "m/s^2", "gyro_unit": "deg/s", "time": "unix_ns"},
            14.0,
            marks=pytest.mark.slow,
        ),
    ],
    ids=["iphone", "car"],
)
def test_a_table_with_readings_and_fixes(
    shared_data: Path, tmp_path: Path, file: str, imu: dict[str, str], fastest: float
) -> None:
    source = shared_data / "real" / file
    assert run_command(["init", str(source), "-o", str(tmp_path / "drive"), "--yes"]) == 0
    said = made(tmp_path / "drive")
    assert {key: said["imu"][key] for key in imu} == imu
    # the sign of the accelerometer alone is turned, and found
    assert said["imu"]["axes"] == "unknown"
    assert "accel_axes" in said["imu"]
    assert "gyro_axes" not in said["imu"]
    assert said["imu"]["file"] == said["gnss"]["file"] == source.name
    fixes = read_recording(load_drive(tmp_path / "drive")).fixes
    assert fixes is not None
    assert np.nanmax(np.hypot(*fixes.vel_ned[:, :2].T)) == pytest.approx(fastest, rel=0.5)


@pytest.mark.slow
def test_a_cars_log_beside_a_phones_is_its_wheel_speed(shared_data: Path, tmp_path: Path) -> None:
    """Local time of Texas, a count of its own, mph: the phone's fixes tell the zone."""
    for name in ("austin-iphone-x.csv", "austin-car-can.csv"):
        (tmp_path / name).symlink_to(shared_data / "real/phone" / name)
    assert run_command(["init", str(tmp_path), "--yes"]) == 0
    said = made(tmp_path)
    assert said["gnss"]["file"] == said["imu"]["file"] == "austin-iphone-x.csv"
    assert said["odometer"]["file"] == "austin-car-can.csv"
    assert said["odometer"]["utc_offset_h"] == -5.0
    text = " ".join(check_drive(tmp_path).text().split())
    # the car's speed, and the phone's late by more than a second
    assert "ms early (sigma 69 ms), 1.0113 times as much" in text


@pytest.mark.slow
def test_a_phones_archive(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "real/phone/sensor-logger-2025-07-08.zip"
    assert run_command(["init", str(source), "-o", str(tmp_path / "drive")]) == 0
    made(tmp_path / "drive")


def test_a_phone_with_hardly_an_inertial_reading_goes_on_with_its_receiver(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nine readings in seven minutes, beside 94 fixes."""
    source = shared_data / "real/phone/gnsslogger-pixel6.txt"
    assert run_command(["init", str(source), "-o", str(tmp_path / "drive")]) == 0
    assert "9 inertial readings in 452 s, fewer than the 94 positions" in capsys.readouterr().err
    assert "imu" not in made(tmp_path / "drive")
    assert run_command(["run", str(tmp_path / "drive"), "--to", "fuse", "--quiet"]) == 0


def test_bags_in_a_folder(shared_data: Path, tmp_path: Path) -> None:
    (tmp_path / "bags").mkdir()
    for name in ("circle_gps.bag", "circle_imu.bag"):
        (tmp_path / "bags" / name).symlink_to(shared_data / "real/bags" / name)
    assert run_command(["init", str(tmp_path / "bags")]) == 0
    made(tmp_path / "bags/drive")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("kitti-20110926-0009", {"gyro_unit": "rad/s", "accel_unit": "m/s^2", "time": "boot_ns"}),
        pytest.param(
            "rtk-car-a",
            {"gyro_unit": "deg/s", "accel_unit": "g", "time": "gps_ns"},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_drive_without_its_manifest(
    shared_data: Path, tmp_path: Path, name: str, said: dict[str, str]
) -> None:
    for path in (shared_data / "drives" / name).iterdir():
        if path.name != "drive.toml":
            (tmp_path / path.name).symlink_to(path)
    assert run_command(["init", str(tmp_path)]) == 0
    imu = made(tmp_path)["imu"]
    assert {key: imu[key] for key in said} == said
