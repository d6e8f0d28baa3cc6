"""Strapdown integration, transition rows and process noise between nodes."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from automap.frames import matrix_to_rotation_vector, quat_to_matrix
from automap.fusion import kernels
from automap.fusion.filtered import full_covariance
from automap.fusion.kernel_runs import Start, run_dense, run_forward
from automap.fusion.kernels.transition import N_NOISE, add_noise, expand_noise
from automap.fusion.model import build_state_model
from automap.fusion.nodes import Shift
from automap.fusion.options import FusionOptions
from automap.fusion.problem import make_problem
from automap.records import FloatArray, ImuData
from tests.slow_cases import others_slow
from tests.unit.dense_filter import rates_of_motion
from tests.unit.fusion_drive import PERFECT, Sensor, record
from tests.unit.fusion_motion import city_drive, make_motion
from tests.unit.fusion_problem import make_nodes, nominal_of, true_start

PLACES = {
    "south": (-35.28, 149.13, 580.0),
    "north": (48.0, 11.0, 500.0),
    "equator": (0.0, 0.0, 0.0),
    "high latitude": (80.0, 20.0, 10.0),
    "date line": (-16.5, 179.98, 5.0),
}
TERMS = (
    "accel_bias",
    "gyro_bias",
    "accel_scale",
    "gyro_scale",
    "accel_misalignment",
    "gyro_misalignment",
    "gyro_g_sensitivity",
    "accel_quadratic",
    "gyro_scale_asymmetry",
)


@pytest.mark.parametrize("place", others_slow(PLACES, 2))
def test_perfect_readings_integrate_to_the_truth(place: str) -> None:
    """Ten minutes of perfect readings at 100 Hz stay within 10 cm."""
    motion = city_drive(600.0, seed=3, origin_deg=PLACES[place])
    options = FusionOptions(effects=())
    problem = make_problem(record(motion, PERFECT, 0), build_state_model(options), options)
    nodes = make_nodes(np.arange(1201) * 0.5)
    forward = run_forward(problem, nodes, true_start(motion), Shift())
    dense, rates = run_dense(
        problem, nodes, forward.store.nominal, forward.store.params, False, True
    )
    true = motion.at(problem.t)
    ned = pymap3d.geodetic2ned(*dense[:, :3].T, true.lat, true.lon, true.height, deg=False)
    assert np.abs(ned).max() < 0.03
    assert np.abs(dense[:, 3:6] - true.vel).max() < 5e-4
    turn = quat_to_matrix(dense[:, 6:10]) @ np.swapaxes(true.c_n_b, 1, 2)
    assert np.abs(matrix_to_rotation_vector(turn)).max() < 5e-6
    assert np.ptp(np.unwrap(dense[:, 1])) < 0.01
    assert np.abs(rates[:, :3] - true.gyro).max() < 2e-3


AXES = np.eye(3)
PAIRS = {"x": (AXES[1], AXES[2]), "y": (AXES[2], AXES[0]), "z": (AXES[0], AXES[1])}


@pytest.mark.parametrize("axis", PAIRS)
@pytest.mark.parametrize("swap", [False, True])
def test_coning_and_sculling_of_one_step_are_exact(axis: str, swap: bool) -> None:
    """A rate that swings from one axis to another over a step turns about the third as well, a
    force that swings against a rate leaves a velocity; Runge-Kutta in tiny steps is the truth."""
    a, b = PAIRS[axis][::-1] if swap else PAIRS[axis]
    gyro = np.stack([1.3 * a + 0.2 * b, 0.1 * a + 1.1 * b])
    force = np.stack([6.0 * b - 3.0 * a, 5.0 * a + 2.0 * b]) + np.array([0.4, -0.3, -9.0])
    start = nominal_of(make_motion([(0.0, 8.0)], [], 2.0).at(np.zeros(1)))
    velocity, turn = one_step(start, gyro, force, 0.005)
    # coning gives 3e-6 rad here, sculling 1e-5 m/s, what is left out of both is an order less
    assert np.abs(turn).max() < 3e-9
    assert np.abs(velocity).max() < 4e-7


@pytest.mark.parametrize("axis", range(3))
def test_a_force_is_turned_with_the_frame_by_half_a_step(axis: int) -> None:
    """The Earth turns by 4e-6 rad in 50 ms, which moves the velocity that a force of 50 m/s^2 gives
    by 4e-6 m/s; what a step leaves out of the Earth's turn is the same without the force."""
    start = nominal_of(make_motion([(0.0, 8.0)], [], 2.0).at(np.zeros(1)))
    start[:, 3:6] = 0.0
    none, force = np.zeros((2, 3)), np.tile(40.0 * np.eye(3)[axis] + 10.0, (2, 1))
    with_it, without = (one_step(start, none, push, 0.05)[0] for push in (force, none))
    assert np.abs(with_it - without).max() < 2e-7


