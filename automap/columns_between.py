"""Several quantities at other instants at once."""

from __future__ import annotations

import numpy as np

from automap.jit import kernel
from automap.records import FloatArray


@kernel
def interpolate(x: FloatArray, t: FloatArray, values: FloatArray, out: FloatArray) -> None:
    """``values`` [n, c] at instants ``t`` [n] as they are at ``x`` [m], in ``out`` [m, c]: to the
    bit what ``numpy.interp`` says of each column, but a place is looked for once, and seldom far
    from the last one."""
    last, i = len(t) - 1, 0
    for k in range(len(x)):
        if i < last and t[i + 1] <= x[k]:
            i += 1
        if x[k] < t[i] or (i < last and t[i + 1] <= x[k]):
            i = max(np.searchsorted(t, x[k], side="right") - 1, 0)
        if i == last or x[k] <= t[i]:
            out[k] = values[i]
            continue
        for c in range(values.shape[1]):
            slope = (values[i + 1, c] - values[i, c]) / (t[i + 1] - t[i])
            out[k, c] = slope * (x[k] - t[i]) + values[i, c]
