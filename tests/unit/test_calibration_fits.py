"""The static calibration's fits against numeric derivatives, enumeration and fits without a row."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm as normal
from scipy.stats import t as student

from automap.calibration import limits, rest_search
from automap.calibration.accelerometer import (
    N_NINE,
    N_SIX,
    AccelFit,
    _ellipsoid_start,
    _norm_residuals,
    _to_readings,
    fit_accelerometer,
    leave_one_out,
    misalignment_matrix,
)
from automap.calibration.least_squares import Fit
from automap.calibration.poses import _design, determination, helpful_poses, pose_name
from automap.calibration.rest import noise_density, rests_below
from automap.calibration.static import _rough_directions
from automap.records import FloatArray, RawImu

GRAVITY = 9.8


def directions(rng: np.random.Generator, n: int) -> FloatArray:
    u = rng.normal(size=(n, 3))
    return np.asarray(u / np.linalg.norm(u, axis=1)[:, None])


@pytest.mark.parametrize("n", [N_SIX, N_NINE])
def test_what_a_norm_misses_gravity_by_has_the_derivatives_that_are_stated(n: int) -> None:
    rng = np.random.default_rng(1)
    y = GRAVITY * directions(rng, 7)
    x = np.concatenate(
        [1.0 + 0.1 * rng.normal(size=3), rng.normal(size=3), 0.1 * rng.normal(size=3)]
    )
    x = x[:n]
    r, J = _norm_residuals(x, y, GRAVITY)
    T = misalignment_matrix(x[6:]) if n == N_NINE else np.eye(3)
    assert r == pytest.approx([np.linalg.norm(T @ (x[:3] * v + x[3:6])) - GRAVITY for v in y])
    h = 1e-6
    slope = [
        (_norm_residuals(x + e, y, GRAVITY)[0] - _norm_residuals(x - e, y, GRAVITY)[0]) / (2 * h)
        for e in h * np.eye(n)
    ]
    np.testing.assert_allclose(J, np.array(slope).T, atol=1e-6)
    # of a sensor without errors, in units of gravity, it is the design by which poses are judged
    _, J = _norm_residuals(np.concatenate([np.ones(3), np.zeros(n - 3)]), y, GRAVITY)
    weights = np.concatenate([np.full(3, GRAVITY), np.ones(3), np.full(n - 6, GRAVITY)])
    np.testing.assert_allclose(_design(y / GRAVITY, n), J / weights, atol=1e-12)


def test_poses_on_an_ellipsoid_give_its_centre_and_half_axes() -> None:
    rng = np.random.default_rng(2)
    centre, half = np.array([500.0, -90.0, 20.0]), np.array([1000.0, 1100.0, 900.0])
    found = _ellipsoid_start(centre + half * directions(rng, 12))
    assert found[0] == pytest.approx(centre)
    assert found[1] == pytest.approx(half)
    # five do not determine it: the middle and the half of the largest span
    few = centre + half * np.vstack([np.eye(3), -np.eye(3)[:2]])
    found = _ellipsoid_start(few)
    assert found[0] == pytest.approx(0.5 * (few.min(axis=0) + few.max(axis=0)))
    assert found[1] == pytest.approx(np.full(3, 1100.0))


@pytest.mark.parametrize("n", [N_SIX, N_NINE])
def test_a_fit_in_centred_units_is_the_same_in_readings(n: int) -> None:
    """The conditioned reading is one, and the covariance is that of numeric derivatives."""
    rng = np.random.default_rng(3)
    centre, unit = np.array([300.0, -20.0, 5.0]), np.array([0.01, 0.02, 0.03])
    x = np.concatenate(
        [1.0 + 0.1 * rng.normal(size=3), rng.normal(size=3), 0.1 * rng.normal(size=3)]
    )
    jacobian = rng.normal(size=(20, n))
    covariance = 0.1**2 * np.linalg.inv(jacobian.T @ jacobian)
    fit = Fit(
        x[:n], covariance, np.zeros(20), np.full(20, 0.1), jacobian, np.array([0.2]), 7.0,
        np.zeros(20, bool),
    )  # fmt: skip
    root = rng.normal(size=(6, 6))
    more = np.zeros((n, n))
    more[:6, :6] = 1e-4 * root @ root.T
    factor = student.ppf(0.975, 7.0) / normal.ppf(0.975)

    def readings(p: FloatArray) -> AccelFit:
        return _to_readings(replace(fit, parameters=p), more[:6, :6], centre, unit, GRAVITY, n)

    def values(p: FloatArray) -> FloatArray:
        one = readings(p)
        return np.concatenate([one.scale, one.bias, one.misalignment])

    found = readings(x[:n])
    raw = centre + rng.normal(size=(5, 3)) / unit
    T = misalignment_matrix(x[6:]) if n == N_NINE else np.eye(3)
    wanted = ((raw - centre) * unit * x[:3] + x[3:6]) @ T.T
    np.testing.assert_allclose(found.apply(raw), wanted)
    h = 1e-5
    J = np.array([(values(x[:n] + e) - values(x[:n] - e)) / (2 * h) for e in h * np.eye(n)]).T
    wanted = J @ (factor**2 * covariance + more) @ J.T
    scale = np.sqrt(np.diag(wanted)) + 1e-12
    np.testing.assert_allclose(
        found.covariance / scale / scale[:, None], wanted / scale / scale[:, None], atol=1e-6
    )
    np.testing.assert_allclose(
        found.half_width, normal.ppf(0.975) * np.sqrt(np.diag(found.covariance))
    )
    weights = np.concatenate([np.full(3, GRAVITY), np.ones(3), np.full(n - 6, GRAVITY)])
    np.testing.assert_allclose(found.design, jacobian / weights)
    assert found.floor == 0.2


def test_the_poses_in_another_unit_and_about_another_zero_are_the_same() -> None:
    rng = np.random.default_rng(4)
    means = GRAVITY * directions(rng, 16) * [1.02, 0.97, 1.0] + [0.3, -0.2, 0.1]
    means += 0.002 * rng.normal(size=means.shape)
    variances = np.full(means.shape, 0.002**2)
    one = fit_accelerometer(means, variances, GRAVITY)
    unit, zero = np.array([50.0, 60.0, 70.0]), np.array([900.0, -70.0, 3.0])
    other = fit_accelerometer(means * unit + zero, variances * unit**2, GRAVITY)
    np.testing.assert_allclose(other.scale, one.scale / unit, rtol=1e-6)
    np.testing.assert_allclose(other.bias, one.bias - one.scale / unit * zero, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(other.misalignment, one.misalignment, atol=1e-7)
    np.testing.assert_allclose(other.half_width[:3], one.half_width[:3] / unit, rtol=1e-3)
    np.testing.assert_allclose(other.half_width[6:], one.half_width[6:], rtol=1e-3)
    left, again = (
        leave_one_out(m, v, GRAVITY, f)
        for m, v, f in ((means, variances, one), (means * unit + zero, variances * unit**2, other))
    )
    assert left is not None
    assert again is not None
    # each pose under the fit to the others
    change = np.zeros(3)
    for k in range(len(means)):
        others = np.delete(np.arange(len(means)), k)
        part = fit_accelerometer(means[others], variances[others], GRAVITY)
        force = misalignment_matrix(part.misalignment) @ (part.scale * means[k] + part.bias)
        assert left.residuals[k] == pytest.approx(np.linalg.norm(force) - GRAVITY, abs=1e-9)
        zero_moved = (part.bias / part.scale - one.bias / one.scale) * one.scale
        change = np.maximum(change, [
            np.abs(part.scale / one.scale - 1.0).max(),
            np.abs(part.misalignment - one.misalignment).max(),
            np.abs(zero_moved).max(),
        ])  # fmt: skip
    assert (left.scale_change, left.misalignment_change, left.bias_change) == pytest.approx(
        tuple(change)
    )
    assert left.rms == pytest.approx(np.sqrt(np.mean(left.residuals**2)))
    np.testing.assert_allclose(again.residuals, left.residuals, atol=1e-5)
    assert again.bias_change == pytest.approx(left.bias_change, rel=1e-3)


def test_rough_directions_are_right_of_a_sensor_that_was_never_turned_over() -> None:
    """Equal scales and any zero, poses on a part of the sphere only."""
    u = directions(np.random.default_rng(5), 30)
    u = u[u[:, 2] > -0.2]
    rests: Any = [SimpleNamespace(accel=200.0 * v + [70.0, -10.0, 900.0], accel_var=v) for v in u]
    np.testing.assert_allclose(_rough_directions(rests), u, atol=1e-9)


@pytest.mark.parametrize(("seed", "shift"), [(0, 0.0), (1, 4.0), (2, 8.0), (3, 30.0)])
def test_rests_are_left_out_by_their_residual_under_the_fit_to_the_others(
    seed: int, shift: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a linear model: against fits without each row, externally studentised; Bonferroni's limit
    for so many."""
    rng = np.random.default_rng(seed)
    n, p = 14, 3
    X, noise = rng.normal(size=(n, p)), rng.normal(size=n)
    noise[4] += shift
    rests: Any = [
        SimpleNamespace(accel=X[k], accel_var=np.array([noise[k], k, 0])) for k in range(n)
    ]

    def fit(means: FloatArray, variances: FloatArray, gravity: float, of: int) -> Any:
        y = variances[:, 0]
        r = y - means @ np.linalg.lstsq(means, y, rcond=None)[0]
        sd = np.full(len(y), np.sqrt(np.sum(r**2) / (len(y) - of)))
        return SimpleNamespace(design=means, residuals=r, residual_sd=sd)

    monkeypatch.setattr(rest_search, "fit_accelerometer", fit)
    kept, out = rest_search._without_outliers(rests, GRAVITY, p)
    left, gone = list(range(n)), []
    while len(left) > p + 2:
        size = []
        for k in left:
            rest = [j for j in left if j != k]
            x = np.linalg.lstsq(X[rest], noise[rest], rcond=None)[0]
            variance = np.sum((noise[rest] - X[rest] @ x) ** 2) / (len(rest) - p)
            spread = 1.0 + X[k] @ np.linalg.inv(X[rest].T @ X[rest]) @ X[k]
            size.append(abs(noise[k] - X[k] @ x) / np.sqrt(variance * spread))
        worst = int(np.argmax(size))
        chance = 2.0 * len(left) * student.sf(size[worst], len(left) - p - 1)
        if chance > limits.OUTLIER_PROBABILITY:
            break
        gone.append(left.pop(worst))
    assert [int(r.accel_var[1]) for r in out] == gone
    assert [int(r.accel_var[1]) for r in kept] == left
    assert bool(gone) == (shift >= 30.0) or shift in (4.0, 8.0)


