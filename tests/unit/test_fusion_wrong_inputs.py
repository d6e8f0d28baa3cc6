"""Inputs that a good-looking path would hide are told, and right ones beside them are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from tempfile import TemporaryFile

import numpy as np
import pytest
from scipy.signal import lfilter

from automap.earth import metres_per_radian
from automap.fusion import limits
from automap.fusion.aside import put_aside
from automap.fusion.doubts.estimates import (
    bend_speed,
    contradicted_arm,
    impossible_ages,
    unexpected_delay,
    unproven_arm,
)
from automap.fusion.doubts.heights import height_doubts, separation_doubts
from automap.fusion.doubts.limits import BEND_STEP_S, TRIADS_APART_S
from automap.fusion.doubts.outcome import leaning, mounted_askew, unsure_path
from automap.fusion.doubts.path import Misses
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.receiver import overstated, receiver_doubts, usable_fixes
from automap.fusion.doubts.triads import following, lateness, triad_doubts
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.options import FusionOptions
from automap.fusion.result import FusionResult, Prior
from automap.fusion.verdict import Weighed, weigh
from automap.fusion.widening import widen
from automap.gates import OUTSIDE_95, gate
from automap.io.drive import load_drive
from automap.io.recording import read_recording
from automap.records import ClockModel, Fixes, FloatArray, ImuData, Trajectory
from automap.sync.velocity_consistency import velocity_consistency
from pipeline.check.steadiness import usable_receiver
from pipeline.check.velocity import check
from pipeline.run.fusion_inputs import _delay_prior, _stated_arm
from tests.unit.foreign_tables import SAMPLE
from tests.unit.fusion_drive import CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive
from tests.unit.test_fusion_verdict import misses_of

BY_MOTION = replace(CLOCK, method="correlation", sd_offset_s=0.02)
LEVER = (0.3, 0.2, -1.1)


def hilly(seconds: int = 600, climb: float = 0.04, lean: float = 0.0) -> Trajectory:
    """A drive over hills at 15 m/s, 10 rows a second; ``climb`` the steepest slope."""
    n = seconds * 10
    t: FloatArray = np.asarray(0.1 * np.arange(n))
    pitch = climb * np.sin(2.0 * np.pi * t / 80.0)
    height = 500.0 + np.cumsum(15.0 * np.tan(pitch)) * 0.1
    zero, three = np.zeros(n), np.zeros((n, 3))
    velocity = np.stack([15.0 + zero, zero, -15.0 * np.tan(pitch)], axis=1)
    rpy = np.stack([lean + zero, pitch, zero], axis=1)
    stamps = np.rint(t * 1e9).astype(np.int64)
    sds = three + 1.0, three + 0.1, three + 0.01
    return Trajectory(
        stamps,
        np.asarray(1.4e9 + t),
        np.asarray(15.0 * t / 6.37e6),
        zero,
        height,
        velocity,
        rpy,
        *sds,
    )


def fixes_of(path: Trajectory, factor: float, wander: float, seed: int) -> Fixes:
    """Fixes a second apart whose heights are ``factor`` times the path's and wander by as much."""
    rng = np.random.default_rng(seed)
    rows = np.arange(0, len(path), 10)
    n, nothing, whole = len(rows), np.full(len(rows), np.nan), np.full(len(rows), -1)
    error = np.zeros(n)
    for i in range(1, n):
        error[i] = 0.983 * error[i - 1] + wander * np.sqrt(1.0 - 0.983**2) * rng.standard_normal()
    return Fixes(
        *(path.gps_s[rows], path.lat_rad[rows], path.lon_rad[rows]),
        factor * (path.height_m[rows] + error),
        *(path.vel_ned[rows], np.full((n, 3), np.nan), np.full((n, 3), np.nan)),
        *(np.full(n, 3), whole, nothing, nothing, whole, whole),
    )


@pytest.mark.parametrize("seed", range(5))
def test_heights_in_metres_are_heights(seed: int) -> None:
    path = hilly()
    assert list(height_doubts(path, fixes_of(path, 1.0, 2.0, seed))) == []
    # what a flat road or too poor a receiver tells of a unit is nothing
    flat = hilly(climb=0.001)
    assert list(height_doubts(flat, fixes_of(flat, 3.28, 2.0, seed))) == []


