"""Signs that should have been seen, and whether they are there."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from merge_scene import Errors, Scene, Town, drive_through, street, to_geodetic

from automap.mapping.existence import (
    Chances,
    DetectionRates,
    chances,
    detection_rates,
    existence,
    still_there,
)
from automap.mapping.limits import LASTING
from automap.mapping.merge import merge_drives
from automap.mapping.sightings import CameraView
from automap.mapping.visibility import (
    Opportunities,
    PathErrors,
    alike,
    head_on,
    opportunities,
)
from automap.records import DrivePath, FloatArray, IntArray

RATES = DetectionRates(0.85, np.full(50, 0.85), 0.9)
DAY_S = 86400.0


def series(*seen: str) -> Chances:
    """Pairs from texts such as "110": seen by the first two drives, missed by the third."""
    sign = np.concatenate([np.full(len(s), k) for k, s in enumerate(seen)]).astype(np.int64)
    drive = np.concatenate([np.arange(len(s)) for s in seen]).astype(np.int64)
    return Chances(sign, drive, np.array([c == "1" for s in seen for c in s]))


def belief(*seen: str, step_s: float = DAY_S) -> list[float]:
    pairs = series(*seen)
    times = 1.4e9 + step_s * np.arange(50)
    return existence(pairs, RATES, len(seen), times).tolist()


def odds(ratio: float) -> float:
    return ratio / (1.0 + ratio)


def test_a_sign_seen_often_is_there_and_one_seen_once_in_many_is_not() -> None:
    often, mostly, once_of_ten, single = belief("11111", "110111", "0000010000", "1")
    # of things that are no signs every drive takes some for one
    assert often == pytest.approx(odds(9.0 / LASTING), abs=0.002)
    assert mostly > 0.95
    assert once_of_ten < 0.2
    # one drive alone says nothing against its own sign
    assert single == pytest.approx(RATES.real)


def test_a_hidden_sign_that_is_seen_now_and_then_is_there() -> None:
    assert belief("0100100101000100")[0] > 0.5


def told(drives: list[float], misses: int = 0, others: tuple[float, ...] = ()) -> float:
    """Existence of a sign that drives saw with that belief, and further ones did not; ``others``
    are beliefs of signs that one drive saw."""
    n = len(drives) + misses
    count = n + len(others)
    pairs = Chances(
        np.append(np.zeros(n, np.int64), np.arange(len(others)) + 1),
        np.append(np.arange(n), np.zeros(len(others), np.int64)),
        np.arange(count) % count >= 0,
        np.concatenate([drives, np.full(misses, np.nan), others]),
    )
    pairs.seen[len(drives) : n] = False
    rates = detection_rates(pairs, 1 + len(others), n)
    return float(existence(pairs, rates, 1 + len(others), 1.4e9 + DAY_S * np.arange(n))[0])


def test_what_one_drive_tells_of_its_own_sign_is_what_the_map_tells() -> None:
    for belief_of_drive in (0.9996, 0.9, 0.6):
        assert told([belief_of_drive]) == pytest.approx(belief_of_drive, abs=1e-6)
        # whatever else that drive saw
        beside = told([belief_of_drive], others=(0.999,) * 40)
        assert beside == pytest.approx(belief_of_drive, abs=1e-3)


def test_another_drive_that_saw_it_takes_no_belief_and_one_that_missed_it_does() -> None:
    others = (0.98,) * 60
    alone = told([0.99], others=others)
    for second in (0.6, 0.9, 0.999):
        assert told([0.99, second], others=others) > alone
    assert told([0.99], misses=1, others=others) < alone
    assert told([0.99], misses=3, others=others) < told([0.99], misses=1, others=others)
    assert told([0.6], misses=2, others=others) < 0.2


def test_mistakes_of_drives_are_not_independent() -> None:
    """A gable that looks like a sign: however many drives see it, its odds are those of the word
    of one of them over the share of mistakes that all drives make."""
    for count in (10, 30):
        pairs = series("1" * count)
        pairs = Chances(pairs.sign, pairs.drive, pairs.seen, np.full(count, 0.9))
        found = existence(pairs, RATES, 1, 1.4e9 + DAY_S * np.arange(count))[0]
        assert found == pytest.approx(odds(9.0 / LASTING), abs=1e-3)


def test_drives_that_do_not_tell_say_nothing_for_or_against() -> None:
    pairs = series("1", "11")
    untold = Chances(pairs.sign, pairs.drive, pairs.seen, np.full(3, np.nan))
    times = 1.4e9 + DAY_S * np.arange(50)
    found = existence(untold, RATES, 2, times)
    assert np.array_equal(found, existence(pairs, RATES, 2, times))
    half = Chances(pairs.sign, pairs.drive, pairs.seen, np.array([np.nan, 0.99, np.nan]))
    assert existence(half, RATES, 2, times)[0] == pytest.approx(RATES.real)
    assert existence(half, RATES, 2, times)[1] > found[1]


def test_of_two_sightings_of_one_drive_the_surer_counts() -> None:
    none, zero = np.zeros(0, np.int64), np.zeros(0)
    views = Opportunities(none, none, zero, zero, none)
    sign = np.zeros(3, np.int64)
    pairs = chances(sign, np.array([0, 0, 1]), views, zero, np.array([0.7, 0.9, np.nan]))
    assert pairs.told is not None
    assert pairs.told == pytest.approx([0.9, np.nan], nan_ok=True)


def test_a_sign_taken_down_is_gone_and_one_put_up_is_there() -> None:
    gone, new = belief("11111000000", "00000011111")
    assert gone < 0.2
    assert new > 0.8


def test_years_between_drives_make_a_change_easier_to_believe() -> None:
    quick = belief("1111100", step_s=3600.0)[0]
    slow = belief("1111100", step_s=365 * DAY_S)[0]
    assert slow < quick


def test_rates_come_from_the_data() -> None:
    rng = np.random.default_rng(4)
    n, drives = 400, 12
    seen = rng.random((n, drives)) < 0.6
    false = np.zeros((40, drives), bool)
    false[np.arange(40), rng.integers(0, drives, 40)] = True
    everything = np.vstack([seen[seen.any(axis=1)], false])
    m = len(everything)
    sign, drive = np.divmod(np.arange(m * drives), drives)
    pairs = Chances(sign, drive, everything.ravel())
    rates = detection_rates(pairs, m, drives)
    assert rates.overall == pytest.approx(0.6, abs=0.06)
    found = existence(pairs, rates, m, 1.4e9 + DAY_S * np.arange(drives))
    assert (found[:-40] > 0.5).mean() > 0.97
    assert (found[-40:] < 0.5).mean() > 0.9


def test_a_drive_in_the_dark_takes_little_belief() -> None:
    dark = DetectionRates(0.85, np.array([0.85, 0.85, 0.1]), 0.9)
    clear = DetectionRates(0.85, np.full(3, 0.85), 0.9)
    times = 1.4e9 + DAY_S * np.arange(3)
    pairs = series("100")
    assert existence(pairs, dark, 1, times)[0] > existence(pairs, clear, 1, times)[0] + 0.05


def test_an_older_sign_that_fresh_drives_miss() -> None:
    sign = np.array([0, 1, 1, 1], np.int64)
    left = still_there(sign, np.ones(4), RATES, np.array([0.99, 0.99]), np.array([5.0, 5.0]))
    assert left[0] > 0.5
    assert left[1] < 0.2


def straight(speed: float = 10.0) -> DrivePath:
    """A path of 200 m to the north."""
    along = np.arange(0.0, 200.0, 4.0)
    plan = np.column_stack([np.zeros(50), along, np.zeros(50)])
    lat, lon, _ = to_geodetic(plan)
    return DrivePath(along / speed, lat, lon, np.zeros(50), np.zeros((50, 3)))


@pytest.mark.parametrize(
    ("east", "north", "facing_deg", "seen"),
    [
        (-5.0, 100.0, 180.0, True),  # faces the car
        (-5.0, 100.0, 0.0, False),  # looks away
        (-5.0, -20.0, 180.0, False),  # behind
        (-90.0, 100.0, 180.0, False),  # too far off
        (-5.0, 100.0, np.nan, True),  # of unknown direction
        (-5.0, 190.0, 180.0, True),
    ],
)
def test_what_a_drive_has_in_view(east: float, north: float, facing_deg: float, seen: bool) -> None:
    lat, lon, _ = to_geodetic(np.array([[east, north, 2.0]]))
    facing = np.radians([facing_deg])
    passing: Any = SimpleNamespace(path=straight(), cameras=(CameraView(0.0, 0.6),))
    found = opportunities([passing], lat, lon, facing)
    assert (len(found) == 1) is seen
    if seen:
        assert found.offset[0] == pytest.approx(east, abs=0.1)
        # from 60 m on to where it leaves 0.9 of the picture's half, every 8 m
        assert 4 <= found.rows[0] <= 7


def test_a_path_that_is_off_is_looked_at_where_it_was() -> None:
    """20 m to the east, and 10 m at a later sighting: between them in between. In a cell without a
    sighting nothing tells of it."""
    north = np.array([60.0, 120.0, 180.0])
    lat, lon, _ = to_geodetic(np.column_stack([np.full(3, -5.0), north, np.zeros(3)]))
    facing, path = np.full(3, np.pi), straight()
    east = np.column_stack([np.full(50, 20.0), np.zeros((50, 2))])
    off = replace(path, lon_rad=to_geodetic(east)[1])
    right, wrong = (
        [SimpleNamespace(path=each, cameras=(CameraView(0.0, 0.6),))] for each in (path, off)
    )
    true = opportunities(right, lat, lon, facing)
    zero, seen_s = np.zeros(2, np.int64), path.gps_s[[12, 38]]

    def moved(home: list[int], sign: list[int], late: list[float]) -> FloatArray:
        told = np.column_stack([late, [0.0, 0.0]])
        errors = PathErrors(np.array(home), np.array(sign), zero, seen_s, told)
        found = opportunities(wrong, lat, lon, facing, errors=errors)
        assert (found.rows[0], found.sign[0]) == (true.rows[0], true.sign[0])
        return found.offset - true.offset[found.sign]

    assert moved([7, 7, 9], [0, 1], [20.0, 20.0]) == pytest.approx([0.0, 0.0, -20.0], abs=1e-2)
    first, middle, last = moved([7, 7, 7], [0, 2], [20.0, 10.0])
    assert (first, last) == pytest.approx((0.0, -10.0), abs=1e-2)
    assert -6.5 < middle < -4.0


def test_drives_metres_off_their_way_miss_what_is_not_there() -> None:
    """By their paths as they are, most of them would have been in another street."""
    rng = np.random.default_rng(9)
    town = street(rng, 600.0, 15.0)
    path = np.array([[-1.5, -40.0], [-1.5, 640.0]])
    scene = Scene(town)
    for number in range(8):
        errors = Errors(shared=(8.0, 8.0, 9.0), clutter=0.3 if number == 3 else 0.0)
        drive, truth = drive_through(
            rng, town, path, 12.0, f"d{number}", 1.4e9 + DAY_S * number, errors
        )
        scene.drives.append(drive)
        scene.truth.append(truth)
    merged = merge_drives(scene.drives)
    s = merged.sightings
    truth, there = scene_truth(scene, s.first, s.row), merged.existence > 0.5
    real = np.isin(np.arange(len(merged)), merged.sign[truth >= 0])
    assert (~real).sum() >= 3
    assert not (there & ~real).any()
    assert set(truth[there[merged.sign]].tolist()) >= set(truth.tolist()) - {-1}


def test_a_camera_to_the_side_sees_the_side() -> None:
    lat, lon, _ = to_geodetic(np.array([[30.0, 100.0, 2.0]]))
    facing = np.radians([270.0])
    drives: Any = [
        SimpleNamespace(path=straight(), cameras=(CameraView(yaw, 0.4),))
        for yaw in (0.0, np.pi / 2)
    ]
    assert opportunities(drives, lat, lon, facing).drive.tolist() == [1]


def test_only_drives_that_came_the_same_way_should_have_seen_it() -> None:
    zero = np.zeros(4, np.int64)
    views = Opportunities(
        zero, np.arange(4), np.array([0.0, 0.1, 1.6, 0.0]), np.array([-5.0, -4.0, -5.0, 20.0]),
        zero + 5,
    )  # fmt: skip
    seen = np.array([True, False, False, False])
    assert alike(views, seen).tolist() == [True, True, False, False]
    facing = np.array([np.pi])
    pairs = chances(np.zeros(1, np.int64), np.zeros(1, np.int64), views, facing)
    assert pairs.drive.tolist() == [0, 1]
    assert views.drive[head_on(views, facing)].tolist() == [0, 1]


def test_what_was_seen_from_afar_those_should_have_seen_that_came_at_its_face() -> None:
    zero = np.zeros(3, np.int64)
    views = Opportunities(
        zero, np.arange(3), np.array([0.1, 1.6, 0.0]), np.array([-4.0, -5.0, 20.0]), zero + 5
    )
    # the drive that saw it, number 3, was never near
    pairs = chances(np.zeros(1, np.int64), np.array([3]), views, np.array([np.pi]))
    assert pairs.drive.tolist() == [0, 3]
    assert pairs.seen.tolist() == [False, True]


def scene_truth(scene: Scene, first: IntArray, row: IntArray) -> IntArray:
    """True sign of every sighting in the order of a merge."""
    return np.concatenate([own[row[first[k] : first[k + 1]]] for k, own in enumerate(scene.truth)])


def test_clutter_of_one_drive_is_unlikely_when_others_passed() -> None:
    rng = np.random.default_rng(8)
    town = street(rng, 600.0, 30.0)
    path = np.array([[-1.5, -40.0], [-1.5, 640.0]])
    scene = Scene(town)
    for number in range(8):
        errors = Errors(clutter=0.15 if number == 3 else 0.0)
        drive, truth = drive_through(
            rng, town, path, 12.0, f"d{number}", 1.4e9 + DAY_S * number, errors
        )
        scene.drives.append(drive)
        scene.truth.append(truth)
    merged = merge_drives(scene.drives)
    views = opportunities(
        merged.drives, merged.adjusted.lat, merged.adjusted.lon, merged.attributes.facing_rad
    )
    s = merged.sightings
    real = np.zeros(len(merged), bool)
    real[merged.sign[scene_truth(scene, s.first, s.row) >= 0]] = True
    passed = np.bincount(views.sign, minlength=len(real)) >= 6
    assert (merged.existence[real] > 0.5).mean() > 0.97
    assert (~real & passed).any()
    assert (merged.existence[~real & passed] < 0.5).all()


def test_a_map_of_one_drive_has_its_existence() -> None:
    rng = np.random.default_rng(3)
    path = np.array([[-1.5, -40.0], [-1.5, 340.0]])
    drive, _ = drive_through(rng, street(rng, 300.0, 30.0), path, 12.0, "a", 1.4e9, Errors())
    own = rng.uniform(0.6, 0.9996, len(drive))
    own[:3] = 0.9996
    merged = merge_drives([replace(drive, existence=own)])
    assert merged.existence == pytest.approx(own[merged.sightings.row], abs=1e-3)


def test_a_town_without_signs() -> None:
    town = Town(np.zeros((0, 3)), np.zeros(0), np.zeros(0, object))
    path = np.array([[0.0, 0.0], [0.0, 200.0]])
    drive, _ = drive_through(
        np.random.default_rng(0), town, path, 10.0, "empty", 1.4e9, Errors(clutter=0.0)
    )
    merged = merge_drives([drive])
    assert merged.signs == []
    assert merged.existence.shape == (0,)
