"""Drives that are no passes of their own, told by where their receivers were when."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.records import IntArray
from pipeline.merge.doubles import EVERY_S, Marks, doubles, marks_told, sentence
from pipeline.merge.doubles import _marks as marks_at

FRAMES = 1_000_000_007 * np.arange(1, 21, dtype=np.int64)


def marks(first: int = 0, last: int = 20, east_m: float = 0.0, later: int = 0) -> Marks:
    """A drive north at 10 m/s, marks ``first`` to ``last`` of it."""
    count = np.arange(first, last, dtype=np.int64)
    lat = np.asarray(0.87 + count * EVERY_S * 10.0 / 6.371e6, np.float64)
    lon = np.full(len(count), 0.15 + east_m / (6.371e6 * np.cos(0.87)))
    return Marks(count + 48_000_000 + later, lat, lon, FRAMES[first:last])


@pytest.mark.parametrize("part", [marks(0, 12), marks(8, 20), marks(5, 6)])
def test_a_part_of_a_recording_is_left_out(part: Marks) -> None:
    for order in ([part, marks()], [marks(), part]):
        (found,) = doubles(order)
        assert (found.left_out, found.alike) == (True, False)
        assert order[found.part] is part


def test_of_two_that_are_whole_the_first_counts() -> None:
    # one's last fixes were not used
    for order in ([marks(0, 19), marks()], [marks(), marks(0, 19)], [marks(), marks()]):
        (found,) = doubles(order)
        assert (found.part, found.left_out, found.alike) == (1, True, True)


def test_parts_of_parts_leave_the_whole() -> None:
    found = doubles([marks(0, 5), marks(), None, marks(0, 12)])
    assert {d.part for d in found if d.left_out} == {0, 3}


def test_of_a_part_nothing_is_told_but_that_it_is_one() -> None:
    beside = marks(east_m=3.0)
    found = doubles([marks(0, 12), beside, marks()])
    assert [(d.part, d.whole, d.left_out) for d in found] == [(0, 2, True), (2, 1, False)]


def test_one_receiver_with_two_cameras_is_told_and_stays() -> None:
    (found,) = doubles([marks(), replace(marks(), frame_ns=FRAMES + 13)])
    assert (found.left_out, found.same) == (False, True)
    assert "same fixes" in sentence(found, "a", "b")


def test_boxes_are_not_left_out_for_a_longer_log_without_any() -> None:
    blind = replace(marks(), frame_ns=np.zeros(20, np.int64))
    assert doubles([blind, marks(0, 12)]) == []
    (found,) = doubles([replace(marks(0, 12), frame_ns=np.zeros(12, np.int64)), marks()])
    assert (found.part, found.left_out) == (0, True)


def test_a_log_with_half_of_anothers_is_told_and_stays() -> None:
    own = marks(0, 20, east_m=900.0, later=2880)
    half = marks(10, 20)
    both = Marks(
        *(
            np.concatenate([getattr(own, name), getattr(half, name)])
            for name in ("count", "lat_rad", "lon_rad", "frame_ns")
        )
    )
    (found,) = doubles([both, marks()])
    assert (found.left_out, found.same) == (False, True)
    assert found.to_s - found.from_s == 9 * EVERY_S


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (marks(east_m=3.0), True),
        (marks(east_m=25.0), False),  # another lane, or the car behind
        (marks(later=1), False),  # the next car on the same road
        (marks(0, 2, east_m=3.0), False),  # too short to tell
    ],
)
def test_two_receivers_in_one_vehicle_are_told(other: Marks, told: bool) -> None:
    found = doubles([marks(), other])
    assert bool(found) is told
    assert not any(d.left_out for d in found)


def test_cars_that_are_parked_side_by_side_do_not_go_together() -> None:
    parked = [
        replace(m, lat_rad=np.full(20, 0.87), frame_ns=0 * FRAMES)
        for m in (marks(), marks(0, 20, 3.0))
    ]
    assert doubles(parked) == []


def test_marks_of_a_cut_log_are_those_of_the_whole() -> None:
    rng = np.random.default_rng(5)
    gps_s = 1.46e9 + np.arange(0.0, 300.0, 0.2)
    lat, lon = 0.87 + np.cumsum(rng.normal(0.0, 1e-7, (2, len(gps_s))), axis=1)
    whole = marks_at(gps_s, lat, lon, None, None)
    cut = marks_at(gps_s[:900], lat[:900], lon[:900], None, None)
    n = len(cut.count)
    assert (n, len(whole.count)) == (6, 10)
    for name in ("count", "lat_rad", "lon_rad"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name)[:n])


def test_marks_are_had_where_fixes_are_near() -> None:
    gps_s: list[float] = [3.0, 12.0, 31.0, 59.0, 61.0]
    found = marks_at(np.array(gps_s), np.zeros(5), np.zeros(5), None, None)
    assert found.count.tolist() == [2]


def test_marks_come_back_from_json() -> None:
    back = marks_told(marks().told())
    assert back is not None
    (found,) = doubles([back, marks()])
    assert found.left_out
    frames: IntArray = back.frame_ns
    np.testing.assert_array_equal(frames, FRAMES)
    for damaged in (None, [], [[1, 2]], [[1, 2, 3, "x"]], {"a": 1}):
        assert marks_told(damaged) is None
