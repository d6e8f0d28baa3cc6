"""A recording in the ASL format of the EuRoC data sets.

Reference: M. Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 2016: a folder for
each sensor with data.csv and sensor.yaml; T_BS takes the sensor's axes to the body's.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.records import FloatArray, IntArray

_OPENCV_MODELS = ("radial-tangential", "radtan")


@dataclass(frozen=True)
class EurocCamera:
    """Images with stamps; matrix [3, 3], distortion and T_BS [4, 4] where sensor.yaml has them."""

    images: tuple[Path, ...]
    t_ns: IntArray
    matrix: FloatArray | None
    distortion: tuple[float, ...]
    T_body_cam: FloatArray | None


@dataclass(frozen=True)
class EurocRecording:
    """IMU readings [n, 3] (rad/s, m/s^2, the sensor's axes), its T_BS, the first camera, and the
    positions of a receiver (gps0: latitude, longitude, altitude [k, 3]) where there is one."""

    path: Path
    imu_t_ns: IntArray
    gyro: FloatArray
    accel: FloatArray
    T_body_imu: FloatArray | None
    camera: EurocCamera | None
    gps_t_ns: IntArray | None
    gps: FloatArray | None
    files: tuple[Path, ...]
    warnings: tuple[str, ...]


def read_euroc(source: Path) -> EurocRecording:
    """Read ``mav0`` or the folder that holds it; InputError names what is missing."""
    root = source / "mav0" if (source / "mav0").is_dir() else source
    imus = sorted(root.glob("imu*/data.csv"))
    if not imus:
        raise InputError(
            f"{source} is no ASL recording: there is no imu0/data.csv; give the folder mav0."
        )
    warnings: list[str] = []
    table = _table(imus[0], 7)
    yaml = imus[0].with_name("sensor.yaml")
    files = [imus[0], *([yaml] if yaml.is_file() else [])]
    camera = _camera(root / "cam0", files, warnings)
    gps_file = root / "gps0" / "data.csv"
    gps = None
    if gps_file.is_file():
        gps = _table(gps_file, 4)
        files.append(gps_file)
    else:
        warnings.append(
            f"{root}: no positions on Earth (gps0); the format rarely has them, and without them "
            "there is no map"
        )
    return EurocRecording(
        path=root,
        imu_t_ns=table[0],
        gyro=table[1][:, :3],
        accel=table[1][:, 3:6],
        T_body_imu=_transform(_text(yaml)) if yaml.is_file() else None,
        camera=camera,
        gps_t_ns=None if gps is None else gps[0],
        gps=None if gps is None else gps[1][:, :3],
        files=tuple(files),
        warnings=tuple(warnings),
    )


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); copy it again.") from error


def _table(path: Path, columns: int) -> tuple[IntArray, FloatArray]:
    """Stamps in ns [n] and the numbers after them [n, columns - 1]."""
    stamps: list[int] = []
    rows: list[list[float]] = []
    bad = 0
    for line in _text(path).splitlines():
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = line.split(",")
        try:
            row = [float(v) for v in cells[1:columns]]
            if len(row) != columns - 1 or not np.isfinite(row).all():
                raise ValueError
            stamps.append(int(cells[0]))
            rows.append(row)
        except ValueError:
            bad += 1
    if len(rows) < 2 or bad > len(rows):
        raise InputError(
            f"{path}: {len(rows)} lines with a stamp and {columns - 1} numbers, {bad} without; it "
            "is damaged or of another kind, copy it again."
        )
    return np.array(stamps, np.int64), np.array(rows)


def _numbers(text: str, key: str) -> list[float]:
    match = re.search(rf"^\s*{key}\s*:\s*\[([^\]]*)\]", text, re.MULTILINE)
    if not match:
        return []
    try:
        return [float(v) for v in match[1].replace("\n", " ").split(",")]
    except ValueError:
        return []


def _transform(text: str) -> FloatArray | None:
    """``T_BS`` [4, 4] of a sensor.yaml."""
    match = re.search(r"T_BS\s*:.*?data\s*:\s*\[([^\]]*)\]", text, re.DOTALL)
    if not match:
        return None
    try:
        values = [float(v) for v in match[1].replace("\n", " ").split(",")]
    except ValueError:
        return None
    return np.array(values).reshape(4, 4) if len(values) == 16 else None


def _camera(folder: Path, files: list[Path], warnings: list[str]) -> EurocCamera | None:
    listing = folder / "data.csv"
    if not listing.is_file():
        warnings.append(f"{folder}: no data.csv; the drive has no video")
        return None
    images, stamps, missing = [], [], 0
    for line in _text(listing).splitlines():
        cells = [cell.strip() for cell in line.split(",")]
        if line.lstrip().startswith("#") or len(cells) < 2 or not cells[0].isdigit():
            continue
        path = folder / "data" / Path(cells[1]).name
        if path.is_file():
            images.append(path)
            stamps.append(int(cells[0]))
        else:
            missing += 1
    if missing:
        warnings.append(f"{folder}: {missing} images that data.csv names are not there")
    if not images:
        return None
    matrix, transform = None, None
    distortion: tuple[float, ...] = ()
    yaml = folder / "sensor.yaml"
    if yaml.is_file():
        text = _text(yaml)
        files.append(yaml)
        intrinsics = _numbers(text, "intrinsics")
        if len(intrinsics) == 4:
            fu, fv, cu, cv = intrinsics
            matrix = np.array([[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]])
        model = re.search(r"^\s*distortion_model\s*:\s*(\S+)", text, re.MULTILINE)
        coefficients = _numbers(text, "distortion_coefficients")
        if model and model[1].strip("\"'") in _OPENCV_MODELS and len(coefficients) in (4, 5):
            distortion = tuple(coefficients)
        elif any(coefficients):
            warnings.append(f"{yaml}: a distortion model that is not OpenCV's is left out")
        transform = _transform(text)
    files.append(listing)
    return EurocCamera(tuple(images), np.array(stamps, np.int64), matrix, distortion, transform)
