"""What stops a run, and what a drive may accept of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from input_drive import write_drive

from automap.errors import InputError
from pipeline.check.command import check_drive
from tests.unit.checked_drive import edit, ingested


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return write_drive(tmp_path / "formula")


def test_what_stops_a_run_is_what_check_calls_an_error(drive: Path, tmp_path: Path) -> None:
    edit(drive, "[imu]\n", '[imu]\naxes = "BLD"\n')
    (wrong,) = [f for f in check_drive(drive).findings if f.severity == "error"]
    assert wrong.code == "imu_axes"
    assert 'accept = ["imu_axes"] at the top of drive.toml' in wrong.advice
    with pytest.raises(InputError) as caught:
        ingested(drive, tmp_path / "work")
    assert str(caught.value) == f"{drive / 'imu.csv'}: {wrong.text}; {wrong.advice}."


def test_what_is_accepted_is_a_warning_in_both(drive: Path, tmp_path: Path) -> None:
    edit(drive, "[imu]\n", '[imu]\naxes = "BLD"\n')
    manifest = drive / "drive.toml"
    manifest.write_text('accept = ["imu_axes"]\n' + manifest.read_text())
    report = check_drive(drive)
    assert report.usable
    (told,) = [f.text for f in report.findings if f.severity == "warning"]
    (warning,) = ingested(drive, tmp_path / "work").warnings
    assert warning == f'{drive / "imu.csv"}: {told}; accepted as "imu_axes"'


def test_a_code_that_nothing_was_found_of_is_told(drive: Path, tmp_path: Path) -> None:
    manifest = drive / "drive.toml"
    manifest.write_text('accept = ["imu_axis"]\n' + manifest.read_text())
    said = "accept names imu_axis, and nothing of that name was found"
    assert said in check_drive(drive).text()
    assert any(said in text for text in ingested(drive, tmp_path / "work").warnings)


def test_nobody_can_accept_that_there_are_no_positions(drive: Path, tmp_path: Path) -> None:
    (drive / "gnss.nmea").unlink()
    manifest = drive / "drive.toml"
    manifest.write_text('accept = ["no_positions"]\n' + manifest.read_text())
    report = check_drive(drive)
    assert not report.usable
    (wrong,) = [f for f in report.findings if f.severity == "error"]
    with pytest.raises(InputError) as caught:
        ingested(drive, tmp_path / "work")
    assert str(caught.value) == f"{manifest}: {wrong.text}; {wrong.advice}."
