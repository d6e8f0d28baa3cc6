"""Importing comma2k19: a made segment, and what can be wrong with one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pymap3d
import pytest
from pynmeagps import NMEAReader
from scipy.spatial.transform import Rotation

from automap.errors import ConfigError, InputError
from automap.io.comma2k19 import LiveFixes, nmea_log, read_segment
from automap.io.drive import load_drive
from automap.io.imu_csv import imu_format, read_imu_csv
from automap.io.receiver import read_receiver_log
from automap.io.truth_trajectory import read_truth_trajectory
from automap.timebase import unix_to_gps
from pipeline.importers.comma2k19 import import_comma2k19

LAT, LON = -33.9, 151.2
UNIX_MS = 1_533_226_488_299


def save(path: Path, values: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as stream:
        np.save(stream, values)


@pytest.fixture
def segment(tmp_path: Path) -> Path:
    """A car going north-east at 10 m/s, nose 45 degrees from north, in the southern hemisphere."""
    folder = tmp_path / "source" / "segment"
    log, pose = folder / "processed_log", folder / "global_pose"
    t = 1000.0 + np.arange(200) * 0.01
    save(log / "IMU/accelerometer/t", t)
    save(log / "IMU/accelerometer/value", np.tile([0.1, 0.2, -9.8], (200, 1)))
    save(log / "IMU/gyro_uncalibrated/t", t)
    save(log / "IMU/gyro_uncalibrated/value", np.tile([0.01, 0.02, 0.03], (200, 1)))
    tg = 1000.2 + np.arange(15) * 0.1
    value = np.column_stack(
        [
            np.full(15, LAT) + np.arange(15) * 1e-5,
            np.full(15, LON),
            np.full(15, 10.0),
            UNIX_MS + np.arange(15) * 100.0,
            np.full(15, 33.37),
            np.full(15, 45.0),
        ]
    )
    save(log / "GNSS/live_gnss_ublox/t", tg)
    save(log / "GNSS/live_gnss_ublox/value", value)
    save(log / "CAN/speed/t", t)
    save(log / "CAN/speed/value", np.full((200, 1), 10.0))
    position = np.array(pymap3d.geodetic2ecef(LAT, LON, 40.0))
    c_e_n = np.array(
        [pymap3d.enu2uvw(*axis, LAT, LON) for axis in ((0, 1, 0), (1, 0, 0), (0, 0, -1))]
    ).T
    attitude = Rotation.from_matrix(c_e_n) * Rotation.from_euler("ZYX", [45, -4, 2], degrees=True)
    x, y, z, w = attitude.as_quat()
    save(pose / "frame_times", 1000.0 + np.arange(30) * 0.05)
    save(pose / "frame_positions", np.tile(position, (30, 1)))
    save(pose / "frame_velocities", np.tile(c_e_n @ [7.0, 7.0, 0.5], (30, 1)))
    save(pose / "frame_orientations", np.tile([w, x, y, z], (30, 1)))
    return folder


def test_import_writes_a_drive_that_reads_back(segment: Path, tmp_path: Path) -> None:
    out = tmp_path / "drive"
    assert import_comma2k19(segment.parent, out) == []
    drive = load_drive(out)
    assert drive.warnings == ()
    assert drive.gnss.output_delay_s is None
    imu = read_imu_csv(drive.imu_file, imu_format(drive)).data
    np.testing.assert_allclose(imu.accel[5], [0.1, 0.2, -9.8])
    np.testing.assert_allclose(imu.gyro[5], [0.01, 0.02, 0.03])
    assert imu.t_ns[0] == 1_000_000_000_000
    fixes = read_receiver_log(drive.gnss_file).fixes
    assert len(fixes) == 15
    expected = unix_to_gps(UNIX_MS * 1e-3 + np.arange(15) * 0.1)
    np.testing.assert_allclose(fixes.gps_s, expected, atol=2e-6)
    np.testing.assert_allclose(np.degrees(fixes.lat_rad), LAT + np.arange(15) * 1e-5, atol=1e-9)
    np.testing.assert_allclose(np.degrees(fixes.lon_rad), LON, atol=1e-9)
    np.testing.assert_allclose(fixes.height_m, 33.37, atol=1e-4)
    np.testing.assert_allclose(fixes.vel_ned[:, :2], 10.0 * np.sqrt(0.5), atol=1e-4)
    assert np.isnan(fixes.vel_ned[:, 2]).all()
    assert np.isnan(fixes.geoid_sep_m).all()
    arrival = np.loadtxt(drive.arrival_file, delimiter=",", skiprows=1, dtype=np.int64)
    np.testing.assert_array_equal(arrival[:, 0], fixes.offset)
    assert arrival[3, 1] == 1_000_500_000_000
    assert (out / "can_speed.csv").read_text().startswith("t_ns,speed_m_s\n1000000000000,10\n")


def test_truth_is_in_north_east_down(segment: Path, tmp_path: Path) -> None:
    import_comma2k19(segment, tmp_path / "drive")
    truth = read_truth_trajectory(tmp_path / "drive" / "truth" / "trajectory.csv")
    np.testing.assert_allclose(np.degrees(truth.lat_rad), LAT, atol=1e-9)
    np.testing.assert_allclose(truth.height_m, 40.0, atol=1e-3)
    np.testing.assert_allclose(truth.vel_ned[0], [7.0, 7.0, 0.5], atol=1e-3)
    np.testing.assert_allclose(np.degrees(truth.rpy[0]), [2.0, -4.0, 45.0], atol=1e-3)
    assert np.isnan(truth.gps_s).all()


def test_gyro_with_stamps_of_its_own_is_interpolated(segment: Path) -> None:
    folder = segment / "processed_log/IMU/gyro_uncalibrated"
    t = 1000.005 + np.arange(150) * 0.01
    save(folder / "t", t)
    save(folder / "value", np.column_stack([t - 1000.0, np.zeros(150), np.zeros(150)]))
    read = read_segment(segment)
    np.testing.assert_allclose(read.gyro[:, 0], read.imu_t_ns * 1e-9 - 1000.0, atol=1e-9)
    assert len(read.imu_t_ns) == 149
    assert any("interpolated" in text for text in read.warnings)


def test_without_poses_there_is_no_truth_but_a_drive(segment: Path, tmp_path: Path) -> None:
    for path in (segment / "global_pose").iterdir():
        path.unlink()
    (segment / "global_pose").rmdir()
    warnings = import_comma2k19(segment, tmp_path / "drive")
    assert any("no truth" in text for text in warnings)
    assert load_drive(tmp_path / "drive").truth_dir is None


def test_a_video_comes_along_with_the_stamps_of_its_frames(segment: Path, tmp_path: Path) -> None:
    (segment / "video.hevc").write_bytes(b"stream")
    import_comma2k19(segment, tmp_path / "drive")
    drive = load_drive(tmp_path / "drive")
    assert [path.read_bytes() for path in drive.videos["front"].chapters] == [b"stream"]
    rows = drive.videos["front"].frames.read_text().splitlines()
    assert rows[:3] == ["frame,t_ns", "0,1000000000000", "1,1000050000000"]


def test_importing_twice_replaces_but_nothing_else_is_overwritten(
    segment: Path, tmp_path: Path
) -> None:
    out = tmp_path / "drive"
    import_comma2k19(segment, out)
    (out / "_automap").mkdir()
    import_comma2k19(segment, out)
    assert (out / "_automap").is_dir()
    assert load_drive(out).gnss_file is not None
    other = tmp_path / "other"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match="not empty"):
        import_comma2k19(segment, other)
    assert [path.name for path in other.iterdir()] == ["notes.txt"]


def test_damage_is_named_and_leaves_nothing_behind(segment: Path, tmp_path: Path) -> None:
    bad = segment / "processed_log/GNSS/live_gnss_ublox/value"
    bad.write_bytes(bad.read_bytes()[:100])
    with pytest.raises(InputError, match="live_gnss_ublox/value"):
        import_comma2k19(segment, tmp_path / "drive")
    assert [path.name for path in tmp_path.iterdir()] == ["source"]
    bad.unlink()
    with pytest.raises(InputError, match="missing"):
        import_comma2k19(segment, tmp_path / "drive")


def test_a_folder_without_a_segment_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="processed_log"):
        read_segment(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        read_segment(tmp_path / "none")
    for name in ("a", "b"):
        (tmp_path / name / "processed_log").mkdir(parents=True)
    with pytest.raises(InputError, match="2 segments"):
        read_segment(tmp_path)


def test_sentences_are_valid_at_awkward_places() -> None:
    live = LiveFixes(
        arrival_ns=np.arange(3),
        unix_ms=np.array([UNIX_MS, 1_546_300_799_999, 1_546_300_800_000]),
        lat_deg=np.array([-0.00000001, 59.99999999999, -89.5]),
        lon_deg=np.array([179.99999999999, -0.5, -179.999]),
        height_m=np.array([-3.25, 0.0, 8000.0]),
        speed_m_s=np.array([0.0, 1e-5, 60.0]),
        course_deg=np.array([0.0, 359.999, 180.0]),
    )
    log, offsets = nmea_log(live)
    lines = log.splitlines(keepends=True)
    assert [log.index(lines[2 * i]) for i in range(3)] == offsets.tolist()
    for i in range(3):
        rmc, pubx = (NMEAReader.parse(line) for line in lines[2 * i : 2 * i + 2])
        assert rmc.lat == pytest.approx(live.lat_deg[i], abs=2e-8)
        assert pubx.lon == pytest.approx(live.lon_deg[i], abs=2e-8)
        assert pubx.altRef == pytest.approx(live.height_m[i], abs=1e-3)
    assert str(NMEAReader.parse(lines[2]).date) == "2018-12-31"
