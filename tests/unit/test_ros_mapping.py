"""ROS messages of types that nobody knows: fields by their names, or as the user says."""

from __future__ import annotations

import tomllib
from pathlib import Path

import import_sources as made
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from import_bags import write_own_bag

from automap.errors import AutoMapError, ConfigError, InputError
from automap.io.drive import load_drive
from automap.io.recording import Recording, read_recording
from automap.io.ros_mapping import Place, as_option, read_map_file, read_options
from automap.timebase import unix_to_gps
from pipeline.cli.root import run_command
from pipeline.importers.rosbag import import_rosbag

FRD = np.array([1.0, -1.0, -1.0])


def read(drive: Path) -> Recording:
    recording = read_recording(load_drive(drive))
    assert recording.failures == ()
    return recording


def check_imu(recording: Recording) -> None:
    assert recording.imu is not None
    assert len(recording.imu) == made.N_IMU
    np.testing.assert_allclose(recording.imu.gyro.mean(axis=0), made.GYRO * FRD, atol=1e-4)
    np.testing.assert_allclose(recording.imu.accel.mean(axis=0), made.FORCE_FLU * FRD, atol=2e-3)


def check_fixes(recording: Recording) -> None:
    fixes = recording.fixes
    assert fixes is not None
    wanted = np.array([made.place(i) for i in range(made.N_FIX)])
    np.testing.assert_allclose(np.degrees(fixes.lat_rad), wanted[:, 0], atol=1e-7, rtol=0)
    np.testing.assert_allclose(np.degrees(fixes.lon_rad), wanted[:, 1], atol=1e-7, rtol=0)
    np.testing.assert_allclose(fixes.height_m, made.HEIGHT, atol=0.01)
    np.testing.assert_allclose(fixes.gps_s, unix_to_gps(made.FIX_NS * 1e-9), atol=1e-3)


def test_fields_are_known_by_their_names_and_it_is_said(tmp_path: Path) -> None:
    """One drive in two bags: vectors in deg/s, the receiver's sentences with the stamps' date."""
    imu = write_own_bag(tmp_path / "imu.bag", gnss=False)
    gnss = write_own_bag(tmp_path / "gps.bag", imu=False)
    warnings = import_rosbag([gnss, imu], tmp_path / "drive", axes="FLU")
    said = " ".join(warnings)
    assert "imu.gyro=/maker/imu:angular_rate_dps[deg/s] --map imu.accel=/maker/imu:accel" in said
    assert "gnss.nmea=/maker/gps:sentence" in said
    assert "the date" in said
    recording = read(tmp_path / "drive")
    check_imu(recording)
    check_fixes(recording)
    assert recording.fixes is not None
    np.testing.assert_array_equal(recording.fixes.arrival_ns, made.FIX_NS)


def test_a_folder_of_bags_is_one_drive(tmp_path: Path) -> None:
    write_own_bag(tmp_path / "bags/imu.bag", gnss=False)
    write_own_bag(tmp_path / "bags/gps.bag", imu=False)
    import_rosbag(tmp_path / "bags", tmp_path / "drive", axes="FLU")
    check_imu(read(tmp_path / "drive"))


def test_positions_without_sentences_are_a_table_of_fixes(tmp_path: Path) -> None:
    bag = write_own_bag(tmp_path / "own.bag", sentences=False)
    warnings = import_rosbag(bag, tmp_path / "drive")
    assert any("gnss.lat=/maker/gps:lat[1e-7 deg]" in text for text in warnings)
    recording = read(tmp_path / "drive")
    check_fixes(recording)
    assert recording.fixes is not None
    half = made.SPEED * np.sqrt(0.5)
    np.testing.assert_allclose(recording.fixes.vel_ned[:, :2], half, atol=1e-3)


