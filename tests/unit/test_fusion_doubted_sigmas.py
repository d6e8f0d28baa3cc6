"""What is doubted is as unsure as it shows: velocities, headings, instants, fixes by themselves."""

from __future__ import annotations

import math
from dataclasses import fields as dataclass_fields
from dataclasses import replace

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.fusion.doubts.constancy import constancy_doubts, move_of
from automap.fusion.doubts.difference import off_course
from automap.fusion.doubts.outcome import weak_heading
from automap.fusion.doubts.path import Misses
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.receiver import receiver_doubts, usable_fixes
from automap.fusion.fix_levels import fix_levels
from automap.fusion.gnss_only import smooth_fixes, uncorrected
from automap.fusion.options import FusionOptions
from automap.fusion.output import ParameterHistory
from automap.fusion.verdict_alone import seen_at_sensor, weigh_alone
from automap.fusion.widening import widen
from automap.lever_arm import moved_to
from automap.records import Fixes, FixType, FloatArray, Trajectory
from automap.sync.velocity_consistency import velocity_consistency
from tests.slow_cases import others_slow
from tests.unit.fusion_drive import CLOCK
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive
from tests.unit.receiver_scene import Receiver as SoldReceiver
from tests.unit.receiver_scene import any_receiver, simulated_fixes

NONE = Misses(np.zeros(0), *(np.zeros((0, 3)) for _ in range(3)))
DOUBT = [Reason("a", "")]


def winding_path(seconds: int = 200) -> Trajectory:
    """Ten rows a second at 10 m/s through bends of half a minute."""
    n = seconds * 10
    t = 0.1 * np.arange(n)
    yaw = 1.2 * np.sin(2.0 * np.pi * t / 30.0)
    velocity = 10.0 * np.column_stack([np.cos(yaw), np.sin(yaw), 0.0 * t])
    place = np.cumsum(velocity, axis=0) * 0.1
    lat = place[:, 0] / metres_per_radian(0.0, 0.0)[0]
    lon = place[:, 1] / metres_per_radian(0.0, 0.0)[1]
    rpy = np.column_stack([0.0 * t, 0.0 * t, yaw])
    return Trajectory(
        *(np.rint(t * 1e9).astype(np.int64), 1.4e9 + t, lat, lon, 0.0 * t, velocity, rpy),
        *(np.full((n, 3), 0.5), np.full((n, 3), 0.05), np.full((n, 3), 0.005)),
    )


def test_a_doubted_heading_and_velocity_are_as_unsure_as_they_are_off_the_fixes_own() -> None:
    path = winding_path()
    alone = replace(
        path,
        vel_ned=path.vel_ned + np.array([0.0, 0.8, 0.0]),
        rpy=path.rpy + np.array([0.0, 0.0, np.radians(4.0)]),
    )
    wide = widen(path, DOUBT, NONE, alone)
    assert np.degrees(wide.sd_rpy[:, 2]) == pytest.approx(4.0, rel=0.01)
    assert wide.sd_vel_ned[:, 1] == pytest.approx(0.8, rel=0.01)
    assert wide.sd_vel_ned[:, 0] == pytest.approx(0.05)
    # where nothing is doubted nothing is widened
    half = widen(path, [Reason("a", "", ((0.0, 100.0),))], NONE, alone)
    assert half.sd_rpy[1500, 2] == path.sd_rpy[1500, 2]
    # at rest a course says nothing of a heading
    rest = replace(alone, vel_ned=np.zeros_like(path.vel_ned))
    assert widen(path, DOUBT, NONE, rest).sd_rpy[:, 2] == pytest.approx(0.005)


def test_an_arm_and_an_age_of_the_fixes_widen_nothing() -> None:
    """The path of fixes is that of their antenna, at their tags: 1.5 and 3 m from the sensor's."""
    path, arm, age = winding_path(), np.array([1.2, -0.9, -1.0]), 0.3
    antenna = moved_to(path, arm)
    alone = replace(antenna, gps_s=path.gps_s + age)
    inside = slice(50, -50)
    wide = widen(path, DOUBT, NONE, seen_at_sensor(alone, arm, age))
    assert wide.sd_pos_ned[inside] == pytest.approx(0.5, rel=1e-3)
    assert wide.sd_vel_ned[inside, 2] == pytest.approx(0.05, rel=1e-3)
    assert (widen(path, DOUBT, NONE, alone).sd_pos_ned[inside, 0] > 1.0).all()


