"""Tables with holes, remarks, other rows and columns."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tests.unit.strangers.drive import (
    DEG,
    EN_IMU,
    PER_G,
    Row,
    Truth,
    fix_rows,
    imu_rows,
    iso,
    seconds,
    since,
    stamp,
    truth,
    write,
)


def holes(folder: Path) -> Truth:
    """NaN, -, n/a, #N/A, --- and empty cells here and there."""
    of = truth()
    marks = ["NaN", "-", "n/a", "#N/A", "---", "", "null", "#DIV/0!", "--", "?", "NA", "inf"]
    rows = imu_rows(of, iso, DEG, PER_G)
    for n, row in enumerate(rows):
        if n % 40 == 7:
            row[1 + n % 6] = marks[n // 40 % len(marks)]
    write(folder / "imu_log.csv", EN_IMU, rows)
    rows = fix_rows(of, iso, height=None, speed=1.0)
    for n, row in enumerate(rows):
        if n % 10 == 3:
            row[3:] = [marks[n // 10 % len(marks)]] * 2
        elif n % 37 == 5:
            row[1:3] = [marks[n // 37 % len(marks)]] * 2
    write(folder / "gps.csv", "time,lat,lon,speed [m/s],course", rows)
    return of


def remarks(folder: Path) -> Truth:
    """A preamble with commas in it, remarks within."""
    of = truth()
    head = (
        "# Logger: X-7, firmware 2.1, serial 0042\n# Started, by hand, on a Friday\n"
        "# rate: 50 Hz, range: 250 deg/s, 2 g\n#\n"
    )
    rows = imu_rows(of, iso, DEG, PER_G)
    lines = [",".join(row) for row in rows]
    lines[100:100] = ["# marker: start of hill"]
    (folder / "imu_log.csv").parent.mkdir(parents=True, exist_ok=True)
    (folder / "imu_log.csv").write_text(head + EN_IMU + "\n" + "\n".join(lines) + "\n")
    write(
        folder / "gps.csv",
        "Device;X-7\nStart;17.05.2024\n\ntime;lat;lon;speed [m/s];course",
        fix_rows(of, iso, height=None, speed=1.0),
        ";",
    )
    return of


def pandas_index(folder: Path) -> Truth:
    """An index without a name, every text in quotes."""
    of = truth()
    header = ',"timestamp","gyro_x","gyro_y","gyro_z","acc_x","acc_y","acc_z"'
    rows = imu_rows(of, lambda t: [stamp('"%Y-%m-%d %H:%M:%S.%L000"', t)], 1.0, 1.0)
    write(folder / "imu_log.csv", header, ([str(n), *row] for n, row in enumerate(rows)))
    write(
        folder / "gps.csv",
        "Unnamed: 0,timestamp,latitude,longitude,speed,heading",
        ([str(n), *row] for n, row in enumerate(fix_rows(of, iso, height=None, speed=1.0))),
    )
    return of


def two_header_lines(folder: Path) -> Truth:
    """Sensors in one line, their axes in the next."""
    of = truth()
    write(
        folder / "imu_log.csv",
        "Time,Gyroscope (deg/s),,,Accelerometer (g),,\n,x,y,z,x,y,z",
        imu_rows(of, iso, DEG, PER_G),
    )
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, iso, height=None, speed=1.0),
    )
    return of


def quoted_commas(folder: Path) -> Truth:
    """Decimal commas between commas: every number in quotes."""
    of = truth()

    def quoted(rows: list[list[str]]) -> Iterable[list[str]]:
        return ([f'"{cell.replace(".", ",")}"' for cell in row] for row in rows)

    def when(t: float) -> list[str]:
        return [stamp("%d.%m.%Y %H:%M:%S,%L", t).replace(".", "@")]

    def dated(rows: list[list[str]]) -> Iterable[list[str]]:
        return ([cell.replace("@", ".") for cell in row] for row in quoted(rows))

    write(
        folder / "messung.csv",
        '"Zeit","Drehrate X [°/s]","Drehrate Y [°/s]","Drehrate Z [°/s]","Beschleunigung X [g]",'
        '"Beschleunigung Y [g]","Beschleunigung Z [g]"',
        dated(imu_rows(of, when, DEG, PER_G)),
    )
    write(
        folder / "gps.csv",
        '"Zeit","Breite","Länge","Geschwindigkeit [km/h]","Kurs [°]"',
        dated(fix_rows(of, when, height=None)),
    )
    return of


def blanks(folder: Path) -> Truth:
    """Columns in line, as printf puts them."""
    of = truth()

    def wide(cells: Iterable[str]) -> list[str]:
        return [f"{cell:>16s}" for cell in cells]

    for name, header, rows in (
        ("imu.txt", "time gx gy gz ax ay az", imu_rows(of, seconds)),
        ("gps.txt", "time lat lon speed course", fix_rows(of, seconds, height=None, speed=1.0)),
    ):
        write(folder / name, " ".join(wide(header.split())), map(wide, rows), " ")
    return of


def one_table(folder: Path) -> Truth:
    """Readings and fixes in one table, cells of the fixes empty between them; time since start."""
    of = truth()
    rows = imu_rows(of, since(of), DEG, PER_G)
    at = np.searchsorted(of.t, of.fix_t)
    fixes: dict[int, Row] = dict(
        zip(at.tolist(), fix_rows(of, iso, height=None, speed=1.0), strict=True)
    )
    write(
        folder / "log.csv",
        "elapsed [s],Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s),Acc X (g),Acc Y (g),Acc Z (g),"
        "GPS UTC,GPS lat,GPS lon,GPS speed [m/s],GPS course",
        ([*row, *fixes.get(n, [""] * 5)] for n, row in enumerate(rows)),
    )
    return of


def two_sensor_tables(folder: Path) -> Truth:
    """Gyroscope and accelerometer in tables of their own."""
    of = truth()
    rows = imu_rows(of, iso)
    write(folder / "gyroscope.csv", "time,x,y,z", (row[:4] for row in rows))
    write(folder / "accelerometer.csv", "time,x,y,z", ([row[0], *row[4:]] for row in rows))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, iso, height=None, speed=1.0),
    )
    return of


def long_format(folder: Path) -> Truth:
    """One reading a row, the sensor named in each."""
    of = truth()
    rows: list[list[str]] = []
    for row in imu_rows(of, iso):
        rows += [[row[0], "gyroscope", *row[1:4]], [row[0], "accelerometer", *row[4:]]]
    write(folder / "log.csv", "time,sensor,x,y,z", rows)
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, iso, height=None, speed=1.0),
    )
    return of


WRITERS = (
    holes,
    remarks,
    pandas_index,
    two_header_lines,
    quoted_commas,
    blanks,
    one_table,
    two_sensor_tables,
    long_format,
)
