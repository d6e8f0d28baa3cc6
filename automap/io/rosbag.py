"""ROS 1 bags and ROS 2 recordings (MCAP, SQLite): the topics that a drive is made of.

Read by the package ``rosbags``. Definitions of messages are taken from the recording, so that
ublox_msgs needs no ROS. References: REP-103 (axes: x forward, y left, z up), sensor_msgs Imu,
NavSatFix (altitude above the ellipsoid, covariance east-north-up), CameraInfo.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io.ros_fields import nanoseconds
from automap.io.ros_mapping import Place
from automap.records import FixType, FloatArray, IntArray

IMU = ("sensor_msgs/msg/Imu",)
IMU_FIELDS = {"gyro": Place("angular_velocity"), "accel": Place("linear_acceleration")}
NOVATEL = {
    "novatel_gps_msgs/msg/NovatelPosition": {
        "lat": Place("lat"), "lon": Place("lon"), "msl": Place("height"),
        "geoid_sep": Place("undulation"), "sd_n": Place("lat_sigma"), "sd_e": Place("lon_sigma"),
        "sd_d": Place("height_sigma"),
    },
    "novatel_oem7_msgs/msg/BESTPOS": {
        "lat": Place("lat"), "lon": Place("lon"), "msl": Place("hgt"),
        "geoid_sep": Place("undulation"), "sd_n": Place("lat_stdev"), "sd_e": Place("lon_stdev"),
        "sd_d": Place("hgt_stdev"),
    },
}  # fmt: skip
FIX = ("sensor_msgs/msg/NavSatFix", "gps_common/msg/GPSFix", "gps_msgs/msg/GPSFix")
UBLOX = ("ublox_msgs/msg/NavPVT", "ublox_msgs/msg/NavPVT7")
VELOCITY = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped")
IMAGE = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
INFO = ("sensor_msgs/msg/CameraInfo",)

SUFFIXES = (".bag", ".mcap", ".db3")
_UNKNOWN = -2
_NO_FIX = dict.fromkeys((_UNKNOWN, -1), FixType.NONE)
_STATUS = _NO_FIX | dict.fromkeys((1, 2, 18, 33), FixType.DGNSS)
"""UNKNOWN (ROS 2: nobody set it), NO_FIX, SBAS, GBAS (which is RTK, fixed or not); of a GPSFix
DGPS and WAAS as well."""
_LISTED = 12
"""Topics that a message names."""
_VELOCITY_MATCH_S = 0.06


@dataclass(frozen=True)
class BagFixes:
    """Positions [n]: stamps of their headers, degrees, ellipsoidal height, fix, sigmas and
    velocity [n, 3] north-east-down (NaN where unknown); ``warnings`` a sentence each."""

    t_ns: IntArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    height_m: FloatArray
    fix_type: IntArray
    sd_pos_ned: FloatArray
    vel_ned: FloatArray
    sd_vel_ned: FloatArray
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t_ns)


class Bag:
    """Open recordings of one drive; ``topics`` maps each topic to its message type and count."""

    def __init__(self, readers: Sequence[Any], path: Path) -> None:
        self._readers = sorted(readers, key=lambda reader: reader.start_time)
        self.path = path
        self.topics: dict[str, tuple[str, int]] = {}
        for connection in (c for reader in self._readers for c in reader.connections):
            kind, count = self.topics.get(connection.topic, (connection.msgtype, 0))
            self.topics[connection.topic] = (kind, count + connection.msgcount)

    def choose(self, kinds: tuple[str, ...], wanted: str | None, option: str) -> str | None:
        """The topic ``wanted``, else the one of these message types with most messages.

        None also for a wanted topic of another type; ConfigError when it is not there.
        """
        if wanted is not None:
            if wanted not in self.topics:
                there = ", ".join(sorted(self.topics)) or "none"
                raise ConfigError(
                    f"{option} {wanted}: no such topic in {self.path}; there are: {there}."
                )
            return wanted if self.topics[wanted][0] in kinds else None
        found = {t: n for t, (kind, n) in self.topics.items() if kind in kinds and n}
        return max(sorted(found), key=lambda t: found[t]) if found else None

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Stamp of the header in ns (of the recording where it is zero) and the message."""
        for reader in self._readers:
            chosen = [c for c in reader.connections if c.topic == topic]
            if not chosen:
                continue
            for connection, received, data in reader.messages(connections=chosen):
                message = reader.deserialize(data, connection.msgtype)
                header = getattr(message, "header", None)
                yield int((0 if header is None else nanoseconds(header.stamp)) or received), message

    def listed(self) -> str:
        """The topics with their types and counts, for messages."""
        shown = [f"{t} ({kind}, {n})" for t, (kind, n) in sorted(self.topics.items())]
        more = f" and {len(shown) - _LISTED} more" if len(shown) > _LISTED else ""
        return (", ".join(shown[:_LISTED]) + more) or "none"


