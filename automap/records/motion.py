"""Where the vehicle went."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from automap.records.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Trajectory:
    """Vehicle trajectory at the IMU origin, with one-sigma uncertainties.

    ``t_ns`` [n], ``gps_s`` [n], ``lat_rad``, ``lon_rad``, ``height_m`` [n], ``vel_ned``
    [n, 3], ``rpy`` [n, 3] roll, pitch, yaw of the vehicle (ZYX, rad), ``sd_pos_ned``,
    ``sd_vel_ned``, ``sd_rpy`` [n, 3] (sd_rpy in rad). ``slip_sd`` [n] rad (one number stands for
    all) is what the sigma of the yaw has in it since the vehicle's nose is off its course for
    minutes, NaN where whoever made the trajectory does not say.
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
    slip_sd: FloatArray = field(default_factory=lambda: np.array(np.nan))

    def __post_init__(self) -> None:
        every = np.broadcast_to(self.slip_sd, np.shape(self.t_ns))
        object.__setattr__(self, "slip_sd", every)

    def __len__(self) -> int:
        return len(self.t_ns)

    def at(self, rows: slice | IntArray) -> Trajectory:
        """Some of the rows."""
        return Trajectory(**{name: values[rows] for name, values in vars(self).items()})


def along_course(sd_rpy: FloatArray, slip_sd: FloatArray) -> FloatArray:
    """Sigmas [n, 3] of roll, pitch and yaw, rad, without what the yaw's have, ``slip_sd`` [n] (NaN
    none), for a nose that is off its course for minutes. A camera's own turn is told against that
    course, so that it is no error of its yaw."""
    rest = np.maximum(sd_rpy[:, 2] ** 2 - np.nan_to_num(slip_sd) ** 2, 0.0)
    return np.column_stack([sd_rpy[:, :2], np.sqrt(rest)])


@dataclass(frozen=True)
class DrivePath:
    """A trajectory thinned to one row every few metres.

    ``gps_s``, ``lat_rad``, ``lon_rad``, ``yaw_rad`` [k] (of the vehicle, clockwise from
    north) and ``sd_enu`` [k, 3] m.
    """

    gps_s: FloatArray
    lat_rad: FloatArray
    lon_rad: FloatArray
    yaw_rad: FloatArray
    sd_enu: FloatArray

    def __len__(self) -> int:
        return len(self.lat_rad)
