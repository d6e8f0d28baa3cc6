"""A recording in the ASL format (EuRoC) as a drive folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.io.atomic import write_bytes
from automap.records import FixType
from automap.timebase import unix_to_gps
from pipeline.importers.parts import (
    gnss_section,
    imu_section,
    video_section,
    write_image_files,
    write_imu,
)
from pipeline.importers.target import Import, new_drive

if TYPE_CHECKING:
    from automap.io.euroc import EurocCamera, EurocRecording

_NOTES = (
    "Stamps as in the recording, taken as UNIX time of one clock.",
    "imu.csv            imu0 in its own axes.",
    "The ground truth of the format is in a frame of the room, not on Earth, and left out.",
)


def import_euroc(
    source: Path, out: Path, axes: str = "unknown", no_video: bool = False
) -> list[str]:
    """Write the ASL recording in ``source`` as the drive ``out``; returns warnings."""
    from automap.io.euroc import read_euroc

    with new_drive("euroc", source, out) as run:
        recording = read_euroc(run.source)
        run.sources += recording.files
        for text in recording.warnings:
            run.warn(text)
        write_imu(run, recording.imu_t_ns, recording.gyro, recording.accel)
        sections = imu_section(axes, "unix_ns") + _write_positions(run, recording)
        if recording.camera is not None and not no_video:
            sections += _write_video(run, recording.camera)
        run.write_manifest(sections, _NOTES)
    return run.warnings


def _write_positions(run: Import, recording: EurocRecording) -> str:
    from automap.io.pos_writer import pos_log

    if recording.gps is None or recording.gps_t_ns is None:
        return ""
    log, _ = pos_log(
        unix_to_gps(recording.gps_t_ns * 1e-9),
        recording.gps[:, 0],
        recording.gps[:, 1],
        recording.gps[:, 2],
        np.full(len(recording.gps), FixType.THREE_D),
    )
    write_bytes(run.folder / "gnss.pos", log)
    return gnss_section("gnss.pos")


def _write_video(run: Import, camera: EurocCamera) -> str:
    run.sources += camera.images
    name = write_image_files(run, camera.images, camera.t_ns)
    return video_section(name, "unix_ns", matrix=camera.matrix, distortion=camera.distortion)
