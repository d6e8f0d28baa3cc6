"""Heights in another unit, by the pressure or that never change are told, right ones are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion import limits
from automap.fusion.doubts.heights import height_doubts, separation_doubts
from automap.fusion.doubts.receiver import receiver_doubts, usable_fixes
from automap.fusion.widening import widen
from automap.geoid import geoid_height
from automap.records import Fixes, FixType
from automap.sync.velocity_consistency import velocity_consistency
from pipeline.check.velocity import check
from tests.unit.fusion_fixes import fixes_of, hilly, town_fixes
from tests.unit.test_fusion_verdict import misses_of


@pytest.mark.parametrize("seed", range(5))
def test_heights_in_metres_are_heights(seed: int) -> None:
    path = hilly()
    assert list(height_doubts(path, fixes_of(path, 1.0, 2.0, seed))) == []
    # nor are they of another unit where a receiver without satellites holds one for most of it
    low = hilly(climb=0.02)
    held = fixes_of(low, 1.0, 0.5, seed)
    n = len(held)
    held.height_m[n // 5 : 4 * n // 5] = held.height_m[n // 5]
    assert list(height_doubts(low, held)) == []
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


def test_a_nose_that_rises_on_its_springs_is_no_hill() -> None:
    path = hilly(climb=1e-3, seconds=1200)
    t = path.gps_s - path.gps_s[0]
    speed, gain = 12.0 + 8.0 * np.sin(t / 9.0), 8.0 / 9.0 * np.cos(t / 9.0)
    velocity = np.stack([speed, 0.0 * t, 0.0 * t], axis=1)
    rises = np.outer(0.007 * gain, [0.0, 1.0, 0.0])
    path = replace(path, vel_ned=velocity, height_m=0.0 * t + 500.0, rpy=rises)
    fixes = fixes_of(path, 1.0, 0.3, 1)
    assert list(height_doubts(path, fixes)) != []
    assert list(height_doubts(path, fixes, lifts=0.007)) == []


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


@pytest.mark.parametrize("lean", [-0.03, 0.03])
def test_a_unit_that_leans_is_not_in_feet(lean: float) -> None:
    fixes = fixes_of(hilly(seconds=300, climb=0.02), 1.0, 0.2, 2)
    velocity = fixes.vel_ned.copy()
    velocity[:, 2] += lean * np.hypot(velocity[:, 0], velocity[:, 1])
    found = velocity_consistency(replace(fixes, vel_ned=velocity)).vertical
    assert found is not None
    assert (found.feet, found.turned) == (1.0, False)


@pytest.mark.parametrize("unit", ["", "feet"])
def test_a_geoid_that_is_nowhere_on_earth_tells_feet(unit: str) -> None:
    factor = 1.0 / 0.3048 if unit else 1.0
    fixes = fixes_of(hilly(60), 1.0, 0.5, 4)
    separation = geoid_there(fixes) + 3.0
    height = (fixes.height_m + 100.0) * factor
    fixes = replace(fixes, height_m=height, geoid_sep_m=np.full(len(height), factor * separation))
    said = separation_doubts(fixes)
    assert [reason.code for reason in said] == ["height_scale"] * bool(unit)
    if said:
        assert unit in said[0].text
        assert said[0].height_m == pytest.approx(np.abs(height).max() * (1.0 - 0.3048))
    unknown = replace(fixes, geoid_sep_m=np.full(len(height), np.nan))
    assert separation_doubts(unknown) == []


def geoid_there(fixes: Fixes) -> float:
    return geoid_height(*np.degrees([fixes.lat_rad[0], fixes.lon_rad[0]]))


def test_heights_above_nobody_knows_what_are_as_unsure_as_the_geoid_is_far() -> None:
    fixes = fixes_of(hilly(60), 1.0, 0.5, 4)
    there = geoid_there(fixes)
    assert abs(there) > 12.0
    none = replace(fixes, height_m=fixes.height_m + 100.0, geoid_sep_m=np.zeros(len(fixes)))
    (reason,) = separation_doubts(none)
    assert (reason.code, reason.state) == ("height_surface", "good")
    assert reason.height_m == pytest.approx(abs(there), abs=0.2)
    # where they would be below the sea they are above the ellipsoid
    low = replace(none, height_m=np.full(len(fixes), min(there, -there) - 20.0))
    assert separation_doubts(low) == []
    other = replace(none, geoid_sep_m=np.full(len(fixes), there - np.sign(there) * 70.0))
    (reason,) = separation_doubts(other)
    assert (reason.code, reason.state) == ("height_surface", "doubtful")
    assert reason.height_m == pytest.approx(70.0, abs=0.1)


def test_a_geoid_in_no_unit_leaves_heights_unknown() -> None:
    fixes = fixes_of(hilly(60), 1.0, 0.5, 4)
    (reason,) = separation_doubts(replace(fixes, geoid_sep_m=np.full(len(fixes), 4800.0)))
    assert "another unit" in reason.text
    assert reason.height_m == limits.UNKNOWN_HEIGHT_SD_M


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


def test_heights_that_are_kept_for_a_part_are_those_of_three_satellites() -> None:
    fixes = town_fixes()
    height = np.round(
        fixes.height_m + 0.3 * np.random.default_rng(3).standard_normal(len(fixes)), 1
    )
    kept = np.where(np.arange(len(fixes)) < len(fixes) // 3, height[0], height)
    held = replace(fixes, height_m=kept)
    found = velocity_consistency(held)
    usable = usable_fixes(held, found)
    first = np.arange(1, len(fixes) // 3)
    assert np.isnan(usable.height_m[first]).all()
    assert (usable.fix_type[first] == FixType.TWO_D).all()
    assert np.array_equal(usable.height_m[len(first) + 1 :], height[len(first) + 1 :])
    (reason,) = receiver_doubts(found, 0.0)
    assert (reason.code, reason.state) == ("height_held", "good")
    # heights to a metre stay on a level road, those of a receiver do not
    for sound in (np.rint(kept), height):
        assert velocity_consistency(replace(fixes, height_m=sound)).height_held == ()
