"""Where a bias jumps, by the drift that a fit has found.

A jump that the model does not know makes innovations far from linear in its size, and a screening
puts it anywhere. A model that lets the bias drift follows it, and shows the instant.
"""

from __future__ import annotations

import numpy as np

from automap.gap.fit import Fit
from automap.records import FloatArray

CLEAR = 0.6
"""Share of the variance of a bias along the drive that one step must make up."""
EDGE = 0.02
"""Share of the drive at either end in which no step is looked for: biases settle there."""


def jumps_of(fit: Fit, sensor: str) -> list[tuple[str, str]]:
    """Channel and formula of the step in each axis of ``sensor`` ("accel", "gyro") whose smoothed
    bias makes a clear one."""
    names = fit.last.problem.model.names
    t = fit.last.nodes.t
    out = []
    for axis in "xyz":
        name = f"{sensor}_bias_{axis}"
        if name not in names:
            continue
        instant = clear_step(t, fit.last.smooth.params[:, names.index(name)])
        if instant is not None:
            out.append(
                (f"{sensor}_{axis}", f"step(time - {instant + fit.opened.drive.begin_s:.5g})")
            )
    return out


def clear_step(t: FloatArray, values: FloatArray) -> float | None:
    """The instant at which ``values`` [n] at times ``t`` [n] step, None where no step makes up
    most of their variance."""
    n = len(t)
    first = max(int(EDGE * n), 1)
    before = np.arange(first, n - first)
    spread = float(np.sum((values - values.mean()) ** 2))
    if len(before) == 0 or spread <= 0.0:
        return None
    total = np.cumsum(values - values.mean())
    # what the means before and after an instant make up of the variance
    made = total[before - 1] ** 2 * n / (before * (n - before))
    best = int(np.argmax(made))
    if made[best] < CLEAR * spread:
        return None
    at = before[best]
    return float(0.5 * (t[at - 1] + t[at]))
