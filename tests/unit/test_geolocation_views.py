"""Rays of a long drive's boxes, and its path: the same whether made at once or not."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.frames import matrix_to_rpy, rpy_to_matrix
from automap.geolocation import trajectory_adjustment, views
from automap.geolocation.path_relation import make_path
from automap.geolocation.trajectory_adjustment import Adjustment
from automap.geolocation.views import (
    CameraCorrection,
    MeasurementNoise,
    Views,
    build_views,
    map_origin,
)
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


def test_a_path_is_thinned_stretch_by_stretch(monkeypatch: pytest.MonkeyPatch) -> None:
    path = drive_path(duration_s=60.0)
    times = np.linspace(path.t_ns[0], path.t_ns[-1], 5) * 1e-9
    moved = Adjustment(times, np.outer(np.arange(5.0), [0.2, 0.1, -0.1]), np.full((5, 3), 0.1))
    origin = map_origin(path)
    for adjustment in (None, moved):
        whole = make_path(path, origin, adjustment)
        with monkeypatch.context() as patched:
            patched.setattr(trajectory_adjustment, "_ROWS", 100)
            pieces = make_path(path, origin, adjustment)
        assert len(whole.t_ns) == 1200
        for name, values in vars(whole).items():
            np.testing.assert_array_equal(values, getattr(pieces, name), name)


@pytest.mark.parametrize("slip_deg", [0.0, 0.25, 0.6, None])
def test_a_nose_that_is_off_its_course_is_no_error_of_a_cameras_yaw(
    slip_deg: float | None,
) -> None:
    """What a trajectory says of it, whatever that is; another's says nothing, and its heading is
    as unsure as it states."""
    path = drive_path(duration_s=20.0)
    own = np.radians([0.05, 0.04, 0.3])
    found, _ = boxes(path, roadside(path), camera(), np.random.default_rng(1))
    sd = np.tile(own, (len(path), 1))
    slip = np.nan if slip_deg is None else np.radians(slip_deg)
    sd[:, 2] = np.hypot(own[2], np.nan_to_num(slip))
    stated = replace(path, sd_rpy=sd, slip_sd=np.array(slip))
    built = build_views(stated, [found], {"front": camera()}, MeasurementNoise())
    assert built.attitude_sd == pytest.approx(np.tile(own, (len(built), 1)))


def test_a_turn_that_was_found_counts_as_if_the_manifest_had_it() -> None:
    path = drive_path(10.0)
    view = camera()
    found, _ = boxes(path, roadside(path, every_s=2.0), view, np.random.default_rng(0))
    turn = np.radians([1.0, -3.0, 5.0])
    mount = matrix_to_rpy(rpy_to_matrix(view.mount_rpy) @ rpy_to_matrix(turn))
    one, other = (
        build_views(path, [found], {"front": seen}, MeasurementNoise(), corrections)
        for seen, corrections in (
            (view, {"front": CameraCorrection(turn, 0.0, np.eye(10))}),
            (replace(view, mount_rpy=mount), None),
        )
    )
    for name in ("centre", "C_cam_ref", "C_cam_body", "velocity", "rate", "measured"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-9)
