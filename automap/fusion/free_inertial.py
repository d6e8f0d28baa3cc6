"""Inertial readings integrated by themselves, from no attitude and place that anything else told.

What another sensor saw of the motion cannot have entered, so that the two may be compared. Over
some seconds the unknown start is a constant, a slope and a parabola.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.frames import quat_to_matrix
from automap.fusion import limits
from automap.fusion.mechanisation import quat_to_dcm, rotate_right
from automap.jit import kernel
from automap.records import FloatArray, IntArray


@dataclass(frozen=True)
class FreeInertial:
    """Integrals of specific force in axes that stay as the vehicle's were at the first sample.

    ``t`` [n] s, ``quat`` [n, 4] vehicle to these axes, ``velocity`` [n, 3] m/s and ``position``
    [n, 3] m without gravity, ``rate`` [n, 3] rad/s in vehicle axes; ``lost_s`` [n] seconds in gaps.
    """

    t: FloatArray
    quat: FloatArray
    velocity: FloatArray
    position: FloatArray
    rate: FloatArray
    lost_s: FloatArray

    def nearest(self, t: FloatArray) -> IntArray:
        """The samples [m] next to instants [m] s."""
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        return np.asarray(after - (t - self.t[after - 1] < self.t[after] - t))

    def of_point(self, t: FloatArray, arm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity and position [m, 3] at instants [m] s of a point ``arm`` [3] m off in vehicle
        axes."""
        row = self.nearest(t)
        c = quat_to_matrix(self.quat[row])
        velocity, position = (
            np.stack([np.interp(t, self.t, column) for column in values.T], axis=1)
            for values in (self.velocity, self.position)
        )
        return velocity + np.einsum("nij,nj->ni", c, np.cross(self.rate[row], arm)), np.asarray(
            position + c @ arm
        )

    def lost_between(self, start: FloatArray, stop: FloatArray) -> FloatArray:
        """Seconds [m] of gaps between instants [m] s; infinite beyond the recording."""
        lost = np.interp(stop, self.t, self.lost_s) - np.interp(start, self.t, self.lost_s)
        beyond = (start < self.t[0]) | (stop > self.t[-1])
        return np.where(beyond, np.inf, lost)


def free_inertial(
    t: FloatArray, gyro: FloatArray, accel: FloatArray, bridged_s: FloatArray
) -> FreeInertial:
    """Integrate rates [n, 3] rad/s and forces [n, 3] m/s^2 in vehicle axes at rising ``t`` [n] s.

    ``bridged_s`` [n] is not zero where readings were made up; such stretches count as gaps.
    """
    n = len(t)
    quat, velocity, position = np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3))
    quat[0, 0] = 1.0
    _integrate(t, gyro, accel, quat, velocity, position)
    step = np.diff(t)
    gap = (step > limits.JOINED_S) | (bridged_s[:-1] > limits.JOINED_S)
    lost = np.concatenate([[0.0], np.cumsum(np.where(gap, step, 0.0))])
    return FreeInertial(t, quat, velocity, position, gyro, lost)


@kernel
def _integrate(
    t: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    quat: FloatArray,
    velocity: FloatArray,
    position: FloatArray,
) -> None:
    """Fill the rows after the first, by the trapezoidal rule."""
    q, c, force, before = quat[0].copy(), np.eye(3), np.zeros(3), np.zeros(3)
    quat_to_dcm(q, c)
    for a in range(3):
        for b in range(3):
            before[a] += c[a, b] * accel[0, b]
    for i in range(1, t.shape[0]):
        half = 0.5 * (t[i] - t[i - 1])
        w = half * (gyro[i - 1] + gyro[i])
        rotate_right(q, w[0], w[1], w[2])
        quat_to_dcm(q, c)
        for a in range(3):
            force[a] = c[a, 0] * accel[i, 0] + c[a, 1] * accel[i, 1] + c[a, 2] * accel[i, 2]
            velocity[i, a] = velocity[i - 1, a] + half * (before[a] + force[a])
            position[i, a] = position[i - 1, a] + half * (velocity[i - 1, a] + velocity[i, a])
            before[a] = force[a]
        quat[i] = q
