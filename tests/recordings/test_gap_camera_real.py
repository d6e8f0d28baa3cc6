"""Errors of a real camera: signs of a recorded street, labelled by hand."""

from __future__ import annotations

from pathlib import Path

from pipeline.gap.camera import camera_gaps

AHEAD_M = 1.08
"""How far before the inertial unit the camera stands, by the data set's own calibration: 0.81 m
to the laser scanner and 0.27 m on from there."""


def test_a_camera_that_is_not_where_the_manifest_says(shared_data: Path, tmp_path: Path) -> None:
    # the manifest has it at the inertial unit
    model = tmp_path / "model.toml"
    model.write_text("", encoding="utf-8")
    drive = shared_data / "drives" / "kitti-20110930-0033"
    gaps, warnings = camera_gaps([drive], [], tmp_path / "runs", model, [])
    assert warnings == []
    found = {f.effect: f for f in gaps[0].findings}
    ahead = found["camera_lever_arm"].parameters["x"]
    assert abs(ahead.value - AHEAD_M) < 3.0 * ahead.sd
    assert ahead.sd < 0.3
    assert gaps[0].gap_after < 0.2 * gaps[0].gap_before
