"""Noise of shocks: potholes and joints that readings show as scatter from sample to sample."""

from __future__ import annotations

import numpy as np

from automap.fusion.limits import LEAST_SHOCK_RATIO, SHOCK_WINDOW_S, USUAL_PERCENTILE
from automap.records import FloatArray

_SECOND_DIFFERENCE = 6.0
"""Variance of the second difference of white noise over its own."""


def shock_noise(gyro: FloatArray, accel: FloatArray, step_s: float) -> FloatArray:
    """PSD [n, 2] of white noise that shocks add to forces and rates (in that order).

    ``gyro`` rad/s and ``accel`` m/s^2 [n, 3] every ``step_s`` s. Motion is smooth from
    sample to sample, so the second difference is noise. Where its variance over a short window
    is several times the usual one, what is above that is added as white noise (sigma^2 step);
    elsewhere nothing.
    """
    from scipy.ndimage import uniform_filter1d

    out = np.zeros((len(gyro), 2))
    if len(gyro) < 3:
        return out
    width = max(2 * round(0.5 * SHOCK_WINDOW_S / step_s) + 1, 3)
    for column, readings in enumerate((accel, gyro)):
        second = np.zeros_like(readings)
        second[1:-1] = readings[2:] - 2.0 * readings[1:-1] + readings[:-2]
        each = np.mean(second**2, axis=1) / _SECOND_DIFFERENCE
        local = uniform_filter1d(each, width, mode="nearest")
        usual = float(np.percentile(local, USUAL_PERCENTILE))
        out[:, column] = np.where(local > LEAST_SHOCK_RATIO * usual, (local - usual) * step_s, 0.0)
    return out
