"""How readings become rates and forces, and how much noise stands between the nodes."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from scipy.integrate import trapezoid

from automap.fusion.filtered import full_covariance
from automap.fusion.kernel_runs import run_dense, run_forward
from automap.fusion.kernels.readings import acceleration, take_noise_out
from automap.fusion.model import build_state_model
from automap.fusion.nodes import Shift
from automap.fusion.options import FusionOptions
from automap.fusion.problem import Problem, make_problem
from automap.fusion.steady_readings import steady
from automap.fusion.unusable_readings import gap_noise
from automap.records import ImuData
from tests.unit.fusion_drive import BASE_NS
from tests.unit.fusion_motion import make_motion
from tests.unit.fusion_problem import make_nodes, true_start

EFFECTS = (
    "accel_bias",
    "gyro_bias",
    "accel_scale",
    "gyro_scale",
    "accel_misalignment",
    "gyro_misalignment",
    "gyro_g_sensitivity",
    "accel_temperature",
    "gyro_temperature",
)
RATE_HZ = 50.0
OPTIONS = FusionOptions(effects=())


def _errors(values: dict[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrix [6, 6], bias [6] and slope by temperature [6] with reading = true + matrix true +
    bias + slope (T - T0); rates before forces."""
    matrix, bias, slope = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    for name, value in values.items():
        match = re.fullmatch(r"(gyro|accel)_(.*)_([xyz]+)", name)
        assert match is not None, name
        sensor, kind, axes = match.groups()
        first = 0 if sensor == "gyro" else 3
        out = first + "xyz".index(axes[0])
        if kind == "bias":
            bias[out] = value
        elif kind == "temperature":
            slope[out] = value
        else:
            source = 3 if kind == "g_sensitivity" else first
            matrix[out, source + "xyz".index(axes[-1])] += value
    return matrix, bias, slope


def test_readings_are_freed_of_all_linear_errors_exactly() -> None:
    """The sensor's errors by their definition, on rates and forces that rise evenly."""
    rng = np.random.default_rng(4)
    options = FusionOptions(effects=EFFECTS, velocity_wander_sd=0.0)
    model = build_state_model(options)
    model.prior_mean[:] = 2.0 * model.prior_sd * rng.standard_normal(len(model.prior_sd))
    matrix, bias, slope = _errors(dict(zip(model.names, model.prior_mean.tolist(), strict=True)))
    n = 101
    t = np.arange(n) / RATE_HZ
    true = rng.normal(0.0, [0.2] * 3 + [3.0] * 3) + t[:, None] * rng.normal(0.0, 0.3, 6)
    warm = 20.0 + np.where(t < 1.0, 0.0, 6.0)
    readings = true @ (np.eye(6) + matrix).T + bias + np.outer(warm - np.median(warm), slope)
    t_ns = BASE_NS + np.rint(t * 1e9).astype(np.int64)
    imu = ImuData(t_ns, readings[:, :3], readings[:, 3:], temp_c=warm, axes_known=True)
    problem = make_problem(imu, model, options)
    nodes = make_nodes(np.array([0.0, 0.91, 1.9]))
    forward = run_forward(problem, nodes, true_start(make_motion([(0.0, 5.0)], [], 3.0)), Shift())
    _, rates = run_dense(
        problem, nodes, forward.store.nominal, forward.store.params, blend=False, with_rates=True
    )
    # a step takes the signals of its begin, and next to the jump samples are no straight line
    steady = (t < 0.95) | ((t > 1.05) & (t < 1.9))
    assert rates[steady] == pytest.approx(true[steady], abs=1e-9)
    assert np.abs(readings - true)[steady].max() > 0.05


def _resting(extra: np.ndarray | None = None, gap: slice | None = None) -> ImuData:
    """Ten seconds at rest with white noise, a burst of more of it, or samples left out."""
    rng = np.random.default_rng(1)
    n = int(10 * RATE_HZ) + 1
    t_ns = BASE_NS + np.rint(np.arange(n) / RATE_HZ * 1e9).astype(np.int64)
    readings = rng.standard_normal((n, 6)) * [1e-3] * 6
    if extra is not None:
        readings[200:260] += rng.standard_normal((60, 6)) * extra
    readings[:, 5] -= 9.8
    keep = np.ones(n, bool)
    if gap is not None:
        keep[gap] = False
    return ImuData(t_ns[keep], readings[keep, :3], readings[keep, 3:], axes_known=True)


