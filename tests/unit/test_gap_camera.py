"""Effects of the camera from boxes of tracked signs: geometry, fit and search."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from automap.earth import from_local_ned
from automap.effects.camera import as_stated, exposed, row_delay_s, true_camera
from automap.effects.camera_user import drift
from automap.effects.path_signals import path_signals
from automap.effects.user import set_user_effects
from automap.effects.user_tables import effects_of_formulas
from automap.errors import ConfigError
from automap.frames import rpy_to_matrix
from automap.gap.camera.fit import box_noise, fit_camera
from automap.gap.camera.search import find_camera_gap
from automap.gap.camera.views import Boxes, boxes_of, joined
from automap.interpolation import poses_at
from automap.records import Camera, Detections, FloatArray, IntArray, Trajectory
from automap.simulation.boxes import face_box
from pipeline.settings.load import load_settings
from tests.slow_cases import others_slow

PLATE = 0.5 * np.array([[[0.0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]]])
"""Middles of the edges of a plate that faces the camera, in its axes."""
ORIGIN = (-0.6, 2.6, 500.0)
PIXEL_SD = 0.7
CAMERA = Camera(
    width=1280,
    height=720,
    matrix=np.array([[1000.0, 0.0, 640.0], [0.0, 1000.0, 360.0], [0.0, 0.0, 1.0]]),
    distortion=np.zeros(5),
    lever_arm_m=np.array([1.3, 0.0, -0.6]),
    mount_rpy=np.array([0.01, -0.02, 0.03]),
    mount_sd=0.001,
    time_offset_s=0.0,
    time_offset_sd=0.001,
)
VALUES = {
    "camera_boresight": {"roll": 0.0, "pitch": 0.012, "yaw": -0.02},
    "camera_time_offset": {"s": 0.06},
    "rolling_shutter": {"s": 0.04},
    "camera_focal": {"relative": 0.03},
    "camera_distortion": {"k1": -0.12, "k2": 0.05},
    "camera_lever_arm": {"x": 0.9, "y": 0.5, "z": 0.0},
}


@lru_cache
def path() -> Trajectory:
    """Two minutes of winding road at changing speed, 20 rows a second."""
    t = np.arange(0.0, 120.0, 0.05)
    speed = 11.0 + 5.0 * np.sin(0.2 * t)
    yaw = 0.9 * np.sin(0.11 * t) + 0.25 * np.sin(0.5 * t)
    pitch, roll = 0.02 * np.sin(0.3 * t), 0.03 * np.sin(0.7 * t)
    vel = np.stack([speed * np.cos(yaw), speed * np.sin(yaw), 0.0 * t], axis=1)
    steps = 0.5 * (vel[1:] + vel[:-1]) * 0.05
    pos = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    lat, lon, height = from_local_ned(pos, ORIGIN)
    n = len(t)
    return Trajectory(
        t_ns=(t * 1e9).astype(np.int64),
        gps_s=1.4e9 + t,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=vel,
        rpy=np.stack([roll, pitch, yaw], axis=1),
        sd_pos_ned=np.full((n, 3), 0.3),
        sd_vel_ned=np.full((n, 3), 0.02),
        sd_rpy=np.tile([0.0005, 0.0005, 0.001], (n, 1)),
    )


def film(values: dict[str, dict[str, float]], seed: int = 1) -> tuple[Detections, IntArray]:
    """What a detector makes of some signs, and the number of the sign of each box."""
    rng = np.random.default_rng(seed)
    trajectory = path()
    camera, signals = true_camera(CAMERA, values), path_signals(trajectory).signals
    frames = np.arange(1.0, 119.0, 0.1)
    here = poses_at(trajectory, (frames * 1e9).astype(np.int64))
    north, east = _metres(here.lat_rad, here.lon_rad)
    boxes, stamps, numbers = [], [], []
    for number, at in enumerate(np.arange(20, len(frames), 25)):
        yaw = here.rpy[at, 2]
        aside = float(rng.choice([-1.0, 1.0]) * rng.uniform(2.5, 7.0))
        down = -float(rng.uniform(0.8, 4.5))
        place = np.array([north[at] - np.sin(yaw) * aside, east[at] + np.cos(yaw) * aside, down])
        size = float(rng.uniform(0.5, 0.9))
        stamp = frames[max(0, at - 60) : at]
        at = stamp + camera.time_offset_s + drift(values, signals.at(stamp))[1]
        ray, _ = exposed(camera, values, pose_at, at, place, signals)
        box = face_box(camera, ray, PLATE * size)
        box += rng.normal(0.0, PIXEL_SD, box.shape)
        good = (ray[:, 0] > 5.0) & (ray[:, 0] < 60.0) & (box[:, :2] > 2.0).all(axis=1)
        good &= (box[:, 2] < 1277.0) & (box[:, 3] < 717.0)
        boxes.append(box[good])
        stamps.append(stamp[good])
        numbers.append(np.full(int(good.sum()), number))
    n = sum(len(b) for b in boxes)
    found = Detections(
        frame=np.arange(n),
        t_ns=np.rint(np.concatenate(stamps) * 1e9).astype(np.int64),
        class_name=np.full(n, "sign", np.object_),
        box=np.concatenate(boxes),
        score=np.ones(n),
        track=np.full(n, -1, np.int64),
    )
    return found, np.concatenate(numbers)


def _metres(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
    from automap.earth import local_ned

    place = local_ned(lat, lon, np.full(len(lat), ORIGIN[2]), ORIGIN)
    return place[:, 0], place[:, 1]


def pose_at(seconds: FloatArray) -> tuple[FloatArray, FloatArray]:
    pose = poses_at(path(), np.rint(seconds * 1e9).astype(np.int64))
    north, east = _metres(pose.lat_rad, pose.lon_rad)
    return np.column_stack([north, east, np.zeros(len(north))]), rpy_to_matrix(pose.rpy)


def boxes_with(values: dict[str, dict[str, float]], seed: int = 1) -> Boxes:
    found, numbers = film(values, seed)
    boxes = boxes_of(path(), CAMERA, found, numbers, path_signals(path()))
    assert boxes is not None
    return boxes


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect",
    others_slow(
        [
            "camera_lever_arm",
            "camera_boresight",
            "camera_time_offset",
            "rolling_shutter",
            "camera_focal",
            "camera_distortion",
        ]
    ),
)
def test_an_effect_of_the_camera_is_named_and_recovered(effect: str) -> None:
    gap = find_camera_gap("front", boxes_with({effect: VALUES[effect]}), None)
    assert [f.effect for f in gap.findings] == [effect]
    finding = gap.findings[0]
    assert finding.p_value < 1e-3
    for parameter, true in VALUES[effect].items():
        value = finding.parameters[parameter]
        assert abs(value.value - true) < 4.0 * value.sd, parameter
    assert gap.gap_after < 0.3 * gap.gap_before


USERS = {
    "nods": {"k": {"on": "camera_pitch", "formula": "acceleration", "prior_sd": 0.01}},
    "dawdles": {"k": {"on": "camera_time", "formula": "speed", "prior_sd": 0.01}},
    "leans": {
        "roll": {"on": "camera_roll", "formula": "lateral_acceleration", "prior_sd": 0.01},
        "yaw": {"on": "camera_yaw", "formula": "lateral_acceleration", "prior_sd": 0.01},
    },
}
HIDDEN = {"nods": {"k": 0.015}, "dawdles": {"k": 0.004}, "leans": {"roll": 0.01, "yaw": 0.008}}


@pytest.fixture
def users() -> Iterator[None]:
    set_user_effects(effects_of_formulas(USERS, "mine.toml"))
    yield
    set_user_effects([])


@pytest.mark.slow
@pytest.mark.usefixtures("users")
@pytest.mark.parametrize(
    "effect", ["leans", *(pytest.param(e, marks=pytest.mark.slow) for e in HIDDEN if e != "leans")]
)
def test_a_users_effect_of_the_camera_is_named_and_recovered(effect: str) -> None:
    gap = find_camera_gap("front", boxes_with({effect: HIDDEN[effect]}), None)
    assert [f.effect for f in gap.findings] == [effect]
    for parameter, true in HIDDEN[effect].items():
        value = gap.findings[0].parameters[parameter]
        assert abs(value.value - true) < 4.0 * value.sd, parameter
        assert value.sd < 0.2 * true


@pytest.mark.slow
@pytest.mark.usefixtures("users")
def test_known_effects_that_go_with_the_drive_are_taken_out_of_the_boxes() -> None:
    values = {**HIDDEN, "rolling_shutter": {"s": 0.04}}
    found, numbers = film(values)
    back = as_stated(found, CAMERA, values, path_signals(path()))
    assert find_camera_gap("front", boxes_with(values), None).findings
    boxes = boxes_of(path(), CAMERA, back, numbers, path_signals(path()))
    assert boxes is not None
    gap = find_camera_gap("front", boxes, None)
    assert gap.findings == ()
    assert gap.gap_before < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_camera_as_stated_is_silent(seed: int) -> None:
    gap = find_camera_gap("front", boxes_with({}, seed), None)
    assert gap.findings == ()


def test_signs_at_their_best_places_give_back_their_boxes() -> None:
    boxes = boxes_with({})
    fit = fit_camera(
        boxes, box_noise(boxes, np.full(2, PIXEL_SD), np.zeros(2)), np.zeros(boxes.n_common)
    )
    # to the noise of their edges
    rest = (fit.residual * fit.sd)[:, :2]
    assert 0.8 < float(np.std(rest)) / (PIXEL_SD / np.sqrt(2.0) / 1000.0) < 1.05


@pytest.mark.slow
def test_drives_of_one_camera_are_searched_together() -> None:
    values = {"rolling_shutter": {"s": 0.04}}
    parts = [boxes_with(values, seed) for seed in (1, 2)]
    both = joined(parts)
    assert both.n_signs == sum(p.n_signs for p in parts)
    gap, one = find_camera_gap("front", both, None), find_camera_gap("front", parts[0], None)
    assert [f.effect for f in gap.findings] == ["rolling_shutter"]
    found = gap.findings[0].parameters["s"]
    assert abs(found.value - 0.04) < 4.0 * found.sd
    assert found.sd < 0.85 * one.findings[0].parameters["s"].sd


def test_too_few_signs_are_told() -> None:
    boxes = boxes_with({}).of_signs(0, 5)
    gap = find_camera_gap("front", boxes, None)
    assert gap.findings == ()
    assert "only 5 signs" in gap.warnings[0]


def test_the_true_camera_is_the_stated_one_with_its_errors() -> None:
    same = true_camera(CAMERA, {})
    np.testing.assert_allclose(same.mount_rpy, CAMERA.mount_rpy, atol=1e-12)
    np.testing.assert_array_equal(same.matrix, CAMERA.matrix)
    true = true_camera(CAMERA, VALUES)
    assert true.matrix[0, 0] == pytest.approx(1030.0)
    assert true.matrix[0, 2] == CAMERA.matrix[0, 2]
    assert true.time_offset_s == pytest.approx(0.06)
    np.testing.assert_allclose(true.lever_arm_m, [2.2, 0.5, -0.6])
    np.testing.assert_allclose(true.distortion[:2], [-0.12, 0.05])
    # further turned in the camera's own axes
    turn = rpy_to_matrix(CAMERA.mount_rpy).T @ rpy_to_matrix(true.mount_rpy)
    np.testing.assert_allclose(turn, rpy_to_matrix(np.array([0.0, 0.012, -0.02])), atol=1e-12)
    assert row_delay_s(np.array([-0.5, 359.5, 719.5]), 720, VALUES) == pytest.approx(
        [-0.02, 0.0, 0.02]
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[geolocate.fixed.front.camera_boresigt]\nyaw = 0.01\n", "no effect of a camera"),
        ("[geolocate.fixed.front.camera_boresight]\njaw = 0.01\n", "has no parameter 'jaw'"),
        ("[geolocate.fixed.front.gyro_bias]\nx = 0.01\n", "no effect of a camera"),
    ],
)
def test_wrong_errors_of_a_camera_are_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "model.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=said):
        load_settings(path)
