"""Files that grow, on a disk that fills up."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from automap.errors import StageError
from automap.io.arrival import read_arrival
from automap.io.manifest import read_manifest
from pipeline.record.append_file import AppendFile, ByteLog
from pipeline.record.conditions import Conditions
from pipeline.record.imu_format import load_format
from pipeline.record.manifest_text import manifest_text, read_rig


class Disk:
    """Stands in for ``os.write``: takes so many bytes, then is full."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, room: int) -> None:
        self.room = room
        self._write = os.write
        monkeypatch.setattr("pipeline.record.append_file.os.write", self.write)

    def write(self, fd: int, data: bytes) -> int:
        if not self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        taken = self._write(fd, bytes(data)[: self.room])
        self.room -= taken
        return taken


def test_nothing_is_lost_while_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = Disk(monkeypatch, 25)
    file = AppendFile(tmp_path / "log")
    pieces = [bytes([i]) * 10 for i in range(8)]
    assert all(file.append(piece) for piece in pieces)
    assert file.trouble is not None
    assert "the disk is full" in file.trouble
    assert (tmp_path / "log").read_bytes() == b"".join(pieces)[:25]
    assert (file.size, file.waiting) == (80, 55)
    disk.room = 1000
    assert file.append(b"end")
    assert file.trouble is None
    assert file.close()
    assert (tmp_path / "log").read_bytes() == b"".join(pieces) + b"end"


def test_when_memory_runs_out_whole_pieces_are_refused_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = Disk(monkeypatch, 0)
    file = AppendFile(tmp_path / "log", hold_bytes=25)
    assert [file.append(bytes([i]) * 10) for i in range(4)] == [True, True, False, False]
    disk.room = 1000
    assert file.append(b"z" * 10)
    assert not file.close()  # something is missing in it
    assert file.refused_bytes == 20
    assert (tmp_path / "log").read_bytes() == b"\0" * 10 + b"\1" * 10 + b"z" * 10


def test_arrival_rows_stay_with_their_bytes(tmp_path: Path) -> None:
    log = ByteLog(tmp_path / "gnss.ubx", tmp_path / "gnss_arrival.csv", merge_ns=500)
    log.append([(1000, b"abc"), (1400, b"de"), (1600, b"f")])
    log.append([(5000, b"ghi")])
    for file in log.files:
        file.close()
    arrival = read_arrival(tmp_path / "gnss_arrival.csv")
    offset, t_ns = arrival.offset, arrival.t_ns
    assert (tmp_path / "gnss.ubx").read_bytes() == b"abcdefghi"
    # a piece that follows at once shares the row before it
    assert offset.tolist() == [0, 5, 6]
    assert t_ns.tolist() == [1000, 1600, 5000]


def test_refused_pieces_leave_no_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = ByteLog(tmp_path / "gnss.ubx", tmp_path / "gnss_arrival.csv")
    disk = Disk(monkeypatch, 0)
    log.data._hold = 8
    log.append([(1_000_000, b"abcd")])
    log.append([(2_000_000, b"efghij")])
    disk.room = 10_000
    log.append([(3_000_000, b"klm")])
    for file in log.files:
        file.close()
    arrival = read_arrival(tmp_path / "gnss_arrival.csv")
    offset, t_ns = arrival.offset, arrival.t_ns
    assert (tmp_path / "gnss.ubx").read_bytes() == b"abcdklm"
    assert offset.tolist() == [0, 4]
    assert t_ns.tolist() == [1_000_000, 3_000_000]


def test_a_folder_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StageError, match="in the way"):
        AppendFile(tmp_path / "file" / "log")


def test_the_manifest_takes_over_the_rig(tmp_path: Path) -> None:
    rig = tmp_path / "drive.toml"
    rig.write_text(
        'schema = "automap.drive/1"\nname = "old"\n'
        '[imu]\nfile = "old.csv"\naxes = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]\n'
        'gyro_unit = "deg/s"\ncalibration = "/rig/imu_calibration.toml"\n'
        '[gnss]\nfile = "old.ubx"\noutput_delay_s = 0.07\nlever_arm_m = [0.4, 0.1, -1.2]\n'
        '[video.front]\nfiles = ["old.mp4"]\nmount_rpy_deg = [0.5, -1.0, 0.25]\n'
        '[video.rear]\nwidth = 640\n[site]\ncountry = "NZ"\ntraffic_side = "left"\n'
    )
    form = load_format("thinimu-micro")
    cameras = {"front": {"frames": "video/front_frames.csv", "width": 1280, "height": 720}}
    text = manifest_text('a "drive"', "gnss.ubx", form, cameras, read_rig(tmp_path))
    (tmp_path / "new.toml").write_text(text)
    manifest = read_manifest(tmp_path / "new.toml")
    assert manifest.name == 'a "drive"'
    assert (manifest.imu.file, manifest.imu.sensor) == ("imu.csv", "thinimu-micro")
    assert (manifest.imu.gyro_unit, manifest.imu.accel_unit) == ("counts", "counts")
    assert manifest.imu.axes == [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
    assert manifest.imu.calibration == "/rig/imu_calibration.toml"
    assert (manifest.gnss.file, manifest.gnss.output_delay_s) == ("gnss.ubx", 0.07)
    assert list(manifest.video) == ["front"]
    assert manifest.video["front"].mount_rpy_deg == (0.5, -1.0, 0.25)
    assert manifest.video["front"].files is None
    assert manifest.site.country == "NZ"


@pytest.mark.parametrize(
    ("size", "matrix"),
    [
        ((1280, 720), ((1000.0, 0, 639.5), (0, 1000.0, 359.5), (0, 0, 1))),
        ((640, 360), ((500.0, 0, 319.5), (0, 500.0, 179.5), (0, 0, 1))),
        ((640, 480), None),
    ],
)
def test_the_camera_matrix_goes_with_the_size(
    tmp_path: Path, size: tuple[int, int], matrix: tuple[tuple[float, ...], ...] | None
) -> None:
    rig = tmp_path / "drive.toml"
    rig.write_text(
        'schema = "automap.drive/1"\n[video.front]\nwidth = 1280\nheight = 720\n'
        "camera_matrix = [[1000.0, 0.0, 639.5], [0.0, 1000.0, 359.5], [0.0, 0.0, 1.0]]\n"
    )
    files = {"frames": "video/front_frames.csv", "width": size[0], "height": size[1]}
    text = manifest_text("x", None, None, {"front": files}, read_rig(tmp_path))
    (tmp_path / "new.toml").write_text(text)
    camera = read_manifest(tmp_path / "new.toml").video["front"]
    assert (camera.width, camera.height) == size
    assert camera.camera_matrix == matrix


def test_a_trouble_on_the_brink_is_told_once() -> None:
    told: list[tuple[str, str]] = []
    conditions = Conditions(lambda level, text: told.append((level, text)))
    for on in [True, False, True, False, False, True]:
        conditions.update({"disk": "the disk is nearly full"} if on else {})
    assert told == [("warning", "the disk is nearly full")]
    for _ in range(10):
        conditions.update({})
    assert [level for level, _ in told] == ["warning", "note"]
    conditions.update({"port": "away"}, told=frozenset({"port"}))
    assert len(told) == 2
    assert conditions.active == {"port": "away"}
