"""Time offsets that a drive does not tell apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.gates import gate, sigmas
from automap.geolocation import limits
from automap.geolocation.locate import locate_signs
from automap.geolocation.result import GeolocationResult
from automap.geolocation.time_minima import alike, apart
from automap.records import FloatArray
from tests.benchmarks.geolocation_world import Difficulty, make_world

SWING_S = 0.66


def test_minima_that_chance_does_not_tell_apart_are_all_named() -> None:
    time = np.array([-0.34, -0.1, 0.0, 0.1, 0.3, 0.4])
    loss = np.array([39.0, 60.0, 50.0, 55.0, 41.5, np.nan])
    assert alike(time, loss, 0.03) == (-0.34, 0.3)
    # what is next to the least is none, nor what lies within its sigmas
    assert alike(time, np.sort(loss), 0.03) == (-0.34,)
    assert alike(time, loss, 0.3) == (-0.34,)
    assert alike(time, np.full(6, np.nan), 0.03) == ()


def test_a_minimum_that_stands_alone_leaves_nothing_open() -> None:
    chance = 0.5 * gate(limits.ALIKE_PROBABILITY, 1)
    for over, number in ((0.99, 2), (1.01, 1)):
        assert len(alike(np.arange(3.0), np.array([over * chance, 9.0, 0.0]), 0.1)) == number


def test_offsets_are_apart_by_their_sigmas() -> None:
    far = sigmas(limits.ALIKE_PROBABILITY) * 0.01
    assert [apart(0.2, 0.2 + part * far, 0.01) for part in (0.98, 1.02, -1.02)] == [
        False,
        True,
        True,
    ]


def pitching(pitch_deg: FloatArray, time_offset_s: float = 0.0) -> GeolocationResult:
    """Two signs of a straight road, the car pitching by ``pitch_deg`` [1200] at 100 Hz."""
    level = drive_path(12.0, turn_rate=0.0)
    rpy = level.rpy.copy()
    rpy[:, 1] = np.radians(pitch_deg)
    trajectory = replace(level, rpy=rpy)
    scene = roadside(trajectory)
    view = camera(time_offset_sd=0.3, time_offset_s=time_offset_s)
    found, _ = boxes(trajectory, scene, view, np.random.default_rng(3), noise_px=0.5)
    return locate_signs(trajectory, [found], {"front": camera(time_offset_sd=0.3)})


@pytest.mark.slow
def test_a_steady_swing_leaves_the_offset_open() -> None:
    t = np.arange(1200) * 0.01
    result = pitching(0.7 * np.sin(2.0 * np.pi * t / SWING_S))
    found = result.corrections["front"]
    assert found.time_s == 0.0
    np.testing.assert_allclose(np.sqrt(found.covariance[3, 3]), 0.3)
    assert len(found.time_minima) > 1
    apart = np.diff(found.time_minima)
    np.testing.assert_allclose(apart, SWING_S * np.rint(apart / SWING_S), atol=0.05)
    assert any("explain the boxes alike" in text for text in result.warnings)


@pytest.mark.slow
def test_a_bump_tells_the_offset() -> None:
    t = np.arange(1200) * 0.01
    bumps = sum(np.exp(-(((t - at) / 0.25) ** 2)) for at in (4.5, 8.6))
    result = pitching(1.5 * bumps, time_offset_s=0.2)
    found = result.corrections["front"]
    assert found.time_minima == ()
    np.testing.assert_allclose(found.time_s, 0.2, atol=0.03)


@pytest.mark.slow
def test_many_signs_of_a_straight_road_hide_no_other_offset() -> None:
    """Thirty-one signs, one bend: the nearest end of a descent is 0.17 s off, sure of 15 ms."""
    mount = (1.7248187830137738, 2.58726699657376, 1.8265727375559537)
    late_s = -0.20916779206547165
    world = make_world(
        8182,
        Difficulty(mount_deg=mount, late_s=late_s, duration_s=90.0, twice=False, box_alike=0.7),
    )
    result = locate_signs(world.trajectory, [world.detections], {"front": world.camera})
    found = result.corrections["front"]
    assert abs(found.time_s - late_s) < 3.0 * np.sqrt(found.covariance[3, 3])
