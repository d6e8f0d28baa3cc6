"""Functions of formulas that remember: what follows slowly, and what hangs in a play."""

from __future__ import annotations

import numpy as np

from automap.jit import kernel
from automap.records import FloatArray


@kernel
def lag(values: FloatArray, time: FloatArray, seconds: float) -> FloatArray:
    """``values`` [n] at ``time`` [n] s, low-passed in first order; at rest where they begin.

    Exact for values that are straight between instants, so that steps of a second do as well as
    those of a sensor.
    """
    out = np.empty(len(values))
    out[0] = values[0]
    for i in range(1, len(values)):
        step = max(time[i] - time[i - 1], 0.0) / seconds
        keep = np.exp(-step)
        # share of the newer value over the step; of the older the rest
        newer = 1.0 - (1.0 - keep) / step if step > 1e-6 else 0.0
        older = 1.0 - keep - newer
        out[i] = keep * out[i - 1] + older * values[i - 1] + newer * values[i]
    return out


@kernel
def play(values: FloatArray, width: float) -> FloatArray:
    """What a joint with a play of ``width`` to either side passes on of ``values`` [n]; its middle
    is at zero before (Prandtl's play operator: Krasnosel'skii and Pokrovskii 1989)."""
    out = np.empty(len(values))
    at = 0.0
    for i in range(len(values)):
        at = min(max(at, values[i] - width), values[i] + width)
        out[i] = at
    return out
