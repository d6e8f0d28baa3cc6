"""The trajectory adjusted by control signs and by signs seen again."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geolocation_scene import ORIGIN, Scene, boxes, camera, drive_path, roadside

from automap.earth import from_local_ned, local_ned
from automap.geolocation.limits import FACE_SD_M, LASTING_ERROR
from automap.geolocation.locate import locate_signs
from automap.geolocation.result import GeolocationResult
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.trajectory_adjustment import place_signs
from automap.mapping.limits import PATH_CORRELATION_S
from automap.records import Detections, SignPoints, Trajectory

SHIFT = np.array([3.0, -2.0, 0.0])


def moved(trajectory: Trajectory, shift: np.ndarray, sd_m: float) -> Trajectory:
    """The trajectory with a constant or row-wise position error [3] or [n, 3]."""
    place = local_ned(trajectory.lat_rad, trajectory.lon_rad, trajectory.height_m, ORIGIN)
    lat, lon, height = from_local_ned(place + shift, ORIGIN)
    sd = np.full((len(trajectory), 3), sd_m)
    return replace(trajectory, lat_rad=lat, lon_rad=lon, height_m=height, sd_pos_ned=sd)


def adjusted(result: GeolocationResult) -> Trajectory:
    assert result.adjusted is not None
    (whole,) = result.adjusted.pieces()
    return whole


def error(result: GeolocationResult, true: Trajectory) -> np.ndarray:
    """Horizontal error [n, 2] of the adjusted trajectory."""
    one, other = (
        local_ned(t.lat_rad, t.lon_rad, t.height_m, ORIGIN) for t in (adjusted(result), true)
    )
    return np.asarray(one - other)[:, :2]


@pytest.fixture(scope="module")
def passed() -> tuple[Trajectory, Scene, Detections]:
    path = drive_path(40.0)
    scene = roadside(path, every_s=4.0)
    return path, scene, boxes(path, scene, camera(), np.random.default_rng(0), noise_px=0.5)[0]


def surveyed(scene: Scene, rows: list[int], sd_m: float = 0.05) -> SignPoints:
    lat, lon, _ = from_local_ned(scene.position[rows], ORIGIN)
    names, none = np.full(len(rows), "", np.object_), np.full((len(rows), 2, 2), np.nan)
    return SignPoints(lat, lon, names, none, np.full(len(rows), sd_m))


@pytest.mark.slow
def test_control_signs_take_the_common_error_off(passed) -> None:
    path, scene, found = passed
    off = moved(path, SHIFT, 3.0)
    rows = list(range(0, len(scene.position), 2))
    result = locate_signs(off, [found], {"front": camera()}, control=surveyed(scene, rows))
    assert result.n_control >= len(rows) - 1
    assert np.linalg.norm(error(result, path), axis=1).max() < 1.0
    assert adjusted(result).sd_pos_ned[:, :2].max() < 1.5
    np.testing.assert_array_equal(adjusted(result).rpy, off.rpy)
    for sign in result.signs:
        place = local_ned(sign.lat_rad, sign.lon_rad, 0.0, ORIGIN)[:2]
        assert np.linalg.norm(scene.position[:, :2] - place, axis=1).min() < 1.2
    # boxes are as far off their signs as they are drawn, wherever the path was
    plain = locate_signs(off, [found], {"front": camera()})
    one, other = (r.observations.residual_px[r.observations.used] for r in (result, plain))
    assert np.sqrt(np.mean(one**2)) == pytest.approx(np.sqrt(np.mean(other**2)), rel=0.05)
    assert np.sqrt(np.mean(one**2)) < 1.5


@pytest.mark.slow
def test_without_control_or_second_pass_nothing_is_adjusted(passed) -> None:
    path, _, found = passed
    result = locate_signs(moved(path, SHIFT, 3.0), [found], {"front": camera()})
    assert result.adjusted is None
    assert result.n_control == 0


@pytest.mark.slow
def test_control_signs_of_another_place_are_left_out_and_said(passed) -> None:
    path, scene, found = passed
    far = replace(scene, position=scene.position + np.array([500.0, 500.0, 0.0]))
    result = locate_signs(path, [found], {"front": camera()}, control=surveyed(far, [0, 1]))
    assert result.n_control == 0
    assert result.adjusted is None
    assert any("2 of 2 control signs" in text for text in result.warnings)


@pytest.mark.slow
def test_a_second_pass_halves_the_difference_of_the_two() -> None:
    """The same circle twice, the second lap's trajectory shifted: both laps meet halfway."""
    lap_s = 40.0
    path = drive_path(2.0 * lap_s, turn_rate=2.0 * np.pi / lap_s)
    scene = roadside(drive_path(lap_s, turn_rate=2.0 * np.pi / lap_s), every_s=4.0)
    found, _ = boxes(path, scene, camera(), np.random.default_rng(0), noise_px=0.5)
    seconds = (path.t_ns - path.t_ns[0]) * 1e-9
    late = np.clip((seconds - lap_s) / 5.0 + 0.5, 0.0, 1.0)[:, None] * np.array([2.0, 0.0, 0.0])
    result = locate_signs(moved(path, late, 2.0), [found], {"front": camera()})
    after = error(result, path)
    first, second = after[seconds < 0.8 * lap_s, 0], after[seconds > 1.2 * lap_s, 0]
    assert abs(second.mean() - first.mean()) < 0.8, "two metres apart before"
    off = GeolocationRules(adjust_trajectory=False)
    assert locate_signs(path, [found], {"front": camera()}, off).adjusted is None