def test_rests_are_taken_at_the_limit_that_leaves_the_narrowest_intervals(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The gyro's own limit counts its zero besides; where no limit tells, a middle one is taken."""
    count = len(limits.THRESHOLDS)
    widths = {k: np.full(3, 1.0 + abs(k - 5)) for k in range(count)}
    biases = {k: np.full(3, 3.0 * abs(k - 7)) for k in range(count)}

    def below(logs: Any, movements: Any, limit: float) -> list[int]:
        return [limits.THRESHOLDS.index(limit)] * 2

    monkeypatch.setattr(rest_search, "movement", lambda log: log)
    monkeypatch.setattr(rest_search, "rests_below", below)
    monkeypatch.setattr(rest_search, "_log_widths", lambda r, g, n: widths[r[0]])
    monkeypatch.setattr(rest_search, "_log_bias", lambda r: biases[r[0]])
    monkeypatch.setattr(rest_search, "_without_outliers", lambda r, g, n: (r, []))
    monkeypatch.setattr(rest_search, "_moved", lambda m, r: 1.0)
    found: Any = rest_search.find_rests([], GRAVITY, 9)
    assert (found.rests[0], found.gyro_rests[0], found.determined) == (5, 7, True)
    assert (found.limit, found.gyro_limit) == (limits.THRESHOLDS[5], limits.THRESHOLDS[7])
    assert found.tried == tuple((limit, 2) for limit in limits.THRESHOLDS)
    widths = {k: np.full(3, np.inf) for k in range(count)}
    none: Any = rest_search.find_rests([], GRAVITY, 9)
    assert not none.determined
    assert none.limit == none.gyro_limit == limits.THRESHOLDS[count // 2]
    assert none.rests[0] == count // 2


def test_a_zero_is_as_sure_as_the_mean_of_its_rests() -> None:
    gyro = np.random.default_rng(6).normal(size=(9, 3)) * [1.0, 2.0, 5.0]
    rests: Any = [SimpleNamespace(gyro=g) for g in gyro]
    wanted = np.sqrt(np.mean((gyro - gyro.mean(axis=0)) ** 2, axis=0) / 9.0)
    assert np.exp(rest_search._log_bias(rests)) == pytest.approx(wanted)
    assert np.isinf(rest_search._log_bias(rests[:1])).all()
    assert (rest_search.least_poses(6), rest_search.least_poses(9)) == (6, 10)


@pytest.mark.parametrize("n", [N_SIX, N_NINE])
def test_intervals_are_those_of_scales_and_angles_by_their_size(
    n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    u = directions(np.random.default_rng(7), 20)
    rests: Any = [SimpleNamespace(accel=v, accel_var=np.ones(3)) for v in u]
    fit = SimpleNamespace(half_width=np.arange(1.0, 10.0), scale=np.array([2.0, -4.0, 8.0]))
    monkeypatch.setattr(rest_search, "fit_accelerometer", lambda *_: fit)
    monkeypatch.setattr(rest_search, "directions_of", lambda f, m: m)
    found = np.exp(rest_search._log_widths(rests, GRAVITY, n))
    assert found == pytest.approx([0.5, 0.5, 0.375, 7.0, 8.0, 9.0][: n - 3])
    assert np.isinf(rest_search._log_widths(rests[: rest_search.least_poses(n) - 1], 9.8, n)).all()
    plane: Any = [SimpleNamespace(accel=v * [1, 1, 0], accel_var=v) for v in u]
    assert np.isinf(rest_search._log_widths(plane, GRAVITY, n)).all()


def test_the_pose_that_helps_most_is_that_of_the_largest_determinant() -> None:
    """One pose after the other by the determinant itself, over all 26, until they will do."""
    have = np.vstack([np.eye(3), -np.eye(3)[:2]])
    n = N_NINE
    grid = np.array([v for v in itertools.product((0, 1, -1), repeat=3) if any(v)], float)
    rows = _design(grid / np.linalg.norm(grid, axis=1)[:, None], n)
    design = _design(have, n)
    information = 1e-6 * np.eye(n) + design.T @ design
    found = helpful_poses(have, n)
    assert 4 <= len(found) <= 12
    names = [pose_name(g) for g in grid]
    for k, name in enumerate(found):
        gain = [np.linalg.slogdet(information + np.outer(r, r))[1] for r in rows]
        chosen = names.index(name)
        assert gain[chosen] == pytest.approx(max(gain), abs=2e-3)
        # until the last it will not do
        assert determination(have, n) < limits.HELPED_SINGULAR, k
        information += np.outer(rows[chosen], rows[chosen])
        have = np.vstack([have, grid[chosen] / np.linalg.norm(grid[chosen])])
    assert determination(have, n) >= limits.HELPED_SINGULAR
    values = np.linalg.eigvalsh(_design(have, n).T @ _design(have, n) / len(have))
    assert determination(have, n) == pytest.approx(np.sqrt(values[0]))
    assert determination(have[: n - 1], n) == 0.0


def test_the_noise_of_a_log_at_rest_is_that_of_its_white_noise() -> None:
    rng = np.random.default_rng(12)
    density = np.array([0.02, 0.03, 0.01, 1e-3, 2e-3, 3e-3])
    rate_hz, n = 100.0, 3000
    noise = density * np.sqrt(rate_hz) * rng.normal(size=(n, 6))
    log = RawImu(np.arange(n) * 10_000_000, noise[:, 3:], noise[:, :3] + [0.0, 0.0, GRAVITY])
    # a thousand independent values and more
    np.testing.assert_allclose(noise_density(log, limits.STILL_LIMIT), density, rtol=0.15)


def test_rests_end_where_movement_begins_and_where_readings_are_missing() -> None:
    rng = np.random.default_rng(13)
    n, step = 1000, 20_000_000
    t_ns = np.arange(n) * step
    t_ns[700:] += round(1.01 * (limits.REST_HOLE_STEPS - 1.0) * step)
    accel = rng.normal(size=(n, 3))
    accel[:300] += 50.0
    accel[700:] += 1.0
    moved = np.zeros(n)
    moved[[300, 990]] = 5.0
    log = RawImu(t_ns, rng.normal(size=(n, 3)), accel)
    found = rests_below([log, log], [moved, moved + 5.0], 5.0)
    # other poses, apart by a sample that moves or comes after a hole; a rest of 0.2 s is none
    assert [(r.log, r.start, r.stop) for r in found] == [(0, 0, 300), (0, 301, 700), (0, 701, 990)]
    for r in found:
        assert r.accel == pytest.approx(accel[r.start : r.stop].mean(axis=0))
    # the variances of all are raised by what their batches show in the mean
    white = np.array(
        [accel[r.start : r.stop].var(axis=0, ddof=1) / (r.stop - r.start) for r in found]
    )
    batch = np.array([r.accel_batch_var for r in found])
    factor = np.maximum(batch.sum(axis=0) / white.sum(axis=0), 1.0)
    np.testing.assert_allclose([r.accel_var for r in found], white * factor)
