"""Each reason to doubt a path is given where it holds, and where nothing is wrong none is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion import limits
from automap.fusion.doubts.estimates import impossible_ages, impossible_errors, levels_at_bound
from automap.fusion.doubts.outcome import refused, unsure_path, weak_heading
from automap.fusion.doubts.path import Misses, contradicted, local_error, spans_of
from automap.fusion.doubts.reason import Reason, verdict_of
from automap.fusion.output import Innovations
from automap.fusion.verdict import widen
from automap.records import FloatArray, Trajectory

TAU_S = 60.0


def slow_and_white(seconds: int, slow: float, white: float, seed: int) -> FloatArray:
    """Errors [n, 3] of fixes once a second: first-order Gauss-Markov and white."""
    rng = np.random.default_rng(seed)
    keep = np.exp(-1.0 / TAU_S)
    drive = rng.standard_normal((seconds, 3)) * np.sqrt(1.0 - keep**2)
    drive[0] /= np.sqrt(1.0 - keep**2)
    for i in range(1, seconds):
        drive[i] += keep * drive[i - 1]
    return np.asarray(slow * drive + white * rng.standard_normal((seconds, 3)))


def misses_of(miss: FloatArray, path: float = 0.3, slow: float = 1.5, white: float = 0.5) -> Misses:
    like = np.ones_like(miss)
    t = np.arange(float(len(miss)))
    return Misses(t, miss, path**2 * like, white**2 * like, slow**2 * like)


def straight_path(seconds: int = 600, sd_m: float = 0.5) -> Trajectory:
    n = seconds * 10
    t = 0.1 * np.arange(n)
    zero, three = np.zeros(n), np.zeros((n, 3))
    return Trajectory(
        *(np.rint(t * 1e9).astype(np.int64), 1.4e9 + t, zero, zero, zero, three, three),
        *(np.full((n, 3), sd_m), np.full((n, 3), 0.1), np.full((n, 3), 0.01)),
    )


# the path against the fixes


@pytest.mark.parametrize("seed", range(20))
def test_what_fixes_do_by_themselves_is_no_contradiction(seed: int) -> None:
    miss = slow_and_white(1800, 1.5, 0.5, seed)
    assert not contradicted(misses_of(miss), TAU_S).any()


def test_single_wild_fixes_say_nothing_of_a_stretch() -> None:
    miss = slow_and_white(600, 1.0, 0.5, 1)
    miss[100::60] += 500.0
    assert not contradicted(misses_of(miss), TAU_S).any()


@pytest.mark.parametrize(("length", "offset"), [(20, 18.0), (60, 14.0), (300, 9.0)])
def test_a_stretch_that_is_off_is_found_where_it_is(length: int, offset: float) -> None:
    miss = slow_and_white(900, 1.0, 0.5, 2)
    miss[400 : 400 + length, 0] += offset
    misses = misses_of(miss)
    wrong = contradicted(misses, TAU_S)
    assert wrong[400 : 400 + length].mean() > 0.95
    far = np.abs(np.arange(900) - 400 - 0.5 * length) > 0.5 * length + 60
    assert not wrong[far].any()
    inner = slice(410, 390 + length) if length > 20 else slice(410, 411)
    assert np.abs(local_error(misses)[inner] - offset).max() < 3.5
    ((first, last),) = spans_of(misses.t, wrong)
    assert first < 410
    assert last > 390 + length


def test_a_small_error_that_never_ends_is_found() -> None:
    miss = slow_and_white(3600, 1.0, 0.5, 3)
    assert not contradicted(misses_of(miss, slow=1.0), TAU_S).any()
    assert contradicted(misses_of(miss + 2.4, slow=1.0), TAU_S).all()


# estimates


def test_fixes_from_the_future_cannot_be() -> None:
    late = {"imu_time_offset_s": (0.6, 0.02), "gnss_velocity_latency_s": (-0.5, 0.02)}
    assert [r.code for r in impossible_ages(late, True)] == ["negative_delay"] * 2
    assert [r.code for r in impossible_ages(late, False)] == ["negative_delay"]
    for fine in (
        {"imu_time_offset_s": (0.14, 0.001), "gnss_velocity_latency_s": (-0.14, 0.001)},
        {"imu_time_offset_s": (0.6, 0.3), "gnss_velocity_latency_s": (-0.4, 0.2)},
        {"imu_time_offset_s": (-0.4, 0.01), "gnss_velocity_latency_s": (0.6, 0.01)},
    ):
        assert impossible_ages(fine, True) == []


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("imu_time_offset_s", -1.0),
        ("gnss_latency_s", 1.0),
        ("gnss_velocity_latency_s", 1.0),
        ("imu_clock_skew_skew", 0.01),
    ],
)
def test_a_delay_that_ran_to_its_bound_is_told(name: str, value: float) -> None:
    assert [r.code for r in impossible_ages({name: (value, 0.01)}, False)] == ["delay_at_bound"]
    assert impossible_ages({name: (0.8 * value, 0.01)}, False) == []


def test_errors_that_no_sensor_has_are_told() -> None:
    found = {f"accel_scale_{a}": (v, 0.01) for a, v in zip("xyz", (0.03, -0.29, 0.0), strict=True)}
    (reason,) = impossible_errors(found | {"gyro_bias_x": (0.02, 1e-4)})
    assert reason.code == "sensor_error"
    assert "axis y, would be 0.29" in reason.text
    assert impossible_errors({"accel_scale_x": (0.06, 0.01), "gyro_bias_x": (0.3, 0.01)}) == []


def test_noise_as_large_as_may_be_is_told() -> None:
    factors = {"accel": 16.0, "gyro": 0.0625, "velocity_h": 8.0}
    (reason,) = levels_at_bound(factors, tuned=False)
    assert "the noise of the accelerometer is 16 times" in reason.text
    assert levels_at_bound(factors, tuned=True) == []


# what the filter says


def test_a_heading_that_might_be_another_is_told() -> None:
    assert "1.2 nats" in weak_heading(1.2)[0].text
    assert weak_heading(limits.SURE_MARGIN_NATS) == []
    assert weak_heading(np.inf) == []


def test_kinds_that_were_refused_are_told_each_by_itself() -> None:
    n = 200
    names = np.repeat(np.array(["position_n", "velocity_e", "nhc_y", "odometer"], object), n)
    accepted = np.ones(4 * n, np.bool_)
    accepted[n : n + 60] = accepted[2 * n : 2 * n + 30] = accepted[3 * n : 3 * n + 150] = False
    one = np.ones(4 * n)
    table = Innovations(np.arange(4 * n), names, one, one, one, accepted)
    reasons = refused(table)
    assert [r.code for r in reasons] == ["velocity_refused", "odometer_refused"]
    assert reasons[0].text.startswith("30% of the velocities")


def test_a_path_of_no_use_is_unusable() -> None:
    assert unsure_path(straight_path(60, 5.0)) == []
    verdict = verdict_of([Reason("a", "b"), *unsure_path(straight_path(60, 50.0))])
    assert verdict.state == "unusable"
    assert [r.code for r in verdict.reasons] == ["path_unsure", "a"]
    assert verdict_of([]).state == "good"


# sigmas


def test_sigmas_grow_where_the_contradiction_is() -> None:
    path = straight_path(600, 0.5)
    miss = np.zeros((600, 3))
    miss[200:260, 1] = 12.0
    misses = misses_of(miss)
    wide = widen(path, [Reason("off", "", ((200.0, 260.0),))], misses, None)
    inside = slice(2150, 2450)
    assert np.hypot(*wide.sd_pos_ned[inside, :2].T) == pytest.approx(12.0, rel=0.01)
    outside = np.r_[0:1900, 2700:6000]
    assert np.array_equal(wide.sd_pos_ned[outside], path.sd_pos_ned[outside])
    assert widen(path, [], misses, None) is path


def test_a_factor_widens_all_and_a_known_error_is_held() -> None:
    path = straight_path(100, 0.5)
    none = misses_of(np.zeros((0, 3)))
    wide = widen(path, [Reason("a", "", factor=3.0)], none, None)
    assert np.allclose(wide.sd_pos_ned, 1.5)
    assert np.allclose(wide.sd_rpy, 0.03)
    wide = widen(path, [Reason("a", "", ((10.0, 20.0),), error_m=30.0)], none, None)
    assert np.hypot(*wide.sd_pos_ned[150, :2]) == pytest.approx(30.0, rel=0.01)
    assert np.hypot(*wide.sd_pos_ned[350, :2]) == pytest.approx(0.5 * np.sqrt(2.0))


def test_the_path_of_the_fixes_alone_counts_where_there_is_doubt() -> None:
    path = straight_path(100, 0.5)
    alone = replace(path, lat_rad=path.lat_rad + 40.0 / 6.378e6)
    none = misses_of(np.zeros((0, 3)))
    wide = widen(path, [Reason("a", "")], none, alone)
    assert np.hypot(*wide.sd_pos_ned[500, :2]) == pytest.approx(40.0, rel=0.02)
