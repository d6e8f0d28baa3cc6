"""A drive of KITTI raw as a drive folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.io.atomic import write_bytes
from automap.records import FixType, FloatArray
from automap.timebase import unix_to_gps
from pipeline.importers.parts import (
    gnss_section,
    imu_section,
    video_section,
    write_image_files,
    write_imu,
    write_truth,
)
from pipeline.importers.target import Import, new_drive

if TYPE_CHECKING:
    from automap.io.kitti_raw import KittiCamera, KittiDrive

_NOTES = (
    "The stamps are the recording computer's calendar, taken as UTC.",
    "imu.csv            oxts: accelerometer and gyro; 10 Hz in _sync, 100 Hz in _extract.",
    "gnss.pos           oxts: positions and velocities of the unit's own filter. They are no",
    "                   receiver's fixes: they hold the IMU already, and their error is small.",
    "truth/             the same poses.",
)
_OPENCV_TO_FRD = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_FLIP = np.diag([1.0, -1.0, -1.0])


def import_kitti(source: Path, out: Path, no_video: bool = False) -> list[str]:
    """Write the drive of KITTI raw in ``source`` as the drive ``out``; returns warnings."""
    from automap.io.kitti_raw import read_kitti

    with new_drive("kitti", source, out) as run:
        drive = read_kitti(run.source)
        run.sources += drive.files
        for text in drive.warnings:
            run.warn(text)
        _write(run, drive, no_video)
    return run.warnings


def _write(run: Import, drive: KittiDrive, no_video: bool) -> None:
    from automap.io import kitti_raw as k
    from automap.io.pos_writer import pos_log

    oxts = drive.oxts
    write_imu(run, drive.t_ns, oxts[:, k.GYRO], oxts[:, k.ACCEL])
    velocity = np.column_stack([oxts[:, k.VN], oxts[:, k.VE], -oxts[:, k.VU]])
    position_sd, velocity_sd = (
        np.repeat(np.where(oxts[:, c] > 0.0, oxts[:, c], np.nan)[:, None], 3, axis=1)
        for c in (k.POS_ACCURACY, k.VEL_ACCURACY)
    )
    log, _ = pos_log(
        unix_to_gps(drive.t_ns * 1e-9),
        oxts[:, k.LAT],
        oxts[:, k.LON],
        oxts[:, k.ALT],
        np.full(len(oxts), FixType.THREE_D),
        position_sd,
        velocity,
        velocity_sd,
    )
    write_bytes(run.folder / "gnss.pos", log)
    # OXTS: roll left side up, pitch nose down, yaw counter-clockwise from east
    rpy = np.column_stack([oxts[:, k.ROLL], -oxts[:, k.PITCH], np.pi / 2.0 - oxts[:, k.YAW]])
    rpy[:, 2] = np.arctan2(np.sin(rpy[:, 2]), np.cos(rpy[:, 2]))
    write_truth(
        run,
        "t_ns",
        drive.t_ns,
        oxts[:, [k.LAT, k.LON, k.ALT]],
        velocity,
        np.degrees(rpy),
    )
    sections = imu_section("FLU", "unix_ns") + gnss_section("gnss.pos")
    sections += "lever_arm_m = [0.0, 0.0, 0.0]\n"
    if drive.images and not no_video:
        sections += _write_video(run, drive)
    sections += '\n[site]\ncountry = "DE"\ntraffic_side = "right"\n'
    run.write_manifest(sections, _NOTES)


def _write_video(run: Import, drive: KittiDrive) -> str:
    run.sources += drive.images
    name = write_image_files(run, drive.images, drive.image_t_ns)
    return video_section(name, "unix_ns", matrix=drive.camera.matrix, more=_mounting(drive.camera))


def _mounting(camera: KittiCamera) -> str:
    if camera.C_imu_cam is None or camera.lever_arm_flu is None:
        return ""
    from scipy.spatial.transform import Rotation

    arm = _FLIP @ camera.lever_arm_flu
    # camera axes forward, right, down in vehicle axes forward, right, down
    C: FloatArray = _FLIP @ camera.C_imu_cam @ _OPENCV_TO_FRD.T
    yaw, pitch, roll = Rotation.from_matrix(C).as_euler("ZYX", degrees=True)
    return (
        f"lever_arm_m = [{arm[0]:.4f}, {arm[1]:.4f}, {arm[2]:.4f}]\n"
        f"mount_rpy_deg = [{roll:.4f}, {pitch:.4f}, {yaw:.4f}]\nmount_rpy_sigma_deg = 0.3\n"
        "time_offset_sigma_s = 0.02\n"
    )
