"""The drive folder, its manifest, and tables that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from automap.errors import ConfigError, InputError, StageError
from automap.frames import rpy_to_matrix
from automap.io.atomic import atomic_path, write_json, write_text
from automap.io.axes import axes_matrix, axes_value, triad_matrix
from automap.io.drive import load_drive
from automap.io.tables import read_fixes, read_imu, write_fixes, write_imu
from automap.io.trajectory_table import COLUMNS, read_trajectory, write_trajectory
from automap.records import (
    DISTORTION_SD,
    NO_TIME,
    UNKNOWN_DISTORTION_SD,
    UNKNOWN_FOCAL_SD,
    Fixes,
    ImuData,
    Trajectory,
)

_SCHEMA = 'schema = "automap.drive/1"\n'


def _drive(folder: Path, manifest: str = "", *files: str) -> Path:
    (folder / "drive.toml").write_text(_SCHEMA + manifest)
    for name in files:
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("x")
    return folder


def test_files_are_found_by_their_usual_names(tmp_path: Path) -> None:
    _drive(
        tmp_path,
        "",
        "imu.csv",
        "gnss.nmea",
        "gnss_arrival.csv",
        "video/front.mp4",
        "video/front_2.mp4",
        "video/front_10.mp4",
        "video/front_frames.csv",
        "video/rear_detections.csv",
    )
    drive = load_drive(tmp_path)
    assert drive.name == tmp_path.name
    assert drive.gnss_file == tmp_path / "gnss.nmea"
    assert drive.arrival_file == tmp_path / "gnss_arrival.csv"
    assert list(drive.videos) == ["front", "rear"]
    assert [path.stem for path in drive.videos["front"].chapters] == [
        "front",
        "front_2",
        "front_10",
    ]
    assert len(drive.input_files()) == 9
    assert load_drive(tmp_path / "drive.toml").name == drive.name


@pytest.mark.parametrize(
    ("manifest", "said"),
    [
        ('[imu]\nfile = "imv.csv"', r"imu\.file names imv\.csv, which is not there \(is imu\.csv"),
        (
            '[gnss]\nfile = "receiver.log"',
            r"gnss\.file names receiver\.log, which is not there; correct",
        ),
        ('[imu]\nfile = "video"', r"imu\.file names video, which is no file"),
    ],
)
def test_a_recording_named_wrongly_is_an_error(tmp_path: Path, manifest: str, said: str) -> None:
    _drive(tmp_path, manifest, "imu.csv", "gnss.ubx", "video/front.mp4")
    with pytest.raises(InputError, match=said):
        load_drive(tmp_path)


def test_a_lesser_file_named_wrongly_is_a_warning(tmp_path: Path) -> None:
    _drive(tmp_path, '[gnss]\narrival = "gnss_arival.csv"\n', "gnss_arrival.csv", "gnss.ubx")
    drive = load_drive(tmp_path)
    assert drive.arrival_file is None
    assert "gnss_arival.csv" in drive.warnings[0]
    assert "is gnss_arrival.csv meant?" in drive.warnings[0]


@pytest.mark.parametrize(
    ("manifest", "said"),
    [
        ('[imu]\naxis = "FRD"', "line 3: unknown key imu.axis; did you mean axes?"),
        ("[video.front]\nwidht = 3", "line 3: unknown key video.front.widht; did you mean width?"),
        ("[gps]\nx = 1", "line 2: unknown key gps; did you mean gnss?"),
        ('[imu]\ntime = "boot"', "line 3: imu.time is 'boot'; it must be 'boot_ns'"),
        ('[imu]\naxes = "FRU"', 'left-handed, which no sensor is; probably it is "FRD"'),
        ('[imu]\naxes = "FRU"', "write accel_axes or gyro_axes"),
        ('[imu]\naccel_axes = "unknown"', "line 3: imu.accel_axes: only axes may be"),
        ('[imu]\ngyro_axes = "FFD"', 'line 3: imu.gyro_axes: axes = "FFD" names one direction'),
        ("[imu]\naccel_axes = 3", "line 3: imu.accel_axes: must be text such as"),
        ('[imu]\naxes = "NED"', "axes of the Earth"),
        ('[imu]\naxes = "FFD"', "one direction twice"),
        ("[imu]\naxes = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "mirrors"),
        ("[imu]\naxes = [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]", "no rotation"),
        ("[imu]\naxes = [[1, 0, 0], [0, 1]]", "three rows"),
        ("[imu]\naxes = 3", "line 3: imu.axes"),
        ("[gnss]\nlever_arm_m = [1, 2]", "line 3: gnss.lever_arm_m"),
        ("[gnss]\nlever_arm_m = [0,4, 0,1, -1,2]", "must be a list such as [0.4, 0.1, -1.2]"),
        ('[video.a]\nfiles = "a.mp4"', 'must be a list such as ["front.mp4"]'),
        ('[site]\ncountry = "GER"', 'must be two letters, such as "DE"'),
        ("[gnss]\nlever_arm_m = [1, 2, nan]", "finite"),
        ("[gnss]\noutput_delay_s = -1", "line 3: gnss.output_delay_s"),
        ("[gnss]\noutput_delay_s = -1", "must be at least 0 s, but it is -1."),
        (
            "[gnss]\noutput_delay_s = 120",
            "must be at most 2 s (120 ms are 0.12 s), but it is 120.",
        ),
        ('[gnss]\noutput_delay_s = "120"', "(120 ms are 0.12 s), but it is '120'."),
        ("[gnss]\noutput_delay_s = 1e9", "must be at most 2 s, but it is 1000000000.0."),
        ('imu = "imu.csv"', "write it as [imu]"),
        ('[imu]\nfile = "../imu.csv"', "is outside the folder"),
        ('[imu]\naccel_unit = "counts"', "names no sensor"),
        ("[video.front]\ncamera_matrix = [[1, 0, 3], [4, 5, 6], [0, 0, 1]]", "camera_matrix"),
        ("[video.front]\ndistortion = [0, 0, 0]", "4, 5, 8, 12 or 14"),
        (
            '[video.a]\nfiles = ["imu.csv"]\n[video.b]\nfiles = ["./imu.csv"]',
            "video.a and video.b are both of imu.csv",
        ),
        ("[imu", "not valid TOML"),
        ('[imu]\ncolumns = { gq = "Gyro" }', "line 3: imu.columns: there is no column gq"),
        ("[imu]\ncolumns = { gx = 0 }", "count from 1"),
        ("[imu]\ncolumns = { gx = 1.5 }", "line 3: imu.columns.gx: must be the file's name"),
        ('[imu]\nseparator = "x"', "line 3: imu.separator is 'x'"),
        ('[gnss]\ntime_format = "seconds"', "is no time format; known are ns, us, ms, s"),
        ('[gnss]\nunits = { speed = "m" }', "'m' is no unit of speed; known are m/s, km/h"),
        ('[gnss.arrival_table]\ncolumns = { ofset = "o" }', "did you mean offset?"),
        ('[imu]\ngyro_unit = "km/h"', "line 3: imu.gyro_unit is 'km/h'"),
    ],
)
def test_a_wrong_manifest_is_one_sentence_with_its_place(
    tmp_path: Path, manifest: str, said: str
) -> None:
    _drive(tmp_path, manifest, "imu.csv")
    with pytest.raises(ConfigError) as caught:
        load_drive(tmp_path)
    text = str(caught.value)
    assert said in text
    assert "\n" not in text
    assert str(tmp_path / "drive.toml") in text


def test_a_manifest_says_how_its_tables_are_to_be_read(tmp_path: Path) -> None:
    text = """
