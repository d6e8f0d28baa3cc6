"""Axes of a sensor that nobody described, as far as gravity tells them."""

from __future__ import annotations

from contextlib import suppress
from itertools import product
from pathlib import Path

import numpy as np

from automap.earth import MEAN_RADIUS
from automap.errors import ConfigError
from automap.fusion.limits import MOUNTING_MOVING_S, MOUNTING_SPEED
from automap.io.axes import axes_matrix
from automap.io.drive import load_drive
from automap.io.recording import read_recording
from automap.records import Fixes, FixType, FloatArray

_LEAST_SHARE = 0.9
"""Share of gravity that must lie on one axis."""
_WINDOW_S = 3.0
"""Positions so far apart give a speed: a metre of error in each is half a metre a second."""
_ENOUGH = 2.0
"""Times the least that an estimate of the mounting needs; speeds from fixes are no better."""


def is_slow(fixes: Fixes) -> bool:
    """Whether nothing moved as fast as a vehicle for long enough that its motion tells the axes."""
    good = np.isfinite(fixes.gps_s) & (fixes.fix_type >= FixType.TWO_D)
    t, speed = fixes.gps_s[good], np.hypot(fixes.vel_ned[good, 0], fixes.vel_ned[good, 1])
    if len(t) < 2:
        return True
    last = np.minimum(np.searchsorted(t, t + _WINDOW_S), len(t) - 1)
    lat, lon = fixes.lat_rad[good], fixes.lon_rad[good]
    north, east = lat[last] - lat, (lon[last] - lon) * np.cos(lat)
    away = MEAN_RADIUS * np.hypot(north, east)
    with np.errstate(invalid="ignore", divide="ignore"):
        # of speeds without a course velocities are known at rest alone
        speed = np.where(np.isfinite(speed), speed, away / (t[last] - t))
    fast = float(np.count_nonzero(speed > MOUNTING_SPEED)) * float(np.median(np.diff(t)))
    return fast < _ENOUGH * MOUNTING_MOVING_S


def axes_where_slow(folder: Path) -> str | None:
    """Axes by gravity of a drive that says it does not know them.

    None where it moves enough to tell them itself, where gravity is on no axis, or where readings
    or fixes are missing.
    """
    recording = read_recording(load_drive(folder))
    if recording.imu is None or recording.fixes is None or not is_slow(recording.fixes):
        return None
    return level_axes(recording.imu.accel)


SLOW = (
    "nothing moved as fast as a vehicle for long enough, from whose motion axes are estimated; by "
    "gravity they are {axes}, with one level axis taken as forward"
)
"""What is said of axes that :func:`axes_where_slow` gave."""


def level_axes(accel: FloatArray) -> str | None:
    """Axes, such as "FLU", of specific forces [n, 3] in any unit of a sensor near level.

    Which way is forward is not in them: an axis that is level is taken. None where gravity is
    on no axis.
    """
    mean = np.mean(accel, axis=0)
    axis = int(np.argmax(np.abs(mean)))
    if abs(mean[axis]) < _LEAST_SHARE * float(np.linalg.norm(mean)):
        return None
    vertical = "U" if mean[axis] > 0 else "D"
    for letters in product("FLRB", repeat=2):
        word = [*letters]
        word.insert(axis, vertical)
        with suppress(ConfigError):
            axes_matrix("".join(word))
            return "".join(word)
    return None
