"""Tables whose times are dates, serials, weeks, or have lost a part."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.unit.strangers.drive import (
    DEG,
    EN_IMU,
    EXCEL_EPOCH,
    PER_G,
    Truth,
    date,
    en_imu,
    fix_rows,
    imu_rows,
    iso,
    stamp,
    truth,
    write,
)


def backwards(folder: Path) -> Truth:
    """The newest row first."""
    of = truth()
    write(folder / "imu_log.csv", EN_IMU, imu_rows(of, iso, DEG, PER_G)[::-1])
    rows = fix_rows(of, iso, height=None, speed=1.0)
    write(folder / "gps.csv", "time,lat,lon,speed [m/s],course", rows[::-1])
    return of


def shuffled(folder: Path) -> Truth:
    """Rows in no order at all."""
    of = truth()
    random = np.random.default_rng(3)
    imu, gps = imu_rows(of, iso, DEG, PER_G), fix_rows(of, iso, height=None, speed=1.0)
    write(folder / "imu_log.csv", EN_IMU, (imu[n] for n in random.permutation(len(imu))))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        (gps[n] for n in random.permutation(len(gps))),
    )
    return of


def excel_serial(folder: Path) -> Truth:
    """Days since 1899, as Excel counts."""
    of = truth()

    def when(t: float) -> list[str]:
        return [f"{(date(t) - EXCEL_EPOCH).total_seconds() / 86400.0:.9f}"]

    write(
        folder / "imu_log.csv",
        "Datum;" + EN_IMU.replace(",", ";").partition(";")[2],
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

    write(folder / "imu_log.csv", EN_IMU, imu_rows(of, when, DEG, PER_G))
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
        "GPS Week,TOW (ms)," + EN_IMU.partition(",")[2],
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

    write(folder / "imu_log.csv", EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, when, height=None, speed=1.0),
    )
    return of


def minutes_and_seconds(folder: Path) -> Truth:
    """mm:ss of fixes, once a second, which looks like hours and minutes."""
    of = truth()
    en_imu(folder, of)
    rows = fix_rows(of, lambda t: [stamp("%M:%S", t)], height=None, speed=1.0)[::5]
    write(folder / "gps.csv", "time,lat,lon,speed [m/s],course", rows)
    return of


def whole_seconds(folder: Path) -> Truth:
    """Fifty readings with the same second."""
    of = truth()

    def when(t: float) -> list[str]:
        return [stamp("%Y-%m-%d %H:%M:%S", t)]

    write(folder / "imu_log.csv", EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, iso, height=None, speed=1.0),
    )
    return of


def micros_wrap(folder: Path) -> Truth:
    """An Arduino's micros(), which begin again at zero after 2^32."""
    of = truth()

    def when(t: float) -> list[str]:
        return [f"{(round(1e6 * (t - of.t[0])) + 2**32 - 30_000_000) % 2**32}"]

    write(
        folder / "imu_log.csv",
        "micros," + EN_IMU.partition(",")[2],
        imu_rows(of, when, DEG, PER_G),
    )
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, iso, height=None, speed=1.0),
    )
    return of


def local_times(folder: Path) -> Truth:
    """Both in local time, and nothing says which zone."""
    of = truth()

    def when(t: float) -> list[str]:
        return [stamp("%Y-%m-%d %H:%M:%S.%L", t, 2.0)]

    write(folder / "imu_log.csv", EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, when, height=None, speed=1.0),
    )
    return of


def either_month(folder: Path) -> Truth:
    """05/03/2026, which is the fifth of March here and the third of May in America."""
    of = truth()

    def when(t: float) -> list[str]:
        return [stamp("%d/%m/%Y %H:%M:%S.%L", t - 9 * 86400.0)]

    write(folder / "imu_log.csv", EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, when, height=None, speed=1.0),
    )
    return of


def compact_times(folder: Path) -> Truth:
    """hhmmss.sss as NMEA has it, and no date; the readings count from midnight."""
    of = truth()
    write(
        folder / "imu_log.csv",
        EN_IMU,
        imu_rows(of, lambda t: [stamp("%H:%M:%S.%L", t)], DEG, PER_G),
    )
    write(
        folder / "gps.csv",
        "UTC,lat,lon,speed [m/s],course",
        fix_rows(of, lambda t: [stamp("%H%M%S.%L", t)], height=None, speed=1.0),
    )
    return of


def scientific_times(folder: Path) -> Truth:
    """Milliseconds since 1970 as a spreadsheet shows them: 1.77348E+12."""
    of = truth()

    def when(t: float) -> list[str]:
        return [f"{1e3 * t:.5E}"]

    write(folder / "imu_log.csv", EN_IMU, imu_rows(of, when, DEG, PER_G))
    write(
        folder / "gps.csv",
        "time,lat,lon,speed [m/s],course",
        fix_rows(of, when, height=None, speed=1.0),
    )
    return of


WRITERS = (
    backwards,
    shuffled,
    excel_serial,
    matlab_dates,
    gps_weeks,
    minutes_only,
    minutes_and_seconds,
    whole_seconds,
    micros_wrap,
    local_times,
    either_month,
    compact_times,
    scientific_times,
)
