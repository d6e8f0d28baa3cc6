"""The paper's experiments on a real drive: their figures must show what they claim."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pipeline.cli.root import run_command
from tests.slow_cases import others_slow

DRIVE = "drives/kitti-20110926-0059"


@pytest.mark.slow
@pytest.mark.parametrize("kind", others_slow(["dropout", "calibration"]))
def test_outages_show_what_calibration_and_smoothing_bring(
    kind: str, shared_data: Path, tmp_path: Path
) -> None:
    words = ["experiment", kind, str(shared_data / DRIVE), "-o", str(tmp_path)]
    assert run_command([*words, "--outage", "8", "--every", "14"]) == 0
    figures = json.loads((tmp_path / f"{kind}.json").read_text())
    assert figures["outages"] >= 2
    worse, better = (
        ("uncalibrated_rms_of_largest_m", "calibrated_rms_of_largest_m")
        if kind == "calibration"
        else ("filter_rms_of_largest_m", "smoother_rms_of_largest_m")
    )
    assert figures[better] < 0.7 * figures[worse]
    assert (tmp_path / f"{kind}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_biases_and_nis_are_plotted(shared_data: Path, tmp_path: Path) -> None:
    drive = str(shared_data / DRIVE)
    assert run_command(["experiment", "biases", drive, "-o", str(tmp_path)]) == 0
    assert run_command(["experiment", "nis", drive, "-o", str(tmp_path)]) == 0
    biases = json.loads((tmp_path / "biases.json").read_text())
    added = json.loads((shared_data / DRIVE / "truth/added_errors.json").read_text())
    # the errors were added in the sensor's axes (FLU), ours are the vehicle's (FRD)
    truth = -added["gyro_bias"][2]
    found = biases["gyro_bias_z"]
    assert abs(found["end"] - truth) < 4 * found["sd"] + 5e-4
    nis = json.loads((tmp_path / "nis.json").read_text())
    assert 0.5 < nis["velocity"]["mean"] < 1.5
    assert nis["doubts"] == []


def test_outages_closer_than_fixes_allow_are_refused(tmp_path: Path) -> None:
    words = ["experiment", "dropout", "nowhere", "-o", str(tmp_path), "--outage", "15"]
    assert run_command([*words, "--every", "16"]) == 2
