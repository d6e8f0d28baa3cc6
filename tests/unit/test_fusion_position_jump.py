"""Positions good to decimetres that jump where no vehicle did are told, and what vehicles, sigmas
and single wild fixes do is not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from automap.fusion.doubts.hole import regained_jumps
from automap.fusion.doubts.position_jump import (
    Jump,
    beside_readings,
    height_jumps,
    heights_of,
    jump_doubts,
    places_of,
    position_jumps,
)
from automap.fusion.nodes import model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.output import Innovations
from automap.fusion.widening import widen
from automap.records import Fixes, FixType, FloatArray, Trajectory
from tests.unit.fusion_receiver import GPS0, Receiver, receive, shifted
from tests.unit.test_fusion_doubted_sigmas import NONE
from tests.unit.test_fusion_velocity_step import drive, free_of, path_of

RTK = Receiver(rate=5.0, wander=(0.008, 0.008, 0.015), white=(0.004, 0.004, 0.008))
OFF_RAD = (0.01, -0.01, 0.01)
"""What the path's attitude is off by."""


@cache
def exact(seed: int = 3, rate: float = 5.0) -> Fixes:
    fixes = receive(drive(seed)[0], replace(RTK, rate=rate), seed)
    return replace(
        fixes,
        vel_ned=np.full_like(fixes.vel_ned, np.nan),
        sd_pos_ned=np.full((len(fixes), 3), 0.014),
        fix_type=np.full(len(fixes), FixType.FIXED),
    )


def moved(fixes: Fixes, start: float, stop: float, by: FloatArray) -> Fixes:
    t = fixes.gps_s - GPS0
    return shifted(fixes, ((t >= start) & (t < stop))[:, None] * np.append(by, 0.0))


def jumps_of(fixes: Fixes, seed: int | None = 3) -> list[Jump]:
    """Beside the readings of the drive ``seed``, or by themselves."""
    places = places_of(model_fixes(fixes, fixes.gps_s, FusionOptions()))
    if seed is None:
        return position_jumps(places)
    motion, imu = drive(seed)
    path = path_of(motion, imu, OFF_RAD)
    return position_jumps(beside_readings(places, free_of(imu), path, np.zeros(3), 0.0))


@pytest.mark.parametrize("rate", [1.0, 5.0])
@pytest.mark.parametrize("seed", [3, 11])
def test_a_sound_drive_has_no_jump(seed: int, rate: float) -> None:
    assert jumps_of(exact(seed, rate), seed) == []
    assert jumps_of(exact(seed, rate), None) == []


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_what_an_imu_does_not_feel_is_told_with_size_and_instant(rate: float) -> None:
    by = np.array([1.1, -0.9])
    found = jumps_of(moved(exact(rate=rate), 100.1, 130.1, by))
    assert [jump.gps_s - GPS0 for jump in found] == pytest.approx([100.0, 130.0], abs=1.0)
    assert found[0].by == pytest.approx([*by, 0.0], abs=0.2)
    assert found[1].by == pytest.approx([*-by, 0.0], abs=0.2)


@pytest.mark.parametrize("by_m", [0.0, 3.0, 6.5])
def test_of_a_usual_receiver_jumps_beyond_the_steps_of_sound_ones_are_told(by_m: float) -> None:
    """A path followed 8 m within seconds, and was stated to be good to 2 m."""
    white = np.random.default_rng(8).normal(0.0, 0.15, (len(exact()), 3))
    fixes = replace(
        shifted(exact(), white),
        sd_pos_ned=np.full((len(exact()), 3), 1.3),
        fix_type=np.full(len(exact()), FixType.THREE_D),
    )
    found = jumps_of(moved(fixes, 100.1, 1e3, by_m * np.array([0.6, -0.8])))
    assert len(found) == (by_m > 5.0)
    for jump in found:
        assert jump.gps_s - GPS0 == pytest.approx(100.0, abs=0.3)
        assert np.hypot(*jump.by[:2]) == pytest.approx(by_m, abs=0.6)
    # without an IMU nothing tells them from what such fixes err by
    assert jumps_of(moved(fixes, 100.1, 1e3, by_m * np.array([0.6, -0.8])), None) == []