@contextmanager
def open_bag(*paths: Path) -> Iterator[Bag]:
    """Open the ``.bag`` and ``.mcap`` files, or folders of ROS 2 recordings, of one drive.

    Raises InputError, here or while messages are read, for anything that cannot be read.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with ExitStack() as stack:
        path = paths[0]
        try:
            # what a ROS 2 recording does not define itself is as in the present release
            store = get_typestore(Stores.LATEST)
            readers = []
            for path in (part for given in paths for part in _parts(given)):
                readers.append(stack.enter_context(AnyReader([path], default_typestore=store)))
            yield Bag(readers, path if len(readers) == 1 else paths[0])
        except (InputError, ConfigError):
            raise
        except Exception as error:
            # the package raises its own errors and those of its decoders, and asserts
            raise InputError(
                f"{path} cannot be read as a ROS recording ({type(error).__name__}: {error}); "
                "repair it with rosbag reindex or ros2 bag reindex, or copy it again."
            ) from error


def _parts(path: Path) -> list[Path]:
    """What the reader opens: a folder of ROS 2, or every file of a folder without its metadata."""
    if not path.is_dir() or (path / "metadata.yaml").is_file():
        return [path]
    files = [file for file in sorted(path.iterdir()) if file.suffix in SUFFIXES]
    if not files:
        raise InputError(f"{path} holds no .bag, no .mcap and no ROS 2 recording; name one.")
    return files


def says_unmeasured(bag: Bag, topic: str) -> frozenset[str]:
    """Which fields of the topic's Imu messages say by a covariance of -1 that nothing measured
    them (sensor_msgs Imu), by the first one."""
    for _, message in bag.messages(topic):
        fields = (place.field for place in IMU_FIELDS.values())
        return frozenset(f for f in fields if getattr(message, f"{f}_covariance")[0] == -1.0)
    return frozenset()


def read_fixes(bag: Bag, topic: str, velocity_topic: str | None) -> BagFixes:
    """Positions of a NavSatFix or GPSFix topic, with the velocities (x east, y north, z up) of
    another, else those of a GPSFix itself."""
    stamps, rows, sds, status, own = [], [], [], [], []
    for stamp, message in bag.messages(topic):
        stamps.append(stamp)
        rows.append((message.latitude, message.longitude, message.altitude))
        covariance = np.asarray(message.position_covariance, np.float64)
        known = int(message.position_covariance_type) != 0
        variance = covariance[[4, 0, 8]] if known else np.full(3, np.nan)
        sds.append(np.sqrt(np.where(variance > 0.0, variance, np.nan)))
        status.append(int(message.status.status))
        own.append(_own_velocity(message))
    t_ns, place = np.array(stamps, np.int64), np.array(rows, np.float64).reshape(-1, 3)
    good = np.isfinite(place[:, :2]).all(axis=1)
    said: list[str] = []
    kinds = _kinds(topic, status, said)
    sd = np.array(sds, np.float64).reshape(-1, 3)
    flat = int(np.count_nonzero(good & ~np.isfinite(place[:, 2])))
    if flat:
        said.append(
            f"{flat} of {len(t_ns)} messages of {topic} have no altitude; their heights are unknown"
        )
    if len(sd) and not np.isfinite(sd).any():
        said.append(
            f"no message of {topic} states an accuracy (its covariance is unknown or zero); that "
            "of a usual receiver is assumed: record a topic that has it if there is one"
        )
    velocity, sd_velocity = np.array(own).reshape(-1, 3), np.full((len(t_ns), 3), np.nan)
    if velocity_topic is not None:
        velocity, sd_velocity = _velocities(bag, velocity_topic, t_ns)
    return BagFixes(
        t_ns=t_ns,
        lat_deg=place[:, 0],
        lon_deg=place[:, 1],
        height_m=place[:, 2],
        fix_type=np.where(good, kinds, FixType.NONE),
        sd_pos_ned=sd,
        vel_ned=velocity,
        sd_vel_ned=sd_velocity,
        warnings=tuple(said),
    )


def _kinds(topic: str, status: list[int], said: list[str]) -> IntArray:
    """Types [n] of fixes by their status. Where no message has one, all are taken as fixes."""
    unknown = status.count(_UNKNOWN)
    if unknown and unknown == len(status):
        said.append(
            f"no message of {topic} says whether it is a fix (status -2, unknown); all are taken "
            "as fixes: see that none was recorded before the receiver had one"
        )
        return np.full(len(status), FixType.THREE_D, np.int64)
    if unknown:
        said.append(
            f"{unknown} of {len(status)} messages of {topic} do not say whether they are fixes "
            "(status -2, unknown) and are taken as none"
        )
    return np.array([_STATUS.get(code, FixType.THREE_D) for code in status], np.int64)


def _own_velocity(message: Any) -> tuple[float, float, float]:
    """North, east, down of a GPSFix; NaN for a message that has no speed."""
    if not hasattr(message, "track"):
        return np.nan, np.nan, np.nan
    track, speed = np.radians(message.track), message.speed
    return speed * np.cos(track), speed * np.sin(track), -message.climb


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
