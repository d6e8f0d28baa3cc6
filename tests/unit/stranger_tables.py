"""Tables as strangers write them: the sample drive in some fifty layouts, with what is to come out.

Each writer puts the files of one folder down and returns what they tell.
"""

from __future__ import annotations

import shutil
import zipfile
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
_EXCEL_EPOCH = datetime(1899, 12, 30, tzinfo=UTC)


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


def _s(t: float) -> list[str]:
    return [f"{t:.3f}"]


def _since(of: Truth) -> Callable[[float], list[str]]:
    return lambda t: [f"{t - of.t[0]:.3f}"]


def _iso(t: float) -> list[str]:
    return [stamp("%Y-%m-%dT%H:%M:%S.%LZ", t)]


_EN_IMU = "Timestamp,Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s),Acc X (g),Acc Y (g),Acc Z (g)"


def _en_imu(folder: Path, of: Truth) -> None:
    """A table of readings that gives no trouble, beside fixes that may."""
    write(folder / "imu_log.csv", _EN_IMU, imu_rows(of, _iso, DEG, PER_G))


def german_excel(folder: Path) -> Truth:
    """Excel: BOM, CRLF, semicolons, an index, date beside a time of day with a decimal comma."""
    of = truth()

    def when(t: float) -> list[str]:
        return [stamp("%d.%m.%Y", t), stamp("%H:%M:%S,%L", t)]

    rows = imu_rows(of, when, DEG, PER_G)
    write(
        folder / "Messung.csv",
        "Nr.;Datum;Uhrzeit;Drehrate X [°/s];Drehrate Y [°/s];Drehrate Z [°/s];"
        "Beschleunigung X [g];Beschleunigung Y [g];Beschleunigung Z [g]",
        ([str(n + 1), *row] for n, row in enumerate(rows)),
        ";", comma=True, encoding="utf-8-sig", end="\r\n",
    )  # fmt: skip
    write(
        folder / "GPS.csv",
        "Nr.;Datum;Uhrzeit;Breite;Länge;Höhe über Ellipsoid [m];Geschwindigkeit [km/h];Kurs [°]",
        ([str(n + 1), *row] for n, row in enumerate(fix_rows(of, when))),
        ";", comma=True, encoding="utf-8-sig", end="\r\n",
    )  # fmt: skip
    return of


def german_tempo(folder: Path) -> Truth:
    """Tempo is a speed in German."""
    of = truth()
    _en_imu(folder, of)
    write(
        folder / "fahrt.csv",
        "Zeitstempel;Breitengrad;Längengrad;Tempo [km/h];Heading [°]",
        fix_rows(of, _iso, height=None),
        ";", comma=True,
    )  # fmt: skip
    return of


def german_tempo_bare(folder: Path) -> Truth:
    """Tempo without a unit, beside a time of the day and a date; latin-1."""
    of = truth()
    _en_imu(folder, of)

    def when(t: float) -> list[str]:
        return [stamp("%d.%m.%Y %H:%M:%S.%L", t)]

    write(
        folder / "fahrt.csv",
        "Tempo;Zeit;Breite;Länge;Fahrtrichtung",
        ([row[3], row[0], row[1], row[2], row[4]] for row in fix_rows(of, when, height=None)),
        ";", encoding="latin-1",
    )  # fmt: skip
    return of


def french_utf16(folder: Path) -> Truth:
    """UTF-16 with tabs, day first, decimal commas in the times too; cap is the course."""
    of = truth(45.76, 4.84)

    def when(t: float) -> list[str]:
        return [stamp("%d/%m/%Y %H:%M:%S,%L", t)]

    write(
        folder / "centrale.txt",
        "Horodatage\tVitesse angulaire X (°/s)\tVitesse angulaire Y (°/s)\t"
        "Vitesse angulaire Z (°/s)\tAccélération X (g)\tAccélération Y (g)\tAccélération Z (g)",
        imu_rows(of, when, DEG, PER_G),
        "\t", comma=True, encoding="utf-16", end="\r\n",
    )  # fmt: skip
    write(
        folder / "position.txt",
        "Horodatage\tLatitude\tLongitude\tAltitude ellipsoïdale (m)\tVitesse (km/h)\tCap (°)",
        fix_rows(of, when),
        "\t", comma=True, encoding="utf-16", end="\r\n",
    )  # fmt: skip
    return of


