"""Kernels of the fusion against the same computed another way: dense matrices, cubics, SciPy."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from automap.fusion import limits
from automap.fusion.alignment import level
from automap.fusion.engine import _turn
from automap.fusion.kernel_runs import PathStates
from automap.fusion.kernels.axis import smooth_axis
from automap.fusion.kernels.resample import interpolate_states
from automap.fusion.kernels.transition import reach
from automap.fusion.layout import HAS_POS_H, HAS_POS_V, N_NAV
from automap.fusion.measurements.position import age_sd_of
from automap.fusion.mechanisation import radii, rotate_left, rotate_right
from automap.fusion.mounting import Mounting
from automap.fusion.options import FusionOptions
from automap.fusion.passes import Session
from automap.fusion.relinearise import _largest_turn
from automap.fusion.standstill import _rolling_sd
from automap.records import ClockModel, FixType, FloatArray, ImuData

TAU = (9.0, 3.0)
PSD = 0.7


def transition(dt: float) -> tuple[FloatArray, FloatArray]:
    """Transition and covariance of the noise over ``dt`` s: a white acceleration, and errors of a
    sigma of one that are forgotten."""
    F = np.diag([1.0, 1.0, np.exp(-dt / TAU[0]), np.exp(-dt / TAU[1])])
    F[0, 1] = dt
    Q = np.diag([PSD * dt**3 / 3.0, PSD * dt, 1.0 - F[2, 2] ** 2, 1.0 - F[3, 3] ** 2])
    Q[0, 1] = Q[1, 0] = 0.5 * PSD * dt**2
    return F, Q


def test_the_smoother_of_an_axis_is_the_conditional_mean_of_all_states_at_once() -> None:
    rng = np.random.default_rng(5)
    n = 12
    t = np.cumsum(rng.uniform(0.2, 3.0, n))
    z = rng.normal(0.0, [30.0, 4.0], (n, 2))
    used = rng.random((n, 2)) < 0.7
    used[0], used[4], used[-1] = (True, False), False, (False, True)
    var, lasting = rng.uniform(0.5, 6.0, (n, 2)), rng.uniform(0.3, 3.0, (n, 2))
    out = np.zeros((n, 4))
    smooth_axis(t, z, used, var, lasting, PSD, TAU, 1e12, out)

    # all states in one vector: their covariance before any fix, then one Gaussian conditioning
    prior = np.zeros((4 * n, 4 * n))
    mean = np.zeros(4 * n)
    mean[0] = z[0, 0]
    prior[:4, :4] = np.diag([100.0**2, 30.0**2, 1.0, 1.0])
    for k in range(1, n):
        F, Q = transition(t[k] - t[k - 1])
        a, b = slice(4 * k - 4, 4 * k), slice(4 * k, 4 * k + 4)
        mean[b] = F @ mean[a]
        prior[b, : 4 * k] = F @ prior[a, : 4 * k]
        prior[: 4 * k, b] = prior[b, : 4 * k].T
        prior[b, b] = F @ prior[a, a] @ F.T + Q
    rows = [(k, m) for k in range(n) for m in range(2) if used[k, m]]
    H = np.zeros((len(rows), 4 * n))
    for row, (k, m) in enumerate(rows):
        H[row, 4 * k + m], H[row, 4 * k + 2 + m] = 1.0, lasting[k, m]
    R = np.diag([var[k, m] for k, m in rows])
    gain = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + R)
    mean = mean + gain @ (np.array([z[k, m] for k, m in rows]) - H @ mean)
    cov = prior - gain @ H @ prior
    sd = np.sqrt(np.diag(cov)).reshape(n, 4)
    np.testing.assert_allclose(out[:, :2], mean.reshape(n, 4)[:, :2], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(out[:, 2:], sd[:, :2], rtol=1e-6)


@pytest.mark.parametrize("wild", [10.0, 4000.0])
def test_a_fix_beyond_the_limit_counts_as_one_at_the_limit(wild: float) -> None:
    """One velocity alone: prior 30 m/s, noise 2 m/s, lasting error 3 m/s."""
    limit = 9.0
    out = np.zeros((1, 4))
    used, z = np.array([[False, True]]), np.array([[0.0, wild]])
    smooth_axis(
        np.zeros(1), z, used, np.full((1, 2), 4.0), np.full((1, 2), 3.0), PSD, TAU, limit, out
    )
    variance = max(30.0**2 + 9.0 + 4.0, wild**2 / limit)
    assert out[0, 1] == pytest.approx(30.0**2 * wild / variance)
    assert out[0, 3] == pytest.approx(np.sqrt(30.0**2 - 30.0**4 / variance))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 5e-3, 0.0101, 0.4, 3.0])
def test_turns_of_quaternions_are_scipys(angle: float) -> None:
    rng = np.random.default_rng(2)
    for _ in range(5):
        vector = rng.normal(size=3)
        vector *= angle / np.linalg.norm(vector)
        first = Rotation.random(random_state=rng)
        turn = Rotation.from_rotvec(vector)
        for function, wanted in ((rotate_left, turn * first), (rotate_right, first * turn)):
            q = first.as_quat(scalar_first=True)
            function(q, *vector)
            found = Rotation.from_quat(q, scalar_first=True)
            assert (found * wanted.inv()).magnitude() < 1e-12
            assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-12)


def states_of(t: FloatArray, lon_0: float) -> FloatArray:
    """States [n, 10] of a motion that is a cubic of time in every axis, with a turning body."""
    lat, speed = 0.8, np.array([[8.0, 0.5, -0.04], [-12.0, 0.7, 0.05], [0.5, -0.1, 0.02]])
    way = speed @ np.array([t, t**2 / 2.0, t**3 / 3.0])
    velocity = speed @ np.array([np.ones_like(t), t, t**2])
    rm, rn = radii(lat)
    out = np.zeros((len(t), 10))
    out[:, 0] = lat + way[0] / rm
    out[:, 1] = lon_0 + way[1] / (rn * np.cos(lat))
    out[:, 1] = (out[:, 1] + np.pi) % (2.0 * np.pi) - np.pi
    out[:, 2] = -way[2]
    out[:, 3:6] = velocity.T
    turned = Rotation.from_rotvec(np.outer(t, [0.02, -0.03, 0.3]))
    out[:, 6:] = turned.as_quat(scalar_first=True)
    # a quaternion and its negative are one attitude
    out[1::2, 6:] *= -1.0
    return out


@pytest.mark.parametrize("lon_0", [0.3, np.pi - 3e-6, -np.pi + 2e-6])
def test_states_between_nodes_are_those_of_the_cubic_through_them(lon_0: float) -> None:
    """Also over the date line. Within the cubic only velocity (bent) and attitude (by the chord)
    are approximate, by as much as the step allows."""
    t = np.array([0.0, 0.5, 1.3, 2.0, 3.1])
    want = np.array([0.0, 0.2, 0.5, 0.77, 1.3, 2.6, 3.0, 3.1])
    out = np.zeros((len(want), 10))
    interpolate_states(t, states_of(t, lon_0), want, out)
    true = states_of(want, lon_0)
    rm, rn = radii(0.8)
    apart = out[:, 1] - true[:, 1]
    apart = (apart + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs((out[:, 0] - true[:, 0]) * rm).max() < 1e-3
    assert np.abs(apart * rn * np.cos(0.8)).max() < 1e-3
    assert np.abs(out[:, 2] - true[:, 2]).max() < 1e-6
    # a parabola's sagitta over 1.1 s: second derivative times step squared over eight
    assert np.abs(out[:, 3:6] - true[:, 3:6]).max() < 0.1 * 1.1**2 / 8.0 + 1e-9
    q = Rotation.from_quat(out[:, 6:], scalar_first=True)
    wanted = Rotation.from_quat(true[:, 6:], scalar_first=True)
    assert (q * wanted.inv()).magnitude().max() < 2e-3
    at_nodes = np.isin(want, t)
    np.testing.assert_allclose(out[at_nodes, 2:6], true[at_nodes, 2:6], atol=1e-9)


@pytest.mark.parametrize(("want", "end"), [(-2.0, 0), (5.1, -1)])
def test_beyond_the_ends_the_last_velocity_goes_on(want: float, end: int) -> None:
    t = np.array([0.0, 0.5, 1.3, 2.0, 3.1])
    states, out = states_of(t, 0.3), np.zeros((1, 10))
    interpolate_states(t, states, np.array([want]), out)
    beyond = want - t[end]
    rm, rn = radii(states[end, 0])
    metres = np.array([rm + states[end, 2], (rn + states[end, 2]) * np.cos(states[end, 0]), -1.0])
    wanted = states[end, :3] + states[end, 3:6] * beyond / metres
    # a latitude some metres on has another cosine, by millionths of the way
    assert np.abs((out[0, :3] - wanted) * metres).max() < 1e-3
    np.testing.assert_allclose(out[0, 3:6], states[end, 3:6], atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-7, 0.02, 1.0, 3.1])
def test_the_largest_turn_between_two_paths_is_scipys(angle: float) -> None:
    rng = np.random.default_rng(8)
    first = Rotation.random(20, random_state=rng)
    axis = rng.normal(size=(20, 3))
    axis *= (angle * rng.uniform(0.0, 0.9, 20) / np.linalg.norm(axis, axis=1))[:, None]
    axis[13] *= angle / max(float(np.linalg.norm(axis[13])), 1e-30)
    second = Rotation.from_rotvec(axis) * first
    a, b = np.zeros((2, 20, 10))
    a[:, 6:], b[:, 6:] = first.as_quat(scalar_first=True), second.as_quat(scalar_first=True)
    b[::2, 6:] *= -1.0
    found = _largest_turn(PathStates(a, np.zeros((20, 0))), SimpleNamespace(nominal=b))  # type: ignore[arg-type]
    # a cosine has lost the digits below the root of the last
    assert found == pytest.approx(angle, abs=1e-7)


def test_a_session_in_sensor_axes_is_turned_into_the_vehicles() -> None:
    rng = np.random.default_rng(9)
    c_v_s = Rotation.from_rotvec([0.4, -0.2, 2.0])
    gyro, accel, bias = rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), rng.normal(size=3)
    means = {f"gyro_bias_{a}": float(v) for a, v in zip("xyz", bias, strict=True)} | {"other": 2.0}
    imu = ImuData(np.arange(5), gyro, accel, axes_known=False)
    fixes = SimpleNamespace(flags=np.array([HAS_POS_H, HAS_POS_H | HAS_POS_V]))
    session = Session(imu, fixes, FusionOptions(), [], means, {}, (0.0, 1.0))  # type: ignore[arg-type]
    attitude = Rotation.random(random_state=rng)
    nominal = np.zeros((2, 10))
    nominal[:, :6], nominal[:, 6:] = np.arange(6.0), attitude.as_quat(scalar_first=True)
    last = SimpleNamespace(smooth=SimpleNamespace(nominal=nominal))
    mounting = Mounting(c_v_s.as_matrix(), np.zeros(3), np.zeros(3))
    turned, start = _turn(session, last, mounting)  # type: ignore[arg-type]
    assert turned.imu.axes_known
    np.testing.assert_allclose(turned.imu.gyro, c_v_s.apply(gyro))
    np.testing.assert_allclose(turned.imu.accel, c_v_s.apply(accel))
    assert [turned.means[f"gyro_bias_{a}"] for a in "xyz"] == pytest.approx(c_v_s.apply(bias))
    assert turned.means["other"] == 2.0
    # what the vehicle's axes are in the world: the sensor's, turned back by the mounting
    vehicle = Rotation.from_quat(start.nominal[6:], scalar_first=True)
    assert (vehicle * c_v_s * attitude.inv()).magnitude() < 1e-12
    np.testing.assert_array_equal(start.nominal[:6], np.arange(6.0))
    place, speed = limits.TURNED_START_SD_M, limits.TURNED_START_SPEED_SD
    tilt = limits.START_TILT_SD
    assert start.sd == pytest.approx(
        [place] * 3 + [speed] * 3 + [tilt, tilt, limits.TURNED_HEADING_SD]
    )
    # a height that no fix has told is none for having been smoothed
    level = replace(session, fixes=SimpleNamespace(flags=np.array([HAS_POS_H])))
    height_sd = _turn(level, last, mounting)[1].sd[2]  # type: ignore[arg-type]
    assert height_sd == limits.UNKNOWN_HEIGHT_SD_M
    plain = replace(session, means={"other": 2.0})
    assert _turn(plain, last, mounting)[0].means == {"other": 2.0}  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kinds", "age"),
    [
        ((FixType.THREE_D,) * 4, limits.FIX_AGE_SD_S),
        ((FixType.FIXED, FixType.FLOAT, FixType.FIXED, FixType.THREE_D), 0.0),
        ((FixType.FIXED, FixType.THREE_D, FixType.THREE_D, FixType.NONE), limits.FIX_AGE_SD_S),
        ((FixType.FIXED, FixType.FLOAT, FixType.NONE, FixType.NONE), 0.0),
    ],
)
def test_fixes_by_carrier_phase_are_of_the_instant_of_their_tag(
    kinds: tuple[FixType, ...], age: float
) -> None:
    fixes = SimpleNamespace(fix_type=np.array(kinds))
    for clock_sd, kept in ((0.03, 0.03), (50.0, 1.0)):
        clock = ClockModel(0, 0.0, 0.0, clock_sd, 1e-6, "arrival")
        found = age_sd_of(fixes, clock, FusionOptions())  # type: ignore[arg-type]
        assert found == pytest.approx(np.hypot(age, kept))
        known = FusionOptions(fixed={"gnss_latency": {"s": 0.1}})
        assert age_sd_of(fixes, clock, known) == pytest.approx(kept)  # type: ignore[arg-type]


def test_transition_rows_reach_to_the_last_column_that_is_not_zero() -> None:
    for last in range(N_NAV + 4):
        phi = np.zeros((N_NAV, N_NAV + 4))
        phi[last % N_NAV, last] = -1e-9
        assert reach(phi) == max(last + 1, N_NAV)


@pytest.mark.parametrize(("part", "told"), [(1.0, True), (0.6, True), (0.4, False), (0.0, False)])
def test_levelling_takes_velocities_over_half_of_the_window(part: float, told: bool) -> None:
    """A vehicle askew that gathers speed: the force is its acceleration less gravity, if there is
    any velocity to tell the one."""
    window = limits.LEVELLING_WINDOW_S
    t = 100.0 + np.arange(0.0, window + 1.0, 0.02)
    gained = np.array([1.2, -0.5, 0.0])
    c = Rotation.from_euler("ZYX", [0.3, -0.2, 0.1]).as_matrix()
    force = c.T @ (gained - [0.0, 0.0, 9.8])
    raw = np.column_stack([np.zeros((len(t), 3)), np.tile(force, (len(t), 1))])

    def samples_at(rows: slice) -> SimpleNamespace:
        return SimpleNamespace(t=t[rows], raw=raw[rows])

    problem: Any = SimpleNamespace(t=t, samples_at=samples_at)
    at = np.linspace(100.0, 100.0 + part * window, 12)
    values = np.zeros((12, 6))
    values[:, 3:5] = [7.0, 3.0] + (at - 100.0)[:, None] * gained[:2]
    fixes: Any = SimpleNamespace(t=at, values=values, flags=np.full(12, 4 if part else 0))
    tilt, free = level(problem, fixes, 100.0, np.zeros(3))
    wanted = (gained if told else 0.0) - np.array([0.0, 0.0, 9.8])
    assert free == pytest.approx(wanted / np.linalg.norm(wanted), abs=1e-9)
    assert tilt @ force == pytest.approx(free * np.linalg.norm(force))


def test_the_spread_about_a_reading_is_that_of_the_window_over_all_axes() -> None:
    values = np.random.default_rng(7).normal(5.0, [1.0, 0.2, 3.0], (40, 3))
    found = _rolling_sd(values, 7)
    wanted = [np.sqrt(values[k - 3 : k + 4].var(axis=0).sum()) for k in range(3, 37)]
    assert found[3:37] == pytest.approx(wanted)
