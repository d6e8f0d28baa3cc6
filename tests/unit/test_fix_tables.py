"""A table of fixes as a receiver's log of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.errors import InputError
from automap.io.drive import load_drive
from automap.io.fix_table import read_fix_table
from automap.io.receiver import read_receiver_log
from automap.io.recording import read_recording
from automap.io.table_form import TableForm
from automap.records import NO_TIME, FixType
from automap.timebase import unix_to_gps

UNIX_S = 1_715_936_398


def _write(folder: Path, text: str, name: str = "fixes.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def _rows(line: str, n: int = 10) -> str:
    return "".join(line.format(k=k, t=UNIX_S + k, lat=48.0 + 1e-5 * k) + "\n" for k in range(n))


def test_everything_that_a_table_may_tell(tmp_path: Path) -> None:
    header = (
        "timestamp_s,latitude,longitude,height_m,geoid_sep,hAcc,vAcc,speed_kmh,course,"
        "speed_acc,fix,satellites,hdop,arrival_ns\n"
    )
    path = _write(
        tmp_path,
        header + _rows("{t},{lat:.5f},11.0,500.0,47.0,2.0,3.0,36,90,0.2,3,9,0.8,{k}000000"),
    )
    log = read_receiver_log(path)
    fixes = log.fixes
    assert log.kind == "table"
    np.testing.assert_allclose(fixes.gps_s, unix_to_gps(UNIX_S + np.arange(10)))
    np.testing.assert_allclose(np.degrees(fixes.lat_rad), 48.0 + 1e-5 * np.arange(10))
    np.testing.assert_allclose(fixes.height_m, 500.0)
    np.testing.assert_allclose(fixes.geoid_sep_m, 47.0)
    np.testing.assert_allclose(fixes.vel_ned[:, :2], [[0.0, 10.0]] * 10, atol=1e-12)
    assert np.isnan(fixes.vel_ned[:, 2]).all()
    np.testing.assert_allclose(fixes.sd_pos_ned, [[2**0.5, 2**0.5, 3.0]] * 10)
    np.testing.assert_allclose(fixes.sd_vel_ned[:, :2], 0.2)
    assert set(fixes.fix_type) == {FixType.THREE_D}
    assert fixes.n_sats.tolist() == [9] * 10
    assert fixes.arrival_ns.tolist() == [k * 1_000_000 for k in range(10)]


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ("date;time;lat;lon;alt\n", "17.05.2024;08:59:{s};{lat:.5f};11,0;500,0"),
        ("Datum\tUhrzeit\tBreite\tLänge\tHöhe\n", "2024-05-17\t08:59:{s}\t{lat:.5f}\t11.0\t500"),
        ("time,lat_rad,lon_rad\n", "2024-05-17T08:59:{s}Z,{rad:.9f},0.19"),
        ("week,tow,lat,lon\n", "2314,{tow},{lat:.5f},11.0"),
        ("gps_time,lat,lon\n", "{gps},{lat:.5f},11.0"),
        ("t_ms,lat,lon\n", "{ms},{lat:.5f},11.0"),
        ("t;Breite [1e-7 deg];Länge [1e-7 deg]\n", "{ms};{e7};110000000"),
    ],
)
def test_times_and_places_in_any_words(tmp_path: Path, header: str, line: str) -> None:
    gps = unix_to_gps(UNIX_S + np.arange(2.0, 12.0))
    text = header
    for k in range(10):
        lat = 48.0 + 1e-4 * k
        said = line.format(
            s=f"{(k + 0):02d}", lat=lat, rad=np.radians(lat), e7=round(lat * 1e7),
            tow=gps[k] - 2314 * 604800 - 60 + 0.0, gps=gps[k] - 60, ms=(UNIX_S + 2 + k - 60) * 1000,
        )  # fmt: skip
        text += (said.replace(".", ",") if "alt" in header and ";" in header else said) + "\n"
    if "alt" in header and ";" in header:
        text = text.replace("17,05,2024", "17.05.2024")
    fixes = read_fix_table(_write(tmp_path, text)).fixes
    np.testing.assert_allclose(fixes.gps_s, gps - 60.0, atol=1e-6)
    np.testing.assert_allclose(np.degrees(fixes.lat_rad), 48.0 + 1e-4 * np.arange(10), atol=1e-6)


def test_fixes_that_are_held_are_taken_once_at_their_first_row(tmp_path: Path) -> None:
    lines = [
        f"{1000 + 0.02 * k:.2f},{0.1 * (k % 7)},0,0,0,0,-9.8,{48.0 + 1e-5 * (k // 5):.5f},11.0"
        for k in range(100)
    ]
    header = "Zeit (s),Gyro X,Gyro Y,Gyro Z,Acc X,Acc Y,Acc Z,Breite,Länge\n"
    _write(tmp_path, header + "\n".join(lines) + "\n", "log.csv")
    _write(
        tmp_path,
        'schema = "automap.drive/1"\n[imu]\nfile = "log.csv"\n[gnss]\nfile = "log.csv"\n',
        "drive.toml",
    )
    recording = read_recording(load_drive(tmp_path))
    assert recording.failures == ()
    assert recording.imu is not None
    assert recording.fixes is not None
    assert len(recording.imu) == 100
    assert len(recording.fixes) == 20
    np.testing.assert_array_equal(recording.fixes.arrival_ns, recording.imu.t_ns[::5])
    assert any("no column tells the date" in text for text in recording.warnings)


def test_a_parked_car_keeps_its_fixes(tmp_path: Path) -> None:
    lines = [f"{UNIX_S + k},{48.0 + 1e-5 * min(k, 60):.5f},11.0" for k in range(100)]
    path = _write(tmp_path, "time,lat,lon\n" + "\n".join(lines) + "\n")
    assert len(read_fix_table(path).fixes) == 100


def test_heights_above_sea_level_and_lost_fixes_are_told(tmp_path: Path) -> None:
    text = "time,lat,lon,altitude,accuracy\n" + _rows("{t},{lat:.5f},11.0,500,-1")
    text += f"{UNIX_S + 10},0,0,0,5\n{UNIX_S + 11},abc,11,0,5\n"
    found = read_fix_table(_write(tmp_path, text))
    said = "\n".join(found.warnings)
    assert (found.fixes.geoid_sep_m == 0.0).all()
    assert "1 of 11 fixes have no valid position" in said
    assert "line 13, column lat: 'abc'" in said
    assert np.isnan(found.fixes.sd_pos_ned).all()


def test_a_quality_that_no_fix_has_is_a_plain_fix_and_told(tmp_path: Path) -> None:
    text = "time,lat,lon,fix_quality\n" + _rows("{t},{lat:.5f},11.0,4")
    text += f"{UNIX_S + 10},48.1,11.0,9\n{UNIX_S + 11},48.1,11.0,12\n{UNIX_S + 12},48.1,11.0,99\n"
    found = read_fix_table(_write(tmp_path, text))
    assert "2 fixes have a quality that no kind of fix has" in "\n".join(found.warnings)
    assert found.fixes.fix_type[-3:].tolist() == [FixType.TWO_D] * 3
    known = read_fix_table(_write(tmp_path, text.replace(",12\n", ",1\n").replace(",99\n", ",1\n")))
    assert "quality" not in "\n".join(known.warnings)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,x,y\n1,2,3\n", "names no column lat"),
        ("lat,lon\n48,11\n", "no column is a time"),
        ("time,lat,lon\n2024-05-17T10:00:00,480,11\n", "no row has a latitude within 90 deg"),
    ],
)
def test_a_table_that_is_none_says_what_to_write(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_receiver_log(_write(tmp_path, text))


@pytest.mark.parametrize(
    ("name", "epochs", "rate_hz", "form"),
    [
        ("car/balzer-2014-03-26.csv", 2158, 10.0, TableForm()),
        ("phone/austin-iphone-x.csv", 343, 1.0, TableForm()),
        ("phone/austin-car-can.csv", 4708, 11.658, TableForm(utc_offset_h=-5.0)),
    ],
)
def test_published_tables_are_read_as_they_are(
    shared_data: Path, name: str, epochs: int, rate_hz: float, form: TableForm
) -> None:
    found = read_fix_table(shared_data / "real" / name, form)
    assert len(found.fixes) == epochs
    assert np.median(np.diff(found.fixes.gps_s)) == pytest.approx(1.0 / rate_hz, rel=1e-3)
    assert (found.fixes.fix_type >= FixType.TWO_D).all()
    assert not any("unreadable" in text for text in found.warnings)


def test_two_tables_of_one_drive_share_their_clock(shared_data: Path) -> None:
    phone = read_fix_table(shared_data / "real/phone/austin-iphone-x.csv").fixes
    car = read_fix_table(
        shared_data / "real/phone/austin-car-can.csv", TableForm(utc_offset_h=-5.0)
    ).fixes
    at = np.interp(phone.gps_s, car.gps_s, car.lat_rad)
    north = (phone.lat_rad - at)[(phone.gps_s > car.gps_s[0]) & (phone.gps_s < car.gps_s[-1])]
    assert np.median(np.abs(north)) * 6.37e6 < 30.0
    assert (car.arrival_ns == NO_TIME).all()


@pytest.mark.parametrize(("unit", "factor"), [("km/h", 3.6), ("knots", 1.9438), ("mph", 2.2369)])
def test_speeds_without_a_unit_are_those_of_the_positions(
    tmp_path: Path, unit: str, factor: float
) -> None:
    lines = [
        f"{UNIX_S + k},{48.0 + 12.0 * k / 6.36e6 * 57.29578:.8f},11.0,{12.0 * factor:.3f},0"
        for k in range(60)
    ]
    path = _write(tmp_path, "time,lat,lon,speed,course\n" + "\n".join(lines) + "\n")
    found = read_fix_table(path)
    np.testing.assert_allclose(found.fixes.vel_ned[:, 0], 12.0, rtol=1e-3)
    assert any(f"speed is in {unit}, by its numbers" in text for text in found.notes)
    stated = read_fix_table(path, TableForm(units={"speed": "m/s"}))
    np.testing.assert_allclose(stated.fixes.vel_ned[:, 0], 12.0 * factor, rtol=1e-3)


@pytest.mark.parametrize(("courses", "known"), [(False, 0), (True, 20)])
def test_rests_alone_tell_no_velocity(tmp_path: Path, courses: bool, known: int) -> None:
    """Of speeds without a course those at rest would be the only ones known."""
    lines = [
        f"{UNIX_S + k},{48.0 + 1e-4 * max(k - 9, 0):.7f},11.0,{0.0 if k < 10 else 11.1}"
        + (f",{'' if k < 10 else 0}" if courses else "")
        for k in range(20)
    ]
    header = "time,lat,lon,speed" + (",course" if courses else "")
    found = read_fix_table(_write(tmp_path, header + "\n" + "\n".join(lines) + "\n"))
    assert np.count_nonzero(np.isfinite(found.fixes.vel_ned[:, 0])) == known


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("place", [(-35.0, 149.0), (48.0, 11.0)])
def test_latitudes_and_longitudes_in_each_other_s_columns(
    tmp_path: Path, place: tuple[float, float], swapped: bool
) -> None:
    course = 40.0 + 60.0 * np.sin(np.arange(120) / 20.0)
    way = 12.0 * np.cumsum(np.exp(1j * np.radians(course))) / np.radians(6.371e6)
    lat, lon = place[0] + way.real, place[1] + way.imag / np.cos(np.radians(place[0]))
    told = (course + np.random.default_rng(3).normal(0.0, 1.0, 120)) % 360.0
    lines = [
        f"{UNIX_S + k},{b:.7f},{a:.7f},12.0,{c:.2f}"
        if swapped
        else f"{UNIX_S + k},{a:.7f},{b:.7f},12.0,{c:.2f}"
        for k, (a, b, c) in enumerate(zip(lat, lon, told, strict=True))
    ]
    none_yet = f"{UNIX_S - 1},0.0,0.0,0.0,0.0"
    path = _write(tmp_path, "\n".join(["time,lat,lon,speed,course", none_yet, *lines, ""]))
    found = read_fix_table(path)
    mended = swapped and place[1] > 90.0  # else courses from east would look alike
    assert any("in each other's columns" in text for text in found.warnings) == mended
    wanted = lat if mended or not swapped else lon
    np.testing.assert_allclose(np.degrees(found.fixes.lat_rad[-120:]), wanted, atol=1e-6)


@pytest.mark.parametrize(
    ("first", "last", "off_deg", "unit"),
    [
        (0.0, 359.9, 0.0, "gon"),  # up to 400
        (20.0, 200.0, 0.0, "gon"),  # none that degrees have not
        (20.0, 200.0, 0.0, "deg"),
        (20.0, 200.0, 15.0, "deg"),  # from magnetic north, where it is far off
        (70.0, 70.0, 0.0, "deg"),
        (125.0, 145.0, 15.0, "deg"),  # as degrees of gon would be
    ],
)
def test_courses_of_400_a_turn_are_told_from_those_of_another_north(
    tmp_path: Path, first: float, last: float, off_deg: float, unit: str
) -> None:
    course = np.linspace(first, last, 120)
    way = 12.0 * np.cumsum(np.exp(1j * np.radians(course))) / 6.371e6
    lat = 48.0 + np.degrees(way.real)
    lon = 11.0 + np.degrees(way.imag) / np.cos(np.radians(48.0))
    rng = np.random.default_rng(3)
    told = (course + off_deg + rng.normal(0.0, 1.0, 120)) % 360.0 / {"deg": 1.0, "gon": 0.9}[unit]
    lines = [
        f"{UNIX_S + k},{a:.7f},{b:.7f},12.0,{c:.2f}"
        for k, (a, b, c) in enumerate(zip(lat, lon, told, strict=True))
    ]
    path = _write(tmp_path, "time,lat,lon,speed,course\n" + "\n".join(lines) + "\n")
    found = read_fix_table(path)
    velocity = found.fixes.vel_ned[:, 0] + 1j * found.fixes.vel_ned[:, 1]
    off = np.angle(velocity * np.exp(-1j * np.radians(course + off_deg)))
    assert np.abs(off).max() < np.radians(5.0)
    assert any("course is in gon, by its numbers" in text for text in found.notes) == (
        unit == "gon"
    )
    if unit == "gon":
        stated = read_fix_table(path, TableForm(units={"course": "gon"}))
        np.testing.assert_allclose(stated.fixes.vel_ned, found.fixes.vel_ned, atol=1e-9)
