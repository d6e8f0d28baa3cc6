"""The normalised innovation squared over the drive, against what chance allows.

For a filter that knows its own error the innovation of m components, squared over its covariance,
follows the chi-square distribution of m degrees of freedom: the sum of many over the sum n of
their degrees lies between the 2.5 and 97.5 % points of chi-square with n degrees, over n
(Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
section 5.4).
"""

from __future__ import annotations

import numpy as np

from automap.gates import mean_square_limits
from automap.records import BoolArray, FloatArray, IntArray
from pipeline.pages.svg_plot import Series

WINDOWS = 48
LEAST = 6
GROUPS = (("position", "GPS position"), ("velocity", "GPS velocity"), ("nhc", "sideways rule"))


def nis_series(
    channels: np.ndarray,
    t_ns: IntArray,
    nis: FloatArray,
    accepted: BoolArray,
) -> list[tuple[str, list[Series]]]:
    """Title and series of a plot for each group of channels that has enough measurements.

    Takes arrays [n], one row a component; x is seconds from the first row. Rejected ones do not
    take part.
    """
    plots: list[tuple[str, list[Series]]] = []
    if len(t_ns) == 0 or t_ns.max() == t_ns.min():
        return plots
    span = float(t_ns.max() - t_ns.min()) * 1e-9
    names = channels.astype(str)
    for prefix, title in GROUPS:
        own = np.char.startswith(names, f"{prefix}_") & accepted & np.isfinite(nis)
        stamps, total, degrees = _epochs(t_ns[own], nis[own])
        if degrees.sum() < 4 * LEAST:
            continue
        seconds = (stamps - t_ns.min()) * 1e-9
        count, mean, middle = _windows(seconds, total, degrees, span)
        enough = count >= LEAST
        if int(enough.sum()) < 2:
            continue
        low, high = mean_square_limits(count[enough])
        x = middle[enough]
        plots.append(
            (
                f"NIS, {title}",
                [
                    Series("95 % of chance", x, low, "band", 2, upper=high),
                    Series("mean per degree of freedom", x, mean[enough], "line", 0),
                ],
            )
        )
    return plots


def _epochs(t_ns: IntArray, nis: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Stamps, NIS and degrees of freedom of each epoch.

    The components of one measurement carry its common NIS; where the values of an epoch differ
    each row is a measurement of its own, and they are added.
    """
    stamps, place, count = np.unique(t_ns, return_inverse=True, return_counts=True)
    if len(stamps) == 0:
        return stamps, np.zeros(0), np.zeros(0)
    total = np.bincount(place, weights=nis)
    largest = np.full(len(stamps), -np.inf)
    np.maximum.at(largest, place, nis)
    common = (count > 1) & (np.abs(total - count * largest) <= 1e-6 * np.abs(total))
    return stamps, np.where(common, largest, total), count.astype(np.float64)


def _windows(
    seconds: FloatArray, nis: FloatArray, degrees: FloatArray, span: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Degrees of freedom, NIS per degree and middle in time of equal windows."""
    # as many windows as leave some measurements in each
    windows = int(np.clip(degrees.sum() // (3 * LEAST), 2, WINDOWS))
    slot = np.minimum((seconds / span * windows).astype(np.int64), windows - 1)
    count = np.bincount(slot, weights=degrees, minlength=windows).astype(np.float64)
    total = np.bincount(slot, weights=nis, minlength=windows)
    mean = total / np.maximum(count, 1.0)
    return count, mean, (np.arange(windows) + 0.5) * span / windows
