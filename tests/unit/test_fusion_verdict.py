"""Each reason to doubt a path is given where it holds, and where nothing is wrong none is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from automap.fusion import limits
from automap.fusion.doubts.estimates import (
    impossible_ages,
    impossible_errors,
    levels_at_bound,
    unexpected_delay,
)
from automap.fusion.doubts.outcome import refused, unsure_path, weak_heading
from automap.fusion.doubts.path import Misses, contradicted, local_error, spans_of
from automap.fusion.doubts.reason import Reason, verdict_of
from automap.fusion.doubts.receiver import dated_velocities, receiver_doubts
from automap.fusion.options import FusionOptions
from automap.fusion.output import Innovations
from automap.fusion.rest_noise import shaken_levels
from automap.fusion.widening import widen
from automap.records import Fixes, FloatArray, ImuData, Trajectory
from automap.sync.path_match import Estimate, Match
from automap.sync.velocity_findings import Interval, VelocityConsistency
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive

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


def misses_of(miss: FloatArray, slow: float = 1.5, white: float = 0.5) -> Misses:
    like = np.ones_like(miss)
    t = np.arange(float(len(miss)))
    return Misses(t, miss, white**2 * like, slow**2 * like)


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
    assert contradicted(misses_of(miss + 1.2, slow=1.0), TAU_S).all()


# estimates


def test_fixes_from_the_future_cannot_be() -> None:
    late = {"imu_time_offset_s": (0.6, 0.02), "gnss_velocity_latency_s": (-0.5, 0.02)}
    assert [r.code for r in impossible_ages(late, True)] == ["negative_delay"] * 2
    assert [r.code for r in impossible_ages(late, False)] == ["negative_delay"]
    for fine in (
        {"imu_time_offset_s": (0.14, 0.001), "gnss_velocity_latency_s": (-0.14, 0.001)},
        {"imu_time_offset_s": (0.6, 0.3), "gnss_velocity_latency_s": (-0.4, 0.2)},
        {"imu_time_offset_s": (-0.4, 0.01), "gnss_velocity_latency_s": (0.6, 0.01)},
        {"imu_time_offset_s": (-0.4, 0.01), "gnss_velocity_latency_s": (-0.3, 0.01)},
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
    (reason,) = impossible_ages({name: (value, 0.01)}, False)
    # of a clock that is off the delay is looked for about what the motions show
    of_delay = name == "imu_time_offset_s"
    assert (impossible_ages({name: (value, 0.01)}, False, expected_s=value) == []) == of_delay
    assert reason.code == "delay_at_bound"
    # what a receiver smooths is nothing against the IMU
    assert reason.inertial != ("velocity" in name)
    assert impossible_ages({name: (0.8 * value, 0.01)}, False) == []


def test_errors_that_no_sensor_has_are_told() -> None:
    found = {f"accel_scale_{a}": (v, 0.01) for a, v in zip("xyz", (0.03, -0.29, 0.0), strict=True)}
    (reason,) = impossible_errors(found, fixes_part=True)
    assert (reason.inertial, "what the receiver smooths" in reason.text) == (False, True)
    (reason,) = impossible_errors(found | {"gyro_bias_x": (0.02, 1e-4)})
    assert reason.code == "sensor_error"
    assert "axis y, would be 0.29" in reason.text
    assert impossible_errors({"accel_scale_x": (0.06, 0.01), "gyro_bias_x": (0.3, 0.01)}) == []


def test_noise_as_large_as_may_be_is_told() -> None:
    factors = {"accel": 16.0, "gyro": 0.0625, "velocity_h": 8.0}
    (reason,) = levels_at_bound(factors, tuned=False)
    assert "the noise of the accelerometer is 16 times" in reason.text
    assert reason.inertial
    assert levels_at_bound(factors, tuned=True) == []


def test_noise_that_the_readings_show_themselves_accuses_no_sensor() -> None:
    """A telephone's ten readings a second: units, axes and stamps were blamed."""
    t_ns = np.arange(2000) * np.int64(10**8)
    shakes = np.random.default_rng(1).normal(0.0, 1.0, (2, 2000, 3))
    options = FusionOptions()
    wanted = {"accel": 9.0, "gyro": 20.0}
    accel, gyro = (
        f * stated * np.sqrt(10.0) * s
        for f, stated, s in zip(
            wanted.values(), (options.accel_noise, options.gyro_noise), shakes, strict=True
        )
    )
    # what moves slowly is no noise
    slow = 5.0 * np.sin(0.05 * t_ns * 1e-9)[:, None]
    shaken = shaken_levels(ImuData(t_ns, gyro, accel + slow), options)
    assert shaken == pytest.approx(wanted, rel=0.05)
    accel_told, gyro_told = levels_at_bound({"accel": 17.0, "gyro": 16.0}, False, shaken)
    assert not accel_told.inertial
    assert not gyro_told.inertial
    assert "record at 50 Hz or more" in accel_told.text
    assert "record at 50 Hz or more" in gyro_told.text
    # of a shaken gyro turns and delays are wrong, of a shaken accelerometer nothing
    assert (accel_told.state, gyro_told.state) == ("good", "doubtful")
    (accel_told, gyro_told) = levels_at_bound(dict.fromkeys(wanted, 16.0), False, {"gyro": 8.5})
    assert accel_told.inertial
    assert accel_told.state == "doubtful"
    assert not gyro_told.inertial
    # as much as was looked for is not as much as there is
    (accel_told,) = levels_at_bound({"accel": 18.0}, False, shaken)
    assert (accel_told.inertial, accel_told.state) == (False, "doubtful")


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
    assert unsure_path(5.0) == []
    verdict = verdict_of([Reason("a", "b"), *unsure_path(50.0)])
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


