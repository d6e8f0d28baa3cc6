"""Every kind of import: what comes out of a made recording, and what damage ends in."""

from __future__ import annotations

import json
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import import_sources as made
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from import_bags import write_bag
from import_data_sets import write_euroc, write_kitti
from import_phones import write_gnss_logger, write_mapillary, write_sensor_logger
from import_rtklib import write_rtklib

from automap.errors import ConfigError, InputError, StageError
from automap.io.drive import load_drive
from automap.io.frame_times import frame_times
from automap.io.recording import Recording, read_recording
from automap.io.video import read_chapter
from automap.timebase import unix_to_gps
from pipeline.check.command import check_drive
from pipeline.cli.import_kinds import KINDS
from pipeline.cli.root import run_command
from pipeline.importers.euroc import import_euroc
from pipeline.importers.kitti import import_kitti
from pipeline.importers.mapillary import import_mapillary
from pipeline.importers.openpilot import import_openpilot
from pipeline.importers.phone import import_gnss_logger, import_sensor_logger
from pipeline.importers.rosbag import import_rosbag
from pipeline.importers.rtklib import import_rtklib
from tests.slow_cases import others_slow

FRD = np.array([1.0, -1.0, -1.0])


def read(out: Path) -> Recording:
    recording = read_recording(load_drive(out))
    assert recording.failures == ()
    return recording


def check_fixes(recording: Recording, step: int = 1, atol_deg: float = 2e-7) -> None:
    """Positions are those of the source, at GPS times of its UNIX stamps."""
    fixes = recording.fixes
    assert fixes is not None
    wanted = np.array([made.place(i * step) for i in range(len(fixes))])
    np.testing.assert_allclose(np.degrees(fixes.lat_rad), wanted[:, 0], atol=atol_deg, rtol=0)
    np.testing.assert_allclose(np.degrees(fixes.lon_rad), wanted[:, 1], atol=atol_deg, rtol=0)
    np.testing.assert_allclose(fixes.height_m, made.HEIGHT, atol=0.01)


def check_imu(recording: Recording) -> None:
    assert recording.imu is not None
    assert len(recording.imu) == made.N_IMU
    turns = np.tile(made.GYRO * FRD, (made.N_IMU, 1))
    np.testing.assert_allclose(recording.imu.gyro, turns, atol=1e-4)
    force = np.tile(made.FORCE_FLU * FRD, (made.N_IMU, 1))
    np.testing.assert_allclose(recording.imu.accel, force, atol=2e-3)


def check_video(out: Path, brightness: bool = True) -> None:
    video = load_drive(out).videos["front"]
    assert read_chapter(video.chapters[0]).count == made.N_IMAGE
    assert np.all(np.diff(frame_times(video).t_ns) > 0)


@pytest.mark.parametrize("ros2", [False, True], ids=["bag", "mcap"])
def test_a_ros_recording(tmp_path: Path, ros2: bool) -> None:
    bag = write_bag(tmp_path / ("two" if ros2 else "one.bag"), ros2=ros2)
    out = tmp_path / "drive"
    warnings = import_rosbag(bag, out)
    assert [text for text in warnings if "CameraInfo" not in text] == []
    recording = read(out)
    check_imu(recording)
    check_fixes(recording)
    assert recording.fixes is not None
    np.testing.assert_allclose(recording.fixes.gps_s, unix_to_gps(made.FIX_NS * 1e-9), atol=1e-6)
    half = made.SPEED * np.sqrt(0.5)
    np.testing.assert_allclose(recording.fixes.vel_ned[3], [half, half, -0.5], atol=1e-3)
    np.testing.assert_allclose(recording.fixes.sd_pos_ned[3], [1.0, 2.0, 3.0], atol=1e-3)
    check_video(out)
    np.testing.assert_array_equal(frame_times(load_drive(out).videos["front"]).t_ns, made.IMAGE_NS)
    assert check_drive(out).usable


