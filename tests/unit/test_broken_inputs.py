"""Files that once ended in a traceback: a result or one sentence, and quickly."""

from __future__ import annotations

import os
import shutil
import warnings
from pathlib import Path

import pytest

from automap.errors import AutoMapError
from pipeline.cli.root import run_command
from tests.unit.broken_readers import reader_of

_FOLDER = Path(os.environ.get("AUTOMAP_SHARED_DATA", "")) / "broken"
_FILES = sorted(path.name for path in _FOLDER.glob("*") if path.is_file())
_DRIVES = sorted(path.name for path in _FOLDER.glob("F*") if path.is_dir())


@pytest.mark.skipif(not _FILES, reason="the damaged files are in AUTOMAP_SHARED_DATA/broken")
@pytest.mark.parametrize("name", _FILES)
def test_a_damaged_file_gives_a_result_or_one_sentence(
    tmp_path: Path, shared_data: Path, name: str
) -> None:
    path = shared_data / "broken" / name
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            reader_of(name)(path, tmp_path)
        except AutoMapError as error:
            said = str(error)
            assert "\n" not in said
            assert len(said) < 1000
            assert str(path) in said or str(tmp_path) in said or name in said


@pytest.mark.skipif(not _DRIVES, reason="the damaged drives are in AUTOMAP_SHARED_DATA/broken")
@pytest.mark.parametrize("name", _DRIVES)
@pytest.mark.parametrize("command", ["check", "run"])
def test_a_damaged_drive_gives_a_result_or_one_sentence(
    tmp_path: Path, shared_data: Path, capfd: pytest.CaptureFixture[str], name: str, command: str
) -> None:
    drive = tmp_path / name
    shutil.copytree(shared_data / "broken" / name, drive, copy_function=shutil.copyfile)
    readings = drive / "imu.csv"
    if readings.is_file():
        # what is damaged comes early; half a minute is enough to go on with
        rows = readings.read_bytes().splitlines(keepends=True)
        readings.write_bytes(b"".join(rows[:3000]))
    code = run_command([command, str(drive), *(["--to", "fuse"] if command == "run" else [])])
    told = capfd.readouterr()
    assert code in (0, 2, 3)
    assert "unexpectedly" not in told.out + told.err
    assert "Traceback" not in told.out + told.err
    assert "Warning:" not in told.err
    assert len(told.out + told.err) < 20_000
    record = drive / "_automap" / "run.json"
    assert not record.is_file() or record.stat().st_size < 100_000


def test_images_with_huge_headers_are_left_out(tmp_path: Path, shared_data: Path) -> None:
    source, out = shared_data / "broken" / "mapillary", tmp_path / "drive"
    code = run_command(["import", "mapillary", str(source), "-o", str(out)])
    assert code in (0, 2, 3)


@pytest.mark.parametrize("stages", ["null", '{"ingest": [[]]}', '{"ingest": {"inputs": 3}}', "[]"])
def test_a_damaged_record_of_a_run_stops_no_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], stages: str
) -> None:
    (tmp_path / "drive.toml").write_text('schema = "automap.drive/1"\n')
    (tmp_path / "bearings.csv").write_text("lat_deg,lon_deg,bearing_deg\n48,11,0\n48,11.001,350\n")
    out = tmp_path / "out"
    out.mkdir()
    (out / "run.json").write_text(f'{{"schema": "automap.run/1", "stages": {stages}}}')
    assert run_command(["run", str(tmp_path), "-o", str(out), "--to", "ingest"]) == 0
    assert "unexpectedly" not in capsys.readouterr().err
