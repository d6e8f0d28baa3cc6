"""What nodes observe: every analytic row against the numeric derivative of its residual, and
residuals of true states against geometry computed elsewhere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pymap3d
import pytest

from automap.frames import rpy_to_matrix
from automap.fusion import kernels
from automap.fusion.kernel_runs import run_forward
from automap.fusion.kernels.readings import correct, correction_of
from automap.fusion.layout import HAS_POS_H, HAS_POS_V, HAS_VEL_H, HAS_VEL_V, N_NAV
from automap.fusion.mechanisation import quat_to_dcm
from automap.fusion.model import StateModel, build_state_model
from automap.fusion.nodes import Shift
from automap.fusion.options import FusionOptions
from automap.fusion.problem import make_problem
from tests.unit.fusion_drive import PERFECT, record
from tests.unit.fusion_motion import make_motion
from tests.unit.fusion_problem import make_nodes, nominal_of, true_start
from tests.unit.fusion_receiver import Receiver, receive
from tests.unit.measured_node import (
    CONSTRAINT,
    POSITION,
    VELOCITY,
    ZERO_RATE,
    ZERO_VELOCITY,
    measured,
)

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
SECOND_ORDER = (
    "imu_time_offset",
    "gnss_velocity_latency",
    "gnss_latency",
    "gnss_velocity_lag",
    "imu_clock_skew",
    "vehicle_sideslip",
    "vehicle_pitch",
)
T = 12.0
RATE = np.array([0.05, -0.03, 0.4])
ACC = np.array([0.7, -1.9, 0.3])
WANDER_SD = np.array([1.5, 1.2, 2.5])
PLACE = np.array([-0.6, 2.6, 500.0])

Block = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


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
    for effect in SECOND_ORDER:
        params[model.rows(effect).start - N_NAV] = 0.0
    return params


def _evaluate(block: Block, state: np.ndarray, params: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    c = np.zeros((3, 3))
    quat_to_dcm(state[6:10], c)
    return block(state[0:3].copy(), state[3:6].copy(), c, params)


def _assert_rows(block: Block, rows: int, state: np.ndarray, model: StateModel) -> np.ndarray:
    params = _params(model)
    h, _ = _evaluate(block, state, params)
    assert h.shape == (rows, model.size)
    assert np.isfinite(h).all()
    step = np.concatenate([[1e-2] * 3, [1e-4] * 3, [1e-5] * 3, 1e-4 * model.prior_sd])
    for j in range(model.size):
        ends = []
        for sign in (1.0, -1.0):
            moved, moved_params = state[None].copy(), params[None].copy()
            delta = np.zeros((1, model.size))
            delta[0, j] = sign * step[j]
            kernels.apply_correction(moved, moved_params, delta)
            ends.append(_evaluate(block, moved[0], moved_params[0])[1])
        numeric = -(ends[0] - ends[1]) / (2.0 * step[j])
        name = j if j < N_NAV else model.names[j - N_NAV]
        assert h[:, j] == pytest.approx(numeric, rel=1e-4, abs=2e-4), name
    return h


def test_position_rows(model: StateModel, state: np.ndarray) -> None:
    fix = np.concatenate([state[:3] + np.array([2e-7, -3e-7, 1.0]), state[3:6]])

    def block(pos, vel, c, xi):  # type: ignore[no-untyped-def]
        return measured(POSITION, model, pos, vel, c, xi, fix, t=T, signals=WANDER_SD)

    h = _assert_rows(block, 3, state, model)
    assert h[:, model.rows("imu_time_offset")][:, 0] == pytest.approx(state[3:6])
    assert h[:, model.rows("gnss_correlated_noise")] == pytest.approx(np.diag(WANDER_SD))


@pytest.mark.parametrize(
    ("number", "level", "height"),
    [(POSITION, HAS_POS_H, HAS_POS_V), (VELOCITY, HAS_VEL_H, HAS_VEL_V)],
)
def test_what_a_fix_lacks_has_no_row(
    number: int, level: int, height: int, model: StateModel, state: np.ndarray
) -> None:
    fix = np.concatenate([state[:3] + np.array([2e-7, -3e-7, 1.0]), state[3:6] + ACC])

    def rows(lacking: int) -> tuple[np.ndarray, np.ndarray]:
        def block(pos, vel, c, xi):  # type: ignore[no-untyped-def]
            return measured(
                number, model, pos, vel, c, xi, fix, t=T, signals=WANDER_SD, lacking=lacking
            )

        return _evaluate(block, state, _params(model))

    h, z = rows(0)
    for lacking, left in ((height, [0, 1]), (level, [2]), (level | height, [])):
        for found, whole in zip(rows(lacking), (h, z), strict=True):
            np.testing.assert_array_equal(found, whole[left])


def test_velocity_rows(model: StateModel, state: np.ndarray) -> None:
    fix = np.concatenate([state[:3], state[3:6] + 0.3])

    def block(pos, vel, c, xi):  # type: ignore[no-untyped-def]
        return measured(VELOCITY, model, pos, vel, c, xi, fix, rate=RATE, acc=ACC, t=T)

    h = _assert_rows(block, 3, state, model)
    c = np.zeros((3, 3))
    quat_to_dcm(state[6:10], c)
    first = model.rows("gnss_lever_arm").start - N_NAV
    mount = model.rows("imu_mounting").start - N_NAV
    arm, angles = _params(model)[first : first + 3], _params(model)[mount : mount + 3]
    # in a bend the antenna is drawn inwards
    late = ACC + c @ np.cross(RATE, np.cross(RATE, rpy_to_matrix(angles).T @ arm))
    assert h[:, model.rows("imu_time_offset")][:, 0] == pytest.approx(late)
    assert h[:, model.rows("gnss_velocity_latency")][:, 0] == pytest.approx(-late)
    assert h[:, model.rows("imu_clock_skew")][:, 0] == pytest.approx(late * T)


def test_a_car_that_drifts_outwards(model: StateModel) -> None:
    """In a right-hand bend the velocity points to the left of the nose."""
    params = np.zeros(len(model.names))
    params[model.rows("vehicle_sideslip").start - N_NAV] = 0.003
    vel, acc = np.array([12.0, -0.003 * 4.0 * 12.0, 0.0]), np.array([0.0, 4.0, 0.0])
    _, z = measured(CONSTRAINT, model, PLACE, vel, np.eye(3), params, acc=acc)
    assert z[0] == pytest.approx(0.0, abs=1e-12)


def test_constraint_rows(model: StateModel, state: np.ndarray) -> None:
    def block(pos, vel, c, xi):  # type: ignore[no-untyped-def]
        return measured(CONSTRAINT, model, pos, vel, c, xi, rate=RATE, acc=ACC)

    h = _assert_rows(block, 2, state, model)
    assert np.abs(h[:, model.rows("imu_mounting").start]).max() < 2.0
    assert np.abs(h[:, model.rows("nhc_lever_arm").start]).max() > 0.1


@pytest.mark.parametrize("effect", ["vehicle_sideslip", "vehicle_pitch"])
def test_an_effect_of_accelerations_acts_alone_as_beside_others(
    effect: str, model: StateModel, state: np.ndarray
) -> None:
    """The only term of a model, or one of many of which the others are nothing."""
    told = []
    for one in (build_state_model(FusionOptions(effects=(effect,))), model):
        params = np.zeros(len(one.prior_sd))
        params[one.rows(effect).start - N_NAV] = 0.01

        def block(pos, vel, c, xi, one=one):  # type: ignore[no-untyped-def]
            columns = np.ones(len(one.signals))
            return measured(CONSTRAINT, one, pos, vel, c, xi, rate=RATE, acc=ACC, signals=columns)

        told.append(_evaluate(block, state, params)[1])
        plain = _evaluate(block, state, 0.0 * params)[1]
        assert np.abs(told[-1] - plain).max() > 1e-3
    assert told[0] == pytest.approx(told[1])


def test_zero_velocity_rows(model: StateModel, state: np.ndarray) -> None:
    def block(pos, vel, c, xi):  # type: ignore[no-untyped-def]
        return measured(ZERO_VELOCITY, model, pos, vel, c, xi)

    _assert_rows(block, 3, state, model)


def test_zero_rate_rows(model: StateModel, state: np.ndarray) -> None:
    """The rate that the residual compares is the corrected reading."""
    raw = np.concatenate([RATE, [0.4, -0.2, -9.7]])
    matrix, shift, reading = np.empty((6, 6)), np.empty(6), np.empty(6)

    def block(pos, vel, c, xi):  # type: ignore[no-untyped-def]
        correction_of(model.term_table, xi, np.zeros(0), matrix, shift)
        correct(raw, matrix, shift, reading)
        rate = reading[:3].copy()
        return measured(ZERO_RATE, model, pos, vel, c, xi, rate=rate, reading=reading)

    # a turn of the attitude moves the Earth's rate by less than the rows are good for; products
    # of two small parameters are second order
    params = _params(model) * 0.02
    h, z = _evaluate(block, state, params)
    expected = -reading[:3]
    assert z == pytest.approx(expected, abs=1e-4)
    for m, term in enumerate(model.terms):
        moved = params.copy()
        moved[m] += 1e-4 * model.prior_sd[m]
        change = -(_evaluate(block, state, moved)[1] - z)
        numeric = change / (1e-4 * model.prior_sd[m])
        assert h[:, N_NAV + m] == pytest.approx(numeric, rel=2e-3, abs=2e-3), term.name


def test_earth_rate_is_all_that_a_gyro_at_rest_reads(model: StateModel) -> None:
    motion = make_motion([(0.0, 0.0)], [], 5.0)
    true = motion.at(np.array([1.0]))
    reading = np.concatenate([true.gyro[0], true.accel[0]])
    place = np.array([true.lat[0], true.lon[0], true.height[0]])
    params = np.zeros(len(model.names))
    _, z = measured(
        ZERO_RATE,
        model,
        place,
        np.zeros(3),
        true.c_n_b[0],
        params,
        rate=true.gyro[0],
        reading=reading,
    )
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
    params[model.rows("gnss_lever_arm").start - N_NAV :][:3] = lever
    # data are older than their tag: the position at the tag plus v times minus the latency
    params[model.rows("imu_time_offset").start - N_NAV] = -0.004
    params[model.rows("gnss_velocity_latency").start - N_NAV] = 0.006
    step = 1e-3
    acc = (motion.at(true.t + step).vel - motion.at(true.t - step).vel) / (2 * step)
    c = np.zeros((3, 3))
    for k in range(2, len(fixes)):
        quat_to_dcm(nominal[k, 6:10], c)
        fix = np.array([fixes.lat_rad[k], fixes.lon_rad[k], fixes.height_m[k]])
        both = np.concatenate([fix, fixes.vel_ned[k]])
        args = (model, nominal[k, 0:3], nominal[k, 3:6], c, params, both)
        _, z = measured(POSITION, *args, t=T, signals=WANDER_SD)
        assert np.abs(z).max() < 3e-3
        _, z = measured(VELOCITY, *args, rate=true.turn[k], acc=acc[k], t=T)
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
    vel = true.vel[0] - true.c_n_b[0] @ np.cross(true.turn[0], wheel)
    params = np.zeros(len(model.names))
    params[model.rows("imu_mounting").start - N_NAV :][:3] = mount
    params[model.rows("nhc_lever_arm").start - N_NAV :][:3] = wheel
    _, z = measured(CONSTRAINT, model, PLACE, vel, c_n_s, params, rate=rate)
    assert np.abs(z).max() < 2e-3
    zero = np.zeros(len(model.names))
    _, z = measured(CONSTRAINT, model, PLACE, vel, c_n_s, zero, rate=rate)
    assert np.abs(z).max() > 0.05


def test_the_arm_swings_at_the_first_node_too() -> None:
    """A drive that begins in a turn: the first velocity is the antenna's, exactly."""
    motion = make_motion([(0.0, 8.0)], [(0.0, 3.0, 60.0)], 4.0)
    arm = np.array([2.0, -1.0, -1.5])
    fixes = receive(motion, Receiver(2.0, (0.0,) * 3, white=(0.0,) * 3, velocity=0.0, lever=arm), 0)
    options = FusionOptions(effects=("gnss_lever_arm",))
    means = {f"gnss_lever_arm_{a}": v for a, v in zip("xyz", arm, strict=True)}
    problem = make_problem(record(motion, PERFECT, 0), build_state_model(options, means), options)
    values = np.zeros((2, 7))
    values[:, 3:6] = fixes.vel_ned[:2]
    nodes = make_nodes(np.array([0.0, 0.5]), np.full(2, HAS_VEL_H | HAS_VEL_V), values)
    store = run_forward(problem, nodes, true_start(motion), Shift()).store
    turned = np.abs(fixes.vel_ned[0] - motion.at(np.zeros(1)).vel[0]).max()
    assert turned > 0.3
    assert store.nu[:6] == pytest.approx(0.0, abs=2e-3)
