"""Small recordings of phone apps, and their pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from import_sources import FIX_NS, IMU_NS, N_FIX, N_IMAGE, SPEED, START_NS, force, gyro, place


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
