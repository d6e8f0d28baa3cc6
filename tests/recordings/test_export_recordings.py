"""Maps of real drives: the path of the reference and the true signs in every format."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from automap.export.geojson import read_signs_geojson, signs_geojson
from automap.export.path import simplified_path
from automap.export.sign_columns import sign_columns
from automap.io.trajectory_csv import read_trajectory_csv


@pytest.fixture(scope="module")
def drives(shared_data: Path) -> list[Path]:
    return sorted((shared_data / "drives").glob("kitti-*"))


def test_true_signs_are_read_and_survive_being_written(drives: list[Path], tmp_path: Path) -> None:
    total = 0
    for drive in drives:
        truth = drive / "truth" / "signs.geojson"
        signs = read_signs_geojson(truth)
        assert len(signs) == len(json.loads(truth.read_text())["features"])
        assert {round(float(np.sqrt(s.cov_enu[0, 0])), 3) for s in signs} <= {0.7}
        copy = tmp_path / f"{drive.name}.geojson"
        copy.write_text(signs_geojson(sign_columns(signs)), encoding="utf-8")
        for before, after in zip(signs, read_signs_geojson(copy), strict=True):
            assert abs(before.lat_rad - after.lat_rad) < 1e-9
            assert (before.id, before.class_name) == (after.id, after.class_name)
        total += len(signs)
    assert len(drives) == 10
    assert total == 88


def test_reference_paths_are_thinned_within_tolerance(drives: list[Path]) -> None:
    for drive in drives:
        full = read_trajectory_csv(drive / "truth" / "trajectory.csv").data
        path = simplified_path(full, tolerance_m=0.1)
        assert len(path) < 0.1 * len(full)
        lat = np.interp(full.t_ns, path.t_ns, np.radians(path.lat_deg))
        lon = np.interp(full.t_ns, path.t_ns, np.radians(path.lon_deg))
        north = (lat - full.lat_rad) * 6.37e6
        east = (lon - full.lon_rad) * 6.37e6 * np.cos(full.lat_rad)
        # between the ten rows a second that take part a car moves on by its own curvature
        assert np.hypot(north, east).max() < 0.2, drive.name