@pytest.mark.parametrize("seed", range(3))
def test_heights_by_the_pressure_in_a_car_are_told(seed: int) -> None:
    path = hilly()
    t = path.gps_s - path.gps_s[0]
    speed, gain = 15.0 + 12.0 * np.sin(t / 24.0), 0.5 * np.cos(t / 24.0)
    climb = speed * np.tan(path.rpy[:, 1])
    velocity = np.stack([speed, 0.0 * t, -climb], axis=1)
    path = replace(path, vel_ned=velocity, height_m=500.0 + 0.1 * np.cumsum(climb))
    sound = fixes_of(path, 1.0, 1.0, seed)
    # a body that rises at the front as it speeds up climbs no hill
    squat = replace(path, rpy=path.rpy + np.outer(0.005 * gain, [0.0, 1.0, 0.0]))
    assert [*height_doubts(path, sound), *height_doubts(squat, sound)] == []
    off = 0.012 * speed[::10] ** 2
    (reason,) = height_doubts(path, replace(sound, height_m=sound.height_m - off))
    assert reason.code == "height_by_pressure"
    assert reason.height_m == pytest.approx(off.max(), rel=0.3)


@pytest.mark.parametrize("off_deg", [-11.0, 6.0, 2.0])
def test_courses_against_another_north_are_turned_back_and_told(off_deg: float) -> None:
    fixes = town_fixes()
    assert not velocity_consistency(fixes).course_off
    course = np.exp(1j * np.radians(off_deg)) * (fixes.vel_ned[:, 0] + 1j * fixes.vel_ned[:, 1])
    off = replace(fixes, vel_ned=np.column_stack([course.real, course.imag, fixes.vel_ned[:, 2]]))
    found = velocity_consistency(off)
    assert [r.code for r in receiver_doubts(found, 0.0)] == ["course_off"]
    back = usable_fixes(off, found).vel_ned
    assert np.abs(back - fixes.vel_ned).max() < np.radians(1.0) * np.abs(fixes.vel_ned).max()
    assert np.array_equal(usable_fixes(fixes, velocity_consistency(fixes)).vel_ned, fixes.vel_ned)


@pytest.mark.parametrize(
    ("factor", "text"), [(1.0 / 0.3048, "as feet where metres"), (0.3048, "as if they were")]
)
def test_heights_in_feet_are_told_and_widen_the_heights(factor: float, text: str) -> None:
    path = hilly()
    (reason,) = height_doubts(path, fixes_of(path, factor, 1.0, 3))
    assert reason.code == "height_scale"
    assert text in reason.text
    wide = widen(path, [reason], misses_of(np.zeros((0, 3))), None)
    assert (wide.sd_pos_ned[:, 2] > 0.9 * 500.0 * abs(factor - 1.0)).all()
    assert np.array_equal(wide.sd_pos_ned[:, :2], path.sd_pos_ned[:, :2])


def test_heights_that_fall_where_the_path_climbs_are_unknown() -> None:
    path = hilly()
    (reason,) = height_doubts(path, fixes_of(path, -1.0, 1.0, 3))
    assert reason.height_m == limits.UNKNOWN_HEIGHT_SD_M


@pytest.mark.parametrize("seed", range(8))
def test_two_minutes_of_hills_tell_feet_from_metres(seed: int) -> None:
    path = hilly(seconds=130)
    assert list(height_doubts(path, fixes_of(path, 1.0, 2.0, seed))) == []
    (reason,) = height_doubts(path, fixes_of(path, 1.0 / 0.3048, 0.5, seed))
    assert "as feet where metres" in reason.text


@pytest.mark.parametrize("factor", [1.0 / 0.3048, 0.3048])
def test_vertical_velocities_tell_feet_from_metres(factor: float) -> None:
    path = hilly(seconds=300, climb=0.1)
    right = velocity_consistency(fixes_of(path, 1.0, 0.5, 2))
    assert right.vertical is not None
    assert right.vertical.feet == 1.0
    log = fixes_of(path, factor, 0.2, 2)
    found = velocity_consistency(log)
    (reason,) = receiver_doubts(found, 0.0)
    assert reason.code == "height_scale"
    most = float(np.abs(log.height_m).max())
    assert reason.height_m == pytest.approx(most * abs(1.0 - 1.0 / factor))
    assert not found.unusable_vertical_velocity(log).any()
    assert "height_scale" in [finding.code for finding in check(log)]
    assert separation_doubts(replace(log, geoid_sep_m=np.full(len(log), 157.0)), [reason]) == []


