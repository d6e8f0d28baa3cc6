"""A receiver's velocities against its positions: damage is found, a sound one is not blamed."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from automap.gates import mean_square_limits
from automap.records import Fixes
from automap.sync.velocity_consistency import velocity_consistency
from automap.sync.velocity_findings import Interval
from tests.slow_cases import others_slow
from tests.unit.receiver_damage import (
    driving,
    held,
    redirected,
    scaled,
    shifted,
    upside_down,
    zeroed,
)
from tests.unit.receiver_scene import Receiver, any_receiver, simulated_fixes

SEEDS = range(2)
KMH, KNOT, MPH = 1.0 / 3.6, 1852.0 / 3600.0, 0.44704


def codes(fixes: Fixes) -> list[str]:
    return [reason.code for reason in velocity_consistency(fixes).reasons]


@pytest.mark.parametrize("seeds", [range(8), pytest.param(range(8, 200), marks=pytest.mark.slow)])
def test_sound_receivers_are_not_blamed(seeds: range) -> None:
    parted = 0
    for seed in seeds:
        seconds, fast = (60.0, 180.0, 400.0)[seed % 3], (3.0, 8.0, 14.0, 30.0)[seed % 4]
        fixes = simulated_fixes(seed, seconds=seconds, fast=fast)
        found = velocity_consistency(fixes)
        assert found.reasons == (), f"seed {seed}"
        assert not found.unrelated
        assert found.straight_m == 0.0
        assert not found.unusable_velocity(fixes).any()
        assert not found.unusable_vertical_velocity(fixes).any()
        assert not found.unusable_position(fixes).any()
        parted += len(found.parted)
    # positions jump every three minutes, some by more than 10 m
    assert parted < 0.1 * len(seeds)


@pytest.mark.slow
def test_scale_and_lags_are_found_within_their_sigmas() -> None:
    off: dict[str, list[float]] = {"scale": [], "speed_lag_s": [], "course_lag_s": []}
    for seed in range(24):
        receiver = any_receiver(np.random.default_rng(seed))
        match = velocity_consistency(simulated_fixes(seed, seconds=240.0)).match
        truth = {
            "scale": 1.0,
            "speed_lag_s": receiver.speed_lag_s,
            "course_lag_s": receiver.course_lag_s,
        }
        for name, value in truth.items():
            found = getattr(match, name)
            if found is not None:
                off[name].append((found.value - value) / found.sd)
    for name, sigmas in off.items():
        n = len(sigmas)
        assert n > 20, name
        assert abs(np.mean(sigmas)) < 3.0 / np.sqrt(n), name
        # sigmas are estimated from few stretches themselves
        assert np.mean(np.square(sigmas)) < 1.5 * mean_square_limits(n)[1], name
        assert np.mean(np.square(sigmas)) > 0.3, name


@pytest.mark.parametrize(
    ("logged", "expected", "factor"),
    others_slow(
        [
            ("km/h", "knots", KNOT / KMH),
            ("km/h", "m/s", 1.0 / KMH),
            ("m/s", "km/h", KMH),
            ("m/s", "knots", KNOT),
            ("knots", "m/s", 1.0 / KNOT),
            ("mph", "m/s", 1.0 / MPH),
            ("mph", "knots", KNOT / MPH),
            ("knots", "mph", MPH / KNOT),
        ],
        3,
    ),
)
def test_unit_is_told(logged: str, expected: str, factor: float) -> None:
    for seed in SEEDS:
        fixes = scaled(simulated_fixes(seed, seconds=240.0), factor)
        found = velocity_consistency(fixes)
        assert found.unit is not None
        assert (found.unit.logged, found.unit.expected) == (logged, expected)
        assert found.match.scale is not None
        assert found.match.scale.value == pytest.approx(factor, abs=4.0 * found.match.scale.sd)
        assert [reason.code for reason in found.reasons] == ["velocity_unit"]
        assert found.unusable_velocity(fixes).all()
        # all three are in that unit, and no height is wrong for it
        assert found.unusable_vertical_velocity(fixes).all()
        assert found.vertical is None
        assert not found.unusable_position(fixes).any()


def test_scale_of_no_unit_is_told_as_such() -> None:
    for seed in SEEDS:
        found = velocity_consistency(scaled(simulated_fixes(seed, seconds=240.0), 1.3))
        assert [reason.code for reason in found.reasons] == ["velocity_scale"]


def test_what_few_digits_cut_off_is_no_contradiction() -> None:
    fine = simulated_fixes(3, seconds=240.0, fast=30.0)

    def sectors(degrees: float) -> Fixes:
        velocity, step = fine.vel_ned.copy(), np.radians(degrees)
        course = np.rint(np.arctan2(velocity[:, 1], velocity[:, 0]) / step) * step
        ways = np.column_stack([np.cos(course), np.sin(course)])
        velocity[:, :2] = np.hypot(velocity[:, 0], velocity[:, 1])[:, None] * ways
        return replace(fine, vel_ned=velocity)

    for degrees in (45.0, 10.0):
        fixes = sectors(degrees)
        found = velocity_consistency(fixes)
        assert [reason.text for reason in found.reasons] == [
            f"courses come in steps of {degrees:g} deg"
        ]
        assert found.parted == ()
        assert not found.unrelated
        assert found.unusable_velocity(fixes).all()
    # a whole degree is less than what velocities err by
    assert codes(sectors(1.0)) == []
    # nor are bearings of a road's pieces, which are those of six seconds before
    speed = np.hypot(fine.vel_ned[:, 0], fine.vel_ned[:, 1])
    first = np.searchsorted(fine.gps_s, fine.gps_s[0] + (fine.gps_s - fine.gps_s[0]) // 6.0 * 6.0)
    held = fine.vel_ned[first] / np.maximum(speed[first], 1e-3)[:, None] * speed[:, None]
    assert codes(replace(fine, vel_ned=held)) == ["course_coarse"]
    cut = [np.radians(np.rint(np.degrees(x) * 6e3) / 6e3) for x in (fine.lat_rad, fine.lon_rad)]
    found = velocity_consistency(replace(fine, lat_rad=cut[0], lon_rad=cut[1]))
    assert found.reasons == found.parted == ()
    assert not found.unrelated
    assert found.straight_m == 0.0


@pytest.mark.parametrize(
    ("matrix", "quarters", "mirrored"),
    others_slow(
        [
            ([[-1, 0], [0, -1]], 2, False),
            ([[0, 1], [-1, 0]], 1, False),
            ([[0, -1], [1, 0]], 3, False),
            ([[0, 1], [1, 0]], 1, True),
            ([[1, 0], [0, -1]], 0, True),
            ([[-1, 0], [0, 1]], 2, True),
        ],
        2,
    ),
)
def test_turned_courses_are_found(matrix: list[list[float]], quarters: int, mirrored: bool) -> None:
    for seed in SEEDS:
        fixes = redirected(simulated_fixes(seed, seconds=240.0), matrix)
        found = velocity_consistency(fixes)
        assert (found.match.quarters, found.match.mirrored) == (quarters, mirrored)
        assert found.match.turn_rad is not None
        assert abs(found.match.turn_rad.value) < 4.0 * found.match.turn_rad.sd
        # one wrong sign may as well be a longitude's that was lost
        one_sign = mirrored and quarters % 2 == 0
        code = "sign_turned" if one_sign else "course_turned"
        assert [reason.code for reason in found.reasons] == [code]
        assert found.unusable_velocity(fixes).all() != one_sign


def test_mirroring_on_a_straight_road_is_none() -> None:
    fixes = simulated_fixes(3, seconds=240.0)
    speed = np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1])
    north = np.concatenate(
        [[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fixes.gps_s))]
    )
    straight = replace(
        fixes,
        lat_rad=-0.6 + north / 6.3558e6,
        lon_rad=np.full(len(fixes), 2.5),
        vel_ned=np.column_stack([speed, 0.0 * speed, np.nan * speed]),
    )
    assert codes(redirected(straight, [[1, 0], [0, -1]])) == []
    assert codes(redirected(straight, [[-1, 0], [0, 1]])) == ["course_turned"]


def _overlap(intervals: tuple[Interval, ...], start: float, end: float) -> float:
    """Seconds of intervals within start to end."""
    return sum(max(0.0, min(i.end_gps_s, end) - max(i.start_gps_s, start)) for i in intervals)


@pytest.mark.parametrize("seed", others_slow(range(8)))
@pytest.mark.parametrize(
    ("what", "name"),
    [
        ("velocity holds", "velocity_stuck"),
        ("velocity is zero", "velocity_stuck"),
        ("position holds", "position_frozen"),
        ("rows hold", "rows_frozen"),
        ("position holds, no velocity", "rows_frozen"),
    ],
)
def test_repeating_values_are_found_where_they_are(what: str, name: str, seed: int) -> None:
    fixes = simulated_fixes(seed, seconds=240.0)
    rows = driving(fixes, 20.0)
    place = ("lat_rad", "lon_rad", "height_m")
    damaged = {
        "velocity holds": lambda: held(fixes, rows, "vel_ned"),
        "velocity is zero": lambda: zeroed(fixes, rows),
        "position holds": lambda: held(fixes, rows, *place),
        "rows hold": lambda: held(fixes, rows, *place, "vel_ned"),
        "position holds, no velocity": lambda: zeroed(held(fixes, rows, *place), rows),
    }[what]()
    found = velocity_consistency(damaged)
    intervals = getattr(found, name)
    assert [reason.code for reason in found.reasons] == [name]
    start, end = fixes.gps_s[rows][0], fixes.gps_s[rows][-1]
    seconds = sum(interval.seconds for interval in intervals)
    inside = _overlap(intervals, start - 1.01, end)
    assert inside > 0.6 * (end - start)
    assert seconds - inside < 1.0
    marked = {
        "velocity_stuck": [found.unusable_velocity(damaged)],
        "position_frozen": [found.unusable_position(damaged)],
        "rows_frozen": [found.unusable_position(damaged), found.unusable_velocity(damaged)],
    }[name]
    for mask in marked:
        assert mask[rows].mean() > 0.6
        assert not mask[~rows].any()
    # the rest is compared as if nothing were wrong
    clean = velocity_consistency(fixes).match.scale
    assert clean is not None
    assert found.match.scale is not None
    assert found.match.scale.value == pytest.approx(clean.value, abs=3.0 * found.match.scale.sd)


def test_rows_that_repeat_at_no_speed_are_told_by_how_they_end() -> None:
    for seed in SEEDS:
        fixes = simulated_fixes(seed, seconds=240.0)
        rows = driving(fixes, 20.0)
        # braking gently to nothing, and off again from there
        t = fixes.gps_s - fixes.gps_s[rows][0]
        ramp = np.clip(np.maximum(-t, t - 20.0) / 6.0, 0.0, 1.0)
        still = replace(fixes, vel_ned=fixes.vel_ned * ramp[:, None])
        kept = held(still, rows, "lat_rad", "lon_rad", "height_m", "vel_ned")
        found = velocity_consistency(kept)
        assert [reason.code for reason in found.reasons] == ["rows_frozen"]
        (interval,) = found.rows_frozen
        assert interval.metres > 30.0


def test_a_velocity_that_is_zero_throughout_is_stuck() -> None:
    for seed in SEEDS:
        fixes = simulated_fixes(seed, seconds=240.0)
        assert codes(zeroed(fixes, np.ones(len(fixes), np.bool_))) == ["velocity_stuck"]


@pytest.mark.slow
def test_positions_that_come_less_often_than_they_are_logged() -> None:
    for seed in SEEDS:
        fixes = simulated_fixes(seed, Receiver(rate_hz=10.0), seconds=240.0)
        fresh = np.arange(len(fixes)) % 10 == 0
        k = np.maximum.accumulate(np.where(fresh, np.arange(len(fixes)), 0))
        slow = replace(fixes, lat_rad=fixes.lat_rad[k], lon_rad=fixes.lon_rad[k])
        found = velocity_consistency(slow)
        assert [reason.code for reason in found.reasons] == ["position_frozen"]
        bad = found.unusable_position(slow)
        fast = np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1]) > 5.0
        assert not bad[fresh].any()
        assert bad[~fresh & fast].mean() > 0.95


@pytest.mark.slow
def test_values_of_few_digits_are_not_stuck() -> None:
    for seed in SEEDS:
        fixes = simulated_fixes(seed, Receiver(rate_hz=10.0), seconds=240.0)
        speed = np.round(np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1]) / KMH) * KMH
        course = np.deg2rad(
            np.round(np.rad2deg(np.arctan2(fixes.vel_ned[:, 1], fixes.vel_ned[:, 0])))
        )
        rounded = np.column_stack([speed * np.cos(course), speed * np.sin(course), 0.0 * speed])
        minutes = 1e-3 / 60.0
        coarse = {
            name: np.deg2rad(np.round(np.rad2deg(getattr(fixes, name)) / minutes) * minutes)
            for name in ("lat_rad", "lon_rad")
        }
        assert codes(replace(fixes, vel_ned=rounded * [1.0, 1.0, np.nan], **coarse)) == []


@pytest.mark.slow
def test_a_car_that_stands_tells_nothing() -> None:
    for seed in range(20):
        fixes = simulated_fixes(seed, fast=0.0)
        # some receivers hold their position and tell no speed at all
        for still in (fixes, zeroed(fixes, np.ones(len(fixes), np.bool_))):
            found = velocity_consistency(still)
            assert not found.can_tell
            assert found.reasons == ()
            assert not found.unrelated


def test_positions_that_jump_are_a_parting_where_it_is() -> None:
    for seed in SEEDS:
        fixes = simulated_fixes(seed, seconds=240.0)
        rows = fixes.gps_s > fixes.gps_s[0] + 100.0
        found = velocity_consistency(shifted(fixes, rows, 30.0))
        assert found.reasons == ()
        (part,) = found.parted
        assert part.start_gps_s <= fixes.gps_s[rows][0] <= part.end_gps_s
        assert part.seconds < 1.5
        assert part.metres == pytest.approx(30.0, abs=6.0)


def test_places_of_a_moment_on_the_way_back_are_part_of_one_parting() -> None:
    """Reflections leave by steps; a place for a moment where positions are otherwise is sound."""
    for seed in SEEDS:
        fixes = simulated_fixes(seed, seconds=240.0)
        t = fixes.gps_s - fixes.gps_s[0]
        steps = np.select([(t > 100.0) & (t <= 102.0), (t > 102.0) & (t < 104.0)], [60.0, 30.0])
        (part,) = velocity_consistency(shifted(fixes, t >= 0.0, steps)).parted
        assert (part.start_gps_s - fixes.gps_s[0], part.seconds) == pytest.approx(
            (100.0, 4.0), abs=1.0
        )
        twice = np.where(((t > 100.0) & (t < 101.5)) | ((t > 103.0) & (t < 104.5)), 60.0, 0.0)
        assert len(velocity_consistency(shifted(fixes, t >= 0.0, twice)).parted) == 2


def test_positions_that_drift_off_are_a_parting() -> None:
    for seed in SEEDS:
        fixes = simulated_fixes(seed, Receiver(), seconds=400.0)
        drift = np.interp(fixes.gps_s - fixes.gps_s[0], [100.0, 130.0], [0.0, 80.0])
        found = velocity_consistency(shifted(fixes, drift, 1.0))
        assert found.reasons == ()
        assert sum(interval.metres for interval in found.parted) > 30.0
        start = fixes.gps_s[0]
        inside = _overlap(found.parted, start + 100.0 - 64.0, start + 130.0 + 64.0)
        assert inside == pytest.approx(sum(interval.seconds for interval in found.parted))


@pytest.mark.parametrize(("rate_hz", "noise_m"), [(1.0, 8.0), (5.0, 5.0), (10.0, 3.5)])
def test_positions_that_are_noisy_are_none_of_another_drive(rate_hz: float, noise_m: float) -> None:
    """Single point positions of a telephone: by the metres from fix to fix, and no further off."""
    for seed in range(2):
        receiver = Receiver(rate_hz=rate_hz, noise_m=noise_m)
        found = velocity_consistency(simulated_fixes(seed, receiver, seconds=240.0, fast=9.0))
        assert found.worse > 5.3
        assert not found.unrelated
        assert found.reasons == ()


def test_velocities_of_another_drive_are_unrelated() -> None:
    for seed in SEEDS:
        fixes = simulated_fixes(seed, Receiver(), seconds=240.0)
        other = simulated_fixes(seed + 100, Receiver(), seconds=240.0)
        found = velocity_consistency(replace(fixes, vel_ned=other.vel_ned))
        assert found.unrelated
        assert not found.can_tell
        assert not found.unusable_velocity(fixes).any()


def test_delays_beyond_any_receivers_are_found() -> None:
    for seed in SEEDS:
        late = Receiver(speed_lag_s=3.0, course_lag_s=3.0)
        match = velocity_consistency(simulated_fixes(seed, late, seconds=240.0)).match
        for lag in (match.speed_lag_s, match.course_lag_s):
            assert lag is not None
            assert lag.value == pytest.approx(3.0, abs=4.0 * lag.sd)


@pytest.mark.slow
def test_vertical_sign() -> None:
    # a receiver with corrections, on hills
    good = Receiver(rate_hz=4.0, wander_m=0.02, noise_m=0.01, velocity_error=0.05)
    for seed in SEEDS:
        fixes = simulated_fixes(seed, good, seconds=400.0, fast=20.0)
        right = velocity_consistency(fixes).vertical
        assert right is not None
        assert not right.turned
        assert right.scale is not None
        assert right.scale.value == pytest.approx(1.0, abs=4.0 * right.scale.sd)
        turned = upside_down(fixes)
        found = velocity_consistency(turned)
        assert [reason.code for reason in found.reasons] == ["vertical_turned"]
        assert found.unusable_vertical_velocity(turned).all()
        assert not found.unusable_velocity(turned).any()
        level = replace(fixes, vel_ned=fixes.vel_ned * [1.0, 1.0, 0.0])
        assert codes(level) == ["vertical_stuck"]


def test_two_mistakes_are_told_apart() -> None:
    fixes = simulated_fixes(5, seconds=240.0)
    rows = driving(fixes, 20.0)
    damaged = scaled(redirected(held(fixes, rows, "vel_ned"), [[-1, 0], [0, -1]]), 3.6)
    assert codes(damaged) == ["velocity_unit", "course_turned", "velocity_stuck"]


def test_nothing_to_compare() -> None:
    fixes = simulated_fixes(1, seconds=60.0)
    unknown = np.full_like(fixes.vel_ned, np.nan)
    kept = (0, 1, 2, 5)
    short = [
        Fixes(**{item.name: getattr(fixes, item.name)[:n] for item in fields(Fixes)}) for n in kept
    ]
    for nothing in (
        *short,
        replace(fixes, vel_ned=unknown),
        replace(fixes, lat_rad=unknown[:, 0]),
        replace(fixes, gps_s=unknown[:, 0]),
        replace(fixes, fix_type=np.zeros(len(fixes), np.int64)),
    ):
        found = velocity_consistency(nothing)
        assert not found.can_tell
        assert found.reasons == ()
        assert found.unusable_velocity(nothing).shape == (len(nothing),)


def test_rows_in_any_order_and_twice_the_same() -> None:
    fixes = simulated_fixes(2, seconds=240.0)
    order = np.random.default_rng(1).permutation(np.arange(len(fixes)).repeat(2))
    mixed = Fixes(**{item.name: getattr(fixes, item.name)[order] for item in fields(Fixes)})
    assert velocity_consistency(mixed) == velocity_consistency(fixes)
