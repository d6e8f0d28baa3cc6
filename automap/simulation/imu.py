"""What the inertial sensor records: perfect readings, distorted by named effects, and noise."""

from __future__ import annotations

import numpy as np

from automap.effects import distort_imu, effect_named
from automap.errors import ConfigError
from automap.records import FloatArray, ImuData, IntArray
from automap.simulation.scenario import Imu
from automap.simulation.trajectory import Motion

_SIMULATED = ("imu", "noise")


def check_errors(errors: dict[str, dict[str, float]]) -> None:
    """Refuse effects or parameters that the inertial simulation does not have (ConfigError)."""
    for name, values in errors.items():
        effect = effect_named(name)
        if effect.family not in _SIMULATED:
            raise ConfigError(f"effect '{name}' cannot be given under [errors]; remove it")
        known = [p.name for p in effect.parameters]
        for parameter in values:
            if parameter not in known:
                raise ConfigError(
                    f"effect '{name}' has no parameter '{parameter}'; it has {', '.join(known)}"
                )


def record_imu(
    t_ns: IntArray,
    motion: Motion,
    setup: Imu,
    errors: dict[str, dict[str, float]],
    rng: np.random.Generator,
) -> ImuData:
    """Readings in body axes at ``motion``'s times, stamped ``t_ns`` [n].

    The effects of family "imu" come from the one sensor model; bias walks are integrated
    white noise from zero; white noise has the setup's density over the Nyquist band.
    """
    speed = np.linalg.norm(motion.vel_ned, axis=1)
    gyro, accel = distort_imu(motion.angular_rate, motion.specific_force, errors, speed=speed)
    steps = np.diff(motion.t_s, prepend=motion.t_s[:1])
    gyro += _walk(errors.get("gyro_bias_walk", {}), steps, rng)
    accel += _walk(errors.get("accel_bias_walk", {}), steps, rng)
    root_rate = np.sqrt(setup.rate_hz)
    gyro += rng.standard_normal(gyro.shape) * setup.gyro_noise * root_rate
    accel += rng.standard_normal(accel.shape) * setup.accel_noise * root_rate
    return ImuData(t_ns=t_ns, gyro=gyro, accel=accel)


def _walk(intensity: dict[str, float], steps: FloatArray, rng: np.random.Generator) -> FloatArray:
    scale = np.array([intensity.get(axis, 0.0) for axis in "xyz"])
    kicks = rng.standard_normal((len(steps), 3)) * np.sqrt(steps)[:, None] * scale
    return np.asarray(np.cumsum(kicks, axis=0))
