"""Sightings of one sign in passes that tell little by themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.geolocation.landmark import SizePrior, fit_landmark
from automap.geolocation.passes import group_sightings, seen_beside
from automap.geolocation.sightings import Sighting, make_sighting
from automap.geolocation.views import MeasurementNoise, Views, build_views


@pytest.fixture(scope="module")
def seen() -> tuple[Views, list[Sighting]]:
    """One sign in three parts of its approach, a minute later each, as if it were three passes."""
    path = drive_path(20.0)
    scene = roadside(path, every_s=40.0)
    found, _ = boxes(path, scene, camera(), np.random.default_rng(0))
    views = build_views(path, [found], {"front": camera()}, MeasurementNoise())
    thirds = np.array_split(np.arange(len(views)), 3)
    marks = [fit_landmark(views, rows, SizePrior()) for rows in thirds]
    sightings = [make_sighting(views, mark, [1e-8 * np.eye(10)]) for mark in marks]
    return views, [replace(s, time_s=s.time_s + 60.0 * k) for k, s in enumerate(sightings)]


SD = np.array([2.0, 2.0, 2.0])


def placed(sighting: Sighting, east_m: float, sd_m: float) -> Sighting:
    """The sighting at a place east of the first, with an uncertainty to the east."""
    cov = np.diag([0.5, sd_m, 0.5]) ** 2
    return replace(sighting, position=np.array([0.0, east_m, 0.0]), own_cov=cov)


def test_two_poor_sightings_either_side_of_a_good_one_are_one_sign(
    seen: tuple[Views, list[Sighting]],
) -> None:
    views, (a, b, c) = seen
    poor = [placed(a, -6.0, 4.0), placed(b, 0.0, 0.3), placed(c, 6.0, 4.0)]
    assert group_sightings(views, poor) == [[0, 1, 2]], "the poor ones are 12 m apart"
    sure = [placed(a, -6.0, 0.3), placed(b, 0.0, 0.3), placed(c, 6.0, 0.3)]
    assert len(group_sightings(views, sure)) == 3
    assert group_sightings(views, []) == []


def test_two_cameras_see_one_sign_at_a_time(seen: tuple[Views, list[Sighting]]) -> None:
    views, (a, *_) = seen
    one = [placed(a, 0.0, 0.3), replace(placed(a, 0.2, 0.3), camera=1)]
    assert group_sightings(views, one) == [[0, 1]]
    beside = [one[0], replace(one[1], camera=0)]
    assert len(group_sightings(views, beside)) == 2, "a camera that shows both shows two"


def test_two_tracks_of_a_sign_in_one_pass_are_one(seen: tuple[Views, list[Sighting]]) -> None:
    """Parts of an approach that share no frame; what shares frames stands beside one another."""
    views, (a, b, _) = seen
    one = placed(a, 0.0, 0.3)
    again = replace(placed(b, 0.4, 0.3), time_s=one.time_s + 1.0)
    assert group_sightings(views, [one, again]) == [[0, 1]]
    beside = replace(again, landmark=one.landmark)
    assert len(group_sightings(views, [one, beside])) == 2


def test_a_far_part_of_an_approach_is_the_sign_that_it_may_be(
    seen: tuple[Views, list[Sighting]],
) -> None:
    """Far boxes tell the distance to metres; what they show is no sign of its own for that."""
    views, (a, b, _) = seen
    near = placed(b, 0.0, 0.3)
    far = replace(placed(a, 5.0, 4.0), time_s=near.time_s - 1.0)
    assert group_sightings(views, [far, near]) == [[0, 1]]
    sure = replace(placed(a, 5.0, 0.3), time_s=far.time_s)
    assert len(group_sightings(views, [sure, near])) == 2
    beside = replace(far, landmark=near.landmark)
    assert len(group_sightings(views, [beside, near])) == 2


def test_a_stretch_is_laid_over_the_others_as_a_whole(seen: tuple[Views, list[Sighting]]) -> None:
    """Signs every 5 m, passed again by a path that is 4 m off: taken one by one each lies nearer to
    its neighbour."""
    views, (a, *_) = seen
    rng = np.random.default_rng(3)
    east = np.cumsum(rng.uniform(4.0, 6.0, 8))
    first = [replace(placed(a, x, 0.2), time_s=float(k), path_sd=SD) for k, x in enumerate(east)]
    again = [
        replace(placed(a, x + 4.0, 0.2), time_s=100.0 + k, path_sd=SD) for k, x in enumerate(east)
    ]
    groups = group_sightings(views, [*first, *again])
    assert sorted(groups) == [[k, k + 8] for k in range(8)]


def test_tracks_that_take_turns_with_one_signs_boxes_are_not_two_signs() -> None:
    """A second box in one frame begins a second track; two signs are together in most frames."""
    rng = np.random.default_rng(1)
    frames = np.flatnonzero(rng.random(600) < 0.7)
    turns = rng.random(len(frames)) < 0.5
    one, other = frames[turns], frames[~turns]
    assert not seen_beside(one, other)
    assert not seen_beside(one, np.union1d(other, one[50:52]))
    assert seen_beside(one[:5], np.union1d(other[:5], one[:1])), "too few frames to tell"
    assert seen_beside(frames, np.flatnonzero(rng.random(600) < 0.3))
    assert seen_beside(frames[:300], frames[299:]), "an end and a beginning in one frame"
