"""Positions that drift over minutes by more than their receiver states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.doubts.slow_drift import Drift, slow_drifts
from automap.fusion.fix_axes import usable_epochs
from automap.fusion.fix_levels import fix_levels
from automap.fusion.gnss_only import smooth_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.verdict import weigh_alone
from automap.records import Fixes
from automap.sync.velocity_consistency import velocity_consistency
from tests.unit.fusion_drive import BASE_NS, CLOCK
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive, shifted

OPTIONS = FusionOptions()
U_BLOX = Receiver(rate=5.0)
PHONE = Receiver(rate=1.0, velocity=0.1, lasting=0.15, says_all=False)
PULSE_M = np.array([8.0 * 0.6, 8.0 * 0.8, 0.0])


def drive(receiver: Receiver, seed: int, seconds: float = 300.0) -> Fixes:
    return receive(city_drive(seconds, seed), receiver, seed + 1)


def with_pulse(fixes: Fixes, begin_s: float = 30.0) -> Fixes:
    """With eight metres that come and go in four minutes, as of the air."""
    part = np.clip((fixes.gps_s - GPS0 - begin_s) / 240.0, 0.0, 1.0)
    return shifted(fixes, (0.5 - 0.5 * np.cos(2.0 * np.pi * part))[:, None] * PULSE_M)


def drifts_of(fixes: Fixes) -> list[Drift]:
    levels = fix_levels(fixes, OPTIONS)
    alone = smooth_fixes(fixes, CLOCK, OPTIONS, levels)
    return slow_drifts(usable_epochs(fixes, OPTIONS), alone, OPTIONS, levels)


@pytest.mark.parametrize("seed", [31, 41, 51])
def test_a_bias_of_minutes_is_told_and_held_by_the_sigmas(seed: int) -> None:
    fixes = with_pulse(drive(U_BLOX, seed))
    (drift,) = drifts_of(fixes)
    assert drift.gain > 3.0
    weighed = weigh_alone(fixes, CLOCK, OPTIONS, velocity_consistency(fixes))
    assert [r.code for r in weighed.verdict.reasons] == ["positions_drift"]
    path = weighed.trajectory
    true = city_drive(300.0, seed).at((path.t_ns - BASE_NS) * 1e-9)
    north = (path.lat_rad - true.lat) * 6.37e6
    east = (path.lon_rad - true.lon) * 6.37e6 * np.cos(true.lat)
    square = (north / path.sd_pos_ned[:, 0]) ** 2 + (east / path.sd_pos_ned[:, 1]) ** 2
    assert np.mean(square < 5.99) > 0.9


@pytest.mark.parametrize("receiver", [U_BLOX, PHONE])
@pytest.mark.parametrize("seed", [31, 41, 51, 61])
def test_a_receiver_that_errs_as_it_states_does_not_drift(receiver: Receiver, seed: int) -> None:
    assert all(drift.gain < 1.0 for drift in drifts_of(drive(receiver, seed)))


def test_only_the_window_that_drifts_is_less_sure() -> None:
    """Windows far from where a drive begins are judged as the first one is."""
    quiet = drive(U_BLOX, 71, 1100.0)
    assert all(drift.gain < 1.0 for drift in drifts_of(quiet))
    told = [drift for drift in drifts_of(with_pulse(quiet, 700.0)) if drift.gain > 3.0]
    assert [round(drift.start_s - GPS0) for drift in told] == [550]


def test_fixes_without_velocities_show_no_drift() -> None:
    """Nothing then tells a drift from the way that was driven."""
    fixes = with_pulse(drive(U_BLOX, 31))
    unknown = np.full_like(fixes.vel_ned, np.nan)
    assert all(drift.gain < 1.0 for drift in drifts_of(replace(fixes, vel_ned=unknown)))
