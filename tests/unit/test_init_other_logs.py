"""What a folder holds beside what is taken: other receiver logs, files that are not known."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from input_drive import write_drive

from pipeline.init.choose import draft_of
from pipeline.init.command import init_drive
from pipeline.init.found import look
from pipeline.init.other_logs import seconds_late
from tests.unit.receiver_scene import simulated_fixes

SEED = 9932


@pytest.mark.parametrize("late", [-18, -1, 0, 1, 18])
def test_a_log_of_the_same_places_at_other_seconds(late: int) -> None:
    fixes = simulated_fixes(SEED)
    other = replace(
        fixes,
        gps_s=fixes.gps_s + late,
        lat_rad=fixes.lat_rad + np.random.default_rng(SEED).normal(0.0, 1e-7, len(fixes)),
    )
    assert seconds_late(fixes, other) == late


def test_a_receiver_that_stands_tells_no_seconds() -> None:
    fixes = simulated_fixes(SEED, fast=0.0)
    noise = np.random.default_rng(SEED).normal(0.0, 3e-7, len(fixes))
    other = replace(fixes, gps_s=fixes.gps_s + 5.0, lat_rad=fixes.lat_rad + noise)
    assert seconds_late(fixes, other) == 0


def test_a_log_of_another_hour_has_nothing_in_common() -> None:
    fixes = simulated_fixes(SEED)
    assert seconds_late(fixes, replace(fixes, gps_s=fixes.gps_s + 3600.0)) is None


def test_a_log_that_is_not_taken_is_named(tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "two")
    shutil.copy(drive / "gnss.nmea", drive / "other.nmea")
    doubts = draft_of(look(drive), drive, None).doubts
    assert any("other.nmea is a receiver's log too and is not taken" in text for text in doubts)


def test_many_files_that_are_not_used_are_told_in_one_line(tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "photos")
    (drive / "drive.toml").unlink()
    for number in range(50):
        (drive / f"IMG_{number:04d}.JPG").write_bytes(b"\xff\xd8")
    (drive / "notes.xyz").write_text("-")
    told = init_drive(drive, None, lambda *_: []).told
    assert sum("IMG_" in text for text in told) == 1
    assert any("IMG_0049.JPG, 50 files" in text and "import mapillary" in text for text in told)
    assert any("notes.xyz: not used" in text for text in told)