def spanish_units_below(folder: Path) -> Truth:
    """Units in a second header row; rumbo is the course."""
    of = truth(40.42, -3.7)
    write(
        folder / "imu.txt",
        "Tiempo;Velocidad angular X;Velocidad angular Y;Velocidad angular Z;Aceleración X;"
        "Aceleración Y;Aceleración Z\ns;grados/s;grados/s;grados/s;m/s2;m/s2;m/s2",
        imu_rows(of, _s, DEG, 1.0),
        ";", comma=True,
    )  # fmt: skip
    write(
        folder / "gps.txt",
        "Tiempo;Latitud;Longitud;Altura elipsoidal;Velocidad;Rumbo\ns;grados;grados;m;km/h;grados",
        fix_rows(of, _s),
        ";", comma=True,
    )  # fmt: skip
    return of


def italian(folder: Path) -> Truth:
    """Tempo is a time in Italian; knots, rotta."""
    of = truth(45.07, 7.69)
    write(
        folder / "sensori.csv",
        "Tempo (ms);Giroscopio X (°/s);Giroscopio Y (°/s);Giroscopio Z (°/s);"
        "Accelerazione X (mg);Accelerazione Y (mg);Accelerazione Z (mg)",
        imu_rows(of, lambda t: [f"{1e3 * t:.0f}"], DEG, 1e3 * PER_G),
        ";", comma=True,
    )  # fmt: skip
    write(
        folder / "posizione.csv",
        "Tempo;Latitudine;Longitudine;Velocità (nodi);Rotta (gradi)",
        fix_rows(of, _s, speed=3600 / 1852, height=None),
        ";", comma=True,
    )  # fmt: skip
    return of


def portuguese(folder: Path) -> Truth:
    """Data and hora, rumo and velocidade."""
    of = truth(38.72, -9.14)

    def when(t: float) -> list[str]:
        return [stamp("%d/%m/%Y", t), stamp("%H:%M:%S.%L", t)]

    write(
        folder / "sensores.csv",
        "Data;Hora;Giroscópio X (°/s);Giroscópio Y (°/s);Giroscópio Z (°/s);Aceleração X (m/s²);"
        "Aceleração Y (m/s²);Aceleração Z (m/s²)",
        imu_rows(of, when, DEG, 1.0),
        ";",
    )
    write(
        folder / "gps.csv",
        "Data;Hora;Latitude;Longitude;Velocidade (km/h);Rumo (°)",
        fix_rows(of, when, height=None),
        ";",
    )
    return of


def dutch(folder: Path) -> Truth:
    """Tijd, snelheid, koers; a zone in the times."""
    of = truth(52.37, 4.9)

    def when(t: float) -> list[str]:
        return [stamp("%Y-%m-%d %H:%M:%S.%L+02:00", t, 2.0)]

    write(
        folder / "meting.csv",
        "Tijdstempel,Hoeksnelheid X [rad/s],Hoeksnelheid Y [rad/s],Hoeksnelheid Z [rad/s],"
        "Versnelling X [m/s²],Versnelling Y [m/s²],Versnelling Z [m/s²]",
        imu_rows(of, when),
    )
    write(
        folder / "positie.csv",
        "Tijdstempel,Breedtegraad,Lengtegraad,Snelheid [km/u],Koers [°]",
        fix_rows(of, when, height=None),
    )
    return of


def american(folder: Path) -> Truth:
    """Month first, a 12-hour clock, mph, feet, heading."""
    of = truth(30.33, -97.76)

    def when(t: float) -> list[str]:
        return [stamp("%m/%d/%Y %I:%M:%S.%L %p", t)]

    write(
        folder / "imu_export.csv",
        "Date/Time,Gyro X (dps),Gyro Y (dps),Gyro Z (dps),Accel X (g),Accel Y (g),Accel Z (g)",
        imu_rows(of, when, DEG, PER_G),
    )
    write(
        folder / "gps_export.csv",
        "Date/Time,Latitude,Longitude,Altitude HAE (ft),Speed (mph),Heading",
        fix_rows(of, when, speed=1 / 0.44704, height=1 / 0.3048),
    )
    return of


def _dms(value: float, signs: str, degree: str = "°", minute: str = "'", second: str = '"') -> str:
    size = abs(value)
    whole, minutes = int(size), int(size * 60) % 60
    seconds = (size * 60 - int(size * 60)) * 60
    return f"{whole}{degree}{minutes:02d}{minute}{seconds:07.4f}{second}{signs[value < 0]}"


