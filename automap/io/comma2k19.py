"""One segment of comma2k19: IMU, receiver positions, wheel speed and reference poses.

The arrays are NumPy files without the usual suffix; all times are seconds since the phone
started. Layout and units: H. Schafer et al., "A Commute in Data: The comma2k19 Dataset",
arXiv:1812.05752, and the data set's own README.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from automap.earth import ecef_axes
from automap.errors import InputError
from automap.io.nmea_writer import Positions, nmea_positions, unknown
from automap.records import FloatArray, IntArray

_NO_ARRAY = (ValueError, OSError, EOFError, OverflowError, SyntaxError, MemoryError, TokenError)
"""What NumPy raises for files that are none of its."""
_LOG = "processed_log"
_POSE = "global_pose"
_MOST_S = 9.0e9
"""More seconds do not fit into the nanoseconds of 64 bits."""


@dataclass(frozen=True)
class LiveFixes:
    """What the receiver reported, one row an epoch [n].

    ``arrival_ns`` when the phone got it, ``unix_ms`` the UTC tag; ``height_m`` is above the
    ellipsoid (against the reference it is off by a metre, not by the geoid's 32).
    """

    arrival_ns: IntArray
    unix_ms: IntArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    height_m: FloatArray
    speed_m_s: FloatArray
    course_deg: FloatArray


@dataclass(frozen=True)
class Reference:
    """Poses of the phone's camera [n] from the data set's own processing.

    ``t_ns`` the frame's stamp, ``lat_deg, lon_deg, height_m``, ``vel_ned`` [n, 3] m/s,
    ``rpy_deg`` [n, 3] of the phone (forward, right, down).
    """

    t_ns: IntArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    height_m: FloatArray
    vel_ned: FloatArray
    rpy_deg: FloatArray


@dataclass(frozen=True)
class Segment:
    """A segment as recorded. ``accel`` m/s^2 and ``gyro`` rad/s [n, 3], forward-right-down.

    ``speed_t_ns`` and ``speed_m_s`` [k] come from the car's bus; they and ``reference`` are
    None where the segment has none. ``video`` is the raw HEVC stream, if it is there.
    """

    path: Path
    imu_t_ns: IntArray
    gyro: FloatArray
    accel: FloatArray
    live: LiveFixes
    speed_t_ns: IntArray | None
    speed_m_s: FloatArray | None
    reference: Reference | None
    frame_t_ns: IntArray | None
    video: Path | None
    warnings: tuple[str, ...]


def find_segment(source: Path) -> Path:
    """The segment in ``source``: the folder itself, or the only one in it.

    Raises InputError when there is none, or more than one to choose from.
    """
    source = Path(source)
    if not source.is_dir():
        raise InputError(f"{source}: there is no such folder; give a comma2k19 segment.")
    if (source / _LOG).is_dir():
        return source
    inside = sorted(path.parent for path in source.glob(f"*/{_LOG}") if path.is_dir())
    if len(inside) == 1:
        return inside[0]
    if inside:
        some = ", ".join(path.name for path in inside[:4])
        raise InputError(
            f"{source} holds {len(inside)} segments ({some} ...); name one, a drive is made of "
            "one segment."
        )
    raise InputError(
        f"{source} is no comma2k19 segment: it has no folder {_LOG}; give the folder that holds "
        f"{_LOG} and {_POSE}."
    )


def read_segment(source: Path) -> Segment:
    """Read the segment in ``source``; InputError names what is missing or damaged."""
    path = find_segment(source)
    log = path / _LOG
    warnings: list[str] = []
    imu_t_ns, gyro, accel = _imu(log / "IMU", warnings)
    live = _live(log / "GNSS" / "live_gnss_ublox", warnings)
    speed_t_ns, speed = _speed(log / "CAN" / "speed", warnings)
    frame_times = _optional(path / _POSE / "frame_times")
    frames = (
        None if frame_times is None else _nanoseconds(frame_times, path / _POSE / "frame_times")
    )
    video = path / "video.hevc"
    return Segment(
        path=path,
        imu_t_ns=imu_t_ns,
        gyro=gyro,
        accel=accel,
        live=live,
        speed_t_ns=speed_t_ns,
        speed_m_s=speed,
        reference=_reference(path / _POSE, warnings),
        frame_t_ns=frames,
        video=video if video.is_file() else None,
        warnings=tuple(warnings),
    )


def _array(path: Path, columns: int | None = None) -> FloatArray:
    """A float array [n] or [n, columns]; the file may or may not have the suffix .npy."""
    for candidate in (path, path.with_name(path.name + ".npy")):
        if candidate.is_file():
            break
    else:
        raise InputError(f"{path} is missing; the segment is not complete.")
    try:
        with warnings.catch_warnings():
            # headers of Python 2 are told of, and are read
            warnings.simplefilter("ignore", UserWarning)
            values: Any = np.load(candidate, allow_pickle=False)
        values = np.asarray(values, np.float64)
    except _NO_ARRAY as error:
        raise InputError(f"{candidate} is not a NumPy array ({error}); copy it again.") from error
    wanted = (len(values),) if columns is None and values.ndim else (len(values), columns)
    if values.ndim == 2 and values.shape[1] == 1 and columns is None:
        values = values[:, 0]
    if values.shape != wanted or len(values) == 0:
        shape = "one column" if columns is None else f"{columns} columns"
        raise InputError(f"{candidate} has the shape {values.shape}; {shape} are expected.")
    return np.asarray(values, np.float64)


def _optional(path: Path, columns: int | None = None) -> FloatArray | None:
    if path.is_file() or path.with_name(path.name + ".npy").is_file():
        return _array(path, columns)
    return None


def _channel(folder: Path, columns: int | None) -> tuple[FloatArray, FloatArray]:
    """Times [n] and values of one channel, rows with anything not finite left out."""
    t, value = _array(folder / "t"), _array(folder / "value", columns)
    if len(t) != len(value):
        raise InputError(f"{folder}: t has {len(t)} rows and value {len(value)}; copy them again.")
    good = (np.abs(t) < _MOST_S) & np.isfinite(value.reshape(len(t), -1)).all(axis=1)
    return t[good], value[good]


def _nanoseconds(seconds: FloatArray, path: Path) -> IntArray:
    if not (np.abs(seconds) < _MOST_S).all():
        raise InputError(f"{path} holds a time that is no number of seconds; copy it again.")
    return np.asarray(np.rint(seconds * 1e9), np.int64)


def _imu(folder: Path, warnings: list[str]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Stamps, gyro (uncalibrated: what the sensor measured) and accelerometer."""
    t, accel = _channel(folder / "accelerometer", 3)
    t_gyro, gyro = _channel(folder / "gyro_uncalibrated", 3)
    if len(t) != len(t_gyro) or not np.array_equal(t, t_gyro):
        inside = (t >= t_gyro[0]) & (t <= t_gyro[-1])
        order = np.argsort(t_gyro, kind="stable")
        t, accel = t[inside], accel[inside]
        gyro = np.column_stack([np.interp(t, t_gyro[order], gyro[order, i]) for i in range(3)])
        warnings.append(
            f"{folder}: accelerometer and gyro have stamps of their own; the gyro was "
            "interpolated to the accelerometer's"
        )
    if len(t) == 0:
        raise InputError(f"{folder}: accelerometer and gyro share no time; copy them again.")
    return _nanoseconds(t, folder), gyro, accel


def _live(folder: Path, warnings: list[str]) -> LiveFixes:
    t, value = _channel(folder, 6)
    if len(t) and np.abs(value[:, 3]).max() > 1e3 * _MOST_S:
        raise InputError(f"{folder / 'value'}: its times are no Unix milliseconds; copy it again.")
    if len(t) == 0:
        raise InputError(f"{folder} holds no position; the segment cannot be used.")
    lost = len(_array(folder / "t")) - len(t)
    if lost:
        warnings.append(f"{folder}: {lost} rows with a value that is no number were left out")
    return LiveFixes(
        arrival_ns=_nanoseconds(t, folder),
        unix_ms=np.asarray(np.rint(value[:, 3]), np.int64),
        lat_deg=value[:, 0],
        lon_deg=value[:, 1],
        height_m=value[:, 4],
        speed_m_s=value[:, 2],
        course_deg=np.mod(value[:, 5], 360.0),
    )


def _speed(folder: Path, warnings: list[str]) -> tuple[IntArray | None, FloatArray | None]:
    if not folder.is_dir():
        warnings.append(f"{folder} is missing; the car's own speed is not imported")
        return None, None
    t, value = _channel(folder, None)
    return _nanoseconds(t, folder), value


def _reference(folder: Path, warnings: list[str]) -> Reference | None:
    if not folder.is_dir():
        warnings.append(f"{folder} is missing; the drive has no truth")
        return None
    import pymap3d
    from scipy.spatial.transform import Rotation

    t = _array(folder / "frame_times")
    position = _array(folder / "frame_positions", 3)
    velocity = _array(folder / "frame_velocities", 3)
    quaternion = _array(folder / "frame_orientations", 4)
    count = min(len(t), len(position), len(velocity), len(quaternion))
    good = np.isfinite(
        np.column_stack([t[:count], position[:count], velocity[:count], quaternion[:count]])
    ).all(axis=1)
    t, position, velocity = t[:count][good], position[:count][good], velocity[:count][good]
    quaternion = quaternion[:count][good]
    lat, lon, height = pymap3d.ecef2geodetic(*position.T)
    c_n_e = np.swapaxes(ecef_axes(np.radians(lat), np.radians(lon)), 1, 2)
    # scalar first, from the phone's axes to ECEF
    c_e_b = Rotation.from_quat(quaternion[:, [1, 2, 3, 0]]).as_matrix()
    yaw_pitch_roll = Rotation.from_matrix(c_n_e @ c_e_b).as_euler("ZYX", degrees=True)
    return Reference(
        t_ns=_nanoseconds(t, folder),
        lat_deg=np.asarray(lat, np.float64),
        lon_deg=np.asarray(lon, np.float64),
        height_m=np.asarray(height, np.float64),
        vel_ned=np.einsum("nij,nj->ni", c_n_e, velocity),
        rpy_deg=yaw_pitch_roll[:, ::-1],
    )


def nmea_log(live: LiveFixes) -> tuple[bytes, IntArray]:
    """The live fixes as a receiver would have sent them, and the byte where each starts [n].

    What the data set does not say stays empty: vertical velocity, accuracy, number of
    satellites, separation of the geoid.
    """
    n = len(live.unix_ms)
    return nmea_positions(
        Positions(
            unix_ms=live.unix_ms,
            lat_deg=live.lat_deg,
            lon_deg=live.lon_deg,
            height_m=live.height_m,
            speed_m_s=live.speed_m_s,
            course_deg=live.course_deg,
            down_m_s=unknown(n),
            h_acc_m=unknown(n),
            v_acc_m=unknown(n),
            hdop=unknown(n),
            fix=np.full(n, 3),
        )
    )