def test_the_user_says_which_field_is_what(tmp_path: Path) -> None:
    bag = write_own_bag(tmp_path / "own.bag")
    options = ["imu.gyro=/maker/imu:angular_rate_dps[deg/s]", "imu.accel=/maker/imu:accel"]
    options += ["imu.t=/maker/imu:clock_us[us]"]
    import_rosbag(bag, tmp_path / "one", maps=options, axes="FLU")
    check_imu(read(tmp_path / "one"))
    first = read(tmp_path / "one").imu
    assert first is not None
    np.testing.assert_array_equal(first.t_ns, made.IMU_NS + 7000)
    (tmp_path / "map.toml").write_text(
        '[imu]\ntopic = "/maker/imu"\ngyro = "angular_rate_dps[deg/s]"\n'
        'ax = "accel.0"\nay = "accel.1"\naz = "accel.2"\nt = "clock_us[us]"\n'
    )
    import_rosbag(bag, tmp_path / "two", map_file=tmp_path / "map.toml", axes="FLU")
    for name in ("imu.csv", "gnss.nmea"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    # not said: axes are unknown, gravity gives the level ones of what hardly moved
    warnings = import_rosbag(bag, tmp_path / "three", maps=options)
    assert any("by gravity they are FLU" in text for text in warnings)
    manifest = tomllib.loads((tmp_path / "three/drive.toml").read_text())
    assert manifest["imu"]["axes"] == "FLU"


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("imu.gyro", "write TABLE.COLUMN=TOPIC:FIELD"),
        ("imu.gyroo=/maker/imu:angular_rate_dps", "did you mean gyro"),
        ("imu.gyro=/maker/imu:angular_rate_dps[kg]", "'kg' is no unit"),
        ("car.gyro=/maker/imu:angular_rate_dps", "no table car"),
        ("imu.gyro=/maker/imu:omega", "it has: angular_rate_dps.x"),
        ("imu.gyro=/maker/imu:clock_us", "no vector of three"),
        ("imu.gyro=/maker/imus:angular_rate_dps", "no such topic"),
        ("imu.gyro=/maker/imu:angular_rate_dps", "lacks ax, ay, az"),
        ("gnss.lat=/maker/gps:lat", "lacks gnss.lon"),
        ("gnss.lat=/maker/gps:sentence", "no number"),
    ],
)
def test_a_wrong_mapping_is_one_sentence(tmp_path: Path, option: str, said: str) -> None:
    bag = write_own_bag(tmp_path / "own.bag")
    with pytest.raises((ConfigError, InputError)) as error:
        import_rosbag(bag, tmp_path / "drive", maps=[option])
    assert said in str(error.value)
    assert not (tmp_path / "drive").exists()


def test_what_cannot_be_known_lists_the_topics_and_the_line_to_try(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_own_bag(tmp_path / "own.bag", gnss=False)
    code = run_command(
        ["import", "rosbag", str(bag), "--imu-topic", "/none", "-o", str(tmp_path / "drive")]
    )
    assert code == 2
    assert "there are: /maker/imu" in capsys.readouterr().err
    warnings = import_rosbag(bag, tmp_path / "drive", axes="FLU")
    assert any("/maker/imu (maker/msg/Readings, 300)" in t and "--map gnss" in t for t in warnings)


@given(st.text(max_size=60))
def test_any_option_is_read_or_refused(text: str) -> None:
    try:
        mapped = read_options([text])
    except ConfigError as error:
        assert "\n" not in str(error).replace(text, "")  # noqa: PT017
    else:
        assert all(name in ("imu", "gnss") for name in mapped)


@given(
    st.dictionaries(
        st.sampled_from(["gyro", "accel", "gx", "temp_c", "t"]),
        st.from_regex(r"[a-z][a-z0-9_]*(\.[a-z0-9_]+){0,2}", fullmatch=True),
        min_size=1,
    )
)
def test_options_say_again_what_they_said(fields: dict[str, str]) -> None:
    mapped = read_options([f"imu.{role}=/a/b:{path}" for role, path in fields.items()])
    assert mapped["imu"].places == {role: Place(path) for role, path in fields.items()}
    again = as_option("imu", mapped["imu"]).removeprefix("--map ").split(" --map ")
    assert read_options(again) == mapped


@pytest.mark.parametrize(
    "text",
    ["x", "imu = 3", "[imu]\ngyro = 'a'", "[imu]\ntopic = '/a'\ngyro = 3", "[car]\ntopic=''"],
)
def test_a_wrong_map_file_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(AutoMapError, match=r"map\.toml"):
        read_map_file(tmp_path / "map.toml")