def degrees_minutes_seconds(folder: Path) -> Truth:
    """Degrees, minutes, seconds and a letter of the hemisphere."""
    of = truth(-33.87, -70.6)
    _en_imu(folder, of)
    rows = fix_rows(of, _iso, height=None)
    write(
        folder / "gps.csv",
        "Time;Latitude;Longitude;Speed (km/h);Course",
        (
            [row[0], _dms(float(row[1]), "NS"), _dms(float(row[2]), "EW"), *row[3:]]
            for row in rows
        ),
        ";",
    )  # fmt: skip
    return of


def degrees_and_minutes_of_nmea(folder: Path) -> Truth:
    """ddmm.mmmm as a receiver's sentences have it, the hemispheres in columns of their own."""
    of = truth(-35.28, 149.13)
    _en_imu(folder, of)

    def nmea(value: float) -> str:
        size = abs(value)
        return f"{int(size) * 100 + (size - int(size)) * 60:.6f}"

    write(
        folder / "gps.csv",
        "UTC,Latitude,N/S,Longitude,E/W,Speed (knots),Course",
        (
            [row[0], nmea(float(row[1])), "S", nmea(float(row[2])), "E", *row[3:]]
            for row in fix_rows(of, _iso, height=None, speed=3600 / 1852)
        ),
    )
    return of


def hemisphere_letters(folder: Path) -> Truth:
    """Letters in the cells: 35.28 S."""
    of = truth(-35.28, -70.6)
    _en_imu(folder, of)
    write(
        folder / "gps.csv",
        "Time,Lat,Lon,Speed [m/s],Course [deg]",
        (
            [row[0], f"{-float(row[1]):.8f} S", f"{-float(row[2]):.8f} W", *row[3:]]
            for row in fix_rows(of, _iso, height=None, speed=1.0)
        ),
    )
    return of


def hemisphere_columns(folder: Path) -> Truth:
    """Decimal degrees without a sign, the letters in columns of their own."""
    of = truth(-35.28, -70.6)
    _en_imu(folder, of)
    write(
        folder / "gps.csv",
        "Time,Latitude,NS,Longitude,EW,Speed [m/s],Course [deg]",
        (
            [row[0], f"{-float(row[1]):.8f}", "S", f"{-float(row[2]):.8f}", "W", *row[3:]]
            for row in fix_rows(of, _iso, height=None, speed=1.0)
        ),
    )
    return of


def utm(folder: Path) -> Truth:
    """Eastings and northings of UTM."""
    of = truth()
    _en_imu(folder, of)
    write(
        folder / "gps.csv",
        "Time,Easting,Northing,Zone,Speed [m/s],Course [deg]",
        (
            [row[0], f"{690000 + 74000 * (float(row[2]) - 11.5):.3f}",
             f"{5330000 + 111200 * (float(row[1]) - 48.1):.3f}", "32U", *row[3:]]
            for row in fix_rows(of, _iso, height=None, speed=1.0)
        ),
    )  # fmt: skip
    return of


def milli_units_bare(folder: Path) -> Truth:
    """Whole mg and milli-degrees a second, nothing tells so."""
    of = truth()
    write(
        folder / "imu_log.csv",
        "time,gx,gy,gz,ax,ay,az",
        imu_rows(of, _iso, 1e3 * DEG, 1e3 * PER_G, digits=0),
    )
    write(folder / "gps.csv", "time,lat,lon,speed,course", fix_rows(of, _iso, height=None))
    return of


def counts(folder: Path) -> Truth:
    """Whole counts of 16 bits: 131 for a degree a second, 16384 for a g."""
    of = truth()
    write(
        folder / "imu_log.csv",
        "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z",
        imu_rows(of, _iso, 131.0 * DEG, 16384.0 * PER_G, digits=0),
    )
    write(folder / "gps.csv", "time,lat,lon,speed,course", fix_rows(of, _iso, height=None))
    return of


