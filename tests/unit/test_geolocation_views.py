"""Rays of a long drive's boxes: the same whether made at once or not, and no more memory."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.geolocation import views
from automap.geolocation.views import MeasurementNoise, Views, build_views
from automap.records import Detections, Trajectory


def peak(path: Trajectory, found: list[Detections]) -> tuple[Views, int]:
    """Views, and the bytes that they took at most while they were made."""
    cameras = {one.camera: camera() for one in found}
    tracemalloc.start()
    try:
        built = build_views(path, found, cameras, MeasurementNoise(stamp_sd_s=0.01))
        return built, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_rays_are_made_stretch_by_stretch(monkeypatch: pytest.MonkeyPatch) -> None:
    path = drive_path(duration_s=60.0)
    one, _ = boxes(path, roadside(path), camera(), np.random.default_rng(1))
    many = {
        k: np.concatenate([v] * 8) for k, v in vars(one).items() if isinstance(v, np.ndarray)
    }  # fmt: skip
    found = [replace(one, **many), replace(one, camera="rear")]
    peak(path, found)  # what is imported
    whole, at_once = peak(path, found)
    monkeypatch.setattr(views, "_ROWS", 200)
    pieces, by_stretch = peak(path, found)
    assert len(whole) > 1000
    for name, values in vars(whole).items():
        np.testing.assert_array_equal(values, getattr(pieces, name), name)
    size = sum(v.nbytes for v in vars(whole).values() if isinstance(v, np.ndarray))
    # parts and the one column that is being joined, its rows in order
    assert by_stretch < 2.0 * size < at_once
