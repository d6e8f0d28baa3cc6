"""Commands given what nobody should give them: a code of the contract and one clear sentence."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from export_inputs import write_run
from import_data_sets import write_euroc
from input_drive import write_drive

from automap.errors import ConfigError
from automap.io import names
from automap.io.toml_file import read_toml
from pipeline.cli.root import run_command
from pipeline.detect.images import images_in
from pipeline.shared.targets import spare_recordings


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("run") / "out", signs=3, seconds=20.0)


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "out"))


def failed(words: list[str], code: int, capsys: pytest.CaptureFixture[str]) -> str:
    """The sentence of a command that ends with a code."""
    assert run_command(words) == code
    text = capsys.readouterr().err
    assert "unexpectedly" not in text
    assert "Warning" not in text
    return text


@pytest.mark.parametrize(
    "words",
    [
        ["merge", "OUT", "-o", "NEW", "--min-existence", "nan"],
        ["export", "OUT", "--format", "csv", "--min-confidence", "nan"],
        ["evaluate", "OUT", "--truth-sd", "inf"],
        ["evaluate", "OUT", "--truth-sd", "1e300"],
        ["calibrate", "static", "x.csv", "-o", "NEW", "--rate", "nan"],
        ["calibrate", "static", "x.csv", "-o", "NEW", "--gravity", "nan"],
        ["gap", "x", "-o", "NEW", "--gravity", "inf"],
        ["experiment", "dropout", "x", "-o", "NEW", "--every", "inf"],
        ["record", "-o", "NEW", "--duration", "nan"],
        ["import", "bearings", "x.csv", "-o", "NEW", "--truth-sd", "nan"],
        ["simulate", "sample", "-o", "NEW", "--seed", "-1"],
    ],
)
def test_numbers_that_are_none_are_refused(
    words: list[str], out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    real = {"OUT": str(out), "NEW": str(tmp_path / "new")}
    assert "Invalid value" in failed([real.get(word, word) for word in words], 2, capsys)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("name", [names.SIGNS_GEOJSON, names.RUN, names.TRAJECTORY])
def test_an_export_spares_the_other_results(
    name: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(["export", str(out), "--format", "geojson"]) == 0
    before = (out / name).read_bytes()
    text = failed(["export", str(out), "--format", "csv", "-o", str(out / name)], 2, capsys)
    assert name in text
    assert (out / name).read_bytes() == before
    assert run_command(["export", str(out), "--format", "geojson"]) == 0


def test_recordings_are_spared(
    out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = write_drive(tmp_path / "drive")
    (drive / "video").mkdir()
    (drive / "video" / "front.mp4").write_bytes(b"a recording")
    for name in ("imu.csv", names.MANIFEST, "video/front.mp4"):
        before = (drive / name).read_bytes()
        target = str(drive / name)
        assert target in failed(["export", str(out), "--format", "csv", "-o", target], 2, capsys)
        assert target in failed(["detect", str(drive), "-o", target], 2, capsys)
        assert (drive / name).read_bytes() == before
    table = drive / "video" / "front_detections.csv"
    table.write_text("frame\n")
    spare_recordings(table)
    spare_recordings(drive / "new.csv")
    with pytest.raises(ConfigError, match="what is to be read"):
        spare_recordings(out / names.RUN, out / names.RUN)


@pytest.mark.parametrize(
    ("point", "said"),
    [("1,2", "three numbers"), ("nan,0,0", "three numbers"), ("1e300,0,0", "farther than 100 m")],
)
def test_a_point_off_the_vehicle(
    point: str, said: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["export", str(out), "--format", "tum", "--point", point]
    assert said in failed(words, 2, capsys)


def test_a_damaged_run_record_is_told(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (out / names.RUN).write_text("[" * 100_000)
    assert run_command(["export", str(out), "--format", "csv"]) == 0
    assert "run.json is left out: it is damaged" in capsys.readouterr().err


def test_the_sheet_of_an_earlier_search_is_no_picture(tmp_path: Path) -> None:
    for name in ("a.jpg", "boxes_signs.jpg", "stop_signs.jpg", "boxes.csv"):
        (tmp_path / name).touch()
    assert [path.name for path in images_in(tmp_path)] == ["a.jpg", "stop_signs.jpg"]


def test_a_table_where_a_file_is_in_the_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import cv2

    (tmp_path / "in").mkdir()
    cv2.imwrite(str(tmp_path / "in" / "grey.png"), np.full((60, 80, 3), 90, np.uint8))
    (tmp_path / "file").touch()
    target = str(tmp_path / "file" / "boxes.csv")
    assert "in the way" in failed(["detect", str(tmp_path / "in"), "-o", target], 4, capsys)


def test_an_import_with_axes_that_there_are_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = write_euroc(tmp_path / "asl")
    words = ["import", "euroc", str(source), "-o", str(tmp_path / "drive"), "--axes", "XYZ"]
    assert "three letters" in failed(words, 2, capsys)
    assert not (tmp_path / "drive").exists()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"a = " + b"[" * 5000, "nested too deeply"),
        (b"a = 1\n\xff", "byte 6 is not UTF-8"),
        (b"a = 1\nb = \nc = 2", "line 2"),
    ],
)
def test_toml_that_cannot_be_read(content: bytes, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(content)
    with pytest.raises(ConfigError, match=said):
        read_toml(tmp_path / "a.toml")


def test_toml_of_other_editors(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfa = 1\r\nb = 2\rc = 3\n")
    assert read_toml(tmp_path / "a.toml") == {"a": 1, "b": 2, "c": 3}


def _desk(path: Path, changes: str = "") -> Path:
    """Half a minute of a sensor at rest; ``changes`` says what is wrong with it."""
    noise = np.random.default_rng(1).normal(size=(3000, 6))
    readings = noise * [0.02, 0.02, 0.02, 0.002, 0.002, 0.002] + [0.0, 0.0, -9.81, 0.0, 0.0, 0.0]
    readings = readings * 1e200 if changes == "huge" else readings
    np.savetxt(path, readings, fmt="%.8g")
    return path


COLUMNS = ["--columns", "ax,ay,az,gx,gy,gz", "--rate", "100"]


def test_readings_of_absurd_size_are_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = _desk(tmp_path / "desk.txt", "huge")
    words = ["calibrate", "allan", str(log), *COLUMNS, "-o", str(tmp_path / "out")]
    assert "usable readings" in failed(words, 3, capsys)


def test_two_logs_that_share_no_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(0.0, 5.0, 0.01)
    for name, begin in (("accel", 0.0), ("gyro", 1e6)):
        np.savetxt(tmp_path / f"{name}.txt", np.column_stack([t + begin, t, t, t]))
    words = ["calibrate", "static", "-o", str(tmp_path / "out"), "--columns", "t_s,x,y,z"]
    words += ["--accel", str(tmp_path / "accel.txt"), "--gyro", str(tmp_path / "gyro.txt")]
    assert "share no time" in failed(words, 3, capsys)


def test_an_experiment_without_an_outage_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = write_drive(tmp_path / "drive")
    words = ["experiment", "dropout", str(drive), "-o", str(tmp_path / "out")]
    assert "too short" in failed([*words, "--outage", "100", "--every", "120"], 3, capsys)


def test_a_replay_spares_what_is_in_the_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = write_drive(tmp_path / "drive")
    links = tmp_path / "links"
    links.touch()
    words = ["record", "--replay", str(drive), "--links", str(links)]
    assert "in the way" in failed(words, 4, capsys)
    links.unlink()
    links.mkdir()
    (links / "imu").write_text("mine")
    assert "in the way" in failed(words, 2, capsys)
    assert [path.name for path in links.iterdir()] == ["imu"]
    assert (links / "imu").read_text() == "mine"


@pytest.mark.parametrize("source", ["lavfi:nonsense", "lavfi:sine"])
def test_a_camera_that_shows_nothing(
    source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["record", "-o", str(tmp_path / "drive"), "--gnss", "none", "--imu", "none"]
    words += ["--camera", f"front={source}", "--duration", "0.2"]
    assert "cannot be opened" in failed(words, 3, capsys)


def test_a_baseline_that_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    baseline = tmp_path / "figures.json"
    words = ["regress", str(tmp_path), "--baseline", str(baseline), "--update", "--yes"]
    for content, said in ((b"\xff", "no text"), (b"gx,gy", "delete it"), (b"[" * 99999, "deep")):
        baseline.write_bytes(content)
        assert said in failed(words, 3, capsys)
        assert baseline.read_bytes() == content


@pytest.fixture
def closed(tmp_path: Path) -> Iterator[Path]:
    """A folder that may not be looked into."""
    folder = tmp_path / "closed"
    folder.mkdir()
    (folder / names.RUN).touch()
    folder.chmod(0)
    if os.access(folder, os.R_OK):
        pytest.skip("this user may read everything")
    yield folder
    folder.chmod(0o755)


@pytest.mark.parametrize(
    "words",
    [
        ["check", "CLOSED"],
        ["run", "CLOSED", "-o", "NEW"],
        ["export", "CLOSED", "--format", "csv"],
        ["evaluate", "CLOSED"],
        ["view", "CLOSED", "--no-browser"],
        ["merge", "CLOSED", "-o", "NEW"],
        ["detect", "CLOSED", "-o", "NEW"],
        ["import", "mapillary", "CLOSED", "-o", "NEW"],
        ["simulate", "--like", "CLOSED", "-o", "NEW"],
    ],
)
def test_a_folder_without_rights(
    words: list[str], closed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    real = {"CLOSED": str(closed), "NEW": str(tmp_path / "new")}
    failed([real.get(word, word) for word in words], 3, capsys)


def test_a_folder_without_rights_does_not_stop_the_others(
    closed: Path, out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = str(tmp_path / "map")
    assert run_command(["merge", str(out), str(closed), "-o", target]) == 0
    assert "left out" in capsys.readouterr().err
    closed.chmod(0o555)
    for form in ("csv", "gpkg", "flatgeobuf", "parquet"):
        words = ["export", str(out), "--format", form, "-o", str(closed / "x")]
        assert "no permission" in failed(words, 4, capsys)


@pytest.mark.parametrize("value", [np.nan, 1e300])
def test_a_trajectory_off_the_earth_is_left_out(
    value: float, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = out / names.TRAJECTORY
    table = pq.read_table(path)
    changed = {
        name: pa.array(np.full(len(table), value)) if name != "t_ns" else table[name]
        for name in table.column_names
    }
    pq.write_table(pa.table(changed), path)
    assert run_command(["export", str(out), "--format", "kml"]) == 0
    text = capsys.readouterr().err
    assert "no positions on Earth" in text
    assert "RuntimeWarning" not in text


def test_the_twin_of_damaged_results(
    out: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def damaged(run: Path, folder: Path, seed: int, **_: object) -> None:
        (folder / "imu.csv").touch()
        raise KeyError("settings")

    monkeypatch.setattr("pipeline.simulate.twin.write_twin", damaged)
    words = ["simulate", "--like", str(out), "-o", str(out.parent / "twin")]
    assert "damaged or incomplete" in failed(words, 3, capsys)
    assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_a_results_folder_runs_no_program_without_the_users_word(
    out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mark, program = out.parent / "mark", out / "effects.py"
    program.write_text(f"open({str(mark)!r}, 'w').close()\nEFFECTS = []\n", encoding="utf-8")
    (out / names.FUSION).write_text('{"method": "inertial"}', encoding="utf-8")
    record = json.loads((out / names.RUN).read_text(encoding="utf-8"))
    record["settings"] = {"effects": {"files": [str(program)]}}
    (out / names.RUN).write_text(json.dumps(record), encoding="utf-8")
    words = ["simulate", "--like", str(out), "-o", str(out.parent / "twin")]
    text = failed(words, 3, capsys)
    assert "effects.py" in text
    assert "--config" in text
    assert not mark.exists()
    config = out.parent / "mine.toml"
    config.write_text(f'[effects]\nfiles = ["{program}"]\n', encoding="utf-8")
    assert "no list EFFECTS" in failed([*words, "--config", str(config)], 2, capsys)
    assert mark.exists()


def test_a_folder_in_the_place_of_the_clock(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (out / names.SYNC).unlink(missing_ok=True)
    (out / names.SYNC).mkdir()
    assert run_command(["merge", str(out), "-o", str(out.parent / "map")]) in (0, 3)
    assert "unexpectedly" not in capsys.readouterr().err
