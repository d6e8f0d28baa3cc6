"""How the sensor sits in vehicles that lean outwards in bends, and inwards."""

from __future__ import annotations

import numpy as np
import pytest

from automap.frames import rpy_to_matrix
from automap.fusion.mounting import Mounting, estimate_mounting

G = 9.81
MOUNT = np.radians([4.0, -3.0, 5.0])


def mounted(lean: float, seconds: float = 400.0) -> Mounting:
    """Of a drive that bends to the right far more than to the left, whose vehicle leans ``lean``
    times as a pendulum does, inwards where that is positive."""
    t = np.arange(0.0, seconds, 0.1)
    speed = 12.0
    rate = np.where(t % 40.0 < 15.0, 0.25, np.where(t % 40.0 > 37.0, -0.25, 0.0))
    yaw = np.cumsum(rate) * 0.1
    roll = lean * np.arctan(speed * rate / G)
    zero = np.zeros_like(t)
    vehicle = rpy_to_matrix(np.column_stack([roll, zero, yaw]))
    c_n_s = vehicle @ rpy_to_matrix(MOUNT)
    turning = np.einsum("nji,nj->ni", c_n_s, np.column_stack([zero, zero, rate]))
    velocity = speed * np.column_stack([np.cos(yaw), np.sin(yaw), zero])
    return estimate_mounting(t, velocity, c_n_s, turning, zero)


@pytest.mark.parametrize("lean", [-0.05, 0.0, 1.0], ids=["car", "stiff", "motorcycle"])
def test_a_vehicle_that_leans_in_bends_to_one_side_sits_upright(lean: float) -> None:
    found = mounted(lean)
    np.testing.assert_allclose(found.rpy[0], MOUNT[0], atol=np.radians(0.6))
    assert np.degrees(found.sd[0]) < 1.3