@pytest.mark.parametrize("seed", [3, 11])
def test_heights_that_an_imu_does_not_feel_are_told(seed: int) -> None:
    """Four decimetres, which at 15 m/s may be a body that pitches, were 2.8 sigmas off."""
    fixes = exact(seed)
    t = fixes.gps_s - GPS0
    up = shifted(fixes, ((t >= 100.1) & (t < 130.1))[:, None] * np.array([0.0, 0.0, -0.4]))
    motion, imu = drive(seed)
    free, path = free_of(imu), path_of(motion, imu, OFF_RAD)
    for log in (fixes, up):
        model = model_fixes(log, log.gps_s, FusionOptions())
        seen = beside_readings(heights_of(model), free, path, np.zeros(3), 0.0)
        found = position_jumps(seen)
        if log is fixes:
            assert found == []
            continue
        assert [jump.gps_s - GPS0 for jump in found] == pytest.approx([100.0, 130.0], abs=1.0)
        assert found[0].by == pytest.approx([0.0, 0.0, 0.4], abs=0.06)
        assert found[1].by == pytest.approx([0.0, 0.0, -0.4], abs=0.06)


def test_what_no_tyres_hold_is_told_without_an_imu() -> None:
    by = np.array([1.0, 0.8])
    (jump,) = jumps_of(moved(exact(), 100.1, 1e3, by), None)
    assert jump.gps_s - GPS0 == pytest.approx(100.1, abs=0.2)
    # once a second a vehicle may have gained as much
    assert jumps_of(moved(exact(rate=1.0), 100.1, 1e3, by), None) == []


def test_brakes_that_lock_and_bends_at_the_limit_are_no_jump() -> None:
    """From 30 m/s to rest by 9.8 m/s^2, and the same to the side at once."""
    fixes = exact()
    t = fixes.gps_s - GPS0
    way = 30.0 * t - np.where(t > 50.03, 0.5 * 9.8 * np.clip(t - 50.03, 0.0, 30.0 / 9.8) ** 2, 0.0)
    aside = np.where(np.abs(t - 20.11) < 1.3, 0.5 * 9.8 * (1.3 - np.abs(t - 20.11)) ** 2, 0.0)
    straight = replace(fixes, lat_rad=0.6 + way / 6.36e6, lon_rad=0.2 + 0.7 * aside / 6.38e6)
    assert jumps_of(straight, None) == []


def test_one_wild_fix_and_fixes_that_err_by_metres_are_none() -> None:
    by = np.array([2.0, 0.0])
    assert jumps_of(moved(exact(), 100.1, 100.25, by)) == []
    assert jumps_of(moved(exact(), 100.1, 100.25, by), None) == []
    unsure = replace(exact(), sd_pos_ned=np.full((len(exact()), 3), 1.5))
    assert jumps_of(moved(unsure, 100.1, 130.1, by)) == []
    # a float solution says of itself that it is good to decimetres
    t = exact().gps_s - GPS0
    part = np.where((t > 100.1) & (t < 130.1), 0.25, 0.014)
    floating = replace(exact(), sd_pos_ned=np.tile(part[:, None], (1, 3)))
    assert jumps_of(moved(floating, 100.1, 130.1, 0.3 * by)) == []


def _path(seconds: float = 200.0) -> Trajectory:
    t = np.arange(0.0, seconds + 0.05, 0.1)
    zero, three = np.zeros(len(t)), np.zeros((len(t), 3))
    sd = np.full((len(t), 3), 0.02)
    stamps = np.rint(t * 1e9).astype(np.int64)
    return Trajectory(stamps, GPS0 + t, zero, zero, zero, three, three, sd, sd, sd)


def test_each_place_is_right_as_probably_as_it_lasted() -> None:
    """Half of the drive elsewhere: either half may be. Five seconds in 200: they are."""
    path = _path()
    assert list(jump_doubts([], path)) == []
    by = np.array([1.2, 0.9, 2.0])
    (half,) = jump_doubts([Jump(GPS0 + 100.0, by)], path)
    assert (half.code, half.state, half.spans) == ("positions_jump", "doubtful", ())
    assert "positions jump by 2.5 m at" in half.text
    assert half.error_m == pytest.approx(1.5 * np.sqrt(0.5), rel=1e-3)
    assert half.height_m == pytest.approx(2.0 * np.sqrt(0.5), rel=1e-3)
    # an error of the whole jump lies in the ellipse of 95 %
    sd = widen(path, [half], NONE, None).sd_pos_ned[:, :2]
    assert ((np.array([1.2, 0.9]) / sd) ** 2).sum(axis=1).max() < 5.99
    back = [Jump(GPS0 + t, s * by) for t, s in ((100.0, 1.0), (105.0, -1.0))]
    (short,) = jump_doubts(back, path)
    assert short.spans == (pytest.approx((97.0, 108.0)),)
    assert short.error_m == pytest.approx(1.5 * np.sqrt(0.975), rel=1e-3)
    assert "2 times, by up to 2.5 m" in short.text
    # what does not come back may as well have been wrong before
    (last,) = jump_doubts([Jump(GPS0 + 195.0, by)], path)
    assert last.spans == ()


