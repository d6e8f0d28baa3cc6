"""Velocities that are ways between positions are told from those of a receiver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.doubts.own_velocities import own_velocities, smoothed_doubts, smoothed_s
from automap.fusion.doubts.receiver import receiver_doubts
from automap.fusion.options import FusionOptions
from automap.records import Fixes, FixType
from automap.sync import epoch_means as module
from automap.sync import limits
from automap.sync.epoch_means import AFTER, AROUND, BEFORE, epoch_means
from automap.sync.receiver_path import ReceiverPath, receiver_path
from automap.sync.velocity_consistency import velocity_consistency
from tests.slow_cases import others_slow
from tests.unit.receiver_damage import derived, upside_down
from tests.unit.receiver_scene import Receiver, any_receiver, simulated_fixes

GOOD = Receiver(4.0, 0.0, 0.0, 0.02, 0.003, 0.01, 1.0, 0.0, 0.0)
"""A carrier-phase receiver under an open sky: all it errs by is millimetres and centimetres a
second."""


@pytest.mark.parametrize("interval", others_slow([AFTER, BEFORE, AROUND]))
@pytest.mark.parametrize("rate_hz", others_slow([1.0, 4.0, 10.0]))
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


@pytest.mark.slow
@pytest.mark.parametrize("late_s", [0.0, 0.3])
@pytest.mark.parametrize("rate_hz", others_slow([4.0, 1.0, 10.0]))
def test_the_best_receivers_own_velocities_are_not(rate_hz: float, late_s: float) -> None:
    receiver = replace(GOOD, rate_hz=rate_hz, speed_lag_s=late_s, course_lag_s=late_s)
    for seed in range(4):
        fixes = simulated_fixes(seed, receiver, seconds=240.0)
        found = velocity_consistency(fixes)
        assert found.means is None, f"seed {seed}"
        assert own_velocities(fixes, found) is fixes


@pytest.mark.slow
def test_ordinary_receivers_own_velocities_are_not() -> None:
    for seed in range(20):
        assert velocity_consistency(simulated_fixes(seed)).means is None, f"seed {seed}"


def test_a_receiver_that_follows_the_ways_closely_tells_no_more_than_they() -> None:
    """Velocities half an epoch late that err by less than any may are as good as means."""
    receiver = replace(GOOD, speed_lag_s=0.125, course_lag_s=0.125)
    found = velocity_consistency(simulated_fixes(1, receiver, seconds=240.0))
    assert found.means is not None
    assert (found.means.interval, found.means.rows) == (BEFORE, 1)
    assert 0.01 < found.means.sd < limits.BEST_VELOCITY_SD
    worse = replace(receiver, velocity_error=2.0 * limits.BEST_VELOCITY_SD)
    assert velocity_consistency(simulated_fixes(1, worse, seconds=240.0)).means is None


@pytest.mark.parametrize("fast", [0.0, 14.0])
def test_what_stands_or_is_short_says_nothing(fast: float) -> None:
    seconds = 240.0 if fast == 0.0 else 4.0
    still = replace(GOOD, wander_m=0.0, noise_m=0.0, velocity_error=0.0)
    assert velocity_consistency(simulated_fixes(2, still, seconds, fast)).means is None


@pytest.mark.parametrize(
    ("rate_hz", "rows_back"), others_slow([(10.0, 0), (10.0, 1), (10.0, 10), (1.0, 1)])
)
def test_lost_rows_beside_ways_between_rough_positions_contradict_nothing(
    rate_hz: float, rows_back: int
) -> None:
    """Positions that scatter by a metre ten times a second: the noise of velocities about lost rows
    added up to 85 m. A log that is of another place from some row on is told still."""
    receiver = replace(any_receiver(np.random.default_rng(1)), rate_hz=rate_hz, noise_m=1.0)
    sound = simulated_fixes(1, receiver, seconds=240.0)
    fixes = ways_of(sound, rows_back) if rows_back else derived(sound, AROUND)
    kept = np.random.default_rng(2).random(len(fixes)) > 0.1
    fixes = replace(fixes, **{name: value[kept] for name, value in vars(fixes).items()})
    found = velocity_consistency(fixes)
    assert found.means is not None
    assert not found.parted
    assert not found.aside
    moved = np.where(np.arange(len(fixes)) < len(fixes) // 2, 0.0, 50.0 / 6.4e6)
    assert velocity_consistency(replace(fixes, lat_rad=fixes.lat_rad + moved)).parted


def by_carrier(fixes: Fixes, sd_m: float, rows: slice = slice(None)) -> Fixes:
    """The ``rows`` of fixes as carrier-phase ones."""
    kind, sd = fixes.fix_type.copy(), fixes.sd_pos_ned.copy()
    kind[rows], sd[rows] = FixType.FIXED, sd_m
    return replace(fixes, fix_type=kind, sd_pos_ned=sd)


def ways_of(fixes: Fixes, rows_back: int, error: float = 0.0) -> Fixes:
    """Fixes whose velocities are the ways from so many rows before, to an ``error`` m/s."""
    path = receiver_path(fixes)
    way = (path.place[rows_back:] - path.place[:-rows_back]) / (
        path.t[rows_back:] - path.t[:-rows_back]
    )
    velocity = np.full((len(fixes), 3), np.nan)
    velocity[path.row[rows_back:], :2] = np.column_stack([way.real, way.imag])
    noise = error * np.random.default_rng(5).normal(size=velocity.shape)
    return replace(fixes, vel_ned=velocity + noise)


@pytest.mark.parametrize(("rate_hz", "rows_back"), others_slow([(5.0, 5), (1.0, 2), (10.0, 20)]))
def test_ways_of_the_last_second_or_two_are_told(rate_hz: float, rows_back: int) -> None:
    for seed in range(3):
        receiver = replace(any_receiver(np.random.default_rng(seed)), rate_hz=rate_hz)
        fixes = ways_of(simulated_fixes(seed, receiver, seconds=240.0), rows_back)
        found = velocity_consistency(fixes)
        assert found.means is not None, f"seed {seed}"
        assert (found.means.interval, found.means.rows) == (BEFORE, rows_back)
        assert f"from {rows_back} rows before to it" in found.means.text
        assert np.isnan(own_velocities(fixes, found).vel_ned).all()


@pytest.mark.parametrize("rows_back", others_slow([4, 8, 16]))
def test_means_over_seconds_tell_less_than_carrier_phases(rows_back: int) -> None:
    """As those of an instant they drew a motorway's antenna by 0.3 m."""
    sound = simulated_fixes(10005, GOOD, seconds=240.0, fast=30.0)
    means = ways_of(sound, rows_back, 2.0 * limits.BEST_VELOCITY_SD)
    velocity = means.vel_ned
    found = velocity_consistency(means)
    assert found.means is None
    half = slice(0, len(sound) // 2)
    sure = by_carrier(means, 0.01, half)
    assert smoothed_s(sure, found) == pytest.approx(rows_back / 4.0, rel=0.1)
    own = own_velocities(sure, found).vel_ned
    assert np.isnan(own[half]).all()
    np.testing.assert_array_equal(own[half.stop :], velocity[half.stop :])
    (reason,) = smoothed_doubts(own_velocities(sure, found), found)
    assert (reason.code, reason.state, reason.handled) == ("velocity_smoothed", "good", True)
    # float ones err by more from one to the next than the velocities, others do not say
    for fixes in (by_carrier(means, 0.2), means):
        assert own_velocities(fixes, found) is fixes
        assert smoothed_doubts(fixes, found) == []


@pytest.mark.parametrize("late_s", [0.0, 0.2])
def test_velocities_of_an_instant_stay_beside_carrier_phases(late_s: float) -> None:
    """Late by some tenths of a second is what a receiver's filter is."""
    receiver = replace(GOOD, speed_lag_s=late_s, course_lag_s=late_s, velocity_error=0.05)
    fixes = by_carrier(simulated_fixes(10006, receiver, seconds=240.0), 0.01)
    assert own_velocities(fixes, velocity_consistency(fixes)) is fixes


def test_velocities_that_are_wrong_are_not_called_ways() -> None:
    fixes = derived(simulated_fixes(3, seconds=240.0), BEFORE)
    wrong = replace(fixes, vel_ned=fixes.vel_ned * 3.6)
    assert velocity_consistency(wrong).means is None
    assert velocity_consistency(upside_down(fixes)).means is not None


def test_only_intervals_whose_rows_are_used_and_near_are_weighed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Against a walk along the rows: who is used at random, and some steps are long."""
    rng = np.random.default_rng(6)
    n = 60
    step = np.where(rng.random(n) < 0.1, 3.0, rng.uniform(0.9, 1.1, n))
    t = np.cumsum(step)
    place, velocity = (rng.normal(size=n) + 1j * rng.normal(size=n) for _ in range(2))
    use = rng.random(n) < 0.9
    velocity[~use] = np.nan
    path = ReceiverPath(
        np.arange(n), t, 0.0, place, velocity, *(np.full(n, np.nan) for _ in range(3))
    )
    given: dict[tuple[str, int], list[np.ndarray]] = {}
    monkeypatch.setattr(
        module,
        "_weighed",
        lambda interval, rows, *values, instants: given.update(
            {(interval, rows): [*values, instants[0]]}
        ),
    )
    assert epoch_means(path, use) is None
    usual = np.median(np.diff(t))
    wanted: dict[tuple[str, int], list[list[complex]]] = {}
    for count in range(1, 5):
        for k in range(n - count):
            rows = range(k, k + count + 1)
            if not use[rows].all() or max(np.diff(t[rows])) > 1.6 * usual:
                continue
            span = t[k + count] - t[k]
            way = (place[k + count] - place[k]) / span
            told = np.trapezoid(velocity[rows], t[rows]) / span - way
            of = {(BEFORE, count): k + count, (AFTER, count): k}
            if count % 2 == 0:
                of[AROUND, count // 2] = k + count // 2
            for key, row in of.items():
                wanted.setdefault(key, []).append([span, way, velocity[row] - way, told])
    assert given.keys() == wanted.keys()
    for key, values in wanted.items():
        assert 5 < len(values) < n - 8
        np.testing.assert_allclose(np.array(given[key]).T, np.array(values))


def test_the_best_receiver_is_the_same_to_sync_and_fusion() -> None:
    assert FusionOptions().min_velocity_sd == limits.BEST_VELOCITY_SD