# readings


# the IMU against the receiver


# the receiver against itself, and delays


def test_a_delay_far_from_what_was_expected_is_told_as_a_distance() -> None:
    found = {"imu_time_offset_s": (-0.9, 0.01)}
    (reason,) = unexpected_delay(found, 0.0, 0.05, 11.0)
    assert reason.error_m == pytest.approx(9.9)
    assert "10 m off along the road" in reason.text
    # that of one drive in twenty is no doubt, but may be the fixes' age
    (reason,) = unexpected_delay({"imu_time_offset_s": (-0.2, 0.01)}, 0.0, 0.05, 11.0)
    assert (reason.state, reason.late_s, reason.error_m) == ("good", 0.2, 0.0)
    assert unexpected_delay({"imu_time_offset_s": (-0.09, 0.01)}, 0.0, 0.05, 11.0) == []
    assert unexpected_delay({}, 0.0, 0.05, 11.0) == []


def test_readings_that_seem_to_be_stamped_before_they_were_read_are_fixes_of_an_age() -> None:
    """Fixes by carrier phase that are 0.3 s old, beside an IMU that is 0.16 s late: the delay is
    within those expected of the IMU, but none is stamped 0.12 s early."""
    found = {"imu_time_offset_s": (-0.12, 0.003)}
    (reason,) = unexpected_delay(found, 0.0, 0.1, 8.0, age_sd=0.001)
    assert (reason.state, reason.error_m) == ("good", 0.0)
    assert "before its readings, or the fixes older" in reason.text
    rng = np.random.default_rng(8)
    imu_late = np.abs(0.1 * rng.normal(size=200_000))
    assert reason.late_s == pytest.approx(np.sqrt(np.mean((0.12 + imu_late) ** 2)), rel=0.01)
    # a navigation filter's fixes may be as old, and late stamps are usual
    assert unexpected_delay(found, 0.0, 0.1, 8.0, age_sd=0.08) == []
    assert unexpected_delay({"imu_time_offset_s": (0.16, 0.003)}, 0.0, 0.1, 8.0, 0.001) == []


def consistency(**changes: Any) -> VelocityConsistency:
    none: dict[str, Any] = dict.fromkeys(
        ("velocity_stuck", "position_frozen", "rows_frozen", "parted"), ()
    )
    plain = {"compared_s": 300.0, "match": Match(), "scale_wrong": False, "unit": None}
    plain |= {"unrelated": False, "vertical": None, "worse": 1.0}
    return VelocityConsistency(**(plain | none | changes))


