"""The paper's figure 2 in numbers: resting sequences with and without dynamic calibration."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from calibration_scene import random_errors, random_poses, recorded, turned_by_hand
from test_calibration_command import write_csv

from automap.calibration.rest_attitude import largest_turn, roll_pitch_since_start
from automap.calibration.rest_sequences import log_sequences, simulated_sequences
from automap.errors import InputError
from automap.frames import rpy_to_matrix
from automap.records import RawImu
from pipeline.cli import root


@pytest.fixture(scope="module")
def drifting() -> RawImu:
    """Four rests of 8 s whose gyro bias moves by 0.1 deg/s from each to the next."""
    rng = np.random.default_rng(4)
    motion = turned_by_hand(rng, random_poses(rng, 4), 8.0, 2.0, 8.0)
    drift = np.zeros((len(motion.t_s), 6))
    drift[:, 3] = np.radians(0.1) * np.floor(motion.t_s / 10.0)
    return recorded(rng, motion, random_errors(rng, 0.0), drift=drift)


def test_simulated_turn_ons_run_away_and_stay_put() -> None:
    sequences = simulated_sequences(range(4))
    without = np.degrees([s.drift_without for s in sequences])
    assert np.all(without > 1.0)
    assert np.ptp(without) > 2.0
    assert max(np.degrees(s.drift_with) for s in sequences) < 0.4


def test_the_bias_of_one_rest_is_applied_to_the_others(drifting: RawImu) -> None:
    sequences, source_s = log_sequences(drifting, 14.0)
    assert source_s == pytest.approx(14.0, abs=1.0)
    assert [round(s.start_s / 10.0) for s in sequences] == [0, 2, 3]
    drift = np.degrees([s.drift_without for s in sequences])
    # the second face turns the sensor about x: its bias shows as roll in every pose but one
    assert drift[0] == pytest.approx(0.1 * sequences[0].seconds, abs=0.15)
    assert drift[2] > drift[1] - 0.1
    assert all(np.degrees(s.drift_with) < 0.2 for s in sequences)


def test_what_cannot_be_is_said(drifting: RawImu) -> None:
    with pytest.raises(InputError, match="in counts"):
        log_sequences(replace(drifting, gyro_scale=None))
    rows = slice(0, 900)
    short = replace(
        drifting, t_ns=drifting.t_ns[rows], gyro=drifting.gyro[rows], accel=drifting.accel[rows]
    )
    with pytest.raises(InputError, match="1 rest of 5 s"):
        log_sequences(short)


def test_roll_and_pitch_mean_the_same_in_every_attitude() -> None:
    turn = np.radians([[0.0, 0.0], [0.0, 2.0], [1.0, 0.0]])
    for tilt in ([0.0, 0.0, 0.0], [0.0, 89.9, 0.0], [180.0, 10.0, 30.0]):
        C = rpy_to_matrix(np.radians(tilt))
        # gravity's direction after small turns of the start as level
        level = np.array([rpy_to_matrix([r, p, 0.0]).T @ [0.0, 0.0, 1.0] for r, p in turn])
        found = roll_pitch_since_start(level @ C)
        np.testing.assert_allclose(np.hypot(*found.T), np.abs(turn).sum(axis=1), atol=1e-5)
        assert largest_turn(level @ C) == pytest.approx(np.radians(2.0))


@pytest.mark.slow
def test_the_experiment_writes_plot_and_figures(drifting: RawImu, tmp_path: Path) -> None:
    path = write_csv(tmp_path / "desk.csv", drifting)
    words = ["experiment", "rest", str(path), "-o", str(tmp_path), "--bias-at", "14"]
    assert root.run_command(words) == 0
    figures = json.loads((tmp_path / "rest.json").read_text())
    assert len(figures["simulated"]["with_deg"]) == 10
    assert len(figures["log"]["with_deg"]) == 3
    assert (tmp_path / "rest.png").read_bytes().startswith(b"\x89PNG")
