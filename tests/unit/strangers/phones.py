"""Tables as apps on phones write them."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path

import numpy as np

from automap.earth import STANDARD_GRAVITY
from tests.unit.strangers.drive import (
    DEG,
    PER_G,
    Truth,
    fix_rows,
    imu_rows,
    num,
    since,
    stamp,
    truth,
    write,
)


def phyphox(folder: Path) -> Truth:
    """A table for each sensor, all of one clock that begins with the recording."""
    of = truth()
    rows = imu_rows(of, since(of))
    gyro = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)"'
    write(folder / "Gyroscope.csv", gyro, (row[:4] for row in rows))
    for name, word, gravity in (
        ("Accelerometer.csv", "Acceleration", 0.0),
        ("Linear Accelerometer.csv", "Linear Acceleration", STANDARD_GRAVITY),
    ):
        header = ",".join(['"Time (s)"', *(f'"{word} {axis} (m/s^2)"' for axis in "xyz")])
        write(
            folder / name,
            header,
            ([*row[:1], *row[4:6], num(float(row[6]) + gravity)] for row in rows),
        )
    write(
        folder / "Location.csv",
        '"Time (s)","Latitude (°)","Longitude (°)","Height (m)","Velocity (m/s)","Direction (°)"',
        fix_rows(of, since(of), speed=1.0),
    )
    return of


def phyphox_archive(folder: Path) -> Truth:
    """The same as it is sent."""
    of = phyphox(folder / "inside")
    with zipfile.ZipFile(folder / "drive 2026-03-14.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted((folder / "inside").iterdir()):
            archive.write(path, path.name)
        archive.writestr("meta/device.csv", "property,value\ndeviceModel,X\n")
    shutil.rmtree(folder / "inside")
    return of


def physics_toolbox(folder: Path) -> Truth:
    """g forces, rad/s and a place in one table; milliseconds after a colon, no course."""
    of = truth()
    at = np.clip(np.searchsorted(of.fix_t, of.t, side="right") - 1, 0, None)
    rows = imu_rows(of, lambda t: [stamp("%H:%M:%S:%L", t)], 1.0, PER_G)
    write(
        folder / "log.csv",
        "time,gFx,gFy,gFz,wx,wy,wz,Latitude,Longitude,Speed (m/s)",
        (
            [row[0], *row[4:], *row[1:4], num(of.lat[k], 8), num(of.lon[k], 8), num(of.speed[k])]
            for row, k in zip(rows, at, strict=True)
        ),
    )
    return of


def androsensor(folder: Path) -> Truth:
    """Blanks and colons in the names, a date in a format of its own."""
    of = truth()
    at = np.clip(np.searchsorted(of.fix_t, of.t, side="right") - 1, 0, None)
    rows = imu_rows(of, lambda t: [f"{1e3 * (t - of.t[0]):.0f}"])
    write(
        folder / "Sensor_record.csv",
        "ACCELEROMETER X (m/s²);ACCELEROMETER Y (m/s²);ACCELEROMETER Z (m/s²);"
        "GYROSCOPE X (rad/s);GYROSCOPE Y (rad/s);GYROSCOPE Z (rad/s);LOCATION Latitude : ;"
        "LOCATION Longitude : ;LOCATION Speed ( Kmh);LOCATION ORIENTATION (°);"
        "Satellites in range;Time since start in ms ;YYYY-MO-DD HH-MI-SS_SSS",
        (
            [
                *row[4:],
                *row[1:4],
                num(of.lat[k], 8),
                num(of.lon[k], 8),
                num(3.6 * of.speed[k]),
                num(DEG * of.course[k]),
                "9 / 12",
                row[0],
                stamp("%Y-%m-%d %H:%M:%S:%L", of.fix_t[k]),
            ]
            for row, k in zip(rows, at, strict=True)
        ),
        ";",
    )
    return of


WRITERS = (phyphox, phyphox_archive, physics_toolbox, androsensor)
