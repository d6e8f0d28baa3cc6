"""Positions that drift over minutes by more than their receiver states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.adapt import COARSE
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.slow_drift import (
    Drift,
    beside_motion,
    drifting,
    pattern_doubts,
    slow_drifts,
)
from automap.fusion.fix_axes import usable_epochs
from automap.fusion.fix_levels import fix_levels
from automap.fusion.gnss_only import smooth_fixes
from automap.fusion.options import FusionOptions
from automap.records import Fixes, Trajectory
from tests.slow_cases import others_slow
from tests.unit.fusion_drive import CLOCK
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive, shifted

OPTIONS = FusionOptions()
U_BLOX = Receiver(rate=5.0)
PHONE = Receiver(rate=1.0, velocity=0.1, lasting=0.15, says_all=False)
RECORDED = Receiver(rate=1.0, velocity=0.02, lasting=0.06, says_all=False)
"""As a recorded phone, whose velocities lose 2 to 4 m in five minutes."""
PULSE_M = np.array([12.0 * 0.6, 12.0 * 0.8, 0.0])


def drive(receiver: Receiver, seed: int, seconds: float = 300.0) -> Fixes:
    return receive(city_drive(seconds, seed), receiver, seed + 1)


def with_pulse(fixes: Fixes, begin_s: float = 30.0) -> Fixes:
    """With twelve metres that come and go in four minutes, as of the air."""
    part = np.clip((fixes.gps_s - GPS0 - begin_s) / 240.0, 0.0, 1.0)
    return shifted(fixes, (0.5 - 0.5 * np.cos(2.0 * np.pi * part))[:, None] * PULSE_M)


def drifts_of(fixes: Fixes) -> list[Drift]:
    levels = fix_levels(fixes, OPTIONS)
    alone = smooth_fixes(fixes, CLOCK, OPTIONS, levels)
    return slow_drifts(usable_epochs(fixes, OPTIONS), alone, OPTIONS, levels, GPS0)


def beside(fixes: Fixes, path: Trajectory) -> list[Drift]:
    """The same beside a path that an IMU has made."""
    levels = fix_levels(fixes, OPTIONS)
    alone = smooth_fixes(fixes, CLOCK, OPTIONS, levels)
    off, motion, by_imu = beside_motion(usable_epochs(fixes, OPTIONS), alone, levels, path, {})
    return slow_drifts(off, motion, OPTIONS, by_imu, GPS0)


def followed(seconds: float, seed: int, begin_s: float | None) -> Trajectory:
    """The true motion as an IMU's path has it that goes where the positions do."""
    t = np.arange(0.0, seconds + 0.05, 0.1)
    motion = city_drive(seconds, seed)
    true = motion.at(t)
    rows = Receiver(rate=10.0, wander=(0.0,) * 3, white=(0.0,) * 3, velocity=0.0)
    fixes = receive(motion, rows, seed)
    if begin_s is not None:
        fixes = with_pulse(fixes, begin_s)
        part = np.clip((t - begin_s) / 240.0, 0.0, 1.0)
        rate = np.pi / 240.0 * np.sin(2.0 * np.pi * part)
        fixes = replace(fixes, vel_ned=fixes.vel_ned + rate[:, None] * PULSE_M)
    none = np.zeros((len(t), 3))
    places = fixes.lat_rad, fixes.lon_rad, fixes.height_m
    assert np.allclose(true.lat, places[0], atol=1e-5)
    return Trajectory(fixes.offset, fixes.gps_s, *places, fixes.vel_ned, none, none, none, none)


@pytest.mark.parametrize("seed", others_slow([31, 41, 51, 61]))
def test_a_bias_of_minutes_is_told(seed: int) -> None:
    fixes = drive(U_BLOX, seed)
    assert all(drift.gain < 1.0 for drift in drifts_of(fixes))
    (drift,) = drifts_of(with_pulse(fixes))
    assert drift.gain > COARSE.gain
    assert 3.0 < drift.size < 8.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", others_slow([51, 31, 41, 61]))
def test_readings_tell_what_fixes_once_a_second_leave_open(seed: int) -> None:
    """Between two fixes of a phone the way is the IMU's, so that velocities tell more of a bias."""
    fixes = with_pulse(drive(RECORDED, seed))
    (alone,), (drift,) = drifts_of(fixes), beside(fixes, followed(300.0, seed, 30.0))
    assert drift.gain > max(COARSE.gain, alone.gain)
    part = np.clip((drift.gps_s - GPS0 - 30.0) / 240.0, 0.0, 1.0)
    off = (0.5 - 0.5 * np.cos(2.0 * np.pi * part))[:, None] * PULSE_M[:2]
    # a bell of one sign peaks at twice its spread and more beyond its mean
    square = (off**2 / (drift.sd_m**2 + 1.3**2)).sum(axis=1)
    assert square.mean() / 2 < 2.0
    quiet = drive(RECORDED, seed)
    assert all(drift.gain < 1.0 for drift in beside(quiet, followed(300.0, seed, None)))


