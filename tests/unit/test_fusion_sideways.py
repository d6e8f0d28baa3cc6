"""A path whose vehicle goes sideways is told, one that slides as cars do is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.doubts.sideways import sideways
from automap.fusion.options import FusionOptions
from automap.lever_arm import moved_to
from automap.records import FloatArray, Trajectory

OPTIONS, AT_AXLE = FusionOptions(), np.zeros(3)
PARTS = (slice(0, 1210), slice(1210, None))


def path_of(slip: FloatArray, speed: float = 15.0, rate: float = 0.0) -> Trajectory:
    """A path at 10 rows a second whose nose is ``slip`` [n] rad off its course, which turns with
    ``rate`` rad/s."""
    n = len(slip)
    t, three = 0.1 * np.arange(n), np.ones((n, 3))
    course = rate * t
    velocity = speed * np.stack([np.cos(course), np.sin(course), 0.0 * t], axis=1)
    rpy = np.stack([0.0 * t, 0.0 * t, course + slip], axis=1)
    place = t, 0.6 + 0.0 * t, 0.2 + 0.0 * t, 0.0 * t
    stamps = np.rint(t * 1e9).astype(np.int64)
    return Trajectory(stamps, *place, velocity, rpy, three, 0.05 * three, 0.005 * three)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_nose_off_its_course_is_told_with_its_time(sign: float) -> None:
    off = np.zeros(2000)
    off[1200:1250] = sign * np.radians(12.0)
    path = path_of(off)
    (reason,) = sideways([path], OPTIONS, AT_AXLE)
    assert reason.code == "path_sideways"
    assert "12 deg" in reason.text
    assert reason.spans == ((pytest.approx(110.0), pytest.approx(134.9)),)
    # a path comes in stretches, and times are of the whole
    halves = [replace(path, **{k: getattr(path, k)[rows] for k in vars(path)}) for rows in PARTS]
    assert list(sideways(halves, OPTIONS, AT_AXLE)) == [reason]


def test_what_cars_do_is_not_told() -> None:
    assert list(sideways([path_of(np.full(600, np.radians(0.7)))], OPTIONS, AT_AXLE)) == []
    # tyres in a bend of 0.4 g at 10 m/s: half a degree for 1 m/s^2
    assert list(sideways([path_of(np.full(600, 0.035), 10.0, 0.4)], OPTIONS, AT_AXLE)) == []
    # in reverse
    assert list(sideways([path_of(np.full(600, np.pi))], OPTIONS, AT_AXLE)) == []
    # what hardly moves has no course
    assert list(sideways([path_of(np.full(600, 1.0), 2.0)], OPTIONS, AT_AXLE)) == []


def test_a_body_that_a_kerb_rolls_is_not_told() -> None:
    # a phone on a dash that turned into a drive: 15 deg a second of roll at 3.6 m/s, 6.4 deg aside
    off, roll = np.zeros((2, 600))
    off[300:310], roll[300:310] = np.radians(6.4), np.radians(1.5) * np.arange(10)
    roll[310:] = roll[309]
    path = path_of(off, 3.6)
    told = list(sideways([path], OPTIONS, AT_AXLE))
    assert [reason.code for reason in told] == ["path_sideways"]
    assert (
        list(sideways([replace(path, rpy=path.rpy + np.outer(roll, [1, 0, 0]))], OPTIONS, AT_AXLE))
        == []
    )


def test_a_sensor_far_ahead_of_the_axle_swings_out_in_bends_and_is_not_told() -> None:
    # corners of 0.4 rad/s at 7 m/s that begin and end within half a second
    rate = 0.4 * np.clip(2.0 * np.sin(np.arange(600) / 12.0), -1.0, 1.0)
    course = np.cumsum(0.1 * rate)
    turned = np.stack([np.cos(course), np.sin(course), 0.0 * course], axis=1)
    path = path_of(np.zeros(600))
    rpy = np.stack([0.0 * course, 0.0 * course, course], axis=1)
    ahead = moved_to(replace(path, vel_ned=7.0 * turned, rpy=rpy), (4.0, 0.0, 0.0))
    assert [r.code for r in sideways([ahead], OPTIONS, AT_AXLE)] == ["path_sideways"]
    assert list(sideways([ahead], OPTIONS, np.array([-4.0, 0.0, 0.0]))) == []