def one_step(
    start: FloatArray, gyro: FloatArray, force: FloatArray, step: float
) -> tuple[FloatArray, FloatArray]:
    """By how much velocity [3] m/s and attitude [3] rad after one step of ``step`` s from a nominal
    state [1, 10], with readings [2, 3] at its ends, are off those of the motion's equations."""
    n = 200
    options = FusionOptions(effects=())
    imu = ImuData(np.array([0, round(step * 1e9)], np.int64), gyro, force, axes_known=True)
    problem = make_problem(imu, build_state_model(options), options)
    nodes = make_nodes(np.array([0.0, step]))
    end = run_forward(problem, nodes, Start(start[0], np.ones(9)), Shift()).store.nominal[-1]

    place, vel, c = start[:, :3], start[:, 3:6], quat_to_matrix(start[:, 6:10])
    for k in range(n):
        middle = (k + 0.5) / n
        rate, push = (v[:1] + middle * (v[1:] - v[:1]) for v in (gyro, force))
        half = [
            x + 0.5 * step / n * d
            for x, d in zip(
                (place, vel, c), rates_of_motion(place, vel, c, rate, push), strict=True
            )
        ]
        slope = rates_of_motion(*half, rate, push)
        place, vel, c = (x + step / n * d for x, d in zip((place, vel, c), slope, strict=True))
    return end[3:6] - vel[0], matrix_to_rotation_vector(quat_to_matrix(end[6:10]) @ c[0].T)


def test_integration_ends_the_same_on_any_nodes() -> None:
    motion = city_drive(60.0, seed=5)
    options = FusionOptions(effects=())
    problem = make_problem(record(motion, PERFECT, 0), build_state_model(options), options)
    ends = []
    for step in (0.1, 0.5, 0.3337):
        t = np.append(np.arange(0.0, 59.9, step), 60.0)
        ends.append(run_forward(problem, make_nodes(t), true_start(motion), Shift()))
    for other in ends[1:]:
        miss = _subtract(other.store.nominal[-1], ends[0].store.nominal[-1])
        assert np.abs(miss[:3]).max() < 5e-3
        assert np.abs(miss[3:]).max() < 1e-4


def _subtract(state: np.ndarray, row: np.ndarray) -> np.ndarray:
    out = np.zeros(9)
    kernels.state.subtract(state[0:3], state[3:6], state[6:10], row, out)
    return out