def _growth(problem: Problem, t: tuple[float, float]) -> np.ndarray:
    """What the variances [9] grow by between two instants, from a start that is almost sure."""
    start = true_start(make_motion([(0.0, 0.0)], [], 12.0), np.full(9, 1e-9))
    run = run_forward(problem, make_nodes(np.array(t)), start, Shift())
    cov = full_covariance(run.store.cov, problem.model.size)
    return np.diag(cov[1] - cov[0])


def test_a_reading_without_its_noise_is_the_steady_one_at_any_instant() -> None:
    """Reading and what is taken out of it add up to the best estimate, between samples as well."""
    rng = np.random.default_rng(3)
    t = np.arange(6000) / 100.0
    turning = np.column_stack([0.1 * np.sin(0.8 * t), 0.05 * np.cos(1.1 * t), 0.3 * np.sin(t)])
    gyro = turning + 0.01 * rng.normal(size=turning.shape)
    accel = 4.0 * turning + [0.0, 0.0, -9.8] + 0.3 * rng.normal(size=turning.shape)
    imu = ImuData(BASE_NS + np.rint(t * 1e9).astype(np.int64), gyro, accel, None)
    problem = make_problem(imu, build_state_model(OPTIONS), OPTIONS)
    best = np.column_stack([steady(t, gyro), steady(t, accel)])
    # the noise of the readings is out of it, the turns are not
    inside = slice(500, -500)
    assert np.std((best[:, :3] - turning)[inside]) < 0.5 * np.std((gyro - turning)[inside])
    for at in (10.0, 20.004, 30.0075, 59.99):
        i = min(int(np.searchsorted(t, at, "right")) - 1, len(t) - 2)
        reading = np.array([np.interp(at, t, problem.samples.raw[:, a]) for a in range(6)])
        take_noise_out(problem.samples, i, at, 6, reading)
        expected = [np.interp(at, t, best[:, a]) for a in range(6)]
        np.testing.assert_allclose(reading, expected, rtol=0.0, atol=1e-12)


def test_a_scale_error_takes_the_force_without_its_noise() -> None:
    """With the noise in it a shaken accelerometer seems to read too much: what it adds to the
    velocity would be explained by what it adds to the column."""
    rng = np.random.default_rng(3)
    t = np.arange(6000) / 100.0
    accel = np.tile([0.0, 0.0, -9.8], (len(t), 1))
    accel[:, 0] += np.sin(0.8 * t)
    shaken = accel + 1.2 * rng.normal(size=accel.shape)
    model = build_state_model(FusionOptions(effects=("accel_scale",), velocity_wander_sd=0.0))
    imu = ImuData(BASE_NS + np.rint(t * 1e9).astype(np.int64), np.zeros_like(accel), shaken, None)
    problem = make_problem(imu, model, FusionOptions(effects=("accel_scale",)))
    start = true_start(make_motion([(0.0, 0.0)], [], 12.0), np.full(9, 1e-9))
    trans = run_forward(problem, make_nodes(np.array([20.0, 21.0])), start, Shift()).store.trans[1]
    column = trans[:, 9 + model.names.index("accel_scale_x")]
    over = slice(2000, 2101)
    noisy, calm = (trapezoid(f[over, 0], t[over]) for f in (shaken, steady(t, shaken)))
    assert np.hypot(*column[3:5]) == pytest.approx(abs(calm), rel=2e-3)
    assert abs(noisy) != pytest.approx(abs(calm), rel=1e-2)


def test_a_gap_of_the_samples_adds_what_the_vehicle_may_have_done_in_it() -> None:
    options = FusionOptions(effects=(), gap_force_sd=0.8, gap_rate_sd=0.05)
    problem = make_problem(_resting(gap=slice(200, 300)), build_state_model(options), options)
    grown = _growth(problem, (2.0, 8.0))
    # samples 199 and 300 stand: 2.02 s between them, of which the vehicle's own is taken as even
    width, whole = 101 / RATE_HZ, 6.0
    tilt = (options.gap_rate_sd * width) ** 2 + options.gyro_noise**2 * whole
    assert grown[6:9] == pytest.approx(np.full(3, tilt), rel=1e-6)
    down = (options.gap_force_sd * width) ** 2 + options.accel_noise**2 * whole
    assert grown[5] == pytest.approx(down, rel=1e-3)
    # tilt turns gravity into the horizontal
    assert (grown[3:5] > 2.0 * down).all()


