"""Sync on real recordings, against their reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.io.drive import load_drive
from automap.io.recording import read_recording
from automap.io.truth_trajectory import read_truth_trajectory
from automap.sync.arrival import fit_arrival_clock
from automap.sync.clock import synchronise
from automap.sync.motion_clock import correlation_clock
from automap.sync.result import SyncResult
from pipeline.importers.comma2k19 import import_comma2k19


def sync(folder: Path) -> SyncResult:
    drive = load_drive(folder)
    recording = read_recording(drive)
    return synchronise(
        recording.imu,
        recording.fixes,
        drive.imu.time,
        drive.gnss.arrival_time,
        drive.gnss.output_delay_s,
    )


def test_clock_of_every_drive_with_truth_is_within_its_sd(shared_data: Path) -> None:
    ratios = []
    for folder in sorted((shared_data / "drives").glob("kitti-*")):
        drive = load_drive(folder)
        fixes = read_recording(drive).fixes
        assert fixes is not None
        fit = fit_arrival_clock(fixes.arrival_ns, fixes.gps_s, drive.gnss.output_delay_s)
        truth = read_truth_trajectory(folder / "truth" / "trajectory.csv")
        error = fit.clock.gps_s(truth.t_ns) - truth.gps_s
        assert np.abs(error).max() < 1e-3
        assert fit.warnings == []
        ratios.append(float(error.mean()) / fit.clock.sd_offset_s)
    assert len(ratios) == 10
    assert np.sqrt(np.mean(np.square(ratios))) < 2.0


def test_clock_of_the_simulated_drive(shared_data: Path) -> None:
    result = sync(shared_data / "reference" / "white-noise-drive")
    error = result.clock.gps_s(np.array([4_000_000_000_000]))[0] - 1457486418.0
    assert abs(error) < 5e-4
    assert result.lag is not None
    assert abs(result.lag.lag_s) < 3.0 * result.lag.sd_s


@pytest.mark.parametrize("name", ["kitti-20110926-0009", "kitti-20110930-0020"])
def test_offset_is_found_again_without_the_arrival_times(shared_data: Path, name: str) -> None:
    folder = shared_data / "drives" / name
    recording = read_recording(load_drive(folder))
    assert recording.imu is not None
    assert recording.fixes is not None
    result = correlation_clock(recording.imu, recording.fixes)
    truth = read_truth_trajectory(folder / "truth" / "trajectory.csv")
    error = result.clock.gps_s(truth.t_ns) - truth.gps_s
    assert np.abs(error).max() < 0.08
    assert abs(float(error.mean())) < 4.0 * result.clock.sd_offset_s


def test_delay_of_an_imu_mounted_anyhow(shared_data: Path) -> None:
    result = sync(shared_data / "drives" / "rtk-car-a")
    assert result.clock.method == "identity"
    position, velocity = result.lags["position"], result.lags["velocity"]
    assert abs(position.lag_s - 0.125) < 3.0 * position.sd_s
    assert position.sd_s < 0.03
    # the velocities belong half an epoch before their tag
    assert position.lag_s - velocity.lag_s == pytest.approx(0.125, abs=0.03)


def test_imported_segment(shared_data: Path, tmp_path: Path) -> None:
    out = tmp_path / "comma"
    assert import_comma2k19(shared_data / "comma2k19", out) == []
    result = sync(out)
    assert result.clock.method == "arrival"
    assert result.clock.output_delay_s is None
    assert result.fit is not None
    recording = read_recording(load_drive(out))
    fixes, imu = recording.fixes, recording.imu
    assert fixes is not None
    assert imu is not None
    assert len(fixes) == 579
    assert len(imu) == 6256
    # seven hundredths late against the reference, a metre and a half to the side
    truth = read_truth_trajectory(out / "truth" / "trajectory.csv")
    when = fixes.arrival_ns - 70_000_000
    inside = (when > truth.t_ns[0]) & (when < truth.t_ns[-1])
    lat, lon, height = (
        np.interp(when[inside], truth.t_ns, values)
        for values in (truth.lat_rad, truth.lon_rad, truth.height_m)
    )
    north = (fixes.lat_rad[inside] - lat) * 6.37e6
    east = (fixes.lon_rad[inside] - lon) * 6.37e6 * np.cos(lat)
    assert np.sqrt(np.mean(north**2 + east**2)) < 0.6
    assert np.abs(np.median(fixes.height_m[inside] - height)) < 3.0
    speed = np.interp(when[inside], truth.t_ns, np.hypot(*truth.vel_ned[:, :2].T))
    reported = np.hypot(*fixes.vel_ned[inside, :2].T)
    assert np.sqrt(np.mean((reported - speed) ** 2)) < 0.5
    course = np.arctan2(truth.vel_ned[:, 1], truth.vel_ned[:, 0])
    assert np.degrees(np.median(np.abs(truth.rpy[:, 2] - course))) < 5.0
