"""Small recordings in other programs' formats: a vehicle driving north-east at 10 m/s."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

LAT, LON, HEIGHT = -33.9, 151.2, 40.0
START_NS = 1_700_000_000_000_000_000
SPEED = 10.0
N_IMU, N_FIX, N_IMAGE = 300, 16, 5
IMU_NS = START_NS + np.arange(N_IMU, dtype=np.int64) * 10_000_000
FIX_NS = START_NS + np.arange(N_FIX, dtype=np.int64) * 200_000_000
IMAGE_NS = START_NS + np.arange(N_IMAGE, dtype=np.int64) * 500_000_000
GYRO = np.array([0.01, -0.02, 0.03])
FORCE_FLU = np.array([0.1, 0.2, 9.8])


def gyro(i: int) -> np.ndarray:
    """Turn rates of reading ``i``, which flicker as a sensor's do."""
    return GYRO * (1.0 + 1e-3 * (-1) ** i)


def force(i: int) -> np.ndarray:
    """Specific force of reading ``i``, forward, left, up."""
    return FORCE_FLU * (1.0 + 1e-4 * (-1) ** i)


def place(i: int) -> tuple[float, float, float]:
    """Degrees and height of fix ``i``."""
    way = SPEED * np.sqrt(0.5) * i * 0.2
    lat = LAT + np.degrees(way / 6_371_000.0)
    return lat, LON + np.degrees(way / 6_371_000.0 / np.cos(np.radians(LAT))), HEIGHT


def jpeg(i: int) -> bytes:
    """A small picture of its own grey."""
    return cv2.imencode(".jpg", np.full((48, 64, 3), 40 + 20 * i, np.uint8))[1].tobytes()


def png(i: int) -> bytes:
    """The same as PNG."""
    return cv2.imencode(".png", np.full((48, 64, 3), 40 + 20 * i, np.uint8))[1].tobytes()


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


def write_kitti(folder: Path) -> Path:
    """A drive of KITTI raw with calibration beside it; the folder of the drive."""
    drive = folder / "2011_09_26" / "2011_09_26_drive_0001_sync"
    data = drive / "oxts" / "data"
    data.mkdir(parents=True)
    yaw = np.pi / 4.0
    lines = []
    for i in range(N_FIX):
        lat, lon, height = place(i)
        half = SPEED * np.sqrt(0.5)
        row = [lat, lon, height, 0.02, -0.03, yaw, half, half, SPEED, 0.0, 0.1]
        row += [*force(i), *force(i), *gyro(i), *gyro(i), 0.05, 0.02, 4, 9, 6, 6, 0]
        (data / f"{i:010d}.txt").write_text(" ".join(str(v) for v in row))
        lines.append(f"2011-09-26 13:02:{25.0 + 0.2 * i:012.9f}")
    (drive / "oxts" / "timestamps.txt").write_text("\n".join(lines) + "\n")
    images = drive / "image_02" / "data"
    images.mkdir(parents=True)
    for i in range(N_IMAGE):
        (images / f"{i:010d}.png").write_bytes(png(i))
    stamps = "\n".join(lines[:N_IMAGE]) + "\n"
    (drive / "image_02" / "timestamps.txt").write_text(stamps)
    identity = "1 0 0 0 1 0 0 0 1"
    day = drive.parent
    (day / "calib_cam_to_cam.txt").write_text(
        f"R_rect_00: {identity}\nP_rect_02: 700 0 32 70 0 700 24 0 0 0 1 0\n"
    )
    # camera x right, y down, z forward; the laser x forward, y left, z up
    (day / "calib_velo_to_cam.txt").write_text("R: 0 -1 0 0 0 -1 1 0 0\nT: 0 0 -0.3\n")
    (day / "calib_imu_to_velo.txt").write_text(f"R: {identity}\nT: -0.8 0.3 -0.8\n")
    return drive


