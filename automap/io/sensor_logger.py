"""Recordings of the phone application Sensor Logger: a folder or .zip of CSV files.

References: its documentation (tszheichoi/awesome-sensor-logger: units, axes and the setting
"standardisation").
"""

from __future__ import annotations

import csv
import io
import re
import zipfile
import zlib
from pathlib import Path

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.errors import InputError
from automap.io import limits
from automap.io.nmea_writer import Positions
from automap.io.phone_logs import PhoneLog, Table, at_times, first_of, placed, together
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
_COPY = re.compile(r"([A-Za-z]+)[ _(-]")
"""How systems name a second file of one name: ``Location (1)``, ``Location - Copy``."""


def read_sensor_logger(source: Path) -> PhoneLog:
    """Read the folder or .zip of one recording of Sensor Logger."""
    texts, files = _csv_texts(source)
    warnings: list[str] = []
    copies = [name for name in texts if (part := _COPY.match(name)) and part[1] in _USED]
    if copies:
        warnings.append(
            f"{source}: {len(copies)} files have names of a second recording, such as "
            f"{copies[0]}.csv, and are not used; give each recording a folder of its own"
        )
    tables = {name: _csv_table(f"{source.name}/{name}", text) for name, text in texts.items()}
    gyro = first_of(tables, ("GyroscopeUncalibrated", "Gyroscope"))
    if gyro is None:
        raise InputError(
            f"{source} holds no readings in a Gyroscope.csv; record with accelerometer, gyroscope "
            "and location."
        )
    t_accel, accel = _specific_force(source, tables, warnings)
    t_gyro, turns = gyro.stamps("time"), gyro.triad("x", "y", "z")
    imu_t_ns, turns, accel = together(t_accel, accel, t_gyro, turns, str(source))
    location = first_of(tables, ("LocationGps", "Location"))
    positions, position_t_ns = None, None
    if location is None or not len(location):
        warnings.append(f"{source}: no rows in a Location.csv, so the drive has no positions")
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
                    if stem in texts:
                        raise InputError(
                            f"{source}: holds several recordings, each with a {stem}.csv; unpack "
                            "it, and give the folder of one."
                        )
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


def _specific_force(
    source: Path, tables: dict[str, Table], warnings: list[str]
) -> tuple[IntArray, FloatArray]:
    """What the accelerometer felt, gravity in it, up positive at rest, m/s^2."""
    whole = first_of(tables, ("AccelerometerUncalibrated", "TotalAcceleration"))
    if whole is not None:
        t, accel = whole.stamps("time"), whole.triad("x", "y", "z")
    else:
        linear = first_of(tables, ("Accelerometer",))
        gravity = first_of(tables, ("Gravity",))
        if linear is None or gravity is None:
            raise InputError(
                f"{source} holds no readings in TotalAcceleration.csv, "
                "AccelerometerUncalibrated.csv or Accelerometer.csv with Gravity.csv; record one."
            )
        t, accel = linear.stamps("time"), linear.triad("x", "y", "z")
        pull, t_pull = gravity.triad("x", "y", "z"), gravity.stamps("time")
        accel = accel + np.column_stack([at_times(t, t_pull, pull[:, k]) for k in range(3)])
    # a garbled reading may be too large to square
    with np.errstate(over="ignore"):
        sizes = np.linalg.norm(accel, axis=1)
    sizes = sizes[np.isfinite(sizes)]
    size = float(np.median(sizes)) if len(sizes) else 0.0
    if 0.5 < size < 2.0:
        accel = accel * STANDARD_GRAVITY
        warnings.append(f"{source}: accelerations of about 1 are taken as g")
    metadata = first_of(tables, ("Metadata",))
    ios = metadata is not None and _says(metadata, "platform", "ios")
    if ios and metadata is not None and not _says(metadata, "standardisation", "true"):
        # raw values of iOS point the other way: gravity itself, not what holds against it
        accel = -accel
    return t, accel


def _says(table: Table, column: str, word: str) -> bool:
    at = table.index.get(column)
    return at is not None and any(row[at].strip().lower() == word for row in table.rows)


def _locations(table: Table, t_ns: IntArray) -> Positions:
    """Locations; accuracies are the phone's 68 % radii, negative where it has none."""

    def known(column: str) -> FloatArray:
        values = table.floats(column)
        return np.where(values >= 0.0, values, np.nan)

    n = len(table)
    lat, lon = table.floats("latitude"), table.floats("longitude")
    good = placed(lat, lon, table.name)
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
