"""Fifty simulated sensors: the intervals hold what they promise."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from calibration_scene import GRAVITY, random_errors, random_poses, recorded, turned_by_hand

from automap.calibration.dynamic import calibrate_dynamic
from automap.calibration.static import calibrate_static

SEEDS = 50
OFF = ~np.eye(3, dtype=bool)


@pytest.mark.slow
def test_static_intervals_cover() -> None:
    inside = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        truth = random_errors(rng)
        log = recorded(rng, turned_by_hand(rng, random_poses(rng, 20)), truth)
        result = calibrate_static([log], GRAVITY)
        a, g = result.accel, result.gyro
        assert g is not None
        found = np.concatenate([a.scale, a.bias, a.misalignment, g.scale, g.bias, g.matrix[OFF]])
        true = np.concatenate(
            [truth.accel_scale, truth.accel_bias, truth.misalignment, truth.gyro_scale,
             truth.gyro_bias, truth.gyro_matrix[OFF]]
        )  # fmt: skip
        inside.append(np.abs(found - true) <= np.concatenate([a.half_width, g.half_width]))
    cover = np.array(inside)
    for part in (cover[:, :9], cover[:, 9:]):
        assert 0.90 <= part.mean() <= 0.985
    # one parameter in fifty draws: below 42 would happen to one in a thousand at 95 %
    assert cover.sum(axis=0).min() >= 42


@pytest.mark.slow
def test_dynamic_recovers_turn_on_biases() -> None:
    accel, gyro, standard = [], [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        truth = replace(random_errors(rng), misalignment=np.zeros(3), gyro_matrix=np.eye(3))
        motion = turned_by_hand(rng, random_poses(rng, 80), 0.0, 1.5, 2.0)
        log = recorded(rng, motion, truth)
        result = calibrate_dynamic(log, log.gyro, log.accel, GRAVITY)
        accel.append(result.final[:3] - truth.accel_bias)
        gyro.append(result.final[3:6] - truth.gyro_bias)
        standard.append(gyro[-1] / result.sd[-1, 3:6])
    assert np.abs(accel).max() < 0.02
    assert np.sqrt(np.mean(np.degrees(gyro) ** 2)) < 0.0025
    assert np.degrees(np.abs(gyro)).max() < 0.005
    assert np.sqrt(np.mean(np.square(standard))) < 1.2
