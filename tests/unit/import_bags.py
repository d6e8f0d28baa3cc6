"""Small ROS bags."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from import_sources import FIX_NS, IMAGE_NS, IMU_NS, SPEED, force, gyro, jpeg, place

_NAVPVT = """
uint32 iTOW
uint16 year
uint8 month
uint8 day
uint8 hour
uint8 min
uint8 sec
uint8 valid
uint32 tAcc
int32 nano
uint8 fixType
uint8 flags
uint8 flags2
uint8 numSV
int32 lon
int32 lat
int32 height
int32 hMSL
uint32 hAcc
uint32 vAcc
int32 velN
int32 velE
int32 velD
int32 gSpeed
int32 heading
uint32 sAcc
uint32 headAcc
uint16 pDOP
uint8[6] reserved1
int32 headVeh
int16 magDec
uint16 magAcc
"""


def write_bag(path: Path, *, ros2: bool, ublox: bool = False, raw_images: bool = False) -> Path:
    """A bag with IMU, positions (and NavPVT), velocity and images; the file to import."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(_NAVPVT, "ublox_msgs/msg/NavPVT"))
    t = store.types
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP) if ros2 else Writer1(path)
    sequence = {} if ros2 else {"seq": 0}

    def header(ns: int) -> object:
        time = t["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        return t["std_msgs/msg/Header"](stamp=time, frame_id="x", **sequence)

    vector, nine = t["geometry_msgs/msg/Vector3"], np.zeros(9)

    def imu(i: int) -> object:
        return t["sensor_msgs/msg/Imu"](
            header=header(int(IMU_NS[i])),
            orientation=t["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=nine,
            angular_velocity=vector(*gyro(i).tolist()),
            angular_velocity_covariance=nine,
            linear_acceleration=vector(*force(i).tolist()),
            linear_acceleration_covariance=nine,
        )

    def fix(i: int) -> object:
        lat, lon, height = place(i)
        return t["sensor_msgs/msg/NavSatFix"](
            header=header(int(FIX_NS[i])),
            status=t["sensor_msgs/msg/NavSatStatus"](status=0, service=1),
            latitude=lat,
            longitude=lon,
            altitude=height,
            position_covariance=np.diag([4.0, 1.0, 9.0]).ravel(),
            position_covariance_type=2,
        )

    def velocity(i: int) -> object:
        half = SPEED * float(np.sqrt(0.5))
        return t["geometry_msgs/msg/TwistStamped"](
            header=header(int(FIX_NS[i])),
            twist=t["geometry_msgs/msg/Twist"](
                linear=vector(half, half, 0.5), angular=vector(0.0, 0.0, 0.0)
            ),
        )

    def pvt(i: int) -> object:
        lat, lon, height = place(i)
        seconds = 1_700_000_000 + i * 0.2
        moment = np.datetime64(int(seconds), "s").astype(object)
        names = [line.split()[1] for line in _NAVPVT.split("\n") if line.strip()]
        values = dict.fromkeys(names, 0)
        values |= {
            "iTOW": round((1_384_035_218 + i * 0.2) * 1e3) % 604_800_000,
            "year": moment.year, "month": moment.month, "day": moment.day, "hour": moment.hour,
            "min": moment.minute, "sec": moment.second, "valid": 7,
            "nano": round((seconds - int(seconds)) * 1e9), "fixType": 3, "flags": 1, "numSV": 12,
            "lon": round(lon * 1e7), "lat": round(lat * 1e7), "height": round(height * 1e3),
            "hMSL": round(height * 1e3) - 20_000, "hAcc": 1500, "vAcc": 2500, "velN": 7071,
            "velE": 7071, "velD": -500, "gSpeed": 10_000, "heading": 4_500_000, "sAcc": 100,
            "pDOP": 150,
        }  # fmt: skip
        values["reserved1"] = np.zeros(6, np.uint8)
        return t["ublox_msgs/msg/NavPVT"](**values)

    def image(i: int) -> object:
        if raw_images:
            pixels = np.full((48, 64, 3), 40 + 20 * i, np.uint8)
            return t["sensor_msgs/msg/Image"](
                header=header(int(IMAGE_NS[i])), height=48, width=64, encoding="rgb8",
                is_bigendian=0, step=192, data=pixels.ravel(),
            )  # fmt: skip
        return t["sensor_msgs/msg/CompressedImage"](
            header=header(int(IMAGE_NS[i])),
            format="jpeg",
            data=np.frombuffer(jpeg(i), np.uint8),
        )

    channels: list[tuple[str, str, np.ndarray, Callable[[int], object]]] = [
        ("/imu/data", "sensor_msgs/msg/Imu", IMU_NS, imu),
        ("/gps/fix", "sensor_msgs/msg/NavSatFix", FIX_NS, fix),
        ("/gps/vel", "geometry_msgs/msg/TwistStamped", FIX_NS, velocity),
        (
            "/cam/image_raw",
            f"sensor_msgs/msg/{'Image' if raw_images else 'CompressedImage'}",
            IMAGE_NS,
            image,
        ),
    ]
    if ublox:
        channels.append(("/ublox/navpvt", "ublox_msgs/msg/NavPVT", FIX_NS, pvt))
    with writer:
        for topic, kind, stamps, make in channels:
            connection = writer.add_connection(topic, kind, typestore=store)
            for i, stamp in enumerate(stamps.tolist()):
                message = make(i)
                raw = (
                    store.serialize_cdr(message, kind)
                    if ros2
                    else store.serialize_ros1(message, kind)
                )
                writer.write(connection, stamp + 3_000_000, raw)
    return path


_OWN_IMU = (
    "std_msgs/Header header\ngeometry_msgs/Vector3 angular_rate_dps\nfloat64[3] accel\n"
    "uint64 clock_us\n"
)
_OWN_FIX = (
    "std_msgs/Header header\nint32 lat\nint32 lon\nfloat64 height_ellipsoid\nfloat64 speed_kmh\n"
    "float64 track\nstring sentence\n"
)


def write_own_bag(
    path: Path, *, imu: bool = True, gnss: bool = True, sentences: bool = True
) -> Path:
    """A ROS 1 bag whose messages are of types that nobody knows: deg/s, 1e-7 deg, km/h, and a
    receiver's GGA where there are ``sentences``."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from automap.io.nmea_writer import angle, sentence

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(_OWN_IMU, "maker/msg/Readings"))
    store.register(get_types_from_msg(_OWN_FIX, "maker/msg/Place"))
    t = store.types
    path.parent.mkdir(parents=True, exist_ok=True)

    def header(ns: int) -> object:
        time = t["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        return t["std_msgs/msg/Header"](stamp=time, frame_id="x", seq=0)

    def readings(i: int) -> object:
        return t["maker/msg/Readings"](
            header=header(int(IMU_NS[i])),
            angular_rate_dps=t["geometry_msgs/msg/Vector3"](*np.degrees(gyro(i)).tolist()),
            accel=force(i),
            clock_us=int(IMU_NS[i]) // 1000 + 7,
        )

    def fix(i: int) -> object:
        lat, lon, height = place(i)
        moment = np.datetime64(int(FIX_NS[i]), "ns").astype("datetime64[us]").astype(object)
        gga = sentence(
            f"GPGGA,{moment:%H%M%S}.{moment.microsecond // 1000:03d},{angle(lat, 2)},S,"
            f"{angle(lon, 3)},E,1,09,1.0,{height - 20.0:.1f},M,20.0,M,,"
        ).decode()
        return t["maker/msg/Place"](
            header=header(int(FIX_NS[i])),
            lat=round(lat * 1e7),
            lon=round(lon * 1e7),
            height_ellipsoid=height,
            speed_kmh=SPEED * 3.6,
            track=45.0,
            sentence=gga if sentences else "",
        )

    with Writer(path) as writer:
        for wanted, topic, kind, stamps, make in (
            (imu, "/maker/imu", "maker/msg/Readings", IMU_NS, readings),
            (gnss, "/maker/gps", "maker/msg/Place", FIX_NS, fix),
        ):
            if wanted:
                connection = writer.add_connection(topic, kind, typestore=store)
                for i, stamp in enumerate(stamps.tolist()):
                    writer.write(connection, stamp + 3_000_000, store.serialize_ros1(make(i), kind))
    return path