def write_euroc(folder: Path, gps: bool = True) -> Path:
    """A recording in the ASL format; the folder that holds mav0."""
    root = folder / "mav0"
    for name in ("imu0", "cam0/data", "gps0"):
        (root / name).mkdir(parents=True)
    rows = [f"{t}," + ",".join(map(str, [*gyro(i), *force(i)])) for i, t in enumerate(IMU_NS)]
    head = "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n"
    (root / "imu0/data.csv").write_text(head + "\n".join(rows))
    lines = (", ".join("1.0" if i == j else "0.0" for j in range(4)) for i in range(4))
    identity = f"[{(',' + chr(10) + ' ').join(lines)}]"
    transform = f"T_BS:\n  cols: 4\n  rows: 4\n  data: {identity}\n"
    (root / "imu0/sensor.yaml").write_text(transform)
    for i in range(N_IMAGE):
        (root / f"cam0/data/{IMAGE_NS[i]}.png").write_bytes(png(i))
    listing = "".join(f"{t},{t}.png\r\n" for t in IMAGE_NS)
    (root / "cam0/data.csv").write_text("#timestamp [ns],filename\r\n" + listing, newline="")
    (root / "cam0/sensor.yaml").write_text(
        transform + "intrinsics: [458.6, 457.3, 31.5, 23.5] #fu, fv, cu, cv\n"
        "distortion_model: radial-tangential\n"
        "distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]\n"
    )
    if gps:
        fixes = [f"{FIX_NS[i]}," + ",".join(f"{v:.9f}" for v in place(i)) for i in range(N_FIX)]
        (root / "gps0/data.csv").write_text("#timestamp,lat,lon,alt\n" + "\n".join(fixes))
    return folder


def write_sensor_logger(folder: Path) -> Path:
    """A recording of Sensor Logger on Android."""
    folder.mkdir(parents=True)
    gravity = np.array([0.0, 0.0, 9.8])
    head = "time,seconds_elapsed,z,y,x\n"

    def rows(values: Callable[[int], np.ndarray]) -> str:
        lines = []
        for i, t in enumerate(IMU_NS):
            x, y, z = values(i)
            lines.append(f"{t},{(t - START_NS) * 1e-9:.3f},{z},{y},{x}\n")
        return "".join(lines)

    (folder / "Gyroscope.csv").write_text(head + rows(gyro))
    (folder / "Gravity.csv").write_text(head + rows(lambda i: gravity))
    (folder / "Accelerometer.csv").write_text(head + rows(lambda i: force(i) - gravity))
    lines = ["time,seconds_elapsed,bearingAccuracy,speedAccuracy,verticalAccuracy,"
             "horizontalAccuracy,speed,bearing,altitude,longitude,latitude"]  # fmt: skip
    for i in range(N_FIX):
        lat, lon, height = place(i)
        lines.append(f"{FIX_NS[i]},{i * 0.2},1,0.5,4,3,{SPEED},45,{height},{lon:.9f},{lat:.9f}")
    (folder / "Location.csv").write_text("\n".join(lines) + "\n")
    (folder / "Metadata.csv").write_text("version,platform,standardisation\n1.4,android,true\n")
    return folder