def holes(folder: Path) -> Truth:
    """NaN, -, n/a, #N/A, --- and empty cells here and there."""
    of = truth()
    marks = ["NaN", "-", "n/a", "#N/A", "---", "", "null", "#DIV/0!", "--", "?", "NA", "inf"]
    rows = imu_rows(of, _iso, DEG, PER_G)
    for n, row in enumerate(rows):
        if n % 40 == 7:
            row[1 + n % 6] = marks[n // 40 % len(marks)]
    write(folder / "imu_log.csv", _EN_IMU, rows)
    rows = fix_rows(of, _iso, height=None, speed=1.0)
    for n, row in enumerate(rows):
        if n % 10 == 3:
            row[3:] = [marks[n // 10 % len(marks)]] * 2
        elif n % 37 == 5:
            row[1:3] = [marks[n // 37 % len(marks)]] * 2
    write(folder / "gps.csv", "time,lat,lon,speed [m/s],course", rows)
    return of


def thousands(folder: Path) -> Truth:
    """Thousands separators: heights and readings of mg in quotes."""
    of = truth()

    def grouped(text: str, digits: int) -> str:
        return f'"{float(text):,.{digits}f}"'

    rows = imu_rows(of, _iso, DEG, 1e3 * PER_G)
    write(
        folder / "imu_log.csv",
        _EN_IMU.replace("(g)", "(mg)"),
        ([*row[:4], *(grouped(cell, 4) for cell in row[4:])] for row in rows),
    )
    write(
        folder / "gps.csv",
        "time,lat,lon,height [ft],speed [m/s],course",
        (
            [*row[:3], grouped(row[3], 3), *row[4:]]
            for row in fix_rows(of, _iso, height=1 / 0.3048, speed=1.0)
        ),
    )
    return of


def german_thousands(folder: Path) -> Truth:
    """1.234,56: points part the thousands where commas are decimal."""
    of = truth()

    def grouped(text: str) -> str:
        return f"{float(text):,.3f}".replace(",", " ").replace(".", ",").replace(" ", ".")

    rows = imu_rows(of, _iso, DEG, 1e3 * PER_G)
    write(
        folder / "imu_log.csv",
        "Zeit;Drehrate X [°/s];Drehrate Y [°/s];Drehrate Z [°/s];Beschl. X [mg];Beschl. Y [mg];"
        "Beschl. Z [mg]",
        ([row[0], *(cell.replace(".", ",") for cell in row[1:4]), *map(grouped, row[4:])]
         for row in rows),
        ";",
    )  # fmt: skip
    write(
        folder / "gps.csv",
        "Zeit;Breite;Länge;Geschwindigkeit [km/h];Kurs",
        fix_rows(of, _iso, height=None),
        ";", comma=True,
    )  # fmt: skip
    return of


def remarks(folder: Path) -> Truth:
    """A preamble with commas in it, remarks within."""
    of = truth()
    head = (
        "# Logger: X-7, firmware 2.1, serial 0042\n# Started, by hand, on a Friday\n"
        "# rate: 50 Hz, range: 250 deg/s, 2 g\n#\n"
    )
    rows = imu_rows(of, _iso, DEG, PER_G)
    lines = [",".join(row) for row in rows]
    lines[100:100] = ["# marker: start of hill"]
    (folder / "imu_log.csv").parent.mkdir(parents=True, exist_ok=True)
    (folder / "imu_log.csv").write_text(head + _EN_IMU + "\n" + "\n".join(lines) + "\n")
    write(
        folder / "gps.csv",
        "Device;X-7\nStart;17.05.2024\n\ntime;lat;lon;speed [m/s];course",
        fix_rows(of, _iso, height=None, speed=1.0),
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
        ([str(n), *row] for n, row in enumerate(fix_rows(of, _iso, height=None, speed=1.0))),
    )
    return of


def backwards(folder: Path) -> Truth:
    """The newest row first."""
    of = truth()
    write(folder / "imu_log.csv", _EN_IMU, imu_rows(of, _iso, DEG, PER_G)[::-1])
    rows = fix_rows(of, _iso, height=None, speed=1.0)
    write(folder / "gps.csv", "time,lat,lon,speed [m/s],course", rows[::-1])
    return of


def shuffled(folder: Path) -> Truth:
    """Rows in no order at all."""
    of = truth()
    random = np.random.default_rng(3)
    imu, gps = imu_rows(of, _iso, DEG, PER_G), fix_rows(of, _iso, height=None, speed=1.0)
    write(folder / "imu_log.csv", _EN_IMU, (imu[n] for n in random.permutation(len(imu))))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        (gps[n] for n in random.permutation(len(gps))),
    )
    return of


def two_header_lines(folder: Path) -> Truth:
    """Sensors in one line, their axes in the next."""
    of = truth()
    write(
        folder / "imu_log.csv",
        "Time,Gyroscope (deg/s),,,Accelerometer (g),,\n,x,y,z,x,y,z",
        imu_rows(of, _iso, DEG, PER_G),
    )
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, _iso, height=None, speed=1.0),
    )
    return of


def excel_serial(folder: Path) -> Truth:
    """Days since 1899, as Excel counts."""
    of = truth()

    def when(t: float) -> list[str]:
        return [f"{(date(t) - _EXCEL_EPOCH).total_seconds() / 86400.0:.9f}"]

    write(
        folder / "imu_log.csv",
        "Datum;" + _EN_IMU.replace(",", ";").partition(";")[2],
        imu_rows(of, when, DEG, PER_G),
        ";", comma=True,
    )  # fmt: skip
    write(
        folder / "gps.csv",
        "Zeit;Breite;Länge;Geschwindigkeit [km/h];Kurs",
        fix_rows(of, when, height=None),
        ";", comma=True,
    )  # fmt: skip
    return of


def matlab_dates(folder: Path) -> Truth:
    """17-May-2024 08:59:58.250."""
    of = truth()

    def when(t: float) -> list[str]:
        return [stamp("%d-%b-%Y %H:%M:%S.%L", t)]

    write(folder / "imu_log.csv", _EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, when, height=None, speed=1.0),
    )
    return of


def gps_weeks(folder: Path) -> Truth:
    """GPS week and milliseconds of it."""
    of = truth()

    def when(t: float) -> list[str]:
        gps = t - 315964800 + 18
        return [f"{int(gps // 604800)}", f"{1e3 * (gps % 604800):.0f}"]

    write(
        folder / "imu_log.csv",
        "GPS Week,TOW (ms)," + _EN_IMU.partition(",")[2],
        imu_rows(of, when, DEG, PER_G),
    )
    write(
        folder / "gps.csv",
        "GPS Week,TOW (ms),lat,lon,speed [m/s],course",
        fix_rows(of, when, height=None, speed=1.0),
    )
    return of


def minutes_only(folder: Path) -> Truth:
    """mm:ss.0, which is what Excel shows of a time and then writes."""
    of = truth()

    def when(t: float) -> list[str]:
        return [stamp("%M:%S.%L", t)[:-2]]

    write(folder / "imu_log.csv", _EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, when, height=None, speed=1.0),
    )
    return of


