"""Imports of real recordings: a GoPro's video and a walk logged by RTKLIB."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.errors import InputError
from automap.io.drive import load_drive
from automap.io.gopro import read_gopro
from automap.io.recording import read_recording
from pipeline.check.command import check_drive
from pipeline.evaluate.command import evaluate_run
from pipeline.importers.gopro import import_gopro
from pipeline.importers.rosbag import import_rosbag
from pipeline.importers.rtklib import import_rtklib
from pipeline.run import registry
from pipeline.run.runner import Request, run_drive
from pipeline.settings.load import load_settings


def test_every_sample_of_a_gopro_is_there(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "video" / "gopro-max.mp4"
    import_gopro(source, tmp_path / "drive", link=True)
    drive = load_drive(tmp_path / "drive")
    recording = read_recording(drive)
    assert recording.imu is not None
    assert recording.fixes is not None
    assert len(recording.imu) == 2082
    assert len(recording.fixes) == 191
    assert check_drive(tmp_path / "drive").usable
    # forward, right, down of a camera held upright and looking a little down
    force = recording.imu.accel.mean(axis=0)
    assert force[2] == pytest.approx(-9.7, abs=0.2)
    assert np.linalg.norm(force[:2]) < 1.5
    assert -1.6 < force[0] < -1.0
    # 197.5 Hz without a gap where one block of samples meets the next
    steps = np.diff(recording.imu.t_ns) * 1e-6
    assert steps.min() > 5.0
    assert steps.max() < 5.15
    # the video lasts 10.5 s, and so do the samples beside it
    assert -0.1 < recording.imu.t_ns[0] * 1e-9 < 0.1
    assert recording.imu.t_ns[-1] * 1e-9 == pytest.approx(10.5, abs=0.2)
    speed = np.hypot(recording.fixes.vel_ned[:, 0], recording.fixes.vel_ned[:, 1])
    assert np.nanmedian(speed) == pytest.approx(1.24, abs=0.1)


def test_a_gopros_turns_are_those_of_its_picture(shared_data: Path) -> None:
    """The gyro about the down axis goes with the sideways motion of the picture."""
    import av
    import cv2

    path = shared_data / "video" / "gopro-max.mp4"
    recording = read_gopro([path])
    shifts, before = [], None
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            grey = cv2.resize(frame.to_ndarray(format="gray"), (212, 120)).astype(np.float32)
            if before is not None:
                shifts.append(cv2.phaseCorrelate(before, grey)[0][0])
            before = grey
    frames = (np.arange(len(shifts)) + 0.5) * 1e9 / 29.97
    yaw = np.interp(frames, recording.imu_t_ns, recording.gyro[:, 2])
    # turning right moves the picture to the left
    assert np.corrcoef(yaw, shifts)[0, 1] < -0.4


@pytest.mark.parametrize("part", [0.01, 0.5, 0.97, 0.999])
def test_a_gopro_file_cut_short(shared_data: Path, tmp_path: Path, part: float) -> None:
    data = (shared_data / "video" / "gopro-max.mp4").read_bytes()
    (tmp_path / "cut.mp4").write_bytes(data[: int(part * len(data))])
    with pytest.raises(InputError, match=r"cut\.mp4"):
        import_gopro(tmp_path / "cut.mp4", tmp_path / "drive")
    assert not (tmp_path / "drive").exists()


def test_a_gopro_file_with_damaged_blocks(shared_data: Path, tmp_path: Path) -> None:
    data = bytearray((shared_data / "video" / "gopro-max.mp4").read_bytes())
    at = data.find(b"GYRO", len(data) // 2)
    data[at - 40 : at + 40] = bytes(80)
    (tmp_path / "hurt.mp4").write_bytes(bytes(data))
    try:
        import_gopro(tmp_path / "hurt.mp4", tmp_path / "drive")
    except InputError as error:
        assert "hurt.mp4" in str(error)  # noqa: PT017
    else:
        assert check_drive(tmp_path / "drive").usable


def test_another_video_is_refused(shared_data: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="GoPro"):
        import_gopro(shared_data / "video" / "approach-720p.mp4", tmp_path / "drive")


@pytest.mark.slow
def test_a_walk_by_rtklib_is_fused_to_a_decimetre(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "gnss_logs" / "walk-m8-rawx"
    warnings = import_rtklib(source, tmp_path / "drive")
    assert any("above the sea" in text for text in warnings)
    assert check_drive(tmp_path / "drive").usable
    recording = read_recording(load_drive(tmp_path / "drive"))
    assert recording.imu is not None
    # the IMU's clock and the computer's agree in rate; a line lasts 6.56 ms in the mean
    span = (recording.imu.t_ns[-1] - recording.imu.t_ns[0]) * 1e-9
    assert span == pytest.approx(134.25, abs=0.15)
    request = Request(
        stages=registry.load_stages(registry.ORDER[:3]),
        selected=registry.ORDER[:3],
        settings=load_settings(),
    )
    outcome = run_drive(tmp_path / "drive", tmp_path / "out", request)
    assert outcome.exit_code == 0, outcome.error
    result = evaluate_run(tmp_path / "out", tmp_path / "drive" / "truth")
    # at the fixed epochs of the .pos, the antenna's few centimetres from the IMU included
    assert result["position_rms_m"]["horizontal"] < 0.1
    assert result["position_rms_m"]["d"] < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("files", "readings", "fixes"),
    [(["circle_gps.bag", "circle_imu.bag"], 6001, 147), (["going_in_circles1_0.mcap"], 2983, 74)],
    ids=["two ROS 1 bags", "mcap"],
)
def test_bags_with_messages_of_their_own_types_become_a_path(
    shared_data: Path, tmp_path: Path, files: list[str], readings: int, fixes: int
) -> None:
    """A VectorNav and a serial receiver, circling: types that no distribution has."""
    sources = [shared_data / "real" / "bags" / name for name in files]
    import_rosbag(sources, tmp_path / "drive")
    assert check_drive(tmp_path / "drive").usable
    recording = read_recording(load_drive(tmp_path / "drive"))
    assert recording.imu is not None
    assert recording.fixes is not None
    assert (len(recording.imu), len(recording.fixes)) == (readings, fixes)
    # z down by gravity, and a receiver above the sea whose geoid lies 34 m below the ellipsoid
    assert np.median(recording.imu.accel[:, 2]) == pytest.approx(-10.2, abs=0.4)
    assert np.median(recording.fixes.height_m) == pytest.approx(-24.0, abs=4.0)
    request = Request(
        stages=registry.load_stages(registry.ORDER[:3]),
        selected=registry.ORDER[:3],
        settings=load_settings(),
    )
    outcome = run_drive(tmp_path / "drive", tmp_path / "out", request)
    assert outcome.exit_code == 0, outcome.error
