"""The clock of a finished trajectory that gives both its stamps and GPS time."""

from __future__ import annotations

import numpy as np

from automap.errors import InputError
from automap.records import ClockModel, FloatArray, IntArray
from automap.sync.limits import LEAST_SD_S, MAX_RATE, MOST_SCATTER_S


def trajectory_clock(t_ns: IntArray, gps_s: FloatArray) -> ClockModel:
    """The straight line through rows (``t_ns``, ``gps_s``) [n]; what is left over is its sd.

    Raises InputError when the two columns cannot belong to one clock.
    """
    ref_ns = int(t_ns[len(t_ns) // 2])
    ref_gps = float(gps_s[len(gps_s) // 2])
    x = (t_ns - ref_ns) * 1e-9
    y = gps_s - ref_gps - x
    x0 = float(x.mean())
    spread = float(((x - x0) ** 2).sum())
    rate = float(((x - x0) @ y) / spread) if spread > 0.0 else 0.0
    level = float(y.mean())
    residual = float(np.sqrt(np.mean((y - level - rate * (x - x0)) ** 2)))
    if abs(rate) > MAX_RATE or residual > MOST_SCATTER_S:
        raise InputError(
            f"trajectory.csv: gps_s and t_ns run apart by {rate * 1e6:+.0f} ppm and scatter by "
            f"{residual:.3f} s, so they are not two clocks of one drive; correct one of the "
            "columns or leave it out."
        )
    edge_ns = ref_ns + round(x0 * 1e9)
    sd = float(np.hypot(residual / np.sqrt(len(x)), LEAST_SD_S))
    sd_rate = residual / np.sqrt(spread) if spread > 0.0 else 0.0
    return ClockModel(edge_ns, ref_gps + x0 + level, rate, sd, sd_rate, "trajectory", 0.0)