def test_transition_rows_are_the_derivative_of_the_integration() -> None:
    motion = make_motion([(0.0, 8.0), (3.0, 14.0)], [(0.0, 3.0, 60.0)], 4.0)
    options = FusionOptions(effects=(*TERMS, "gnss_lever_arm", "gnss_correlated_noise"))
    model = build_state_model(options)
    rng = np.random.default_rng(4)
    model.prior_mean[:] = 0.1 * model.prior_sd * rng.standard_normal(len(model.prior_sd))
    problem = make_problem(record(motion, Sensor(), 1), model, options)
    span = 0.5
    nodes = make_nodes(np.array([1.0, 1.0 + span]))
    nominal = nominal_of(motion.at(np.array([1.0])))[0]

    def end(delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        state, params = nominal[None].copy(), model.prior_mean[None].copy()
        kernels.apply_correction(state, params, delta[None])
        moved = np.array(model.prior_mean)
        model.prior_mean[:] = params[0]
        run = run_forward(problem, nodes, Start(state[0], np.ones(9)), Shift())
        model.prior_mean[:] = moved
        return run.store.nominal[-1], run.store.trans[-1]

    zero = np.zeros(model.size)
    base, trans = end(zero)
    size = np.concatenate([[1.0] * 3, [0.1] * 3, [1e-3] * 3, 0.1 * model.prior_sd])
    numeric = np.zeros((9, model.size))
    for j in range(model.size):
        delta = zero.copy()
        delta[j] = size[j]
        high = _subtract(end(delta)[0], base)
        low = _subtract(end(-delta)[0], base)
        numeric[:, j] = (high - low) / (2.0 * size[j])
    # Earth and transport rate couple the errors by 1e-4 rad/s, which the rows leave out
    scale = np.maximum(np.abs(numeric).max(axis=0), 1e-2)
    assert np.abs((trans - numeric) / scale).max() < 1e-2


def test_compact_noise_is_the_dense_recursion() -> None:
    rng = np.random.default_rng(8)
    qa, qg, dt = 1e-4, 1.6e-7, 0.01
    compact, dense = np.zeros(N_NOISE), np.zeros((9, 9))
    for _ in range(120):
        d = (rng.normal(0.0, 3.0, 3) + np.array([0.0, 0.0, -9.8])) * dt
        cross = np.array([[0, -d[2], d[1]], [d[2], 0, -d[0]], [-d[1], d[0], 0]])
        f = np.eye(9)
        f[0:3, 3:6] = dt * np.eye(3)
        f[3:6, 6:9] = -cross
        f[0:3, 6:9] = -0.5 * dt * cross
        dense = f @ dense @ f.T
        dense[3:6, 3:6] += qa * dt * np.eye(3)
        dense[6:9, 6:9] += qg * dt * np.eye(3)
        add_noise(compact, d, dt, qa, qg)
    out = np.empty((9, 9))
    expand_noise(compact, out)
    size = np.sqrt(np.diag(dense))
    miss = np.abs((out - dense) / np.outer(size, size))
    # position leaves out the attitude's part within a single step
    assert miss[:3, :3].max() < 5e-4
    miss[:3, :3] = 0.0
    assert miss.max() < 1e-12


def test_noise_of_a_steady_force_is_the_textbook_integral() -> None:
    """White rate noise of density qg under a force f: var v = qg f^2 t^3 / 3 across it."""
    qa, qg, f, dt, t = 1e-4, 1e-6, 9.8, 0.01, 5.0
    s = np.zeros(N_NOISE)
    for _ in range(int(t / dt)):
        add_noise(s, np.array([0.0, 0.0, -f * dt]), dt, qa, qg)
    q = np.empty((9, 9))
    expand_noise(s, q)
    assert q[6, 6] == pytest.approx(qg * t)
    assert q[5, 5] == pytest.approx(qa * t)
    assert q[3, 3] == pytest.approx(qa * t + qg * f**2 * t**3 / 3, rel=0.01)
    assert q[0, 0] == pytest.approx(qa * t**3 / 3 + qg * f**2 * t**5 / 20, rel=0.01)
    assert q[3, 7] == pytest.approx(-f * qg * t**2 / 2, rel=0.01)


def test_covariance_follows_the_transition_and_the_noise() -> None:
    """Between nodes without measurements P := F P F' + Q, by full matrices."""
    motion = city_drive(12.0, seed=2, start_speed=10.0)
    options = FusionOptions(effects=("accel_bias", "gyro_bias", "gnss_correlated_noise"))
    model = build_state_model(options)
    problem = make_problem(record(motion, Sensor(), 1), model, options)
    nodes = make_nodes(np.arange(0.0, 10.0, 0.4))
    store = run_forward(problem, nodes, true_start(motion), Shift()).store
    cov = full_covariance(store.cov, model.size)
    for k in range(1, len(nodes.t)):
        full = np.eye(model.size)
        full[:9] = store.trans[k]
        decay = np.ones(model.size)
        with np.errstate(divide="ignore"):
            decay[9:] = np.where(model.tau[9:] > 0, np.exp(-0.4 / model.tau[9:]), 1.0)
        full[range(9, model.size), range(9, model.size)] = decay[9:]
        rest = cov[k] - full @ cov[k - 1] @ full.T
        assert np.abs(rest[9:, :9]).max() < 1e-12
        expected = np.where(model.tau > 0, (1 - decay**2) * model.walk, model.walk * 0.4)
        assert np.diag(rest)[9:] == pytest.approx(expected[9:], abs=1e-13)
        assert np.linalg.eigvalsh(rest[:9, :9]).min() > -1e-12
        assert rest[6, 6] == pytest.approx(options.gyro_noise**2 * 0.4, rel=1e-6)
