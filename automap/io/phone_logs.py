"""Logs of phone applications: Sensor Logger's CSV files and Google's GnssLogger.

References: Sensor Logger's documentation (tszheichoi/awesome-sensor-logger: units, axes and the
setting "standardisation"); gps-measurement-tools of Google, GnssLogger's log header, and
Android's SensorEvent (m/s^2, rad/s; x right, y up, z out of the screen).
"""

from __future__ import annotations

import csv
import io
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.errors import InputError
from automap.io import limits
from automap.io.nmea_writer import Positions
from automap.records import FloatArray, IntArray

_USED = frozenset(
    {
        "GyroscopeUncalibrated",
        "Gyroscope",
        "AccelerometerUncalibrated",
        "TotalAcceleration",
        "Accelerometer",
        "Gravity",
        "LocationGps",
        "Location",
        "Metadata",
    }
)
"""The tables of Sensor Logger that are read; no other is unpacked."""


@dataclass(frozen=True)
class PhoneLog:
    """IMU [n, 3] in rad/s and m/s^2 (specific force) at ``imu_t_ns``, positions and the host
    times ``position_t_ns`` [k] at which they came."""

    imu_t_ns: IntArray
    gyro: FloatArray
    accel: FloatArray
    positions: Positions | None
    position_t_ns: IntArray | None
    files: tuple[Path, ...]
    warnings: tuple[str, ...]


class Table:
    """Columns of a CSV by name; a cell that is no number is NaN."""

    def __init__(self, name: str, header: list[str], rows: list[list[str]]) -> None:
        self.name = name
        self.index = {column.strip().lower(): i for i, column in enumerate(header)}
        self.rows = [row for row in rows if len(row) >= len(header)]

    def __len__(self) -> int:
        return len(self.rows)

    def floats(self, column: str) -> FloatArray:
        """A column [n]; NaN throughout where there is no such column."""
        at = self.index.get(column.lower())
        if at is None:
            return np.full(len(self.rows), np.nan)
        return np.array([_number(row[at]) for row in self.rows], np.float64)

    def stamps(self, column: str) -> IntArray:
        """A column of whole numbers [n]; InputError where one is not."""
        at = self.index.get(column.lower())
        if at is None:
            raise InputError(
                f"{self.name} has no column {column}; columns are {', '.join(self.index)}."
            )
        try:
            return np.array([int(row[at].split(".")[0]) for row in self.rows], np.int64)
        except (ValueError, OverflowError) as error:
            raise InputError(
                f"{self.name}: column {column} holds {error.args[0]}; export it again."
            ) from None

    def triad(self, x: str, y: str, z: str) -> FloatArray:
        """Three columns [n, 3]; InputError where one is missing."""
        for column in (x, y, z):
            if column.lower() not in self.index:
                raise InputError(
                    f"{self.name} has no column {column}; columns are {', '.join(self.index)}."
                )
        return np.column_stack([self.floats(column) for column in (x, y, z)])


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def read_sensor_logger(source: Path) -> PhoneLog:
    """Read the folder or .zip of one recording of Sensor Logger."""
    texts, files = _csv_texts(source)
    warnings: list[str] = []
    tables = {name: _csv_table(f"{source.name}/{name}", text) for name, text in texts.items()}
    gyro = _first(tables, ("GyroscopeUncalibrated", "Gyroscope"))
    if gyro is None:
        raise InputError(
            f"{source} holds no Gyroscope.csv; record with accelerometer, gyroscope and location."
        )
    t_accel, accel = _specific_force(source, tables, warnings)
    t_gyro, turns = gyro.stamps("time"), gyro.triad("x", "y", "z")
    imu_t_ns, turns, accel = together(t_accel, accel, t_gyro, turns, str(source))
    location = _first(tables, ("LocationGps", "Location"))
    positions, position_t_ns = None, None
    if location is None or not len(location):
        warnings.append(f"{source}: no Location.csv, so the drive has no positions")
    else:
        position_t_ns = location.stamps("time")
        positions = _locations(location, position_t_ns)
    return PhoneLog(imu_t_ns, turns, accel, positions, position_t_ns, tuple(files), tuple(warnings))


