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
    """Roll and pitch [n, 2] in rad at ``t_s`` [n], integrated from the levelled start."""

    t_s: FloatArray
    roll_pitch: FloatArray

    @property
    def drift(self) -> float:
        """Largest angle between the gravity direction carried and that of the start, rad."""
        start, now = _down(self.roll_pitch[0]), _down(self.roll_pitch)
        return float(np.max(np.arccos(np.clip(now @ start, -1.0, 1.0))))


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
    found = [down]
    end, sensitivity = np.empty(3), np.empty((3, 3, N_SIGNALS))
    signals = np.zeros((len(t_s), N_SIGNALS))
    dt = np.diff(t_s)
    for a, b in itertools.pairwise(marks):
        carry_direction(gyro[a : b + 1], signals[a : b + 1], dt[a:b], found[-1], end, sensitivity)
        found.append(end / np.linalg.norm(end))
    d = np.array(found)
    roll = np.arctan2(d[:, 1], d[:, 2])
    pitch = np.arctan2(-d[:, 0], np.hypot(d[:, 1], d[:, 2]))
    return RestAttitude(t_s[marks] - t_s[0], np.column_stack([roll, pitch]))


def _down(roll_pitch: FloatArray) -> FloatArray:
    """Unit vectors [..., 3] of gravity in body axes."""
    roll, pitch = roll_pitch[..., 0], roll_pitch[..., 1]
    return np.stack(
        [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)], axis=-1
    )
