"""Positions that drift over minutes by more than their receiver states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.slow_drift import Drift, drifting, pattern_doubts, slow_drifts
from automap.fusion.fix_axes import usable_epochs
from automap.fusion.fix_levels import fix_levels
from automap.fusion.gnss_only import smooth_fixes
from automap.fusion.options import FusionOptions
from automap.records import Fixes
from tests.unit.fusion_drive import CLOCK
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive, shifted

OPTIONS = FusionOptions()
U_BLOX = Receiver(rate=5.0)
PHONE = Receiver(rate=1.0, velocity=0.1, lasting=0.15, says_all=False)
PULSE_M = np.array([12.0 * 0.6, 12.0 * 0.8, 0.0])


def drive(receiver: Receiver, seed: int, seconds: float = 300.0) -> Fixes:
    return receive(city_drive(seconds, seed), receiver, seed + 1)


def with_pulse(fixes: Fixes, begin_s: float = 30.0) -> Fixes:
    """With twelve metres that come and go in four minutes, as of the air."""
    part = np.clip((fixes.gps_s - GPS0 - begin_s) / 240.0, 0.0, 1.0)
    return shifted(fixes, (0.5 - 0.5 * np.cos(2.0 * np.pi * part))[:, None] * PULSE_M)


def drifts_of(fixes: Fixes, by_imu: dict[str, float] | None = None) -> list[Drift]:
    levels = fix_levels(fixes, OPTIONS)
    alone = smooth_fixes(fixes, CLOCK, OPTIONS, levels)
    kinds = [levels] if by_imu is None else [levels, by_imu]
    return slow_drifts(usable_epochs(fixes, OPTIONS), alone, OPTIONS, *kinds)


BY_IMU = {"wander": 1.25, "multipath": 1.0, "velocity_h": 1.0, "velocity_wander": 0.1}
"""As an IMU tells them of ``U_BLOX``."""


@pytest.mark.parametrize("seed", [31, 41, 51, 61])
def test_a_bias_of_minutes_is_told(seed: int) -> None:
    fixes = drive(U_BLOX, seed)
    assert all(drift.gain < 1.0 for drift in drifts_of(fixes, BY_IMU))
    (drift,) = drifts_of(with_pulse(fixes), BY_IMU)
    assert drift.gain > 3.0
    assert 2.0 < drift.sd_m < 6.0


def test_the_sigmas_hold_a_drift_and_it_is_told() -> None:
    fixes = with_pulse(drive(U_BLOX, 61))
    levels = fix_levels(fixes, OPTIONS)
    alone = smooth_fixes(fixes, CLOCK, OPTIONS, levels)
    reasons, drifts = pattern_doubts(fixes, alone, OPTIONS, levels, 1.0, [], BY_IMU)
    assert [reason.code for reason in reasons] == ["positions_drift"]
    wider = drifting(alone, drifts)
    assert (wider.sd_pos_ned[:, :2] >= drifts[0].sd_m).all()
    assert (wider.sd_pos_ned[:, 2] == alone.sd_pos_ned[:, 2]).all()
    # where something else parts positions and velocities, that tells how far
    parted = Reason("positions_parted", "", error_m=20.0)
    assert pattern_doubts(fixes, alone, OPTIONS, levels, 1.0, [parted], BY_IMU) == ([], [])


@pytest.mark.parametrize("receiver", [U_BLOX, PHONE])
@pytest.mark.parametrize("seed", [31, 41, 51, 61])
def test_a_receiver_that_errs_as_it_states_does_not_drift(receiver: Receiver, seed: int) -> None:
    assert all(drift.gain < 1.0 for drift in drifts_of(drive(receiver, seed)))


def test_only_the_window_that_drifts_is_less_sure() -> None:
    """Windows far from where a drive begins are judged as the first one is."""
    quiet = drive(Receiver(rate=2.0), 71, 1100.0)
    assert all(drift.gain < 1.0 for drift in drifts_of(quiet, BY_IMU))
    told = [drift for drift in drifts_of(with_pulse(quiet, 700.0), BY_IMU) if drift.gain > 3.0]
    assert [round(drift.start_s - GPS0) for drift in told] == [550]


def test_fixes_without_velocities_show_no_drift() -> None:
    """Nothing then tells a drift from the way that was driven."""
    fixes = with_pulse(drive(U_BLOX, 31))
    unknown = np.full_like(fixes.vel_ned, np.nan)
    assert all(drift.gain < 1.0 for drift in drifts_of(replace(fixes, vel_ned=unknown)))
