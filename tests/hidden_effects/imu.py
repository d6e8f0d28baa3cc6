"""What a real inertial sensor makes of the true specific force and turn rate.

Every error is that of the reading: reading = true + sum theta phi(true), with phi in the
sensor's axes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.motion import Motion, State, rotation
from tests.hidden_effects.noise import ImuNoise, coloured, heavy

Effects = Mapping[str, Mapping[str, float]]
Extra = Callable[["Signals"], tuple[Array, Array]]
Readings = Callable[[Array, Array, "Signals"], None]
"""Changes gyro and accel [n, 3] in place."""
Clock = Callable[[Array], Array]
"""By how much stamps are late, s, at true instants [n]."""
AXES = "xyz"
REFERENCE_C = 25.0


@dataclass(frozen=True)
class Signals:
    """What an error may depend on, at the samples [n]: ``force``, ``rate`` [n, 3] in the
    sensor's axes, ``temp_c`` [n], the ``state`` of the vehicle, seconds ``t`` [n]."""

    t: Array
    force: Array
    rate: Array
    temp_c: Array
    state: State


@dataclass(frozen=True)
class ImuRecord:
    """``stamp`` [n] s by the recorder, ``true_t`` [n] s when it happened; readings [n, 3];
    ``temp_c`` [n]; ``clean_gyro``, ``clean_accel`` [n, 3] the ideal readings at ``stamp``."""

    stamp: Array
    true_t: Array
    gyro: Array
    accel: Array
    temp_c: Array
    clean_gyro: Array
    clean_accel: Array


def sample_times(stamp: Array, effects: Effects) -> Array:
    """True instants of samples with the stamps ``stamp`` [n].

    ``imu_time_offset``: the stamp is later than the truth. ``imu_clock_skew``: the sensor's
    clock runs fast by that share, from zero on.
    """
    offset = effects.get("imu_time_offset", {}).get("s", 0.0)
    skew = effects.get("imu_clock_skew", {}).get("s_per_s", 0.0)
    return np.asarray((stamp - offset) / (1.0 + skew))


def record_imu(
    motion: Motion,
    effects: Effects,
    noise: ImuNoise,
    rng: np.random.Generator,
    warm_up: tuple[float, float, float],
    extra: Extra | None = None,
    rate_hz: float = 100.0,
    readings: Readings | None = None,
    clock: Clock | None = None,
) -> ImuRecord:
    """Readings every 1/``rate_hz`` s by the sensor's stamps.

    ``warm_up``: temperature at the start, rise in K, time constant in s. Of what no library
    holds ``extra`` gives errors (gyro [n, 3], accel [n, 3]), ``readings`` changes what is read,
    and a ``clock`` errs beside those of ``effects``.
    """
    stamp = np.arange(round(motion.seconds * rate_hz) + 1) / rate_hz
    true_t = sample_times(stamp, effects)
    if clock is not None:
        stamp = stamp + clock(true_t)
    state = motion.at(true_t)
    angles = effects.get("imu_mounting", {})
    C_vehicle_sensor = rotation(
        np.array([[angles.get(name, 0.0) for name in ("roll", "pitch", "yaw")]])
    )[0]
    start, rise, constant = warm_up
    temp = start + rise * (1.0 - np.exp(-np.maximum(true_t, 0.0) / constant))
    temp = temp + coloured(rng, len(temp), 0.2, 30.0, 1.0 / rate_hz)
    signals = Signals(
        true_t, state.force @ C_vehicle_sensor, state.rate @ C_vehicle_sensor, temp, state
    )
    gyro, accel = signals.rate.copy(), signals.force.copy()
    _add_deterministic(gyro, accel, signals, effects)
    if extra is not None:
        more_gyro, more_accel = extra(signals)
        gyro += more_gyro
        accel += more_accel
    _add_noise(gyro, accel, signals, effects, noise, rng, rate_hz)
    if readings is not None:
        readings(gyro, accel, signals)
    clean = motion.at(stamp)
    return ImuRecord(stamp, true_t, gyro, accel, temp, clean.rate, clean.force)


def _vector(effects: Effects, name: str) -> Array:
    values = effects.get(name, {})
    return np.array([values.get(axis, 0.0) for axis in AXES])


def _matrix(effects: Effects, name: str) -> Array:
    """Row = output axis."""
    values = effects.get(name, {})
    return np.array([[values.get(a + b, 0.0) for b in AXES] for a in AXES])


def _add_deterministic(gyro: Array, accel: Array, true: Signals, effects: Effects) -> None:
    f, w = true.force, true.rate
    warmth = (true.temp_c - REFERENCE_C)[:, None]
    accel += _vector(effects, "accel_bias")
    accel += f * _vector(effects, "accel_scale")
    accel += f @ _matrix(effects, "accel_misalignment").T
    accel += np.abs(f) * _vector(effects, "accel_scale_asymmetry")
    accel += f**2 * _vector(effects, "accel_quadratic")
    accel += warmth * _vector(effects, "accel_temperature")
    accel += (true.state.speed**2)[:, None] * _vector(effects, "speed_vibration")
    gyro += _vector(effects, "gyro_bias")
    gyro += w * _vector(effects, "gyro_scale")
    gyro += w @ _matrix(effects, "gyro_misalignment").T
    gyro += np.abs(w) * _vector(effects, "gyro_scale_asymmetry")
    gyro += f @ _matrix(effects, "gyro_g_sensitivity").T
    gyro += warmth * _vector(effects, "gyro_temperature")


def _add_noise(
    gyro: Array,
    accel: Array,
    true: Signals,
    effects: Effects,
    noise: ImuNoise,
    rng: np.random.Generator,
    rate_hz: float,
) -> None:
    n = len(gyro)
    # driving shakes more than standing
    moving = np.minimum(true.state.speed / 3.0, 1.0)
    level = 1.0 - noise.quieter_at_rest * (1.0 - moving)
    for signal, density in ((gyro, noise.gyro), (accel, noise.accel)):
        white = heavy(rng, (n, 3), noise.tail)
        signal += white * (density * np.sqrt(rate_hz) * level)[:, None]
    for signal, name in ((gyro, "gyro_bias_walk"), (accel, "accel_bias_walk")):
        density_xyz = _vector(effects, name)
        signal += np.cumsum(rng.normal(size=(n, 3)), axis=0) * density_xyz / np.sqrt(rate_hz)
    length = round(0.25 * rate_hz)
    for begin in rng.integers(0, n, rng.poisson(noise.bursts_per_min * n / rate_hz / 60.0)):
        rows = slice(begin, begin + length)
        size = len(accel[rows])
        shape = np.hanning(length)[:size, None] * moving[rows, None]
        accel[rows] += shape * rng.normal(0.0, noise.burst, (size, 3))
        gyro[rows] += shape * rng.normal(0.0, 0.02 * noise.burst, (size, 3))
    for signal, lsb in ((gyro, noise.gyro_lsb), (accel, noise.accel_lsb)):
        if lsb > 0.0:
            signal[:] = np.round(signal / lsb) * lsb
