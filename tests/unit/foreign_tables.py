"""The sample drive as other programs would have written it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.io.drive import load_drive
from automap.io.recording import Recording, read_recording
from automap.records import FloatArray
from automap.timebase import gps_to_unix

SAMPLE = Path(__file__).parents[2] / "data" / "sample-drive"


@cache
def sample() -> Recording:
    """The sample drive in SI units, forward, right, down."""
    return read_recording(load_drive(SAMPLE))


@cache
def imu_unix_s() -> FloatArray:
    """UNIX time [n] of its readings."""
    recording = sample()
    fixes, imu = recording.fixes, recording.imu
    assert fixes is not None
    assert imu is not None
    known = fixes.arrival_ns > 0
    host = fixes.arrival_ns[known] * 1e-9
    later = float(np.median(host - fixes.gps_s[known])) - 0.07
    return np.asarray(gps_to_unix(imu.t_ns * 1e-9 - later))


def german(folder: Path, encoding: str = "latin-1") -> None:
    """Semicolons, decimal commas, ISO times, deg/s and g; dates and times of day in two columns."""
    _write(
        folder / "messung.csv",
        ";",
        "Zeitstempel;Drehrate X [°/s];Drehrate Y [°/s];Drehrate Z [°/s];Beschleunigung X [g];"
        "Beschleunigung Y [g];Beschleunigung Z [g]",
        ([_iso(u) + "Z", *map(_comma, row)] for u, row in _readings(np.degrees(1.0), 1.0)),
        encoding,
    )
    _write(
        folder / "gps.csv",
        ";",
        "Datum;Uhrzeit;Breitengrad;Längengrad;Höhe über Ellipsoid [m];Geschwindigkeit [km/h];"
        "Kurs [°]",
        (
            [f"{_date(u):%d.%m.%Y}", f"{_date(u):%H:%M:%S.%f}", *map(_comma, row)]
            for u, row in _fixes()
        ),
        encoding,
    )


def french(folder: Path) -> None:
    """Tabs, milliseconds since 1970 and ISO times with their zone."""
    _write(
        folder / "centrale.tsv",
        "\t",
        "Temps (ms)\tVitesse angulaire X (deg/s)\tVitesse angulaire Y (deg/s)\tVitesse angulaire Z "
        "(deg/s)\tAccélération X (m/s²)\tAccélération Y (m/s²)\tAccélération Z (m/s²)",
        (
            [f"{u * 1e3:.3f}", *map(_point, row)]
            for u, row in _readings(np.degrees(1.0), STANDARD_GRAVITY)
        ),
    )
    _write(
        folder / "position.tsv",
        "\t",
        "Horodatage\tLatitude\tLongitude\tAltitude ellipsoïdale\tVitesse (km/h)\tCap",
        ([_iso(u) + "+00:00", *map(_point, row)] for u, row in _fixes()),
    )


def bare(folder: Path) -> None:
    """No units anywhere: deg/s and g, seconds; the receiver's log as it came."""
    _write(
        folder / "log.csv",
        ",",
        "timestamp,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z",
        ([f"{u:.6f}", *map(_point, row)] for u, row in _readings(np.degrees(1.0), 1.0)),
    )
    shutil.copy(SAMPLE / "gnss.ubx", folder)


FOREIGN: dict[str, Callable[[Path], None]] = {"german": german, "french": french, "bare": bare}


def _readings(per_rad_s: float, per_g: float) -> Iterable[tuple[float, list[float]]]:
    imu = sample().imu
    assert imu is not None
    rows = np.column_stack([imu.gyro * per_rad_s, imu.accel * per_g / STANDARD_GRAVITY])
    return zip(imu_unix_s().tolist(), rows.tolist(), strict=True)


def _fixes() -> Iterable[tuple[float, list[float]]]:
    """Degrees, ellipsoidal height, km/h and course of the fixes that are some."""
    fixes = sample().fixes
    assert fixes is not None
    north, east = fixes.vel_ned[:, 0], fixes.vel_ned[:, 1]
    rows = np.column_stack(
        [
            np.degrees(fixes.lat_rad),
            np.degrees(fixes.lon_rad),
            fixes.height_m,
            3.6 * np.hypot(north, east),
            np.degrees(np.arctan2(east, north)) % 360.0,
        ]
    )
    good = np.isfinite(rows).all(axis=1) & (fixes.fix_type > 1)
    return zip(gps_to_unix(fixes.gps_s[good]).tolist(), rows[good].tolist(), strict=True)


def _write(
    path: Path, separator: str, header: str, rows: Iterable[list[str]], encoding: str = "utf-8"
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    text = "\n".join([header, *map(separator.join, rows)]) + "\n"
    path.write_bytes(text.encode(encoding))


def _date(unix_s: float) -> datetime:
    return datetime.fromtimestamp(unix_s, UTC)


def _iso(unix_s: float) -> str:
    return f"{_date(unix_s):%Y-%m-%dT%H:%M:%S.%f}"


def _point(value: float) -> str:
    return f"{value:.9f}"


def _comma(value: float) -> str:
    return _point(value).replace(".", ",")
