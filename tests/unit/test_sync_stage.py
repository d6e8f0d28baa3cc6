"""The stage sync: what it reads and writes for each kind of drive."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from automap.errors import InputError
from automap.io import names
from automap.io.clock_json import read_clock, read_clocks, write_clock
from automap.io.drive import load_drive
from automap.io.tables import read_table, write_fixes, write_imu
from automap.records import ClockModel
from automap.sync.stamps import in_trajectory_time
from pipeline.run.stage import StageContext
from pipeline.run.stages.sync import STAGE
from pipeline.settings.load import Settings
from tests.unit.sync_scene import GPS_START, drive, fixes_of, imu_of

MANIFEST = 'schema = "automap.drive/1"\n[gnss]\noutput_delay_s = 0.07\n'


@pytest.fixture
def context(tmp_path: Path) -> StageContext:
    folder, out, work = tmp_path / "drive", tmp_path / "out", tmp_path / "work"
    for path in (folder, out, work):
        path.mkdir()
    (folder / "drive.toml").write_text(MANIFEST)
    (folder / "imu.csv").write_text("t_ns,gx,gy,gz,ax,ay,az\n")
    return StageContext(load_drive(folder), out, work, Settings())


def test_drive_with_arrival_times(context: StageContext) -> None:
    t, gyro, accel, motion = drive(60.0)
    fixes = fixes_of(t, motion)
    waiting = np.random.default_rng(1).exponential(0.01, len(fixes))
    arrival = 10**11 + np.rint((fixes.gps_s - GPS_START + 0.07 + waiting) * 1e9).astype(np.int64)
    write_imu(context.out / names.IMU, imu_of(t, gyro, accel, 10**11))
    write_fixes(context.out / names.FIXES, replace(fixes, arrival_ns=arrival))
    STAGE.run(context)
    clock = read_clock(context.work / names.SYNC)
    assert clock.method == "arrival"
    assert clock.output_delay_s == 0.07
    assert clock.gps_s(np.array([10**11]))[0] == pytest.approx(GPS_START, abs=1e-3)
    table = read_table(context.work / names.SYNC_DELAYS, ("t_ns", "delay_s", "envelope_s", "used"))
    assert len(table) == len(fixes)
    delay = table["delay_s"].to_numpy()
    assert np.median(delay) == pytest.approx(0.077, abs=2e-3)
    content = json.loads((context.work / names.SYNC).read_text())
    assert content["imu_delay_sd_s"] > 0.0
    assert context.metrics["sync_offset_sd_s"] == clock.sd_offset_s
    assert {"sync_offset_s", "sync_drift_ppm", "sync_drift_sd_ppm"} <= set(context.metrics)
    assert set(path.name for path in context.work.iterdir()) <= set(STAGE.outputs)


def test_drive_without_receiver_says_that_times_are_the_hosts(context: StageContext) -> None:
    t, gyro, accel, _ = drive(20.0)
    write_imu(context.out / names.IMU, imu_of(t, gyro, accel, 10**11))
    STAGE.run(context)
    clock = read_clock(context.work / names.SYNC)
    assert clock.method == "none"
    assert clock.sd_offset_s == np.inf
    assert context.warnings


def test_the_receivers_own_sensors_bring_their_clock(context: StageContext) -> None:
    t, gyro, accel, motion = drive(60.0)
    write_imu(context.out / names.IMU, imu_of(t, gyro, accel, round(GPS_START * 1e9)))
    write_fixes(context.out / names.FIXES, fixes_of(t, motion))
    # the manifest says boot_ns, for there is no [imu] in it; what ingest made is GPS time
    (context.out / names.INGEST).write_text('{"imu": {"source": "receiver", "time": "gps_ns"}}')
    STAGE.run(context)
    clock = read_clock(context.work / names.SYNC)
    assert clock.method == "identity"
    assert clock.gps_s(np.array([10**18]))[0] == pytest.approx(1e9, abs=1e-3)
    assert read_clocks(context.work / names.SYNC).time_base == "gps_ns"
    assert context.result == "stamps are GPS time"


def test_arrival_times_of_another_clock_are_kept_for_the_cameras(context: StageContext) -> None:
    t, gyro, accel, motion = drive(60.0)
    fixes = fixes_of(t, motion)
    arrival = 10**11 + np.rint((fixes.gps_s - GPS_START + 0.07) * 1e9).astype(np.int64)
    write_imu(context.out / names.IMU, imu_of(t, gyro, accel, round(GPS_START * 1e9)))
    write_fixes(context.out / names.FIXES, replace(fixes, arrival_ns=arrival))
    (context.out / names.INGEST).write_text('{"imu": {"source": "csv", "time": "gps_ns"}}')
    STAGE.run(context)
    clocks = read_clocks(context.work / names.SYNC)
    assert (clocks.time_base, clocks.arrival_time_base) == ("gps_ns", "boot_ns")
    frame = np.array([10**11 + 5 * 10**9])
    seen = in_trajectory_time(frame, "boot_ns", clocks)[0] * 1e-9
    assert seen == pytest.approx(GPS_START + 5.0, abs=2e-3)


def test_drive_without_anything_passes_through(context: StageContext) -> None:
    STAGE.run(context)
    assert read_clock(context.work / names.SYNC).method == "identity"


def test_finished_trajectory_brings_its_own_clock(context: StageContext) -> None:
    rows = "".join(
        f"{10**9 * i},{GPS_START + i},{50.0 + i * 1e-5:.7f},8.0,100.0\n" for i in range(30)
    )
    path = context.drive.path / "trajectory.csv"
    path.write_text("t_ns,gps_s,lat_deg,lon_deg,height_m\n" + rows)
    context.drive = load_drive(context.drive.path)
    STAGE.run(context)
    clock = read_clock(context.work / names.SYNC)
    assert clock.method == "trajectory"
    assert clock.gps_s(np.array([10**9]))[0] == pytest.approx(GPS_START + 1.0, abs=1e-5)


def test_clock_survives_the_file_and_damage_is_said(tmp_path: Path) -> None:
    clock = ClockModel(10**18, 1.4e9, -3e-5, 2e-3, 1e-6, "arrival", None)
    write_clock(tmp_path / "sync.json", clock, {"other": float("nan")})
    assert read_clock(tmp_path / "sync.json") == clock
    (tmp_path / "sync.json").write_text('{"ref_ns": 1}')
    with pytest.raises(InputError, match="damaged"):
        read_clock(tmp_path / "sync.json")
    with pytest.raises(InputError, match="missing"):
        read_clock(tmp_path / "none.json")