def minutes_and_seconds(folder: Path) -> Truth:
    """mm:ss of fixes, once a second, which looks like hours and minutes."""
    of = truth()
    _en_imu(folder, of)
    rows = fix_rows(of, lambda t: [stamp("%M:%S", t)], height=None, speed=1.0)[::5]
    write(folder / "gps.csv", "time,lat,lon,speed [m/s],course", rows)
    return of


def whole_seconds(folder: Path) -> Truth:
    """Fifty readings with the same second."""
    of = truth()

    def when(t: float) -> list[str]:
        return [stamp("%Y-%m-%d %H:%M:%S", t)]

    write(folder / "imu_log.csv", _EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, _iso, height=None, speed=1.0),
    )
    return of


def linear_acceleration(folder: Path) -> Truth:
    """Gravity taken off by a phone."""
    of = truth()
    rows = [
        [*row[:4], *(num(v, 5) for v in a + np.array([0.0, 0.0, STANDARD_GRAVITY]))]
        for row, a in zip(imu_rows(of, _iso), of.accel, strict=True)
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
        fix_rows(of, _iso, height=None, speed=1.0),
    )
    return of


def swapped(folder: Path) -> Truth:
    """The header says the wrong way round which is latitude."""
    of = truth()
    _en_imu(folder, of)
    write(
        folder / "gps.csv",
        "time,longitude,latitude,speed [m/s],course",
        fix_rows(of, _iso, height=None, speed=1.0),
    )
    return of


def attitude_only(folder: Path) -> Truth:
    """Angles in place of rates."""
    of = truth()
    write(
        folder / "imu_log.csv",
        "time,roll,pitch,yaw,acc_x,acc_y,acc_z",
        imu_rows(of, _iso, DEG, PER_G),
    )
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, _iso, height=None, speed=1.0),
    )
    return of


def radians(folder: Path) -> Truth:
    """Latitude, longitude and course in radians, nothing tells so."""
    of = truth()
    _en_imu(folder, of)
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        (
            [row[0], f"{np.radians(float(row[1])):.12f}", f"{np.radians(float(row[2])):.12f}",
             *row[3:]]
            for row in fix_rows(of, _iso, height=None, speed=1.0, course=1.0)
        ),
    )  # fmt: skip
    return of


