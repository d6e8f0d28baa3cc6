"""Which logs a calibration reads, and the gravity of the place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.errors import ConfigError
from automap.records import ImuCalibration, TriadCalibration

if TYPE_CHECKING:
    from automap.io.imu_log import ImuLog


@dataclass(frozen=True)
class LogSource:
    """Where the readings are: ``logs``, or one file of each sensor; and how to read them."""

    logs: tuple[Path, ...] = ()
    accel: Path | None = None
    gyro: Path | None = None
    columns: tuple[str, ...] = ()
    rate_hz: float | None = None
    gyro_unit: str | None = None
    accel_unit: str | None = None
    sensor: str | None = None


def read_logs(source: LogSource) -> list[ImuLog]:
    """Read all logs of a source; ConfigError when none, or only half of a pair, is named."""
    from automap.io.imu_log import LogFormat, read_imu_log, read_imu_pair
    from automap.io.sensor_file import find_sensor, read_sensor

    sensor = None if source.sensor is None else read_sensor(find_sensor(source.sensor))
    form = LogFormat(source.columns, source.rate_hz, source.gyro_unit, source.accel_unit, sensor)
    logs = [read_imu_log(path, form) for path in source.logs]
    if (source.accel is None) != (source.gyro is None):
        raise ConfigError("--accel and --gyro go together: name both files, or a single LOG.")
    if source.accel is not None and source.gyro is not None:
        logs.append(read_imu_pair(source.accel, source.gyro, form))
    if not logs:
        raise ConfigError("no log is named; give a LOG, or --accel FILE and --gyro FILE.")
    units = {(log.data.gyro_unit, log.data.accel_unit) for log in logs}
    if len(units) > 1:
        raise ConfigError("the logs are in different units; calibrate them one by one.")
    return logs


def local_gravity(
    gravity: float | None, place: tuple[float, float] | None
) -> tuple[float, list[str]]:
    """Gravity in m/s^2 as given, or of a place (latitude deg, height m), or the standard one.

    Returns it with a warning when neither is given.
    """
    if gravity is not None:
        if not 9.7 < gravity < 9.9:
            raise ConfigError(f"--gravity {gravity:g} is not the Earth's; it lies near 9.8 m/s^2.")
        return gravity, []
    if place is not None:
        from automap.earth import gravity as normal_gravity

        return float(normal_gravity(np.radians(place[0]), place[1])), []
    return STANDARD_GRAVITY, [
        "neither --gravity nor --place is given: standard gravity is taken, and the "
        "accelerometer's scale may be off by up to 0.3 %"
    ]


def stated(log: ImuLog) -> ImuCalibration:
    """The data sheet's scale and zero as a calibration."""
    raw = log.data
    if raw.gyro_scale is None or raw.accel_scale is None:
        raise ConfigError(
            f"{raw.name} is in counts; name its static calibration with --calibration, or its "
            "data sheet with --sensor."
        )
    parts = []
    for scale, zero in ((raw.accel_scale, raw.accel_zero), (raw.gyro_scale, raw.gyro_zero)):
        bias = np.zeros(3) if zero is None else -scale * zero
        parts.append(TriadCalibration(scale, bias, np.eye(3)))
    return ImuCalibration(parts[0], parts[1])
