"""Tables in other units, or of other quantities than they seem."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.earth import STANDARD_GRAVITY
from tests.unit.strangers.drive import (
    DEG,
    PER_G,
    Truth,
    en_imu,
    fix_rows,
    imu_rows,
    iso,
    num,
    truth,
    write,
)


def milli_units_bare(folder: Path) -> Truth:
    """Whole mg and milli-degrees a second, nothing tells so."""
    of = truth()
    write(
        folder / "imu_log.csv",
        "time,gx,gy,gz,ax,ay,az",
        imu_rows(of, iso, 1e3 * DEG, 1e3 * PER_G, digits=0),
    )
    write(folder / "gps.csv", "time,lat,lon,speed,course", fix_rows(of, iso, height=None))
    return of


def counts(folder: Path) -> Truth:
    """Whole counts of 16 bits: 131 for a degree a second, 16384 for a g."""
    of = truth()
    write(
        folder / "imu_log.csv",
        "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z",
        imu_rows(of, iso, 131.0 * DEG, 16384.0 * PER_G, digits=0),
    )
    write(folder / "gps.csv", "time,lat,lon,speed,course", fix_rows(of, iso, height=None))
    return of


def linear_acceleration(folder: Path) -> Truth:
    """Gravity taken off by a phone."""
    of = truth()
    rows = [
        [*row[:4], *(num(v, 5) for v in a + np.array([0.0, 0.0, STANDARD_GRAVITY]))]
        for row, a in zip(imu_rows(of, iso), of.accel, strict=True)
    ]
    write(
        folder / "imu_log.csv",
        "time,Gyroscope x (rad/s),Gyroscope y (rad/s),Gyroscope z (rad/s),"
        "Linear Acceleration x (m/s^2),Linear Acceleration y (m/s^2),"
        "Linear Acceleration z (m/s^2)",
        rows,
    )
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, iso, height=None, speed=1.0),
    )
    return of


def attitude_only(folder: Path) -> Truth:
    """Angles in place of rates."""
    of = truth()
    write(
        folder / "imu_log.csv",
        "time,roll,pitch,yaw,acc_x,acc_y,acc_z",
        imu_rows(of, iso, DEG, PER_G),
    )
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, iso, height=None, speed=1.0),
    )
    return of


def radians(folder: Path) -> Truth:
    """Latitude, longitude and course in radians, nothing tells so."""
    of = truth()
    en_imu(folder, of)
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        (
            [row[0], f"{np.radians(float(row[1])):.12f}", f"{np.radians(float(row[2])):.12f}",
             *row[3:]]
            for row in fix_rows(of, iso, height=None, speed=1.0, course=1.0)
        ),
    )  # fmt: skip
    return of


def scaled_integers(folder: Path) -> Truth:
    """Degrees times 1e7, mm and mm/s, as u-blox has them; nothing tells so."""
    of = truth()
    en_imu(folder, of)
    write(
        folder / "gps.csv",
        "time,lat,lon,height,gSpeed,headMot",
        (
            [row[0], f"{1e7 * float(row[1]):.0f}", f"{1e7 * float(row[2]):.0f}",
             *(f"{float(cell):.0f}" for cell in row[3:])]
            for row in fix_rows(of, iso, height=1e3, speed=1e3, course=1e5 * DEG)
        ),
    )  # fmt: skip
    return of


def heights_in_feet(folder: Path) -> Truth:
    """Heights in feet, which nothing tells."""
    of = truth()
    en_imu(folder, of)
    write(
        folder / "gps.csv",
        "time,lat,lon,ellipsoidal height,speed,course",
        fix_rows(of, iso, height=1 / 0.3048, speed=1.0),
    )
    return of


WRITERS = (
    milli_units_bare,
    counts,
    linear_acceleration,
    attitude_only,
    radians,
    scaled_integers,
    heights_in_feet,
)
