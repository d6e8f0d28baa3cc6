"""What a run found out about its cameras counts where signs are placed by hand."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geolocation_scene import camera

from automap.geolocation.landmark_kernels import RADIAL
from pipeline.view.placing import _corrections

TOLD: dict[str, Any] = {
    "boresight_rpy_deg": [1.0, -2.0, 3.0],
    "boresight_rpy_sd_deg": [0.1, 0.1, 0.1],
    "time_offset_s": 0.02,
    "time_offset_sd_s": 0.01,
    "focal_scale": 1.01,
    "focal_scale_sd": 0.002,
    "box_margin_px": 1.0,
    "box_margin_sd_px": 0.5,
}


@pytest.mark.parametrize(
    ("lens", "radial", "sd"),
    [({"k1_added": 0.07, "k1_sd": 0.005}, 0.07, 0.005), ({}, 0.0, 0.03)],
)
def test_a_camera_is_as_the_run_found_it_also_where_it_knew_nothing_of_lenses(
    lens: dict[str, float], radial: float, sd: float
) -> None:
    shown: Any = SimpleNamespace(out=Path("out"), metrics={"camera_front": TOLD | lens})
    found = _corrections(shown, {"front": camera(distortion_sd=0.03)})["front"]
    assert np.degrees(found.turn).tolist() == pytest.approx([1.0, -2.0, 3.0])
    assert found.radial == radial
    assert np.sqrt(found.covariance[RADIAL, RADIAL]) == pytest.approx(sd)
