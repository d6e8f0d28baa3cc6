"""CSV columns, stamps, inertial recordings, detections, finished trajectories."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.errors import ConfigError, InputError
from automap.io.axes import ImuAxes, imu_axes
from automap.io.csv_columns import read_columns
from automap.io.detections_csv import read_detections_csv
from automap.io.imu_calibration import read_imu_calibration
from automap.io.imu_csv import ImuFormat, read_imu_csv
from automap.io.imu_log import LogFormat, read_imu_log
from automap.io.sensor_file import SCHEMA as SENSOR_SCHEMA
from automap.io.sensor_file import find_sensor, preset_names, read_sensor
from automap.io.stamps import order_stamps
from automap.io.trajectory_csv import read_trajectory_csv
from automap.records import FrameTimes

_HEADER = "t_ns,gx,gy,gz,ax,ay,az"


def _write(folder: Path, text: str, name: str = "imu.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def _rows(t_ns: np.ndarray, value: str = "0.1,0.2,0.3,1,2,-9.8") -> str:
    return "\n".join([_HEADER, *(f"{t},{value}" for t in t_ns)]) + "\n"


@pytest.mark.parametrize(
    ("text", "t_ns", "gx"),
    [
        ("t_ns,gx\n1,2\n3,4\n", [1, 3], [2, 4]),
        ("gx,foo,t_ns\n2,x,1\n", [1], [2]),
        ("T_NS; GX\n1;2,5\n", [1], [2.5]),
        ("t_ns\tgx\r\n1\t2\r\n\r\n", [1], [2]),
        ("  t_ns   gx\n 1  2.5 \n\n", [1], [2.5]),
        ("\ufefft_ns,gx\n1,2", [1], [2]),
        ("# t_ns,gx\n1, 2\n", [1], [2]),
        ('"t_ns","gx"\n"1","2"\n', [1], [2]),
        ("t_ns,gx\n1.6,2\n2e3,4\n", [2, 2000], [2, 4]),
        ("t_ns,gx\n1,nan\n2,\n3,inf\n", [1, 2, 3], [np.nan, np.nan, np.inf]),
    ],
)
def test_columns_are_found_however_they_are_written(
    tmp_path: Path, text: str, t_ns: list[int], gx: list[float]
) -> None:
    table = read_columns(_write(tmp_path, text), {"t_ns": "int", "gx": "float"})
    assert table.columns["t_ns"].tolist() == t_ns
    np.testing.assert_array_equal(table.columns["gx"], gx)
    assert table.bad_rows == 0


def test_rows_that_cannot_be_read_are_counted_and_the_first_is_named(tmp_path: Path) -> None:
    path = _write(tmp_path, "t_ns,gx\n1,2\n\n2\n3,4,5\n4,abc\n6,7\n8,")
    table = read_columns(path, {"t_ns": "int", "gx": "float"})
    assert table.columns["t_ns"].tolist() == [1, 6, 8]
    assert (table.bad_rows, table.blank_rows) == (3, 1)
    assert table.first_bad == "line 4 (1 cell in place of 2): '2'"
    assert [table.line(row) for row in range(3)] == [2, 7, 8]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"\n\n", "is empty"),
        (b"t_ns,gx\n", "not one usable row"),
        (b"1,2\n3,4\n", "line 1 holds numbers"),
        (b"t_ns,wx\n1,2\n", "no column gx (rename wx?)"),
        (b"t_ns,gx,gx\n1,2,3\n", "names the column gx twice"),
        (b"t_ns,gx\nabc,def\n", "line 2, column t_ns: 'abc'"),
        (b"\x00\x01\x02", "is not text"),
        (b"t_ns,gx\n1,\xff\xfe\n", "line 2"),
    ],
)
def test_a_hopeless_csv_is_one_sentence(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "imu.csv"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_columns(path, {"t_ns": "int", "gx": "float"})
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.integers(-(2**62), 2**62),
            st.floats(allow_nan=True, allow_infinity=True),
        ),
        min_size=1,
        max_size=20,
    )
)
def test_numbers_survive_the_way_through_csv(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, float]]
) -> None:
    text = "t_ns,gx\n" + "".join(f"{t},{v!r}\n" for t, v in rows)
    path = _write(tmp_path_factory.mktemp("csv"), text)
    table = read_columns(path, {"t_ns": "int", "gx": "float"})
    assert table.columns["t_ns"].tolist() == [t for t, _ in rows]
    np.testing.assert_array_equal(table.columns["gx"], [v for _, v in rows])


def test_stamps_without_any_order_are_no_clock(tmp_path: Path) -> None:
    t_ns = np.random.default_rng(1).integers(0, 10**15, 5000)
    assert order_stamps(t_ns) is None
    with pytest.raises(InputError, match="no clock"):
        read_imu_csv(_write(tmp_path, _rows(t_ns)))


@pytest.mark.parametrize(
    ("gyro_unit", "accel_unit", "factors"),
    [
        ("rad/s", "m/s^2", (1.0, 1.0)),
        ("deg/s", "g", (np.pi / 180, 9.80665)),
    ],
)
def test_units_become_si(
    tmp_path: Path, gyro_unit: str, accel_unit: str, factors: tuple[float, float]
) -> None:
    path = _write(tmp_path, _rows(np.arange(3) * 10**7))
    imu = read_imu_csv(path, ImuFormat(ImuAxes(), gyro_unit, accel_unit)).data
    np.testing.assert_allclose(imu.gyro[0], np.array([0.1, 0.2, 0.3]) * factors[0])
    np.testing.assert_allclose(imu.accel[0], np.array([1, 2, -9.8]) * factors[1])


def test_axes_turn_readings_into_the_vehicle(tmp_path: Path) -> None:
    path = _write(tmp_path, _rows(np.arange(3) * 10**7))
    C = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    recording = read_imu_csv(path, ImuFormat(ImuAxes(C, C)))
    np.testing.assert_allclose(recording.data.accel[0], [2, -1, -9.8])
    assert recording.data.axes_known
    raw = read_imu_csv(path, ImuFormat(ImuAxes(known=False))).data
    np.testing.assert_allclose(raw.gyro[0], [0.1, 0.2, 0.3])
    assert not raw.axes_known


def test_triads_may_have_axes_of_their_own(tmp_path: Path) -> None:
    path = _write(tmp_path, _rows(np.arange(3) * 10**7))
    both = read_imu_csv(path, ImuFormat(imu_axes("FLU", accel_axes="BRD"))).data
    np.testing.assert_allclose(both.gyro[0], [0.1, -0.2, -0.3])
    np.testing.assert_allclose(both.accel[0], [-1, 2, -9.8])
    assert both.axes_known
    case = read_imu_csv(path, ImuFormat(imu_axes("unknown", accel_axes="BLU"))).data
    np.testing.assert_allclose(case.gyro[0], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(case.accel[0], [-1, -2, 9.8])
    assert not case.axes_known


def test_rows_that_a_sensor_did_not_answer_are_left_out_and_said(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    n = 400
    gyro = rng.normal(0.0, 0.01, (n, 3)) + 0.3 * np.sin(np.arange(n) / 60.0)[:, None]
    accel = rng.normal([0.2, 0.1, 9.8], 0.1, (n, 3))
    gyro[[150, 203, 204]] = 0.0
    gyro[300:340] = 0.0  # a band in which the gyro shows nothing, while the other triad goes on
    accel[[150, 260]] = 0.0
    accel[270] = -1.0
    rows = np.column_stack([np.arange(n) * 10**7, gyro, accel])
    text = "t_ns,gx,gy,gz,ax,ay,az\n" + "".join(
        f"{int(row[0])}," + ",".join(f"{value:.6f}" for value in row[1:]) + "\n" for row in rows
    )
    recording = read_imu_csv(_write(tmp_path, text))
    left = np.setdiff1d(np.arange(n), recording.data.t_ns // 10**7)
    assert left.tolist() == [150, 203, 204, 260, 270]
    assert recording.quality.failed == 5
    assert any("5 rows with one number on all axes" in said for said in recording.warnings)


def test_coarse_readings_at_rest_are_no_failed_reads(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    n = 400
    gyro = np.round(rng.normal(0.0, 0.6, (n, 3)))
    accel = np.round(rng.normal([0.0, 0.0, 9.8], 0.6, (n, 3)))
    rows = np.column_stack([np.arange(n) * 10**7, gyro, accel]).astype(int)
    text = "t_ns,gx,gy,gz,ax,ay,az\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    assert read_imu_csv(_write(tmp_path, text)).quality.failed == 0


def test_what_was_wrong_with_an_imu_file_is_counted_and_said(tmp_path: Path) -> None:
    lines = _rows(np.arange(100) * 10**7).splitlines()
    lines[20] = lines[20].replace("0.1,", "nan,")
    lines[30] = "garbage"
    lines[41] = lines[40]
    lines[50:60] = []
    recording = read_imu_csv(_write(tmp_path, "\n".join(lines)))
    quality = recording.quality
    assert (quality.not_finite, quality.unreadable, quality.repeats) == (1, 1, 1)
    assert [round(length, 3) for _, length in quality.gaps] == [0.11]
    assert quality.used == len(recording.data) == 87
    said = " ".join(recording.warnings)
    for part in ("line 21", "line 31", "1 row with the t_ns of another row left out", "1 gap"):
        assert part in said


@pytest.mark.parametrize(
    ("head", "value", "read", "told"),
    [
        ("temp_c", 31.0, 31.0, False),
        ("Temp (°F)", 104.0, 40.0, False),
        ("temp", 104.0, 104.0, True),
        ("temp", 296.0, 296.0, True),
        ("temp [K]", 296.0, 22.85, False),
    ],
)
def test_a_temperature_of_another_unit_is_told_where_no_sensor_can_be(
    tmp_path: Path, head: str, value: float, read: float, told: bool
) -> None:
    rows = "".join(f"{k * 10_000_000},0.1,0.2,0.3,1,2,-9.8,{value}\n" for k in range(40))
    path = _write(tmp_path, f"t_ns,gx,gy,gz,ax,ay,az,{head}\n{rows}")
    found = read_imu_csv(path)
    assert found.data.temp_c == pytest.approx(read)
    log = read_imu_log(path, LogFormat())
    for warnings in (found.warnings, log.warnings):
        assert any("sensors are rated for" in text for text in warnings) == told


def test_every_sensor_file_that_comes_along_is_valid() -> None:
    names = preset_names(SENSOR_SCHEMA)
    assert "thinimu-micro" in names
    for name in names:
        model = read_sensor(find_sensor(name))
        one_g = 1.0 / model.accel.scale * 9.80665
        assert np.all(one_g > 50)
        assert np.all(one_g < 1e6)
        assert np.all(model.gyro.scale > 0)


def test_counts_of_an_analogue_sensor_follow_from_its_data_sheet(tmp_path: Path) -> None:
    # 2 mV per deg/s over a 3 V span of 4096 counts: 2.7306 counts per deg/s, at 2048 in rest
    model = read_sensor(find_sensor("thinimu-micro"))
    counts = 2048 + 10 * 0.002 * 4096 / 3.0
    np.testing.assert_allclose(
        model.gyro.from_counts(np.array([[counts, 2048, 2048]]))[0], [np.radians(10), 0, 0]
    )
    path = _write(tmp_path, _rows(np.arange(3) * 10**7, "2048,2048,2048,2048,2048,1502"))
    imu = read_imu_csv(path, ImuFormat(ImuAxes(), "counts", "counts", model)).data
    np.testing.assert_allclose(imu.accel[0], [0, 0, -9.80665], atol=0.01)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[gyro]\ncounts_per_unit=1\n[accel]\ncounts_per_unit=1", "schema"),
        ('schema="automap.sensor/1"\n[gyro]\ncounts_per_unit=1', "[accel]"),
        ('schema="automap.sensor/1"\n[gyro]\ncount_per_unit=1\n[accel]\nbits=3', "did you mean"),
        ('schema="automap.sensor/1"\n[gyro]\ncounts_per_unit=0\n[accel]\nbits=3', "gyro.counts"),
        ('schema="automap.sensor/1"\n[gyro]\nbits=99\n[accel]\nbits=3', "1 to 32"),
    ],
)
def test_a_wrong_sensor_file_is_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    path = _write(tmp_path, text, "sensor.toml")
    with pytest.raises(ConfigError) as caught:
        read_sensor(path)
    assert said in str(caught.value)


def test_an_unknown_sensor_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean mpu9150"):
        find_sensor("mpu9250")


def test_a_calibration_takes_the_place_of_the_unit(tmp_path: Path) -> None:
    text = """schema = "automap.imu-calibration/1"
