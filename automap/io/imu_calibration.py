"""Calibration files of an inertial sensor, ``imu_calibration.toml``: read, applied, written."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import ConfigError
from automap.io.atomic import write_text
from automap.io.toml_file import read_toml, toml_value
from automap.records import FloatArray, ImuCalibration, TriadCalibration

SCHEMA = "automap.imu-calibration/1"
_ANGLES = {"accel": slice(6, 9), "gyro": slice(6, 12)}
"""Rows of a covariance that are angles between axes, behind scale and bias."""


def read_imu_calibration(path: Path) -> ImuCalibration:
    """Read what ``automap calibrate`` wrote; ConfigError with file and key when it is wrong.

    The accelerometer's matrix is T = [[1, -m0, m1], [0, 1, -m2], [0, 0, 1]].
    """
    data = read_toml(path)
    if data.get("schema") != SCHEMA:
        raise ConfigError(f'{path}: the line schema = "{SCHEMA}" is missing; calibrate again.')
    m0, m1, m2 = _numbers(path, data, "accel", "misalignment", (3,), np.zeros(3))
    T = np.array([[1.0, -m0, m1], [0.0, 1.0, -m2], [0.0, 0.0, 1.0]])
    conditions = data.get("conditions", {})
    return ImuCalibration(
        accel=TriadCalibration(
            _scale(path, data, "accel"),
            _numbers(path, data, "accel", "bias", (3,)),
            T,
            _angles_sd(path, data, "accel"),
        ),
        gyro=TriadCalibration(
            _scale(path, data, "gyro"),
            _numbers(path, data, "gyro", "bias", (3,)),
            _numbers(path, data, "gyro", "matrix", (3, 3), np.eye(3)),
            _angles_sd(path, data, "gyro"),
        ),
        accel_unit=conditions.get("accel_unit"),
        gyro_unit=conditions.get("gyro_unit"),
        g_sensitivity=_numbers(path, data, "gyro", "g_sensitivity", (3, 3), np.zeros((3, 3))),
    )


def write_imu_calibration(path: Path, sections: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the sections (``accel``, ``gyro``, ``conditions``, ...) whole or not at all.

    Values are texts, numbers, truth values and arrays of any depth; numbers keep all digits.
    """
    lines = [f'schema = "{SCHEMA}"']
    for name, table in sections.items():
        lines += ["", f"[{name}]"]
        lines += [f"{key} = {_written(value)}" for key, value in table.items() if value is not None]
    write_text(path, "\n".join(lines) + "\n")


def _written(value: Any) -> str:
    """A value of a section, a matrix with a line for each row."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple) and value and isinstance(value[0], list | tuple):
        return "[\n" + "".join(f"  {toml_value(row)},\n" for row in value) + "]"
    return toml_value(value)


def _scale(path: Path, data: dict[str, Any], section: str) -> FloatArray:
    scale = _numbers(path, data, section, "scale", (3,))
    if np.any(scale == 0):
        raise ConfigError(f"{path}: {section}.scale holds a zero; calibrate again.")
    return scale


def _angles_sd(path: Path, data: dict[str, Any], section: str) -> float:
    """The largest sigma, rad, of a triad's angles by its covariance; NaN where the file has none,
    or zeros because nothing measured them."""
    covariance = data.get(section, {}).get("covariance")
    if covariance is None:
        return math.nan
    angles = _ANGLES[section]
    size = max(len(covariance) if isinstance(covariance, list) else 0, angles.stop)
    variances = np.diag(_numbers(path, data, section, "covariance", (size, size)))[angles]
    return float(np.sqrt(variances.max())) if np.all(variances > 0.0) else math.nan


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