def test_what_may_be_of_another_instant_is_as_unsure_as_it_changes() -> None:
    path = winding_path()
    wide = widen(path, [Reason("a", "", late_s=0.8)], NONE, None)
    inside = slice(20, -20)
    late, early = (np.roll(path.rpy[:, 2], k) for k in (8, -8))
    turned = np.maximum(np.abs(late - path.rpy[:, 2]), np.abs(early - path.rpy[:, 2]))
    assert wide.sd_rpy[inside, 2] == pytest.approx(np.hypot(turned, 0.005)[inside], rel=1e-3)
    # tilts as headings: they were 5 sigmas off beside fixes that are late by a tenth of a second
    tilts = np.column_stack([0.03 * np.sin(path.gps_s), 0.05 * np.cos(0.7 * path.gps_s)])
    swaying = replace(path, rpy=np.column_stack([tilts, path.rpy[:, 2]]))
    tilted = widen(swaying, [Reason("a", "", moved_s=0.8)], NONE, None)
    most = np.max([np.abs(np.roll(tilts, k, axis=0) - tilts) for k in (8, -8)], axis=0)
    expected = np.hypot(most, path.sd_rpy[:, :2])[inside]
    np.testing.assert_allclose(tilted.sd_rpy[inside, :2], expected, rtol=1e-3)
    np.testing.assert_array_equal(tilted.sd_pos_ned, path.sd_pos_ned)
    # the way of that time, in any direction
    assert np.hypot(*wide.sd_pos_ned[inside, :2].T).max() == pytest.approx(8.0, abs=0.2)
    # and on a climb of a tenth its height
    up = replace(path, height_m=np.arange(len(path)) * 0.1)
    high = widen(up, [Reason("a", "", late_s=0.8)], NONE, None).sd_pos_ned
    assert high[inside, 2] == pytest.approx(np.hypot(0.5, 0.8), rel=1e-3)
    standing = replace(path, lat_rad=0 * path.lat_rad, lon_rad=0 * path.lon_rad)
    assert widen(standing, [Reason("a", "", late_s=0.8)], NONE, None).sd_pos_ned.max() == 0.5


# positions that are older than the velocities beside them


def with_late_positions(fixes: Fixes, late_s: float) -> Fixes:
    told = [
        np.interp(fixes.gps_s - late_s, fixes.gps_s, v)
        for v in (fixes.lat_rad, fixes.lon_rad, fixes.height_m)
    ]
    return replace(fixes, lat_rad=told[0], lon_rad=told[1], height_m=told[2])


@pytest.mark.parametrize("seed", others_slow(range(20), 6))
def test_no_receiver_as_they_are_sold_has_late_positions(seed: int) -> None:
    receiver = any_receiver(np.random.default_rng(seed))
    assert velocity_consistency(simulated_fixes(seed, receiver, 120.0)).positions_late_s == 0.0


def test_late_positions_are_told_dated_back_and_unsure_by_it() -> None:
    motion = city_drive(240.0, 3)
    fixes = receive(motion, Receiver(), 4)
    late = with_late_positions(fixes, 0.9)
    found = velocity_consistency(late)
    assert found.positions_late_s == pytest.approx(0.9, abs=0.1)
    (reason,) = receiver_doubts(found, 0.0)
    assert reason.code == "positions_late"
    # what is left is how late the velocities are themselves
    assert 0.5 < reason.late_s < 0.6
    (known,) = receiver_doubts(found, 0.0, velocity_late_s=0.2)
    assert (reason.state, known.state) == ("doubtful", "good")
    assert known.late_s == pytest.approx(reason.late_s - 0.3)
    back = usable_fixes(late, found)
    north = metres_per_radian(float(fixes.lat_rad[0]), 0.0)[0]
    off = np.abs(back.lat_rad - fixes.lat_rad) * north
    assert np.nanmedian(off) < 0.6
    assert np.isnan(off).sum() < 8
    weighed = weigh_alone(back, CLOCK, FusionOptions(), found)
    assert weighed.verdict.state == "doubtful"
    error, sd = errors(weighed.trajectory, motion)
    assert np.mean(np.hypot(*(error / sd)[:, :2].T) < 2.45) > 0.95


