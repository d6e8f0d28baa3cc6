"""Velocities that are ways between positions are told from those of a receiver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.doubts.receiver import own_velocities, receiver_doubts
from automap.sync import limits
from automap.sync.epoch_means import AFTER, AROUND, BEFORE
from automap.sync.velocity_consistency import velocity_consistency
from tests.unit.receiver_damage import derived, upside_down
from tests.unit.receiver_scene import Receiver, any_receiver, simulated_fixes

GOOD = Receiver(4.0, 0.0, 0.0, 0.02, 0.003, 0.01, 1.0, 0.0, 0.0)
"""A carrier-phase receiver under an open sky: all it errs by is millimetres and centimetres a
second."""


@pytest.mark.parametrize("interval", [BEFORE, AFTER, AROUND])
@pytest.mark.parametrize("rate_hz", [1.0, 4.0, 10.0])
def test_ways_between_positions_are_told(interval: str, rate_hz: float) -> None:
    for seed in range(4):
        receiver = replace(any_receiver(np.random.default_rng(seed)), rate_hz=rate_hz)
        fixes = derived(simulated_fixes(seed, receiver, seconds=240.0), interval)
        found = velocity_consistency(fixes)
        assert found.means is not None, f"seed {seed}"
        assert found.means.interval == interval
        assert found.means.seconds == pytest.approx((1 + (interval == AROUND)) / rate_hz)
        assert found.means.sd < 0.01
        assert np.isnan(own_velocities(fixes, found).vel_ned).all()
        (reason,) = (r for r in receiver_doubts(found, 0.0) if r.code == "velocity_of_positions")
        assert reason.state == "good"
        assert reason.handled


@pytest.mark.parametrize("late_s", [0.0, 0.3])
@pytest.mark.parametrize("rate_hz", [1.0, 4.0, 10.0])
def test_the_best_receivers_own_velocities_are_not(rate_hz: float, late_s: float) -> None:
    receiver = replace(GOOD, rate_hz=rate_hz, speed_lag_s=late_s, course_lag_s=late_s)
    for seed in range(4):
        fixes = simulated_fixes(seed, receiver, seconds=240.0)
        found = velocity_consistency(fixes)
        assert found.means is None, f"seed {seed}"
        assert own_velocities(fixes, found) is fixes


def test_ordinary_receivers_own_velocities_are_not() -> None:
    for seed in range(20):
        assert velocity_consistency(simulated_fixes(seed)).means is None, f"seed {seed}"


def test_a_receiver_that_follows_the_ways_closely_tells_no_more_than_they() -> None:
    """Velocities half an epoch late that err by less than any may are as good as means."""
    receiver = replace(GOOD, speed_lag_s=0.125, course_lag_s=0.125)
    found = velocity_consistency(simulated_fixes(1, receiver, seconds=240.0))
    assert found.means is not None
    assert found.means.interval == BEFORE
    assert 0.01 < found.means.sd < limits.BEST_VELOCITY_SD
    worse = replace(receiver, velocity_error=2.0 * limits.BEST_VELOCITY_SD)
    assert velocity_consistency(simulated_fixes(1, worse, seconds=240.0)).means is None


@pytest.mark.parametrize("fast", [0.0, 14.0])
def test_what_stands_or_is_short_says_nothing(fast: float) -> None:
    seconds = 240.0 if fast == 0.0 else 4.0
    still = replace(GOOD, wander_m=0.0, noise_m=0.0, velocity_error=0.0)
    assert velocity_consistency(simulated_fixes(2, still, seconds, fast)).means is None


def test_velocities_that_are_wrong_are_not_called_ways() -> None:
    fixes = derived(simulated_fixes(3, seconds=240.0), BEFORE)
    wrong = replace(fixes, vel_ned=fixes.vel_ned * 3.6)
    assert velocity_consistency(wrong).means is None
    assert velocity_consistency(upside_down(fixes)).means is not None
