"""Parts of the calibration one by one, with readings in counts, holes and an odd pose."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from automap.records import FloatArray, ImuCalibration, RawImu, TriadCalibration
from tests.unit.calibration_scene import GRAVITY
from tests.unit.figure_levels import levelled, table
from tests.unit.scenarios import _or_error, _turned, scenario


@cache
def _log(seed: int = 3, poses: int = 13, rest_s: float = 1.8, turn_s: float = 2.0) -> RawImu:
    """A log in counts; one stamp in three hundred is late, and once a second and a half is gone."""
    log = _turned(seed, poses, rest_s, turn_s)
    rng = np.random.default_rng(seed)
    late = np.rint(2e6 * (rng.random(len(log)) < 0.003)).astype(np.int64)
    t_ns = log.t_ns + late + np.where(np.arange(len(log)) > 520, 1_500_000_000, 0)
    counts = np.array([2048.0, 2050.0, 2041.0])
    return replace(
        log,
        t_ns=t_ns,
        accel=np.rint(log.accel / GRAVITY * counts),
        gyro=log.gyro * [900.0, 880.0, 910.0],
        accel_scale=GRAVITY / counts,
        gyro_scale=1.0 / np.array([900.0, 880.0, 910.0]),
    )


def _off(log: RawImu, counts: float) -> RawImu:
    """The log with another error of the accelerometer in every stretch of four seconds."""
    stretch = ((log.t_ns - log.t_ns[0]) // 3_800_000_000).astype(np.int64)
    errors = counts * np.random.default_rng(1).normal(size=(stretch.max() + 1, 3))
    return replace(log, accel=log.accel + np.rint(errors[stretch]))


def _poses(seed: int, k: int) -> tuple[FloatArray, FloatArray]:
    """Mean readings [k, 3] of poses and their variances."""
    rng = np.random.default_rng(seed)
    up = rng.normal(size=(k, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    force = (
        GRAVITY * up @ np.linalg.inv(np.array([[1.0, -0.01, 0.02], [0.0, 1.0, 0.013], [0, 0, 1]])).T
    )
    means = (force - [0.2, -0.3, 0.1]) / [0.0048, 0.0051, 0.0046] + rng.normal(0.0, 0.9, (k, 3))
    return means, rng.uniform(0.2, 0.9, (k, 3))


@scenario
def calibration_rests() -> Any:
    """Movement, noise and rests of two logs, and the limit between rest and motion."""
    from automap.calibration import rest as of
    from automap.calibration import rest_search as search
    from automap.calibration.allan_triads import _longest_rest

    one, other = _log(), _log(9, 6, 1.6, 0.9)
    moved = [of.movement(log) for log in (one, other)]
    found = {limit: of.rests_below([one, other], moved, limit) for limit in (2.0, 9.0, 70.0)}
    rests = found[9.0]
    a, b = rests[2], rests[3]
    near = replace(b, start=a.stop + 30, accel=a.accel + np.array([3.0, 0.0, 1.0]))
    flat = replace(one, gyro=np.round(one.gyro * [1.0, 0.0, 1.0]))
    off = [
        replace(r, accel=r.accel * (1.0, 1.08, 1.0, 0.95)[k % 4 if k < 8 else 0])
        for k, r in enumerate(rests)
    ]
    short = replace(one, t_ns=one.t_ns[:40], gyro=one.gyro[:40], accel=one.accel[:40])
    slow = replace(one, t_ns=one.t_ns * 30)
    return levelled(
        {
            "moved": moved,
            "flat": of.movement(flat),
            "refused": [_or_error(of.movement, log) for log in (short, slow)],
            "noise": [
                of.noise_density(log, limit) for log in (one, other) for limit in (1.2, 8.0, 90.0)
            ],
            "windowed": of._windowed(one),
            "step": of.quantisation_step(
                np.array([[0.0, 5.0], [2.0, 5.0], [2.5, 5.0], [9.0, 5.0]])
            ),
            "rests": {str(limit): table(some) for limit, some in found.items()},
            "same": [
                of._same_pose(one, x, y, span)
                for x, y in ((a, b), (a, near), (a, rests[-1]))
                for span in (6000.0, 500.0)
            ],
            "joined": of._joined(a, b),
            "correlated": table(of._with_correlation(rests)),
            "runs": of._runs(np.array([True, True, False, True, False, False, True])),
            "search": [
                {n: table(v) if n.endswith("s") else v for n, v in vars(s).items()}
                for s in (search.find_rests([one], GRAVITY, n) for n in (6, 9))
            ],
            "open": search.find_rests([other], GRAVITY, 9).determined,
            "least": [search.least_poses(n) for n in (6, 9)],
            "widths": [
                search._log_widths(some, GRAVITY, n) for some in (rests, rests[:5]) for n in (6, 9)
            ],
            "bias": [search._log_bias(some) for some in (rests, rests[:1])],
            "outliers": [
                table(part)
                for n, some in ((6, off), (9, rests), (6, off[:9]))
                for part in search._without_outliers(some, GRAVITY, n)
            ],
            "longest": [_longest_rest(log) for log in (one, other)],
        }
    )


@scenario
def calibration_fits() -> Any:
    """Accelerometer and gyro fits with all that is told of them."""
    from automap.calibration import accelerometer as of
    from automap.calibration import gyroscope, static
    from automap.calibration.rest import movement, rests_below

    means, variances = _poses(1, 15)
    flat = means[:7] * [1.0, 1.0, 0.05]
    fits = [of.fit_accelerometer(means, variances, GRAVITY, n) for n in (6, 9)]
    x = np.array([1.02, 0.97, 1.01, 0.1, -0.2, 0.15, 0.01, -0.02, 0.03])
    y = means * GRAVITY / 2000.0
    log = _log()
    rests = rests_below([log], [movement(log)], 9.0)
    accel = of.fit_accelerometer(
        np.array([r.accel for r in rests]), np.array([r.accel_var for r in rests]), GRAVITY, 9
    )
    force = accel.apply(log.accel)
    up = of.directions_of(accel, np.array([r.accel for r in rests]))
    spread = np.random.default_rng(4).uniform(1e-9, 4e-9, up.shape)
    turns = gyroscope.turns_between([log], [force], rests, up, spread, GRAVITY)
    gyro = [
        gyroscope.fit_gyro([log], [force], rests, turns, accel, GRAVITY, with_g)
        for with_g in (False, True)
    ]
    turned = np.array([[1.0, 0.2, -0.1], [0.4, -0.9, 0.1], [0.3, 0.1, 0.5]])
    return levelled(
        {
            "accel": fits,
            "told": [(f.residual_rms, f.matrix, f.apply(means[:3])) for f in fits],
            "residuals": [of._norm_residuals(x[:n], y, GRAVITY) for n in (6, 9)],
            "start": [of._ellipsoid_start(m) for m in (means, means[:5], flat)],
            "left out": [
                of.leave_one_out(means[:k], variances[:k], GRAVITY, f)
                for f in fits
                for k in (11, 10, 7)
            ],
            "turns": table(turns),
            "seconds": [turn.seconds for turn in turns],
            "gyro": gyro,
            "rms": [g.turn_rms for g in gyro],
            "rate": [g.apply(log.gyro[::90], force[::90]) for g in gyro],
            "linear": gyroscope._linear_start(
                [log], [force], log.gyro[0], np.array([90.0, 80.0, 70.0])
            ),
            "axes": [
                gyroscope.other_axes(m)
                for m in (
                    turned,
                    -turned,
                    turned[[1, 0, 2]],
                    np.abs(turned),
                    np.diag([1.0, 2.0, 0.0]),
                )
            ],
            "static": [
                found
                if isinstance(found, str)
                else (
                    found.warnings,
                    found.accel.scale,
                    found.gyro_scale,
                    found.gyro_bias,
                    found.turns,
                )
                for some, n in (
                    (_log(5, 7), None),
                    (_log(5, 9), None),
                    (_log(5, 7), 6),
                    (replace(_log(5, 7), gyro_scale=None), 6),
                    (_off(_log(), 9.0), 6),
                    (_off(_log(), 60.0), 6),
                )
                for found in [_or_error(static.calibrate_static, [some], GRAVITY, n)]
            ],
            "rough": static._rough_directions(rests[:9]),
            "few": [
                static._too_few([log], replace(_search(), rests=rests[:k]), n)
                for k, n in (
                    (0, 6),
                    (1, 6),
                    (4, 6),
                    (8, 9),
                    (9, 6),
                )
            ],
            "warned": [
                static._pose_warnings(
                    replace(_search(), rests=rests, outliers=tuple(rests[:1])), m, f
                )
                for m, f in ((means, fits[1]), (means[:6], fits[0]), (np.abs(means), fits[1]))
            ],
        }
    )


@cache
def _search() -> Any:
    from automap.calibration.rest_search import find_rests

    return find_rests([_log()], GRAVITY, 9)


@scenario
def calibration_squares() -> Any:
    """Least squares with a floor, its parts, and poses, units and folds that go with them."""
    from automap.calibration import fold, plausible, poses
    from automap.calibration import least_squares as of

    rng = np.random.default_rng(5)
    t = np.linspace(0.0, 3.0, 24)
    y = 2.0 * np.exp(-0.8 * t) + 0.3 + rng.normal(0.0, 0.06, 24)

    def model(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        decay = np.exp(-x[1] * t)
        return x[0] * decay + x[2] - y, np.column_stack([decay, -x[0] * t * decay, np.ones(24)])

    variance = rng.uniform(0.5, 2.0, 24) * np.where(t < 1.4, 2e-4, 9e-3)
    group, share = (t > 1.4).astype(np.int64), np.where(t < 1.0, 2.0 / 3.0, 1.0)
    fit = of.fit_with_floor(model, np.array([1.0, 0.3, 0.0]), variance, group, share)
    A = rng.normal(size=(9, 4)) * [1.0, 1e3, 1e-4, 3.0]
    up = rng.normal(size=(8, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    matrix = np.eye(3) + 0.02 * rng.normal(size=(3, 3))
    triad = TriadCalibration(np.array([1.1, 0.9, 1.2]), np.array([0.1, -0.2, 0.3]), matrix)
    before = ImuCalibration(
        triad, replace(triad, scale=triad.scale * 0.01), "g", "deg/s", 0.01 * matrix
    )
    errors = 0.05 * rng.normal(size=12)
    root = rng.normal(size=(12, 12))
    wave = 10.0 * np.sin(np.linspace(0.0, 25.0, 300))
    cut = {c: np.clip(wave + rng.normal(0.0, 0.05, 300), -99.0, c) for c in (9.9, 9.0, 6.0)}
    log = _log()
    return levelled(
        {
            "newton": [
                of.gauss_newton(model, np.array(x), np.sqrt(variance), n)
                for x, n in (
                    ([1.0, 0.3, 0.0], 60),
                    ([5.0, 9.0, -3.0], 4),
                    ([0.1, -2.0, 2.0], 60),
                )
            ],
            "fit": fit,
            "half": fit.half_width(),
            "redundancy": [of._redundancy(A, np.arange(9) < k, share[-9:]) for k in (3, 7)],
            "inverse": of._inverse(A.T @ A),
            "floor": [
                of._floor(y[:9], v * variance[:9], e, share[:9])
                for v in (0.0, 1.0, 1e5)
                for e in (3.0, 7.5)
            ],
            "determined": [poses.determination(up[:k], n) for k in (5, 6, 8) for n in (6, 9)],
            "design": [poses._design(up, n) for n in (6, 9)],
            "helpful": [poses.helpful_poses(up[:k], n) for k in (0, 3, 6) for n in (6, 9)],
            "named": [poses.pose_name(np.array(v)) for v in ([0.0, -1.0, 0.0], [1.0, 0.0, -1.0])],
            "folded": fold.corrected(before, errors),
            "covariance": [
                fold.folded_covariance(triad, root @ root.T, at, 7) for at in ((0, 6), (3, 9))
            ],
            "angles": fold.angles(matrix),
            "saturated": [plausible._saturated(x) for x in cut.values()],
            "cut": [
                plausible._cut_off(x, s, n)
                for x in cut.values()
                for s, n in ((18, 4), (120, 9), (0, 5))
            ],
            "units": [
                _or_error(refuse, replace(log, accel_unit="g", gyro_unit="deg/s"), s * scale)
                for refuse, scale in (
                    (plausible.refuse_wrong_accel_unit, log.accel_scale),
                    (plausible.refuse_wrong_gyro_unit, log.gyro_scale),
                )
                for s in (1.0, 0.78, 1.24, 1.27, 9.8, 57.0, 0.0174, 400.0)
            ],
        }
    )


@scenario
def calibration_hand() -> Any:
    """The hand's motion by the innovations, and the covariance that goes with it."""
    from automap.calibration import dynamic
    from automap.calibration import hand_motion as of
    from automap.calibration.limits import PRIOR_SD

    rng = np.random.default_rng(6)
    m = 140
    sway = np.cumsum(rng.normal(0.0, 0.01, (m, 3)), axis=0)
    innovations = np.column_stack(
        [np.arange(m) * 5.0, np.gradient(sway, axis=0) * 20.0, np.ones((m, 3)), sway]
    ) + 0.01 * rng.normal(size=(m, 10))
    moving = (np.arange(m) % 23 > 5) | (np.arange(m) < 20)
    response = 0.05 * rng.normal(size=(m, 21, 27)) + np.eye(21, 27)
    weights = of.final_response(0.3 * response)
    own = 3e-3 * rng.normal(size=(m, 12, 6))
    root = 0.02 * rng.normal(size=(12, 12))
    still = replace(_log(), t_ns=_log().t_ns)
    log = replace(still, gyro=still.gyro / 900.0, accel=still.accel / 2048.0 * GRAVITY)
    errors = 0.01 * rng.normal(size=12)
    sd = np.linspace(1.0, 0.2, 30)[:, None] * PRIOR_SD
    made = dynamic.DynamicCalibration(
        np.arange(30.0),
        np.zeros((30, 4)),
        np.tile(errors, (30, 1)),
        sd,
        root,
        0.6,
        0.1,
        np.array([3.0, 9.0, 5.0]),
        innovations,
        (),
    )
    return levelled(
        {
            "hand": [of.hand_motion(innovations[:k], moving[:k], 0.1) for k in (m, 90, 40)],
            "slow": of.hand_motion(innovations, moving, 0.7),
            "used": of._used(moving),
            "weights": weights,
            "covariance": [
                of.coloured_noise_covariance(
                    root @ root.T,
                    own[:k],
                    rng.uniform(0.01, 0.1, (k, 2)),
                    innovations[:k],
                    moving[:k],
                    0.1,
                )
                for k in (m, 40)
            ],
            "spectrum": np.abs(of._cross_spectrum(innovations[:, [1, 7]], of._used(moving), 0.1)),
            "phase": of._cross_spectrum(innovations[:, [2, 9]], of._used(moving), 0.3),
            "history": of.coloured_noise_history(sd, 1.2 * PRIOR_SD, 0.3 * PRIOR_SD),
            "start": [
                dynamic._start(log, log.accel, errors, rest, GRAVITY, PRIOR_SD)
                for rest in (True, False)
            ],
            "unit": dynamic._unit(log.accel * 3.0, log.accel),
            "judged": dynamic._judged(made, log, PRIOR_SD).warnings,
            "final": made.final,
            "refused": [
                _or_error(
                    dynamic.calibrate_dynamic,
                    log,
                    log.gyro,
                    s * log.accel,
                    GRAVITY,
                    PRIOR_SD,
                    least,
                )
                for s, least in ((1.0, 1e3), (0.5, 1.0), (2.0, 1.0))
            ],
        }
    )