@pytest.mark.parametrize("surveyed_to_m", [None, 0.05])
def test_what_lasts_all_along_the_drive_no_second_pass_averages(
    surveyed_to_m: float | None,
) -> None:
    """Error and sigma everywhere, from the whole covariance of all errors at once; where a place is
    surveyed, it tells what lasts."""
    path = moved(drive_path(900.0), np.zeros(3), 2.0)
    start = float(path.t_ns[0]) * 1e-9
    passed_s = start + np.array([20.0, 30.0, 500.0, 510.0, 850.0])
    off = np.array(
        [[1.0, -2.0, 0.5], [1.2, -1.8, 0.3], [-1.5, 1.0, 0.2], [-1.4, 0.8, 0.0], [0.3] * 3]
    )
    groups = [[0, 2], [1, 3, 4]]
    sign = np.array([0, 1, 0, 1, 1])
    place = 10.0 * sign[:, None] + off
    seen: Any = [
        SimpleNamespace(
            time_s=t,
            position=x,
            covariance=(0.3**2 + 2.0**2) * np.eye(3),
            path_sd=np.full(3, 2.0),
            camera=0,
            camera_cov=np.eye(10),
            camera_effect=np.zeros((3, 10)),
            size_effect=np.zeros(3),
        )
        for t, x in zip(passed_s, place, strict=True)
    ]
    control = {0: (np.zeros(3), surveyed_to_m**2 * np.eye(3))} if surveyed_to_m else {}
    _, found = place_signs(path, seen, groups, control)
    assert found is not None

    def alike(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        wander = np.exp(-np.abs(one[:, None] - other) / PATH_CORRELATION_S)
        return np.asarray(2.0**2 * (LASTING_ERROR + (1.0 - LASTING_ERROR) * wander))

    own = (0.3**2 + FACE_SD_M**2) * np.eye(5)
    free = 1e4**2 * (sign[:, None] == sign)
    if surveyed_to_m:
        free = np.where((sign == 0)[:, None] & (sign == 0), surveyed_to_m**2, free)
    gain = alike(found.time_s, passed_s) @ np.linalg.inv(alike(passed_s, passed_s) + own + free)
    variance = 2.0**2 - np.einsum("ij,ij->i", gain, alike(found.time_s, passed_s))
    expected = gain @ (place - np.where(sign == 0, 0.0, 10.0)[:, None])
    assert found.error == pytest.approx(expected, abs=1e-3)
    assert found.sd[:, 0] == pytest.approx(np.sqrt(variance), abs=1e-3)
    assert surveyed_to_m or found.sd.min() > 0.8 * 2.0, "two passes tell nothing of what lasts"
