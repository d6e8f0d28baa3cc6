"""Logs of phone applications as drive folders."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.io.atomic import make_folder, write_bytes
from pipeline.importers.parts import (
    copy_or_link,
    gnss_section,
    imu_section,
    write_arrival,
    write_imu,
)
from pipeline.importers.target import Import, new_drive

if TYPE_CHECKING:
    from automap.io.phone_logs import PhoneLog

_VIDEOS = (".mp4", ".mov", ".m4v")
_NOTES = (
    "imu.csv            specific force and rotation in the phone's axes, x right, y up, z out of",
    "                   the screen; how it lay in the vehicle is not in the log.",
    "gnss.nmea          the phone's locations as sentences; heights as the phone gave them.",
    "gnss_arrival.csv   the phone's time of each location.",
)


def import_sensor_logger(source: Path, out: Path, axes: str = "unknown") -> list[str]:
    """Write a recording of Sensor Logger (folder or .zip) as the drive ``out``."""
    from automap.io.sensor_logger import read_sensor_logger

    return _import("sensor-logger", source, out, axes, "unix_ns", read_sensor_logger)


def import_gnss_logger(source: Path, out: Path, axes: str = "unknown") -> list[str]:
    """Write a log of GnssLogger as the drive ``out``."""
    from automap.io.gnss_logger import read_gnss_logger

    return _import("gnss-logger", source, out, axes, "boot_ns", read_gnss_logger)


def _import(
    kind: str, source: Path, out: Path, axes: str, time: str, read: Callable[[Path], PhoneLog]
) -> list[str]:
    with new_drive(kind, source, out) as run:
        log = read(run.source)
        run.sources += log.files
        for text in log.warnings:
            run.warn(text)
        sections = _write_readings(run, log, axes, time) + _write_positions(run, log, time)
        run.write_manifest(sections, _NOTES)
        if run.source.is_dir():
            _keep_video(run)
    return run.warnings


def _write_readings(run: Import, log: PhoneLog, axes: str, time: str) -> str:
    """The IMU and its section; left out where there are fewer readings than positions, for what
    happens between these is then not in them."""
    t_ns, at_ns = log.imu_t_ns, log.position_t_ns
    if at_ns is not None and len(t_ns) < len(at_ns):
        span_s = float(np.ptp(t_ns)) * 1e-9 if len(t_ns) else 0.0
        run.warn(
            f"{run.source}: {len(t_ns)} inertial readings in {span_s:.0f} s, fewer than the "
            f"{len(at_ns)} positions, are left out and the path is that of the positions; switch "
            "the sensors on at their full rate next time"
        )
        return ""
    write_imu(run, t_ns, log.gyro, log.accel)
    return imu_section(axes, time)


def _write_positions(run: Import, log: PhoneLog, time: str) -> str:
    from automap.io.nmea_writer import nmea_positions

    if log.positions is None or log.position_t_ns is None:
        return ""
    text, offsets = nmea_positions(log.positions)
    write_bytes(run.folder / "gnss.nmea", text)
    write_arrival(run, offsets, np.maximum.accumulate(log.position_t_ns))
    return gnss_section("gnss.nmea", time)


def _keep_video(run: Import) -> None:
    """A single video of the recording is put in; when it began is the user's to say."""
    videos = [p for p in sorted(run.source.rglob("*")) if p.suffix.lower() in _VIDEOS]
    if len(videos) != 1:
        return
    copy_or_link(videos[0], make_folder(run.folder / "video") / f"front{videos[0].suffix}", False)
    run.sources.append(videos[0])
    run.warn(
        f"{videos[0]}: the video is put in, but the log does not say when it began; add start_ns "
        "to [video.front] in drive.toml"
    )