def _csv_texts(source: Path) -> tuple[dict[str, str], list[Path]]:
    """The CSV files of a recording by name without suffix."""
    if source.is_dir():
        paths = sorted(source.glob("*.csv"))
        return {p.stem: p.read_text(encoding="utf-8-sig", errors="replace") for p in paths}, paths
    try:
        with zipfile.ZipFile(source) as archive:
            texts = {}
            for entry in archive.infolist():
                stem = Path(entry.filename).stem
                if stem not in _USED or not entry.filename.lower().endswith(".csv"):
                    continue
                if entry.file_size > limits.MAX_UNPACKED_BYTES:
                    raise InputError(
                        f"{source}: {stem}.csv unpacks to {entry.file_size} bytes, more than any "
                        "recording; export it again."
                    )
                if not entry.filename.startswith("__MACOSX"):
                    texts[stem] = archive.read(entry).decode("utf-8-sig", "replace")
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError) as error:
        # a garbled directory would repeat the file itself as a name
        why = str(error)[: limits.SHOWN] or "its end is missing"
        raise InputError(
            f"{source} is no folder and no whole .zip ({why}); export the recording again."
        ) from error
    return texts, [source]


def _csv_table(name: str, text: str) -> Table:
    rows = list(csv.reader(io.StringIO(text.replace("\0", ""))))
    return Table(name, rows[0] if rows else [], rows[1:])


def _first(tables: dict[str, Table], names: Iterable[str]) -> Table | None:
    return next((tables[name] for name in names if name in tables and len(tables[name])), None)


def _specific_force(
    source: Path, tables: dict[str, Table], warnings: list[str]
) -> tuple[IntArray, FloatArray]:
    """What the accelerometer felt, gravity in it, up positive at rest, m/s^2."""
    whole = _first(tables, ("AccelerometerUncalibrated", "TotalAcceleration"))
    if whole is not None:
        t, accel = whole.stamps("time"), whole.triad("x", "y", "z")
    else:
        linear = _first(tables, ("Accelerometer",))
        gravity = _first(tables, ("Gravity",))
        if linear is None or gravity is None:
            raise InputError(
                f"{source} holds neither TotalAcceleration.csv nor AccelerometerUncalibrated.csv "
                "nor Accelerometer.csv with Gravity.csv; record one of them."
            )
        t, accel = linear.stamps("time"), linear.triad("x", "y", "z")
        pull, t_pull = gravity.triad("x", "y", "z"), gravity.stamps("time")
        accel = accel + np.column_stack([_at(t, t_pull, pull[:, k]) for k in range(3)])
    # a garbled reading may be too large to square
    with np.errstate(over="ignore"):
        sizes = np.linalg.norm(accel, axis=1)
    sizes = sizes[np.isfinite(sizes)]
    size = float(np.median(sizes)) if len(sizes) else 0.0
    if 0.5 < size < 2.0:
        accel = accel * STANDARD_GRAVITY
        warnings.append(f"{source}: accelerations of about 1 are taken as g")
    metadata = _first(tables, ("Metadata",))
    ios = metadata is not None and _says(metadata, "platform", "ios")
    if ios and metadata is not None and not _says(metadata, "standardisation", "true"):
        # raw values of iOS point the other way: gravity itself, not what holds against it
        accel = -accel
    return t, accel


def _says(table: Table, column: str, word: str) -> bool:
    at = table.index.get(column)
    return at is not None and any(row[at].strip().lower() == word for row in table.rows)


def _at(t: IntArray, times: IntArray, values: FloatArray) -> FloatArray:
    base = int(times[0])
    order = np.argsort(times, kind="stable")
    seconds = (times[order] - base) * 1e-9
    return np.asarray(np.interp((t - base) * 1e-9, seconds, values[order]))