def write_gnss_logger(path: Path) -> Path:
    """A log of GnssLogger with fixes of two providers."""
    boot = 5_000_000_000_000
    fix = (
        "Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,"
        "BearingDegrees,UnixTimeMillis,SpeedAccuracyMps,BearingAccuracyDegrees,"
        "elapsedRealtimeNanos,VerticalAccuracyMeters"
    )
    accel_head, gyro_head = (
        f"Uncal{kind},utcTimeMillis,elapsedRealtimeNanos,Uncal{kind}X{unit},Uncal{kind}Y{unit},"
        f"Uncal{kind}Z{unit},BiasX{unit},BiasY{unit},BiasZ{unit}"
        for kind, unit in (("Accel", "Mps2"), ("Gyro", "RadPerSec"))
    )
    lines = ["# ", "# Header Description:", "# Version: v3.0.6.4 Platform: 13", "# "]
    lines += [f"# {head}" for head in (fix, accel_head, gyro_head)]
    for i, ns in enumerate(IMU_NS):
        stamp = f"{ns // 10**6},{ns - START_NS + boot}"
        lines.append(f"UncalAccel,{stamp}," + ",".join(map(str, force(i))) + ",0,0,0")
        lines.append(f"UncalGyro,{stamp}," + ",".join(map(str, gyro(i))) + ",0,0,0")
    for i in range(N_FIX):
        lat, lon, height = place(i)
        for provider in ("GPS", "FLP"):
            shift = 0.0 if provider == "GPS" else 1e-4
            lines.append(
                f"Fix,{provider},{lat + shift:.9f},{lon:.9f},{height},{SPEED},3.0,45.0,"
                f"{FIX_NS[i] // 10**6},0.5,1.0,{FIX_NS[i] - START_NS + boot},4.0"
            )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def write_mapillary(folder: Path, described: bool) -> Path:
    """Images with EXIF GPS tags, or with the description of mapillary_tools."""
    from fractions import Fraction

    from PIL import Image

    folder.mkdir(parents=True)
    for i in range(N_IMAGE):
        lat, lon, height = place(i * 5)
        image = Image.new("RGB", (64, 48), (40 + 20 * i,) * 3)
        exif = image.getexif()
        moment = np.datetime64(1_700_000_000 + i, "s").astype(object)
        if described:
            exif[0x010E] = json.dumps(
                {
                    "MAPLatitude": lat,
                    "MAPLongitude": lon,
                    "MAPAltitude": height,
                    "MAPCaptureTime": f"{moment:%Y_%m_%d_%H_%M_%S}_250",
                    "MAPCompassHeading": {"TrueHeading": 45.0, "MagneticHeading": 45.0},
                }
            )
        else:
            exif.get_ifd(0x8769)[0x9003] = f"{moment:%Y:%m:%d %H:%M:%S}"
            exif.get_ifd(0x8769)[0x9291] = "25"
            exif.get_ifd(0x8769)[0x9011] = "+00:00"
            gps = exif.get_ifd(0x8825)

            def parts(angle: float) -> tuple[Fraction, Fraction, Fraction]:
                seconds = Fraction(round(abs(angle) * 3600 * 10**6), 10**6)
                return (
                    Fraction(seconds // 3600),
                    Fraction(seconds % 3600 // 60),
                    Fraction(seconds % 60),
                )

            gps[1], gps[2] = ("S" if lat < 0 else "N"), parts(lat)
            gps[3], gps[4] = ("W" if lon < 0 else "E"), parts(lon)
            gps[5], gps[6] = b"\0", Fraction(round(height * 100), 100)
        image.save(folder / f"image{i:03d}.jpg", exif=exif)
    return folder


def write_rtklib(folder: Path, carriage_returns_lost: bool = False) -> Path:
    """An RTKLIB recording: a u-blox log, IMU lines and their tags."""
    from automap.records import Fixes
    from automap.simulation.ubx_writer import nav_pvt
    from automap.timebase import unix_to_gps

    folder.mkdir(parents=True)
    n = N_FIX
    places = np.array([place(i) for i in range(n)])
    three = np.ones((n, 3))
    half = SPEED * np.sqrt(0.5)
    fixes = Fixes(
        gps_s=unix_to_gps(FIX_NS * 1e-9),
        lat_rad=np.radians(places[:, 0]),
        lon_rad=np.radians(places[:, 1]),
        height_m=places[:, 2],
        vel_ned=np.tile([half, half, 0.0], (n, 1)),
        sd_pos_ned=three,
        sd_vel_ned=three * 0.1,
        fix_type=np.full(n, 3),
        n_sats=np.full(n, 12),
        hdop=np.ones(n),
        geoid_sep_m=np.full(n, 20.0),
        offset=np.zeros(n, np.int64),
        arrival_ns=np.zeros(n, np.int64),
    )
    messages = nav_pvt(fixes)
    (folder / "gnss.ubx").write_bytes(b"".join(messages))
    ends = np.cumsum([len(m) for m in messages])
    ticks = np.arange(n) * 200 + 70
    _write_tag(folder / "gnss.ubx.tag", 1000, ticks, ends)
    lines = [
        ",".join(f"{v / 9.80665:.5f}" for v in force(i))
        + ","
        + ",".join(f"{np.degrees(v):.4f}" for v in gyro(i))
        + f",{50_000 + 10 * i}\r\n"
        for i in range(N_IMU)
    ]
    ends = np.cumsum([len(line) for line in lines])
    _write_tag(folder / "imu.csv.tag", 1000, np.arange(N_IMU) * 10 + 5 + np.arange(N_IMU) % 7, ends)
    text = "".join(lines)
    text = text.replace("\r", "") if carriage_returns_lost else text
    (folder / "imu.csv").write_bytes(text.encode())
    return folder


def _write_tag(path: Path, tick: int, ticks: np.ndarray, ends: np.ndarray) -> None:
    head = b"TIMETAG RTKLIB EX".ljust(60, b"\0") + struct.pack("<I", tick)
    head += struct.pack("<Id", 1_700_000_000, 0.25)
    rows = b"".join(struct.pack("<II", int(t), int(e)) for t, e in zip(ticks, ends, strict=True))
    path.write_bytes(head + rows)