@pytest.mark.parametrize(
    ("nis", "off_m", "state"),
    [(60.0, 1.0, "doubtful"), (25.0, 1.0, "good"), (8.0, 1.0, ""), (60.0, 0.1, "")],
)
def test_fixed_positions_behind_a_float_are_not_elsewhere(
    nis: float, off_m: float, state: str
) -> None:
    """Half a minute of float, and a filter that led elsewhere, by readings stamped late."""
    fixes, path, late_s = exact(), _path(), 0.15
    floating = np.abs(fixes.gps_s - GPS0 - 60.0) < 15.0
    fixes = replace(fixes, sd_pos_ned=np.where(floating, 0.28, 0.014)[:, None] * np.ones(3))
    tag = fixes.gps_s[(fixes.gps_s > path.gps_s[0]) & (fixes.gps_s < path.gps_s[-1] - 1.0)]
    stamps = np.rint((np.repeat(tag, 3) - GPS0 + late_s) * 1e9).astype(np.int64)
    back = np.argmax(tag - GPS0 > 74.9)
    off = np.zeros((len(tag), 3))
    off[back] = off_m * np.array([0.8, -0.6, -1.0])
    each = np.where(np.arange(len(tag)) == back, nis, 2.0).repeat(3)
    names = np.array([f"position_{axis}" for axis in "ned"] * len(tag), dtype=object)
    told = Innovations(stamps, names, off.ravel(), np.ones(len(each)), each, each < 10.0)
    found = regained_jumps(model_fixes(fixes, fixes.gps_s, FusionOptions()), told, path, -late_s)
    reasons = list(jump_doubts(found, path))
    assert [reason.state for reason in reasons] == [state] * bool(state)
    if state:
        assert found[0].gps_s == pytest.approx(tag[back])
        assert found[0].by == pytest.approx([0.8, -0.6, 1.0])


@pytest.mark.parametrize("rate", [1.0, 5.0])
@pytest.mark.parametrize(
    ("by_m", "told"), [(30.0, True), (-12.0, True), (4.0, False), (0.0, False)]
)
def test_heights_that_jump_by_more_than_they_err_are_told(
    rate: float, by_m: float, told: bool
) -> None:
    """Where the vehicle drives its hills, with a receiver that is 1.5 m off for minutes."""
    motion, imu = drive(3)
    fixes = receive(motion, Receiver(rate=rate, wander=(1.0, 1.0, 1.5)), 3)
    fixes = replace(fixes, sd_pos_ned=np.full((len(fixes), 3), 1.5))
    late = (fixes.gps_s - GPS0 > 100.1)[:, None]
    # and a burst of three wild ones, which is no jump
    burst = (np.arange(len(fixes)) // 3 == len(fixes) // 4)[:, None]
    fixes = shifted(fixes, late * np.array([0.0, 0.0, -by_m]) + burst * np.array([0.0, 0.0, 20.0]))
    path = path_of(motion, imu, OFF_RAD)
    found = height_jumps(model_fixes(fixes, fixes.gps_s, FusionOptions()), path)
    assert len(found) == told
    if told:
        assert found[0].gps_s - GPS0 == pytest.approx(100.0, abs=1.0)
        assert found[0].by == pytest.approx([0.0, 0.0, by_m], abs=1.5)
        (reason,) = jump_doubts(found, path)
        assert (reason.code, reason.error_m) == ("heights_jump", 0.0)
        widest = widen(path, [reason], NONE, None).sd_pos_ned[:, 2].max()
        assert 0.4 * abs(by_m) < widest < abs(by_m)


@pytest.mark.parametrize("by_m", [0.0, 0.5])
def test_heights_of_carrier_phases_that_jump_are_told_from_fix_to_fix(by_m: float) -> None:
    """Over seconds a body's pitch and the way would make as much."""
    motion, imu = drive(3)
    fixes = exact()
    late = (fixes.gps_s - GPS0 > 100.1)[:, None]
    fixes = shifted(fixes, late * np.array([0.0, 0.0, -by_m]))
    path = path_of(motion, imu, OFF_RAD)
    found = height_jumps(model_fixes(fixes, fixes.gps_s, FusionOptions()), path)
    assert [jump.by[2] for jump in found] == pytest.approx([by_m] * bool(by_m), abs=0.1)