def test_a_receivers_own_message_is_preferred(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "one.bag", ros2=False, ublox=True, raw_images=True)
    import_rosbag(bag, tmp_path / "drive")
    recording = read(tmp_path / "drive")
    check_fixes(recording)
    assert load_drive(tmp_path / "drive").gnss_file == tmp_path / "drive" / "gnss.ubx"
    assert recording.fixes is not None
    np.testing.assert_allclose(recording.fixes.vel_ned[3], [7.071, 7.071, -0.5], atol=1e-3)
    np.testing.assert_allclose(recording.fixes.gps_s, unix_to_gps(made.FIX_NS * 1e-9), atol=1e-5)
    np.testing.assert_array_equal(recording.fixes.arrival_ns, made.FIX_NS + 3_000_000)
    check_video(tmp_path / "drive")


def test_topics_can_be_named(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "one.bag", ros2=False, ublox=True)
    import_rosbag(bag, tmp_path / "drive", gnss_topic="/gps/fix", no_video=True)
    assert (tmp_path / "drive/gnss.pos").is_file()
    assert not (tmp_path / "drive/video").exists()
    with pytest.raises(ConfigError, match=r"/imu/data"):
        import_rosbag(bag, tmp_path / "other", imu_topic="/imu/raw")
    assert not (tmp_path / "other").exists()


def test_kitti_raw(tmp_path: Path) -> None:
    source = write_kitti(tmp_path / "kitti")
    assert import_kitti(source, tmp_path / "drive") == []
    recording = read(tmp_path / "drive")
    check_fixes(recording)
    assert recording.imu is not None
    np.testing.assert_allclose(recording.imu.accel[0], made.force(0) * FRD, atol=1e-6)
    drive = load_drive(tmp_path / "drive")
    camera = drive.cameras()["front"]
    np.testing.assert_allclose(camera.mount_rpy, 0.0, atol=1e-9)
    # the laser is 0.8 m behind and below, the camera 0.3 m in front of it, 0.1 m to the left
    np.testing.assert_allclose(camera.lever_arm_m, [0.5 + 0.6, 0.3 - 0.2, 0.0], atol=2.0)
    from automap.io.truth_trajectory import read_truth_trajectory

    truth = read_truth_trajectory(tmp_path / "drive/truth/trajectory.csv")
    rpy = np.degrees(truth.rpy[0])
    np.testing.assert_allclose(rpy, np.degrees([0.02, 0.03, np.pi / 4.0]), atol=1e-3)
    check_video(tmp_path / "drive")
    # the data set is German, these made positions are not
    found = check_drive(tmp_path / "drive").findings
    assert [f.code for f in found if f.severity == "error"] == ["wrong_country"]


def test_euroc(tmp_path: Path) -> None:
    source = write_euroc(tmp_path / "asl")
    import_euroc(source, tmp_path / "drive", axes="FLU")
    recording = read(tmp_path / "drive")
    check_imu(recording)
    check_fixes(recording)
    check_video(tmp_path / "drive")
    camera = load_drive(tmp_path / "drive").cameras()["front"]
    assert camera.matrix[0, 0] == 458.6
    assert camera.distortion[0] == -0.28


def test_euroc_without_positions_is_not_usable_and_says_so(tmp_path: Path) -> None:
    source = write_euroc(tmp_path / "asl", gps=False)
    assert any("gps0" in text for text in import_euroc(source, tmp_path / "drive"))
    report = check_drive(tmp_path / "drive")
    assert not report.usable
    assert [f for f in report.findings if f.severity == "error"]


@pytest.mark.parametrize("zipped", [False, True])
def test_sensor_logger(tmp_path: Path, zipped: bool) -> None:
    source = write_sensor_logger(tmp_path / "log")
    if zipped:
        with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
            for path in source.iterdir():
                archive.write(path, path.name)
        source = tmp_path / "log.zip"
    assert import_sensor_logger(source, tmp_path / "drive", axes="FLU") == []
    recording = read(tmp_path / "drive")
    check_imu(recording)
    check_fixes(recording)
    assert recording.fixes is not None
    half = made.SPEED * np.sqrt(0.5)
    np.testing.assert_allclose(recording.fixes.vel_ned[3, :2], half, atol=1e-3)


