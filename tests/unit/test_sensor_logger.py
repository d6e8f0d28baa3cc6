"""Recordings of a phone that were opened, mixed or renamed before they were read."""

from __future__ import annotations

import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from import_phones import write_sensor_logger

from automap.errors import InputError
from automap.io.sensor_logger import read_sensor_logger
from pipeline.cli.root import run_command


def edited(folder: Path, name: str, change: Callable[[str], str]) -> None:
    path = folder / f"{name}.csv"
    first, _, rest = path.read_text().partition("\n")
    path.write_text(first + "\n" + change(rest))


@pytest.mark.parametrize("name", ["Location", "Gyroscope"])
def test_times_that_a_spreadsheet_rounded_are_refused(tmp_path: Path, name: str) -> None:
    folder = write_sensor_logger(tmp_path / "phone")
    edited(folder, name, lambda rows: re.sub(r"(?m)^1\d{18}", "1.70000E+18", rows))
    with pytest.raises(InputError, match=f"{name}: column time holds '1.70000E\\+18'"):
        read_sensor_logger(folder)


def test_exchanged_latitudes_are_told_where_they_can_be_none(tmp_path: Path) -> None:
    folder = write_sensor_logger(tmp_path / "phone")
    edited(folder, "Location", lambda rows: re.sub(r"(?m)-[\d.]+$", "-105.1", rows))
    with pytest.raises(InputError, match="exchange the names"):
        read_sensor_logger(folder)


def test_a_second_recording_in_a_folder_or_archive_is_told(tmp_path: Path) -> None:
    folder = write_sensor_logger(tmp_path / "phone")
    shutil.copy(folder / "Location.csv", folder / "Location (1).csv")
    assert any("Location (1).csv" in text for text in read_sensor_logger(folder).warnings)
    archive = tmp_path / "phone.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for part in ("a", "b"):
            for name in ("Gyroscope", "Accelerometer", "Gravity"):
                file.write(folder / f"{name}.csv", f"{part}/{name}.csv")
    with pytest.raises(InputError, match="several recordings"):
        read_sensor_logger(archive)


def test_folders_in_a_folder_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_sensor_logger(tmp_path / "all" / "monday")
    assert run_command(["init", str(tmp_path / "all"), "-o", str(tmp_path / "o"), "--yes"]) == 3
    assert "not looked into: monday; give one" in capsys.readouterr().err


def test_local_time_in_one_table_is_told_by_its_zone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_sensor_logger(tmp_path / "phone")
    hour = 3600 * 10**9
    edited(
        folder, "Location",
        lambda rows: re.sub(r"(?m)^\d{19}", lambda m: str(int(m[0]) - 6 * hour), rows),
    )  # fmt: skip
    assert run_command(["init", str(folder), "-o", str(tmp_path / "o"), "--yes"]) == 3
    told = " ".join(capsys.readouterr().out.split())
    assert "the fixes are -6 h from the IMU" in told
