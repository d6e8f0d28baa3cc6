"""Positions of two receivers or antennas in turn, in one log."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.fix_axes import Epochs, whitened_epochs
from automap.fusion.limits import DOUBT_PROBABILITY
from automap.fusion.options import FusionOptions
from automap.gates import exceeds_ratio, gate, sd_by_median
from automap.records import BoolArray, FloatArray


def alternation(at: Epochs, options: FusionOptions, levels: Mapping[str, float]) -> float:
    """How far, m, every second position lies off the mean of it and its neighbours; 0 where chance
    makes that, or a receiver that states every second one to be so much worse.

    White innovations have as much power at half of the rate of the fixes as at rates beside it;
    the quotient of two mean powers has Fisher's distribution.
    """
    n = limits.ALTERNATION_FIXES
    square, worse = 0.0, 0.0
    power, beside = np.zeros(0), np.zeros(0)
    for axis in (0, 1):
        told = at.used[axis][:, 0]
        none = np.zeros((len(at.t), 2, 0))
        rows = whitened_epochs(at, axis, options, levels, none)[_of_positions(at.used[axis]), 0]
        if len(rows) < n:
            return 0.0
        half, near = _at_half_rate(rows)
        power, beside = np.concatenate([power, half]), np.concatenate([beside, near])
        z = at.z[axis, told, 0]
        # what alternates by one is two off the middle of its neighbours
        half, near = _at_half_rate(0.5 * z[1:-1] - 0.25 * (z[:-2] + z[2:]))
        square += float(np.mean(half - near)) / n
        sd = at.stated_sd[told, axis]
        worse += abs(float(np.median(sd[::2] ** 2) - np.median(sd[1::2] ** 2)))
    many = len(power)
    ratio = float(np.mean(power) / max(float(np.mean(beside)), 1e-12))
    # a rate beside half has a sine and a cosine
    chance = exceeds_ratio(ratio, many, 2 * limits.ALTERNATION_BESIDE * many)
    # of two that err alike but for their size either is half of that off the mean
    stated = 0.25 * 0.5 * worse * gate(DOUBT_PROBABILITY, 2)
    return float(np.sqrt(square)) if chance < DOUBT_PROBABILITY and square > stated else 0.0


def _at_half_rate(y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Power at half of the rate of ``y`` [k], and at rates beside it, window by window."""
    n = limits.ALTERNATION_FIXES
    beyond = limits.WILD_MISS_SIGMAS * sd_by_median(y)
    windows = np.clip(y, -beyond, beyond)[: len(y) // n * n].reshape(-1, n)
    spectrum = np.abs(np.fft.rfft(windows, axis=1)) ** 2 / n
    half = n // 2
    near = spectrum[:, half - limits.ALTERNATION_BESIDE : half].mean(axis=1)
    return np.asarray(spectrum[:, half]), np.asarray(near)


def _of_positions(used: BoolArray) -> BoolArray:
    """Which of the measurements ``used`` [k, 2], in the order of time, are positions."""
    return np.asarray(np.broadcast_to([True, False], used.shape)[used])