def test_raw_values_of_ios_are_turned_round(tmp_path: Path) -> None:
    source = write_sensor_logger(tmp_path / "log")
    for name in ("Accelerometer", "Gravity"):
        lines = (source / f"{name}.csv").read_text().splitlines()
        rows = [line.split(",") for line in lines[1:]]
        turned = [[*r[:2], *(str(-float(v) / 9.80665) for v in r[2:])] for r in rows]
        text = "\n".join([lines[0], *(",".join(r) for r in turned)])
        (source / f"{name}.csv").write_text(text)
    (source / "Metadata.csv").write_text("version,platform,standardisation\n1,ios,false\n")
    import_sensor_logger(source, tmp_path / "drive", axes="FLU")
    check_imu(read(tmp_path / "drive"))


def test_gnss_logger(tmp_path: Path) -> None:
    source = write_gnss_logger(tmp_path / "gnss_log.txt")
    warnings = import_gnss_logger(source, tmp_path / "drive", axes="FLU")
    assert ["fused" in text for text in warnings] == [True]
    recording = read(tmp_path / "drive")
    check_imu(recording)
    check_fixes(recording)
    assert recording.fixes is not None
    assert recording.fixes.arrival_ns[1] - recording.fixes.arrival_ns[0] == 200_000_000


@pytest.mark.parametrize("described", [False, True], ids=["exif", "description"])
def test_mapillary(tmp_path: Path, described: bool) -> None:
    source = write_mapillary(tmp_path / "images", described)
    import_mapillary(source, tmp_path / "drive")
    recording = read(tmp_path / "drive")
    check_fixes(recording, step=5)
    assert recording.fixes is not None
    np.testing.assert_allclose(
        recording.fixes.gps_s, unix_to_gps(1_700_000_000.25 + np.arange(made.N_IMAGE)), atol=1e-5
    )
    check_video(tmp_path / "drive")


@pytest.mark.parametrize("lost", [False, True], ids=["as logged", "copied as text"])
def test_rtklib_tags_put_both_streams_on_one_clock(tmp_path: Path, lost: bool) -> None:
    source = write_rtklib(tmp_path / "log", carriage_returns_lost=lost)
    import_rtklib(source, tmp_path / "drive", axes="FLU")
    recording = read(tmp_path / "drive")
    check_imu(recording)
    check_fixes(recording)
    assert recording.imu is not None
    assert recording.fixes is not None
    # the least delay of the lines is 5 ms after the tick of their time
    wanted = (1000 + 5 + np.arange(made.N_IMU) * 10) * 1_000_000
    np.testing.assert_allclose(recording.imu.t_ns, wanted, atol=1_000_000)
    np.testing.assert_array_equal(
        recording.fixes.arrival_ns, (1000 + 70 + np.arange(made.N_FIX) * 200) * 1_000_000
    )


def test_a_bare_rlog_is_refused_with_a_way_out(tmp_path: Path) -> None:
    (tmp_path / "rlog.bz2").write_bytes(b"BZh9")
    for source in (tmp_path, tmp_path / "rlog.bz2"):
        with pytest.raises(InputError, match="convert"):
            import_openpilot(source, tmp_path / "drive")


def test_lineage_names_the_sources_and_what_was_written(tmp_path: Path) -> None:
    source = write_gnss_logger(tmp_path / "gnss_log.txt")
    import_gnss_logger(source, tmp_path / "drive")
    lineage = json.loads((tmp_path / "drive/import.json").read_text())
    assert lineage["kind"] == "gnss-logger"
    assert [entry["file"] for entry in lineage["source_files"]] == ["gnss_log.txt"]
    assert lineage["source_files"][0]["bytes"] == source.stat().st_size
    assert set(lineage["written"]) == {"drive.toml", "gnss.nmea", "gnss_arrival.csv", "imu.csv"}
    # another kind into the same folder: nothing of the first stays
    import_mapillary(write_mapillary(tmp_path / "images", True), tmp_path / "drive")
    assert not (tmp_path / "drive/imu.csv").exists()


