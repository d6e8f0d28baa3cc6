"""Calibration files of an inertial sensor, ``imu_calibration.toml``, and how they apply."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import ConfigError
from automap.records import FloatArray

SCHEMA = "automap.imu-calibration/1"


@dataclass(frozen=True)
class TriadCalibration:
    """true = matrix @ (scale * reading + bias), reading in the log's own unit.

    ``scale`` [3] SI per reading unit, ``bias`` [3] SI, ``matrix`` [3, 3].
    """

    scale: FloatArray
    bias: FloatArray
    matrix: FloatArray

    def apply(self, reading: FloatArray) -> FloatArray:
        """Readings [n, 3] to true values [n, 3] in SI units, in the accelerometer's axes."""
        return np.asarray((reading * self.scale + self.bias) @ self.matrix.T, dtype=np.float64)


@dataclass(frozen=True)
class ImuCalibration:
    """Both triads; ``accel_unit`` and ``gyro_unit`` are those of the log that was used to
    calibrate, None when the file does not say."""

    accel: TriadCalibration
    gyro: TriadCalibration
    accel_unit: str | None = None
    gyro_unit: str | None = None


def read_imu_calibration(path: Path) -> ImuCalibration:
    """Read what ``automap calibrate`` wrote; ConfigError with file and key when it is wrong.

    The accelerometer's matrix is T = [[1, -m0, m1], [0, 1, -m2], [0, 0, 1]].
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} cannot be read as UTF-8 text: {error}.") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}; correct that place.") from None
    if data.get("schema") != SCHEMA:
        raise ConfigError(f'{path}: the line schema = "{SCHEMA}" is missing; calibrate again.')
    m0, m1, m2 = _numbers(path, data, "accel", "misalignment", (3,), np.zeros(3))
    T = np.array([[1.0, -m0, m1], [0.0, 1.0, -m2], [0.0, 0.0, 1.0]])
    conditions = data.get("conditions", {})
    return ImuCalibration(
        accel=TriadCalibration(
            _scale(path, data, "accel"), _numbers(path, data, "accel", "bias", (3,)), T
        ),
        gyro=TriadCalibration(
            _scale(path, data, "gyro"),
            _numbers(path, data, "gyro", "bias", (3,)),
            _numbers(path, data, "gyro", "matrix", (3, 3), np.eye(3)),
        ),
        accel_unit=conditions.get("accel_unit"),
        gyro_unit=conditions.get("gyro_unit"),
    )


def _scale(path: Path, data: dict[str, Any], section: str) -> FloatArray:
    scale = _numbers(path, data, section, "scale", (3,))
    if np.any(scale == 0):
        raise ConfigError(f"{path}: {section}.scale holds a zero; calibrate again.")
    return scale


def _numbers(
    path: Path,
    data: dict[str, Any],
    section: str,
    key: str,
    shape: tuple[int, ...],
    default: FloatArray | None = None,
) -> FloatArray:
    table = data.get(section)
    value = table.get(key) if isinstance(table, dict) else None
    if value is None and default is not None:
        return default
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape != shape or not np.all(np.isfinite(numbers)):
        size = " x ".join(str(n) for n in shape)
        raise ConfigError(f"{path}: {section}.{key} must be {size} finite numbers.")
    return numbers