[imu]
columns = { t = "Zeit", gx = "Gyro X [°/s]", ax = 5 }
separator = ";"
decimal = ","
time_format = "%d.%m.%Y %H:%M:%S.%f"
gyro_unit = "°/s"
[gnss]
units = { speed = "kmh" }
[gnss.arrival_table]
columns = { offset = "Byte", t = 2 }
"""
    _drive(tmp_path, text, "imu.csv")
    drive = load_drive(tmp_path)
    form = drive.imu.form
    assert form.columns == {"t": "Zeit", "gx": "Gyro X [°/s]", "ax": 5}
    assert (form.separator, form.decimal) == (";", ",")
    assert form.time_format == "%d.%m.%Y %H:%M:%S.%f"
    assert drive.imu.gyro_unit == "deg/s"
    assert drive.gnss.form.units == {"speed": "km/h"}
    assert drive.gnss.arrival_table.form.columns == {"offset": "Byte", "t": 2}


@pytest.mark.parametrize("manifest", ["", 'schema = "automap.drive/9"', "name = 'x'"])
def test_a_manifest_without_a_known_schema_says_what_to_write(
    tmp_path: Path, manifest: str
) -> None:
    (tmp_path / "drive.toml").write_text(manifest)
    with pytest.raises(ConfigError, match=r'schema = "automap\.drive/1"'):
        load_drive(tmp_path)


def test_a_folder_that_is_no_drive(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such drive folder"):
        load_drive(tmp_path / "nowhere")
    with pytest.raises(InputError, match="at least the line schema"):
        load_drive(tmp_path)
    with pytest.raises(InputError, match="holds no recording"):
        load_drive(_drive(tmp_path))


@pytest.mark.parametrize(
    ("axes", "reading", "vehicle"),
    [
        ("FRD", [1, 2, 3], [1, 2, 3]),
        ("FLU", [1, 2, 3], [1, -2, -3]),
        ("rfu", [1, 2, 3], [2, 1, -3]),
        ("DRB", [1, 2, 3], [-3, 2, 1]),
        ([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], [1, 2, 3], [2, -1, 3]),
    ],
)
def test_axes(axes: str | list[list[float]], reading: list[float], vehicle: list[float]) -> None:
    C = axes_matrix(axes)
    assert C is not None
    np.testing.assert_allclose(C @ reading, vehicle)
    assert axes_matrix("unknown") is None


@given(
    st.permutations([0, 1, 2]),
    st.tuples(*[st.sampled_from([1.0, -1.0])] * 3),
    st.tuples(*[st.floats(-np.pi, np.pi)] * 3),
)
def test_what_is_written_of_axes_is_read_as_these_axes(
    order: list[int], signs: tuple[float, ...], angles: tuple[float, float, float]
) -> None:
    letters = np.eye(3)[order] * np.array(signs)[:, None]
    written = axes_value(letters)
    assert written.startswith('"')
    np.testing.assert_array_equal(triad_matrix(tomllib.loads(f"axes = {written}")["axes"]), letters)
    turned = rpy_to_matrix(np.array(angles)) @ letters
    read = triad_matrix(tomllib.loads(f"axes = {axes_value(turned)}")["axes"])
    np.testing.assert_allclose(read, turned, atol=2e-3)


def test_cameras_take_what_the_manifest_lacks_from_elsewhere(tmp_path: Path) -> None:
    matrix = "camera_matrix = [[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]]"
    _drive(
        tmp_path,
        f"[video.front]\n{matrix}\n[video.rear]\n[video.left]\nwidth = 800\n"
        "height = 600\nmount_rpy_deg = [0.0, 0.0, 90.0]",
        "imu.csv",
    )
    drive = load_drive(tmp_path)
    cameras = drive.cameras()
    assert (cameras["front"].width, cameras["front"].height) == (640, 480)
    assert "rear" not in cameras
    np.testing.assert_allclose(cameras["left"].mount_rpy, [0, 0, np.pi / 2])
    # 60 degrees of view: half the width over its tangent
    np.testing.assert_allclose(cameras["left"].matrix[0, 0], 400 / np.tan(np.pi / 6))
    assert len(drive.camera_warnings()) == 2


def test_a_phone_held_upright_has_the_lens_of_one_that_lies(tmp_path: Path) -> None:
    sizes = "[video.a]\nwidth = 1280\nheight = 720\n[video.b]\nwidth = 720\nheight = 1280\n"
    _drive(tmp_path, sizes, "imu.csv")
    lying, upright = load_drive(tmp_path).cameras().values()
    assert upright.matrix[0, 0] == lying.matrix[0, 0] == lying.matrix[1, 1]
    np.testing.assert_array_equal(upright.matrix[:2, 2], lying.matrix[[1, 0], 2])


def test_a_lens_that_nobody_describes_is_unsure(tmp_path: Path) -> None:
    matrix = "camera_matrix = [[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]]"
    size = "width = 640\nheight = 480"
    _drive(
        tmp_path,
        f"[video.a]\n{size}\n{matrix}\ndistortion = [0, 0, 0, 0, 0]\n[video.b]\n{size}\n{matrix}\n"
        f"[video.c]\n{size}\n[video.d]\n{size}\n{matrix}\ndistortion_sigma = 0.03\n",
        "imu.csv",
    )
    cameras = load_drive(tmp_path).cameras()
    assert {name: (each.distortion_sd, each.focal_sd) for name, each in cameras.items()} == {
        "a": (DISTORTION_SD, 0.0),
        "b": (UNKNOWN_DISTORTION_SD, 0.0),
        "c": (UNKNOWN_DISTORTION_SD, UNKNOWN_FOCAL_SD),
        "d": (0.03, 0.0),
    }


def _write_half(path: Path, error: BaseException) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text("half")
        raise error


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, {"x": np.array([1.0, np.nan]), "n": np.int64(3)})
    assert path.read_text().split() == ["{", '"x":', "[", "1.0,", "null", "],", '"n":', "3", "}"]
    with pytest.raises(KeyboardInterrupt):
        _write_half(path, KeyboardInterrupt())
    assert path.read_text().startswith("{")
    assert [item.name for item in tmp_path.iterdir()] == ["a.json"]


def test_a_full_disk_and_a_file_in_the_way_are_one_sentence(tmp_path: Path) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(StageError, match="disk is full"):
        _write_half(tmp_path / "a", full)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("x")
    with pytest.raises(StageError, match="cannot write"):
        write_text(tmp_path / "file" / "b", "x")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(StageError, match="no plain file"):
        write_text(tmp_path / "pipe", "x")


def _random(*shape: int) -> np.ndarray:
    return np.random.default_rng(sum(shape)).normal(size=shape)


@pytest.mark.parametrize("temperature", [False, True])
def test_readings_come_back_bit_for_bit(tmp_path: Path, temperature: bool) -> None:
    imu = ImuData(
        np.arange(50) + 2**60,
        _random(50, 3),
        _random(50, 3),
        _random(50) if temperature else None,
        axes_known=not temperature,
    )
    write_imu(tmp_path / "imu.parquet", imu)
    back = read_imu(tmp_path / "imu.parquet")
    np.testing.assert_array_equal(back.t_ns, imu.t_ns)
    np.testing.assert_array_equal(back.gyro, imu.gyro)
    np.testing.assert_array_equal(back.accel, imu.accel)
    assert back.axes_known == imu.axes_known
    assert (back.temp_c is None) == (imu.temp_c is None)


def test_epochs_come_back_bit_for_bit(tmp_path: Path) -> None:
    n = 20
    vectors = [_random(n, 3) for _ in range(3)]
    vectors[0][3, 2] = np.nan
    fixes = Fixes(
        _random(n) + 1.4e9,
        _random(n),
        _random(n),
        _random(n),
        *vectors,
        np.arange(n) % 7,
        np.full(n, -1),
        _random(n),
        np.full(n, np.nan),
        np.arange(n) * 100,
        np.full(n, NO_TIME),
    )
    write_fixes(tmp_path / "fixes.parquet", fixes)
    back = read_fixes(tmp_path / "fixes.parquet")
    for name, value in vars(fixes).items():
        np.testing.assert_array_equal(getattr(back, name), value, err_msg=name)


def test_a_trajectory_is_stored_in_degrees(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    n = 30
    data = [_random(n) for _ in range(4)] + [_random(n, 3) for _ in range(5)]
    data[1] = np.arctan(data[1])  # latitudes
    trajectory = Trajectory(np.arange(n), *data, slip_sd=_random(n))
    write_trajectory(tmp_path / "t.parquet", trajectory)
    table = pq.read_table(tmp_path / "t.parquet")
    assert tuple(table.column_names) == COLUMNS
    np.testing.assert_allclose(table["lat_deg"].to_numpy(), np.degrees(trajectory.lat_rad))
    back = read_trajectory(tmp_path / "t.parquet")
    for name, value in vars(trajectory).items():
        digits = 1e-7 if name in ("vel_ned", "sd_pos_ned", "sd_vel_ned", "sd_rpy") else 1e-14
        np.testing.assert_allclose(getattr(back, name), value, rtol=digits, err_msg=name)
    # what is written again can be joined with what was not read
    write_trajectory(tmp_path / "again.parquet", back)
    assert pq.read_schema(tmp_path / "again.parquet").equals(table.schema)
    # others' and older files do not tell the nose from its course
    pq.write_table(table.drop_columns(["sd_slip_deg"]), tmp_path / "t.parquet")
    assert np.isnan(read_trajectory(tmp_path / "t.parquet").slip_sd).all()


def test_columns_with_nulls_and_several_chunks(tmp_path: Path) -> None:
    import pyarrow as pa

    from automap.io.arrow_columns import column_to_numpy

    column = pa.chunked_array([[1.0, None, 3.0], [], [None, 5.0]], pa.float64())
    np.testing.assert_array_equal(column_to_numpy(column), [1, np.nan, 3, np.nan, 5])
    np.testing.assert_array_equal(column_to_numpy(column.slice(1, 3)), [np.nan, 3, np.nan])
    whole = pa.chunked_array([list(range(20))], pa.int64()).slice(3, 9)
    np.testing.assert_array_equal(column_to_numpy(whole), np.arange(3, 12))


def test_a_damaged_table_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "imu.parquet"
    with pytest.raises(InputError, match="is missing"):
        read_imu(path)
    path.write_bytes(b"PAR1 but not really")
    with pytest.raises(InputError, match="not a readable Parquet file"):
        read_imu(path)