# fixes by themselves, whose figures promise too much


def errors(path: Trajectory, motion: object) -> tuple[FloatArray, FloatArray]:
    """Errors NED [m, 3] m of a path on ``motion`` and their stated sigmas."""
    true = motion.at(path.gps_s - 1_400_000_000.0)  # type: ignore[attr-defined]
    north, east = metres_per_radian(true.lat, true.height)
    off = np.column_stack(
        [
            (path.lat_rad - true.lat) * north,
            (path.lon_rad - true.lon) * east,
            true.height - path.height_m,
        ]
    )
    return off, path.sd_pos_ned


@pytest.mark.slow
def test_accuracies_that_the_velocities_contradict_are_not_believed() -> None:
    options, held = FusionOptions(), []
    for seed in (1, 2, 3):
        motion = city_drive(300.0, seed)
        honest = receive(motion, Receiver(wander=(3.0, 3.0, 4.0), tau=120.0), seed)
        sure = replace(honest, sd_pos_ned=honest.sd_pos_ned / 8.0)
        weighed = weigh_alone(sure, CLOCK, options, velocity_consistency(sure))
        error, sd = errors(weighed.trajectory, motion)
        held.append(np.mean(np.abs(error / sd) < 1.96))
        levels = fix_levels(honest, options)
        assert max(levels["wander"], levels["wander_v"], levels["position_h"]) <= 2.0
    assert np.mean(held) > 0.9


def test_velocities_better_than_stated_make_no_velocity_surer() -> None:
    motion = city_drive(200.0, 5)
    fixes = receive(motion, Receiver(velocity=0.03), 5)
    options = FusionOptions()
    levels = fix_levels(fixes, options)
    assert levels["velocity_h"] < 1.0
    told = smooth_fixes(fixes, CLOCK, options, levels).sd_vel_ned
    plain = smooth_fixes(fixes, CLOCK, options).sd_vel_ned
    assert np.all(told >= 0.999 * plain)


# positions that jump


@pytest.mark.parametrize(("begin", "end", "aside"), [(100, 150, [1]), (100, 240, [0, 1])])
def test_positions_between_jumps_are_as_unsure_as_they_jumped(
    begin: int, end: int, aside: list[int]
) -> None:
    """A minute aside of most of a drive is aside; of two halves nobody knows which is."""
    fixes = simulated_fixes(7, SoldReceiver(wander_m=0.5, jumps_an_hour=0.0), 240.0)
    assert velocity_consistency(fixes).aside == ()
    t = fixes.gps_s - fixes.gps_s[0]
    north = 30.0 / metres_per_radian(float(fixes.lat_rad[0]), 0.0)[0]
    off = replace(fixes, lat_rad=fixes.lat_rad + north * ((t > begin) & (t < end)))
    found = velocity_consistency(off)
    assert len(found.aside) == len(aside)
    assert [i.metres for i in found.aside] == pytest.approx([30.0] * len(aside), abs=4.0)
    middle = [0.5 * (i.start_gps_s + i.end_gps_s) - fixes.gps_s[0] for i in found.aside]
    assert [int(m > begin) for m in middle] == aside
    told = {reason.code: reason for reason in receiver_doubts(found, float(fixes.gps_s[0]))}
    assert told["positions_aside"].error_m == pytest.approx(30.0, abs=4.0)
    assert not told["positions_aside"].handled


# what is one number all through a drive


