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
    """Integrals of specific force in axes that stay as the vehicle's were at the first sample, at
    some of the samples.

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
    t: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    bridged_s: FloatArray,
    wanted: FloatArray | None = None,
    turn: FloatArray | None = None,
    bias: FloatArray | None = None,
) -> FreeInertial:
    """Integrate rates [n, 3] rad/s and forces [n, 3] m/s^2 at rising ``t`` [n] s.

    ``turn`` [3, 3] takes readings into vehicle axes, where they have the ``bias`` [6] of rates and
    forces; without them they are in these axes and have none. ``bridged_s`` [n] is not zero where
    readings were made up; such stretches count as gaps. Kept are the ends and the samples beside
    the instants ``wanted`` [m] s, or all.
    """
    rows = np.arange(len(t))
    if wanted is not None:
        after = np.searchsorted(t, wanted)
        beside = np.concatenate([after - 2, after - 1, after, after + 1])
        rows = np.unique(np.clip(np.append(beside, [0, len(t)]), 0, len(t) - 1))
    n = len(rows)
    quat, velocity, position = np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3))
    quat[0, 0] = 1.0
    turn = np.eye(3) if turn is None else np.ascontiguousarray(turn)
    bias = np.zeros(6) if bias is None else bias
    # the readings of ten hours are turned one after the other
    _integrate(t, gyro, accel, turn, bias, rows, quat, velocity, position)
    step = np.diff(t)
    gap = (step > limits.JOINED_S) | (bridged_s[:-1] > limits.JOINED_S)
    lost = np.concatenate([[0.0], np.cumsum(np.where(gap, step, 0.0))])
    rate = gyro[rows] @ turn.T - bias[:3]
    return FreeInertial(t[rows], quat, velocity, position, rate, lost[rows])


@kernel
def _turned(turn: FloatArray, reading: FloatArray, bias: FloatArray, out: FloatArray) -> None:
    """Fill a reading in vehicle axes without its bias, all [3]."""
    for a in range(3):
        out[a] = -bias[a]
        for b in range(3):
            out[a] += turn[a, b] * reading[b]


@kernel
def _integrate(
    t: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    turn: FloatArray,
    bias: FloatArray,
    rows: IntArray,
    quat: FloatArray,
    velocity: FloatArray,
    position: FloatArray,
) -> None:
    """Fill what is kept, the ``rows`` of the samples after the first, by the trapezoidal rule."""
    q, c, force, before = quat[0].copy(), np.eye(3), np.zeros(3), np.zeros(3)
    rate, was_rate, felt = np.zeros(3), np.zeros(3), np.zeros(3)
    v, p, k = np.zeros(3), np.zeros(3), 1
    quat_to_dcm(q, c)
    _turned(turn, gyro[0], bias[:3], was_rate)
    _turned(turn, accel[0], bias[3:], felt)
    before[:] = c @ felt
    for i in range(1, t.shape[0]):
        half = 0.5 * (t[i] - t[i - 1])
        _turned(turn, gyro[i], bias[:3], rate)
        _turned(turn, accel[i], bias[3:], felt)
        w = half * (was_rate + rate)
        rotate_right(q, w[0], w[1], w[2])
        quat_to_dcm(q, c)
        for a in range(3):
            force[a] = c[a, 0] * felt[0] + c[a, 1] * felt[1] + c[a, 2] * felt[2]
            was = v[a]
            v[a] = was + half * (before[a] + force[a])
            p[a] = p[a] + half * (was + v[a])
            before[a] = force[a]
            was_rate[a] = rate[a]
        if k < len(rows) and rows[k] == i:
            quat[k], velocity[k], position[k] = q, v, p
            k += 1
