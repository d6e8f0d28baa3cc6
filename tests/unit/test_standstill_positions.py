"""Standstill where a log tells positions only."""

from __future__ import annotations

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.fusion.layout import HAS_POS_H, HAS_POS_V, HAS_VEL_H
from automap.fusion.nodes import FixModel
from automap.fusion.standstill import find_standstill, shown_speed, unmoved
from automap.records import FloatArray

STOPS = [(40.0, 70.0), (150.0, 165.0)]
END_S, RATE_HZ, SPEED = 240.0, 50.0, 10.0


def speed_at(t: FloatArray) -> FloatArray:
    """10 m/s, and none at the stops."""
    speed = np.full_like(t, SPEED)
    for start, stop in STOPS:
        # braking and starting at 2 m/s^2
        away = np.maximum(np.maximum(start - t, t - stop), 0.0)
        speed = np.minimum(speed, 2.0 * away)
    return speed


def fixes(step_s: float, noise_m: float, velocity: bool = False) -> FixModel:
    """Fixes on a straight road to the north-east."""
    fine = np.arange(0.0, END_S, 0.01)
    along = np.concatenate([[0.0], np.cumsum(speed_at(fine)[:-1]) * 0.01])
    t = np.arange(0.0, END_S, step_s)
    rng = np.random.default_rng(5)
    place = np.interp(t, fine, along)[:, None] * np.sqrt(0.5) + rng.normal(0, noise_m, (len(t), 2))
    north, east = metres_per_radian(np.full(1, -0.6), np.zeros(1))
    values = np.zeros((len(t), 6))
    values[:, 0] = -0.6 + place[:, 0] / north
    values[:, 1] = 2.6 + place[:, 1] / east
    values[:, 3:5] = speed_at(t)[:, None] * np.sqrt(0.5)
    flags = HAS_POS_H | HAS_POS_V | (HAS_VEL_H if velocity else 0)
    white = np.full((len(t), 6), noise_m**2)
    stated = np.full((len(t), 3), 1.0)
    rows, usual = np.arange(len(t)), np.ones((len(t), 2))
    return FixModel(t, np.full(len(t), flags), values, white, stated, rows, usual)


def readings() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, gyro and accelerometer that shake while the vehicle drives."""
    t = np.arange(0.0, END_S, 1.0 / RATE_HZ)
    shake = np.where(speed_at(t) > 0.0, 20.0, 1.0)[:, None]
    rng = np.random.default_rng(6)
    gyro, accel = (size * shake * rng.normal(size=(len(t), 3)) for size in (0.001, 0.02))
    return t, gyro, accel


@pytest.mark.parametrize(("step_s", "noise_m"), [(1.0, 0.3), (0.2, 0.3), (1.0, 0.02)])
def test_stops_are_found_by_positions(step_s: float, noise_m: float) -> None:
    model = fixes(step_s, noise_m)
    found = unmoved(find_standstill(*readings(), *shown_speed(model)), model)
    assert found
    rest = np.array([any(a <= t <= b for a, b in found) for t in np.arange(0.0, END_S, 0.1)])
    true = speed_at(np.arange(0.0, END_S, 0.1)) == 0.0
    assert not (rest & ~true).any()
    lost_at_ends = 2 * 4.0 * len(STOPS)
    assert 0.1 * rest.sum() > 0.1 * true.sum() - lost_at_ends


def test_the_speed_of_positions_is_as_good_as_it_says() -> None:
    t, speed, sd = shown_speed(fixes(1.0, 0.3))
    steady = np.abs(speed_at(t + 4.0) - SPEED) + np.abs(speed_at(t - 4.0) - SPEED) == 0.0
    error = speed[steady] - SPEED
    # the sd is that of both coordinates, of which one lies along the road
    assert 0.4 < np.sqrt(np.mean(error**2)) / np.median(sd) < 1.1


def test_a_receivers_own_speeds_go_first() -> None:
    model = fixes(1.0, 0.3, velocity=True)
    t, speed, _ = shown_speed(model)
    np.testing.assert_allclose(speed, speed_at(t))


@pytest.mark.parametrize("count", [0, 1, 3])
def test_few_positions_show_no_speed(count: int) -> None:
    model = fixes(1.0, 0.3)
    few = FixModel(
        *(getattr(model, name)[:count] for name in ("t", "flags", "values", "white_var")),
        model.stated_sd[:count],
        model.row[:count],
        model.larger[:count],
    )
    assert [len(values) for values in shown_speed(few)] == [0, 0, 0]


def test_positions_far_apart_show_no_speed() -> None:
    assert len(shown_speed(fixes(5.0, 0.3))[0]) == 0
