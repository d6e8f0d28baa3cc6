"""Positions of two receivers or antennas in turn, in one log."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.fix_axes import Epochs, whitened_epochs
from automap.fusion.limits import DOUBT_PROBABILITY
from automap.fusion.options import FusionOptions
from automap.gates import exceeds_ratio, sd_by_median
from automap.records import BoolArray


def alternation(at: Epochs, options: FusionOptions, levels: Mapping[str, float]) -> float:
    """How far, m, every second position lies off the mean of it and its neighbours; 0 where chance
    makes that.

    White innovations have as much power at half of the rate of the fixes as at rates beside it;
    the quotient of two mean powers has Fisher's distribution.
    """
    n, square, noise = limits.ALTERNATION_FIXES, 0.0, 0.0
    half = n // 2
    power, beside = np.zeros(0), np.zeros(0)
    for axis in (0, 1):
        told = at.used[axis][:, 0]
        errors = np.zeros((len(at.t), 2, 1))
        errors[told, 0, 0] = 1.0 - 2.0 * (np.arange(np.count_nonzero(told)) % 2)
        rows = whitened_epochs(at, axis, options, levels, errors)[_of_positions(at.used[axis])]
        windows = rows[: len(rows) // n * n].reshape(-1, n, 2)
        if not len(windows):
            return 0.0
        y, x = windows[..., 0], windows[..., 1]
        beyond = limits.WILD_MISS_SIGMAS * sd_by_median(y.ravel())
        y = np.clip(y, -beyond, beyond)
        spectrum = np.abs(np.fft.rfft(y, axis=1)) ** 2 / n
        near = spectrum[:, half - limits.ALTERNATION_BESIDE : half].mean(axis=1)
        gained = (x**2).sum(axis=1)
        square += float(np.mean(((x * y).sum(axis=1) / gained) ** 2))
        noise += float(np.mean(near / gained))
        power = np.concatenate([power, spectrum[:, half]])
        beside = np.concatenate([beside, near])
    many = len(power)
    ratio = float(np.mean(power) / max(float(np.mean(beside)), 1e-12))
    # a rate beside half has a sine and a cosine
    chance = exceeds_ratio(ratio, many, 2 * limits.ALTERNATION_BESIDE * many)
    return float(np.sqrt(max(square - noise, 0.0))) if chance < DOUBT_PROBABILITY else 0.0


def _of_positions(used: BoolArray) -> BoolArray:
    """Which of the measurements ``used`` [k, 2], in the order of time, are positions."""
    return np.asarray(np.broadcast_to([True, False], used.shape)[used])
