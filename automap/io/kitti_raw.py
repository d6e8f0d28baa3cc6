"""A drive of KITTI raw: readings and poses of its OXTS unit, images, calibration.

Reference: A. Geiger et al., "Vision meets Robotics: The KITTI Dataset", IJRR 2013, and
dataformat.txt of the development kit (30 numbers a line; vehicle axes x forward, y left, z up).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.records import FloatArray, IntArray

_FIELDS = 30
LAT, LON, ALT, ROLL, PITCH, YAW, VN, VE = range(8)
VU = 10
ACCEL = slice(11, 14)
GYRO = slice(17, 20)
POS_ACCURACY, VEL_ACCURACY, NAVSTAT, NUMSATS, POSMODE = 23, 24, 25, 26, 27


@dataclass(frozen=True)
class KittiCamera:
    """Rectified colour camera: matrix [3, 3], image size, place in the IMU's axes (forward,
    left, up) and C_imu_camera [3, 3] of OpenCV's axes; None where calibration is missing."""

    matrix: FloatArray | None
    lever_arm_flu: FloatArray | None
    C_imu_cam: FloatArray | None


@dataclass(frozen=True)
class KittiDrive:
    """``t_ns`` [n] and ``oxts`` [n, 30] of the unit; ``images`` with their stamps."""

    path: Path
    t_ns: IntArray
    oxts: FloatArray
    images: tuple[Path, ...]
    image_t_ns: IntArray
    camera: KittiCamera
    files: tuple[Path, ...]
    warnings: tuple[str, ...]


def read_kitti(source: Path) -> KittiDrive:
    """Read ``..._drive_NNNN_sync`` or ``..._extract``; InputError names what is missing."""
    folder = source / "oxts"
    if not folder.is_dir():
        raise InputError(
            f"{source} is no drive of KITTI raw: it has no folder oxts; give the folder "
            "DATE_drive_NNNN_sync or _extract."
        )
    warnings: list[str] = []
    stamps = read_timestamps(folder / "timestamps.txt")
    files = sorted((folder / "data").glob("*.txt"))
    if not files or len(files) > len(stamps):
        raise InputError(
            f"{folder}: {len(files)} readings and {len(stamps)} time stamps; unpack it again."
        )
    numbers = [int(path.stem) for path in files if path.stem.isdigit()]
    if len(numbers) != len(files) or numbers[-1] >= len(stamps):
        raise InputError(f"{folder}/data: names that are no numbers; unpack the drive again.")
    oxts = np.array([_oxts(path) for path in files])
    t_ns = stamps[numbers]
    order = np.argsort(t_ns, kind="stable")
    if np.any(np.diff(numbers) != 1):
        warnings.append(f"{folder}: {len(stamps) - len(files)} readings are missing")
    images, image_t_ns = _images(source / "image_02", warnings)
    camera, calibration = _camera(source.parent, warnings)
    return KittiDrive(
        path=source,
        t_ns=t_ns[order],
        oxts=oxts[order],
        images=images,
        image_t_ns=image_t_ns,
        camera=camera,
        files=(folder / "timestamps.txt", *files, *calibration),
        warnings=tuple(warnings),
    )


def read_timestamps(path: Path) -> IntArray:
    """Lines ``2011-09-26 13:02:25.594360375`` as ns, the calendar taken as UTC [n]."""
    try:
        lines = path.read_text(encoding="ascii", errors="replace").split("\n")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); unpack it again.") from error
    stamps = []
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            stamps.append(int(np.datetime64(line.strip().replace(" ", "T"), "ns").astype(np.int64)))
        except ValueError:
            raise InputError(
                f"{path}: line {number} is no time (2011-09-26 13:02:25.594); unpack it again."
            ) from None
    return np.array(stamps, np.int64)


def _oxts(path: Path) -> list[float]:
    try:
        row = [float(v) for v in path.read_text(encoding="ascii", errors="replace").split()]
    except (ValueError, OSError) as error:
        raise InputError(f"{path} does not hold numbers ({error}); unpack it again.") from None
    if len(row) != _FIELDS or not np.isfinite(row).all():
        raise InputError(f"{path} holds {len(row)} numbers, not {_FIELDS}; unpack it again.")
    return row


def _images(folder: Path, warnings: list[str]) -> tuple[tuple[Path, ...], IntArray]:
    files = sorted([*(folder / "data").glob("*.png"), *(folder / "data").glob("*.jpg")])
    if not files or not (folder / "timestamps.txt").is_file():
        warnings.append(f"{folder}: no images with time stamps; the drive has no video")
        return (), np.zeros(0, np.int64)
    stamps = read_timestamps(folder / "timestamps.txt")
    kept = [path for path in files if path.stem.isdigit() and int(path.stem) < len(stamps)]
    return tuple(kept), stamps[[int(path.stem) for path in kept]]


def _camera(folder: Path, warnings: list[str]) -> tuple[KittiCamera, list[Path]]:
    """Camera 2 of the calibration files beside the drives of a day."""
    cam_file, velo_file, imu_file = (
        folder / name
        for name in ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt", "calib_imu_to_velo.txt")
    )
    if not all(path.is_file() for path in (cam_file, velo_file, imu_file)):
        warnings.append(
            f"{folder}: calib_*.txt are missing; add camera_matrix and lever arms to drive.toml"
        )
        return KittiCamera(None, None, None), []
    cam, velo, imu = (_calibration(path) for path in (cam_file, velo_file, imu_file))
    try:
        P = cam["P_rect_02"].reshape(3, 4)
        rectify = _homogeneous(cam["R_rect_00"].reshape(3, 3), np.zeros(3))
        to_cam = _homogeneous(velo["R"].reshape(3, 3), velo["T"])
        to_velo = _homogeneous(imu["R"].reshape(3, 3), imu["T"])
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{folder}: the calibration files lack {error}; unpack the day's calibration again."
        ) from None
    shift = _homogeneous(np.eye(3), np.array([P[0, 3] / P[0, 0], 0.0, 0.0]))
    cam_from_imu = shift @ rectify @ to_cam @ to_velo
    C = cam_from_imu[:3, :3].T
    return (
        KittiCamera(matrix=P[:, :3], lever_arm_flu=-C @ cam_from_imu[:3, 3], C_imu_cam=C),
        [cam_file, velo_file, imu_file],
    )


def _homogeneous(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def _calibration(path: Path) -> dict[str, FloatArray]:
    """``NAME: number number ...`` by name; lines of anything else are passed over."""
    values = {}
    for line in path.read_text(encoding="ascii", errors="replace").splitlines():
        name, _, rest = line.partition(":")
        try:
            values[name.strip()] = np.array([float(v) for v in rest.split()])
        except ValueError:
            continue
    return values
