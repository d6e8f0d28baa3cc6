"""ROS 1 bags and ROS 2 recordings (MCAP, SQLite): the topics that a drive is made of.

Read by the package ``rosbags``. Definitions of messages are taken from the recording, so that
ublox_msgs needs no ROS. References: REP-103 (axes: x forward, y left, z up), sensor_msgs Imu,
NavSatFix (altitude above the ellipsoid, covariance east-north-up), CameraInfo.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import ConfigError, InputError
from automap.records import FixType, FloatArray, IntArray

IMU = ("sensor_msgs/msg/Imu",)
FIX = ("sensor_msgs/msg/NavSatFix",)
UBLOX = ("ublox_msgs/msg/NavPVT", "ublox_msgs/msg/NavPVT7")
VELOCITY = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped")
IMAGE = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
INFO = ("sensor_msgs/msg/CameraInfo",)

_VELOCITY_MATCH_S = 0.06


@dataclass(frozen=True)
class BagFixes:
    """Positions [n]: stamps of their headers, degrees, ellipsoidal height, fix, sigmas and
    velocity [n, 3] north-east-down (NaN where unknown)."""

    t_ns: IntArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    height_m: FloatArray
    fix_type: IntArray
    sd_pos_ned: FloatArray
    vel_ned: FloatArray
    sd_vel_ned: FloatArray

    def __len__(self) -> int:
        return len(self.t_ns)


class Bag:
    """An open recording; ``topics`` maps each topic to its message type and count."""

    def __init__(self, reader: Any, path: Path) -> None:
        self._reader = reader
        self.path = path
        self.topics: dict[str, tuple[str, int]] = {}
        for connection in reader.connections:
            kind, count = self.topics.get(connection.topic, (connection.msgtype, 0))
            self.topics[connection.topic] = (kind, count + connection.msgcount)

    def choose(self, kinds: tuple[str, ...], wanted: str | None, option: str) -> str | None:
        """The topic ``wanted``, else the one of these message types with most messages.

        Raises ConfigError when a wanted topic is not there or of another type.
        """
        found = {t: n for t, (kind, n) in self.topics.items() if kind in kinds and n}
        if wanted is not None:
            if wanted not in found:
                there = ", ".join(sorted(found)) or "none"
                raise ConfigError(
                    f"{option} {wanted}: no such topic of {kinds[0]} in {self.path}; of that kind "
                    f"there are: {there}."
                )
            return wanted
        return max(sorted(found), key=lambda t: found[t]) if found else None

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Stamp of the header in ns (of the recording where it is zero) and the message."""
        chosen = [c for c in self._reader.connections if c.topic == topic]
        for connection, received, data in self._reader.messages(connections=chosen):
            message = self._reader.deserialize(data, connection.msgtype)
            header = getattr(message, "header", None)
            stamp = 0 if header is None else header.stamp.sec * 10**9 + header.stamp.nanosec
            yield int(stamp or received), message


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a ``.bag``, an ``.mcap`` or the folder of a ROS 2 recording.

    Raises InputError, here or while messages are read, for anything that cannot be read.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    try:
        # what a ROS 2 recording does not define itself is as in the present release
        store = get_typestore(Stores.LATEST)
        with AnyReader(_parts(path), default_typestore=store) as reader:
            yield Bag(reader, path)
    except (InputError, ConfigError):
        raise
    except Exception as error:
        # the package raises its own errors and those of its decoders, and asserts
        raise InputError(
            f"{path} cannot be read as a ROS recording ({type(error).__name__}: {error}); repair "
            "it with rosbag reindex or ros2 bag reindex, or copy it again."
        ) from error


def _parts(path: Path) -> list[Path]:
    """What the reader opens: a folder of ROS 2, or the files in a folder without its metadata."""
    if not path.is_dir() or (path / "metadata.yaml").is_file():
        return [path]
    for suffix in (".bag", ".mcap", ".db3"):
        files = sorted(path.glob(f"*{suffix}"))
        if files:
            return files
    raise InputError(f"{path} holds no .bag, no .mcap and no ROS 2 recording; name one.")