def test_a_short_gap_adds_what_the_drive_changes_by_in_as_long() -> None:
    """Two readings lost of each twenty, of a drive that swings slowly: a line over a gap errs by no
    more than its second difference, and a longer gap by more."""
    t = np.arange(6000) / 100.0
    gyro = np.column_stack([0.0 * t, 0.0 * t, 0.3 * np.sin(2.0 * t)])
    accel = np.tile([0.0, 0.0, -9.8], (len(t), 1))
    kept = np.arange(len(t)) % 20 > 1
    found = []
    for half in (1, 10):
        keep = kept & ~((t > 30.0) & (t < 30.0 + 0.02 * half)) if half > 1 else kept
        noise = gap_noise(t[keep], gyro[keep], accel[keep], 0.025, 1.0, 0.1)
        gaps = np.flatnonzero(np.diff(t[keep]) > 0.025)
        assert np.flatnonzero(noise[:, 1] > 0.0).tolist() == gaps.tolist()
        width = np.diff(t[keep])[gaps]
        widest = int(np.argmax(width))
        found.append(float(np.sqrt(noise[gaps, 1] / width)[widest]))
        # of a sine half the squared rate times half the gap's half length squared
        bend = 0.3 / np.sqrt(2.0) * 0.5 * (2.0 * 0.5 * float(width[widest])) ** 2
        assert 0.5 * bend < found[-1] < 2.0 * bend
    assert found[0] < 0.1 * found[1]


@pytest.mark.parametrize(("first", "column"), [(3, 5), (0, 8)])
def test_a_shock_adds_noise_to_the_sensor_that_shows_it(first: int, column: int) -> None:
    """Scatter of the forces makes velocities less sure and leaves the heading, that of rates the
    other way round; the variance added is that of the scatter."""
    extra = np.zeros(6)
    extra[first : first + 3] = 0.02
    options = FusionOptions(effects=(), shocks=True, accel_noise=1e-4, gyro_noise=1e-4)
    model = build_state_model(options)
    grown = _growth(make_problem(_resting(extra), model, options), (3.0, 7.0))
    plain = _growth(make_problem(_resting(), model, options), (3.0, 7.0))
    other = 13 - column
    expected = 0.02**2 * 60 / RATE_HZ**2
    assert grown[column] - plain[column] == pytest.approx(expected, rel=0.3)
    assert grown[other] - plain[other] < 0.05 * expected


@pytest.mark.parametrize(("t", "share"), [(2.0, 0.0), (2.15, 0.75), (2.9, 1.0)])
def test_acceleration_and_reading_without_noise_between_two_samples(t: float, share: float) -> None:
    rng = np.random.default_rng(2)
    c, out = rng.normal(size=(3, 3)), np.zeros(3)
    problem = make_problem(
        ImuData(BASE_NS + np.arange(40) * 20_000_000, np.zeros((40, 3)), np.ones((40, 3))),
        build_state_model(OPTIONS),
        OPTIONS,
    )
    calm, now = rng.normal(size=(3, 6)), rng.normal(size=3)
    samples: Any = problem.samples._replace(t=np.array([1.0, 2.0, 2.2]), calm=calm)
    acceleration(samples, 1, t, 9.8, c, now, out)
    noise = -calm[:, 3:]
    wanted = c @ (now - (1.0 - share) * noise[1] - share * noise[2]) + [0.0, 0.0, 9.8]
    assert out == pytest.approx(wanted)
    wanted = 1.0 + (1.0 - share) * calm[1] + share * calm[2]
    for n in (3, 6):
        reading = np.ones(6)
        take_noise_out(samples, 1, t, n, reading)
        assert reading == pytest.approx(np.where(np.arange(6) < n, wanted, 1.0))
