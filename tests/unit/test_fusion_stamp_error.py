"""An unsure delay shows in the sd of what is told by its stamp."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from automap.frames import matrix_to_quat, rpy_to_matrix
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.layout import N_NAV
from automap.fusion.model import build_state_model
from automap.fusion.options import DEFAULT_EFFECTS, FusionOptions
from automap.fusion.result import Prior
from automap.fusion.stamp_error import (
    covariance_at_stamps,
    mounting_rows,
    rates_of_change,
    reported_rows,
)
from tests.slow_cases import others_slow
from tests.unit.fusion_drive import CLOCK, Sensor, errors, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive

TURN = 0.3
ALONG = 1.5


def test_rates_of_change_of_a_bend_taken_at_rising_speed() -> None:
    t = np.arange(0.0, 4.0, 0.01)
    yaw = TURN * t
    speed = 5.0 + ALONG * t
    states = np.zeros((len(t), 10))
    states[:, 3:5] = speed[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw)])
    zero = np.zeros_like(yaw)
    states[:, 6:10] = matrix_to_quat(rpy_to_matrix(np.column_stack([zero, zero, yaw])))
    at = np.array([0.0, 1.0, 2.5, t[-1]])
    rates = rates_of_change(t, states, at)
    heading = np.column_stack([np.cos(TURN * at), np.sin(TURN * at)])
    across = np.column_stack([-heading[:, 1], heading[:, 0]])
    v = 5.0 + ALONG * at
    assert rates[:, :2] == pytest.approx(v[:, None] * heading, abs=0.1)
    assert rates[:, 3:5] == pytest.approx(ALONG * heading + (TURN * v)[:, None] * across, abs=0.1)
    assert rates[:, 6:] == pytest.approx(np.tile([0.0, 0.0, TURN], (4, 1)), abs=1e-3)


@pytest.mark.parametrize("turn", [(0.3, 0.0, 0.0), (0.0, -0.4, 0.0), (0.2, -0.3, 0.5)])
def test_a_turn_about_any_axis_is_told_in_the_navigation_frame(turn: tuple[float, ...]) -> None:
    """Of a body that lies anyhow, also where the sign of its quaternion changes on the way."""
    t = np.arange(0.0, 4.0, 0.01)
    begin = Rotation.from_euler("ZYX", [2.0, 0.7, -1.1])
    states = np.zeros((len(t), 10))
    states[:, 6:10] = [
        (Rotation.from_rotvec(np.array(turn) * at) * begin).as_quat()[[3, 0, 1, 2]] for at in t
    ]
    states[200:, 6:10] *= -1.0
    rates = rates_of_change(t, states, np.array([0.5, 1.995, 3.5]))
    assert rates[:, 6:] == pytest.approx(np.tile(turn, (3, 1)), abs=2e-3)
    assert np.array_equal(rates[:, :6], np.zeros((3, 6)))


@pytest.mark.parametrize("more", [(), ("imu_clock_skew",)])
def test_the_covariance_is_that_of_state_plus_rate_times_delay(more: tuple[str, ...]) -> None:
    model = build_state_model(FusionOptions(effects=(*DEFAULT_EFFECTS, *more)))
    rows = reported_rows(model)
    m = model.rows("imu_mounting").start
    assert rows[:N_NAV].tolist() == list(range(N_NAV))
    assert rows[mounting_rows(model)].tolist() == [m, m + 1, m + 2]
    assert model.rows("imu_time_offset").start in rows
    skew = model.rows("imu_clock_skew")
    assert (skew.start in rows and skew.stop > skew.start) == bool(more)
    rng = np.random.default_rng(1)
    r, node_t = len(rows), np.array([3.0, 70.0])
    root = rng.standard_normal((2, r, r))
    cov = root @ np.swapaxes(root, 1, 2)
    change = rng.standard_normal((2, N_NAV))
    out = covariance_at_stamps(model, cov, node_t, change)
    for k in range(2):
        h = np.eye(N_NAV + 3, r)
        h[:N_NAV, N_NAV + 3] = change[k]
        if more:
            h[:N_NAV, N_NAV + 4] = change[k] * node_t[k]
        assert out[k] == pytest.approx(h @ cov[k] @ h.T, rel=1e-9)


def test_a_known_delay_adds_nothing() -> None:
    effects = tuple(e for e in DEFAULT_EFFECTS if e != "imu_time_offset")
    model = build_state_model(FusionOptions(effects=effects))
    cov = np.tile(np.eye(len(reported_rows(model))), (3, 1, 1))
    out = covariance_at_stamps(model, cov, np.arange(3.0), np.ones((3, N_NAV)))
    assert np.array_equal(out, cov)


def test_an_unknown_age_of_the_fixes_is_of_velocity_and_attitude() -> None:
    model = build_state_model(FusionOptions(effects=("accel_bias",)))
    change = np.arange(9.0) * np.ones((3, 1))
    out = covariance_at_stamps(model, np.zeros((3, N_NAV, N_NAV)), np.arange(3.0), change, 0.1)
    assert np.diagonal(out, axis1=1, axis2=2)[0] == pytest.approx(
        [0.0, 0.0, 0.0, *(0.01 * np.arange(3.0, 9.0) ** 2)]
    )


@pytest.mark.slow
@pytest.mark.parametrize("delay_sd", others_slow([0.02, 0.1]))
def test_old_fixes_are_not_the_delay_of_the_imu(delay_sd: float) -> None:
    """Where the stamps are known the age of the fixes is estimated, else it is in the sigmas."""
    motion = city_drive(300.0, 7, slip=True)
    result = fuse_imu_gnss(
        record(motion, Sensor(), 8),
        receive(motion, Receiver(latency=0.1, lasting=0.1), 9),
        CLOCK,
        FusionOptions(),
        Prior(0.0, delay_sd),
        lever_arm=np.zeros(3),
    )
    path = result.trajectory
    error = errors(path, motion)
    moving = np.linalg.norm(path.vel_ned, axis=1) > 2.0
    ratio = np.sqrt(np.mean((error[moving, 3:5] / path.sd_vel_ned[moving, :2]) ** 2, axis=0))
    yaw = np.sqrt(np.mean((error[moving, 8] / path.sd_rpy[moving, 2]) ** 2))
    assert (ratio < 1.6).all()
    assert yaw < 1.6
    known = delay_sd < 0.05
    assert ("gnss_latency_s" in result.parameters.names) is known
    assert abs(result.delay.mean) < 0.03 if known else abs(result.delay.mean) > 0.05
