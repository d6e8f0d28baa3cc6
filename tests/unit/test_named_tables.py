"""Tables in anybody's words: separators, decimal signs, times, units, header names."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.errors import ConfigError, InputError
from automap.io.calendar_text import parse_stamps, pattern_of
from automap.io.header_names import role_named, take_apart, triad_axis
from automap.io.imu_csv import ImuFormat, read_imu_csv
from automap.io.named_table import look_at_table, read_table
from automap.io.odometer_csv import read_odometer_csv
from automap.io.table_form import QUANTITIES, TableForm, TableKind

START = datetime(2024, 5, 17, 8, 59, 58, tzinfo=UTC)
START_NS = round(START.timestamp()) * 1_000_000_000
_UNIT_NS = {"ns": 1, "us": 10**3, "ms": 10**6, "s": 10**9}

HEADERS = {
    "en": ("Time{}", "Gyro {} ({})", "Accel {} ({})"),
    "de": ("Zeit{}", "Drehrate {} [{}]", "Beschleunigung {} [{}]"),
    "fr": ("Temps{}", "Vitesse angulaire {} ({})", "Accélération {} ({})"),
    "es": ("Tiempo{}", "Velocidad angular {} ({})", "Aceleración {} ({})"),
    "it": ("Tempo{}", "Velocità angolare {} [{}]", "Accelerazione {} [{}]"),
    "nl": ("Tijd{}", "Hoeksnelheid {} [{}]", "Versnelling {} [{}]"),
}


def _write(folder: Path, text: str, name: str = "table.csv", encoding: str = "utf-8") -> Path:
    path = folder / name
    path.write_bytes(text.encode(encoding))
    return path


def _stamp(ns: int, form: str) -> tuple[str, str]:
    """A stamp since START as a form writes it, and what the header says of its unit."""
    if form in _UNIT_NS:
        whole, rest = divmod(ns, _UNIT_NS[form])
        digits = len(str(_UNIT_NS[form])) - 1
        return (f"{whole}.{rest:0{digits}d}" if digits else str(whole)), f" [{form}]"
    if form.startswith("unix_"):
        text, _ = _stamp(START_NS + ns, form.removeprefix("unix_"))
        return text, ""
    when = START + timedelta(microseconds=ns // 1000)
    if form == "iso":
        return when.isoformat(timespec="microseconds").replace("+00:00", "Z"), ""
    return when.strftime(form), ""


@pytest.mark.slow
@settings(max_examples=150)
@given(
    language=st.sampled_from(sorted(HEADERS)),
    separator=st.sampled_from([",", ";", "\t", "|"]),
    comma=st.booleans(),
    form=st.sampled_from(
        ["s", "ms", "us", "ns", "unix_s", "unix_ms", "iso", "%d.%m.%Y %H:%M:%S.%f", "%H:%M:%S.%f"]
    ),
    units=st.sampled_from([("°/s", "g"), ("rad/s", "m/s²"), ("deg/s", "mg")]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "latin-1", "utf-16"]),
    ending=st.sampled_from(["\n", "\r\n", "\r"]),
    seed=st.integers(0, 2**31),
)
def test_a_table_reads_back_however_it_is_written(
    tmp_path_factory: pytest.TempPathFactory,
    language: str,
    separator: str,
    comma: bool,
    form: str,
    units: tuple[str, str],
    encoding: str,
    ending: str,
    seed: int,
) -> None:
    comma = comma and separator != ","
    random = np.random.default_rng(seed)
    n, step = 30, 10_000_000
    readings = np.round(random.normal(0.0, 3.0, (n, 6)), 4)
    time, gyro, accel = HEADERS[language]
    sign = "," if comma else "."
    rows = [[_stamp(k * step, form)[0], *(f"{v:.4f}" for v in readings[k])] for k in range(n)]
    if comma:
        texts = 0 if form in _UNIT_NS or form.startswith("unix_") else 1
        rows = [row[:texts] + [cell.replace(".", ",") for cell in row[texts:]] for row in rows]
    names = [time.format(_stamp(0, form)[1])]
    names += [gyro.format(axis, units[0]) for axis in "XYZ"]
    names += [accel.format(axis, units[1]) for axis in "XYZ"]
    text = ending.join(separator.join(row) for row in [names, *rows]) + ending
    path = _write(tmp_path_factory.mktemp("table"), text, encoding=encoding)
    table = read_table(path, "imu")
    assert table.rows.bad_rows == 0
    assert table.t_ns is not None
    np.testing.assert_allclose(np.diff(table.t_ns), step, atol=1000)
    if form not in _UNIT_NS and form != "%H:%M:%S.%f":
        assert abs(int(table.t_ns[0]) - START_NS) < 1000
        assert table.clock == "unix"
    found = np.column_stack([table.columns[name] for name in ("gx", "gy", "gz", "ax", "ay", "az")])
    np.testing.assert_array_equal(found, readings)
    assert table.guess.form.decimal == sign
    assert table.units["gx"] == {"°/s": "deg/s", "deg/s": "deg/s", "rad/s": "rad/s"}[units[0]]
    # what was guessed, written into a manifest, reads the same
    again = read_table(path, "imu", table.guess.form)
    np.testing.assert_array_equal(again.t_ns, table.t_ns)


@pytest.mark.parametrize(
    ("cells", "pattern", "first"),
    [
        (["260314 123825300"], "%d%m%y %H%M%S%f", "2014-03-26T12:38:25.300"),
        (["2018-04-08 10:31:37.005628"], "%Y-%m-%d %H:%M:%S", "2018-04-08T10:31:37.005628"),
        (["2018-04-08T10:31:37+02:00"], "%Y-%m-%d %H:%M:%S%z", "2018-04-08T08:31:37"),
        (["17.05.2024 08:59:58,25"], "%d.%m.%Y %H:%M:%S", "2024-05-17T08:59:58.25"),
        (["5/17/2024 8:59:58 PM"], "%m/%d/%Y %I:%M:%S %p", "2024-05-17T20:59:58"),
        (["20240517 085958"], "%Y%m%d %H%M%S", "2024-05-17T08:59:58"),
        (["2024/05/17 00:00:00"], "%Y/%m/%d %H:%M:%S", "2024-05-17T00:00:00"),
        (["17-May-2024 08:59:58.25"], "%d-%b-%Y %H:%M:%S", "2024-05-17T08:59:58.25"),
        (["17 août 2024 08:59:58"], "%d %b %Y %H:%M:%S", "2024-08-17T08:59:58"),
        (["17. März 2024 08:59:58 UTC"], "%d. %b %Y %H:%M:%S%z", "2024-03-17T08:59:58"),
        (["Dez 7, 2024 08:59:58"], "%b %d, %Y %H:%M:%S", "2024-12-07T08:59:58"),
    ],
)
def test_dates_are_known_by_their_look(cells: list[str], pattern: str, first: str) -> None:
    assert pattern_of(cells) == pattern
    t_ns, good = parse_stamps(cells, pattern, 0.0)
    assert good.all()
    assert t_ns[0] == np.datetime64(first, "ns").astype(np.int64)


def test_times_of_day_run_over_midnight() -> None:
    t_ns, _ = parse_stamps(["23:59:59.5", "00:00:00.5", "00:00:01.5"], "%H:%M:%S", 0.0)
    np.testing.assert_array_equal(np.diff(t_ns), [10**9, 10**9])


@pytest.mark.parametrize(
    ("name", "role", "unit"),
    [
        ("Latitude / Y Position (Degrees)", "lat", "deg"),
        ("Breitengrad", "lat", None),
        ("Länge [°]", "lon", "deg"),
        ("geogr. Länge", "lon", None),
        ("longitudine", "lon", None),
        ("Höhe über NN [m]", "msl", "m"),
        ("height_m", "height", "m"),
        ("ellipsoidal height (ft)", "height", "ft"),
        ("locationHorizontalAccuracy(m)", "h_acc", "m"),
        ("epe", "h_acc", None),
        ("vAcc", "v_acc", None),
        ("v_acc_m", "v_acc", "m"),
        ("sd_n_m", "sd_n", "m"),
        ("sAcc", "speed_acc", None),
        ("snelheid in km/h", "speed", "km/h"),
        ("Speed (MPH)", "speed", "mph"),
        ("velocity_north", "vn", None),
        ("vel_e_m_s", "ve", "m/s"),
        ("Kurs", "course", None),
        ("satellites_used", "n_sats", None),
        ("geoid_sep", "geoid_sep", None),
    ],
)
def test_names_of_fixes_are_known(name: str, role: str, unit: str | None) -> None:
    taken = take_apart(name)
    found = role_named(taken, "gnss")
    assert found is not None
    assert found[0] == role
    quantity = QUANTITIES["gnss"][role]
    assert (None if quantity is None else taken.unit(quantity)) == unit


@pytest.mark.parametrize(
    "name", ["Steering Angle", "latency_ms", "Lateral Gs", "pdop", "Distance (Miles)", "Engine RPM"]
)
def test_other_columns_are_no_fixes(name: str) -> None:
    assert role_named(take_apart(name), "gnss") is None


@pytest.mark.parametrize(
    ("name", "sensor"),
    [
        ("gx", "g"),
        ("gyroRotationZ(rad/s)", "g"),
        ("Gierrate [°/s]", "g"),
        ("rollrate", "g"),
        ("angular_velocity.x", "g"),
        ("UncalAccelXMps2", "a"),
        ("linear_acceleration.y", "a"),
        ("acc_x_g", "a"),
        ("GForceX", "a"),
        ("motionUserAccelerationX(G)", None),
        ("motionGravityX(G)", None),
        ("angular_acceleration_x", None),
        ("gyro_bias_x", None),
        ("locationHeadingX(µT)", None),
    ],
)
def test_inertial_names_are_known(name: str, sensor: str | None) -> None:
    found = triad_axis(take_apart(name))
    assert (None if found is None else found[0]) == sensor


def _rows(n: int = 20, step: float = 0.01) -> str:
    return "".join(f"{k * step:.2f};{k};0;0;0;0;-9,8\n".replace(".", ",") for k in range(n))


def test_the_manifest_overrides_what_would_be_guessed(tmp_path: Path) -> None:
    path = _write(tmp_path, "a;b;c;d;e;f;g\n" + _rows())
    with pytest.raises(InputError, match=r"names no column gx.*columns = "):
        read_imu_csv(path)
    form = TableForm({"t": "a", "gx": "b", "gy": 3, "gz": "D", "ax": "e", "ay": "f", "az": "g"})
    imu = read_imu_csv(path, ImuFormat(table=form)).data
    np.testing.assert_array_equal(imu.t_ns, np.arange(20) * 10_000_000)
    np.testing.assert_array_equal(imu.gyro[:, 0], np.arange(20))
    with pytest.raises(ConfigError, match=r"names no column 'h', which drive\.toml gives for gx"):
        look_at_table(path, "imu", TableForm({"gx": "h"}))
    with pytest.raises(ConfigError, match=r"has 7 columns, and columns\.gx = 8"):
        look_at_table(path, "imu", TableForm({"gx": 8}))


def test_a_table_without_a_header_goes_by_numbers(tmp_path: Path) -> None:
    path = _write(tmp_path, "# logger 7\n" + _rows())
    places = {"t": 1, "gx": 2, "gy": 3, "gz": 4, "ax": 5, "ay": 6, "az": 7}
    table = read_table(path, "imu", TableForm(places))
    assert len(table) == 20
    assert table.t_ns is not None
    np.testing.assert_array_equal(np.diff(table.t_ns), 10_000_000)


def test_lines_above_the_header_and_units_below_it(tmp_path: Path) -> None:
    text = (
        "Messung vom 17. Mai;\nGerät: X-7;\n\nZeit;Gyro X;Gyro Y;Gyro Z;Acc X;Acc Y;Acc Z\n"
        "s;°/s;°/s;°/s;g;g;g\n" + _rows()
    )
    table = read_table(_write(tmp_path, text), "imu")
    assert table.rows.header_line == 4
    assert (table.units["gy"], table.units["az"]) == ("deg/s", "g")
    assert table.rows.line(0) == 6
    assert len(table) == 20


def test_float_seconds_under_our_name_are_told_what_to_write(tmp_path: Path) -> None:
    rows = "".join(f"{k * 0.01:.2f},1,2,3,0,0,-9.8\n" for k in range(20))
    path = _write(tmp_path, "t_ns,gx,gy,gz,ax,ay,az\n" + rows)
    with pytest.raises(InputError, match=r'column t_ns: steps of 0\.01 .* time_format = "s"'):
        read_imu_csv(path)
    imu = read_imu_csv(path, ImuFormat(table=TableForm(time_format="s"))).data
    np.testing.assert_array_equal(np.diff(imu.t_ns), 10_000_000)


@pytest.mark.parametrize(
    ("kind", "name", "step", "meant"),
    [
        # milliseconds would be a thousand fixes a second, seconds one in a quarter of an hour
        ("gnss", "timestamp_ms", 1.0, "unix_s"),
        ("gnss", "time_s", 1000.0, "unix_ms"),
        ("imu", "time_s", 10.0, "unix_ms"),
        ("imu", "timestamp_ms", 0.01, "unix_s"),
    ],
)
def test_times_in_another_unit_than_their_name_says(
    tmp_path: Path, kind: TableKind, name: str, step: float, meant: str
) -> None:
    first = 1773480000.0 * (1000.0 if meant == "unix_ms" else 1.0)
    columns = ("gx,gy,gz,ax,ay,az", "1,2,3,0,0,-9.8")
    if kind == "gnss":
        columns = ("latitude,longitude,altitude_m", "48.97,8.47,160.0")
    rows = "".join(f"{first + k * step:.2f},{columns[1]}\n" for k in range(20))
    path = _write(tmp_path, f"{name},{columns[0]}\n{rows}")
    with pytest.raises(InputError, match=rf'{name}: steps of .* time_format = "{meant}"'):
        read_table(path, kind)
    assert len(read_table(path, kind, TableForm(time_format=meant))) == 20


@pytest.mark.parametrize(
    ("name", "first", "clock", "asked"),
    [
        ("t", 1457515218.0, "unix", True),
        # in GPS time of a day that is to come, or said
        ("t", 1757515218.0, "unix", False),
        ("unix_time", 1457515218.0, "unix", False),
        ("gps_time", 1457515218.0, "gps", False),
    ],
)
def test_seconds_that_may_be_gps_time_are_asked_about(
    tmp_path: Path, name: str, first: float, clock: str, asked: bool
) -> None:
    """Read as since 1970 a drive of ten years later has its date wrong, and nothing else."""
    rows = [f"{first + k:.3f},48.1,11.5,500.0" for k in range(20)]
    path = _write(tmp_path, "\n".join([f"{name},lat,lon,height", *rows]) + "\n")
    guess = look_at_table(path, "gnss")
    assert guess.time is not None
    assert guess.time.clock == clock
    assert any("in GPS time they are of 2026-03-14" in doubt for doubt in guess.doubts) == asked


def test_gps_seconds_of_readings_are_times(tmp_path: Path) -> None:
    rows = [f"{1457515218.0 + 0.01 * k:.3f},0.0,0.0,0.01,0.1,0.2,-9.8" for k in range(20)]
    path = _write(tmp_path, "\n".join(["gps_s,gx,gy,gz,ax,ay,az", *rows]) + "\n")
    table = read_table(path, "imu")
    assert table.clock == "gps"
    assert table.t_ns is not None
    assert table.t_ns[0] == 1457515218 * 10**9


def test_our_own_names_need_no_note(tmp_path: Path) -> None:
    rows = "".join(f"{k * 10_000_000},1,2,3,0,0,-9.8\n" for k in range(20))
    path = _write(tmp_path, "t_ns,gx,gy,gz,ax,ay,az\n" + rows)
    assert read_imu_csv(path).notes == ()


def test_a_cell_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = _write(tmp_path, "Zeit;Drehrate X;Drehrate Y;Drehrate Z;ax;ay;az\n" + _rows())
    text = path.read_text().replace("0,05;5;", "0,05;5a;").replace("0,09;", "0,0?;")
    path.write_text(text)
    recording = read_imu_csv(path)
    assert recording.quality.unreadable == 2
    assert "2 rows were left out" in recording.warnings[0]
    assert "line 7, column Drehrate X: '5a'" in recording.warnings[0]


def test_wheel_speeds_in_any_unit(tmp_path: Path) -> None:
    text = "Uhrzeit;Geschwindigkeit [km/h]\n" + "".join(
        f"08:00:{k:02d},5;{36 + k},0\n" for k in range(20)
    )
    wheels = read_odometer_csv(_write(tmp_path, text)).data
    np.testing.assert_allclose(wheels.speed, (36.0 + np.arange(20)) / 3.6)
    np.testing.assert_array_equal(np.diff(wheels.t_ns), 10**9)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("Tempo km/h", {"speed": "km/h"}),
        ("speed_km_h", {"speed": "km/h"}),
        ("yaw rate deg s", {"rate": "deg/s"}),
        ("t ms", {"time": "ms", "speed": "m/s"}),
        ("time h", {"time": "h"}),
    ],
)
def test_the_end_of_a_unit_is_no_unit_of_its_own(name: str, told: dict[str, str]) -> None:
    """km/h tells no hours, deg/s no seconds."""
    taken = take_apart(name)
    assert {q: unit for q in ("time", "speed", "rate") if (unit := taken.unit(q))} == told


@pytest.mark.parametrize(("column", "unit_ns"), [("t_ns", 1), ("time_us", 1000), ("time_s", 10**9)])
@pytest.mark.parametrize("bits_32_ns", [2**32 * 1000, 2**32 * 1_000_000])
def test_a_counter_of_32_bits_runs_on(
    tmp_path: Path, column: str, unit_ns: int, bits_32_ns: int
) -> None:
    """In whatever unit its stamps were written."""
    t_ns = bits_32_ns - 3_000_000_000 + np.arange(600) * 10_000_000
    cells = (t_ns % bits_32_ns) / unit_ns if unit_ns > 1 else t_ns % bits_32_ns
    rows = [f"{cell!r},0.0,0.0,0.01,0.1,0.2,-9.8" for cell in cells.tolist()]
    path = _write(tmp_path, "\n".join([f"{column},gx,gy,gz,ax,ay,az", *rows]) + "\n")
    found = read_table(path, "imu").t_ns
    assert found is not None
    np.testing.assert_allclose(np.diff(found), 10_000_000, atol=1000)