def scaled_integers(folder: Path) -> Truth:
    """Degrees times 1e7, mm and mm/s, as u-blox has them; nothing tells so."""
    of = truth()
    _en_imu(folder, of)
    write(
        folder / "gps.csv",
        "time,lat,lon,height,gSpeed,headMot",
        (
            [row[0], f"{1e7 * float(row[1]):.0f}", f"{1e7 * float(row[2]):.0f}",
             *(f"{float(cell):.0f}" for cell in row[3:])]
            for row in fix_rows(of, _iso, height=1e3, speed=1e3, course=1e5 * DEG)
        ),
    )  # fmt: skip
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
        ("imu.txt", "time gx gy gz ax ay az", imu_rows(of, _s)),
        ("gps.txt", "time lat lon speed course", fix_rows(of, _s, height=None, speed=1.0)),
    ):
        write(folder / name, " ".join(wide(header.split())), map(wide, rows), " ")
    return of


def compass_beside_course(folder: Path) -> Truth:
    """A phone's compass beside the receiver's course."""
    of = truth()
    _en_imu(folder, of)
    rows = fix_rows(of, _iso, height=None, speed=1.0)
    write(
        folder / "gps.csv",
        "time,lat,lon,compass heading,magnetic heading,speed [m/s],course",
        ([*row[:3], "123.4", "120.1", *row[3:]] for row in rows),
    )
    return of


def one_table(folder: Path) -> Truth:
    """Readings and fixes in one table, cells of the fixes empty between them; time since start."""
    of = truth()
    rows = imu_rows(of, _since(of), DEG, PER_G)
    at = np.searchsorted(of.t, of.fix_t)
    fixes: dict[int, Row] = dict(
        zip(at.tolist(), fix_rows(of, _iso, height=None, speed=1.0), strict=True)
    )
    write(
        folder / "log.csv",
        "elapsed [s],Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s),Acc X (g),Acc Y (g),Acc Z (g),"
        "GPS UTC,GPS lat,GPS lon,GPS speed [m/s],GPS course",
        ([*row, *fixes.get(n, [""] * 5)] for n, row in enumerate(rows)),
    )
    return of


def micros_wrap(folder: Path) -> Truth:
    """An Arduino's micros(), which begin again at zero after 2^32."""
    of = truth()

    def when(t: float) -> list[str]:
        return [f"{(round(1e6 * (t - of.t[0])) + 2**32 - 30_000_000) % 2**32}"]

    write(
        folder / "imu_log.csv",
        "micros," + _EN_IMU.partition(",")[2],
        imu_rows(of, when, DEG, PER_G),
    )
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, _iso, height=None, speed=1.0),
    )
    return of


def local_times(folder: Path) -> Truth:
    """Both in local time, and nothing says which zone."""
    of = truth()

    def when(t: float) -> list[str]:
        return [stamp("%Y-%m-%d %H:%M:%S.%L", t, 2.0)]

    write(folder / "imu_log.csv", _EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, when, height=None, speed=1.0),
    )
    return of


def two_sensor_tables(folder: Path) -> Truth:
    """Gyroscope and accelerometer in tables of their own."""
    of = truth()
    rows = imu_rows(of, _iso)
    write(folder / "gyroscope.csv", "time,x,y,z", (row[:4] for row in rows))
    write(folder / "accelerometer.csv", "time,x,y,z", ([row[0], *row[4:]] for row in rows))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, _iso, height=None, speed=1.0),
    )
    return of


def long_format(folder: Path) -> Truth:
    """One reading a row, the sensor named in each."""
    of = truth()
    rows: list[list[str]] = []
    for row in imu_rows(of, _iso):
        rows += [[row[0], "gyroscope", *row[1:4]], [row[0], "accelerometer", *row[4:]]]
    write(folder / "log.csv", "time,sensor,x,y,z", rows)
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, _iso, height=None, speed=1.0),
    )
    return of


def counter_clockwise(folder: Path) -> Truth:
    """Courses from east, counter-clockwise, as robots have them."""
    of = truth()
    _en_imu(folder, of)
    rows = fix_rows(of, _iso, height=None, speed=1.0)
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],heading [deg]",
        ([*row[:4], num((90.0 - float(row[4])) % 360.0, 4)] for row in rows),
    )
    return of


