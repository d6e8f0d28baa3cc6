"""States at other instants than the samples'."""

from __future__ import annotations

import numpy as np

from automap.fusion.kernels.resample import interpolate_states
from automap.records import FloatArray


def shift_states(t: FloatArray, states: FloatArray, shift_s: FloatArray) -> FloatArray:
    """States [n, 10] at ``t + shift_s`` [n] of states at ``t`` [n] in s (see ``states_at``)."""
    if not shift_s.any() or len(t) < 2:
        return states
    return states_at(t, states, t + shift_s)


def states_at(t: FloatArray, states: FloatArray, want: FloatArray) -> FloatArray:
    """States [m, 10] at rising instants ``want`` [m] of states [n, 10] at ``t`` [n] s, n > 1.

    Position by cubic Hermite on the velocities, velocity linear, attitude by the chord. Beyond
    the ends the vehicle keeps its last velocity and attitude.
    """
    out = np.empty((len(want), states.shape[1]))
    interpolate_states(
        np.ascontiguousarray(t), np.ascontiguousarray(states), np.ascontiguousarray(want), out
    )
    return out
