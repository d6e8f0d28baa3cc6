"""RTKLIB solutions: one track written in every form reads as the same fixes."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from automap import timebase as tb
from automap.errors import InputError
from automap.io.receiver import read_receiver_bytes
from automap.records import FixType

GPS0 = float(tb.week_to_gps(2300, 345_600.0 - 1.0))
TIMES = GPS0 + 0.25 * np.arange(8)
LAT = np.radians(-0.01 + 1e-4 * np.arange(8))
LON = np.radians(-150.5 + 1e-4 * np.arange(8))
HEIGHT = 50.0 + np.arange(8) * 0.5
REFERENCE = (np.radians(-0.02), np.radians(-150.49), 40.0)


def when(gps_s: float, form: str) -> str:
    shift = {"GPST": None, "UTC": 0.0, "JST": 9 * 3600.0}[form.split()[0]]
    if form.endswith("tow"):
        week, tow = tb.gps_to_week(gps_s if shift is None else tb.gps_to_utc(gps_s) + shift)
        return f"{int(week):4d} {float(tow):10.3f}"
    seconds = gps_s if shift is None else float(tb.gps_to_utc(gps_s)) + shift
    stamp = np.datetime64("1980-01-06", "ms") + np.timedelta64(round(seconds * 1e3), "ms")
    date, _, clock = str(stamp).partition("T")
    return f"{date.replace('-', '/')} {clock}"


def dms(angle: float) -> str:
    seconds = round(abs(np.degrees(angle)) * 3600, 6)
    sign = "-" if angle < 0 else ""
    return f"{sign}{int(seconds // 3600)} {int(seconds // 60 % 60):02d} {seconds % 60:09.6f}"


def file_of(time: str, position: str, separator: str = " ", header: bool = True) -> bytes:
    lines = ["% program   : RTKLIB ver.2.4.3"]
    if position == "enu":
        lat, lon, height = REFERENCE
        lines.append(f"% ref pos   : {np.degrees(lat):.9f} {np.degrees(lon):.9f} {height:.4f}")
    note = {"xyz": "x/y/z-ecef=WGS84", "enu": "e/n/u-baseline=WGS84"}
    lines.append(f"% ({note.get(position, 'lat/lon/height=WGS84/ellipsoidal')},Q=1:fix,2:float)")
    names = {
        "llh": "latitude(deg) longitude(deg) height(m)",
        "dms": "latitude(d'\") longitude(d'\") height(m)",
        "xyz": "x-ecef(m) y-ecef(m) z-ecef(m)",
        "enu": "e-baseline(m) n-baseline(m) u-baseline(m)",
    }
    lines.append(
        f"%  {time.split()[0]}  {names[position]} Q ns sdn sde sdu sdne sdeu sdun age ratio"
    )
    if not header:
        lines = []
    for t, lat, lon, height in zip(TIMES, LAT, LON, HEIGHT, strict=True):
        if position == "llh":
            place = f"{np.degrees(lat):.9f} {np.degrees(lon):.9f} {height:.4f}"
        elif position == "dms":
            place = f"{dms(lat)} {dms(lon)} {height:.4f}"
        elif position == "xyz":
            x, y, z = pymap3d.geodetic2ecef(lat, lon, height, deg=False)
            place = f"{x:.4f} {y:.4f} {z:.4f}"
        else:
            e, n, u = pymap3d.geodetic2enu(lat, lon, height, *REFERENCE, deg=False)
            place = f"{e:.4f} {n:.4f} {u:.4f}"
        figures = "2 11 0.3000 0.2000 0.5000 -0.0500 0.0100 0.0200 1.00 2.5"
        row = f"{when(float(t), time)} {place} {figures}"
        if separator in ",;":
            # RTKLIB keeps the blank between date and clock
            clock = when(float(t), time)
            row = clock + separator + separator.join(row[len(clock) :].split())
        else:
            row = row.replace(" ", separator)
        lines.append(row)
    return ("\n".join(lines) + "\n").encode()


@pytest.mark.parametrize("position", ["llh", "dms", "xyz", "enu"])
@pytest.mark.parametrize("time", ["GPST", "UTC", "JST", "GPST tow", "UTC tow"])
def test_every_form_reads_the_same(time: str, position: str) -> None:
    log = read_receiver_bytes(file_of(time, position), "x.pos")
    fixes = log.fixes
    assert log.kind == "rtklib"
    assert not log.warnings
    assert np.allclose(fixes.gps_s, TIMES, atol=1e-6)
    assert np.allclose(fixes.lat_rad, LAT, atol=1e-10)
    assert np.allclose(fixes.lon_rad, LON, atol=1e-10)
    assert np.allclose(fixes.height_m, HEIGHT, atol=1e-3)
    assert (fixes.fix_type == FixType.FLOAT).all()
    assert (fixes.n_sats == 11).all()


@pytest.mark.parametrize("separator", [" ", ",", ";", "\t", "  "])
def test_separators(separator: str) -> None:
    fixes = read_receiver_bytes(file_of("GPST", "llh", separator), "x.pos").fixes
    assert np.allclose(fixes.gps_s, TIMES, atol=1e-6)
    assert fixes.sd_pos_ned[0] == pytest.approx([0.3, 0.2, 0.5])


def test_the_baseline_form_has_east_first() -> None:
    fixes = read_receiver_bytes(file_of("GPST", "enu"), "x.pos").fixes
    assert fixes.sd_pos_ned[0] == pytest.approx([0.2, 0.3, 0.5])


def test_covariance_of_the_earth_fixed_form_is_turned() -> None:
    """Against the turned matrix, with signed roots off the diagonal."""
    fixes = read_receiver_bytes(file_of("GPST", "xyz"), "x.pos").fixes
    cov = np.array(
        [
            [0.3**2, -(0.05**2), 0.02**2],
            [-(0.05**2), 0.2**2, 0.01**2],
            [0.02**2, 0.01**2, 0.5**2],
        ]
    )
    lat, lon = LAT[0], LON[0]
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    up = np.cross(east, north)
    for axis, direction in enumerate((north, east, up)):
        assert fixes.sd_pos_ned[0, axis] == pytest.approx(np.sqrt(direction @ cov @ direction))


def test_velocity_columns() -> None:
    row = b"2025/07/08 19:34:18.499 40.0 -105.1 1601.4 1 21 .01 .01 .01 0 0 0 0 0 "
    row += b"1.0 -2.0 3.0 0.05 0.06 0.07 0 0 0\n"
    fixes = read_receiver_bytes(row, "x.pos").fixes
    assert fixes.vel_ned[0].tolist() == [1.0, -2.0, -3.0]
    assert fixes.sd_vel_ned[0] == pytest.approx([0.05, 0.06, 0.07])
    assert fixes.fix_type[0] == FixType.FIXED


def test_without_a_header_gps_time_and_degrees_are_taken_and_said() -> None:
    log = read_receiver_bytes(file_of("GPST", "llh", header=False), "x.pos")
    assert np.allclose(log.fixes.lat_rad, LAT, atol=1e-10)
    assert any("header" in w for w in log.warnings)
    log = read_receiver_bytes(file_of("GPST", "xyz", header=False), "x.pos")
    assert np.allclose(log.fixes.lat_rad, LAT, atol=1e-10)


def test_offsets_point_at_the_rows() -> None:
    data = file_of("GPST", "llh")
    for offset in read_receiver_bytes(data, "x.pos").fixes.offset:
        assert data[offset : offset + 4] == b"2024"
        assert data[offset - 1 : offset] == b"\n"


def test_cut_and_damaged_rows() -> None:
    data = file_of("GPST", "llh")
    log = read_receiver_bytes(data[:-40], "x.pos")
    assert len(log.fixes) == 7
    assert log.truncated is not None
    log = read_receiver_bytes(data.replace(b"-0.009900000", b"garbage"), "x.pos")
    assert len(log.fixes) == 7
    assert any("line 5" in w for w in log.warnings)


@pytest.mark.parametrize("byte", [b"\0", b"\x0b", b"\x1f", b"\xff"])
def test_stray_bytes_in_a_row(byte: bytes) -> None:
    data = file_of("GPST", "llh")
    place = data.index(b"-0.0099")
    for damaged in (data[:place] + byte + data[place:], data + byte):
        log = read_receiver_bytes(damaged, "x.pos")
        assert len(log.fixes) >= 7


@pytest.mark.parametrize("byte", [b"\0", b"\x1f", b" ", b" ,"])
def test_a_height_that_is_not_known_behind_whatever_parts_cells(byte: bytes) -> None:
    """It was sought with fewer separators than rows are read with."""
    height = f" {HEIGHT[0]:.4f}".encode()
    data = file_of("GPST", "llh").replace(height, byte + b"nan", 1)
    fixes = read_receiver_bytes(data, "x.pos").fixes
    assert len(fixes) == len(TIMES)
    assert np.isnan(fixes.height_m[0])


def test_geodetic_heights_are_of_no_known_separation() -> None:
    data = file_of("GPST", "llh").replace(b"ellipsoidal", b"geodetic")
    log = read_receiver_bytes(data, "x.pos")
    assert (log.fixes.geoid_sep_m == 0.0).all()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"% program : RTKLIB\n%  GPST latitude(deg)\n", "without any position"),
        (b"% program : RTKLIB\nhello world\n", "none of its 1 rows"),
        (file_of("GPST", "enu").replace(b"ref pos", b"rov pos"), "ref pos"),
    ],
)
def test_unusable_solutions_are_one_clear_sentence(data: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read_receiver_bytes(data, "x.pos")
    assert "\n" not in str(caught.value)
