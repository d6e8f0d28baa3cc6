"""Stickers: what stays in the picture while the vehicle drives is no sign of the road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside
from test_geolocation_carriers import together

from automap.geolocation.fixed_in_picture import fixed_boxes
from automap.geolocation.locate import locate_signs
from automap.geolocation.views import MeasurementNoise
from automap.records import Detections, Trajectory
from tests.slow_cases import others_slow

NOISE = MeasurementNoise()


def sticker(path: Trajectory, every: int, share: float, height_px: float = 40.0) -> Detections:
    """A thing found in a ``share`` of the frames, each ``every`` rows of the path."""
    rng = np.random.default_rng(5)
    rows = np.arange(0, len(path), every)
    rows = rows[rng.random(len(rows)) < share]
    box = np.array([900.0, 180.0, 900.0 + height_px, 180.0 + height_px])
    return Detections(
        frame=(rows // every).astype(np.int64),
        t_ns=path.t_ns[rows],
        class_name=np.full(len(rows), "sign-0", np.object_),
        box=box + rng.normal(0.0, 1.0, (len(rows), 4)),
        score=np.full(len(rows), 0.9),
        track=np.full(len(rows), -1, np.int64),
    )


@pytest.mark.parametrize("share", [0.8, 1.0])
@pytest.mark.parametrize("height_px", [22.0, 40.0, 300.0])
def test_a_sticker_is_told_from_the_signs_of_the_road(share: float, height_px: float) -> None:
    path = drive_path(30.0)
    signs, _ = boxes(path, roadside(path), camera(), np.random.default_rng(2))
    own = sticker(path, 20, share, height_px)
    both = together(signs, own)
    fixed = fixed_boxes(path, both, NOISE)
    assert fixed.sum() == pytest.approx(len(own), abs=0.02 * len(own) + 1)
    of_sticker = np.isin(both.box, own.box).all(axis=1)
    assert not fixed[~of_sticker].any()


@pytest.mark.parametrize("turn_rate", [0.0, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("every_s", others_slow([0.6, 1.0, 2.0]))
def test_signs_at_even_distances_are_none(turn_rate: float, every_s: float) -> None:
    # chevrons in a bend: each comes to the same place of the picture
    path = drive_path(40.0, turn_rate=turn_rate)
    scene = roadside(path, every_s=every_s)
    even = replace(scene, class_name=("sign-0",) * len(scene.class_name))
    for interval_s in (0.05, 0.2):
        seen, _ = boxes(path, even, camera(), np.random.default_rng(2), interval_s=interval_s)
        assert len(seen) > 100
        assert not fixed_boxes(path, seen, NOISE).any()


def test_what_stays_while_the_vehicle_waits_or_for_a_short_way_is_none() -> None:
    path = drive_path(60.0)
    own = sticker(path, 10, 1.0)
    # a velocity of noise for a minute is no way
    waits = replace(path, vel_ned=np.where(np.arange(6000)[:, None] < 600, path.vel_ned, 0.2))
    assert not fixed_boxes(waits, own, NOISE).any()
    assert fixed_boxes(path, own, NOISE).all()
    # nor is what came in a gap of the path
    rows = np.r_[0:100, 4000:4200]
    gap = Trajectory(**{k: v[rows] for k, v in vars(path).items() if isinstance(v, np.ndarray)})
    assert not fixed_boxes(gap, own, NOISE).any()
    short = own.at(own.frame <= 60)
    assert not fixed_boxes(path, short, NOISE).any()


def test_signs_that_are_seen_once_each_at_one_place_are_none() -> None:
    # a frame every 15 m, seven of them in a row of signs as like as photographs
    path = drive_path(30.0)
    own = sticker(path, 125, 1.0)
    assert not fixed_boxes(path, own.at(own.frame <= 6), NOISE).any()
    assert fixed_boxes(path, own, NOISE).all()


def test_a_drive_whose_boxes_are_all_of_a_sticker_has_no_signs() -> None:
    path = drive_path(30.0)
    found = locate_signs(path, [sticker(path, 20, 1.0)], {"front": camera()})
    assert not found.signs
    assert (found.observations.note == "fixed").all()


@pytest.mark.slow
def test_the_signs_are_those_without_it_and_its_boxes_are_told() -> None:
    path = drive_path(30.0)
    signs, _ = boxes(path, roadside(path), camera(), np.random.default_rng(2))
    both = together(signs, sticker(path, 20, 1.0))
    alone = locate_signs(path, [signs], {"front": camera()})
    found = locate_signs(path, [both], {"front": camera()})
    assert len(found.signs) == len(alone.signs) > 5
    for one, other in zip(found.signs, alone.signs, strict=True):
        assert (one.lat_rad, one.lon_rad) == pytest.approx((other.lat_rad, other.lon_rad), abs=1e-9)
        np.testing.assert_allclose(both.box[one.detection_rows], signs.box[other.detection_rows])
    note = found.observations.note
    assert len(note) == len(both)
    assert np.count_nonzero(note == "fixed") == 150
    assert any(f"150 of {len(both)} detections stay at one place" in w for w in found.warnings)
