"""Tracks against all of the path: right ones, those of another time, focal length and drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import ORIGIN, boxes, camera, drive_path, roadside

from automap.earth import from_local_ned
from automap.geolocation import limits
from automap.geolocation.camera_hypotheses import Hypothesis, explanation_by_tracks
from automap.geolocation.locate import locate_signs
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.track_evidence import (
    NOTHING_TOLD,
    Evidence,
    _average,
    _by_chance,
    evidence_of,
)
from automap.records import Camera, Detections, Trajectory


def town(seed: int) -> Trajectory:
    """A minute that turns, nods and speeds up as no other does."""
    s, rng = np.arange(0.0, 60.0, 0.01), np.random.default_rng(seed)

    def wander(sd: float, slowest_s: float, quickest_s: float) -> np.ndarray:
        period = np.geomspace(quickest_s, slowest_s, 8)
        phase = 2.0 * np.pi * (s[:, None] / period + rng.uniform(0.0, 1.0, 8))
        return np.asarray(sd * np.sin(phase) @ rng.normal(0.0, 0.5, 8))

    yaw = 0.7 + np.cumsum(wander(0.15, 30.0, 6.0)) * 0.01
    pitch = wander(0.006, 2.0, 0.5)
    speed = 11.0 + wander(2.0, 40.0, 10.0)
    velocity = speed[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw), 0.0 * s])
    lat, lon, height = from_local_ned(np.cumsum(velocity, axis=0) * 0.01, ORIGIN)
    return replace(
        drive_path(60.0),
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=velocity,
        rpy=np.column_stack([0.0 * s, pitch, yaw]),
    )


@pytest.fixture(autouse=True)
def few_places(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "PLACES", 60)
    monkeypatch.setattr(limits, "LATE_STEP_S", 0.08)


@pytest.fixture(scope="module")
def path() -> Trajectory:
    return town(1)


def seen(path: Trajectory, view: Camera) -> Detections:
    found, owner = boxes(path, roadside(path, every_s=6.0), view, np.random.default_rng(3))
    return replace(found, track=owner)


@pytest.fixture(scope="module")
def found(path: Trajectory) -> Detections:
    return seen(path, camera())


def zoomed(view: Camera, by: float) -> Camera:
    matrix = view.matrix.copy()
    matrix[:2, :2] *= by
    return replace(view, matrix=matrix)


def told(path: Trajectory, found: Detections, view: Camera) -> Evidence:
    return evidence_of(path, found, view, GeolocationRules())


def test_boxes_of_this_path_and_time_are_not_doubted(path, found) -> None:
    one = told(path, found, camera())
    assert not one.doubts
    assert one.shown
    assert one.allows(True)
    assert one.rate == pytest.approx(0.0, abs=0.003)
    assert abs(one.late_s) <= limits.LATE_OWN_S
    assert one.factor == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("late_s", [-2.4, 0.8])
def test_frames_of_another_time_are_told_with_their_offset(path, found, late_s: float) -> None:
    late = replace(found, t_ns=found.t_ns + round(late_s * 1e9))
    one = told(path, late, camera())
    assert one.is_late
    assert one.late_s == pytest.approx(-late_s, abs=0.06)
    (shifted,) = explanation_by_tracks(Hypothesis("", late, camera()), replace(one, focal=0.0), 0.0)
    assert f"{-late_s:+.1f} s from their stamps" in shifted.what
    assert np.abs(shifted.found.t_ns - found.t_ns).max() < 0.06e9


@pytest.mark.parametrize("rate", [-0.03, 0.015])
def test_stamps_at_another_pace_are_told_with_it(path, found, rate: float) -> None:
    since = found.t_ns - found.t_ns.min()
    fast = replace(found, t_ns=found.t_ns + np.round(rate * since).astype(np.int64))
    one = told(path, fast, camera())
    assert one.is_paced
    assert one.paced > one.late
    assert one.rate == pytest.approx(1.0 / (1.0 + rate) - 1.0, abs=0.003)
    assert not one.allows(True)
    # as if its frames had been found a quarter of a second off
    (other,) = explanation_by_tracks(Hypothesis("", fast, camera()), one, 0.25)
    assert f"take {1.0 + one.rate:.4f} of the time" in other.what
    assert np.abs(other.found.t_ns - found.t_ns - 0.25e9).max() < 0.2e9


def test_another_focal_length_is_told(path, found) -> None:
    one = told(path, found, zoomed(camera(), 1.4))
    assert one.is_zoomed
    assert not one.is_late
    assert one.factor == pytest.approx(1.0 / 1.4, rel=0.05)
    (other,) = explanation_by_tracks(Hypothesis("", found, zoomed(camera(), 1.4)), one, 0.0)
    assert other.camera.matrix[0, 0] == pytest.approx(1000.0, rel=0.05)


def test_a_lens_that_does_not_reach_all_boxes_at_another_focal_length(path, found) -> None:
    bent = replace(camera(), distortion=np.array([-0.3, 0.0, 0.0, 0.0, 0.0]))
    wide = replace(found, box=found.box + np.array([400.0, 0.0, 400.0, 0.0]))
    assert np.isfinite(told(path, wide, bent).focal)


@pytest.mark.parametrize("seed", [2, 4])
def test_boxes_of_another_drive_fit_no_better_than_chance(path, seed: int) -> None:
    one = told(path, seen(town(seed), camera()), camera())
    assert one.chance > 0.0
    assert one.doubts
    assert not one.allows(False)


def test_a_straight_level_road_says_nothing() -> None:
    straight = drive_path(60.0, turn_rate=0.0)
    found = seen(straight, camera())
    for one in (
        told(straight, found, camera()),
        told(straight, replace(found, t_ns=found.t_ns + 10**9), camera()),
    ):
        assert not one.doubts
        assert one.allows(False)
        assert not one.shown
        # and so does not speak for what would be assumed
        assert not one.allows(True)


def test_boxes_without_tracks_or_off_the_path_say_nothing(path, found) -> None:
    assert told(path, replace(found, track=np.full(len(found), -1)), camera()) == NOTHING_TOLD
    assert told(path, replace(found, t_ns=found.t_ns + 10**12), camera()) == NOTHING_TOLD
    assert not NOTHING_TOLD.doubts
    assert explanation_by_tracks(Hypothesis("", found, camera()), NOTHING_TOLD, 0.0) == []


def test_likelihoods_are_averaged_and_one_track_of_no_sign_says_little() -> None:
    assert _average(np.log([1.0, 3.0, np.nan])) == pytest.approx(np.log(2.0))
    assert _average(np.array([800.0, 800.0])) == pytest.approx(800.0)
    anywhere = np.log([[1.0, 1.0], [3.0, 3.0]])
    # as likely anywhere as here
    alike = np.array([_average(-column) for column in anywhere.T])
    assert _by_chance(-alike, anywhere, np.full(2, 0.1)) == pytest.approx(0.0)
    far = _by_chance(np.array([500.0, 500.0]), anywhere, np.full(2, 0.1))
    assert far == pytest.approx(2.0 * np.log(10.0))
    assert _by_chance(np.array([np.nan, 500.0]), anywhere, np.full(2, 0.1)) == pytest.approx(
        np.log(10.0)
    )


@pytest.mark.slow
def test_it_is_said_where_nothing_shows_that_boxes_are_of_the_drive(path, found) -> None:
    straight = drive_path(20.0, turn_rate=0.0)
    for way, boxes_of, says in ((path, found, False), (straight, seen(straight, camera()), True)):
        result = locate_signs(way, [boxes_of], {"front": camera()})
        assert {sign.status for sign in result.signs} == {"ok"}
        assert any("nothing shows that its boxes are of this" in w for w in result.warnings) == says
