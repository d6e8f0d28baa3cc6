"""States between samples."""

from __future__ import annotations

import math

from automap.fusion.mechanisation import radii
from automap.jit import kernel
from automap.records import FloatArray


@kernel
def interpolate_states(
    t: FloatArray, states: FloatArray, want: FloatArray, out: FloatArray
) -> None:
    """States ``out`` [m, 10] at rising instants ``want`` [m] of ``states`` [n, 10] at ``t`` [n].

    Position by cubic Hermite on the velocities, velocity linear, attitude by the chord. Beyond
    the ends the vehicle keeps its last velocity and attitude.
    """
    n = t.shape[0]
    i = 0
    for k in range(want.shape[0]):
        while i < n - 2 and t[i + 1] <= want[k]:
            i += 1
        step = t[i + 1] - t[i]
        s = min(max((want[k] - t[i]) / step, 0.0), 1.0)
        beyond = want[k] - min(max(want[k], t[0]), t[n - 1])
        dlon = states[i + 1, 1] - states[i, 1]
        if dlon > math.pi:
            dlon -= 2.0 * math.pi
        elif dlon < -math.pi:
            dlon += 2.0 * math.pi
        for a in range(10):
            out[k, a] = states[i, a] + (states[i + 1, a] - states[i, a]) * s
        out[k, 1] = states[i, 1] + dlon * s
        rm, rn = radii(out[k, 0])
        for axis in range(3):
            change = states[i + 1, axis] - states[i, axis]
            if axis == 0:
                metres = rm + out[k, 2]
            elif axis == 1:
                metres = (rn + out[k, 2]) * math.cos(out[k, 0])
                change = dlon
            else:
                metres = -1.0
            chord = change * metres
            # deviation of the cubic from the chord
            bend = (1.0 - s) * (states[i, 3 + axis] * step - chord)
            bend -= s * (states[i + 1, 3 + axis] * step - chord)
            out[k, axis] += (s * (1.0 - s) * bend + out[k, 3 + axis] * beyond) / metres
        dot = 0.0
        for a in range(6, 10):
            dot += states[i, a] * states[i + 1, a]
        sign = 1.0 if dot >= 0.0 else -1.0
        norm = 0.0
        for a in range(6, 10):
            out[k, a] = states[i, a] * (1.0 - s) + sign * states[i + 1, a] * s
            norm += out[k, a] * out[k, a]
        norm = math.sqrt(norm)
        for a in range(6, 10):
            out[k, a] /= norm