def together(
    t_accel: IntArray, accel: FloatArray, t_gyro: IntArray, gyro: FloatArray, name: str
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Both sensors at the accelerometer's stamps, where both were on."""
    good = np.isfinite(accel).all(axis=1)
    t_accel, accel = t_accel[good], accel[good]
    good = np.isfinite(gyro).all(axis=1)
    t_gyro, gyro = t_gyro[good], gyro[good]
    if len(t_accel) and len(t_gyro):
        order = np.argsort(t_accel, kind="stable")
        t_accel, accel = t_accel[order], accel[order]
        inside = (t_accel >= t_gyro.min()) & (t_accel <= t_gyro.max())
        t_accel, accel = t_accel[inside], accel[inside]
    if len(t_accel) < 2 or not len(t_gyro):
        raise InputError(f"{name}: accelerometer and gyroscope share no time; record both.")
    turns = np.column_stack([_at(t_accel, t_gyro, gyro[:, k]) for k in range(3)])
    return t_accel, turns, accel


def _locations(table: Table, t_ns: IntArray) -> Positions:
    """Locations; accuracies are the phone's 68 % radii, negative where it has none."""

    def known(column: str) -> FloatArray:
        values = table.floats(column)
        return np.where(values >= 0.0, values, np.nan)

    n = len(table)
    lat, lon = table.floats("latitude"), table.floats("longitude")
    good = np.isfinite(lat) & np.isfinite(lon) & (np.abs(lat) <= 90.0) & (np.abs(lon) <= 180.0)
    return Positions(
        unix_ms=np.asarray(np.rint(t_ns / 1e6), np.int64),
        lat_deg=lat,
        lon_deg=lon,
        height_m=table.floats("altitude"),
        speed_m_s=known("speed"),
        course_deg=known("bearing"),
        down_m_s=np.full(n, np.nan),
        h_acc_m=known("horizontalAccuracy"),
        v_acc_m=known("verticalAccuracy"),
        hdop=np.full(n, np.nan),
        fix=np.where(good, 3, 0),
    )


def read_gnss_logger(source: Path) -> PhoneLog:
    """Read a log of GnssLogger with its sensors and fixes switched on.

    Stamps are ``elapsedRealtimeNanos``, nanoseconds since the phone started.
    """
    if source.is_dir():
        raise InputError(f"{source} is a folder; give the gnss_log_*.txt in it.")
    try:
        text = source.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(f"{source} cannot be read ({error.strerror}); copy it again.") from error
    headers: dict[str, list[str]] = {}
    rows: dict[str, list[list[str]]] = {}
    for line in text.splitlines():
        if line.startswith("#"):
            cells = line.lstrip("# ").split(",")
            if len(cells) > 3:
                headers[cells[0].strip()] = [cell.strip() for cell in cells]
        else:
            cells = line.split(",")
            rows.setdefault(cells[0].strip(), []).append(cells)
    tables = {
        name: Table(f"{source.name} ({name})", header, rows.get(name, []))
        for name, header in headers.items()
    }
    if not tables:
        raise InputError(
            f"{source} is no log of GnssLogger: it has no header lines such as # Fix,Provider,...; "
            "give the gnss_log_*.txt."
        )
    accel, gyro = (_first(tables, (f"Uncal{kind}", kind)) for kind in ("Accel", "Gyro"))
    if accel is None or gyro is None:
        raise InputError(
            f"{source} holds no Accel and Gyro lines; switch the sensors on in GnssLogger's "
            "settings and record again."
        )
    imu = []
    for table, kind, unit in ((accel, "Accel", "Mps2"), (gyro, "Gyro", "RadPerSec")):
        prefix = "Uncal" if f"uncal{kind.lower()}x{unit.lower()}" in table.index else ""
        columns = [f"{prefix}{kind}{axis}{unit}" for axis in "XYZ"]
        imu.append((table.stamps("elapsedRealtimeNanos"), table.triad(*columns)))
    t_ns, turns, force = together(imu[0][0], imu[0][1], imu[1][0], imu[1][1], str(source))
    warnings: list[str] = []
    positions, position_t_ns = _fixes(tables.get("Fix"), source, warnings)
    return PhoneLog(t_ns, turns, force, positions, position_t_ns, (source,), tuple(warnings))


def _fixes(
    table: Table | None, source: Path, warnings: list[str]
) -> tuple[Positions | None, IntArray | None]:
    """The receiver's own fixes; those of the network and fused ones hold no satellites."""
    if table is None or not len(table):
        warnings.append(f"{source}: no Fix lines, so the drive has no positions")
        return None, None
    at = table.index.get("provider")
    if at is not None:
        gps = [row for row in table.rows if row[at].strip().upper() == "GPS"]
        if gps and len(gps) < len(table.rows):
            warnings.append(
                f"{source}: {len(table.rows) - len(gps)} fixes that are not the receiver's own "
                "(fused, network) were left out"
            )
        table.rows = gps or table.rows
    n = len(table)
    lat, lon = table.floats("LatitudeDegrees"), table.floats("LongitudeDegrees")
    good = np.isfinite(lat) & np.isfinite(lon)
    positions = Positions(
        unix_ms=table.stamps("UnixTimeMillis"),
        lat_deg=lat,
        lon_deg=lon,
        height_m=table.floats("AltitudeMeters"),
        speed_m_s=table.floats("SpeedMps"),
        course_deg=table.floats("BearingDegrees"),
        down_m_s=np.full(n, np.nan),
        h_acc_m=table.floats("AccuracyMeters"),
        v_acc_m=table.floats("VerticalAccuracyMeters"),
        hdop=np.full(n, np.nan),
        fix=np.where(good, 3, 0),
    )
    return positions, table.stamps("elapsedRealtimeNanos")
