"""Drive folders from recordings in other forms, ``automap import``."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import ConfigError
from automap.io import names
from automap.io.atomic import make_folder, write_bytes, write_failure, write_text

if TYPE_CHECKING:
    from automap.io.comma2k19 import Reference, Segment

_MARK = "# Made by automap import comma2k19"

_MANIFEST = """\
{mark} from {source}
#
# imu.csv            processed_log/IMU: accelerometer and uncalibrated gyro as measured.
# gnss.nmea          processed_log/GNSS/live_gnss_ublox written as sentences; the receiver's
#                    vertical velocity, accuracy and satellites are not in the data set.
# gnss_arrival.csv   when the phone got each position.
# can_speed.csv      processed_log/CAN/speed, the car's own speed.
# truth/             global_pose at frame_times. Its frame_gps_times are left out: against the
#                    stamps of the positions they disagree by more than a tenth of a second.
# The receiver's output delay is not known and therefore not given.
schema = "automap.drive/1"
name = {name}

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


def import_comma2k19(source: Path, out: Path) -> list[str]:
    """Write the comma2k19 segment in ``source`` as the drive folder ``out``.

    Returns warnings, one sentence each. The folder appears whole or not at all. Raises
    InputError for a segment that cannot be read, ConfigError when ``out`` holds anything but
    an earlier import.
    """
    from automap.io.comma2k19 import read_segment

    source, out = Path(source), Path(out)
    _check_target(out)
    segment = read_segment(source)
    make_folder(out.parent)
    try:
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as temporary:
            folder = Path(temporary) / "drive"
            make_folder(folder)
            _write_drive(folder, segment, out.name)
            _move(folder, out)
    except OSError as error:
        raise write_failure(out, error) from error
    return list(segment.warnings)


def _check_target(out: Path) -> None:
    if not out.exists():
        return
    if not out.is_dir():
        raise ConfigError(f"{out} is a file; name a folder for the drive.")
    manifest = out / names.MANIFEST
    if manifest.is_file():
        with manifest.open(encoding="utf-8", errors="replace") as stream:
            if stream.readline().startswith(_MARK):
                return
    if any(out.iterdir()):
        raise ConfigError(
            f"{out} is not empty and was not made by this import; name another folder."
        )


def _move(folder: Path, out: Path) -> None:
    """Put the finished folder in its place; an earlier import's files give way, results stay."""
    if not out.exists():
        os.replace(folder, out)
        return
    for old in ("truth", "video", "can_speed.csv"):
        if (out / old).is_dir():
            shutil.rmtree(out / old)
        else:
            (out / old).unlink(missing_ok=True)
    # the manifest goes last: until then the old one marks the folder as ours
    for item in sorted(folder.iterdir(), key=lambda path: path.name == names.MANIFEST):
        os.replace(item, out / item.name)


def _write_drive(folder: Path, segment: Segment, name: str) -> None:
    from automap.io.comma2k19 import nmea_log

    imu = np.column_stack([segment.gyro, segment.accel])
    write_text(
        folder / "imu.csv",
        _csv(("t_ns", "gx", "gy", "gz", "ax", "ay", "az"), segment.imu_t_ns, imu, 9),
    )
    log, offsets = nmea_log(segment.live)
    write_bytes(folder / "gnss.nmea", log)
    write_text(
        folder / "gnss_arrival.csv",
        "offset,t_ns\n"
        + "".join(
            f"{offset},{t}\n"
            for offset, t in zip(offsets.tolist(), segment.live.arrival_ns.tolist(), strict=True)
        ),
    )
    if segment.speed_t_ns is not None and segment.speed_m_s is not None:
        speed = segment.speed_m_s[:, None]
        text = _csv(("t_ns", "speed_m_s"), segment.speed_t_ns, speed, 6)
        write_text(folder / "can_speed.csv", text)
    if segment.reference is not None:
        path = folder / names.TRUTH_DIR / names.TRUTH_TRAJECTORY
        write_text(path, _truth_csv(segment.reference))
    video = ""
    if segment.video is not None and segment.frame_t_ns is not None:
        _write_video(folder / "video", segment)
        video = _VIDEO
    manifest = _MANIFEST.format(mark=_MARK, source=segment.path.resolve().name, name=_toml(name))
    write_text(folder / names.MANIFEST, manifest + video + _SITE)


def _toml(text: str) -> str:
    import json

    return json.dumps(text)  # a JSON string is a TOML basic string


def _csv(header: tuple[str, ...], t_ns: np.ndarray, values: np.ndarray, digits: int) -> str:
    rows = (
        f"{t}," + ",".join(f"{value:.{digits}g}" for value in row)
        for t, row in zip(t_ns.tolist(), values.tolist(), strict=True)
    )
    return ",".join(header) + "\n" + "\n".join(rows) + "\n"


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
