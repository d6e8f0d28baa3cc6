"""Overlapping Allan deviation of a resting sensor, and the noise terms read off it.

Book: W. J. Riley, Handbook of Frequency Stability Analysis, NIST Special Publication 1065,
sections 5.2 and 5.4; slopes after IEEE Std 952-1997, annex C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.calibration.limits import LEAST_SAMPLES, LEAST_TAUS, MODEL_SD, ROUGH_SD
from automap.errors import InputError
from automap.gates import OUTSIDE_95, mean_square_limits, sigmas
from automap.records import FloatArray, IntArray

FLICKER = np.sqrt(2.0 * np.log(2.0) / np.pi)
"""Allan deviation of flicker noise over its bias instability: 0.664."""


@dataclass(frozen=True)
class Term:
    """One noise term with its 95 % interval; ``value`` 0 where the record shows none of it."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class AllanFit:
    """The deviation of one axis and what it is made of.

    ``tau_s``, ``deviation``, ``low``, ``high`` [k] with 95 % limits. ``white`` per sqrt(Hz),
    ``instability`` in the unit of the reading, ``walk`` per sqrt(s). ``fitted`` [k] is the
    deviation of the three terms together.
    """

    tau_s: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray
    fitted: FloatArray
    white: Term
    instability: Term
    walk: Term


def overlapping_deviation(rate: FloatArray, rate_hz: float, factors: IntArray) -> FloatArray:
    """Overlapping Allan deviation [k] of a series [n] at averaging factors [k].

    The second difference of the summed series over every start, SP 1065 equation (11).
    """
    phase = np.concatenate([[0.0], np.cumsum(rate)]) / rate_hz
    out = np.empty(len(factors))
    for i, m in enumerate(factors.tolist()):
        second = phase[2 * m :] - 2.0 * phase[m:-m] + phase[: -2 * m]
        out[i] = np.sqrt(0.5 * np.mean(second**2)) * rate_hz / m
    return out


def averaging_factors(n: int) -> IntArray:
    """Factors from 1 to a fifth of the record, some ten a decade."""
    most = n // 5
    raw = np.logspace(0.0, np.log10(max(most, 1)), 1 + round(10 * np.log10(max(most, 2))))
    return np.unique(np.rint(raw).astype(np.int64))


def degrees_of_freedom(n: int, factors: IntArray) -> FloatArray:
    """Equivalent degrees of freedom [k] of the overlapping estimate for white noise of the
    rate, SP 1065 section 5.4.1."""
    m = factors.astype(np.float64)
    edf = (3.0 * (n - 1) / (2.0 * m) - 2.0 * (n - 2) / n) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    return np.maximum(edf, 1.0)


def allan_fit(rate: FloatArray, rate_hz: float, name: str = "the log") -> AllanFit:
    """Allan deviation of one axis [n] and its white noise, bias instability and random walk.

    The squared deviation is white^2 / tau + (0.664 instability)^2 + walk^2 tau / 3. The three
    squares, none negative, are fitted to the logarithm of the deviation with the weights of
    its degrees of freedom, robustly. The intervals come from fits to records of the same
    length and terms (parametric bootstrap), so they hold for correlated averaging times.

    Raises:
        InputError: too short a record, or an axis that never changes.
    """
    n = len(rate)
    factors = averaging_factors(n)
    if len(factors) < LEAST_TAUS or n < LEAST_SAMPLES:
        raise InputError(
            f"{name}: {n} samples at rest are too few for an Allan deviation; record an hour."
        )
    if np.ptp(rate) == 0.0:
        raise InputError(f"{name}: an axis never changes at rest; record with finer resolution.")
    deviation = overlapping_deviation(rate - rate.mean(), rate_hz, factors)
    tau = factors / rate_hz
    edf = degrees_of_freedom(n, factors)
    least, most = mean_square_limits(edf)
    squares = _fit_squares(tau, deviation, edf)
    return AllanFit(
        tau_s=tau,
        deviation=deviation,
        low=deviation / np.sqrt(most),
        high=deviation / np.sqrt(least),
        fitted=np.sqrt(_basis(tau) @ squares),
        **_terms(squares, n, rate_hz, factors, edf),
    )


def _basis(tau: FloatArray) -> FloatArray:
    """Squared deviations [k, 3] per unit square of white noise, instability and walk."""
    return np.column_stack([1.0 / tau, np.full(len(tau), FLICKER**2), tau / 3.0])


def _fit_squares(tau: FloatArray, deviation: FloatArray, edf: FloatArray) -> FloatArray:
    """Squares [3] of the three terms, not negative, by reweighted least squares."""
    from scipy.optimize import nnls

    basis, target = _basis(tau), deviation**2
    # relative sd of a chi-square; below the quantisation or a low-pass the model cannot hold
    weight = 1.0 / (target * np.sqrt(2.0 / edf + MODEL_SD**2))
    robust = np.ones(len(tau))
    squares = np.zeros(3)
    for _ in range(12):
        w = weight * robust
        size = np.sqrt(np.sum((basis * w[:, None]) ** 2, axis=0)) + 1e-300
        squares = nnls(basis * w[:, None] / size, target * w)[0] / size
        model = basis @ squares + 1e-300
        relative = np.log(target / model) / np.sqrt(2.0 / edf + MODEL_SD**2)
        weight = 1.0 / (model * np.sqrt(2.0 / edf + MODEL_SD**2))
        robust = 1.0 / np.sqrt(1.0 + (relative / ROUGH_SD) ** 2)
    return np.asarray(squares)


def _terms(
    squares: FloatArray, n: int, rate_hz: float, factors: IntArray, edf: FloatArray, runs: int = 40
) -> dict[str, Term]:
    """The terms with 95 % intervals by repeated simulation of the fitted noise."""
    rng = np.random.default_rng(0)
    # long records are simulated shorter, which only widens the intervals
    kept = min(n, 200_000)
    factors = factors[factors <= kept // 5]
    edf = degrees_of_freedom(kept, factors)
    tau = factors / rate_hz
    logs = []
    for _ in range(runs):
        noise = _simulated(rng, np.sqrt(squares), kept, rate_hz)
        logs.append(_fit_squares(tau, overlapping_deviation(noise, rate_hz, factors), edf))
    spread = np.sqrt(np.array(logs))
    values = np.sqrt(squares)
    names = ("white", "instability", "walk")
    found, wide = {}, sigmas(OUTSIDE_95)
    for i, name in enumerate(names):
        sd = float(np.std(spread[:, i]))
        value = float(values[i])
        found[name] = Term(value, max(value - wide * sd, 0.0), value + wide * sd)
    return found


def _simulated(rng: np.random.Generator, terms: FloatArray, n: int, rate_hz: float) -> FloatArray:
    """A record [n] with white noise, flicker and random walk of the given sizes."""
    noise = terms[0] * np.sqrt(rate_hz) * rng.standard_normal(n)
    noise += terms[2] / np.sqrt(rate_hz) * np.cumsum(rng.standard_normal(n))
    if terms[1] > 0.0:
        spectrum = rng.standard_normal(n // 2 + 1) + 1j * rng.standard_normal(n // 2 + 1)
        frequency = np.fft.rfftfreq(n, 1.0 / rate_hz)
        frequency[0] = np.inf
        # one-sided density B^2 / (2 pi f), times two for one side, in the scaling of irfft
        density = terms[1] ** 2 / (np.pi * frequency)
        noise += np.fft.irfft(spectrum * np.sqrt(density * rate_hz * n / 4.0), n)
    return np.asarray(noise)
