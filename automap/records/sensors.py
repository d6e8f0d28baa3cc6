"""What inertial sensor, receiver and wheels recorded, and what a calibration says of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from automap.records.arrays import FloatArray, IntArray


class FixType(IntEnum):
    """How a position was obtained, in order of trust."""

    NONE = 0
    DEAD_RECKONING = 1
    TWO_D = 2
    THREE_D = 3
    DGNSS = 4
    FLOAT = 5
    FIXED = 6


@dataclass(frozen=True)
class ImuData:
    """Inertial readings in SI units.

    ``gyro`` [n, 3] rad/s and ``accel`` [n, 3] m/s^2 (specific force) are in vehicle axes
    (FRD) when ``axes_known``, otherwise in the sensor's own axes. ``t_ns`` [n] strictly
    increases. ``temp_c`` is None when the recording has no temperature.
    """

    t_ns: IntArray
    gyro: FloatArray
    accel: FloatArray
    temp_c: FloatArray | None = None
    axes_known: bool = True

    def __len__(self) -> int:
        return len(self.t_ns)

    def at(self, rows: slice) -> ImuData:
        """Some of the readings."""
        temp_c = None if self.temp_c is None else self.temp_c[rows]
        return ImuData(self.t_ns[rows], self.gyro[rows], self.accel[rows], temp_c, self.axes_known)


@dataclass(frozen=True)
class RawImu:
    """Inertial readings as logged, in the sensor's own axes and units, for calibration.

    ``t_ns`` [n] strictly increases; ``gyro``, ``accel`` [n, 3] are in ``gyro_unit`` ("rad/s",
    "deg/s", "counts") and ``accel_unit`` ("m/s^2", "g", "counts"). ``temp_c`` [n] or None.
    ``gyro_scale``, ``accel_scale`` [3] are the data sheet's SI value of one reading unit, None
    for counts of an unknown sensor; ``gyro_zero``, ``accel_zero`` [3] its reading at zero input,
    None for zero. ``name`` is what messages call the log.
    """

    t_ns: IntArray
    gyro: FloatArray
    accel: FloatArray
    gyro_unit: str = "rad/s"
    accel_unit: str = "m/s^2"
    gyro_scale: FloatArray | None = None
    accel_scale: FloatArray | None = None
    gyro_zero: FloatArray | None = None
    accel_zero: FloatArray | None = None
    temp_c: FloatArray | None = None
    name: str = "the log"

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def t_s(self) -> FloatArray:
        """Seconds [n] since the first sample."""
        return np.asarray((self.t_ns - self.t_ns[0]) * 1e-9)

    @property
    def rate_hz(self) -> float:
        """Samples a second, by the median step."""
        return float(1e9 / np.median(np.diff(self.t_ns)))


@dataclass(frozen=True)
class TriadCalibration:
    """true = matrix @ (scale * reading + bias), reading in the log's own unit.

    ``scale`` [3] SI per reading unit, ``bias`` [3] SI, ``matrix`` [3, 3]; ``angles_sd`` rad how
    exactly that turns the axes right, NaN when nobody measured it.
    """

    scale: FloatArray
    bias: FloatArray
    matrix: FloatArray
    angles_sd: float = math.nan

    def apply(self, reading: FloatArray) -> FloatArray:
        """Readings [n, 3] to true values [n, 3] in SI units, in the accelerometer's axes."""
        return np.asarray((reading * self.scale + self.bias) @ self.matrix.T, dtype=np.float64)


@dataclass(frozen=True)
class ImuCalibration:
    """Both triads; ``accel_unit`` and ``gyro_unit`` are those of the log that was used to
    calibrate, None when the file does not say. ``g_sensitivity`` [3, 3] (rad/s)/(m/s^2) is
    what the gyro reads of specific force, in the accelerometer's axes."""

    accel: TriadCalibration
    gyro: TriadCalibration
    accel_unit: str | None = None
    gyro_unit: str | None = None
    g_sensitivity: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))

    def apply(self, gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rates [n, 3] rad/s and forces [n, 3] m/s^2 of readings [n, 3] in the log's units."""
        force = self.accel.apply(accel)
        return self.gyro.apply(gyro) - force @ self.g_sensitivity.T, force


@dataclass(frozen=True)
class Fixes:
    """Receiver epochs, one row each, in the order of the log.

    ``gps_s`` [n] GPS time of the epoch. ``lat_rad, lon_rad, height_m`` [n] (ellipsoidal
    height; NaN where unknown). ``vel_ned`` [n, 3] m/s (a component is NaN where the source
    has none, e.g. the vertical one with RMC only). ``sd_pos_ned``, ``sd_vel_ned`` [n, 3]
    the receiver's own one-sigma figures, NaN where it gave none. ``fix_type`` [n] values of
    FixType. ``n_sats`` [n] (-1 unknown). ``hdop`` [n]. ``geoid_sep_m`` [n] height of the
    geoid above the ellipsoid. ``offset`` [n] byte offset in the log of the epoch's first
    message (-1 where it makes no sense). ``arrival_ns`` [n] host time at which that byte
    arrived (int64 min where unknown).
    """

    gps_s: FloatArray
    lat_rad: FloatArray
    lon_rad: FloatArray
    height_m: FloatArray
    vel_ned: FloatArray
    sd_pos_ned: FloatArray
    sd_vel_ned: FloatArray
    fix_type: IntArray
    n_sats: IntArray
    hdop: FloatArray
    geoid_sep_m: FloatArray
    offset: IntArray
    arrival_ns: IntArray

    def __len__(self) -> int:
        return len(self.gps_s)


@dataclass(frozen=True)
class FixErrors:
    """Errors of a recorded receiver at epochs ``gps_s`` [n], increasing.

    ``position`` [n, 3] m NED; ``velocity`` [n, 3] m/s along the direction of travel, across to its
    right, down, NaN where the receiver says nothing, against speeds and courses ``speed_delay_s``
    and ``course_delay_s`` ago.
    """

    gps_s: FloatArray
    position: FloatArray
    velocity: FloatArray
    speed_delay_s: float = 0.0
    course_delay_s: float = 0.0

    def __len__(self) -> int:
        return len(self.gps_s)


@dataclass(frozen=True)
class WheelSpeed:
    """Speed of the wheels or of the CAN bus: ``t_ns`` [n] increasing, ``speed`` [n] m/s."""

    t_ns: IntArray
    speed: FloatArray

    def __len__(self) -> int:
        return len(self.t_ns)