def read_imu(bag: Bag, topic: str) -> tuple[IntArray, FloatArray, FloatArray]:
    """Stamps [n], gyro and specific force [n, 3] in rad/s and m/s^2."""
    stamps, rows = [], []
    for stamp, message in bag.messages(topic):
        w, f = message.angular_velocity, message.linear_acceleration
        stamps.append(stamp)
        rows.append((w.x, w.y, w.z, f.x, f.y, f.z))
    if not rows:
        raise InputError(f"{bag.path}: topic {topic} holds no message; name another.")
    values = np.array(rows, np.float64)
    return np.array(stamps, np.int64), values[:, :3], values[:, 3:]


def read_fixes(bag: Bag, topic: str, velocity_topic: str | None) -> BagFixes:
    """Positions of a NavSatFix topic, with the velocities (x east, y north, z up) of another."""
    stamps, rows, sds, kinds = [], [], [], []
    for stamp, message in bag.messages(topic):
        stamps.append(stamp)
        rows.append((message.latitude, message.longitude, message.altitude))
        covariance = np.asarray(message.position_covariance, np.float64)
        known = int(message.position_covariance_type) != 0
        variance = covariance[[4, 0, 8]] if known else np.full(3, np.nan)
        sds.append(np.sqrt(np.where(variance > 0.0, variance, np.nan)))
        # STATUS_NO_FIX -1, FIX 0, SBAS 1, GBAS 2 (which is RTK, fixed or not)
        status = int(message.status.status)
        kinds.append({-1: FixType.NONE, 1: FixType.DGNSS, 2: FixType.DGNSS}.get(status, 3))
    t_ns, place = np.array(stamps, np.int64), np.array(rows, np.float64).reshape(-1, 3)
    good = np.isfinite(place[:, :2]).all(axis=1)
    velocity, sd_velocity = (np.full((len(t_ns), 3), np.nan) for _ in range(2))
    if velocity_topic is not None:
        velocity, sd_velocity = _velocities(bag, velocity_topic, t_ns)
    return BagFixes(
        t_ns=t_ns,
        lat_deg=place[:, 0],
        lon_deg=place[:, 1],
        height_m=place[:, 2],
        fix_type=np.where(good, np.array(kinds, np.int64), 0),
        sd_pos_ned=np.array(sds, np.float64).reshape(-1, 3),
        vel_ned=velocity,
        sd_vel_ned=sd_velocity,
    )


