"""The normalised innovation squared over the drive, against what chance allows.

For a filter that knows its own error each innovation squared over its variance follows the
chi-square distribution of one degree of freedom: the mean of n of them lies between the 2.5 and
97.5 % points of chi-square with n degrees, over n (Bar-Shalom, Li and Kirubarajan, Estimation
with Applications to Tracking and Navigation, 2001, section 5.4).
"""

from __future__ import annotations

import numpy as np

from automap.records import BoolArray, FloatArray
from pipeline.report.svg_plot import Series

WINDOWS = 48
LEAST = 6
GROUPS = (("position", "GPS position"), ("velocity", "GPS velocity"), ("nhc", "sideways rule"))


def nis_series(
    channels: np.ndarray, seconds: FloatArray, nis: FloatArray, accepted: BoolArray
) -> list[tuple[str, list[Series]]]:
    """Title and series of a plot for each group of channels that has enough measurements.

    Takes arrays [n]; the mean is over the accepted ones of a window in time.
    """
    plots = []
    span = float(seconds.max(initial=0.0))
    if span <= 0:
        return []
    names = channels.astype(str)
    for prefix, title in GROUPS:
        own = np.char.startswith(names, f"{prefix}_") & accepted & np.isfinite(nis)
        if int(own.sum()) < 4 * LEAST:
            continue
        count, mean, middle = _windows(seconds[own], nis[own], span)
        enough = count >= LEAST
        if int(enough.sum()) < 2:
            continue
        low, high = chance_limits(count[enough])
        x = middle[enough]
        plots.append(
            (
                f"Mean NIS, {title}",
                [
                    Series("95 % of chance", x, low, "band", 2, upper=high),
                    Series("mean NIS", x, mean[enough], "line", 0),
                ],
            )
        )
    return plots


def _windows(
    seconds: FloatArray, nis: FloatArray, span: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Number, mean and middle in time of the values in equal windows."""
    # as many windows as leave some measurements in each
    windows = int(np.clip(len(nis) // (2 * LEAST), 2, WINDOWS))
    slot = np.minimum((seconds / span * windows).astype(np.int64), windows - 1)
    count = np.bincount(slot, minlength=windows).astype(np.float64)
    total = np.bincount(slot, weights=nis, minlength=windows)
    mean = total / np.maximum(count, 1.0)
    return count, mean, (np.arange(windows) + 0.5) * span / windows


def chance_limits(count: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where the mean of so many NIS lies with 95 % probability, lower and upper end."""
    from scipy.special import chdtri

    low = np.asarray(chdtri(count, 0.975), np.float64)
    high = np.asarray(chdtri(count, 0.025), np.float64)
    return low / count, high / count
