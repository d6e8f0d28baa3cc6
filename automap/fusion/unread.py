"""The path where a vehicle drove without inertial readings: that of the fixes alone.

A logger that hung, started late or was full before the drive ended leaves out minutes of readings.
The fixes of these minutes are as good as those of a drive without a sensor.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from automap.earth import metres_per_radian
from automap.frames import rpy_to_matrix
from automap.fusion.aside import whole_trajectory
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import DRIVING_SPEED
from automap.interpolation import LONGEST_GAP_S
from automap.records import FloatArray, IntArray, Trajectory


def unread(alone: Trajectory, t_ns: IntArray) -> Trajectory:
    """The rows of the path of the fixes ``alone`` in holes between readings at ``t_ns`` [n] that
    are too long for poses between them, or that far before the first or behind the last reading."""
    first, last = min(alone.t_ns[0], t_ns[0]), max(alone.t_ns[-1], t_ns[-1])
    edges = np.concatenate([[first - 1], t_ns, [last + 1]])
    after = np.searchsorted(edges, alone.t_ns, side="right")
    hole_s = (edges[after] - edges[after - 1]) * 1e-9
    # where a reading is there is a row already
    return alone.at(np.flatnonzero((hole_s > LONGEST_GAP_S) & (edges[after - 1] < alone.t_ns)))


def at_sensor(path: Trajectory, arm: FloatArray) -> Trajectory:
    """The path of a sensor, by that of the antenna ``arm`` [3] m forward, right and down of it."""
    ahead = rpy_to_matrix(path.rpy) @ arm
    north, east = metres_per_radian(path.lat_rad, path.height_m)
    # what the antenna leans and turns by, unseen, moves the sensor below it
    level = np.hypot(path.sd_rpy[:, 2] * np.hypot(*arm[:2]), path.sd_rpy[:, 0] * arm[2])
    unsure = np.stack([level, level, np.zeros(len(path))], axis=1)
    return replace(
        path,
        lat_rad=path.lat_rad - ahead[:, 0] / north,
        lon_rad=path.lon_rad - ahead[:, 1] / east,
        height_m=path.height_m + ahead[:, 2],
        sd_pos_ned=np.hypot(path.sd_pos_ned, unsure),
    )


def joined(stretches: Iterable[Trajectory], more: Trajectory) -> Iterator[Trajectory]:
    """The ``stretches`` of a trajectory with the rows of another, of other stamps, among them."""
    done = 0
    for stretch in stretches:
        reached = int(np.searchsorted(more.t_ns, stretch.t_ns[-1]))
        both = whole_trajectory([stretch, more.at(slice(done, reached))])
        yield both.at(np.argsort(both.t_ns, kind="stable")) if reached > done else stretch
        done = reached
    if done < len(more):
        yield more.at(slice(done, None))


def driven_m(path: Trajectory) -> float:
    """Metres driven between the rows of a path that are near enough for poses between them."""
    step, speed = np.diff(path.gps_s), np.hypot(path.vel_ned[1:, 0], path.vel_ned[1:, 1])
    return float((step * speed)[(step <= LONGEST_GAP_S) & (speed > DRIVING_SPEED)].sum())


def later(reasons: Sequence[Reason], seconds: float) -> list[Reason]:
    """The reasons, whose stretches count from ``seconds`` earlier on."""
    return [
        replace(one, spans=tuple((a + seconds, b + seconds) for a, b in one.spans))
        for one in reasons
    ]
