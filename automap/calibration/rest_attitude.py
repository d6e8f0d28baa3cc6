"""Roll and pitch of a resting sensor by its gyro: the paper's figure 2.

What is left of the gyro's bias turns the attitude of a sensor that does not move; after a
dynamic calibration it stays put.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from automap.calibration.gravity_kernel import N_SIGNALS, carry_direction
from automap.records import FloatArray


@dataclass(frozen=True)
class RestAttitude:
    """The unit vector of gravity in body axes, ``down`` [n, 3], at ``t_s`` [n], carried by the
    gyro from the levelled start."""

    t_s: FloatArray
    down: FloatArray

    @property
    def drift(self) -> float:
        """Largest angle between the gravity direction carried and that of the start, rad."""
        return largest_turn(self.down)


def largest_turn(down: FloatArray) -> float:
    """Largest angle, rad, between unit vectors [n, 3] and the first of them."""
    chord = np.linalg.norm(down - down[0], axis=1)
    return float(2.0 * np.arcsin(np.clip(0.5 * chord.max(), 0.0, 1.0)))


def roll_pitch_since_start(down: FloatArray) -> FloatArray:
    """Roll and pitch [n, 2] in rad by which gravity [n, 3] in body axes has turned since its
    first: from there as level, so that they mean the same in every attitude."""
    z = down[0]
    aside = np.eye(3)[int(np.abs(z).argmin())]
    y = np.cross(z, aside)
    y /= np.linalg.norm(y)
    x = np.cross(y, z)
    return np.column_stack(
        [np.arctan2(down @ y, down @ z), np.arctan2(-down @ x, np.hypot(down @ y, down @ z))]
    )


def rest_attitude(
    t_s: FloatArray, gyro: FloatArray, accel: FloatArray, steps: int = 200
) -> RestAttitude:
    """Integrate the gyro [n, 3] (rad/s) over a rest; ``accel`` [n, 3] levels the start.

    Only gravity's direction in body axes is carried, since heading is unknown at rest.
    """
    n = max(2, round(1.0 / float(np.median(np.diff(t_s)))))
    up = accel[:n].mean(axis=0)
    down = -up / np.linalg.norm(up)
    marks = np.unique(np.linspace(0, len(t_s) - 1, steps).astype(np.int64))
    found, gyro = [down], np.ascontiguousarray(gyro)
    end, sensitivity = np.empty(3), np.empty((3, 3, N_SIGNALS))
    signals = np.zeros((len(t_s), N_SIGNALS))
    dt = np.diff(t_s)
    for a, b in itertools.pairwise(marks):
        carry_direction(gyro[a : b + 1], signals[a : b + 1], dt[a:b], found[-1], end, sensitivity)
        found.append(end / np.linalg.norm(end))
    return RestAttitude(t_s[marks] - t_s[0], np.array(found))
