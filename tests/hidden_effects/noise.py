"""Noise of many kinds: white, coloured, heavy-tailed, in bursts; levels of whole sensor sets."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from tests.hidden_effects.geodesy import Array


@dataclass(frozen=True)
class ImuNoise:
    """``gyro`` rad/s/sqrt(Hz) and ``accel`` m/s^2/sqrt(Hz) white; ``tail`` degrees of freedom of
    Student's t (0: Gaussian); ``quieter_at_rest`` share of the noise that driving adds;
    ``bursts_per_min`` of ``burst`` m/s^2; the smallest steps ``gyro_lsb``, ``accel_lsb``."""

    gyro: float
    accel: float
    tail: float = 0.0
    quieter_at_rest: float = 0.0
    bursts_per_min: float = 0.0
    burst: float = 0.0
    gyro_lsb: float = 0.0
    accel_lsb: float = 0.0


@dataclass(frozen=True)
class GnssNoise:
    """White and wandering error, one sigma: ``white`` m horizontally, ``wander`` m with time
    constant ``wander_s``, both ``vertical`` times that in height; ``velocity`` m/s white,
    ``velocity_wander`` m/s with ``velocity_wander_s``; ``tail`` as for the IMU; ``rate_hz``;
    an outage of ``outage_s`` at a random time; ``down_known`` whether it tells a vertical
    velocity."""

    white: float
    wander: float
    wander_s: float
    velocity: float
    velocity_wander: float = 0.0
    velocity_wander_s: float = 1.0
    vertical: float = 1.8
    tail: float = 0.0
    rate_hz: float = 5.0
    outage_s: float = 0.0
    down_known: bool = True


def heavy(rng: np.random.Generator, shape: tuple[int, ...], tail: float) -> Array:
    """Noise of unit variance: Gaussian, or Student's t of ``tail`` > 2 degrees of freedom."""
    if tail <= 0.0:
        return rng.normal(size=shape)
    return np.asarray(rng.standard_t(tail, shape) * np.sqrt((tail - 2.0) / tail))


def coloured(
    rng: np.random.Generator, n: int, sd: float, constant: float, dt: float, tail: float = 0.0
) -> Array:
    """A stationary first-order Gauss-Markov process [n] of ``sd`` and time ``constant``, s."""
    phi = np.exp(-dt / constant)
    white = heavy(rng, (n,), tail) * sd * np.sqrt(1.0 - phi**2)
    first = rng.normal(0.0, sd)
    out, _ = lfilter([1.0], [1.0, -phi], white, zi=[phi * first])
    return np.asarray(out)


LEVELS = ("quiet", "usual", "poor", "dirty")


def draw_noise(rng: np.random.Generator, level: str) -> tuple[ImuNoise, GnssNoise]:
    """Sensors of one of LEVELS; "dirty" is "usual" with heavy tails, bursts, coloured velocity
    and an outage."""

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    base = "usual" if level == "dirty" else level
    gyro, accel, white, velocity = {
        "quiet": (
            between(3e-5, 1e-4),
            between(1e-3, 4e-3),
            between(0.01, 0.05),
            between(0.01, 0.03),
        ),
        "usual": (
            between(1e-4, 4e-4),
            between(4e-3, 1.5e-2),
            between(0.1, 0.5),
            between(0.03, 0.07),
        ),
        "poor": (between(3e-4, 1e-3), between(1e-2, 3e-2), between(0.5, 1.2), between(0.05, 0.15)),
    }[base]
    imu = ImuNoise(
        gyro=gyro,
        accel=accel,
        quieter_at_rest=float(rng.uniform(0.3, 0.9)),
        gyro_lsb=float(rng.choice([0.0, np.radians(1.0 / 131.072), np.radians(1.0 / 65.536)])),
        accel_lsb=float(rng.choice([0.0, 9.80665 / 16384.0, 9.80665 / 8192.0])),
    )
    gnss = GnssNoise(
        white=white,
        wander=white * between(0.5, 3.0),
        wander_s=between(20.0, 120.0),
        velocity=velocity,
        vertical=float(rng.uniform(1.4, 2.2)),
        rate_hz=float(rng.choice([4.0, 5.0, 10.0])),
    )
    if level != "dirty":
        return imu, gnss
    imu = replace(
        imu,
        tail=float(rng.uniform(3.0, 6.0)),
        bursts_per_min=float(rng.uniform(2.0, 15.0)),
        burst=float(rng.uniform(1.0, 5.0)),
    )
    gnss = replace(
        gnss,
        tail=float(rng.uniform(3.0, 6.0)),
        velocity_wander=gnss.velocity * float(rng.uniform(0.3, 1.0)),
        velocity_wander_s=between(0.3, 5.0),
        outage_s=float(rng.choice([0.0, rng.uniform(4.0, 15.0)])),
    )
    return imu, gnss
