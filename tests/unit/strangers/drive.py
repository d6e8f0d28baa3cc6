"""The drive that strangers' tables tell, and what writes their rows.

A writer puts the files of one folder down and returns what they tell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.records import FloatArray
from automap.timebase import gps_to_unix
from tests.unit.foreign_tables import imu_unix_s, sample

Row = Sequence[str]


EXCEL_EPOCH = datetime(1899, 12, 30, tzinfo=UTC)


@dataclass(frozen=True)
class Truth:
    """The drive: readings every 20 ms in SI, forward, right, down; fixes every 200 ms.

    ``t`` [n] and ``fix_t`` [k] UNIX time; ``gyro``, ``accel`` [n, 3]; ``lat``, ``lon`` [k] deg,
    ``height`` [k] m; ``speed`` [k] m/s and ``course`` [k] rad, 0 to 2 pi.
    """

    t: FloatArray
    gyro: FloatArray
    accel: FloatArray
    fix_t: FloatArray
    lat: FloatArray
    lon: FloatArray
    height: FloatArray
    speed: FloatArray
    course: FloatArray


@cache
def truth(lat0: float = 48.1, lon0: float = 11.5) -> Truth:
    """The sample drive as if it had been driven elsewhere: distances on the ground stay."""
    imu, fixes = sample().imu, sample().fixes
    assert imu is not None
    assert fixes is not None
    t = np.round(imu_unix_s()[::2], 3)
    good = np.isfinite(fixes.vel_ned).all(axis=1) & (fixes.fix_type > 1)
    lat, lon = np.degrees(fixes.lat_rad[good]), np.degrees(fixes.lon_rad[good])
    wider = np.cos(np.radians(lat[0])) / np.cos(np.radians(lat0))
    north, east = fixes.vel_ned[good, 0], fixes.vel_ned[good, 1]
    return Truth(
        t=t,
        gyro=imu.gyro[::2],
        accel=imu.accel[::2],
        fix_t=np.round(np.asarray(gps_to_unix(fixes.gps_s[good]), np.float64), 3),
        lat=lat0 + lat - lat[0],
        lon=lon0 + wider * (lon - lon[0]),
        height=fixes.height_m[good],
        speed=np.hypot(north, east),
        course=np.arctan2(east, north) % (2.0 * np.pi),
    )


def date(unix_s: float, zone_h: float = 0.0) -> datetime:
    """The date and time of day of UNIX time, in a zone."""
    return datetime.fromtimestamp(unix_s, UTC) + timedelta(hours=zone_h)


def ms(when: datetime) -> str:
    """Milliseconds of a date, three digits."""
    return f"{round(when.microsecond / 1000) % 1000:03d}"


def stamp(pattern: str, unix_s: float, zone_h: float = 0.0) -> str:
    """A time by a pattern in which ``%L`` is milliseconds."""
    when = date(round(unix_s, 3) + 1e-5, zone_h)
    return when.strftime(pattern.replace("%L", f"{when.microsecond // 1000:03d}"))


def write(
    path: Path,
    header: str,
    rows: Iterable[Row],
    separator: str = ",",
    *,
    comma: bool = False,
    encoding: str = "utf-8",
    end: str = "\n",
) -> None:
    """A table; ``comma`` puts decimal commas into cells that are numbers."""
    lines = header.split("\n")
    for row in rows:
        cells = [_comma(cell) for cell in row] if comma else row
        lines.append(separator.join(cells))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes((end.join(lines) + end).encode(encoding))


def _comma(cell: str) -> str:
    number = cell.lstrip("+-").replace(".", "", 1).isdigit()
    return cell.replace(".", ",") if number else cell


def num(value: float, digits: int = 7) -> str:
    """A number with a decimal point."""
    return f"{value:.{digits}f}"


def imu_rows(
    of: Truth,
    when: Callable[[float], list[str]],
    rate: float = 1.0,
    accel: float = 1.0,
    digits: int = 7,
) -> list[list[str]]:
    """Rows of a time and six readings, in units of which so many make one rad/s, m/s^2."""
    return [
        [*when(float(t)), *(num(v * rate, digits) for v in g), *(num(v * accel, digits) for v in a)]
        for t, g, a in zip(of.t, of.gyro, of.accel, strict=True)
    ]


def fix_rows(
    of: Truth,
    when: Callable[[float], list[str]],
    *,
    speed: float | None = 3.6,
    course: float | None = float(np.degrees(1.0)),
    height: float | None = 1.0,
) -> list[list[str]]:
    """Rows of a time, latitude, longitude in degrees, and what of height, speed and course is
    asked for, in units of which so many make one m, m/s, rad."""
    rows = []
    for k, t in enumerate(of.fix_t):
        row = [*when(float(t)), num(of.lat[k], 8), num(of.lon[k], 8)]
        for factor, values in ((height, of.height), (speed, of.speed), (course, of.course)):
            if factor is not None:
                row.append(num(values[k] * factor, 5))
        rows.append(row)
    return rows


DEG = float(np.degrees(1.0))


PER_G = 1.0 / STANDARD_GRAVITY


def seconds(t: float) -> list[str]:
    return [f"{t:.3f}"]


def since(of: Truth) -> Callable[[float], list[str]]:
    return lambda t: [f"{t - of.t[0]:.3f}"]


def iso(t: float) -> list[str]:
    return [stamp("%Y-%m-%dT%H:%M:%S.%LZ", t)]


EN_IMU = "Timestamp,Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s),Acc X (g),Acc Y (g),Acc Z (g)"


def en_imu(folder: Path, of: Truth) -> None:
    """A table of readings that gives no trouble, beside fixes that may."""
    write(folder / "imu_log.csv", EN_IMU, imu_rows(of, iso, DEG, PER_G))
