"""Kernels against the same thing computed another way: dense matrices, integrals, enumeration."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import beta

from automap.calibration.plausible import _refuse
from automap.earth import from_local_ned
from automap.errors import InputError
from automap.fusion.doubts.path import Misses, contradicted
from automap.fusion.limits import ROAD_ACCELERATION_PSD
from automap.fusion.steady_readings import steady
from automap.fusion.wheel_limits import WHEELS_GAP_S
from automap.fusion.wheel_match import between
from automap.geolocation.bearing_rays import in_plane
from automap.geolocation.bearings import BearingRules
from automap.mapping.existence import Chances, DetectionRates, existence, still_there
from automap.mapping.limits import (
    CHANGE_PER_YEAR,
    FALSE_BETA,
    LASTING,
    LEAST_CHANGE,
    REAL_PRIOR,
    STRAY,
)
from automap.mapping.path_errors import Equations, Network
from automap.records import Bearings, FloatArray
from automap.sync import limits
from automap.sync.coarse import _correlation
from automap.sync.receiver_path import Windows, plausible_sd, receiver_path, velocity_sd
from tests.slow_cases import others_slow
from tests.unit.receiver_scene import Receiver, simulated_fixes


def counted(rates: tuple[float, float], hits: float, misses: float) -> float:
    """How likely a series of hits and misses is by a rate of this beta distribution."""
    return float(quad(lambda r: r**hits * (1.0 - r) ** misses * beta.pdf(r, *rates), 0.0, 1.0)[0])


@pytest.mark.parametrize("series", ["11", "10", "01", "1101", "0011", "1100", "010010"])
@pytest.mark.parametrize("years", others_slow([0.02, 0.0, 1.5]))
def test_existence_is_the_sum_over_all_histories(series: str, years: float) -> None:
    """Each way in which it stands for some drives and not for others; rates integrated, not by
    their closed form. The second drive that saw it is surer than the first."""
    n = len(series)
    seen = np.array([c == "1" for c in series])
    by_drive = np.linspace(0.5, 0.9, n)
    rates = DetectionRates(0.8, by_drive, 0.7, 6.0)
    weight = np.where(seen, 0.0, np.minimum(np.log(1.0 - by_drive) / np.log(0.2), 1.0))
    step_s = years * 365.25 * 86400.0
    times = 1.4e9 + step_s * np.arange(n)
    change = max(LEAST_CHANGE, 1.0 - np.exp(-CHANGE_PER_YEAR * years))
    own = (6.0 * 0.8, 6.0 * 0.2)

    told = np.full(n, np.nan)
    told[np.flatnonzero(seen)[:2]] = [0.9, 0.97][: int(seen.sum())]
    before = (np.nansum(told) + REAL_PRIOR[0]) / (np.isfinite(told).sum() + sum(REAL_PRIOR))
    ratio = told / (1.0 - told) * (1.0 - before) / before
    # what it looks like is that of all drives; a stray one looks like what is no sign
    looks = float(np.nanmean(ratio))
    stray = np.where(seen, STRAY / np.nan_to_num(ratio, nan=1.0), (1.0 - STRAY) ** weight)

    total = {True: 0.0, False: 0.0}
    for history in product([True, False], repeat=n):
        stands = np.array(history)
        if stands.any():
            turns = int((stands[1:] != stands[:-1]).sum())
            likely = change**turns * (1.0 - change) ** (n - 1 - turns)
            likely *= counted(own, float(seen[stands].sum()), float(weight[stands].sum()))
            total[history[-1]] += likely * float(np.prod(stray[~stands]))
    sign = sum(total.values())
    # the first that saw it is why it is known, sign or not
    once = counted(own, 1.0, 0.0)
    fleeting = counted(FALSE_BETA, float(seen.sum()) - 1.0, float(weight.sum())) * once
    false = LASTING * sign + (1.0 - LASTING) * fleeting
    expected = 0.7 * looks * total[True] / (0.7 * looks * sign + 0.3 * false)
    # a second sign behind it, seen once by a drive that does not tell
    pairs = Chances(
        np.append(np.zeros(n, np.int64), 1),
        np.append(np.arange(n), 0),
        np.append(seen, True),
        np.append(told, np.nan),
    )
    found = existence(pairs, rates, 3, times)
    assert found[0] == pytest.approx(expected, rel=1e-5)
    assert found[1:] == pytest.approx([0.7, 0.7])


def test_a_sign_that_further_drives_miss_is_there_by_bayes() -> None:
    rates = DetectionRates(0.8, np.array([0.8]), 0.7, 6.0)
    belief, hits = np.array([0.9, 0.3, 0.8]), np.array([3.0, 1.0, 2.0])
    sign, weight = np.array([0, 0, 1]), np.array([1.0, 0.4, 0.7])
    found = still_there(sign, weight, rates, belief, hits)
    for k, misses in enumerate([1.4, 0.7, 0.0]):
        start = max(belief[k], 0.5)
        # a rate of which the hits have told already
        kept = counted((4.8 + hits[k], 1.2), 0.0, misses)
        assert found[k] == pytest.approx(start * kept / (start * kept + 1.0 - start), rel=1e-6)


@pytest.mark.parametrize("surveyed", [False, True])
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_errors_of_paths_are_the_conditional_mean_of_all_unknowns_at_once(
    axes: int, surveyed: bool
) -> None:
    """Places and the paths' errors as unknowns of one dense problem, with what each sighting errs
    by itself correlated between the axes; a surveyed place is seen from a path without errors."""
    rng = np.random.default_rng(axes)
    first, sign = np.array([0, 4, 7, 9]), np.array([0, 1, 2, 0, 1, 2, 2, 0, 1])
    n, m = len(sign), 3
    time_s = np.array([0.0, 5.0, 21.0, 60.0, 3.0, 9.0, 50.0, 1.0, 2.5])
    root = rng.normal(0.0, 0.4, (n, axes, axes))
    own = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(axes)
    shared = rng.uniform(0.3, 0.9, (n, axes))
    measured = rng.normal(0.0, 2.0, (n, axes))
    if surveyed:
        shared[-2:] = 0.0
    weight = rng.uniform(0.3, 1.0, n)
    tau = 20.0
    step = np.diff(time_s, prepend=np.inf)
    alike = np.where(step < 0.0, 0.0, np.exp(-np.abs(step) / tau))
    drive = np.repeat(np.arange(3), np.diff(first))
    # what wanders along a drive, and what lasts all of it
    node, sd = np.column_stack([np.arange(n), n + drive]), np.stack([0.8 * shared, 0.6 * shared], 1)
    alike = np.append(alike, np.zeros(3))
    network = Network(alike, node, sign, sd, measured, np.linalg.inv(own))
    found = Equations(network).solve(weight)

    keep = np.exp(-np.abs(time_s[:, None] - time_s) / tau) * (drive[:, None] == drive)
    prior, noise = np.eye(axes * (n + 3)), np.zeros((axes * n, axes * n))
    prior[: axes * n, : axes * n] = np.kron(keep, np.eye(axes))
    design, along = np.zeros((axes * n, axes * m)), np.kron(np.eye(3)[drive], np.eye(axes))
    effect = np.hstack([np.diag(sd[:, 0].ravel()), sd[:, 1].ravel()[:, None] * along])
    for i in range(n):
        rows = slice(axes * i, axes * i + axes)
        noise[rows, rows] = own[i] / weight[i]
        design[rows, axes * sign[i] : axes * sign[i] + axes] = np.eye(axes)
    z = measured.ravel()
    # unknowns: places without a prior, errors with one
    both = np.hstack([design, effect])
    information = both.T @ np.linalg.solve(noise, both)
    information[axes * m :, axes * m :] += np.linalg.inv(prior)
    joint = np.linalg.inv(information)
    solved = joint @ both.T @ np.linalg.solve(noise, z)
    np.testing.assert_allclose(found.place.ravel(), solved[: axes * m], atol=1e-9)
    np.testing.assert_allclose(found.error.ravel(), solved[axes * m :], atol=1e-9)
    errors = joint[axes * m :, axes * m :]
    each = np.arange(found.error.size)
    np.testing.assert_allclose(found.factor.inverse_at(each, each), np.diag(errors), atol=1e-9)
    if axes < 3:
        for k, covariance in enumerate(found.place_variances(m)):
            at = slice(axes * k, axes * k + axes)
            np.testing.assert_allclose(covariance, joint[at, at], atol=1e-9)
    miss = z - both @ np.concatenate([solved[: axes * m], solved[axes * m :]])
    square = [r @ np.linalg.solve(c, r) for r, c in zip(miss.reshape(n, axes), own, strict=True)]
    np.testing.assert_allclose(found.square, square, atol=1e-9)
    for d in range(3):
        for a in range(axes):
            pick = np.zeros(axes * (n + 3))
            pick[axes * np.flatnonzero(drive == d) + a] = 1.0 / (drive == d).sum()
            index = np.where(pick > 0, np.arange(len(pick)), -1)
            assert found.factor.variances_of(index, pick) == pytest.approx(pick @ errors @ pick)


def test_correlation_of_series_with_holes_is_that_of_the_pairs_they_have() -> None:
    rng = np.random.default_rng(3)
    b = rng.normal(0.4, 1.0, 90)
    a = 0.7 * np.concatenate([rng.normal(size=20), b, rng.normal(size=20)]) + 2.0
    a += 0.5 * rng.normal(size=len(a))
    a[15:22], b[40:47] = np.nan, np.nan
    size = 256
    r, count = _correlation(a, b, size)
    for shift in (*range(-65, 106, 5), 20):
        pairs = [
            (a[k + shift], b[k])
            for k in range(len(b))
            if 0 <= k + shift < len(a) and np.isfinite(a[k + shift] + b[k])
        ]
        assert count[shift % size] == len(pairs)
        if len(pairs) >= 25:
            assert r[shift % size] == pytest.approx(np.corrcoef(np.array(pairs).T)[0, 1], abs=1e-9)
        else:
            assert r[shift % size] == 0.0
    assert int(np.argmax(r)) == 20


def test_what_two_paths_may_part_by_is_the_integral_of_its_errors() -> None:
    """An error of velocities that lasts for seconds, integrated twice over its autocovariance; the
    change of velocity times a delay; noise and wander of the positions at both ends."""
    fixes = simulated_fixes(2, Receiver(rate_hz=2.0), 60.0)
    path = receiver_path(fixes)
    over = Windows(np.array([0, 10, 40]), np.array([1, 30, 100]))
    tau, sd = limits.VELOCITY_ERROR_TAU_S, limits.VELOCITY_ERROR_SD
    expected = []
    for first, last in zip(over.first, over.last, strict=True):
        t = path.t[last] - path.t[first]
        x = (np.arange(2000) + 0.5) * t / 2000
        lasting = sd**2 * np.exp(-np.abs(x[:, None] - x) / tau).mean() * t**2
        change = path.velocity[last] - path.velocity[first]
        expected.append(lasting + (limits.DELAY_SD_S * abs(change)) ** 2)
    np.testing.assert_allclose(velocity_sd(path, over) ** 2, expected, rtol=1e-4)
    t = path.t[over.last] - path.t[over.first]
    wander: FloatArray = np.maximum(
        limits.WANDER_SD_M, np.maximum(path.sd[over.first], path.sd[over.last])
    )
    # of both ends, less what the wander has in common
    ends = 2.0 * (limits.POSITION_NOISE_M**2 + wander**2 * (1.0 - np.exp(-t / limits.WANDER_TAU_S)))
    np.testing.assert_allclose(plausible_sd(path, over) ** 2, ends + expected, rtol=1e-4)


def test_a_figure_of_the_height_is_none_of_a_place() -> None:
    fixes = simulated_fixes(2, Receiver(rate_hz=2.0), 20.0)
    fixes.sd_pos_ned[:] = 1.0, 2.0, 9.0
    assert (receiver_path(fixes).sd == 2.0).all()


def test_three_fixes_make_a_stretch_and_two_make_none() -> None:
    """Three that are 5 m off by 0.5 m are off together, of two nothing is said."""

    for count in (2, 3):
        miss, var = np.tile([3.0, 4.0, 0.0], (count, 1)), np.full((count, 3), 0.25)
        off = contradicted(Misses(np.arange(float(count)), miss, var, 0.0 * var), 60.0)
        assert off.tolist() == [count == 3] * count


def test_sightings_a_few_millimetres_apart_are_of_one_camera() -> None:
    origin = (0.6, 2.5, 0.0)
    north = np.array([10.001, 10.003, 10.3, 25.0])
    lat, _, _ = from_local_ned(np.column_stack([north, np.zeros((4, 2))]), origin)
    n = len(lat)
    told = Bearings(
        lat, np.full(n, 2.5), np.zeros(n), np.array([5.0, np.nan, -1.0, 7.0]),
        np.full(n, "lamp", np.object_), np.array([0.01, np.nan, 0.02, 0.03]),
    )  # fmt: skip
    rays = in_plane(told, BearingRules(bearing_sd_rad=0.5), origin)
    assert rays.camera[0] == rays.camera[1]
    assert len(np.unique(rays.camera)) == 3
    assert rays.sd == pytest.approx([0.01, 0.5, 0.02, 0.03])
    assert rays.log_depth == pytest.approx([np.log(5.0), np.nan, np.nan, np.log(7.0)], nan_ok=True)


@pytest.mark.parametrize(
    ("unit", "ratio", "advice"),
    [
        ("rad/s", np.pi / 180.0, "it fits deg/s, so say --gyro-unit deg/s"),
        ("deg/s", 180.0 / np.pi, "it fits rad/s"),
        ("deg/s", 0.2, "correct --gyro-unit"),
        ("counts", 2.02, r"they fit 2 times the range.*counts_per_unit 0\.5 times"),
        ("counts", 0.124, r"they fit 0\.125 times the range.*counts_per_unit 8 times"),
        ("counts", 3e-4, "name the right data sheet with --sensor"),
    ],
)
def test_readings_in_another_unit_are_refused_with_the_one_that_fits(
    unit: str, ratio: float, advice: str
) -> None:
    others = (("deg/s", np.pi / 180.0), ("rad/s", 180.0 / np.pi))
    with pytest.raises(InputError, match=advice):
        _refuse("log", "gyro", "--gyro-unit", unit, ratio * np.array([0.1, 1.0, 10.0]), others)
    _refuse("log", "gyro", "--gyro-unit", unit, np.array([0.01, 1.01, 50.0]), others)


def test_a_speed_between_two_readings_is_that_of_the_line_and_a_brownian_bridge() -> None:
    rng = np.random.default_rng(2)
    t, speed = np.cumsum(rng.uniform(0.05, 0.4, 30)), rng.uniform(0.0, 20.0, 30)
    t[20:] += 2.0 * WHEELS_GAP_S
    at = np.concatenate([rng.uniform(t[0], t[-1], 60), t[:3], [t[0] - 0.1, t[-1] + 0.1]])
    found, var, near = between(t, speed, at)
    inside = (at >= t[0]) & (at <= t[-1])
    np.testing.assert_allclose(found, np.interp(at, t, speed))
    right = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    before, after = at - t[right - 1], t[right] - at
    q = ROAD_ACCELERATION_PSD[0]
    # of a path that is fixed at both ends
    expected = np.where(inside, q * before * after / (before + after), 0.0)
    np.testing.assert_allclose(var, expected, atol=1e-12)
    np.testing.assert_array_equal(near, inside & ~((at > t[19]) & (at < t[20])))


def test_a_rate_is_calmed_but_where_its_window_has_a_gap() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 60.0, 0.01)
    rate = 0.3 * np.sin(0.5 * t)[:, None] + rng.normal(0.0, 0.01, (len(t), 3))
    t[2500:] += 5.0
    out = steady(t, rate)
    changed = np.flatnonzero((out != rate).any(axis=1))
    half = int(changed[0])
    assert half > 50
    rows = np.arange(len(t))
    # whole windows alone, at the ends and on both sides of the gap
    expected = (
        (rows >= half) & (rows < len(t) - half) & ~((rows >= 2500 - half) & (rows < 2500 + half))
    )
    np.testing.assert_array_equal(changed, np.flatnonzero(expected))