@pytest.mark.slow
def test_the_sigmas_hold_a_drift_and_it_is_told() -> None:
    fixes = with_pulse(drive(U_BLOX, 61))
    levels = fix_levels(fixes, OPTIONS)
    alone = smooth_fixes(fixes, CLOCK, OPTIONS, levels)
    changed = Reason("age_changes", "", late_s=0.1, state="good")
    reasons, drifts = pattern_doubts(fixes, alone, OPTIONS, levels, 1.0, [changed])
    assert [reason.code for reason in reasons] == ["positions_drift"]
    wider = drifting(alone, drifts)
    expected = np.hypot(alone.sd_pos_ned[:, :2], drifts[0].sd_m)
    assert np.allclose(wider.sd_pos_ned[:, :2], expected)
    # twelve metres in two minutes, which change by 0.16 m/s where they do most
    assert 0.02 < drifts[0].rate_sd.max() < 0.3
    expected = np.hypot(alone.sd_vel_ned[:, :2], drifts[0].rate_sd)
    assert np.allclose(wider.sd_vel_ned[:, :2], expected)
    assert (wider.sd_pos_ned[:, 2] == alone.sd_pos_ned[:, 2]).all()
    # readings go on before the first fix and behind the last
    longer = replace(alone, gps_s=alone.gps_s + np.linspace(-2.0, 2.0, len(alone.gps_s)))
    wider = drifting(longer, drifts)
    ends = np.hypot(alone.sd_pos_ned[[0, -1], :2], drifts[0].sd_m[[0, -1]])
    assert np.allclose(wider.sd_pos_ned[[0, -1], :2], ends)
    # where something else parts positions and velocities, that tells how far
    parted = Reason("positions_parted", "", error_m=20.0)
    assert pattern_doubts(fixes, alone, OPTIONS, levels, 1.0, [parted]) == ([], [])


@pytest.mark.slow
@pytest.mark.parametrize("receiver", [U_BLOX, PHONE])
@pytest.mark.parametrize("seed", others_slow([31, 41, 51, 61]))
def test_a_receiver_that_errs_as_it_states_does_not_drift(receiver: Receiver, seed: int) -> None:
    for drift in drifts_of(drive(receiver, seed)):
        assert drift.gain < 1.0
        # of the stated metre, which the path has already
        assert drift.size < 1.2


@pytest.mark.slow
def test_only_the_window_that_drifts_is_less_sure() -> None:
    """Windows far from where a drive begins are judged as the first one is."""
    quiet = drive(Receiver(rate=2.0), 71, 1100.0)
    assert all(drift.gain < 1.0 for drift in drifts_of(quiet))
    told = [drift for drift in drifts_of(with_pulse(quiet, 700.0)) if drift.gain > COARSE.gain]
    assert [round(drift.gps_s[0] - GPS0) for drift in told] == [550]


def test_velocities_in_other_units_are_no_drift() -> None:
    """A scale of all velocities is likelier than positions that grow with the way."""
    fixes = drive(U_BLOX, 51)
    for scale in (0.98, 1.03):
        longer = replace(fixes, vel_ned=fixes.vel_ned * scale)
        assert all(drift.gain < COARSE.gain for drift in drifts_of(longer))


def test_fixes_without_velocities_show_no_drift() -> None:
    """Nothing then tells a drift from the way that was driven."""
    fixes = with_pulse(drive(U_BLOX, 31))
    unknown = np.full_like(fixes.vel_ned, np.nan)
    assert all(drift.gain < 1.0 for drift in drifts_of(replace(fixes, vel_ned=unknown)))


@pytest.mark.parametrize("seed", others_slow([131, 141, 151, 161]))
def test_velocities_that_err_for_ten_seconds_make_no_drift(seed: int) -> None:
    """What they add up to in minutes no level of seconds tells; waves of half a minute do."""
    fixes = drive(Receiver(rate=5.0, lasting=0.12, lasting_tau=10.0), seed)
    for drift in (*drifts_of(fixes), *beside(fixes, followed(300.0, seed, None))):
        assert drift.gain < COARSE.gain
