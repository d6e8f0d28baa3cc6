"""Noise levels by likelihood on a short drive; the long one is among the slow tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.adapt import FINE, adapt_noise
from automap.fusion.layout import CH_NHC, HAS_POS_H, HAS_POS_V, HAS_VEL_H, HAS_VEL_V, NHC
from automap.fusion.levels import LEVELS
from automap.fusion.measurements import Nodes, Shift
from automap.fusion.model import FusionOptions, build_state_model
from automap.fusion.problem import Problem, Start, make_problem
from tests.unit.fusion_drive import BASE_NS, GPS0, Receiver, Sensor, city_drive, receive, record
from tests.unit.fusion_problem import make_nodes, true_start

OFF = 3.0
OPTIONS = FusionOptions(effects=("accel_bias", "gyro_bias", "gnss_correlated_noise"))
VELOCITY_SD, WHITE = 0.05, 0.2
MEASURED = HAS_POS_H | HAS_POS_V | HAS_VEL_H | HAS_VEL_V


@pytest.fixture(scope="module")
def drive() -> tuple[Problem, Nodes, Start]:
    """Two minutes whose gyro and velocities are three times as noisy as the model says."""
    motion = city_drive(120.0, 5)
    sensor = Sensor(gyro_noise=OFF * OPTIONS.gyro_noise, accel_noise=OPTIONS.accel_noise)
    imu = record(motion, replace(sensor, vibration=0.0, gyro_walk=0.0, accel_walk=0.0), 6)
    white = (WHITE, WHITE, WHITE)
    fixes = receive(motion, Receiver(velocity=OFF * VELOCITY_SD, white=white), 7)
    inside = (fixes.gps_s >= GPS0) & (fixes.gps_s - GPS0 < 119.0)
    values = np.column_stack([fixes.lat_rad, fixes.lon_rad, fixes.height_m, fixes.vel_ned])[inside]
    t = fixes.gps_s[inside] - GPS0
    nodes = make_nodes(
        t, np.full(len(t), MEASURED | NHC), np.column_stack([values, np.zeros(len(t))])
    )
    nodes.var[:, :3] = WHITE**2
    nodes.var[:, 3:6] = VELOCITY_SD**2
    nodes.wander_sd[:] = (1.0, 1.0, 1.8)
    assert imu.t_ns[0] == BASE_NS
    problem = make_problem(imu, build_state_model(OPTIONS), OPTIONS)
    return problem, nodes, true_start(motion)


def _found(drive: tuple[Problem, Nodes, Start], nodes: Nodes) -> dict[str, float]:
    search = replace(FINE, levels=("gyro", "position_h", "velocity_h", "velocity_v"))
    problem, _, start = drive
    return adapt_noise(problem, nodes, start, Shift(), dict.fromkeys(LEVELS, 1.0), search)


def test_levels_that_are_off_are_found_and_others_left(
    drive: tuple[Problem, Nodes, Start],
) -> None:
    found = _found(drive, drive[1])
    for level in ("gyro", "velocity_h", "velocity_v"):
        assert OFF / 1.5 < found[level] < OFF * 1.5, level
    assert found["position_h"] == pytest.approx(1.0, rel=0.45)
    assert found["wander"] == 1.0


def test_how_loose_the_vehicle_rules_are_has_no_say(drive: tuple[Problem, Nodes, Start]) -> None:
    loose = replace(drive[1], var=drive[1].var.copy())
    loose.var[:, CH_NHC : CH_NHC + 2] = 100.0
    assert _found(drive, loose) == _found(drive, drive[1])
