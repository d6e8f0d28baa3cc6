"""A GoPro's video as a drive folder: the camera is IMU, receiver and eye in one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import InputError
from automap.io.atomic import make_folder, write_bytes
from automap.io.toml_file import toml_value
from pipeline.importers.parts import copy_or_link, write_arrival, write_imu
from pipeline.importers.target import Import, new_drive

if TYPE_CHECKING:
    from automap.io.gopro import GoProRecording
    from automap.io.gopro_positions import GoProPositions

_NOTES = (
    "All times are nanoseconds of the video's clock, its first frame at zero.",
    "imu.csv            ACCL and GYRO, their stamps (STMP) spread evenly over each block.",
    "gnss.nmea          positions as sentences. GPS5 has UTC once a block: the camera's clock is",
    "                   set by the median, so absolute time may be off by up to a second.",
    "                   The course is not kept by the camera: it is that of the positions around.",
    "gnss_arrival.csv   when the camera took each position.",
    "The receiver's output delay is not known and therefore not given; neither is the lens: add",
    "camera_matrix and distortion of the mode that was used, else signs are shifted.",
)


def import_gopro(source: Path, out: Path, link: bool = False) -> list[str]:
    """Write the GoPro recording ``source``, with the chapters that follow it, as ``out``.

    With ``link`` the video is linked instead of copied. Returns warnings; raises InputError
    for a file without GoPro's metadata.
    """
    from automap.io.gopro import find_chapters, read_gopro

    with new_drive("gopro", source, out) as run:
        if run.source.is_dir():
            raise InputError(f"{source} is a folder; name the first file of one recording.")
        chapters = find_chapters(run.source)
        run.sources += chapters
        recording = read_gopro(chapters)
        for text in recording.warnings:
            run.warn(text)
        _write(run, recording, chapters, link)
    return run.warnings


def _write(run: Import, recording: GoProRecording, chapters: list[Path], link: bool) -> None:
    write_imu(run, recording.imu_t_ns, recording.gyro, recording.accel)
    axes = "FRD" if recording.axes_known else "unknown"
    sections = (
        f'[imu]\nfile = "imu.csv"\naxes = "{axes}"\ntime = "boot_ns"\n'
        'gyro_unit = "rad/s"\naccel_unit = "m/s^2"\n'
    )
    if recording.positions is not None:
        _write_positions(run, recording.positions)
        sections += (
            '\n[gnss]\nfile = "gnss.nmea"\narrival = "gnss_arrival.csv"\narrival_time = "boot_ns"\n'
        )
    folder = make_folder(run.folder / "video")
    files = []
    for number, chapter in enumerate(chapters, start=1):
        name = f"front{'' if number == 1 else f'_{number}'}{chapter.suffix.lower()}"
        copy_or_link(chapter, folder / name, link)
        files.append(f"video/{name}")
    listed = ", ".join(toml_value(name) for name in files)
    sections += (
        f"\n[video.front]\nfiles = [{listed}]\nstart_ns = 0\n"
        "mount_rpy_sigma_deg = 3.0\ntime_offset_sigma_s = 0.05\n"
    )
    counts = ", ".join(f"{n} {key}" for key, n in recording.counts.items())
    run.write_manifest(sections, (f"{recording.device or 'GoPro'}: {counts} samples.", *_NOTES))


def _write_positions(run: Import, found: GoProPositions) -> None:
    from automap.io.gopro_positions import course_of_positions
    from automap.io.nmea_writer import Positions, nmea_positions, unknown

    rows = np.flatnonzero(np.isfinite(found.unix_s))
    if len(rows) < len(found):
        run.warn(f"{run.source}: {len(found) - len(rows)} positions without time were left out")
    n = len(rows)
    log, offsets = nmea_positions(
        Positions(
            unix_ms=np.rint(found.unix_s[rows] * 1e3).astype(np.int64),
            lat_deg=found.lat_deg[rows],
            lon_deg=found.lon_deg[rows],
            height_m=found.height_m[rows],
            speed_m_s=found.speed_m_s[rows],
            course_deg=course_of_positions(found)[rows],
            down_m_s=unknown(n),
            h_acc_m=unknown(n),
            v_acc_m=unknown(n),
            hdop=found.dop[rows],
            fix=found.fix[rows],
        )
    )
    write_bytes(run.folder / "gnss.nmea", log)
    write_arrival(run, offsets, found.t_ns[rows])
