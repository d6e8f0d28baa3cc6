"""Turn rates and specific forces without the noise of single readings.

What a lever arm adds to a velocity is the turn rate times the arm, and what a scale error adds to a
force is the force times the error. With the noise of a single reading in these, a short arm fits
better than the true one, which adds that noise to every prediction, and a sensor that seems to read
too much better than a right one (errors in variables; Fuller, 1987): low-cost gyros had antennas a
metre off, and accelerometers that were shaken by 1.2 m/s^2 a scale error of up to 20 %. What is the
best estimate from the readings does not do so: what it misses is not correlated with it (regression
calibration; Carroll et al., Measurement Error in Nonlinear Models, 2006, chapter 4).
"""

from __future__ import annotations

import numpy as np

from automap.fusion.limits import (
    FLOOR_BAND_HZ,
    FLOOR_HZ,
    SPECTRUM_S,
    STEADY_GAP_STEPS,
    SWAY_HZ,
)
from automap.records import FloatArray

STRETCHES = 256
"""Stretches of a spectrum at a time; bounds the memory."""


def steady(t: FloatArray, readings: FloatArray) -> FloatArray:
    """Readings [n, 3] at times [n] s as a Wiener filter of both directions sees them; as they are
    within ``SPECTRUM_S / 2`` of gaps and ends, and where sampling is too slow for it."""
    from scipy.signal import oaconvolve

    if len(t) < 2:
        return readings.copy()
    step = np.diff(t)
    usual = float(np.median(step))
    half = round(0.5 * SPECTRUM_S / usual) if usual > 0.0 else 0
    if half < 2 or 0.5 / usual < 2.0 * SWAY_HZ or len(t) < 4 * half:
        return readings.copy()
    out, mean = readings.copy(), readings.mean(axis=0)
    for axis in range(readings.shape[1]):
        weights = wiener_weights(readings[:, axis], usual, half)
        moved = oaconvolve(readings[:, axis] - mean[axis], weights, mode="valid")
        out[half:-half, axis] = mean[axis] + moved
    gaps = np.flatnonzero(step > STEADY_GAP_STEPS * usual)
    near = np.zeros(len(t) + 1, np.int64)
    np.add.at(near, np.maximum(gaps + 1 - half, 0), 1)
    np.add.at(near, np.minimum(gaps + 1 + half, len(t)), -1)
    raw = np.cumsum(near[:-1]) > 0
    out[raw] = readings[raw]
    return out


def wiener_weights(rate: FloatArray, step_s: float, half: int) -> FloatArray:
    """Weights [2 half + 1] of the readings about an instant in the best estimate of a rate [n]
    without its mean.

    The body's motion is what the spectrum has above white noise up to ``SWAY_HZ``. White noise is
    no more than the least of the spectrum (N. Wiener, Extrapolation, Interpolation, and Smoothing
    of Stationary Time Series, 1949).
    """
    f, density = _spectrum(rate, step_s, half)
    bands = ((f >= SWAY_HZ) & (f < FLOOR_HZ)).nonzero()[0]
    width = max(round(FLOOR_BAND_HZ / float(f[1])), 1)
    bands = bands[: max(len(bands) // width, 1) * width]
    floor = float(density[bands].reshape(-1, min(width, len(bands))).mean(axis=1).min())
    above = np.maximum(density - floor, 0.0)
    share = np.divide(above, density, out=np.zeros_like(above), where=(f < SWAY_HZ) & (above > 0.0))
    # the mean was taken out of the lowest
    share[0] = share[1]
    weights = np.roll(np.fft.irfft(share), half)
    return np.asarray(np.append(weights, 0.0) * np.hanning(2 * half + 1))


def _spectrum(rate: FloatArray, step_s: float, half: int) -> tuple[FloatArray, FloatArray]:
    """Frequencies in Hz and density of a rate [n] by stretches of 2 ``half`` readings that overlap
    by half (P. Welch, IEEE Transactions on Audio and Electroacoustics 15, 1967)."""
    window = np.hanning(2 * half + 1)[:-1]
    stretches = np.lib.stride_tricks.sliding_window_view(rate, 2 * half)[::half]
    total: FloatArray = np.zeros(half + 1)
    for start in range(0, len(stretches), STRETCHES):
        some = stretches[start : start + STRETCHES]
        lines = np.fft.rfft((some - some.mean(axis=1)[:, None]) * window, axis=1)
        total += (lines.real**2 + lines.imag**2).sum(axis=0)
    # both signs of a frequency, but for none and the highest
    total[1:-1] *= 2.0
    density = total * (step_s / (len(stretches) * float(window @ window)))
    return np.asarray(np.fft.rfftfreq(2 * half, step_s), np.float64), density
