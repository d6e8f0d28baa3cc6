"""Which reader each kind of damaged file goes to, by the beginning of its name."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from automap.io.bearings_csv import read_bearings
from automap.io.bearings_import import read_foreign_bearings, read_foreign_points
from automap.io.camera_turns import read_camera_turns
from automap.io.clock_json import read_clocks
from automap.io.detections_csv import read_detections_csv
from automap.io.drive import load_drive
from automap.io.exif_images import read_images
from automap.io.frame_times import frame_times
from automap.io.gnss_logger import read_gnss_logger
from automap.io.gopro_streams import Channel, add_payload
from automap.io.gpmf import GpmfError
from automap.io.imu_calibration import read_imu_calibration
from automap.io.imu_csv import read_imu_csv
from automap.io.imu_log import LogFormat, read_imu_log
from automap.io.manifest import VideoSection
from automap.io.odometer_csv import read_odometer_csv
from automap.io.receiver import read_receiver_log
from automap.io.receiver_file import read_receiver
from automap.io.review_json import read_review
from automap.io.sensor_file import read_sensor
from automap.io.sensor_logger import read_sensor_logger
from automap.io.sign_points import read_sign_points
from automap.io.tables import read_imu
from automap.io.trajectory_csv import read_trajectory_csv
from automap.io.truth_trajectory import read_truth_trajectory
from automap.io.video import VideoInput
from automap.records import FrameTimes
from pipeline.detect.search_setup import read_description
from pipeline.settings.load import load_settings
from pipeline.shared.run_record import drive_of, read_record

Reader = Callable[[Path, Path], object]
"""Reads a file with a folder to work in."""


def _plain(read: Callable[[Path], object]) -> Reader:
    return lambda path, work: read(path)


def _as(name: str, read: Callable[[Path], object]) -> Reader:
    """Reads a copy under the name that the reader looks for."""

    def run(path: Path, work: Path) -> object:
        shutil.copyfile(path, work / name)
        return read(work / name)

    return run


def _images(path: Path, work: Path) -> object:
    # one image alone is no sequence
    for name in ("0.jpg", "1.jpg"):
        shutil.copyfile(path, work / name)
    return read_images(work)


def _drive(path: Path, work: Path) -> object:
    shutil.copyfile(path, work / "drive.toml")
    for name in ("imu.csv", "gnss.nmea"):
        (work / name).write_text("x\n")
    return load_drive(work)


def _phone(path: Path, work: Path) -> object:
    for name in ("Gyroscope", "TotalAcceleration"):
        shutil.copyfile(path, work / f"{name}.csv")
    return read_sensor_logger(work)


def _record(path: Path, work: Path) -> object:
    shutil.copyfile(path, work / "run.json")
    return drive_of(work), read_record(work)


def _payload(path: Path) -> object:
    channels: dict[str, Channel] = {}
    # the caller counts such a packet and goes on with the next
    with suppress(GpmfError):
        add_payload(path.read_bytes(), 0.0, channels)
    return [channel.times_us(1e6) for channel in channels.values()]


_TIMES = FrameTimes(np.arange(100), np.arange(100) * 100_000_000)

READERS: dict[str, Reader] = {
    "bearings_csv": _plain(read_bearings),
    "camera_turns_json": _plain(read_camera_turns),
    "detections_csv": _plain(lambda path: read_detections_csv(path, _TIMES)),
    "detector_toml": _plain(read_description),
    "drive_toml": _drive,
    "exif_jpg": _images,
    "foreign_bearings": _plain(read_foreign_bearings),
    "foreign_points": _plain(read_foreign_points),
    "frames_csv": _plain(
        lambda path: frame_times(VideoInput("front", VideoSection(), frames=path))
    ),
    "gnss_logger": _plain(read_gnss_logger),
    "gopro_channels": _plain(_payload),
    "imu_calibration": _plain(read_imu_calibration),
    "imu_csv": _plain(read_imu_csv),
    "imu_log_named": _plain(lambda path: read_imu_log(path, LogFormat())),
    "imu_parquet": _plain(read_imu),
    "odometer_csv": _plain(read_odometer_csv),
    "phone_csv": _phone,
    "phone_": _plain(read_sensor_logger),
    "receiver_toml": _plain(read_receiver),
    "review_json": _plain(read_review),
    "run_json": _record,
    "rx_": _plain(read_receiver_log),
    "sensor_toml": _plain(read_sensor),
    "settings_model_toml": _plain(lambda path: load_settings(path)),
    "signs_geojson": _plain(read_sign_points),
    "sync_json": _plain(read_clocks),
    "trajectory_csv": _plain(read_trajectory_csv),
    "truth_trajectory": _plain(read_truth_trajectory),
}


def reader_of(name: str) -> Reader:
    """The reader for a damaged file, by the longest beginning that is known."""
    known = [start for start in READERS if name.startswith(start)]
    return READERS[max(known, key=len)]