[accel]
scale = [2.0, 3.0, 4.0]
bias = [0.1, 0.2, 0.3]
misalignment = [0.01, 0.02, 0.03]
[gyro]
scale = [1.0, 1.0, 0.5]
bias = [0.0, 0.0, 0.1]
matrix = [[1.0, 0.0, 0.1], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
"""
    calibration = read_imu_calibration(_write(tmp_path, text, "imu_calibration.toml"))
    path = _write(tmp_path, _rows(np.arange(3) * 10**7, "1,2,3,1,1,1"))
    imu = read_imu_csv(path, ImuFormat(ImuAxes(), calibration=calibration)).data
    x, y, z = 2.1, 3.2, 4.3
    np.testing.assert_allclose(imu.accel[0], [x - 0.01 * y + 0.02 * z, y - 0.03 * z, z])
    np.testing.assert_allclose(imu.gyro[0], [1 + 0.1 * 1.6, 2, 1.6])


def _times() -> FrameTimes:
    return FrameTimes(np.array([0, 1, 3]), np.array([10, 20, 40]))


def test_detections_get_the_stamps_of_their_frames(tmp_path: Path) -> None:
    text = (
        "frame,class,x_min,y_min,x_max,y_max,score,track\n"
        "3,stop,1,2,11,12,0.5,7\n"
        "0,give-way,1,2,11,12,1.0,8\n"
        "2,stop,1,2,11,12,1.0,8\n"  # a frame without a stamp
        "1,stop,5,2,5,12,1.0,8\n"  # no area
        "1,stop,900,2,905,12,1.0,8\n"  # outside
        "0,stop,2,2,12,12,0.9,9\n"  # the sign of line 3 once more
        "1,stop,1,2,11,12,1.5,8\n"  # no score
    )
    found = read_detections_csv(_write(tmp_path, text, "d.csv"), _times(), "front", (640, 480))
    assert found.data.t_ns.tolist() == [10, 40]
    assert found.data.class_name.tolist() == ["give-way", "stop"]
    assert found.data.track.tolist() == [8, 7]
    assert len(found.warnings) == 5
    assert "line 4" in found.warnings[0]
    assert "1 detections left out that a better one" in found.warnings[4]


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("{f},stop,0.1,0.2,0.11,0.22,0.9", "shares of the picture"),
        ("{f},stop,300,200,20,20,0.9", "to widths and heights add"),
        ("{f},stop,300,200,320,220,90", "divide percents"),
        ("{f}00,stop,300,200,320,220,0.9", "are no times"),
        ("{f}.04,stop,300,200,320,220,0.9", "no whole number"),
        ("{f},stop,700,200,720,220,0.9", "width and height"),
    ],
)
def test_boxes_that_are_not_what_their_columns_say_are_refused(
    tmp_path: Path, row: str, told: str
) -> None:
    text = "frame,class,x_min,y_min,x_max,y_max,score\n" + "\n".join(
        row.format(f=f) for f in (1, 1, 3)
    )
    with pytest.raises(InputError, match=told):
        read_detections_csv(_write(tmp_path, text, "d.csv"), _times(), "front", (640, 480))


@pytest.mark.filterwarnings("error")
def test_a_box_without_end_is_read_without_a_word_of_numpy(tmp_path: Path) -> None:
    text = "frame,class,x_min,y_min,x_max,y_max,score\n1,stop,1,2,1e200,1e200,0.9\n"
    found = read_detections_csv(_write(tmp_path, text, "d.csv"), _times(), "front")
    assert len(found.data) == 1


def test_a_header_alone_means_that_nothing_was_detected(tmp_path: Path) -> None:
    path = _write(tmp_path, "frame,class,x_min,y_min,x_max,y_max,score\n", "d.csv")
    assert len(read_detections_csv(path, _times()).data) == 0


def test_a_bare_finished_trajectory_is_completed(tmp_path: Path) -> None:
    lines = ["gps_s,lat_deg,lon_deg"]
    # due east along the equator at 10 m/s
    step = np.degrees(10.0 / 6378137.0)
    lines += [f"{1.4e9 + i},0.0,{10 + i * step:.12f}" for i in range(10)]
    finished = read_trajectory_csv(_write(tmp_path, "\n".join(lines), "trajectory.csv"))
    data = finished.data
    assert finished.time == "gps_s"
    assert data.t_ns[0] == 1_400_000_000 * 10**9
    np.testing.assert_allclose(data.vel_ned, [[0, 10, 0]] * 10, atol=1e-4)
    np.testing.assert_allclose(np.degrees(data.rpy[:, 2]), 90, atol=1e-3)
    np.testing.assert_allclose(data.sd_pos_ned, 0.1)
    assert len(finished.warnings) == 3


def test_a_nose_off_its_course_comes_back_from_csv(tmp_path: Path) -> None:
    """As far as it is told, and no more of it than the heading is unsure by."""
    names = "t_ns,lat_deg,lon_deg,roll_deg,pitch_deg,yaw_deg,sd_roll_deg,sd_pitch_deg,sd_yaw_deg"
    rows = [f"{k}000000000,1.0,2.00{k},0,0,90,0.1,0.1,0.4" for k in range(3)]
    slips = ["0.3", "", "0.7"]
    text = "\n".join([names + ",sd_slip_deg", *(map(",".join, zip(rows, slips, strict=True)))])
    told = read_trajectory_csv(_write(tmp_path, text, "trajectory.csv")).data
    np.testing.assert_allclose(np.degrees(told.slip_sd), [0.3, np.nan, 0.4])
    untold = read_trajectory_csv(_write(tmp_path, "\n".join([names, *rows]), "trajectory.csv"))
    assert np.isnan(untold.data.slip_sd).all()


def test_a_trajectory_that_never_moves_needs_its_heading(tmp_path: Path) -> None:
    text = "t_ns,lat_deg,lon_deg\n" + "".join(f"{i}000000000,1.0,2.0\n" for i in range(5))
    with pytest.raises(InputError, match="yaw_deg"):
        read_trajectory_csv(_write(tmp_path, text, "trajectory.csv"))


def test_a_trajectory_without_time_is_one_sentence(tmp_path: Path) -> None:
    path = _write(tmp_path, "lat_deg,lon_deg\n1,2\n1,2\n", "trajectory.csv")
    with pytest.raises(InputError, match="neither t_ns nor gps_s"):
        read_trajectory_csv(path)


def test_a_sound_recording_is_never_read_cell_by_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slowly(*_: object) -> None:
        raise AssertionError("the careful way was taken")

    monkeypatch.setattr("automap.io.csv_cells._careful", slowly)
    path = _write(tmp_path, _rows(np.arange(1000) * 10_000_000))
    assert len(read_imu_csv(path).data) == 1000


def test_a_table_whose_threads_lose_a_chunk_is_read_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pyarrow as pa
    import pyarrow.csv

    path = _write(tmp_path, "t_ns,gx\n1,2.5\n3,4\n")
    sound, threads = pa.csv.read_csv, []

    def losing(source: object, read_options: pa.csv.ReadOptions, **others: object) -> pa.Table:
        threads.append(read_options.use_threads)
        if read_options.use_threads:
            raise pa.ArrowException("Unknown error: a chunk failed converting")
        return sound(source, read_options=read_options, **others)

    monkeypatch.setattr(pa.csv, "read_csv", losing)
    table = read_columns(path, {"t_ns": "int", "gx": "float"})
    assert threads == [True, False]
    assert table.columns["gx"].tolist() == [2.5, 4.0]
    assert table.bad_rows == 0


def test_a_block_written_twice_costs_no_other_row(tmp_path: Path) -> None:
    t_ns = np.arange(3000, dtype=np.int64) * 10_000_000
    lines = [f"{t},{i % 7 * 0.01:.2f},0.2,{i},1,2,-9.8\n" for i, t in enumerate(t_ns)]
    twice = "".join(lines[:2000] + lines[1500:])
    recording = read_imu_csv(_write(tmp_path, "t_ns,gx,gy,gz,ax,ay,az\n" + twice))
    np.testing.assert_array_equal(recording.data.t_ns, t_ns)
    assert recording.quality.repeats == 500
    assert not any("left out, the stamps" in text for text in recording.warnings)
