"""What nodes observe: every analytic row against the numeric derivative of its residual, and
residuals of true states against geometry computed elsewhere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pymap3d
import pytest

from automap.fusion import kernels
from automap.fusion.kernels.observations import (
    constraint_block,
    position_block,
    standstill_rate_rows,
    velocity_block,
    zero_velocity_rows,
)
from automap.fusion.kernels.readings import correct, correction_of
from automap.fusion.layout import (
    DELAY,
    LATENCY,
    LEVER,
    MOUNT,
    N_NAV,
    SIDESLIP,
    SKEW,
    VEHICLE_PITCH,
    VEL_LAG,
    VEL_LATENCY,
    WANDER,
    WHEEL,
)
from automap.fusion.mechanisation import N_EARTH, earth_terms, quat_to_dcm
from automap.fusion.model import StateModel, build_state_model
from automap.fusion.options import FusionOptions
from tests.unit.fusion_drive import Receiver, make_motion, receive
from tests.unit.fusion_problem import nominal_of

EFFECTS = (
    "accel_bias",
    "gyro_bias",
    "gyro_scale",
    "gyro_misalignment",
    "gyro_g_sensitivity",
    "gnss_lever_arm",
    "imu_time_offset",
    "gnss_velocity_latency",
    "gnss_correlated_noise",
    "imu_mounting",
    "nhc_lever_arm",
    "gnss_latency",
    "gnss_velocity_lag",
    "imu_clock_skew",
    "gnss_datum_shift",
    "vehicle_sideslip",
    "vehicle_pitch",
)
SHIFTS = (DELAY, VEL_LATENCY, LATENCY, VEL_LAG, SKEW, SIDESLIP, VEHICLE_PITCH)
T = 12.0
RATE = np.array([0.05, -0.03, 0.4])
ACC = np.array([0.7, -1.9, 0.3])
WANDER_SD = np.array([1.5, 1.2, 2.5])

Block = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]


@pytest.fixture(scope="module")
def model() -> StateModel:
    return build_state_model(FusionOptions(effects=EFFECTS))


@pytest.fixture(scope="module")
def state() -> np.ndarray:
    motion = make_motion([(0.0, 12.0)], [(0.0, 5.0, 90.0)], 5.0)
    return nominal_of(motion.at(np.array([2.0])))[0]


def _params(model: StateModel) -> np.ndarray:
    params = 0.3 * model.prior_sd * np.random.default_rng(3).standard_normal(len(model.prior_sd))
    # the blocks are exact where the delays have settled
    for block in SHIFTS:
        params[model.offsets[block] - N_NAV] = 0.0
    return params


def _evaluate(
    block: Block, rows: int, state: np.ndarray, params: np.ndarray, n: int
) -> tuple[np.ndarray, np.ndarray]:
    h, z, c = np.full((3, n), np.nan), np.full(3, np.nan), np.zeros((3, 3))
    quat_to_dcm(state[6:10], c)
    block(h, z, state[0:3].copy(), state[3:6].copy(), c, params)
    return h[:rows], z[:rows]


def _assert_rows(
    block: Block, rows: int, state: np.ndarray, model: StateModel, skip: tuple[str, ...] = ()
) -> np.ndarray:
    params = _params(model)
    h, _ = _evaluate(block, rows, state, params, model.size)
    assert np.isfinite(h).all()
    step = np.concatenate([[1e-2] * 3, [1e-4] * 3, [1e-5] * 3, 1e-4 * model.prior_sd])
    for j in range(model.size):
        if j >= N_NAV and model.names[j - N_NAV].startswith(skip or ("none",)):
            continue
        ends = []
        for sign in (1.0, -1.0):
            moved, moved_params = state[None].copy(), params[None].copy()
            delta = np.zeros((1, model.size))
            delta[0, j] = sign * step[j]
            kernels.apply_correction(moved, moved_params, delta)
            ends.append(_evaluate(block, rows, moved[0], moved_params[0], model.size)[1])
        numeric = -(ends[0] - ends[1]) / (2.0 * step[j])
        name = j if j < N_NAV else model.names[j - N_NAV]
        assert h[:, j] == pytest.approx(numeric, rel=1e-4, abs=2e-4), name
    return h


def test_position_rows(model: StateModel, state: np.ndarray) -> None:
    fix = state[:3] + np.array([2e-7, -3e-7, 1.0])

    def block(h, z, pos, vel, c, xi):  # type: ignore[no-untyped-def]
        position_block(h, z, fix, pos, vel, c, xi, model.offsets, WANDER_SD, T)

    h = _assert_rows(block, 3, state, model)
    assert h[:, model.offsets[DELAY]] == pytest.approx(state[3:6])
    wander = slice(model.offsets[WANDER], model.offsets[WANDER] + 3)
    assert h[:, wander] == pytest.approx(np.diag(WANDER_SD))


def test_velocity_rows(model: StateModel, state: np.ndarray) -> None:
    def block(h, z, pos, vel, c, xi):  # type: ignore[no-untyped-def]
        velocity_block(h, z, state[3:6] + 0.3, vel, c, RATE, ACC, xi, model.offsets, T)

    h = _assert_rows(block, 3, state, model)
    assert h[:, model.offsets[DELAY]] == pytest.approx(ACC)
    assert h[:, model.offsets[VEL_LATENCY]] == pytest.approx(-ACC)
    assert h[:, model.offsets[SKEW]] == pytest.approx(ACC * T)


def test_a_car_that_drifts_outwards(model: StateModel) -> None:
    """In a right-hand bend the velocity points to the left of the nose."""
    params = np.zeros(len(model.names))
    params[model.offsets[SIDESLIP] - N_NAV] = 0.003
    vel, acc = np.array([12.0, -0.003 * 4.0 * 12.0, 0.0]), np.array([0.0, 4.0, 0.0])
    h, z = np.empty((3, model.size)), np.empty(3)
    constraint_block(h, z, vel, np.eye(3), np.zeros(3), acc, params, model.offsets)
    assert z[0] == pytest.approx(0.0, abs=1e-12)


def test_constraint_rows(model: StateModel, state: np.ndarray) -> None:
    def block(h, z, pos, vel, c, xi):  # type: ignore[no-untyped-def]
        constraint_block(h, z, vel, c, RATE, ACC, xi, model.offsets)

    h = _assert_rows(block, 2, state, model)
    assert np.abs(h[:, model.offsets[MOUNT]]).max() < 2.0
    assert np.abs(h[:, model.offsets[WHEEL]]).max() > 0.1


def test_zero_velocity_rows(model: StateModel, state: np.ndarray) -> None:
    def block(h, z, pos, vel, c, xi):  # type: ignore[no-untyped-def]
        zero_velocity_rows(h, z, vel)

    _assert_rows(block, 3, state, model)


def test_zero_rate_rows(model: StateModel, state: np.ndarray) -> None:
    """The rate that the residual compares is the corrected reading."""
    raw = np.concatenate([RATE, [0.4, -0.2, -9.7]])
    place = np.empty(N_EARTH)
    matrix, shift, reading = np.empty((6, 6)), np.empty(6), np.empty(6)

    def block(h, z, pos, vel, c, xi):  # type: ignore[no-untyped-def]
        earth_terms(pos, True, place)
        correction_of(model.term_table, xi, np.zeros(0), matrix, shift)
        correct(raw, matrix, shift, reading)
        standstill_rate_rows(h, z, reading[:3].copy(), place, c, reading, model.term_table)

    # a turn of the attitude moves the Earth's rate by less than the rows are good for; products
    # of two small parameters are second order
    params = _params(model) * 0.02
    h, z = _evaluate(block, 3, state, params, model.size)
    for m, term in enumerate(model.terms):
        moved = params.copy()
        moved[m] += 1e-4 * model.prior_sd[m]
        change = -(_evaluate(block, 3, state, moved, model.size)[1] - z)
        numeric = change / (1e-4 * model.prior_sd[m])
        assert h[:, N_NAV + m] == pytest.approx(numeric, rel=2e-3, abs=2e-3), term.name
    assert z == pytest.approx(-reading[:3], abs=1e-4)


def test_earth_rate_is_all_that_a_gyro_at_rest_reads(model: StateModel) -> None:
    motion = make_motion([(0.0, 0.0)], [], 5.0)
    true = motion.at(np.array([1.0]))
    place, h, z = np.empty(N_EARTH), np.empty((3, model.size)), np.empty(3)
    earth_terms(np.array([true.lat[0], true.lon[0], true.height[0]]), True, place)
    mid = np.concatenate([true.gyro[0], true.accel[0]])
    standstill_rate_rows(h, z, true.gyro[0], place, true.c_n_b[0], mid, model.term_table)
    assert np.abs(z).max() < 1e-12


@pytest.mark.parametrize("lon", [149.13, 179.9999, -179.9999])
def test_residuals_of_the_truth_are_the_injected_errors(lon: float) -> None:
    """Fixes with lever arm, delays and no noise, computed on the tangent plane and by pymap3d."""
    effects = EFFECTS[5:9]
    model = build_state_model(FusionOptions(effects=effects))
    motion = make_motion(
        [(0.0, 9.0), (4.0, 15.0)], [(0.0, 4.0, 70.0)], 5.0, origin_deg=(-35.0, lon, 100.0)
    )
    lever = (0.4, -0.3, -1.2)
    receiver = Receiver(
        wander=(0.0, 0.0, 0.0),
        white=(0.0, 0.0, 0.0),
        velocity=0.0,
        lever=lever,
        latency=0.004,
        vel_latency=0.006,
    )
    fixes = receive(motion, receiver, 0)
    true = motion.at(fixes.gps_s - fixes.gps_s[0])
    nominal = nominal_of(true)
    params = np.zeros(model.size - N_NAV)
    params[model.offsets[LEVER] - N_NAV :][:3] = lever
    # data are older than their tag: the position at the tag plus v times minus the latency
    params[model.offsets[DELAY] - N_NAV] = -0.004
    params[model.offsets[VEL_LATENCY] - N_NAV] = 0.006
    step = 1e-3
    acc = (motion.at(true.t + step).vel - motion.at(true.t - step).vel) / (2 * step)
    h, z, c = np.empty((3, model.size)), np.empty(3), np.zeros((3, 3))
    for k in range(2, len(fixes)):
        quat_to_dcm(nominal[k, 6:10], c)
        fix = np.array([fixes.lat_rad[k], fixes.lon_rad[k], fixes.height_m[k]])
        args = (nominal[k, 0:3], nominal[k, 3:6], c)
        position_block(h, z, fix, *args, params, model.offsets, WANDER_SD, T)
        assert np.abs(z).max() < 3e-3
        fix_vel = fixes.vel_ned[k]
        velocity_block(
            h, z, fix_vel, nominal[k, 3:6], c, true.turn[k], acc[k], params, model.offsets, T
        )
        assert np.abs(z).max() < 6e-3
        offset = pymap3d.geodetic2ned(*fix, true.lat[k], true.lon[k], true.height[k], deg=False)
        assert np.hypot(*offset[:2]) < 1.0


def test_a_car_that_does_not_slide_meets_the_constraint(model: StateModel) -> None:
    """Also where the sensor is turned in the vehicle and away from the rear axle."""
    motion = make_motion([(0.0, 12.0)], [(0.0, 5.0, 90.0)], 5.0)
    true = motion.at(np.array([2.5]))
    mount = np.array([0.004, -0.006, 0.008])
    wheel = np.array([-1.4, 0.2, 0.9])
    turn = np.array([[1, -mount[2], mount[1]], [mount[2], 1, -mount[0]], [-mount[1], mount[0], 1]])
    # the motion's velocity is that of the axle; the sensor stands before it
    c_n_s = true.c_n_b[0] @ turn
    rate = turn.T @ true.turn[0]
    vel = true.vel[0] - c_n_s @ np.cross(rate, wheel)
    params = np.zeros(len(model.names))
    params[model.offsets[MOUNT] - N_NAV :][:3] = mount
    params[model.offsets[WHEEL] - N_NAV :][:3] = wheel
    h, z = np.empty((3, model.size)), np.empty(3)
    constraint_block(h, z, vel, c_n_s, rate, np.zeros(3), params, model.offsets)
    assert np.abs(z[:2]).max() < 2e-3
    zero = np.zeros(len(model.names))
    constraint_block(h, z, vel, c_n_s, rate, np.zeros(3), zero, model.offsets)
    assert np.abs(z[:2]).max() > 0.05
