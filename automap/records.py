"""What passes between modules: small frozen records of plain arrays.

Shapes are given as ``[n]`` and ``[n, 3]``; all floats are float64. A value that the
source did not give is NaN. Nothing here knows about files.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


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
class WheelSpeed:
    """Speed of the wheels or of the CAN bus: ``t_ns`` [n] increasing, ``speed`` [n] m/s."""

    t_ns: IntArray
    speed: FloatArray

    def __len__(self) -> int:
        return len(self.t_ns)


NO_TIME = np.iinfo(np.int64).min
"""Marks an unknown int64 time stamp."""


@dataclass(frozen=True)
class ClockModel:
    """Host clock to GPS time: ``gps_s = ref_gps_s + (1 + drift) * (t_ns - ref_ns) * 1e-9``.

    ``sd_offset_s`` and ``sd_drift`` are one sigma at the reference. ``method`` says how it
    was found ("arrival", "identity", "unix", "correlation").
    ``output_delay_s`` is what was taken for the receiver's least output delay, None when it
    is unknown and left to the fusion to estimate.
    """

    ref_ns: int
    ref_gps_s: float
    drift: float
    sd_offset_s: float
    sd_drift: float
    method: str
    output_delay_s: float | None = None

    def gps_s(self, t_ns: npt.NDArray[np.int64]) -> FloatArray:
        """GPS seconds [n] of host stamps [n]."""
        dt = (np.asarray(t_ns, np.int64) - self.ref_ns) * 1e-9
        return np.asarray(self.ref_gps_s + (1.0 + self.drift) * dt, dtype=np.float64)

    def t_ns(self, gps_s: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Host stamps [n] of GPS seconds [n], rounded to the nanosecond."""
        dt = (np.asarray(gps_s, np.float64) - self.ref_gps_s) / (1.0 + self.drift)
        return self.ref_ns + np.rint(dt * 1e9).astype(np.int64)


@dataclass(frozen=True)
class Trajectory:
    """Vehicle trajectory at the IMU origin, with one-sigma uncertainties.

    ``t_ns`` [n], ``gps_s`` [n], ``lat_rad``, ``lon_rad``, ``height_m`` [n], ``vel_ned``
    [n, 3], ``rpy`` [n, 3] roll, pitch, yaw of the vehicle (ZYX, rad), ``sd_pos_ned``,
    ``sd_vel_ned``, ``sd_rpy`` [n, 3] (sd_rpy in rad).
    """

    t_ns: IntArray
    gps_s: FloatArray
    lat_rad: FloatArray
    lon_rad: FloatArray
    height_m: FloatArray
    vel_ned: FloatArray
    rpy: FloatArray
    sd_pos_ned: FloatArray
    sd_vel_ned: FloatArray
    sd_rpy: FloatArray

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True)
class Detections:
    """Boxes of signs in frames, one row each.

    ``frame`` [n] counts from 0 over all chapters; ``t_ns`` [n] the frame's stamp; ``class_name``
    [n] str; ``box`` [n, 4] x_min, y_min, x_max, y_max in pixels; ``score`` [n] in 0..1;
    ``track`` [n] (-1 untracked); ``camera`` the name of the video section. ``view_class`` [n] is
    what the single view looks like where ``class_name`` is that of the whole track, None where
    there is no such difference.
    """

    frame: IntArray
    t_ns: IntArray
    class_name: npt.NDArray[np.object_]
    box: FloatArray
    score: FloatArray
    track: IntArray
    camera: str = "front"
    view_class: npt.NDArray[np.object_] | None = None

    def __len__(self) -> int:
        return len(self.frame)


@dataclass(frozen=True)
class Camera:
    """Pinhole camera with OpenCV distortion, mounted on the vehicle.

    ``matrix`` [3, 3], ``distortion`` [k] OpenCV order, ``lever_arm_m`` [3] IMU to camera in
    body axes, ``mount_rpy`` [3] rad (C_body_cam = Rz(yaw) Ry(pitch) Rx(roll), camera axes
    forward, right, down), ``mount_sd`` rad, ``time_offset_s`` added to frame stamps.
    """

    width: int
    height: int
    matrix: FloatArray
    distortion: FloatArray
    lever_arm_m: FloatArray
    mount_rpy: FloatArray
    mount_sd: float
    time_offset_s: float
    time_offset_sd: float


@dataclass(frozen=True)
class Sign:
    """One located sign. Position WGS-84; covariance [3, 3] in ENU metres, trajectory included.

    ``support`` names the post or gantry, the same for all signs on it ("" unknown).
    """

    id: str
    class_name: str
    lat_rad: float
    lon_rad: float
    height_m: float
    cov_enu: FloatArray
    confidence: float
    n_views: int
    first_seen_ns: int
    last_seen_ns: int
    height_above_road_m: float
    facing_rad: float
    size_m: float
    side: str
    status: str = "ok"
    drives: tuple[str, ...] = ()
    detection_rows: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    support: str = ""
