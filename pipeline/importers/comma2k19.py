"""A segment of comma2k19 as a drive folder."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.io import names
from automap.io.atomic import make_folder, write_bytes, write_text
from pipeline.importers.parts import write_arrival, write_csv, write_imu
from pipeline.importers.target import Import, new_drive

if TYPE_CHECKING:
    from automap.io.comma2k19 import Reference, Segment

_NOTES = (
    "imu.csv            processed_log/IMU: accelerometer and uncalibrated gyro as measured.",
    "gnss.nmea          processed_log/GNSS/live_gnss_ublox written as sentences; the receiver's",
    "                   vertical velocity, accuracy and satellites are not in the data set.",
    "gnss_arrival.csv   when the phone got each position.",
    "can_speed.csv      processed_log/CAN/speed, the car's own speed.",
    "truth/             global_pose at frame_times. Its frame_gps_times are left out: against the",
    "                   stamps of the positions they disagree by more than a tenth of a second.",
    "The receiver's output delay is not known and therefore not given.",
)

_SECTIONS = """\
[imu]
file = "imu.csv"
axes = "FRD"
time = "boot_ns"
gyro_unit = "rad/s"
accel_unit = "m/s^2"

[gnss]
file = "gnss.nmea"
arrival = "gnss_arrival.csv"
arrival_time = "boot_ns"
"""

_ODOMETER = """
[odometer]
file = "can_speed.csv"
"""

_VIDEO = """
[video.front]
files = ["video/front.hevc"]
frames = "video/front_frames.csv"
width = 1164
height = 874
camera_matrix = [[910.0, 0.0, 582.0], [0.0, 910.0, 437.0], [0.0, 0.0, 1.0]]
mount_rpy_sigma_deg = 4.0
"""

_SITE = """
[site]
country = "US"
traffic_side = "right"
"""


def import_comma2k19(source: Path, out: Path, kind: str = "comma2k19") -> list[str]:
    """Write the comma2k19 segment in ``source`` as the drive folder ``out``.

    Returns warnings, one sentence each. Raises InputError for a segment that cannot be read,
    ConfigError when ``out`` holds anything but an earlier import.
    """
    from automap.io.comma2k19 import read_segment

    with new_drive(kind, source, out) as run:
        segment = read_segment(run.source)
        for text in segment.warnings:
            run.warn(text)
        for part in ("processed_log", "global_pose"):
            folder = segment.path / part
            run.sources += sorted(path for path in folder.rglob("*") if path.is_file())
        _write_drive(run, segment)
    return run.warnings


def _write_drive(run: Import, segment: Segment) -> None:
    from automap.io.comma2k19 import nmea_log

    folder = run.folder
    write_imu(run, segment.imu_t_ns, segment.gyro, segment.accel)
    log, offsets = nmea_log(segment.live)
    write_bytes(folder / "gnss.nmea", log)
    write_arrival(run, offsets, segment.live.arrival_ns)
    sections = _SECTIONS
    if segment.speed_t_ns is not None and segment.speed_m_s is not None:
        sections += _ODOMETER
        write_csv(
            folder / "can_speed.csv",
            ("t_ns", "speed_m_s"),
            segment.speed_t_ns,
            segment.speed_m_s,
            ".6g",
        )
    if segment.reference is not None:
        path = folder / names.TRUTH_DIR / names.TRUTH_TRAJECTORY
        write_text(path, _truth_csv(segment.reference))
    if segment.video is not None and segment.frame_t_ns is not None:
        _write_video(folder / "video", segment)
        run.sources.append(segment.video)
        sections += _VIDEO
    run.write_manifest(sections + _SITE, _NOTES)


def _truth_csv(reference: Reference) -> str:
    header = "t_ns,lat_deg,lon_deg,height_m,vn,ve,vd,roll_deg,pitch_deg,yaw_deg\n"
    values = np.column_stack(
        [
            reference.lat_deg,
            reference.lon_deg,
            reference.height_m,
            reference.vel_ned,
            reference.rpy_deg,
        ]
    )
    rows = (
        f"{t},{row[0]:.10f},{row[1]:.10f}," + ",".join(f"{value:.4f}" for value in row[2:]) + "\n"
        for t, row in zip(reference.t_ns.tolist(), values.tolist(), strict=True)
    )
    return header + "".join(rows)


def _write_video(folder: Path, segment: Segment) -> None:
    assert segment.video is not None
    assert segment.frame_t_ns is not None
    make_folder(folder)
    shutil.copyfile(segment.video, folder / "front.hevc")
    rows = "".join(f"{frame},{t}\n" for frame, t in enumerate(segment.frame_t_ns.tolist()))
    write_text(folder / "front_frames.csv", "frame,t_ns\n" + rows)
