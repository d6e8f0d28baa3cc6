"""Ingest, check and video on real recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.io import names
from automap.io.drive import load_drive
from automap.io.frame_times import frame_times
from automap.io.manifest import VideoSection
from automap.io.recording import imu_time, read_recording
from automap.io.tables import read_fixes, read_imu
from automap.io.video import VideoInput, read_chapter
from automap.io.video_decode import iter_frames
from pipeline.check.command import check_drive
from pipeline.run.stage import StageContext
from pipeline.run.stages import ingest
from pipeline.settings.load import Settings

_DRIVES = (
    "drives/kitti-20110926-0009",
    "drives/kitti-20110926-0014",
    "drives/kitti-20110926-0032",
    "drives/kitti-20110926-0059",
    "drives/kitti-20110926-0101",
    "drives/kitti-20110926-0104",
    "drives/kitti-20110930-0020",
    "drives/kitti-20110930-0033",
    "drives/kitti-20110930-0034",
    "drives/kitti-20111003-0034",
    "drives/rtk-car-a",
    "reference/white-noise-drive",
)

_ALIKE = (
    "0014",
    "0032",
    "0059",
    "0101",
    "0104",
    "0930-0033",
    "0930-0034",
    "1003-0034",
    "white-noise-drive",
)
"""Drives of the same car and sensors as others, and the longest; left to the slow tests."""
_MANY = [
    pytest.param(name, marks=pytest.mark.slow) if name.endswith(_ALIKE) else name
    for name in _DRIVES
]


@pytest.mark.parametrize("name", _MANY)
def test_a_real_drive_is_usable_and_has_no_false_alarm(shared_data: Path, name: str) -> None:
    report = check_drive(shared_data / name)
    assert report.usable, report.text()
    assert not [f for f in report.findings if f.severity == "error"], report.text()


@pytest.mark.parametrize("name", _MANY)
def test_a_real_drive_is_ingested_whole(shared_data: Path, name: str, tmp_path: Path) -> None:
    drive = load_drive(shared_data / name)
    context = StageContext(drive, tmp_path, tmp_path, Settings())
    ingest.run(context)
    imu, fixes = read_imu(tmp_path / names.IMU), read_fixes(tmp_path / names.FIXES)
    recording = read_recording(drive)
    assert recording.imu_file is not None
    quality = recording.imu_file.quality
    # every row of the file is used or counted under what was wrong with it
    assert quality.rows == quality.used + quality.repeats + quality.wrong_stamps
    assert quality.wrong_stamps == 0
    assert len(imu) == quality.used
    assert np.all(np.diff(imu.t_ns) > 0)
    assert np.all(np.isfinite(imu.gyro))
    assert abs(quality.rate_hz - 100.0) < 1.0
    assert np.all(fixes.fix_type >= 2)
    # the epochs cover the readings
    assert abs((fixes.gps_s[-1] - fixes.gps_s[0]) - quality.span_s) < 5.0


def test_late_packets_fill_the_gaps_they_left(shared_data: Path) -> None:
    recording = read_recording(load_drive(shared_data / "drives/kitti-20110926-0032"))
    assert recording.imu_file is not None
    quality = recording.imu_file.quality
    assert (quality.reordered, quality.repeats) == (12, 13)
    assert max(length for _, length in quality.gaps) < 0.1


@pytest.mark.parametrize(("name", "frames"), [("approach-720p", 56), ("gopro-max", 315)])
def test_video_stamps_are_those_of_the_decoder(shared_data: Path, name: str, frames: int) -> None:
    import av

    path = shared_data / "video" / f"{name}.mp4"
    chapter = read_chapter(path)
    assert len(chapter.pts_ns) == chapter.count == frames
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        decoded = [round(float(f.pts * stream.time_base) * 1e9) for f in container.decode(stream)]
    np.testing.assert_allclose(chapter.pts_ns, decoded, atol=1)


def test_selected_frames_are_the_ones_of_a_full_decode(shared_data: Path) -> None:
    path = shared_data / "video" / "approach-720p.mp4"
    video = VideoInput("front", VideoSection(start_ns=0), (path,))
    chosen = [20, 33, 55]
    full = {f.frame: f.image for f in iter_frames(video) if f.frame in chosen}
    times = frame_times(video)
    for frame in iter_frames(video, select=chosen):
        np.testing.assert_array_equal(frame.image, full.pop(frame.frame))
        assert frame.t_ns == times.t_ns[frame.frame]
    assert full == {}


@pytest.mark.parametrize(
    ("log", "rate_hz"), [("ublox-neo-m8u.log", 100.0), ("ublox-neo-m8l.log", 11.0)]
)
def test_a_receiver_with_its_own_sensors_is_the_imu(
    shared_data: Path, tmp_path: Path, log: str, rate_hz: float
) -> None:
    (tmp_path / "drive.toml").write_text('schema = "automap.drive/1"\n')
    source = shared_data / "gnss_logs" / "gpsd" / log
    (tmp_path / "gnss.ubx").write_bytes(source.read_bytes())
    drive = load_drive(tmp_path)
    recording = read_recording(drive)
    imu, fixes = recording.imu, recording.fixes
    assert imu is not None
    assert fixes is not None
    assert not imu.axes_known
    assert imu_time(drive, recording) == "gps_ns"
    assert abs(1e9 / np.median(np.diff(imu.t_ns)) - rate_hz) < 1.0
    assert abs(imu.t_ns[0] * 1e-9 - fixes.gps_s[0]) < 3.0
    assert abs(np.median(np.linalg.norm(imu.accel, axis=1)) - 9.8) < 0.5
    assert check_drive(tmp_path).usable
