"""Errors of a real camera: signs of a recorded street, labelled by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from automap.gap.camera.search import CameraGap
from pipeline.gap.camera import camera_gaps

AHEAD_M = 1.08
"""How far before the inertial unit the camera stands, by the data set's own calibration: 0.81 m
to the laser scanner and 0.27 m on from there."""


def found_with(model: str, shared_data: Path, folder: Path) -> CameraGap:
    """What is found with a model of IMU and receiver; the manifest has the camera at the IMU."""
    file = folder / "model.toml"
    file.write_text(model, encoding="utf-8")
    drive = shared_data / "drives" / "kitti-20110930-0033"
    gaps, warnings = camera_gaps([drive], [], folder / "runs", file, [])
    assert warnings == []
    # three signs are held out
    assert gaps[0].gap_after < 0.5 * gaps[0].gap_before
    return gaps[0]


@pytest.mark.slow
@pytest.mark.parametrize("model", ["", "[fuse]\nvelocity_wander_sd = 0.0\n"])
def test_a_camera_that_is_not_where_the_manifest_says(
    shared_data: Path, tmp_path: Path, model: str
) -> None:
    """The lever arm is named, not another focal length, which explains the signs nearly as well."""
    gap = found_with(model, shared_data, tmp_path)
    ahead = next(f for f in gap.findings if f.effect == "camera_lever_arm").parameters["x"]
    assert abs(ahead.value - AHEAD_M) < 3.0 * ahead.sd < 1.0
