"""Logs of Google's GnssLogger.

References: gps-measurement-tools of Google, GnssLogger's log header.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.nmea_writer import Positions
from automap.io.phone_logs import PhoneLog, Table, first_of, placed, together
from automap.records import IntArray


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
    accel, gyro = (first_of(tables, (f"Uncal{kind}", kind)) for kind in ("Accel", "Gyro"))
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
    good = placed(lat, lon, f"{source} (Fix)")
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