def either_month(folder: Path) -> Truth:
    """05/03/2026, which is the fifth of March here and the third of May in America."""
    of = truth()

    def when(t: float) -> list[str]:
        return [stamp("%d/%m/%Y %H:%M:%S.%L", t - 9 * 86400.0)]

    write(folder / "imu_log.csv", _EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, when, height=None, speed=1.0),
    )
    return of


def phyphox(folder: Path) -> Truth:
    """A table for each sensor, all of one clock that begins with the recording."""
    of = truth()
    rows = imu_rows(of, _since(of))
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
        fix_rows(of, _since(of), speed=1.0),
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


def parted_degrees(folder: Path) -> Truth:
    """Degrees in one column, their minutes in the next."""
    of = truth()
    _en_imu(folder, of)

    def parted(cell: str) -> list[str]:
        value = float(cell)
        return [str(int(value)), num((value - int(value)) * 60.0)]

    rows = fix_rows(of, _iso, height=None, speed=1.0)
    write(
        folder / "gps.csv",
        "time,Lat deg,Lat min,Lon deg,Lon min,speed [m/s],course",
        ([row[0], *parted(row[1]), *parted(row[2]), *row[3:]] for row in rows),
    )
    return of


def west_in_the_header(folder: Path) -> Truth:
    """Longitudes west of Greenwich without a sign."""
    of = truth(40.0, -100.0)
    _en_imu(folder, of)
    rows = fix_rows(of, _iso, height=None, speed=1.0)
    write(
        folder / "gps.csv",
        "time,Latitude (N),Longitude (W),speed [m/s],course",
        ([*row[:2], row[2].removeprefix("-"), *row[3:]] for row in rows),
    )
    return of


def signed_courses(folder: Path) -> Truth:
    """Courses from -180 to 180."""
    of = truth()
    _en_imu(folder, of)
    rows = fix_rows(of, _iso, height=None, speed=1.0)
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        ([*row[:4], num((float(row[4]) + 180.0) % 360.0 - 180.0)] for row in rows),
    )
    return of


def compact_times(folder: Path) -> Truth:
    """hhmmss.sss as NMEA has it, and no date; the readings count from midnight."""
    of = truth()
    write(
        folder / "imu_log.csv",
        _EN_IMU,
        imu_rows(of, lambda t: [stamp("%H:%M:%S.%L", t)], DEG, PER_G),
    )
    write(
        folder / "gps.csv",
        "UTC,lat,lon,speed [m/s],course",
        fix_rows(of, lambda t: [stamp("%H%M%S.%L", t)], height=None, speed=1.0),
    )
    return of


def heights_in_feet(folder: Path) -> Truth:
    """Heights in feet, which nothing tells."""
    of = truth()
    _en_imu(folder, of)
    write(
        folder / "gps.csv",
        "time,lat,lon,ellipsoidal height,speed,course",
        fix_rows(of, _iso, height=1 / 0.3048, speed=1.0),
    )
    return of


def scientific_times(folder: Path) -> Truth:
    """Milliseconds since 1970 as a spreadsheet shows them: 1.77348E+12."""
    of = truth()

    def when(t: float) -> list[str]:
        return [f"{1e3 * t:.5E}"]

    write(folder / "imu_log.csv", _EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, when, height=None, speed=1.0),
    )
    return of


WRITERS: tuple[Callable[[Path], Truth], ...] = (
    german_excel, german_tempo, german_tempo_bare, french_utf16, spanish_units_below, italian,
    portuguese, dutch, american, degrees_minutes_seconds, degrees_and_minutes_of_nmea,
    hemisphere_letters, hemisphere_columns, utm, milli_units_bare, counts, holes, thousands,
    german_thousands, remarks, pandas_index, backwards, shuffled, two_header_lines, excel_serial,
    matlab_dates, gps_weeks, minutes_only, minutes_and_seconds, whole_seconds, linear_acceleration,
    swapped, attitude_only, radians, scaled_integers, quoted_commas, blanks, compass_beside_course,
    one_table, micros_wrap, local_times, two_sensor_tables, long_format, counter_clockwise,
    either_month, phyphox, phyphox_archive, physics_toolbox, androsensor,
    parted_degrees, west_in_the_header, signed_courses, compact_times, heights_in_feet,
    scientific_times,
)  # fmt: skip