def test_a_car_does_not_lean_for_minutes() -> None:
    for lean in (0.0, 0.1, -0.15):
        assert leaning(hilly(lean=lean)) == []
    fallen = hilly(lean=0.0)
    fallen.rpy[3000:, 0] -= 0.4
    (reason,) = leaning(fallen)
    assert "by 23 deg" in reason.text
    assert reason.spans[0][0] == pytest.approx(300.0)
    assert reason.spans[-1][1] == pytest.approx(600.0)


# gyro and accelerometer


def readings(late_s: float, arm_m: float = 1.5, seconds: float = 400.0, seed: int = 1) -> ImuData:
    """Bends at 8 to 12 m/s, ``arm_m`` ahead of the axle, the accelerometer ``late_s`` s late."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.01)
    rate = 0.3 * np.sin(2.0 * np.pi * t / 37.0) ** 5 + 0.1 * np.sin(2.0 * np.pi * t / 9.0) ** 3
    bend = (10.0 + 2.0 * np.sin(t / 20.0)) * rate + arm_m * np.gradient(rate, 0.01)
    accel = np.stack([0.0 * t, np.interp(t - late_s, t, bend), -9.8 + 0.0 * t], axis=1)
    gyro = np.stack([0.0 * t, 0.0 * t, rate], axis=1)
    return ImuData(
        np.rint(t * 1e9).astype(np.int64),
        gyro + 0.01 * rng.standard_normal(gyro.shape),
        accel + 0.3 * rng.standard_normal(accel.shape),
    )


def speed(imu: ImuData) -> FloatArray:
    return np.asarray(10.0 + 2.0 * np.sin(imu.t_ns * 1e-9 / 20.0))


@pytest.mark.parametrize("late_s", [0.0, 0.2, -0.5, 0.6])
def test_how_late_the_accelerometer_feels_bends_is_found(late_s: float) -> None:
    imu = readings(late_s)
    found = lateness(imu, np.eye(3), speed(imu))
    assert found is not None
    # an IMU ahead of the axle looks like a part of a delay
    assert found[0] == pytest.approx(late_s, abs=TRIADS_APART_S)
    assert found[1] < 0.05
    told = list(triad_doubts(imu, np.eye(3), speed(imu)))
    assert [reason.code for reason in told] == ["triads_apart"] * (abs(late_s) > 0.4)
    if told:
        assert f"{abs(found[0]):.2f} s after its" in told[0].text
        assert ("gyro feels" in told[0].text) == (late_s < 0.0)
        assert told[0].error_m == pytest.approx(10.0 * abs(late_s), abs=2.0)


@pytest.mark.parametrize("arm_m", [-1.5, 0.0, 1.5])
@pytest.mark.parametrize("tau_s", [0.0, 0.5])
def test_a_gyro_behind_a_low_pass_is_told(tau_s: float, arm_m: float) -> None:
    """At one speed it would be one of an IMU some metres ahead of the axle."""
    imu = readings(0.0, arm_m, seed=7)
    kept = float(np.exp(-0.01 / tau_s)) if tau_s else 0.0
    imu = replace(imu, gyro=lfilter([1.0 - kept], [1.0, -kept], imu.gyro, axis=0))
    found = following(imu, np.eye(3), speed(imu))
    assert found is not None
    assert abs(found[0] + tau_s) < BEND_STEP_S + 2.0 * found[1]
    told = list(triad_doubts(imu, np.eye(3), speed(imu)))
    assert [reason.code for reason in told] == ["triads_apart"] * bool(tau_s)
    if told:
        assert "the IMU's gyro feels bends 0." in told[0].text
        assert (told[0].state, told[0].error_m) == ("doubtful", 0.0)
        # headings are as unsure as they change meanwhile
        assert told[0].moved_s == pytest.approx(0.5, abs=0.1)


def test_what_chance_may_make_of_triads_leaves_readings_good() -> None:
    imu = readings(0.0, seconds=60.0, seed=8)
    rng = np.random.default_rng(9)
    kept = float(np.exp(-0.01 / 0.3))
    rough = np.repeat(rng.standard_normal(imu.accel.shape), 100, axis=0)[: len(imu)]
    imu = replace(
        imu,
        gyro=lfilter([1.0 - kept], [1.0, -kept], imu.gyro, axis=0),
        accel=imu.accel + 0.25 * rough,
    )
    (reason,) = triad_doubts(imu, np.eye(3), speed(imu))
    assert (reason.state, reason.inertial, reason.error_m) == ("good", False, 0.0)
    assert reason.moved_s > 0.1


def test_without_bends_or_motion_nothing_is_said_of_triads() -> None:
    imu = readings(0.6)
    assert lateness(imu, np.eye(3), np.zeros(len(imu))) is None
    noise = 0.3 * np.random.default_rng(2).standard_normal(imu.accel.shape)
    straight = replace(imu, gyro=0.03 * noise, accel=noise[::-1])
    assert lateness(straight, np.eye(3), speed(imu)) is None


# the arm to the antenna


def test_an_arm_that_the_drive_moves_away_from_is_told() -> None:
    stated = np.array([1.8, -0.5, 1.2])

    def after(moved: float, sd: float) -> list[Reason]:
        found = {f"gnss_lever_arm_{a}": (float(v), sd) for a, v in zip("xyz", stated, strict=True)}
        found["gnss_lever_arm_x"] = (1.8 - moved, sd)
        return contradicted_arm(found, stated, limits.STATED_ARM_SD_M, 8.0)

    (reason,) = after(0.9, 0.04)
    # the drive by itself: 0.9 m over the share that it has in the estimate
    assert reason.error_m == pytest.approx(0.9 / (1.0 - 0.64), rel=1e-6)
    assert "near [-0.7, -0.5, 1.2]" in reason.text
    # what chance does to a right statement, and what receivers add to it
    assert after(0.1, 0.04) == after(0.17, 0.03) == after(0.0, 0.05) == []
    # a drive that takes a fifth of the tape's variance from it, and moves off by nine of that sigma
    (slight,) = after(0.2, 0.045)
    assert slight.error_m == pytest.approx(0.2 / 0.19, rel=1e-6)
    assert contradicted_arm({}, None, 0.05, 8.0) == []
    # nor what a receiver's filter does to the height of its antenna
    found = {"gnss_lever_arm_z": (-0.845, 0.046), "gnss_velocity_latency_s": (0.1, 0.01)}
    assert contradicted_arm(found, np.array(LEVER), limits.STATED_ARM_SD_M, 8.0) == []
    # late velocities make an arm of their own, in bends at 5 m/s and in those of motorways
    found = {"gnss_lever_arm_x": (-0.79, 0.031), "gnss_velocity_latency_s": (0.53, 0.01)}
    assert contradicted_arm(found, np.zeros(3), limits.STATED_ARM_SD_M, 5.0) == []
    found = {"gnss_lever_arm_x": (-0.03, 0.04986), "gnss_velocity_latency_s": (0.3, 0.01)}
    assert contradicted_arm(found, np.zeros(3), limits.STATED_ARM_SD_M, 28.0) == []


def test_an_arm_whose_sign_the_drive_would_not_show_is_named() -> None:
    def said(
        sd: float, speed: float, stated: tuple[float, ...] = (1.8, -0.2, 1.2), path_sd: float = 1.0
    ) -> list[Reason]:
        found = {f"gnss_lever_arm_{axis}": (0.0, sd) for axis in "xyz"}
        found["gnss_velocity_latency_s"] = (0.3, 0.02)
        return unproven_arm(found, np.array(stated), limits.STATED_ARM_SD_M, speed, path_sd)

    # bends at walking pace take from the tape's variance, those of a motorway do not
    assert said(0.045, 4.0) == []
    for hidden in (said(0.04999, 4.0), said(0.045, 25.0)):
        (reason,) = hidden
        assert (reason.code, reason.state, reason.error_m) == ("lever_arm_unproven", "good", 0.0)
        assert "3.6 m off" in reason.text
    # an antenna over the IMU has no sign, and one that nobody stated is none
    assert said(0.05, 25.0, (0.2, 0.2, -1.5)) == []
    assert unproven_arm({}, None, limits.STATED_ARM_SD_M, 25.0, 1.0) == []
    # a path that is no better than that says so by its sigma
    assert said(0.045, 25.0, path_sd=3.5)
    assert said(0.045, 25.0, path_sd=3.7) == []


# what a receiver says of itself


@pytest.mark.parametrize("factor", [1.0, 4.0, 100.0])
def test_accuracies_far_larger_than_positions_scatter_are_told(factor: float) -> None:
    rng = np.random.default_rng(31)
    n = 300
    stated = np.full((n, 3), (2.0 * factor) ** 2)
    miss = 0.7 * rng.standard_normal((n, 3))
    said = overstated(Misses(np.arange(n, dtype=float), miss, stated / 16.0, stated))
    assert [reason.code for reason in said] == ["accuracy_overstated"] * (factor == 100.0)
    if said:
        assert said[0].state == "good"
        assert "200 m an axis" in said[0].text
    unsure = unsure_path(150.0, bool(said))[0]
    assert unsure.state == "unusable"
    assert ("check the unit of its accuracy" in unsure.text) == bool(said)
    assert ("record again" in unsure.text) != bool(said)


@pytest.mark.parametrize(("separation", "unit"), [(48.0, ""), (-34.0, ""), (48.0, "feet")])
def test_a_geoid_that_is_nowhere_on_earth_tells_feet(separation: float, unit: str) -> None:
    factor = 1.0 / 0.3048 if unit else 1.0
    fixes = fixes_of(hilly(60), 1.0, 0.5, 4)
    height = (fixes.height_m + 100.0) * factor
    fixes = replace(fixes, height_m=height, geoid_sep_m=np.full(len(height), factor * separation))
    said = separation_doubts(fixes)
    assert [reason.code for reason in said] == ["height_scale"] * bool(unit)
    if said:
        assert unit in said[0].text
        assert said[0].height_m == pytest.approx(np.abs(height).max() * (1.0 - 0.3048))
    unknown = replace(fixes, geoid_sep_m=np.full(len(height), np.nan))
    assert separation_doubts(unknown) == []


def test_a_geoid_in_no_unit_leaves_heights_unknown() -> None:
    fixes = fixes_of(hilly(60), 1.0, 0.5, 4)
    (reason,) = separation_doubts(replace(fixes, geoid_sep_m=np.full(len(fixes), 4800.0)))
    assert "another unit" in reason.text
    assert reason.height_m == limits.UNKNOWN_HEIGHT_SD_M


def test_bends_tell_an_arm_by_their_own_speed() -> None:
    t = np.arange(0.0, 40.0, 0.1)
    turns = t < 10.0
    yaw = np.where(turns, 0.2 * t, 2.0)
    assert bend_speed(t, yaw, np.where(turns, 6.0, 30.0)) == pytest.approx(6.0, rel=0.02)
    assert bend_speed(t, np.full(len(t), 0.5), np.full(len(t), 30.0)) == 30.0


# whole drives


def fused(
    receiver: Receiver,
    clock: ClockModel,
    lever: tuple[float, float, float] = LEVER,
    logged: Callable[[Fixes], Fixes] = lambda fixes: fixes,
) -> tuple[FusionResult, Weighed]:
    """A drive of three minutes, and what is said of its path."""
    motion = city_drive(180.0, 4)
    imu, fixes = record(motion, Sensor(), 4), logged(receive(motion, receiver, 5))
    delay, is_clock = _delay_prior(clock, 0.05)
    arm, options = np.array(lever), FusionOptions()
    result = fuse_imu_gnss(imu, fixes, clock, options, delay, arm, delay_is_clock=is_clock)
    seen = velocity_consistency(fixes)
    with TemporaryFile() as file:
        aside = put_aside(result.path_run(), result.t_ns, file)
        weighed = weigh(
            *(result, aside, imu, lambda read: read, fixes, clock, options),
            *(delay, is_clock, seen, arm),
        )
        path = weighed.trajectory
        return result, replace(weighed, run=lambda: iter([path]))


def test_late_velocities_beside_prompt_positions_are_no_contradiction() -> None:
    """A clock that was found by late velocities is as late: positions then seem to come early."""
    late = replace(BY_MOTION, ref_gps_s=BY_MOTION.ref_gps_s + 0.7)
    result, weighed = fused(Receiver(lever=LEVER, vel_latency=0.7), late)
    assert result.delay.mean == pytest.approx(0.7, abs=0.05)
    assert weighed.verdict.state == "good", weighed.verdict
    # of arrival times it is one: nothing arrives before it was
    found = {"imu_time_offset_s": (result.delay.mean, 0.01)}
    assert [r.code for r in impossible_ages(found, dated_by_arrival=True)] == ["negative_delay"]
    assert impossible_ages(found, dated_by_arrival=False) == []
    prior = Prior(-0.1, 0.1)
    assert unexpected_delay(found, prior.mean, prior.sd, 10.0)[0].code == "delay_unexpected"


def overshot(fixes: Fixes) -> Fixes:
    """Positions of a filter that goes on as it went, for 1.5 s of what the velocity changed by in
    the last second."""
    keeps = float(np.exp(-np.median(np.diff(fixes.gps_s))))
    was = lfilter([1.0 - keeps], [1.0, -keeps], fixes.vel_ned - fixes.vel_ned[0], axis=0)
    beyond = 1.5 * (was + fixes.vel_ned[0] - fixes.vel_ned)
    north, east = metres_per_radian(fixes.lat_rad, fixes.height_m)
    lat, lon = fixes.lat_rad + beyond[:, 0] / north, fixes.lon_rad + beyond[:, 1] / east
    return replace(fixes, lat_rad=lat, lon_rad=lon)


@pytest.mark.slow
def test_velocities_are_as_unsure_as_their_ways_differ_from_those_of_positions() -> None:
    """Ways through bends that a receiver's filter made too long make the path's speeds too high."""
    _, weighed = fused(Receiver(lever=LEVER), BY_MOTION, logged=overshot)
    path, motion = weighed.trajectory, city_drive(180.0, 4)
    true = motion.at(path.gps_s - GPS0).vel
    off = ((path.vel_ned - true)[:, :2] / path.sd_vel_ned[:, :2]) ** 2
    assert np.mean(off.sum(axis=1) < gate(OUTSIDE_95, 2)) > 0.9


# what a log says throughout


def town_fixes() -> Fixes:
    return receive(city_drive(240.0, 4), Receiver(rate=1.0), 5)


def test_heights_that_never_change_are_left_out_and_told() -> None:
    fixes = town_fixes()
    assert not velocity_consistency(fixes).height_stuck
    level = replace(fixes, height_m=np.full_like(fixes.height_m, 47.0))
    for silent in (level, replace(level, vel_ned=np.full_like(level.vel_ned, np.nan))):
        found = velocity_consistency(silent)
        assert found.height_stuck
        assert np.isnan(usable_fixes(silent, found).height_m).all()
        assert "height_stuck" in [reason.code for reason in receiver_doubts(found, 0.0)]
    assert np.array_equal(
        usable_fixes(fixes, velocity_consistency(fixes)).height_m, fixes.height_m, equal_nan=True
    )
    # a minute may have one height
    minute = replace(level, fix_type=np.where(np.arange(len(level)) < 60, 3, 0))
    assert not velocity_consistency(minute).height_stuck


@pytest.mark.parametrize(
    ("factor", "text"),
    [(0.6, "as minutes (48.13 deg as 48 13')"), (1.0 / 0.6, "as hundredths of degrees"), (3.6, "")],
)
def test_minutes_of_arc_that_are_none_are_named_beside_units_of_speed(
    factor: float, text: str
) -> None:
    fixes = town_fixes()
    found = velocity_consistency(replace(fixes, vel_ned=factor * fixes.vel_ned))
    (reason,) = (r for r in found.reasons if r.code == "velocity_unit")
    assert text in reason.text
    assert ("positions are wrong" in reason.text) == bool(text)


def test_a_path_told_twice_is_no_witness_against_the_imu() -> None:
    """Axes judged by a path of swapped coordinates would be accused."""
    drive = load_drive(SAMPLE)
    recording = read_recording(drive)
    fixes = recording.fixes
    assert fixes is not None
    assert usable_receiver(drive, recording)[1] is not None
    crossed = replace(fixes, vel_ned=fixes.vel_ned[:, [1, 0, 2]])
    assert usable_receiver(drive, replace(recording, fixes=crossed))[1] is None


@pytest.mark.parametrize(
    ("arm", "believed"), [((-30.0, 10.0, -50.0), False), ((12.0, 0.0, 0.0), True)]
)
def test_an_arm_that_fits_on_no_vehicle_is_not_believed(
    arm: tuple[float, float, float], believed: bool
) -> None:
    drive = load_drive(SAMPLE)
    gnss = drive.gnss.model_copy(update={"lever_arm_m": arm})
    stated = _stated_arm(replace(drive, manifest=drive.manifest.model_copy(update={"gnss": gnss})))
    assert (stated is not None) == believed


def test_a_vehicle_that_leans_in_the_mean_has_an_imu_mounted_askew() -> None:
    level = replace(hilly(), sd_rpy=np.full((6000, 3), 0.0145))
    assert mounted_askew(level, level.sd_rpy[:, 0]) == ([], 0.0)
    right = level.rpy + np.array([0.02, 0.0, 0.0])
    assert mounted_askew(replace(level, rpy=right), level.sd_rpy[:, 0]) == ([], 0.0)
    right = replace(level, rpy=level.rpy - np.array([0.11, 0.0, 0.0]))
    found, lean = mounted_askew(right, level.sd_rpy[:, 0])
    assert [reason.code for reason in found] == ["mounted_askew"]
    assert "6 deg to the left" in found[0].text
    assert lean == pytest.approx(0.11, abs=0.01)