@pytest.mark.parametrize("vertical", [True, False])
def test_velocities_are_dated_by_the_lags_of_speed_and_course(vertical: bool) -> None:
    """Speeds are told 2 s late and courses 1 s: each is taken from so much later, also where a
    receiver tells no vertical velocity; the last ones are not known."""
    fixes = receive(city_drive(60.0, 3), Receiver(rate=4.0), 1)
    north, east = 5.0 + 0.1 * np.arange(len(fixes)), 0.02 * np.arange(len(fixes))
    down = np.full(len(fixes), 0.3 if vertical else np.nan)
    fixes = replace(fixes, vel_ned=np.column_stack([north, east, down]))
    match = Match(speed_lag_s=Estimate(2.0, 0.1), course_lag_s=Estimate(1.0, 0.1))
    found = consistency(match=match)
    late = found.positions_late_s
    lags = [4 * (lag + late) for lag in (2.0, 1.0)]
    dated = dated_velocities(fixes, found).vel_ned
    rows = np.arange(20, 200)
    speed = np.interp(rows + lags[0], np.arange(len(fixes)), np.hypot(north, east))
    course = np.interp(rows + lags[1], np.arange(len(fixes)), np.arctan2(east, north))
    assert dated[rows, 0] == pytest.approx(speed * np.cos(course))
    assert dated[rows, 1] == pytest.approx(speed * np.sin(course))
    assert np.isnan(dated[-3:, :2]).all()
    np.testing.assert_array_equal(dated[:, 2], down)


def test_a_receiver_that_contradicts_itself_is_told() -> None:
    assert receiver_doubts(consistency(), 1000.0) == []
    lost = Interval(1100.0, 1101.0, 12.0), Interval(1200.0, 1260.0, 700.0)
    (reason,) = receiver_doubts(consistency(rows_frozen=lost), 1000.0)
    assert reason.code == "rows_frozen"
    assert reason.handled
    assert reason.spans == ((100.0, 101.0), (200.0, 260.0))
    # one that repeats a fix now and then is sound
    assert receiver_doubts(consistency(rows_frozen=lost[:1]), 1000.0) == []
    (reason,) = receiver_doubts(consistency(parted=lost), 1000.0)
    assert reason.code == "positions_parted"
    assert reason.error_m == 700.0
    assert not reason.handled
    assert [r.code for r in receiver_doubts(consistency(unrelated=True, worse=9.0), 0.0)] == [
        "velocity_unrelated"
    ]
    # a longitude without its sign, or an east velocity: neither was left out
    (reason,) = receiver_doubts(consistency(match=Match(mirrored=True)), 0.0)
    assert (reason.code, reason.state, reason.handled) == ("sign_turned", "unusable", False)
    (reason,) = receiver_doubts(consistency(match=Match(quarters=2)), 0.0)
    assert (reason.code, reason.state, reason.handled) == ("course_turned", "doubtful", True)


def test_what_was_left_out_widens_nothing() -> None:
    path = straight_path(100, 0.5)
    alone = replace(path, lat_rad=path.lat_rad + 40.0 / 6.378e6)
    none = misses_of(np.zeros((0, 3)))
    wide = widen(path, [Reason("a", "", handled=True)], none, alone)
    assert np.array_equal(wide.sd_pos_ned, path.sd_pos_ned)


def test_velocities_are_taken_from_when_they_were_told() -> None:
    t = np.arange(0.0, 200.0)
    late = Match(speed_lag_s=Estimate(0.3, 0.02), course_lag_s=Estimate(0.6, 0.02))
    course, speed = (lambda s: 0.5 * np.sin(s / 12.0)), (lambda s: 10.0 + 3.0 * np.sin(s / 9.0))
    told = np.stack([np.cos(course(t - 0.6)), np.sin(course(t - 0.6)), 0.0 * t], axis=1)
    velocity = told * speed(t - 0.3)[:, None]
    velocity[50:60] = np.nan
    n = len(t)
    nothing, whole = np.full(n, np.nan), np.full(n, -1)
    fixes = Fixes(
        *(1e9 + t, nothing, nothing, nothing, velocity, np.full((n, 3), np.nan)),
        *(np.full((n, 3), np.nan), np.full(n, 3), whole, nothing, nothing, whole, whole),
    )
    moved = dated_velocities(fixes, consistency(match=late)).vel_ned
    true = np.stack([np.cos(course(t)), np.sin(course(t))], axis=1) * speed(t)[:, None]
    known = np.isfinite(moved[:, 0])
    assert not known[49:60].any()
    assert not known[-1]
    assert known.sum() == n - 12
    assert np.abs(moved[known, :2] - true[known]).max() < 0.05
    assert np.abs(velocity[known, :2] - true[known]).max() > 0.2
    # what chance makes of a lag is none
    unsure = Match(speed_lag_s=Estimate(0.1, 0.05), course_lag_s=None)
    assert dated_velocities(fixes, consistency(match=unsure)) is fixes
