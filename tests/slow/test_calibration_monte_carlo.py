"""Fifty simulated sensors: the intervals hold what they promise."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from calibration_scene import (
    GRAVITY,
    random_errors,
    random_poses,
    random_walk,
    recorded,
    turned_by_hand,
)

from automap.calibration.dynamic import calibrate_dynamic
from automap.calibration.limits import WALK
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


def _dynamic(seed: int, drifting: bool) -> tuple[np.ndarray, np.ndarray]:
    """Error [12] and sigma [12] of a dynamic calibration of two minutes in the hand.

    The hand sways by 5 cm and 0.3 m/s RMS; the biases of a ``drifting`` sensor walk as the
    model says, and what they are at the end is to be found.
    """
    rng = np.random.default_rng(seed)
    truth = replace(random_errors(rng), misalignment=np.zeros(3), gyro_matrix=np.eye(3))
    motion = turned_by_hand(rng, random_poses(rng, 80), 0.0, 1.5, 2.0)
    drift = random_walk(rng, len(motion.t_s), drifting * WALK[:6])
    log = recorded(rng, motion, truth, drift=drift)
    result = calibrate_dynamic(log, log.gyro, log.accel, GRAVITY)
    corrections = np.concatenate(
        [
            truth.accel_bias - truth.accel_scale * drift[-1, :3],
            truth.gyro_bias - truth.gyro_scale * drift[-1, 3:],
            truth.accel_scale - 1.0,
            truth.gyro_scale - 1.0,
        ]
    )
    return result.final - corrections, result.sd[-1]


@pytest.mark.slow
def test_dynamic_recovers_turn_on_biases() -> None:
    error = np.array([_dynamic(seed, drifting=False)[0] for seed in range(SEEDS)])
    gyro = np.degrees(error[:, 3:6])
    assert np.abs(error[:, :3]).max() < 0.02
    assert np.sqrt(np.mean(gyro**2)) < 0.0025
    assert np.quantile(np.abs(gyro), 0.99) < 0.005


@pytest.mark.slow
def test_dynamic_sigmas_are_those_of_the_errors() -> None:
    found = [_dynamic(seed, drifting=True) for seed in range(SEEDS)]
    error, sd = (np.array(part) for part in zip(*found, strict=True))
    ratio = np.sqrt(np.mean((error / sd) ** 2, axis=0))
    # fifty draws tell a ratio to 10 %
    assert np.all(ratio > 0.7), ratio
    assert np.all(ratio < 1.25), ratio
    assert 0.85 < np.sqrt(np.mean(ratio**2)) < 1.1
    assert 0.90 <= np.mean(np.abs(error) < 1.96 * sd) <= 0.98
