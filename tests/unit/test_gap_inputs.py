"""What is wrong with a drive is told before a search gives it another name."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from pipeline.gap.inputs import gap_drives
from pipeline.settings.load import load_settings
from tests.unit.broken_drive import write_short_drive


@pytest.mark.slow
def test_readings_that_end_at_their_range_are_told(tmp_path: Path) -> None:
    drive, told = tmp_path / "drive", list[str]()
    write_short_drive(drive)
    gap_drives([drive], tmp_path / "whole", load_settings(None), told.append)
    assert not any("largest value" in text for text in told)
    readings = pd.read_csv(drive / "imu.csv")
    # a shake that is stronger than the range
    readings.loc[500:520, "ay"] = 19.62
    readings.to_csv(drive / "imu.csv", index=False)
    gap_drives([drive], tmp_path / "clipped", load_settings(None), told.append)
    (text,) = (text for text in told if "largest value" in text)
    assert text.startswith(f"{drive / 'imu.csv'}: ay sits")
    assert "choose a wider one" in text
