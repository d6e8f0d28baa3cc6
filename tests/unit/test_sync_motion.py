"""Clocks and delays from the motions that IMU and receiver both saw."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from automap.errors import InputError
from automap.records import ClockModel, DriveClocks, Fixes
from automap.sync.clock import check_overlap, gps_clock, synchronise, unix_clock
from automap.sync.finished import trajectory_clock
from automap.sync.motion_clock import correlation_clock, imu_gnss_delay
from automap.sync.receiver_path import integrated, receiver_path
from automap.timebase import gps_to_unix
from pipeline.run.fusion_inputs import _delay_prior
from tests.unit.sync_scene import GPS_START, drive, fixes_of, imu_of

UPSIDE_DOWN = Rotation.from_euler("ZYX", [150.0, 12.0, 178.0], degrees=True)


def true_clock(start_ns: int, drift: float = 0.0) -> ClockModel:
    return ClockModel(start_ns, GPS_START, drift, 1e-3, 1e-6, "arrival", 0.0)


@pytest.mark.parametrize("mounting", [None, UPSIDE_DOWN])
@pytest.mark.parametrize("delay", [-0.15, 0.125])
def test_delay_is_found_whatever_the_mounting(mounting: Rotation | None, delay: float) -> None:
    t, gyro, accel, motion = drive(mounting=mounting)
    imu = imu_of(t + delay, gyro, accel, 5_000_000_000)
    lags = imu_gnss_delay(imu, true_clock(5_000_000_000), fixes_of(t, motion))
    for source in ("velocity", "position"):
        lag = lags[source]
        assert lag.lag_s == pytest.approx(delay, abs=3.5 * lag.sd_s)
        assert lag.sd_s < 0.04


def test_velocity_and_position_delays_are_told_apart() -> None:
    t, gyro, accel, motion = drive()
    fixes = fixes_of(t, motion)
    # each epoch carries the velocity of the one before, 0.2 s older
    mixed = replace(fixes, vel_ned=np.roll(fixes.vel_ned, 1, axis=0))
    lags = imu_gnss_delay(imu_of(t, gyro, accel, 0), true_clock(0), mixed)
    assert lags["position"].lag_s == pytest.approx(0.0, abs=0.04)
    assert lags["velocity"].lag_s == pytest.approx(-0.2, abs=0.04)


@pytest.mark.parametrize("rate", [5.0, 10.0])
def test_wild_fixes_move_no_delay(rate: float) -> None:
    """One in forty lies tens of metres off: some hundred metres a second from its neighbours."""
    t, gyro, accel, motion = drive()
    imu, fixes = imu_of(t, gyro, accel, 0), fixes_of(t, motion, rate)
    rng = np.random.default_rng(9)
    wild = rng.choice(len(fixes), len(fixes) // 40, replace=False)
    lat = fixes.lat_rad.copy()
    lat[wild] += rng.uniform(10.0, 90.0, len(wild)) * rng.choice([-1.0, 1.0], len(wild)) / 6.371e6
    lag = imu_gnss_delay(imu, true_clock(0), replace(fixes, lat_rad=lat))["position"]
    assert lag.lag_s == pytest.approx(0.0, abs=3.5 * lag.sd_s)
    assert lag.sd_s < 0.06


@pytest.mark.slow
def test_a_drive_of_another_month_in_the_log_costs_neither_memory_nor_the_offset() -> None:
    t, gyro, accel, motion = drive(60.0, 25.0)
    fixes = fixes_of(t, motion, rate=2.0)
    other = fixes_of(t, drive(60.0, 25.0, seed=8)[3], rate=2.0)
    later = replace(other, gps_s=other.gps_s + 30 * 86_400.0)
    log = Fixes(**{k: np.concatenate([v, vars(later)[k]]) for k, v in vars(fixes).items()})
    tracemalloc.start()
    imu = imu_of(t, gyro, accel, 0)
    clocks = [correlation_clock(imu, each).clock for each in (fixes, log)]
    path = receiver_path(log)
    way = integrated(path, np.ones(len(path), np.bool_))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    told = [clock.gps_s(imu.t_ns[[0, -1]]) for clock in clocks]
    assert np.allclose(told[0], told[1], atol=0.02)
    assert np.allclose(way[: len(fixes)] - way[0], path.place[: len(fixes)], atol=2.0)
    assert peak < 100e6


@pytest.mark.parametrize("start_s", [12.0, 4321.0])
def test_offset_of_any_size_is_found_without_arrival_times(start_s: float) -> None:
    t, gyro, accel, motion = drive(150.0, mounting=UPSIDE_DOWN)
    start = round(start_s * 1e9)
    imu = imu_of(t, gyro, accel, start)
    fixes = fixes_of(t, motion)
    late = replace_rows(fixes, fixes.gps_s > GPS_START + 40.0)
    result = correlation_clock(imu, late)
    error = result.clock.gps_s(imu.t_ns[[0, -1]]) - GPS_START - t[[0, -1]]
    assert result.clock.method == "correlation"
    assert result.clock.sd_offset_s < 0.03
    assert np.abs(error).max() < 0.05


def test_rate_error_is_found_on_a_long_log() -> None:
    t, gyro, accel, motion = drive(400.0)
    rate = 3e-4
    imu = imu_of(t * (1.0 + rate), gyro, accel, 0)
    result = correlation_clock(imu, fixes_of(t, motion), drift_sd=3e-4)
    assert result.clock.drift == pytest.approx(-rate, abs=5 * result.clock.sd_drift)
    assert np.abs(result.clock.gps_s(imu.t_ns[[0, -1]]) - GPS_START - t[[0, -1]]).max() < 0.06


def test_two_different_drives_are_refused() -> None:
    t, gyro, accel, _ = drive(seed=3)
    _, _, _, other = drive(seed=44)
    with pytest.raises(InputError, match=r"does not stand out|too little motion"):
        correlation_clock(imu_of(t, gyro, accel, 0), fixes_of(t, other))


def test_standing_still_tells_no_offset() -> None:
    t, gyro, accel, _ = drive(60.0)
    still = np.column_stack([np.zeros(len(t)), np.zeros(len(t))])
    with pytest.raises(InputError):
        correlation_clock(imu_of(t, 0 * gyro, accel * 0 + [0, 0, -9.81], 0), fixes_of(t, still))


def replace_rows(fixes: Fixes, rows: np.ndarray) -> Fixes:
    return Fixes(**{name: getattr(fixes, name)[rows] for name in fixes.__dataclass_fields__})


def with_arrivals(fixes: Fixes, start_ns: int, delay: float = 0.07, shift: float = 0.0) -> Fixes:
    waiting = np.random.default_rng(1).exponential(0.01, len(fixes))
    host = fixes.gps_s - GPS_START + delay + waiting + shift
    return replace(fixes, arrival_ns=start_ns + np.rint(host * 1e9).astype(np.int64))


def test_arrival_times_are_used_where_they_are() -> None:
    t, gyro, accel, motion = drive(90.0)
    fixes = with_arrivals(fixes_of(t, motion), 77_000_000_000)
    result = synchronise(imu_of(t, gyro, accel, 77_000_000_000), fixes, output_delay_s=0.07)
    assert result.clock.method == "arrival"
    assert result.clock.gps_s(np.array([77_000_000_000]))[0] == pytest.approx(GPS_START, abs=1e-3)
    assert result.lag is not None
    assert abs(result.lag.lag_s) < 3.5 * result.lag.sd_s


def test_arrivals_that_the_motion_contradicts_are_an_error() -> None:
    t, gyro, accel, motion = drive(150.0)
    fixes = with_arrivals(fixes_of(t, motion), 0, shift=7.0)
    with pytest.raises(InputError, match=r"-(6\.9|7\.[01]) s .*contradict"):
        synchronise(imu_of(t, gyro, accel, 0), fixes, output_delay_s=0.07)


def test_gps_and_unix_stamps_need_no_arrival() -> None:
    t, gyro, accel, motion = drive(60.0)
    fixes = fixes_of(t, motion)
    start = round(GPS_START * 1e9)
    result = synchronise(imu_of(t, gyro, accel, start), fixes, imu_time="gps_ns")
    assert result.clock.method == "identity"
    assert result.clock.gps_s(np.array([start]))[0] == pytest.approx(GPS_START, abs=1e-6)
    start = round(float(gps_to_unix(GPS_START)) * 1e9)
    result = synchronise(imu_of(t, gyro, accel, start), fixes, imu_time="unix_ns")
    assert result.clock.method == "unix"
    assert result.clock.gps_s(np.array([start]))[0] == pytest.approx(GPS_START, abs=1e-6)


@pytest.mark.parametrize("off_s", [-0.95, 0.3, 0.9])
def test_a_computers_clock_that_is_off_is_what_the_motions_show(off_s: float) -> None:
    """More than receivers' velocities are late is the clock's, and said; the lag is found there."""
    t, gyro, accel, motion = drive()
    start = round((float(gps_to_unix(GPS_START)) + off_s) * 1e9)
    imu, fixes = imu_of(t, gyro, accel, start), fixes_of(t, motion)
    result = synchronise(imu, fixes, imu_time="unix_ns")
    assert result.lag is not None
    assert result.lag.lag_s == pytest.approx(off_s, abs=3.5 * result.lag.sd_s)
    off = abs(off_s) > 0.5
    assert any("the motions are believed" in text for text in result.warnings) == off
    assert (result.shown_offset_s is not None) == off
    clocks = DriveClocks(result.clock, "unix_ns", shown_offset_s=result.shown_offset_s)
    delay, is_clock = _delay_prior(clocks, 0.01)
    assert is_clock
    assert delay.mean == pytest.approx(off_s if off else 0.0, abs=0.2)
    assert delay.sd == 0.5


def test_utc_taken_for_gps_time_is_recognised_by_the_leap_seconds() -> None:
    t, gyro, accel, motion = drive(150.0)
    imu = imu_of(t, gyro, accel, round((GPS_START - 18.0) * 1e9))
    with pytest.raises(InputError, match="18 leap seconds"):
        synchronise(imu, fixes_of(t, motion), imu_time="gps_ns")


def test_recordings_apart_in_time_are_an_error_with_both_spans() -> None:
    t = np.array([0.0, 100.0])
    imu_ns = np.rint((GPS_START + 5000.0 + t) * 1e9).astype(np.int64)
    with pytest.raises(InputError, match=r"2024-05-17T18:16.*2024-05-17T16:53.*4900 s apart"):
        check_overlap(gps_clock(imu_ns), imu_ns, GPS_START + t)


def test_unix_stamps_declared_as_gps_time_are_named() -> None:
    t = np.array([0.0, 100.0])
    imu_ns = np.rint((float(gps_to_unix(GPS_START)) + t) * 1e9).astype(np.int64)
    with pytest.raises(InputError, match="look like UNIX time"):
        check_overlap(gps_clock(imu_ns), imu_ns, GPS_START + t)
    gps_ns = np.rint((GPS_START + t) * 1e9).astype(np.int64)
    with pytest.raises(InputError, match="look like GPS time"):
        check_overlap(unix_clock(gps_ns), gps_ns, GPS_START + t)


def test_without_imu_the_clock_is_gps_time_or_that_of_the_arrivals() -> None:
    t, _, _, motion = drive(60.0)
    fixes = fixes_of(t, motion)
    result = synchronise(None, fixes)
    assert result.clock.method == "identity"
    assert result.clock.t_ns(fixes.gps_s[:1])[0] == pytest.approx(fixes.gps_s[0] * 1e9, abs=500)
    result = synchronise(None, with_arrivals(fixes, 10**12), output_delay_s=0.07)
    assert result.clock.method == "arrival"


def test_without_a_receiver_times_are_the_hosts_and_that_is_said() -> None:
    t, gyro, accel, _ = drive(20.0)
    result = synchronise(imu_of(t, gyro, accel, 10**9), None)
    assert result.clock.method == "none"
    assert result.warnings


def test_nothing_at_all_is_an_identity() -> None:
    assert synchronise(None, None).clock.method == "identity"


def test_clock_of_a_finished_trajectory() -> None:
    t_ns = 10**9 * np.arange(100, dtype=np.int64)
    clock = trajectory_clock(t_ns, GPS_START + t_ns * 1e-9 * (1.0 + 2e-5))
    assert clock.drift == pytest.approx(2e-5, abs=1e-8)
    np.testing.assert_allclose(clock.gps_s(t_ns), GPS_START + t_ns * 1.00002e-9, atol=1e-6)
    with pytest.raises(InputError, match="gps_s and t_ns"):
        trajectory_clock(t_ns, GPS_START + t_ns * 2e-9)
