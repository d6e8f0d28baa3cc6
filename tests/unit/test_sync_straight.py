"""Positions that were put on a map's roads are told, and only they."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.fusion.doubts.receiver import receiver_doubts
from automap.records import Fixes
from automap.sync.velocity_consistency import velocity_consistency
from pipeline.check.velocity import check
from tests.slow_cases import others_slow
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive

MOTION = city_drive(300.0, seed=7)
DULL = Receiver(white=(0.01, 0.01, 0.02), velocity=0.02)


def on_roads(fixes: Fixes, leg_m: float = 40.0) -> Fixes:
    """Positions on the nearest point of a polyline with a vertex every ``leg_m`` of their way."""
    north, east = metres_per_radian(fixes.lat_rad[0], fixes.height_m[0])
    place = fixes.lat_rad * north + 1j * fixes.lon_rad * east
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(place)))])
    vertex = np.interp(np.arange(0.0, way[-1] + leg_m, leg_m), way, place)
    leg = np.clip((way // leg_m).astype(int)[:, None] + np.arange(-1, 2), 0, len(vertex) - 2)
    along = vertex[leg + 1] - vertex[leg]
    share = ((place[:, None] - vertex[leg]) / (along + 1e-9)).real
    near = vertex[leg] + np.clip(share, 0.0, 1.0) * along
    best = np.abs(near - place[:, None]).argmin(axis=1)
    place = near[np.arange(len(place)), best]
    return replace(fixes, lat_rad=place.real / north, lon_rad=place.imag / east)


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_positions_on_a_maps_roads_are_told(rate: float) -> None:
    fixes = on_roads(receive(MOTION, Receiver(rate=rate), 4))
    (reason,) = receiver_doubts(velocity_consistency(fixes), float(fixes.gps_s[0]))
    assert (reason.code, reason.state) == ("positions_straight", "doubtful")
    assert 0.3 < reason.error_m < 5.0
    finding = next(f for f in check(fixes) if f.code == "positions_straight")
    assert finding.severity == "warning"


@pytest.mark.parametrize("late", others_slow([0.0, 0.6]))
@pytest.mark.parametrize("receiver", [Receiver(), DULL, replace(DULL, lasting=0.2)])
@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_positions_of_a_receiver_bend_with_its_velocities(
    rate: float, receiver: Receiver, late: float
) -> None:
    receiver = replace(receiver, rate=rate, vel_latency=late, course_latency=0.5 * late)
    assert velocity_consistency(receive(MOTION, receiver, 4)).straight_m == 0.0
