"""An IMU whose triads lie apart in time or that leans, and a wrong arm to the antenna, are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from automap.fusion import limits
from automap.fusion.doubts.antenna import (
    bend_speed,
    contradicted_arm,
    misplaced_antenna,
    overturned_arm,
    unproven_arm,
)
from automap.fusion.doubts.limits import BEND_STEP_S, TRIADS_APART_S
from automap.fusion.doubts.outcome import leaning, mounted_askew
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.triads import following, lateness, triad_doubts
from automap.io.drive import load_drive
from automap.records import FloatArray, ImuData
from automap.sync.path_match import Estimate, Match
from pipeline.run.fusion_inputs import stated_arm
from tests.unit.foreign_tables import SAMPLE
from tests.unit.fusion_fixes import hilly

LEVER = (0.3, 0.2, -1.1)


def test_a_car_does_not_lean_for_minutes() -> None:
    for lean in (0.0, 0.1, -0.15):
        assert leaning(hilly(lean=lean)) == []
    fallen = hilly(lean=0.0)
    fallen.rpy[3000:, 0] -= 0.4
    (reason,) = leaning(fallen)
    assert "by 23 deg" in reason.text
    assert reason.spans[0][0] == pytest.approx(300.0)
    assert reason.spans[-1][1] == pytest.approx(600.0)


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
    # late velocities make an arm of their own, in bends at 5 m/s and in those of motorways: the
    # path follows it, and is as unsure
    for moved, sd, late, speed in ((-0.79, 0.031, 0.53, 5.0), (-0.03, 0.04986, 0.3, 28.0)):
        found = {"gnss_lever_arm_x": (moved, sd), "gnss_velocity_latency_s": (late, 0.01)}
        (slight,) = contradicted_arm(found, np.zeros(3), limits.STATED_ARM_SD_M, speed)
        assert (slight.state, slight.error_m) == ("good", pytest.approx(-moved))


def test_an_antenna_elsewhere_is_told_by_bends_that_the_receiver_takes_in_time() -> None:
    def found(lead: float, late: float) -> dict[str, tuple[float, float]]:
        return {
            "gnss_velocity_latency_s": (-lead, 0.01),
            "gnss_course_latency_s": (late, 0.01),
            "nhc_lever_arm_x": (2.5, 0.2),
        }

    def own(speed: float, course: float, sd: float = 0.01) -> Match:
        return Match(speed_lag_s=Estimate(speed, sd), course_lag_s=Estimate(course, sd))

    behind = found(0.05, 0.1)
    (reason,) = misplaced_antenna(behind, own(0.0, 0.0), 14.0)
    assert (reason.code, reason.state) == ("lever_arm", "doubtful")
    assert reason.error_m == pytest.approx(0.1 * 14.0 + 2.5)
    (less,) = misplaced_antenna(behind, own(0.0, 0.0, 0.015), 14.0)
    assert less.state == "good"
    # cars turn about a point behind the IMU, which says nothing of an antenna that is ahead
    (ahead,) = misplaced_antenna(found(-0.05, -0.1), own(0.0, 0.0), 14.0)
    assert ahead.error_m == pytest.approx(1.4)
    # a filter is as late in its own positions, and a receiver that tells nothing is no witness
    assert misplaced_antenna(behind, own(-0.05, 0.05, 0.02), 14.0) == []
    assert misplaced_antenna(behind, own(0.2, 0.2), 14.0) == []
    assert misplaced_antenna(behind, Match(), 14.0) == []
    # courses may come late with positions that are of the velocities' instant
    assert misplaced_antenna(found(-0.05, 0.1), own(0.0, 0.0), 14.0) == []


def test_a_height_of_the_antenna_with_the_wrong_sign_is_told_by_its_sway() -> None:
    def said(stated: float, own: float, sd: float) -> list[Reason]:
        """Of a filter that holds what is ``stated`` while the drive alone has it at ``own``."""
        before, tape = limits.HELD_ARM_SD_M, limits.STATED_ARM_SD_M
        taken = before**4 / sd**2
        moved = (own - stated) * taken / before**2
        found = {"gnss_lever_arm_z": (stated + moved, np.sqrt(tape**2 + before**2 - taken))}
        return overturned_arm(found, np.array([0.4, 0.1, stated]), tape)

    for stated in (1.2, -1.2):
        (reason,) = said(stated, -0.97 * stated, 0.07)
        assert (reason.state, reason.height_m) == ("doubtful", pytest.approx(2.4))
        assert f"2.4 m too {'high' if stated > 0.0 else 'low'}" in reason.text
        # a receiver that smooths hides the sway, and one that lags turns some of it over
        for own in (stated, 0.1 * stated, -0.25 * stated):
            assert said(stated, own, 0.03) == []
        # what is beyond both is another fault's, and what is unsure chance's
        assert said(stated, -4.0 * stated, 0.7) == said(stated, -stated, 0.3) == []
    assert said(0.2, -0.2, 0.01) == []
    assert overturned_arm({}, None, 0.05) == overturned_arm({}, np.array(LEVER), 0.05) == []


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


def test_bends_tell_an_arm_by_their_own_speed() -> None:
    t = np.arange(0.0, 40.0, 0.1)
    turns = t < 10.0
    yaw = np.where(turns, 0.2 * t, 2.0)
    assert bend_speed(t, yaw, np.where(turns, 6.0, 30.0)) == pytest.approx(6.0, rel=0.02)
    assert bend_speed(t, np.full(len(t), 0.5), np.full(len(t), 30.0)) == 30.0


@pytest.mark.parametrize(
    ("arm", "believed"), [((-30.0, 10.0, -50.0), False), ((12.0, 0.0, 0.0), True)]
)
def test_an_arm_that_fits_on_no_vehicle_is_not_believed(
    arm: tuple[float, float, float], believed: bool
) -> None:
    drive = load_drive(SAMPLE)
    gnss = drive.gnss.model_copy(update={"lever_arm_m": arm})
    stated = stated_arm(replace(drive, manifest=drive.manifest.model_copy(update={"gnss": gnss})))
    assert (stated is not None) == believed
