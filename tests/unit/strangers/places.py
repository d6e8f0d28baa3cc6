"""Tables whose positions and courses are written in other ways."""

from __future__ import annotations

from pathlib import Path

from tests.unit.strangers.drive import Truth, en_imu, fix_rows, iso, num, truth, write


def dms(value: float, signs: str, degree: str = "°", minute: str = "'", second: str = '"') -> str:
    size = abs(value)
    whole, minutes = int(size), int(size * 60) % 60
    seconds = (size * 60 - int(size * 60)) * 60
    return f"{whole}{degree}{minutes:02d}{minute}{seconds:07.4f}{second}{signs[value < 0]}"


def degrees_minutes_seconds(folder: Path) -> Truth:
    """Degrees, minutes, seconds and a letter of the hemisphere."""
    of = truth(-33.87, -70.6)
    en_imu(folder, of)
    rows = fix_rows(of, iso, height=None)
    write(
        folder / "gps.csv",
        "Time;Latitude;Longitude;Speed (km/h);Course",
        (
            [row[0], dms(float(row[1]), "NS"), dms(float(row[2]), "EW"), *row[3:]]
            for row in rows
        ),
        ";",
    )  # fmt: skip
    return of


def degrees_and_minutes_of_nmea(folder: Path) -> Truth:
    """ddmm.mmmm as a receiver's sentences have it, the hemispheres in columns of their own."""
    of = truth(-35.28, 149.13)
    en_imu(folder, of)

    def nmea(value: float) -> str:
        size = abs(value)
        return f"{int(size) * 100 + (size - int(size)) * 60:.6f}"

    write(
        folder / "gps.csv",
        "UTC,Latitude,N/S,Longitude,E/W,Speed (knots),Course",
        (
            [row[0], nmea(float(row[1])), "S", nmea(float(row[2])), "E", *row[3:]]
            for row in fix_rows(of, iso, height=None, speed=3600 / 1852)
        ),
    )
    return of


def hemisphere_letters(folder: Path) -> Truth:
    """Letters in the cells: 35.28 S."""
    of = truth(-35.28, -70.6)
    en_imu(folder, of)
    write(
        folder / "gps.csv",
        "Time,Lat,Lon,Speed [m/s],Course [deg]",
        (
            [row[0], f"{-float(row[1]):.8f} S", f"{-float(row[2]):.8f} W", *row[3:]]
            for row in fix_rows(of, iso, height=None, speed=1.0)
        ),
    )
    return of


def hemisphere_columns(folder: Path) -> Truth:
    """Decimal degrees without a sign, the letters in columns of their own."""
    of = truth(-35.28, -70.6)
    en_imu(folder, of)
    write(
        folder / "gps.csv",
        "Time,Latitude,NS,Longitude,EW,Speed [m/s],Course [deg]",
        (
            [row[0], f"{-float(row[1]):.8f}", "S", f"{-float(row[2]):.8f}", "W", *row[3:]]
            for row in fix_rows(of, iso, height=None, speed=1.0)
        ),
    )
    return of


def utm(folder: Path) -> Truth:
    """Eastings and northings of UTM."""
    of = truth()
    en_imu(folder, of)
    write(
        folder / "gps.csv",
        "Time,Easting,Northing,Zone,Speed [m/s],Course [deg]",
        (
            [row[0], f"{690000 + 74000 * (float(row[2]) - 11.5):.3f}",
             f"{5330000 + 111200 * (float(row[1]) - 48.1):.3f}", "32U", *row[3:]]
            for row in fix_rows(of, iso, height=None, speed=1.0)
        ),
    )  # fmt: skip
    return of


def swapped(folder: Path) -> Truth:
    """The header says the wrong way round which is latitude."""
    of = truth()
    en_imu(folder, of)
    write(
        folder / "gps.csv",
        "time,longitude,latitude,speed [m/s],course",
        fix_rows(of, iso, height=None, speed=1.0),
    )
    return of


def compass_beside_course(folder: Path) -> Truth:
    """A phone's compass beside the receiver's course."""
    of = truth()
    en_imu(folder, of)
    rows = fix_rows(of, iso, height=None, speed=1.0)
    write(
        folder / "gps.csv",
        "time,lat,lon,compass heading,magnetic heading,speed [m/s],course",
        ([*row[:3], "123.4", "120.1", *row[3:]] for row in rows),
    )
    return of


def counter_clockwise(folder: Path) -> Truth:
    """Courses from east, counter-clockwise, as robots have them."""
    of = truth()
    en_imu(folder, of)
    rows = fix_rows(of, iso, height=None, speed=1.0)
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],heading [deg]",
        ([*row[:4], num((90.0 - float(row[4])) % 360.0, 4)] for row in rows),
    )
    return of


def parted_degrees(folder: Path) -> Truth:
    """Degrees in one column, their minutes in the next."""
    of = truth()
    en_imu(folder, of)

    def parted(cell: str) -> list[str]:
        value = float(cell)
        return [str(int(value)), num((value - int(value)) * 60.0)]

    rows = fix_rows(of, iso, height=None, speed=1.0)
    write(
        folder / "gps.csv",
        "time,Lat deg,Lat min,Lon deg,Lon min,speed [m/s],course",
        ([row[0], *parted(row[1]), *parted(row[2]), *row[3:]] for row in rows),
    )
    return of


def west_in_the_header(folder: Path) -> Truth:
    """Longitudes west of Greenwich without a sign."""
    of = truth(40.0, -100.0)
    en_imu(folder, of)
    rows = fix_rows(of, iso, height=None, speed=1.0)
    write(
        folder / "gps.csv",
        "time,Latitude (N),Longitude (W),speed [m/s],course",
        ([*row[:2], row[2].removeprefix("-"), *row[3:]] for row in rows),
    )
    return of


def signed_courses(folder: Path) -> Truth:
    """Courses from -180 to 180."""
    of = truth()
    en_imu(folder, of)
    rows = fix_rows(of, iso, height=None, speed=1.0)
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        ([*row[:4], num((float(row[4]) + 180.0) % 360.0 - 180.0)] for row in rows),
    )
    return of


WRITERS = (
    degrees_minutes_seconds,
    degrees_and_minutes_of_nmea,
    hemisphere_letters,
    hemisphere_columns,
    utm,
    swapped,
    compass_beside_course,
    counter_clockwise,
    parted_degrees,
    west_in_the_header,
    signed_courses,
)