Importer = Callable[[Path, Path], list[str]]
_SOURCES: dict[str, tuple[Callable[[Path], Path], Importer]] = {
    "bag": (lambda p: write_bag(p / "one.bag", ros2=False), import_rosbag),
    "mcap": (lambda p: write_bag(p / "two", ros2=True), import_rosbag),
    "kitti": (lambda p: write_kitti(p / "k"), import_kitti),
    "euroc": (lambda p: write_euroc(p / "e"), import_euroc),
    "sensor-logger": (lambda p: write_sensor_logger(p / "s"), import_sensor_logger),
    "gnss-logger": (lambda p: write_gnss_logger(p / "g.txt"), import_gnss_logger),
    "mapillary": (lambda p: write_mapillary(p / "m", False), import_mapillary),
    "rtklib": (lambda p: write_rtklib(p / "r"), import_rtklib),
}


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("sources")
    return {name: make(folder / name) for name, (make, _) in _SOURCES.items()}


@pytest.mark.parametrize("name", others_slow(_SOURCES, 4))
@settings(
    max_examples=12,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    derandomize=True,
)
@given(data=st.data())
def test_damage_ends_in_a_sentence_or_a_whole_drive(
    name: str, sources: dict[str, Path], tmp_path: Path, data: st.DataObject
) -> None:
    """One file cut off, overwritten or emptied: InputError and no folder, or a drive."""
    work = tmp_path / "work"
    shutil.rmtree(work, ignore_errors=True)
    source = sources[name]
    copy = work / source.name
    work.mkdir()
    if source.is_dir():
        shutil.copytree(source, copy)
        for extra in source.parent.glob("calib_*"):
            shutil.copy(extra, work)
    else:
        shutil.copy(source, copy)
    files = sorted(p for p in ([copy] if copy.is_file() else copy.rglob("*")) if p.is_file())
    victim = data.draw(st.sampled_from(files), label="file")
    content = bytearray(victim.read_bytes())
    kind = data.draw(st.sampled_from(["cut", "noise", "empty", "gone"]), label="damage")
    if kind == "cut":
        content = content[: data.draw(st.integers(0, len(content)), label="length")]
    elif kind == "noise":
        noise = data.draw(st.binary(min_size=1, max_size=40), label="noise")
        at = data.draw(st.integers(0, len(content)), label="at")
        content[at : at + len(noise)] = noise
    elif kind == "empty":
        content = bytearray()
    victim.write_bytes(bytes(content))
    if kind == "gone":
        victim.unlink()
    out = work / "drive"
    try:
        _SOURCES[name][1](copy, out)
    except InputError as error:
        text = str(error)
        assert "\n" not in text.strip()
        assert len(text) < 700
        assert not out.exists()
    else:
        load_drive(out)
        assert (out / "import.json").is_file()
    assert [p.name for p in work.iterdir() if p.name.startswith(".")] == []


@pytest.mark.parametrize("kind", [k for k in KINDS if k != "bearings"])
def test_what_is_not_there_or_of_no_kind_is_exit_code_three(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    junk = tmp_path / "junk.bin"
    junk.write_bytes(np.random.default_rng(1).integers(0, 256, 5000, np.uint8).tobytes())
    (tmp_path / "empty").mkdir()
    for source in (tmp_path / "none", junk, tmp_path / "empty"):
        code = run_command(["import", kind, str(source), "-o", str(tmp_path / "drive")])
        said = capsys.readouterr().err
        assert code == 3, said
        assert said.startswith("error: ")
        assert said.count("\n") == 1
        assert not (tmp_path / "drive").exists()


def test_a_full_disk_names_the_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, text: str) -> None:
        raise StageError(f"cannot write {path}: the disk is full.")

    source = write_euroc(tmp_path / "asl")
    monkeypatch.setattr("pipeline.importers.parts.write_text", full)
    out = tmp_path / "drive"
    with pytest.raises(StageError, match=re.escape(f"cannot write {out / 'imu.csv'}:")):
        import_euroc(source, out)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["asl"]