@scenario
def calibration_kernels() -> Any:
    """Few steps of the filter of the hand's turns, and gravity carried through some."""
    from automap.calibration.dynamic_kernel import run_filter
    from automap.calibration.gravity_kernel import carry_direction
    from automap.frames import matrix_to_quat, rpy_to_matrix

    found: dict[str, Any] = {}
    for seed, every, followed in ((1, 2, True), (2, 3, False)):
        rng = np.random.default_rng(seed)
        n = 6
        gyro, accel = rng.normal(0.0, 2.0, (n, 3)), rng.normal(0.0, 6.0, (n, 3))
        quat, errors = matrix_to_quat(rpy_to_matrix(rng.normal(size=3))), 0.1 * rng.normal(size=12)
        root = rng.normal(size=(21, 21))
        P = root @ root.T / 9.0 + 0.1 * np.eye(21)
        out, innov = np.zeros((n, 28)), np.zeros((n // every + 1, 10))
        response = np.zeros((len(innov) if followed else 0, 21, 27))
        count = run_filter(
            rng.uniform(0.05, 0.2, n - 1),
            gyro,
            accel,
            9.7,
            quat,
            errors,
            P,
            np.array([0.3, 0.2]),
            every,
            rng.uniform(0.5, 2.0, (n, 2)),
            rng.uniform(0.1, 0.4, 12),
            out,
            innov,
            response,
        )
        found[str(seed)] = [count, quat, errors, P, out, innov, response]
    rng = np.random.default_rng(3)
    for seconds in (0.3, 0.002):
        rate, signals = rng.normal(0.0, 2.0, (4, 3)), rng.normal(size=(4, 7))
        end, sensitivity = np.empty(3), np.empty((3, 3, 7))
        up = np.array([0.6, -0.48, 0.64])
        carry_direction(rate, signals, seconds * rng.uniform(0.5, 2.0, 3), up, end, sensitivity)
        found[f"{seconds} s"] = [end, sensitivity]
    return levelled(found)


@scenario
def calibration_noise() -> Any:
    """Allan's deviation by its parts, both triads at rest, and resting attitudes."""
    from automap.calibration import allan as of
    from automap.calibration import rest_attitude as resting
    from automap.calibration.allan_triads import resting_fits
    from automap.calibration.rest_sequences import (
        log_sequences,
        sequence_of,
        simulated_sequences,
    )

    rng = np.random.default_rng(8)
    n, rate_hz = 1200, 12.5
    t_ns = (np.arange(n) * 8e7).astype(np.int64)
    white = rng.normal(0.0, 1.0, (n, 6)) * [0.02, 0.03, 0.025, 1e-3, 2e-3, 1.5e-3]
    slow = np.cumsum(rng.normal(0.0, 1.0, (n, 6)), axis=0) * [3e-4, 2e-4, 5e-4, 1e-5, 4e-5, 3e-5]
    values = white + slow + [0.3, -0.5, -9.7, 0.01, -0.02, 0.015]
    log = RawImu(
        t_ns=t_ns,
        gyro=values[:, 3:] * 100.0,
        accel=values[:, :3] * 50.0,
        gyro_scale=np.full(3, 0.01),
        accel_scale=np.full(3, 0.02),
        name="still",
    )
    bumped = replace(
        log, accel=log.accel + 400.0 * (np.arange(n) // 20 == 50)[:, None] * rng.normal(size=(n, 3))
    )
    factors = of.averaging_factors(n)
    edf = of.degrees_of_freedom(n, factors)
    squares = np.array([4e-5, 1e-7, 3e-9])
    tau = factors / rate_hz
    deviation = of.overlapping_deviation(values[:, 3], rate_hz, factors)
    t_s, gyro, accel = t_ns[:300] * 1e-9, values[:300, 3:], values[:300, :3]
    rest = replace(
        log,
        t_ns=t_ns[:200],
        gyro=gyro[:200],
        accel=accel[:200],
        gyro_scale=np.ones(3),
        accel_scale=np.ones(3),
    )
    attitude = resting.rest_attitude(t_s, gyro, accel, 40)
    moving = replace(
        _turned(4, 3, 6.0, 2.0),
        name="hand",
        gyro_scale=np.full(3, 1.1),
        accel_scale=np.full(3, 0.98),
    )
    return levelled(
        {
            "factors": [of.averaging_factors(k) for k in (3, 60, n)],
            "freedom": edf,
            "deviation": deviation,
            "basis": of._basis(tau),
            "squares": of._fit_squares(tau, deviation, edf),
            "simulated": [
                of._simulated(np.random.default_rng(1), s, 101, rate_hz)
                for s in (np.sqrt(squares), np.array([0.1, 0.0, 0.2]))
            ],
            "terms": of._terms(squares, 400, rate_hz, of.averaging_factors(400), edf, 6),
            "refused": [
                _or_error(of.allan_fit, v, rate_hz, "x") for v in (values[:90, 0], np.ones(700))
            ],
            "fits": resting_fits(bumped),
            "attitude": attitude,
            "drift": attitude.drift,
            "turned": resting.roll_pitch_since_start(attitude.down[::-1]),
            "largest": resting.largest_turn(moving.accel[::50] / 10.0),
            "sequence": sequence_of(rest, rest.gyro, rest.accel),
            "made": simulated_sequences([2]),
            "sequences": [log_sequences(moving, at) for at in (None, 1.0)],
            "few": [_or_error(log_sequences, x) for x in (rest, replace(log, gyro_scale=None))],
        }
    )
