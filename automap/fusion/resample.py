"""States at other instants than the samples'."""

from __future__ import annotations

import numpy as np

from automap import earth
from automap.records import FloatArray


def shift_states(t: FloatArray, states: FloatArray, shift_s: float) -> FloatArray:
    """States [n, 10] at ``t + shift_s`` of states at ``t`` [n] in s.

    Position by cubic Hermite on the velocities, velocity linear, attitude by the chord. Beyond
    the ends the vehicle keeps its last velocity and attitude.
    """
    if shift_s == 0.0 or len(t) < 2:
        return states
    want = t + shift_s
    i = np.clip(np.searchsorted(t, want, side="right") - 1, 0, len(t) - 2)
    step = t[i + 1] - t[i]
    s = np.clip((want - t[i]) / step, 0.0, 1.0)
    beyond = want - np.clip(want, t[0], t[-1])
    a, b = states[i], states[i + 1]
    out = a + (b - a) * s[:, None]
    out[:, 1] = a[:, 1] + _wrap(b[:, 1] - a[:, 1]) * s
    meridian, transverse = earth.radii(out[:, 0])
    north = 1.0 / (meridian + out[:, 2])
    east = 1.0 / ((transverse + out[:, 2]) * np.cos(out[:, 0]))
    # deviation of the cubic from the chord, per axis in metres
    for axis, scale, sign in ((0, north, 1.0), (1, east, 1.0), (2, np.ones_like(north), -1.0)):
        change = b[:, axis] - a[:, axis]
        if axis == 1:
            change = _wrap(change)
        chord = sign * change / scale
        v0, v1 = a[:, 3 + axis] * step, b[:, 3 + axis] * step
        bend = s * (1.0 - s) * ((1.0 - s) * (v0 - chord) - s * (v1 - chord))
        out[:, axis] += sign * scale * (bend + out[:, 3 + axis] * beyond)
    same = np.sign(np.einsum("ij,ij->i", a[:, 6:], b[:, 6:]))[:, None]
    q = a[:, 6:] * (1.0 - s[:, None]) + same * b[:, 6:] * s[:, None]
    out[:, 6:] = q / np.linalg.norm(q, axis=1, keepdims=True)
    return np.asarray(out)


def _wrap(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
