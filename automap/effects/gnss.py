"""Random errors of fixes, and the low-pass of their velocities.

What is no random error acts by its terms (``effects.measured``). Values map effect to parameter to
value, in the catalogue's names and units; what is not given is zero.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from automap.effects.limits import OUTLIER_M
from automap.effects.measured import Values
from automap.effects.vehicle import parameter
from automap.records import BoolArray, FloatArray


def low_pass(signal: FloatArray, step_s: float, tau_s: float) -> FloatArray:
    """``gnss_velocity_lag``: a signal [n, k] after a first-order low-pass at rest in its start.

    tau y' = x - y, exact for a signal that is linear between its samples ``step_s`` apart.
    """
    if tau_s <= 0.0:
        return signal.copy()
    from scipy.signal import lfilter

    decay = np.exp(-step_s / tau_s)
    gain = tau_s / step_s * (1.0 - decay)
    now, before = 1.0 - gain, gain - decay
    state = ((before + decay) * signal[0])[None]
    out, _ = lfilter([now, before], [1.0, -decay], signal, axis=0, zi=state)
    return np.asarray(out)


def gauss_markov(
    n: int, sigma: FloatArray, step_over_tau: float | FloatArray, rng: np.random.Generator
) -> FloatArray:
    """First-order Gauss-Markov sequences [n, k] that start in their stationary state.

    ``sigma`` [k]; ``step_over_tau`` the time since the row before over the time constant, one
    number or [n] (Brown and Hwang, Introduction to Random Signals, section 5.3).
    """
    keep = np.broadcast_to(np.exp(-np.asarray(step_over_tau)), (n,))
    drive = rng.standard_normal((n, len(sigma))) * sigma
    drive[1:] *= np.sqrt(1.0 - keep[1:, None] ** 2)
    out = np.empty_like(drive)
    out[0] = drive[0]
    for i in range(1, n):
        out[i] = keep[i] * out[i - 1] + drive[i]
    return out


def markov_error(
    n: int, step_s: float, given: Mapping[str, float], rng: np.random.Generator
) -> FloatArray:
    """A wandering error [n] of an effect with ``sigma`` and ``tau``; nothing without a sigma."""
    if not given.get("sigma"):
        return np.zeros(n)
    return gauss_markov(n, np.array([given["sigma"]]), step_s / given["tau"], rng)[:, 0]


def short_error(n: int, step_s: float, values: Values, rng: np.random.Generator) -> FloatArray:
    """Errors NED [n, 3] in m of ``gnss_multipath``."""
    given = {"tau": 10.0, **values.get("gnss_multipath", {})}
    return np.stack([markov_error(n, step_s, given, rng) for _ in range(3)], axis=1)


def slow_error(n: int, step_s: float, values: Values, rng: np.random.Generator) -> FloatArray:
    """Errors NED [n, 3] in m of ``gnss_slow_wander`` and ``gnss_height_wander``."""
    level, height = (values.get(f"gnss_{name}_wander", {}) for name in ("slow", "height"))
    return np.stack([markov_error(n, step_s, part, rng) for part in (level, level, height)], axis=1)


def steps(t_s: FloatArray, values: Values, rng: np.random.Generator) -> FloatArray:
    """Errors NED [n, 3] in m of ``gnss_position_steps`` at ``t_s`` [n]: each value is drawn with
    the size as its sigma and holds until the next, which come at random, an interval apart in the
    mean."""
    given = values.get("gnss_position_steps", {})
    if not given.get("size"):
        return np.zeros((len(t_s), 3))
    begins = _at_random(t_s, given["interval"], rng)
    sizes = rng.standard_normal((len(begins) + 1, 3)) * given["size"]
    return np.asarray(sizes[np.searchsorted(begins, t_s, side="right")])


def frozen(t_s: FloatArray, values: Values, rng: np.random.Generator) -> BoolArray:
    """Epochs [n] at which ``gnss_freeze`` holds the position: for a length that varies
    (exponentially) about the stated one, beginning at random, an interval apart in the mean."""
    given = values.get("gnss_freeze", {})
    out = np.zeros(len(t_s), bool)
    if given.get("length"):
        for begin in _at_random(t_s, given["interval"], rng):
            out |= (t_s > begin) & (t_s <= begin + rng.exponential(given["length"]))
    return out


def _at_random(t_s: FloatArray, interval_s: float, rng: np.random.Generator) -> FloatArray:
    """Instants of a Poisson process over the span of ``t_s`` [n], in order."""
    span = float(t_s[-1] - t_s[0])
    return np.sort(t_s[0] + span * rng.random(rng.poisson(span / interval_s)))


def stands(speed: FloatArray, values: Values) -> BoolArray:
    """Where ``gnss_speed_threshold`` makes nothing of a speed [n] in m/s."""
    return np.asarray(speed < parameter(values, "gnss_speed_threshold"))


def outliers(n: int, values: Values, rng: np.random.Generator) -> FloatArray:
    """Errors NED [n, 3] in m of ``gnss_outliers``: that fraction of epochs is ``OUTLIER_M`` off."""
    wild = rng.random(n) < parameter(values, "gnss_outliers")
    bearing = rng.uniform(0.0, 2.0 * np.pi, n)
    length = OUTLIER_M * wild
    return np.stack([length * np.cos(bearing), length * np.sin(bearing), np.zeros(n)], axis=1)


def noise_factor(values: Values) -> float:
    """True noise over reported, ``gnss_noise_scale``; 1 where it is not given."""
    return float(values.get("gnss_noise_scale", {}).get("factor", 1.0))


def wander(sigma_m: FloatArray, tau_s: float, values: Values) -> tuple[FloatArray, float]:
    """Sigma NED [3] and time constant of the wandering position error, m.

    ``gnss_correlated_noise`` takes the place of the receiver's own ``sigma_m`` [3], ``tau_s``.
    """
    given = values.get("gnss_correlated_noise", {})
    sigma = np.full(3, given["sigma"]) if "sigma" in given else sigma_m
    return sigma, float(given.get("tau", tau_s))


def velocity_wander(values: Values) -> tuple[float, float]:
    """Sigma in m/s and time constant in s of the lasting velocity error."""
    given = values.get("gnss_velocity_wander", {})
    return float(given.get("sigma", 0.0)), float(given.get("tau", 2.0))
