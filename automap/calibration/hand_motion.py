"""How a hand moves the sensor it turns, seen in the innovations of the dynamic calibration.

The pseudo-measurements say that velocity and place are zero; what a hand makes of them is no
white noise but a sway of a second or so. The filter takes it for white noise of the same
strength at low frequency, which costs little accuracy, but its covariance is then not that of
its errors. The right one follows from the filter's linear response to what it is given and the
spectrum of the hand's motion: the covariance of least squares under correlated errors (W. K.
Newey, K. D. West, "A simple, positive semi-definite, heteroskedasticity and autocorrelation
consistent covariance matrix", Econometrica 55, 1987), here over frequencies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.calibration import limits
from automap.calibration.dynamic_kernel import BA, N_STATES, POS
from automap.records import FloatArray

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class HandMotion:
    """What the innovations say of the hand: its RMS ``velocity`` m/s and ``place`` m, and the
    ``variance`` [2] of white noise that stands for velocity and place in the filter."""

    velocity: float
    place: float
    variance: FloatArray


UNKNOWN_HAND = HandMotion(0.2, 0.1, np.array([0.5, 0.1]))
"""Before the innovations tell."""


def hand_motion(innovations: FloatArray, moving: Mask, step_s: float) -> HandMotion:
    """The hand's motion from the ``innovations`` [m, 10] of the filter; ``moving`` [m] whether
    it moved, ``step_s`` the time from one measurement to the next.

    The place binds the slow errors, so its white noise has the strength of its spectrum below
    SLOW_HZ, or somewhat less than the peak where a hand hardly moves so slowly: the filter must
    not follow the sway, or the innovations do not show it. The velocity says the same once
    more, best of what is fast: it gets the peak of its spectrum, so that it is nowhere trusted
    beyond what it is worth.
    """
    used = _used(moving)
    if np.any(used.sum(axis=0) < limits.LEAST_MEASUREMENTS):
        rms = [_rms(innovations[:, 1:4], used[:, 0]), _rms(innovations[:, 7:10], used[:, 1])]
        quiet = np.maximum(rms, [0.05, 0.05])
        return HandMotion(rms[0], rms[1], quiet**2 * np.array([5.0, 10.0]))
    spectra = np.mean(
        [
            np.diagonal(_cross_spectrum(innovations[:, [1 + i, 7 + i]], used, step_s).real, 0, 1, 2)
            for i in range(3)
        ],
        axis=0,
    )
    slow = max(1, round(limits.SLOW_HZ * 2.0 * step_s * len(spectra)))
    place = max(float(spectra[:slow, 1].mean()), limits.PEAK_PART * float(spectra[:, 1].max()))
    variance = np.array([spectra[:, 0].max(), place])
    return HandMotion(
        _rms(innovations[:, 1:4], used[:, 0]),
        _rms(innovations[:, 7:10], used[:, 1]),
        np.maximum(variance, [limits.LEAST_VELOCITY**2, limits.LEAST_PLACE**2]),
    )


def _rms(y: FloatArray, used: Mask) -> float:
    """RMS of the used rows of ``y`` [m, 3]; 0 when there are none."""
    return float(np.sqrt(np.mean(y[used] ** 2))) if np.any(used) else 0.0


def _used(moving: Mask) -> Mask:
    """Which velocities and places [m, 2] show the hand: not the first tenth, which still shows
    errors that the filter has not learnt, and no velocity at rest."""
    begun = np.arange(len(moving)) >= len(moving) // 10
    return np.column_stack([moving & begun, begun])


def final_response(response: FloatArray) -> FloatArray:
    """What each measurement moved the errors at the end: [m, 12, 6] of ``response``
    [m, 21, 27] as the filter leaves it."""
    weights = np.empty((len(response), POS - BA, 6))
    ahead = np.eye(N_STATES)[BA:POS]
    for k in range(len(response) - 1, -1, -1):
        weights[k] = ahead @ response[k, :, N_STATES:]
        ahead = ahead @ response[k, :, :N_STATES]
    return weights


def coloured_noise_covariance(
    covariance: FloatArray,
    weights: FloatArray,
    variance: FloatArray,
    innovations: FloatArray,
    moving: Mask,
    step_s: float,
) -> FloatArray:
    """The covariance [12, 12] of the errors under the hand's motion as it was.

    ``covariance`` [12, 12] is the filter's, under white measurement noise of ``variance``
    [m, 2] (velocity, place); ``weights`` [m, 12, 6] are of ``final_response``. The part of the
    white noise is replaced by what the spectrum of the innovations gives. At rest the velocity
    is known to be zero, and stays white.
    """
    used = _used(moving)
    if np.any(used.sum(axis=0) < limits.LEAST_MEASUREMENTS):
        return covariance
    both = np.column_stack([moving, np.ones(len(moving), dtype=bool)])
    out = covariance.copy()
    for axis in range(3):
        W = weights[:, :, 2 * axis : 2 * axis + 2]
        noise = innovations[:, [1 + axis, 7 + axis]]
        out -= np.einsum("kac,kbc,kc->ab", W, W, variance * both)
        spectrum = _cross_spectrum(noise, used, step_s)
        U = np.fft.rfft(W * both[:, None, :], 2 * (len(spectrum) - 1), axis=0)
        part = np.einsum("fac,fcd,fbd->fab", U.conj(), spectrum, U).real
        # all but the two ends stand for their negative frequency as well
        out += (2.0 * part.sum(axis=0) - part[0] - part[-1]) / (2 * (len(spectrum) - 1))
    return 0.5 * (out + out.T)


def _cross_spectrum(y: FloatArray, used: Mask, step_s: float) -> npt.NDArray[np.complex128]:
    """Cross-spectra [f, 2, 2] of two series [m, 2], variance per bin, averaged over a band."""
    from scipy.ndimage import uniform_filter1d

    length = 2 * int(2 ** np.ceil(np.log2(len(y))))
    # a taper keeps the strong sway from leaking into the slow part
    taper = np.where(used, np.hanning(len(y))[:, None], 0.0)
    H = np.fft.rfft(taper * y, length, axis=0)
    power = np.sqrt(np.sum(taper**2, axis=0))
    raw = H[:, :, None] * H[:, None, :].conj() / np.outer(power, power)
    width = max(1, round(limits.SMOOTH_HZ * step_s * length)) | 1
    parts = [uniform_filter1d(part, width, axis=0, mode="reflect") for part in (raw.real, raw.imag)]
    return np.asarray(parts[0] + 1j * parts[1])


def coloured_noise_history(
    sd: FloatArray, prior_sd: FloatArray, final_sd: FloatArray
) -> FloatArray:
    """The filter's sigmas [n, 12] over time, with information weighed so that the last are
    ``final_sd`` [12]; ``prior_sd`` [12] is where they began."""
    begin = 1.0 / prior_sd**2
    gained = np.maximum(1.0 / sd**2 - begin, 0.0)
    wanted = np.maximum(1.0 / final_sd**2 - begin, 1e-12 * begin)
    return np.asarray(1.0 / np.sqrt(begin + gained * (wanted / np.maximum(gained[-1], 1e-300))))