def _velocities(bag: Bag, topic: str, t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Velocity and its sigmas north-east-down at the positions' stamps."""
    stamps, rows, sds = [], [], []
    for stamp, message in bag.messages(topic):
        twist, sd = message.twist, np.full(3, np.nan)
        if hasattr(twist, "twist"):
            variance = np.asarray(twist.covariance, np.float64)[[7, 0, 14]]
            sd = np.sqrt(np.where(variance > 0.0, variance, np.nan))
            twist = twist.twist
        stamps.append(stamp)
        rows.append((twist.linear.y, twist.linear.x, -twist.linear.z))
        sds.append(sd)
    velocity, sigma = (np.full((len(t_ns), 3), np.nan) for _ in range(2))
    if stamps:
        times = np.array(stamps, np.int64)
        order = np.argsort(times, kind="stable")
        times = times[order]
        right = np.clip(np.searchsorted(times, t_ns), 1, max(len(times) - 1, 1))
        right = np.minimum(right, len(times) - 1)
        left = np.maximum(right - 1, 0)
        nearest = np.where(np.abs(times[left] - t_ns) <= np.abs(times[right] - t_ns), left, right)
        near = np.abs(times[nearest] - t_ns) < _VELOCITY_MATCH_S * 1e9
        velocity[near] = np.array(rows, np.float64)[order][nearest[near]]
        sigma[near] = np.array(sds)[order][nearest[near]]
    return velocity, sigma


def read_ublox(bag: Bag, topic: str) -> tuple[IntArray, list[bytes]]:
    """NAV-PVT messages of ublox_msgs as the receiver sent them, and when each was recorded."""
    import struct

    from automap.io.ubx_writer import frame

    stamps, frames = [], []
    layout = struct.Struct("<IHBBBBBBIiBBBBiiiiIIiiiiiIIH")
    for stamp, m in bag.messages(topic):
        head = layout.pack(
            *(int(m.iTOW if hasattr(m, "iTOW") else m.i_tow), int(m.year), int(m.month)),
            *(int(m.day), int(m.hour), int(m.min), int(m.sec), int(m.valid)),
            *(int(_any(m, "tAcc", "t_acc")), int(m.nano)),
            *(int(_any(m, "fixType", "fix_type")), int(m.flags), int(m.flags2)),
            *(int(_any(m, "numSV", "num_sv")), int(m.lon), int(m.lat), int(m.height)),
            *(int(_any(m, "hMSL", "h_msl")), int(_any(m, "hAcc", "h_acc"))),
            *(int(_any(m, "vAcc", "v_acc")), int(_any(m, "velN", "vel_n"))),
            *(int(_any(m, "velE", "vel_e")), int(_any(m, "velD", "vel_d"))),
            *(int(_any(m, "gSpeed", "g_speed")), int(m.heading)),
            *(int(_any(m, "sAcc", "s_acc")), int(_any(m, "headAcc", "head_acc"))),
            int(_any(m, "pDOP", "p_dop")),
        )
        stamps.append(stamp)
        frames.append(frame(0x01, 0x07, head + bytes(92 - len(head))))
    return np.array(stamps, np.int64), frames


def _any(message: Any, *names: str) -> Any:
    """The first of these fields: ROS 1 and ROS 2 spell them differently."""
    for name in names:
        if hasattr(message, name):
            return getattr(message, name)
    raise InputError(f"a NavPVT message without {names[0]}; its definition is not known.")


def read_images(bag: Bag, topic: str) -> Iterator[tuple[int, bytes]]:
    """Stamps and JPEGs of an image topic; raises InputError for an encoding not known."""
    from automap.io.image_video import as_jpeg, encode_jpeg

    for stamp, message in bag.messages(topic):
        name = f"{bag.path}: an image of {topic}"
        if hasattr(message, "format"):
            yield stamp, as_jpeg(bytes(message.data), name)
        else:
            yield stamp, encode_jpeg(_pixels(message, name), name)


def _pixels(message: Any, name: str) -> np.ndarray:
    """Pixels, blue first, of a sensor_msgs/Image."""
    import cv2

    encoding = str(message.encoding).lower()
    codes = {
        "bgr8": (3, None),
        "8uc3": (3, None),
        "rgb8": (3, cv2.COLOR_RGB2BGR),
        "mono8": (1, None),
        "8uc1": (1, None),
        "bgra8": (4, cv2.COLOR_BGRA2BGR),
        "rgba8": (4, cv2.COLOR_RGBA2BGR),
        "bayer_rggb8": (1, cv2.COLOR_BayerBG2BGR),
        "bayer_bggr8": (1, cv2.COLOR_BayerRG2BGR),
        "bayer_gbrg8": (1, cv2.COLOR_BayerGR2BGR),
        "bayer_grbg8": (1, cv2.COLOR_BayerGB2BGR),
        "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
        "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUYV),
    }
    if encoding not in codes:
        raise InputError(
            f"{name} has the encoding {message.encoding}, which is not read; republish it as bgr8."
        )
    channels, code = codes[encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.frombuffer(bytes(message.data), np.uint8)
    if step < width * channels or len(data) < step * height:
        raise InputError(f"{name} is shorter than its size says; leave it out.")
    rows = data[: step * height].reshape(height, step)[:, : width * channels]
    pixels = rows.reshape(height, width, channels)
    pixels = pixels[:, :, 0] if channels == 1 else pixels
    return pixels if code is None else np.asarray(cv2.cvtColor(pixels, code))


def read_camera(bag: Bag, topic: str) -> tuple[tuple[int, int], FloatArray, list[float]] | None:
    """Size, matrix [3, 3] and distortion of a CameraInfo topic; None for an empty one."""
    for _, message in bag.messages(topic):
        matrix = np.asarray(message.K if hasattr(message, "K") else message.k, np.float64)
        distortion = np.asarray(message.D if hasattr(message, "D") else message.d, np.float64)
        matrix = matrix.reshape(3, 3)
        model = str(message.distortion_model)
        if matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0:
            known = model in ("plumb_bob", "rational_polynomial", "")
            coefficients = distortion.tolist() if known and len(distortion) in (4, 5, 8) else []
            return (int(message.width), int(message.height)), matrix, coefficients
        return None
    return None