def known_by_and_by(
    change: float, seed: int, scatter: float = 1.0, lasts: int = 1
) -> ParameterHistory:
    """A filter's estimates of a delay from a measurement a second, which becomes another half-way,
    beside a prior of 0.05 s; and of a mounting that stays. In the first quarter measurements err
    ``scatter`` times as much as the filter believes, and ``lasts`` s in a row alike."""
    rng = np.random.default_rng(seed)
    n, sd = 200, 0.1
    true = np.where(np.arange(n) < n // 2, 0.0, change)
    error = np.repeat(rng.standard_normal(n), lasts)[:n]
    told = true + sd * np.where(np.arange(n) < n // 4, scatter, 1.0) * error
    weight = 1.0 / 0.05**2 + np.arange(1, n + 1) / sd**2
    value = np.cumsum(told / sd**2) / weight
    steady = np.cumsum(rng.standard_normal(n) / sd) / weight
    names = ("imu_time_offset_s", "imu_mounting_yaw")
    spread = np.column_stack([weight**-0.5] * 2)
    t_ns = (np.arange(n) * 1e9).astype(np.int64)
    return ParameterHistory(t_ns, names, np.column_stack([value, steady]), spread)


@pytest.mark.parametrize(("scatter", "lasts"), [(1.0, 1), (4.0, 1), (3.0, 3)])
def test_a_delay_that_stays_is_not_said_to_change(scatter: float, lasts: int) -> None:
    """As in a town before a motorway, which the filter takes for one."""
    found = [
        move_of(known_by_and_by(0.0, seed, scatter, lasts), "imu_time_offset_s")
        for seed in range(200)
    ]
    chances = np.array([move.chance for move in found if move is not None])
    assert len(chances) == 200
    assert np.mean(chances < 0.05) < 0.08
    assert chances.min() > 1e-4


def test_a_delay_that_becomes_another_is_told_with_its_size() -> None:
    (reason,) = constancy_doubts(known_by_and_by(0.25, 3))
    assert (reason.code, reason.state) == ("age_changes", "doubtful")
    assert "cut the drive there" in reason.text
    assert reason.late_s == pytest.approx(0.25, abs=0.06)
    # what chance may still make leaves a path good, and as unsure as that
    (reason,) = constancy_doubts(known_by_and_by(0.07, 3))
    assert reason.state == "good"
    assert "the stated uncertainty includes it" in reason.text
    assert "cut" not in reason.text
    path = winding_path()
    wide = widen(path, [reason], NONE, replace(path, vel_ned=path.vel_ned + 1.0))
    assert wide.sd_vel_ned.max() < 0.8
    # by the probability that it changed, of which chance makes as much once in 226 drives
    slight = known_by_and_by(0.03, 3)
    (reason,), move = constancy_doubts(slight), move_of(slight, "imu_time_offset_s")
    assert move is not None
    odds = 1.0 / (28.0 * -math.e * move.chance * math.log(move.chance))
    assert reason.late_s == pytest.approx(abs(move.size) * math.sqrt(odds / (1.0 + odds)))
    assert reason.moved_s == reason.late_s < 0.7 * abs(move.size)
    assert np.hypot(*wide.sd_pos_ned[:, :2].T).max() > 0.9
    # positions by carrier phase are of their instant: it is the IMU's stamps that vary
    (dated,) = constancy_doubts(known_by_and_by(0.07, 3), dated=True)
    held = widen(path, [dated], NONE, replace(path, vel_ned=path.vel_ned + 1.0))
    np.testing.assert_array_equal(held.sd_pos_ned, path.sd_pos_ned)
    np.testing.assert_array_equal(held.sd_vel_ned, wide.sd_vel_ned)
    np.testing.assert_array_equal(held.sd_rpy, wide.sd_rpy)
    (other,) = constancy_doubts(known_by_and_by(0.25, 3), dated=True)
    assert other.late_s == pytest.approx(0.25, abs=0.06)
    assert list(constancy_doubts(known_by_and_by(0.0, 3))) == []


def test_an_imu_that_was_turned_is_told() -> None:
    found = known_by_and_by(0.35, 3)
    turned = replace(found, names=("imu_mounting_yaw", "imu_time_offset_s"))
    (reason,) = constancy_doubts(turned)
    assert reason.code == "mounting_changes"
    assert "by 20 deg" in reason.text or "by 2" in reason.text


def test_an_antenna_that_sits_elsewhere_is_told_with_the_way() -> None:
    moved = replace(known_by_and_by(0.4, 3), names=("gnss_lever_arm_x", "gnss_lever_arm_y"))
    (reason,) = constancy_doubts(moved)
    assert (reason.code, reason.state) == ("arm_changes", "doubtful")
    assert reason.error_m == pytest.approx(0.4, abs=0.1)
    steady = replace(known_by_and_by(0.0, 3), names=moved.names)
    assert list(constancy_doubts(steady)) == []


def test_the_ways_to_the_next_positions_make_no_position_late() -> None:
    fixes = receive(city_drive(200.0, 6), Receiver(rate=1.0), 6)
    north, east = metres_per_radian(fixes.lat_rad, fixes.height_m)
    step = np.diff(fixes.gps_s)
    velocity = fixes.vel_ned.copy()
    velocity[:-1, 0] = np.diff(fixes.lat_rad) * north[:-1] / step
    velocity[:-1, 1] = np.diff(fixes.lon_rad) * east[:-1] / step
    velocity[:-1, 2] = -np.diff(fixes.height_m) / step
    found = velocity_consistency(replace(fixes, vel_ned=velocity))
    assert found.means is not None
    assert found.positions_late_s == 0.0


def test_without_corrections_no_path_is_surer_than_satellites_are() -> None:
    options = FusionOptions()
    fixes = receive(city_drive(60.0, 8), Receiver(), 8)
    path = replace(winding_path(60), gps_s=np.linspace(fixes.gps_s[0], fixes.gps_s[-1], 600))
    path = replace(path, sd_pos_ned=np.full((600, 3), 0.1))
    least = options.common_horizontal_sd_m * np.array([1.0, 1.0, 1.5])
    assert uncorrected(path, fixes, options).sd_pos_ned == pytest.approx(np.tile(least, (600, 1)))
    fixed = replace(fixes, fix_type=np.full(len(fixes), FixType.FIXED))
    assert uncorrected(path, fixed, options).sd_pos_ned.max() == 0.1


def test_minutes_that_are_none_leave_positions_off_by_kilometres_unless_an_imu_feels_them() -> None:
    fixes = simulated_fixes(5, SoldReceiver(), 180.0)
    wrong = velocity_consistency(replace(fixes, vel_ned=fixes.vel_ned / 0.6))
    (reason,) = (r for r in receiver_doubts(wrong, 0.0) if r.code == "velocity_unit")
    assert not reason.handled
    assert reason.error_m > 40e3
    (reason,) = (r for r in receiver_doubts(wrong, 0.0, felt=True) if r.code == "velocity_unit")
    assert reason.handled
    # a unit that no minutes explain is one
    unit = velocity_consistency(replace(fixes, vel_ned=3.6 * fixes.vel_ned))
    (reason,) = (r for r in receiver_doubts(unit, 0.0) if r.code == "velocity_unit")
    assert reason.handled


def test_a_heading_that_is_the_course_is_not_weak_however_the_start_was_found() -> None:
    path = winding_path()
    assert weak_heading(1.0, off_course(path, path)) == []
    behind = replace(path, rpy=path.rpy + np.array([0.0, 0.0, np.pi]))
    assert [r.code for r in weak_heading(1.0, off_course(path, behind))] == ["heading_weak"]
    standing = replace(path, vel_ned=np.zeros_like(path.vel_ned))
    reasons = weak_heading(1.0, off_course(path, standing))
    assert [r.code for r in reasons] == ["heading_weak"]
    assert (widen(standing, reasons, NONE, None).sd_rpy[:, 2] > np.radians(100.0)).all()


def test_rows_that_say_again_what_was_said_before_tell_nothing() -> None:
    fixes = receive(city_drive(120.0, 9), Receiver(rate=1.0), 9)
    rows = np.repeat(np.arange(len(fixes)), 10)
    again = Fixes(**{f.name: getattr(fixes, f.name)[rows] for f in dataclass_fields(fixes)})
    again = replace(again, gps_s=fixes.gps_s[0] + 0.1 * np.arange(len(again)))
    usable = usable_fixes(again, velocity_consistency(again))
    # at rest, too, a receiver tells once a second where it is
    assert (np.hypot(*fixes.vel_ned[:, :2].T) < 0.9).any()
    assert (np.isfinite(usable.lat_rad) == (np.arange(len(again)) % 10 == 0)).all()
    plain = usable_fixes(fixes, velocity_consistency(fixes))
    assert np.isfinite(plain.lat_rad).all()
